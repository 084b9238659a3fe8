//! Foundations that know nothing of rendering: errors, atomic file writing, progress, the process, random numbers.

pub mod error;
pub mod files;
mod named;
pub mod pages;
pub mod process;
pub mod processor;
pub mod progress;
pub mod random;
mod sobol;
pub mod streamed;
pub mod tensors;

pub use error::{At, Error, Place, Result, Unfit};
pub use named::named;
pub use progress::{Progress, Silent};
