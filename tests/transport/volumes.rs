//! Media on grids against what can be calculated, against media that are the same everywhere, and every guide against the same.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use crate::media::{block, check, check_at, check_with_distances, medium};
use crate::support::{blocks, scenes, statistics};

use fanal::base::random::Random;
use fanal::generate::build::Builder;
use fanal::geometry::Ray;
use fanal::materials::grid::{Edge, Grid, Values};
use fanal::materials::grid_medium::{GridMedium, Varying};
use fanal::materials::medium::Flight;
use fanal::materials::phase::HenyeyGreenstein;
use fanal::scene::effects::Needs;
use fanal::scene::file::{GridFile, GridMediumFile, LightFile, Matrix, MediumFile, SceneFile};
use fanal::scene::plan::{EffectKind, plan};
use glam::{Affine3A, DVec3, Vec3};
use scenes::{GUIDES, Guide, box_furnace, built, committed, picture, room, settings};
use statistics::{Summary, normal_quantile, sidak};

/// Without a guide, and with two of them.
const FEW: [Guide; 3] = [GUIDES[0], GUIDES[1], GUIDES[5]];

/// From the unit cube to the box between two corners.
fn between(low: [f32; 3], high: [f32; 3]) -> Matrix {
    let side = |axis: usize| high[axis] - low[axis];
    [side(0), 0., 0., low[0], 0., side(1), 0., low[1], 0., 0., side(2), low[2], 0., 0., 0., 1.]
}

fn inline(size: [u32; 3], values: Vec<f32>, to_world: Matrix) -> GridFile {
    GridFile::Inline { size, values, to_world, fades: false }
}

/// A medium on `density`, whose albedo is the same in all channels.
fn varying(density: GridFile, sigma_t: [f32; 3], albedo: f32, g: f32) -> GridMediumFile {
    let (emission, emission_grid) = ([0.0; 3], None);
    GridMediumFile { density, sigma_t, albedo: [albedo; 3], albedo_grid: None, g, emission, emission_grid }
}

fn file(medium: GridMediumFile) -> MediumFile {
    MediumFile::Grid(Box::new(medium))
}

/// A field in the box from (−1, −2, 0) to (3, 2, 1).
fn field(size: [u32; 3], value: impl Fn(Vec3) -> f32) -> (Affine3A, Arc<Grid>) {
    let sides = Vec3::from_array(size.map(|side| side as f32));
    let values = (0..size.iter().product()).map(|index: u32| {
        let cell = [index % size[0], index / size[0] % size[1], index / size[0] / size[1]].map(|at| at as f32 + 0.5);
        value(Vec3::new(-1.0, -2.0, 0.0) + Vec3::new(4.0, 4.0, 1.0) * Vec3::from_array(cell) / sides)
    });
    let grid = Grid::new(size, 1, &Values::Floats(values.collect()), Edge::Continues).unwrap();
    let to_grid =
        Affine3A::from_scale(Vec3::new(0.25, 0.25, 1.0)) * Affine3A::from_translation(Vec3::new(1.0, 2.0, 0.0));
    (to_grid, Arc::new(grid))
}

