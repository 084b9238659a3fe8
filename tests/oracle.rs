//! Slow twins in double precision, written from the formulas of the literature without a look at how the program arranges them,
//! against densities and values in single precision: relative errors of at most 1e-4 over 100,000 inputs and more of each, most
//! of them at the edge of what can come up. Where a larger error is inherent, its bound is stated beside the test.

#[path = "support/network.rs"]
#[allow(dead_code, reason = "shared with the tests of the backends")]
mod support;

use std::f64::consts::PI;
use std::path::Path;

use fanal::base::random::Random;
use fanal::geometry::Surface;
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::distribution::Distribution;
use fanal::guiding::effort::Effort;
use fanal::guiding::features::{FEATURES, NodeInputs};
use fanal::guiding::field::{GuideField, VoxelGuide};
use fanal::guiding::parallax::Parallax;
use fanal::guiding::sampler::SamplingTree;
use fanal::guiding::topology::{MAX_LEVEL, MAX_NODES, Topology};
use fanal::integrators::mixture::{Mixture, Scattering};
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
use fanal::math::{Frame, cylindrical};
use fanal::network::batch::{Batch, DecodeLevel, NONE};
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use fanal::reconstruct::neural::inputs_of;
use fanal::scene::effects::Everything;
use glam::{DVec3, Vec2, Vec3};

/// Inputs of each comparison.
const INPUTS: usize = 100_000;
/// Densities and values below this are no normal singles any more once they are multiplied by anything.
const VANISHING: f64 = 1e-30;

/// The largest relative error so far, and where it was.
struct Worst {
    what: String,
    error: f64,
    at: String,
    compared: usize,
}

impl Worst {
    fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), error: 0.0, at: String::new(), compared: 0 }
    }

    /// An error counts by its excess over what is `inherent`.
    fn compare(&mut self, found: f32, expected: f64, inherent: f64, at: impl FnOnce() -> String) {
        let found = f64::from(found);
        if found.max(expected) < VANISHING && found >= 0.0 {
            return;
        }
        self.compared += 1;
        let error = (found - expected).abs() / expected.abs().max(VANISHING) - inherent;
        if error.is_nan() || error > self.error {
            (self.error, self.at) = (error, format!("{}: {found:e}, not {expected:e}", at()));
        }
    }

    fn check(&self, inputs: usize) {
        println!("{}: {:.1e} over {} ({})", self.what, self.error, self.compared, self.at);
        assert!(self.compared >= inputs, "{}: only {} comparisons", self.what, self.compared);
        assert!(self.error <= 1e-4, "{}: {:.1e} at {}", self.what, self.error, self.at);
    }
}

/// Spread evenly over the decades from `low` to `high`.
fn decades(random: &mut Random, low: f32, high: f32) -> f32 {
    (low.ln() + (high.ln() - low.ln()) * random.next_f32()).exp().clamp(low, high)
}

