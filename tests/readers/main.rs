//! Scenes in every format.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod as_found;
mod cameras;
mod daylight;
mod definitions;
mod dialects;
mod formats;
mod gltf;
mod gltf_damage;
mod gltf_materials;
mod pbrt;
mod projectors;
mod scenes;
mod volumes;
