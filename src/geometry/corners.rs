//! Points of triangles: what lies between their corners, for one hit or for sixteen at once.

use glam::{Mat3, Vec2, Vec3};

use super::mesh::Mesh;
use super::shape::{Geometry, Shape};
use super::{Hit, Surface};
use crate::math::error_bound::gamma;
use crate::math::lanes::{self, Kernel, LANES, Real, V3, Wide};

/// Corners of a triangle in each lane.
pub(super) struct Corners<R> {
    /// In the world.
    positions: [V3<R>; 3],
    /// As the mesh has them; zero where it has none.
    normals: [V3<R>; 3],
    uvs: [[R; 2]; 3],
    /// 1, or −1 where the front is the side opposite to the stored normals.
    front: R,
    /// See [`Geometry::Mesh`].
    winding: R,
    /// Takes normals to the world; none where the mesh is there.
    to_world: Option<Mat3>,
}

/// Points of triangles.
pub(super) struct Points<R> {
    pub point: V3<R>,
    /// Sums of the absolute values of the terms that its coordinates were summed from.
    pub magnitudes: V3<R>,
    /// Unit geometric normal on the front side.
    pub normal: V3<R>,
    /// Unit shading normal.
    pub smooth: V3<R>,
    pub uv: [R; 2],
}

impl<R: Real> Corners<R> {
    /// The points of barycentric coordinates b₁, b₂.
    #[inline(always)]
    pub fn at(&self, [b1, b2]: [R; 2]) -> Points<R> {
        let ([a, b, c], [ta, tb, tc]) = (self.positions, self.uvs);
        let b0 = b1.all(1.0) - b1 - b2;
        let parts = [a * b0, b * b1, c * b2];
        let (across, there) = (b - a).cross(c - a).try_normalize();
        let up = V3::new(b1.all(0.0), b1.all(0.0), b1.all(1.0));
        let normal = V3::choose(there, across, up) * (self.winding * self.front);
        // A function of its own, which a closure is, would not be compiled for wide numbers.
        let [u, v] = [ta[0] * b0 + tb[0] * b1 + tc[0] * b2, ta[1] * b0 + tb[1] * b1 + tc[1] * b2];
        Points {
            point: parts[0] + parts[1] + parts[2],
            magnitudes: parts[0].abs() + parts[1].abs() + parts[2].abs(),
            normal,
            smooth: self.smooth(normal, [b0, b1, b2]),
            uv: [u, v],
        }
    }

    /// The shading normals: `flat` ones where there are no others.
    #[inline(always)]
    fn smooth(&self, flat: V3<R>, [b0, b1, b2]: [R; 3]) -> V3<R> {
        let [a, b, c] = self.normals;
        let mut sum = V3::splat(b0.all(0.0)) + a * b0 + b * b1 + c * b2;
        if let Some(Mat3 { x_axis, y_axis, z_axis }) = self.to_world {
            sum = sum.all(x_axis) * sum.x + sum.all(y_axis) * sum.y + sum.all(z_axis) * sum.z;
        }
        let (smooth, there) = sum.try_normalize();
        V3::choose(there, smooth * self.front, flat)
    }
}

/// Normals and texture coordinates of a triangle's corners, as stored.
#[inline(always)]
fn stored(mesh: &Mesh, triangle: u32) -> ([Vec3; 3], [Vec2; 3]) {
    let corners = mesh.triangles[triangle as usize].map(|vertex| vertex as usize);
    let normals = if mesh.normals.is_empty() { [Vec3::ZERO; 3] } else { corners.map(|vertex| mesh.normals[vertex]) };
    let uvs = if mesh.uvs.is_empty() { [Vec2::ZERO, Vec2::X, Vec2::Y] } else { corners.map(|vertex| mesh.uvs[vertex]) };
    (normals, uvs)
}

impl Corners<f32> {
    /// Of a triangle of a mesh.
    #[inline(always)]
    pub fn new(shape: &Shape, triangle: u32) -> Self {
        let Geometry::Mesh { mesh, normal_to_world, winding, rounding, .. } = &shape.geometry else {
            unreachable!("only meshes have triangles")
        };
        let (normals, uvs) = stored(mesh, triangle);
        Self {
            positions: shape.triangle(triangle).map(V3::from),
            normals: normals.map(V3::from),
            uvs: uvs.map(|uv| uv.to_array()),
            front: shape.front(),
            winding: *winding,
            to_world: rounding.as_ref().map(|_| *normal_to_world),
        }
    }
}

