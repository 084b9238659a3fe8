//! The guiding field that a pass samples from, frozen while it runs, its files, and the roulette that goes by it.

pub mod field;
pub mod file;
pub mod lanes;
pub mod roulette;
