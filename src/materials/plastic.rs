//! Plastic: a clear coat, smooth or rough, over a diffuse base.
//!
//! Light that the coat transmits is scattered by the base, and light that the coat reflects back inside is scattered again, without
//! limit: f = ρ·T(θₒ)·T(θᵢ) / (π·η²·(1 − ρ'·R)), where T is the coat's transmittance from outside, R its reflectance for diffuse
//! light from inside, and ρ' is 1, or ρ where colours are to saturate with each round (Mitsuba's `plastic` and `roughplastic`,
//! whose pictures this matches; the smooth case is Shirley et al. 1997 without their fit).

use std::f32::consts::FRAC_1_PI;

use glam::Vec2;
use rayon::prelude::*;

use super::fresnel;
use super::microfacet::Microfacets;
use super::table::interpolated;
use super::texture::Texture;
use super::{Drawn, Scatter, Transport, mirrored};
use crate::math::channel_mean;
use crate::math::lanes::{Mask, Real, V3, lanes_of};
use crate::sampling::warp;

/// A coated diffuse surface, on the front side.
#[derive(Debug, Clone)]
pub struct Plastic {
    base: Texture,
    reflectance: Texture,
    eta: f32,
    nonlinear: bool,
    facets: Option<Microfacets>,
    coat: Coat,
    /// Where its roughness varies, the coat with parts of it, in even steps from none to all.
    smoother: Vec<Coat>,
    /// Probability of sampling the coat where it reflects half of all light.
    coat_share: f32,
}

/// What is tabulated of a coat.
#[derive(Debug, Clone)]
struct Coat {
    /// Transmittance of a rough coat from outside, at [`COSINES`] cosines from 0 to 1; empty for a smooth one.
    transmitted: Vec<f32>,
    /// Reflectance for diffuse light from inside.
    internal: f32,
}

/// Plastic at surface points.
#[derive(Clone, Copy)]
pub struct At<'a, R: Real> {
    /// Albedo of the base with all rounds inside the coat, ρ / (1 − ρ'·R).
    scattered: V3<R>,
    reflectance: V3<R>,
    eta: R,
    internal: R,
    coat_share: R,
    transmitted: R::Each<&'a [f32]>,
    facets: Option<Microfacets<R>>,
}

lanes_of!(At<'a> { scattered, reflectance, eta, internal, coat_share, transmitted, facets });

/// Cosines at which a coat is tabulated, from 0 to 1.
const COSINES: usize = 64;
/// Facet normals along each axis of the quadrature.
const NORMALS: usize = 32;
/// Roughnesses at which a coat is tabulated whose roughness varies.
const PARTS: usize = 16;

impl Coat {
    fn new(eta: f32, facets: Option<Microfacets>) -> Self {
        let cosine = |i: usize| i as f32 / (COSINES - 1) as f32;
        let tabulated = if facets.is_some() { COSINES } else { 0 };
        let transmitted = (0..tabulated).map(|i| hemispheric(cosine(i), eta, facets, false)).collect();
        // 2·∫R·cos. For a rough coat it is the mean at 64 cosines, both ends whole: a percent below the integral, but as in
        // Mitsuba, next to whose pictures a diffuse base would be 2 % too bright otherwise.
        let weighted = |cos: f32| f64::from(hemispheric(cos, 1.0 / eta, facets, true) * cos);
        let steps = if facets.is_some() { COSINES } else { 64 * COSINES };
        let at = |i: usize| if facets.is_some() { cosine(i) } else { (i as f32 + 0.5) / steps as f32 };
        let internal = (2.0 / steps as f64 * (0..steps).map(|i| weighted(at(i))).sum::<f64>()) as f32;
        Self { transmitted, internal }
    }
}

impl Plastic {
    /// Roughness α of the coat; 1 where it is smooth, and so the base alone is no delta lobe.
    pub(super) fn roughness(&self) -> f32 {
        self.facets.map_or(1.0, |facets| facets.alpha.min(1.0))
    }

    /// Plastic with a coat of refractive index `eta` relative to the outside over a base with albedo `base`. `reflectance` is a
    /// factor on the coat's reflection. Without `facets` the coat is smooth.
    pub fn new(base: Texture, reflectance: Texture, eta: f32, nonlinear: bool, facets: Option<Microfacets>) -> Self {
        let [of_coat, of_base] = [&reflectance, &base].map(|texture| channel_mean(texture.mean()).max(0.0));
        let coat_share = if of_coat + of_base > 0.0 { of_coat / (of_coat + of_base) } else { 0.5 };
        Self {
            base,
            reflectance,
            eta,
            nonlinear,
            facets,
            coat: Coat::new(eta, facets),
            smoother: Vec::new(),
            coat_share,
        }
    }

    /// Whether the coat has facets.
    pub(super) fn is_rough(&self) -> bool {
        self.facets.is_some()
    }

    /// Tabulates what [`Plastic::at`] needs for parts of the roughness.
    pub(super) fn vary_roughness(&mut self) {
        let part = |i: usize| i as f32 / (PARTS - 1) as f32;
        let coat = |i: usize| Coat::new(self.eta, self.facets.map(|facets| facets.scaled(part(i))));
        self.smoother = (0..PARTS).into_par_iter().map(coat).collect();
    }

    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        self.base.prefetch(uv);
        self.reflectance.prefetch(uv);
    }

    /// Plastic at `uv`, with this part of its roughness: 1 unless that varies.
    pub fn at(&self, uv: Vec2, part: f32) -> At<'_, f32> {
        let base = V3::from(self.base.eval(uv));
        let Coat { transmitted, internal } =
            self.smoother.get((part * (PARTS - 1) as f32).round() as usize).unwrap_or(&self.coat);
        // A base brighter than white would send back more light than any number, or less than none.
        let saturated = if self.nonlinear { base.at_most(1.0) } else { V3::splat(1.0) };
        At {
            scattered: base / (saturated * *internal).rest(),
            reflectance: self.reflectance.eval(uv).into(),
            eta: self.eta,
            internal: *internal,
            coat_share: self.coat_share,
            transmitted: [transmitted],
            facets: self.facets.map(|facets| facets.scaled(part)),
        }
    }
}