/// Shadow rays and free flights through densities whose integrals are known: the mean transmittance, the mean weight of getting
/// through, and that of colliding, each within the quantile by which all of them together raise a false alarm in one of 10,000 seeds.
/// Catches majorants that do not bound, steps over cells that lose or repeat a part, and channels weighted by another's density.
#[test]
fn s11_transmittance_of_known_fields() {
    let sigma = Vec3::new(0.4, 1.0, 1.6);
    // Linear between the outermost centres; the ray stays within.
    let linear = |p: Vec3| 0.3 + 0.2 * p.x - 0.1 * p.y + 0.15 * p.z;
    // A Gaussian across x, which cells of 1/32 follow to 1e-3.
    let bell = |p: Vec3| (-2.0 * (p.x - 1.0) * (p.x - 1.0)).exp();
    // erf(2·√2)
    let erf = 0.999_936_657_516_334;
    let cases = [
        (field([20, 33, 8], linear), [Vec3::new(-0.5, 1.5, 0.2), Vec3::new(2.5, -1.0, 0.8)], None),
        (field([128, 1, 3], bell), [Vec3::new(-1.0, 0.0, 0.5), Vec3::new(3.0, 0.0, 0.5)], Some(FRAC_PI_2.sqrt() * erf)),
    ];
    let quantile = normal_quantile(0.5 * sidak(1e-4, 2 * 2 * 3 * 3));
    for (case, (placed, [from, to], integral)) in cases.into_iter().enumerate() {
        // A linear density's mean is its middle's.
        let depth = integral.unwrap_or_else(|| f64::from(linear(0.5 * (from + to)) * from.distance(to)));
        let truth = [sigma.x, sigma.y, sigma.z].map(|sigma| (-f64::from(sigma) * depth).exp());
        let albedo = Varying { factor: Vec3::splat(0.8), grid: None };
        let medium = GridMedium::new(placed, sigma, albedo, None, HenyeyGreenstein::new(0.0));
        let ray = Ray { origin: from, direction: (to - from).normalize() };
        let (length, n) = (from.distance(to), 100_000);
        for carried in [Vec3::ONE, Vec3::new(0.1, 1.0, 0.4)] {
            let mut random = Random::new(5, case as u64, 0);
            let mut sums = [[DVec3::ZERO; 2]; 3];
            let mut add = |sum: usize, value: Vec3| {
                sums[sum][0] += value.as_dvec3() / f64::from(n);
                sums[sum][1] += (value * value).as_dvec3() / f64::from(n);
            };
            for _ in 0..n {
                add(0, medium.transmittance(&ray, length, &mut random));
                match medium.fly(&ray, length, carried, &mut random).end {
                    Flight::Through { weight } => add(1, weight),
                    Flight::Collision { weight, distance } => {
                        assert!(distance >= 0.0 && distance <= length);
                        add(2, weight);
                    }
                }
            }
            for c in 0..3 {
                for (sum, truth) in sums.iter().zip([truth[c], truth[c], 0.8 * (1.0 - truth[c])]) {
                    let error = ((sum[1][c] - sum[0][c] * sum[0][c]).max(0.0) / f64::from(n)).sqrt();
                    assert!(error < 0.02 * truth, "case {case}, channel {c}: standard error {error}");
                    let off = (sum[0][c] - truth).abs();
                    assert!(off < quantile * error + 1e-3 * truth, "case {case}, channel {c}: {} {truth}", sum[0][c]);
                }
            }
        }
    }
}

/// Density on a single cell, or on many of the same value, is the fog of a room as it is everywhere: means of blocks over 8 seeds
/// (Welch, one false alarm in 1000 for all of them), with and without a guide. Half as much again is seen.
#[test]
fn s11_a_constant_grid_is_homogeneous() {
    let fog = |inside: MediumFile| {
        let mut file = room([32, 32], 8.0).finish();
        file.media.insert("fog".into(), inside);
        file.camera.medium = Some("fog".into());
        built(file)
    };
    let (sigma, g) = ([0.5, 0.4, 0.7], 0.4);
    let spread = |density: f32, factor: f32| {
        let place = between([-1.5; 3], [1.5; 3]);
        file(varying(inline([5, 1, 3], vec![density; 15], place), sigma.map(|sigma| factor * sigma), 0.9, g))
    };
    let even = fog(medium(sigma, 0.9, g));
    let [same, more] = [(0.5, 2.0), (0.5, 3.0)].map(|(density, factor)| fog(spread(density, factor)));
    let means = |scene, guide, first: u64| {
        let settings = |seed| {
            let mut settings = settings(guide, 16, seed);
            settings.transport.max_depth = 6;
            settings
        };
        let pictures: Vec<_> = (first..first + 8).map(|seed| picture(scene, &settings(seed))).collect();
        blocks::summaries(&pictures)
    };
    for guide in [GUIDES[0], GUIDES[1]] {
        let (a, b, c) = (means(&even, guide, 0), means(&same, guide, 100), means(&more, guide, 200));
        let tail = sidak(1e-3, 2 * a.len());
        let worst = |a: &[Summary], b: &[Summary]| a.iter().zip(b).map(|(a, b)| a.welch(b, tail)).fold(0.0, f64::max);
        assert!(worst(&a, &b) <= 1.0, "{guide:?}: {:.2} of the limit", worst(&a, &b));
        assert!(worst(&a, &c) > 1.0, "{guide:?}: half as much again is not seen");
    }
}

/// The trilinear field of these values in the unit cube, written apart from the program's.
fn twin(size: [u32; 3], values: &[f32], p: DVec3) -> f64 {
    let mut sum = 0.0;
    for (index, value) in (0u32..).zip(values) {
        let cell = [index % size[0], index / size[0] % size[1], index / size[0] / size[1]];
        let weight = |axis: usize| {
            let q = (p[axis] * f64::from(size[axis]) - 0.5).clamp(0.0, f64::from(size[axis] - 1));
            (1.0 - (q - f64::from(cell[axis])).abs()).max(0.0)
        };
        sum += weight(0) * weight(1) * weight(2) * f64::from(*value);
    }
    sum
}

