//! fanal: a physically based renderer that learns where light comes from.
//!
//! Modules are listed in dependency order; each may use only those above it.
pub mod base;
pub mod math;
pub mod sampling;
pub mod geometry;
pub mod materials;
pub mod lights;
pub mod camera;
pub mod scene;
pub mod film;
pub mod guiding;
pub mod network;
pub mod reconstruct;
pub mod integrators;
pub mod render;
pub mod generate;
pub mod report;
pub mod cli;
