//! Guiding by complete paths: densities of paths of both techniques against one another, and pictures against plain path tracing.

use crate::support::blocks::summaries;
use crate::support::scenes::{built, picture, settings};
use crate::support::statistics::{normal_quantile, sidak};

use std::sync::atomic::AtomicBool;

use fanal::base::Error;
use fanal::base::progress::Silent;
use fanal::base::random::{Dimension, Random};
use fanal::generate::build::{Builder, diffuse, glass, matrix};
use fanal::guiding::paths::cache::{Kept, PathCache};
use fanal::guiding::paths::guide::PathGuide;
use fanal::guiding::paths::path::End;
use fanal::guiding::sample::field::GuideField;
use fanal::guiding::target::Target;
use fanal::integrators::guided::{Expected, GuidedTracer};
use fanal::integrators::path::{CameraPath, Contribution, KernelShares, PathScratch, PathTracer, RayCount, Wants};
use fanal::integrators::{Roulette, TransportSettings};
use fanal::lights::learned::LightSampling;
use fanal::math::channel_mean;
use fanal::picture::Window;
use fanal::reconstruct::AsCounted;
use fanal::render::{Control, GuideMode, RenderSettings, SampleKinds, StopRule, learn, render};
use fanal::scene::Scene;
use fanal::scene::file::{
    Distribution, GridFile, GridMediumFile, LightFile, MaterialFile, MediumFile, SceneFile, TextureFile,
};
use fanal::scene::plan::plan;
use glam::{Mat4, Quat, Vec3};

const SIZE: [u32; 2] = [32, 24];
const PIXELS: f64 = (SIZE[0] * SIZE[1]) as f64;
const PATHS: (GuideMode, SampleKinds, Target) = (GuideMode::Paths, SampleKinds::Path, Target::Variance);
const HYBRID: (GuideMode, SampleKinds, Target) = (GuideMode::Hybrid, SampleKinds::Both, Target::Variance);
const NONE: (GuideMode, SampleKinds, Target) = (GuideMode::None, SampleKinds::Path, Target::Variance);

