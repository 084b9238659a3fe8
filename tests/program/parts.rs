//! Parts of a picture that several processes render, and what puts them together: the picture has the bits that one process gives it, or
//! there is none.

use crate::files::{Files, scene};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use exr::meta::MetaData;
use fanal::base::progress::Silent;
use fanal::base::{Error, Unfit};
use fanal::picture::read_exr_channels;
use fanal::render::merge::{Merged, merge, merge_first};

/// Three blocks of samples, of which the last is not whole.
const SPP: &str = "135";

pub fn fanal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().expect("the program was built for this test")
}

pub fn works(arguments: &[&str]) -> String {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(result.status.success(), "{arguments:?}: {told}");
    String::from_utf8_lossy(&result.stdout).into_owned()
}

/// What the program says that does not do it.
pub fn refused(arguments: &[&str]) -> String {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr).into_owned();
    assert!(!result.status.success() && !told.contains("panicked"), "{arguments:?}: {told}");
    told
}

impl Files {
    /// Renders `options` to a file of this name.
    pub fn render(&self, options: &[&str], name: &str, more: &[&str]) -> PathBuf {
        works(&[&["render"], options, more, &["--quiet", "-o", &self.text(name)]].concat());
        self.path(name)
    }

    /// Renders all parts.
    pub fn parts(&self, options: &[&str], count: u32) -> Vec<PathBuf> {
        let part = |k: u32| self.render(options, &format!("{k}.part"), &["--part", &format!("{k}/{count}")]);
        (1..=count).map(part).collect()
    }

    pub fn merge(&self, parts: &[PathBuf], name: &str) -> PathBuf {
        let parts: Vec<String> = parts.iter().map(|part| part.display().to_string()).collect();
        let words: Vec<&str> = parts.iter().map(String::as_str).collect();
        works(&[&["merge", "--quiet", "-o", &self.text(name)], &words[..]].concat());
        self.path(name)
    }
}

pub type Bits = BTreeMap<String, Vec<u32>>;
pub type Header = BTreeMap<String, String>;

