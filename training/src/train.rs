//! The training loop.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail, ensure};
use burn::tensor::{Device, Tensor};
use fanal::base::random::Random;
use fanal::generate::dataset::{Dataset, read_dataset};
use fanal::generate::shard::TreeSample;
use fanal::guiding::features::FEATURES;
use fanal::network::config::{Config, VERSION};
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use indicatif::{ProgressBar, ProgressStyle};

use crate::batch::HostBatch;
use crate::cases::{Case, common, mean_kl, reconstruct, spread, tune_uniform};
use crate::checkpoint::{self, CHECKPOINT_FILE, State};
use crate::forward::{decode, encode};
use crate::journal::{Entry, Journal};
use crate::loader::{self, Plan};
use crate::loss::{Loss, losses};
use crate::model::{Net, initial_weights, to_vec};
use crate::optimise::{Gradients, Optimiser, beta, collect, rate, sum};

/// What to train, on what, for how long.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The data folder.
    pub data: PathBuf,
    /// The model folder.
    pub output: PathBuf,
    /// Stop after so many minutes of training (over all parts of a resumed run).
    pub minutes: Option<f64>,
    /// Stop after so many passes over the data.
    pub epochs: Option<u64>,
    /// Go on from the checkpoint in the model folder.
    pub resume: bool,
    /// Channels, C.
    pub width: usize,
    /// Convolutions per level.
    pub convolutions: usize,
    /// What is minimised.
    pub loss: Loss,
    /// Separate weights for every level.
    pub per_level: bool,
    /// Where burn computes, without autodiff.
    pub device: Device,
    /// Seed of weights, order and augmentation.
    pub seed: u64,
    /// Pairs per step.
    pub batch: usize,
    /// Parts of a step that are computed side by side; a resumed run keeps its own.
    pub parts: usize,
    /// Peak learning rate.
    pub rate: f64,
    /// Interrupt after this step, as Ctrl-C would.
    pub stop_after: Option<u64>,
    /// No progress bar.
    pub quiet: bool,
}

/// Trees that validation looks at.
const VALIDATION_TREES: usize = 384;
/// Steps between lines of the log.
const LOG_EVERY: u64 = 10;
/// Time between checkpoints, and between validations.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);
/// Least time between validations relative to what one takes.
const VALIDATION_SHARE: u32 = 20;

/// What a run ends with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Steps done.
    pub step: u64,
    /// Best KL on the validation trees.
    pub best: f64,
    /// Trees per second of training in this part of the run.
    pub trees_per_second: f64,
}

/// Trains until the budget is spent or `interrupt` is set; writes the model folder.
///
/// # Errors
/// When the data or a checkpoint cannot be read, does not fit, or a file cannot be written.
pub fn train(settings: &Settings, interrupt: &AtomicBool) -> Result<Outcome> {
    ensure!(settings.batch > 0, "a batch needs at least one tree");
    ensure!(settings.minutes.is_some() || settings.epochs.is_some(), "give --minutes or --epochs");
    let data = read_dataset(&settings.data)?;
    let mode = data.mode.clone();
    let (training, validation) = divide(data)?;
    std::fs::create_dir_all(&settings.output).with_context(|| settings.output.display().to_string())?;
    let mut run = Run::start(settings, mode, training.len(), spread(&validation, VALIDATION_TREES)?)?;
    let plan = Plan { seed: settings.seed, batch: settings.batch, samples: training.len(), parts: run.state.parts };
    let batches = loader::start(Arc::new(training), plan, run.state.step);
    let bar = progress_bar(settings.quiet);
    let mut trees = 0;
    while run.progress(&plan) < 1.0 {
        let batch = batches.recv().context("the thread that prepares data has stopped")?.map_err(|e| anyhow!(e))?;
        trees += batch.iter().map(HostBatch::trees).sum::<usize>();
        run.step(&batch, &plan)?;
        bar.set_position((1000.0 * run.progress(&plan)) as u64);
        bar.set_message(run.message());
        if interrupt.load(Ordering::Relaxed) || settings.stop_after.is_some_and(|s| run.state.step >= s) {
            break;
        }
    }
    bar.finish_and_clear();
    let finished = run.progress(&plan) >= 1.0;
    run.validate()?;
    run.save()?;
    if finished {
        run.settle()?;
    }
    let best = run.state.best.unwrap_or(f64::NAN);
    let seconds = run.state.seconds - run.seconds_before;
    Ok(Outcome { step: run.state.step, best, trees_per_second: trees as f64 / seconds.max(1e-9) })
}

