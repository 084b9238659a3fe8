//! `--fireflies reweight` as users have it: the layer, parts and windows, several cameras, PNG files, and what is refused.

use crate::files::{Files, scene};
use crate::parts::{all_of, assert_same, fanal, refused, works};

use std::path::Path;

use fanal::picture::{read_exr_channels, read_image};

const REWEIGHT: [&str; 4] = ["--fireflies", "reweight", "--kappa", "2"];

fn channel(path: &Path, name: &str) -> Vec<f32> {
    let (.., channels) = read_exr_channels(path).unwrap();
    channels.into_iter().find(|(found, _)| found == name).unwrap_or_else(|| panic!("no {name}")).1
}

/// The picture holds what is kept, the layer what is not; without the option a file is what it always was.
#[test]
fn a_layer_holds_what_is_taken_out() {
    let files = Files::new();
    let caustic = scene("glass-caustic");
    let options = [&caustic[..], "--guide", "none", "--spp", "24", "--size", "40x30", "--aov", "depth,variance"];
    let plain = files.render(&options, "plain.exr", &[]);
    let kept = files.render(&options, "kept.exr", &["--fireflies", "keep"]);
    assert!(std::fs::read(&plain).unwrap().len() == std::fs::read(&kept).unwrap().len());
    assert_same(&plain, &kept, "keep");
    let stats = files.text("stats.json");
    let judged = files.render(&options, "judged.exr", &[&REWEIGHT[..], &["--stats", &stats]].concat());
    let ((plain_bits, plain_header), (bits, header)) = (all_of(&plain), all_of(&judged));
    assert_eq!(bits.len(), plain_bits.len() + 3);
    assert!(header["fireflies"].contains("reweight, kappa 2") && !plain_header.contains_key("fireflies"));
    for name in ["depth.Z", "variance.R"] {
        assert_eq!(bits[name], plain_bits[name], "{name}");
    }
    let mut taken_out = 0;
    for part in ["R", "G", "B"] {
        let [plain, kept] = [&plain, &judged].map(|path| channel(path, part));
        let taken = channel(&judged, &format!("fireflies.{part}"));
        for ((plain, kept), taken) in plain.iter().zip(&kept).zip(&taken) {
            assert!((kept + taken - plain).abs() <= 1e-6 * plain && *taken >= 0.0, "{kept} and {taken} of {plain}");
            taken_out += u32::from(*taken > 0.0);
        }
    }
    assert!(taken_out > 0);
    let told = std::fs::read_to_string(stats).unwrap();
    assert!(told.contains("% of the picture's light taken out"), "{told}");
    // A PNG file shows what is kept.
    let png = |name: &str, more: &[&str]| read_image(&files.render(&options[..7], name, more), false).unwrap();
    assert_ne!(png("a.png", &REWEIGHT).pixels, png("b.png", &[]).pixels);
}

/// Parts that are put together, at once and from a sum of the first, and windows of the picture, have the bits of one process.
#[test]
fn f09_parts_take_out_what_one_process_does() {
    let files = Files::new();
    let caustic = scene("glass-caustic");
    let picture =
        ["--guide", "none", "--spp", "200", "--size", "24x18", "--pixel-filter", "gaussian", "--aov", "samples"];
    let options = [&[&caustic[..]], &picture[..], &REWEIGHT[..]].concat();
    let single = files.render(&options, "single.exr", &["--threads", "1"]);
    let parts = files.parts(&[&options[..], &["--threads", "2"]].concat(), 3);
    assert_same(&single, &files.merge(&[parts[2].clone(), parts[0].clone(), parts[1].clone()], "merged.exr"), "parts");
    // Stored without loss: the same command finds them whole.
    let before = std::fs::metadata(&parts[1]).unwrap().modified().unwrap();
    files.render(&[&options[..], &["--threads", "2"]].concat(), "2.part", &["--part", "2/3"]);
    assert_eq!(std::fs::metadata(&parts[1]).unwrap().modified().unwrap(), before);
    let first = files.merge(&parts[..2], "first.sum");
    assert_same(&single, &files.merge(&[first, parts[2].clone()], "summed.exr"), "a sum");
    let window = |crop: &str, name: &str| files.render(&options, name, &["--crop", crop, "--part", "1/1"]);
    let halves = [window("0,0,24,7", "a.part"), window("0,7,24,11", "b.part")];
    assert_same(&single, &files.merge(&halves, "windows.exr"), "windows");
    let alone = files.render(&options, "alone.exr", &["--crop", "0,7,24,11"]);
    assert_same(&alone, &files.merge(&halves[1..], "one.exr"), "one window");
    // Of another κ it is another picture.
    let unlike = [&[&caustic[..]], &picture[..], &["--fireflies", "reweight"]].concat();
    let unlike = files.render(&unlike, "unlike.part", &["--part", "1/3"]);
    let [unlike, part] = [&unlike, &parts[1]].map(|path| path.display().to_string());
    let told = refused(&["merge", "-o", &files.text("no.exr"), &unlike, &part]);
    assert!(told.contains("unlike.part") && told.contains("kappa") && !files.path("no.exr").exists(), "{told}");
}

/// Each view is judged by itself, as if it were alone.
#[test]
fn views_are_judged_alone() {
    let files = Files::new();
    let door = scene("door-ajar");
    let options = [&door[..], "--guide", "none", "--spp", "16", "--size", "24x20"];
    let options = [&options[..], &REWEIGHT[..]].concat();
    files.render(&options, "turn.exr", &["--orbit", "2"]);
    let alone = files.render(&options, "alone.exr", &[]);
    let first = files.path("turn.000.exr");
    for name in ["R", "G", "B", "fireflies.R", "fireflies.G", "fireflies.B"] {
        assert_eq!(channel(&first, name), channel(&alone, name), "{name}");
    }
    assert!(channel(&first, "fireflies.R").iter().any(|&taken| taken > 0.0));
}

#[test]
fn nonsense_is_refused() {
    let files = Files::new();
    let cornell = scene("cornell");
    let asked = |options: &[&str]| refused(&[&["render", &cornell, "-o", &files.text("a.exr")], options].concat());
    assert!(asked(&["--kappa", "2"]).contains("--fireflies reweight"));
    for kappa in ["0", "-1", "nan", "1e9", "x"] {
        assert!(asked(&["--fireflies", "reweight", "--kappa", kappa]).contains("expected a number"), "{kappa}");
    }
    assert!(asked(&["--fireflies", "kill"]).contains("reweight"));
    assert!(!files.path("a.exr").exists());
    let compared = fanal(&["compare", &cornell, "-o", &files.text("out"), "--variant", "a: --kappa 2", "--spp", "4"]);
    assert!(!compared.status.success());
    works(&[
        "compare",
        &cornell,
        "-o",
        &files.text("out"),
        "--methods",
        "none",
        "--variant",
        "calm: --guide none --fireflies reweight",
        "--spp",
        "4",
        "--seeds",
        "1",
        "--size",
        "16x12",
        "--reference-spp",
        "16",
        "--quiet",
    ]);
    assert!(std::fs::read_to_string(files.path("out/results.json")).unwrap().contains("calm"));
}
