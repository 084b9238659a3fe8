//! Parts of a picture that several processes render, and what puts them together: the picture has the bits that one process gives it, or
//! there is none.

use crate::files::{Files, scene};
use crate::support::scenes;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use exr::meta::MetaData;
use fanal::base::progress::Silent;
use fanal::base::{Error, Unfit};
use fanal::picture::read_exr_channels;
use fanal::render::merge::{Merged, merge};
use scenes::{GUIDES, committed, reconstructor, settings};

/// Three blocks of samples, of which the last is not whole.
const SPP: &str = "150";

fn fanal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().expect("the program was built for this test")
}

fn works(arguments: &[&str]) -> String {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(result.status.success(), "{arguments:?}: {told}");
    String::from_utf8_lossy(&result.stdout).into_owned()
}

/// What the program says that does not do it.
fn refused(arguments: &[&str]) -> String {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr).into_owned();
    assert!(!result.status.success() && !told.contains("panicked"), "{arguments:?}: {told}");
    told
}

impl Files {
    /// Renders `options` to a file of this name.
    fn render(&self, options: &[&str], name: &str, more: &[&str]) -> PathBuf {
        works(&[&["render"], options, more, &["--quiet", "-o", &self.text(name)]].concat());
        self.path(name)
    }

    /// Renders all parts.
    fn parts(&self, options: &[&str], count: u32) -> Vec<PathBuf> {
        let part = |k: u32| self.render(options, &format!("{k}.part"), &["--part", &format!("{k}/{count}")]);
        (1..=count).map(part).collect()
    }

    fn merge(&self, parts: &[PathBuf], name: &str) -> PathBuf {
        let parts: Vec<String> = parts.iter().map(|part| part.display().to_string()).collect();
        let words: Vec<&str> = parts.iter().map(String::as_str).collect();
        works(&[&["merge", "--quiet", "-o", &self.text(name)], &words[..]].concat());
        self.path(name)
    }
}

type Bits = BTreeMap<String, Vec<u32>>;
type Header = BTreeMap<String, String>;

/// All channels of a picture bit by bit, and of its header what does not tell of time.
fn all_of(path: &Path) -> (Bits, Header) {
    let (_, _, channels) = read_exr_channels(path).unwrap();
    let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect();
    let bits = channels.into_iter().map(|(name, values)| (name, bits(values))).collect();
    let header = MetaData::read_from_file(path, false).unwrap().headers.remove(0);
    let windows = format!("{:?} {:?}", header.shared_attributes.display_window, header.own_attributes.layer_position);
    let texts = header.own_attributes.other.iter().map(|(name, value)| (name.to_string(), format!("{value:?}")));
    let mut header: Header = texts.filter(|(name, _)| name != "seconds" && name != "threads").collect();
    header.insert("windows".into(), windows);
    (bits, header)
}

fn assert_same(one: &Path, other: &Path, what: &str) {
    let ((a, a_header), (b, b_header)) = (all_of(one), all_of(other));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{what}");
    for (name, bits) in &a {
        let different = bits.iter().zip(&b[name]).filter(|(a, b)| a != b).count();
        assert!(different == 0 && bits.len() == b[name].len(), "{what}: {different} pixels of {name}");
    }
    assert_eq!(a_header, b_header, "{what}");
}

