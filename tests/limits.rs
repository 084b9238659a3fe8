//! What a process holds at most: while it loads a mesh of a million triangles, for pictures, while it renders and learns from ten
//! million records, and for the field that guides. The figures are in docs/stability.md.

#[path = "support/memory.rs"]
mod memory;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::film::{Block, Pass};
use fanal::generate::build::{Builder, diffuse};
use fanal::guiding::learn::fraction::FractionRule;
use fanal::guiding::sample::field::Evidence;
use fanal::guiding::sample::file::{load, save};
use fanal::lights::envmap::Envmap;
use fanal::picture::read_texels;
use fanal::render::merge::merge;
use fanal::render::part_file::{self, PartHead, Totals};
use fanal::render::{Fireflies, Outcome, PartOf, RenderSettings, Statistics, render};
use fanal::scene::Scene;
use fanal::scene::file::{MeshFile, SceneFile};
use fanal::scene::readers::resolve;
use glam::{Mat3, Vec3};
use memory::{held, peak};
use scenes::{GUIDES, built, committed, reconstructor, room, settings};

const MB: usize = 1_000_000;

/// Memory is that of the whole process: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A wavy surface of 2·(n − 1)² triangles as a PLY file.
fn waves(n: u32) -> Vec<u8> {
    let triangles = 2 * (n - 1) * (n - 1);
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n",
        n * n
    )
    .into_bytes();
    for i in 0..n * n {
        let [x, z] = [i % n, i / n].map(|k| k as f32 / (n - 1) as f32 - 0.5);
        [x, 0.01 * ((60.0 * x).sin() + (50.0 * z).cos()), z].iter().for_each(|c| out.extend(c.to_le_bytes()));
    }
    for i in (0..n * (n - 1)).filter(|i| i % n < n - 1) {
        for corners in [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]] {
            out.push(3);
            corners.iter().for_each(|c| out.extend(c.to_le_bytes()));
        }
    }
    out
}

/// The room with the mesh in it.
fn with_mesh(name: &str) -> SceneFile {
    let mut file = room([8, 6], 10.0).finish();
    file.meshes.insert(
        "waves".into(),
        MeshFile::Ply { file: name.into(), face_normals: false, flip_v: false, as_given: false },
    );
    let mut shape = file.shapes[0].clone();
    shape.geometry = serde_json::from_str("{\"type\":\"mesh\",\"mesh\":\"waves\"}").unwrap();
    file.shapes.push(shape);
    file
}

/// Most bytes per triangle while a mesh is read and its hierarchy is built, and afterwards. Measured: 316 and 91.
const LOADING: usize = 400;
const LOADED: usize = 130;

#[test]
fn limit_of_a_million_triangles() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let side = 709;
    std::fs::write(folder.path().join("waves.ply"), waves(side)).unwrap();
    let triangles = 2 * (side as usize - 1).pow(2);
    assert!(triangles > 1_000_000);
    let before = held();
    let file = with_mesh("waves.ply");
    let (scene, most) = peak(|| {
        let loaded = resolve(file, folder.path(), Path::new("scene")).unwrap();
        Scene::build(&loaded, [8, 6]).unwrap()
    });
    let kept = held() - before;
    println!("{} bytes per triangle while loading, {} afterwards", most / triangles, kept / triangles);
    assert!(most < LOADING * triangles, "{most} bytes for {triangles} triangles");
    assert!(kept < LOADED * triangles, "{kept} bytes for {triangles} triangles");
    drop(scene);
}

/// Pictures of eight and of sixteen bits a channel: their bytes, and nothing more.
const PICTURES: [(png::BitDepth, usize, f64); 2] = [(png::BitDepth::Eight, 1, 3.1), (png::BitDepth::Sixteen, 2, 6.1)];
/// What an environment map holds beside its picture.
const SKY: f64 = 12.1;

