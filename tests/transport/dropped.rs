//! Samples that are not finite: left out, counted by cause, named so that they can be traced again, and never learned from.

use crate::support::scenes;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::generate::build::{Builder, diffuse, glass, matrix};
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::sample::field::{GuideField, PixelValues, VoxelGuide};
use fanal::guiding::sample::roulette::AdjointRoulette;
use fanal::guiding::target::Target;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::integrators::path::{CameraPath, Cause, PathTracer};
use fanal::lights::learned::LightSampling;
use fanal::picture::Window;
use fanal::render::{
    Control, GuideMode, Outcome, RenderSettings, Sample, SampleKinds, render, render_with_field, replay,
};
use fanal::scene::Scene;
use fanal::scene::file::{Filter, LightFile, MaterialFile, MediumFile, SceneFile, TextureFile, Wrap, identity3};
use fanal::scene::readers::{resolve, save};
use glam::{Mat4, Vec3};
use scenes::{GUIDES, built, reconstructor, room, settings};

/// A picture file of the largest numbers there are, which its users multiply by 4: infinite, but not in the file.
fn blazing(folder: &Path) -> String {
    exr::prelude::write_rgb_file(folder.join("blazing.exr"), 4, 4, |_, _| (3e38f32, 3e38f32, 3e38f32)).unwrap();
    "blazing.exr".into()
}

/// The room with a screen in it whose texture is broken; the screen covers a part of the picture.
fn broken_screen(folder: &Path) -> SceneFile {
    with_screen(room([24, 18], 10.0), folder)
}

/// The same in such a room.
fn with_screen(mut b: Builder, folder: &Path) -> SceneFile {
    let reflectance = TextureFile::Bitmap {
        file: blazing(folder),
        to_uv: identity3(),
        raw: true,
        scale: 4.0,
        wrap: Wrap::Repeat,
        filter: Filter::Nearest,
    };
    let broken = b.add_material("broken", MaterialFile::Diffuse { reflectance });
    b.add_quad("screen", Vec3::new(0.3, -0.5, -0.3), [Vec3::X * 0.25, Vec3::Y * 0.25], &broken, None);
    b.render(6, 32);
    b.finish()
}

fn scene_in(folder: &Path, file: SceneFile) -> Scene {
    scene_with(folder, file, |_| ())
}

/// The same with something in it that no reader lets pass.
fn scene_with(folder: &Path, file: SceneFile, put: impl FnOnce(&mut SceneFile)) -> Scene {
    let size = [file.film.width, file.film.height];
    let mut loaded = resolve(file, folder, Path::new("broken")).expect("finite numbers are sound");
    put(&mut loaded.file);
    Scene::build(&loaded, size).unwrap()
}

fn rendered(scene: &Scene, settings: &RenderSettings) -> Outcome {
    let reconstructor = reconstructor(settings.guide);
    render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).unwrap()
}

/// Whatever is sampled from the field is finite and positive.
fn sound(field: &GuideField) -> bool {
    field.voxels().iter().all(|voxel| {
        let tree = voxel.directions.as_ref();
        let map = tree.map_or(Vec::new(), |tree| tree.map(8));
        let effort = [voxel.roulette.light, voxel.roulette.onward].iter().all(|e| *e >= 0.0);
        let sphere = voxel.parallax.centre.is_finite() && voxel.parallax.curvature.is_finite();
        map.iter().all(|d| d.is_finite() && *d > 0.0) && voxel.bsdf_fraction > 0.0 && effort && sphere
    })
}

/// In every mode: the picture is finite, all that is dropped is counted and named, what is learned stays sound, and half of the
/// picture, which never sees the screen directly, has values.
#[test]
fn a09_broken_textures_reach_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene_in(folder.path(), broken_screen(folder.path()));
    for guide in GUIDES {
        let mut settings = settings(guide, 64, 1);
        settings.transport.max_depth = 6;
        settings.learner.keeps_evidence = true;
        let outcome = rendered(&scene, &settings);
        let statistics = &outcome.statistics;
        assert!(outcome.image.pixels.iter().all(|p| p.is_finite()), "{guide:?}");
        let lit = outcome.image.pixels.iter().filter(|p| p.min_element() > 0.0).count();
        assert!(2 * lit > outcome.image.pixels.len(), "{guide:?}: {lit} pixels have a value");
        let drops = &statistics.dropped;
        assert!(statistics.dropped_samples > 100, "{guide:?}: {}", statistics.dropped_samples);
        assert_eq!(drops.causes.iter().sum::<u64>(), statistics.dropped_samples, "{guide:?}");
        let has_photons = guide.0 != GuideMode::None && guide.1.photons();
        assert_eq!(drops.photons > 0, has_photons, "{guide:?}: {} photons", drops.photons);
        assert!(drops.first.len() == 16 && drops.first.iter().all(|d| d.pixel[0] < 24 && d.pixel[1] < 18), "{guide:?}");
        assert!(sound(&outcome.field), "{guide:?}");
        let counted = outcome.evidence.counted.iter().flatten().flat_map(|tree| tree.map(8));
        assert!(counted.into_iter().all(|d| d.is_finite()), "{guide:?}");
        assert!(statistics.iterations.iter().all(|i| i.mean_variance.is_finite() || i.spp < 2), "{guide:?}");
    }
}

