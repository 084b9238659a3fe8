//! Watertight ray-triangle intersection (Woop, Benthin, Wald 2013): edges shared by two triangles are evaluated with the same
//! operands, so a ray cannot slip between them.

use glam::Vec3;

use crate::math::error_bound::gamma;

/// Per-ray constants: the axis permutation and shear that take the ray to the unit ray along +z.
#[derive(Debug, Clone, Copy)]
pub struct Shear {
    pub(super) origin: Vec3,
    pub(super) axes: [usize; 3],
    pub(super) shear: Vec3,
}

impl Shear {
    /// Constants of the ray from `origin` along `direction`.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self::with_inverse(origin, direction, direction.recip())
    }

    /// As [`Shear::new`], where the reciprocals of the direction's components are known.
    #[inline(always)]
    pub(super) fn with_inverse(origin: Vec3, direction: Vec3, inverse: Vec3) -> Self {
        let kz = direction.abs().max_position();
        let [mut kx, mut ky] = [[1, 2], [2, 0], [0, 1]][kz];
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = inverse[kz];
        Self { origin, axes: [kx, ky, kz], shear: Vec3::new(direction[kx] * inverse, direction[ky] * inverse, inverse) }
    }

    /// Distance and barycentric coordinates (b₁, b₂) of the hit in (0, `t_max`), from either side.
    #[inline]
    pub fn intersect(&self, [a, b, c]: &[Vec3; 3], t_max: f32) -> Option<(f32, [f32; 2])> {
        let [kx, ky, kz] = self.axes;
        let (a, b, c) = (*a - self.origin, *b - self.origin, *c - self.origin);
        let ax = a[kx] - self.shear.x * a[kz];
        let ay = a[ky] - self.shear.y * a[kz];
        let bx = b[kx] - self.shear.x * b[kz];
        let by = b[ky] - self.shear.y * b[kz];
        let cx = c[kx] - self.shear.x * c[kz];
        let cy = c[ky] - self.shear.y * c[kz];
        let (mut u, mut v, mut w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        if u == 0.0 || v == 0.0 || w == 0.0 {
            // On an edge in single precision: the products of two singles are exact in double precision.
            let cross = |px: f32, qy: f32, py: f32, qx: f32| {
                (f64::from(px) * f64::from(qy) - f64::from(py) * f64::from(qx)) as f32
            };
            (u, v, w) = (cross(cx, by, cy, bx), cross(ax, cy, ay, cx), cross(bx, ay, by, ax));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let inverse = 1.0 / det;
        let [az, bz, cz] = [a[kz], b[kz], c[kz]].map(|z| z * self.shear.z);
        let t = (u * az + v * bz + w * cz) * inverse;
        if !(t > 0.0 && t < t_max) {
            return None;
        }
        // No rounding brings a triangle in front of the origin behind it: signs of differences are exact.
        let in_front = az > 0.0 && bz > 0.0 && cz > 0.0;
        let largest = |x: f32, y: f32, z: f32| x.abs().max(y.abs()).max(z.abs());
        let extent = [largest(ax, bx, cx), largest(ay, by, cy), largest(a[kz], b[kz], c[kz])];
        let is_beyond_error = || t > distance_error(extent, self.shear.z.abs(), largest(u, v, w)) * inverse.abs();
        (in_front || is_beyond_error()).then_some((t, [v * inverse, w * inverse]))
    }
}

/// Bound of the rounding error of u·az + v·bz + w·cz, given the largest sheared coordinates, of which z is not yet
/// multiplied by `scale`, and the largest edge function (Pharr, Jakob, Humphreys 2016, §3.9.6). A distance below it may
/// belong to the surface that the ray leaves.
///
/// A sheared x is p − s·z, of two differences p and z and |s| ≤ 1: p, which is at most |x| + |z|, is rounded twice, s·z
/// three times, and rounding of s turns the ray about its origin, which moves no hit there. So its error is relative to
/// z in the units of the mesh. The sum is in those of the ray, which are others where its direction is no unit vector,
/// as in an instance: its z are multiplied.
pub(super) fn distance_error([x, y, z]: [f32; 3], scale: f32, edge: f32) -> f32 {
    let (dx, dy) = (ERROR_XY * (x + z), ERROR_XY * (y + z));
    let z = z * scale;
    let dz = ERROR_Z * z;
    let edge_error = 2.0 * (ERROR_EDGE * x * y + dy * x + dx * y);
    3.0 * (ERROR_Z * edge * z + edge_error * z + dz * edge)
}

/// Error of a sheared x or y, relative to its sum with z before that is multiplied.
pub(super) const ERROR_XY: f32 = gamma(5);
/// Relative error of z once it is multiplied.
pub(super) const ERROR_Z: f32 = gamma(3);
/// Relative error of an edge function by its own roundings.
pub(super) const ERROR_EDGE: f32 = gamma(2);
