//! Several views in one run of the program: their files, what is refused, and what goes on after an interruption.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fanal::picture::{Image, read_image};
use serde_json::{Value, json};
use tempfile::TempDir;

fn fanal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().expect("the program was built for this test")
}

/// `scenes/cornell` with further cameras: the default one moved, and some with names that no file should have.
fn scene(folder: &TempDir, names: &[&str]) -> String {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    for file in std::fs::read_dir(&source).unwrap() {
        let file = file.unwrap();
        if file.file_type().unwrap().is_file() {
            std::fs::copy(file.path(), folder.path().join(file.file_name())).unwrap();
        }
    }
    let path = folder.path().join("scene.json");
    let mut json: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for (index, name) in names.iter().enumerate() {
        let mut camera = json["camera"].clone();
        let x = camera["to_world"][3].as_f64().unwrap();
        camera["to_world"][3] = json!(x + 0.05 * (index + 1) as f64);
        json["cameras"][*name] = camera;
    }
    std::fs::write(&path, json.to_string()).unwrap();
    path.display().to_string()
}

fn works(arguments: &[&str]) -> String {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(result.status.success(), "{arguments:?}: {told}");
    String::from_utf8_lossy(&result.stdout).into_owned()
}

fn refused(arguments: &[&str], words: &[&str]) {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(!result.status.success() && !told.contains("panicked"), "{arguments:?}: {told}");
    assert!(words.iter().all(|word| told.contains(word)), "{arguments:?}: {told}");
}

fn image(path: &Path) -> Image {
    read_image(path, false).unwrap_or_else(|error| panic!("{error}"))
}

/// Each view of `--camera all` has its file, with the picture that `--camera NAME` gives; the statistics name them.
#[test]
fn every_camera_has_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(&folder, &["door", "from above"]);
    let file = |name: &str| folder.path().join(name);
    let (out, stats) = (file("out.exr").display().to_string(), file("stats.json").display().to_string());
    let common = ["render", &scene, "-o", &out, "--size", "20x15", "--spp", "4", "--guide", "none", "--quiet"];
    works(&[&common[..], &["--camera", "all", "--aov", "depth", "--stats", &stats]].concat());
    let views = ["out.default.exr", "out.door.exr", "out.from_above.exr"].map(|name| image(&file(name)));
    assert!(!file("out.exr").exists() && views[0] != views[1] && views[1] != views[2]);
    let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert_eq!(
        (&stats["views"], &stats["width"], &stats["height"]),
        (&json!(["default", "door", "from above"]), &json!(20), &json!(15))
    );
    let (width, height, channels) = fanal::picture::read_exr_channels(&file("out.door.exr")).unwrap();
    assert_eq!((width, height, channels.len(), channels[3].1.len()), (20, 15, 4, 300));
    works(&common);
    assert!(image(&file("out.exr")) == views[0]);
    for (name, view) in ["default", "door", "from above"].into_iter().zip(&views) {
        works(&[&common[..], &["--camera", name]].concat());
        assert!(image(&file("out.exr")) == *view, "{name}");
    }
    let depth = fanal::picture::read_exr_channels(&file("out.door.exr")).unwrap().2;
    works(&[&common[..], &["--camera", "door", "--aov", "depth"]].concat());
    assert!(fanal::picture::read_exr_channels(&file("out.exr")).unwrap().2 == depth);
    let plan = works(&["plan", &scene]);
    assert!(plan.contains("cam  default ") && plan.contains("cam  from above "), "{plan}");
    let plan: Value = serde_json::from_str(&works(&["plan", &scene, "--json"])).unwrap();
    assert_eq!(plan["cameras"], json!(["default", "door", "from above"]));
}

/// Names of cameras are not paths.
#[test]
fn hostile_names_stay_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["../../up", "/abs/olute", "a/b", "a:b", "a\u{0}b", "", "..", "A_b"];
    let names: Vec<&str> = names.into_iter().filter(|name| !name.is_empty()).collect();
    let scene = scene(&folder, &names);
    std::fs::create_dir_all(folder.path().join("deep/er")).unwrap();
    let out = folder.path().join("deep/er/out.png").display().to_string();
    let all =
        |path: &Path| -> BTreeSet<PathBuf> { std::fs::read_dir(path).unwrap().map(|f| f.unwrap().path()).collect() };
    let before = [folder.path().to_owned(), folder.path().join("deep")].map(|path| all(&path));
    works(&[
        "render", &scene, "-o", &out, "--size", "8x6", "--spp", "1", "--guide", "none", "--quiet", "--camera", "all",
    ]);
    assert_eq!([folder.path().to_owned(), folder.path().join("deep")].map(|path| all(&path)), before);
    assert_eq!(all(&folder.path().join("deep/er")).len(), 1 + names.len());
}

