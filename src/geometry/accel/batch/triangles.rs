//! The triangles of four packets, each against its own ray, or of one packet against four rays, in one go. Every lane does what
//! [`super::super::avx2`] does, operation by operation.

use super::super::node::LANES;
use crate::geometry::triangle::{ERROR_EDGE, ERROR_XY, ERROR_Z, Shear};
use crate::math::lanes::{Mask, Real, Wide};

/// Packets that are tested at a time, each against its own ray.
pub const GROUP: usize = 4;

/// Constants of a ray's tests against triangles, as [`each`] loads them.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct RayBlock {
    /// The origin and the shear by permuted axis, the maximum distance, and nothing.
    pub values: [f32; 8],
    /// The permuted axes.
    pub axes: [u8; 3],
}

impl RayBlock {
    /// Index of the maximum distance.
    pub const T_MAX: usize = 6;

    #[inline(always)]
    pub fn new(shear: &Shear, t_max: f32) -> Self {
        let [kx, ky, kz] = shear.axes;
        let [o, s] = [shear.origin, shear.shear];
        Self { values: [o[kx], o[ky], o[kz], s.x, s.y, s.z, t_max, 0.0], axes: [kx as u8, ky as u8, kz as u8] }
    }
}

/// Result of testing a group of packets: lane `LANES · i + j` is for triangle j of packet i.
pub struct Found {
    /// Lanes whose triangle the ray meets, one bit each.
    pub mask: u32,
    /// Lanes with an edge function of zero, to be tested in double precision.
    pub on_edge: u32,
    pub distances: [f32; GROUP * LANES],
    pub b1: [f32; GROUP * LANES],
    pub b2: [f32; GROUP * LANES],
}

impl Found {
    pub const NOTHING: Self = Self {
        mask: 0,
        on_edge: 0,
        distances: [0.0; GROUP * LANES],
        b1: [0.0; GROUP * LANES],
        b2: [0.0; GROUP * LANES],
    };
}

/// What a test needs: the vertices by vertex, and the rays' origins and shears, all by permuted axis, and maximum distances.
pub struct Operands<R> {
    pub vertices: [[R; 3]; 3],
    pub origin: [R; 3],
    pub shear: [R; 3],
    pub t_max: R,
}

/// Tests triangles against rays. `INCLUSIVE` counts hits at the maximum distance as well. With `EARLY` it ends where no ray is inside of
/// a triangle.
#[inline(always)]
pub fn test<T: Wide, const INCLUSIVE: bool, const EARLY: bool>(
    tests: T,
    operands: Operands<T::Real>,
    found: &mut Found,
) {
    let Operands { vertices: [a, b, c], origin: [ox, oy, oz], shear: [sx, sy, sz], t_max } = operands;
    let zero = t_max.all(0.0);
    let [az, bz, cz] = [a[2] - oz, b[2] - oz, c[2] - oz];
    let [ax, bx, cx] = [(a[0] - ox) - sx * az, (b[0] - ox) - sx * bz, (c[0] - ox) - sx * cz];
    let [ay, by, cy] = [(a[1] - oy) - sy * az, (b[1] - oy) - sy * bz, (c[1] - oy) - sy * cz];
    let [u, v, w] = [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax];
    let on_edge = u.same(zero) | v.same(zero) | w.same(zero);
    // All of one sign: the least is not negative or the largest is not positive. Neither holds for NaN.
    let (least, largest) = (u.min(v.min(w)), u.max(v.max(w)));
    let inside = (least.ge(zero) | largest.le(zero)) & !on_edge;
    found.on_edge = on_edge.answers();
    if EARLY && !inside.any() {
        found.mask = 0;
        return;
    }
    let inverse = (u + v + w).inverse();
    let depths = [az, bz, cz];
    let [az, bz, cz] = [az * sz, bz * sz, cz * sz];
    let t = (u * az + v * bz + w * cz) * inverse;
    let before = if INCLUSIVE { t.le(t_max) } else { t.lt(t_max) };
    let mut valid = inside & before & t.gt(zero);
    let doubtful = valid & !az.min(bz.min(cz)).gt(zero);
    if doubtful.any() {
        let extent = [largest_of([ax, bx, cx]), largest_of([ay, by, cy]), largest_of(depths)];
        let error = distance_error(extent, sz.abs(), largest_of([u, v, w]));
        valid = valid & !(doubtful & !t.gt(error * inverse.abs()));
    }
    found.mask = valid.answers();
    found.distances = tests.store(t);
    found.b1 = tests.store(v * inverse);
    found.b2 = tests.store(w * inverse);
}

#[inline(always)]
fn largest_of<R: Real>([a, b, c]: [R; 3]) -> R {
    a.abs().max(b.abs()).max(c.abs())
}

#[inline(always)]
fn times<R: Real>(factor: f32, number: R) -> R {
    number.all(factor) * number
}

/// See [`crate::geometry::triangle::distance_error`].
#[inline(always)]
fn distance_error<R: Real>([x, y, z]: [R; 3], scale: R, edge: R) -> R {
    let (dx, dy) = (times(ERROR_XY, x + z), times(ERROR_XY, y + z));
    let z = z * scale;
    let dz = times(ERROR_Z, z);
    let edge_error = times(2.0, times(ERROR_EDGE, x) * y + dy * x + dx * y);
    times(3.0, times(ERROR_Z, edge) * z + edge_error * z + dz * edge)
}
