//! The principled material (Burley 2012; Burley 2015 for transmission), with the formulas of Mitsuba 3's `principled`:
//! a diffuse base with retro-reflection, sheen, GGX facets that are metal or dielectric and may refract, and a clear coat.
//!
//! The sum of the lobes may reflect more than arrives, mostly at grazing angles. So the whole is divided by an upper bound of
//! its albedo at both directions wherever that exceeds 1, which keeps it reciprocal; elsewhere the formulas are exact.

use std::f32::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::fresnel;
use super::microfacet::{Microfacets, Shape};
use super::rough_dielectric::Geometry;
use super::texture::{Texture, luminance};
use super::{BsdfSample, Transport};
use crate::math::channel_mean;
use crate::math::lanes::functions::{ln, pow, sin_cos};
use crate::sampling::warp;

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
    bounds: Arc<Bounds>,
}

/// The parameters at a surface point.
#[derive(Clone, Copy)]
struct Point {
    base: Vec3,
    /// The base's hue: its colour over its luminance.
    hue: Vec3,
    roughness: f32,
    metallic: f32,
    /// Weights of the diffuse base and of refraction.
    opaque: f32,
    clear: f32,
    facets: Microfacets,
}

/// Probabilities of sampling the lobes, as seen from one direction.
struct Lobes {
    facets: f32,
    coat: f32,
}

/// Burley's least α, which keeps densities finite.
const LEAST_ALPHA: f32 = 1e-3;
/// α of the coat's shadowing (Burley 2012, §5.6).
const COAT_SHADOWING: f32 = 0.25;
/// Reflectance of the coat at normal incidence: an index of 1.5.
const COAT_REFLECTION: f32 = 0.04;

/// Schlick's (1 − cos θ)⁵.
fn schlick(cos: f32) -> f32 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

impl Principled {
    /// The material with its bounds tabulated.
    pub fn new(given: Parameters) -> Self {
        // At 1 there would be no interface to bend light.
        let given = Parameters { eta: given.eta.max(1.001), ..given };
        let bounds = Arc::new(Bounds::new(&given));
        Self { given, bounds }
    }

    /// Whether it transmits light.
    pub fn is_clear(&self) -> bool {
        self.given.spec_trans > 0.0
    }

    fn at(&self, uv: Vec2) -> Point {
        let base = self.given.base_color.eval(uv);
        let roughness = self.given.roughness.value(uv).clamp(0.0, 1.0);
        let metallic = self.given.metallic.value(uv).clamp(0.0, 1.0);
        let luminance = luminance(base);
        Point {
            base,
            hue: if luminance > 0.0 { base / luminance } else { Vec3::ONE },
            roughness,
            metallic,
            opaque: (1.0 - metallic) * (1.0 - self.given.spec_trans),
            clear: (1.0 - metallic) * self.given.spec_trans,
            facets: Microfacets { shape: Shape::Ggx, alpha: (roughness * roughness).max(LEAST_ALPHA) },
        }
    }

    /// Refractive index behind the surface over the one in front.
    pub fn eta(&self) -> f32 {
        self.given.eta
    }

    /// Reflectance of a facet seen under `cos` from the front: metal by Schlick, dielectric by Fresnel, its tinted part by Schlick.
    fn reflection(&self, p: &Point, cos: f32) -> Vec3 {
        let weight = schlick(cos);
        let approximate = |normal: Vec3| normal + (Vec3::ONE - normal) * weight;
        let tint = self.given.spec_tint;
        let exact = fresnel::dielectric(cos.clamp(0.0, 1.0), self.given.eta).0;
        let mut sum = Vec3::splat((1.0 - p.metallic) * (1.0 - tint) * exact) + p.metallic * approximate(p.base);
        if tint > 0.0 {
            let normal = ((self.given.eta - 1.0) / (self.given.eta + 1.0)).powi(2);
            sum += (1.0 - p.metallic) * tint * approximate(p.hue * normal);
        }
        sum
    }

