//! The principled material of thin sheets (Burley 2015, §5.3), with the formulas of Mitsuba 3's `principledthin`: a diffuse base that also
//! scatters light through, sheen, and GGX facets that mirror light to either side, since a sheet bends nothing. Both sides are alike.
//!
//! Two things differ. The whole is divided by an upper bound of its albedo at both directions wherever that exceeds 1, as
//! [`principled`](super::principled) is. And light is let through at all angles: Mitsuba leaves out directions that its facets, which it
//! turns around for that, seem to be turned away from, other ones from the camera's side than from the light's.

use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::burley::{
    Bounds, albedo_of_base, albedo_of_facets, albedo_of_sheen, approximate, diffuse, facets_of, mean, mirrored_at,
    schlick, tabulated,
};
use super::fresnel;
use super::texture::{Texture, luminance};
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::{Mask, Real, V3, lanes_of};
use crate::sampling::warp::lanes as warp;

/// Parameters of a thin principled material. Numbers are in [0, 1] unless something else is said.
#[derive(Debug, Clone)]
pub struct Parameters {
    /// Colour of the base, and of what passes.
    pub base_color: Texture,
    /// Square root of the facets' roughness α.
    pub roughness: Texture,
    /// Blend from a diffuse sheet (0) to a clear one (1).
    pub spec_trans: Texture,
    /// Part of the diffuse light that goes through.
    pub diff_trans: Texture,
    /// Refractive index of the sheet relative to what is around it, at least 1.
    pub eta: f32,
    /// Tint of the specular reflection, from white (0) to the base's hue (1).
    pub spec_tint: f32,
    /// Strength of the sheen.
    pub sheen: f32,
    /// Tint of the sheen, from white (0) to the base's hue (1).
    pub sheen_tint: f32,
    /// Blend from the diffuse base (0) to an approximation of subsurface scattering (1).
    pub flatness: f32,
}

/// A thin principled material.
#[derive(Debug, Clone)]
pub struct PrincipledThin {
    given: Parameters,
    bounds: Arc<Bounds>,
}

/// A thin principled material at surface points.
#[derive(Clone, Copy)]
pub struct At<'a, R: Real> {
    base: V3<R>,
    /// The base's hue: its colour over its luminance.
    hue: V3<R>,
    roughness: R,
    /// Weight of the facets; the base has the rest.
    clear: R,
    /// Part of the base's light that goes through.
    through: R,
    eta: R,
    spec_tint: R,
    sheen: R,
    sheen_tint: R,
    flatness: R,
    bounds: R::Each<&'a Bounds>,
}

lanes_of!(At<'a> {
    base, hue, roughness, clear, through, eta, spec_tint, sheen, sheen_tint, flatness, bounds
});

/// Probabilities of sampling the lobes, as seen from one direction: the sum is 1, or 0 where nothing is scattered.
struct Lobes<R> {
    /// Facets that mirror to the same side.
    mirrors: R,
    /// Facets that mirror to the other side.
    passes: R,
    /// The base on the same side.
    base: R,
    /// The base on the other side.
    through: R,
}

/// Roughness of the facets for light that passes (Burley 2015, figure 15).
#[inline(always)]
fn passing<R: Real>(roughness: R, eta: R) -> R {
    (eta * 0.65 - 0.35) * roughness
}

impl PrincipledThin {
    /// The material with its bounds tabulated.
    pub fn new(given: Parameters) -> Self {
        // At 1 there would be no interface to mirror light.
        let given = Parameters { eta: given.eta.max(1.001), ..given };
        let bounds = Bounds::new(&given.roughness, albedo_of_sheen, |roughness, wo, sheen| {
            let [base, mirrored] =
                [albedo_of_base(roughness, given.flatness, wo), albedo_of_facets(roughness, given.eta, wo)];
            [base, mirrored, *sheen, albedo_of_passing(roughness, given.eta, wo)]
        });
        Self { given, bounds: Arc::new(bounds) }
    }

