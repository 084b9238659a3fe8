//! What part files say beside their samples: views, names of channels, statistics.

use crate::files::{Files, scene};
use crate::parts::{assert_same, refused, works};

use fanal::film::{Block, Pass};
use fanal::picture::Channel;
use fanal::render::PartOf;
use fanal::render::part_file::{self, PartHead, Totals};
use glam::Vec3;

/// The header of a merged picture names its camera, as that of one process does.
#[test]
fn parts_know_their_camera() {
    let files = Files::new();
    let cornell = scene("cornell");
    for camera in ["default", "all"] {
        let options =
            [&cornell[..], "--guide", "none", "--spp", "128", "--size", "12x9", "--camera", camera, "--aov", "depth"];
        let parts = files.parts(&options, 2);
        let merged = files.merge(&parts, "merged.exr");
        let single = files.render(&options, "single.exr", &[]);
        let single = if camera == "all" { files.path("single.default.exr") } else { single };
        assert_same(&single, &merged, camera);
        assert!(crate::parts::all_of(&merged).1["camera"].contains("default"));
    }
}

fn numbers(files: &Files) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(files.path("stats.json")).unwrap()).unwrap()
}

/// Statistics tell of reading the scene. Work that was done before has statistics of nothing else, and is silent where that is wanted.
#[test]
fn work_that_is_done_is_left_and_told() {
    let files = Files::new();
    let (door, stats) = (scene("door-ajar"), files.text("stats.json"));
    let size = ["--size", "16x12", "--stats", &stats];
    for (name, command) in [
        ("a.part", &["render", "--guide", "none", "--spp", "128", "--part", "1/2"][..]),
        ("a.guide", &["learn", "--guide", "gaussian", "--spp", "16"]),
        ("b.guide", &["learn", "--guide", "gaussian", "--spp", "16", "--part", "1/2"]),
    ] {
        let output = files.text(name);
        let words = [&command[..1], &[&door], &command[1..], &size, &["-o", &output]].concat();
        works(&[&words[..], &["--quiet"]].concat());
        let (bytes, first) = (std::fs::read(&output).unwrap(), numbers(&files));
        assert!(first["seconds"]["load"].as_f64().unwrap() > 0.0 && first["samples"].as_u64().unwrap() > 0, "{name}");
        std::fs::remove_file(&stats).unwrap();
        assert_eq!(works(&[&words[..], &["--quiet"]].concat()), "");
        let again = numbers(&files);
        assert!(again["seconds"]["load"].as_f64().unwrap() > 0.0 && again["samples"] == 0, "{name}");
        assert_eq!(
            (&again["width"], &again["seed"], &again["method"]),
            (&first["width"], &first["seed"], &first["method"])
        );
        assert!(works(&words).contains("is there already"));
        assert!(std::fs::read(&output).unwrap() == bytes, "{name} was made anew");
        // Another seed is other work, and so is what was damaged.
        works(&[&words[..], &["--quiet", "--seed", "7"]].concat());
        let other = std::fs::read(&output).unwrap();
        assert!(other != bytes && numbers(&files)["samples"].as_u64().unwrap() > 0, "{name}");
        std::fs::write(&output, &bytes[..bytes.len() - 1]).unwrap();
        works(&[&words[..], &["--quiet"]].concat());
        let sound = numbers(&files);
        assert!(sound["samples"] == first["samples"], "{name}");
    }
}

/// Names that an EXR file cannot have are refused, and the picture that is there stays.
#[test]
fn f03_forged_names_are_refused() {
    let files = Files::new();
    let mut pass = Pass::new(3, 2);
    (0..6).for_each(|pixel| pass.add(pixel, 0, Vec3::ONE));
    let block = Block::of(&pass, false);
    let part = |channel: &str, attribute: &str| {
        let path = files.path("1.part");
        let head = PartHead {
            part: PartOf::new(1, 1).unwrap(),
            merged: 0,
            in_common: "a picture".into(),
            size: [3, 2],
            window: [0, 0, 3, 2],
            samples: 1,
            spp: 1,
            detailed: false,
            film_layers: [false; 2],
            fireflies: None,
            channels: vec!["depth.Z".into(), channel.into()],
            attributes: vec![(attribute.into(), "a value".into())],
            layer_attributes: vec![],
            totals: Totals::default(),
        };
        let layer = |name: &str| Channel { name: name.into(), values: vec![1.0; 6] };
        part_file::write(&path, &head, std::slice::from_ref(&block), None, &[layer("depth.Z"), layer(channel)])
            .unwrap();
        vec![path]
    };
    let merged = files.merge(&part("albedo.R", "seed"), "out.exr");
    let good = std::fs::read(&merged).unwrap();
    let long = "n".repeat(5000);
    for (channel, attribute) in [
        ("a\0b", "seed"),
        (&long, "seed"),
        ("", "seed"),
        ("R", "seed"),
        ("depth.Z", "seed"),
        ("灯", "seed"),
        ("albedo.R", "a\0b"),
        ("albedo.R", &long),
    ] {
        let told =
            refused(&["merge", &part(channel, attribute)[0].display().to_string(), "-o", &files.text("out.exr")]);
        assert!(told.contains("1.part") && told.len() < 500, "{channel:?} {attribute:?}: {told}");
        assert!(std::fs::read(&merged).unwrap() == good);
    }
}
