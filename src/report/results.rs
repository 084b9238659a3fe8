//! `results.json`: everything that a comparison measured, and what follows from it.
//!
//! The types here are the schema; unknown keys are refused. It is written beside the results as JSON Schema ([`SCHEMA_FILE`]), for
//! readers in other languages. relMSE and trimmed relMSE are against the truth: where the variance of the
//! reference is known it has been subtracted, so they may be negative where a picture is as good as its reference. `errors.relmse` and the
//! others are as in [`crate::film::error`]. Seconds are wall time of the render, learning included, loading and building the scene
//! not; `cpu_seconds` are those of all threads in the same span.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::files::{read_json, write_json};
use crate::base::{Error, Place, Result};
use crate::film::Measures;

/// Version of the format.
pub const VERSION: u32 = 1;
/// Name of the method that samples what many samples have taught.
pub const ORACLE: &str = "oracle";
/// Name of the file in an output folder.
pub const FILE: &str = "results.json";

/// Name of the file with the JSON Schema of [`FILE`].
pub const SCHEMA_FILE: &str = "results.schema.json";

/// Largest accepted JSON file of a comparison in bytes.
pub(super) const LIMIT: u64 = 256 << 20;

/// No render takes longer, seconds: thirty thousand years.
const LONGEST: f64 = 1e12;

/// A whole comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Results {
    /// [`VERSION`].
    pub version: u32,
    /// Version of the program.
    pub program: String,
    /// The scene.
    pub scene: SceneEntry,
    /// Threads that rendered.
    pub threads: usize,
    /// What errors are measured against.
    pub reference: ReferenceEntry,
    /// Names of the methods, in the order of the page.
    pub methods: Vec<String>,
    /// Budgets, in seconds or samples per pixel, smallest first of each kind.
    pub budgets: Vec<Budget>,
    /// Seeds that were rendered; each is used by every method at every budget, so that methods can be compared in pairs.
    pub seeds: Vec<u64>,
    /// Samples per pixel that the oracle learned from; its learning is not part of its seconds.
    pub oracle_spp: Option<u32>,
    /// Name and version of the denoiser, where pictures were measured without their noise too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub denoiser: Option<String>,
    /// Every render.
    pub runs: Vec<RunEntry>,
    /// Per method and budget.
    pub summary: Vec<SummaryEntry>,
    /// Time to reach an error, trimmed relMSE.
    pub time_to_reach: Vec<TargetEntry>,
}

/// The scene compared on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Name.
    pub name: String,
    /// As given on the command line.
    pub path: String,
    /// CRC-32 of its description, by which runs of another scene are told apart.
    pub crc32: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Longest path.
    pub max_depth: u32,
    /// Seconds to read it.
    pub load_seconds: f64,
    /// Seconds to build its acceleration structure.
    pub build_seconds: f64,
}

/// The reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceEntry {
    /// File, relative to the output folder or absolute.
    pub file: String,
    /// File of the variance of each pixel's mean, where it is known.
    pub variance_file: Option<String>,
    /// Where it came from.
    pub origin: String,
    /// Mean over pixels and channels of variance / (r² + 0.01): its own error as a relMSE.
    pub relative_variance: Option<f64>,
}

/// What a run may spend.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Budget {
    /// Samples per pixel, camera and light paths together.
    Spp(u32),
    /// Wall time.
    Seconds(f64),
}

impl Budget {
    /// For people and file names.
    pub fn label(self) -> String {
        match self {
            Self::Spp(spp) => format!("{spp}spp"),
            Self::Seconds(seconds) => format!("{seconds}s"),
        }
    }
}

/// The three errors that the page shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// relMSE.
    pub relmse: f64,
    /// relMSE without the worst 0.1 % of pixels.
    pub relmse_trimmed: f64,
    /// relMSE of what a screen shows.
    pub relmse_ldr: f64,
}

impl From<&Measures> for Errors {
    fn from(measures: &Measures) -> Self {
        let &Measures { relmse, relmse_trimmed, relmse_ldr, .. } = measures;
        Self { relmse, relmse_trimmed, relmse_ldr }
    }
}