/// What one direction sees: transmittance of the coat, and the probabilities of sampling the coat and the base.
#[derive(Clone, Copy)]
struct Seen<R> {
    passed: R,
    coat: R,
    base: R,
}

impl<R: Real> At<'_, R> {
    /// Number of the discrete options, see [`Variant`](super::Variant).
    pub(super) fn option(&self) -> usize {
        self.facets.map_or(0, |facets| 1 + facets.shape as usize)
    }

    /// Transmittance of the coat from outside, at an angle with cosine `cos` ≥ 0.
    #[inline(always)]
    fn transmitted(&self, cos: R) -> R {
        if self.facets.is_none() {
            return fresnel::transmitted(cos, self.eta);
        }
        interpolated::<R, &[f32]>(&self.transmitted, COSINES, cos.between(0.0, 1.0) * (COSINES - 1) as f32)
    }

    #[inline(always)]
    fn seen(&self, wo: V3<R>) -> Seen<R> {
        let passed = self.transmitted(wo.z);
        let (coat, base) = (passed.rest() * self.coat_share, passed * self.coat_share.rest());
        let any = (coat + base).above(0.0);
        let (coat, base) = (any.choose(coat / (coat + base), coat.all(1.0)), (base / (coat + base)).only(any));
        Seen { passed, coat, base }
    }

    /// f·cos θᵢ and the density of both lobes that are not delta, of two directions in front.
    #[inline(always)]
    fn lobes(&self, seen: &Seen<R>, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let passed = seen.passed * self.transmitted(wi.z) / (self.eta * self.eta);
        let base = self.scattered * (passed * wi.z * FRAC_1_PI);
        let base_pdf = seen.base * warp::lanes::square_to_cosine_hemisphere_pdf(wi);
        let Some(facets) = self.facets else { return (base, base_pdf) };
        let (h, found) = (wo + wi).try_normalize();
        let (cos, density) = (wo.dot(h), facets.density(h));
        let reflected = fresnel::dielectric(cos.at_least(0.0), self.eta).0;
        let g = facets.shadowing(wo, h) * facets.shadowing(wi, h);
        let coat = self.reflectance * (reflected * density * g / (wo.z * 4.0));
        let coat_pdf = seen.coat * facets.visible_part(density, wo, h) / (cos * 4.0);
        (base + coat.only(found), base_pdf + coat_pdf.only(found & cos.above(0.0)))
    }
}

