//! Rendering: passes of growing size that learn, then a final pass; budgets; statistics.

mod learning;
mod pass;
mod settings;
mod statistics;

pub use learning::Learning;
pub use pass::{PassTracer, Records};
pub use settings::{GuideMode, RenderSettings, SampleKinds, StopRule};
pub use statistics::{ErrorPoint, GuideStatistics, Iteration, Seconds, Statistics};

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::base::progress::Progress;
use crate::base::{Error, Result};
use crate::film::{FinishedPass, Pass, check_size, combine};
use crate::guiding::field::GuideField;
use crate::materials::image::Image;
use crate::reconstruct::Reconstructor;
use crate::scene::Scene;

/// What a render produced.
pub struct Outcome {
    /// The picture, linear RGB.
    pub image: Image,
    /// Where time and samples went.
    pub statistics: Statistics,
    /// The field that guided the final pass.
    pub field: GuideField,
}

/// Renders `scene`. `reconstructor` makes the distributions of the guided modes and is not used by [`GuideMode::None`].
/// Setting `stop` ends the render early with the picture so far.
///
/// Under [`StopRule::Spp`] the picture is the same bit for bit for any number of threads.
///
/// # Errors
/// [`Error::Options`] for a picture without pixels or a budget without samples; errors of the reconstructor.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Outcome> {
    check_size(scene.size[0], scene.size[1])?;
    settings.check()?;
    let started = Instant::now();
    let mut run = Run {
        scene,
        settings,
        progress,
        stop,
        started,
        statistics: Statistics::default(),
        passes: Vec::new(),
        spent: 0,
        rendered: 0,
    };
    let (total, unit) = match settings.stop {
        StopRule::Spp(spp) => (u64::from(spp) * run.pixels(), "samples"),
        StopRule::Time(_) => (0, "samples"),
    };
    progress.start(total, unit);
    let field = if settings.guide == GuideMode::None { None } else { Some(run.learn(reconstructor)?) };
    run.final_pass(field.as_ref())?;
    progress.finish();
    run.finish(field.unwrap_or_else(GuideField::empty))
}

struct Run<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    progress: &'a dyn Progress,
    stop: &'a AtomicBool,
    started: Instant,
    statistics: Statistics,
    passes: Vec<FinishedPass>,
    /// Samples per pixel so far, camera and light paths together.
    spent: u32,
    /// Camera samples per pixel so far.
    rendered: u32,
}

impl Run<'_> {
    fn pixels(&self) -> u64 {
        u64::from(self.scene.size[0]) * u64::from(self.scene.size[1])
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Iterations of 2^t samples per pixel while the learning share of the budget lasts (Zhu 2021 §7).
    fn learn(&mut self, reconstructor: &dyn Reconstructor) -> Result<GuideField> {
        let mut learning = Learning::new(self.settings);
        let mut last = 0.0;
        for t in 0.. {
            let camera = 1u32 << t;
            let cost = camera * self.settings.samples.per_iteration();
            if self.stopped() || !self.affords(cost, last) {
                break;
            }
            let begun = Instant::now();
            self.progress.message(&format!("learning, iteration {t}"));
            let field = learning.field(true);
            let tracer = PassTracer {
                scene: self.scene,
                settings: self.settings,
                field: Some(&field),
                first_sample: self.rendered,
                spp: camera,
                stop: self.stop,
            };
            let mut pass = Pass::new(self.scene.size[0] as usize, self.scene.size[1] as usize);
            let complete = tracer.run(&mut pass, Some(&mut learning), &mut self.statistics, self.progress);
            self.spent += cost;
            self.rendered += camera;
            // The first two passes are not worth their noise, but they are all there is of a render stopped early.
            if t >= 2 || !complete {
                self.passes.push(pass.finish());
            }
            let iteration = learning.end_iteration(reconstructor, &mut self.statistics.seconds)?;
            last = begun.elapsed().as_secs_f64();
            let pass_variance = self.passes.last().and_then(FinishedPass::mean_variance);
            self.statistics.iterations.push(Iteration {
                t,
                spp: camera,
                seconds: last,
                mean_variance: pass_variance.unwrap_or(f64::NAN),
                ..iteration
            });
        }
        let field = learning.field(false);
        self.statistics.guide = learning.statistics(&field);
        Ok(field)
    }

    /// Whether another iteration of `cost` samples per pixel fits into the learning share; `last` seconds were needed for
    /// the one before.
    fn affords(&self, cost: u32, last: f64) -> bool {
        let share = self.settings.learning_share;
        match self.settings.stop {
            StopRule::Spp(spp) => f64::from(self.spent + cost) <= f64::from(spp) * share,
            StopRule::Time(seconds) => self.started.elapsed().as_secs_f64() + 2.0 * last <= seconds * share,
        }
    }

    /// What is left of the budget goes into one pass with the field as it is.
    fn final_pass(&mut self, field: Option<&GuideField>) -> Result<()> {
        self.progress.message("rendering");
        let mut pass = Pass::new(self.scene.size[0] as usize, self.scene.size[1] as usize);
        let mut rendered = 0;
        loop {
            let spp = match self.settings.stop {
                StopRule::Spp(spp) => spp.saturating_sub(self.spent),
                StopRule::Time(seconds) => self.batch(seconds, rendered),
            };
            if spp == 0 || self.stopped() {
                break;
            }
            let tracer = PassTracer {
                scene: self.scene,
                settings: self.settings,
                field,
                first_sample: self.rendered,
                spp,
                stop: self.stop,
            };
            tracer.run(&mut pass, None, &mut self.statistics, self.progress);
            self.spent += spp;
            self.rendered += spp;
            rendered += spp;
        }
        if rendered > 0 {
            self.passes.push(pass.finish());
        }
        Ok(())
    }

    /// Samples per pixel of the next batch under a time budget: about a tenth of what is left, by the speed so far.
    fn batch(&self, seconds: f64, rendered: u32) -> u32 {
        let left = seconds - self.started.elapsed().as_secs_f64();
        if left <= 0.0 && self.rendered > 0 {
            return 0;
        }
        let traced = self.statistics.seconds.trace;
        if rendered == 0 || traced <= 0.0 {
            return 1;
        }
        let per_sample = traced / f64::from(self.rendered);
        if left < 0.5 * per_sample { 0 } else { ((left / per_sample * 0.1) as u32).max(1) }
    }

    fn finish(mut self, field: GuideField) -> Result<Outcome> {
        let image = combine(&self.passes).map_err(|_| {
            Error::Options("no sample was rendered: the render was stopped before its first pass".into())
        })?;
        let statistics = &mut self.statistics;
        statistics.seconds.total = self.started.elapsed().as_secs_f64();
        statistics.describe(self.scene, self.settings, self.spent);
        Ok(Outcome { image, statistics: self.statistics, field })
    }
}
