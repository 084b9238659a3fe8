//! Indexed triangle meshes.

use glam::{Vec2, Vec3};

/// An indexed triangle mesh in its own coordinates. Shapes refer to it with a transform, so one mesh serves many shapes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Shading normal per vertex, empty where faces are shaded flat: of unit length as read, and of any in a mesh that
    /// [`Shape::in_world`](super::Shape::in_world) has placed, so that they mix between vertices as they would in the
    /// mesh's own coordinates.
    pub normals: Vec<Vec3>,
    /// Texture coordinates per vertex; empty where there are none.
    pub uvs: Vec<Vec2>,
    /// Vertex indices of each triangle, counter-clockwise seen from the front. All are below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let Self { positions, normals, uvs, triangles } = self;
        size_of_val(&positions[..]) + size_of_val(&normals[..]) + size_of_val(&uvs[..]) + size_of_val(&triangles[..])
    }
}
