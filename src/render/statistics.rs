//! Where samples and seconds went: the content of `--stats`.

use std::collections::BTreeMap;

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

use super::settings::RenderSettings;
use crate::base::process;
use crate::film::Measures;
use crate::guiding::sample::field::GuideField;
use crate::integrators::path::Cause;
use crate::scene::Scene;
use crate::scene::plan::Effect;

/// Seconds of wall time per kind of work.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Seconds {
    /// Everything after loading.
    pub total: f64,
    /// Reading files.
    pub load: f64,
    /// Building the scene.
    pub build: f64,
    /// Camera paths.
    pub trace: f64,
    /// Light paths.
    pub photons: f64,
    /// Depositing into trees.
    pub splat: f64,
    /// Making distributions.
    pub reconstruct: f64,
    /// Denoising the picture, finding its features included.
    pub denoise: f64,
    /// Writing the picture.
    pub write: f64,
}

/// One iteration of learning.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Iteration {
    /// Index of the iteration.
    pub t: u32,
    /// Camera paths in each pixel that it visits; the first iterations visit a part of them.
    pub spp: u32,
    /// Wall time.
    pub seconds: f64,
    /// Voxels at its end.
    pub voxels: usize,
    /// Nodes of all accumulated trees.
    pub nodes: usize,
    /// Part of that time spent on making distributions.
    pub reconstruct_seconds: f64,
    /// Light paths for each camera path, as decided from the iterations before.
    pub photon_share: f64,
    /// Variance of a pixel's mean, averaged over pixels and channels; NaN where no pixel has two samples.
    pub mean_variance: f64,
    /// Estimated variance of a sample with the iteration's guide over that without a guide; none where it is not known.
    pub gain: Option<f64>,
    /// Time of a sample with the iteration's guides over that without: where the verdict on guiding depends on it measured, by rays if
    /// the budget is not a time; otherwise assumed.
    pub cost: f64,
}

impl Iteration {
    /// All fields as numbers for checkpoints, NaN for no gain; a gain itself is never NaN.
    pub(super) fn numbers(&self) -> [f64; 10] {
        let Self { t, spp, seconds, voxels, nodes, reconstruct_seconds, photon_share, mean_variance, gain, cost } =
            *self;
        let [t, spp] = [t, spp].map(f64::from);
        let [voxels, nodes] = [voxels, nodes].map(|n| n as f64);
        let gain = gain.unwrap_or(f64::NAN);
        [t, spp, seconds, voxels, nodes, reconstruct_seconds, photon_share, mean_variance, gain, cost]
    }

    pub(super) fn from_numbers(numbers: &[f64; 10]) -> Self {
        let &[t, spp, seconds, voxels, nodes, reconstruct_seconds, photon_share, mean_variance, gain, cost] = numbers;
        let [t, spp] = [t, spp].map(|n| n as u32);
        let [voxels, nodes] = [voxels, nodes].map(|n| n as usize);
        let gain = (!gain.is_nan()).then_some(gain);
        Self { t, spp, seconds, voxels, nodes, reconstruct_seconds, photon_share, mean_variance, gain, cost }
    }
}

/// Size of the field that guides the final pass.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct GuideStatistics {
    /// Voxels.
    pub voxels: usize,
    /// Voxels that have a distribution.
    pub trees: usize,
    /// Quadtree nodes that can be sampled.
    pub nodes: usize,
    /// Complete paths that are kept.
    pub paths: usize,
    /// Bytes of the field, and of the paths.
    pub bytes: usize,
}

impl GuideStatistics {
    /// Size of a field.
    pub fn of(field: &GuideField) -> Self {
        Self {
            voxels: field.voxels().len(),
            trees: field.voxels().iter().filter(|v| v.directions.is_some()).count(),
            nodes: field.nodes(),
            paths: 0,
            bytes: field.bytes(),
        }
    }
}

