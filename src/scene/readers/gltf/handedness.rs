//! Pictures that are seen mirrored: symmetrical models often have one half of their picture on both sides.

use crate::geometry::mesh::Mesh;

/// Splits a mesh into the triangles that show pictures as they are and those that show them mirrored. v points down on pictures.
pub fn split(mesh: Mesh) -> [Mesh; 2] {
    let is_mirrored = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| mesh.uvs.get(vertex as usize).copied().unwrap_or_default());
        (b - a).perp_dot(c - a) > 0.0
    };
    let (mirrored, straight): (Vec<_>, Vec<_>) = mesh.triangles.iter().partition(|triangle| is_mirrored(triangle));
    match (straight.is_empty(), mirrored.is_empty()) {
        (_, true) => [mesh, Mesh::default()],
        (true, false) => [Mesh::default(), mesh],
        (false, false) => [Mesh { triangles: straight, ..mesh.clone() }, Mesh { triangles: mirrored, ..mesh }],
    }
}