fn toward(cos: f32, random: &mut Random) -> Vec3 {
    let phi = std::f32::consts::TAU * random.next_f32();
    let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

/// A direction in front, most often at a grazing angle or close to the normal.
fn in_front(random: &mut Random) -> Vec3 {
    let cos = match random.below(3) {
        0 => decades(random, 1e-6, 1.0),
        1 => 1.0 - decades(random, 1e-7, 1.0) * 0.999,
        _ => random.range(0.001, 1.0),
    };
    toward(cos, random)
}

// ---- quadtrees ----

/// A tree down to level 20 with energies from 1e-38 to 1e38, and none.
fn tree(seed: u64) -> Distribution {
    let mut random = Random::new(seed, 1, 0);
    let (mut split, mut width) = (vec![], 1usize);
    for level in 0..=MAX_LEVEL {
        let keep = if level < 4 { 0.6 } else { 2.0 / width as f32 };
        let splits = |random: &mut Random, i: usize| {
            level < MAX_LEVEL && (level == 0 || (i == 0 && width > 1) || random.next_f32() < keep)
        };
        let flags: Vec<bool> = (0..width).map(|i| splits(&mut random, i)).collect();
        width = 4 * flags.iter().filter(|flag| **flag).count();
        split.extend(flags);
        if width == 0 || split.len() + width > MAX_NODES / 2 {
            split.extend(vec![false; width]);
            break;
        }
    }
    let topology = Topology::from_split(&split).expect("flags counted level by level");
    let weights: Vec<f64> = topology
        .leaves()
        .map(|_| if random.below(6) == 0 { 0.0 } else { 10f64.powf(random.next_f64() * 76.0 - 38.0) })
        .collect();
    Distribution::from_leaf_weights(topology, &weights)
}

/// The leaf around a point (z, φ) of the cylinder by halving intervals, with its level, its density relative to uniform, and how
/// near to its border the point is. Shares are those that the tree stores: where the children begin, rounded to 2⁻¹⁶.
fn leaf_density(distribution: &Distribution, direction: DVec3) -> (f64, f64) {
    let topology = distribution.topology();
    let turn = direction.y.atan2(direction.x);
    let phi = if turn < 0.0 { turn + 2.0 * PI } else { turn };
    let (mut z, mut turns, mut node, mut relative) = ([-1.0, 1.0], [0.0, 2.0 * PI], 0, 1.0);
    // Rounding moves directions by lengths: near the poles that is much in φ.
    let radius = direction.x.hypot(direction.y);
    let mut from_border = f64::INFINITY;
    while !topology.is_leaf(node) {
        let middle = [0.5 * (z[0] + z[1]), 0.5 * (turns[0] + turns[1])];
        let upper = [direction.z >= middle[0], phi >= middle[1]];
        from_border = from_border.min((direction.z - middle[0]).abs()).min((phi - middle[1]).abs() * radius);
        z[usize::from(!upper[0])] = middle[0];
        turns[usize::from(!upper[1])] = middle[1];
        let k = usize::from(upper[0]) + 2 * usize::from(upper[1]);
        let first = topology.first_child[node] as usize;
        let masses: Vec<f64> = (0..4).map(|k| distribution.node_mass()[first + k]).collect();
        let total: f64 = masses.iter().sum();
        let begin = |k: usize| {
            let before: f64 = masses[..k].iter().sum();
            let exact = if total > 0.0 { before / total } else { 0.25 * k as f64 };
            if k == 4 { 65536.0 } else { (exact * 65536.0).round().min(65535.0) }
        };
        relative *= 4.0 * (begin(k + 1) - begin(k)) / 65536.0;
        node = first + k;
    }
    (relative, from_border.min(phi * radius).min((2.0 * PI - phi) * radius))
}

/// Directions from all over the tree and from where it is densest, at level 20.
#[test]
fn quadtree_densities() {
    let mut worst = Worst::new("quadtree pdf");
    let mut random = Random::new(1, 0, 0);
    let trees: u64 = 400;
    for seed in 0..trees {
        let distribution = tree(seed);
        let uniform = [1e-4, 0.02, 0.5][seed as usize % 3];
        let guide = SamplingTree::new(&distribution, uniform, usize::MAX);
        for i in 0..2 * INPUTS / trees as usize {
            let direction = if i % 2 == 0 { guide.sample(&mut random).0 } else { any_direction(&mut random) };
            let (relative, from_border) = leaf_density(&distribution, direction.as_dvec3());
            // On a border the last bit of the angle decides.
            if from_border > 1e-14 {
                let u = f64::from(uniform);
                let expected = ((1.0 - u) * relative + u) / (4.0 * PI);
                worst.compare(guide.pdf(direction), expected, 0.0, || format!("tree {seed}, {direction}"));
            }
        }
    }
    worst.check(INPUTS);
}

fn any_direction(random: &mut Random) -> Vec3 {
    cylindrical::to_direction([random.next_f64(), random.next_f64()])
}

/// What sixteen bits for a share change: the bounds between children by half a step, that of the last one by a whole step, for each
/// level that a distribution has. That is what is sampled, so nothing is biased by it.
#[test]
fn stored_shares_are_near_the_given() {
    for seed in 0..50 {
        let distribution = tree(seed);
        let guide = SamplingTree::new(&distribution, 1e-4, usize::MAX);
        let topology = distribution.topology();
        let mut moved = 0.0;
        for level in 0..topology.levels() {
            let area = 0.25f64.powi(level as i32);
            for node in topology.level(level).filter(|&node| topology.is_leaf(node)) {
                let shift = MAX_LEVEL - level;
                let stored = f64::from(guide.pdf_at(topology.cell[node].map(|c| c << shift))) * 4.0 * PI * area;
                moved += (stored - (1.0 - 1e-4) * distribution.node_mass()[node] - 1e-4 * area).abs();
            }
        }
        let levels = (topology.levels() - 1) as f64;
        assert!(
            moved <= 2.0 * (0.5 + 0.5 + 1.0) / 65536.0 * levels + 1e-6,
            "tree {seed}: {moved} over {levels} levels"
        );
    }
}

// ---- microfacets ----

fn erf64(x: f64) -> f64 {
    // The series for small x, the continued fraction (Lentz) for large.
    if x.abs() < 2.5 {
        let (mut term, mut sum) = (x, x);
        for n in 1..80 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        return 2.0 / PI.sqrt() * sum;
    }
    let mut fraction = 0.0;
    for k in (1..60).rev() {
        fraction = 0.5 * f64::from(k) / (x.abs() + fraction);
    }
    (1.0 - (-x * x).exp() / (PI.sqrt() * (x.abs() + fraction))).copysign(x)
}

/// Microfacets by Walter et al. 2007 (eq. 25, 33) and Heitz 2014 (eq. 72, 83).
struct Facets {
    shape: Shape,
    alpha: f64,
}

impl Facets {
    fn density(&self, h: DVec3) -> f64 {
        let (cos2, tan2) = (h.z * h.z, (h.x * h.x + h.y * h.y) / (h.z * h.z));
        let e = tan2 / (self.alpha * self.alpha);
        let scale = 1.0 / (PI * self.alpha * self.alpha * cos2 * cos2);
        match self.shape {
            Shape::Beckmann => scale * (-e).exp(),
            Shape::Ggx => scale / (1.0 + e).powi(2),
        }
    }

    fn visible(&self, w: DVec3, h: DVec3) -> f64 {
        if w.dot(h) * w.z <= 0.0 {
            return 0.0;
        }
        let tan = w.truncate().length() / w.z.abs();
        if tan == 0.0 {
            return 1.0;
        }
        let a = 1.0 / (self.alpha * tan);
        let lambda = match self.shape {
            Shape::Ggx => 0.5 * ((1.0 + 1.0 / (a * a)).sqrt() - 1.0),
            Shape::Beckmann => 0.5 * ((-a * a).exp() / (a * PI.sqrt()) - 1.0 + erf64(a)).max(0.0),
        };
        1.0 / (1.0 + lambda)
    }

    /// As light is reflected: for Beckmann Walter's rational fit, eq. 27.
    fn shadowing(&self, w: DVec3, h: DVec3) -> f64 {
        if self.shape == Shape::Ggx || w.dot(h) * w.z <= 0.0 {
            return self.visible(w, h);
        }
        let a = w.z.abs() / (self.alpha * w.truncate().length());
        if a < 1.6 { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) } else { 1.0 }
    }

    fn visible_density(&self, w: DVec3, h: DVec3) -> f64 {
        self.density(h) * self.visible(w, h) * w.dot(h).max(0.0) / w.z
    }
}

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