/// All channels of a picture bit by bit, and of its header what does not tell of time.
pub fn all_of(path: &Path) -> (Bits, Header) {
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

pub fn assert_same(one: &Path, other: &Path, what: &str) {
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
    let picture = ["--spp", SPP, "--size", "20x15", "--aov", "all", "--pixel-filter", "gaussian"];
    let plain = [&[&cornell[..], "--guide", "none"], &picture[..]].concat();
    let single = files.render(&plain, "single.exr", &["--threads", "1"]);
    let merged = files.merge(&files.parts(&[&plain[..], &["--threads", "2"]].concat(), 3), "merged.exr");
    assert_same(&single, &merged, "none");
    // Layers change nothing, and the order of the files neither.
    let bare = [&cornell[..], "--guide", "none", "--spp", SPP, "--size", "20x15", "--pixel-filter", "gaussian"];
    let parts = files.parts(&bare, 2);
    let merged = files.merge(&[parts[1].clone(), parts[0].clone()], "merged.exr");
    assert_same(&files.render(&bare, "bare.exr", &[]), &merged, "without layers");
    // As a screen shows it, too.
    let shown = ["--view", "agx", "--exposure", "-1", "--quiet"];
    let (one, of_parts) = (files.text("single.png"), files.text("merged.png"));
    works(&[&["render"][..], &bare, &["-o", &one], &shown].concat());
    let names: Vec<String> = parts.iter().map(|part| part.display().to_string()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    works(&[&["merge"][..], &names, &["-o", &of_parts], &shown].concat());
    assert!(std::fs::read(&one).unwrap() == std::fs::read(&of_parts).unwrap());
    let told = fanal(&[&["merge"][..], &names, &["-o", &files.text("merged.exr"), "--view", "agx"]].concat());
    assert!(!told.status.success() && String::from_utf8_lossy(&told.stderr).contains("--view"));
    let colours = |path: &Path| {
        let (mut bits, _) = all_of(path);
        bits.retain(|name, _| ["R", "G", "B"].contains(&name.as_str()));
        bits
    };
    assert_eq!(colours(&merged), colours(&single));
    for guide in ["gaussian", "neural"] {
        let learned = files.text("a.guide");
        works(&["learn", &door, "--guide", guide, "--spp", "16", "--size", "20x15", "--quiet", "-o", &learned]);
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
    works(&["learn", &door, "--guide", "gaussian", "--spp", "16", "--size", "20x15", "--quiet", "-o", &learned]);
    let of = |size, spp| [&door[..], "--guide", "gaussian", "--load-guide", &learned, "--spp", spp, "--size", size];
    let single = files.render(&of("12x9", SPP), "single.exr", &[]);
    assert_same(&single, &files.merge(&files.parts(&of("12x9", SPP), 3), "merged.exr"), "looked");
    // The look takes four of these samples, and leaves a block alone; the picture that the guide knows has two.
    let told = refused(&[&["render", "-o", &files.text("1.part"), "--part", "1/2"], &of("12x9", "65")[..]].concat());
    assert!(told.contains("61 samples per pixel are 1 blocks"), "{told}");
    files.render(&of("20x15", "65"), "1.part", &["--part", "1/2"]);
    let crop = ["render", "-o", &files.text("1.part"), "--part", "1/1", "--crop", "0,0,8,8"];
    assert!(refused(&[&crop[..], &of("12x9", SPP)].concat()).contains("another picture"));
}

/// Windows with other numbers of parts each make the whole picture, or one window a part of it.
#[test]
fn windows_are_put_together() {
    let files = Files::new();
    let (door, learned) = (scene("door-ajar"), files.text("a.guide"));
    works(&["learn", &door, "--guide", "gaussian", "--spp", "16", "--size", "16x12", "--quiet", "-o", &learned]);
    let plain = ["--guide", "none"];
    let guided = ["--guide", "gaussian", "--load-guide", &learned];
    for guide in [&plain[..], &guided] {
        let options = [&[&door[..], "--spp", SPP, "--size", "16x12", "--aov", "all"], guide].concat();
        let single = files.render(&options, "single.exr", &[]);
        let window =
            |name: &str, crop: &str, part: &str| files.render(&options, name, &["--crop", crop, "--part", part]);
        let parts = [
            window("a1", "0,0,16,5", "1/2"),
            window("a2", "0,0,16,5", "2/2"),
            window("b", "0,5,9,7", "1/1"),
            window("c", "9,5,7,7", "1/1"),
        ];
        assert_same(&single, &files.merge(&parts, "merged.exr"), guide[1]);
        let alone = files.render(&options, "window.exr", &["--crop", "0,0,16,5"]);
        assert_same(&alone, &files.merge(&parts[..2], "merged.exr"), "one window");
        let missing = refused_merge(&parts[..3], false);
        assert!(missing.0 == Unfit::Missing && missing.2.contains("49 of the picture's 192 pixels"), "{missing:?}");
        let over = window("d", "8,5,8,7", "1/1");
        let (fault, names, _) = refused_merge(&[&parts[..3], std::slice::from_ref(&over)].concat(), false);
        assert!(fault == Unfit::Double && names.contains(&over));
    }
}

/// The sum of the first parts is a part in their place: what is merged of it and the others has the bits of all at once, also in several steps.
#[test]
fn first_parts_are_merged_before_the_others_are_there() {
    let files = Files::new();
    let cornell = scene("cornell");
    let options = [&cornell[..], "--guide", "none", "--spp", "200", "--size", "16x12", "--aov", "all"];
    let parts = files.parts(&options, 4);
    let single = files.render(&options, "single.exr", &[]);
    let two = files.merge(&parts[..2], "2.sum");
    let three = files.merge(&[parts[2].clone(), two.clone()], "3.sum");
    let four = files.merge(&[three.clone(), parts[3].clone()], "4.sum");
    for (what, inputs) in [
        ("two and two", vec![parts[2].clone(), parts[3].clone(), two.clone()]),
        ("three and one", vec![three.clone(), parts[3].clone()]),
        ("four", vec![four]),
    ] {
        assert_same(&single, &files.merge(&inputs, "merged.exr"), what);
    }

    let both = refused_merge(&[two.clone(), parts[1].clone(), parts[2].clone(), parts[3].clone()], true);
    assert!(both.0 == Unfit::Double && both.1.contains(&parts[1]) && both.2.contains("1 to 2/4"), "{both:?}");
    assert_eq!(refused_merge(&[two.clone(), three], true).0, Unfit::Double);
    let (fault, _, message) = refused_merge(&[two.clone(), parts[3].clone()], false);
    assert!(fault == Unfit::Missing && message.contains("3/4"), "{message}");
    let gap = merge_first(&[two.clone(), parts[3].clone()], &files.path("gap.sum"), &Silent).unwrap_err();
    assert!(matches!(gap, Error::Parts { fault: Unfit::Missing, .. }) && !files.path("gap.sum").exists(), "{gap}");
    let late = [&two, &parts[2]].map(|part| part.display().to_string());
    assert!(refused(&["merge", &late[1], "-o", &files.text("gap.sum")]).contains("1/4, 2/4"));
    assert!(refused(&["merge", &late[0], "-o", &files.text("gap.sum"), "--allow-missing"]).contains("--allow-missing"));
    for output in ["gap.sum", "gap.exr"] {
        let of_guides = ["merge", &late[0], "-o", &files.text(output), "--model", "models/default"];
        assert!(refused(&of_guides).contains("--model is for guides") && !files.path(output).exists());
    }
    // A sum is no part that was rendered.
    std::fs::copy(&two, files.path("1.part")).unwrap();
    files.render(&options, "1.part", &["--part", "1/4"]);
    assert_same(&single, &files.merge(&parts, "merged.exr"), "rendered again");

    let good = std::fs::read(&two).unwrap();
    for at in (0..good.len()).step_by(good.len() / 60) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        std::fs::write(&two, bad).unwrap();
        let error = merge(&[two.clone(), parts[2].clone(), parts[3].clone()], false, &Silent).err();
        assert!(error.is_some_and(|error| error.to_string().contains("2.sum")), "byte {at}");
    }
}

/// Why parts are refused, the files at fault, and the message.
pub fn refused_merge(parts: &[PathBuf], allow_missing: bool) -> (Unfit, Vec<PathBuf>, String) {
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
    let Merged { missing, layers, .. } = merge(&parts[1..], true, &Silent).unwrap();
    assert_eq!(missing, ["1/2"]);
    let albedo = layers.channel("albedo.R").unwrap().unwrap();
    assert!(albedo.iter().all(|value| *value == 0.0), "the first part has the layers");
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
