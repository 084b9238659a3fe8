//! Parts, and merges, that are ended before they are done.

use crate::files::{Files, scene};
use crate::parts::{all_of, refused_merge, works};
use crate::support::scenes;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::base::{Progress, Unfit};
use fanal::film::{Block, Pass};
use fanal::picture::Channel;
use fanal::render::merge::merge;
use fanal::render::part_file::{self, PartHead, Totals};
use fanal::render::{
    Checkpointing, Control, GuideMode, PartOf, RenderSettings, learn, render_watched, render_with_field,
};
use glam::Vec3;
use scenes::{GUIDES, committed, reconstructor, settings};

/// SIGTERM keeps a part's state, and the same command goes on; one that is done stays as it is. So does learning.
#[cfg(unix)]
#[test]
fn f08_parts_and_learning_go_on() {
    let files = Files::new();
    let door = scene("door-ajar");
    let part =
        ["render", &door, "--guide", "none", "--size", "48x36", "--spp", "1536", "--part", "2/2", "--threads", "1"];
    let learn = ["learn", &door, "--guide", "gaussian", "--size", "32x24", "--spp", "256", "--threads", "1"];
    for command in [&part[..], &learn] {
        let (whole, broken) = (files.text("whole"), files.text("broken"));
        works(&[command, &["-o", &whole, "--quiet"]].concat());
        // Each time twice as long, so that a busy machine comes to the end too.
        let (mut interruptions, mut saved) = (0u32, 0);
        loop {
            let mut child = Command::new(env!("CARGO_BIN_EXE_fanal"))
                .args([command, &["-o", &broken, "--quiet"]].concat())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(50 << interruptions));
            let _ =
                Command::new("sh").args(["-c", &format!("kill -TERM {}", child.id())]).stderr(Stdio::null()).status();
            match child.wait().unwrap().code() {
                Some(0) => break,
                Some(75) => saved += 1,
                // The signal came before it is heard.
                None => {}
                other => panic!("{other:?}"),
            }
            interruptions += 1;
            assert!(!Path::new(&broken).exists(), "an unfinished file");
            assert!(interruptions < 16, "it never ends");
        }
        assert!(saved > 0 && !files.path("broken.checkpoint").exists());
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

/// Counts the samples that are told of, and wishes to stop after so many steps.
struct Counted {
    stop: crate::support::stop::StopAfter,
    total: AtomicU64,
    steps: Mutex<Vec<u64>>,
}

impl Counted {
    fn until(steps: i64) -> Self {
        let stop = crate::support::stop::StopAfter::new(steps);
        Self { stop, total: AtomicU64::new(0), steps: Mutex::default() }
    }

    fn steps(&self) -> Vec<u64> {
        self.steps.lock().unwrap().clone()
    }
}

impl Progress for Counted {
    fn start(&self, total: u64, _: &str) {
        self.total.store(total, Ordering::Relaxed);
    }
    fn advance(&self, n: u64) {
        self.steps.lock().unwrap().push(n);
        self.stop.advance(n);
    }
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}

/// A part counts against its own samples, and one that was ended early renders no sample twice: it goes on from its checkpoint. So does
/// one with a first look, which every part makes.
#[test]
fn parts_go_on_from_their_checkpoints() {
    let files = Files::new();
    let scene = committed("cornell", [48, 32]);
    let pixels = 48 * 32;
    let (look, part) = (4, PartOf::new(2, 2).unwrap());
    let plain = RenderSettings { part: Some(part), ..settings(GUIDES[0], 5 * 64, 1) };
    let guided = RenderSettings { part: Some(part), ..settings(GUIDES[2], 5 * 64 + look, 1) };
    let learning = RenderSettings { part: None, ..settings(GUIDES[2], 8, 1) };
    let learn_control = Counted::until(i64::MAX);
    let never = Control::new(&learn_control, &learn_control.stop.now);
    let field = learn(&scene, &learning, reconstructor(guided.guide).as_ref(), &never).unwrap();
    assert!(field.pixel_values().is_none(), "then there is no look");
    // Three of five blocks.
    for (settings, samples) in [(&plain, 3 * 64), (&guided, 3 * 64 + u64::from(look))] {
        let path = files.path("2.part.checkpoint");
        let run = |steps: i64, resumes: bool| {
            let told = Counted::until(steps);
            let write = Some((path.clone(), Duration::from_secs(3600)));
            let checkpoint = Checkpointing { made_for: "it".into(), write, resume: resumes.then(|| path.clone()) };
            let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&told, &told.stop.now) };
            let outcome = match settings.guide {
                GuideMode::None => {
                    render_watched(&scene, settings, reconstructor(settings.guide).as_ref(), &control).unwrap()
                }
                _ => render_with_field(&scene, settings, field.clone(), &control).unwrap(),
            };
            assert_eq!(told.total.load(Ordering::Relaxed), samples * pixels);
            (outcome, told.steps())
        };
        let (whole, steps) = run(i64::MAX, false);
        assert!(steps.len() > 2 && steps.iter().sum::<u64>() == samples * pixels, "{steps:?}");
        let (early, before) = run(2, false);
        assert!(early.interrupted && before == steps[..2], "{before:?}");
        let (outcome, after) = run(i64::MAX, true);
        assert_eq!(after[0], before.iter().sum::<u64>(), "what the checkpoint holds");
        assert_eq!(after[1..], steps[2..], "only what is left");
        assert!(!outcome.interrupted && outcome.blocks == whole.blocks);
    }
}

/// A checkpoint between parts is named as what it is.
#[test]
fn unfinished_parts_are_named() {
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

/// A part of a picture that nobody has rendered, with layers.
fn made_up_part(files: &Files, part: PartOf, size: [u32; 2]) -> PathBuf {
    let path = files.path(&format!("{}.part", part.index()));
    let mut random = Random::new(part.index().into(), 0, 0);
    let mut pass = Pass::new(size[0] as usize, size[1] as usize);
    let pixels = (size[0] * size[1]) as usize;
    (0..2).for_each(|sample| {
        (0..pixels).for_each(|pixel| pass.add(pixel, sample, Vec3::splat(random.next_f32())));
    });
    let names = ["albedo.R", "albedo.G", "albedo.B"].map(str::to_owned);
    let layers = names.clone().map(|name| Channel { name, values: (0..pixels).map(|_| random.next_f32()).collect() });
    let head = PartHead {
        part,
        merged: 0,
        in_common: "a picture".into(),
        size,
        window: [0, 0, size[0], size[1]],
        samples: 64 * part.count(),
        spp: 64 * part.count(),
        detailed: false,
        film_layers: [false; 2],
        fireflies: None,
        channels: names.to_vec(),
        attributes: Vec::new(),
        layer_attributes: Vec::new(),
        totals: Totals::default(),
    };
    let layers = if part.index() == 1 { &layers[..] } else { &[] };
    part_file::write(&path, &head, &[Block::of(&pass, false)], None, layers).unwrap();
    path
}

/// A merge that is killed at any moment leaves the picture of before, or the new one.
#[test]
fn f01_killed_merges_leave_whole_pictures() {
    let files = Files::new();
    let parts = [1, 2].map(|index| made_up_part(&files, PartOf::new(index, 2).unwrap(), [256, 192]));
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
