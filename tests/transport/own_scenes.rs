//! The committed scenes are what the code in `generate::own` makes. `FANAL_WRITE_SCENES=1 cargo test --test transport own_scenes` writes
//! them again after a change of that code.

use std::path::Path;

use fanal::base::files::write_bytes;
use fanal::generate::recipe::Recipe;
use fanal::generate::{self, Family, own};
use fanal::scene::Scene;
use fanal::scene::readers::load;

/// Numbers may differ in the last digits, because sines differ between systems; all else must be equal.
fn alike(a: &str, b: &str) -> bool {
    let words = |text: &str| -> Vec<String> {
        let separator = |c: char| c.is_whitespace() || "[]{},:".contains(c);
        text.split(separator).filter(|w| !w.is_empty()).map(str::to_owned).collect()
    };
    let (a, b) = (words(a), words(b));
    let equal = |(a, b): (&String, &String)| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= 2e-6 * (1.0 + a.abs()),
        _ => a == b,
    };
    a.len() == b.len() && a.iter().zip(&b).all(equal)
}

#[test]
fn committed_scenes_are_current() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    for scene in own::all().unwrap() {
        for (name, content) in &scene.files {
            let path = root.join(scene.folder).join(name);
            if std::env::var_os("FANAL_WRITE_SCENES").is_some() {
                std::fs::create_dir_all(root.join(scene.folder)).unwrap();
                write_bytes(&path, content).unwrap();
            }
            let committed = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            let current = match [&committed, content].map(|bytes| str::from_utf8(bytes)) {
                [Ok(committed), Ok(text)] => alike(committed, text),
                _ => committed == *content,
            };
            assert!(current, "{} is not what the code makes", path.display());
        }
    }
}

#[test]
fn committed_scenes_can_be_built() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    for scene in own::all().unwrap() {
        let loaded = load(&root.join(scene.folder)).unwrap();
        assert!(loaded.warnings.is_empty(), "{}: {:?}", scene.folder, loaded.warnings);
        Scene::build(&loaded, [8, 8]).unwrap();
    }
}

#[test]
fn generated_scenes_can_be_built() {
    for family in Family::ALL {
        for seed in 0..20 {
            let loaded = generate::load(family, seed, generate::DEFAULT_SIZE).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(loaded.skipped_triangles, 0, "{}", loaded.file.name);
            Scene::build(&loaded, generate::DEFAULT_SIZE).unwrap_or_else(|e| panic!("{e}"));
        }
    }
}

#[test]
fn committed_recipes_are_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            assert!(!Recipe::read(&path).unwrap().jobs().is_empty());
            seen += 1;
        }
    }
    assert!(seen > 0);
}
