//! A rough surface of diffuse facets in V-shaped grooves, such as plaster or clay (Oren and Nayar 1994).

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec2;

use super::diffuse::cosine_pdf;
use super::table::interpolated;
use super::texture::Texture;
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::functions::atan2;
use crate::math::lanes::{Mask, Real, V3, lanes_of};
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

/// A surface of diffuse facets at points.
#[derive(Clone, Copy)]
pub struct At<'a, R: Real> {
    reflectance: V3<R>,
    c: [R; 4],
    once: Option<R::Each<&'a [f32; COSINES]>>,
    qualitative: bool,
}

lanes_of!(At<'a> { reflectance, c, once } same { qualitative });

/// Two directions in the angles of the model.
#[derive(Clone, Copy)]
struct Angles<R> {
    /// The larger and the smaller angle from the normal.
    wide: R,
    narrow: R,
    /// sin of the larger, tan of the smaller, tan of half their sum.
    sin_wide: R,
    tan_narrow: R,
    tan_half: R,
    /// Cosine of the azimuth between them.
    cos_phi: R,
}

impl<R: Real> Angles<R> {
    #[inline(always)]
    fn new(a: V3<R>, b: V3<R>) -> Self {
        let lower = a.z.lt(b.z);
        let (low, high) = (V3::choose(lower, a, b), V3::choose(lower, b, a));
        let sin_wide = (low.x * low.x + low.y * low.y).sqrt();
        let sin_narrow = (high.x * high.x + high.y * high.y).sqrt();
        let both = sin_wide * sin_narrow;
        let cos_phi = ((a.x * b.x + a.y * b.y) / both).between(-1.0, 1.0).only(both.above(0.0));
        let (wide, narrow) = (atan2(sin_wide, low.z), atan2(sin_narrow, high.z));
        let tan_half = (sin_wide + sin_narrow) / (low.z + high.z);
        Self { wide, narrow, sin_wide, tan_narrow: sin_narrow / high.z, tan_half, cos_phi }
    }

    /// π·f of white facets with the constants `c`, for light scattered once and for light scattered twice.
    #[inline(always)]
    fn scattered(&self, c: [R; 4], qualitative: bool) -> [R; 2] {
        let [c1, c2, c3, c4] = c;
        let Self { wide, narrow, sin_wide, tan_narrow, tan_half, cos_phi } = *self;
        if qualitative {
            return [c1 + c2 * cos_phi.at_least(0.0) * sin_wide * tan_narrow, c1.all(0.0)];
        }
        let part = narrow * 2.0 / PI;
        let c2 = c2 * cos_phi.above(0.0).choose(sin_wide, sin_wide - part * part.squared());
        let c3 = c3 * (part * 2.0 * wide / PI).squared();
        let once = c1 + cos_phi * c2 * tan_narrow + cos_phi.abs().rest() * c3 * tan_half;
        [once, c4 * (cos_phi * part * part).rest()]
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

    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        self.reflectance.prefetch(uv);
    }

    /// The surface at `uv`.
    pub fn at(&self, uv: Vec2) -> At<'_, f32> {
        let reflectance = self.reflectance.eval(uv).into();
        At { reflectance, c: self.c, once: self.once.as_deref().map(|table| [table]), qualitative: self.qualitative }
    }

    /// Albedo of white facets for light scattered once, at a cosine: the mean over cosine-distributed directions. Around the normal
    /// the mean of cos φ over the half where it is positive is 1/π, that of |cos φ| 2/π.
    fn albedo_once(&self, cos: f32) -> f32 {
        const STEPS: usize = 512;
        let at = |cos: f32| V3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        let wo = at(cos.max(1e-3));
        let mean = |i: usize| {
            let angles = Angles::new(wo, at((1.0 - (i as f32 + 0.5) / STEPS as f32).sqrt()));
            let beyond = |cos_phi| Angles { cos_phi, ..angles }.scattered(self.c, self.qualitative)[0] - self.c[0];
            beyond(0.0) * (1.0 - 2.0 * FRAC_1_PI) + (beyond(1.0) + beyond(-1.0)) * FRAC_1_PI
        };
        self.c[0] + (0..STEPS).map(mean).sum::<f32>() / STEPS as f32
    }
}

impl<'a, R: Real> At<'a, R> {
    /// Number of the discrete options, see [`Variant`](super::Variant).
    pub(super) fn option(&self) -> usize {
        usize::from(self.qualitative) + 2 * usize::from(self.once.is_some())
    }

    /// Divisor of f for a direction with a cosine: the albedo, where that is above 1.
    #[inline(always)]
    fn excess(&self, once: &R::Each<&'a [f32; COSINES]>, cos: R) -> V3<R> {
        let once = interpolated::<R, &[f32; COSINES]>(once, COSINES, cos.between(0.0, 1.0) * (COSINES - 1) as f32);
        let color = self.reflectance;
        (color * once + color * color * self.c[3]).at_least(1.0)
    }

    /// f·cos θᵢ.
    #[inline(always)]
    fn value(&self, wo: V3<R>, wi: V3<R>) -> V3<R> {
        let front = wo.z.above(0.0) & wi.z.above(0.0);
        if !front.any() {
            return V3::splat(wi.z.all(0.0));
        }
        let color = self.reflectance;
        let [once, twice] = Angles::new(wo, wi).scattered(self.c, self.qualitative);
        // The fit falls a little below 0 for the roughest, against the light.
        let value = (color * once + color * color * twice).at_least(0.0) * (wi.z * FRAC_1_PI);
        let bounded = match &self.once {
            Some(table) => value / (self.excess(table, wo.z) * self.excess(table, wi.z)),
            None => value,
        };
        bounded.only(front)
    }
}

impl<R: Real> Scatter<R> for At<'_, R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        (self.value(wo, wi), cosine_pdf(wo, wi))
    }

    /// Cosine-distributed direction. Weights stay below 2 but where both directions graze the surface, and have the mean albedo.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let wi = warp::lanes::square_to_cosine_hemisphere(u);
        let pdf = cosine_pdf(wo, wi);
        Drawn::of_lobe(wi, self.value(wo, wi) / pdf, pdf)
    }

    /// Albedo of the facets.
    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        self.reflectance
    }
}
