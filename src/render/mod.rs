//! Rendering: passes of growing size that learn, then a final pass; budgets; statistics.

pub mod aov;
mod control;
mod learning;
mod pass;
mod settings;
mod split;
mod statistics;
mod target;

pub use aov::Aov;
pub use control::{Control, Refresh, Snapshot};
pub use learning::Learning;
pub use pass::{CHUNK, PassTracer, Records};
pub use settings::{GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
pub use statistics::{ErrorPoint, GuideStatistics, Iteration, Seconds, Statistics};

use std::sync::atomic::AtomicBool;

use crate::base::progress::Progress;
use crate::base::{Error, Result};
use crate::film::{
    FinishedPass, Pass, PixelFilter, PixelSpread, Window, check_size, combine, expected_values, outliers, pixel_spread,
};
use crate::guiding::field::{Evidence, GuideField};
use crate::materials::Material;
use crate::materials::image::Image;
use crate::reconstruct::Reconstructor;
use crate::scene::Scene;
use control::Watcher;
use split::{Outlook, gain, learns_on, pays};

/// What a render produced.
pub struct Outcome {
    /// The picture, linear RGB.
    pub image: Image,
    /// How far its pixels may be off, where the settings ask for that.
    pub spread: Option<PixelSpread>,
    /// Where time and samples went.
    pub statistics: Statistics,
    /// The field that guided the final pass.
    pub field: GuideField,
    /// What it was made of, where the settings ask for that.
    pub evidence: Evidence,
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
    render_watched(scene, settings, reconstructor, &Control { progress, stop, refresh: None })
}

/// [`render`] with a picture shown from time to time.
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
    let field = if settings.guide == GuideMode::None { None } else { Some(run.learn(reconstructor)?) };
    run.finish(field)
}

/// Renders `scene` guided by a field that is already there: the whole budget goes into the picture. With a field from
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
    run.statistics.guide = GuideStatistics::of(&field);
    run.look(&field);
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

/// What learning decided, in sentences.
fn decisions(gave_up: bool, trend: &Trend, iterations: &[Iteration], photon_share: f64) -> Vec<String> {
    let count = iterations.len();
    let measured = trend.gain.map_or("not measured yet".into(), |gain| format!("{gain:.2} times that without"));
    let verdict = if gave_up { "off: it does not pay" } else { "on" };
    let guiding =
        format!("guiding {verdict}: the variance of a sample with it is {measured}, after {count} iterations");
    let photons = iterations.first().filter(|first| first.photon_share > 0.0).map(|_| {
        let verdict = if photon_share > 0.0 { "on" } else { "off: what they teach does not pay" };
        format!("photons {verdict}: {:.2} light paths for each camera path in the end", photon_share.abs())
    });
    [Some(guiding), photons].into_iter().flatten().collect()
}

/// A picture, and how far its pixels may be off where that is wanted.
type Rendered = (Image, Option<PixelSpread>);

/// Fewest paths in a chunk: enough to keep a few threads busy.
const LEAST_CHUNK: u64 = 1 << 14;
/// Samples per pixel that tell enough of what pixels will be.
const LOOK: u32 = 4;
/// A chunk is at least this part of the pixels, so that one alone leaves no gaps but narrow ones.
const EVERY_ROW: u64 = 12;

struct Run<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    /// What of the picture is rendered.
    window: Window,
    filter: PixelFilter,
    watcher: Watcher<'a>,
    statistics: Statistics,
    passes: Vec<FinishedPass>,
    /// The first passes that learned, which are too noisy for the picture, but tell about what it will be.
    early: Vec<FinishedPass>,
    /// Whether no picture is wanted, so that the whole budget may go into learning.
    learn_only: bool,
    /// Whether guiding turned out not to pay.
    gave_up: bool,
    /// Samples per pixel so far, camera and light paths together.
    spent: f64,
    evidence: Evidence,
    /// Camera samples per pixel so far.
    rendered: u32,
    /// Those before the pass that is being made, where its samples follow sequences.
    sequences_from: Option<u32>,
}

/// What the iterations so far say about the next.
#[derive(Default)]
struct Trend {
    /// Variance of one sample in each iteration.
    variances: Vec<f64>,
    /// Seconds of the last iteration, and the part of them in which camera paths were traced.
    seconds: f64,
    useful: f64,
    /// Variance with the guide over that without it, as the last iteration measured it.
    gain: Option<f64>,
    /// relMSE of a picture with one sample per pixel, by the last iteration; only kept where a target error asks for it.
    relative: f64,
}

