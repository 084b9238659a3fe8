//! Whether renders end when they were asked to.
//!
//!     cargo bench --bench budgets -- time [SCENE…]      --time: seconds of the whole command against what was asked
//!     cargo bench --bench budgets -- error [--runs 20]  --target-error: the true error against what was asked
//!
//! The times are those of the program from its start to its end, loading, learning and writing included. The errors are those of
//! procedural scenes of all families, each with a reference of its own made by other seeds with eight times the samples; the
//! reference's variance, from its four parts, is subtracted. A scene whose first samples promise far too much is given up after
//! 10,000 samples per pixel and a line says so.

use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Instant;

use clap::{Parser, Subcommand};
use fanal::base::progress::Progress;
use fanal::film::{mean_and_variance, measure_noisy};
use fanal::generate::{self, Family};
use fanal::picture::Image;
use fanal::reconstruct::{AsCounted, Neural, Reconstructor};
use fanal::render::{GuideMode, Outcome, RenderSettings, StopRule, render};
use fanal::scene::Scene;

#[derive(Parser)]
struct Options {
    #[command(subcommand)]
    what: Option<What>,
    /// Given by cargo.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

#[derive(Subcommand)]
enum What {
    /// How long `--time` takes.
    Time {
        /// Scenes; without any, three of our own.
        scenes: Vec<PathBuf>,
        /// Seconds asked for.
        #[arg(long, value_delimiter = ',', default_values_t = [1.0, 4.0, 12.0])]
        seconds: Vec<f64>,
    },
    /// How good `--target-error` is.
    Error {
        #[arg(long, default_value_t = 20)]
        runs: u64,
        /// relMSE asked for, as part of what 32 samples per pixel leave: the first look must not be the last.
        #[arg(long, default_value_t = 0.25)]
        part: f64,
    },
}

fn main() {
    match Options::parse().what {
        None => println!("budgets: say 'time' or 'error'; see the head of tests/bench/budgets.rs"),
        Some(What::Time { scenes, seconds }) => times(&scenes, &seconds),
        Some(What::Error { runs, part }) => errors(runs, part),
    }
}

/// Samples per pixel after which a render is given up.
const MOST_SPP: u32 = 10_000;

fn times(scenes: &[PathBuf], seconds: &[f64]) {
    let own = ["cornell", "door-ajar", "glass-caustic"];
    let own = own.map(|name| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes")).join(name));
    let scenes = if scenes.is_empty() { &own[..] } else { scenes };
    let folder = tempfile::tempdir().expect("a folder for pictures");
    let mut worst = 0.0f64;
    println!("{:32} {:>10} {:>8} {:>8} {:>8} {:>10}", "scene", "size", "guide", "asked", "took", "of allowed");
    for scene in scenes {
        for size in ["64x48", "256x192", "1024x768"] {
            for guide in ["none", "neural"] {
                for asked in seconds {
                    let begun = Instant::now();
                    let status = Command::new(env!("CARGO_BIN_EXE_fanal"))
                        .arg("render")
                        .arg(scene)
                        .args(["--quiet", "--guide", guide, "--size", size, "--time", &asked.to_string(), "-o"])
                        .arg(folder.path().join("out.exr"))
                        .status();
                    let took = begun.elapsed().as_secs_f64();
                    assert!(status.is_ok_and(|s| s.success()), "{} could not be rendered", scene.display());
                    let share = (took - asked).abs() / (0.02 * asked).max(0.5);
                    worst = worst.max(share);
                    let name = scene.file_name().unwrap_or(scene.as_os_str()).to_string_lossy();
                    println!("{name:32} {size:>10} {guide:>8} {asked:>8} {took:>8.2} {share:>10.2}");
                }
            }
        }
    }
    println!("worst: {worst:.2} of what is allowed (2 % or 0.5 s, whichever is larger)");
}

fn errors(runs: u64, part: f64) {
    let neural = Neural::built_in().expect("the model compiled in");
    let mut ratios = Vec::new();
    let mut run = 0;
    for number in 0.. {
        if run == runs {
            break;
        }
        let family = Family::ALL[number as usize % Family::ALL.len()];
        let loaded = generate::load(family, 7_000_000 + number, [64, 64]).expect("generated scenes are sound");
        let scene = Scene::build(&loaded, [64, 64]).expect("generated scenes are sound");
        let guide = if run % 2 == 0 { GuideMode::None } else { GuideMode::Neural };
        let make = |stop, guide, seed| -> Outcome {
            let mut settings = RenderSettings::new(guide, stop);
            settings.transport.max_depth = loaded.file.render.max_depth;
            settings.seed = seed;
            let counted = AsCounted::default();
            let reconstructor: &dyn Reconstructor = if guide == GuideMode::Neural { &neural } else { &counted };
            let limit = Limit::new(i64::from(MOST_SPP) * 64 * 64);
            render(&scene, &settings, reconstructor, &limit, &limit.stop).expect("a picture")
        };
        let first = make(StopRule::TargetError(1e9), guide, 500 + run).statistics.estimated_relmse;
        let target = part * first.expect("it ran to a target");
        if target == 0.0 {
            println!("{:30} is black or constant, so it has no error", loaded.file.name);
            continue;
        }
        run += 1;
        let found = make(StopRule::TargetError(target), guide, run);
        if found.statistics.spp >= MOST_SPP {
            println!(
                "{:30} {:>7} given up: estimated {:?}, asked {target:.4}",
                loaded.file.name,
                guide.name(),
                found.statistics.estimated_relmse
            );
            continue;
        }
        let parts: Vec<Image> = (0..4)
            .map(|part| make(StopRule::Spp((2 * found.statistics.spp).max(256)), guide, 1000 + 10 * run + part).image)
            .collect();
        let (mean, variance) = mean_and_variance(&parts).expect("pictures of one size");
        let error = measure_noisy(&found.image, &mean, Some(&variance)).expect("pictures of one size").relmse;
        ratios.push(error / target);
        println!(
            "{:30} {:>7} {:>7} spp, {:6.1} s: relMSE {error:.4}, estimated {:.4}, asked {target:.4}: {:.2}",
            loaded.file.name,
            guide.name(),
            found.statistics.spp,
            found.statistics.seconds.total,
            found.statistics.estimated_relmse.unwrap_or(f64::NAN),
            error / target
        );
    }
    ratios.sort_by(f64::total_cmp);
    let count = ratios.len();
    let inside = ratios.iter().filter(|r| (0.75..=1.25).contains(*r)).count();
    println!(
        "true error over the one asked for: median {:.3}, from {:.2} to {:.2}; {inside} of {count} within 25 %",
        0.5 * (ratios[ratios.len() / 2] + ratios[(ratios.len() - 1) / 2]),
        ratios[0],
        ratios[ratios.len() - 1]
    );
}

/// Ends a render that takes too many samples.
struct Limit {
    left: AtomicI64,
    stop: AtomicBool,
}

impl Limit {
    fn new(samples: i64) -> Self {
        Self { left: AtomicI64::new(samples), stop: AtomicBool::new(false) }
    }
}

impl Progress for Limit {
    fn start(&self, _total: u64, _unit: &str) {}
    fn message(&self, _text: &str) {}
    fn finish(&self) {}

    fn advance(&self, steps: u64) {
        if self.left.fetch_sub(steps as i64, Ordering::Relaxed) < steps as i64 {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}
