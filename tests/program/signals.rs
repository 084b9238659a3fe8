//! Ctrl-C, SIGTERM and SIGHUP on the real program: what there is is written, the exit code tells it from a whole result, and the same
//! command goes on.
#![cfg(unix)]

use crate::files::{Files, scene};

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use fanal::base::process::ignores;
use fanal::cli::interrupt::EXIT_EARLY;
use fanal::picture::read_image;

const SIGHUP: i32 = 1;
/// What shells report for a process that SIGTERM ended.
const TERMINATED: i32 = 128 + 15;
/// Longer than anything here takes on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(300);

fn start(program: &str, arguments: &[&str]) -> Child {
    let mut command = Command::new(program);
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it can be started")
}

fn fanal(arguments: &[&str]) -> Child {
    start(env!("CARGO_BIN_EXE_fanal"), arguments)
}

/// Waits until `there` says so; the program must not end before.
fn until(child: &mut Child, there: impl Fn() -> bool) {
    let begun = Instant::now();
    while !there() {
        assert!(begun.elapsed() < PATIENCE, "it does not get there");
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be interrupted");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn send(child: &Child, signal: &str) {
    // A process that is gone already is none of the sender's business: its exit code tells.
    let kill = format!("kill -{signal} {}", child.id());
    let _ = Command::new("sh").args(["-c", &kill]).stderr(Stdio::null()).status();
}

/// Sends the signal and waits for the end, which must be an early one.
fn ended_early(child: Child, signal: &str) -> Output {
    send(&child, signal);
    let output = child.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(i32::from(EXIT_EARLY)), "{signal}: {told}");
    assert!(!told.contains("panicked"), "{told}");
    output
}

/// An endless render; it is under way once a picture is there.
fn endless(files: &Files, more: &[&str]) -> Child {
    let (door, output) = (scene("door-ajar"), files.text("out.exr"));
    let _ = std::fs::remove_file(&output);
    let plain = ["render", &door, "-o", &output, "--size", "16x12", "--spp", "16000000", "--guide", "none"];
    let mut child = fanal(&[&plain[..], more].concat());
    until(&mut child, || Path::new(&output).exists());
    child
}

/// Samples per pixel that the statistics name.
fn spp(files: &Files) -> u64 {
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(files.path("stats.json")).unwrap()).unwrap();
    stats["spp"].as_u64().unwrap()
}

/// No checkpoint is due while this renders: the one that is there in the end was written because of the signal.
#[test]
fn f08_renders_keep_picture_and_checkpoint() {
    let files = Files::new();
    let (stats, checkpoint) = (files.text("stats.json"), files.text("a.part"));
    let keep = ["--stats", &stats, "--checkpoint", &checkpoint, "--every", "10000000"];
    let child = endless(&files, &keep);
    assert!(!Path::new(&checkpoint).exists());
    let told = ended_early(child, "TERM").stderr;
    let first = spp(&files);
    assert!((1..16_000_000).contains(&first), "{first}");
    assert!(String::from_utf8_lossy(&told).contains(&format!("interrupted after {first} samples per pixel")));
    let picture = read_image(&files.path("out.exr"), false).unwrap();
    assert!(picture.pixels.iter().all(|pixel| pixel.is_finite()));
    let resume = ["--stats", &stats, "--resume", &checkpoint, "--every", "10000000", "--quiet"];
    let told = ended_early(endless(&files, &resume), "INT").stderr;
    assert!(told.is_empty() && spp(&files) > first, "{first}, then {}", spp(&files));
}

/// The terminal goes away: a render ends early, but not where it was told not to mind.
#[test]
fn f08_hangups() {
    let files = Files::new();
    if !ignores(SIGHUP) {
        ended_early(endless(&files, &[]), "HUP");
    }
    let (door, output) = (scene("door-ajar"), files.text("other.exr"));
    let deaf = "trap '' HUP; exec \"$0\" \"$@\"";
    let program = env!("CARGO_BIN_EXE_fanal");
    let render = ["render", &door, "-o", &output, "--size", "16x12", "--spp", "16000000", "--guide", "none"];
    let mut child = start("sh", &[&["-c", deaf, program][..], &render].concat());
    until(&mut child, || Path::new(&output).exists());
    if let Ok(status) = std::fs::read_to_string(format!("/proc/{}/status", child.id())) {
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim();
        let handled = u64::from_str_radix(mask, 16).unwrap();
        assert_eq!(handled & 1 << (SIGHUP - 1), 0, "{mask}");
    }
    ended_early(child, "TERM");
}

