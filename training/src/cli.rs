//! The `fanal-training` command line.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use clap::{Args, Parser, Subcommand, ValueEnum};
use fanal::cli::interrupt::{self, Ended};
use fanal::cli::print::line;
use fanal::generate::dataset::{DatasetIndex, ShardEntry, read_dataset, read_datasets};
use fanal::generate::shard::{VERSION, write_shard};
use fanal::network::weights::Model;
use fanal::render::{GuideMode, RenderSettings, StopRule};
use serde::Serialize;

use crate::ablation::Ablation;
use crate::average::average;
use crate::evaluate::evaluate;
use crate::likeness::Likeness;
use crate::loss::Loss;
use crate::pareto::pareto;
use crate::statistics::Statistics;
use crate::synthetic;
use crate::train::{Settings, train};
use crate::view::{Inputs, Samples, View};

/// Trains, evaluates and exports fanal's reconstruction network.
#[derive(Debug, Parser)]
#[command(version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a model on a data folder. Ctrl-C, SIGTERM and SIGHUP stop and keep a checkpoint; the exit code is then 75.
    ///
    /// Example: fanal-training train --data data/rooms -o models/rooms --minutes 30
    Train(TrainArgs),
    /// Compare a model with the baselines on held-out trees.
    ///
    /// Example: fanal-training eval --data data/rooms --model models/rooms --ablate neighbours --ablate own
    Eval(EvalArgs),
    /// Say what data folders hold, and draw it.
    ///
    /// Example: fanal-training statistics --data data/rooms -o data/rooms
    Statistics {
        /// The data folder; several times for several.
        #[arg(long, required = true)]
        data: Vec<PathBuf>,
        /// Say instead how alike the trees of each data folder are to those of this one, such as of scenes by others.
        #[arg(long, value_name = "DATA")]
        beside: Option<PathBuf>,
        /// The folder for `statistics.svg` and `statistics.json`, or `likeness.svg` and `likeness.json`.
        #[arg(short)]
        output: PathBuf,
    },
    /// Write a model's ONNX files beside its weights.
    ///
    /// Example: fanal-training export --model models/rooms
    Export {
        /// The model folder.
        #[arg(long)]
        model: PathBuf,
    },
    /// Write the mean of models that were trained on from the same weights.
    ///
    /// Example: fanal-training average --model models/default --model models/further -o models/both
    Average {
        /// A model folder; at least two.
        #[arg(long, required = true)]
        model: Vec<PathBuf>,
        /// The model folder to write.
        #[arg(short)]
        output: PathBuf,
    },
    /// Write a data folder of lobes on the sphere: for trying out the training without a renderer.
    ///
    /// Example: fanal-training synthetic -o data/lobes --trees 500
    Synthetic {
        /// The folder to write.
        #[arg(short)]
        output: PathBuf,
        /// Trees to train on; a tenth as many are held out.
        #[arg(long, default_value_t = 1000)]
        trees: u32,
        /// Seed.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
}

/// Where burn computes.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum DeviceName {
    /// burn-flex.
    Flex,
    /// burn-ndarray.
    Ndarray,
    /// The first NVIDIA card.
    #[cfg(feature = "cuda")]
    Cuda,
    /// What wgpu finds best: Vulkan, Metal, DirectX; the variable `CUBECL_WGPU_DEFAULT_DEVICE` picks another.
    #[cfg(feature = "wgpu")]
    Wgpu,
}

