//! The reconstruction network on plain slices: its configuration, its one list of operations, its weights, and the
//! embedded forward pass.

pub mod backend;
pub mod batch;
pub mod config;
pub mod embedded;
pub mod growing;
#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
pub mod kernels;
pub mod program;
pub mod seal;
pub mod weights;

mod executable;
mod fusion;
mod rows;
