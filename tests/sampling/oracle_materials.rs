//! Slow twins of materials and phase functions in double precision, written from the formulas of the literature without a look at how
//! the program arranges them: relative errors of at most 1e-4 over 100,000 inputs and more of each, most of them at the edge of
//! what can come up. Where a larger error is inherent, its bound is stated beside the test.

use crate::support::twins;

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::materials::conductor::Conductor;
use fanal::materials::dielectric::{Dielectric, ThinDielectric};
use fanal::materials::diffuse::Diffuse;
use fanal::materials::fresnel::Metal;
use fanal::materials::microfacet::{Grain, Microfacets, SMOOTH, Shape};
use fanal::materials::phase::{HenyeyGreenstein, SHARPEST};
use fanal::materials::plastic::Plastic;
use fanal::materials::rough_conductor::RoughConductor;
use fanal::materials::rough_dielectric::{LEAST_STEP, RoughDielectric};
use fanal::materials::rough_diffuse::RoughDiffuse;
use fanal::materials::texture::Texture;
use fanal::materials::{BsdfSample, Kind, Material, Transport};
use glam::{DVec3, Vec2, Vec3};
use twins::{Facets, INPUTS, Worst, decades, erf64, henyey_greenstein, in_front};

/// Reflected share and the cosine behind, by Fresnel's equations.
pub fn dielectric(cos: f64, eta: f64) -> (f64, f64) {
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
pub fn pair(material: &Material, wo: Vec3, random: &mut Random, any: impl Fn(&mut Random) -> Vec3) -> Option<Vec3> {
    if random.below(2) == 0 {
        return material
            .sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance)
            .map(|sample| sample.wi);
    }
    Some(any(random))
}

/// No grain for half of the materials, else one with an aspect of up to 10, as far as facets of the roughness `alpha` stay rough with it; with its
/// aspect and angle.
fn grain(random: &mut Random, alpha: f32) -> (Option<Grain>, f64, f64) {
    if random.below(2) == 0 {
        return (None, 1.0, 0.0);
    }
    let most = (alpha / SMOOTH).clamp(1.0, 10.0);
    let (aspect, angle) = (decades(random, most.recip(), most), random.range(-3.0, 3.0));
    (Some(Grain::new(aspect, angle)), f64::from(aspect), f64::from(angle))
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
            let kind = Kind::RoughConductor(RoughConductor { metal, facets: Microfacets::even(shape, alpha) });
            let (grain, aspect, angle) = grain(random, alpha);
            let material = Material { grain, ..kind.into() };
            let wo = in_front(random);
            let Some(wi) = pair(&material, wo, random, in_front) else { continue };
            let facets = Facets { aspect, angle, ..Facets::even(shape, f64::from(alpha)) };
            let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
            let h = (o + i).normalize();
            let reflected = conductor(o.dot(h), f64::from(eta), f64::from(k));
            let g = facets.shadowing(o, h) * facets.shadowing(i, h);
            let at = || format!("α {alpha:e}, aspect {aspect}, {angle}, {wo} {wi}, η {eta} {k}");
            let value = reflected * facets.density(h) * g / (4.0 * o.z);
            values.compare(material.eval(Vec2::ZERO, wo, wi).x, value, facets.inherent(h), at);
            let pdf = facets.visible_density(o, h) / (4.0 * o.dot(h));
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, facets.inherent(h), at);
        }
        values.check(INPUTS);
        pdfs.check(INPUTS);
    });
}

