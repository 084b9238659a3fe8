//! Geometry: meshes, spheres and the bounding volume hierarchy over them.

pub mod accel;
mod corners;
pub mod mesh;
pub mod shape;
pub mod sphere;
pub mod surface;
pub mod triangle;

pub use accel::{Accel, Hit, Met, Pace, RayKind, Scratch, Way};
pub use shape::{Geometry, Shape};
pub use surface::{Origins, Surface};

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::math::lanes::{V3, Wide};

/// A half line.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Origin.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

impl Ray {
    /// The point at distance `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }

    /// The directions of sixteen rays, which `of` tells.
    #[inline(always)]
    pub fn directions<'a, W: Wide>(wide: W, of: impl Fn(usize) -> &'a Self) -> V3<W::Real> {
        let [_, x, y, z] = wide.four_columns(|lane| {
            let [_, _, numbers @ ..]: [f32; 6] = bytemuck::cast(*of(lane));
            numbers
        });
        V3::new(x, y, z)
    }
}
