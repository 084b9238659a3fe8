//! Slow twins of materials and phase functions in double precision, written from the formulas of the literature without a look at how
//! the program arranges them: relative errors of at most 1e-4 over 100,000 inputs and more of each, most of them at the edge of
//! what can come up. Where a larger error is inherent, its bound is stated beside the test.

#[path = "support/twins.rs"]
#[allow(dead_code, reason = "shared with the other twins")]
mod twins;

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::materials::diffuse::Diffuse;
use fanal::materials::fresnel::Metal;
use fanal::materials::microfacet::{Microfacets, SMOOTH, Shape};
use fanal::materials::phase::{HenyeyGreenstein, SHARPEST};
use fanal::materials::plastic::Plastic;
use fanal::materials::principled::{Parameters, Principled};
use fanal::materials::rough_conductor::RoughConductor;
use fanal::materials::rough_dielectric::{LEAST_STEP, RoughDielectric};
use fanal::materials::texture::Texture;
use fanal::materials::{Kind, Material, Transport};
use glam::{DVec3, Vec2, Vec3};
use twins::{Facets, INPUTS, Worst, decades, erf64, in_front};

/// Reflected share and the cosine behind, by Fresnel's equations.
fn dielectric(cos: f64, eta: f64) -> (f64, f64) {
    let sin2 = (1.0 - cos * cos) / (eta * eta);
    if sin2 >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2).sqrt();
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    (0.5 * (s * s + p * p), cos_t)
}

/// By the complex index: |r_s|² and |r_p|² with (η + ik)² − sin² under the root.
fn conductor(cos: f64, eta: f64, k: f64) -> f64 {
    let sin2 = 1.0 - cos * cos;
    let (re, im) = (eta * eta - k * k - sin2, 2.0 * eta * k);
    let length = re.hypot(im);
    let (a, b) = ((0.5 * (length + re)).max(0.0).sqrt(), (0.5 * (length - re)).max(0.0).sqrt());
    let s = ((a - cos).powi(2) + b * b) / ((a + cos).powi(2) + b * b);
    let t = sin2 / cos;
    s * 0.5 * (1.0 + ((a - t).powi(2) + b * b) / ((a + t).powi(2) + b * b))
}

fn both_shapes(mut check: impl FnMut(Shape, &mut Random)) {
    for shape in [Shape::Beckmann, Shape::Ggx] {
        check(shape, &mut Random::new(7, shape as u64, 0));
    }
}

/// Half of the directions drawn by the material, so that narrow lobes are met, half anywhere.
fn pair(material: &Material, wo: Vec3, random: &mut Random, any: impl Fn(&mut Random) -> Vec3) -> Option<Vec3> {
    if random.below(2) == 0 {
        return material.sample(Vec2::ZERO, wo, random, Transport::Radiance).map(|sample| sample.wi);
    }
    Some(any(random))
}

#[test]
fn rough_metal() {
    both_shapes(|shape, random| {
        let (mut values, mut pdfs) =
            (Worst::new(format!("{shape:?} metal value")), Worst::new(format!("{shape:?} metal pdf")));
        for _ in 0..6 * INPUTS {
            let alpha = decades(random, SMOOTH, 1.0);
            let (eta, k) = (random.range(0.1, 4.0), random.range(0.5, 8.0));
            let reflectance = Texture::Constant(Vec3::ONE);
            let metal = Metal { eta: Vec3::splat(eta), k: Vec3::splat(k), reflectance };
            let material: Material =
                Kind::RoughConductor(RoughConductor { metal, facets: Microfacets { shape, alpha } }).into();
            let wo = in_front(random);
            let Some(wi) = pair(&material, wo, random, in_front) else { continue };
            let facets = Facets { shape, alpha: f64::from(alpha) };
            let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
            let h = (o + i).normalize();
            let reflected = conductor(o.dot(h), f64::from(eta), f64::from(k));
            let g = facets.shadowing(o, h) * facets.shadowing(i, h);
            let at = || format!("α {alpha:e}, {wo} {wi}, η {eta} {k}");
            let value = reflected * facets.density(h) * g / (4.0 * o.z);
            values.compare(material.eval(Vec2::ZERO, wo, wi).x, value, 0.0, at);
            let pdf = facets.visible_density(o, h) / (4.0 * o.dot(h));
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, 0.0, at);
        }
        values.check(INPUTS);
        pdfs.check(INPUTS);
    });
}

