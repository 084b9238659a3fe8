//! Scenes: the file model, its readers, and the immutable scene that is rendered.

pub mod file;
pub mod readers;