/// Trees to train on and trees to choose the best weights by: every tenth scene of the training data if there are enough,
/// otherwise the held-out trees. Those are otherwise left to `eval`.
fn divide(data: Dataset) -> Result<(Vec<TreeSample>, Vec<TreeSample>)> {
    if data.train.is_empty() {
        bail!("the data folder has no trees to train on");
    }
    let scenes: std::collections::BTreeSet<u32> = data.train.iter().map(|t| t.scene).collect();
    if scenes.len() < 10 {
        let validation = if data.held_out.is_empty() { data.train.clone() } else { data.held_out };
        return Ok((data.train, validation));
    }
    let chosen: std::collections::BTreeSet<u32> = scenes.into_iter().skip(4).step_by(10).collect();
    let (validation, training) = data.train.into_iter().partition(|t| chosen.contains(&t.scene));
    Ok((training, validation))
}

fn progress_bar(quiet: bool) -> ProgressBar {
    use std::io::IsTerminal;
    if quiet || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{wide_bar} {percent} %, {eta} left, {msg}");
    ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Sums since the last line of the log.
#[derive(Default)]
struct Sums {
    steps: u64,
    trees: usize,
    seconds: f64,
    value: f64,
    class: f64,
    norm: f64,
}

struct Run<'a> {
    settings: &'a Settings,
    state: State,
    net: Net,
    optimiser: Optimiser,
    journal: Journal,
    sums: Sums,
    validation: Vec<Case>,
    seconds_before: f64,
    saved: Instant,
    validated: Instant,
    validation_time: Duration,
}

impl<'a> Run<'a> {
    fn start(
        settings: &'a Settings,
        mode: fanal::network::config::Mode,
        samples: usize,
        validation: Vec<Case>,
    ) -> Result<Self> {
        let device = settings.device.clone().autodiff();
        let fresh = State {
            config: config(settings, mode),
            loss: settings.loss,
            seed: settings.seed,
            batch: settings.batch,
            parts: settings.parts.max(1),
            samples,
            step: 0,
            seconds: 0.0,
            best: None,
        };
        fresh.config.validate(&settings.output)?;
        let (state, net, optimiser) = if settings.resume {
            let path = settings.output.join(CHECKPOINT_FILE);
            let (state, net, optimiser) = checkpoint::load(&path, &device)?;
            let progress =
                State { step: state.step, seconds: state.seconds, best: state.best, parts: state.parts, ..fresh };
            ensure!(progress == state, "{}: the checkpoint was made with other settings or data", path.display());
            (state, net, optimiser)
        } else {
            let weights = initial_weights(&fresh.config, settings.seed);
            let net = Net::new(&fresh.config, &weights, &device)?;
            (fresh, net, Optimiser::default())
        };
        let journal = if settings.resume { Journal::read(&settings.output, state.step) } else { Journal::default() };
        let seconds_before = state.seconds;
        let (saved, validated) = (Instant::now(), Instant::now());
        let (sums, validation_time) = (Sums::default(), Duration::ZERO);
        Ok(Self {
            settings,
            state,
            net,
            optimiser,
            journal,
            sums,
            validation,
            seconds_before,
            saved,
            validated,
            validation_time,
        })
    }

    /// The share of the budget that is spent: the larger of epochs and time.
    fn progress(&self, plan: &Plan) -> f64 {
        let epochs = self.settings.epochs.map(|e| self.state.step as f64 / (e * plan.steps_per_epoch()).max(1) as f64);
        let time = self.settings.minutes.map(|m| self.state.seconds / (60.0 * m));
        epochs.unwrap_or(0.0).max(time.unwrap_or(0.0))
    }

    fn step(&mut self, batch: &[HostBatch], plan: &Plan) -> Result<()> {
        let start = Instant::now();
        let progress = self.progress(plan);
        let (rate, beta) = (rate(self.settings.rate, progress, self.state.step), beta(progress));
        let trees: usize = batch.iter().map(HostBatch::trees).sum();
        let (parts, value, class) = self.backward(batch, beta, trees)?;
        let norm = self.optimiser.step(&mut self.net, sum(parts), rate);
        self.state.step += 1;
        let seconds = start.elapsed().as_secs_f64();
        self.state.seconds += seconds;
        if norm.is_finite() {
            self.sums.steps += 1;
            self.sums.value += value;
            self.sums.class += class;
            self.sums.norm += f64::from(norm);
        }
        self.sums.trees += trees;
        self.sums.seconds += seconds;
        if self.state.step % LOG_EVERY == 0 || progress >= 1.0 {
            self.log(plan, rate, beta);
        }
        if self.saved.elapsed() > CHECKPOINT_EVERY {
            if self.validated.elapsed() > VALIDATION_SHARE * self.validation_time {
                self.validate()?;
            }
            self.save()?;
        }
        Ok(())
    }

