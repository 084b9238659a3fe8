//! A render that is interrupted at any moment and gone on with is the render that was never interrupted, bit for bit.
//!
//! The number of kills of the real program can be raised: `FANAL_KILLS=50 cargo test --release --test program resume -- --nocapture`.

use crate::support::{scenes, stop};

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::base::{Error, Result};
use fanal::guiding::sample::field::{GuideField, PixelValues};
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::proposal::Proposal;
use fanal::picture::Image;
use fanal::picture::Window;
use fanal::picture::read_image;
use fanal::reconstruct::Reconstructor;
use fanal::render::checkpoint::made_for;
use fanal::render::{
    Checkpointing, Control, Fireflies, GuideMode, Outcome, PartOf, RenderSettings, StopRule, learn, render_watched,
    render_with_field,
};
use fanal::scene::Scene;
use fanal::scene::orbit::orbit;
use fanal::scene::readers::load;
use glam::DVec3;
use scenes::{GUIDES, Guide, NILSSON, ZHU, coarse, committed, reconstructor, settings};
use stop::StopAfter;

/// Renders, guided by `field` if there is one, and stops after `chunks` chunks; says whether it was stopped by that.
fn part(
    scene: &Scene,
    settings: &RenderSettings,
    field: Option<&GuideField>,
    checkpoint: &Checkpointing,
    chunks: i64,
) -> Result<(Outcome, bool)> {
    let stop = StopAfter::new(chunks);
    let control = Control { checkpoint: Some(checkpoint), ..Control::new(&stop, &stop.now) };
    let outcome = match field {
        Some(field) => render_with_field(scene, settings, field.clone(), &control)?,
        None => render_watched(scene, settings, reconstructor(settings.guide).as_ref(), &control)?,
    };
    Ok((outcome, stop.now.load(Ordering::Relaxed)))
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

fn keeping(path: &Path, settings: &RenderSettings, scene: &Scene, resume: bool) -> Checkpointing {
    let made_for = made_for(settings, scene.size, "a scene", "a guide");
    let write = Some((path.to_owned(), Duration::from_secs(3600)));
    Checkpointing { made_for, write, resume: resume.then(|| path.to_owned()) }
}

/// Interrupts a render after every `step` chunks, each time in a new run, and holds picture and counts against those of one run.
/// Returns the number of interruptions.
fn interrupted(scene: &Scene, settings: &RenderSettings, field: Option<&GuideField>, step: i64) -> u32 {
    // Of more threads chunks would be larger, and fewer.
    let threads = rayon::current_num_threads().min(4);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| interrupted_here(scene, settings, field, step))
}

fn interrupted_here(scene: &Scene, settings: &RenderSettings, field: Option<&GuideField>, step: i64) -> u32 {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let none = Checkpointing { write: None, ..keeping(&path, settings, scene, false) };
    let (whole, _) = part(scene, settings, field, &none, i64::MAX).unwrap();
    let mut interruptions = 0;
    let outcome = loop {
        let checkpoint = keeping(&path, settings, scene, interruptions > 0);
        // The advance that tells of what was done before counts too.
        let chunks = step + i64::from(interruptions > 0);
        let (outcome, stopped) = part(scene, settings, field, &checkpoint, chunks).unwrap();
        assert_eq!(outcome.unkept, None);
        if !stopped {
            break outcome;
        }
        interruptions += 1;
        assert!(interruptions < 500, "{:?}: it never ends", settings.guide);
    };
    assert!(!outcome.interrupted);
    let what = (settings.guide, settings.stop, step);
    assert!(bits(&outcome.image) == bits(&whole.image), "{what:?}: another picture");
    assert_eq!(outcome.spread, whole.spread, "{what:?}");
    let taken = |of: &Outcome| of.fireflies.as_ref().map(bits);
    assert!(taken(&outcome) == taken(&whole) && outcome.cascade == whole.cascade, "{what:?}: other fireflies");
    assert!(outcome.blocks == whole.blocks && outcome.blocks.is_empty() == settings.part.is_none(), "{what:?}");
    let counts = |o: &Outcome| {
        let s = &o.statistics;
        let iterations: Vec<_> = s.iterations.iter().map(|i| (i.t, i.spp, i.voxels, i.nodes)).collect();
        (s.rays, s.camera_rays, s.samples, s.spp, s.guide.bytes, iterations, s.decisions.clone())
    };
    assert_eq!(counts(&outcome), counts(&whole), "{what:?}");
    let gains = |o: &Outcome| o.evidence.gain.iter().map(|gain| gain.to_bits()).collect::<Vec<_>>();
    assert!(gains(&outcome) == gains(&whole) && outcome.evidence.counted == whole.evidence.counted, "{what:?}");
    interruptions
}

