//! The `fanal` program from outside: help, exit codes, and what a user reads when something is wrong.

use crate::files::scene;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use fanal::picture::read_image;

fn fanal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().expect("the program was built for this test")
}

/// Runs a command that must fail with `code` and one paragraph without panic that holds all of `words`; `output` must not exist
/// afterwards.
fn fails(code: i32, arguments: &[&str], output: Option<&Path>, words: &[&str]) {
    let result = fanal(arguments);
    let told = String::from_utf8_lossy(&result.stderr);
    assert_eq!(result.status.code(), Some(code), "{arguments:?}: {told}");
    assert!(result.stdout.is_empty(), "{arguments:?}: an error is no result");
    assert!(!told.contains("panicked"), "{arguments:?}: {told}");
    assert_eq!(told.trim_end().lines().count(), 1, "{arguments:?}: {told}");
    for word in words {
        assert!(told.contains(word), "{arguments:?}: {word:?} is missing in {told:?}");
    }
    if let Some(output) = output {
        assert!(!output.exists(), "{arguments:?} left {}", output.display());
    }
}

#[test]
fn every_help_has_examples() {
    let commands =
        ["render", "learn", "merge", "plan", "compare", "error", "dataset", "inspect"].map(|name| vec![name]);
    for command in std::iter::once(vec![]).chain(commands) {
        let result = fanal(&[&command[..], &["--help"]].concat());
        let text = String::from_utf8_lossy(&result.stdout);
        assert!(result.status.success());
        assert!(text.contains("Examples:\n  fanal "), "{command:?}: {text}");
        let ends_early = matches!(command[..], [] | ["render" | "learn" | "compare" | "dataset"]);
        assert_eq!(text.contains("75 ended early by Ctrl-C, SIGTERM or SIGHUP"), ends_early, "{command:?}: {text}");
    }
}

#[test]
fn contradictions_and_bad_values_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    let name = out.display().to_string();
    let base = ["render", &scene("cornell"), "-o", &name];
    for (options, words) in [
        (&["--spp", "8", "--time", "2"][..], &["--spp", "--time"][..]),
        (&["--spp", "0"], &["--spp"]),
        (&["--time", "-1"], &["--time"]),
        (&["--time", "NaN"], &["--time"]),
        (&["--spp", "8", "--target-error", "0.1"], &["--spp", "--target-error"]),
        (&["--target-error", "0"], &["--target-error", "relMSE"]),
        (&["--exposure", "NaN"], &["--exposure"]),
        (&["--size", "12"], &["--size", "640x480"]),
        (&["--guide", "magic"], &["--guide", "hybrid"]),
        (&["--threads", "0"], &["--threads"]),
        (&["--pixel-filter", "lens"], &["--pixel-filter", "blackman-harris"]),
        (&["--crop", "1,2,3"], &["--crop", "four whole numbers"]),
        (&["--crop", "1,2,-3,4"], &["--crop", "four whole numbers"]),
        (&["--aov", "albedo,lantern"], &["--aov", "lantern", "guiding"]),
        (&["--lanterns"], &["--lanterns"]),
    ] {
        fails(2, &[&base, options].concat(), Some(&out), words);
    }
    fails(2, &["render", &scene("cornell")], None, &["--output"]);
    fails(2, &["dataset", "recipe.toml"], None, &["--output"]);
    fails(2, &["compare", &scene("cornell"), "-o", &name], Some(&out), &["--time"]);
    fails(2, &["dataset", "recipe.toml", "--check", "data"], None, &["--check"]);
}