/// Value and density of rough glass by Walter et al. 2007, eq. 20, 21 and 14, 17; and how near to total reflection it is, as the
/// cosine of the angle behind.
fn glass(facets: &Facets, eta: f64, o: DVec3, i: DVec3) -> (f64, f64, f64) {
    // Seen from behind, the surface is turned around and the indices are exchanged.
    let (o, i, [n_o, n_i]) = if o.z > 0.0 { (o, i, [1.0, eta]) } else { (-o, -i, [eta, 1.0]) };
    let refracts = i.z < 0.0;
    let half = if refracts { -(n_o * o + n_i * i) } else { o + i };
    let h = half.normalize() * half.z.signum();
    let (cos_o, cos_i) = (o.dot(h), i.dot(h));
    if cos_o <= 0.0 || cos_i * i.z <= 0.0 {
        return (0.0, 0.0, 1.0);
    }
    let (reflected, behind) = dielectric(cos_o, n_i / n_o);
    let g = facets.shadowing(o, h) * facets.shadowing(i, h);
    let (d, visible) = (facets.density(h), facets.visible_density(o, h));
    if !refracts {
        return (reflected * d * g / (4.0 * o.z), reflected * visible / (4.0 * cos_o), behind);
    }
    let jacobian = n_i * n_i * cos_i.abs() / (n_o * cos_o + n_i * cos_i).powi(2);
    // Eq. 21 has the squared index on the side where light leaves, the Jacobian that on the side where it comes from.
    let value = cos_o * (1.0 - reflected) * d * g / o.z * jacobian * (n_o / n_i).powi(2);
    (value, visible * (1.0 - reflected) * jacobian, behind)
}

/// Inherent: what passes goes with the cosine behind, √(1 − sin²), which near total reflection has the rounding of its argument,
/// some 2e-7, over its square; what is reflected there goes with that cosine over the one in front. And for an index near 1, what is reflected goes with the square of the difference from 1, which
/// cosines rounded to singles know to 4e-7 over that difference.
#[test]
fn rough_glass() {
    both_shapes(|shape, random| {
        let (mut values, mut pdfs) =
            (Worst::new(format!("{shape:?} glass value")), Worst::new(format!("{shape:?} glass pdf")));
        for _ in 0..8 * INPUTS {
            let alpha = decades(random, SMOOTH, 1.0);
            let eta = match random.below(4) {
                0 => 1.0 + decades(random, LEAST_STEP, 1.0),
                1 => 1.0 / (1.0 + decades(random, 1.001 * LEAST_STEP, 1.0)),
                _ => 1.5,
            };
            let material: Material =
                Kind::RoughDielectric(RoughDielectric { eta, facets: Microfacets { shape, alpha } }).into();
            let side = |random: &mut Random| if random.below(2) == 0 { 1.0f32 } else { -1.0 };
            let wo = side(random) * in_front(random);
            let Some(wi) = pair(&material, wo, random, |random| side(random) * in_front(random)) else { continue };
            let facets = Facets { shape, alpha: f64::from(alpha) };
            let (value, pdf, behind) = glass(&facets, f64::from(eta), wo.as_dvec3(), wi.as_dvec3());
            let refracts = wo.z * wi.z < 0.0;
            let facing = wo.dot((wo + wi).normalize_or(wo)).abs();
            let inherent = if refracts {
                2e-7 / (behind * behind)
            } else {
                4e-7 / f64::from((eta - 1.0).abs()) + 4e-7 / (behind * f64::from(facing)).max(1e-7)
            };
            let at = || format!("α {alpha:e}, η {eta}, {wo} {wi}, behind {behind}");
            values.compare(material.eval(Vec2::ZERO, wo, wi).x, value, inherent, at);
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, inherent, at);
        }
        values.check(INPUTS);
        pdfs.check(INPUTS);
    });
}