/// Light of a point that a field scatters once: ∫ σ_s(t) T(0, t) T(t, light) p(θ) I / r² dt along the camera's ray by quadrature.
/// Distances that are drawn where the guide expects light change the picture, not its mean.
#[test]
fn s11_single_scattering_is_the_integral_along_the_ray() {
    let (size, light) = ([3, 2, 4], Vec3::new(0.3, 1.0, -1.0));
    let mut random = Random::new(31, 0, 0);
    let values: Vec<f32> = (0..24).map(|_| 2.0 * random.next_f32() * random.next_f32()).collect();
    let place = |p: DVec3| (p + 2.0) / 4.0;
    let density = |p: DVec3| twin(size, &values, place(p));
    let depth = |from: DVec3, to: DVec3| {
        let n = 200;
        let at = |i: i32| density(from.lerp(to, (f64::from(i) + 0.5) / f64::from(n)));
        (0..n).map(at).sum::<f64>() * from.distance(to) / f64::from(n)
    };
    let (sigma, albedo, g) = ([0.3f32, 0.6, 1.2], 0.9f32, 0.5);
    let phase = HenyeyGreenstein::new(g);
    let (camera, n) = (DVec3::new(0.2, -0.1, 1.5), 1500);
    let mut expected = [0.0; 3];
    let mut before = 0.0;
    // To the far side of the box.
    let step = 3.5 / f64::from(n);
    for i in 0..n {
        let p = camera + DVec3::NEG_Z * step * (f64::from(i) + 0.5);
        let to = light.as_dvec3() - p;
        let here = density(p);
        let value = f64::from(phase.pdf(to.normalize().as_vec3())) * 3.0 / to.length_squared() * step;
        let along = before + 0.5 * here * step + depth(p, light.as_dvec3());
        for (sum, sigma) in expected.iter_mut().zip(sigma.map(f64::from)) {
            *sum += 0.9 * sigma * here * (-sigma * along).exp() * value;
        }
        before += here * step;
    }
    let mut b = Builder::new("field around a light", [2, 2]);
    b.add_light(LightFile::Point { position: light.to_array(), intensity: [3.0; 3] });
    let eye = camera.as_vec3();
    b.look_at(eye, eye + Vec3::NEG_Z, Vec3::Y, 0.01);
    let mut scene = b.finish();
    let density = inline(size, values.clone(), between([-2.0; 3], [2.0; 3]));
    scene.media.insert("field".into(), file(varying(density, sigma, albedo, g)));
    scene.camera.medium = Some("field".into());
    let scene = built(scene);
    check(&scene, GUIDES[0], 4096, 2, expected);
    check_with_distances(&scene, expected);
}

/// Random values, some of them 0.
fn patchy(size: [u32; 3], most: f32, to_world: Matrix) -> GridFile {
    let mut random = Random::new(23, 0, 0);
    let count = size.iter().product::<u32>();
    let values = (0..count).map(|_| (most * (1.5 * random.next_f32() - 0.5)).max(0.0)).collect();
    inline(size, values, to_world)
}

/// A cloud that absorbs nothing cannot be told from the sky around it, thin, dense or coloured; nor one inside a closed box whose
/// walls emit 1 and reflect a, where the radiance is 1/(1 − a) everywhere.
#[test]
fn s11_white_clouds_vanish() {
    let inside = between([-1.0; 3], [1.0; 3]);
    for (name, most, sigma, g) in
        [("thin", 1.0, [1.0; 3], 0.3), ("dense", 12.0, [1.0; 3], 0.0), ("coloured", 1.0, [1.0, 0.4, 2.0], 0.6)]
    {
        let scene = built(block(name, file(varying(patchy([4, 5, 3], most, inside), sigma, 1.0, g))));
        for guide in if name == "dense" { &FEW[..1] } else { &FEW[..] } {
            check(&scene, *guide, 128, 1000, [1.0; 3]);
        }
    }
    let mut furnace = box_furnace(0.6);
    furnace.name = "cloudy furnace".into();
    furnace.media.insert(
        "cloud".into(),
        file(varying(patchy([6, 4, 5], 1.0, between([-1.2; 3], [1.2; 3])), [0.8; 3], 1.0, 0.4)),
    );
    furnace.camera.medium = Some("cloud".into());
    let scene = built(furnace);
    // The others meet a furnace with fog in `s03_fog_changes_no_furnace`; what a guide sees of a medium is the same code.
    for guide in FEW {
        check_at(0.0027, &scene, guide, [768, 200], [2.5; 3]);
    }
}