/// A picture without its noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DenoisedEntry {
    /// Wall time of denoising, features included.
    pub seconds: f64,
    /// Errors against the reference.
    pub errors: Errors,
}

/// Seconds of one run by kind of work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Parts {
    /// Camera paths.
    pub trace: f64,
    /// Light paths.
    pub photons: f64,
    /// Depositing into trees.
    pub deposit: f64,
    /// Making distributions.
    pub reconstruct: f64,
    /// Writing the picture.
    pub write: f64,
}

/// One render.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunEntry {
    /// Method.
    pub method: String,
    /// Index into `budgets`.
    pub budget: usize,
    /// Seed.
    pub seed: u64,
    /// The picture, relative to the output folder.
    pub file: String,
    /// Samples per pixel spent.
    pub spp: u32,
    /// Wall time.
    pub seconds: f64,
    /// CPU time, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Wall time by kind of work.
    pub parts: Parts,
    /// Errors against the reference.
    pub errors: Errors,
    /// Mean of the picture over the mean of the reference; none where only the reference is black.
    pub mean_ratio: Option<f64>,
    /// The picture without its noise, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub denoised: Option<DenoisedEntry>,
    /// Samples left out because they were not finite.
    pub dropped_samples: u64,
}

impl RunEntry {
    /// Whether a render can have cost this: times that are no times would go into means and onto logarithmic axes.
    pub(super) fn is_possible(&self) -> bool {
        let Parts { trace, photons, deposit, reconstruct, write } = self.parts;
        let all = [self.seconds, self.cpu_seconds.unwrap_or(0.0), trace, photons, deposit, reconstruct, write];
        all.iter().all(|seconds| (0.0..LONGEST).contains(seconds))
    }
}

/// A mean with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Geometric mean over seeds.
    pub mean: f64,
    /// Lower end of the bootstrap interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Denoised pictures of one method at one budget.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DenoisedSummary {
    /// Median wall time, that of denoising included.
    pub seconds: f64,
    /// relMSE over seeds.
    pub relmse: Interval,
    /// Trimmed relMSE over seeds.
    pub relmse_trimmed: Interval,
    /// LDR relMSE over seeds.
    pub relmse_ldr: Interval,
}

/// One method at one budget.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SummaryEntry {
    /// Method.
    pub method: String,
    /// Index into `budgets`.
    pub budget: usize,
    /// Median samples per pixel.
    pub spp: f64,
    /// Median wall time.
    pub seconds: f64,
    /// Median CPU time.
    pub cpu_seconds: Option<f64>,
    /// Median wall time by kind of work.
    pub parts: Parts,
    /// relMSE over seeds.
    pub relmse: Interval,
    /// Trimmed relMSE over seeds.
    pub relmse_trimmed: Interval,
    /// LDR relMSE over seeds.
    pub relmse_ldr: Interval,
    /// Trimmed relMSE over that of the first method, paired by seed; none where the first method was not run.
    pub ratio: Option<Interval>,
    /// The same pictures without their noise, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub denoised: Option<DenoisedSummary>,
}

/// Time that each method needs for one error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetEntry {
    /// Trimmed relMSE.
    pub error: f64,
    /// In the order of `methods`.
    pub methods: Vec<Reach>,
}

/// Whether and when a method reaches an error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reach {
    /// After so many seconds, by interpolation between budgets.
    At(f64),
    /// The smallest budget was already better.
    Before(f64),
    /// Not with the largest budget.
    Never,
}

impl Results {
    /// Reads a file that [`Results::write`] wrote.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] naming the line, also for another version.
    pub fn read(path: &Path) -> Result<Self> {
        let results: Self = read_json(path, LIMIT)?;
        if results.version != VERSION {
            let message = format!("version {}, this program reads version {VERSION}", results.version);
            return Err(Error::malformed(Place::file(path), message));
        }
        Ok(results)
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<()> {
        write_json(path, self)
    }

    /// Writes the JSON Schema (draft 2020-12) that every file by [`Results::write`] obeys.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_schema(path: &Path) -> Result<()> {
        write_json(path, &schemars::schema_for!(Self))
    }
}