/// Value and density of rough glass by Walter et al. 2007, eq. 20, 21 and 14, 17; and how near to total reflection it is, as the
/// cosine of the angle behind; and the facet's normal.
fn glass(facets: &Facets, eta: f64, o: DVec3, i: DVec3) -> (f64, f64, f64, DVec3) {
    // Seen from behind, the surface is turned around and the indices are exchanged.
    let (o, i, [n_o, n_i]) = if o.z > 0.0 { (o, i, [1.0, eta]) } else { (-o, -i, [eta, 1.0]) };
    let refracts = i.z < 0.0;
    let half = if refracts { -(n_o * o + n_i * i) } else { o + i };
    let h = half.normalize() * half.z.signum();
    let (cos_o, cos_i) = (o.dot(h), i.dot(h));
    if cos_o <= 0.0 || cos_i * i.z <= 0.0 {
        return (0.0, 0.0, 1.0, h);
    }
    let (reflected, behind) = dielectric(cos_o, n_i / n_o);
    let g = facets.shadowing(o, h) * facets.shadowing(i, h);
    let (d, visible) = (facets.density(h), facets.visible_density(o, h));
    if !refracts {
        return (reflected * d * g / (4.0 * o.z), reflected * visible / (4.0 * cos_o), behind, h);
    }
    let jacobian = n_i * n_i * cos_i.abs() / (n_o * cos_o + n_i * cos_i).powi(2);
    // Eq. 21 has the squared index on the side where light leaves, the Jacobian that on the side where it comes from.
    let value = cos_o * (1.0 - reflected) * d * g / o.z * jacobian * (n_o / n_i).powi(2);
    (value, visible * (1.0 - reflected) * jacobian, behind, h)
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
            let kind = Kind::RoughDielectric(RoughDielectric { eta, facets: Microfacets::even(shape, alpha) });
            let (grain, aspect, angle) = grain(random, alpha);
            let material = Material { grain, ..kind.into() };
            let side = |random: &mut Random| if random.below(2) == 0 { 1.0f32 } else { -1.0 };
            let wo = side(random) * in_front(random);
            let Some(wi) = pair(&material, wo, random, |random| side(random) * in_front(random)) else { continue };
            let facets = Facets { aspect, angle, ..Facets::even(shape, f64::from(alpha)) };
            let (value, pdf, behind, h) = glass(&facets, f64::from(eta), wo.as_dvec3(), wi.as_dvec3());
            let refracts = wo.z * wi.z < 0.0;
            let facing = wo.dot((wo + wi).normalize_or(wo)).abs();
            let inherent = facets.inherent(h)
                + if refracts {
                    2e-7 / (behind * behind)
                } else {
                    4e-7 / f64::from((eta - 1.0).abs()) + 4e-7 / (behind * f64::from(facing)).max(1e-7)
                };
            let at = || format!("α {alpha:e}, aspect {aspect}, {angle}, η {eta}, {wo} {wi}, behind {behind}");
            values.compare(material.eval(Vec2::ZERO, wo, wi).x, value, inherent, at);
            // The density has the cosine between light and facet in singles.
            let grazing = 1.2e-7 / h.dot(wo.as_dvec3()).abs();
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, inherent + grazing, at);
        }
        values.check(INPUTS);
        pdfs.check(INPUTS);
    });
}

/// Any colour that is not nearly black.
fn colour(random: &mut Random) -> Vec3 {
    Vec3::new(random.range(0.05, 1.0), random.range(0.05, 1.0), random.range(0.05, 1.0))
}

