//! Small scenes and renders for tests of light transport.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::generate::build::{Builder, diffuse};
use fanal::guiding::target::Target;
use fanal::picture::Image;
use fanal::reconstruct::Reconstructor;
use fanal::reconstruct::buckets::Buckets;
use fanal::render::{GuideMode, Outcome, RenderSettings, SampleKinds, StopRule, render};
use fanal::scene::Scene;
use fanal::scene::file::{MaterialFile, SceneFile, TextureFile};
use fanal::scene::readers::{LoadedScene, load, resolve};
use glam::Vec3;

/// Every committed scene of ours.
pub const OURS: [&str; 10] = [
    "blinds",
    "cornell",
    "door-ajar",
    "glass-caustic",
    "lamp-room",
    "pinhole",
    "smoke",
    "spot",
    "starfield",
    "white-furnace",
];

/// A mode that directions are sampled in.
pub type Guide = (GuideMode, SampleKinds, Target);

/// Every mode, photons alone, and the target that knows the picture.
pub const GUIDES: [Guide; 11] = [
    (GuideMode::None, SampleKinds::Both, Target::Variance),
    (GuideMode::Hybrid, SampleKinds::Both, Target::Variance),
    (GuideMode::Hybrid, SampleKinds::Photon, Target::Variance),
    (GuideMode::Ppg, SampleKinds::Path, Target::Radiance),
    (GuideMode::Variance, SampleKinds::Path, Target::Variance),
    (GuideMode::Gaussian, SampleKinds::Both, Target::Variance),
    (GuideMode::Neural, SampleKinds::Both, Target::Variance),
    (GuideMode::Variance, SampleKinds::Path, Target::VariancePixel),
    (GuideMode::Jensen, SampleKinds::Photon, Target::Radiance),
    (GuideMode::Vmf, SampleKinds::Path, Target::Radiance),
    (GuideMode::Gmm, SampleKinds::Both, Target::Radiance),
];

/// Nilsson 2022 and Zhu 2021 with all that is around their models. The latter finds by chance alone what others find by light sampling.
pub const NILSSON: Guide = (GuideMode::Nilsson, SampleKinds::Path, Target::VariancePixel);
pub const ZHU: Guide = (GuideMode::Zhu, SampleKinds::Both, Target::Variance);

/// Guided even where that does not pay: these scenes are small and easy.
pub fn settings((guide, samples, target): Guide, spp: u32, seed: u64) -> RenderSettings {
    let mut settings =
        RenderSettings { samples, seed, gives_up: false, ..RenderSettings::new(guide, StopRule::Spp(spp)) };
    settings.learner.target = target;
    settings
}

/// The same with voxels three times as wide as usual: the few thousand paths of a small picture then fill them as those of a large one
/// fill the usual ones, where they would else make thousands of trees of a handful of samples each.
pub fn coarse(guide: Guide, spp: u32, seed: u64) -> RenderSettings {
    let mut settings = settings(guide, spp, seed);
    // Müller's grid begins with one.
    if !guide.0.has_one_tree() {
        settings.learner.resolution = 8.0;
    }
    settings
}

/// What each mode reconstructs with.
pub fn reconstructor(guide: GuideMode) -> Box<dyn Reconstructor> {
    let settings = RenderSettings::new(guide, StopRule::Spp(1));
    let network = settings.reconstruction.reconstructor(|| Ok(Box::new(Buckets::built_in(&settings.mode())?)));
    network.expect("the model fits the program")
}

pub fn picture(scene: &Scene, settings: &RenderSettings) -> Image {
    outcome(scene, settings).image
}

/// All that the render of a picture comes to.
pub fn outcome(scene: &Scene, settings: &RenderSettings) -> Outcome {
    let reconstructor = reconstructor(settings.guide);
    let outcome = render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false));
    outcome.expect("the settings are sound")
}

/// Mean over pixels and channels.
pub fn mean(image: &Image) -> f64 {
    image.pixels.iter().map(|p| f64::from(p.element_sum()) / 3.0).sum::<f64>() / image.pixels.len() as f64
}

/// A diffuse material that is black at the back.
pub fn one_sided(albedo: f32) -> MaterialFile {
    MaterialFile::Diffuse { reflectance: TextureFile::rgb([albedo; 3]) }
}

/// Builds a scene that was made up here.
pub fn built(file: SceneFile) -> Scene {
    built_with(file, |_| ())
}

/// The same with something added that else only files hold.
pub fn built_with(file: SceneFile, add: impl FnOnce(&mut LoadedScene)) -> Scene {
    let size = [file.film.width, file.film.height];
    let mut loaded = resolve(file, Path::new(""), Path::new("test")).expect("the scene is sound");
    add(&mut loaded);
    Scene::build(&loaded, size).expect("names resolve")
}

/// A scene of `scenes/`.
pub fn committed(name: &str, size: [u32; 2]) -> Scene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    Scene::build(&load(&folder).expect("a committed scene loads"), size).expect("a committed scene builds")
}

/// A floor of albedo 1/2 in y = 0, of half width `half`, seen from above in a small part around the origin.
pub fn floor(size: [u32; 2], half: f32) -> Builder {
    let mut b = Builder::new("floor", size);
    let grey = b.add_material("grey", one_sided(0.5));
    b.add_quad("floor", Vec3::ZERO, [Vec3::Z * half, Vec3::X * half], &grey, None);
    b.look_at(Vec3::new(0.6, 0.8, 0.0), Vec3::ZERO, Vec3::Z, 0.5);
    b
}

/// Inside a closed box whose walls reflect `albedo` and emit radiance 1.
pub fn box_furnace(albedo: f32) -> SceneFile {
    let mut b = Builder::new("box furnace", [8, 8]);
    let wall = b.add_material("wall", diffuse([albedo; 3]));
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for (i, n) in axes.into_iter().flat_map(|n| [n, -n]).enumerate() {
        let u = axes[(i / 2 + 1) % 3];
        // A wall at −n faces n = u × v.
        b.add_quad("wall", -n, [u, n.cross(u)], &wall, Some([1.0; 3]));
    }
    b.look_at(Vec3::new(0.3, 0.1, -0.4), Vec3::new(-0.2, 0.3, 1.0), Vec3::Y, 80.0);
    b.finish()
}

/// A block on a floor under a square lamp of radiance `emission`.
pub fn room(size: [u32; 2], emission: f32) -> Builder {
    let mut b = Builder::new("room", size);
    let wall = b.add_material("wall", diffuse([0.6, 0.5, 0.4]));
    b.add_block("room", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.add_block("block", Vec3::new(-0.5, -0.99, -0.5), Vec3::new(0.0, 0.0, 0.0), &wall);
    b.add_quad("lamp", Vec3::new(0.3, 0.5, 0.3), [Vec3::X * 0.3, Vec3::Z * 0.3], &wall, Some([emission; 3]));
    b.look_at(Vec3::new(0.5, 0.4, 0.9), Vec3::new(-0.2, -0.5, 0.0), Vec3::Y, 70.0);
    b
}
