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

use glam::Vec3;

/// A half line.
#[derive(Debug, Clone, Copy)]
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
}