// ---- mixture ----

/// α·p_bsdf + (1 − α)·p_guide, the guide's directions carried from the centre of their voxel (dω = dω'·r²/(R²·cos)). Directions that
/// singles may carry to another leaf are left out; roughness is above 0.05, since a turn between world and surface moves a
/// direction by 1e-7, which narrower lobes would show as more than 1e-4.
#[test]
fn mixture_densities() {
    let mut worst = Worst::new("mixture pdf");
    let mut random = Random::new(11, 0, 0);
    for seed in 0..200 {
        let distribution = tree(1000 + seed);
        let uniform = [0.01f32, 0.1][seed as usize % 2];
        let n = any_direction(&mut random);
        let point = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
        let frame = Frame::new(n);
        let (error, uv) = (Vec3::ZERO, Vec2::ZERO);
        let surface = Surface { point, error, normal: n, frame, smooth: n, uv, distance: 1.0, shape: 0 };
        let curvature = if seed % 3 == 0 { 0.0 } else { random.range(0.1, 0.7) };
        let parallax = Parallax { centre: Vec3::splat(0.5), curvature };
        let alpha = random.range(0.05, 0.95);
        let (shape, roughness) = (Shape::Ggx, random.range(0.05, 1.0));
        let metal = Metal { eta: Vec3::splat(0.2), k: Vec3::splat(3.9), reflectance: Texture::Constant(Vec3::ONE) };
        let facets = Microfacets { shape, alpha: roughness };
        let material: Material = Kind::RoughConductor(RoughConductor { metal, facets }).into();
        let wo = in_front(&mut random);
        let out = frame.to_world(wo);
        let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
        cache.find_or_insert(point, surface.normal_towards(out));
        let tree = SamplingTree::new(&distribution, uniform, usize::MAX);
        let field = GuideField::new(
            cache,
            vec![VoxelGuide { tree: Some(tree), parallax, bsdf_fraction: alpha, effort: Effort::UNKNOWN }],
        );
        let guide = field.at(point, surface.normal_towards(out));
        let mixture = Mixture::<Everything>::new(&surface, Scattering::Material(&material), out, guide);
        let twin = Facets { shape, alpha: f64::from(roughness) };
        let axes = [frame.s, frame.t, frame.n].map(Vec3::as_dvec3);
        let local = |w: Vec3| DVec3::from_array(axes.map(|axis| axis.dot(w.as_dvec3())));
        for _ in 0..1000 {
            let wi = if random.below(2) == 0 {
                any_direction(&mut random)
            } else {
                let Some(sample) = mixture.sample(&mut random, Transport::Radiance) else { continue };
                sample.direction
            };
            let (o, i) = (local(out), local(wi));
            let h = (o + i).normalize();
            let bsdf = if i.z > 0.0 && o.z > 0.0 { twin.visible_density(o, h) / (4.0 * o.dot(h)) } else { 0.0 };
            // Along the ray from the point to the sphere of radius R around the centre.
            let (seen, carried) = carried(parallax, point, wi);
            let (relative, from_border) = leaf_density(&distribution, seen);
            if from_border < 1e-6 || i.z.abs() < 1e-6 || o.z.abs() < 1e-6 {
                continue;
            }
            let u = f64::from(uniform);
            let guided = ((1.0 - u) * relative + u) / (4.0 * PI) * carried;
            let a = f64::from(alpha);
            let at = || format!("seed {seed}, roughness {roughness}, {o} {i}, {bsdf} {guided}");
            worst.compare(mixture.pdf(wi).0, a * bsdf + (1.0 - a) * guided, 0.0, at);
        }
    }
    worst.check(INPUTS);
}

