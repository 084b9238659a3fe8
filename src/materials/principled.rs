//! The principled material (Burley 2012; Burley 2015 for transmission), with the formulas of Mitsuba 3's `principled`:
//! a diffuse base with retro-reflection, sheen, GGX facets that are metal or dielectric and may refract, and a clear coat.
//!
//! The sum of the lobes may reflect more than arrives, mostly at grazing angles. So the whole is divided by an upper bound of
//! its albedo at both directions wherever that exceeds 1, which keeps it reciprocal; elsewhere the formulas are exact.

use std::f32::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::burley::{
    Bounds, albedo_of_base, albedo_of_facets, albedo_of_sheen, approximate, diffuse, facets_of, mean, mirrored_at,
    schlick, tabulated,
};
use super::dielectric::seen_from;
use super::fresnel;
use super::microfacet::{Grain, Microfacets, Shape};
use super::rough_dielectric::Geometry;
use super::texture::{Texture, luminance};
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::functions::{exp, ln, sin_cos};
use crate::math::lanes::{Mask, Real, V3, lanes_of};
use crate::sampling::warp::lanes as warp;

/// Parameters of a principled material. Numbers are in [0, 1] unless something else is said.
#[derive(Debug, Clone)]
pub struct Parameters {
    /// Albedo of the base; colour of a metal.
    pub base_color: Texture,
    /// Square root of the facets' roughness α.
    pub roughness: Texture,
    /// Blend from dielectric (0) to metal (1).
    pub metallic: Texture,
    /// Refractive index relative to the outside, at least 1.
    pub eta: f32,
    /// Tint of the dielectric's specular reflection, from white (0) to the base's hue (1).
    pub spec_tint: f32,
    /// Strength of the sheen: reflection at grazing angles as of cloth.
    pub sheen: f32,
    /// Tint of the sheen, from white (0) to the base's hue (1).
    pub sheen_tint: f32,
    /// Strength of the clear coat.
    pub clearcoat: f32,
    /// Gloss of the clear coat, from satin (0) to glossy (1).
    pub clearcoat_gloss: f32,
    /// Blend from the diffuse base (0) to an approximation of subsurface scattering (1).
    pub flatness: f32,
    /// Part of the dielectric that refracts instead of having a base.
    pub spec_trans: f32,
}

/// A principled material.
#[derive(Debug, Clone)]
pub struct Principled {
    given: Parameters,
    coat: Option<Coat<f32>>,
    bounds: Arc<Bounds>,
}

/// A principled material at surface points, all of which let light through or none, and all of which have a coat or none.
#[derive(Clone, Copy)]
pub struct At<'a, R: Real> {
    base: V3<R>,
    /// The base's hue: its colour over its luminance.
    hue: V3<R>,
    roughness: R,
    metallic: R,
    /// Weight of the diffuse base.
    opaque: R,
    /// Weight of refraction; none where the material lets no light through.
    clear: Option<R>,
    eta: R,
    spec_tint: R,
    sheen: R,
    sheen_tint: R,
    flatness: R,
    coat: Option<Coat<R>>,
    /// Grain of the facets; that of the coat has none.
    grain: Option<Grain<R>>,
    bounds: R::Each<&'a Bounds>,
}

lanes_of!(At<'a> {
    base, hue, roughness, metallic, opaque, clear, eta, spec_tint, sheen, sheen_tint, flatness, coat, grain, bounds
});

/// Probabilities of sampling the lobes, as seen from one direction.
struct Lobes<R> {
    facets: R,
    coat: R,
}

/// α of the coat's shadowing (Burley 2012, §5.6).
const COAT_SHADOWING: f32 = 0.25;
/// Reflectance of the coat at normal incidence: an index of 1.5.
const COAT_REFLECTION: f32 = 0.04;

impl Principled {
    /// The material with its bounds tabulated.
    pub fn new(given: Parameters) -> Self {
        // At 1 there would be no interface to bend light.
        let given = Parameters { eta: given.eta.max(1.001), ..given };
        let coat = (given.clearcoat > 0.0).then(|| Coat::new(given.clearcoat, given.clearcoat_gloss));
        let along = |wo| [albedo_of_sheen(wo), coat.map_or(0.0, |coat| albedo_of_coat(coat, wo))];
        let bounds = Bounds::new(&given.roughness, along, |roughness, wo, [sheen, coat]| {
            [albedo_of_base(roughness, given.flatness, wo), albedo_of_facets(roughness, given.eta, wo), *sheen, *coat]
        });
        let bounds = Arc::new(bounds);
        Self { given, coat, bounds }
    }

