//! Parts of a guide that are ended early, or that cannot be added up.

use crate::files::{Files, scene};
use crate::parts::{fanal, refused};
use crate::support::scenes;
use crate::support::stop::StopAfter;

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use fanal::base::Progress;
use fanal::render::guide_part::{self, LearnedHead};
use fanal::render::{Checkpointing, Control, PartOf, RenderSettings, learn_part};
use scenes::{GUIDES, committed, reconstructor, settings};

/// Wishes to stop after so many steps, and counts those before the share and all.
struct Steps {
    stop: StopAfter,
    before: AtomicI64,
    all: AtomicI64,
}

impl Progress for Steps {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, n: u64) {
        self.all.fetch_add(1, Ordering::Relaxed);
        self.stop.advance(n);
    }
    fn message(&self, text: &str) {
        if text.contains("share") {
            self.before.store(self.all.load(Ordering::Relaxed), Ordering::Relaxed);
        }
    }
    fn finish(&self) {}
}

/// Ended in its share, a part goes on from its checkpoint to the same bits. Paths are short, and enough for two chunks.
#[test]
fn f08_shares_of_learning_go_on() {
    let files = Files::new();
    let scene = committed("cornell", [128, 96]);
    let (guide, part) = (GUIDES[4], PartOf::new(2, 3).unwrap());
    let mut settings = RenderSettings { part: Some(part), ..settings(guide, 64, 1) };
    settings.transport.max_depth = 2;
    let (path, output) = (files.path("a.checkpoint"), files.path("a.guide"));
    let run = |steps: i64, resumes: bool| {
        let told = Steps { stop: StopAfter::new(steps), before: AtomicI64::new(0), all: AtomicI64::new(0) };
        let write = Some((path.clone(), Duration::from_secs(3600)));
        let checkpoint = Checkpointing { made_for: "it".into(), write, resume: resumes.then(|| path.clone()) };
        let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&told, &told.stop.now) };
        let learned = learn_part(&scene, &settings, reconstructor(guide.0).as_ref(), &control).unwrap();
        let head = LearnedHead {
            part,
            in_common: "it".into(),
            voxels: learned.voxels,
            rays: learned.rays,
            settings: settings.learner.clone(),
            reconstruction: settings.reconstruction,
            mode: settings.mode(),
        };
        guide_part::write(&output, &head, &learned.learner, None).unwrap();
        let steps = [told.before.into_inner(), told.all.into_inner()];
        (learned.interrupted, steps, std::fs::read(&output).unwrap())
    };
    let (early, [before, all], whole) = run(i64::MAX, false);
    assert!(!early && before > 0 && all > before + 1, "{before} steps, then {all} in all");
    let (early, steps, bytes) = run(before + 1, false);
    assert!(early && steps == [before, before + 1] && bytes != whole);
    let (early, steps, bytes) = run(i64::MAX, true);
    assert!(!early && bytes == whole, "{steps:?}");
}

/// What cannot be added up is refused before or once it shows, in place of a guide of the first part alone.
#[test]
fn shares_that_cannot_be_added_up_are_refused() {
    let files = Files::new();
    let (door, output) = (scene("door-ajar"), files.text("1.guide"));
    let plain = ["learn", &door, "--size", "16x12", "--quiet", "-o", &output, "--guide", "gaussian"];
    let told = refused(&[&plain[..], &["--spp", "32", "--fraction", "adam", "--part", "1/2"]].concat());
    assert!(told.contains("--fraction adam"), "{told}");
    let told = refused(&[&plain[..], &["--spp", "2", "--part", "1/2"]].concat());
    assert!(told.contains("--spp"), "{told}");
    assert!(!files.path("1.guide").exists());
    let alone = fanal(&[&plain[..], &["--spp", "32", "--fraction", "adam"]].concat());
    assert!(alone.status.success());
}