impl<'a> Run<'a> {
    fn begin(scene: &'a Scene, settings: &'a RenderSettings, control: &'a Control<'a>) -> Result<Self> {
        check_size(scene.size[0], scene.size[1])?;
        settings.check()?;
        let window = settings.window(scene.size);
        window.check_inside(scene.size)?;
        let run = Self {
            scene,
            settings,
            window,
            filter: PixelFilter::new(settings.filter)?,
            watcher: Watcher::new(control),
            statistics: Statistics::default(),
            passes: Vec::new(),
            early: Vec::new(),
            learn_only: false,
            gave_up: false,
            spent: 0.0,
            evidence: Evidence::default(),
            rendered: 0,
            sequences_from: None,
        };
        let total = match settings.stop {
            StopRule::Spp(spp) => u64::from(spp) * run.pixels(),
            StopRule::Time(_) | StopRule::TargetError(_) => 0,
        };
        control.progress.start(total, "samples");
        Ok(run)
    }

    fn pixels(&self) -> u64 {
        self.window.pixels()
    }

    fn begin_pass(&mut self) -> Pass {
        self.sequences_from = Some(self.rendered);
        self.empty_pass()
    }

    fn empty_pass(&self) -> Pass {
        Pass::new(self.window.width as usize, self.window.height as usize)
    }

    /// Traces `spp` camera paths per pixel into `pass`; returns whether all were made.
    fn trace(
        &mut self,
        pass: &mut Pass,
        spp: u32,
        field: Option<&GuideField>,
        learning: Option<&mut Learning>,
        picture: Option<&[f32]>,
    ) -> bool {
        // Against a clock, chunks of about a twentieth of a second.
        let chunk = match (&learning, self.watcher.deadline) {
            (None, Some(_)) => (0.05 * self.statistics.samples as f64 / self.statistics.seconds.trace.max(1e-3)) as u64,
            _ => CHUNK,
        };
        let tracer = PassTracer {
            scene: self.scene,
            settings: self.settings,
            window: self.window,
            filter: &self.filter,
            field,
            target: learning.as_ref().map_or(self.settings.learner.target, |l| l.learner.target()),
            picture,
            first_sample: self.rendered,
            sequences_from: self.sequences_from,
            spp,
            chunk: chunk.max(LEAST_CHUNK).max(self.pixels().div_ceil(EVERY_ROW)),
        };
        self.rendered += spp;
        self.spent += f64::from(spp) * (1.0 + learning.as_ref().map_or(0.0, |l| l.photon_share));
        let spent = self.spent.ceil() as u32;
        let (watcher, passes) = (&mut self.watcher, &self.passes);
        watcher.begin_chunk();
        let so_far = |pass: &Pass| combine(&[passes.as_slice(), &[pass.finish()]].concat()).ok();
        let mut go_on = |pass: &Pass, samples| watcher.end_chunk(samples, spent, || so_far(pass));
        tracer.run(pass, learning, &mut self.statistics, &mut go_on)
    }

    /// About what each pixel will be, by the passes so far; none while no light was found.
    fn pixel_values(&self) -> Option<Vec<f32>> {
        expected_values(&combine(if self.passes.is_empty() { &self.early } else { &self.passes }).ok()?)
    }

