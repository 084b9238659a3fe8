//! Slow twins of the principled materials in double precision, as those of [the others](super::oracle_materials).

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::materials::microfacet::Shape;
use fanal::materials::principled::{Parameters, Principled};
use fanal::materials::principled_thin::{self, PrincipledThin};
use fanal::materials::texture::Texture;
use fanal::materials::{Kind, Material};
use glam::{DVec3, Vec2, Vec3};

use crate::oracle_materials::{between, dielectric, hemispheric, middles, pair, visible_normals};
use crate::support::twins::{Facets, INPUTS, Worst, in_front};

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
        Facets::even(Shape::Ggx, (self.roughness * self.roughness).max(1e-3))
    }

    fn hue(&self) -> DVec3 {
        let luminance = self.base.dot(DVec3::new(0.212671, 0.715160, 0.072169));
        if luminance > 0.0 { self.base / luminance } else { DVec3::ONE }
    }

    /// What a facet reflects and what it lets through: exact for the dielectric, by Schlick for metal and tint.
    fn facet(&self, cos: f64, front: bool) -> [DVec3; 2] {
        let exact = dielectric(cos, if front { self.eta } else { 1.0 / self.eta }).0;
        let [_, clear] = self.opaque_and_clear();
        let through = DVec3::from_array(self.base.to_array().map(f64::sqrt)) * clear * (1.0 - exact);
        if !front {
            return [DVec3::splat(clear * exact), through];
        }
        let schlick = |normal: DVec3| normal + (DVec3::ONE - normal) * fifth(cos);
        let normal = ((self.eta - 1.0) / (self.eta + 1.0)).powi(2);
        let dielectric =
            (1.0 - self.spec_tint) * exact + self.spec_tint * schlick((self.hue() * normal).min(DVec3::ONE));
        [(1.0 - self.metallic) * dielectric + self.metallic * schlick(self.base), through]
    }

    /// Burley 2012, eq. 4.
    fn coat_density(&self, h: DVec3) -> f64 {
        let a2 = (0.1 + (0.001 - 0.1) * self.gloss).powi(2);
        (a2 - 1.0) / (PI * a2.ln() * (1.0 + (a2 - 1.0) * h.z * h.z))
    }

    /// π·f of a white base of this roughness: Burley 2012, §5.3, Burley 2015, eq. 4 and §2.3.
    fn white_base(&self, roughness: f64, o: DVec3, i: DVec3, h: DVec3) -> f64 {
        let cos = i.dot(h);
        let [fo, fi] = [o.z, i.z].map(fifth);
        let retro = 2.0 * roughness * cos * cos;
        let lambert = (1.0 - fo / 2.0) * (1.0 - fi / 2.0) + retro * (fo + fi + fo * fi * (retro - 1.0));
        let fss90 = roughness * cos * cos;
        let fss = (1.0 + (fss90 - 1.0) * fo) * (1.0 + (fss90 - 1.0) * fi);
        let flat = 1.25 * (fss * (1.0 / (o.z + i.z) - 0.5) + 0.5);
        (1.0 - self.flatness) * lambert + self.flatness * flat
    }

    /// f of a full coat over the density of its facets: Burley 2012, §5.6.
    fn full_coat(o: DVec3, i: DVec3, h: DVec3) -> f64 {
        let smith = Facets::even(Shape::Ggx, 0.25);
        0.25 * (0.04 + 0.96 * fifth(i.dot(h))) * smith.visible(o, h) * smith.visible(i, h)
    }

    /// The part that has a base, and the part that lets light through.
    fn opaque_and_clear(&self) -> [f64; 2] {
        [1.0 - self.spec_trans, self.spec_trans].map(|part| (1.0 - self.metallic) * part)
    }

    /// Everything above the facets: the base, sheen (Burley 2012, §5.5) and coat.
    fn above(&self, o: DVec3, i: DVec3, h: DVec3) -> DVec3 {
        let [opaque, _] = self.opaque_and_clear();
        let base = self.base * (opaque / PI * self.white_base(self.roughness, o, i, h));
        let tint = DVec3::ONE * (1.0 - self.sheen_tint) + self.hue() * self.sheen_tint;
        let sheen = tint * (self.sheen * (1.0 - self.metallic) * fifth(i.dot(h)));
        let coat = self.clearcoat * self.coat_density(h) * Self::full_coat(o, i, h);
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
            let [opaque, _] = self.opaque_and_clear();
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

/// Cosines at which the bounds of the principled material are given, and the roughnesses.
const COSINES: usize = 24;
const ROUGHNESSES: usize = 8;

/// What a principled material scatters at most, as the program has it, of which the literature knows nothing: the sum of the
/// albedos of its lobes, each by a quadrature of 24 × 24 points at 24 cosines, and at the two of eight roughnesses around its own,
/// and linear between them.
struct Bound<'a> {
    painted: &'a Painted,
    specular: Vec<f64>,
    base: Vec<f64>,
    sheen: Vec<f64>,
    coat: Vec<f64>,
}