#[test]
fn wrong_views_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(&folder, &["door", "window"]);
    let out = folder.path().join("out.exr").display().to_string();
    let common = ["render", &scene, "-o", &out, "--size", "8x6", "--spp", "1", "--guide", "none", "--quiet"];
    for (options, words) in [
        (&["--camera", "dorr"][..], &["\"dorr\"", "\"default\"", "\"window\"", "is \"door\" meant?"][..]),
        (&["--camera", "door,lantern"], &["\"lantern\""]),
        (&["--camera", "all", "--crop", "0,0,2,2"], &["--crop", "--camera NAME"]),
        (&["--camera", "all", "--reference", &out], &["--reference", "--camera NAME"]),
        (&["--camera", "all", "--replay", "0,0,0"], &["--replay", "--camera NAME"]),
        (&["--camera", "all", "--orbit", "4"], &["--orbit", "--camera NAME"]),
        (&["--orbit", "4", "--around", "1e20,0,0"], &["--around"]),
        (&["--orbit", "0"], &["--orbit"]),
        (&["--around", "0,0,0"], &["--orbit"]),
    ] {
        refused(&[&common[..], options].concat(), words);
    }
    let huge = ["render", &scene, "-o", &out, "--size", "16000x8000", "--camera", "all"];
    refused(&huge, &["3 pictures of 16000x8000"]);
    // Pictures of different sizes need one for all.
    let path = folder.path().join("scene.json");
    let mut json: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    json["cameras"]["door"]["size"] = json!([9, 7]);
    std::fs::write(&path, json.to_string()).unwrap();
    let unsized_options = ["render", &scene, "-o", &out, "--spp", "1", "--guide", "none", "--quiet", "--camera"];
    refused(&[&unsized_options[..], &["all"]].concat(), &["\"door\" has 9x7", "--size"]);
    assert_eq!(
        std::fs::read_dir(folder.path())
            .unwrap()
            .filter(|f| f.as_ref().unwrap().path().extension() == Some("exr".as_ref()))
            .count(),
        0
    );
    works(&[&unsized_options[..], &["door"]].concat());
    assert_eq!((image(Path::new(&out)).width, image(Path::new(&out)).height), (9, 7));
    works(&[&common[..], &["--camera", "all"]].concat());
}

/// A turntable with one guide: it is saved, loaded, and its checkpoint goes on.
#[test]
fn turntables_share_a_guide() {
    let folder = tempfile::tempdir().unwrap();
    let door = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/door-ajar").display().to_string();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (out, guide, stats, part) = (file("turn.exr"), file("turn.guide"), file("stats.json"), file("turn.part"));
    let common = [
        "render",
        &door,
        "-o",
        &out,
        "--size",
        "24x18",
        "--spp",
        "32",
        "--guide",
        "gaussian",
        "--quiet",
        "--around",
        "1.1,1.3,3",
        "--orbit",
        "3",
    ];
    let pictures = || ["turn.000.exr", "turn.001.exr", "turn.002.exr"].map(|name| image(&folder.path().join(name)));
    works(&[&common[..], &["--stats", &stats, "--checkpoint", &part, "--every", "1e-9"]].concat());
    let first = pictures();
    let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert_eq!(stats["views"], json!(["000", "001", "002"]));
    let iterations: Vec<u64> =
        stats["iterations"].as_array().unwrap().iter().map(|i| i["t"].as_u64().unwrap()).collect();
    assert!(
        !iterations.is_empty() && iterations.iter().copied().eq(0..iterations.len() as u64),
        "learned once: {iterations:?}"
    );
    works(&[&common[..], &["--resume", &part]].concat());
    assert!(pictures() == first, "a checkpoint goes on to the same pictures");
    refused(&[&common[..13], &["--orbit", "4", "--resume", &part]].concat(), &["turn.part", "scene"]);
    works(&[&common[..], &["--save-guide", &guide]].concat());
    assert!(pictures() == first);
    works(&[&common[..], &["--load-guide", &guide]].concat());
    assert!(pictures() != first && pictures().iter().all(|image| image.pixels.iter().any(|p| p.length() > 0.0)));
}