/// Smooth plastic: Fresnel on the way in and out, the base between, what the coat throws back by ∫ of Fresnel. Forty of them, and
/// as many matt surfaces, in all colours, with indices up to 1.9: above, the program's mean over 4096 cosines is off by up to 1.1e-4
/// of what gets out of the coat.
#[test]
fn diffuse_and_smooth_plastic() {
    let (mut values, mut pdfs, mut diffuse) =
        (Worst::new("plastic value"), Worst::new("plastic pdf"), Worst::new("diffuse value"));
    let mut random = Random::new(9, 0, 0);
    let materials = 40;
    for i in 0..materials {
        let [base, reflectance] = [colour(&mut random), colour(&mut random)];
        let (eta, nonlinear) = (random.range(1.2, 1.9), i % 2 == 0);
        let [base_texture, reflectance_texture] = [base, reflectance].map(Texture::Constant);
        let chalk: Material = Kind::Diffuse(Diffuse { reflectance: base_texture.clone() }).into();
        let plastic = Plastic::new(base_texture, reflectance_texture, eta, nonlinear, None);
        let material: Material = Kind::Plastic(plastic).into();
        let (base, reflectance, eta) = (base.as_dvec3(), reflectance.as_dvec3(), f64::from(eta));
        let steps = 100_000;
        let inside = |i: i32| {
            let cos = (f64::from(i) + 0.5) / f64::from(steps);
            2.0 * cos * dielectric(cos, 1.0 / eta).0 / f64::from(steps)
        };
        let internal: f64 = (0..steps).map(inside).sum();
        let scattered = base / (DVec3::ONE - if nonlinear { base } else { DVec3::ONE } * internal);
        for _ in 0..INPUTS / materials {
            let (wo, wi) = (in_front(&mut random), in_front(&mut random));
            let [passed_o, passed_i] = [wo, wi].map(|w| 1.0 - dielectric(f64::from(w.z), eta).0);
            let cos = f64::from(wi.z);
            let value = scattered * (passed_o * passed_i / (PI * eta * eta) * cos);
            let at = || format!("base {base}, {reflectance}, η {eta}, {wo} {wi}");
            let (found, of_chalk) = (material.eval(Vec2::ZERO, wo, wi), chalk.eval(Vec2::ZERO, wo, wi));
            for c in 0..3 {
                values.compare(found[c], value[c], 0.0, at);
                diffuse.compare(of_chalk[c], base[c] * cos / PI, 0.0, at);
            }
            // The coat is sampled by what it reflects, the base by what gets in, times their albedos.
            let [coat, of_base] = [(1.0 - passed_o) * reflectance.element_sum(), passed_o * base.element_sum()];
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), of_base / (coat + of_base) * cos / PI, 0.0, at);
        }
    }
    values.check(3 * INPUTS);
    pdfs.check(INPUTS);
    diffuse.check(3 * INPUTS);
}

/// Facets that are diffuse: Oren and Nayar's functional approximation (1994, §4.4) and their qualitative model (§4.5), with a variance
/// of α²/2. No albedo above 0.9, so that nothing is bounded. Inherent: opposite to the light, and where both directions graze the
/// surface, little is left of sums of terms that are rounded to singles, up to a factor tan β ≫ 1.
#[test]
fn rough_diffuse() {
    let (mut whole, mut simple) = (Worst::new("facets"), Worst::new("facets, qualitative"));
    let mut random = Random::new(15, 0, 0);
    let materials = 40;
    for i in 0..materials {
        let (rho, alpha, qualitative) = (0.9 * colour(&mut random), random.range(0.02, 1.2), i % 2 == 0);
        let made = RoughDiffuse::new(Texture::Constant(rho), alpha, qualitative);
        let material: Material = Kind::RoughDiffuse(Box::new(made)).into();
        let variance = f64::from(alpha).powi(2) / 2.0;
        for _ in 0..INPUTS / materials {
            let (wo, wi) = (in_front(&mut random), in_front(&mut random));
            let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
            let angle = |w: DVec3| w.x.hypot(w.y).atan2(w.z);
            let (a, b) = (angle(o).max(angle(i)), angle(o).min(angle(i)));
            let cos_phi = (o.y.atan2(o.x) - i.y.atan2(i.x)).cos();
            let steep = variance / (variance + 0.09);
            let c1 = 1.0 - 0.5 * variance / (variance + 0.33);
            let c2 = 0.45 * steep * if cos_phi >= 0.0 { a.sin() } else { a.sin() - (2.0 * b / PI).powi(3) };
            let c3 = 0.125 * steep * (4.0 * a * b / (PI * PI)).powi(2);
            let once = c1 + cos_phi * c2 * b.tan() + (1.0 - cos_phi.abs()) * c3 * (0.5 * (a + b)).tan();
            let twice = 0.17 * variance / (variance + 0.13) * (1.0 - cos_phi * (2.0 * b / PI).powi(2));
            let plain = c1 + 0.45 * steep * cos_phi.max(0.0) * a.sin() * b.tan();
            for c in 0..3 {
                let rho = f64::from(rho[c]);
                let value = if qualitative { rho * plain } else { rho * once + rho * rho * twice };
                let value = value.max(0.0) * i.z / PI;
                let terms = rho * (1.0 + 0.45 * steep * b.tan() + c3 * (0.5 * (a + b)).tan()) * i.z / PI;
                let inherent = 5e-7 * terms / value.max(1e-30);
                let at = || format!("ρ {rho}, α {alpha}, {wo} {wi}");
                let worst = if qualitative { &mut simple } else { &mut whole };
                worst.compare(material.eval(Vec2::ZERO, wo, wi)[c], value, inherent, at);
            }
        }
    }
    whole.check(INPUTS);
    simple.check(INPUTS);
}

