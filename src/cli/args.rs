//! The command line's options. Nothing here looks at a file; see [`super::resolve`].

use std::path::PathBuf;
use std::sync::LazyLock;

use clap::builder::PossibleValue;
use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::Vec3;

use crate::guiding::learn::fraction::FractionRule;
use crate::guiding::target::{DirectLight, Target};
use crate::integrators::Roulette;
use crate::picture::{Address, View, Window};
use crate::render::{Aov, Fireflies, GuideMode, PartOf, Reconstruction, Sample, SampleKinds};
use crate::report::experiment::Method;
use crate::scene::file::FilterFile;
use crate::scene::overrides::Override;
use crate::scene::readers::{Definition, How, Missing};

/// Exit codes in the help of every command that a signal can end.
macro_rules! exit_codes {
    () => {
        "\n\nExit codes: 0 done, 75 ended early by Ctrl-C, SIGTERM or SIGHUP with what there is kept, 1 failed, 2 wrong usage.\n\
         A second such signal ends the program at once; under nohup SIGHUP is ignored (on Linux)."
    };
}

mod parts;
mod scene;
mod variant;

pub use parts::{LearnArgs, MergeArgs};
pub use scene::SceneArgs;
pub use variant::VariantArgs;

/// A physically based renderer that learns where light comes from.
#[derive(Debug, Parser)]
#[command(
    name = "fanal",
    version,
    after_help = concat!(
        "Examples:\n  fanal render scenes/door-ajar -o out.exr\n  fanal render --help",
        exit_codes!()
    )
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene to a picture
    Render(Box<RenderArgs>),
    /// Learn where light comes from, and write a guide file
    Learn(Box<LearnArgs>),
    /// Put the parts of a picture, guides, or a data set together
    Merge(MergeArgs),
    /// Say which effects a scene calls for, which are off, and why
    Plan(PlanArgs),
    /// Compare methods on a scene: what accuracy costs in time
    Compare(CompareArgs),
    /// Measure how far a picture is from a reference
    Error(ErrorArgs),
    /// Generate training data, or check it
    Dataset(DatasetArgs),
    /// Look into a guide file: the distributions at a point, and where guiding helps
    Inspect(InspectArgs),
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
pub struct Common {
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// No progress and no warnings. Otherwise a terminal shows a bar, and a file or a pipe gets a line every ten seconds, on stderr
    #[arg(long)]
    pub quiet: bool,
}

/// The renderer's own choices as words of the command line, each with a line of help.
macro_rules! words {
    ($type:ty, $($variant:ident: $help:literal),+ $(,)?) => {
        impl ValueEnum for $type {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$variant),+]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                let help = match self {
                    $(Self::$variant => $help),+
                };
                Some(PossibleValue::new(self.name()).help(help))
            }
        }
    };
}

impl ValueEnum for GuideMode {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()).help(self.help()))
    }
}

words!(
    SampleKinds,
    Path: "Camera paths only",
    Photon: "Light paths only",
    Both: "Both",
);

words!(
    Target,
    Radiance: "Incident radiance",
    Variance: "Root of the second moment of what a sample contributes",
    VariancePixel: "The same relative to the pixel",
);

words!(
    FractionRule,
    Half: "One half (Müller 2017)",
    Moments: "The best of several by measured second moments",
    Adam: "Learned by gradient descent (Müller 2019)",
    Found: "By the light that samples of either have found (Zhu 2021)",
);

words!(
    DirectLight,
    Nothing: "Nothing",
    Weighted: "What is left for hitting it, by the weights of multiple importance sampling",
    All: "All of it",
);

words!(
    Reconstruction,
    None: "Nothing",
    Gaussian: "They are smoothed level by level",
    Nilsson: "They are denoised on matrices (Nilsson 2022)",
    Neural: "The network reconstructs them",
);

words!(
    Roulette,
    Off: "Not before nothing is left of them",
    Throughput: "By how much is left of them",
    Window: "By what is expected of them, light sampling likewise (Vorba and Křivánek 2016)",
);

words!(
    Missing,
    Refuse: "The scene is refused, with a list of them",
    Skip: "Shapes without their mesh are left out, grey stands for a picture",
);

/// Pixel filters, as wide as usual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PixelFilter {
    /// The mean over the pixel
    Box,
    /// A tent over two pixels
    Tent,
    /// A Gaussian with a standard deviation of half a pixel
    Gaussian,
    /// A Blackman-Harris window over three pixels
    BlackmanHarris,
}

