//! What the effects cost that a scene does not use: instructions of the path tracer on plain diffuse scenes over those of a twin
//! from which every effect has been cut out, and whether both give the same radiance to the last bit. Fails where they do not, or where
//! ours takes more than 1.01 times as many.
//!
//!     cargo bench --bench effects [-- SCENE… --samples 4]
//!
//! Instructions are counted by valgrind's callgrind, since containers often forbid the processor's counters: the bench runs itself
//! under it, with `--samples 0` too, so that loading does not count. The library's source is compiled into this program along with
//! the twin, so that the compiler may inline the same into both.
#![allow(dead_code, unused_imports, reason = "not everything of the library is used here")]
#![allow(clippy::wrong_self_convention, reason = "the library exports what is private here")]

#[path = "../../src/base/mod.rs"]
mod base;
#[path = "../../src/math/mod.rs"]
mod math;
#[path = "../../src/picture/mod.rs"]
mod picture;
#[path = "../../src/sampling/mod.rs"]
mod sampling;
#[path = "../../src/geometry/mod.rs"]
mod geometry;
#[path = "../../src/materials/mod.rs"]
mod materials;
#[path = "../../src/lights/mod.rs"]
mod lights;
#[path = "../../src/camera/mod.rs"]
mod camera;
#[path = "../../src/scene/mod.rs"]
mod scene;
#[path = "../../src/film/mod.rs"]
mod film;
#[path = "../../src/guiding/mod.rs"]
mod guiding;
#[path = "../../src/integrators/mod.rs"]
mod integrators;

#[path = "effects/twin.rs"]
mod twin;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use clap::{Parser, ValueEnum};
use glam::Vec3;

use base::random::{Dimension, Random};
use film::PixelFilter;
use geometry::{Pace, Way};
use guiding::target::{DirectLight, Target};
use integrators::path::{CameraPath, PathScratch, PathTracer, RayCount, Wants};
use integrators::{Roulette, TransportSettings};
use lights::learned::LightSampling;
use scene::Scene;
use scene::readers::load;
use twin::Twin;

/// Columns and rows.
const SIZE: u32 = 48;
/// Longest path: what `render` does where it is not told.
const MAX_DEPTH: u32 = 20;
/// Paths at once, as a render traces them.
const BATCH: usize = 1024;
/// What the effects may cost where they are not used.
const MOST: f64 = 1.01;

