//! fanal: a physically based renderer that learns where light comes from.
//!
//! Dependencies run one way: base, math, picture, sampling, geometry, then materials, lights and camera, then scene, film, guiding,
//! network, reconstruct, integrators, render, generate, report, cli. A test holds every `use` against this order.

#![deny(unsafe_code)]

pub mod base;
pub mod math;
pub mod picture;
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
