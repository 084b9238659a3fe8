//! `fanal render --denoise` from outside. What needs the library is checked where `OIDN_DYLIB_PATH` names it.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use fanal::film::{Denoiser, measure_noisy};
use fanal::picture::{Image, read_exr_channels, read_image, write_png};
use fanal::render::{GuideMode, RenderSettings, StopRule, features};
use fanal::report::Results;
use fanal::scene::Scene;
use fanal::scene::readers::load;
use glam::Vec3;

/// Runs `fanal render scenes/cornell -o output`, with the library at `library`, or else with that of the environment.
fn render(output: &Path, options: &[&str], library: Option<&Path>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
    command.arg("render").arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell")).arg("-o").arg(output);
    command.args(["--size", "48x40", "--guide", "none", "--quiet"]).args(options);
    if let Some(library) = library {
        command.env("OIDN_DYLIB_PATH", library);
    }
    command.output().expect("the program was built for this test")
}

fn is_there() -> bool {
    let there = std::env::var_os("OIDN_DYLIB_PATH").is_some_and(|path| !path.is_empty());
    if !there {
        eprintln!("skipped: OIDN_DYLIB_PATH is not set; tests/fetch-oidn.sh prints its value");
    }
    there
}

/// The render would take days, so the error comes before it.
#[test]
fn without_its_library_nothing_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    let library = folder.path().join("no-library.so");
    let result = render(&out, &["--spp", "16777216", "--denoise"], Some(&library));
    let told = String::from_utf8_lossy(&result.stderr);
    assert_eq!(result.status.code(), Some(1), "{told}");
    for word in ["Open Image Denoise 2", "OIDN_DYLIB_PATH", "pyoidn", "no-library.so"] {
        assert!(told.contains(word), "{told}");
    }
    assert!(!out.exists() && !told.contains("panicked"), "{told}");
}

fn channels(path: &Path) -> BTreeMap<String, Vec<f32>> {
    read_exr_channels(path).unwrap().2.into_iter().collect()
}

/// The header's text of this name.
fn attribute(path: &Path, name: &str) -> Option<String> {
    use exr::meta::attribute::AttributeValue;
    let header = exr::meta::MetaData::read_from_file(path, false).unwrap().headers.remove(0).own_attributes;
    let mut texts = header.other.into_iter().map(|(key, value)| (key.to_string(), value));
    let found = texts.find(|(key, _)| key == name);
    found.map(|(_, value)| if let AttributeValue::Text(text) = value { text.to_string() } else { String::new() })
}

#[test]
fn both_pictures_are_kept() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let made = |name: &str, options: &[&str]| {
        let result = render(&file(name), &[&["--spp", "4"][..], options].concat(), None);
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        file(name)
    };
    let plain = made("plain.exr", &[]);
    let (stats, reference) = (file("stats.json").display().to_string(), plain.display().to_string());
    let options = ["--denoise", "--aov", "albedo", "--threads", "1", "--stats", &stats, "--reference", &reference];
    let denoised = made("denoised.exr", &options);
    let (before, after) = (channels(&plain), channels(&denoised));
    assert_eq!(after.len(), 3 + 3 + 3);
    for part in ["R", "G", "B"] {
        assert_eq!(after[&format!("noisy.{part}")], before[part]);
        assert_ne!(after[part], before[part]);
    }
    assert!(attribute(&denoised, "denoised").unwrap().starts_with("oidn 2."));
    assert_eq!(attribute(&plain, "denoised"), None);
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert!(stats["seconds"]["denoise"].as_f64().unwrap() > 0.0, "{stats}");
    assert_eq!(stats["errors"].as_array().unwrap().last().unwrap()["relmse"], 0.0, "of the noisy picture");
    assert!(stats["denoised_error"]["relmse"].as_f64().unwrap() > 0.0, "{stats}");

    // Any number of threads makes the same picture, and a PNG file shows it.
    let twice = made("twice.exr", &["--denoise", "--threads", "2"]);
    assert!(["R", "G", "B"].iter().all(|part| channels(&twice)[*part] == after[*part]));
    let shown = made("shown.png", &["--denoise"]);
    let pixels = (0..48 * 40).map(|i| Vec3::from(["R", "G", "B"].map(|part| after[part][i]))).collect();
    let image = Image { width: 48, height: 40, pixels };
    assert_eq!(std::fs::read(shown).unwrap(), write_png::encode(&image, Default::default()).unwrap());

    let part = made("part.exr", &["--denoise", "--crop", "3,4,20,9"]);
    assert_eq!(read_image(&part, false).map(|image| (image.width, image.height)).unwrap(), (20, 9));
    let inside = |name: &str| (0..9 * 20).map(|i| before[name][(4 + i / 20) * 48 + 3 + i % 20]).collect::<Vec<_>>();
    assert_eq!(channels(&part)["noisy.G"], inside("G"));
}

/// The error of each denoised picture of a comparison, found again from the picture that is kept.
#[test]
fn comparisons_measure_denoised_pictures_too() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
    command.arg("compare").arg(&scene).arg("-o").arg(folder.path()).args(["--methods", "none", "--denoise", "--quiet"]);
    let options = ["--spp", "4,16", "--seeds", "2", "--size", "40x30", "--reference-spp", "128"];
    let output = command.args(options).output().expect("the program was built for this test");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let results = Results::read(&folder.path().join("results.json")).unwrap();
    let denoiser = Denoiser::new().unwrap();
    assert_eq!(results.denoiser, Some(denoiser.name()));

    let scene = Scene::build(&load(&scene).unwrap(), [40, 30]).unwrap();
    let features = features(&scene, &RenderSettings::new(GuideMode::None, StopRule::Spp(1))).unwrap();
    let read = |name: &str, signed| read_image(&folder.path().join(name), signed).unwrap();
    let (reference, variance) = (read("reference.exr", false), read("reference-variance.exr", true));
    for run in &results.runs {
        let denoised = denoiser.denoise(&read(&run.file, false), &features).unwrap();
        let relmse = measure_noisy(&denoised, &reference, Some(&variance)).unwrap().relmse;
        let entry = run.denoised.unwrap();
        assert!((entry.errors.relmse - relmse).abs() < 1e-9, "{relmse}, {entry:?}");
        assert!(entry.errors.relmse < run.errors.relmse && entry.seconds > 0.0, "{entry:?}");
    }
    for entry in &results.summary {
        let denoised = entry.denoised.unwrap();
        assert!(denoised.relmse_trimmed.mean < entry.relmse_trimmed.mean && denoised.seconds > entry.seconds);
    }
    let csv = std::fs::read_to_string(folder.path().join("runs.csv")).unwrap();
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert!(csv.lines().next().unwrap().ends_with(",denoised_relmse_ldr") && columns.iter().all(|&n| n == columns[0]));
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    assert!(page.contains("Dashed lines") && page.contains("trimmed, denoised"));
}
