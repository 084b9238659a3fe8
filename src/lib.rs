//! fanal: a physically based renderer that learns where light comes from.
//!
//! Dependencies run one way: base, math, sampling, geometry, then materials, lights and camera, then scene, film, guiding,
//! network, reconstruct, integrators, render, generate, report, cli. A test holds every `use` against this order.

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
