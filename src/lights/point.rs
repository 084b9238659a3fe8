//! Lights without extent: points and spots.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec3};

use super::bounds::{Cone, LightBounds};
use super::{Emission, LightSamples};
use crate::geometry::Ray;
use crate::math::lanes::functions::atan2;
use crate::math::lanes::{Mask, Real, V3, by_lane};
use crate::math::{Frame, Frames, channel_mean};
use crate::sampling::warp;

/// A point light.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// World position.
    pub position: Vec3,
    /// Radiant intensity, W·sr⁻¹.
    pub intensity: Vec3,
}

/// Ways from points to lights in lanes.
pub(super) struct Way<R> {
    /// Unit directions.
    pub(super) wi: V3<R>,
    distance: R,
    squared: R,
}

impl<R: Real> Way<R> {
    #[inline(always)]
    pub(super) fn new(point: V3<R>, position: V3<R>) -> Self {
        let to = position - point;
        let squared = to.length_squared();
        let distance = squared.sqrt();
        Self { wi: to / distance, distance, squared }
    }

    /// The only directions towards lights of these intensities.
    #[inline(always)]
    pub(super) fn samples(&self, intensity: V3<R>) -> LightSamples<R> {
        let (wi, distance, one) = (self.wi, self.distance, self.distance.all(1.0));
        let radiance = intensity / self.squared;
        LightSamples {
            wi,
            distance,
            radiance,
            pdf: one,
            delta: one.same(one),
            found: wi.is_finite() & !radiance.is_zero(),
        }
    }
}

/// Samples the points `light` of each lane: the only directions towards them.
#[inline(always)]
pub(super) fn sample_points<'a, R: Real>(light: impl Fn(usize) -> &'a Point, point: V3<R>) -> LightSamples<R> {
    let [x, y, z, r, g, b] = by_lane!([point.x], |lane, _| {
        let Point { position, intensity } = light(lane);
        [position.x, position.y, position.z, intensity.x, intensity.y, intensity.z]
    });
    Way::new(point, V3::new(x, y, z)).samples(V3::new(r, g, b))
}

impl Point {
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

/// Samples the spots `light` of each lane: the only directions towards them.
#[inline(always)]
pub(super) fn sample_spots<'a, R: Real>(light: impl Fn(usize) -> &'a Spot, point: V3<R>) -> LightSamples<R> {
    let [x, y, z, sx, sy, sz, tx, ty, tz, nx, ny, nz, r, g, b, cutoff, beam] = by_lane!([point.x], |lane, _| {
        let Spot { position: p, frame: Frame { s, t, n }, intensity: i, cutoff, beam } = light(lane);
        [p.x, p.y, p.z, s.x, s.y, s.z, t.x, t.y, t.z, n.x, n.y, n.z, i.x, i.y, i.z, *cutoff, *beam]
    });
    let way = Way::new(point, V3::new(x, y, z));
    let axes = Frames { s: V3::new(sx, sy, sz), t: V3::new(tx, ty, tz), n: V3::new(nx, ny, nz) };
    way.samples(V3::new(r, g, b) * part(axes.to_local(-way.wi), cutoff, beam))
}

/// Part of the full intensity in local directions.
#[inline(always)]
pub(super) fn part<R: Real>(local: V3<R>, cutoff: R, beam: R) -> R {
    // atan2 keeps the small angles of a narrow beam, where acos(1 − ε) has no digits left.
    let angle = atan2((local.x * local.x + local.y * local.y).sqrt(), local.z);
    let edge = ((cutoff - angle) / (cutoff - beam)).only(angle.lt(cutoff));
    angle.le(beam).choose(angle.all(1.0), edge)
}

impl Spot {
    /// A spot at the origin of `to_world` along its +z axis; half angles in radians, 0 ≤ `beam` ≤ `cutoff` ≤ π.
    pub fn new(to_world: Affine3A, intensity: Vec3, cutoff: f32, beam: f32) -> Self {
        let axis = to_world.transform_vector3(Vec3::Z).normalize_or(Vec3::Z);
        Self { position: to_world.translation.into(), frame: Frame::new(axis), intensity, cutoff, beam }
    }

    fn cone(&self) -> f32 {
        let s = (0.5 * self.cutoff).sin();
        2.0 * s * s
    }

    /// Position, intensity and cone of directions.
    pub(super) fn bounds(&self) -> LightBounds {
        let intensity = channel_mean(self.intensity);
        LightBounds { low: self.position, high: self.position, cone: Cone::beam(self.frame.n, self.cutoff), intensity }
    }

    /// Samples a photon in a uniform direction of the cone.
    pub fn emit(&self, u: [f32; 2]) -> Emission {
        let direction = self.frame.to_world(warp::square_to_cone(u, self.cone())).normalize();
        let part = part(self.frame.to_local(direction).into(), self.cutoff, self.beam);
        let power = self.intensity * part / warp::square_to_cone_pdf(self.cone());
        Emission { ray: Ray { origin: self.position, direction }, power, normal: direction }
    }

    /// Emitted power, ∫ I dω = 2πI·(1 − (sin c − sin b)/(c − b)) with cutoff c and beam width b.
    pub fn power(&self) -> Vec3 {
        let (c, b) = (f64::from(self.cutoff), f64::from(self.beam));
        let mean_cos = if c - b > 1e-6 { (c.sin() - b.sin()) / (c - b) } else { c.cos() };
        self.intensity * (TAU * (1.0 - mean_cos) as f32)
    }
}