#[test]
fn bad_input_is_one_readable_paragraph() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    let name = out.display().to_string();
    let cornell = scene("cornell");
    let broken = folder.path().join("broken.json");
    std::fs::write(&broken, "{\n\"version\": 1,\n\"camera\": 7\n}").unwrap();
    let broken = broken.display().to_string();
    let missing = folder.path().join("missing/out.exr").display().to_string();
    let data = folder.path().display().to_string();
    for (arguments, words) in [
        (&["render", "no-such-scene.json", "-o", &name][..], &["no-such-scene.json"][..]),
        (&["render", &broken, "-o", &name], &["broken.json", "3"]),
        (&["render", &cornell, "-o", &name, "--size", "4000000000x4000000000"], &["4000000000x4000000000"]),
        (&["render", &cornell, "-o", &name, "--size", "0x5"], &["0x5"]),
        (&["render", &cornell, "-o", &name, "--guide", "none", "--samples", "both"], &["--samples"]),
        (&["render", &cornell, "-o", &name, "--guide", "vmf", "--samples", "both"], &["--samples"]),
        (&["render", &cornell, "-o", &name, "--guide", "none", "--guided-distances", "on"], &["--guided-distances"]),
        (&["render", &cornell, "-o", &name, "--complete-paths", "0.5", "--adaptive", "on"], &["--complete-paths"]),
        (&["render", &cornell, "-o", &name, "--every", "5"], &["--every", "--checkpoint", "--resume"]),
        (&["learn", &cornell, "-o", &name, "--guide", "paths"], &["--guide paths", "no guide file"]),
        (&["render", &cornell, "-o", &name, "--reference", "no-such.exr"], &["no-such.exr"]),
        (&["render", &cornell, "-o", &name, "--stats", &missing], &["missing"]),
        (&["render", &cornell, "-o", "out.jpg"], &["out.jpg", ".exr"]),
        (&["render", &cornell, "-o", &name, "--size", "8x6", "--crop", "0,0,9,1"], &["--crop", "0,0,9,1", "8x6"]),
        (&["render", &cornell, "-o", &name, "--size", "8x6", "--crop", "0,0,0,1"], &["--crop", "0,0,0,1", "8x6"]),
        (&["render", &cornell, "-o", "out.png", "--aov", "depth"], &["--aov", ".exr", "PNG"]),
        (&["render", &cornell, "-o", &name, "--stats", &name], &["two options", &name]),
        (&["render", &cornell, "-o", &name, "--save-guide", &missing, "--stats", &missing], &["missing"]),
        (&["render", &cornell, "-o", &missing], &["missing"]),
        (&["plan", "no-such-scene.xml"], &["no-such-scene.xml"]),
        (&["error", "a.exr", "b.exr"], &["a.exr"]),
        (&["dataset", "no-such.toml", "-o", &name], &["no-such.toml"]),
        (&["dataset", "--check", &missing], &["missing"]),
        (&["merge", &data, "--model", "models/default"], &["--model is for guides"]),
        (&["merge", &data, "--backend", "onnx"], &["--backend is for guides"]),
    ] {
        fails(1, arguments, Some(&out), words);
    }
    for unused in [["--model", "models/default"], ["--backend", "onnx"]] {
        let plain = ["render", &cornell, "--size", "8x6", "--spp", "1", "--guide"];
        for how in
            [&["gaussian", "-o", &name][..], &["none", "-o", &name, "--part", "1/1"], &["none", "--replay", "0,0,0"]]
        {
            let told = fanal(&[&plain[..], how, &unused].concat());
            let warning = format!("warning: {} has no effect", unused[0]);
            assert!(told.status.success() && String::from_utf8_lossy(&told.stderr).contains(&warning), "{told:?}");
        }
    }
    let other = folder.path().join("comparison").display().to_string();
    let taken = ["compare", &cornell, "-o", &other, "--spp", "1", "--variant", "Reference: --guide none"];
    fails(1, &taken, None, &["--variant", "Reference"]);
}

