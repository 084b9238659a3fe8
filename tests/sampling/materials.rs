//! Materials: sampled directions follow the stated densities, and energy, reciprocity and weights are those of the theory.
//!
//! All χ² tests of tests/sampling*.rs together raise a false alarm with probability 0.01 for a new seed (Šidák).

use crate::support::{chart, statistics};

use chart::Chart;
use fanal::base::random::Random;
use fanal::materials::blend::Blend;
use fanal::materials::dielectric::{Dielectric, ThinDielectric};
use fanal::materials::diffuse::Diffuse;
use fanal::materials::fresnel::Metal;
use fanal::materials::medium::{Flight, Medium};
use fanal::materials::microfacet::{Grain, Microfacets, Shape};
use fanal::materials::phase::HenyeyGreenstein;
use fanal::materials::plastic::Plastic;
use fanal::materials::principled::{Parameters, Principled};
use fanal::materials::principled_thin::{self, PrincipledThin};
use fanal::materials::rough_conductor::RoughConductor;
use fanal::materials::rough_dielectric::RoughDielectric;
use fanal::materials::rough_diffuse::RoughDiffuse;
use fanal::materials::texture::Texture;
use fanal::materials::translucent::Translucent;
use fanal::materials::{Coordinates, Kind, Material, Transport};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use statistics::assert_chi2;

const SHAPES: [Shape; 2] = [Shape::Beckmann, Shape::Ggx];
const ALPHAS: [f32; 3] = [0.05, 0.3, 0.8];
/// Cosines of the directions to the viewer: along the normal, oblique, grazing.
const COSINES: [f32; 3] = [1.0, 0.6, 0.05];