    /// Reflectance and transmittance of a facet seen under the cosine `cos`.
    fn facet(&self, p: &Point, cos: f32, front: bool) -> [Vec3; 2] {
        let eta = if front { self.given.eta } else { 1.0 / self.given.eta };
        let exact = fresnel::dielectric(cos.clamp(0.0, 1.0), eta).0;
        let through = p.base.max(Vec3::ZERO).map(f32::sqrt) * (p.clear * (1.0 - exact));
        // From behind there is neither tint nor metal.
        [if front { self.reflection(p, cos) } else { Vec3::splat(p.clear * exact) }, through]
    }

    /// Factor that keeps the albedo at both directions from exceeding 1. A direction behind the surface has no bound.
    fn bound(&self, p: &Point, wo: Vec3, wi: Vec3) -> f32 {
        let albedo = |w: Vec3| if w.z > 0.0 { self.bounds.albedo(&self.given, p, w.z) } else { 1.0 };
        1.0 / albedo(wo).max(albedo(wi)).max(1.0)
    }

    /// f·|cos θᵢ|, for radiance.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z == 0.0 || wi.z == 0.0 || (wo.z < 0.0 && !self.is_clear()) {
            return Vec3::ZERO;
        }
        let p = self.at(uv);
        let value = if wo.z * wi.z < 0.0 {
            self.refracted(&p, wo, wi)
        } else {
            let Some(h) = (wo + wi).try_normalize() else { return Vec3::ZERO };
            let mut sum = self.reflected(&p, wo, wi, h);
            if wo.z > 0.0 {
                let base =
                    p.base * (p.opaque * wi.z * FRAC_1_PI * diffuse(p.roughness, self.given.flatness, wo, wi, h));
                sum += base + self.sheen(&p, wi, h) + self.coat(wo, wi, h);
            }
            sum
        };
        value * self.bound(&p, wo, wi)
    }

    /// The facets' reflection. `h` is on the side of both directions.
    fn reflected(&self, p: &Point, wo: Vec3, wi: Vec3, h: Vec3) -> Vec3 {
        let front = if h.z < 0.0 { -h } else { h };
        let cos = wo.dot(h);
        let facets = p.facets.density(front) * p.facets.shadowing(wo, front) * p.facets.shadowing(wi, front)
            / (4.0 * wo.z.abs());
        if cos <= 0.0 || facets == 0.0 { Vec3::ZERO } else { self.facet(p, cos, wo.z > 0.0)[0] * facets }
    }

    /// The facets' refraction (Walter et al. 2007, eq. 21).
    fn refracted(&self, p: &Point, wo: Vec3, wi: Vec3) -> Vec3 {
        let Some(g) = Geometry::new(wo, wi, self.given.eta) else { return Vec3::ZERO };
        let shadowing = p.facets.shadowing(g.wo, g.h) * p.facets.shadowing(g.wi, g.h);
        let facets = p.facets.density(g.h) * shadowing / g.wo.z;
        self.facet(p, g.cos_o, wo.z > 0.0)[1] * (facets * g.cos_o * g.jacobian() / (g.eta * g.eta))
    }

    fn sheen(&self, p: &Point, wi: Vec3, h: Vec3) -> Vec3 {
        if self.given.sheen == 0.0 {
            return Vec3::ZERO;
        }
        let color = Vec3::ONE.lerp(p.hue, self.given.sheen_tint);
        color * (self.given.sheen * (1.0 - p.metallic) * schlick(wi.dot(h)) * wi.z)
    }

    fn coat(&self, wo: Vec3, wi: Vec3, h: Vec3) -> Vec3 {
        if self.given.clearcoat == 0.0 {
            return Vec3::ZERO;
        }
        Vec3::splat(self.given.clearcoat * coat(self.coat_alpha(), wo, wi, h) * wi.z)
    }

    /// α of the coat (Burley 2012, §5.6).
    fn coat_alpha(&self) -> f32 {
        0.1 + (0.001 - 0.1) * self.given.clearcoat_gloss
    }

    /// Probabilities of the lobes, about proportional to their reflectances.
    fn lobes(&self, p: &Point, wo: Vec3) -> Lobes {
        if wo.z <= 0.0 {
            return Lobes { facets: 1.0, coat: 0.0 };
        }
        let [reflected, through] = self.facet(p, wo.z, true).map(channel_mean);
        let diffuse = p.opaque * channel_mean(p.base) + 0.25 * self.given.sheen * (1.0 - p.metallic);
        let coat = self.given.clearcoat * 0.25 * (COAT_REFLECTION + schlick(wo.z));
        let sum = reflected + through + diffuse + coat;
        Lobes { facets: (reflected + through) / sum, coat: coat / sum }
    }

    /// Probabilities that a chosen facet reflects and that it refracts: each by itself, since either may be next to nothing.
    fn splits(&self, p: &Point, cos: f32, front: bool) -> [f32; 2] {
        let parts = self.facet(p, cos, front).map(channel_mean);
        if parts[1] == 0.0 { [1.0, 0.0] } else { parts.map(|part| part / (parts[0] + parts[1])) }
    }

    /// Density of [`Principled::sample`] w.r.t. solid angle.
    pub fn pdf(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 || (wo.z < 0.0 && !self.is_clear()) {
            return 0.0;
        }
        self.density(&self.at(uv), wo, wi)
    }

    fn density(&self, p: &Point, wo: Vec3, wi: Vec3) -> f32 {
        let (lobes, front) = (self.lobes(p, wo), wo.z > 0.0);
        if wo.z * wi.z < 0.0 {
            let Some(g) = Geometry::new(wo, wi, self.given.eta) else { return 0.0 };
            let [_, refracts] = self.splits(p, g.cos_o, front);
            return lobes.facets * refracts * p.facets.visible_density(g.wo, g.h) * g.jacobian();
        }
        let Some(h) = (wo + wi).try_normalize() else { return 0.0 };
        let cos = wo.dot(h);
        let (wo, h) = if front { (wo, h) } else { (-wo, -h) };
        let mut sum = lobes.facets * self.splits(p, cos, front)[0] * p.facets.visible_density(wo, h) / (4.0 * cos);
        if front {
            sum += (1.0 - lobes.facets - lobes.coat).max(0.0) * warp::square_to_cosine_hemisphere_pdf(wi);
            if lobes.coat > 0.0 {
                sum += lobes.coat * gtr1(self.coat_alpha(), h) * h.z / (4.0 * cos);
            }
        }
        if sum.is_finite() { sum } else { 0.0 }
    }

    /// Chooses a lobe with `choice` and a direction of it with `u`.
    pub fn sample(&self, uv: Vec2, wo: Vec3, u: [f32; 2], choice: f32, transport: Transport) -> Option<BsdfSample> {
        if wo.z == 0.0 || (wo.z < 0.0 && !self.is_clear()) {
            return None;
        }
        let p = self.at(uv);
        let lobes = self.lobes(&p, wo);
        let wi = if choice < lobes.facets {
            self.sample_facet(&p, wo, u, choice / lobes.facets)?
        } else if choice < lobes.facets + lobes.coat {
            let h = sample_gtr1(self.coat_alpha(), u);
            h * (2.0 * wo.dot(h)) - wo
        } else {
            warp::square_to_cosine_hemisphere(u)
        };
        let refracts = wi.z * wo.z < 0.0;
        if refracts && choice >= lobes.facets {
            return None;
        }
        let pdf = self.density(&p, wo, wi);
        let eta = if wo.z > 0.0 { self.given.eta } else { 1.0 / self.given.eta };
        // Power is not squeezed into a smaller solid angle as radiance is.
        let scale = if refracts && transport == Transport::Importance { eta * eta } else { 1.0 };
        let weight = self.eval(uv, wo, wi) / pdf * scale;
        (pdf > 0.0 && weight.is_finite()).then_some(BsdfSample { wi, weight, pdf, delta: false })
    }

    /// Reflects or refracts at a visible facet; none where another facet would block the light.
    fn sample_facet(&self, p: &Point, wo: Vec3, u: [f32; 2], choice: f32) -> Option<Vec3> {
        let (side, eta) = if wo.z > 0.0 { (1.0, self.given.eta) } else { (-1.0, 1.0 / self.given.eta) };
        let wo = wo * side;
        let h = p.facets.sample_visible(wo, u);
        let cos = wo.dot(h);
        let reflects = choice < self.splits(p, cos, side > 0.0)[0];
        let wi = if reflects {
            h * (2.0 * cos) - wo
        } else {
            h * (cos / eta - fresnel::dielectric(cos.clamp(0.0, 1.0), eta).1) - wo / eta
        };
        ((wi.z > 0.0) == reflects && wi.z != 0.0).then(|| wi.normalize() * side)
    }

    /// Reflectance for pictures of the albedo.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        let p = self.at(uv);
        (p.base * p.opaque + self.reflection(&p, 1.0) + Vec3::splat(p.clear)).min(Vec3::ONE)
    }
}

