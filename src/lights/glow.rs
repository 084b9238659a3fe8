//! Emission that varies over a surface by a texture. The triangles of a mesh are cut along the lines of a grid over the texture's
//! picture; the pieces are drawn in proportion to their area times the brightness of their cell, and points evenly within a piece. So
//! the density of a point follows from its texture coordinates alone.

use std::f32::consts::PI;

use glam::{Affine2, DVec2, DVec3, Vec2, Vec3};

use super::cut;
use crate::geometry::Shape;
use crate::geometry::sphere::Sphere;
use crate::math::channel_mean;
use crate::math::lanes::V3;
use crate::picture::texture::{Texture, Wrap};
use crate::sampling::discrete::Discrete;
use crate::sampling::warp;

/// Most rows and columns of the grid.
const MOST_CELLS: usize = 64;
/// Points along each side of a cell at which its brightness is read.
const POINTS: usize = 6;
/// Brightness that every cell has at least, as a part of the mean: no point that emits may have no density.
const LEAST: f32 = 0.1;
/// About the most pieces that a mesh is cut into, of 90 bytes each, or two for each triangle of a large one; the grid
/// gets coarser until they suffice.
pub const MOST_PIECES: usize = 1 << 16;

/// A texture of emission with the distribution of points by it.
#[derive(Debug, Clone)]
pub struct Glow {
    texture: Texture,
    /// Rows, and columns, of the grid over a period of the picture.
    side: usize,
    /// Relative density of each cell, row by row; all positive.
    cells: Vec<f32>,
    /// Texture coordinates of each piece's corners.
    uvs: Vec<[Vec2; 3]>,
    /// Inverse density per area of each piece's cell: the area that an even light of its brightness would have.
    areas: Vec<f32>,
    /// Sum of area times relative density.
    total: f32,
}

/// A piece of a triangle: its corners in the world, and their texture coordinates.
struct Piece {
    corners: [Vec3; 3],
    uvs: [Vec2; 3],
    triangle: u32,
    weight: f64,
}

/// What an emitting mesh is drawn by.
pub struct Cut {
    /// Distribution over the pieces.
    pub pieces: Discrete,
    /// Each piece's corners in the world.
    pub corners: Vec<[Vec3; 3]>,
    /// The triangle that it is part of.
    pub triangles: Vec<u32>,
    /// ∫ of the radiance over the surface, W·sr⁻¹.
    pub integral: Vec3,
}

impl Glow {
    /// The emission of a sphere, whose points are not drawn by it.
    pub fn of_sphere(texture: Texture) -> Self {
        Self { texture, side: 1, cells: vec![1.0], uvs: Vec::new(), areas: Vec::new(), total: 1.0 }
    }

    /// The emission of a mesh, `radiance` times the texture, and the pieces by which it is drawn; `most` is as
    /// [`MOST_PIECES`] says.
    pub fn of_mesh(texture: Texture, radiance: Vec3, shape: &Shape, triangles: u32, most: usize) -> (Self, Cut) {
        let side = fitting_side(&texture, shape, triangles, most);
        let cells = brightness(&texture, side);
        let mut glow = Self { texture, side, cells, uvs: Vec::new(), areas: Vec::new(), total: 0.0 };
        let pieces: Vec<Piece> = (0..triangles).flat_map(|triangle| glow.cut(shape, triangle)).collect();
        let distribution = Discrete::new(pieces.iter().map(|piece| piece.weight));
        glow.total = distribution.total() as f32;
        glow.areas = pieces.iter().map(|piece| glow.total / glow.cell(middle(piece.uvs))).collect();
        glow.uvs = pieces.iter().map(|piece| piece.uvs).collect();
        let read: Vec3 = pieces.iter().map(|piece| glow.mean(piece.uvs) * area(piece.corners) as f32).sum();
        // Points may miss the few pixels that shine, and what has no power is never chosen.
        let integral = radiance * if radiance * read == Vec3::ZERO { glow.integral_of_pixels(&pieces) } else { read };
        let triangles = pieces.iter().map(|piece| piece.triangle).collect();
        let corners = pieces.into_iter().map(|piece| piece.corners).collect();
        (glow, Cut { pieces: distribution, corners, triangles, integral })
    }

    /// Factor on the radiance at texture coordinates.
    #[inline]
    pub fn at(&self, uv: Vec2) -> Vec3 {
        self.texture.eval(uv).max(Vec3::ZERO)
    }

    /// The same on a sphere, in the direction `outward` in its own frame.
    #[inline]
    pub fn on_sphere(&self, outward: Vec3) -> Vec3 {
        self.at(Sphere::uv(outward))
    }