impl PixelFilter {
    /// The filter as a scene file has it.
    pub fn file(self) -> FilterFile {
        match self {
            Self::Box => FilterFile::default(),
            Self::Tent => FilterFile::TENT,
            Self::Gaussian => FilterFile::GAUSSIAN,
            Self::BlackmanHarris => FilterFile::BLACKMAN_HARRIS,
        }
    }
}

words!(
    Aov,
    Albedo: "albedo.R/G/B: reflectance; 0 where nothing is hit",
    Normal: "normal.X/Y/Z: shading normal in the world, on the camera's side; 0 where nothing is hit",
    Position: "position.X/Y/Z: point in the world; 0 where nothing is hit",
    Depth: "depth.Z: distance along the ray (not along the viewing axis); 0 where nothing is hit",
    Samples: "samples.Y: camera samples that the pixel is made of",
    Variance: "variance.R/G/B: variance of the pixel's mean; 0 where one sample cannot tell",
    Guiding: "guiding.Y: probability that the guide chooses the direction at the first surface; 0 where unguided",
    CryptoObject: "crypto_object00.r/g/b/a to 02: Cryptomatte of shapes by their names",
    CryptoMaterial: "crypto_material00.r/g/b/a to 02: Cryptomatte of materials by their names",
);

words!(
    View,
    Srgb: "The sRGB curve: what is too bright is cut off",
    Agx: "AgX: a wide range in soft contrast, bright colours fade to white (Sobotka 2022)",
    PbrNeutral: "Colours stay what they are but for the brightest (Khronos 2024)",
);

/// What is done about fireflies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Outliers {
    /// Nothing: the picture is the mean of its samples
    Keep,
    /// Their light is taken out of the picture, and kept as fireflies.R/G/B in an EXR file (after Zirr 2018); the picture is darker by it
    Reweight,
}

/// Layers beside the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// All of them.
    All,
    /// One of them.
    One(Aov),
}

impl ValueEnum for Layer {
    fn value_variants<'a>() -> &'a [Self] {
        static LAYERS: LazyLock<Vec<Layer>> =
            LazyLock::new(|| [Layer::All].into_iter().chain(Aov::ALL.map(Layer::One)).collect());
        &LAYERS
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            Self::All => Some(PossibleValue::new("all").help("All of them")),
            Self::One(aov) => aov.to_possible_value(),
        }
    }
}

impl Layer {
    /// The layers of a list, each once.
    pub fn aovs(list: &[Self]) -> Vec<Aov> {
        let wanted = |&aov: &Aov| list.contains(&Self::One(aov)) || list.contains(&Self::All);
        Aov::ALL.into_iter().filter(wanted).collect()
    }
}

/// Who executes the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// The forward pass built into this program
    Embedded,
    /// onnxruntime, whose shared library must be installed (ORT_DYLIB_PATH says where)
    Onnx,
}

/// A switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// Yes
    On,
    /// No
    Off,
}

impl Switch {
    /// Whether it is on.
    pub fn is_on(self) -> bool {
        self == Self::On
    }
}

const RENDER_EXAMPLES: &str = concat!(
    "Examples:
  fanal render scenes/door-ajar -o out.exr
  fanal render scenes/cornell/scene.json -o out.png --guide none --spp 256 --size 128x128
  fanal render scenes/lamp-room -o out.exr --target-error 0.01
  fanal render scenes/cornell -o out.png --spp 16 --denoise --view agx --exposure 1
  fanal render scenes/lamp-room -o out.exr --time 60 --display localhost
  fanal render scene.xml -o out.exr --time 60 --stats stats.json --reference reference.exr
  fanal render scenes/lamp-room -o out.exr --model models/mine --backend onnx
  fanal render scenes/lamp-room -o out.exr --spp 4096 --checkpoint lamp.part
  fanal render scenes/lamp-room -o out.exr --spp 4096 --resume lamp.part
  fanal render scene.xml --guide none --replay 120,45,17
  fanal render scene.glb -o out.exr --camera all
  fanal render scene.glb -o turn.png --orbit 36 --spp 64
  fanal render scenes/lamp-room --load-guide lamp.guide --spp 4096 --part 3/64 -o parts/3.part",
    exit_codes!()
);

