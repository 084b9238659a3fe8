//! Voxels of space, the groups that they belong to, and the map that carries directions between the points of a voxel.

pub(in crate::guiding) mod arrays;
pub mod parallax;
mod spatial;

pub use spatial::*;
