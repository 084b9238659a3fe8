//! The state of one training run, and its training step.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, ensure};
use burn::tensor::Tensor;
use fanal::base::random::Random;
use fanal::guiding::tree::features::FEATURES;
use fanal::network::config::{Config, Mode, VERSION};
use fanal::network::embedded::Embedded;
use fanal::network::weights::{Model, Weights};

use crate::batch::HostBatch;
use crate::cases::{Case, common, mean_kl, mean_log_moment, reconstruct, tune_uniform};
use crate::checkpoint::{self, CHECKPOINT_FILE, Data, State};
use crate::forward::{decode, encode};
use crate::journal::{Entry, Journal};
use crate::loader::Plan;
use crate::loss::losses;
use crate::model::{Net, initial_weights, to_vec};
use crate::optimise::{Gradients, Optimiser, beta, collect, rate, sum};
use crate::train::Settings;

/// Steps between lines of the log.
const LOG_EVERY: u64 = 10;
/// Least time between validations, relative to the duration of one.
const VALIDATION_SHARE: u32 = 20;

/// Least uniform part of a trained model. Validation trees are few: where the network gives up a direction by mistake, a render of
/// millions of paths finds it, and shows a firefly.
const LEAST_UNIFORM: f32 = 0.02;

/// Steps in a row without a finite gradient after which nothing more is to be expected.
const MOST_SKIPPED: u32 = 20;

/// Least improvement in ln(1 + V) that counts for patience.
const LEAST_GAIN: f64 = 1e-4;

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

/// A training run: the network, its optimiser, its log, and its progress.
pub struct Run<'a> {
    settings: &'a Settings,
    /// Configuration and progress.
    pub state: State,
    net: Net,
    optimiser: Optimiser,
    journal: Journal,
    sums: Sums,
    /// Steps in a row whose gradient was not finite.
    skipped: u32,
    validation: Vec<Case>,
    /// Seconds of training in earlier parts of the run.
    pub seconds_before: f64,
    saved: Instant,
    validated: Instant,
    validation_time: Duration,
}