/// π·f of a white base: Burley 2012, §5.3 in the form of Burley 2015, eq. 4, or flattened (§2.3 there).
fn diffuse(roughness: f32, flatness: f32, wo: Vec3, wi: Vec3, h: Vec3) -> f32 {
    let (fo, fi) = (schlick(wo.z), schlick(wi.z));
    let cos_d = wi.dot(h);
    let retro = 2.0 * roughness * cos_d * cos_d;
    let plain = (1.0 - 0.5 * fo) * (1.0 - 0.5 * fi) + retro * (fo + fi + fo * fi * (retro - 1.0));
    if flatness == 0.0 {
        return plain;
    }
    let at_grazing = retro / 2.0;
    let ss = (1.0 + (at_grazing - 1.0) * fo) * (1.0 + (at_grazing - 1.0) * fi);
    let flat = 1.25 * (ss * (1.0 / (wo.z + wi.z) - 0.5) + 0.5);
    plain + (flat - plain) * flatness
}

/// f of a coat of full strength (Burley 2012, §5.6): a quarter of F·D·G with the generalised Trowbridge-Reitz distribution γ = 1.
fn coat(alpha: f32, wo: Vec3, wi: Vec3, h: Vec3) -> f32 {
    let facets = Microfacets { shape: Shape::Ggx, alpha: COAT_SHADOWING };
    let fresnel = COAT_REFLECTION + (1.0 - COAT_REFLECTION) * schlick(wo.dot(h));
    0.25 * fresnel * gtr1(alpha, h) * facets.shadowing(wo, h) * facets.shadowing(wi, h)
}

