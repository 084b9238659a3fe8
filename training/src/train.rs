//! The training loop.

use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail, ensure};
use burn::tensor::Device;
use fanal::base::Progress;
use fanal::base::files::crc32;
use fanal::cli::lines::Lines;
use fanal::generate::dataset::{Dataset, DatasetIndex, read_datasets};
use fanal::generate::shard::TreeSample;
use fanal::network::weights::Model;
use indicatif::{ProgressBar, ProgressStyle};

use crate::batch::HostBatch;
use crate::cases::{every, spread};
use crate::checkpoint::Data;
use crate::loader::{self, Plan};
use crate::loss::Loss;
use crate::report::Report;
use crate::run::Run;
use crate::view::View;

/// Settings of a training run: the network, the data and the limits.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The data folders.
    pub data: Vec<PathBuf>,
    /// The model folder.
    pub output: PathBuf,
    /// Minutes of training after which to stop (over all parts of a resumed run).
    pub minutes: Option<f64>,
    /// Passes over the data after which to stop.
    pub epochs: Option<u64>,
    /// Whether to go on from the checkpoint in the model folder.
    pub resume: bool,
    /// The folder of a model whose weights a new run begins with; random ones if none.
    pub from: Option<PathBuf>,
    /// Channels, C.
    pub width: usize,
    /// Convolutions per level.
    pub convolutions: usize,
    /// The loss that is minimised.
    pub loss: Loss,
    /// Whether every level has separate weights.
    pub per_level: bool,
    /// Level of an image network, see [`Config::image`](fanal::network::config::Config::image).
    pub image: Option<usize>,
    /// Number of validations without improvement after which to stop.
    pub patience: Option<u32>,
    /// The choice of inputs and pairs that the network is shown.
    pub view: View,
    /// The device on which burn computes, without autodiff.
    pub device: Device,
    /// Seed of weights, order and augmentation.
    pub seed: u64,
    /// Pairs per step.
    pub batch: usize,
    /// Parts of a step that are computed in parallel; a resumed run keeps its own.
    pub parts: usize,
    /// Peak learning rate.
    pub rate: f64,
    /// Time between checkpoints, and least time between validations.
    pub every: Duration,
    /// Step after which to interrupt, as Ctrl-C would.
    pub stop_after: Option<u64>,
    /// Whether to show no progress.
    pub quiet: bool,
}

/// Number of trees for validation.
const VALIDATION_TREES: usize = 384;
/// Result of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Steps done.
    pub step: u64,
    /// Best mean ln(1 + V) on the validation trees.
    pub best: f64,
    /// Trees per second of training in this part of the run.
    pub trees_per_second: f64,
    /// Whether the budget or the patience was spent; otherwise the run was interrupted.
    pub finished: bool,
}

/// Trains until the budget is spent or `interrupt` is set; writes the model folder.
///
/// # Errors
/// When the data or a checkpoint cannot be read, does not fit, or a file cannot be written.
pub fn train(settings: &Settings, interrupt: &AtomicBool) -> Result<Outcome> {
    ensure!(settings.batch > 0, "a batch needs at least one tree");
    ensure!(settings.minutes.is_some() || settings.epochs.is_some(), "give --minutes or --epochs");
    ensure!(
        settings.rate.is_finite() && settings.rate > 0.0,
        "a learning rate of {}: expected more than none",
        settings.rate
    );
    let minutes = settings.minutes.unwrap_or(1.0);
    ensure!(minutes.is_finite() && minutes > 0.0, "{minutes} minutes of training: expected more than none");
    let data = settings.view.apply(read_datasets(&settings.data)?)?;
    let mode = data.mode.clone();
    let (training, validation) = divide(data)?;
    std::fs::create_dir_all(&settings.output).with_context(|| settings.output.display().to_string())?;
    let data = Data { pairs: training.len(), crc32: indices(&settings.data)? };
    let mut run = Run::start(settings, mode, data, spread(&validation, VALIDATION_TREES)?)?;
    let plan = Plan {
        seed: settings.seed,
        batch: settings.batch,
        samples: training.len(),
        parts: run.state.parts,
        config: run.state.config.clone(),
    };
    let batches = loader::start(Arc::new(training), plan.clone(), run.state.step);
    if settings.from.is_some() {
        // What is written in the end is at least as good as what it began with.
        run.validate()?;
    }
    let shown = Shown::new(settings.quiet);
    let mut trees = 0;
    while run.progress(&plan) < 1.0 && !run.exhausted() {
        let batch = batches.recv().context("the thread that prepares data has stopped")?.map_err(|e| anyhow!(e))?;
        trees += batch.iter().map(HostBatch::trees).sum::<usize>();
        run.step(&batch, &plan)?;
        shown.step(run.progress(&plan), run.message());
        if interrupt.load(Ordering::Relaxed) || settings.stop_after.is_some_and(|s| run.state.step >= s) {
            break;
        }
    }
    shown.finish();
    let finished = run.progress(&plan) >= 1.0 || run.exhausted();
    let unimproved = run.state.unimproved;
    run.validate()?;
    if !finished {
        // An interruption at any moment says nothing about whether the run still improves.
        run.state.unimproved = run.state.unimproved.min(unimproved);
    }
    run.save()?;
    if finished {
        let model = Model::load(&settings.output)?;
        Report::new(&model, &every(&validation, VALIDATION_TREES).collect::<Vec<_>>())?.write(&settings.output)?;
    }
    let best = run.state.best.unwrap_or(f64::NAN);
    let seconds = run.state.seconds - run.seconds_before;
    Ok(Outcome { step: run.state.step, best, trees_per_second: trees as f64 / seconds.max(1e-9), finished })
}

