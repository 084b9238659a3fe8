//! Per-ray constants of the tests against boxes and triangles.

use glam::Vec3;

use crate::geometry::Ray;
use crate::geometry::triangle::Shear;

/// A ray with the constants of its tests against boxes and triangles.
#[derive(Debug, Clone, Copy)]
pub struct Query {
    pub origin: Vec3,
    pub direction: Vec3,
    pub shear: Shear,
    pub slabs: Slabs,
}

/// Constants of the test against boxes, by axis. Along an axis the ray passes a plane at distance (origin − plane) · −1/direction.
#[derive(Debug, Clone, Copy)]
pub struct Slabs {
    pub origin: [f32; 3],
    /// −1/direction, with a rounding that makes the distance of the nearer plane too small.
    pub nearer: [f32; 3],
    /// −1/direction, with a rounding that makes the distance of the farther plane too large.
    pub farther: [f32; 3],
    /// Index of the nearer plane among a node's six, by axis.
    pub nearer_plane: [usize; 3],
    /// Index of the farther plane among a node's six, by axis.
    pub farther_plane: [usize; 3],
}

impl Query {
    /// Calls `ask` with the query of a ray and returns its result; none where the ray has no finite origin or direction: it hits
    /// nothing. A query is large, and would be copied if it were returned.
    #[inline(always)]
    pub fn with<R>(ray: &Ray, ask: impl FnOnce(&Self) -> R) -> Option<R> {
        let Ray { origin, direction } = *ray;
        if !(origin.is_finite() && direction.is_finite()) {
            return None;
        }
        Some(ask(&Self::new(origin, direction)))
    }

    /// The query of a ray with finite origin and direction.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let inverse = direction.recip();
        let shear = Shear::with_inverse(origin, direction, inverse);
        Self { origin, direction, shear, slabs: Slabs::new(origin, direction, inverse) }
    }
}

impl Slabs {
    /// Relative widening of the distances to boxes: a test of a box must not be stricter than that of a triangle in it. Its three
    /// roundings (Ize 2013), and the roundings that move a vertex before the edges of a triangle are tested, are all relative to
    /// the distance from the origin to the plane; together they stay below eight units.
    pub const SLACK: f32 = 8.0 * f32::EPSILON;

    #[inline(always)]
    fn new(origin: Vec3, direction: Vec3, inverse: Vec3) -> Self {
        // A component of zero makes these infinite; the distance is then infinite, or NaN and ignored.
        let inverse = -inverse;
        let forward = direction.to_array().map(|d| !d.is_sign_negative());
        let [x, y, z] = forward;
        let plane = |low: bool, axis: usize| if low { axis } else { 3 + axis };
        Self {
            origin: origin.to_array(),
            nearer: (inverse * (1.0 - Self::SLACK)).to_array(),
            farther: (inverse * (1.0 + Self::SLACK)).to_array(),
            nearer_plane: [plane(x, 0), plane(y, 1), plane(z, 2)],
            farther_plane: [plane(!x, 0), plane(!y, 1), plane(!z, 2)],
        }
    }
}