/// With layers, variances, a filter, and other numbers of threads.
#[test]
fn parts_are_the_picture_of_one_process() {
    let files = Files::new();
    let (cornell, door) = (scene("cornell"), scene("door-ajar"));
    let picture = ["--spp", SPP, "--size", "32x24", "--aov", "all", "--pixel-filter", "gaussian"];
    let plain = [&[&cornell[..], "--guide", "none"], &picture[..]].concat();
    let single = files.render(&plain, "single.exr", &["--threads", "1"]);
    let merged = files.merge(&files.parts(&[&plain[..], &["--threads", "2"]].concat(), 3), "merged.exr");
    assert_same(&single, &merged, "none");
    // Layers change nothing, and the order of the files neither.
    let bare = [&cornell[..], "--guide", "none", "--spp", SPP, "--size", "32x24", "--pixel-filter", "gaussian"];
    let parts = files.parts(&bare, 2);
    let merged = files.merge(&[parts[1].clone(), parts[0].clone()], "merged.exr");
    assert_same(&files.render(&bare, "bare.exr", &[]), &merged, "without layers");
    let colours = |path: &Path| {
        let (mut bits, _) = all_of(path);
        bits.retain(|name, _| ["R", "G", "B"].contains(&name.as_str()));
        bits
    };
    assert_eq!(colours(&merged), colours(&single));
    for guide in ["gaussian", "neural"] {
        let learned = files.text("a.guide");
        works(&["learn", &door, "--guide", guide, "--spp", "24", "--size", "32x24", "--quiet", "-o", &learned]);
        let guided = [&[&door[..], "--guide", guide, "--load-guide", &learned], &picture[..]].concat();
        let single = files.render(&guided, "single.exr", &["--threads", "2"]);
        let merged = files.merge(&files.parts(&[&guided[..], &["--threads", "1"]].concat(), 2), "merged.exr");
        assert_same(&single, &merged, guide);
    }
}

/// A guide that was learned for another picture: every part has the same first look.
#[test]
fn parts_by_the_guide_of_another_picture() {
    let files = Files::new();
    let (door, learned) = (scene("door-ajar"), files.text("a.guide"));
    works(&["learn", &door, "--guide", "gaussian", "--spp", "16", "--size", "32x24", "--quiet", "-o", &learned]);
    let of = |size, spp| [&door[..], "--guide", "gaussian", "--load-guide", &learned, "--spp", spp, "--size", size];
    let single = files.render(&of("24x18", SPP), "single.exr", &[]);
    assert_same(&single, &files.merge(&files.parts(&of("24x18", SPP), 3), "merged.exr"), "looked");
    // The look takes four of these samples, and leaves a block alone; the picture that the guide knows has two.
    let told = refused(&[&["render", "-o", &files.text("1.part"), "--part", "1/2"], &of("24x18", "65")[..]].concat());
    assert!(told.contains("61 samples per pixel are 1 blocks"), "{told}");
    files.render(&of("32x24", "65"), "1.part", &["--part", "1/2"]);
    let crop = ["render", "-o", &files.text("1.part"), "--part", "1/1", "--crop", "0,0,8,8"];
    assert!(refused(&[&crop[..], &of("24x18", SPP)].concat()).contains("another picture"));
}

/// Windows with other numbers of parts each make the whole picture, or one window a part of it.
#[test]
fn windows_are_put_together() {
    let files = Files::new();
    let (door, learned) = (scene("door-ajar"), files.text("a.guide"));
    works(&["learn", &door, "--guide", "gaussian", "--spp", "16", "--size", "32x24", "--quiet", "-o", &learned]);
    let plain = ["--guide", "none"];
    let guided = ["--guide", "gaussian", "--load-guide", &learned];
    for guide in [&plain[..], &guided] {
        let options = [&[&door[..], "--spp", SPP, "--size", "32x24", "--aov", "all"], guide].concat();
        let single = files.render(&options, "single.exr", &[]);
        let window =
            |name: &str, crop: &str, part: &str| files.render(&options, name, &["--crop", crop, "--part", part]);
        let parts = [
            window("a1", "0,0,32,11", "1/2"),
            window("a2", "0,0,32,11", "2/2"),
            window("b", "0,11,17,13", "1/1"),
            window("c", "17,11,15,13", "1/1"),
        ];
        assert_same(&single, &files.merge(&parts, "merged.exr"), guide[1]);
        let alone = files.render(&options, "window.exr", &["--crop", "0,0,32,11"]);
        assert_same(&alone, &files.merge(&parts[..2], "merged.exr"), "one window");
        let missing = refused_merge(&parts[..3], false);
        assert!(missing.0 == Unfit::Missing && missing.2.contains("195 of the picture's 768 pixels"), "{missing:?}");
        let over = window("d", "16,11,16,13", "1/1");
        let (fault, names, _) = refused_merge(&[&parts[..3], std::slice::from_ref(&over)].concat(), false);
        assert!(fault == Unfit::Double && names.contains(&over));
    }
}