/// Density of facet normals, sr⁻¹ (Burley 2012, eq. 4).
fn gtr1(alpha: f32, h: Vec3) -> f32 {
    let a2 = alpha * alpha;
    // 1 − (1 − α²)·cos², written so that it keeps its digits near the normal.
    let spread = (h.x * h.x + h.y * h.y) + a2 * h.z * h.z;
    if h.z <= 0.0 { 0.0 } else { (a2 - 1.0) / (PI * ln(a2) * spread) }
}

/// A facet normal with density D·cos θ.
fn sample_gtr1(alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    let a2 = alpha * alpha;
    let cos2 = ((1.0 - pow(a2, 1.0 - u)) / (1.0 - a2)).clamp(0.0, 1.0);
    let (sin, cos) = ((1.0 - cos2).sqrt(), cos2.sqrt());
    let (sin_phi, cos_phi) = sin_cos(TAU * v);
    Vec3::new(sin * cos_phi, sin * sin_phi, cos)
}

/// Numbers of cosines (closer to one another at grazing angles) and roughnesses at which albedos are tabulated, both from 0 to 1.
const COSINES: usize = 24;
const ROUGHNESSES: usize = 8;
/// Points along each axis of the quadratures.
const POINTS: usize = 24;

/// Albedos of the lobes by cosine, and by roughness where that matters.
#[derive(Debug)]
struct Bounds {
    diffuse: [[f32; COSINES]; ROUGHNESSES],
    specular: [[f32; COSINES]; ROUGHNESSES],
    sheen: [f32; COSINES],
    coat: [f32; COSINES],
}