/// Smooth plastic: Fresnel on the way in and out, the base between, what the coat throws back by ∫ of Fresnel.
#[test]
fn diffuse_and_smooth_plastic() {
    let [base, eta] = [0.6f32, 1.5];
    let (mut values, mut pdfs, mut diffuse) =
        (Worst::new("plastic value"), Worst::new("plastic pdf"), Worst::new("diffuse value"));
    let constant = |value: f32| Texture::Constant(Vec3::splat(value));
    let material: Material = Kind::Plastic(Plastic::new(constant(base), constant(1.0), eta, true, None)).into();
    let chalk: Material = Kind::Diffuse(Diffuse { reflectance: constant(base) }).into();
    let (base, eta) = (f64::from(base), f64::from(eta));
    let steps = 1_000_000;
    let inside = |i: i32| {
        let cos = (f64::from(i) + 0.5) / f64::from(steps);
        2.0 * cos * dielectric(cos, 1.0 / eta).0 / f64::from(steps)
    };
    let internal: f64 = (0..steps).map(inside).sum();
    let mut random = Random::new(9, 0, 0);
    for _ in 0..INPUTS {
        let (wo, wi) = (in_front(&mut random), in_front(&mut random));
        let [passed_o, passed_i] = [wo, wi].map(|w| 1.0 - dielectric(f64::from(w.z), eta).0);
        let cos = f64::from(wi.z);
        let value = base * passed_o * passed_i / (PI * eta * eta * (1.0 - base * internal)) * cos;
        let at = || format!("{wo} {wi}");
        values.compare(material.eval(Vec2::ZERO, wo, wi).x, value, 0.0, at);
        // The coat is sampled by what it reflects, the base by what gets in, times their albedos.
        let coat = (1.0 - passed_o) * 1.0 / (1.0 + base);
        let of_base = passed_o * base / (1.0 + base);
        pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), of_base / (coat + of_base) * cos / PI, 0.0, at);
        diffuse.compare(chalk.eval(Vec2::ZERO, wo, wi).x, base * cos / PI, 0.0, at);
    }
    values.check(INPUTS);
    pdfs.check(INPUTS);
    diffuse.check(INPUTS);
}

/// A rough coat (Walter et al. 2007 over a diffuse base): what passes is the mean over 32 × 32 visible normals, given at 64 cosines
/// and linear between them, as the program and Mitsuba have it.
struct Coat {
    facets: Facets,
    eta: f64,
    passes: Vec<f64>,
    internal: f64,
}

impl Coat {
    fn new(facets: Facets, eta: f64) -> Self {
        let cosine = |i: usize| i as f64 / 63.0;
        let passes = (0..64).map(|i| hemispheric(&facets, cosine(i), eta, false)).collect();
        let weighted = |i: usize| hemispheric(&facets, cosine(i), 1.0 / eta, true) * cosine(i);
        let internal = (0..64).map(weighted).sum::<f64>() / 32.0;
        Self { facets, eta, passes, internal }
    }

    fn passed(&self, cos: f64) -> f64 {
        let below = (cos * 63.0).floor().min(62.0);
        let [a, b] = [0, 1].map(|i| self.passes[below as usize + i]);
        a + (b - a) * (cos * 63.0 - below)
    }
}

/// The part of the light under an angle that is reflected, or passes, and is not hidden by other facets where it goes.
fn hemispheric(facets: &Facets, cos: f64, eta: f64, reflects: bool) -> f64 {
    let cos = cos.max(1e-4);
    let w = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let mut sum = 0.0;
    for h in visible_normals(facets, w) {
        let cos = w.dot(h).clamp(0.0, 1.0);
        let (reflected, behind) = dielectric(cos, eta);
        let out = if reflects { h * (2.0 * cos) - w } else { h * (cos / eta - behind) - w / eta };
        if (out.z > 0.0) == reflects {
            let part = if reflects { reflected } else { 1.0 - reflected };
            sum += part * facets.shadowing(out, h);
        }
    }
    sum / 1024.0
}