/// `fanal render`.
#[derive(Debug, Clone, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub struct RenderArgs {
    /// What is rendered.
    #[command(flatten)]
    pub of: SceneArgs,
    /// Picture to write, .exr or .png; with --part the file of the part, of any name
    #[arg(short, long, value_name = "FILE", required_unless_present = "replay")]
    pub output: Option<PathBuf>,
    /// Write the guiding field, for --load-guide and for `fanal inspect`
    #[arg(long, value_name = "FILE", conflicts_with = "load_guide")]
    pub save_guide: Option<PathBuf>,
    /// Guide by a field that an earlier render saved; nothing is learned
    #[arg(long, value_name = "FILE", conflicts_with_all = ["samples", "target", "reconstruct", "model", "direct", "fraction", "filter", "simple_iterations", "past"])]
    pub load_guide: Option<PathBuf>,
    /// Samples per pixel, camera and light paths together [default: the scene's]
    #[arg(long, value_name = "N", group = "stop", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: Option<u32>,
    /// Render for so many seconds, from reading the scene to the written picture
    #[arg(long, value_name = "SECONDS", group = "stop", allow_negative_numbers = true, value_parser = seconds)]
    pub time: Option<f64>,
    /// Render until the estimated relMSE is so small
    #[arg(long, value_name = "RELMSE", group = "stop", allow_negative_numbers = true, value_parser = error_target)]
    pub target_error: Option<f64>,
    /// Whether noisy pixels get more samples than others, once a fifth of all has told where they are [default: on with --time]
    #[arg(long, value_enum)]
    pub adaptive: Option<Switch>,
    /// Learn complete paths on top of the guide, those that it finds too rarely, and draw so many from them for each path of the path tracer,
    /// from 0 to 1 (Reibold 2018): for caustics that voxels cannot hold. Samples are not divided by noise then [default: 0; 1 for --guide
    /// paths]
    #[arg(long, value_name = "RATIO", value_parser = part)]
    pub complete_paths: Option<f64>,
    /// Render only this part of the samples, for example 3/64: whole blocks of 64 samples of each pixel. The parts of one picture, which
    /// other machines may render, are put together by `fanal merge`, which gives the bits of the picture that the same command gives
    /// without --part. Under --guide none and --load-guide. A part keeps its state in a file beside it, from which the same command goes on
    #[arg(long, value_name = "K/N", conflicts_with_all = ["time", "target_error", "save_guide", "display", "denoise", "checkpoint", "resume", "replay", "reference", "exposure", "view"])]
    pub part: Option<PartOf>,
    /// Show the picture while it is rendered in tev, or in HDRView where it listens for image updates; without a port 14158
    #[arg(long, value_name = "HOST[:PORT]")]
    pub display: Option<Address>,
    /// Layers beside the picture in the EXR file, separated by commas. Features are those of the first surface that a camera ray
    /// hits, mirrors and glass included, averaged over up to 16 samples per pixel; of edges in mattes 128
    #[arg(long, value_enum, value_name = "LAYERS", value_delimiter = ',')]
    pub aov: Vec<Layer>,
    /// Denoise the finished picture with Intel's Open Image Denoise 2, whose shared libraries must be installed (OIDN_DYLIB_PATH says
    /// where), and keep the noisy one in the EXR file as noisy.R/G/B
    #[arg(long)]
    pub denoise: bool,
    /// What is done about samples so bright and so rare that they stand alone
    #[arg(long, value_enum, default_value = "keep")]
    pub fireflies: Outliers,
    /// Samples of like brightness that `--fireflies reweight` asks for around a pixel; more take more light out [default: 4]
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = kappa)]
    pub kappa: Option<f64>,
    /// Stops by which a PNG file is brightened [default: 0]
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = stops)]
    pub exposure: Option<f32>,
    /// How a PNG file shows what is brighter than a screen, after --exposure [default: srgb]
    #[arg(long, value_enum)]
    pub view: Option<View>,
    /// Write the state of the render to this file from time to time and when a signal ends it, for --resume
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Least time between two checkpoints, with --checkpoint, --resume or --part; they may take a twentieth of all time
    /// at most [default: 30]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds)]
    pub every: Option<f64>,
    /// Go on from a checkpoint of the same scene and options, and keep it up to date unless --checkpoint names another file. Under
    /// --spp the picture has the bits that it would have had without the interruption
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// Render nothing, but print the path of one sample vertex by vertex: the column and row of its pixel, its number, and the
    /// number at which its pass began, which is 0 with --guide none, or "none" where random numbers are independent (--target-error).
    /// --stats lists dropped samples in this form. Replays --guide none and --load-guide, and writes no picture
    #[arg(long, value_name = "X,Y,SAMPLE[,FROM]", value_parser = sample, conflicts_with_all = ["aov", "reference", "checkpoint", "resume", "save_guide", "stats", "denoise", "display"])]
    pub replay: Option<Sample>,
    /// Write statistics as JSON
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Picture to measure errors against; they go into the statistics
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
    /// What papers do otherwise. Last, since its heading holds for all that follows.
    #[command(flatten)]
    pub learning: LearningArgs,
}

