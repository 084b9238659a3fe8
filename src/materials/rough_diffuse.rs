//! A rough surface of diffuse facets in V-shaped grooves, such as plaster or clay (Oren and Nayar 1994).

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{Vec2, Vec3};

use super::BsdfSample;
use super::diffuse::Diffuse;
use super::texture::Texture;
use crate::math::lanes::functions::atan2;
use crate::sampling::warp;

/// Number of cosines at which albedos are kept, evenly from 0 to 1.
const COSINES: usize = 33;

/// Oren and Nayar's functional approximation (their §4.4), with interreflection between facets, or their qualitative model without
/// it (§4.5). The variance of the facets' slope is α²/2, as in Mitsuba 0.6, so that α is about the roughness of a microfacet
/// material. At grazing angles the fit would send back up to 1.05 times as much as arrives; it is bounded.
#[derive(Debug, Clone)]
pub struct RoughDiffuse {
    /// Albedo of the facets.
    reflectance: Texture,
    qualitative: bool,
    /// The model's C₁ (or A), the factors of its C₂ (or B) and C₃, and C₄.
    c: [f32; 4],
    /// Albedo of white facets for light scattered once, by cosine; none where with light scattered twice it never exceeds 1.
    once: Option<Box<[f32; COSINES]>>,
}

/// Two directions in the angles of the model.
#[derive(Clone, Copy)]
struct Angles {
    /// The larger and the smaller angle from the normal.
    wide: f32,
    narrow: f32,
    /// sin of the larger, tan of the smaller, tan of half their sum.
    sin_wide: f32,
    tan_narrow: f32,
    tan_half: f32,
    /// Cosine of the azimuth between them.
    cos_phi: f32,
}

impl Angles {
    fn new(a: Vec3, b: Vec3) -> Self {
        let (low, high) = if a.z < b.z { (a, b) } else { (b, a) };
        let (sin_wide, sin_narrow) = (low.truncate().length(), high.truncate().length());
        let both = sin_wide * sin_narrow;
        let cos_phi = if both > 0.0 { (a.truncate().dot(b.truncate()) / both).clamp(-1.0, 1.0) } else { 0.0 };
        let (wide, narrow) = (atan2(sin_wide, low.z), atan2(sin_narrow, high.z));
        let tan_half = (sin_wide + sin_narrow) / (low.z + high.z);
        Self { wide, narrow, sin_wide, tan_narrow: sin_narrow / high.z, tan_half, cos_phi }
    }
}

impl RoughDiffuse {
    /// A surface of facets of albedo `reflectance` with the roughness `alpha`, not negative.
    pub fn new(reflectance: Texture, alpha: f32, qualitative: bool) -> Self {
        let variance = 0.5 * alpha * alpha;
        let steep = variance / (variance + 0.09);
        let twice = if qualitative { 0.0 } else { 0.17 * variance / (variance + 0.13) };
        let c = [1.0 - 0.5 * variance / (variance + 0.33), 0.45 * steep, 0.125 * steep, twice];
        let mut material = Self { reflectance, qualitative, c, once: None };
        let once: [f32; COSINES] = std::array::from_fn(|i| material.albedo_once(i as f32 / (COSINES - 1) as f32));
        if once.iter().any(|albedo| albedo + twice > 1.0) {
            material.once = Some(Box::new(once));
        }
        material
    }

    /// π·f of white facets, for light scattered once and for light scattered twice.
    fn scattered(&self, angles: &Angles) -> [f32; 2] {
        let [c1, c2, c3, c4] = self.c;
        let Angles { wide, narrow, sin_wide, tan_narrow, tan_half, cos_phi } = *angles;
        if self.qualitative {
            return [c1 + c2 * cos_phi.max(0.0) * sin_wide * tan_narrow, 0.0];
        }
        let part = 2.0 * narrow / PI;
        let c2 = c2 * if cos_phi > 0.0 { sin_wide } else { sin_wide - part.powi(3) };
        let c3 = c3 * (part * 2.0 * wide / PI).powi(2);
        let once = c1 + cos_phi * c2 * tan_narrow + (1.0 - cos_phi.abs()) * c3 * tan_half;
        [once, c4 * (1.0 - cos_phi * part * part)]
    }

    /// Albedo of white facets for light scattered once, at a cosine: the mean over cosine-distributed directions. Around the normal
    /// the mean of cos φ over the half where it is positive is 1/π, that of |cos φ| 2/π.
    fn albedo_once(&self, cos: f32) -> f32 {
        const STEPS: usize = 512;
        let at = |cos: f32| Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        let wo = at(cos.max(1e-3));
        let mean = |i: usize| {
            let angles = Angles::new(wo, at((1.0 - (i as f32 + 0.5) / STEPS as f32).sqrt()));
            let beyond = |cos_phi| self.scattered(&Angles { cos_phi, ..angles })[0] - self.c[0];
            beyond(0.0) * (1.0 - 2.0 * FRAC_1_PI) + (beyond(1.0) + beyond(-1.0)) * FRAC_1_PI
        };
        self.c[0] + (0..STEPS).map(mean).sum::<f32>() / STEPS as f32
    }

    /// Divisor of f for a direction with a cosine: the albedo, where that is above 1.
    fn excess(&self, once: &[f32; COSINES], cos: f32, color: Vec3) -> Vec3 {
        let x = cos.clamp(0.0, 1.0) * (COSINES - 1) as f32;
        let below = (x as usize).min(COSINES - 2);
        let once = once[below] + (once[below + 1] - once[below]) * (x - below as f32);
        (color * once + color * color * self.c[3]).max(Vec3::ONE)
    }

    /// f·cos θᵢ.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Vec3::ZERO;
        }
        let color = self.reflectance.eval(uv);
        let [once, twice] = self.scattered(&Angles::new(wo, wi));
        // The fit falls a little below 0 for the roughest, against the light.
        let value = (color * once + color * color * twice).max(Vec3::ZERO) * (wi.z * FRAC_1_PI);
        match &self.once {
            Some(table) => value / (self.excess(table, wo.z, color) * self.excess(table, wi.z, color)),
            None => value,
        }
    }

    /// Density w.r.t. solid angle.
    pub fn pdf(wo: Vec3, wi: Vec3) -> f32 {
        Diffuse::pdf(wo, wi)
    }

    /// Cosine-distributed direction. Weights stay below 2 but where both directions graze the surface, and have the mean albedo.
    pub fn sample(&self, uv: Vec2, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        let wi = warp::square_to_cosine_hemisphere(u);
        let pdf = Self::pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: self.eval(uv, wo, wi) / pdf, pdf, delta: false })
    }

    /// Albedo of the facets.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        self.reflectance.eval(uv)
    }
}