fn direction(cos: f32, phi: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

/// A metal that reflects everything where `white`, else gold.
fn rough(shape: Shape, alpha: f32, two_sided: bool, white: bool) -> Material {
    let (eta, k) = if white { (0.0, 1.0) } else { (0.2, 3.9) };
    let metal = Metal { eta: Vec3::splat(eta), k: Vec3::splat(k), reflectance: Texture::Constant(Vec3::ONE) };
    let kind = Kind::RoughConductor(RoughConductor { metal, facets: Microfacets::even(shape, alpha) });
    Material { two_sided, ..kind.into() }
}

fn diffuse(two_sided: bool) -> Material {
    let reflectance = Texture::Constant(Vec3::new(0.8, 0.5, 0.2));
    Material { two_sided, ..Kind::Diffuse(Diffuse { reflectance }).into() }
}

/// Facets of one albedo.
fn chalk(albedo: f32, alpha: f32, qualitative: bool) -> Material {
    let reflectance = Texture::Constant(Vec3::splat(albedo));
    Kind::RoughDiffuse(Box::new(RoughDiffuse::new(reflectance, alpha, qualitative))).into()
}

/// A coat over a base that saturates; without roughness it is smooth.
fn plastic(base: f32, facets: Option<Microfacets>) -> Material {
    let [base, coat] = [base, 1.0].map(|value| Texture::Constant(Vec3::splat(value)));
    Kind::Plastic(Plastic::new(base, coat, 1.5, true, facets)).into()
}

fn frosted(shape: Shape, alpha: f32, eta: f32) -> Material {
    Kind::RoughDielectric(RoughDielectric { eta, facets: Microfacets::even(shape, alpha) }).into()
}

/// A dielectric with a base, all else 0.
fn parameters(base: [f32; 3], roughness: f32, metallic: f32) -> Parameters {
    let constant = |value: f32| Texture::Constant(Vec3::splat(value));
    Parameters {
        base_color: Texture::Constant(base.into()),
        roughness: constant(roughness),
        metallic: constant(metallic),
        eta: 1.5,
        spec_tint: 0.0,
        sheen: 0.0,
        sheen_tint: 0.0,
        clearcoat: 0.0,
        clearcoat_gloss: 0.0,
        flatness: 0.0,
        spec_trans: 0.0,
    }
}

/// Every lobe in turn, and several at once, over a base of one colour.
pub(super) fn principled(base: [f32; 3]) -> [(&'static str, Parameters); 8] {
    let p = |roughness, metallic| parameters(base, roughness, metallic);
    [
        ("plain", p(0.5, 0.0)),
        ("metal", p(0.3, 0.7)),
        ("tint", Parameters { eta: 2.0 / (1.0 - (0.08f32 * 0.7).sqrt()) - 1.0, spec_tint: 0.6, ..p(0.4, 0.0) }),
        ("sheen", Parameters { sheen: 0.8, sheen_tint: 0.4, ..p(0.6, 0.0) }),
        ("coat", Parameters { clearcoat: 0.9, clearcoat_gloss: 0.3, ..p(0.6, 0.0) }),
        ("flat", Parameters { flatness: 0.8, ..p(0.7, 0.0) }),
        ("clear", Parameters { eta: 1.4, spec_trans: 0.7, ..p(0.5, 0.0) }),
        (
            "all",
            Parameters { sheen: 1.0, clearcoat: 1.0, spec_trans: 0.3, flatness: 0.3, spec_tint: 0.5, ..p(0.6, 0.3) },
        ),
    ]
}

pub(super) fn made(parameters: Parameters) -> Material {
    Kind::Principled(Box::new(Principled::new(parameters))).into()
}

/// Every lobe of a thin sheet in turn, and several at once.
pub(super) fn thin(base: [f32; 3]) -> [(&'static str, principled_thin::Parameters); 5] {
    let constant = |value: f32| Texture::Constant(Vec3::splat(value));
    let p = |roughness, spec_trans, diff_trans| principled_thin::Parameters {
        base_color: Texture::Constant(base.into()),
        roughness: constant(roughness),
        spec_trans: constant(spec_trans),
        diff_trans: constant(diff_trans),
        eta: 1.5,
        spec_tint: 0.0,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
    };
    use principled_thin::Parameters as P;
    [
        ("plain", p(0.5, 0.0, 0.0)),
        ("leaf", P { flatness: 0.6, ..p(0.7, 0.0, 0.6) }),
        ("clear", P { eta: 1.4, ..p(0.5, 0.8, 0.0) }),
        ("tint", P { eta: 1.7, spec_tint: 0.6, ..p(0.6, 0.9, 0.0) }),
        ("all", P { eta: 1.33, sheen: 0.8, sheen_tint: 0.4, spec_tint: 0.3, flatness: 0.3, ..p(0.6, 0.4, 0.25) }),
    ]
}

pub(super) fn sheet(parameters: principled_thin::Parameters) -> Material {
    Kind::PrincipledThin(Box::new(PrincipledThin::new(parameters))).into()
}

/// Catches a density that is not the sampler's (a wrong Jacobian, a forgotten horizon, the wrong side), in shape and in mass:
/// lost samples are counted too. And a lobe's number that is left out although it is read.
fn check(name: &str, material: &Material, wo: Vec3, alpha: f32) -> f64 {
    // A narrow lobe is spread over the chart around its centre; otherwise the horizon is a border of cells.
    let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
    let chart = if alpha < 0.1 { Chart::around(mirrored, 4.0) } else { Chart::around(Vec3::Z, 1.0) };
    chart.check(
        name,
        [32, 32],
        |wi| f64::from(material.pdf(Vec2::ZERO, wo, wi)),
        |random| {
            let (lobe, u) = (random.next_f32(), random.next_2d());
            let draw = |lobe| material.sample(Vec2::ZERO, wo, lobe, u, Transport::Radiance);
            let direction = draw(lobe).filter(|s| !s.delta).map(|s| s.wi);
            assert!(
                material.at(Vec2::ZERO).chooses_lobe()
                    || draw(1.0 - lobe).is_none_or(|s| s.delta || Some(s.wi) == direction)
            );
            direction
        },
    )
}

/// How far light gets in a medium: 50 cells of equal probability as far as the next surface, or without one, and beyond it. The
/// density is that which the weight states, σ_s·T over it, to 1e-4. Catches a channel chosen with another probability than the
/// density is weighted with, and flights that do not end at the surface.
#[test]
fn s01_free_flights_follow_their_density() {
    let (extinction, albedo) = (Vec3::new(0.5, 1.0, 2.0), Vec3::new(0.9, 0.8, 0.7));
    let medium = Medium { extinction, albedo, phase: HenyeyGreenstein::new(0.0) };
    let cases = [(Vec3::ONE, 3.0), (Vec3::new(1.0, 0.2, 0.05), f32::INFINITY), (Vec3::new(0.0, 0.0, 2.0), 1.0)];
    for (i, (carried, limit)) in cases.into_iter().enumerate() {
        let share = carried.as_dvec3() / carried.as_dvec3().element_sum();
        let transmittance = |distance: f32| (extinction.as_dvec3() * -f64::from(distance)).exp();
        let beyond = share.dot(transmittance(limit));
        let (n, cells) = (1_000_000, 50);
        let mut random = Random::new(25, i as u64, 0);
        let mut counts = vec![0.0; cells + 1];
        for _ in 0..n {
            match medium.sample(carried, limit, random.next_f32(), random.next_f32()) {
                Flight::Collision { distance, weight } => {
                    let passed = transmittance(distance);
                    let before = (1.0 - share.dot(passed)) / (1.0 - beyond);
                    counts[((before * cells as f64) as usize).min(cells - 1)] += 1.0;
                    let scattered = albedo.as_dvec3() * extinction.as_dvec3() * passed;
                    let stated = scattered / share.dot(extinction.as_dvec3() * passed);
                    assert!((weight.as_dvec3() / stated - 1.0).abs().max_element() < 1e-4, "{weight} {stated}");
                }
                Flight::Through { .. } => counts[cells] += 1.0,
            }
        }
        let mut expected = vec![f64::from(n) * (1.0 - beyond) / cells as f64; cells];
        expected.push(f64::from(n) * beyond);
        assert_chi2(&format!("free flight {i}"), &counts, &expected, chart::level());
    }
}

#[test]
fn s01_phase_function_follows_its_density() {
    for (g, power) in [(-0.9, 4.0), (-0.3, 1.0), (0.0, 1.0), (1e-6, 1.0), (0.6, 1.0), (0.99, 6.0), (1.0, 8.0)] {
        let phase = HenyeyGreenstein::new(g);
        let peak = if g < 0.0 { Vec3::Z } else { Vec3::NEG_Z };
        Chart::around(peak, power).check(
            &format!("phase function {g}"),
            [32, 32],
            |wi| f64::from(phase.pdf(wi)),
            |random| Some(phase.sample(random.next_2d())),
        );
        let mass = Chart::around(peak, power).mass(|wi| f64::from(phase.pdf(wi)));
        assert!((mass - 1.0).abs() < 1e-3, "phase function {g}: {mass}");
    }
}

/// Facets cover the surface once, ∫ D cos θ dω = 1, and those that are visible fill the field of view, ∫ D_w dω = 1: for every
/// roughness and direction, by quadrature to 1e-3. Catches a normalisation that only a χ² at one roughness would let pass.
#[test]
fn s02_microfacets_cover_the_surface() {
    for (shape, alpha) in SHAPES.into_iter().flat_map(|shape| [1e-3, 0.05, 0.3, 0.8, 1.0].map(|alpha| (shape, alpha))) {
        let facets = Microfacets::even(shape, alpha);
        let power = if alpha < 0.01 { 12.0 } else { 4.0 };
        let chart = Chart::around(Vec3::Z, power);
        let cover = chart.mass(|h| f64::from(facets.density(h.into()) * h.z.max(0.0)));
        assert!((cover - 1.0).abs() < 1e-3, "{shape:?} {alpha}: {cover}");
        for cos in COSINES {
            let w = direction(cos, 0.7);
            let mass =
                chart.mass(|h| if h.z > 0.0 { f64::from(facets.visible_density(w.into(), h.into())) } else { 0.0 });
            assert!((mass - 1.0).abs() < 1e-3, "{shape:?} {alpha} from {cos}: {mass}");
        }
    }
}

#[test]
fn s01_rough_metal_follows_its_density() {
    for shape in SHAPES {
        for alpha in ALPHAS {
            for cos in COSINES {
                check(
                    &format!("{shape:?} {alpha} {cos}"),
                    &rough(shape, alpha, false, true),
                    direction(cos, 0.7),
                    alpha,
                );
            }
            let back = -direction(0.6, 0.7);
            check(&format!("{shape:?} {alpha} from the back"), &rough(shape, alpha, true, true), back, alpha);
        }
    }
}

/// Along a grain and across it, for metal, glass and the principled material.
#[test]
fn s01_facets_with_a_grain_follow_their_density() {
    for shape in SHAPES {
        for (aspect, angle) in [(0.4, 0.3), (2.5, 1.1)] {
            let grain = Some(Grain::new(aspect, angle));
            let [metal, glass] = [rough(shape, 0.3, true, true), frosted(shape, 0.3, 1.5)];
            for (name, material) in [("metal", metal), ("glass", glass)] {
                let material = Material { grain, ..material };
                for cos in [1.0, 0.5, -0.8] {
                    check(&format!("{shape:?} {name} {aspect} {cos}"), &material, direction(cos, 0.7), 1.0);
                }
            }
        }
    }
    for (name, given) in principled([1.0; 3]) {
        let material = Material { grain: Some(Grain::new(1.8, 2.0)), ..made(given) };
        check(&format!("principled {name}"), &material, direction(0.5, 0.7), 1.0);
    }
}

/// A grain goes with ∂p/∂u: turned by an angle, a surface scatters as it does for directions that are turned the other way.
#[test]
fn grains_turn_with_the_surface() {
    let turn = |w: Vec3, angle: f32| glam::Mat3::from_rotation_z(angle) * w;
    let mut random = Random::new(62, 0, 0);
    for shape in SHAPES {
        for material in [rough(shape, 0.3, true, false), frosted(shape, 0.3, 1.5)] {
            let material = Material { grain: Some(Grain::new(2.0, 0.4)), ..material };
            let mut differs = 0;
            for _ in 0..1000 {
                let [wo, wi] = [0; 2].map(|_| direction(random.range(0.05, 1.0), random.range(0.0, 6.0)));
                let angle = random.range(-3.0, 3.0);
                let turned = material.eval(Coordinates { uv: Vec2::ZERO, angle }, wo, wi).x;
                let expected = material.eval(Vec2::ZERO, turn(wo, -angle), turn(wi, -angle)).x;
                assert!((turned / expected - 1.0).abs() < 1e-3 || turned.max(expected) < 1e-6, "{turned} {expected}");
                differs += u32::from((material.eval(Vec2::ZERO, wo, wi).x / expected - 1.0).abs() > 0.01);
            }
            assert!(differs > 500, "{differs}");
        }
    }
}

/// A diffuse surface loses no sample: its density integrates to 1 up to the rounding of single precision.
#[test]
fn s01_diffuse_follows_its_density() {
    for (two_sided, cos) in [(false, 1.0), (false, 0.02), (true, -0.6)] {
        let wo = direction(cos, 0.7);
        let mass = check(&format!("diffuse {cos}"), &diffuse(two_sided), wo, 1.0);
        assert!((mass - 1.0).abs() < 1e-5, "{mass}");
    }
}

fn translucent(reflectance: [f32; 3], transmittance: [f32; 3]) -> Material {
    let [reflectance, transmittance] = [reflectance, transmittance].map(|color| Texture::Constant(color.into()));
    Kind::Translucent(Translucent { reflectance, transmittance }).into()
}

/// Nor does a translucent sheet, seen from either side; it scatters what it says to both, and never more than arrives.
#[test]
fn s01_translucent_sheets_follow_their_density() {
    for (reflectance, transmittance, kept) in [
        ([0.5, 0.2, 0.1], [0.1, 0.3, 0.4], 1.0),
        ([0.0; 3], [0.9; 3], 1.0),
        ([0.7; 3], [0.0; 3], 1.0),
        ([0.9; 3], [0.6; 3], 1.5),
    ] {
        let material = translucent(reflectance, transmittance);
        let [reflected, passed] = [reflectance, transmittance].map(|albedo| Vec3::from(albedo) / kept);
        for cos in [0.8, 0.02, -0.5] {
            let wo = direction(cos, 0.7);
            let mass = check(&format!("sheet {reflectance:?} {transmittance:?} {cos}"), &material, wo, 1.0);
            assert!((mass - 1.0).abs() < 1e-5, "{mass}");
            let wi = direction(0.6 * cos.signum(), 2.0);
            for (wi, albedo) in [(wi, reflected), (-wi, passed)] {
                let value = material.eval(Vec2::ZERO, wo, wi);
                assert!(value.distance(albedo * 0.6 / std::f32::consts::PI) < 1e-6, "{value} {albedo}");
            }
        }
    }
}

/// Where roughness varies, a point scatters as a material does that is as rough everywhere: to the bit, since the parts here are some of
/// those at which coats are tabulated.
#[test]
fn roughness_varies_from_point_to_point() {
    let board = |parts: [f32; 2]| {
        let [color0, color1] = parts.map(Vec3::splat);
        Texture::Checkerboard { color0, color1, to_uv: glam::Affine2::IDENTITY }
    };
    let mut random = Random::new(61, 0, 0);
    let parts = [3.0 / 15.0, 1.0];
    for shape in SHAPES {
        let made: [fn(Shape, f32) -> Material; 3] = [
            |shape, alpha| rough(shape, alpha, true, false),
            |shape, alpha| frosted(shape, alpha, 1.5),
            |shape, alpha| plastic(0.5, Some(Microfacets::even(shape, alpha))),
        ];
        for make in made {
            let mut varying = make(shape, 0.6);
            varying.vary_roughness(board(parts));
            for (part, uv) in parts.into_iter().zip([Vec2::splat(0.25), Vec2::new(0.75, 0.25)]) {
                let even = make(shape, 0.6 * part);
                for _ in 0..200 {
                    let [wo, wi] = [0; 2].map(|_| direction(random.range(-1.0, 1.0), random.range(0.0, 6.0)));
                    assert_eq!(varying.eval_and_pdf(uv, wo, wi), even.eval_and_pdf(uv, wo, wi));
                    let (lobe, u) = (random.next_f32(), random.next_2d());
                    let [a, b] = [&varying, &even].map(|m| m.sample(uv, wo, lobe, u, Transport::Radiance));
                    assert_eq!(a.map(|s| (s.wi, s.weight, s.pdf)), b.map(|s| (s.wi, s.weight, s.pdf)));
                }
            }
            assert!((varying.roughness() - 0.36).abs() < 1e-6, "{}", varying.roughness());
        }
    }
}

/// Neither does one of diffuse facets, and its weights have a bound for every direction, 2 where that does not graze the surface.
#[test]
fn s01_rough_diffuse_follows_its_density() {
    for (alpha, qualitative) in [(0.2, false), (0.9, false), (0.9, true)] {
        let material = chalk(1.0, alpha, qualitative);
        for cos in [1.0, 0.5, 0.02] {
            let mass = check(&format!("facets {alpha} {qualitative} {cos}"), &material, direction(cos, 0.7), 1.0);
            assert!((mass - 1.0).abs() < 1e-5, "{mass}");
            let mut random = Random::new(26, 0, 0);
            let mut weight = || {
                let sample = material.sample(
                    Vec2::ZERO,
                    direction(cos, 0.7),
                    random.next_f32(),
                    random.next_2d(),
                    Transport::Radiance,
                );
                sample.map_or(0.0, |sample| sample.weight.x)
            };
            let weights: Vec<f32> = (0..100_000).map(|_| weight()).collect();
            let most = weights.iter().fold(0.0f32, |most, weight| most.max(*weight));
            let second = weights.iter().map(|w| f64::from(w * w)).sum::<f64>() / weights.len() as f64;
            println!("facets {alpha} {qualitative} {cos}: weights up to {most}, second moment {second}");
            assert!(most < if cos < 0.1 { 25.0 } else { 2.0 } && second < 1.5, "{most} {second}");
        }
    }
}

/// A smooth coat's delta lobe counts as lost.
#[test]
fn s01_plastic_follows_its_density() {
    for cos in [0.9, 0.1] {
        let mass = check(&format!("smooth plastic {cos}"), &plastic(0.6, None), direction(cos, 0.7), 1.0);
        assert!(mass < 0.99, "{mass}");
        for shape in SHAPES {
            let material = plastic(0.6, Some(Microfacets::even(shape, 0.3)));
            check(&format!("{shape:?} plastic {cos}"), &material, direction(cos, 0.7), 1.0);
        }
    }
}

#[test]
fn s01_principled_follows_its_density() {
    for (name, parameters) in principled([0.6, 0.3, 0.1]) {
        let clear = parameters.spec_trans > 0.0;
        let material = made(parameters);
        for cos in [0.8, 0.2, -0.7] {
            if cos > 0.0 || clear {
                check(&format!("principled {name} {cos}"), &material, direction(cos, 0.7), 1.0);
            }
        }
    }
    let parts = [diffuse(false), rough(Shape::Ggx, 0.3, false, true)];
    let blend = Blend { weight: Texture::Constant(Vec3::splat(0.3)), parts };
    check("blend", &Kind::Blend(Box::new(blend)).into(), direction(0.6, 0.7), 1.0);
}

/// From both sides.
#[test]
fn s01_thin_sheets_follow_their_density() {
    for (name, parameters) in thin([0.6, 0.3, 0.1]) {
        let material = sheet(parameters);
        for cos in [0.8, 0.2, -0.5] {
            check(&format!("thin {name} {cos}"), &material, direction(cos, 0.7), 1.0);
        }
    }
}

/// Nothing is bent, so f(a, b) = f(b, a) for directions on any sides. Both sides are alike.
#[test]
fn s06_thin_sheets_are_reciprocal_and_alike() {
    let mut random = Random::new(32, 0, 0);
    for (_, parameters) in thin([0.9, 0.7, 0.2]) {
        let material = sheet(parameters);
        for _ in 0..2000 {
            let [a, b] = [(); 2].map(|()| {
                direction(random.range(0.02, 1.0), random.range(0.0, 6.0))
                    * if random.next_f32() < 0.5 { -1.0 } else { 1.0 }
            });
            let there = material.eval(Vec2::ZERO, a, b) / b.z.abs();
            let back = material.eval(Vec2::ZERO, b, a) / a.z.abs();
            assert!((there - back).abs().max_element() <= 1e-4 * there.max_element() + 1e-30, "{there} {back}");
            assert_eq!(material.eval(Vec2::ZERO, a, b), material.eval(Vec2::ZERO, -a, -b));
            assert_eq!(material.eta(a, b), 1.0);
        }
    }
}

/// A white sheet keeps nearly all light where it only scatters, and gains none, whatever its lobes; what its facets hide from one another
/// is lost. Three standard errors are 0.004.
#[test]
fn s06_thin_sheets_gain_no_energy() {
    for (name, parameters) in thin([1.0; 3]) {
        let material = sheet(parameters);
        for cos in [1.0, 0.6, 0.2, 0.05, -0.5] {
            let albedo = albedo(&material, direction(cos, 0.3), Transport::Radiance);
            assert!(albedo < 1.02 && albedo > 0.6, "{name} {cos}: {albedo}");
        }
    }
    // A pure colour, whose hue is many times as bright: no channel gains.
    let (_, parameters) = thin([0.0, 0.0, 1.0])[0].clone();
    let blue = principled_thin::Parameters {
        eta: 2.0,
        spec_tint: 1.0,
        spec_trans: Texture::Constant(Vec3::ONE),
        roughness: Texture::Constant(Vec3::splat(0.2)),
        ..parameters
    };
    let blue = sheet(blue);
    let mut random = Random::new(33, 0, 0);
    let (wo, samples) = (direction(1.0, 0.3), 100_000);
    let drawn =
        (0..samples).map(|_| blue.sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance));
    let brightest =
        drawn.flatten().map(|sample| f64::from(sample.weight.max_element())).sum::<f64>() / f64::from(samples);
    assert!(brightest > 0.6 && brightest < 1.02, "{brightest}");
    // All of the base's light goes through: exactly as much as arrives.
    let (_, leaf) = thin([1.0; 3])[1].clone();
    let through = principled_thin::Parameters { diff_trans: Texture::Constant(Vec3::ONE), ..leaf };
    let albedo = albedo(&sheet(through), direction(0.4, 0.3), Transport::Radiance);
    assert!((albedo - 1.0).abs() < 1e-4, "{albedo}");
}

/// From both sides, into the denser and into the thinner medium.
#[test]
fn s01_rough_glass_follows_its_density() {
    for shape in SHAPES {
        for (alpha, cos) in [(0.3, 0.8), (0.3, -0.8), (0.8, 0.3), (0.8, -0.3)] {
            let wo = direction(cos, 0.7);
            check(&format!("{shape:?} glass {alpha} {cos}"), &frosted(shape, alpha, 1.5), wo, 1.0);
        }
    }
}

/// All materials, with directions on both sides.
fn cases() -> Vec<(Material, Vec3)> {
    let mut random = Random::new(5, 0, 0);
    let mut cases = vec![];
    for two_sided in [false, true] {
        for _ in 0..20 {
            let side = if two_sided && random.next_f32() < 0.5 { -1.0 } else { 1.0 };
            let wo = side * direction(random.range(0.02, 1.0), random.range(0.0, 6.0));
            cases.push((diffuse(two_sided), wo));
            for shape in SHAPES {
                cases.extend(ALPHAS.map(|alpha| (rough(shape, alpha, two_sided, false), wo)));
                let grain = Some(Grain::new(random.range(0.3, 3.0), random.range(-3.0, 3.0)));
                cases.push((Material { grain, ..rough(shape, 0.3, two_sided, false) }, wo));
            }
        }
        let wo = direction(random.range(0.02, 1.0), random.range(0.0, 6.0));
        for shape in SHAPES {
            cases.extend(ALPHAS.map(|alpha| (plastic(0.6, Some(Microfacets::even(shape, alpha))), wo)));
        }
        for (alpha, qualitative) in [(0.1, false), (0.7, false), (0.4, true)] {
            cases.push((Material { two_sided, ..chalk(0.9, alpha, qualitative) }, wo));
            cases.push((Material { two_sided, ..chalk(1.0, alpha, qualitative) }, wo));
        }
        let opaque = principled([0.9, 0.7, 0.2]).into_iter().filter(|(_, p)| p.spec_trans == 0.0);
        cases.extend(opaque.map(|(_, p)| (made(p), wo)));
        let parts = [diffuse(false), rough(Shape::Ggx, 0.3, false, false)];
        let blend = Blend { weight: Texture::Constant(Vec3::splat(0.3)), parts };
        cases.push((Kind::Blend(Box::new(blend)).into(), wo));
    }
    cases
}

/// Catches a sampler that returns another density than `pdf`, or a weight that is not f·cos θ over it. 1e-4 is some hundred
/// roundings.
#[test]
fn samples_agree_with_density_and_value() {
    let mut random = Random::new(6, 0, 0);
    let mut kept = 0;
    let glass =
        SHAPES.into_iter().flat_map(|shape| [0.6, -0.6].map(|cos| (frosted(shape, 0.3, 1.5), direction(cos, 2.0))));
    let clear = principled([0.6, 0.3, 0.1]).into_iter().filter(|(_, p)| p.spec_trans > 0.0);
    let glass = glass.chain(clear.flat_map(|(_, p)| [0.6, -0.6].map(|cos| (made(p.clone()), direction(cos, 2.0)))));
    let sheets = thin([0.6, 0.3, 0.1]).into_iter().map(|(_, p)| sheet(p));
    let sheets = sheets.flat_map(|sheet| [0.6, -0.6].map(|cos| (sheet.clone(), direction(cos, 2.0))));
    for (material, wo) in cases().into_iter().chain(glass).chain(sheets) {
        for _ in 0..1000 {
            let Some(sample) =
                material.sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance)
            else {
                continue;
            };
            kept += 1;
            let (pdf, value) = (material.pdf(Vec2::ZERO, wo, sample.wi), material.eval(Vec2::ZERO, wo, sample.wi));
            assert!(!sample.delta && (pdf - sample.pdf).abs() <= 1e-4 * pdf, "{pdf} {}", sample.pdf);
            assert!((sample.weight * sample.pdf - value).abs().max_element() <= 1e-4 * value.max_element());
            assert!((sample.wi.length() - 1.0).abs() < 1e-5);
        }
    }
    assert!(kept > 200_000, "{kept} samples");
}

/// Helmholtz: f(a, b) = f(b, a). Catches shadowing or a cosine applied to one direction only.
#[test]
fn s06_reciprocal() {
    let mut random = Random::new(7, 0, 0);
    for (material, a) in cases() {
        for _ in 0..200 {
            let b = direction(random.range(0.02, 1.0), random.range(0.0, 6.0)) * a.z.signum();
            let there = material.eval(Vec2::ZERO, a, b) / b.z.abs();
            let back = material.eval(Vec2::ZERO, b, a) / a.z.abs();
            assert!((there - back).abs().max_element() <= 1e-4 * there.max_element() + 1e-30, "{there} {back}");
        }
    }
}

/// Refraction scales radiance by the squared indices: f(a, b)/η_a² = f(b, a)/η_b² (Veach 1997, eq. 5.14). Catches a squeeze of
/// radiance that is missing, doubled or on the wrong side.
#[test]
fn s06_rough_glass_is_reciprocal() {
    let mut random = Random::new(17, 0, 0);
    let mut compared = 0;
    for shape in SHAPES {
        let material = frosted(shape, 0.5, 1.5);
        let index = |w: Vec3| if w.z < 0.0 { 1.5f32 } else { 1.0 };
        for _ in 0..20_000 {
            let [a, b] = [(); 2].map(|()| {
                direction(random.range(0.02, 1.0), random.range(0.0, 6.0))
                    * if random.next_f32() < 0.5 { -1.0 } else { 1.0 }
            });
            let there = material.eval(Vec2::ZERO, a, b).x / b.z.abs() / index(a).powi(2);
            let back = material.eval(Vec2::ZERO, b, a).x / a.z.abs() / index(b).powi(2);
            // Near total reflection what passes goes with √(1 − sin²), whose argument is rounded by some 2e-7; and where an exponential
            // vanishes, the rounding of its exponent is the error.
            let refracts = a.z * b.z < 0.0;
            let h = if refracts { a * index(a) + b * index(b) } else { a + b }.normalize();
            let [cos_a, cos_b] = [a, b].map(|w| w.dot(h).abs());
            let squared = if refracts { cos_a.min(cos_b).powi(2) } else { 1.0 - 2.25 * (1.0 - cos_a * cos_a) };
            let inherent = if refracts || a.z < 0.0 { 4e-7 / squared.abs().max(1e-8) } else { 0.0 };
            assert!((there - back).abs() <= (1e-4 + inherent) * there + 1e-12, "{a} {b}: {there} {back}");
            compared += u32::from(there > 1e-3 && a.z * b.z < 0.0);
        }
    }
    assert!(compared > 1000, "{compared} refractions");
}

/// Mean weight of 1.6e6 samples.
fn albedo(material: &Material, wo: Vec3, transport: Transport) -> f64 {
    let (parts, n) = (16, 100_000);
    let part = |part: u64| {
        let mut random = Random::new(19, part, 0);
        let sample = |_| {
            material
                .sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), transport)
                .map_or(0.0, |s| f64::from(s.weight.x))
        };
        (0..n).map(sample).sum::<f64>() / f64::from(n)
    };
    let means: Vec<f64> = (0..parts).into_par_iter().map(part).collect();
    means.iter().sum::<f64>() / parts as f64
}