/// Why parts are refused, the files at fault, and the message.
fn refused_merge(parts: &[PathBuf], allow_missing: bool) -> (Unfit, Vec<PathBuf>, String) {
    match merge(parts, allow_missing, &Silent) {
        Err(Error::Parts { fault, files, message }) => (fault, files, message),
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("they were put together"),
    }
}

/// What does not belong together is refused with its name, and no picture is written.
#[test]
fn parts_that_make_no_whole_are_refused() {
    let files = Files::new();
    let cornell = scene("cornell");
    let options = [&cornell[..], "--guide", "none", "--spp", SPP, "--size", "16x12", "--aov", "albedo"];
    let parts = files.parts(&options, 3);
    let [one, two, three] = [0, 1, 2].map(|i| parts[i].clone());

    let (fault, _, message) = refused_merge(&[one.clone(), three.clone()], false);
    assert!(fault == Unfit::Missing && message.contains("2/3"), "{message}");
    let copy = files.path("copy.part");
    std::fs::copy(&two, &copy).unwrap();
    for allowed in [false, true] {
        let (fault, names, _) = refused_merge(&[one.clone(), two.clone(), copy.clone(), three.clone()], allowed);
        assert_eq!((fault, names), (Unfit::Double, vec![two.clone(), copy.clone()]));
    }
    let half = files.render(&options, "half.part", &["--part", "2/2"]);
    assert_eq!(refused_merge(&[one.clone(), half.clone()], true).0, Unfit::Double, "of another division");

    for (other, differs) in [
        (vec!["--seed", "7"], "seed: 7"),
        (vec!["--max-depth", "3"], "scene: "),
        (vec!["--pixel-filter", "tent"], "filter: "),
        (vec!["--aov", "normal"], "layers: "),
    ] {
        let foreign = files.render(&options, "foreign.part", &[&["--part", "2/3"][..], &other].concat());
        let (fault, names, message) = refused_merge(&[one.clone(), foreign.clone(), three.clone()], true);
        assert_eq!((fault, &names), (Unfit::Foreign, &vec![foreign, one.clone()]), "{message}");
        assert!(message.contains(differs), "{message}");
    }

    let good = std::fs::read(&two).unwrap();
    let damaged = files.path("damaged.part");
    let broken = |bytes: &[u8]| {
        std::fs::write(&damaged, bytes).unwrap();
        let error = merge(&[one.clone(), damaged.clone(), three.clone()], true, &Silent).err().expect("it is damaged");
        assert!(error.to_string().contains("damaged.part"), "{error}");
        error
    };
    for end in (0..good.len()).step_by(211).chain([good.len() - 1]) {
        assert!(matches!(broken(&good[..end]), Error::Malformed { .. }));
    }
    for at in (0..good.len()).step_by(97) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        broken(&bad);
    }
    broken(&[&good[..], b"more"].concat());
    broken(b"");
    broken(&std::fs::read(files.render(&options, "a.exr", &[])).unwrap());

    let words = ["merge", &one.display().to_string(), &files.text("none.part"), "-o", &files.text("out.exr")];
    assert!(refused(&words).contains("none.part"));
    assert!(!files.path("out.exr").exists());
    let temporary = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with(".fanal");
    assert!(!std::fs::read_dir(files.0.path()).unwrap().any(|entry| temporary(&entry.unwrap())));
}