#[derive(Debug, Args)]
struct TrainArgs {
    /// The data folder; several times for several.
    #[arg(long, required = true)]
    data: Vec<PathBuf>,
    /// The model folder.
    #[arg(short)]
    output: PathBuf,
    /// Stop after so many minutes of steps, validation and waiting for data not counted; 30 if --epochs is not given.
    #[arg(long)]
    minutes: Option<f64>,
    /// Stop after so many passes over the data.
    #[arg(long)]
    epochs: Option<u64>,
    /// Stop after so many validations that are no better than the best; its weights are kept in any case.
    #[arg(long, value_name = "VALIDATIONS")]
    patience: Option<u32>,
    /// Go on from the checkpoint in the model folder.
    #[arg(long)]
    resume: bool,
    /// Begin with the weights of this model instead of random ones, and in the middle of the schedule.
    #[arg(long, value_name = "MODEL", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// Channels of the hidden layers.
    #[arg(long, default_value_t = 16)]
    width: usize,
    /// Convolutions per level.
    #[arg(long, help_heading = "Research", default_value_t = 1)]
    convolutions: usize,
    /// What is minimised.
    #[arg(long, help_heading = "Research", value_enum, default_value_t = Loss::Variance)]
    loss: Loss,
    /// Separate weights for every level, as in Zhu 2021.
    #[arg(long, help_heading = "Research")]
    per_level: bool,
    /// An image network of 2^LEVEL squared pixels instead of one on sparse quadtrees.
    #[arg(long, help_heading = "Research", value_name = "LEVEL")]
    image: Option<usize>,
    #[command(flatten)]
    view: ViewArgs,
    /// Where burn computes.
    #[arg(long, value_enum, default_value_t = DeviceName::Flex)]
    device: DeviceName,
    /// Seed of weights, order and augmentation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trees per step.
    #[arg(long, default_value_t = 16)]
    batch: usize,
    /// Threads, one on a graphics card if nothing is said; a resumed run keeps the number that it began with.
    #[arg(long)]
    threads: Option<usize>,
    /// Peak learning rate.
    #[arg(long, default_value_t = 4e-3)]
    rate: f64,
    /// Seconds between checkpoints.
    #[arg(long, default_value_t = 60.0)]
    every: f64,
    /// Interrupt after this step, as Ctrl-C would.
    #[arg(long, hide = true)]
    stop_after: Option<u64>,
    /// No progress: neither a bar, nor a line every ten seconds where there is no terminal.
    #[arg(long)]
    quiet: bool,
}

#[derive(Debug, Args)]
struct ViewArgs {
    /// What inputs are made from; everything but `all` is for finding out what the rest is worth.
    #[arg(long, help_heading = "Research", value_enum, default_value_t = Inputs::All)]
    inputs: Inputs,
    /// Only pairs with a number of path samples in this range, such as 16..64.
    #[arg(long, help_heading = "Research", default_value = "0..")]
    samples: Samples,
    /// Only pairs with a number of path samples and photons in this range.
    #[arg(long, help_heading = "Research", default_value = "0..")]
    both_samples: Samples,
    /// Only pairs whose targets are converged: KL between two halves of it at most this, in nats.
    #[arg(long, help_heading = "Research", value_name = "NATS")]
    floor: Option<f64>,
}

impl ViewArgs {
    fn view(&self) -> View {
        View { inputs: self.inputs, samples: self.samples, both_samples: self.both_samples, floor: self.floor }
    }
}

#[derive(Debug, Args)]
struct EvalArgs {
    /// The data folder; several times for several.
    #[arg(long, required = true)]
    data: Vec<PathBuf>,
    /// Evaluate on the held-out trees of this data folder instead, several times for several; those of --data are then only tuned on.
    #[arg(long, value_name = "DATA")]
    held_out: Vec<PathBuf>,
    /// The model folder; several with --pareto.
    #[arg(long, required = true)]
    model: Vec<PathBuf>,
    /// Accuracy against time instead: every model in every backend, as a table and as a plot in this folder.
    #[arg(long, help_heading = "Research", value_name = "FOLDER", conflicts_with = "ablate")]
    pareto: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Also evaluate the network without this.
    #[arg(long, help_heading = "Research", value_enum)]
    ablate: Vec<Ablation>,
    /// Held-out trees at most.
    #[arg(long, default_value_t = 2000)]
    trees: usize,
    #[command(flatten)]
    view: ViewArgs,
}

/// Runs a parsed command line.
///
/// # Errors
/// Whatever went wrong, in words for the user.
pub fn run(cli: Cli) -> Result<Ended> {
    match cli.command {
        Command::Train(args) => return run_train(args),
        Command::Eval(args) => run_eval(&args)?,
        Command::Statistics { mut data, beside: Some(beside), output } => {
            data.push(beside);
            let name = |folder: &Path| folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let sets =
                data.iter().map(|folder| Ok((name(folder), read_dataset(folder)?))).collect::<Result<Vec<_>>>()?;
            let likeness = Likeness::new(&sets)?;
            likeness.write(&output)?;
            print(&likeness, false)?;
        }
        Command::Statistics { data, beside: None, output } => {
            let folders = data.iter().map(|folder| read_dataset(folder)).collect::<fanal::base::Result<Vec<_>>>()?;
            let statistics = Statistics::new(&folders)?;
            statistics.write(&output)?;
            print(&statistics, false)?;
        }
        Command::Export { model } => export(&model)?,
        Command::Average { model, output } => average(&model, &output)?,
        Command::Synthetic { output, trees, seed } => write_synthetic(&output, trees, seed)?,
    }
    Ok(Ended::Whole)
}