/// A base that absorbs nothing under a smooth coat sends everything back, in any direction: what enters, 1 − F, comes out again
/// since η²(1 − R) is the mean transmittance from outside. Three standard errors are 0.01. A rough coat loses what its facets throw at one
/// another, on the way in and out, and 2 % by its quadrature. Catches a factor η² or a Fresnel term that is missing.
#[test]
fn s06_white_plastic_keeps_energy() {
    for cos in [1.0, 0.5, 0.2] {
        let wo = direction(cos, 0.3);
        let smooth = albedo(&plastic(1.0, None), wo, Transport::Radiance);
        assert!((smooth - 1.0).abs() < 0.01, "{cos}: {smooth}");
        for shape in SHAPES {
            let rough = albedo(&plastic(1.0, Some(Microfacets::even(shape, 0.1))), wo, Transport::Radiance);
            assert!((0.85..1.01).contains(&rough), "{shape:?} {cos}: {rough}");
        }
    }
}

/// Power is kept but for what facets hide, radiance is squeezed; a pane lets through what it does not mirror.
#[test]
fn s06_glass_keeps_power() {
    for shape in SHAPES {
        for cos in [0.9, 0.5, -0.9, -0.5] {
            let wo = direction(cos, 0.3);
            let power = albedo(&frosted(shape, 0.1, 1.5), wo, Transport::Importance);
            assert!((0.95..1.005).contains(&power), "{shape:?} {cos}: {power}");
        }
    }
    let pane: Material = Kind::ThinDielectric(ThinDielectric { eta: 1.5 }).into();
    assert!((albedo(&pane, direction(0.4, 0.3), Transport::Radiance) - 1.0).abs() < 1e-6);
    // At normal incidence F = 0.04, and 2F/(1 + F) is mirrored.
    let mut random = Random::new(20, 0, 0);
    let mirrored = (0..100_000).filter(|_| {
        pane.sample(Vec2::ZERO, Vec3::Z, random.next_f32(), random.next_2d(), Transport::Radiance)
            .is_some_and(|s| s.wi == Vec3::Z)
    });
    assert!((mirrored.count() as f64 / 1e5 - 0.08 / 1.04).abs() < 0.004);
}