    /// Forward and backward, one thread for each part: gradients, and the value and class parts of the loss.
    fn backward(&self, batch: &[HostBatch], beta: f64, trees: usize) -> Result<(Vec<Gradients>, f64, f64)> {
        let one = &|(i, part): (usize, &HostBatch)| {
            let net = self.net.replica();
            let mut random = Random::new(self.settings.seed, 0, self.state.step * self.state.parts as u64 + i as u64);
            let encoded = encode(&net, &self.state.config, part);
            let decoded = decode(&net, &self.state.config, part, &encoded, &mut random);
            let losses = losses(self.settings.loss, &decoded, beta);
            let share = part.trees() as f32 / trees as f32;
            let gradients = collect(&net, &losses.total.backward(), share);
            let scalar = |loss: Tensor<1>| f64::from(share * to_vec(loss.inner()).first().copied().unwrap_or(f32::NAN));
            (gradients, scalar(losses.value), scalar(losses.class))
        };
        let found: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = batch.iter().enumerate().map(|part| scope.spawn(move || one(part))).collect();
            threads.into_iter().map(|t| t.join().map_err(|_| anyhow!("a training thread panicked"))).collect()
        });
        let found = found.into_iter().collect::<Result<Vec<_>>>()?;
        let (value, class) = found.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.1, sum.1 + part.2));
        Ok((found.into_iter().map(|part| part.0).collect(), value, class))
    }

    fn log(&mut self, plan: &Plan, rate: f64, beta: f64) {
        let n = self.sums.steps.max(1) as f64;
        self.journal.entries.push(Entry {
            step: self.state.step,
            epoch: self.state.step as f64 / plan.steps_per_epoch() as f64,
            seconds: self.state.seconds,
            value: self.sums.value / n,
            class: self.sums.class / n,
            beta,
            rate,
            norm: self.sums.norm / n,
            trees_per_second: self.sums.trees as f64 / self.sums.seconds.max(1e-9),
            validation_kl: None,
        });
        self.sums = Sums::default();
    }

    fn message(&self) -> String {
        let last = self.journal.entries.last();
        let loss = last.map_or(String::new(), |e| format!("loss {:.3}, {:.0} trees/s", e.value, e.trees_per_second));
        self.state.best.map_or(loss.clone(), |best| format!("{loss}, best KL {best:.4}"))
    }

    fn model(&self) -> Model {
        Model { config: self.state.config.clone(), weights: self.net.weights() }
    }

    /// Measures the network on the validation trees; the best weights go into the model folder.
    fn validate(&mut self) -> Result<()> {
        let start = Instant::now();
        let mut model = self.model();
        let cells = common(&self.validation, &reconstruct(&model, &Embedded::new(&model)?, &self.validation)?);
        let uniform = tune_uniform(&cells);
        let kl = mean_kl(&cells, uniform);
        if let Some(last) = self.journal.entries.last_mut() {
            last.validation_kl = Some(kl);
        }
        if kl.is_finite() && self.state.best.is_none_or(|best| kl < best) {
            self.state.best = Some(kl);
            model.config.uniform = uniform as f32;
            model.save(&self.settings.output)?;
        }
        (self.validated, self.validation_time) = (Instant::now(), start.elapsed());
        Ok(())
    }

    fn save(&mut self) -> Result<()> {
        let path = self.settings.output.join(CHECKPOINT_FILE);
        checkpoint::save(&path, &self.state, &self.net, &self.optimiser)?;
        self.journal.write(&self.settings.output)?;
        self.saved = Instant::now();
        Ok(())
    }

    /// After the last step: the uniform part of the best weights, tuned once more on all validation trees.
    fn settle(&self) -> Result<()> {
        let mut model = Model::load(&self.settings.output)?;
        let guides = reconstruct(&model, &Embedded::new(&model)?, &self.validation)?;
        model.config.uniform = tune_uniform(&common(&self.validation, &guides)) as f32;
        model.save(&self.settings.output)?;
        Ok(())
    }
}

fn config(settings: &Settings, mode: fanal::network::config::Mode) -> Config {
    let name = settings.output.file_name().and_then(|n| n.to_str()).unwrap_or("model").to_owned();
    Config {
        version: VERSION,
        name,
        width: settings.width,
        convolutions: settings.convolutions,
        features: FEATURES,
        per_level: settings.per_level,
        leaf_threshold: 0.5,
        // Half of what the trees were split by: finer nodes cost time and, measured, gain nothing.
        min_split_share: 0.5 * mode.split_share,
        uniform: 0.1,
        mode,
    }
}

/// Whether a model folder holds a checkpoint to go on from.
pub fn has_checkpoint(folder: &Path) -> bool {
    folder.join(CHECKPOINT_FILE).is_file()
}