    /// Mean over the area of a sphere.
    pub fn mean_on_sphere(&self) -> Vec3 {
        const ROWS: usize = 64;
        let mut sum = Vec3::ZERO;
        for row in 0..ROWS {
            let v = (row as f32 + 0.5) / ROWS as f32;
            for column in 0..2 * ROWS {
                sum += self.at(Vec2::new((column as f32 + 0.5) / (2 * ROWS) as f32, v)) * (PI * v).sin();
            }
        }
        sum * (0.25 * PI / (ROWS * ROWS) as f32)
    }

    /// Mean of the texture.
    pub fn mean_of_texture(&self) -> Vec3 {
        self.texture.mean().max(Vec3::ZERO)
    }

    /// ∫ of the texture over pieces by the means of their cells, which miss nothing.
    fn integral_of_pixels(&self, pieces: &[Piece]) -> Vec3 {
        let mut means = vec![None; self.cells.len()];
        let of_piece = |piece: &Piece| {
            let cell = self.index(middle(piece.uvs));
            *means[cell].get_or_insert_with(|| self.mean_of_pixels(cell)) * area(piece.corners) as f32
        };
        pieces.iter().map(of_piece).sum()
    }

    /// Mean of the pixels of a cell and of those next to it, which are read for points near its edges.
    fn mean_of_pixels(&self, cell: usize) -> Vec3 {
        let Texture::Bitmap { image, scale, .. } = &self.texture else {
            // The squares of a board are cells, so that points of all were read, unless all of it is a single cell.
            return if self.side == 1 { self.mean_of_texture() } else { Vec3::ZERO };
        };
        let along = |part: usize, pixels: usize| {
            let (first, beyond) = (part * pixels / self.side, ((part + 1) * pixels).div_ceil(self.side));
            // One before the first, from the other side where there is none.
            (first + pixels - 1..=beyond + pixels).map(move |index| index % pixels)
        };
        let [width, height] = image.size();
        let (mut sum, mut count) = (DVec3::ZERO, 0usize);
        for row in along(cell / self.side, height) {
            for column in along(cell % self.side, width) {
                let [pixel] = image.pixels([row * width + column]);
                sum += (pixel * *scale).max(Vec3::ZERO).as_dvec3();
                count += 1;
            }
        }
        (sum / count as f64).as_vec3()
    }

    /// The factor on the radiance where the uniform numbers `u` lead to within `piece`, and the inverse of the density there.
    #[inline]
    pub fn drawn(&self, piece: usize, u: [f32; 2]) -> (Vec3, f32) {
        let [b1, b2] = warp::lanes::square_to_triangle(u);
        let [a, b, c] = self.uvs[piece];
        (self.at(a * (1.0 - b1 - b2) + b * b1 + c * b2), self.areas[piece])
    }

    /// The inverse of the density per area at texture coordinates.
    #[inline]
    pub fn area(&self, uv: Vec2) -> f32 {
        self.total / self.cell(uv)
    }

    /// Index of the cell at texture coordinates.
    fn index(&self, uv: Vec2) -> usize {
        let (to_uv, wrap) = placement(&self.texture);
        let [column, row] = to_uv.transform_point2(uv).to_array().map(|x| fold(x, wrap, self.side));
        row * self.side + column
    }

    /// Relative density of the cell at texture coordinates.
    fn cell(&self, uv: Vec2) -> f32 {
        self.cells[self.index(uv)]
    }

    /// Mean of the texture over a small triangle.
    fn mean(&self, [a, b, c]: [Vec2; 3]) -> Vec3 {
        let middle = middle([a, b, c]);
        [middle, middle.lerp(a, 0.5), middle.lerp(b, 0.5), middle.lerp(c, 0.5)]
            .map(|uv| self.at(uv))
            .iter()
            .sum::<Vec3>()
            / 4.0
    }

    /// Cuts a triangle along the lines of the grid.
    fn cut(&self, shape: &Shape, triangle: u32) -> Vec<Piece> {
        let (positions, uvs) = (shape.triangle(triangle).map(Vec3::as_dvec3), shape.triangle_uvs(triangle));
        let (to_uv, _) = placement(&self.texture);
        let pieces = cut::cells(uvs.map(|uv| to_uv.transform_point2(uv).as_dvec2()), self.side);
        let place = |part: DVec2| {
            let weights = [1.0 - part.x - part.y, part.x, part.y];
            let position = positions[0] * weights[0] + positions[1] * weights[1] + positions[2] * weights[2];
            let [a, b, c] = weights.map(|weight| weight as f32);
            (position.as_vec3(), uvs[0] * a + uvs[1] * b + uvs[2] * c)
        };
        let mut out = Vec::new();
        for polygon in pieces {
            for pair in polygon.windows(2).skip(1) {
                let [(a, ta), (b, tb), (c, tc)] = [polygon[0], pair[0], pair[1]].map(place);
                let (corners, uvs) = ([a, b, c], [ta, tb, tc]);
                let weight = area(corners) * f64::from(self.cell(middle(uvs)));
                out.push(Piece { corners, uvs, triangle, weight });
            }
        }
        out
    }
}

