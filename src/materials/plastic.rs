//! Plastic: a clear coat, smooth or rough, over a diffuse base.
//!
//! Light that the coat transmits is scattered by the base, and light that the coat reflects back inside is scattered again, without
//! limit: f = ρ·T(θₒ)·T(θᵢ) / (π·η²·(1 − ρ'·R)), where T is the coat's transmittance from outside, R its reflectance for diffuse
//! light from inside, and ρ' is 1, or ρ where colours are to saturate with each round (Mitsuba's `plastic` and `roughplastic`,
//! whose pictures this matches; the smooth case is Shirley et al. 1997 without their fit).

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::BsdfSample;
use super::fresnel;
use super::microfacet::Microfacets;
use super::texture::Texture;
use crate::math::channel_mean;
use crate::sampling::warp;

/// A coated diffuse surface, on the front side.
#[derive(Debug, Clone)]
pub struct Plastic {
    base: Texture,
    reflectance: Texture,
    eta: f32,
    nonlinear: bool,
    facets: Option<Microfacets>,
    /// Transmittance of a rough coat from outside, at [`COSINES`] cosines from 0 to 1; empty for a smooth one.
    transmitted: Vec<f32>,
    /// Reflectance of the coat for diffuse light from inside.
    internal: f32,
    /// Probability of sampling the coat where it reflects half of all light.
    coat_share: f32,
}

/// Cosines at which a coat is tabulated, from 0 to 1.
const COSINES: usize = 64;
/// Facet normals along each axis of the quadrature.
const NORMALS: usize = 32;

impl Plastic {
    /// Plastic with a coat of refractive index `eta` relative to the outside over a base with albedo `base`. `reflectance` is a
    /// factor on the coat's reflection. Without `facets` the coat is smooth.
    pub fn new(base: Texture, reflectance: Texture, eta: f32, nonlinear: bool, facets: Option<Microfacets>) -> Self {
        let cosine = |i: usize| i as f32 / (COSINES - 1) as f32;
        let tabulated = if facets.is_some() { COSINES } else { 0 };
        let transmitted = (0..tabulated).map(|i| hemispheric(cosine(i), eta, facets, false)).collect();
        // 2·∫R·cos. For a rough coat it is the mean at 64 cosines, both ends whole: a percent below the integral, but as in
        // Mitsuba, next to whose pictures a diffuse base would be 2 % too bright otherwise.
        let weighted = |cos: f32| f64::from(hemispheric(cos, 1.0 / eta, facets, true) * cos);
        let steps = if facets.is_some() { COSINES } else { 64 * COSINES };
        let at = |i: usize| if facets.is_some() { cosine(i) } else { (i as f32 + 0.5) / steps as f32 };
        let internal = (2.0 / steps as f64 * (0..steps).map(|i| weighted(at(i))).sum::<f64>()) as f32;
        let [of_coat, of_base] = [&reflectance, &base].map(|texture| channel_mean(texture.mean()).max(0.0));
        let coat_share = if of_coat + of_base > 0.0 { of_coat / (of_coat + of_base) } else { 0.5 };
        Self { base, reflectance, eta, nonlinear, facets, transmitted, internal, coat_share }
    }

    /// Transmittance of the coat from outside, at an angle with cosine `cos` ≥ 0.
    fn transmitted(&self, cos: f32) -> f32 {
        if self.facets.is_none() {
            return fresnel::transmitted(cos, self.eta);
        }
        let position = cos.clamp(0.0, 1.0) * (COSINES - 1) as f32;
        let below = (position as usize).min(COSINES - 2);
        let [a, b] = [self.transmitted[below], self.transmitted[below + 1]];
        a + (b - a) * (position - below as f32)
    }