/// A closed room with a lamp, a ball of glass that throws a caustic, a mirror, and a glossy block.
fn caustic_room() -> Builder {
    let mut b = Builder::new("caustic", SIZE);
    let wall = b.add_material("wall", diffuse([0.6, 0.5, 0.4]));
    let clear = b.add_material("glass", glass(1.5));
    b.add_block("room", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.add_sphere("ball", Vec3::new(0.1, -0.55, 0.0), 0.3, &clear, None);
    b.add_quad("lamp", Vec3::new(0.1, 0.6, 0.0), [Vec3::X * 0.2, Vec3::Z * 0.2], &wall, Some([10.0; 3]));
    b.look_at(Vec3::new(0.5, 0.3, 0.9), Vec3::new(0.0, -0.7, 0.0), Vec3::Y, 70.0);
    b
}

/// The same with a spot and a sky through a missing wall: ends of all kinds.
fn all_ends() -> SceneFile {
    let mut b = Builder::new("ends", SIZE);
    let wall = b.add_material("wall", diffuse([0.6, 0.5, 0.4]));
    let clear = b.add_material("glass", glass(1.5));
    b.add_quad("floor", Vec3::new(0.0, -1.0, 0.0), [Vec3::Z * 2.0, Vec3::X * 2.0], &wall, None);
    b.add_quad("back", Vec3::new(0.0, 0.0, -1.0), [Vec3::X * 2.0, Vec3::Y * 2.0], &wall, None);
    b.add_sphere("ball", Vec3::new(0.1, -0.55, 0.0), 0.3, &clear, None);
    b.add_sphere("lamp", Vec3::new(-0.6, -0.2, 0.2), 0.1, &wall, Some([6.0; 3]));
    b.add_light(LightFile::Constant { radiance: [0.4, 0.5, 0.6] });
    let to_world = matrix(Mat4::from_translation(Vec3::new(0.8, 1.0, 0.8)) * Mat4::from_rotation_x(1.9));
    b.add_light(LightFile::Spot { to_world, intensity: [3.0; 3], cutoff_angle: 60.0, beam_width: 40.0 });
    b.look_at(Vec3::new(0.5, 0.3, 1.9), Vec3::new(0.0, -0.5, 0.0), Vec3::Y, 50.0);
    b.finish()
}

/// A spot that shines through a ball of glass in tinted fog with a border, with a ball of another fog in it, on a floor and a wall.
fn foggy_spot(g: f32) -> Builder {
    let mut b = Builder::new("fog", SIZE);
    let wall = b.add_material("wall", diffuse([0.6, 0.5, 0.4]));
    let clear = b.add_material("glass", glass(1.5));
    b.add_quad("floor", Vec3::new(0.0, -1.0, 0.0), [Vec3::Z * 2.0, Vec3::X * 2.0], &wall, None);
    b.add_quad("back", Vec3::new(0.0, 0.0, -1.0), [Vec3::X * 2.0, Vec3::Y * 2.0], &wall, None);
    b.add_sphere("ball", Vec3::new(0.2, 0.1, 0.1), 0.3, &clear, None);
    let border = b.add_material("border of another", MaterialFile::Null {});
    b.add_sphere("other", Vec3::new(-0.5, -0.5, 0.2), 0.3, &border, None);
    let eye = Vec3::new(0.9, 1.1, 0.6);
    let turn = Quat::from_rotation_arc(Vec3::Z, (Vec3::new(0.2, 0.1, 0.1) - eye).normalize());
    let to_world = matrix(Mat4::from_rotation_translation(turn, eye));
    b.add_light(LightFile::Spot { to_world, intensity: [6.0, 5.0, 4.0], cutoff_angle: 20.0, beam_width: 15.0 });
    b.look_at(Vec3::new(0.5, 0.3, 1.9), Vec3::new(0.0, -0.2, 0.0), Vec3::Y, 50.0);
    b.fill([Vec3::splat(-1.2), Vec3::new(1.3, 1.3, 2.1)], [0.3, 0.45, 0.6], [0.95, 0.9, 0.8], g);
    b
}

/// The same as a scene.
fn foggy(g: f32) -> SceneFile {
    let mut file = foggy_spot(g).finish();
    file.media.insert("dense".into(), MediumFile::Homogeneous { sigma_t: [3.0, 2.0, 1.0], albedo: [0.7; 3], g: 0.3 });
    let other = file.shapes.iter_mut().find(|shape| shape.name.starts_with("other"));
    other.unwrap().interior = Some("dense".into());
    file
}

/// Fills a scene with fog.
fn filled(mut file: SceneFile, sigma_t: [f32; 3], g: f32) -> SceneFile {
    file.media.insert("fog".into(), MediumFile::Homogeneous { sigma_t, albedo: [0.9; 3], g });
    file.camera.medium = Some("fog".into());
    file
}

/// A medium on a grid over the box between two corners: patches of another density and colour than what is between them.
fn cloud([low, high]: [Vec3; 2], sigma_t: [f32; 3], g: f32) -> GridMediumFile {
    let to_world = matrix(Mat4::from_translation(low) * Mat4::from_scale(high - low));
    let inline = |values: &[f32]| GridFile::Inline { size: [2, 3, 2], values: values.into(), to_world, fades: false };
    let density = inline(&[0.2, 1.4, 0.0, 0.7, 1.0, 0.1, 0.6, 0.3, 1.2, 0.0, 0.4, 1.0]);
    let albedo = inline(&[0.9, 0.7, 1.0, 0.8, 0.6, 1.0, 0.9, 0.8, 1.0, 0.7, 0.9, 0.8]);
    let (emission, emission_grid) = ([0.0; 3], None);
    GridMediumFile { density, sigma_t, albedo: [1.0, 0.95, 0.9], albedo_grid: Some(albedo), g, emission, emission_grid }
}

/// [`foggy`] in a cloud instead of fog.
fn cloudy(g: f32) -> SceneFile {
    let mut file = foggy(g);
    let fog = file.media.iter_mut().find(|(name, _)| *name != "dense").unwrap().1;
    *fog = MediumFile::Grid(Box::new(cloud([Vec3::splat(-1.2), Vec3::new(1.3, 1.3, 2.1)], [0.6, 0.9, 1.2], g)));
    file
}

/// The room of the caustic in a cloud, which shines or not.
fn cloudy_room(emission: [f32; 3]) -> SceneFile {
    let mut file = caustic_room().finish();
    let cloud = GridMediumFile { emission, ..cloud([Vec3::splat(-1.0), Vec3::ONE], [0.4, 0.8, 0.6], 0.5) };
    file.media.insert("cloud".into(), MediumFile::Grid(Box::new(cloud)));
    file.camera.medium = Some("cloud".into());
    file
}

/// [`all_ends`] with a lamp that no ray meets.
fn unseen_lamp() -> SceneFile {
    let mut file = all_ends();
    file.shapes.iter_mut().filter(|shape| shape.emission.is_some()).for_each(|shape| shape.unseen = true);
    file
}

/// A closed room with narrow and wide lobes that reflect and refract, alone, over delta lobes and mixed; `masked` with a pane of holes.
fn lobes(masked: bool) -> SceneFile {
    let mut b = caustic_room();
    let (eta, k) = ([0.2, 0.4, 1.4], [3.9, 2.4, 1.6]);
    let specular_reflectance = TextureFile::rgb([0.9; 3]);
    let distribution = Distribution::Ggx;
    let metal = MaterialFile::RoughConductor { alpha: 0.15, distribution, eta, k, specular_reflectance };
    let frosted = MaterialFile::RoughDielectric { alpha: 0.3, distribution, int_ior: 1.5, ext_ior: 1.0 };
    let coated = |alpha: f32| MaterialFile::Plastic {
        alpha,
        distribution,
        int_ior: 1.5,
        ext_ior: 1.0,
        diffuse_reflectance: TextureFile::rgb([0.5, 0.3, 0.2]),
        specular_reflectance: TextureFile::rgb([1.0; 3]),
        nonlinear: false,
    };
    let materials = Box::new([glass(1.3), coated(0.1)]);
    let mixed = MaterialFile::Blend { weight: TextureFile::rgb([0.5; 3]), materials };
    for (i, material) in [metal, frosted, coated(0.0), coated(0.08), mixed].into_iter().enumerate() {
        let name = b.add_material(&format!("lobes {i}"), material);
        b.add_sphere("ball", Vec3::new(0.35 * i as f32 - 0.75, -0.8, -0.5), 0.17, &name, None);
    }
    if masked {
        let material = Box::new(diffuse([0.7; 3]));
        let pane = b.add_material("pane", MaterialFile::Mask { opacity: TextureFile::rgb([0.4; 3]), material });
        b.add_quad("pane", Vec3::new(0.0, 0.2, 0.0), [Vec3::X * 0.9, Vec3::Z * 0.9], &pane, None);
    }
    b.finish()
}

fn transport(roulette: Roulette) -> TransportSettings {
    TransportSettings { max_depth: 7, light_sampling: true, roulette, guided_distances: false }
}

/// A scene, the guide of directions of the path tracer, and what its pixels are expected to be.
type Traced<'a> = (&'a Scene, Option<&'a GuideField>, Option<Expected<'a>>);