    /// Refractive index behind the surface over the one in front.
    pub fn eta(&self) -> f32 {
        self.given.eta
    }

    /// Square root of the facets' roughness α.
    pub(super) fn root_of_roughness(&self) -> &Texture {
        &self.given.roughness
    }

    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        let Parameters { base_color, roughness, metallic, .. } = &self.given;
        [base_color, roughness, metallic].into_iter().for_each(|texture| texture.prefetch(uv));
    }

    /// The material at `uv`: all that its textures say there.
    pub fn at(&self, uv: Vec2, grain: Option<Grain>) -> At<'_, f32> {
        let given = &self.given;
        let base = given.base_color.eval(uv);
        let roughness = given.roughness.value(uv).clamp(0.0, 1.0);
        let metallic = given.metallic.value(uv).clamp(0.0, 1.0);
        let luminance = luminance(base);
        At {
            base: base.into(),
            hue: if luminance > 0.0 { base / luminance } else { Vec3::ONE }.into(),
            roughness,
            metallic,
            opaque: (1.0 - metallic) * (1.0 - given.spec_trans),
            clear: (given.spec_trans > 0.0).then_some((1.0 - metallic) * given.spec_trans),
            eta: given.eta,
            spec_tint: given.spec_tint,
            sheen: given.sheen,
            sheen_tint: given.sheen_tint,
            flatness: given.flatness,
            coat: self.coat,
            grain: facets_of(roughness).with_grain(grain).grain,
            bounds: [&self.bounds],
        }
    }
}

/// Option of materials that light passes through, and of those with a clear coat behind them.
pub(super) const CLEAR: usize = 2;

impl At<'_, f32> {
    /// Number of the discrete options, which all lanes have in common; below 4.
    pub(super) fn option(&self) -> usize {
        CLEAR * usize::from(self.clear.is_some()) + usize::from(self.coat.is_some())
    }

    /// Whether the facets have a grain.
    pub(super) fn has_grain(&self) -> bool {
        self.grain.is_some()
    }
}

