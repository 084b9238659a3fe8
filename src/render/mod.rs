//! Rendering: passes of growing size that learn, then a final pass; budgets; statistics.

pub mod aov;
mod budget;
pub mod checkpoint;
mod control;
mod features;
mod final_pass;
mod iterations;
mod learning;
mod mattes;
mod order;
mod pass;
mod replay;
mod run;
mod settings;
mod state;
mod statistics;
mod target;

pub use aov::Aov;
pub use checkpoint::Checkpointing;
pub use control::{Control, Refresh, Snapshot};
pub use features::features;
pub use learning::{Learning, Records};
pub use pass::{CHUNK, Chunk, PassTracer};
pub use replay::{Sample, replay};
pub use settings::{GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
pub use statistics::{Dropped, Drops, ErrorPoint, GuideStatistics, Iteration, Seconds, Statistics};

use std::sync::atomic::AtomicBool;

use crate::base::Result;
use crate::base::progress::Progress;
use crate::film::PixelSpread;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::picture::Image;
use crate::reconstruct::Reconstructor;
use crate::scene::Scene;
use run::Run;
use state::Phase;

/// Result of a render.
pub struct Outcome {
    /// The picture, linear RGB.
    pub image: Image,
    /// Sample counts and variances of its pixels, where the settings ask for them.
    pub spread: Option<PixelSpread>,
    /// Statistics of time and samples spent.
    pub statistics: Statistics,
    /// The field that guided the final pass.
    pub field: GuideField,
    /// Counted distributions and gains behind the field, per voxel, where the settings ask for them.
    pub evidence: Evidence,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether the stop flag ended the render early.
    pub interrupted: bool,
}

/// Renders `scene`. `reconstructor` makes the distributions of the guided modes and is not used by [`GuideMode::None`].
/// Setting `stop` ends the render early with the picture so far.
///
/// Under [`StopRule::Spp`] the picture is the same bit for bit for any number of threads.
///
/// # Errors
/// [`Error::Options`](crate::base::Error::Options) for a picture without pixels or a budget without samples;
/// [`Error::Interrupted`](crate::base::Error::Interrupted) where it was stopped before its first sample; errors of the reconstructor.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Outcome> {
    render_watched(scene, settings, reconstructor, &Control::new(progress, stop))
}

/// [`render`] with previews and checkpoints as `control` asks for.
///
/// # Errors
/// As [`render`].
pub fn render_watched(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    control: &Control,
) -> Result<Outcome> {
    let mut run = Run::begin(scene, settings, control)?;
    let resumed = run.resumed.as_mut().and_then(|resumed| resumed.field.take());
    let field = match (settings.guide, resumed) {
        (GuideMode::None, _) => None,
        (_, Some((field, evidence))) => {
            run.evidence = if settings.learner.keeps_evidence { evidence } else { Evidence::default() };
            Some(field)
        }
        (_, None) => Some(run.learn(reconstructor)?),
    };
    run.finish(field)
}

/// Renders `scene` guided by a given field: the whole budget goes into the picture. With a field from
/// [`learn`] and a much larger budget this is the oracle, which shows what any reconstruction could reach at most.
///
/// # Errors
/// As [`render`].
pub fn render_with_field(
    scene: &Scene,
    settings: &RenderSettings,
    field: GuideField,
    control: &Control,
) -> Result<Outcome> {
    let mut run = Run::begin(scene, settings, control)?;
    let resumed = run.resume(Phase::Look);
    if resumed.is_some() || run.resumed.is_none() {
        run.look(&field, resumed);
    }
    run.finish(Some(field))
}

/// Spends the budget on learning alone and returns the field.
///
/// # Errors
/// As [`render`].
pub fn learn(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    control: &Control,
) -> Result<GuideField> {
    let mut run = Run::begin(scene, settings, control)?;
    run.learn_only = true;
    let field = run.learn(reconstructor)?;
    control.progress.finish();
    Ok(field)
}