fn area([a, b, c]: [Vec3; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    0.5 * (b - a).cross(c - a).length()
}

fn middle([a, b, c]: [Vec2; 3]) -> Vec2 {
    (a + b + c) / 3.0
}

/// From texture coordinates to the picture, and how that goes on beyond its edges.
fn placement(texture: &Texture) -> (Affine2, Wrap) {
    match texture {
        Texture::Constant(_) => (Affine2::IDENTITY, Wrap::Clamp),
        Texture::Bitmap { to_uv, wrap, .. } => (*to_uv, *wrap),
        Texture::Checkerboard { to_uv, .. } => (*to_uv, Wrap::Repeat),
    }
}

/// The column (or row), of `side`, of a place on the picture.
fn fold(x: f32, wrap: Wrap, side: usize) -> usize {
    let inside = match wrap {
        Wrap::Repeat => x - x.floor(),
        Wrap::Clamp => x,
        Wrap::Mirror => {
            let turn = x - 2.0 * (x / 2.0).floor();
            turn.min(2.0 - turn)
        }
    };
    // Casts saturate, and NaN counts as 0.
    ((inside * side as f32) as usize).min(side - 1)
}

/// Rows and columns of the grid: as fine as the picture, as long as the mesh is not cut into too many pieces.
fn fitting_side(texture: &Texture, shape: &Shape, triangles: u32, most: usize) -> usize {
    let (to_uv, _) = placement(texture);
    let mut side = match texture {
        Texture::Constant(_) => 1,
        Texture::Checkerboard { .. } => 2,
        Texture::Bitmap { image, .. } => image.size().into_iter().max().unwrap_or(1).clamp(1, MOST_CELLS),
    };
    // Width and height together, and twice the area on the picture.
    let sizes: Vec<[f64; 2]> = (0..triangles)
        .map(|triangle| {
            let [a, b, c] = shape.triangle_uvs(triangle).map(|uv| to_uv.transform_point2(uv).as_dvec2());
            [(a.max(b).max(c) - a.min(b).min(c)).element_sum(), (b - a).perp_dot(c - a).abs()]
        })
        .collect();
    let pieces = |side: usize| -> f64 {
        let side = side as f64;
        // In the mean over all places of the grid there are as many cuts as the triangle is wide, high and large in
        // cells; and each of a polygon in two adds two to the triangles that make it up.
        sizes.iter().map(|[span, twice_area]| 1.0 + side * (2.0 * span + side * twice_area)).sum()
    };
    let fits = |side: usize| pieces(side) <= f64::max(most as f64, 2.0 * f64::from(triangles));
    while side > 1 && !fits(side) {
        side /= 2;
    }
    side
}

/// Relative density of each cell of the grid: its mean brightness, and a part of that of all.
fn brightness(texture: &Texture, side: usize) -> Vec<f32> {
    let plain = match texture.clone() {
        Texture::Bitmap { image, scale, wrap, nearest, .. } => {
            Texture::Bitmap { image, scale, wrap, nearest, to_uv: Affine2::IDENTITY }
        }
        Texture::Checkerboard { color0, color1, .. } => {
            Texture::Checkerboard { color0, color1, to_uv: Affine2::IDENTITY }
        }
        constant => constant,
    };
    let step = 1.0 / (side * POINTS) as f32;
    let at = |row: usize, column: usize| {
        let uv = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * step;
        channel_mean(plain.eval(uv).max(Vec3::ZERO))
    };
    let mut cells: Vec<f32> = (0..side * side)
        .map(|cell| {
            let [row, column] = [cell / side * POINTS, cell % side * POINTS];
            let points = (0..POINTS * POINTS).map(|point| at(row + point / POINTS, column + point % POINTS));
            points.sum::<f32>() / (POINTS * POINTS) as f32
        })
        .collect();
    let mean = cells.iter().sum::<f32>() / cells.len() as f32;
    // A black picture, or one too bright to be added up, is drawn evenly.
    let usable = mean > 0.0 && mean.is_finite();
    cells.iter_mut().for_each(|cell| *cell = if usable { *cell / mean + LEAST } else { 1.0 });
    cells
}

/// The factors of a lane's sphere, see [`Glow::on_sphere`].
#[inline(always)]
pub fn on_sphere(glow: Option<&Glow>, shape: &Shape, outward: [f32; 3], radiance: V3<f32>) -> [f32; 3] {
    let Some(glow) = glow else { return [radiance.x, radiance.y, radiance.z] };
    let outward = Vec3::from_array(outward).normalize_or(Vec3::Z);
    (Vec3::from(radiance) * glow.on_sphere(shape.turn.map_or(outward, |turn| turn * outward))).to_array()
}