/// `--allow-missing` gives the mean of the samples that are there, and the header says which parts are not.
#[test]
fn a_picture_of_what_is_there_says_so() {
    let files = Files::new();
    let cornell = scene("cornell");
    let of = |spp| [&cornell[..], "--guide", "none", "--spp", spp, "--size", "16x12", "--aov", "samples,albedo"];
    let parts = files.parts(&of("128"), 2);
    let out = files.text("so-far.exr");
    let told = fanal(&["merge", &parts[0].display().to_string(), "-o", &out, "--allow-missing"]);
    assert!(told.status.success());
    assert!(String::from_utf8_lossy(&told.stderr).contains("parts are missing: 2/2"));
    let ((found, header), (half, _)) = (all_of(Path::new(&out)), all_of(&files.render(&of("64"), "half.exr", &[])));
    assert!(header["missingParts"].contains("2/2") && header["spp"].contains("64"), "{header:?}");
    assert_eq!(found, half, "the first block of samples, whatever follows");
    let Merged { missing, channels, .. } = merge(&parts[1..], true, &Silent).unwrap();
    assert_eq!(missing, ["1/2"]);
    let albedo = channels.iter().find(|channel| channel.name == "albedo.R").unwrap();
    assert!(albedo.values.iter().all(|value| *value == 0.0), "the first part has the layers");
    assert!(!all_of(&files.merge(&parts, "whole.exr")).1.contains_key("missingParts"));
}

/// A part is of a scene's content, wherever that lies.
#[test]
fn scenes_are_known_by_their_content() {
    let files = Files::new();
    let copy = |name: &str, change: fn(&str) -> String| {
        let text = std::fs::read_to_string(Path::new(&scene("cornell")).join("scene.json")).unwrap();
        std::fs::create_dir(files.path(name)).unwrap();
        std::fs::write(files.path(name).join("scene.json"), change(&text)).unwrap();
        files.text(name)
    };
    let options = ["--guide", "none", "--spp", "128", "--size", "16x12"];
    let part =
        |scene: &str, name: &str, part: &str| files.render(&[&[scene], &options[..]].concat(), name, &["--part", part]);
    let one = part(&scene("cornell"), "1.part", "1/2");
    files.merge(&[one.clone(), part(&copy("same", str::to_owned), "2.part", "2/2")], "out.exr");
    let darker = copy("darker", |text| text.replacen("\"fov\": ", "\"fov\": 1", 1));
    assert_ne!(
        std::fs::read(files.path("same/scene.json")).unwrap(),
        std::fs::read(files.path("darker/scene.json")).unwrap()
    );
    let (fault, _, message) = refused_merge(&[one, part(&darker, "2.part", "2/2")], false);
    assert!(fault == Unfit::Foreign && message.contains("scene: "), "{message}");
}

#[test]
fn what_parts_cannot_hold_is_refused() {
    let files = Files::new();
    let (cornell, part) = (scene("cornell"), files.text("a.part"));
    let with = |more: &[&str]| {
        let plain = ["render", &cornell, "--size", "16x12", "-o", &part, "--part", "1/2"];
        let told = refused(&[&plain[..], more].concat());
        assert!(!files.path("a.part").exists());
        told
    };
    assert!(with(&["--guide", "none", "--spp", "128", "--adaptive", "on"]).contains("--adaptive on"));
    assert!(with(&["--guide", "neural", "--spp", "128"]).contains("--load-guide"));
    assert!(with(&["--guide", "none", "--time", "1"]).contains("--time"));
    assert!(with(&["--guide", "none", "--target-error", "1"]).contains("--target-error"));
    assert!(with(&["--guide", "none", "--spp", "64"]).contains("at most 1"));
    assert!(with(&["--guide", "none", "--spp", "128", "--orbit", "2"]).contains("--part is about one picture"));
    assert!(with(&["--guide", "none", "--spp", "128", "--denoise"]).contains("--denoise"));
    assert!(refused(&["learn", &cornell, "--guide", "none", "-o", &part]).contains("learns nothing"));
}

