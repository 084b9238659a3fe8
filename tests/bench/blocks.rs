//! Whether the modes are unbiased on a whole scene: means of blocks of 16 × 16 pixels over independent seeds against a
//! reference, Welch's test in every block, Šidák's correction over the blocks (one false alarm in a hundred runs per mode).
//!
//!     cargo bench --bench blocks -- SCENE --reference REF.exr [--variance VAR.exr] [--spp 32] [--seeds 16] [--modes …]
//!     cargo bench --bench blocks -- SCENE --reference-spp 1024 …        renders 8 references by `none` itself
//!     cargo bench --bench blocks -- SCENE --effects=each …              with each effect alone the other way round than planned
//!     cargo bench --bench blocks -- SCENE --effects=+medium,-photons …  with each of these alone
//!
//! `each` leaves out what would change the scene itself, and light sampling, without which some lights are never found.
//!
//! Also prints the mean of the picture relative to the reference's, and the same without the pixels that are the brightest 0.1 %
//! of the reference, for scenes whose tails are too heavy for any test of means. (Leaving out each picture's own brightest pixels
//! would take the fireflies from the noisier one, and with them light that belongs to it.)

#[path = "../support/blocks.rs"]
mod blocks;
#[path = "../support/statistics.rs"]
#[allow(dead_code, reason = "shared with the tests")]
mod statistics;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use blocks::{BLOCK, block_means, channel_means, summaries};
use clap::Parser;
use fanal::base::progress::Silent;
use fanal::picture::{Image, read_image};
use fanal::reconstruct::gaussian::Gaussian;
use fanal::reconstruct::nilsson::Nilsson;
use fanal::reconstruct::{AsCounted, Neural, Reconstructor};
use fanal::render::{GuideMode, Reconstruction, RenderSettings, StopRule, render};
use fanal::scene::Scene;
use fanal::scene::overrides::{Override, decide};
use fanal::scene::plan::{EffectKind, EffectPlan, plan};
use fanal::scene::readers::load_with;
use statistics::{Summary, sidak};

/// Probability of a false alarm per mode and run.
const FALSE_ALARM: f64 = 0.01;
/// References rendered where none is given.
const REFERENCES: u64 = 8;

#[derive(Parser)]
struct Options {
    /// Scene file or folder.
    scene: PathBuf,
    /// The truth, as EXR.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Variance of the truth per pixel and channel, as EXR; without it the truth counts as exact.
    #[arg(long, requires = "reference")]
    variance: Option<PathBuf>,
    /// Samples per pixel of each of 8 references that are rendered without guiding.
    #[arg(long, default_value_t = 1024)]
    reference_spp: u32,
    #[arg(long, default_value_t = 32)]
    spp: u32,
    #[arg(long, default_value_t = 16)]
    seeds: u64,
    /// As in `fanal render --guide`.
    #[arg(long, value_delimiter = ',', default_value = "none,hybrid,neural")]
    modes: Vec<String>,
    /// Effects to switch, each alone, as in `fanal render --effects`; `each` are all that must not change the picture.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
    effects: Vec<String>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A truth with its error.
struct Truth {
    blocks: Vec<Summary>,
    mean: f64,
    trimmed: f64,
    /// Pixels brighter than this are left out of the trimmed mean.
    limit: f64,
    pixels: Vec<f64>,
}

fn main() {
    if std::env::args().all(|a| a.starts_with('-') || a == std::env::args().next().unwrap_or_default()) {
        println!("blocks: give SCENE; see the head of tests/bench/blocks.rs");
        return;
    }
    let options = Options::parse();
    let neural = Neural::built_in().expect("the model compiled in");
    let planned = Subject::new(&options.scene, &[]);
    let truth = match &options.reference {
        Some(path) => given(path, options.variance.as_deref()),
        None => {
            let seeds = 900_000..900_000 + REFERENCES;
            rendered(&planned.pictures("none", &neural, options.reference_spp, seeds))
        }
    };
    let switched = switched(&options.effects, &planned.plan);
    for mode in &options.modes {
        compare(mode, &planned, &neural, &options, &truth);
        for &change in &switched {
            print!("{}{} ", if change.on { '+' } else { '-' }, change.kind.name());
            compare(mode, &Subject::new(&options.scene, &[change]), &neural, &options, &truth);
        }
    }
}

/// The effects that are to be switched, each alone.
fn switched(effects: &[String], plan: &EffectPlan) -> Vec<Override> {
    let sought = [EffectKind::Photons, EffectKind::Guiding, EffectKind::Reconstruction];
    let each = plan.effects.iter().filter(|effect| !effect.on || sought.contains(&effect.name));
    let each = each.map(|effect| Override { kind: effect.name, on: !effect.on });
    let one = |text: &String| match text.as_str() {
        "each" => each.clone().collect::<Vec<_>>(),
        other => vec![other.parse::<Override>().unwrap_or_else(|e| panic!("{e}"))],
    };
    effects.iter().flat_map(one).collect()
}

/// A scene with some effects switched.
struct Subject {
    scene: Scene,
    plan: EffectPlan,
    max_depth: u32,
}

impl Subject {
    fn new(path: &Path, overrides: &[Override]) -> Self {
        let loaded = load_with(path, overrides).expect("a scene");
        let file = &loaded.file;
        let mut plan = plan(file);
        decide(&mut plan, overrides);
        let scene = Scene::build(&loaded, [file.film.width, file.film.height]).expect("a scene");
        Self { scene, plan, max_depth: file.render.max_depth }
    }

