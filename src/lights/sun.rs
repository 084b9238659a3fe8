//! A disk of light infinitely far away, such as the sun.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::distant::{cross_section, ray_through};
use super::{BoundingSphere, Emission};
use crate::math::lanes::{Real, V3};
use crate::math::{Frame, Frames};
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

    /// Radiance from the directions `wi`, and the density of [`Sun::directions`] w.r.t. solid angle.
    #[inline(always)]
    pub(super) fn seen<R: Real>(&self, wi: V3<R>) -> (V3<R>, R) {
        // The chord keeps digits that the cosine of a small angle has lost.
        let chord = (wi - wi.all(self.frame.n)).length_squared();
        let covered = chord.le(chord.all(self.reach));
        let (radiance, pdf) = self.disk(chord);
        (radiance.only(covered), pdf.only(covered))
    }

    /// Radiance from the disk, and the density of its directions, in lanes of what is `like` that.
    #[inline(always)]
    pub(super) fn disk<R: Real>(&self, like: R) -> (V3<R>, R) {
        (V3::splat(like).all(self.radiance), like.all(warp::square_to_cone_pdf(self.height)))
    }

    /// Uniform directions on the disk.
    #[inline(always)]
    pub(super) fn directions<R: Real>(&self, u: [R; 2]) -> V3<R> {
        let Frame { s, t, n } = self.frame;
        Frames::all(u[0], [s, t, n]).to_world(warp::lanes::square_to_cone(u, u[0].all(self.height)))
    }

    /// Samples a photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Emission {
        let direction = Vec3::from(-self.directions(u));
        Emission { ray: ray_through(bounds, direction, v), power: self.power(bounds), normal: direction }
    }

    /// Power: radiance times solid angle times the cross-section of the scene.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.radiance * (self.solid_angle() * cross_section(bounds))
    }
}
