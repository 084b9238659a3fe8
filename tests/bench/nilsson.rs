//! What denoising quadtrees is worth, as Nilsson 2022 measured it: tables 5.2 and 5.3 by samples, 5.4 and 5.5 by time.
//!
//!     cargo bench --bench nilsson -- samples SCENE… [--training 32 --rendering 512]
//!     cargo bench --bench nilsson -- time SCENE… [--seconds 20]
//!
//! By samples, guides are learned of so many per pixel, and kept for the picture; denoising has no limit. By time, a render divides it
//! by itself, and denoising keeps to its limit. Prints relMSE, and in brackets what it is without the worst 0.1 % of pixels, of every method, and
//! over the method of Rath et al. 2020 (`radiance` is Müller et al. 2017). No reference is needed: half of the squared difference between
//! two seeds is the variance of either. Relative to the squared mean of all pictures plus 0.01.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use clap::{Parser, Subcommand};
use fanal::base::Result;
use fanal::base::progress::Silent;
use fanal::film::{mean_and_variance, measure, outliers};
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::proposal::Proposal;
use fanal::picture::Image;
use fanal::reconstruct::nilsson::Nilsson;
use fanal::reconstruct::{AsCounted, Reconstructor};
use fanal::render::{Control, GuideMode, RenderSettings, StopRule, learn, render, render_with_field};
use fanal::scene::{Scene, readers};
use glam::Vec3;

#[derive(Parser)]
struct Options {
    #[command(subcommand)]
    what: Option<What>,
    /// Seeds of each method; at least two.
    #[arg(long, global = true, default_value_t = 3)]
    seeds: u64,
    /// Columns and rows.
    #[arg(long, global = true, value_delimiter = 'x', default_values_t = [320, 180])]
    size: Vec<u32>,
    /// Given by cargo.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

#[derive(Subcommand)]
enum What {
    /// Tables 5.2 and 5.3.
    Samples {
        scenes: Vec<PathBuf>,
        #[arg(long, default_value_t = 32)]
        training: u32,
        #[arg(long, default_value_t = 512)]
        rendering: u32,
    },
    /// Tables 5.4 and 5.5.
    Time {
        scenes: Vec<PathBuf>,
        #[arg(long, default_value_t = 20.0)]
        seconds: f64,
    },
}

/// Denoises from an iteration on.
struct Late {
    first: u32,
    /// Whether their limit of the work holds.
    limited: bool,
    /// The last iteration that there was.
    seen: AtomicU32,
}

impl Late {
    fn new(first: u32, limited: bool) -> Self {
        Self { first, limited, seen: AtomicU32::new(0) }
    }
}

impl Reconstructor for Late {
    fn name(&self) -> &'static str {
        "nilsson"
    }

    fn rays_per_node(&self) -> f64 {
        0.0
    }

    fn admits(&self, trees: &[CountedTree], iteration: u32) -> bool {
        self.seen.fetch_max(iteration, Ordering::Relaxed);
        iteration >= self.first && (!self.limited || Nilsson.admits(trees, iteration))
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        Nilsson.reconstruct(trees)
    }
}

/// The methods of the tables.
#[derive(Clone, Copy, PartialEq)]
enum Method {
    /// Müller et al. 2017.
    Radiance,
    /// Rath et al. 2020: as counted.
    Counted,
    /// The same, denoised after the last iteration of learning.
    After,
    /// Denoised while learning, without limit.
    During,
    /// And the target switched.
    Switched,
    /// Denoised while learning, within their limit.
    Limited,
    /// And the target switched.
    LimitedSwitched,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::Radiance => "radiance",
            Self::Counted => "variance",
            Self::After => "denoised after",
            Self::During => "denoised",
            Self::Switched => "denoised, switched",
            Self::Limited => "denoised, limited",
            Self::LimitedSwitched => "limited, switched",
        }
    }

    fn settings(self, stop: StopRule, max_depth: u32, seed: u64) -> RenderSettings {
        let guide = if self == Self::Radiance { GuideMode::Ppg } else { GuideMode::Nilsson };
        let mut settings = RenderSettings::new(guide, stop);
        if !matches!(self, Self::Switched | Self::LimitedSwitched) {
            settings.learner.simple_iterations = 0;
        }
        (settings.transport.max_depth, settings.seed) = (max_depth, seed);
        settings
    }

    /// What it denoises with, where the last iteration of learning has this number.
    fn reconstructor(self, last: u32) -> Box<dyn Reconstructor> {
        match self {
            Self::Radiance | Self::Counted => Box::new(AsCounted::default()),
            Self::After => Box::new(Late::new(last, false)),
            Self::During | Self::Switched => Box::new(Late::new(0, false)),
            Self::Limited | Self::LimitedSwitched => Box::new(Late::new(0, true)),
        }
    }
}