/// How guides learn, against what --guide says: to compare with what papers do, and to see what each part is worth.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Research")]
pub struct LearningArgs {
    /// Where guiding samples come from [default: by --guide]
    #[arg(long, value_enum)]
    pub samples: Option<SampleKinds>,
    /// What guiding distributions are proportional to [default: by --guide]
    #[arg(long, value_enum)]
    pub target: Option<Target>,
    /// What trees learn of light that light sampling finds too [default: all; nothing for --guide ppg, ppg2 and nilsson]
    #[arg(long, value_enum)]
    pub direct: Option<DirectLight>,
    /// How often the BSDF is sampled instead of the guide [default: moments; half for --guide ppg and
    /// nilsson, adam for ppg2, found for zhu]
    #[arg(long, value_enum)]
    pub fraction: Option<FractionRule>,
    /// Move samples at random within the size of their leaf and their voxel (Müller 2019), as --guide ppg2 and zhu always do
    #[arg(long)]
    pub filter: bool,
    /// Iterations in which `variance` is learned before `--target variance-pixel` [default: 3 for --guide nilsson, else 0]
    #[arg(long, value_name = "N")]
    pub simple_iterations: Option<u32>,
    /// As what part of their number the samples of earlier iterations count in the next [default: 0.5; 0 for --guide ppg, ppg2,
    /// nilsson and zhu]
    #[arg(long, value_name = "PART", value_parser = part)]
    pub past: Option<f64>,
    /// What is made of the trees as counted [default: by --guide]
    #[arg(long, value_enum)]
    pub reconstruct: Option<Reconstruction>,
}

const INSPECT_EXAMPLES: &str = "Examples:
  fanal render scenes/door-ajar -o out.exr --save-guide door.guide
  fanal inspect door.guide
  fanal inspect door.guide --at 1.0,0.2,-0.5 -o tree.png
  fanal inspect door.guide --scene scenes/door-ajar -o gain.png";

/// `fanal inspect`.
#[derive(Debug, Clone, Args)]
#[command(after_help = INSPECT_EXAMPLES)]
pub struct InspectArgs {
    /// Guide file of `fanal render --save-guide`
    pub guide: PathBuf,
    /// Point whose distributions are drawn: a row for each facing of the surfaces there, on the left as counted (Q_h), on the
    /// right as sampled (Q_r); z runs to the right, φ downwards, colours are logarithmic
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "output")]
    pub at: Option<Vec3>,
    /// Scene over whose picture it is drawn how much guiding helps
    #[arg(long, value_name = "SCENE", requires = "output", conflicts_with = "at")]
    pub scene: Option<PathBuf>,
    /// Size of that picture in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = size, requires = "scene")]
    pub size: Option<[u32; 2]>,
    /// Value for $NAME in a Mitsuba scene, in place of the scene's default; may be given several times
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", requires = "scene")]
    pub definitions: Vec<Definition>,
    /// What to do about meshes and pictures that the scene names and that are not there
    #[arg(long, value_enum, default_value = "refuse", requires = "scene")]
    pub missing: Missing,
    /// Picture to write, .png or .exr
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

const PLAN_EXAMPLES: &str = "Examples:
  fanal plan scenes/door-ajar
  fanal plan scene.xml --json
  fanal plan scene.xml --effects +photons,-medium
  fanal plan scene.xml -D spp=64 -D depth=8";