/// In pictures by complete paths a pixel has a sample less for each that was dropped, with all that guided paths have brought to it, and causes
/// are told.
#[test]
fn a09_complete_paths_leave_broken_samples_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut b = room([24, 18], 10.0);
    // Caustics are what is kept.
    let clear = b.add_material("glass", glass(1.5));
    b.add_sphere("ball", Vec3::new(0.3, -0.6, 0.3), 0.25, &clear, None);
    let scene = scene_in(folder.path(), with_screen(b, folder.path()));
    let guide = (GuideMode::Paths, SampleKinds::Path, Target::Variance);
    let mut settings = RenderSettings { paths_share: 0.75, keeps_spread: true, ..settings(guide, 320, 1) };
    settings.transport.max_depth = 6;
    let outcome = rendered(&scene, &settings);
    let (statistics, spread) = (&outcome.statistics, outcome.spread.unwrap());
    assert!(statistics.guide.paths > 0, "nothing was kept: {:?}", statistics.decisions);
    assert!(outcome.image.pixels.iter().all(|p| p.is_finite()));
    // Some pixel has the samples of all rounds.
    let rounds = spread.samples.iter().copied().max().unwrap();
    let missing: u64 = spread.samples.iter().map(|&samples| u64::from(rounds - samples)).sum();
    assert!(missing > 100 && missing == statistics.dropped_samples, "{missing} of {}", statistics.dropped_samples);
    let drops = &statistics.dropped;
    assert_eq!(drops.causes.iter().sum::<u64>(), missing);
    assert!(drops.first.len() == 16 && drops.first.iter().any(|d| d.cause == Cause::DirectLight), "{:?}", drops.first);
}

/// Where every sample is dropped, guides learn nothing: not even that somebody was there.
#[test]
fn a09_dropped_samples_are_not_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let texture = |file: String, scale: f32| TextureFile::Bitmap {
        file,
        to_uv: identity3(),
        raw: true,
        scale,
        wrap: Wrap::Repeat,
        filter: Filter::Nearest,
    };
    let voxels = |scale: f32| {
        let mut b = Builder::new("screen", [8, 6]);
        let reflectance = texture(blazing(folder.path()), scale);
        let broken = b.add_material("broken", MaterialFile::Diffuse { reflectance });
        b.add_quad("screen", Vec3::ZERO, [Vec3::X * 10.0, Vec3::Y * 10.0], &broken, None);
        b.add_light(LightFile::Constant { radiance: [1.0; 3] });
        b.look_at(Vec3::Z * 2.0, Vec3::ZERO, Vec3::Y, 40.0);
        let statistics = rendered(&scene_in(folder.path(), b.finish()), &settings(GUIDES[4], 16, 1)).statistics;
        (statistics.dropped_samples > 0, statistics.iterations.iter().map(|i| i.voxels).max())
    };
    assert_eq!(voxels(4.0), (true, Some(0)));
    // The same screen with a sound texture is learned from.
    let (dropped, found) = voxels(1e-39);
    assert!(!dropped && found > Some(0), "{found:?}");
}

/// What is dropped, and what is told of it, does not depend on the number of threads.
#[test]
fn a09_drops_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene_in(folder.path(), broken_screen(folder.path()));
    let drops = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| rendered(&scene, &settings(GUIDES[1], 64, 1))).statistics.dropped
    };
    assert_eq!(drops(1), drops(3));
}

/// The scene's first dropped sample is traced again and says why it was dropped; so is what only some paths meet.
fn traced(scene: &Scene, settings: &RenderSettings, cause: Cause) {
    let outcome = rendered(scene, settings);
    assert!(!outcome.statistics.dropped.first.is_empty(), "{cause:?}: nothing was dropped");
    for dropped in &outcome.statistics.dropped.first {
        let sample = Sample { pixel: dropped.pixel, number: dropped.sample, pass_from: dropped.pass_from };
        let stop = AtomicBool::new(false);
        let found = replay(scene, settings, None, sample, &Control::new(&Silent, &stop)).unwrap();
        assert!(!found.radiance.is_finite(), "{dropped:?}: the sample is finite");
        assert_eq!((found.cause, dropped.cause), (Some(cause), cause));
    }
}