/// relMSE, and the same without the worst pixels.
fn noise(pictures: &[Image], mean: &Image) -> [f64; 2] {
    let (mut all, mut trimmed, mut pairs) = (0.0, 0.0, 0.0);
    for (i, a) in pictures.iter().enumerate() {
        for b in &pictures[i + 1..] {
            let difference = |(a, b): (&Vec3, &Vec3)| (*a - *b).as_dvec3();
            let of = |(d, m): (glam::DVec3, &Vec3)| {
                let m = m.as_dvec3();
                (0.5 * d * d / (m * m + 0.01)).element_sum() / 3.0
            };
            let mut errors: Vec<f64> =
                a.pixels.iter().zip(&b.pixels).map(difference).zip(&mean.pixels).map(of).collect();
            errors.sort_unstable_by(f64::total_cmp);
            let kept = errors.len() - outliers(errors.len());
            all += errors.iter().sum::<f64>() / errors.len() as f64;
            trimmed += errors[..kept].iter().sum::<f64>() / kept as f64;
            pairs += 1.0;
        }
    }
    [all / pairs, trimmed / pairs]
}

fn main() {
    let Options { what, seeds, size, .. } = Options::parse();
    let [width, height] = size[..] else { panic!("--size is WIDTHxHEIGHT") };
    assert!(seeds > 1, "the noise of one seed is not known");
    let stop = AtomicBool::new(false);
    let control = Control::new(&Silent, &stop);
    match what {
        None => println!("nilsson: say 'samples' or 'time'; see the head of tests/bench/nilsson.rs"),
        Some(What::Samples { scenes, training, rendering }) => {
            let methods = [Method::Counted, Method::After, Method::Radiance, Method::During, Method::Switched];
            table(&scenes, [width, height], &methods, seeds, |scene, method, depth, seed| {
                let settings = |spp| method.settings(StopRule::Spp(spp), depth, seed);
                // Which iteration is the last is known once there has been one.
                let last = match method {
                    Method::After => {
                        let late = Late::new(u32::MAX, false);
                        learn(scene, &settings(training), &late, &control).expect("a guide");
                        late.seen.into_inner()
                    }
                    _ => 0,
                };
                let reconstructor = method.reconstructor(last);
                let field = learn(scene, &settings(training), &*reconstructor, &control).expect("a guide");
                render_with_field(scene, &settings(rendering), field, &control).expect("a picture").image
            });
        }
        Some(What::Time { scenes, seconds }) => {
            let methods = [Method::Counted, Method::Radiance, Method::During, Method::Limited, Method::LimitedSwitched];
            table(&scenes, [width, height], &methods, seeds, |scene, method, depth, seed| {
                let settings = method.settings(StopRule::Time(seconds), depth, seed);
                let reconstructor = method.reconstructor(0);
                render(scene, &settings, &*reconstructor, &Silent, &stop).expect("a picture").image
            });
        }
    }
}

/// Prints what each method's pictures have.
fn table(
    scenes: &[PathBuf],
    size: [u32; 2],
    methods: &[Method],
    seeds: u64,
    picture: impl Fn(&Scene, Method, u32, u64) -> Image,
) {
    for path in scenes {
        let loaded = readers::load(path).expect("a scene");
        let scene = Scene::build(&loaded, size).expect("a scene");
        let depth = loaded.file.render.max_depth;
        // In turns, so that what changes slowly about the machine does so for all.
        let mut pictures: Vec<Vec<Image>> = vec![Vec::new(); methods.len()];
        for seed in 1..=seeds {
            for (method, pictures) in methods.iter().zip(&mut pictures) {
                pictures.push(picture(&scene, *method, depth, seed));
            }
        }
        let (mean, _) = mean_and_variance(&pictures.concat()).expect("pictures of one size");
        let first = noise(&pictures[0], &mean);
        for (method, pictures) in methods.iter().zip(&pictures) {
            let ([all, trimmed], name) = (noise(pictures, &mean), method.name());
            let brightness = measure(&pictures[0], &mean).map_or(f64::NAN, |measures| measures.mean_ratio);
            println!(
                "{:14} {name:20} {all:.4} ({trimmed:.4})   over variance {:.3} ({:.3})   mean {brightness:.3}",
                name_of(path),
                all / first[0],
                trimmed / first[1]
            );
        }
    }
}

/// Name of the scene's folder, or of its file.
fn name_of(path: &Path) -> String {
    let path = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