    /// Iterations of 2^t samples per pixel while learning pays (Zhu 2021 §7; Müller 2017 §3.5).
    fn learn(&mut self, reconstructor: &dyn Reconstructor) -> Result<GuideField> {
        let mut learning = Learning::new(self.settings, &self.scene.lights.emission);
        let mut trend = Trend::default();
        for t in 0..31 {
            let camera = 1u32 << t;
            let hopeless = t >= self.patience() && !self.pays(&trend);
            if hopeless || self.watcher.stopped() || !self.learns_on(camera, learning.photon_share, &trend) {
                break;
            }
            let (begun, traced) = (self.watcher.elapsed(), self.statistics.seconds.trace);
            let photon_share = learning.photon_share;
            self.watcher.control.progress.message(&format!("learning, iteration {t}"));
            let field = learning.field(true);
            let mut pass = self.begin_pass();
            let picture = self.pixel_values();
            if let StopRule::Time(seconds) = self.settings.stop {
                self.watcher.deadline = Some(self.settings.learning_share * seconds);
            }
            let complete = self.trace(&mut pass, camera, Some(&field), Some(&mut learning), picture.as_deref());
            if t == 0 && !complete {
                // Too many pixels for the time: what little there is left is better spent on samples than on trees.
                self.passes.push(self.finished(&pass));
                return Ok(GuideField::empty());
            }
            let rays = self.reconstruction_rays();
            let iteration = learning.end_iteration(
                camera,
                outliers(self.pixels() as usize),
                rays,
                reconstructor,
                &mut self.statistics.seconds,
            )?;
            let seconds = self.watcher.elapsed() - begun;
            let finished = self.finished(&pass);
            let variance = pass.variance_relative_to(picture.as_deref());
            trend.gain = variance.and_then(|v| gain(v, &learning.moments, finished.samples() as f64));
            trend.variances.extend(finished.sample_variance());
            trend.useful = ((self.statistics.seconds.trace - traced) / seconds.max(1e-9)).clamp(0.0, 1.0);
            trend.seconds = seconds;
            if let StopRule::TargetError(_) = self.settings.stop {
                trend.relative = pass.relative_variance();
            }
            self.statistics.iterations.push(Iteration {
                t,
                spp: camera,
                seconds,
                mean_variance: finished.sample_variance().map_or(f64::NAN, |v| v / f64::from(camera)),
                gain: trend.gain,
                photon_share,
                ..iteration
            });
            // The first two passes are not worth their noise, but they are all there is of a render stopped early.
            if t >= 2 || !complete {
                self.passes.push(finished);
            } else {
                self.early.push(finished);
            }
        }
        self.gave_up = !self.pays(&trend);
        self.statistics.decisions = decisions(self.gave_up, &trend, &self.statistics.iterations, learning.photon_share);
        let field = if self.gave_up { GuideField::empty() } else { learning.field(false) };
        self.statistics.guide = GuideStatistics::of(&field);
        self.evidence = learning.learner.evidence();
        Ok(field)
    }

    /// Iterations before guiding is given up. Learning costs several times what rendering does, so an easy scene should be known
    /// for one at once; but light that comes through glass or from mirrors is found late, and then it is most of the noise.
    fn patience(&self) -> u32 {
        let specular = self.scene.materials().iter().any(Material::is_delta);
        if specular { 4 } else { 2 }
    }

    /// Whether the guide at hand is worth its price, or its price does not matter.
    fn pays(&self, trend: &Trend) -> bool {
        self.learn_only || !self.settings.gives_up || trend.gain.is_none_or(pays)
    }

    /// Rays that reconstruction may have cost after this iteration: a share of those of the whole render as far as that can be
    /// foreseen, which is up to the end of the next iteration.
    fn reconstruction_rays(&self) -> f64 {
        let done = match self.settings.stop {
            StopRule::Spp(spp) => self.spent / f64::from(spp),
            StopRule::Time(seconds) => self.watcher.elapsed() / seconds,
            StopRule::TargetError(_) => 0.0,
        };
        let rays = self.statistics.rays as f64;
        self.settings.reconstruction_share * (rays / done.clamp(1.0 / 3.0, 1.0))
    }

    /// Whether another iteration of `camera` paths per pixel is worth its price.
    fn learns_on(&self, camera: u32, photon_share: f64, trend: &Trend) -> bool {
        let kinds = 1.0 + photon_share;
        let (cost, spent) = (f64::from(camera) * kinds, self.spent);
        let limit = self.settings.learning_share;
        let outlook = match self.settings.stop {
            StopRule::Spp(spp) => {
                let budget = f64::from(spp);
                Outlook { budget, left: budget - spent, cost, useful: 1.0 / kinds, limit }
            }
            StopRule::Time(budget) => {
                let left = budget - self.watcher.elapsed();
                Outlook { budget, left, cost: 2.0 * trend.seconds, useful: trend.useful, limit }
            }
            // What is learned from does not enter a picture that ends by its own samples; the first iterations find out how
            // many those will be.
            StopRule::TargetError(error) => {
                let left = if trend.relative > 0.0 { trend.relative / error } else { 100.0 * cost };
                Outlook { budget: spent + left, left, cost, useful: 0.0, limit }
            }
        };
        if self.learn_only {
            outlook.cost <= outlook.left
        } else {
            learns_on(
                &outlook,
                &trend.variances,
                trend.gain.is_some() && trend.variances.len() >= self.patience() as usize,
            )
        }
    }

