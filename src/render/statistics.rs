//! Where samples and seconds went: the content of `--stats`.

use serde::Serialize;

use super::settings::RenderSettings;
use crate::base::process;
use crate::film::Measures;
use crate::guiding::field::GuideField;
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
    /// Writing the picture.
    pub write: f64,
}

/// One iteration of learning.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Iteration {
    /// Index.
    pub t: u32,
    /// Camera paths per pixel.
    pub spp: u32,
    /// Wall time.
    pub seconds: f64,
    /// Voxels at its end.
    pub voxels: usize,
    /// Nodes of all accumulated trees.
    pub nodes: usize,
    /// Part of the time that made distributions.
    pub reconstruct_seconds: f64,
    /// Light paths for each camera path, as decided from the iterations before.
    pub photon_share: f64,
    /// Variance of a pixel's mean, averaged; NaN where one sample cannot tell.
    pub mean_variance: f64,
    /// About the variance of a sample with the guide that the iteration made over that without it; none where it cannot tell.
    pub gain: Option<f64>,
}

/// The field of the final pass.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct GuideStatistics {
    /// Voxels.
    pub voxels: usize,
    /// Voxels that have a distribution.
    pub trees: usize,
    /// Quadtree nodes that can be sampled.
    pub nodes: usize,
    /// Bytes of the field.
    pub bytes: usize,
}

impl GuideStatistics {
    /// Size of a field.
    pub fn of(field: &GuideField) -> Self {
        Self {
            voxels: field.voxels().len(),
            trees: field.voxels().iter().filter(|v| v.tree.is_some()).count(),
            nodes: field.nodes(),
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
    /// Columns of what was rendered.
    pub width: u32,
    /// Rows of what was rendered.
    pub height: u32,
    /// Samples per pixel spent, camera and light paths together.
    pub spp: u32,
    /// Wall time.
    pub seconds: Seconds,
    /// Ray queries.
    pub rays: u64,
    /// Those of camera paths.
    pub camera_rays: u64,
    /// Per second of the total.
    pub rays_per_second: f64,
    /// Camera and light paths.
    pub samples: u64,
    /// Per second of the total.
    pub samples_per_second: f64,
    /// Samples that were not finite and left out.
    pub dropped_samples: u64,
    /// Guiding.
    pub guide: GuideStatistics,
    /// Learning.
    pub iterations: Vec<Iteration>,
    /// Effects of the scene.
    pub effects: Vec<Effect>,
    /// What was decided while rendering, by counts, each in a sentence.
    pub decisions: Vec<String>,
    /// relMSE as the render estimates it itself, where it ran to a target error.
    pub estimated_relmse: Option<f64>,
    /// Errors against the reference, where there is one.
    pub errors: Vec<ErrorPoint>,
    /// Most memory that the process held, where the system tells.
    pub peak_rss_bytes: Option<u64>,
}

/// Error of a picture against a reference.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ErrorPoint {
    /// Wall time of the render.
    pub seconds: f64,
    /// Samples per pixel.
    pub spp: u32,
    /// Relative mean squared error.
    pub relmse: f64,
    /// The same without the worst 0.1 % of pixels.
    pub relmse_trimmed: f64,
}

impl ErrorPoint {
    /// The errors of a picture made in `seconds` with `spp` samples per pixel.
    pub fn new(seconds: f64, spp: u32, measures: &Measures) -> Self {
        Self { seconds, spp, relmse: measures.relmse, relmse_trimmed: measures.relmse_trimmed }
    }
}

impl Statistics {
    pub(super) fn describe(&mut self, scene: &Scene, settings: &RenderSettings, spp: u32) {
        self.version = 1;
        self.scene.clone_from(&scene.name);
        self.method = settings.guide.name().into();
        self.seed = settings.seed;
        self.threads = rayon::current_num_threads();
        let window = settings.window(scene.size);
        [self.width, self.height] = [window.width, window.height];
        self.spp = spp;
        self.peak_rss_bytes = process::peak_rss();
        let total = self.seconds.total.max(1e-9);
        self.rays_per_second = self.rays as f64 / total;
        self.samples_per_second = self.samples as f64 / total;
    }
}
