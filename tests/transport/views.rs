//! Several views of one scene, rendered together on a sheet.

use crate::support::{scenes, statistics};

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fanal::base::Error;
use fanal::base::progress::Silent;
use fanal::film::measure;
use fanal::picture::{Image, Window};
use fanal::render::{Outcome, RenderSettings, StopRule, render};
use fanal::scene::Scene;
use fanal::scene::file::{CameraFile, SceneFile};
use fanal::scene::orbit::{ahead, orbit};
use fanal::scene::readers::resolve;
use fanal::scene::views::choose;
use glam::Vec3;
use scenes::{GUIDES, coarse, mean, picture, reconstructor, room, settings};
use statistics::{Summary, sidak};

const SIZE: [u32; 2] = [16, 12];

/// A room with two further cameras, of which one is in the block, where there is no light.
fn file() -> SceneFile {
    let mut file = room(SIZE, 20.0).finish();
    let camera = |eye: Vec3, target: Vec3| {
        let mut b = room(SIZE, 20.0);
        b.look_at(eye, target, Vec3::Y, 70.0);
        b.finish().camera
    };
    let corner = camera(Vec3::new(-0.7, 0.6, 0.8), Vec3::new(0.4, -0.6, 0.0));
    let dark = camera(Vec3::new(-0.25, -0.5, -0.25), Vec3::new(0.0, -0.4, -0.2));
    file.cameras = BTreeMap::from([("corner".into(), corner), ("dark".into(), dark)]);
    file
}

/// The scene with the cameras that are asked for.
fn built(mut file: SceneFile, choice: Option<&str>) -> Scene {
    choose(&mut file, choice).expect("there are such cameras");
    Scene::build_views(&resolve(file, Path::new(""), Path::new("test")).expect("it is sound"), SIZE).expect("it builds")
}

fn made(scene: &Scene, settings: &RenderSettings) -> Outcome {
    let reconstructor = reconstructor(settings.guide);
    render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).expect("the settings are sound")
}

/// Every view on a sheet has the bits that it has alone, and alone it is that of a scene whose only camera is this one.
#[test]
fn views_are_what_they_are_alone() {
    let settings = settings(GUIDES[0], 24, 3);
    let sheet = made(&built(file(), Some("all")), &settings);
    let parts = sheet.image.parts(3);
    assert_eq!((sheet.statistics.spp, sheet.statistics.height), (24, SIZE[1]));
    let cameras: Vec<(String, CameraFile)> = file().views().map(|(name, c)| (name.to_owned(), c.clone())).collect();
    for ((name, camera), part) in cameras.into_iter().zip(&parts) {
        let only = SceneFile { camera, ..room(SIZE, 20.0).finish() };
        let alone = picture(&scenes::built(only), &settings);
        assert!(alone == picture(&built(file(), Some(&name)), &settings), "{name}");
        assert!(alone == *part, "{name} on the sheet");
        assert_eq!(mean(&alone) > 0.0, name != "dark");
    }
    assert!(picture(&built(file(), None), &settings) == parts[0]);
}

/// What one guide learns from all views, once, guides each of them to the same mean that it has without: Welch's test at 0.001 for all
/// views and guides. With any number of threads, and with the samples divided among all pixels of all views, too.
#[test]
fn a_shared_guide_changes_no_mean() {
    let (sheet, seeds, tail) = (built(file(), Some("all")), 24, sidak(0.001, 6));
    let means = |settings: &dyn Fn(u64) -> RenderSettings| -> [Summary; 2] {
        let pictures: Vec<Vec<Image>> = (0..seeds).map(|seed| made(&sheet, &settings(seed)).image.parts(3)).collect();
        [0, 1].map(|view| Summary::new(&pictures.iter().map(|parts| mean(&parts[view])).collect::<Vec<_>>()))
    };
    let truth = means(&|seed| settings(GUIDES[0], 384, 500 + seed));
    let adaptive = |seed| RenderSettings { adaptive: true, ..coarse(GUIDES[5], 96, seed) };
    let found =
        [means(&|seed| coarse(GUIDES[1], 96, seed)), means(&|seed| coarse(GUIDES[4], 96, seed)), means(&adaptive)];
    for (guide, found) in found.iter().enumerate() {
        for (view, (found, truth)) in found.iter().zip(&truth).enumerate() {
            assert!(found.error() < 0.02 * truth.mean, "the test could not see a bias: {found:?}");
            assert!(found.welch(truth, tail) < 1.0, "guide {guide}, view {view}: {found:?} instead of {truth:?}");
        }
    }
    let bits = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
        pool.install(|| made(&sheet, &adaptive(1))).image
    };
    let one = made(&sheet, &adaptive(1));
    assert!(one.image == bits(1) && one.image == bits(3));
    // One render's iterations, from t = 0 on, each once.
    let iterations: Vec<u32> = one.statistics.iterations.iter().map(|iteration| iteration.t).collect();
    assert!(iterations.len() > 1 && iterations.iter().copied().eq(0..iterations.len() as u32), "{iterations:?}");
    assert!(one.statistics.guide.trees > 0 && one.image.parts(3)[2].pixels.iter().all(|p| *p == Vec3::ZERO));
}

