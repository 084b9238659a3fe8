//! A disk of light infinitely far away, such as the sun.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::distant::{cross_section, ray_through};
use super::{BoundingSphere, Emission, LightSample};
use crate::math::Frame;
use crate::sampling::warp;

/// A disk of the same radiance all over.
#[derive(Debug, Clone, Copy)]
pub struct Sun {
    /// Frame around the unit direction to its centre.
    frame: Frame,
    /// Radiance, W·m⁻²·sr⁻¹.
    radiance: Vec3,
    /// One minus the cosine of its angular radius.
    height: f32,
    /// Square of the longest chord from the centre to a direction on the disk.
    reach: f32,
}

impl Sun {
    /// A sun whose light travels along the unit vector `direction`, with an `irradiance` (W·m⁻²) on a plane across it and an
    /// angular `diameter` in (0, π), radians.
    pub fn new(direction: Vec3, irradiance: Vec3, diameter: f32) -> Self {
        let height = 2.0 * (0.25 * diameter).sin().powi(2);
        // ∫ cos θ over the disk is π·sin² of its radius.
        let radiance = irradiance / (PI * height * (2.0 - height));
        // Directions on the rim, rounded to singles, belong to it.
        let reach = ((2.0 * height).sqrt() + 2.0 * f32::EPSILON).powi(2);
        Self { frame: Frame::new(-direction), radiance, height, reach }
    }

    /// Solid angle of the disk, sr.
    fn solid_angle(&self) -> f32 {
        TAU * self.height
    }

    // The chord keeps digits that the cosine of a small angle has lost.
    fn covers(&self, wi: Vec3) -> bool {
        wi.distance_squared(self.frame.n) <= self.reach
    }

    /// Radiance from direction `wi`.
    pub fn radiance(&self, wi: Vec3) -> Vec3 {
        if self.covers(wi) { self.radiance } else { Vec3::ZERO }
    }

    /// Density of [`Sun::sample`] w.r.t. solid angle.
    pub fn pdf(&self, wi: Vec3) -> f32 {
        if self.covers(wi) { warp::square_to_cone_pdf(self.height) } else { 0.0 }
    }

    /// Samples a uniform direction on the disk.
    pub fn sample(&self, u: [f32; 2]) -> LightSample {
        let wi = self.frame.to_world(warp::square_to_cone(u, self.height));
        let pdf = warp::square_to_cone_pdf(self.height);
        LightSample { wi, distance: f32::INFINITY, radiance: self.radiance, pdf, delta: false }
    }

    /// Samples a photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Emission {
        let direction = -self.sample(u).wi;
        Emission { ray: ray_through(bounds, direction, v), power: self.power(bounds), normal: direction }
    }

    /// Power: radiance times solid angle times the cross-section of the scene.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.radiance * (self.solid_angle() * cross_section(bounds))
    }
}