/// Bytes per pixel of a texture's picture, and of what environment sampling holds beside one.
#[test]
fn limit_of_pictures() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.png");
    let (width, height) = (1024usize, 512usize);
    let mut random = Random::new(61, 0, 0);
    let per_pixel = |bytes: usize| bytes as f64 / (width * height) as f64;
    for (depth, bytes, most) in PICTURES {
        let samples: Vec<u8> = (0..4 * bytes * width * height).map(|_| random.below(256) as u8).collect();
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(&samples).unwrap();
        // A first picture makes the tables that all share.
        drop(read_texels(&path, false).unwrap());
        let before = held();
        let texels = read_texels(&path, false).unwrap();
        let picture = per_pixel(held() - before);
        let before = held();
        let sky = Envmap::new(texels.clone(), 1.0, Mat3::IDENTITY);
        let beside = per_pixel(held() - before);
        println!("{picture} bytes per pixel, {beside} of a sky beside its picture");
        assert!(picture < most && beside < SKY, "{picture} and {beside}");
        drop((texels, sky));
    }
}

fn run(scene: &Scene, settings: &RenderSettings) -> (Outcome, usize) {
    let reconstructor = reconstructor(settings.guide);
    let (outcome, most) =
        peak(|| render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).unwrap());
    (outcome, most)
}

/// What a render with a guide holds at most for a small picture: the records of one chunk of 2^18 paths of at most 20 bounces each, and
/// as much again to sort them. Measured: 532 MB.
const RENDERING: usize = 800 * MB;

