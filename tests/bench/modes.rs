//! Compares guide modes on one scene: paired seeds, trimmed relMSE, ratios of geometric means with bootstrap intervals.
//!
//!     cargo bench --bench modes -- SCENE REFERENCE.exr --spp 128 [--time S] [--seeds 8] [--modes none,hybrid,neural]
//!                                  [--model DIR] [--save DIR]
//!
//! Runs are interleaved (seed by seed, all modes in turn), so that a machine that slows down hurts all alike.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::film::{measure, write};
use fanal::materials::image::Image;
use fanal::reconstruct::{Counted, Neural, Reconstructor};
use fanal::render::{GuideMode, RenderSettings, StopRule, render};
use fanal::scene::Scene;
use fanal::scene::readers::{load, read_image};

struct Options {
    scene: PathBuf,
    reference: PathBuf,
    stop: StopRule,
    seeds: u64,
    modes: Vec<GuideMode>,
    model: Option<PathBuf>,
    save: Option<PathBuf>,
}

fn options() -> Options {
    let mut positional = Vec::new();
    let mut named = std::collections::BTreeMap::new();
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(argument) = arguments.next() {
        match argument.strip_prefix("--") {
            Some(name) => _ = named.insert(name.to_owned(), arguments.next().expect("every option has a value")),
            None => positional.push(PathBuf::from(argument)),
        }
    }
    let mode = |name: &str| match name {
        "none" => GuideMode::None,
        "hybrid" => GuideMode::Hybrid,
        "neural" => GuideMode::Neural,
        other => panic!("unknown mode {other}"),
    };
    let number = |name: &str| named.get(name).map(|v| v.parse::<f64>().expect("a number"));
    let [scene, reference] = positional.try_into().expect("SCENE REFERENCE.exr");
    Options {
        scene,
        reference,
        stop: number("time").map_or(StopRule::Spp(number("spp").unwrap_or(128.0) as u32), StopRule::Time),
        seeds: number("seeds").unwrap_or(8.0) as u64,
        modes: named.get("modes").map_or("none,hybrid,neural", String::as_str).split(',').map(mode).collect(),
        model: named.get("model").map(PathBuf::from),
        save: named.get("save").map(PathBuf::from),
    }
}

fn main() {
    if std::env::args().all(|a| !a.ends_with(".exr")) {
        println!("modes: give SCENE REFERENCE.exr; see the head of tests/bench/modes.rs");
        return;
    }
    let options = options();
    let loaded = load(&options.scene).expect("a scene");
    let scene = Scene::build(&loaded, [loaded.file.film.width, loaded.file.film.height]).expect("a scene");
    let reference = read_image(&options.reference, true).expect("a reference");
    let neural = options.modes.contains(&GuideMode::Neural).then(|| match &options.model {
        Some(folder) => Neural::embedded(folder).expect("a model"),
        None => Neural::built_in().expect("the model compiled in"),
    });
    let mut errors = vec![Vec::new(); options.modes.len()];
    for seed in 0..options.seeds {
        for (mode, errors) in options.modes.iter().zip(&mut errors) {
            errors.push(run(
                &options,
                &scene,
                &reference,
                *mode,
                neural.as_ref(),
                1000 + seed,
                loaded.file.render.max_depth,
            ));
        }
    }
    summary(&options.modes, &errors);
}

fn run(
    options: &Options,
    scene: &Scene,
    reference: &Image,
    mode: GuideMode,
    neural: Option<&Neural>,
    seed: u64,
    max_depth: u32,
) -> f64 {
    let mut settings = RenderSettings::new(mode, options.stop);
    settings.seed = seed;
    settings.transport.max_depth = max_depth;
    let counted = Counted::default();
    let reconstructor: &dyn Reconstructor = match neural {
        Some(neural) if mode == GuideMode::Neural => neural,
        _ => &counted,
    };
    let outcome = render(scene, &settings, reconstructor, &Silent, &AtomicBool::new(false)).expect("a picture");
    let error = measure(&outcome.image, reference).expect("a finite picture of the reference's size");
    let s = &outcome.statistics;
    println!(
        "{:7} seed {seed}: relMSE {:.5} trimmed {:.5} mean ratio {:.4} | {} spp {:.1} s (trace {:.1} photons {:.1} \
         splat {:.1} reconstruct {:.1}) | {} voxels {} nodes {} bytes",
        mode.name(),
        error.relmse,
        error.relmse_trimmed,
        error.mean_ratio,
        s.spp,
        s.seconds.total,
        s.seconds.trace,
        s.seconds.photons,
        s.seconds.splat,
        s.seconds.reconstruct,
        s.guide.voxels,
        s.guide.nodes,
        s.guide.bytes
    );
    if let Some(folder) = &options.save {
        save(folder, mode, seed, &outcome.image);
    }
    error.relmse_trimmed
}

fn save(folder: &Path, mode: GuideMode, seed: u64, image: &Image) {
    for extension in ["png", "exr"] {
        let path = folder.join(format!("{}-{seed}.{extension}", mode.name()));
        write(&path, image, &[], 0.0).expect("the folder can be written");
    }
}

fn summary(modes: &[GuideMode], errors: &[Vec<f64>]) {
    let geometric = |e: &[f64]| (e.iter().map(|x| x.ln()).sum::<f64>() / e.len() as f64).exp();
    for (mode, e) in modes.iter().zip(errors) {
        println!("{:7} trimmed relMSE, geometric mean of {}: {:.5}", mode.name(), e.len(), geometric(e));
    }
    for (b, denominator) in modes.iter().enumerate() {
        for (a, numerator) in modes.iter().enumerate().filter(|&(a, _)| a > b) {
            let logs: Vec<f64> = errors[a].iter().zip(&errors[b]).map(|(x, y)| (x / y).ln()).collect();
            let (low, high) = interval(&logs);
            let ratio = (logs.iter().sum::<f64>() / logs.len() as f64).exp();
            println!("{} / {}: {ratio:.3}  95 % [{low:.3}, {high:.3}]", numerator.name(), denominator.name());
        }
    }
}

/// Percentile bootstrap of the mean of paired log ratios, 10,000 resamples with a fixed seed.
fn interval(logs: &[f64]) -> (f64, f64) {
    let mut random = Random::new(1, 2, 3);
    let n = logs.len() as u32;
    let mean = |random: &mut Random| (0..n).map(|_| logs[random.below(n) as usize]).sum::<f64>() / f64::from(n);
    let mut means: Vec<f64> = (0..10_000).map(|_| mean(&mut random)).collect();
    means.sort_by(f64::total_cmp);
    (means[250].exp(), means[9749].exp())
}