impl<'a> Run<'a> {
    /// Starts a run afresh, or resumes the one whose checkpoint lies in the model folder.
    ///
    /// # Errors
    /// When the settings are not valid, or the checkpoint cannot be read or was made with other settings.
    pub fn start(settings: &'a Settings, mode: Mode, data: Data, validation: Vec<Case>) -> Result<Self> {
        let device = settings.device.clone().autodiff();
        let fresh = State {
            config: config(settings, mode),
            loss: settings.loss,
            view: settings.view,
            seed: settings.seed,
            from: None,
            batch: settings.batch,
            rate: settings.rate,
            parts: settings.parts.max(1),
            data,
            step: 0,
            seconds: 0.0,
            best: None,
            unimproved: 0,
        };
        fresh.config.validate(&settings.output)?;
        let (state, net, optimiser) = if settings.resume {
            let path = settings.output.join(CHECKPOINT_FILE);
            let (state, net, optimiser) = checkpoint::load(&path, &device)?;
            // The folder may have been renamed.
            let state = State { config: Config { name: fresh.config.name.clone(), ..state.config }, ..state };
            let progress = State {
                step: state.step,
                seconds: state.seconds,
                best: state.best,
                unimproved: state.unimproved,
                parts: state.parts,
                from: state.from,
                ..fresh
            };
            ensure!(progress == state, "{}: the checkpoint was made with other settings or data", path.display());
            (state, net, optimiser)
        } else {
            let path = settings.output.join(CHECKPOINT_FILE);
            ensure!(
                !path.exists(),
                "{}: a run was begun here: go on with --resume, or remove its folder",
                path.display()
            );
            let begun = settings.from.as_deref().map(|folder| weights_of(folder, &fresh.config)).transpose()?;
            let from = begun.as_ref().map(Weights::checksum);
            let weights = begun.unwrap_or_else(|| initial_weights(&fresh.config, settings.seed));
            let net = Net::new(&fresh.config, &weights, &device)?;
            (State { from, ..fresh }, net, Optimiser::default())
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
            skipped: 0,
            validation,
            seconds_before,
            saved,
            validated,
            validation_time,
        })
    }

    /// The share of the budget that is spent: the larger of epochs and time.
    pub fn progress(&self, plan: &Plan) -> f64 {
        let epochs = self.settings.epochs.map(|e| self.state.step as f64 / (e * plan.steps_per_epoch()).max(1) as f64);
        let time = self.settings.minutes.map(|m| self.state.seconds / (60.0 * m));
        epochs.unwrap_or(0.0).max(time.unwrap_or(0.0))
    }

    /// The place in the schedule of learning rate and losses. Weights that were trained before begin in the middle: the full rate would
    /// undo what they know.
    fn schedule(&self, plan: &Plan) -> f64 {
        let progress = self.progress(plan);
        if self.state.from.is_some() { 0.5 + 0.5 * progress } else { progress }
    }

    /// Whether validation has not improved for as long as the settings wait.
    pub fn exhausted(&self) -> bool {
        self.settings.patience.is_some_and(|patience| self.state.unimproved >= patience)
    }

    /// Trains one step on the parts of a batch; now and then validates and saves.
    ///
    /// # Errors
    /// When a thread panics, a file cannot be written, or the run diverges: its checkpoint is then of an earlier step.
    pub fn step(&mut self, batch: &[HostBatch], plan: &Plan) -> Result<()> {
        let start = Instant::now();
        let progress = self.schedule(plan);
        let (rate, beta) = (rate(self.state.rate, progress, self.state.step), beta(progress));
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
            self.skipped = 0;
        } else {
            self.skipped += 1;
            let step = self.state.step;
            ensure!(
                self.skipped < MOST_SKIPPED,
                "no gradient was finite in {MOST_SKIPPED} steps up to step {step}: give a lower --rate"
            );
        }
        self.sums.trees += trees;
        self.sums.seconds += seconds;
        if self.state.step.is_multiple_of(LOG_EVERY) || self.progress(plan) >= 1.0 {
            self.log(plan, rate, beta);
        }
        if self.skipped == 0 && self.saved.elapsed() > self.settings.every {
            if self.validated.elapsed() > VALIDATION_SHARE * self.validation_time {
                self.validate()?;
            }
            self.save()?;
        }
        Ok(())
    }

    /// Runs forward and backward passes, one thread for each part; returns gradients, and the value and class parts of the loss.
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
        if self.sums.steps == 0 {
            return;
        }
        let n = self.sums.steps as f64;
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
            validation_moment: None,
        });
        self.sums = Sums::default();
    }

    /// Loss, speed and best validation ln(1 + V), for a progress bar.
    pub fn message(&self) -> String {
        let last = self.journal.entries.last();
        let loss = last.map_or(String::new(), |e| format!("loss {:.3}, {:.0} trees/s", e.value, e.trees_per_second));
        self.state.best.map_or(loss.clone(), |best| format!("{loss}, best ln(1 + V) {best:.4}"))
    }

    fn model(&self) -> Model {
        Model { config: self.state.config.clone(), weights: self.net.weights() }
    }

    /// Measures the network on the validation trees; writes the best weights to the model folder.
    ///
    /// # Errors
    /// When the model cannot be run or written.
    pub fn validate(&mut self) -> Result<()> {
        let start = Instant::now();
        let mut model = self.model();
        let cells = common(&self.validation, &reconstruct(&model, &Embedded::new(&model)?, &self.validation)?);
        let uniform = tune_uniform(&cells, mean_log_moment);
        let (kl, moment) = (mean_kl(&cells, uniform), mean_log_moment(&cells, uniform));
        if let Some(last) = self.journal.entries.last_mut() {
            (last.validation_kl, last.validation_moment) = (Some(kl), Some(moment));
        }
        let better = |than: f64| moment.is_finite() && self.state.best.is_none_or(|best| moment < best - than);
        self.state.unimproved = if better(LEAST_GAIN) { 0 } else { self.state.unimproved + 1 };
        if better(0.0) {
            self.state.best = Some(moment);
            model.config.uniform = (uniform as f32).max(LEAST_UNIFORM);
            model.save(&self.settings.output)?;
        }
        (self.validated, self.validation_time) = (Instant::now(), start.elapsed());
        Ok(())
    }

    /// Writes checkpoint, log and plot.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&mut self) -> Result<()> {
        let path = self.settings.output.join(CHECKPOINT_FILE);
        checkpoint::save(&path, &self.state, &self.net, &self.optimiser)?;
        self.journal.write(&self.settings.output)?;
        self.saved = Instant::now();
        Ok(())
    }
}

/// The weights of the model in `folder`, which must have the layers and the mode of `config`.
fn weights_of(folder: &Path, config: &Config) -> Result<Weights> {
    let Model { config: own, weights } = Model::load(folder)?;
    let shape = |of: &Config| (of.width, of.convolutions, of.per_level, of.image);
    ensure!(shape(&own) == shape(config), "{}: the model has {}", folder.display(), layers(&own));
    ensure!(own.mode == config.mode, "{}: the model serves another mode than the data were made in", folder.display());
    Ok(weights)
}

/// The options that make a network with the layers of `config`.
fn layers(config: &Config) -> String {
    let per_level = if config.per_level { " --per-level" } else { "" };
    let image = config.image.map_or(String::new(), |level| format!(" --image {level}"));
    format!("--width {} --convolutions {}{per_level}{image}", config.width, config.convolutions)
}

fn config(settings: &Settings, mode: Mode) -> Config {
    let name = settings.output.file_name().and_then(|n| n.to_str()).unwrap_or("model").to_owned();
    Config {
        version: VERSION,
        name,
        width: settings.width,
        convolutions: settings.convolutions,
        features: FEATURES,
        per_level: settings.per_level,
        image: settings.image,
        leaf_threshold: 0.5,
        // A quarter of the share by which the voxels' own trees were split, and about half of that of the targets.
        min_split_share: 0.25 * mode.split_share,
        uniform: 0.1,
        mode,
    }
}