/// Complete paths of the path tracer from places that are spread evenly over the picture.
fn traced(
    (scene, field, expected): Traced,
    roulette: Roulette,
    stream: u64,
    count: u64,
    mut take: impl FnMut(Contribution),
) {
    let tracer = PathTracer { scene, settings: transport(roulette), field, lights: LightSampling::Plain };
    let (shares, mut scratch) = (KernelShares::new(scene), PathScratch::default());
    for first in (0..count).step_by(1 << 10) {
        let begun: Vec<([f32; 2], CameraPath)> = (first..count.min(first + (1 << 10)))
            .map(|index| {
                let random = Random::new(77, stream, index);
                let [x, y] = random.at(Dimension::FILM).next_2d();
                let film = [x * SIZE[0] as f32, y * SIZE[1] as f32];
                let ray = scene.camera.ray(film, scene.camera.lens(&random));
                (film, CameraPath { ray, random, pixel: expected.map(|expected| expected.at(film)) })
            })
            .collect();
        let paths = begun.iter().map(|(_, path)| path.clone());
        tracer.trace_all(paths, Wants::Contributions, &mut scratch, &mut RayCount::default());
        for (index, (film, path)) in begun.iter().enumerate() {
            let mut sum = Vec3::ZERO;
            tracer.contributions(index, &scratch, (*film, path.ray.origin, &path.random), &shares, |contribution| {
                sum += contribution.value;
                take(contribution);
            });
            // Together they are the path's radiance.
            let whole = tracer.radiance(index, &scratch, None);
            assert!((sum - whole).abs().max_element() <= 1e-4 * whole.max_element(), "{sum} {whole}");
        }
    }
}