/// A white box, where paths have a dozen vertices, each of which leaves a record: ten million of them and more, of which at most a chunk
/// is held.
#[test]
fn limit_of_ten_million_records() {
    let _alone = alone();
    let mut b = Builder::new("white", [256, 192]);
    let wall = b.add_material("wall", diffuse([0.9; 3]));
    b.add_block("room", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.add_quad("lamp", Vec3::new(0.3, 0.9, 0.3), [Vec3::X * 0.1, Vec3::Z * 0.1], &wall, Some([10.0; 3]));
    b.look_at(Vec3::new(0.5, 0.4, 0.9), Vec3::new(-0.2, -0.5, 0.0), Vec3::Y, 70.0);
    let scene = built(b.finish());
    let mut settings = settings(GUIDES[4], 128, 1);
    settings.transport.light_sampling = false;
    let (outcome, most) = run(&scene, &settings);
    let Statistics { camera_rays, samples, iterations, .. } = &outcome.statistics;
    // Without shadow rays every ray of a path but the last begins at a record.
    let per_path = *camera_rays as f64 / *samples as f64 - 1.0;
    // The first two iterations do not visit all pixels.
    let learned: u32 = iterations.iter().skip(2).map(|iteration| iteration.spp).sum();
    let records = per_path * f64::from(learned) * (256.0 * 192.0);
    println!("{most} bytes at most, {records:e} records, {} bytes of field", outcome.field.bytes());
    assert!(records > 1e7, "{records} records only");
    assert!(most < RENDERING, "{most} bytes");
}

/// Most bytes that samples by brightness take for each pixel without a guide: in the two halves of a pass, and in the sum of blocks. The resident set
/// grows by 150.
const BY_BRIGHTNESS: usize = 400;

/// Of a picture of 200,000 pixels with 70 samples each, in two blocks.
#[test]
fn limit_of_samples_by_brightness() {
    let _alone = alone();
    let scene = committed("glass-caustic", [512, 384]);
    let mut kept = settings(GUIDES[0], 70, 1);
    // What is held does not know how long paths were.
    kept.transport.max_depth = 2;
    let reweighted = RenderSettings { fireflies: Fireflies::Reweight { kappa: Fireflies::KAPPA }, ..kept.clone() };
    let [without, with] = [&kept, &reweighted].map(|settings| run(&scene, settings).1);
    let each = with.saturating_sub(without) / (512 * 384);
    println!("{each} bytes per pixel: {with} instead of {without} at most");
    assert!(each > 0 && each < BY_BRIGHTNESS, "{each} bytes per pixel");
}

/// The field stays within what `--guide-memory` allows, 24 MB where nothing is said.
#[test]
fn limit_of_the_field() {
    let _alone = alone();
    let scene = committed("door-ajar", [160, 120]);
    for (guide, memory) in [GUIDES[5], GUIDES[8], GUIDES[9], GUIDES[10]]
        .into_iter()
        .flat_map(|guide| [24 * MB, MB].map(|memory| (guide, memory)))
    {
        let mut settings = settings(guide, 48, 1);
        settings.learner.memory = memory;
        let (outcome, _) = run(&scene, &settings);
        println!("{} of {memory}", outcome.field.bytes());
        assert!(outcome.field.bytes() <= memory, "{} bytes of {memory}", outcome.field.bytes());
    }
}

/// A field with cells a quarter as wide as usual, some 20,000, whose trees want twice what 24 MB allow and are cut to
/// that: what is left over is less than a node for each tree.
#[test]
fn limit_of_a_full_field() {
    let _alone = alone();
    let scene = built(room([160, 120], 10.0).finish());
    let mut settings = settings(GUIDES[1], 24, 1);
    settings.learner.memory = 24 * MB;
    // No voxel is without its tree because the BSDF is better there.
    (settings.learner.resolution, settings.learner.fraction) = (96.0, FractionRule::Half);
    let (outcome, most) = run(&scene, &settings);
    let (bytes, guide) = (outcome.field.bytes(), outcome.statistics.guide);
    println!("{bytes} bytes, {guide:?}; {most} bytes at most in all");
    assert!(bytes <= 24 * MB, "{bytes} bytes");
    assert!(bytes > 22 * MB && guide.trees > 10_000, "{bytes} bytes do not reach the ceiling: {guide:?}");
    let file = tempfile::NamedTempFile::new().unwrap();
    save(file.path(), &outcome.field, &Evidence::default()).unwrap();
    assert_eq!(load(file.path()).unwrap().0.bytes(), bytes, "what was cut can be read");
}

/// Of parts only stripes are held beside the sum, however many they are and however large: eight take no more than two.
#[test]
fn parts_are_put_together_in_stripes() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let size = [1024u32, 512];
    let pixels = (size[0] * size[1]) as usize;
    let mut pass = Pass::new(size[0] as usize, size[1] as usize);
    (0..pixels).for_each(|pixel| pass.add(pixel, 0, Vec3::splat(pixel as f32)));
    let block = [Block::of(&pass, false)];
    drop(pass);
    let parts = |count: u32| -> Vec<PathBuf> {
        let part = |index: u32| {
            let path = folder.path().join(format!("{index}-{count}.part"));
            let head = PartHead {
                part: PartOf::new(index, count).unwrap(),
                merged: 0,
                in_common: "a picture".into(),
                size,
                window: [0, 0, size[0], size[1]],
                samples: 64 * count,
                spp: 64 * count,
                detailed: false,
                film_layers: [false; 2],
                fireflies: None,
                channels: Vec::new(),
                attributes: Vec::new(),
                layer_attributes: Vec::new(),
                totals: Totals::default(),
            };
            part_file::write(&path, &head, &block, None, &[]).unwrap();
            path
        };
        (1..=count).map(part).collect()
    };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let took = |count: u32| {
        let parts = parts(count);
        let (merged, most) = one_thread.install(|| peak(|| merge(&parts, false, &Silent).unwrap()));
        assert_eq!(merged.image.pixels[pixels - 1].x, (pixels - 1) as f32);
        most
    };
    let [two, eight] = [2, 8].map(took);
    println!("2 parts: {} MB, 8 parts: {} MB", two / MB, eight / MB);
    assert!(eight < 60 * pixels + 32 * MB && eight < two + MB, "{two} and {eight} bytes");
}