    /// Square root of the facets' roughness α.
    pub(super) fn root_of_roughness(&self) -> &Texture {
        &self.given.roughness
    }

    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        let Parameters { base_color, roughness, spec_trans, diff_trans, .. } = &self.given;
        [base_color, roughness, spec_trans, diff_trans].into_iter().for_each(|texture| texture.prefetch(uv));
    }

    /// The material at `uv`: all that its textures say there.
    pub fn at(&self, uv: Vec2) -> At<'_, f32> {
        let given = &self.given;
        let base = given.base_color.eval(uv);
        let luminance = luminance(base);
        let part = |texture: &Texture| texture.value(uv).clamp(0.0, 1.0);
        At {
            base: base.into(),
            hue: if luminance > 0.0 { base / luminance } else { Vec3::ONE }.into(),
            roughness: part(&given.roughness),
            clear: part(&given.spec_trans),
            through: part(&given.diff_trans),
            eta: given.eta,
            spec_tint: given.spec_tint,
            sheen: given.sheen,
            sheen_tint: given.sheen_tint,
            flatness: given.flatness,
            bounds: [&self.bounds],
        }
    }
}

impl<R: Real> At<'_, R> {
    /// What facets reflect that are seen under `cos`, where Fresnel's reflectance is `exact`: their tinted part by Schlick.
    #[inline(always)]
    fn reflection(&self, cos: R, exact: R) -> V3<R> {
        let white = V3::splat(self.spec_tint.rest() * exact);
        if !self.spec_tint.above(0.0).any() {
            return white;
        }
        let normal = ((self.eta - 1.0) / (self.eta + 1.0)).squared();
        // The hue of a pure colour is many times as bright as the colour.
        white + approximate((self.hue * normal).at_most(1.0), schlick(cos)) * self.spec_tint
    }

    /// Roughness of the facets that mirror light to the same side, and where `behind` of those that send it to the other.
    #[inline(always)]
    fn roughness_of(&self, behind: R::Mask) -> R {
        behind.choose(passing(self.roughness, self.eta), self.roughness)
    }

    /// Probabilities of the lobes, about proportional to what they scatter.
    #[inline(always)]
    fn lobes(&self, cos: R) -> Lobes<R> {
        let exact = fresnel::dielectric(cos.at_most(1.0), self.eta).0;
        let brightness = self.base.mean();
        let mirrors = self.clear * self.reflection(cos, exact).mean();
        let passes = self.clear * exact.rest() * brightness;
        let base = self.clear.rest() * self.through.rest() * (brightness + self.sheen * 0.25);
        let through = self.clear.rest() * self.through * brightness;
        let sum = (mirrors + passes + base + through).at_least(f32::MIN_POSITIVE);
        Lobes { mirrors: mirrors / sum, passes: passes / sum, base: base / sum, through: through / sum }
    }

    /// f·cos and the density; `wo` is in front, `wi` mirrored to there where it is `behind`.
    #[inline(always)]
    fn scattered(&self, wo: V3<R>, wi: V3<R>, behind: R::Mask) -> (V3<R>, R) {
        let (h, found) = (wo + wi).try_normalize();
        let facets = facets_of(self.roughness_of(behind));
        let (cos, density) = (wo.dot(h), facets.density(h));
        let exact = fresnel::dielectric(cos.between(0.0, 1.0), self.eta).0;
        let factor = V3::choose(behind, self.base * exact.rest(), self.reflection(cos, exact));
        let sent = density * facets.shadowing(wo, h) * facets.shadowing(wi, h) / (wo.z * 4.0);
        let specular = (factor * (self.clear * sent)).only(cos.above(0.0) & !sent.is(0.0));
        let lobes = self.lobes(wo.z);
        let (of_facets, of_base) =
            (behind.choose(lobes.passes, lobes.mirrors), behind.choose(lobes.through, lobes.base));
        let pdf = of_facets * facets.visible_part(density, wo, h) / (cos * 4.0)
            + of_base * warp::square_to_cosine_hemisphere_pdf(wi);
        let value = specular + self.diffused(wo, wi, h, behind);
        (value.only(found), pdf.only(found & pdf.finite()))
    }

    /// What the base scatters.
    #[inline(always)]
    fn diffused(&self, wo: V3<R>, wi: V3<R>, h: V3<R>, behind: R::Mask) -> V3<R> {
        let opaque = self.clear.rest();
        let shape = behind.choose(opaque.all(1.0), diffuse(self.roughness, self.flatness, wo, wi, h));
        let part = opaque * behind.choose(self.through, self.through.rest());
        let mut sum = self.base * (part * wi.z * FRAC_1_PI * shape);
        if self.sheen.above(0.0).any() {
            let color = V3::splat(self.sheen_tint.rest()) + self.hue * self.sheen_tint;
            sum = sum + (color * (self.sheen * part * schlick(wi.dot(h)) * wi.z)).only(!behind);
        }
        sum
    }

    /// Upper bound of the albedo at an angle with cosine `cos`.
    #[inline(always)]
    fn most(&self, cos: R) -> R {
        let [base, mirrored, sheen, passed] = tabulated(self.bounds, self.roughness, cos);
        let brightest = self.base.max_element();
        let more_hue = (self.hue.max_element() - 1.0).at_least(0.0);
        let mirrored = (mirrored * (self.spec_tint * more_hue + 1.0)).at_most(1.0);
        let sheen = self.sheen * (more_hue * self.sheen_tint + 1.0) * sheen;
        let diffuse = self.through.rest() * (brightest * base + sheen) + self.through * brightest;
        self.clear * (mirrored + brightest * passed) + self.clear.rest() * diffuse
    }
}

