//! What a pass samples from, frozen while it runs, and its files.

pub mod field;
pub mod file;
pub mod roulette;