/// `fanal plan`.
#[derive(Debug, Clone, Args)]
#[command(after_help = PLAN_EXAMPLES)]
pub struct PlanArgs {
    /// Scene: our JSON, Mitsuba XML, pbrt, glTF, or a folder that holds one of them called scene
    pub scene: PathBuf,
    /// Effects to switch on (+) or off (-) against the plan
    #[arg(long, value_name = "+NAME,-NAME,…", value_delimiter = ',', allow_hyphen_values = true)]
    pub effects: Vec<Override>,
    /// Value for $NAME in a Mitsuba scene, in place of the scene's default; may be given several times
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE")]
    pub definitions: Vec<Definition>,
    /// What to do about meshes and pictures that the scene names and that are not there
    #[arg(long, value_enum, default_value = "refuse")]
    pub missing: Missing,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

impl PlanArgs {
    /// How to load the scene.
    pub fn how(&self) -> How<'_> {
        How { overrides: &self.effects, definitions: &self.definitions, missing: self.missing }
    }
}

const COMPARE_EXAMPLES: &str = concat!(
    "Examples:
  fanal compare scenes/door-ajar --time 5,10,20 -o out/door
  fanal compare scenes/cornell --methods none,neural --spp 16,64 --seeds 8 -o out/cornell
  fanal compare scene.xml --time 30 --reference ref.exr --reference-variance var.exr -o out/scene
An interrupted comparison goes on where it was; so does one with more seeds or budgets.",
    exit_codes!()
);

/// `fanal compare`.
#[derive(Debug, Clone, Args)]
#[command(after_help = COMPARE_EXAMPLES)]
pub struct CompareArgs {
    /// Scene: our JSON, Mitsuba XML, pbrt, glTF, or a folder that holds one of them called scene
    pub scene: PathBuf,
    /// Folder to write the page, the measurements and the pictures to
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Methods; ratios refer to the first
    #[arg(long, value_enum, value_delimiter = ',', default_value = "none,hybrid,neural")]
    pub methods: Vec<Method>,
    /// A further method under a name of its own: options of `fanal render` that say how light is found, for example
    /// 'no-past: --guide variance --past 0'. May be given several times
    #[arg(long, value_name = "NAME: OPTIONS", value_parser = variant::variant, allow_hyphen_values = true)]
    pub variant: Vec<VariantArgs>,
    /// Budgets in seconds
    #[arg(long, value_name = "S,…", value_delimiter = ',', allow_negative_numbers = true, value_parser = seconds,
          conflicts_with = "spp", required_unless_present = "spp")]
    pub time: Vec<f64>,
    /// Budgets in samples per pixel
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: Vec<u32>,
    /// Seeds per method and budget
    #[arg(long, value_name = "N", default_value = "4", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// The truth, as EXR [default: rendered and rated here]
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,
    /// Variance of the reference per pixel and channel, as EXR; it is subtracted from the errors
    #[arg(long, value_name = "FILE", requires = "reference")]
    pub reference_variance: Option<PathBuf>,
    /// Samples per pixel of each of the four parts of a reference that is rendered here
    #[arg(long, value_name = "N", default_value = "1024", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub reference_spp: u32,
    /// Samples per pixel that the oracle learns from
    #[arg(long, value_name = "N", default_value = "512", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub oracle_spp: u32,
    /// Measure every picture denoised too (Open Image Denoise, see `fanal render --denoise`): dashed lines
    #[arg(long)]
    pub denoise: bool,
    /// Size of the picture in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<[u32; 2]>,
    /// 1 = emission only, 2 = direct light, n = n-1 bounces [default: the scene's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    pub max_depth: Option<u32>,
    /// Value for $NAME in a Mitsuba scene, in place of the scene's default; may be given several times
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE")]
    pub definitions: Vec<Definition>,
    /// What to do about meshes and pictures that the scene names and that are not there
    #[arg(long, value_enum, default_value = "refuse")]
    pub missing: Missing,
    /// Folder of the network's model [default: the model inside this program]
    #[arg(long, value_name = "DIR")]
    pub model: Option<PathBuf>,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

