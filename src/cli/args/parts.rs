//! Options of the commands that divide work among several processes.

use std::path::PathBuf;

use clap::Args;

use super::{Backend, Common, LearningArgs, SceneArgs, seconds, stops};
use crate::picture::View;
use crate::render::PartOf;

const LEARN_EXAMPLES: &str = concat!(
    "Examples:
  fanal learn scenes/door-ajar --spp 256 -o door.guide
  fanal learn scenes/door-ajar --guide gaussian --time 60 -o door.guide
  fanal render scenes/door-ajar --load-guide door.guide --spp 4096 --part 3/64 -o parts/3.part
  fanal merge parts/*.part -o door.exr
  fanal learn scenes/door-ajar --spp 256 --part 3/8 -o guides/3.guide
  fanal merge guides/*.guide -o door.guide
What a signal ends goes on with the same command, from a file beside the guide; a guide that is there already is left as it is.",
    exit_codes!()
);

/// `fanal learn`.
#[derive(Debug, Clone, Args)]
#[command(after_help = LEARN_EXAMPLES)]
pub struct LearnArgs {
    /// What is rendered.
    #[command(flatten)]
    pub of: SceneArgs,
    /// Guide file to write, for --load-guide and for `fanal inspect`. Beside the guide it holds what pixels of this picture will about
    /// be, by which paths are judged
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Samples per pixel to learn from at most, camera and light paths together [default: the scene's]
    #[arg(long, value_name = "N", group = "stop", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: Option<u32>,
    /// Learn only this part of the samples, for example 3/8: all parts learn the same with half of --spp, and each as much as it can with
    /// the other half; `fanal merge` adds their counts up. With --spp
    #[arg(long, value_name = "K/N", conflicts_with = "time")]
    pub part: Option<PartOf>,
    /// Learn for so many seconds at most, from reading the scene on
    #[arg(long, value_name = "SECONDS", group = "stop", allow_negative_numbers = true, value_parser = seconds)]
    pub time: Option<f64>,
    /// Least time between two checkpoints; they may take a twentieth of all time at most
    #[arg(long, value_name = "SECONDS", default_value = "30", allow_negative_numbers = true, value_parser = seconds)]
    pub every: f64,
    /// Write statistics as JSON
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
    /// What papers do otherwise. Last, since its heading holds for all that follows.
    #[command(flatten)]
    pub learning: LearningArgs,
}

const MERGE_EXAMPLES: &str = "Examples:
  fanal merge parts/*.part -o out.exr
  fanal merge parts/*.part -o so-far.png --allow-missing --view agx
  fanal merge parts/{1..500}.part -o parts/500.sum
  fanal merge guides/*.guide -o door.guide
  fanal merge data/small --check";

/// `fanal merge`.
#[derive(Debug, Clone, Args)]
#[command(after_help = MERGE_EXAMPLES)]
pub struct MergeArgs {
    /// Part files of `fanal render --part` or of `fanal learn --part`, in any order; or the folder of a data set whose parts `fanal dataset --part` made
    #[arg(required = true, value_name = "PART|DIR")]
    pub inputs: Vec<PathBuf>,
    /// Picture to write, .exr or .png; or the guide; or a name that ends in .sum, for the sum of the first parts of a picture, which is a part in
    /// their place: the others are merged with it later
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Make a picture of the parts that are there; its header says which are missing
    #[arg(long, requires = "output")]
    pub allow_missing: bool,
    /// Stops by which a PNG file is brightened [default: 0]
    #[arg(long, value_name = "STOPS", requires = "output", allow_negative_numbers = true, value_parser = stops)]
    pub exposure: Option<f32>,
    /// How a PNG file shows what is brighter than a screen, after --exposure [default: srgb]
    #[arg(long, requires = "output", value_enum)]
    pub view: Option<View>,
    /// Folder of the network's model that the guide was learned for [default: the model inside this program]
    #[arg(long, value_name = "DIR")]
    pub model: Option<PathBuf>,
    /// Who executes the network
    #[arg(long, value_enum, default_value = "embedded")]
    pub backend: Backend,
    /// Check the data set afterwards, as `fanal dataset --check` does
    #[arg(long, conflicts_with = "output")]
    pub check: bool,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}