/// Statistics of a render.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Statistics {
    /// Version of this format.
    pub version: u32,
    /// Scene name.
    pub scene: String,
    /// Guide mode.
    pub method: String,
    /// Seed.
    pub seed: u64,
    /// Threads of the pool.
    pub threads: usize,
    /// Columns of the rendered window.
    pub width: u32,
    /// Rows of the rendered window; of several views, of each.
    pub height: u32,
    /// Names of the views that were rendered together; empty for a picture alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub views: Vec<String>,
    /// Samples per pixel spent, camera and light paths together.
    pub spp: u32,
    /// Wall time.
    pub seconds: Seconds,
    /// Ray queries.
    pub rays: u64,
    /// Ray queries of camera paths.
    pub camera_rays: u64,
    /// Ray queries per second of the total time.
    pub rays_per_second: f64,
    /// Camera and light paths traced.
    pub samples: u64,
    /// Camera and light paths per second of the total time.
    pub samples_per_second: f64,
    /// Camera samples that were not finite and left out.
    pub dropped_samples: u64,
    /// Causes of dropped samples, and the first of those samples.
    pub dropped: Drops,
    /// Triangles of the scene that have no area and were left out.
    pub skipped_triangles: usize,
    /// Meshes and pictures that the scene names and that were not found; it was rendered without them.
    pub missing_files: Vec<String>,
    /// Size of the guiding field.
    pub guide: GuideStatistics,
    /// Iterations of learning.
    pub iterations: Vec<Iteration>,
    /// Effects of the scene's plan: which are on, and why.
    pub effects: Vec<Effect>,
    /// Decisions on guiding and photons taken while rendering, by counts; a sentence each.
    pub decisions: Vec<String>,
    /// relMSE estimated by the render itself, without a reference; only for a render to a target error.
    pub estimated_relmse: Option<f64>,
    /// Errors against the reference, where there is one.
    pub errors: Vec<ErrorPoint>,
    /// Error of the denoised picture, where there is one and a reference.
    pub denoised_error: Option<ErrorPoint>,
    /// Peak resident memory of the process, bytes; none where the system does not tell.
    pub peak_rss_bytes: Option<u64>,
}

/// A camera sample that was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Dropped {
    /// Column and row in the whole picture; on the sheet while several are rendered.
    pub pixel: [u32; 2],
    /// Number of the sample among all of its pixel's.
    pub sample: u64,
    /// The number at which its pass began, where the pass follows sequences of random numbers.
    pub pass_from: Option<u32>,
    /// First quantity on its path that was not finite.
    pub cause: Cause,
    /// The view whose picture it is of, as an index of [`Statistics::views`], once a render of several has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<usize>,
}

impl Dropped {
    /// Argument of `--replay` that traces the sample again under the same seed.
    pub fn replay(&self) -> String {
        let [x, y] = self.pixel;
        let from = self.pass_from.map_or_else(|| "none".to_owned(), |from| from.to_string());
        format!("{x},{y},{},{from}", self.sample)
    }

    pub(super) fn numbers(&self) -> [f64; 5] {
        let [x, y] = self.pixel.map(f64::from);
        let cause = Cause::ALL.iter().position(|cause| *cause == self.cause).unwrap_or(0);
        [x, y, self.sample as f64, self.pass_from.map_or(-1.0, f64::from), cause as f64]
    }

    pub(super) fn from_numbers(&[x, y, sample, from, cause]: &[f64; 5]) -> Option<Self> {
        let pass_from = (from >= 0.0).then_some(from as u32);
        let cause = *Cause::ALL.get(cause as usize)?;
        Some(Self { pixel: [x as u32, y as u32], sample: sample as u64, pass_from, cause, view: None })
    }
}

/// Samples that were not finite and left out.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Drops {
    /// Dropped camera samples by cause, in the order of [`Cause::ALL`].
    pub causes: [u64; Cause::ALL.len()],
    /// Light paths that ended because their power was not finite.
    pub photons: u64,
    /// The first dropped camera samples, at most `REMEMBERED`.
    pub first: Vec<Dropped>,
}

/// Number of dropped camera samples that are kept one by one.
const REMEMBERED: usize = 16;

impl Drops {
    /// Counts a dropped camera sample; the first are kept.
    pub fn add(&mut self, dropped: Dropped) {
        let counts = self.causes.iter_mut().zip(Cause::ALL);
        counts.filter(|(_, cause)| *cause == dropped.cause).for_each(|(count, _)| *count += 1);
        if self.first.len() < REMEMBERED {
            self.first.push(dropped);
        }
    }

    /// Names of the causes that occurred, with their counts.
    pub fn counted(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.causes.iter().zip(Cause::ALL).filter(|(count, _)| **count > 0).map(|(&count, cause)| (cause.name(), count))
    }
}