/// A guide of some of the paths that the path tracer finds, one in `every`.
fn guide(of: Traced, roulette: Roulette, every: usize) -> PathGuide {
    let (mut kept, mut number) = (Vec::new(), 0);
    // Where light is seldom sampled, fewer paths bring any.
    let count = if roulette == Roulette::Window { 12_000 } else { 3000 };
    traced(of, roulette, 1, count, |Contribution { path, value, unguided }| {
        number += 1;
        if let Some(path) = path.filter(|_| number % every == 0) {
            kept.push(Kept { path, value: f64::from(channel_mean(value)) * unguided, unguided, footprint: 0.03 });
        }
    });
    assert!(kept.len() > 100, "{} paths", kept.len());
    // Two batches, so that weights differ, and kernels are not the first.
    let (mut cache, second) = (PathCache::default(), kept.split_off(kept.len() / 2));
    let first = cache.learn(kept, &PathGuide::default(), PIXELS, SIZE);
    cache.learn(second, &first, PIXELS, SIZE)
}

/// Guides of directions that are learned in a scene from camera paths and photons.
fn learned(scene: &Scene) -> GuideField {
    let mut settings = settings(HYBRID, 64, 9);
    settings.transport.max_depth = 7;
    let field =
        learn(scene, &settings, &AsCounted::default(), &Control::new(&Silent, &AtomicBool::new(false))).unwrap();
    assert!(field.distributions().count() > 20);
    field
}

/// Sums over independent samples of a technique, in classes: what they bring, squares of that, and the same times what the other technique
/// would bring by the same path, which is the second moment of that.
#[derive(Clone)]
struct Sums(Vec<[f64; 3]>);

/// Classes of paths: how they end, whether a delta lobe scatters, whether a medium does, and how long they are up to 5 points.
const CLASSES: usize = 3 * 2 * 2 * 5;

fn class(path: &fanal::guiding::paths::path::CompletePath) -> usize {
    let end = match path.end {
        End::Surface => 0,
        End::Sky => 1,
        End::Light(_) => 2,
    };
    let delta = usize::from(path.steps.iter().any(|step| step.event.delta));
    let medium = usize::from(path.steps.iter().any(|step| step.event.medium));
    ((end * 2 + delta) * 2 + medium) * 5 + path.points.len().min(5) - 1
}

impl Sums {
    fn new() -> Self {
        Self(vec![[0.0; 3]; CLASSES])
    }

    /// Adds what a sample brings by this technique, and what it would by the other.
    fn add(&mut self, values: &[[f64; 2]]) {
        for (sum, [value, other]) in self.0.iter_mut().zip(values) {
            *sum = [sum[0] + value, sum[1] + value * value, sum[2] + value * other];
        }
    }
}

