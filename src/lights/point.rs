//! Lights without extent: points and spots.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec3};

use super::tree::{Cone, LightBounds};
use super::{Emission, LightSample};
use crate::geometry::Ray;
use crate::math::{Frame, channel_mean};
use crate::sampling::warp;

/// A point light.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// World position.
    pub position: Vec3,
    /// Radiant intensity, W·sr⁻¹.
    pub intensity: Vec3,
}

fn towards(position: Vec3, point: Vec3, intensity: impl Fn(Vec3) -> Vec3) -> Option<LightSample> {
    let to = position - point;
    let squared = to.length_squared();
    let distance = squared.sqrt();
    let wi = to / distance;
    if !wi.is_finite() {
        return None;
    }
    let radiance = intensity(-wi) / squared;
    (radiance != Vec3::ZERO).then_some(LightSample { wi, distance, radiance, pdf: 1.0, delta: true })
}

impl Point {
    /// The only direction towards the light.
    pub fn sample(&self, point: Vec3) -> Option<LightSample> {
        towards(self.position, point, |_| self.intensity)
    }

    /// Samples a photon in a uniform direction.
    pub fn emit(&self, u: [f32; 2]) -> Emission {
        let direction = warp::square_to_sphere(u);
        Emission { ray: Ray { origin: self.position, direction }, power: self.power(), normal: direction }
    }

    /// Position and intensity; it shines in all directions.
    pub(super) fn bounds(&self) -> LightBounds {
        let intensity = channel_mean(self.intensity);
        LightBounds { low: self.position, high: self.position, cone: Cone::ALL, intensity }
    }

    /// Emitted power, 4π·I.
    pub fn power(&self) -> Vec3 {
        self.intensity * (4.0 * PI)
    }
}

/// A spot light: full intensity up to the beam width, then a linear fall-off in the angle to the cutoff.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    position: Vec3,
    frame: Frame,
    intensity: Vec3,
    cutoff: f32,
    beam: f32,
}

impl Spot {
    /// A spot at the origin of `to_world` along its +z axis; half angles in radians, 0 ≤ `beam` ≤ `cutoff` ≤ π.
    pub fn new(to_world: Affine3A, intensity: Vec3, cutoff: f32, beam: f32) -> Self {
        let axis = to_world.transform_vector3(Vec3::Z).normalize_or(Vec3::Z);
        Self { position: to_world.translation.into(), frame: Frame::new(axis), intensity, cutoff, beam }
    }

    fn intensity(&self, direction: Vec3) -> Vec3 {
        let local = self.frame.to_local(direction);
        // atan2 keeps the small angles of a narrow beam, where acos(1 − ε) has no digits left.
        let angle = (local.x * local.x + local.y * local.y).sqrt().atan2(local.z);
        if angle <= self.beam {
            self.intensity
        } else if angle < self.cutoff {
            self.intensity * ((self.cutoff - angle) / (self.cutoff - self.beam))
        } else {
            Vec3::ZERO
        }
    }

    fn cone(&self) -> f32 {
        let s = (0.5 * self.cutoff).sin();
        2.0 * s * s
    }

    /// The only direction towards the light.
    pub fn sample(&self, point: Vec3) -> Option<LightSample> {
        towards(self.position, point, |direction| self.intensity(direction))
    }

    /// Position, intensity and cone of directions.
    pub(super) fn bounds(&self) -> LightBounds {
        let intensity = channel_mean(self.intensity);
        LightBounds { low: self.position, high: self.position, cone: Cone::new(self.frame.n, self.cutoff), intensity }
    }

    /// Samples a photon in a uniform direction of the cone.
    pub fn emit(&self, u: [f32; 2]) -> Emission {
        let direction = self.frame.to_world(warp::square_to_cone(u, self.cone())).normalize();
        let power = self.intensity(direction) / warp::square_to_cone_pdf(self.cone());
        Emission { ray: Ray { origin: self.position, direction }, power, normal: direction }
    }

    /// Emitted power, ∫ I dω = 2πI·(1 − (sin c − sin b)/(c − b)) with cutoff c and beam width b.
    pub fn power(&self) -> Vec3 {
        let (c, b) = (f64::from(self.cutoff), f64::from(self.beam));
        let mean_cos = if c - b > 1e-6 { (c.sin() - b.sin()) / (c - b) } else { c.cos() };
        self.intensity * (TAU * (1.0 - mean_cos) as f32)
    }
}