/// The normals that `w`, in the plane of x and z, sees at the middles of a grid of 32 × 32: by Heitz 2018 for GGX, and by the inverse
/// of the distribution of slopes (Heitz and d'Eon 2014), found by halving, for Beckmann.
fn visible_normals(facets: &Facets, w: DVec3) -> Vec<DVec3> {
    let stretched = DVec3::new(facets.alpha * w.x, 0.0, w.z).normalize();
    let middles: Vec<f64> = (0..32).map(|i| (f64::from(i) + 0.5) / 32.0).collect();
    let normal = |x: f64, y: f64, z: f64| DVec3::new(facets.alpha * x, facets.alpha * y, z).normalize();
    let pairs = |f: &dyn Fn(usize, usize) -> DVec3| (0..1024).map(|i| f(i % 32, i / 32)).collect();
    match facets.shape {
        Shape::Ggx => pairs(&|i, j| {
            let (across, up) = (DVec3::Y, stretched.cross(DVec3::Y));
            let (radius, angle) = (middles[i].sqrt(), 2.0 * PI * middles[j]);
            let (a, b) = (radius * angle.cos(), radius * angle.sin());
            let lift = 0.5 * (1.0 + stretched.z);
            let b = (1.0 - lift) * (1.0 - a * a).sqrt() + lift * b;
            let n = a * across + b * up + (1.0 - a * a - b * b).max(0.0).sqrt() * stretched;
            normal(n.x, n.y, n.z.max(0.0))
        }),
        // Seen from above, slopes have no direction; as the paper's supplement has it.
        Shape::Beckmann if stretched.z > 0.9999 => pairs(&|i, j| {
            let (radius, angle) = ((-(1.0 - middles[i]).ln()).sqrt(), 2.0 * PI * middles[j]);
            normal(-radius * angle.cos(), -radius * angle.sin(), 1.0)
        }),
        Shape::Beckmann => {
            let tan = stretched.x / stretched.z;
            // ∫ (1 − t·tan)·exp(−t²)/√π up to s; slopes beyond the cotangent face away.
            let below = |s: f64| 0.5 * (1.0 + erf64(s)) + 0.5 * tan / PI.sqrt() * (-s * s).exp();
            let halved = |f: &dyn Fn(f64) -> f64, value: f64, most: f64| {
                let (mut low, mut high) = (-6.0, most);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    *(if f(middle) < value { &mut low } else { &mut high }) = middle;
                }
                0.5 * (low + high)
            };
            let most = (1.0 / tan).min(6.0);
            let along: Vec<f64> = middles.iter().map(|u| halved(&below, u * below(most), most)).collect();
            let across: Vec<f64> = middles.iter().map(|v| halved(&erf64, 2.0 * v - 1.0, 6.0)).collect();
            pairs(&|i, j| normal(-along[i], -across[j], 1.0))
        }
    }
}

/// The coat and the base of rough plastic, and how often each is sampled. Inherent: what the coat reflects on the whole is 1 less what
/// passes, a single near 1, in whose last digit and a half of one more it is known.
#[test]
fn rough_plastic() {
    both_shapes(|shape, random| {
        let (mut values, mut pdfs) =
            (Worst::new(format!("{shape:?} plastic value")), Worst::new(format!("{shape:?} plastic pdf")));
        for i in 0..20 {
            let (alpha, eta) = (decades(random, 0.01, 1.0), random.range(1.2, 2.2));
            let [base, reflectance] = [random.range(0.05, 1.0), random.range(0.05, 1.0)];
            let nonlinear = i % 2 == 0;
            let constant = |value: f32| Texture::Constant(Vec3::splat(value));
            let facets = Microfacets { shape, alpha };
            let plastic = Plastic::new(constant(base), constant(reflectance), eta, nonlinear, Some(facets));
            let material: Material = Kind::Plastic(plastic).into();
            let coat = Coat::new(Facets { shape, alpha: f64::from(alpha) }, f64::from(eta));
            let (base, reflectance) = (f64::from(base), f64::from(reflectance));
            let scattered = base / (1.0 - if nonlinear { base } else { 1.0 } * coat.internal);
            for _ in 0..INPUTS / 10 {
                let wo = in_front(random);
                let Some(wi) = pair(&material, wo, random, in_front) else { continue };
                let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
                let h = (o + i).normalize();
                let cos = o.dot(h);
                let [passed_o, passed_i] = [o.z, i.z].map(|cos| coat.passed(cos));
                let facets = &coat.facets;
                let g = facets.shadowing(o, h) * facets.shadowing(i, h);
                let of_coat = reflectance * dielectric(cos, coat.eta).0 * facets.density(h) * g / (4.0 * o.z);
                let of_base = scattered * passed_o * passed_i / (coat.eta * coat.eta) * i.z / PI;
                let at = || format!("α {alpha:e}, η {eta}, base {base}, {reflectance}, {wo} {wi}");
                values.compare(material.eval(Vec2::ZERO, wo, wi).x, of_coat + of_base, 0.0, at);
                // By what is reflected and what passes, times the part that is not absorbed.
                let [coat, base] = [(1.0 - passed_o) * reflectance, passed_o * base];
                let visible = facets.visible_density(o, h) / (4.0 * cos);
                let pdf = (coat * visible + base * i.z / PI) / (coat + base);
                pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, 1.5e-7 / (1.0 - passed_o), at);
            }
        }
        values.check(INPUTS);
        pdfs.check(INPUTS);
    });
}

