//! Light that is transported: means, hard scenes, effects, stopping, the picture.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod complete_paths;
mod denoise;
mod determinism;
mod dropped;
mod effects;
mod film;
mod fireflies;
mod hard_scenes;
mod lights;
mod mattes;
mod media;
mod own_scenes;
mod projectors;
mod robustness;
mod roulette;
mod stopping;
mod surfaces;
mod views;
mod volumes;