/// SIGTERM keeps a part's state, and the same command goes on; one that is done stays as it is. So does learning.
#[cfg(unix)]
#[test]
fn f08_parts_and_learning_go_on() {
    let files = Files::new();
    let door = scene("door-ajar");
    let part =
        ["render", &door, "--guide", "none", "--size", "64x48", "--spp", "320", "--part", "2/2", "--threads", "1"];
    let learn = ["learn", &door, "--guide", "gaussian", "--size", "64x48", "--spp", "64", "--threads", "1"];
    for command in [&part[..], &learn] {
        let (whole, broken) = (files.text("whole"), files.text("broken"));
        works(&[command, &["-o", &whole, "--quiet"]].concat());
        let mut interruptions = 0;
        loop {
            let mut child = Command::new(env!("CARGO_BIN_EXE_fanal"))
                .args([command, &["-o", &broken, "--quiet"]].concat())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(250 + 10 * interruptions));
            let _ =
                Command::new("sh").args(["-c", &format!("kill -TERM {}", child.id())]).stderr(Stdio::null()).status();
            match child.wait().unwrap().code() {
                Some(0) => break,
                // A signal may come before it is heard.
                Some(75) | None => interruptions += 1,
                other => panic!("{other:?}"),
            }
            assert!(!Path::new(&broken).exists(), "an unfinished file");
            assert!(interruptions < 1000);
        }
        assert!(interruptions > 0 && !files.path("broken.checkpoint").exists());
        let bytes = |path: &str| std::fs::read(path).unwrap();
        if command[0] == "learn" {
            assert!(bytes(&whole) == bytes(&broken), "another guide");
        } else {
            let first = files.render(&part[1..8], "first.part", &["--part", "1/2"]);
            let merged = |name: &str| merge(&[first.clone(), files.path(name)], false, &Silent).unwrap().image.pixels;
            assert!(merged("whole") == merged("broken"), "another picture");
            let before = bytes(&broken);
            assert!(works(&[command, &["-o", &broken]].concat()).contains("is there already"));
            assert!(bytes(&broken) == before);
        }
        [whole, broken].iter().for_each(|file| std::fs::remove_file(file).unwrap());
    }
}

/// A checkpoint between parts is named as what it is.
#[test]
fn unfinished_parts_are_named() {
    use fanal::render::{Checkpointing, Control, PartOf, RenderSettings, render_watched};
    let files = Files::new();
    let scene = committed("cornell", [64, 48]);
    let part = Some(PartOf::new(1, 2).unwrap());
    let settings = RenderSettings { part, ..settings(GUIDES[0], 256, 1) };
    let path = files.path("1.part.checkpoint");
    let write = Some((path.clone(), Duration::ZERO));
    let checkpoint = Checkpointing { made_for: "it".into(), write, resume: None };
    let stop = crate::support::stop::StopAfter::new(1);
    let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&stop, &stop.now) };
    let outcome = render_watched(&scene, &settings, reconstructor(settings.guide).as_ref(), &control).unwrap();
    assert!(outcome.interrupted);
    let (fault, names, _) = refused_merge(std::slice::from_ref(&path), true);
    assert_eq!((fault, names), (Unfit::Unfinished, vec![path]));
}

/// A merge that is killed at any moment leaves the picture of before, or the new one.
#[test]
fn f01_killed_merges_leave_whole_pictures() {
    let files = Files::new();
    let cornell = scene("cornell");
    let options = [&cornell[..], "--guide", "none", "--spp", "128", "--size", "256x192", "--aov", "albedo"];
    let parts = files.parts(&options, 2);
    let merged = files.merge(&parts, "out.exr");
    let good = all_of(&merged);
    let words = [parts[0].display().to_string(), parts[1].display().to_string()];
    for delay in 0..12 {
        if delay % 4 == 0 {
            let _ = std::fs::remove_file(&merged);
        }
        let mut child = Command::new(env!("CARGO_BIN_EXE_fanal"))
            .args(["merge", &words[0], &words[1], "--quiet", "-o", &merged.display().to_string()])
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(5 * delay));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!merged.exists() || all_of(&merged) == good, "after {delay}");
    }
    assert!(all_of(&files.merge(&parts, "out.exr")) == good);
}

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
            "name = \"tiny\"\nseed = {seed}\nheld_out = 0.25\nresolution = [24, 24]\niterations = [1]\ngrids = [12]\n\
             target_spp = 16\nmax_trees_per_scene = 8\n[[family]]\nname = \"rooms\"\nscenes = 3\n\
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
