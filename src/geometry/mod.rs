//! Geometry: meshes, spheres and the bounding volume hierarchy over them.

pub mod mesh;