/// A column of a comparison: every mode of `render`, and the oracle.
impl ValueEnum for Method {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [Method; GuideMode::ALL.len() + 1] = {
            let mut all = [Method::Oracle; GuideMode::ALL.len() + 1];
            let mut i = 0;
            while i < GuideMode::ALL.len() {
                all[i] = Method::Guide(GuideMode::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            Self::Guide(guide) => guide.to_possible_value(),
            Self::Variant(_) => None,
            Self::Oracle => {
                let help = "Guided by converged trees made beforehand: what reconstruction could reach at most";
                Some(PossibleValue::new("oracle").help(help))
            }
        }
    }
}

const ERROR_EXAMPLES: &str = "Examples:
  fanal error out.exr reference.exr
  fanal error out.exr reference.exr --json";

/// `fanal error`.
#[derive(Debug, Clone, Args)]
#[command(after_help = ERROR_EXAMPLES)]
pub struct ErrorArgs {
    /// The picture
    #[arg(value_name = "A")]
    pub picture: PathBuf,
    /// What it should be
    #[arg(value_name = "REF")]
    pub reference: PathBuf,
    /// Variance of the reference per pixel and channel, as EXR; it is subtracted from both relMSE
    #[arg(long, value_name = "FILE")]
    pub reference_variance: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

const DATASET_EXAMPLES: &str = concat!(
    "Examples:
  fanal dataset datasets/small.toml -o data/small
  fanal dataset --check data/small
  fanal dataset datasets/small.toml -o data/small --part 3/16
What was made is kept: the same command goes on after the last scene.",
    exit_codes!()
);

/// `fanal dataset`.
#[derive(Debug, Clone, Args)]
#[command(after_help = DATASET_EXAMPLES, override_usage = "fanal dataset RECIPE.toml -o DIR\n       fanal dataset --check DIR")]
pub struct DatasetArgs {
    /// Recipe to follow
    #[arg(value_name = "RECIPE", required_unless_present = "check", conflicts_with = "check", requires = "output")]
    pub recipe: Option<PathBuf>,
    /// Folder to write; what is there already is kept, what is missing is made
    #[arg(short, long, value_name = "DIR", conflicts_with = "check")]
    pub output: Option<PathBuf>,
    /// Take the scenes in this folder instead of the recipe's, all of them held out: the scene that it is, or those in its folders
    #[arg(long, value_name = "FOLDER", conflicts_with = "check")]
    pub scenes: Option<PathBuf>,
    /// Write the scenes of the recipe's families, each as a folder that can be rendered, instead of data
    #[arg(long, conflicts_with_all = ["check", "scenes", "part"])]
    pub only_scenes: bool,
    /// Make only this part of the scenes, for example 3/16. Parts may be made in one folder by several machines at once, and are put
    /// together by `fanal merge DIR`
    #[arg(long, value_name = "K/N", conflicts_with = "check")]
    pub part: Option<PartOf>,
    /// Check a folder of data instead
    #[arg(long, value_name = "DIR")]
    pub check: Option<PathBuf>,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e7 => Ok(seconds),
        _ => Err("expected a number of seconds above 0 and at most 10000000".into()),
    }
}

fn error_target(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if (1e-9..=1e9).contains(&error) => Ok(error),
        _ => Err("expected a relMSE between 1e-9 and 1e9".into()),
    }
}

fn part(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(part) if (0.0..=1.0).contains(&part) => Ok(part),
        _ => Err("expected a number between 0 and 1".into()),
    }
}

fn kappa(text: &str) -> Result<f64, String> {
    let [least, most] = Fireflies::RANGE;
    match text.parse::<f64>() {
        Ok(kappa) if (least..=most).contains(&kappa) => Ok(kappa),
        _ => Err(format!("expected a number between {least} and {most}")),
    }
}

fn stops(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(stops) if (-64.0..=64.0).contains(&stops) => Ok(stops),
        _ => Err("expected a number of stops between -64 and 64".into()),
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides.ok_or_else(|| "expected columns and rows, for example 640x480".into())
}

fn sample(text: &str) -> Result<Sample, String> {
    let usage = || "expected column,row,sample or column,row,sample,first sample of its pass (or none)".to_owned();
    let parts: Vec<&str> = text.split(',').collect();
    let number = |text: &str| text.parse::<u32>().map_err(|_| usage());
    let (&[x, y, sample, ..], from) = (parts.first_chunk::<3>().ok_or_else(usage)?, &parts[3..]);
    let pass_from = match from {
        [] => Some(0),
        ["none"] => None,
        [from] => Some(number(from)?),
        _ => return Err(usage()),
    };
    Ok(Sample { pixel: [number(x)?, number(y)?], number: number(sample)?.into(), pass_from })
}

fn window(text: &str) -> Result<Window, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) => Ok(Window { x, y, width, height }),
        _ => Err("expected four whole numbers, for example 120,80,64,48".into()),
    }
}

fn point(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.matches(',').count() == 2 && [x, y, z].iter().all(|x| x.is_finite()) => {
            Ok(Vec3::new(x, y, z))
        }
        _ => Err("expected three numbers, for example 0.5,1,-2".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn definitions_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for bad in ["640", "x", "640x", "-1x5", "640x480x3", "99999999999x1"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
