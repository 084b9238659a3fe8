//! The clear sky's radiance (Hošek and Wilkie 2012, An analytic model for full spectral sky-dome radiance).

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Mat3, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};

use super::envmap::Envmap;
use crate::math::Frame;

/// Sum of the CIE 1931 ȳ over steps of 1 nm, in Mitsuba 3's table: over it, the model's values are a mean per nanometre,
/// W·m⁻²·sr⁻¹·nm⁻¹. (Mitsuba 0.6 has 106.857.)
const CIE_Y: f32 = 106.750_26;
/// Columns of the map, and rows from the zenith to the horizon. The mean error of bilinear radiance is 3e-4 of the mean radiance then;
/// half as many have 8e-4, twice as many columns no less.
const COLUMNS: usize = 512;
const ROWS: usize = 256;
/// Angle from the zenith at which directions below the horizon are evaluated.
const ABOVE: f64 = FRAC_PI_2 - 1e-4;

/// Parameters of a clear sky.
#[derive(Debug, Clone, Copy)]
pub struct Atmosphere {
    /// Unit direction to the sun, not below the horizon.
    pub sun: Vec3,
    /// Unit direction upwards.
    pub up: Vec3,
    /// Turbidity in [1, 10].
    pub turbidity: f32,
    /// Albedo of the ground per channel, in [0, 1].
    pub albedo: Vec3,
    /// Factor on angles from the zenith, in [1, 2].
    pub stretch: f32,
    /// Whether the horizon's light goes on below it, fading out towards the nadir.
    pub extend: bool,
}

/// A clear sky without the sun's disk.
#[derive(Debug, Clone, Copy)]
pub struct Sky {
    state: SkyState,
    sun: DVec3,
    up: DVec3,
    stretch: f64,
    extend: bool,
}

impl Sky {
    /// The sky of an atmosphere; none where the model is not defined.
    pub fn new(air: &Atmosphere) -> Option<Self> {
        let (sun, up) = (air.sun.as_dvec3().normalize_or_zero(), air.up.as_dvec3().normalize_or_zero());
        let elevation = (sun.dot(up).clamp(-1.0, 1.0).asin() as f32).clamp(0.0, std::f32::consts::FRAC_PI_2);
        let parameters = SkyParams { elevation, turbidity: air.turbidity, albedo: air.albedo.to_array() };
        let state = SkyState::new(&parameters).ok()?;
        Some(Self { state, sun, up, stretch: air.stretch.into(), extend: air.extend })
    }

    /// Radiance from the unit vector `direction`, W·m⁻²·sr⁻¹·nm⁻¹ in linear RGB. Negative channels are clamped to 0.
    pub fn radiance(&self, direction: DVec3) -> Vec3 {
        let cos = direction.dot(self.up).clamp(-1.0, 1.0);
        let zenith = cos.acos() / self.stretch;
        if zenith > FRAC_PI_2 && !self.extend {
            return Vec3::ZERO;
        }
        let theta = if zenith >= FRAC_PI_2 && self.extend { ABOVE } else { zenith };
        let around = (direction - self.up * cos).normalize_or_zero();
        let seen = self.up * theta.cos() + around * theta.sin();
        let gamma = 2.0 * (0.5 * seen.distance(self.sun)).min(1.0).asin();
        let channel = |channel| self.state.radiance(theta as f32, gamma as f32, channel) / CIE_Y;
        let radiance = Vec3::new(channel(Channel::R), channel(Channel::G), channel(Channel::B)).max(Vec3::ZERO);
        if self.extend { radiance * fade(cos.acos()) } else { radiance }
    }

    /// Environment map of the sky's radiance times `scale`.
    pub fn envmap(&self, scale: f32) -> Envmap {
        let frame = Frame::new(self.up.as_vec3());
        let to_world = Mat3::from_cols(frame.t, frame.n, frame.s);
        let lowest = if self.extend { PI } else { FRAC_PI_2 * self.stretch };
        let rows = (ROWS as f64 * lowest / FRAC_PI_2).round() as usize + 1;
        Envmap::dome([COLUMNS, rows], lowest, scale, to_world, |wi| self.radiance(wi))
    }
}

/// Smooth fade from 1 at the horizon, `angle` = π/2 away from the zenith, to 0 at the nadir.
fn fade(angle: f64) -> f32 {
    let x = (2.0 - 2.0 * angle / PI).clamp(0.0, 1.0);
    (x * x * (3.0 - 2.0 * x)) as f32
}
