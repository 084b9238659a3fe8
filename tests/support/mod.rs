//! What several tests need.

pub mod blocks;
pub mod chart;
pub mod files;
pub mod gltf;
pub mod network;
pub mod records;
pub mod scenes;
pub mod statistics;
pub mod stop;
pub mod twins;