fn sampled(kind: Kind, wo: Vec3, random: &mut Random) -> BsdfSample {
    let sample = Material::from(kind).sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance);
    let sample = sample.unwrap_or_else(|| panic!("nothing comes back to {wo}"));
    assert!(sample.delta, "{wo}");
    sample
}

fn mirrored(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// What a perfect mirror reflects, per channel.
#[test]
fn smooth_metal() {
    let mut weights = Worst::new("mirror weight");
    let mut random = Random::new(13, 0, 0);
    for _ in 0..INPUTS {
        let mut any = |low: f32, high: f32| [0; 3].map(|_| random.range(low, high));
        let (eta, k, tint) = (any(0.1, 4.0), any(0.5, 8.0), any(0.05, 1.0));
        let reflectance = Texture::Constant(tint.into());
        let metal = Metal { eta: eta.into(), k: k.into(), reflectance };
        let wo = in_front(&mut random);
        let sample = sampled(Kind::Conductor(Conductor { metal }), wo, &mut random);
        assert!(sample.wi == mirrored(wo) && sample.pdf == 1.0, "{wo} {}", sample.wi);
        for c in 0..3 {
            let [eta, k, tint] = [eta[c], k[c], tint[c]].map(f64::from);
            let expected = tint * conductor(f64::from(wo.z), eta, k);
            weights.compare(sample.weight[c], expected, 0.0, || format!("{wo}, η {eta} {k}, {tint}"));
        }
    }
    weights.check(3 * INPUTS);
}

/// Clear glass from both sides and a pane: how often light is reflected and how often it passes, by Fresnel's equations; where it
/// goes, by Snell's law; and how it is squeezed. Inherent: what passes is 1 less what is reflected, in singles; and near total
/// reflection it goes with the cosine behind, √(1 − sin²), which has the rounding of its argument, what is reflected with that over
/// the cosine in front. Within 1e-6 of it rounding decides which it is.
#[test]
fn smooth_glass() {
    let (mut reflections, mut refractions) = (Worst::new("glass reflects"), Worst::new("glass refracts"));
    let (mut cosines, mut panes) = (Worst::new("cosine behind"), Worst::new("pane"));
    let mut random = Random::new(14, 0, 0);
    for i in 0..6 * INPUTS {
        let eta = if i % 2 == 0 { random.range(1.05, 2.5) } else { 1.0 / random.range(1.05, 2.5) };
        let wo = in_front(&mut random) * if random.below(2) == 0 { 1.0f32 } else { -1.0 };
        let cos = f64::from(wo.z.abs());
        let index = if wo.z > 0.0 { f64::from(eta) } else { 1.0 / f64::from(eta) };
        let (reflected, behind) = dielectric(cos, index);
        if (1.0 - (1.0 - cos * cos) / (index * index)).abs() > 1e-6 {
            let sample = sampled(Kind::Dielectric(Dielectric { eta }), wo, &mut random);
            let may_be_total = if index < 1.0 && behind > 0.0 { 1.0 } else { 0.0 };
            let at = || format!("η {eta}, {wo} to {}, behind {behind}", sample.wi);
            if sample.wi.z * wo.z > 0.0 {
                assert!(sample.wi == mirrored(wo) && sample.weight == Vec3::ONE, "{}", at());
                reflections.compare(sample.pdf, reflected, may_be_total * 1.2e-6 / (behind * cos).max(1e-7), at);
            } else {
                let near = may_be_total * 2e-7 / (behind * behind);
                refractions.compare(sample.pdf, 1.0 - reflected, near + 4e-7 / (1.0 - reflected), at);
                cosines.compare(sample.wi.z.abs(), behind, near, at);
                let bent = sample.wi.truncate().as_dvec2() * index + wo.truncate().as_dvec2();
                assert!(bent.length() < 3e-6, "{}", at());
                assert!((f64::from(sample.weight.x) * index * index - 1.0).abs() < 1e-6, "{}", at());
            }
        }
        // All rounds between the pane's faces.
        let eta = eta.max(1.0 / eta);
        let once = dielectric(cos, f64::from(eta)).0;
        let sample = sampled(Kind::ThinDielectric(ThinDielectric { eta }), wo, &mut random);
        let (passes, all) = (sample.wi == -wo, 2.0 * once / (1.0 + once));
        assert!(passes || sample.wi == mirrored(wo), "{wo} {}", sample.wi);
        let (expected, inherent) = if passes { (1.0 - all, 4e-7 / (1.0 - all)) } else { (all, 0.0) };
        panes.compare(sample.pdf, expected, inherent, || format!("pane of {eta}, {wo}"));
    }
    for worst in [reflections, refractions, cosines, panes] {
        worst.check(INPUTS);
    }
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
        let passes = (0..64).map(|i| hemispheric(&facets, cosine(i), eta, false, 32)).collect();
        let weighted = |i: usize| hemispheric(&facets, cosine(i), 1.0 / eta, true, 32) * cosine(i);
        let internal = (0..64).map(weighted).sum::<f64>() / 32.0;
        Self { facets, eta, passes, internal }
    }

    fn passed(&self, cos: f64) -> f64 {
        between(cos * 63.0, &self.passes)
    }
}

