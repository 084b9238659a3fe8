//! Surfaces both of whose sides shine, as two sheets back to back: a surface shines from its front.

use std::collections::HashMap;

use crate::geometry::mesh::Mesh;

use super::extent;

/// Distance of the sheets over the size of the surface.
pub const GAP: f64 = 1e-4;

/// Two sheets of a mesh, one in front of it and one behind it that faces backwards, [`GAP`] parts of its size apart.
pub fn sheets(mesh: &Mesh) -> Mesh {
    let [low, high] = extent::bounds(mesh);
    let step = (0.5 * GAP * (high - low).max_element().max(0.0)) as f32;
    let mut out = Mesh::default();
    for side in [1.0, -1.0] {
        for triangle in &mesh.triangles {
            let corners = triangle.map(|i| mesh.positions[i as usize]);
            let [a, b, c] = corners.map(|p| p.as_dvec3());
            let offset = (b - a).cross(c - a).normalize_or_zero().as_vec3() * step * side;
            let first = out.positions.len() as u32;
            let order = if side > 0.0 { [0, 1, 2] } else { [0, 2, 1] };
            out.triangles.push(order.map(|corner| first + corner));
            out.positions.extend(corners.map(|p| p + offset));
            let normal = |i: u32| mesh.normals.get(i as usize).map(|n| *n * side);
            out.normals.extend(triangle.iter().filter_map(|&i| normal(i)));
            out.uvs.extend(triangle.iter().filter_map(|&i| mesh.uvs.get(i as usize)));
        }
    }
    out
}

/// Whether a mesh has a border, so that it shows its other side: an edge of one triangle alone. Vertices at one position count as one.
pub fn is_open(mesh: &Mesh) -> bool {
    let mut edges: HashMap<[[u32; 3]; 2], u32> = HashMap::new();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|i| (mesh.positions[i as usize] + 0.0).to_array().map(f32::to_bits));
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let edge = [corners[a].min(corners[b]), corners[a].max(corners[b])];
            *edges.entry(edge).or_default() += 1;
        }
    }
    edges.into_values().any(|count| count == 1)
}

#[cfg(test)]
mod tests {
    use super::super::builtin;
    use super::*;

    #[test]
    fn a_cube_is_closed_and_a_rectangle_is_not() {
        assert!(is_open(&builtin::rectangle()) && !is_open(&builtin::cube()));
        let both = sheets(&builtin::rectangle());
        assert_eq!(both.triangles.len(), 4);
        let heights: Vec<f32> = both.positions.iter().map(|p| p.z).collect();
        assert!(
            heights[..6].iter().all(|z| (z - 1e-4).abs() < 1e-6)
                && heights[6..].iter().all(|z| (z + 1e-4).abs() < 1e-6)
        );
        assert!(both.normals[..6].iter().all(|n| n.z == 1.0) && both.normals[6..].iter().all(|n| n.z == -1.0));
    }
}