impl<'a> Bound<'a> {
    fn new(painted: &'a Painted) -> Self {
        let points = middles(24);
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            let row = |&u: &f64| points.iter().map(|&v| f(u, v)).sum::<f64>();
            points.iter().map(row).sum::<f64>() / 576.0
        };
        let blended = |f: &dyn Fn(f64, DVec3) -> f64| blended(painted.roughness, f);
        let specular = |roughness: f64, o: DVec3| {
            let facets = Facets::even(Shape::Ggx, (roughness * roughness).max(1e-3));
            hemispheric(&facets, o.z, painted.eta, true, 24)
        };
        // Directions by their cosine, from the disk below (Shirley and Chiu 1997).
        let scattered = |o: DVec3, f: &dyn Fn(DVec3, DVec3) -> f64| {
            mean(&|u, v| {
                let i = above_disk(u, v);
                f(i, (o + i).normalize())
            })
        };
        // Facets by the inverse of their distribution (Burley 2012, appendix B.2), whose density cancels.
        let a2 = (0.1 + (0.001 - 0.1) * painted.gloss).powi(2);
        let coat = |o: DVec3| {
            mean(&|u, v| {
                let cos2 = (1.0 - a2.powf(1.0 - u)) / (1.0 - a2);
                let ((sin_phi, cos_phi), sin) = ((2.0 * PI * v).sin_cos(), (1.0 - cos2).sqrt());
                let h = DVec3::new(sin * cos_phi, sin * sin_phi, cos2.sqrt());
                let cos = o.dot(h);
                let i = h * (2.0 * cos) - o;
                if i.z > 0.0 && cos > 0.0 { Painted::full_coat(o, i, h) * i.z * 4.0 * cos / h.z } else { 0.0 }
            })
        };
        Self {
            painted,
            specular: blended(&specular),
            base: blended(&|roughness, o| scattered(o, &|i, h| painted.white_base(roughness, o, i, h))),
            sheen: at_cosines(&|o| scattered(o, &|i, h| PI * fifth(i.dot(h)))),
            coat: at_cosines(&coat),
        }
    }

    /// What is scattered at most under an angle in front.
    fn albedo(&self, cos: f64) -> f64 {
        let p = self.painted;
        let at = |table: &[f64]| between(cos.sqrt() * (COSINES - 1) as f64, table);
        let [opaque, clear] = p.opaque_and_clear();
        let (brightest, more_hue) = (p.base.max_element(), (p.hue().max_element() - 1.0).max(0.0));
        let specular = at(&self.specular);
        p.metallic
            + (1.0 - p.metallic) * (specular * (1.0 + p.spec_tint * more_hue)).min(1.0)
            + opaque * brightest * at(&self.base)
            + clear * (1.0 - specular) * brightest.sqrt()
            + p.sheen * (1.0 - p.metallic) * (1.0 + p.sheen_tint * more_hue) * at(&self.sheen)
            + p.clearcoat * at(&self.coat)
    }

    /// What a value is divided by: the bound of the direction that has the larger one, where that is above 1. Behind there is none.
    fn divisor(&self, o: DVec3, i: DVec3) -> f64 {
        let [o, i] = [o, i].map(|w| if w.z > 0.0 { self.albedo(w.z) } else { 1.0 });
        o.max(i).max(1.0)
    }
}

/// A table of one roughness: an albedo at cosines.
fn at_cosines(f: &dyn Fn(DVec3) -> f64) -> Vec<f64> {
    let cosines = (0..COSINES).map(|i| (i as f64 / (COSINES - 1) as f64).powi(2).max(1e-3));
    cosines.map(|cos| f(DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos))).collect()
}

/// The same between the two rows around a roughness. Rows are blended first, which comes to the same.
fn blended(roughness: f64, f: &dyn Fn(f64, DVec3) -> f64) -> Vec<f64> {
    let position = roughness * (ROUGHNESSES - 1) as f64;
    let lower = position.floor().min((ROUGHNESSES - 2) as f64);
    let [a, b] = [lower, lower + 1.0].map(|row| at_cosines(&|o| f(row / (ROUGHNESSES - 1) as f64, o)));
    a.iter().zip(b).map(|(a, b)| a + (b - a) * (position - lower)).collect()
}