impl Bounds {
    fn new(given: &Parameters) -> Self {
        let direction = |i: usize| {
            let cos = (i as f32 / (COSINES - 1) as f32).powi(2).max(1e-3);
            Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
        };
        let rough = |i: usize| i as f32 / (ROUGHNESSES - 1) as f32;
        // Where the roughness does not vary, only the rows around it are asked for.
        let asked = |i: usize| match &given.roughness {
            Texture::Constant(value) => {
                (luminance(*value).clamp(0.0, 1.0) - rough(i)).abs() * ((ROUGHNESSES - 1) as f32) < 1.01
            }
            _ => true,
        };
        let half = |wo: Vec3, wi: Vec3| (wo + wi).normalize_or(Vec3::Z);
        let over_cosines = |f: &dyn Fn(Vec3, Vec3) -> f32, wo: Vec3| {
            mean(|u| {
                let wi = warp::square_to_cosine_hemisphere(u);
                f(wo, wi) * f32::from(u8::from(wi.z > 0.0))
            })
        };
        let base = |r: usize, wo: Vec3| {
            let white = |wo: Vec3, wi: Vec3| diffuse(rough(r), given.flatness, wo, wi, half(wo, wi));
            over_cosines(&white, wo)
        };
        let specular = |r: usize, wo: Vec3| {
            let facets = Microfacets { shape: Shape::Ggx, alpha: (rough(r) * rough(r)).max(LEAST_ALPHA) };
            mean(|u| {
                let h = facets.sample_visible(wo, u);
                let wi = h * (2.0 * wo.dot(h)) - wo;
                fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), given.eta).0
                    * if wi.z > 0.0 { facets.shadowing(wi, h) } else { 0.0 }
            })
        };
        let sheen = |wo: Vec3| over_cosines(&|wo, wi| PI * schlick(wi.dot(half(wo, wi))), wo);
        let alpha = 0.1 + (0.001 - 0.1) * given.clearcoat_gloss;
        let glossy = |wo: Vec3| {
            mean(|u| {
                let h = sample_gtr1(alpha, u);
                let wi = h * (2.0 * wo.dot(h)) - wo;
                let density = gtr1(alpha, h) * h.z / (4.0 * wo.dot(h));
                if wi.z > 0.0 && density > 0.0 { coat(alpha, wo, wi, h) * wi.z / density } else { 0.0 }
            })
        };
        let row = |f: &dyn Fn(Vec3) -> f32| std::array::from_fn(|i| f(direction(i)));
        Self {
            diffuse: std::array::from_fn(|r| row(&|wo| if asked(r) { base(r, wo) } else { 0.0 })),
            specular: std::array::from_fn(|r| row(&|wo| if asked(r) { specular(r, wo) } else { 0.0 })),
            sheen: row(&sheen),
            coat: row(&glossy),
        }
    }

    /// Upper bound of the material's albedo at an angle with cosine `cos`.
    fn albedo(&self, given: &Parameters, p: &Point, cos: f32) -> f32 {
        let column = |row: &[f32; COSINES]| between(cos.sqrt() * (COSINES - 1) as f32, row.len(), |i| row[i]);
        let table = |rows: &[[f32; COSINES]; ROUGHNESSES]| {
            between(p.roughness * (ROUGHNESSES - 1) as f32, rows.len(), |i| column(&rows[i]))
        };
        let brightest = p.base.max_element();
        let specular = table(&self.specular);
        let tinted = specular * (1.0 + given.spec_tint * (p.hue.max_element() - 1.0).max(0.0));
        // A metal reflects at most everything.
        let mut sum = p.metallic + (1.0 - p.metallic) * tinted.min(1.0);
        sum += p.opaque * brightest * table(&self.diffuse) + p.clear * (1.0 - specular) * brightest.max(0.0).sqrt();
        if given.sheen > 0.0 {
            let hue = 1.0 + (p.hue.max_element() - 1.0).max(0.0) * given.sheen_tint;
            sum += given.sheen * (1.0 - p.metallic) * hue * column(&self.sheen);
        }
        if given.clearcoat > 0.0 {
            sum += given.clearcoat * column(&self.coat);
        }
        sum
    }
}

/// The mean over the unit square.
fn mean(f: impl Fn([f32; 2]) -> f32) -> f32 {
    let at = |k: usize| (k as f32 + 0.5) / POINTS as f32;
    let sum: f32 = (0..POINTS * POINTS).map(|i| f([at(i % POINTS), at(i / POINTS)])).sum();
    sum / (POINTS * POINTS) as f32
}

/// Linear interpolation between the `count` values of `at`.
fn between(position: f32, count: usize, at: impl Fn(usize) -> f32) -> f32 {
    let below = (position.max(0.0) as usize).min(count - 2);
    let [a, b] = [at(below), at(below + 1)];
    a + (b - a) * (position - below as f32)
}
