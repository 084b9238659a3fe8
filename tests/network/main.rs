//! The network by every backend, its files, and what is wrong with them.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod backends;
mod onnx_faults;
mod weights;