/// Two estimates of the same in each class, of so many samples: none differs by more than chance allows with a false alarm of 1e-3 for all;
/// returns the number of classes that have any. A technique that finds a class once in a million samples has found none among fewer, and no
/// variance in them; so the variance is the larger of that which its own samples have and that which the other's tell.
fn agree(name: &str, (a, of_a): (&Sums, f64), (b, of_b): (&Sums, f64)) -> usize {
    let limit = normal_quantile(0.5 * sidak(1e-3, CLASSES));
    let mean = |own: [f64; 3], n: f64, other: [f64; 3], of_other: f64| {
        let mean = own[0] / n;
        let second = (own[1] / n).max(other[2] / of_other);
        (mean, (second - mean * mean) / n)
    };
    let mut seen = 0;
    for (class, (&a, &b)) in a.0.iter().zip(&b.0).enumerate() {
        let ((a, va), (b, vb)) = (mean(a, of_a, b, of_b), mean(b, of_b, a, of_a));
        if a > 0.0 || b > 0.0 {
            seen += 1;
            let z = (a - b) / (va + vb).sqrt();
            assert!(z.abs() < limit, "{name}, class {class}: {a} ± {} and {b} ± {}, z = {z}", va.sqrt(), vb.sqrt());
        }
    }
    seen
}

