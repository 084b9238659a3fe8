//! Colours of vertices as a picture: of each triangle a square of two by two pixels, between whose centres a bilinear filter is the
//! linear interpolation between the triangle's corners.

use glam::{Vec2, Vec3};

use crate::geometry::mesh::Mesh;
use crate::picture::Image;

/// Most triangles that are painted: the picture has four pixels for each.
const MOST_TRIANGLES: usize = 1 << 22;

/// Paints `mesh`, whose vertices have these colours times `factor`; see [`painted_corners`].
pub fn painted(mesh: &Mesh, colors: &[Vec3], factor: Vec3) -> Option<(Mesh, Image)> {
    if colors.len() != mesh.positions.len() {
        return None;
    }
    let color = |vertex: u32| colors.get(vertex as usize).map_or(Vec3::ZERO, |color| *color * factor);
    let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|triangle| triangle.map(color)).collect();
    painted_corners(mesh, &corners)
}

/// Paints `mesh`, the corners of whose triangles have these colours: returns it with texture coordinates of its own for each corner,
/// the same for all colours, and the picture. None where it is too large.
pub fn painted_corners(mesh: &Mesh, corners: &[[Vec3; 3]]) -> Option<(Mesh, Image)> {
    let count = mesh.triangles.len();
    if count == 0 || count > MOST_TRIANGLES || corners.len() != count {
        return None;
    }
    let columns = (count as f64).sqrt().ceil() as usize;
    let [width, height] = [2 * columns, 2 * count.div_ceil(columns)];
    let mut pixels = vec![Vec3::ZERO; width * height];
    let mut out = Mesh::default();
    for (index, (triangle, [a, b, c])) in mesh.triangles.iter().zip(corners).enumerate() {
        let [x, y] = [2 * (index % columns), 2 * (index / columns)];
        // The fourth corner continues the plane through the other three; no point of the triangle takes more than it can bear.
        for (offset, color) in [([0, 0], *a), ([1, 0], *b), ([0, 1], *c), ([1, 1], *b + *c - *a)] {
            pixels[(y + offset[1]) * width + x + offset[0]] = color;
        }
        let first = 3 * index as u32;
        out.triangles.push([first, first + 1, first + 2]);
        for (vertex, offset) in triangle.iter().zip([[0, 0], [1, 0], [0, 1]]) {
            let at = Vec2::new((x + offset[0]) as f32 + 0.5, (y + offset[1]) as f32 + 0.5);
            out.uvs.push(at / Vec2::new(width as f32, height as f32));
            out.positions.push(mesh.positions[*vertex as usize]);
            out.normals.extend(mesh.normals.get(*vertex as usize));
        }
    }
    Some((out, Image { width, height, pixels }))
}