    /// f·cos θᵢ of the base and of a rough coat.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Vec3::ZERO;
        }
        let passed = self.transmitted(wo.z) * self.transmitted(wi.z) / (self.eta * self.eta);
        let base = self.scattered(uv) * (passed * wi.z * FRAC_1_PI);
        base + self.facets.map_or(Vec3::ZERO, |facets| {
            let Some(h) = (wo + wi).try_normalize() else { return Vec3::ZERO };
            let reflected = fresnel::dielectric(wo.dot(h).max(0.0), self.eta).0;
            let g = facets.shadowing(wo, h) * facets.shadowing(wi, h);
            self.reflectance.eval(uv) * (reflected * facets.density(h) * g / (4.0 * wo.z))
        })
    }

    /// Albedo of the base with all rounds inside the coat, ρ / (1 − ρ'·R).
    fn scattered(&self, uv: Vec2) -> Vec3 {
        let base = self.base.eval(uv);
        base / (Vec3::ONE - if self.nonlinear { base } else { Vec3::ONE } * self.internal)
    }

    /// Albedo at normal incidence.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        let passed = self.transmitted(1.0);
        let inside = passed * (1.0 - self.internal);
        (self.reflectance.eval(uv) * (1.0 - passed) + self.scattered(uv) * inside).min(Vec3::ONE)
    }

    /// Density over the lobes that are not delta, w.r.t. solid angle.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let [coat, base] = self.probabilities(wo);
        base * warp::square_to_cosine_hemisphere_pdf(wi)
            + self.facets.map_or(0.0, |facets| {
                let Some(h) = (wo + wi).try_normalize() else { return 0.0 };
                let cos = wo.dot(h);
                if cos > 0.0 { coat * facets.visible_density(wo, h) / (4.0 * cos) } else { 0.0 }
            })
    }

    /// Probability with which [`Plastic::sample`] reflects at a smooth coat.
    pub fn delta_probability(&self, wo: Vec3) -> f32 {
        if self.facets.is_some() || wo.z <= 0.0 { 0.0 } else { self.probabilities(wo)[0] }
    }

    /// Probabilities of sampling the coat and the base.
    fn probabilities(&self, wo: Vec3) -> [f32; 2] {
        let passed = self.transmitted(wo.z);
        let (coat, base) = ((1.0 - passed) * self.coat_share, passed * (1.0 - self.coat_share));
        if coat + base > 0.0 { [coat, base].map(|part| part / (coat + base)) } else { [1.0, 0.0] }
    }

    /// Reflects at the coat or scatters from the base.
    pub fn sample(&self, uv: Vec2, wo: Vec3, [choice, u]: [f32; 2]) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let [coat, _] = self.probabilities(wo);
        let wi = if choice < coat {
            let Some(facets) = self.facets else {
                let wi = Vec3::new(-wo.x, -wo.y, wo.z);
                let reflected = 1.0 - self.transmitted(wo.z);
                let weight = self.reflectance.eval(uv) * (reflected / coat);
                return Some(BsdfSample { wi, weight, pdf: coat, delta: true });
            };
            let h = facets.sample_visible(wo, [choice / coat, u]);
            h * (2.0 * wo.dot(h)) - wo
        } else {
            warp::square_to_cosine_hemisphere([((choice - coat) / (1.0 - coat)).min(1.0 - f32::EPSILON / 2.0), u])
        };
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: self.eval(uv, wo, wi) / pdf, pdf, delta: false })
    }
}

/// Reflectance of an interface at an angle with cosine `cos` if `reflects`, else its transmittance: Fresnel's, or its mean over the
/// visible facets, less the part that other facets block on its way out.
fn hemispheric(cos: f32, eta: f32, facets: Option<Microfacets>, reflects: bool) -> f32 {
    let part = |(reflected, _): (f32, f32)| if reflects { reflected } else { 1.0 - reflected };
    let Some(facets) = facets else { return part(fresnel::dielectric(cos, eta)) };
    let cos = cos.max(1e-4);
    let w = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
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

    /// Diffuse Fresnel reflectance: 0.0918 from outside and 0.5963 from inside at an index of 1.5 (Egan and Hilgeman 1973, table;
    /// the two follow from each other by 1 − R_in = (1 − R_out)/η²).
    #[test]
    fn diffuse_reflectance_from_inside() {
        let white = Texture::Constant(Vec3::ONE);
        let plastic = Plastic::new(white.clone(), white, 1.5, false, None);
        assert!((plastic.internal - 0.5963).abs() < 5e-4, "{}", plastic.internal);
    }

    /// The rough coat becomes the smooth one as its roughness vanishes.
    #[test]
    fn a_hardly_rough_coat_is_smooth() {
        use crate::materials::microfacet::Shape;
        let coat = |facets| {
            let white = Texture::Constant(Vec3::splat(0.5));
            Plastic::new(white.clone(), white, 1.5, true, facets)
        };
        let smooth = coat(None);
        for shape in [Shape::Beckmann, Shape::Ggx] {
            let rough = coat(Some(Microfacets { shape, alpha: 1e-3 }));
            assert!((rough.internal - smooth.internal).abs() < 0.011, "{} {}", rough.internal, smooth.internal);
            for cos in [0.2, 0.5, 1.0] {
                assert!((rough.transmitted(cos) - smooth.transmitted(cos)).abs() < 5e-3, "{cos}");
            }
        }
    }
}