fn run_train(args: TrainArgs) -> Result<Ended> {
    let interrupt = interrupt::flag()?;
    let unlimited = args.minutes.is_none() && args.epochs.is_none();
    let settings = Settings {
        data: args.data,
        output: args.output,
        minutes: if unlimited { Some(30.0) } else { args.minutes },
        epochs: args.epochs,
        resume: args.resume,
        from: args.from,
        patience: args.patience,
        width: args.width,
        convolutions: args.convolutions,
        loss: args.loss,
        per_level: args.per_level,
        image: args.image,
        view: args.view.view(),
        device: device(args.device),
        seed: args.seed,
        batch: args.batch,
        parts: args.threads.unwrap_or_else(|| parts(args.device)),
        rate: args.rate,
        every: Duration::try_from_secs_f64(args.every).context("--every must be a time in seconds")?,
        stop_after: args.stop_after,
        quiet: args.quiet,
    };
    let outcome = train(&settings, &interrupt)?;
    let (step, best, speed) = (outcome.step, outcome.best, outcome.trees_per_second);
    line(&format!("{step} steps, best validation ln(1 + V) {best:.4}, {speed:.0} trees/s"))?;
    Ok(if outcome.finished { Ended::Whole } else { Ended::Early })
}

/// Parts of a step: a processor computes one on each core, a graphics card all trees together.
fn parts(device: DeviceName) -> usize {
    match device {
        DeviceName::Flex | DeviceName::Ndarray => std::thread::available_parallelism().map_or(1, usize::from),
        #[cfg(feature = "cuda")]
        DeviceName::Cuda => 1,
        #[cfg(feature = "wgpu")]
        DeviceName::Wgpu => 1,
    }
}

fn device(name: DeviceName) -> Device {
    match name {
        DeviceName::Flex => Device::flex(),
        // Deprecated by burn in favour of flex, but still what this project names; both are tested against each other.
        #[allow(deprecated)]
        DeviceName::Ndarray => Device::ndarray(),
        #[cfg(feature = "cuda")]
        DeviceName::Cuda => Device::cuda(0),
        #[cfg(feature = "wgpu")]
        DeviceName::Wgpu => Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
    }
}

fn run_eval(args: &EvalArgs) -> Result<()> {
    let mut data = read_datasets(&args.data)?;
    if !args.held_out.is_empty() {
        let others = read_datasets(&args.held_out)?;
        ensure!(others.mode == data.mode, "the data to evaluate on have another mode: {:?}", others.mode);
        data.held_out = others.held_out;
    }
    let data = args.view.view().apply(data)?;
    if let Some(folder) = &args.pareto {
        let pareto = pareto(&data, &args.model, args.trees)?;
        pareto.write(folder)?;
        return print(&pareto, args.json);
    }
    let [model] = args.model.as_slice() else { bail!("several models can be compared with --pareto only") };
    let model = Model::load(model)?;
    ensure!(model.config.mode == data.mode, "the model was trained for another mode than the data: {:?}", data.mode);
    let evaluation = evaluate(&data, &model, &args.ablate, args.trees)?;
    print(&evaluation, args.json)
}

fn print(result: &(impl Serialize + Display), json: bool) -> Result<()> {
    if json {
        println!("{}", serde_json::to_string_pretty(result)?);
    } else {
        print!("{result}");
    }
    Ok(())
}

fn export(folder: &Path) -> Result<()> {
    crate::onnx::export(&Model::load(folder)?, folder)?;
    Ok(())
}

/// Scenes of fifty trees, one shard for training and one held out.
fn write_synthetic(folder: &Path, trees: u32, seed: u64) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
    let settings = synthetic::Settings::default();
    let mut index = DatasetIndex::default();
    for (file, held_out, first, count) in
        [("train.safetensors", false, 0, trees), ("held-out.safetensors", true, 1 << 24, (trees / 10).max(1))]
    {
        let samples = synthetic::tree_samples(&settings, seed, first, count);
        write_shard(&folder.join(file), &samples)?;
        index.shards.push(ShardEntry {
            version: VERSION,
            file: file.into(),
            scene: if held_out { "lobes held out" } else { "lobes" }.into(),
            family: "synthetic".into(),
            seed,
            held_out,
            samples: samples.len() as u64,
            mode: mode.clone(),
        });
    }
    index.write(folder)?;
    Ok(())
}
