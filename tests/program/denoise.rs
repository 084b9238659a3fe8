//! `fanal render --denoise` from outside. What needs the library is checked where `OIDN_DYLIB_PATH` names it.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use fanal::picture::{Image, read_exr_channels, read_image, write_png};
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
