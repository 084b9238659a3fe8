//! Random draws that the scene families share.

use glam::{Quat, Vec3};

use super::build::Builder;
use crate::base::random::Random;

/// Draws with the shapes that scenes need.
#[derive(Debug, Clone)]
pub struct Draw(Random);

impl Draw {
    /// The draws of one scene.
    pub fn new(family: u64, seed: u64) -> Self {
        Self(Random::new(seed, family, 0))
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f32) -> bool {
        self.0.next_f32() < p
    }

    /// Uniform integer in low..=high.
    pub fn integer(&mut self, low: u32, high: u32) -> u32 {
        low + self.0.below(high - low + 1)
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        self.0.range(low, high)
    }

    /// Uniform in the logarithm, in [low, high); both positive.
    pub fn log_range(&mut self, low: f32, high: f32) -> f32 {
        (self.0.range(low.ln(), high.ln())).exp()
    }

    /// Uniform in a box.
    pub fn point(&mut self, low: Vec3, high: Vec3) -> Vec3 {
        let [x, y, z] = std::array::from_fn(|i| self.0.range(low[i], high[i]));
        Vec3::new(x, y, z)
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = self.range(0.0, std::f32::consts::TAU).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    }

    /// A uniform rotation (Shoemake 1992).
    pub fn rotation(&mut self) -> Quat {
        let u = self.range(0.0, 1.0);
        let (s1, c1) = self.range(0.0, std::f32::consts::TAU).sin_cos();
        let (s2, c2) = self.range(0.0, std::f32::consts::TAU).sin_cos();
        let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
        Quat::from_xyzw(a * s1, a * c1, b * s2, b * c2).normalize()
    }

    /// A rotation about the vertical axis.
    pub fn yaw(&mut self) -> Quat {
        Quat::from_rotation_y(self.range(0.0, std::f32::consts::TAU))
    }

    /// An albedo: often grey, sometimes saturated, never above 0.9.
    pub fn albedo(&mut self) -> [f32; 3] {
        let value = self.range(0.05, 0.9);
        let saturation = if self.chance(0.4) { 0.0 } else { self.range(0.0, 0.9) };
        std::array::from_fn(|_| value * (1.0 - saturation * self.range(0.0, 1.0)))
    }

    /// A light colour of mean 1, from white to clearly tinted.
    pub fn tint(&mut self) -> [f32; 3] {
        let raw: [f32; 3] = std::array::from_fn(|_| self.log_range(0.4, 1.0));
        let mean = raw.iter().sum::<f32>() / 3.0;
        raw.map(|c| c / mean)
    }

    /// A light colour of mean 1 as daylight and lamps of rooms have it.
    pub fn near_white(&mut self) -> [f32; 3] {
        self.tint().map(|c| 0.75 + 0.25 * c)
    }

    /// Power of all lights of a scene together, uniform in the logarithm over three decades.
    pub fn power(&mut self) -> f32 {
        self.log_range(0.3, 300.0)
    }

    /// Radiance of a diffuse emitter of `area` with a power as of [`Draw::power`].
    pub fn emission(&mut self, area: f32) -> [f32; 3] {
        let power = self.power();
        self.tint().map(|c| c * power / (std::f32::consts::PI * area))
    }

    /// Scales the finished scene over four decades, moves it, and turns it any way up in half of all cases.
    pub fn scatter_world(&mut self, builder: &mut Builder) {
        let scale = self.log_range(0.01, 100.0);
        let turn = if self.chance(0.5) { self.rotation() } else { self.yaw() };
        let shift = self.direction() * scale * self.range(0.0, 5.0);
        builder.transform(scale, turn, shift);
    }

    /// Puts the camera into free space within a box, looking at a point of the content with something to see ahead.
    /// Of 200 tries the roomiest is taken, so it always ends.
    pub fn camera(&mut self, builder: &mut Builder, [low, high]: [Vec3; 2], [near, far]: [Vec3; 2], clear: f32) {
        let mut best = (f32::NEG_INFINITY, (low + high) * 0.5, (near + far) * 0.5);
        for _ in 0..200 {
            let (origin, target) = (self.point(low, high), self.point(near, far));
            let Some(along) = (target - origin).try_normalize() else { continue };
            let room = builder.solids().distance(origin);
            let ahead = if room > 0.0 { builder.solids().free_path(origin, along, clear) } else { 0.0 };
            let roominess = room.min(0.1 * clear) * 10.0 + ahead;
            if roominess > best.0 {
                best = (roominess, origin, target);
            }
            if room > 0.1 * clear && ahead >= clear {
                break;
            }
        }
        let up = (Vec3::Y + self.direction() * self.range(0.0, 0.2)).normalize_or(Vec3::Y);
        let fov = self.range(35.0, 90.0);
        builder.look_at(best.1, best.2, up, fov);
    }
}