/// Short paths: what is kept between chunks does not know how long they were.
fn short(guide: Guide, spp: u32, seed: u64) -> RenderSettings {
    let mut settings = coarse(guide, spp, seed);
    settings.transport.max_depth = 6;
    settings
}

/// Every chunk of a render is the last of some process: within iterations, between them, at their end, in the final pass.
#[test]
fn f01_every_chunk_may_be_the_last() {
    let scene = committed("door-ajar", [64, 48]);
    for guide in GUIDES.into_iter().chain([NILSSON, ZHU]) {
        let interruptions = interrupted(&scene, &short(guide, 192, 3), None, 1);
        assert!(interruptions >= 3, "{guide:?}: only {interruptions}");
    }
}

/// The same with several chunks in a pass, voxels that appear between them, a guide that is given up, layers and evidence.
#[test]
fn f01_passes_of_several_chunks() {
    let scene = committed("cornell", [160, 120]);
    let mut settings = RenderSettings { gives_up: true, keeps_spread: true, ..short(GUIDES[5], 64, 1) };
    settings.learner.keeps_evidence = true;
    settings.learner.tree.filtered = true;
    assert!(interrupted(&scene, &settings, None, 2) >= 3);
}

/// A final pass whose samples go where noise is, before and after it has found out where.
#[test]
fn f01_samples_that_follow_noise() {
    let scene = committed("cornell", [160, 120]);
    for guide in [GUIDES[0], GUIDES[5]] {
        let settings = RenderSettings { adaptive: true, gives_up: true, keeps_spread: true, ..short(guide, 96, 1) };
        assert!(interrupted(&scene, &settings, None, 1) >= 3, "{guide:?}");
    }
}

#[test]
fn f01_windows_target_errors_and_loaded_guides() {
    let scene = committed("door-ajar", [64, 48]);
    let window = Some(Window { x: 10, y: 5, width: 50, height: 40 });
    let windowed = RenderSettings { crop: window, ..settings(GUIDES[6], 128, 2) };
    assert!(interrupted(&scene, &windowed, None, 1) >= 2);
    let easy = committed("cornell", [48, 36]);
    for guide in [GUIDES[0], GUIDES[1]] {
        let target = RenderSettings { stop: StopRule::TargetError(0.002), ..settings(guide, 1, 2) };
        assert!(interrupted(&easy, &target, None, 1) >= 4, "{guide:?}");
    }
    let stop = AtomicBool::new(false);
    let learning = settings(GUIDES[1], 64, 1);
    let field = learn(&scene, &learning, reconstructor(learning.guide).as_ref(), &Control::new(&Silent, &stop));
    assert!(interrupted(&scene, &settings(GUIDES[1], 256, 4), Some(&field.unwrap()), 1) >= 2);
}

/// A part of a render, unguided and by a given guide, after a first look and without.
#[test]
fn f01_parts_of_a_render() {
    let scene = committed("door-ajar", [64, 48]);
    let part = Some(PartOf::new(2, 2).unwrap());
    let plain = RenderSettings { part, keeps_spread: true, ..short(GUIDES[0], 320, 1) };
    assert!(interrupted(&scene, &plain, None, 1) >= 2);
    let stop = AtomicBool::new(false);
    let learning = short(GUIDES[5], 32, 1);
    let field =
        learn(&scene, &learning, reconstructor(learning.guide).as_ref(), &Control::new(&Silent, &stop)).unwrap();
    let known = PixelValues { of: "it".into(), window: Window::whole(scene.size), values: vec![0.5; 64 * 48] };
    let guided = RenderSettings { part, ..short(GUIDES[5], 320, 4) };
    for field in [field.clone(), field.with_pixel_values(Some(known))] {
        assert!(interrupted(&scene, &guided, Some(&field), 1) >= 2);
    }
}

