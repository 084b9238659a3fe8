//! A picture is the same to the bit whatever the processor and however many threads it has.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::files::scene;
use crate::support::scenes::OURS;

use fanal::picture::read_image;
use fanal::render::GuideMode;
use rayon::prelude::*;

/// Widest vector instructions that may be used, and threads. Sixteen lanes, eight twice, one.
const WAYS: [(&str, &str); 3] = [("", "1"), ("avx2", "2"), ("portable", "7")];

/// A picture of 24 x 18 pixels.
fn render(scene: &Path, guide: &str, (lanes, threads): (&str, &str), path: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal"))
        .arg("render")
        .arg(scene)
        .arg("-o")
        .arg(path)
        .args(["--size", "24x18", "--spp", "16", "--guide", guide, "--threads", threads, "--quiet"])
        .env("FANAL_LANES", lanes)
        .output()
        .expect("the program was built for this test")
}

/// Scenes of six families of the generators, written into `folder`.
fn generated(folder: &Path) -> Vec<PathBuf> {
    let recipe = folder.join("recipe.toml");
    let families = ["primitives", "rooms", "caustics", "lamps", "corridors", "outdoors"];
    let families = families.map(|name| format!("[[family]]\nname = \"{name}\"\nscenes = 1\n")).concat();
    let head = "name = \"bits\"\nseed = 3\nheld_out = 0.0\nresolution = [24, 18]\niterations = [0]\ngrids = [8]\n\
                target_spp = 1\nmax_trees_per_scene = 1\n";
    std::fs::write(&recipe, format!("{head}{families}")).unwrap();
    let out = folder.join("generated");
    let words = ["dataset".as_ref(), recipe.as_os_str(), "--only-scenes".as_ref(), "-o".as_ref(), out.as_os_str()];
    let result = Command::new(env!("CARGO_BIN_EXE_fanal")).args(words).output().unwrap();
    assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
    let scenes: Vec<PathBuf> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
    let scenes: Vec<PathBuf> = scenes.into_iter().filter(|path| path.is_dir()).collect();
    assert_eq!(scenes.len(), 6, "{scenes:?}");
    scenes
}

/// Wider vectors and more threads change the time that a picture takes, and nothing else: on every scene of ours, on one with every
/// material and on those of the generators, in every mode.
#[test]
fn every_scene_has_the_same_bits_on_every_processor() {
    let folder = tempfile::tempdir().unwrap();
    let museum = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/museum");
    let ours = OURS.map(|name| PathBuf::from(scene(name)));
    let scenes: Vec<PathBuf> = ours.into_iter().chain([museum]).chain(generated(folder.path())).collect();
    let pairs: Vec<(usize, GuideMode)> =
        (0..scenes.len()).flat_map(|scene| GuideMode::ALL.map(|guide| (scene, guide))).collect();
    let lit: usize = pairs
        .par_iter()
        .map(|&(number, guide)| {
            let (scene, guide) = (&scenes[number], guide.name());
            let pictures = WAYS.map(|way| {
                let path = folder.path().join(format!("{number}-{guide}-{}.exr", way.1));
                let result = render(scene, guide, way, &path);
                let told = String::from_utf8_lossy(&result.stderr);
                assert!(result.status.success(), "{} by {guide}: {told}", scene.display());
                let picture = read_image(&path, false).expect("it was just written");
                picture.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>()
            });
            let [widest, others @ ..] = &pictures;
            for (other, way) in others.iter().zip(&WAYS[1..]) {
                assert!(other == widest, "{} by {guide}: other bits with {way:?}", scene.display());
            }
            widest.iter().filter(|pixel| **pixel != [0; 3]).count()
        })
        .sum();
    let pixels = pairs.len() * 24 * 18;
    assert!(lit > pixels / 2, "{lit} of {pixels} pixels are lit");
}

/// What is no instruction set is an error.
#[test]
fn unknown_vector_instructions_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let result = render(Path::new(&scene("cornell")), "none", ("sse9", "1"), &folder.path().join("out.exr"));
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(result.status.code() == Some(1) && told.contains("sse9") && told.contains("avx2"), "{told}");
}