/// Power keeps, radiance is divided by η² where it is refracted: that is what both kinds of transport differ by, sample by sample, for
/// every material that refracts, seen from both sides.
#[test]
fn s06_radiance_is_squeezed_by_the_square_of_eta() {
    let clear = principled([1.0; 3]).into_iter().filter(|(_, p)| p.spec_trans > 0.0).map(|(_, p)| made(p));
    let smooth: Material = Kind::Dielectric(Dielectric { eta: 1.5 }).into();
    let mut materials = vec![smooth, frosted(SHAPES[0], 0.3, 1.33)];
    let mixed = [frosted(SHAPES[0], 0.3, 1.5), frosted(SHAPES[0], 0.6, 1.5)];
    materials.push(Kind::Blend(Box::new(Blend { weight: Texture::Constant(Vec3::splat(0.4)), parts: mixed })).into());
    materials.extend(clear);
    for (i, material) in materials.iter().enumerate() {
        let mut refracted = 0;
        for n in 0..1000 {
            let wo = direction(if n % 2 == 0 { 0.7 } else { -0.8 }, 0.3);
            let mut random = Random::new(21, n, 0);
            let (lobe, u) = (random.next_f32(), random.next_2d());
            let [radiance, power] = [Transport::Radiance, Transport::Importance]
                .map(|transport| material.sample(Vec2::ZERO, wo, lobe, u, transport));
            let (Some(radiance), Some(power)) = (radiance, power) else { continue };
            let eta = material.eta(wo, radiance.wi);
            assert_eq!(eta != 1.0, radiance.wi.z * wo.z < 0.0, "{i}: {wo} {}", radiance.wi);
            let squeezed = power.weight / radiance.weight;
            assert!((squeezed - eta * eta).abs().max_element() < 1e-4, "{i}: {squeezed} {eta}");
            assert!((eta * material.eta(radiance.wi, wo) - 1.0).abs() < 1e-6);
            refracted += u32::from(eta != 1.0);
        }
        assert!(refracted > 100, "{i}: {refracted}");
    }
}