/// A direction in front at a point of the unit square, by its cosine: as the concentric map of the square to the disk has it.
fn above_disk(u: f64, v: f64) -> DVec3 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (r, phi) = if a.abs() > b.abs() { (a, PI / 4.0 * b / a) } else { (b, PI / 2.0 - PI / 4.0 * a / b) };
    DVec3::new(r * phi.cos(), r * phi.sin(), (1.0 - r * r).sqrt())
}

/// All lobes of the principled material, and the bound that they are divided by where their sum might reflect more than arrives.
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
        let bound = Bound::new(&twin);
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
            let divisor = bound.divisor(o, i);
            let of_kind = if divisor > 1.0 { &mut bounded } else { &mut values };
            of_kind.compare(material.eval(Vec2::ZERO, wo, wi).y, value.y / divisor, inherent, at);
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, inherent, at);
        }
    }
    values.check(INPUTS);
    bounded.check(INPUTS);
    pdfs.check(INPUTS);
}

/// A thin sheet (Burley 2015, §5.3): the base, hue and lobes of the solid material, without metal and coat.
struct Sheet {
    painted: Painted,
    /// Part of the base's light that goes through.
    through: f64,
}

impl Sheet {
    /// Facets for light that is reflected, and for light that passes (Burley 2015, figure 15).
    fn facets(eta: f64, roughness: f64, behind: bool) -> Facets {
        let roughness = if behind { (0.65 * eta - 0.35) * roughness } else { roughness };
        Facets::even(Shape::Ggx, (roughness * roughness).max(1e-3))
    }

    /// f·cos before anything is bounded, the density, and the part that facets let through.
    fn seen(&self, o: DVec3, i: DVec3) -> (DVec3, f64, f64) {
        let p = &self.painted;
        let (o, i) = if o.z > 0.0 { (o, i) } else { (-o, -i) };
        let behind = i.z < 0.0;
        let i = DVec3::new(i.x, i.y, i.z.abs());
        let h = (o + i).normalize();
        let mean = |c: DVec3| c.element_sum() / 3.0;
        let (clear, opaque) = (p.spec_trans, 1.0 - p.spec_trans);
        let facets = Self::facets(p.eta, p.roughness, behind);
        let passed = 1.0 - dielectric(o.dot(h), p.eta).0;
        let factor = if behind { p.base * passed } else { p.facet(o.dot(h), true)[0] };
        let specular = clear * facets.density(h) * facets.shadowing(o, h) * facets.shadowing(i, h) / (4.0 * o.z);
        let tint = DVec3::ONE * (1.0 - p.sheen_tint) + p.hue() * p.sheen_tint;
        let base = if behind {
            p.base * (self.through / PI)
        } else {
            (p.base * (p.white_base(p.roughness, o, i, h) / PI) + tint * (p.sheen * fifth(i.dot(h))))
                * (1.0 - self.through)
        };
        // Lobes are sampled by what they scatter about, seen from where light is looked for.
        let straight = dielectric(o.z, p.eta).0;
        let shares = [
            clear * mean(p.facet(o.z, true)[0]),
            clear * (1.0 - straight) * mean(p.base),
            opaque * (1.0 - self.through) * (mean(p.base) + 0.25 * p.sheen),
            opaque * self.through * mean(p.base),
        ];
        let sum: f64 = shares.iter().sum();
        let side = usize::from(behind);
        let pdf = shares[side] * facets.visible_density(o, h) / (4.0 * o.dot(h)) + shares[2 + side] * i.z / PI;
        (factor * specular + base * (opaque * i.z), pdf / sum, passed)
    }
}