impl<R: Real> At<'_, R> {
    /// Whether light passes through.
    #[inline(always)]
    pub(super) fn transmits(&self) -> bool {
        self.clear.is_some()
    }

    /// The facets.
    #[inline(always)]
    fn facets(&self) -> Microfacets<R> {
        Microfacets { grain: self.grain, ..facets_of(self.roughness) }
    }

    /// Where the surface scatters light towards `wo`.
    #[inline(always)]
    fn is_seen(&self, wo: V3<R>) -> R::Mask {
        if self.clear.is_some() { !wo.z.is(0.0) } else { wo.z.above(0.0) }
    }

    /// A direction, turned around where it is not seen from the front. Nothing is seen from behind that does not transmit.
    #[inline(always)]
    fn turned(&self, w: V3<R>, front: R::Mask) -> V3<R> {
        if self.clear.is_some() { V3::choose(front, w, -w) } else { w }
    }

    /// Refractive index on the other side over that on the side from which the surface is seen.
    #[inline(always)]
    fn eta_from(&self, front: R::Mask) -> R {
        if self.clear.is_some() { front.choose(self.eta, self.eta.inverse()) } else { self.eta }
    }

    /// Reflection by all lobes, and the density.
    #[inline(always)]
    fn reflected(&self, wo: V3<R>, wi: V3<R>, lobes: &Lobes<R>) -> (V3<R>, R) {
        let front = wo.z.above(0.0);
        let (wo, wi) = (self.turned(wo, front), self.turned(wi, front));
        let (h, found) = (wo + wi).try_normalize();
        let (facets, cos) = (self.facets(), wo.dot(h));
        let density = facets.density(h);
        let parts = self.facet(cos, front);
        let sent = density * facets.shadowing(wo, h) * facets.shadowing(wi, h) / (wo.z * 4.0);
        let value = (parts[0] * sent).only(cos.above(0.0) & !sent.is(0.0));
        // From behind only the facets are seen.
        let value = value + self.layers(wo, wi, h).only(front);
        let base = (lobes.facets.rest() - lobes.coat).at_least(0.0);
        let mut pdf = lobes.facets * self.splits(parts)[0] * facets.visible_part(density, wo, h) / (cos * 4.0)
            + base * warp::square_to_cosine_hemisphere_pdf(wi);
        if let Some(coat) = &self.coat {
            pdf = pdf + lobes.coat * coat.density(h) * h.z / (cos * 4.0);
        }
        (value.only(found), pdf.only(found & pdf.finite()))
    }

    /// The facets' refraction (Walter et al. 2007, eq. 21), and the density.
    #[inline(always)]
    fn refracted(&self, wo: V3<R>, wi: V3<R>, lobes: &Lobes<R>) -> (V3<R>, R) {
        let (g, found) = Geometry::new(wo, wi, self.eta);
        let facets = self.facets();
        let density = facets.density(g.h);
        let parts = self.facet(g.cos_o, wo.z.above(0.0));
        let shadowing = facets.shadowing(g.wo, g.h) * facets.shadowing(g.wi, g.h);
        let sent = density * shadowing / g.wo.z;
        let value = parts[1] * (sent * g.cos_o * g.jacobian() / (g.eta * g.eta));
        let pdf = lobes.facets * self.splits(parts)[1] * facets.visible_part(density, g.wo, g.h) * g.jacobian();
        (value.only(found), pdf.only(found))
    }

    /// Reflectance of a facet seen under `cos` from the front, where Fresnel's is `exact`: metal by Schlick, dielectric by Fresnel,
    /// its tinted part by Schlick.
    #[inline(always)]
    fn reflection(&self, cos: R, exact: R) -> V3<R> {
        let (weight, tint, dielectric) = (schlick(cos), self.spec_tint, self.metallic.rest());
        let mut sum = V3::splat(dielectric * tint.rest() * exact) + approximate(self.base, weight) * self.metallic;
        if tint.above(0.0).any() {
            let normal = ((self.eta - 1.0) / (self.eta + 1.0)).squared();
            // The hue of a pure colour is many times as bright as the colour.
            sum = sum + approximate((self.hue * normal).at_most(1.0), weight) * (dielectric * tint);
        }
        sum
    }

    /// Reflectance and transmittance of a facet seen under the cosine `cos`.
    #[inline(always)]
    fn facet(&self, cos: R, front: R::Mask) -> [V3<R>; 2] {
        let exact = fresnel::dielectric(cos.between(0.0, 1.0), self.eta_from(front)).0;
        let Some(clear) = self.clear else { return [self.reflection(cos, exact), V3::splat(cos.all(0.0))] };
        let V3 { x, y, z } = self.base.at_least(0.0);
        let root = V3::new(x.sqrt(), y.sqrt(), z.sqrt());
        // From behind there is neither tint nor metal.
        let mut reflected = V3::splat(clear * exact);
        if front.any() {
            reflected = V3::choose(front, self.reflection(cos, exact), reflected);
        }
        [reflected, root * (clear * exact.rest())]
    }

    /// Factor that keeps the albedo at both directions from exceeding 1. A direction behind the surface has no bound.
    #[inline(always)]
    fn bound(&self, wo: V3<R>, wi: V3<R>) -> R {
        self.most(wo.z).max(self.most(wi.z)).at_least(1.0).inverse()
    }

    /// Upper bound of the albedo at an angle with cosine `cos`; 1 behind the surface.
    #[inline(always)]
    fn most(&self, cos: R) -> R {
        let (front, one) = (cos.above(0.0), cos.all(1.0));
        if !front.any() {
            return one;
        }
        let [diffuse, specular, sheen, coat] = tabulated(self.bounds, self.roughness, cos);
        let brightest = self.base.max_element();
        let more_hue = (self.hue.max_element() - 1.0).at_least(0.0);
        let dielectric = self.metallic.rest();
        let tinted = specular * (self.spec_tint * more_hue + 1.0);
        // A metal reflects at most everything.
        let facets = self.metallic + dielectric * tinted.at_most(1.0);
        let mut base = self.opaque * brightest * diffuse;
        if let Some(clear) = self.clear {
            base = base + clear * specular.rest() * brightest.at_least(0.0).sqrt();
        }
        let mut sum = facets + base + self.sheen * dielectric * (more_hue * self.sheen_tint + 1.0) * sheen;
        if let Some(of) = &self.coat {
            sum = sum + of.strength * coat;
        }
        front.choose(sum, one)
    }

    /// Reflection in front of the surface by all but the facets.
    #[inline(always)]
    fn layers(&self, wo: V3<R>, wi: V3<R>, h: V3<R>) -> V3<R> {
        let diffuse = diffuse(self.roughness, self.flatness, wo, wi, h);
        let mut sum = self.base * (self.opaque * wi.z * FRAC_1_PI * diffuse);
        if self.sheen.above(0.0).any() {
            sum = sum + self.sheen(wi, h);
        }
        if let Some(coat) = &self.coat {
            sum = sum + V3::splat(coat.strength * coat.of_full_strength(wo, wi, h) * wi.z);
        }
        sum
    }

    #[inline(always)]
    fn sheen(&self, wi: V3<R>, h: V3<R>) -> V3<R> {
        let color = V3::splat(self.sheen_tint.rest()) + self.hue * self.sheen_tint;
        color * (self.sheen * self.metallic.rest() * schlick(wi.dot(h)) * wi.z)
    }

    /// Probabilities of the lobes, about proportional to their reflectances.
    #[inline(always)]
    fn lobes(&self, wo: V3<R>) -> Lobes<R> {
        let front = wo.z.above(0.0);
        let [reflected, through] = self.facet(wo.z, front);
        let facets = reflected.mean() + through.mean();
        let diffuse = self.opaque * self.base.mean() + self.sheen * 0.25 * self.metallic.rest();
        let coat = match &self.coat {
            Some(coat) => coat.strength * 0.25 * (schlick(wo.z) + COAT_REFLECTION),
            None => wo.z.all(0.0),
        };
        let sum = facets + diffuse + coat;
        Lobes { facets: front.choose(facets / sum, wo.z.all(1.0)), coat: (coat / sum).only(front) }
    }

    /// Probabilities that a chosen facet reflects and that it refracts, by its reflectance and transmittance: each by itself, since
    /// either may be next to nothing.
    #[inline(always)]
    fn splits(&self, [reflected, through]: [V3<R>; 2]) -> [R; 2] {
        let (a, b) = (reflected.mean(), through.mean());
        let one = a.all(1.0);
        if self.clear.is_none() {
            return [one, b];
        }
        let passes = !b.is(0.0);
        [passes.choose(a / (a + b), one), (b / (a + b)).only(passes)]
    }

    /// Reflects or refracts at a visible facet; not where another facet would block the light.
    #[inline(always)]
    fn sample_facet(&self, wo: V3<R>, u: [R; 2], choice: R) -> (V3<R>, R::Mask) {
        let front = wo.z.above(0.0);
        let (wo, eta) = (self.turned(wo, front), self.eta_from(front));
        let h = self.facets().sample_visible(wo, u);
        if self.clear.is_none() {
            let wi = mirrored_at(wo, h);
            return (wi.normalize(), wi.z.above(0.0));
        }
        let cos = wo.dot(h);
        let reflects = choice.lt(self.splits(self.facet(cos, front))[0]);
        let cos_t = fresnel::dielectric(cos.between(0.0, 1.0), eta).1;
        let wi = V3::choose(reflects, mirrored_at(wo, h), h * (cos / eta - cos_t) - wo / eta);
        let passes = reflects & wi.z.above(0.0) | !reflects & wi.z.below(0.0);
        (self.turned(wi.normalize(), front), passes)
    }
}