/// However white the base and whatever lobes are added, no more leaves than arrives. Weights stay below about 3, so three standard
/// errors are 0.004; tables between 24 cosines are off by less than 0.6 %. Catches a bound that is missing or too low.
#[test]
fn s06_principled_gains_no_energy() {
    for (name, parameters) in principled([1.0; 3]) {
        let clear = parameters.spec_trans > 0.0;
        let material = made(parameters);
        for cos in [1.0, 0.6, 0.2, 0.05, -0.5] {
            if cos > 0.0 || clear {
                let albedo = albedo(&material, direction(cos, 0.3), Transport::Importance);
                // From behind only the part that lets light through scatters.
                let least = if cos > 0.0 { 0.4 } else { 0.1 };
                // The lobes of the model are bounded together only where tables of their albedos have an entry: 1.018 between them.
                assert!(albedo < 1.02 && albedo > least, "{name} {cos}: {albedo}");
            }
        }
    }
}

/// White diffuse facets send no more back than arrives, whatever their roughness: the fit would have 1.05 from the side. Standard errors
/// are below 0.002. Of the model with interreflection at least 0.65, and nearly all where they are hardly rough.
#[test]
fn s06_no_facets_gain_energy() {
    for (alpha, qualitative) in [0.05, 0.2, 0.4, 0.7, 5.0].into_iter().flat_map(|alpha| [(alpha, false), (alpha, true)])
    {
        for cos in [1.0, 0.5, 0.2, 0.05, 0.01] {
            let albedo = albedo(&chalk(1.0, alpha, qualitative), direction(cos, 0.3), Transport::Radiance);
            let least = if alpha < 0.3 { 0.96 } else { 0.5 };
            assert!(albedo > least && albedo < 1.006, "{alpha} {qualitative} {cos}: {albedo}");
        }
    }
}

/// No direction reflects more than it gets (1.01), with a metal that absorbs nothing: the mean weight is the albedo. Three standard
/// errors are below 0.003. A nearly smooth one loses next to nothing. Catches a missing or doubled factor in f.
#[test]
fn s06_no_metal_gains_energy() {
    for shape in SHAPES {
        for (alpha, cos) in ALPHAS.into_iter().flat_map(|a| COSINES.map(|c| (a, c))) {
            let albedo = albedo(&rough(shape, alpha, false, true), direction(cos, 0.3), Transport::Radiance);
            let least = if alpha < 0.1 && cos > 0.5 { 0.98 } else { 0.2 };
            assert!(albedo > least && albedo < 1.01, "{shape:?} {alpha} {cos}: {albedo}");
            let brushed = Material { grain: Some(Grain::new(2.0, 0.8)), ..rough(shape, alpha, false, true) };
            let albedo = self::albedo(&brushed, direction(cos, 0.3), Transport::Radiance);
            assert!(albedo > 0.2 && albedo < 1.01, "{shape:?} {alpha} {cos} with a grain: {albedo}");
        }
    }
}