#[test]
fn errors_between_pictures() {
    use fanal::picture::Image;
    let folder = tempfile::tempdir().unwrap();
    let picture = |name: &str, value: f32| {
        let path = folder.path().join(name);
        let image = Image { width: 3, height: 2, pixels: vec![glam::Vec3::splat(value); 6] };
        fanal::picture::write(&path, &image, &[]).unwrap();
        path.display().to_string()
    };
    let (a, b) = (picture("a.exr", 0.3), picture("b.exr", 0.1));
    let result = fanal(&["error", &a, &b, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&result.stdout).unwrap();
    assert!((json["relmse"].as_f64().unwrap() - 2.0).abs() < 1e-5, "{json}");
    // (0.3 − 0.1)² is 0.04, of which the reference's own variance is half; 0.1² + 0.01 is 0.02.
    let variance = picture("variance.exr", 0.02);
    let result = fanal(&["error", &a, &b, "--json", "--reference-variance", &variance]);
    let json: serde_json::Value = serde_json::from_slice(&result.stdout).unwrap();
    for measure in ["relmse", "relmse_trimmed"] {
        assert!((json[measure].as_f64().unwrap() - 1.0).abs() < 1e-5, "{json}");
    }
    let text = fanal(&["error", &a, &a]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("relMSE            0.000000"));
}

#[test]
fn plans_of_our_scenes() {
    let on = |name: &str| -> Vec<String> {
        let result = fanal(&["plan", &scene(name), "--json"]);
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        let json: serde_json::Value = serde_json::from_slice(&result.stdout).unwrap();
        let effects = json["effects"].as_array().unwrap();
        effects.iter().filter(|e| e["on"] == true).map(|e| e["name"].as_str().unwrap().to_owned()).collect()
    };
    assert!(on("door-ajar").contains(&"guiding".into()));
    assert!(on("glass-caustic").contains(&"transmission".into()));
    assert!(on("white-furnace").contains(&"environment".into()));
    assert!(!on("blinds").contains(&"photons".into()));
    assert!(!on("cornell").contains(&"transmission".into()));
}

/// Effects that a scene does not call for, compiled in, change no bit; those switched off are gone from the statistics.
#[test]
fn effects_are_switched() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let render = |name: &str, more: &[&str]| -> serde_json::Value {
        let (picture, stats) = (file(&format!("{name}.exr")), file(&format!("{name}.json")));
        let scene = scene("cornell");
        let fixed = ["render", &scene, "-o", &picture, "--stats", &stats, "--spp", "8", "--size", "24x24", "--quiet"];
        let result = fanal(&[&fixed, more].concat());
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap()
    };
    let off = |stats: &serde_json::Value, effect: &str| {
        stats["effects"].as_array().unwrap().iter().any(|e| e["name"] == effect && e["on"] == false)
    };
    let plain = render("plain", &["--guide", "none"]);
    assert!(off(&plain, "medium") && off(&plain, "guiding") && !off(&plain, "area-lights"));
    for (name, effects) in [("media", "+medium"), ("glass", "+transmission,+masks")] {
        render(name, &["--guide", "none", "--effects", effects]);
        let same = fanal(&["error", &file(&format!("{name}.exr")), &file("plain.exr"), "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&same.stdout).unwrap();
        assert_eq!(json["relmse"], 0.0, "{effects}");
    }
    let learned = render("learned", &["--guide", "gaussian", "--effects", "-photons,-direct-light"]);
    assert!(off(&learned, "photons") && off(&learned, "direct-light") && !off(&learned, "guiding"));
    assert!(learned["decisions"].as_array().unwrap()[0].as_str().unwrap().starts_with("guiding o"));
    assert_eq!(learned["seconds"]["photons"], 0.0);
    let dark = render("dark", &["--guide", "gaussian", "--effects", "-area-lights"]);
    assert_eq!(dark["method"], "none", "nothing is learned where there is no light");
    let refused = fanal(&["plan", &scene("cornell"), "--effects", "-fog"]);
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("medium"));
}

/// A scene without some of its files is refused with all their names, or rendered without them where that is asked for; then the
/// picture and the statistics say so, and no checkpoint of it is taken for one of the whole scene.
#[test]
fn missing_files_are_named_or_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let body = "<scene version='3.0.0'>\n<sensor type='perspective'/>\n<emitter type='constant'/>\n\
        <shape type='obj'><string name='filename' value='lost.obj'/></shape>\n<shape type='rectangle'><bsdf type='diffuse'>\n\
        <texture type='bitmap' name='reflectance'><string name='filename' value='lost.png'/></texture></bsdf></shape></scene>";
    std::fs::write(folder.path().join("scene.xml"), body).unwrap();
    let (scene, picture, stats, part) = (file("scene.xml"), file("out.exr"), file("stats.json"), file("out.part"));
    let render = ["render", &scene, "-o", &picture, "--size", "8x6", "--guide", "none", "--spp", "2"];
    let words = [
        "2 files are missing",
        "lost.obj (named at",
        "scene.xml:4)",
        "lost.png (named at",
        "scene.xml:6)",
        "--missing skip",
    ];
    fails(1, &render, Some(Path::new(&picture)), &words);
    fails(1, &["plan", &scene], None, &words);
    fails(1, &["compare", &scene, "--spp", "1", "-o", &file("compared")], None, &words);
    fails(2, &[&render[..], &["--missing", "what"]].concat(), None, &["--missing", "refuse", "skip"]);
    fails(2, &["inspect", "a.guide", "--missing", "skip"], None, &["--scene"]);
    let skip =
        [&render[..], &["--missing", "skip", "--stats", &stats, "--checkpoint", &part, "--every", "1e-9"]].concat();
    let result = fanal(&skip);
    let told = String::from_utf8_lossy(&result.stderr);
    assert!(result.status.success(), "{told}");
    assert!(told.contains("scene.xml:4: ") && told.contains("scene.xml:6: ") && told.contains("0.5 is used"), "{told}");
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert_eq!(stats["missing_files"], serde_json::json!(["lost.obj", "lost.png"]));
    let header = exr::meta::MetaData::read_from_file(&picture, false).unwrap().headers.remove(0).own_attributes.other;
    let missing = header.iter().find(|(name, _)| *name == "missingFiles");
    assert!(matches!(missing, Some((_, exr::meta::attribute::AttributeValue::Text(text))) if *text == *"2"));
    assert!(fanal(&["plan", &scene, "--missing", "skip"]).status.success());
    let resume = [&render[..], &["--missing", "skip", "--resume", &part]].concat();
    assert!(fanal(&resume).status.success(), "the same scene goes on");
    std::fs::write(folder.path().join("lost.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    fails(1, &[&resume[..], &["--quiet"]].concat(), None, &["out.part", "scene"]);
}

/// A scene that names files beside its folder is refused with what helps, and read where that is allowed.
#[test]
fn files_of_another_folder_are_allowed_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    std::fs::write(folder.path().join("shared.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let body = "<scene version='3.0.0'><sensor type='perspective'/><emitter type='constant'/>\
        <shape type='obj'><string name='filename' value='../shared.obj'/></shape></scene>";
    std::fs::write(inner.join("scene.xml"), body).unwrap();
    let scene = inner.display().to_string();
    fails(1, &["plan", &scene], None, &["../shared.obj", "scene.xml:1", "FANAL_SCENE_ROOT"]);
    let allowed = |root: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
        command.args(["plan", &scene]).env("FANAL_SCENE_ROOT", root).output().unwrap().status.success()
    };
    assert!(allowed(folder.path()) && !allowed(&inner));
}

/// A saved field guides another render and can be looked into; a damaged one is refused with its name.
#[test]
fn guides_are_saved_loaded_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (guide, picture, drawing) = (file("door.guide"), file("out.exr"), file("tree.png"));
    let works = |arguments: &[&str]| {
        let result = fanal(&[arguments, &["--quiet"]].concat());
        let told = String::from_utf8_lossy(&result.stderr);
        assert!(result.status.success(), "{arguments:?}: {told}");
        String::from_utf8_lossy(&result.stdout).into_owned()
    };
    let door = scene("door-ajar");
    let render = ["render", &door, "--size", "48x36", "--spp", "24", "-o", &picture, "--guide", "gaussian"];
    works(&[&render[..], &["--save-guide", &guide]].concat());
    let stats = file("stats.json");
    works(&[&render[..], &["--load-guide", &guide, "--stats", &stats]].concat());
    let stats = std::fs::read_to_string(&stats).unwrap();
    assert!(stats.contains("\"iterations\": []") && !stats.contains("\"trees\": 0,"), "{stats}");
    // Where guiding is off, nothing is guided: neither picture nor replay knows of the guide.
    let unguided = |options: &[&str]| {
        let fixed = [&["render", &door, "--size", "48x36", "--spp", "24"][..], options].concat();
        let told = works(&[&fixed[..], &["--replay", "20,15,3,0"]].concat());
        let result = fanal(&[&fixed[..], &["-o", &picture]].concat());
        let warned = String::from_utf8_lossy(&result.stderr).contains("guiding is off");
        (read_image(Path::new(&picture), false).unwrap().pixels, told, warned)
    };
    let (pixels, told, warned) = unguided(&["--guide", "none"]);
    let off = unguided(&["--guide", "gaussian", "--load-guide", &guide, "--effects", "-guiding"]);
    assert!(!warned && off == (pixels, told, true));
    let told = works(&["inspect", &guide, "--at", "1,0.01,0.5", "-o", &drawing]);
    assert!(told.contains("voxels") && told.contains("facing +y"), "{told}");
    works(&["inspect", &guide, "--scene", &door, "--size", "48x36", "-o", &drawing]);
    let drawing = Path::new(&drawing);
    assert!(std::fs::metadata(drawing).unwrap().len() > 100);
    std::fs::remove_file(drawing).unwrap();
    let far = ["inspect", &guide, "--at", "1e6,0,0", "-o", "tree.png"];
    fails(1, &far, None, &["nothing is known"]);
    fails(2, &["inspect", &guide, "--at", "1,2", "-o", "tree.png"], None, &["--at", "three numbers"]);
    let mut bytes = std::fs::read(&guide).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&guide, bytes).unwrap();
    fails(1, &["inspect", &guide], None, &["door.guide", "damaged"]);
    std::fs::remove_file(&picture).unwrap();
    fails(1, &[&render[..], &["--load-guide", &guide]].concat(), Some(Path::new(&picture)), &["door.guide"]);
}

