//! Rendering: passes of growing size that learn, then a final pass; budgets; statistics.

pub mod aov;
mod blocks;
mod budget;
mod camera;
pub mod checkpoint;
mod control;
mod features;
mod final_pass;
pub mod guide_part;
mod iterations;
mod learning;
mod lights;
mod mattes;
pub mod merge;
mod order;
mod part;
pub mod part_file;
mod pass;
mod paths;
mod replay;
mod run;
mod settings;
mod share;
mod state;
mod statistics;
mod target;
mod trial;

pub use aov::Aov;
pub use checkpoint::{ALGORITHM, Checkpointing};
pub use control::{Control, Refresh, Snapshot};
pub use features::features;
use final_pass::own_samples;
pub use final_pass::samples_of_parts;
pub use learning::{Learning, Records};
pub use part::PartOf;
pub use pass::{CHUNK, Chunk, PassTracer};
pub use replay::{Sample, replay};
pub use settings::{Fireflies, GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
pub use statistics::{Dropped, Drops, ErrorPoint, GuideStatistics, Iteration, Seconds, Statistics};

use std::sync::atomic::AtomicBool;

use crate::base::progress::Progress;
use crate::base::{Error, Result};
use crate::film::{Block, Cascade, PixelSpread};
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::picture::Image;
use crate::reconstruct::Reconstructor;
use crate::scene::Scene;
use guide_part::PartLearned;
use run::Run;
use state::Phase;

/// Result of a render.
pub struct Outcome {
    /// The picture, linear RGB, without what was taken out of it.
    pub image: Image,
    /// The light of fireflies that was taken out of it; with it, it is the plain picture. None where the settings keep it.
    pub fireflies: Option<Image>,
    /// Sample counts and variances of its pixels, where the settings ask for them.
    pub spread: Option<PixelSpread>,
    /// Statistics of time and samples spent.
    pub statistics: Statistics,
    /// The field that guided the final pass.
    pub field: GuideField,
    /// Counted distributions and gains behind the field, per voxel, where the settings ask for them.
    pub evidence: Evidence,
    /// Values that the pixels of such a picture are expected to have, for guides that are kept: where the settings ask for evidence, and
    /// there is a guide.
    pub pixel_values: Option<Vec<f32>>,
    /// The blocks of samples of a part of a render, in their order; empty where all of it was rendered.
    pub blocks: Vec<Block>,
    /// Their samples by brightness, where the settings take fireflies out of the picture that they are a part of.
    pub cascade: Option<Cascade>,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether the stop flag ended the render early.
    pub interrupted: bool,
}

impl Outcome {
    /// Samples per pixel of the picture that was rendered with `settings`: those of all parts, where this is one of them.
    fn samples_of_all(&self, settings: &RenderSettings) -> u32 {
        match (settings.part, settings.stop) {
            (Some(_), StopRule::Spp(spp)) => spp,
            _ => self.statistics.spp,
        }
    }
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
    paths::check(scene, settings, control)?;
    let mut run = Run::begin(scene, settings, control)?;
    run.start(own_samples(settings, scene.size, None)?)?;
    let resumed = run.resumed.as_mut().and_then(|resumed| resumed.field.take());
    if settings.part.is_some() && settings.guide != GuideMode::None {
        return Err(Error::Options(
            "parts do not learn: give --load-guide with a guide of `fanal learn`, or --guide none".into(),
        ));
    }
    let field = match (settings.guide, resumed) {
        (GuideMode::None | GuideMode::Paths, _) => None,
        (_, Some((field, evidence))) => {
            run.evidence = if settings.learner.keeps_evidence { evidence } else { Evidence::default() };
            Some(field)
        }
        (_, None) => Some(run.learn(reconstructor)?),
    };
    run.finish(field)
}

/// Renders `scene` guided by a given field: the whole budget goes into the picture, but for a few samples that tell what its pixels will
/// be where the field does not know that. With a field from
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
    if settings.guide == GuideMode::Paths {
        return Err(Error::Options("--guide paths has no guide that could be loaded".into()));
    }
    paths::check(scene, settings, control)?;
    let mut run = Run::begin(scene, settings, control)?;
    run.start(own_samples(settings, scene.size, Some(&field))?)?;
    run.known = field.pixel_values().and_then(|known| known.within(run.window));
    let resumed = run.resume(Phase::Look);
    if resumed.is_some() || run.resumed.is_none() {
        run.look(&field, resumed);
    }
    run.finish(Some(field))
}

/// What learning alone gives.
pub struct Learned {
    /// The field, which guides whatever its gain.
    pub field: GuideField,
    /// Counted distributions and gains behind the field, per voxel, where the settings ask for them.
    pub evidence: Evidence,
    /// Values that pixels are expected to have; none while no light was found.
    pub pixel_values: Option<Vec<f32>>,
    /// Statistics of time and samples spent.
    pub statistics: Statistics,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether the stop flag ended it early.
    pub interrupted: bool,
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
    learn_whole(scene, settings, reconstructor, control).map(|learned| learned.field)
}

/// As [`learn`], with all that is known besides.
///
/// # Errors
/// As [`render`].
pub fn learn_whole(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    control: &Control,
) -> Result<Learned> {
    if settings.part.is_some() {
        return Err(Error::Options("a part learns a share: see learn_part".into()));
    }
    paths::refuse(settings)?;
    let mut run = Run::begin(scene, settings, control)?;
    run.start(own_samples(settings, scene.size, None)?)?;
    run.learn_only = true;
    let field = run.learn(reconstructor)?;
    control.progress.finish();
    Ok(run.learned(field))
}

/// Learns a part's share of what several processes learn, see [`guide_part`].
///
/// # Errors
/// As [`render`]; [`Error::Options`] where the settings name no part, or a budget that cannot be shared.
pub fn learn_part(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    control: &Control,
) -> Result<PartLearned> {
    let (Some(part), StopRule::Spp(spp)) = (settings.part, settings.stop) else {
        return Err(Error::Options(
            "a share of learning is one of samples that are counted: give a part and --spp".into(),
        ));
    };
    paths::refuse(settings)?;
    let mut run = Run::begin(scene, settings, control)?;
    run.start(spp)?;
    run.learn_only = true;
    run.learn_part(part, spp, reconstructor)
}