/// The numbers of a principled material.
struct Painted {
    base: DVec3,
    roughness: f64,
    metallic: f64,
    eta: f64,
    spec_tint: f64,
    sheen: f64,
    sheen_tint: f64,
    clearcoat: f64,
    gloss: f64,
    flatness: f64,
    spec_trans: f64,
}

/// What is compared of one pair of directions: f·cos, the density, and how near to total reflection it is.
struct Seen {
    value: DVec3,
    pdf: f64,
    behind: f64,
    /// Part that facets let through.
    passed: f64,
}

fn fifth(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

impl Painted {
    fn facets(&self) -> Facets {
        Facets { shape: Shape::Ggx, alpha: (self.roughness * self.roughness).max(1e-3) }
    }

    fn hue(&self) -> DVec3 {
        let luminance = self.base.dot(DVec3::new(0.212671, 0.715160, 0.072169));
        if luminance > 0.0 { self.base / luminance } else { DVec3::ONE }
    }

    /// What a facet reflects and what it lets through: exact for the dielectric, by Schlick for metal and tint.
    fn facet(&self, cos: f64, front: bool) -> [DVec3; 2] {
        let exact = dielectric(cos, if front { self.eta } else { 1.0 / self.eta }).0;
        let clear = (1.0 - self.metallic) * self.spec_trans;
        let through = DVec3::from_array(self.base.to_array().map(f64::sqrt)) * clear * (1.0 - exact);
        if !front {
            return [DVec3::splat(clear * exact), through];
        }
        let schlick = |normal: DVec3| normal + (DVec3::ONE - normal) * fifth(cos);
        let normal = ((self.eta - 1.0) / (self.eta + 1.0)).powi(2);
        let dielectric = (1.0 - self.spec_tint) * exact + self.spec_tint * schlick(self.hue() * normal);
        [(1.0 - self.metallic) * dielectric + self.metallic * schlick(self.base), through]
    }

    /// Burley 2012, eq. 4.
    fn coat_density(&self, h: DVec3) -> f64 {
        let a2 = (0.1 + (0.001 - 0.1) * self.gloss).powi(2);
        (a2 - 1.0) / (PI * a2.ln() * (1.0 + (a2 - 1.0) * h.z * h.z))
    }

    /// Everything above the facets: Burley 2012, §5.3 to 5.6, Burley 2015, eq. 4 and §2.3.
    fn above(&self, o: DVec3, i: DVec3, h: DVec3) -> DVec3 {
        let (cos, opaque) = (i.dot(h), (1.0 - self.metallic) * (1.0 - self.spec_trans));
        let [fo, fi] = [o.z, i.z].map(fifth);
        let retro = 2.0 * self.roughness * cos * cos;
        let lambert = (1.0 - fo / 2.0) * (1.0 - fi / 2.0) + retro * (fo + fi + fo * fi * (retro - 1.0));
        let fss90 = self.roughness * cos * cos;
        let fss = (1.0 + (fss90 - 1.0) * fo) * (1.0 + (fss90 - 1.0) * fi);
        let flat = 1.25 * (fss * (1.0 / (o.z + i.z) - 0.5) + 0.5);
        let base = self.base * (opaque / PI * ((1.0 - self.flatness) * lambert + self.flatness * flat));
        let tint = DVec3::ONE * (1.0 - self.sheen_tint) + self.hue() * self.sheen_tint;
        let sheen = tint * (self.sheen * (1.0 - self.metallic) * fifth(cos));
        let smith = Facets { shape: Shape::Ggx, alpha: 0.25 };
        let shadowing = smith.visible(o, h) * smith.visible(i, h);
        let coat = 0.25 * self.clearcoat * (0.04 + 0.96 * fifth(cos)) * self.coat_density(h) * shadowing;
        (base + sheen + DVec3::splat(coat)) * i.z
    }

    /// Before anything is bounded.
    fn seen(&self, o: DVec3, i: DVec3) -> Seen {
        let front = o.z > 0.0;
        let (o, i, [n_o, n_i]) = if front { (o, i, [1.0, self.eta]) } else { (-o, -i, [self.eta, 1.0]) };
        let refracts = i.z < 0.0;
        let half = if refracts { -(n_o * o + n_i * i) } else { o + i };
        let h = half.normalize() * half.z.signum();
        let (cos_o, cos_i) = (o.dot(h), i.dot(h));
        let mean = |c: DVec3| c.element_sum() / 3.0;
        // How often facets and coat are sampled: by what they reflect about, seen from where light is looked for.
        let [facets, coat] = if front {
            let opaque = (1.0 - self.metallic) * (1.0 - self.spec_trans);
            let both = self.facet(o.z, true).map(mean).iter().sum::<f64>();
            let base = opaque * mean(self.base) + 0.25 * self.sheen * (1.0 - self.metallic);
            let coat = 0.25 * self.clearcoat * (0.04 + fifth(o.z));
            [both / (both + base + coat), coat / (both + base + coat)]
        } else {
            [1.0, 0.0]
        };
        let none = Seen { value: DVec3::ZERO, pdf: 0.0, behind: 1.0, passed: 1.0 };
        if cos_o <= 0.0 || cos_i * i.z <= 0.0 {
            return none;
        }
        let lobe = self.facets();
        let [reflected, through] = self.facet(cos_o, front);
        let (exact, behind) = dielectric(cos_o, n_i / n_o);
        let reflects = if mean(through) == 0.0 { 1.0 } else { mean(reflected) / mean(reflected + through) };
        let (d, g) = (lobe.density(h), lobe.shadowing(o, h) * lobe.shadowing(i, h));
        let visible = facets * lobe.visible_density(o, h);
        let passed = 1.0 - exact;
        if refracts {
            // Walter et al. 2007, eq. 17 and 21.
            let jacobian = n_i * n_i * cos_i.abs() / (n_o * cos_o + n_i * cos_i).powi(2);
            let value = through * (cos_o * d * g / o.z * jacobian * (n_o / n_i).powi(2));
            return Seen { value, pdf: visible * (1.0 - reflects) * jacobian, behind, passed };
        }
        let mut value = reflected * (d * g / (4.0 * o.z));
        let mut pdf = visible * reflects / (4.0 * cos_o);
        if front {
            value += self.above(o, i, h);
            pdf += (1.0 - facets - coat) * i.z / PI + coat * self.coat_density(h) * h.z / (4.0 * cos_o);
        }
        Seen { value, pdf, behind, passed }
    }
}

/// All lobes of the principled material. Where the sum might reflect more than arrives, the program divides it by the larger of a
/// bound for either direction: so of a pair it is divided by what the one or the other direction has with itself, and by nothing else.
/// Inherent: near total reflection as of rough glass; and what passes is 1 less what is reflected, in singles. Pairs that are opposite
/// to one another but for 1e-3 are left out: their rounding decides which facet joins them.
#[test]
fn principled() {
    let (mut values, mut pdfs) = (Worst::new("principled value"), Worst::new("principled pdf"));
    let mut bounded = Worst::new("principled bounded value");
    let mut random = Random::new(12, 0, 0);
    for material in 0..400 {
        let mut unit = |most: f32| if random.below(3) == 0 { 0.0 } else { random.range(0.0, most) };
        let dark = material % 2 == 0;
        let [metallic, spec_tint, sheen_tint, gloss, flatness] = [0; 5].map(|_| unit(1.0));
        let [sheen, clearcoat] = [0; 2].map(|_| if dark { 0.0 } else { unit(1.0) });
        let spec_trans = unit(1.0);
        let base = Vec3::new(random.range(0.01, 1.0), random.range(0.01, 1.0), random.range(0.01, 1.0));
        let (roughness, eta) = (random.range(0.05, 1.0), random.range(1.1, 2.2));
        let number = |value: f32| Texture::Constant(Vec3::splat(value));
        let given = Parameters {
            base_color: Texture::Constant(base),
            roughness: number(roughness),
            metallic: number(metallic),
            eta,
            spec_tint,
            sheen,
            sheen_tint,
            clearcoat,
            clearcoat_gloss: gloss,
            flatness,
            spec_trans,
        };
        let twin = Painted {
            base: base.as_dvec3(),
            roughness: roughness.into(),
            metallic: metallic.into(),
            eta: eta.into(),
            spec_tint: spec_tint.into(),
            sheen: sheen.into(),
            sheen_tint: sheen_tint.into(),
            clearcoat: clearcoat.into(),
            gloss: gloss.into(),
            flatness: flatness.into(),
            spec_trans: spec_trans.into(),
        };
        let clear = spec_trans > 0.0;
        let material: Material = Kind::Principled(Box::new(Principled::new(given))).into();
        let side = |random: &mut Random| if clear && random.below(2) == 0 { -1.0 } else { 1.0 };
        // What a direction in front makes of the value of its pair with itself: one behind is not bounded.
        let divided = |w: Vec3| {
            if w.z < 0.0 {
                1.0
            } else {
                f64::from(material.eval(Vec2::ZERO, w, w).y) / twin.seen(w.as_dvec3(), w.as_dvec3()).value.y
            }
        };
        for _ in 0..2 * INPUTS / 100 {
            let wo = in_front(&mut random) * side(&mut random);
            let any = |random: &mut Random| in_front(random) * side(random);
            let Some(wi) = pair(&material, wo, &mut random, any) else { continue };
            let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
            let Seen { value, pdf, behind, passed } = twin.seen(o, i);
            let facing = o.dot((o + i).normalize()).abs();
            if o.z * i.z > 0.0 && facing < 1e-3 {
                continue;
            }
            let from_behind = 2e-7 / (behind * behind) + 4e-7 / (behind * facing).max(1e-7);
            let inherent =
                if clear && (wo.z < 0.0 || wi.z < 0.0) { from_behind + 1.2e-7 / passed.max(1e-9) } else { 0.0 };
            let at = || {
                format!("α {:e}, η {eta}, metallic {metallic}, clear {spec_trans}, {wo} {wi}", roughness * roughness)
            };
            let found = material.eval(Vec2::ZERO, wo, wi).y;
            let division = divided(wo).min(divided(wi));
            if division > 1.0 - 1e-5 {
                values.compare(found, value.y, inherent, at);
            } else {
                bounded.compare(found, value.y * division, inherent, at);
            }
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, inherent, at);
        }
    }
    values.check(INPUTS);
    bounded.check(INPUTS);
    pdfs.check(INPUTS);
}