/// With a target error the noisiest view has to reach it: the others have less.
#[test]
fn every_view_reaches_the_target() {
    let (target, sheet) = (0.004, built(file(), Some("default,corner")));
    let outcome = made(&sheet, &RenderSettings { stop: StopRule::TargetError(target), ..settings(GUIDES[0], 1, 5) });
    let truth = made(&sheet, &settings(GUIDES[0], 16384, 77));
    let views = outcome.image.parts(2);
    let errors: Vec<f64> =
        views.iter().zip(truth.image.parts(2)).map(|(a, b)| measure(a, &b).unwrap().relmse).collect();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    // The error of 192 pixels with rare bright ones scatters.
    assert!((0.5..1.6).contains(&(worst / target)), "{errors:?}");
}

/// Half a turn around what the camera looks at shows its other side: a sphere that is lit from the camera's side alone is dark there.
#[test]
fn an_orbit_shows_the_other_side() {
    use fanal::generate::build::{Builder, diffuse};
    use fanal::scene::file::LightFile;
    let mut b = Builder::new("ball", SIZE);
    let white = b.add_material("white", diffuse([0.8; 3]));
    b.add_sphere("ball", Vec3::new(1.0, 0.5, 2.0), 0.7, &white, None);
    b.add_light(LightFile::Directional { direction: [0.0, 0.0, -1.0], irradiance: [3.0; 3] });
    b.look_at(Vec3::new(1.0, 1.0, 6.0), Vec3::new(1.0, 0.5, 2.0), Vec3::Y, 30.0);
    let mut loaded = resolve(b.finish(), Path::new(""), Path::new("test")).unwrap();
    let alone = picture(&Scene::build(&loaded, SIZE).unwrap(), &settings(GUIDES[0], 64, 1));
    let middle = ahead(&loaded.file.camera, loaded.bounds()).unwrap();
    assert!(middle.distance(glam::DVec3::new(1.0, 0.5, 2.0)) < 1e-5, "{middle}");
    orbit(&mut loaded.file, 4, middle).unwrap();
    let scene = Scene::build_views(&loaded, SIZE).unwrap();
    let views = made(&scene, &settings(GUIDES[0], 64, 1)).image.parts(4);
    assert!(views[0] == alone);
    let means: Vec<f64> = views.iter().map(mean).collect();
    // Half of the ball is lit as seen from the side.
    assert!(means[2] < 0.05 * means[0] && means[1] > 0.2 * means[0] && means[1] < 0.6 * means[0], "{means:?}");
    assert!((means[1] / means[3] - 1.0).abs() < 0.1, "{means:?}");
}

/// What cannot be rendered together is refused, as an error of the options.
#[test]
fn what_does_not_go_together_is_refused() {
    let refused = |result: fanal::base::Result<()>, words: &str| {
        let error = result.expect_err(words);
        assert!(matches!(error, Error::Options(_)) && error.to_string().contains(words), "{error}");
    };
    let sheet = built(file(), Some("all"));
    let rendered = |settings: &RenderSettings| {
        render(&sheet, settings, reconstructor(settings.guide).as_ref(), &Silent, &AtomicBool::new(false)).map(drop)
    };
    let crop = Some(Window { x: 0, y: 0, width: 2, height: 2 });
    refused(rendered(&RenderSettings { crop, ..settings(GUIDES[0], 1, 1) }), "one by one");
    let mut foggy = file();
    foggy.media.insert(
        "fog".into(),
        serde_json::from_str(r#"{"type": "homogeneous", "sigma_t": [1,1,1], "albedo": [1,1,1]}"#).unwrap(),
    );
    foggy.cameras.get_mut("corner").unwrap().medium = Some("fog".into());
    let foggy = resolve(foggy, Path::new(""), Path::new("test")).unwrap();
    refused(Scene::build_views(&foggy, SIZE).map(drop), "different media");
    let huge = Scene::build_views(&resolve(file(), Path::new(""), Path::new("test")).unwrap(), [8192, 8192]).unwrap();
    let settings = settings(GUIDES[0], 1, 1);
    let rendered = render(&huge, &settings, reconstructor(settings.guide).as_ref(), &Silent, &AtomicBool::new(false));
    refused(rendered.map(drop), "3 pictures of 8192x8192");
}