    /// The picture with the field as it is, and the end.
    fn finish(mut self, field: Option<GuideField>) -> Result<Outcome> {
        self.watcher.control.progress.message("rendering");
        let (image, spread) = match self.settings.stop {
            StopRule::TargetError(error) => self.render_to(error, field.as_ref())?,
            StopRule::Spp(_) | StopRule::Time(_) => self.final_pass(field.as_ref())?,
        };
        self.watcher.control.progress.finish();
        let mut statistics = self.statistics;
        statistics.seconds.total = self.watcher.elapsed();
        statistics.describe(self.scene, self.settings, self.spent.ceil() as u32);
        Ok(Outcome {
            image,
            spread,
            statistics,
            field: field.unwrap_or_else(GuideField::empty),
            evidence: self.evidence,
        })
    }

    /// A first pass with a field that nothing was learned for: about what pixels will be, by which roulette judges the rest.
    fn look(&mut self, field: &GuideField) {
        let spp = match self.settings.stop {
            StopRule::Spp(spp) => (spp / 16).min(LOOK),
            StopRule::Time(seconds) => {
                self.watcher.deadline = Some(seconds / 16.0);
                LOOK
            }
            StopRule::TargetError(_) => LOOK,
        };
        if spp > 0 {
            let mut pass = self.begin_pass();
            self.trace(&mut pass, spp, Some(field), None, None);
            self.passes.push(self.finished(&pass));
        }
    }

    /// What is left of the budget goes into one pass.
    fn final_pass(&mut self, field: Option<&GuideField>) -> Result<Rendered> {
        let mut pass = self.begin_pass();
        let picture = field.and_then(|_| self.pixel_values());
        let mut rendered = 0;
        loop {
            let spp = match self.settings.stop {
                StopRule::Spp(spp) => (f64::from(spp) - self.spent).max(0.0) as u32,
                _ => self.batch(rendered),
            };
            if spp == 0 || self.watcher.stopped() {
                break;
            }
            self.watcher.deadline = match self.settings.stop {
                StopRule::Time(seconds) => Some(seconds),
                _ => None,
            };
            rendered += spp;
            if !self.trace(&mut pass, spp, field, None, picture.as_deref()) {
                break;
            }
        }
        if rendered > 0 {
            let finished = self.finished(&pass);
            // What a guide that does not pay has found by chance is a few bright pixels that the others would have to outweigh.
            let guided: u64 = self.passes.iter().map(FinishedPass::samples).sum();
            if self.gave_up && finished.samples() > guided {
                self.passes.clear();
            }
            self.passes.push(finished);
        }
        let image = combine(&self.passes).map_err(|_| {
            Error::Options("no sample was rendered: the render was stopped before its first pass".into())
        })?;
        Ok((image, self.spread(&self.passes, None)?))
    }

    /// Ends a pass whose samples may enter the picture.
    fn finished(&self, pass: &Pass) -> FinishedPass {
        if self.settings.keeps_spread { pass.finish_with_variance() } else { pass.finish() }
    }

    /// How far pixels of the picture that passes make may be off, where that is wanted.
    fn spread(&self, passes: &[FinishedPass], weights: Option<&[f64]>) -> Result<Option<PixelSpread>> {
        self.settings.keeps_spread.then(|| pixel_spread(passes, weights)).transpose()
    }

    /// Samples per pixel of the next batch under a time budget: about a tenth of what is left, by the speed so far.
    fn batch(&self, rendered: u32) -> u32 {
        let StopRule::Time(seconds) = self.settings.stop else { return 0 };
        let left = seconds - self.watcher.elapsed();
        let traced = self.statistics.seconds.trace;
        if rendered == 0 && (self.passes.is_empty() || left > 0.0) {
            return 1;
        }
        let per_sample = traced / f64::from(self.rendered);
        if left <= 0.0 { 0 } else { ((left / per_sample.max(1e-9) * 0.1) as u32).clamp(1, 1 << 16) }
    }
}