/// By both techniques, in each class of paths, where the guide has a density at all:
///
/// - ∫ p_g p_u / (p_u + p_g): of the guided samples, which of them the path tracer finds, and the other way round. Were p_g not the density of
///   what guided paths do, or did it hold paths that bring no light, it would be less;
/// - ∫ p_g p_u² / (p_u + p_g)²: another part of the same paths;
/// - ∫ f p_g p_u / (p_u + p_g)²: their light.
///
/// The weights bound what single samples bring, so that the means are near enough to normal. Also on top of a guide of directions.
#[test]
fn densities_are_those_of_both_techniques() {
    // Scenes, the fewest classes that each has, and by how many kinds of path tracers it is sampled: relatives of another by two.
    let scenes = [
        ("closed", built(caustic_room().finish()), 6, 5),
        ("ends", built(all_ends()), 12, 5),
        ("unseen", built(unseen_lamp()), 8, 2),
        ("lobes", built(lobes(false)), 6, 5),
        ("holes", built(lobes(true)), 6, 2),
        ("fog", built(foggy(0.3)), 8, 5),
        ("forward fog", built(foggy(0.9)), 8, 2),
        ("room in fog", built(filled(caustic_room().finish(), [0.2, 0.4, 0.3], 0.5)), 8, 2),
        ("ends in fog", built(filled(all_ends(), [0.4, 0.0, 0.1], -0.85)), 10, 2),
        ("cloud", built(cloudy(0.3)), 8, 2),
        ("room in a cloud", built(cloudy_room([0.0; 3])), 8, 5),
    ];
    let kinds = [
        (Roulette::Off, false),
        (Roulette::Window, true),
        (Roulette::Throughput, false),
        (Roulette::Off, true),
        (Roulette::Throughput, true),
    ];
    // Of whatever value: densities say how paths are judged by it.
    let values: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|pixel| 0.02 + 0.0002 * pixel as f32).collect();
    let window = Window { x: 0, y: 0, width: SIZE[0], height: SIZE[1] };
    let cases = scenes.iter().flat_map(|scene| kinds[..scene.3].iter().map(move |kind| (scene, *kind)));
    for ((name, scene, most, _), (roulette, guided)) in cases {
        let field = guided.then(|| learned(scene));
        let (field, name) = (field.as_ref(), &if guided { format!("{name}, guided") } else { name.to_string() });
        let expected = (roulette == Roulette::Window).then_some(Expected { values: &values, window });
        let of = (scene, field, expected);
        let guide = guide(of, roulette, 4);
        let shares = KernelShares::new(scene);
        let tracer = GuidedTracer {
            scene,
            settings: transport(roulette),
            field,
            expected,
            lights: LightSampling::Plain,
            guide: &guide,
            shares: &shares,
        };
        let n = 150_000;
        let mut sums: [Sums; 6] = std::array::from_fn(|_| Sums::new());
        let value = |sums: &mut Sums, class: usize, value: f64, [by_guide, by_tracer]: [f64; 2]| {
            let mut values = [[0.0; 2]; CLASSES];
            values[class] = [value * by_guide, value * by_tracer];
            sums.add(&values);
        };
        for index in 0..n {
            let Some(path) = tracer.sample(Random::new(3, 4, index)) else { continue };
            let (class, pu, pg) = (class(&path.path), path.unguided, PIXELS * path.guided);
            let both = pu + pg;
            assert!(pu > 0.0, "the path tracer finds all that guided paths do");
            let shares = [pu / both, pg / both];
            value(&mut sums[0], class, 1.0, shares);
            value(&mut sums[1], class, pu / both, shares);
            value(&mut sums[2], class, path.value.element_sum() / 3.0 / both, shares);
        }
        // A camera path has several complete ones, which depend on one another; their classes are summed first.
        let mut of_path = [[[0.0; 2]; CLASSES]; 3];
        let mut last = None;
        traced(of, roulette, 2, n, |Contribution { path, value, unguided }| {
            let Some(path) = path else { return };
            if last != Some(path.film) {
                (3..6).for_each(|i| sums[i].add(&of_path[i - 3]));
                (of_path, last) = ([[[0.0; 2]; CLASSES]; 3], Some(path.film));
            }
            let (class, pg) = (class(&path), PIXELS * guide.density(&path));
            if pg > 0.0 {
                let both = unguided + pg;
                let light = f64::from(channel_mean(value)) * unguided;
                for (sums, value) in of_path.iter_mut().zip([1.0, unguided / both, light / both]) {
                    let [by_tracer, by_guide] = &mut sums[class];
                    *by_tracer += value * pg / both;
                    *by_guide += value * unguided / both;
                }
            }
        });
        (3..6).for_each(|i| sums[i].add(&of_path[i - 3]));
        let mut seen = 0;
        for (i, what) in ["densities", "squares", "light"].into_iter().enumerate() {
            // Roulette before a light that is run into does not count in p_u, and so not every such path is found; its light makes up for it. Nor
            // do holes and fog before such a light, which light sampling sees through.
            let counts = roulette == Roulette::Off
                && !["holes", "room in fog", "ends in fog", "room in a cloud"]
                    .iter()
                    .any(|veiled| name.starts_with(veiled));
            if !counts && i < 2 {
                continue;
            }
            seen = agree(&format!("{name}, {what}"), (&sums[i], n as f64), (&sums[3 + i], n as f64));
        }
        assert!(seen >= *most, "{name}: {seen} classes");
    }
}

/// Settings under which most of the budget is for learning: small pictures have small batches, of which few paths are kept.
fn learning(mode: (GuideMode, SampleKinds, Target), seed: u64) -> RenderSettings {
    let spp = if mode == PATHS { 320 } else { 448 };
    let mut settings = RenderSettings { complete_paths: 1.0, paths_share: 0.75, ..settings(mode, spp, seed) };
    settings.transport.max_depth = 7;
    settings
}

/// A room with a caustic, the same full of tinted fog, and in a cloud that shines: see [`have_the_means_of_path_tracing`].
#[test]
fn pictures_have_the_means_of_path_tracing() {
    let fog = filled(caustic_room().finish(), [0.2, 0.4, 0.3], 0.5);
    let scenes = [caustic_room().finish(), fog, cloudy_room([0.3, 0.2, 0.1])].map(built);
    for (scene, modes) in scenes.iter().zip([&[PATHS, HYBRID][..], &[PATHS], &[PATHS]]) {
        have_the_means_of_path_tracing(scene, modes);
    }
}

