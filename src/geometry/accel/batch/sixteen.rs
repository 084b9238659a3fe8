//! Sixteen rays with their constants, and bounds of these.

use glam::Vec3;

use crate::geometry::Ray;
use crate::math::lanes::LANES;

/// Rays of a bundle.
pub const RAYS: usize = LANES;

/// A number of each ray.
pub type Lane = [f32; RAYS];

/// Rays with the constants of their tests against boxes and triangles, by axis.
#[repr(C, align(64))]
pub struct Lanes {
    pub origin: [Lane; 3],
    pub direction: [Lane; 3],
    /// See [`Slabs::nearer`].
    pub nearer: [Lane; 3],
    /// See [`Slabs::farther`].
    pub farther: [Lane; 3],
    /// See [`Shear`](crate::geometry::triangle::Shear), whose axes are the same for all.
    pub shear: [Lane; 3],
    pub axes: [usize; 3],
    /// The farthest that each ray still looks; a negative distance where it has ended.
    pub t_max: Lane,
}

/// Bounds of the constants of all rays of a bundle, by axis.
pub struct Bounds {
    /// The origin from which the nearer planes are nearest.
    pub near_origin: [f32; 3],
    /// The origin from which the farther planes are farthest.
    pub far_origin: [f32; 3],
    /// Least and largest of [`Slabs::nearer`].
    pub nearer: [[f32; 2]; 3],
    /// Least and largest of [`Slabs::farther`].
    pub farther: [[f32; 2]; 3],
    pub nearer_plane: [usize; 3],
    pub farther_plane: [usize; 3],
}

impl Lanes {
    pub const EMPTY: Self = {
        let zeros = [[0.0; RAYS]; 3];
        let (origin, direction, nearer, farther, shear) = (zeros, zeros, zeros, zeros, zeros);
        Self { origin, direction, nearer, farther, shear, axes: [0; 3], t_max: [-1.0; RAYS] }
    };

    /// Puts a ray with its maximum distance into a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, ray: &Ray, t_max: f32) {
        for axis in 0..3 {
            self.origin[axis][lane] = ray.origin[axis];
            self.direction[axis][lane] = ray.direction[axis];
        }
        self.t_max[lane] = t_max;
    }

    /// The ray in a lane.
    pub fn ray(&self, lane: usize) -> Ray {
        let at = |values: &[Lane; 3]| Vec3::from_array(values.map(|values| values[lane]));
        Ray { origin: at(&self.origin), direction: at(&self.direction) }
    }
}