#[derive(Parser)]
struct Options {
    /// Scenes; without any, two that are plain.
    scenes: Vec<PathBuf>,
    /// Samples per pixel.
    #[arg(long, default_value_t = 4)]
    samples: u64,
    /// Traces with one of the two only and counts nothing.
    #[arg(long)]
    only: Option<Tracer>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Tracer {
    Ours,
    Twin,
}

fn main() -> ExitCode {
    let options = Options::parse();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = ["scenes/cornell", "tests/bench/effects/lamps.json"].map(|name| root.join(name));
    let scenes = if options.scenes.is_empty() { &own[..] } else { &options.scenes };
    let mut sound = true;
    for path in scenes {
        let scene = match load(path).and_then(|loaded| Scene::build(&loaded, [SIZE; 2])) {
            Ok(mut scene) => {
                scene.accel.pace = Pace::only(Way::InFlight);
                scene
            }
            Err(error) => {
                println!("{error}");
                return ExitCode::FAILURE;
            }
        };
        match options.only {
            Some(tracer) => {
                std::hint::black_box(samples(&scene, tracer, options.samples));
            }
            None => sound &= compare(path, &scene, options.samples),
        }
    }
    if sound { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Prints how the two compare; returns whether ours is as it should be, or could not be counted.
fn compare(path: &Path, scene: &Scene, per_pixel: u64) -> bool {
    let [ours, twin] = [Tracer::Ours, Tracer::Twin].map(|tracer| samples(scene, tracer, per_pixel));
    let bits = |radiance: &Vec3| radiance.to_array().map(f32::to_bits);
    let different = ours.iter().zip(&twin).filter(|(ours, twin)| bits(ours) != bits(twin)).count();
    let lit = ours.iter().filter(|radiance| **radiance != Vec3::ZERO).count();
    println!("{}: {different} of {} samples differ, {lit} are lit", path.display(), ours.len());
    let same = different == 0 && lit * 2 > ours.len();
    let (Some(ours), Some(twin)) = (count(path, Tracer::Ours, per_pixel), count(path, Tracer::Twin, per_pixel)) else {
        println!("  instructions: not counted; that takes valgrind");
        return same;
    };
    let per_sample = |count: u64| count as f64 / (u64::from(SIZE * SIZE) * per_pixel) as f64;
    let ratio = ours as f64 / twin as f64;
    let [ours, twin] = [ours, twin].map(per_sample);
    println!("  instructions per sample: {ours:.0}, of the twin {twin:.0}: ratio {ratio:.4}, allowed {MOST}");
    same && ratio <= MOST
}

/// Instructions that the samples take, loading left out; none where they cannot be counted.
fn count(path: &Path, tracer: Tracer, per_pixel: u64) -> Option<u64> {
    let [all, loading] = [per_pixel, 0].map(|samples| collected(path, tracer, samples));
    all?.checked_sub(loading?)
}

/// Instructions of this program while it traces with `tracer` alone.
fn collected(path: &Path, tracer: Tracer, per_pixel: u64) -> Option<u64> {
    let program = std::env::current_exe().ok()?;
    let tracer = tracer.to_possible_value()?;
    // One thread: how often idle ones look for work is a matter of chance.
    let output = Command::new("valgrind")
        .env("RAYON_NUM_THREADS", "1")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(program)
        .arg(path)
        .args(["--only", tracer.get_name(), "--samples", &per_pixel.to_string()])
        .output()
        .ok()?;
    let report = String::from_utf8_lossy(&output.stderr);
    let (_, collected) = report.split_once("Collected : ").filter(|_| output.status.success())?;
    collected.lines().next()?.trim().parse().ok()
}

/// The radiance of every sample.
fn samples(scene: &Scene, tracer: Tracer, per_pixel: u64) -> Vec<Vec3> {
    let indices = (0..per_pixel).flat_map(|sample| (0..u64::from(SIZE * SIZE)).map(move |pixel| (pixel, sample)));
    let mut starts = indices.map(|(pixel, sample)| camera_path(scene, pixel, sample));
    let batches = (u64::from(SIZE * SIZE) * per_pixel).div_ceil(BATCH as u64);
    let mut radiance = Vec::new();
    match tracer {
        Tracer::Ours => {
            let settings = TransportSettings {
                max_depth: MAX_DEPTH,
                light_sampling: true,
                roulette: Roulette::Window,
                guided_distances: false,
            };
            let tracer = PathTracer { scene, settings, field: None, lights: LightSampling::Plain };
            let (mut scratch, mut rays) = (PathScratch::default(), RayCount::default());
            for _ in 0..batches {
                tracer.trace_all(starts.by_ref().take(BATCH), Wants::Radiance, &mut scratch, &mut rays);
                radiance.extend((0..scratch.paths()).map(|index| tracer.radiance(index, &scratch, None)));
            }
        }
        Tracer::Twin => {
            let twin = Twin::new(scene, MAX_DEPTH).expect("the scene is plain");
            let mut scratch = twin::Scratch::default();
            for _ in 0..batches {
                twin.trace(starts.by_ref().take(BATCH), &mut scratch, &mut radiance);
            }
        }
    }
    radiance
}

/// The beginning of a sample's path, as `render` makes it for the samples of one pass.
fn camera_path(scene: &Scene, pixel: u64, sample: u64) -> CameraPath {
    let family = Random::new(0x5EED, pixel, sample % 2);
    let random = Random::new(0, pixel, sample).in_sequences(family.key(), (sample / 2) as u32);
    let [dx, dy] = PixelFilter::default().sample(random.at(Dimension::FILM).next_2d());
    let film = [(pixel % u64::from(SIZE)) as f32 + dx, (pixel / u64::from(SIZE)) as f32 + dy];
    CameraPath { ray: scene.camera.ray(film, scene.camera.lens(&random)), random, pixel: None }
}