/// Linear between the values of a table.
pub fn between(position: f64, table: &[f64]) -> f64 {
    let below = (position as usize).min(table.len() - 2);
    let [a, b] = [table[below], table[below + 1]];
    a + (b - a) * (position - below as f64)
}

/// The part of the light under an angle that is reflected, or passes, and is not hidden by other facets where it goes: the mean
/// over `side` × `side` visible normals.
pub fn hemispheric(facets: &Facets, cos: f64, eta: f64, reflects: bool, side: usize) -> f64 {
    let cos = cos.max(1e-4);
    let w = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let mut sum = 0.0;
    for h in visible_normals(facets, w, side) {
        let cos = w.dot(h).clamp(0.0, 1.0);
        let (reflected, behind) = dielectric(cos, eta);
        let out = if reflects { h * (2.0 * cos) - w } else { h * (cos / eta - behind) - w / eta };
        if (out.z > 0.0) == reflects {
            let part = if reflects { reflected } else { 1.0 - reflected };
            sum += part * facets.shadowing(out, h);
        }
    }
    sum / (side * side) as f64
}

/// The middles of `side` equal parts of the line from 0 to 1.
pub fn middles(side: usize) -> Vec<f64> {
    (0..side).map(|i| (i as f64 + 0.5) / side as f64).collect()
}

/// The normals that `w`, in the plane of x and z, sees at the middles of a grid of `side` × `side`: by Heitz 2018 for GGX, and by
/// the inverse of the distribution of slopes (Heitz and d'Eon 2014), found by halving, for Beckmann.
pub fn visible_normals(facets: &Facets, w: DVec3, side: usize) -> Vec<DVec3> {
    let stretched = DVec3::new(facets.alpha * w.x, 0.0, w.z).normalize();
    let middles = middles(side);
    let normal = |x: f64, y: f64, z: f64| DVec3::new(facets.alpha * x, facets.alpha * y, z).normalize();
    let pairs = |f: &dyn Fn(usize, usize) -> DVec3| (0..side * side).map(|i| f(i % side, i / side)).collect();
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
            let facets = Microfacets::even(shape, alpha);
            let plastic = Plastic::new(constant(base), constant(reflectance), eta, nonlinear, Some(facets));
            let material: Material = Kind::Plastic(plastic).into();
            let coat = Coat::new(Facets::even(shape, f64::from(alpha)), f64::from(eta));
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
        // The direction is not exactly a unit vector.
        let expected = henyey_greenstein(g, wi.as_dvec3().normalize(), DVec3::Z);
        worst.compare(phase.pdf(wi), expected, 0.0, || format!("g {g}, {wi}"));
    }
    worst.check(INPUTS);
}
