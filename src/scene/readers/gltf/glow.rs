//! Textured emission: triangles that the texture lights become a shape of their own, and the others stay dark.

use glam::{DVec3, Vec2, Vec3};

use crate::geometry::mesh::Mesh;
use crate::materials::texture::Texture;
use crate::scene::file::Matrix;
use crate::scene::readers::validate::linear;

/// Most rows of points on a triangle at which the texture is read.
const MOST_ROWS: usize = 24;
/// Triangles below this part of the brightest are dark.
const LEAST: f32 = 1e-3;
/// Differences up to this part of the brightest are not worth a texture.
const EVEN: f32 = 0.02;

/// Triangles that shine, triangles that do not, and the mean colour over the area of the former.
#[derive(Debug, Clone, PartialEq)]
pub struct Split {
    /// Triangles that the texture lights.
    pub lit: Vec<[u32; 3]>,
    /// The others.
    pub dark: Vec<[u32; 3]>,
    /// Mean of the texture where it is lit.
    pub mean: Vec3,
    /// Whether all lit triangles have nearly this mean.
    pub is_even: bool,
}

/// What a texture is on a triangle.
struct Over {
    mean: Vec3,
    least: Vec3,
    most: Vec3,
}

/// Splits the triangles of `mesh` by the light that `texture` gives them.
pub fn split(mesh: &Mesh, texture: &Texture) -> Split {
    let all: Vec<Over> = mesh.triangles.iter().map(|triangle| over(mesh, triangle, texture)).collect();
    let brightest = all.iter().map(|over| over.mean.max_element()).fold(0.0, f32::max);
    let is_dark = |over: &Over| over.mean.max_element() <= LEAST * brightest;
    let mut split = Split { lit: Vec::new(), dark: Vec::new(), mean: Vec3::ZERO, is_even: true };
    let (mut sum, mut area) = (Vec3::ZERO, 0.0);
    for (triangle, over) in mesh.triangles.iter().zip(&all) {
        if is_dark(over) {
            split.dark.push(*triangle);
            continue;
        }
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
        let weight = (b - a).cross(c - a).length();
        split.lit.push(*triangle);
        sum += over.mean * weight;
        area += weight;
    }
    if area > 0.0 {
        split.mean = sum / area;
    }
    let near = |color: Vec3| color.abs_diff_eq(split.mean, EVEN * brightest);
    split.is_even = all.iter().all(|over| is_dark(over) || near(over.least) && near(over.most));
    split
}

/// Area of a mesh where it is placed, times what `texture` is in the middle of each triangle.
pub fn lit_area(mesh: &Mesh, to_world: &Matrix, texture: Option<&Texture>) -> DVec3 {
    let to_world = linear(to_world);
    let of = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].as_dvec3());
        let area = 0.5 * (to_world * (b - a)).cross(to_world * (c - a)).length();
        let uv = |vertex: u32| mesh.uvs.get(vertex as usize).copied().unwrap_or_default();
        let middle = triangle.map(uv).iter().sum::<Vec2>() / 3.0;
        area * texture.map_or(DVec3::ONE, |texture| texture.eval(middle).as_dvec3())
    };
    mesh.triangles.iter().map(of).sum()
}

/// The texture over a triangle, read at as many points as the triangle has pixels, within bounds.
fn over(mesh: &Mesh, triangle: &[u32; 3], texture: &Texture) -> Over {
    let uv = |vertex: u32| mesh.uvs.get(vertex as usize).copied().filter(|uv| uv.is_finite()).unwrap_or(Vec2::ZERO);
    let [a, b, c] = triangle.map(uv);
    let pixels = match texture {
        Texture::Bitmap { image, .. } => image.size().map(|side| side as f32),
        _ => [1.0; 2],
    };
    let size = |edge: Vec2| (edge * Vec2::from_array(pixels)).length();
    let rows = (size(b - a).max(size(c - a)).ceil() as usize).clamp(2, MOST_ROWS);
    let mut over = Over { mean: Vec3::ZERO, least: Vec3::INFINITY, most: Vec3::NEG_INFINITY };
    for row in 0..rows {
        for column in 0..rows - row {
            // Within the triangle, each point for a part of about the same size.
            let [x, y] = [column, row].map(|i| (i as f32 + 1.0 / 3.0) / rows as f32);
            let color = texture.eval(a + (b - a) * x + (c - a) * y);
            over.mean += color;
            (over.least, over.most) = (over.least.min(color), over.most.max(color));
        }
    }
    over.mean /= (rows * (rows + 1) / 2) as f32;
    over
}