/// Numbers of a hit: three positions, three normals, three texture coordinates, two barycentric ones, front and winding.
const NUMBERS: usize = 28;

/// Hits of triangles of meshes in world coordinates, one in each row.
struct Triangles([[f32; NUMBERS]; LANES]);

impl Triangles {
    #[inline(always)]
    fn set(&mut self, lane: usize, hit: &Hit, mesh: &Mesh, front: f32, winding: f32) {
        let positions = mesh.triangles[hit.triangle as usize].map(|vertex| mesh.positions[vertex as usize]);
        let ([a, b, c], ([na, nb, nc], [ta, tb, tc])) = (positions, stored(mesh, hit.triangle));
        let [b1, b2] = hit.barycentric;
        let row = &mut self.0[lane];
        for (place, vector) in [a, b, c, na, nb, nc].into_iter().enumerate() {
            row[3 * place..3 * place + 3].copy_from_slice(&vector.to_array());
        }
        for (place, uv) in [ta, tb, tc].into_iter().enumerate() {
            row[18 + 2 * place..20 + 2 * place].copy_from_slice(&uv.to_array());
        }
        row[24..].copy_from_slice(&[b1, b2, front, winding]);
    }
}

/// [`Triangles`], and the surfaces that their points are to become.
struct Sixteen<'t> {
    triangles: &'t Triangles,
    surfaces: &'t mut [Surface; LANES],
}

impl Kernel for Sixteen<'_> {
    type Output = ();

    /// Makes all of a surface but what its hit says.
    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let numbers = wide.columns(&self.triangles.0);
        let vector = |at: usize| V3::new(numbers[at], numbers[at + 1], numbers[at + 2]);
        let pair = |at: usize| [numbers[at], numbers[at + 1]];
        let corners = Corners {
            positions: [vector(0), vector(3), vector(6)],
            normals: [vector(9), vector(12), vector(15)],
            uvs: [pair(18), pair(20), pair(22)],
            front: numbers[26],
            winding: numbers[27],
            to_world: None,
        };
        let Points { point, magnitudes, normal, smooth, uv: [u, v] } = corners.at(pair(24));
        let error = magnitudes * magnitudes.x.all(gamma(12));
        let (p, e, n, s) = (point, error, normal, smooth);
        for (number, four) in [[p.x, p.y, p.z, e.x], [e.y, e.z, n.x, n.y], [n.z, s.x, s.y, s.z], [s.x, s.y, s.z, u]]
            .into_iter()
            .enumerate()
        {
            let rows = wide.four_rows(four);
            for (surface, row) in self.surfaces.iter_mut().zip(&rows) {
                surface.numbers_mut()[4 * number..4 * number + 4].copy_from_slice(row);
            }
        }
        for (surface, v) in self.surfaces.iter_mut().zip(wide.store(v)) {
            surface.uv.y = v;
        }
    }
}

/// Fewest hits that are worth lanes.
const FEWEST: usize = 4;

/// Makes the surfaces at up to [`LANES`] hits that are on meshes in world coordinates, if they are many enough. Returns which were
/// made, one bit each. Where there are places for sixteen, the others mean nothing thereafter.
#[inline(always)]
pub(super) fn surfaces(hits: &[Option<Hit>], shapes: &[Shape], surfaces: &mut [Surface]) -> u32 {
    if !lanes::available() {
        return 0;
    }
    let (mut triangles, mut made) = (Triangles([[0.0; NUMBERS]; LANES]), 0u32);
    for (lane, hit) in hits.iter().enumerate().take(LANES) {
        let Some(hit) = hit else { continue };
        let shape = &shapes[hit.shape as usize];
        if let Geometry::Mesh { mesh, winding, rounding: None, .. } = &shape.geometry {
            triangles.set(lane, hit, mesh, shape.front(), *winding);
            made |= 1 << lane;
        }
    }
    if (made.count_ones() as usize) < FEWEST {
        return 0;
    }
    let Some(places) = surfaces.first_chunk_mut::<LANES>() else { return 0 };
    if lanes::run(Sixteen { triangles: &triangles, surfaces: places }).is_err() {
        return 0;
    }
    for (hit, surface) in hits.iter().zip(places) {
        if let Some(hit) = hit {
            (surface.distance, surface.shape, surface.angle) = (hit.distance, hit.shape, 0.0);
        }
    }
    made
}