/// From isotropic to the sharpest, seen in directions close to the peak and away from it. Inherent: none; but the mean cosine itself
/// is a single, and 1 − g has its digits.
#[test]
fn phase_functions() {
    let mut worst = Worst::new("phase function");
    let mut random = Random::new(10, 0, 0);
    for i in 0..2 * INPUTS {
        let g = match i % 4 {
            0 => 1.0 - decades(&mut random, 1.0 - SHARPEST, 1.0),
            1 => -1.0 + decades(&mut random, 1.0 - SHARPEST, 1.0),
            2 => decades(&mut random, 1e-20, 0.5),
            _ => random.range(-0.99, 0.99),
        };
        let g = g.clamp(-SHARPEST, SHARPEST);
        let phase = HenyeyGreenstein::new(g);
        let wi = if i % 2 == 0 { phase.sample(random.next_2d()) } else { in_front(&mut random) * g.signum() * -1.0 };
        // The cosine by which light is turned, of a direction that is not exactly a unit vector.
        let (w, g) = (wi.as_dvec3().normalize(), f64::from(g));
        let half = (0.5 * (w + DVec3::Z)).length_squared();
        let expected = (1.0 - g * g) / (4.0 * PI * ((1.0 - g).powi(2) + 4.0 * g * half).powf(1.5));
        worst.compare(phase.pdf(wi), expected, 0.0, || format!("g {g}, {wi}"));
    }
    worst.check(INPUTS);
}
