//! `fanal dataset`.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use super::in_pool;
use crate::base::{Error, Result};
use crate::cli::args::DatasetArgs;
use crate::cli::interrupt::Ended;
use crate::cli::{interrupt, print, progress};
use crate::generate;
use crate::generate::collect::generate_part;
use crate::generate::dataset::{Summary, check};
use crate::generate::recipe::{Recipe, Source};
use crate::picture::check_folder;

/// Follows a recipe, or checks what one has made.
///
/// # Errors
/// Errors of the recipe, of generation and of the data folder.
pub fn run(args: &DatasetArgs) -> Result<Ended> {
    let watcher = progress::progress(args.common.quiet);
    match (&args.check, &args.recipe, &args.output) {
        (Some(folder), _, _) => told(&in_pool(&args.common, || check(folder))?).map(|()| Ended::Whole),
        (None, Some(recipe), Some(output)) => {
            let recipe = Recipe::read(recipe)?;
            let recipe = if let Some(folder) = &args.scenes { recipe.with_scenes(folder)? } else { recipe };
            std::fs::create_dir_all(output).map_err(|e| Error::io(output, e))?;
            let stop = interrupt::flag()?;
            let missing = if args.only_scenes {
                scenes(&recipe, output, &stop)?
            } else {
                check_folder(&output.join("index.jsonl"))?;
                in_pool(&args.common, || generate_part(&recipe, output, args.part, &*watcher, &stop))?
            };
            if missing == 0 {
                return Ok(Ended::Whole);
            }
            let early = format!("interrupted, scenes that are missing: {missing}; the same command goes on");
            print::warnings(&[early], args.common.quiet);
            Ok(Ended::Early)
        }
        _ => Err(Error::Options("give a recipe and -o DIR, or --check DIR".into())),
    }
}

/// Writes the scenes of the recipe's families as folders that are named after family, number and seed. Returns how many of them are missing
/// because it was stopped.
fn scenes(recipe: &Recipe, output: &Path, stop: &AtomicBool) -> Result<usize> {
    let mut missing = 0;
    for job in recipe.jobs() {
        let Source::Family(family) = job.source else { continue };
        if stop.load(Ordering::Relaxed) {
            missing += 1;
            continue;
        }
        let folder = output.join(format!("{}-{:03}-{:016x}", family.name(), job.index, job.seed));
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
        generate::write(family, job.seed, recipe.resolution, &folder)?;
    }
    Ok(missing)
}

/// Prints what is in sound data.
///
/// # Errors
/// Those of printing.
pub fn told(found: &Summary) -> Result<()> {
    print::line(&format!(
        "{} shards of {} scenes in {} families are sound",
        found.shards, found.scenes, found.families
    ))?;
    print::line(&format!("trees: {} to train on, {} held out", found.train, found.held_out))?;
    print::line(&format!("nodes per tree: input {:.1}, target {:.1}", found.input_nodes, found.target_nodes))?;
    print::line(&format!("samples per input: {:.1} paths, {:.1} photons", found.path_samples, found.photon_samples))?;
    print::line(&format!("KL between independent targets: {:.4} nats", found.floor_kl))
}
