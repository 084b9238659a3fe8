//! fanal: a physically based renderer that learns where light comes from.
//!
//! Modules are listed in dependency order; each may use only those above it.
pub mod base;
pub mod camera;
pub mod cli;
pub mod film;
pub mod generate;
pub mod geometry;
pub mod guiding;
pub mod integrators;
pub mod lights;
pub mod materials;
pub mod math;
pub mod network;
pub mod reconstruct;
pub mod render;
pub mod report;
pub mod sampling;
pub mod scene;