/// Samples by brightness of passes that are combined, of one that follows noise, of halves, of blocks, and of a part.
#[test]
fn f01_fireflies_that_are_taken_out() {
    let scene = committed("door-ajar", [64, 48]);
    let fireflies = Fireflies::Reweight { kappa: 2.0 };
    let blocks = RenderSettings { fireflies, ..short(GUIDES[0], 192, 3) };
    let part = RenderSettings { part: Some(PartOf::new(2, 2).unwrap()), ..short(GUIDES[0], 320, 1) };
    let target = RenderSettings { stop: StopRule::TargetError(2.0), ..short(GUIDES[0], 1, 2) };
    let passes = short(GUIDES[5], 192, 3);
    let noise = RenderSettings { adaptive: true, ..short(GUIDES[5], 192, 3) };
    for settings in [blocks, part, target, passes, noise] {
        let settings = RenderSettings { fireflies, ..settings };
        assert!(interrupted(&scene, &settings, None, 1) >= 2, "{:?} {:?}", settings.guide, settings.stop);
    }
}

/// Several views on one sheet, by one guide.
#[test]
fn f01_views_that_share_a_guide() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/door-ajar");
    let mut loaded = load(&folder).expect("a committed scene loads");
    // Inside the room.
    orbit(&mut loaded.file, 3, DVec3::new(1.1, 1.3, 3.0)).expect("it is near");
    let scene = Scene::build_views(&loaded, [48, 36]).expect("it builds");
    for guide in [GUIDES[0], GUIDES[5]] {
        assert!(interrupted(&scene, &settings(guide, 128, 2), None, 1) >= 2, "{guide:?}");
    }
}

/// Reconstructs, and wishes for an end meanwhile.
struct Stopping<'a>(Box<dyn Reconstructor>, &'a AtomicBool);

impl Reconstructor for Stopping<'_> {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn rays_per_node(&self) -> f64 {
        self.0.rays_per_node()
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        self.1.store(true, Ordering::Relaxed);
        self.0.reconstruct(trees)
    }
}

/// A wish to stop that comes between two passes leaves a checkpoint too; without one to write, nothing is traced any more.
#[test]
fn f01_wishes_between_passes_are_kept() {
    let scene = committed("door-ajar", [64, 48]);
    let settings = short(GUIDES[5], 192, 3);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let stopped = |checkpoint: &Checkpointing| {
        let stop = AtomicBool::new(false);
        let control = Control { checkpoint: Some(checkpoint), ..Control::new(&Silent, &stop) };
        let outcome = render_watched(&scene, &settings, &Stopping(reconstructor(settings.guide), &stop), &control);
        let outcome = outcome.unwrap();
        assert!(outcome.interrupted && outcome.unkept.is_none());
        assert!(u64::from(outcome.statistics.spp) <= outcome.statistics.samples.div_ceil(64 * 48));
        outcome.statistics.samples
    };
    let none = Checkpointing { write: None, ..keeping(&path, &settings, &scene, false) };
    let alone = stopped(&none);
    assert!(stopped(&keeping(&path, &settings, &scene, false)) > alone && path.exists());
    let (whole, _) = part(&scene, &settings, None, &none, i64::MAX).unwrap();
    let (resumed, _) = part(&scene, &settings, None, &keeping(&path, &settings, &scene, true), i64::MAX).unwrap();
    assert!(!whole.interrupted && !resumed.interrupted);
    assert!(bits(&resumed.image) == bits(&whole.image));
}

