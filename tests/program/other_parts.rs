//! Parts of data sets and of guides.

use crate::files::{Files, scene};
use crate::parts::{Bits, all_of, fanal, refused, works};

use std::collections::BTreeMap;
use std::path::Path;

/// Names and contents of the files of a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(path).unwrap())).collect()
}

/// Parts of a data set, made in one folder, are the folder that one process makes, byte for byte.
#[test]
fn data_sets_are_put_together() {
    let files = Files::new();
    let recipe = |name: &str, seed: u32| {
        let text = format!(
            "name = \"tiny\"\nseed = {seed}\nheld_out = 0.25\nresolution = [16, 16]\niterations = [1]\ngrids = [12]\n\
             target_spp = 4\nmax_trees_per_scene = 4\n[[family]]\nname = \"rooms\"\nscenes = 3\n\
             [[family]]\nname = \"primitives\"\nscenes = 2\n"
        );
        std::fs::write(files.path(name), text).unwrap();
        files.text(name)
    };
    let (tiny, other) = (recipe("tiny.toml", 3), recipe("other.toml", 4));
    let (single, data) = (files.text("single"), files.text("data"));
    works(&["dataset", &tiny, "-o", &single, "--quiet"]);
    let part = |recipe: &str, part: &str| fanal(&["dataset", recipe, "-o", &data, "--quiet", "--part", part]);
    assert!(part(&tiny, "2/3").status.success() && part(&tiny, "1/3").status.success());
    assert!(refused(&["merge", &data]).contains("parts are missing: 3/3"));
    let told = part(&other, "1/3");
    assert!(!told.status.success() && String::from_utf8_lossy(&told.stderr).contains("index.1-3.json"));
    assert!(part(&tiny, "3/3").status.success());
    // One that has not come to its end, and one whose shard is gone.
    let index = files.path("data/index.2-3.json");
    let whole = std::fs::read(&index).unwrap();
    let mut json: serde_json::Value = serde_json::from_slice(&whole).unwrap();
    json["shards"].as_array_mut().unwrap().pop();
    std::fs::write(&index, json.to_string()).unwrap();
    assert!(refused(&["merge", &data]).contains("index.2-3.json: 1 of 2 scenes are done"));
    assert!(part(&tiny, "2/3").status.success());
    assert_eq!(std::fs::read(&index).unwrap(), whole);
    let shard = json["shards"][0]["file"].as_str().unwrap().to_owned();
    let bytes = std::fs::read(files.path("data").join(&shard)).unwrap();
    std::fs::remove_file(files.path("data").join(&shard)).unwrap();
    assert!(refused(&["merge", &data]).contains(&shard));
    std::fs::write(files.path("data").join(&shard), bytes).unwrap();
    std::fs::write(files.path("data/index.1-4.json"), whole).unwrap();
    assert!(refused(&["merge", &data]).contains("index.1-4.json"), "an index under another name");
    std::fs::remove_file(files.path("data/index.1-4.json")).unwrap();
    let parts: Vec<_> = (1..=3).map(|part| files.path("data").join(format!("index.{part}-3.json"))).collect();
    let kept = std::fs::read(&parts[2]).unwrap();

    assert!(works(&["merge", &data, "--check"]).contains("5 shards"));
    assert!(contents(&files.path("data")) == contents(&files.path("single")));
    // What a merge leaves that is killed at its end.
    std::fs::write(&parts[2], kept).unwrap();
    assert!(works(&["merge", &data]).contains("the data are whole"));
    assert!(contents(&files.path("data")) == contents(&files.path("single")));
    assert!(!part(&tiny, "1/3").status.success(), "whole data are not begun anew");
}

/// What several processes learn is added up: with one part it is what that learned; guides of several are whole guides, the same whatever
/// the order and the threads; what does not belong together is refused.
#[test]
fn guides_are_put_together() {
    let files = Files::new();
    let door = scene("door-ajar");
    let learn = |name: &str, more: &[&str]| {
        let plain = ["learn", &door, "--guide", "gaussian", "--spp", "32", "--size", "32x24", "--quiet"];
        works(&[&plain[..], more, &["-o", &files.text(name)]].concat());
        files.path(name)
    };
    let parts = [
        learn("1.guide", &["--part", "1/2", "--threads", "1"]),
        learn("2.guide", &["--part", "2/2", "--threads", "2"]),
    ];
    let [one, two] = parts.clone().map(|path| path.display().to_string());
    let merged = |inputs: &[&str], name: &str| {
        works(&[&["merge", "--quiet", "-o", &files.text(name)], inputs].concat());
        std::fs::read(files.path(name)).unwrap()
    };
    let both = merged(&[&one, &two], "all.guide");
    assert!(both == merged(&[&two, &one], "again.guide"));
    let render = |guide: &str| {
        let words = [&door[..], "--guide", "gaussian", "--load-guide", guide, "--spp", "16", "--size", "32x24"];
        all_of(&files.render(&words, "out.exr", &["--aov", "guiding"])).0
    };
    let guided = |bits: &Bits| bits["guiding.Y"].iter().filter(|&&bits| f32::from_bits(bits) > 0.0).count();
    assert!(guided(&render(&files.text("all.guide"))) > 100);
    works(&["inspect", &files.text("all.guide")]);
    assert!(refused(&["merge", &one, "-o", &files.text("a.guide")]).contains("parts are missing: 2/2"));
    assert!(refused(&["merge", &one, &one, "-o", &files.text("a.guide")]).contains("both part 1/2"));
    let foreign = learn("foreign.guide", &["--part", "2/2", "--seed", "1"]).display().to_string();
    assert!(refused(&["merge", &one, &foreign, "-o", &files.text("a.guide")]).contains("seed: 1"));
    assert!(refused(&["render", &door, "--load-guide", &one, "-o", &files.text("a.exr")]).contains("fanal merge"));
    std::fs::write(&foreign, &std::fs::read(&two).unwrap()[..5000]).unwrap();
    assert!(refused(&["merge", &one, &foreign, "-o", &files.text("a.guide")]).contains("foreign.guide"));
}