/// By complete paths, alone or on top of a guide of directions, and by path tracing alone: means of 16 × 16 blocks over 16 pictures each,
/// with a false alarm of 1e-3 for all of the scenes and modes. At least 20 paths are kept, each of which reaches 28 of 768 pixels.
fn have_the_means_of_path_tracing(scene: &Scene, modes: &[(GuideMode, SampleKinds, Target)]) {
    let plain = |seed| {
        let mut settings = settings(NONE, 256, seed);
        settings.transport.max_depth = 7;
        picture(scene, &settings)
    };
    let plain = summaries(&(1..17).map(plain).collect::<Vec<_>>());
    for &mode in modes {
        let guided = |seed| {
            let outcome = rendered(scene, &learning(mode, seed)).unwrap();
            let kept = outcome.statistics.guide.paths;
            assert!(kept > 20, "{kept} paths");
            outcome.image
        };
        let guided = summaries(&(1..17).map(guided).collect::<Vec<_>>());
        for (block, (guided, plain)) in guided.iter().zip(&plain).enumerate() {
            let means = format!("{} ± {} and {} ± {}", guided.mean, guided.error(), plain.mean, plain.error());
            assert!(!guided.differs(plain, sidak(1e-3, 16)), "block {block}: {means}");
            assert!(guided.error() < 0.05 * guided.mean, "nothing is tested: {means}");
        }
    }
}

fn rendered(scene: &Scene, settings: &RenderSettings) -> fanal::base::Result<fanal::render::Outcome> {
    render(scene, settings, &AsCounted::default(), &Silent, &AtomicBool::new(false))
}

/// The same bits for any number of threads, and paths are kept; few samples and wide filters give a picture too.
#[test]
fn pictures_do_not_depend_on_threads() {
    let scene = built(caustic_room().finish());
    let mut wanted = learning(PATHS, 5);
    wanted.filter = fanal::scene::file::FilterFile::TENT;
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| rendered(&scene, &wanted)).unwrap()
    };
    let [one, three] = [1, 3].map(of);
    assert!(one.statistics.guide.paths > 20, "{:?}", one.statistics.decisions);
    assert_eq!(one.image.pixels, three.image.pixels);
    assert_eq!(one.statistics.guide.paths, three.statistics.guide.paths);
    assert!(one.statistics.spp <= 320);
    for spp in [1, 2, 3, 11, 31] {
        let outcome = rendered(&scene, &settings(PATHS, spp, 1)).unwrap();
        assert!(outcome.image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
        assert!(outcome.statistics.spp <= spp);
    }
}

/// A scene whose plan leaves guiding out is rendered without, be it asked for by complete paths alone or beside other guides.
#[test]
fn plans_leave_them_out() {
    let mut file = caustic_room().finish();
    file.render.max_depth = 2;
    let (plan, scene) = (plan(&file), built(file));
    for mode in [PATHS, HYBRID] {
        let asked = RenderSettings { complete_paths: 1.0, ..settings(mode, 2, 1) };
        let statistics = rendered(&scene, &asked.following(&plan)).unwrap().statistics;
        assert_eq!((statistics.method.as_str(), statistics.guide.paths), ("none", 0));
    }
}

/// What there is no picture by complete paths for is an error, and no panic; nor are they learned for a file.
#[test]
fn what_cannot_be_is_refused() {
    let scene = built(caustic_room().finish());
    let refused = |change: fn(&mut RenderSettings)| {
        let mut settings = settings(PATHS, 16, 1);
        change(&mut settings);
        matches!(rendered(&scene, &settings), Err(Error::Options(_)))
    };
    assert!(refused(|settings| settings.stop = StopRule::TargetError(0.1)));
    assert!(refused(|settings| settings.adaptive = true));
    let wanted = settings(PATHS, 16, 1);
    let learned = learn(&scene, &wanted, &AsCounted::default(), &Control::new(&Silent, &AtomicBool::new(false)));
    assert!(matches!(learned, Err(Error::Options(_))));
}
