//! Where things are learned: voxels of space, the groups that they belong to, and how directions are carried between their points.

pub(in crate::guiding) mod arrays;
pub mod parallax;
mod spatial;

pub use spatial::*;
