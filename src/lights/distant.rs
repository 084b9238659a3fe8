//! Light from infinitely far away: parallel, or the same from everywhere.

use std::f32::consts::PI;

use glam::Vec3;

use super::{BoundingSphere, Emission, LightSamples};
use crate::geometry::Ray;
use crate::math::Frame;
use crate::math::lanes::{Real, V3};
use crate::sampling::warp;

/// A ray along `direction` that starts outside the sphere at a uniform point of the disk which the sphere covers.
pub fn ray_through(bounds: &BoundingSphere, direction: Vec3, u: [f32; 2]) -> Ray {
    let disk = warp::square_to_disk(u) * bounds.radius;
    let frame = Frame::new(direction);
    Ray { origin: bounds.center + frame.s * disk.x + frame.t * disk.y - direction * bounds.radius, direction }
}

/// π·r², the area that a sphere covers.
pub fn cross_section(bounds: &BoundingSphere) -> f32 {
    PI * bounds.radius * bounds.radius
}

/// Parallel light.
#[derive(Debug, Clone, Copy)]
pub struct Directional {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance across the direction, W·m⁻².
    pub irradiance: Vec3,
}

impl Directional {
    /// The only direction towards the light, in lanes of what is `like` that.
    #[inline(always)]
    pub(super) fn samples<R: Real>(&self, like: R) -> LightSamples<R> {
        let all = V3::splat(like);
        let sample = LightSamples::distant(all.all(-self.direction), all.all(self.irradiance), like.all(1.0));
        LightSamples { delta: sample.found, ..sample }
    }

    /// Samples a photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2]) -> Emission {
        let ray = ray_through(bounds, self.direction, u);
        Emission { ray, power: self.power(bounds), normal: self.direction }
    }

    /// Power: irradiance times the cross-section of the scene.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.irradiance * cross_section(bounds)
    }
}

/// Constant light from everywhere.
#[derive(Debug, Clone, Copy)]
pub struct Constant {
    /// Radiance, W·m⁻²·sr⁻¹.
    pub radiance: Vec3,
}

impl Constant {
    /// Uniform directions.
    #[inline(always)]
    pub(super) fn directions<R: Real>(u: [R; 2]) -> V3<R> {
        warp::lanes::square_to_sphere(u)
    }

    /// Radiance from the directions `wi`, and their density w.r.t. solid angle.
    #[inline(always)]
    pub(super) fn seen<R: Real>(&self, wi: V3<R>) -> (V3<R>, R) {
        (wi.all(self.radiance), wi.x.all(warp::square_to_sphere_pdf()))
    }

    /// Samples a photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Emission {
        let direction = warp::square_to_sphere(u);
        Emission { ray: ray_through(bounds, direction, v), power: self.power(bounds), normal: direction }
    }

    /// Power into the bounding sphere, 4π²r²·L.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.radiance * (4.0 * PI * cross_section(bounds))
    }
}
