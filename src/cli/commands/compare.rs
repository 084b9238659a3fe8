//! `fanal compare`.

use std::time::Instant;

use clap::ValueEnum;

use super::render::settled;
use super::{in_pool, load_scene};
use crate::base::{Error, Result};
use crate::cli::args::{CompareArgs, Switch, VariantArgs};
use crate::cli::interrupt::Ended;
use crate::cli::resolve::resolve;
use crate::cli::{interrupt, print, progress};
use crate::film::{Denoiser, check_size};
use crate::reconstruct::Neural;
use crate::reconstruct::buckets::Buckets;
use crate::render::{GuideMode, Reconstruction, RenderSettings, StopRule};
use crate::report::experiment::{Method, Variant};
use crate::report::results::Interval;
use crate::report::{Budget, Experiment, page};
use crate::scene::readers::{How, LoadedScene};
use crate::scene::views::choose;

/// Runs the comparison and writes its page.
///
/// # Errors
/// Errors of reading, rendering and writing.
pub fn run(args: &CompareArgs) -> Result<Ended> {
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, e))?;
    in_pool(&args.common, || {
        let denoiser = args.denoise.then(Denoiser::new).transpose()?;
        let begun = Instant::now();
        let how = How { definitions: &args.definitions, missing: args.missing, ..How::default() };
        let mut loaded = load_scene(&args.scene, &how, &args.common)?;
        choose(&mut loaded.file, None)?;
        let load_seconds = begun.elapsed().as_secs_f64();
        let size = args.size.unwrap_or([loaded.file.film.width, loaded.file.film.height]);
        check_size(size[0], size[1])?;
        let neural = args.model.as_ref().map_or_else(Neural::built_in, |folder| Neural::embedded(folder))?;
        let mut settings = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1));
        // The plan goes by the scene's depth, so it must know of another one.
        loaded.file.render.max_depth = args.max_depth.unwrap_or(loaded.file.render.max_depth);
        settings.transport.max_depth = loaded.file.render.max_depth;
        settings.filter = loaded.file.film.filter;
        neural.check_mode(&settings.mode())?;
        let variants = variants(&args.variant, &loaded, &neural)?;
        let methods = distinct(args.methods.iter().copied());
        let experiment = Experiment {
            loaded: &loaded,
            path: args.scene.display().to_string(),
            load_seconds,
            settings,
            size,
            methods: methods.into_iter().chain((0..variants.len()).map(Method::Variant)).collect(),
            variants: &variants,
            budgets: budgets(args),
            seeds: args.seeds,
            reference: args.reference.clone().map(|r| (r, args.reference_variance.clone())),
            reference_spp: args.reference_spp,
            oracle_spp: args.oracle_spp,
            denoiser: denoiser.as_ref(),
            neural: &neural,
            folder: &args.output,
        };
        let comparison = experiment.run(&*progress::progress(args.common.quiet), &*interrupt::flag()?)?;
        page::write(&comparison, &args.output)?;
        for s in &comparison.results.summary {
            let e = &s.relmse_trimmed;
            let first = &comparison.results.methods[0];
            let over = |r: Interval| format!("  over {first} {:.3} [{:.3}, {:.3}]", r.mean, r.low, r.high);
            print::line(&format!(
                "{:>8}  {:8} {:>8.0} spp {:>8.2} s  trimmed relMSE {:.5} [{:.5}, {:.5}]{}",
                comparison.results.budgets[s.budget].label(),
                s.method,
                s.spp,
                s.seconds,
                e.mean,
                e.low,
                e.high,
                s.ratio.map_or(String::new(), over),
            ))?;
        }
        if let Some(text) = comparison.interruption() {
            print::line(&text)?;
        }
        print::line(&format!("{}", args.output.join("index.html").display()))?;
        Ok(if comparison.missing > 0 { Ended::Early } else { Ended::Whole })
    })
}

/// The methods that were described by options, in their order; refused where two would have one name.
fn variants(given: &[VariantArgs], loaded: &LoadedScene, neural: &Neural) -> Result<Vec<Variant>> {
    let mut variants: Vec<Variant> = Vec::new();
    for VariantArgs { name, render } in given {
        // Files of the page are called by methods, and one by the reference.
        let taken = Method::from_str(name, true).is_ok()
            || name.eq_ignore_ascii_case("reference")
            || variants.iter().any(|v| v.name.eq_ignore_ascii_case(name));
        if taken {
            return Err(Error::Options(format!(
                "--variant: there is another method called {name}; give it another name"
            )));
        }
        let settings = resolve(render, &loaded.file).and_then(|request| {
            let (_, settings) = settled(&request, loaded);
            if settings.reconstruction == Reconstruction::Neural {
                Buckets::fitting(neural, &settings.mode())?;
            }
            Ok(settings)
        });
        let settings = settings.map_err(|error| Error::Options(format!("--variant {name}: {error}")))?;
        // As `fanal render` has it: where complete paths are added, samples are not divided by noise.
        let even = (settings.complete_paths > 0.0).then_some(false);
        let adaptive = render.adaptive.map(Switch::is_on).or(even);
        variants.push(Variant { name: name.clone(), settings, adaptive });
    }
    Ok(variants)
}

/// The budgets in ascending order, each once.
fn budgets(args: &CompareArgs) -> Vec<Budget> {
    let mut time = args.time.clone();
    time.sort_by(f64::total_cmp);
    let mut spp = args.spp.clone();
    spp.sort_unstable();
    distinct(time.into_iter().map(Budget::Seconds).chain(spp.into_iter().map(Budget::Spp)))
}

fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(&value) {
            kept.push(value);
        }
    }
    kept
}