    fn pictures(&self, mode: &str, neural: &Neural, spp: u32, seeds: Range<u64>) -> Vec<Image> {
        let guide = GuideMode::ALL.into_iter().find(|guide| guide.name() == mode);
        let guide = guide.unwrap_or_else(|| panic!("unknown mode {mode}"));
        let one = |seed| {
            let mut settings = RenderSettings::new(guide, StopRule::Spp(spp)).following(&self.plan);
            settings.transport.max_depth = self.max_depth;
            settings.seed = seed;
            let counted = AsCounted::default();
            let reconstructor: &dyn Reconstructor = match settings.reconstruction {
                Reconstruction::Neural => neural,
                Reconstruction::Gaussian => &Gaussian::default(),
                Reconstruction::Nilsson => &Nilsson,
                Reconstruction::None => &counted,
            };
            render(&self.scene, &settings, reconstructor, &Silent, &AtomicBool::new(false)).expect("a picture").image
        };
        seeds.map(one).collect()
    }
}

/// Prints how a mode's blocks compare with the truth.
fn compare(mode: &str, subject: &Subject, neural: &Neural, options: &Options, truth: &Truth) {
    let tail = sidak(FALSE_ALARM, truth.blocks.len());
    let pictures = subject.pictures(mode, neural, options.spp, 2000..2000 + options.seeds);
    let blocks = summaries(&pictures);
    let tests: Vec<f64> = blocks.iter().zip(&truth.blocks).map(|(a, b)| a.welch(b, tail)).collect();
    let worst = (0..tests.len()).max_by(|&a, &b| tests[a].total_cmp(&tests[b])).expect("a block");
    let means: Vec<f64> = pictures.iter().map(|p| channel_means(p).iter().sum::<f64>()).collect();
    let mean = Summary::new(&means);
    let pixels = channel_means(&pictures[0]).len() as f64;
    println!(
        "{mode:7} {} blocks, {} seeds of {} spp: worst |t| {:.3} of its limit (block {worst}: {:.5} ± {:.5}, truth \
         {:.5}), {} | mean ratio {:.4} ± {:.4}, trimmed {:.4}",
        tests.len(),
        options.seeds,
        options.spp,
        tests[worst],
        blocks[worst].mean,
        blocks[worst].error(),
        truth.blocks[worst].mean,
        if tests[worst] <= 1.0 { "agrees" } else { "DIFFERS" },
        mean.mean / pixels / truth.mean,
        mean.error() / pixels / truth.mean,
        trimmed(&average(&pictures), &truth.pixels, truth.limit) / truth.trimmed
    );
}

/// The truth from files: per-pixel variances add up over a block.
fn given(reference: &std::path::Path, variance: Option<&std::path::Path>) -> Truth {
    let image = read_image(reference, true).expect("a reference");
    let variance = variance.map(|path| read_image(path, true).expect("a variance"));
    let means = block_means(&image, &channel_means(&image));
    // The channels come from the same paths: the standard deviation of their mean is at most the mean of their deviations.
    let deviation = |v: &glam::Vec3| v.to_array().iter().map(|&x| f64::from(x.max(0.0)).sqrt()).sum::<f64>() / 3.0;
    let spread = |v: &Image| -> Vec<f64> { v.pixels.iter().map(|p| deviation(p).powi(2)).collect() };
    let errors = variance.map(|v| block_means(&v, &spread(&v)));
    let blocks = means.iter().enumerate().map(|(i, &mean)| {
        let pixels = (BLOCK * BLOCK) as f64;
        Summary { mean, variance: errors.as_ref().map_or(0.0, |e| e[i] / pixels), freedom: 1e3 }
    });
    let all = channel_means(&image);
    truth(blocks.collect(), all)
}

fn rendered(pictures: &[Image]) -> Truth {
    let all = average(pictures);
    truth(summaries(pictures), all)
}

fn truth(blocks: Vec<Summary>, pixels: Vec<f64>) -> Truth {
    let mut sorted = pixels.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = sorted[sorted.len() - 1 - sorted.len() / 1000];
    let mean = pixels.iter().sum::<f64>() / pixels.len() as f64;
    Truth { blocks, mean, trimmed: trimmed(&pixels, &pixels, limit), limit, pixels }
}

fn average(pictures: &[Image]) -> Vec<f64> {
    let mut sum = vec![0.0; channel_means(&pictures[0]).len()];
    for picture in pictures {
        sum.iter_mut().zip(channel_means(picture)).for_each(|(s, x)| *s += x / pictures.len() as f64);
    }
    sum
}

/// Mean over the pixels where `truth` is at most `limit`.
fn trimmed(values: &[f64], truth: &[f64], limit: f64) -> f64 {
    let kept = || values.iter().zip(truth).filter(|(_, t)| **t <= limit).map(|(v, _)| v);
    kept().sum::<f64>() / kept().count() as f64
}