impl<R: Real> Scatter<R> for At<'_, R> {
    /// For radiance.
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let zero = wo.z.all(0.0);
        let behind = (wo.z * wi.z).below(0.0);
        let seen = self.is_seen(wo) & !wi.z.is(0.0);
        let (reflects, refracts) = (seen & !behind, seen & behind);
        let (mut value, mut pdf) = (V3::splat(zero), zero);
        let lobes = self.lobes(wo);
        if reflects.any() {
            let pair = self.reflected(wo, wi, &lobes);
            (value, pdf) = (pair.0.only(reflects), pair.1.only(reflects));
        }
        if self.clear.is_some() && refracts.any() {
            let pair = self.refracted(wo, wi, &lobes);
            (value, pdf) = (V3::choose(refracts, pair.0, value), refracts.choose(pair.1, pdf));
        }
        if seen.any() {
            value = value * self.bound(wo, wi);
        }
        (value, pdf)
    }

    /// Chooses a lobe with `lobe` and a direction of it with `u`.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], transport: Transport) -> Drawn<R> {
        let lobes = self.lobes(wo);
        let seen = self.is_seen(wo);
        let of_facets = lobe.lt(lobes.facets);
        let of_coat = !of_facets & lobe.lt(lobes.facets + lobes.coat);
        let (mut wi, mut found) = (wo, seen);
        if (seen & of_facets).any() {
            let (direction, passes) = self.sample_facet(wo, u, lobe / lobes.facets);
            (wi, found) = (direction, seen & (passes | !of_facets));
        }
        if let Some(coat) = &self.coat
            && (seen & of_coat).any()
        {
            let h = coat.sample(u);
            wi = V3::choose(of_coat, mirrored_at(wo, h), wi);
        }
        let of_base = !(of_facets | of_coat);
        if (seen & of_base).any() {
            wi = V3::choose(of_base, warp::square_to_cosine_hemisphere(u), wi);
        }
        let refracts = (wi.z * wo.z).below(0.0);
        let (value, pdf) = self.eval_and_pdf(wo, wi);
        let mut weight = value / pdf;
        if self.clear.is_some() && transport == Transport::Importance {
            // Power is not squeezed into a smaller solid angle as radiance is.
            let eta = self.eta_from(wo.z.above(0.0));
            weight = weight * refracts.choose(eta * eta, eta.all(1.0));
        }
        let found = found & (of_facets | !refracts) & pdf.above(0.0) & weight.is_finite();
        Drawn { wi, weight, pdf, delta: found.none(), found }
    }

    #[inline(always)]
    fn eta(&self, wo: V3<R>) -> R {
        seen_from(wo, self.eta)
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        let one = self.eta.all(1.0);
        let reflection = self.reflection(one, fresnel::dielectric(one, self.eta).0);
        let clear = self.clear.unwrap_or(one.all(0.0));
        (self.base * self.opaque + reflection + V3::splat(clear)).at_most(1.0)
    }
}