/// The direction as seen from the centre and dω/dω'.
fn carried(parallax: Parallax, point: Vec3, away: Vec3) -> (DVec3, f64) {
    let (curvature, away) = (f64::from(parallax.curvature), away.as_dvec3());
    let offset = (point - parallax.centre).as_dvec3() * curvature;
    if curvature == 0.0 || offset.length_squared() >= 0.9 {
        return (away, 1.0);
    }
    // |offset + t·away| = 1.
    let (a, b, c) = (away.length_squared(), offset.dot(away), offset.length_squared() - 1.0);
    let t = ((b * b - a * c).sqrt() - b) / a;
    let seen = (offset + t * away).normalize();
    (seen, t * t / seen.dot(away.normalize()))
}

// ---- network ----

type Rows = Vec<Vec<f64>>;

/// Zhu 2021, eq. 12 to 14, from the weights file.
struct Oracle<'a>(&'a Model);

impl Oracle<'_> {
    /// x·W + b.
    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let layer = &self.0.weights.layers[name];
        assert_eq!(layer.rows, x.len());
        (0..layer.columns)
            .map(|c| {
                let products = x.iter().enumerate().map(|(r, x)| x * f64::from(layer.weight[r * layer.columns + c]));
                f64::from(layer.bias[c]) + products.sum::<f64>()
            })
            .collect()
    }

    /// relu(x·W + b), then convolutions over nine neighbours with one residual around them all.
    fn step(&self, prefix: &str, inputs: Rows, neighbours: &[u32]) -> Rows {
        let relu = |row: Vec<f64>| row.into_iter().map(|x| x.max(0.0)).collect::<Vec<f64>>();
        let start: Rows = inputs.iter().map(|row| relu(self.linear(&format!("{prefix}.in"), row))).collect();
        let mut rows = start.clone();
        let zero = vec![0.0; self.0.config.width];
        for i in 0..self.0.config.convolutions {
            let nine = |row: usize| -> Vec<f64> {
                let around = neighbours[9 * row..][..9].iter();
                around.flat_map(|&r| rows.get(r as usize).unwrap_or(&zero).clone()).collect()
            };
            let mut next: Rows =
                (0..rows.len()).map(|row| self.linear(&format!("{prefix}.conv{i}"), &nine(row))).collect();
            if i + 1 == self.0.config.convolutions {
                next.iter_mut()
                    .zip(&start)
                    .for_each(|(row, start)| row.iter_mut().zip(start).for_each(|(x, s)| *x += s));
            }
            rows = next.into_iter().map(relu).collect();
        }
        rows
    }

    /// All outputs, named and ordered as by `support::forward`.
    fn forward(&self, trees: &[support::Tree]) -> Vec<(String, Vec<f32>)> {
        let topologies: Vec<&Topology> = trees.iter().map(|tree| tree.counted.topology()).collect();
        let batch = Batch::new(&topologies);
        let wide = |values: &[f32], columns: usize| -> Rows {
            values.chunks(columns).map(|row| row.iter().map(|&x| f64::from(x)).collect()).collect()
        };
        let nodes: Vec<NodeInputs> = trees.iter().map(|tree| inputs_of(&tree.input())).collect();
        let features: Vec<f32> = nodes.iter().flat_map(|n| &n.features).copied().collect();
        let log_shares: Vec<_> = nodes.iter().flat_map(|n| &n.log_shares).copied().collect();
        let base: Vec<f32> = nodes.iter().flat_map(|n| &n.base).copied().collect();
        let width = self.0.config.width;
        let mut encoded: Vec<Rows> = vec![vec![]; batch.levels.len() + 1];
        for level in (0..batch.levels.len()).rev() {
            let own = wide(&batch.gather(level, &features, FEATURES), FEATURES);
            let pooled = batch.levels[level].rows.first_child.iter().map(|&first| match first {
                NONE => vec![0.0; width],
                first => {
                    let four = &encoded[level + 1][first as usize..][..4];
                    (0..width).map(|c| four.iter().map(|row| row[c]).sum::<f64>() / 4.0).collect()
                }
            });
            let inputs = own.into_iter().zip(pooled).map(|(own, pooled)| [own, pooled].concat()).collect();
            encoded[level] = self.step("encode", inputs, &batch.levels[level].rows.neighbours);
        }
        let flat = |rows: &Rows| rows.iter().flatten().map(|&x| x as f32).collect::<Vec<f32>>();
        let mut outputs: Vec<_> =
            encoded.iter().enumerate().map(|(level, rows)| (format!("encoded {level}"), flat(rows))).collect();
        let (mut above, mut parents) = (DecodeLevel::roots(&batch), encoded[0].clone());
        loop {
            let splits = |(row, &skip): (usize, &u32)| {
                skip != NONE && (batch.levels[above.level].rows.first_child[skip as usize] != NONE || row % 7 == 0)
            };
            let split: Vec<bool> = above.skip.iter().enumerate().map(splits).collect();
            let level = above.grow(&batch, &split);
            if level.rows.is_empty() {
                return outputs;
            }
            let geometry = level.geometry(&log_shares);
            let inputs = (0..level.rows.len()).map(|row| {
                let skip = match level.skip[row] {
                    NONE => vec![0.0; width],
                    skip => encoded[level.level][skip as usize].clone(),
                };
                let columns = geometry.len() / level.rows.len();
                let geometry = geometry[row * columns..][..columns].iter().map(|&x| f64::from(x)).collect();
                [parents[level.rows.parent[row] as usize].clone(), skip, geometry].concat()
            });
            let decoded = self.step("decode", inputs.collect(), &level.rows.neighbours);
            let head = |name: &str| decoded.iter().map(|row| self.linear(name, row)[0]).collect::<Vec<f64>>();
            let base = level.base(&base);
            let share: Vec<f64> = head("decode.share").iter().zip(&base).map(|(x, &b)| x + f64::from(b)).collect();
            let leaf = head("decode.leaf");
            let softmax = share.chunks(4).flat_map(|four| {
                let most = four.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let sum: f64 = four.iter().map(|x| (x - most).exp()).sum();
                four.iter().map(move |x| (x - most).exp() / sum)
            });
            let softmax: Vec<f64> = softmax.collect();
            let sigmoid: Vec<f64> = leaf.iter().map(|x| 1.0 / (1.0 + (-x).exp())).collect();
            let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
            let named = [
                ("share_logit", single(&share)),
                ("share", single(&softmax)),
                ("leaf_logit", single(&leaf)),
                ("leaf", single(&sigmoid)),
                ("decoded", flat(&decoded)),
            ];
            outputs.extend(named.map(|(name, values)| (format!("{name} {}", level.level), values)));
            (parents, above) = (decoded, level);
        }
    }
}

/// The model that the program carries, over trees of all shapes, twenty levels up and twenty down without a rounding in between.
/// Inherent: a sum of terms of both signs is right to the rounding of the terms, so errors are relative to the value plus the
/// root mean square of its tensor.
#[test]
fn network_forward_pass() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/default");
    let model = Model::load(&folder).expect("the model is part of the project");
    let trees = support::trees();
    let found = support::forward(&model, &Embedded::new(&model).expect("it runs"), &trees);
    let expected = Oracle(&model).forward(&trees);
    let values: usize = found.iter().map(|(_, values)| values.len()).sum();
    assert!(values > INPUTS, "{values}");
    support::assert_close(&found, &expected, 1e-4);
}