impl Serialize for Drops {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct First<'a> {
            #[serde(flatten)]
            dropped: &'a Dropped,
            replay: String,
        }
        let first: Vec<First> = self.first.iter().map(|d| First { dropped: d, replay: d.replay() }).collect();
        let mut map = serializer.serialize_struct("Drops", 3)?;
        map.serialize_field("causes", &self.counted().collect::<BTreeMap<_, _>>())?;
        map.serialize_field("photons", &self.photons)?;
        map.serialize_field("first", &first)?;
        map.end()
    }
}

/// Error of a picture against a reference.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ErrorPoint {
    /// Wall time of the render, seconds.
    pub seconds: f64,
    /// Samples per pixel.
    pub spp: u32,
    /// Relative mean squared error.
    pub relmse: f64,
    /// relMSE without the worst 0.1 % of pixels.
    pub relmse_trimmed: f64,
}

impl ErrorPoint {
    pub(super) fn numbers(&self) -> [f64; 4] {
        [self.seconds, f64::from(self.spp), self.relmse, self.relmse_trimmed]
    }

    pub(super) fn from_numbers(&[seconds, spp, relmse, relmse_trimmed]: &[f64; 4]) -> Self {
        Self { seconds, spp: spp as u32, relmse, relmse_trimmed }
    }

    /// The errors of a picture made in `seconds` with `spp` samples per pixel.
    pub fn new(seconds: f64, spp: u32, measures: &Measures) -> Self {
        Self { seconds, spp, relmse: measures.relmse, relmse_trimmed: measures.relmse_trimmed }
    }
}

impl Statistics {
    /// The totals that grow from chunk to chunk, for checkpoints.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let Seconds { trace, photons, splat, reconstruct, .. } = self.seconds;
        let counts = [self.rays, self.camera_rays, self.samples, self.dropped_samples, self.dropped.photons];
        let counts = counts.into_iter().chain(self.dropped.causes).map(|n| n as f64);
        [trace, photons, splat, reconstruct].into_iter().chain(counts).collect()
    }

    /// Statistics with the totals that [`Statistics::numbers`] made; none where there are too few or too many.
    pub(super) fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (&[trace, photons, splat, reconstruct, rays, camera_rays, samples, dropped, lost], causes) =
            numbers.split_first_chunk()?;
        let seconds = Seconds { trace, photons, splat, reconstruct, ..Seconds::default() };
        let mut statistics = Self { seconds, ..Self::default() };
        [statistics.rays, statistics.camera_rays, statistics.samples] = [rays, camera_rays, samples].map(|n| n as u64);
        [statistics.dropped_samples, statistics.dropped.photons] = [dropped, lost].map(|n| n as u64);
        statistics.dropped.causes = causes.iter().map(|&n| n as u64).collect::<Vec<_>>().try_into().ok()?;
        Some(statistics)
    }

    /// Those of a render that has nothing left to do.
    pub fn of_nothing(scene: &Scene, settings: &RenderSettings) -> Self {
        let mut statistics = Self::default();
        statistics.describe(scene, settings, 0);
        statistics
    }

    /// Camera and light paths traced in each second that was spent on them.
    pub(super) fn rate(&self) -> f64 {
        self.samples as f64 / (self.seconds.trace + self.seconds.photons).max(1e-3)
    }

    pub(super) fn describe(&mut self, scene: &Scene, settings: &RenderSettings, spp: u32) {
        self.version = 1;
        self.scene.clone_from(&scene.name);
        self.method = settings.guide.name().into();
        self.seed = settings.seed;
        self.threads = rayon::current_num_threads();
        let window = settings.window(scene.size);
        [self.width, self.height] = [window.width, window.height / scene.views() as u32];
        if scene.views() > 1 {
            self.dropped.first.iter_mut().for_each(|dropped| {
                let (view, row) = scene.view_of(dropped.pixel[1]);
                (dropped.view, dropped.pixel[1]) = (Some(view), row);
            });
        }
        self.spp = spp;
        self.peak_rss_bytes = process::peak_rss();
        let total = self.seconds.total.max(1e-9);
        self.rays_per_second = self.rays as f64 / total;
        self.samples_per_second = self.samples as f64 / total;
    }
}