/// A clear coat (Burley 2012, §5.6).
#[derive(Debug, Clone, Copy)]
struct Coat<R> {
    strength: R,
    /// α², and its logarithm.
    alpha2: R,
    ln_alpha2: R,
}

lanes_of!(Coat { strength, alpha2, ln_alpha2 });

impl Coat<f32> {
    fn new(strength: f32, gloss: f32) -> Self {
        let alpha = 0.1 + (0.001 - 0.1) * gloss;
        Self { strength, alpha2: alpha * alpha, ln_alpha2: ln(alpha * alpha) }
    }
}

impl<R: Real> Coat<R> {
    /// f of a coat of strength 1: a quarter of F·D·G with the generalised Trowbridge-Reitz distribution γ = 1.
    #[inline(always)]
    fn of_full_strength(&self, wo: V3<R>, wi: V3<R>, h: V3<R>) -> R {
        let facets = Microfacets { shape: Shape::Ggx, alpha: wo.z.all(COAT_SHADOWING), grain: None };
        let fresnel = schlick(wo.dot(h)) * (1.0 - COAT_REFLECTION) + COAT_REFLECTION;
        fresnel * 0.25 * self.density(h) * facets.shadowing(wo, h) * facets.shadowing(wi, h)
    }

    /// Density of facet normals, sr⁻¹ (Burley 2012, eq. 4).
    #[inline(always)]
    fn density(&self, h: V3<R>) -> R {
        // 1 − (1 − α²)·cos², written so that it keeps its digits near the normal.
        let spread = (h.x * h.x + h.y * h.y) + self.alpha2 * h.z * h.z;
        ((self.alpha2 - 1.0) / (self.ln_alpha2 * PI * spread)).only(h.z.above(0.0))
    }

    /// A facet normal with density D·cos θ.
    #[inline(always)]
    fn sample(&self, [u, v]: [R; 2]) -> V3<R> {
        // α to the power of 2·(1 − u).
        let power = exp(u.rest() * self.ln_alpha2);
        let cos2 = (power.rest() / self.alpha2.rest()).between(0.0, 1.0);
        let (sin, cos) = (cos2.rest().sqrt(), cos2.sqrt());
        let (sin_phi, cos_phi) = sin_cos(v * TAU);
        V3::new(sin * cos_phi, sin * sin_phi, cos)
    }
}

fn albedo_of_coat(coat: Coat<f32>, wo: V3<f32>) -> f32 {
    mean(|u| {
        let h = coat.sample(u);
        let wi = mirrored_at(wo, h);
        let density = coat.density(h) * h.z / (4.0 * wo.dot(h));
        if wi.z > 0.0 && density > 0.0 { coat.of_full_strength(wo, wi, h) * wi.z / density } else { 0.0 }
    })
}