/// Lamps that each have nearly as much power as a single can hold, eight of them: as a photon stands for all, it would
/// have more. Every one is counted, and none reaches a tree.
#[test]
fn a09_photons_without_finite_power_are_counted() {
    let mut b = room([24, 18], 8e37);
    let black = b.add_material("black", MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.0; 3]) });
    for i in 1..8 {
        let below = Vec3::new(0.3, 0.5 - 0.05 * i as f32, 0.3);
        b.add_quad("lamp", below, [Vec3::X * 0.3, Vec3::Z * 0.3], &black, Some([8e37; 3]));
    }
    let mut settings = settings(GUIDES[2], 16, 1);
    settings.transport.light_sampling = false;
    let outcome = rendered(&built(b.finish()), &settings);
    let drops = &outcome.statistics.dropped;
    // The first iteration has as many photons as pixels.
    assert!(drops.photons >= 24 * 18, "{} photons", drops.photons);
    assert!(outcome.field.voxels().iter().all(|voxel| voxel.directions.is_none()), "something was learned");
    assert!(outcome.image.pixels.iter().all(|p| p.is_finite()));
}

#[test]
fn a09_causes_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let settings = |light_sampling: bool| {
        let mut settings = settings(GUIDES[0], 16, 1);
        settings.transport.light_sampling = light_sampling;
        settings
    };
    let screen = scene_in(folder.path(), broken_screen(folder.path()));
    traced(&screen, &settings(false), Cause::Bsdf);
    traced(&screen, &settings(true), Cause::DirectLight);
    let sky = |scale: f32| {
        let mut b = Builder::new("sky", [8, 6]);
        b.add_light(LightFile::Envmap { file: blazing(folder.path()), scale, to_world: matrix(Mat4::IDENTITY) });
        b.finish()
    };
    traced(&scene_in(folder.path(), sky(4.0)), &settings(false), Cause::Background);
    let room = || room([8, 6], 10.0).finish();
    let with = |file: SceneFile, put: fn(&mut SceneFile)| scene_with(folder.path(), file, put);
    traced(&with(sky(1e-38), |file| file.camera.fov = f32::NAN), &settings(false), Cause::Camera);
    let shining = with(room(), |file| file.shapes[2].emission = Some([f32::INFINITY; 3]));
    traced(&shining, &settings(false), Cause::Emission);
    let foggy = with(room(), |file| {
        let fog = MediumFile::Homogeneous { sigma_t: [f32::NAN; 3], albedo: [0.0; 3], g: 0.0 };
        file.media.insert("fog".into(), fog);
        file.camera.medium = Some("fog".into());
    });
    traced(&foggy, &settings(false), Cause::Transmittance);
    // Walls that shine and reflect nearly all: each number is finite, their sum is not.
    let mut b = Builder::new("box", [8, 6]);
    let wall = b.add_material("wall", diffuse([0.9; 3]));
    b.add_block("box", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.look_at(Vec3::ZERO, Vec3::X, Vec3::Y, 60.0);
    let mut file = b.finish();
    (file.shapes[0].emission, file.shapes[0].flip_normals) = (Some([3e38; 3]), true);
    traced(&scene_in(folder.path(), file), &settings(false), Cause::Overflow);
    // BSDF and guide whose parts of the density have no sum.
    let (scene, settings) = (built(room()), settings(false));
    let mut cache = SpatialCache::new(Vec3::splat(-5.0), 10.0).without_facing();
    cache.find_or_insert(Vec3::ZERO, Vec3::Y);
    let tree = SamplingTree::new(&Distribution::uniform(), 0.1, usize::MAX);
    let (parallax, bsdf_fraction, roulette) = (Parallax::NONE, f32::INFINITY, AdjointRoulette::UNKNOWN);
    let field =
        GuideField::new(cache, vec![VoxelGuide { directions: Some(tree.into()), parallax, bsdf_fraction, roulette }]);
    let transport = settings.transport;
    let tracer = PathTracer { scene: &scene, settings: transport, field: Some(&field), lights: LightSampling::Plain };
    let ray = || scene.camera.ray([4.0, 3.0], [0.5; 2]);
    let paths = (0..100).map(|i| tracer.explain(CameraPath { ray: ray(), random: Random::new(1, 0, i), pixel: None }));
    let causes: Vec<Option<Cause>> = paths.filter(|path| !path.radiance.is_finite()).map(|path| path.cause).collect();
    assert!(causes.len() > 20 && causes.iter().all(|cause| *cause == Some(Cause::Pdf)), "{causes:?}");
}