/// What a medium emits by itself: thin and thick, alike everywhere (1 − e^{−τ} times what it would in the limit), with a source that
/// grows along the ray, and, scattering too, in a sky as bright as itself, where everything is as bright.
#[test]
fn s11_media_shine() {
    let place = between([-1.0; 3], [1.0; 3]);
    let glowing = |values: Vec<f32>, albedo: f32, grid: Option<GridFile>| {
        let size = [1, 1, values.len() as u32];
        let mut medium = varying(inline(size, values, place), [1.0, 0.5, 2.0], albedo, 0.2);
        (medium.emission, medium.emission_grid) = ([2.0, 1.0, 0.5], grid);
        file(medium)
    };
    let dark = |name: &str, inside: MediumFile| -> SceneFile {
        let mut file = block(name, inside);
        file.lights.clear();
        file
    };
    let (sigma, emission) = ([1.0, 0.5, 2.0], [2.0, 1.0, 0.5]);
    for (name, density, albedo) in [("thin glow", 0.05, 0.3), ("thick glow", 20.0, 0.3), ("flame", 0.5, 0.0)] {
        // Light that is emitted towards the camera, of which none is scattered there.
        let scene = built(dark(name, glowing(vec![density; 2], albedo, None)));
        let share = 1.0 - f64::from(albedo);
        let expected = [0, 1, 2].map(|c| share * emission[c] * (1.0 - (-sigma[c] * 2.0 * f64::from(density)).exp()));
        check(&scene, GUIDES[0], 4096, 1, expected);
    }
    // A source that is brighter at the back than at the front, where the camera looks from: ∫ σ e^{−σt} L_e(t) dt from 0 to 2.
    let ramp = inline([1, 1, 2], vec![1.5, 0.0], place);
    let scene = built(dark("ramp", glowing(vec![1.0; 2], 0.0, Some(ramp))));
    let n = 20_000;
    let expected = [0, 1, 2].map(|c| {
        let at = |i: i32| {
            let t = 2.0 * (f64::from(i) + 0.5) / f64::from(n);
            emission[c]
                * twin([1, 1, 2], &[1.5, 0.0], DVec3::new(0.5, 0.5, 1.0 - 0.5 * t))
                * sigma[c]
                * (-sigma[c] * t).exp()
        };
        (0..n).map(at).sum::<f64>() * 2.0 / f64::from(n)
    });
    check(&scene, GUIDES[0], 4096, 1, expected);
    // Of the sky's radiance everywhere, whatever it scatters.
    let mut medium = varying(patchy([4, 5, 3], 2.0, place), [1.0, 0.7, 1.5], 0.6, 0.3);
    medium.emission = [1.0; 3];
    let scene = built(block("warm as the sky", file(medium)));
    for guide in FEW {
        check(&scene, guide, 256, 1000, [1.0; 3]);
    }
}

/// The plan names what varies and what shines; scenes without it take the loops that they took.
#[test]
fn plans_name_volumes() {
    let place = between([-1.0; 3], [1.0; 3]);
    let mut glowing = varying(patchy([2; 3], 1.0, place), [1.0; 3], 0.5, 0.0);
    glowing.emission = [1.0; 3];
    let mut scene = block("cloud", file(glowing));
    scene.lights.clear();
    let cause = |scene: &SceneFile, kind| {
        let effect = plan(scene).effects.into_iter().find(|effect| effect.name == kind).unwrap();
        (effect.on, effect.cause)
    };
    let (on, why) = cause(&scene, EffectKind::Volumes);
    assert!(on && why.contains("inside"), "{why}");
    assert!(!cause(&scene, EffectKind::Medium).0 && !cause(&scene, EffectKind::DirectLight).0);
    assert!(cause(&scene, EffectKind::Guiding).0, "its own light is worth finding");
    assert_eq!(built(scene).needs(), Needs { materials: true, media: true });
    assert_eq!(committed("cornell", [8, 8]).needs(), Needs::default());
    let fog = block("fog", medium([1.0; 3], 0.5, 0.0));
    assert!(cause(&fog, EffectKind::Medium).0 && !cause(&fog, EffectKind::Volumes).0);
    assert!(!built(fog).has_grids());
}