impl<R: Real> Scatter<R> for At<'_, R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let front = wo.z.above(0.0) & wi.z.above(0.0);
        if !front.any() {
            return (V3::splat(wi.z.all(0.0)), wi.z.all(0.0));
        }
        let (value, pdf) = self.lobes(&self.seen(wo), wo, wi);
        (value.only(front), pdf.only(front))
    }

    /// Reflects at the coat or scatters from the base; the number that chooses is used up by the direction.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, [choice, u]: [R; 2], _: Transport) -> Drawn<R> {
        let seen = self.seen(wo);
        let coated = choice.lt(seen.coat);
        let weight = self.reflectance * (seen.passed.rest() / seen.coat);
        let mirror = Drawn::of_delta(mirrored(wo), weight, seen.coat, wo.z.above(0.0));
        let mut wi = mirror.wi;
        match self.facets {
            None if !(!coated).any() => return mirror,
            Some(facets) if coated.any() => {
                let h = facets.sample_visible(wo, [choice / seen.coat, u]);
                wi = h * (wo.dot(h) * 2.0) - wo;
            }
            _ => {}
        }
        if (!coated).any() {
            let left = ((choice - seen.coat) / seen.coat.rest()).at_most(1.0 - f32::EPSILON / 2.0);
            wi = V3::choose(coated, wi, warp::lanes::square_to_cosine_hemisphere([left, u]));
        }
        let front = wo.z.above(0.0) & wi.z.above(0.0);
        let (value, pdf) = self.lobes(&seen, wo, wi);
        let drawn = Drawn::of_lobe(wi, value / pdf, pdf.only(front));
        if self.facets.is_some() { drawn } else { Drawn::choose(coated, mirror, drawn) }
    }

    #[inline(always)]
    fn delta_probability(&self, wo: V3<R>) -> R {
        if self.facets.is_some() { wo.z.all(0.0) } else { self.seen(wo).coat.only(wo.z.above(0.0)) }
    }

    /// Albedo at normal incidence.
    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        let passed = self.transmitted(self.eta.all(1.0));
        let inside = passed * self.internal.rest();
        (self.reflectance * passed.rest() + self.scattered * inside).at_most(1.0)
    }
}

/// Reflectance of an interface at an angle with cosine `cos` if `reflects`, else its transmittance: Fresnel's, or its mean over the
/// visible facets, less the part that other facets block on its way out.
fn hemispheric(cos: f32, eta: f32, facets: Option<Microfacets>, reflects: bool) -> f32 {
    let part = |(reflected, _): (f32, f32)| if reflects { reflected } else { 1.0 - reflected };
    let Some(facets) = facets else { return part(fresnel::dielectric(cos, eta)) };
    let cos = cos.max(1e-4);
    let w = V3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let mut sum = 0.0f64;
    for i in 0..NORMALS * NORMALS {
        let u = [i % NORMALS, i / NORMALS].map(|k| (k as f32 + 0.5) / NORMALS as f32);
        let h = facets.sample_visible(w, u);
        let cos = w.dot(h).clamp(0.0, 1.0);
        let fresnel = fresnel::dielectric(cos, eta);
        let out = if reflects { h * (2.0 * cos) - w } else { h * (cos / eta - fresnel.1) - w / eta };
        if (out.z > 0.0) == reflects {
            sum += f64::from(part(fresnel) * facets.shadowing(out, h));
        }
    }
    (sum / (NORMALS * NORMALS) as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Diffuse Fresnel reflectance: 0.0918 from outside and 0.5963 from inside at an index of 1.5 (Egan and Hilgeman 1973, table;
    /// the two follow from each other by 1 − R_in = (1 − R_out)/η²).
    #[test]
    fn diffuse_reflectance_from_inside() {
        let white = Texture::Constant(Vec3::ONE);
        let plastic = Plastic::new(white.clone(), white, 1.5, false, None);
        assert!((plastic.coat.internal - 0.5963).abs() < 5e-4, "{}", plastic.coat.internal);
    }

    /// Whatever a base sends back, it is no less than nothing, and more than white is not multiplied between coat and base.
    #[test]
    fn a_base_brighter_than_white_stays_finite() {
        for base in [1.0, 1.6, 1.677, 2.0, 100.0] {
            let colour = Texture::Constant(Vec3::splat(base));
            let plastic = Plastic::new(colour.clone(), colour, 1.5, true, None);
            let scattered = plastic.at(Vec2::ZERO, 1.0).scattered.x;
            assert!((scattered / base - 1.0 / (1.0 - plastic.coat.internal)).abs() < 1e-4, "{base}: {scattered}");
        }
    }

    /// The rough coat becomes the smooth one as its roughness vanishes.
    #[test]
    fn a_hardly_rough_coat_is_smooth() {
        use crate::materials::microfacet::Shape;
        let coat = |facets| {
            let white = Texture::Constant(Vec3::splat(0.5));
            Plastic::new(white.clone(), white, 1.5, true, facets)
        };
        let passed = |plastic: &Plastic, cos| plastic.at(Vec2::ZERO, 1.0).transmitted(cos);
        let smooth = coat(None);
        for shape in [Shape::Beckmann, Shape::Ggx] {
            let rough = coat(Some(Microfacets::even(shape, 1e-3)));
            let [rough_internal, smooth_internal] = [&rough, &smooth].map(|plastic| plastic.coat.internal);
            assert!((rough_internal - smooth_internal).abs() < 0.011, "{rough_internal} {smooth_internal}");
            for cos in [0.2, 0.5, 1.0] {
                assert!((passed(&rough, cos) - passed(&smooth, cos)).abs() < 5e-3, "{cos}");
            }
        }
    }
}