/// Samples that are traced again are those of the picture: their mean is the pixel's value, up to the rounding of single
/// precision. Plain, in a window, with independent numbers, and guided by a field that was there before.
#[test]
fn a09_replayed_samples_are_those_of_the_picture() {
    let scene = built(room([24, 18], 10.0).finish());
    let stop = AtomicBool::new(false);
    let control = Control::new(&Silent, &stop);
    let mean = |settings: &RenderSettings, field: Option<&GuideField>, pixel: [u32; 2], samples: &[(u64, u32)]| {
        let one = |&(number, from): &(u64, u32)| {
            let sample = Sample { pixel, number, pass_from: Some(from) };
            replay(&scene, settings, field.cloned(), sample, &control).unwrap().radiance.as_dvec3()
        };
        samples.iter().map(one).sum::<glam::DVec3>() / samples.len() as f64
    };
    let close = |found: glam::DVec3, expected: Vec3| (found.as_vec3() - expected).length() < 1e-5 * expected.length();
    let plain = settings(GUIDES[0], 8, 3);
    let samples: Vec<_> = (0..8).map(|number| (number, 0)).collect();
    let image = rendered(&scene, &plain).image;
    for pixel in [[0, 0], [12, 9], [23, 17]] {
        let expected = image.pixels[(pixel[1] * 24 + pixel[0]) as usize];
        assert!(expected.max_element() > 0.0 && close(mean(&plain, None, pixel, &samples), expected), "{pixel:?}");
    }
    let window = RenderSettings { crop: Some(Window { x: 12, y: 9, width: 2, height: 2 }), ..plain };
    let image = rendered(&scene, &window).image;
    assert!(close(mean(&window, None, [13, 9], &samples), image.pixels[1]));

    // Of 16 samples one is a first look, by which the others' roulette goes: it is none of the picture's. A guide that knows the
    // picture needs none.
    let learned = rendered(&scene, &settings(GUIDES[1], 64, 1)).field;
    assert!(learned.voxels().iter().any(|v| v.directions.is_some()));
    let guided = settings(GUIDES[1], 16, 5);
    let values: Vec<f32> = (0..24 * 18).map(|i| 0.5 + (i % 7) as f32).collect();
    let known = PixelValues { of: "it".into(), window: Window::whole([24, 18]), values };
    let knows = learned.clone().with_pixel_values(Some(known));
    for (field, first) in [(&learned, 1), (&knows, 0)] {
        let image = render_with_field(&scene, &guided, field.clone(), &control).unwrap().image;
        let samples: Vec<_> = (u64::from(first)..16).map(|number| (number, first)).collect();
        for pixel in [[12, 9], [3, 4]] {
            let expected = image.pixels[(pixel[1] * 24 + pixel[0]) as usize];
            assert!(close(mean(&guided, Some(field), pixel, &samples), expected), "{pixel:?} from {first}");
        }
    }
}

#[test]
fn a09_the_program_tells_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.json");
    save(&broken_screen(folder.path()), &scene).unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (scene, out, stats) = (scene.display().to_string(), file("out.exr"), file("stats.json"));
    let run = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    run(&["render", &scene, "-o", &out, "--guide", "none", "--spp", "16", "--seed", "9", "--stats", &stats, "--quiet"]);
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
    let causes: BTreeMap<String, u64> = serde_json::from_value(json["dropped"]["causes"].clone()).unwrap();
    assert_eq!(Some(causes.values().sum::<u64>()), json["dropped_samples"].as_u64());
    let first = json["dropped"]["first"][0]["replay"].as_str().unwrap();
    let told = run(&["render", &scene, "--guide", "none", "--seed", "9", "--replay", first, "--quiet"]);
    for words in ["vertex 1: at (", "material \"broken\"", "NOT FINITE: direct_light", "not finite: direct_light"] {
        assert!(told.contains(words), "{words:?} is missing in:\n{told}");
    }
    let header = exr::meta::MetaData::read_from_file(&out, false).unwrap().headers.remove(0);
    let text = format!("{:?}", header.own_attributes.other);
    for (cause, count) in &causes {
        assert!(text.contains("droppedCauses") && text.contains(&format!("{cause} {count}")), "{causes:?}: {text}");
    }
    let learned = ["render", &scene, "--guide", "hybrid", "--replay", "1,1,0"];
    let output = Command::new(env!("CARGO_BIN_EXE_fanal")).args(learned).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("--load-guide"));
}