/// Time that runs out is a render's end, not an early one.
#[test]
fn f08_a_spent_budget_is_whole() {
    let files = Files::new();
    let (door, output) = (scene("door-ajar"), files.text("out.exr"));
    let render = ["render", &door, "-o", &output, "--size", "16x12", "--time", "0.5", "--guide", "none"];
    assert_eq!(fanal(&render).wait_with_output().unwrap().status.code(), Some(0));
}

/// The runs that are there get their page; without any there is none.
#[test]
fn f08_comparisons() {
    let files = Files::new();
    let (cornell, output) = (scene("cornell"), files.text("out"));
    let plain = ["compare", &cornell, "-o", &output, "--size", "16x12", "--methods", "none", "--seeds", "1"];
    let mut child = fanal(&[&plain[..], &["--spp", "1,16000000", "--reference-spp", "1"]].concat());
    let runs = files.path("out/runs");
    let recorded = || {
        let names = std::fs::read_dir(&runs).into_iter().flatten().map(|entry| entry.unwrap().file_name());
        names.map(|name| name.into_string().unwrap()).any(|name| name.starts_with("none-") && name.ends_with(".json"))
    };
    until(&mut child, recorded);
    let told = ended_early(child, "TERM").stdout;
    assert!(String::from_utf8_lossy(&told).contains("one run is missing"));
    assert!(files.path("out/index.html").exists());

    let (output, runs) = (files.text("none"), files.path("none/runs"));
    let plain = ["compare", &cornell, "-o", &output, "--size", "16x12", "--methods", "none", "--seeds", "1"];
    let mut child = fanal(&[&plain[..], &["--spp", "1", "--reference-spp", "16000000"]].concat());
    until(&mut child, || runs.exists());
    let told = ended_early(child, "TERM").stderr;
    assert!(String::from_utf8_lossy(&told).contains("stopped"));
    assert!(!files.path("none/index.html").exists());
}

/// Parts of the reference that were whole when a comparison was stopped are not rendered again, and go once the reference is there.
#[test]
fn f08_comparisons_keep_parts_of_the_reference() {
    let files = Files::new();
    let (cornell, output, runs) = (scene("cornell"), files.text("out"), files.path("out/runs"));
    let words =
        ["compare", &cornell, "-o", &output, "--size", "16x12", "--methods", "none", "--seeds", "1", "--spp", "1"];
    let words = [&words[..], &["--reference-spp", "16384"]].concat();
    let part = |number: u32| {
        let ending = format!("-{number}.exr");
        let entries = std::fs::read_dir(&runs).into_iter().flatten().map(|entry| entry.unwrap().path());
        let mut entries = entries.filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with("reference-"));
        entries.find(|path| path.to_str().unwrap().ends_with(&ending))
    };
    let written = |number: u32| std::fs::metadata(part(number).unwrap()).unwrap().modified().unwrap();
    let mut child = fanal(&words);
    until(&mut child, || part(0).is_some());
    let first = written(0);
    ended_early(child, "TERM");
    let mut child = fanal(&words);
    until(&mut child, || part(2).is_some());
    assert_eq!(written(0), first);
    assert!(child.wait().unwrap().success());
    assert!((0..4).all(|number| part(number).is_none()) && files.path("out/reference.exr").exists());
}

/// A recipe of `scenes` rooms.
fn recipe(files: &Files, scenes: u32, spp: u32) -> String {
    let text = format!(
        "name = \"tiny\"\nseed = 3\nheld_out = 0.25\nresolution = [32, 32]\niterations = [1]\ngrids = [12]\n\
         target_spp = {spp}\nmax_trees_per_scene = 8\n[[family]]\nname = \"rooms\"\nscenes = {scenes}\n"
    );
    std::fs::write(files.path("recipe.toml"), text).unwrap();
    files.text("recipe.toml")
}

/// Data generation ends after the scene at hand; a second signal does not wait for that.
#[test]
fn f08_data_generation() {
    let files = Files::new();
    let output = files.text("data");
    let many = recipe(&files, 200, 32);
    let mut child = fanal(&["dataset", &many, "-o", &output]);
    until(&mut child, || files.path("data/index.jsonl").exists());
    let told = ended_early(child, "TERM").stderr;
    assert!(String::from_utf8_lossy(&told).contains("scenes that are missing"));
    assert!(
        Command::new(env!("CARGO_BIN_EXE_fanal")).args(["dataset", "--check", &output]).status().unwrap().success()
    );

    let (output, long) = (files.text("other"), recipe(&files, 1, 1 << 22));
    let mut child = fanal(&["dataset", &long, "-o", &output]);
    until(&mut child, || files.path("other/recipe.json").exists());
    // Two that come at once may be taken for one.
    while child.try_wait().unwrap().is_none() {
        send(&child, "TERM");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(child.wait().unwrap().code(), Some(TERMINATED));
}