/// Layers lie in one part beside the picture, which does not change by them.
#[test]
fn layers_are_written_beside_the_picture() {
    use fanal::picture::read_exr_channels;
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let render = |name: &str, options: &[&str]| {
        let path = file(name);
        let cornell = scene("cornell");
        let plain = ["render", &cornell, "--size", "20x15", "--spp", "4", "--guide", "none", "--quiet", "-o", &path];
        let result = fanal(&[&plain[..], options].concat());
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        read_exr_channels(Path::new(&path)).unwrap()
    };
    let (_, _, plain) = render("plain.exr", &[]);
    let (width, height, all) = render("all.exr", &["--aov", "all"]);
    assert_eq!((width, height, all.len()), (20, 15, 3 + 15 + 2 * 12), "features, and two mattes of six ids");
    let find = |name: &str| all.iter().find(|(other, _)| other == name);
    assert!(plain.iter().all(|channel| find(&channel.0) == Some(channel)));
    assert!(find("samples.Y").unwrap().1.iter().all(|&n| n == 4.0));
    assert!(find("variance.R").unwrap().1.iter().all(|v| v.is_finite() && *v >= 0.0));
    let (_, _, two) = render("two.exr", &["--aov", "depth,albedo"]);
    let names: Vec<&str> = two.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["B", "G", "R", "albedo.B", "albedo.G", "albedo.R", "depth.Z"]);
}