/// All lobes of a thin sheet, seen from both sides, and the bound by which they are divided. Inherent: what passes is 1 less what is
/// reflected, in singles. Pairs that are opposite to one another but for 1e-3 are left out, as above.
#[test]
fn principled_thin() {
    let (mut values, mut pdfs) = (Worst::new("thin value"), Worst::new("thin pdf"));
    let mut bounded = Worst::new("thin bounded value");
    let mut random = Random::new(13, 0, 0);
    for material in 0..400 {
        let mut unit = |most: f32| if random.below(3) == 0 { 0.0 } else { random.range(0.0, most) };
        let [spec_tint, sheen_tint, flatness, spec_trans, diff_trans] = [0; 5].map(|_| unit(1.0));
        let sheen = if material % 2 == 0 { 0.0 } else { unit(1.0) };
        let least = if material % 2 == 0 { 0.01 } else { 0.8 };
        let base = Vec3::new(random.range(least, 1.0), random.range(least, 1.0), random.range(least, 1.0));
        let (roughness, eta) = (random.range(0.2, 1.0), random.range(1.1, 2.2));
        let number = |value: f32| Texture::Constant(Vec3::splat(value));
        let given = principled_thin::Parameters {
            base_color: Texture::Constant(base),
            roughness: number(roughness),
            spec_trans: number(spec_trans),
            diff_trans: number(diff_trans),
            eta,
            spec_tint,
            sheen,
            sheen_tint,
            flatness,
        };
        let painted = Painted {
            base: base.as_dvec3(),
            roughness: roughness.into(),
            metallic: 0.0,
            eta: eta.into(),
            spec_tint: spec_tint.into(),
            sheen: sheen.into(),
            sheen_tint: sheen_tint.into(),
            clearcoat: 0.0,
            gloss: 0.0,
            flatness: flatness.into(),
            spec_trans: spec_trans.into(),
        };
        let twin = Sheet { painted, through: diff_trans.into() };
        let material: Material = Kind::PrincipledThin(Box::new(PrincipledThin::new(given))).into();
        let bound = Bound::new(&twin.painted);
        let passing = blended(twin.painted.roughness, &|roughness, o| {
            let facets = Sheet::facets(twin.painted.eta, roughness, true);
            let normals = visible_normals(&facets, o, 24);
            let passed = |h: &DVec3| {
                let i = *h * (2.0 * o.dot(*h)) - o;
                if i.z > 0.0 {
                    (1.0 - dielectric(o.dot(*h), twin.painted.eta).0) * facets.shadowing(i, *h)
                } else {
                    0.0
                }
            };
            normals.iter().map(passed).sum::<f64>() / 576.0
        });
        let most = |cos: f64| {
            let p = &twin.painted;
            let at = |table: &[f64]| between(cos.sqrt() * (COSINES - 1) as f64, table);
            let (brightest, more_hue) = (p.base.max_element(), (p.hue().max_element() - 1.0).max(0.0));
            let mirrored = (at(&bound.specular) * (1.0 + p.spec_tint * more_hue)).min(1.0);
            let sheen = p.sheen * (1.0 + p.sheen_tint * more_hue) * at(&bound.sheen);
            let base = (1.0 - twin.through) * (brightest * at(&bound.base) + sheen) + twin.through * brightest;
            p.spec_trans * (mirrored + brightest * at(&passing)) + (1.0 - p.spec_trans) * base
        };
        for _ in 0..3 * INPUTS / 100 {
            let side = |random: &mut Random| if random.below(2) == 0 { -1.0 } else { 1.0 };
            let wo = in_front(&mut random) * side(&mut random);
            let any = |random: &mut Random| in_front(random) * side(random);
            let Some(wi) = pair(&material, wo, &mut random, any) else { continue };
            let (o, i) = (wo.as_dvec3(), wi.as_dvec3());
            let folded = DVec3::new(i.x, i.y, i.z.abs().copysign(o.z));
            if o.dot((o + folded).normalize()).abs() < 1e-3 {
                continue;
            }
            let (value, pdf, passed) = twin.seen(o, i);
            let inherent = if o.z * i.z < 0.0 { 1.2e-7 / passed.max(1e-9) } else { 0.0 };
            let at = || format!("roughness {roughness}, η {eta}, clear {spec_trans}, through {diff_trans}, {wo} {wi}");
            let divisor = most(o.z.abs()).max(most(i.z.abs())).max(1.0);
            let of_kind = if divisor > 1.0 { &mut bounded } else { &mut values };
            of_kind.compare(material.eval(Vec2::ZERO, wo, wi).y, value.y / divisor, inherent, at);
            // How often light is let through is 1 less Fresnel's reflectance along the normal, which is nearly 1 at grazing angles.
            let straight = 1.0 - dielectric(o.z.abs(), twin.painted.eta).0;
            let of_share = if o.z * i.z < 0.0 { 4e-7 / straight.max(1e-9) } else { 0.0 };
            pdfs.compare(material.pdf(Vec2::ZERO, wo, wi), pdf, inherent + of_share, at);
        }
    }
    values.check(INPUTS);
    bounded.check(INPUTS);
    pdfs.check(INPUTS);
}
