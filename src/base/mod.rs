//! Foundations that know nothing of rendering: errors, atomic file writing, random numbers.

pub mod error;
pub mod files;
pub mod random;

pub use error::{Error, Place, Result};