impl<R: Real> Scatter<R> for At<'_, R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let back = wo.z.below(0.0);
        let (wo, wi) = (V3::choose(back, -wo, wo), V3::choose(back, -wi, wi));
        let behind = wi.z.below(0.0);
        let wi = V3::new(wi.x, wi.y, wi.z.abs());
        let seen = wo.z.above(0.0) & wi.z.above(0.0);
        let (value, pdf) = self.scattered(wo, wi, behind);
        let bound = self.most(wo.z).max(self.most(wi.z)).at_least(1.0).inverse();
        ((value * bound).only(seen), pdf.only(seen))
    }

    /// Chooses a lobe with `lobe` and a direction of it with `u`.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let back = wo.z.below(0.0);
        let front = V3::choose(back, -wo, wo);
        let lobes = self.lobes(front.z);
        let of_facets = lobe.lt(lobes.mirrors + lobes.passes);
        let behind =
            of_facets & lobe.ge(lobes.mirrors) | !of_facets & lobe.ge(lobes.mirrors + lobes.passes + lobes.base);
        let mut wi = warp::square_to_cosine_hemisphere(u);
        if of_facets.any() {
            let h = facets_of(self.roughness_of(behind)).sample_visible(front, u);
            wi = V3::choose(of_facets, mirrored_at(front, h).normalize(), wi);
        }
        let above = wi.z.above(0.0) & front.z.above(0.0);
        let wi = V3::new(wi.x, wi.y, behind.choose(-wi.z, wi.z));
        let wi = V3::choose(back, -wi, wi);
        let (value, pdf) = self.eval_and_pdf(wo, wi);
        let weight = value / pdf;
        let found = above & pdf.above(0.0) & weight.is_finite();
        Drawn { wi, weight, pdf, delta: found.none(), found }
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        let one = self.eta.all(1.0);
        let exact = fresnel::dielectric(one, self.eta).0;
        let clear = self.reflection(one, exact) + self.base * exact.rest();
        (self.base * self.clear.rest() + clear * self.clear).at_most(1.0)
    }
}

/// Albedo of white facets that mirror to the other side what they do not reflect.
fn albedo_of_passing(roughness: f32, eta: f32, wo: V3<f32>) -> f32 {
    let facets = facets_of(passing(roughness, eta));
    mean(|u| {
        let h = facets.sample_visible(wo, u);
        let wi = mirrored_at(wo, h);
        let passes = 1.0 - fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), eta).0;
        if wi.z > 0.0 { passes * facets.shadowing(wi, h) } else { 0.0 }
    })
}