/// A checkpoint is for one scene, one set of options and one program; the message says what differs.
#[test]
fn f01_other_renders_are_refused() {
    let scene = committed("cornell", [16, 12]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let made = settings(GUIDES[0], 4096, 1);
    part(&scene, &made, None, &keeping(&path, &made, &scene, false), 1).unwrap();
    let other = RenderSettings { seed: 2, ..made.clone() };
    let refused = |checkpoint: &Checkpointing| {
        let Err(error) = part(&scene, &other, None, checkpoint, 1) else { panic!("it went on") };
        assert!(matches!(error, Error::Options(_)), "{error}");
        error.to_string()
    };
    let message = refused(&keeping(&path, &other, &scene, true));
    assert!(message.contains("seed: 1") && message.contains("seed: 2") && message.contains("a.part"), "{message}");
    let mut checkpoint = keeping(&path, &made, &scene, true);
    checkpoint.made_for = made_for(&made, scene.size, "another scene", "a guide");
    assert!(refused(&checkpoint).contains("another scene"));
}

/// In a large picture the first iterations visit some of the pixels, so that more samples per pixel are begun than are spent.
#[test]
fn f01_large_pictures() {
    let scene = committed("cornell", [512, 384]);
    for guide in [GUIDES[3], GUIDES[5]] {
        let made = RenderSettings { gives_up: false, ..short(guide, 5, 1) };
        assert!(interrupted(&scene, &made, None, 3) > 0, "{guide:?}");
    }
}

/// The time that an earlier process spent counts against the budget.
#[test]
fn f01_time_goes_on() {
    let scene = committed("cornell", [32, 24]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let made = RenderSettings { stop: StopRule::Time(3.0), ..settings(GUIDES[0], 1, 1) };
    let begun = Instant::now();
    part(&scene, &made, None, &keeping(&path, &made, &scene, false), 20).unwrap();
    let first = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let (outcome, _) = part(&scene, &made, None, &keeping(&path, &made, &scene, true), i64::MAX).unwrap();
    let (second, total) = (begun.elapsed().as_secs_f64(), outcome.statistics.seconds.total);
    assert!(first > 0.2 && second < 3.0 - 0.5 * first, "{first} s, then {second} s");
    assert!((total - first - second).abs() < 0.5, "{total} s of {first} and {second}");
}

/// Kills of the real program in each test.
fn kills() -> u32 {
    std::env::var("FANAL_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(3)
}

fn fanal(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::inherit());
    command.spawn().expect("the program was built for this test")
}

/// Runs the program to its end; returns the seconds that took.
fn completed(arguments: &[&str]) -> f64 {
    let begun = Instant::now();
    assert!(fanal(arguments).wait().unwrap().success(), "{arguments:?}");
    begun.elapsed().as_secs_f64()
}

/// Kills the program after some time; returns whether it was still running.
fn killed(arguments: &[&str], after: f64) -> bool {
    let mut child = fanal(arguments);
    std::thread::sleep(Duration::from_secs_f64(after));
    let running = child.try_wait().unwrap().is_none();
    // SIGKILL: nothing can be tidied up.
    child.kill().unwrap();
    child.wait().unwrap();
    running
}

/// Kills a render at random moments again and again; `resumed` counts those that had a checkpoint to go on from. An output file of
/// before, or a picture of an earlier moment, is there and whole after every kill.
fn kill_renders(guide: &str, seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/door-ajar").display().to_string();
    let (whole, broken, checkpoint) = (file("whole.exr"), file("broken.exr"), file("a.part"));
    let base = ["render", &scene, "--size", "96x72", "--spp", "160", "--guide", guide, "--quiet", "--seed", "5", "-o"];
    let with = |more: &[&'static str], output: &str| -> Vec<String> {
        let words = base.iter().copied().chain([output]).chain(more.iter().copied());
        words.map(str::to_owned).collect()
    };
    let seconds = completed(&with(&["--threads", "2"], &whole).iter().map(String::as_str).collect::<Vec<_>>());
    std::fs::copy(&whole, &broken).unwrap();
    let mut random = Random::new(seed, 0, 0);
    let (mut interruptions, mut resumed) = (0, 0);
    while interruptions < kills() {
        let exists = Path::new(&checkpoint).exists();
        let threads = ["1", "2", "3"][random.below(3) as usize];
        let mut arguments = with(&["--every", "0.01", "--threads", threads], &broken);
        arguments.extend([if exists { "--resume" } else { "--checkpoint" }.to_owned(), checkpoint.clone()]);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let after = f64::from(random.range(0.1, 0.8)) * seconds;
        if killed(&arguments, after) {
            interruptions += 1;
        } else {
            // It came to its end: the next one begins anew.
            assert!(
                bits(&read_image(Path::new(&broken), false).unwrap())
                    == bits(&read_image(Path::new(&whole), false).unwrap())
            );
            std::fs::remove_file(&checkpoint).unwrap();
        }
        resumed += u32::from(exists);
        let picture = read_image(Path::new(&broken), false).expect("an old picture or a new one, never half of one");
        assert_eq!((picture.width, picture.height), (96, 72));
    }
    assert!(Path::new(&checkpoint).exists(), "{guide}: no kill left a checkpoint");
    let mut arguments = with(&["--threads", "2"], &broken);
    arguments.extend(["--resume".to_owned(), checkpoint.clone()]);
    completed(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let [a, b] = [&whole, &broken].map(|path| bits(&read_image(&PathBuf::from(path), false).unwrap()));
    assert!(a == b, "{guide}: another picture");
    println!("{guide}: {interruptions} kills, {resumed} resumed");
}

#[test]
fn f01_killed_renders_go_on() {
    for (guide, seed) in [(GuideMode::None, 1), (GuideMode::Gaussian, 2), (GuideMode::Neural, 3)] {
        kill_renders(guide.name(), seed);
    }
}

/// Names and contents of the finished files of a folder.
fn finished(folder: &Path) -> Vec<(std::ffi::OsString, Vec<u8>)> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let finished = files.filter(|path| path.extension().is_none_or(|e| e != "part"));
    let mut all: Vec<_> =
        finished.map(|path| (path.file_name().unwrap().to_owned(), std::fs::read(path).unwrap())).collect();
    all.sort();
    all
}

/// Data generation that is killed makes the same shards and the same index. One that comes to its end begins anew.
#[test]
fn f01_killed_data_generation_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = folder.path().join("recipe.toml");
    let text = "name = \"tiny\"\nseed = 3\nheld_out = 0.25\nresolution = [32, 32]\niterations = [1]\ngrids = [12]\n\
                target_spp = 64\nmax_trees_per_scene = 8\n[[family]]\nname = \"rooms\"\nscenes = 4\n\
                [[family]]\nname = \"primitives\"\nscenes = 4\n";
    std::fs::write(&recipe, text).unwrap();
    let recipe = recipe.display().to_string();
    let [whole, broken] = ["whole", "broken"].map(|name| folder.path().join(name));
    let command =
        |to: &Path| ["dataset".to_owned(), recipe.clone(), "--quiet".into(), "-o".into(), to.display().to_string()];
    let [first, second] = [command(&whole), command(&broken)];
    let [first, second] = [first.each_ref().map(String::as_str), second.each_ref().map(String::as_str)];
    let seconds = completed(&first);
    let whole = finished(&whole);
    // Eight shards, their index, and what is kept of the recipe.
    assert_eq!(whole.len(), 10);
    let mut random = Random::new(7, 0, 0);
    let (mut interruptions, mut resumed) = (0, 0);
    while interruptions < kills() {
        let exists = broken.exists() && finished(&broken).len() > 2;
        if killed(&second, f64::from(random.range(0.1, 0.6)) * seconds) {
            interruptions += 1;
            resumed += u32::from(exists);
        } else {
            assert!(whole == finished(&broken), "other data");
            std::fs::remove_dir_all(&broken).unwrap();
        }
    }
    println!("data generation: {interruptions} kills, {resumed} of runs that went on");
    completed(&second);
    assert!(whole == finished(&broken), "other data");
}