/// Checksum of the data folders' indices: shards, seeds of their scenes, numbers of trees.
fn indices(folders: &[PathBuf]) -> Result<u32> {
    let read = |folder: &PathBuf| Ok(serde_json::to_vec(&DatasetIndex::read(folder)?.shards)?);
    let all = folders.iter().map(read).collect::<Result<Vec<_>>>()?;
    Ok(crc32(all.iter().map(Vec::as_slice)))
}

/// Trees to train on, and trees to choose the best weights by: every tenth scene of the training data, family by family, if there are
/// enough, else the held-out trees, which are otherwise left to `eval`, and where there are none the training trees. Scenes of several
/// folders that have the same family and number go together.
fn divide(data: Dataset) -> Result<(Vec<TreeSample>, Vec<TreeSample>)> {
    if data.train.is_empty() {
        bail!("the data folder has no trees to train on");
    }
    // Recipes deal scenes to families in turn: by number alone whole families would never be validated on.
    let scenes: BTreeSet<(u32, u32)> = data.train.iter().map(|t| (t.family, t.scene)).collect();
    if scenes.len() < 10 {
        let validation = if data.held_out.is_empty() { data.train.clone() } else { data.held_out };
        return Ok((data.train, validation));
    }
    let chosen: BTreeSet<(u32, u32)> = scenes.into_iter().skip(4).step_by(10).collect();
    let (validation, training) = data.train.into_iter().partition(|t| chosen.contains(&(t.family, t.scene)));
    Ok((training, validation))
}

/// Progress display on stderr: a bar on a terminal, elsewhere a line from time to time.
struct Shown {
    bar: ProgressBar,
    lines: Option<Lines>,
}

impl Shown {
    fn new(quiet: bool) -> Self {
        if quiet || !std::io::stderr().is_terminal() {
            let lines = (!quiet).then(Lines::begin);
            lines.iter().for_each(|lines| lines.start(0, "steps"));
            return Self { bar: ProgressBar::hidden(), lines };
        }
        let style = ProgressStyle::with_template("{wide_bar} {percent} %, {eta} left, {msg}");
        let bar = ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self { bar, lines: None }
    }

    /// Shows the state after a step; `part` is the part of the budget that is spent.
    fn step(&self, part: f64, message: String) {
        if let Some(lines) = &self.lines {
            lines.message("training");
            lines.advance(1);
            lines.reached(Some(part), &message);
        }
        self.bar.set_position((1000.0 * part) as u64);
        self.bar.set_message(message);
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
        self.lines.iter().for_each(Lines::finish);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fanal::render::{GuideMode, RenderSettings, StopRule};

    /// Scenes of two recipes, whose families are dealt in turn.
    #[test]
    fn every_family_is_validated_on() {
        let of = |family: u32, scene: u32| TreeSample { family, scene, ..TreeSample::default() };
        let dealt = |families: u32, scenes: u32| (0..families * scenes).map(move |i| of(i % families, i));
        let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
        let train = dealt(6, 20).chain(dealt(2, 10)).collect();
        let data = Dataset { mode: mode.clone(), train, held_out: Vec::new() };
        let all = data.train.len();
        let (training, validation) = divide(data).unwrap();
        let families: BTreeSet<u32> = validation.iter().map(|tree| tree.family).collect();
        assert_eq!(families, (0..6).collect());
        assert_eq!(training.len() + validation.len(), all);
        assert!((all / 16..all / 7).contains(&validation.len()), "{} of {all}", validation.len());
        let scenes = |trees: &[TreeSample]| trees.iter().map(|t| (t.family, t.scene)).collect::<BTreeSet<_>>();
        assert!(scenes(&training).is_disjoint(&scenes(&validation)));
        let few = Dataset { mode, train: dealt(3, 3).collect(), held_out: vec![of(0, 9)] };
        let (training, validation) = divide(few).unwrap();
        assert_eq!((training.len(), validation.len()), (9, 1));
    }
}