/// The header says how a picture was made, and two makings differ in nothing but time and threads.
#[test]
fn headers_say_how_the_picture_was_made() {
    use exr::meta::MetaData;
    use exr::meta::attribute::AttributeValue;
    let folder = tempfile::tempdir().unwrap();
    let render = |name: &str, threads: &str| {
        let path = folder.path().join(name);
        let (scene, output) = (scene("cornell"), path.display().to_string());
        let options = ["render", &scene, "-o", &output, "--size", "20x15", "--spp", "4", "--guide", "none", "--quiet"];
        let more = ["--seed", "3", "--max-depth", "5", "--pixel-filter", "tent", "--threads", threads];
        assert!(fanal(&[&options[..], &more].concat()).status.success());
        path
    };
    let attributes = |path: &Path| {
        let header = MetaData::read_from_file(path, false).unwrap().headers.remove(0).own_attributes;
        let text = |value| if let AttributeValue::Text(text) = value { text.to_string() } else { String::new() };
        let software = header.software_name.map(|name| ("software".to_owned(), name.to_string()));
        header.other.into_iter().map(|(k, v)| (k.to_string(), text(v))).chain(software).collect::<BTreeMap<_, _>>()
    };
    let [mut one, mut two] = [("1.exr", "1"), ("2.exr", "2")].map(|(name, threads)| attributes(&render(name, threads)));
    for (name, value) in [
        ("software", concat!("fanal ", env!("CARGO_PKG_VERSION"))),
        ("scene", &scene("cornell")),
        ("method", "none"),
        ("seed", "3"),
        ("size", "20x15"),
        ("filter", r#"{"type":"tent","radius":1.0}"#),
        ("maxDepth", "5"),
        ("stop", "spp 4"),
        ("spp", "4"),
        ("droppedSamples", "0"),
        ("threads", "1"),
    ] {
        assert_eq!(one.get(name).map(String::as_str), Some(value), "{name}: {one:?}");
    }
    assert!(one["seconds"].parse::<f64>().is_ok_and(|seconds| seconds >= 0.0));
    for name in ["seconds", "threads"] {
        assert!(one.remove(name).is_some() && two.remove(name).is_some());
    }
    assert_eq!(one, two);
}

/// A window lies in its place in an EXR file and alone in a PNG file, and is compared with its part of a whole picture.
#[test]
fn windows_are_rendered_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let cornell = scene("cornell");
    let render = |name: &str, options: &[&str]| {
        let path = file(name);
        let plain = ["render", &cornell, "--size", "20x15", "--spp", "2", "--guide", "none", "--quiet", "-o", &path];
        let result = fanal(&[&plain[..], options].concat());
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        path
    };
    let (whole, stats) = (render("whole.exr", &[]), file("stats.json"));
    let part = render("part.exr", &["--crop", "3,4,8,6", "--reference", &whole, "--stats", &stats]);
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert_eq!((&stats["width"], &stats["height"], &stats["errors"][0]["relmse"]), (&8.into(), &6.into(), &0.0.into()));
    let header = exr::meta::MetaData::read_from_file(&part, false).unwrap().headers.remove(0);
    assert_eq!(header.shared_attributes.display_window.size, exr::math::Vec2(20, 15));
    assert_eq!(header.own_attributes.layer_position, exr::math::Vec2(3, 4));
    assert_eq!(header.layer_size, exr::math::Vec2(8, 6));
    let shown = render("part.png", &["--crop", "3,4,8,6"]);
    let size = fanal::picture::read_image(Path::new(&shown), false).map(|image| (image.width, image.height));
    assert_eq!(size.unwrap(), (8, 6));
    for pair in [[&part, &whole], [&whole, &part], [&part, &part]] {
        let text = fanal(&["error", pair[0], pair[1]]);
        let text = String::from_utf8_lossy(&text.stdout);
        assert!(text.contains("relMSE            0.000000"), "{pair:?}: {text}");
    }
    let other = render("other.exr", &["--crop", "4,4,8,6"]);
    fails(1, &["error", &part, &other], None, &["different windows", "3,4,8,6", "4,4,8,6"]);
    let wrong =
        ["render", &cornell, "-o", &file("no.exr"), "--size", "20x16", "--crop", "3,4,8,6", "--reference", &whole];
    fails(1, &wrong, Some(&folder.path().join("no.exr")), &["whole.exr", "20x15", "8x6"]);
}
