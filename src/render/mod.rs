//! Rendering: passes of growing size that learn, then a final pass; budgets; statistics.

pub mod aov;
pub mod checkpoint;
mod control;
mod learning;
mod pass;
mod replay;
mod settings;
mod split;
mod state;
mod statistics;
mod target;

pub use aov::Aov;
pub use checkpoint::Checkpointing;
pub use control::{Control, Refresh, Snapshot};
pub use learning::{Learning, Records};
pub use pass::{CHUNK, Chunk, PassTracer};
pub use replay::{Sample, replay};
pub use settings::{GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
pub use statistics::{Dropped, Drops, ErrorPoint, GuideStatistics, Iteration, Seconds, Statistics};

use std::sync::atomic::AtomicBool;

use crate::base::progress::Progress;
use crate::base::{Error, Result};
use crate::film::{
    FinishedPass, Pass, PixelFilter, PixelSpread, check_size, combine, expected_values, outliers, pixel_spread,
};
use crate::guiding::learn::learner::Use;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::materials::Material;
use crate::picture::Image;
use crate::picture::Window;
use crate::reconstruct::Reconstructor;
use crate::scene::Scene;
use checkpoint::{MOST_SAMPLES, Moment, Resumed};
use control::Watcher;
use split::{Outlook, Verdict, judged, learns_on};
use state::{Part, Phase, Position, State, Trend};

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
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether the wish to stop ended it before it was done.
    pub interrupted: bool,
}

/// Renders `scene`. `reconstructor` makes the distributions of the guided modes and is not used by [`GuideMode::None`].
/// Setting `stop` ends the render early with the picture so far.
///
/// Under [`StopRule::Spp`] the picture is the same bit for bit for any number of threads.
///
/// # Errors
/// [`Error::Options`] for a picture without pixels or a budget without samples; [`Error::Interrupted`] where it was stopped before its
/// first sample; errors of the reconstructor.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    reconstructor: &dyn Reconstructor,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Outcome> {
    render_watched(scene, settings, reconstructor, &Control::new(progress, stop))
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

/// What learning decided, in sentences.
fn decisions(gave_up: bool, trend: &Trend, iterations: &[Iteration], photon_share: f64) -> Vec<String> {
    let count = iterations.len();
    let on = if gave_up { "off: it does not pay" } else { "on" };
    let measured = match trend.verdict {
        Verdict::Gain(gain) => format!("{on}: the variance of a sample with it is {gain:.2} times that without"),
        Verdict::Unseen => format!("{on}: photons know of light that paths have not found yet"),
        Verdict::Unknown => {
            format!("{on} only where samples have told that it helps: too few found light to judge it as a whole")
        }
    };
    let guiding = format!("guiding {measured}, after {count} iterations");
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
/// Iterations after which a verdict should be known even where light is hard to find.
const LATEST_VERDICT: usize = 4;
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
    /// Whether no picture is wanted, so that the whole budget may go into learning.
    learn_only: bool,
    evidence: Evidence,
    state: State,
    /// What an earlier process has left, until it is gone on with.
    resumed: Option<Resumed>,
    /// Whether samples were left out because of the wish to stop.
    interrupted: bool,
}

impl<'a> Run<'a> {
    fn begin(scene: &'a Scene, settings: &'a RenderSettings, control: &'a Control<'a>) -> Result<Self> {
        check_size(scene.size[0], scene.size[1])?;
        settings.check()?;
        let window = settings.window(scene.size);
        window.check_inside(scene.size)?;
        let mut run = Self {
            scene,
            settings,
            window,
            filter: PixelFilter::new(settings.filter)?,
            watcher: Watcher::new(control),
            statistics: Statistics::default(),
            learn_only: false,
            evidence: Evidence::default(),
            state: State::default(),
            resumed: None,
            interrupted: false,
        };
        let total = match settings.stop {
            StopRule::Spp(spp) => u64::from(spp) * run.pixels(),
            StopRule::Time(_) | StopRule::TargetError(_) => 0,
        };
        if let StopRule::Time(seconds) = settings.stop {
            run.watcher.budget = Some(seconds);
        }
        control.progress.start(total, "samples");
        run.read_checkpoint()?;
        Ok(run)
    }

    /// Takes up what the checkpoint holds that is to be gone on from, if there is one.
    fn read_checkpoint(&mut self) -> Result<()> {
        let control = self.watcher.control;
        let from = control.checkpoint.and_then(|c| Some((c.resume.as_ref()?, &c.made_for)));
        let Some((path, made_for)) = from else { return Ok(()) };
        let size = [self.window.width, self.window.height];
        let mut resumed = Resumed::read(path, made_for, self.settings, size, &self.scene.lights.emission)?;
        self.state = std::mem::take(&mut resumed.state);
        self.statistics = std::mem::take(&mut resumed.statistics);
        (self.watcher.before, self.watcher.errors) = (resumed.elapsed, std::mem::take(&mut resumed.errors));
        control.progress.advance(self.statistics.samples);
        self.resumed = Some(resumed);
        Ok(())
    }

    /// The pass that an earlier process has left unfinished, where it was of this kind.
    fn resume(&mut self, phase: Phase) -> Option<Part> {
        self.resumed.take_if(|_| self.state.position.phase == phase).map(|resumed| resumed.part)
    }

    fn pixels(&self) -> u64 {
        self.window.pixels()
    }

    /// The next pass, of `spp` samples per pixel.
    fn begin_pass(&mut self, spp: u32) -> Part {
        self.state.sequences_from = Some(self.state.rendered);
        Part { pass: self.empty_pass(), spp, start: 0 }
    }

    fn empty_pass(&self) -> Pass {
        Pass::new(self.window.width as usize, self.window.height as usize)
    }

    /// Traces what is left of a pass; returns whether all camera paths were made.
    fn trace(
        &mut self,
        part: &mut Part,
        field: Option<&GuideField>,
        learning: Option<&mut Learning>,
        picture: Option<&[f32]>,
    ) -> bool {
        // Against a clock, chunks of about a twentieth of a second.
        let chunk = match (&learning, self.watcher.deadline) {
            (None, Some(_)) => (0.05 * self.statistics.samples as f64 / self.statistics.seconds.trace.max(1e-3)) as u64,
            _ => CHUNK,
        };
        let Part { pass, spp, start } = part;
        if *start == 0 {
            self.state.rendered += *spp;
            self.state.spent += f64::from(*spp) * (1.0 + learning.as_ref().map_or(0.0, |l| l.photon_share));
        }
        let tracer = PassTracer {
            scene: self.scene,
            settings: self.settings,
            window: self.window,
            filter: &self.filter,
            // One without voxels, of a guide that was given up or not begun, would only be looked up in vain.
            field: field.filter(|field| !field.voxels().is_empty()),
            picture,
            first_sample: self.state.rendered - *spp,
            sequences_from: self.state.sequences_from,
            spp: *spp,
            chunk: chunk.max(LEAST_CHUNK).max(self.pixels().div_ceil(EVERY_ROW)),
        };
        let pixels = self.pixels();
        let (watcher, state, evidence) = (&mut self.watcher, &self.state, &self.evidence);
        let field = field.map(|field| (field, evidence));
        watcher.begin_chunk();
        let so_far = |pass: &Pass| combine(&[state.passes.as_slice(), &[pass.finish()]].concat()).ok();
        let mut go_on = |chunk: &Chunk| {
            let Chunk { pass, samples, end: start, learning, statistics } = *chunk;
            let reached = statistics.samples.div_ceil(pixels) as u32;
            let keep = |checkpoint: &Checkpointing, elapsed: f64, errors: &[ErrorPoint]| {
                let Some((path, _)) = &checkpoint.write else { return Ok(()) };
                let moment = Moment { state, pass, spp: *spp, start, statistics, learning, field, elapsed, errors };
                moment.write(path, &checkpoint.made_for)
            };
            watcher.end_chunk(samples, reached, || so_far(pass), keep)
        };
        let complete = tracer.run(pass, *start, learning, &mut self.statistics, &mut go_on);
        *start = 0;
        self.interrupted |= !complete && self.watcher.stopped();
        complete
    }

    /// About what each pixel will be, by the passes so far; none while no light was found.
    fn pixel_values(&self) -> Option<Vec<f32>> {
        let State { passes, early, .. } = &self.state;
        expected_values(&combine(if passes.is_empty() { early } else { passes }).ok()?)
    }

    /// Iterations of 2^t samples per pixel while learning pays (Zhu 2021 §7; Müller 2017 §3.5).
    fn learn(&mut self, reconstructor: &dyn Reconstructor) -> Result<GuideField> {
        let emitted = &self.scene.lights.emission;
        let learned = self.resumed.as_mut().and_then(|resumed| resumed.learning.take());
        let mut learning = learned.unwrap_or_else(|| Learning::new(self.settings, emitted));
        let mut resumed = self.resume(Phase::Learning);
        let first = resumed.as_ref().map_or(0, |_| self.state.position.iteration);
        for t in first..31 {
            let mut part = match resumed.take() {
                Some(part) => part,
                None if self.goes_on_learning(t, learning.photon_share) => self.begin_iteration(t, &learning),
                None => break,
            };
            self.watcher.control.progress.message(&format!("learning, iteration {t}"));
            let Some(finished) = self.iterate(&mut part, &mut learning, reconstructor)? else {
                // Too many pixels for the time: what little there is left is better spent on samples than on trees.
                return Ok(GuideField::empty());
            };
            let (finished, complete) = finished;
            // The first two passes are not worth their noise, but they are all there is of a render stopped early.
            if t >= 2 || !complete {
                self.state.passes.push(finished);
            } else {
                self.state.early.push(finished);
            }
        }
        self.state.gave_up = !self.pays();
        let (trend, iterations) = (&self.state.trend, &self.statistics.iterations);
        self.statistics.decisions = decisions(self.state.gave_up, trend, iterations, learning.photon_share);
        // Of a guide that was given up there is nothing to look at.
        self.evidence = if self.state.gave_up { Evidence::default() } else { learning.learner.evidence() };
        Ok(match self.state.trend.verdict {
            _ if self.state.gave_up => GuideField::empty(),
            Verdict::Unknown if !self.is_always_guided() => learning.learner.field(Use::WhereTold),
            _ => learning.learner.field(Use::Rendering),
        })
    }

    /// Whether there is to be an iteration `t`.
    fn goes_on_learning(&self, t: u32, photon_share: f64) -> bool {
        let earlier = self.statistics.iterations.iter().rev().nth(1).and_then(|iteration| iteration.gain);
        let hopeless = t >= self.patience() && !self.pays()
            || !self.is_always_guided() && self.state.trend.verdict.is_hopeless(earlier);
        !hopeless && !self.watcher.stopped_between() && self.learns_on(1 << t, photon_share)
    }

    fn begin_iteration(&mut self, t: u32, learning: &Learning) -> Part {
        self.state.position = Position {
            phase: Phase::Learning,
            iteration: t,
            voxels: learning.learner.voxels(),
            began: self.watcher.elapsed(),
            traced: self.statistics.seconds.trace,
            ..Position::default()
        };
        self.begin_pass(1 << t)
    }

    /// Makes the pass of an iteration and learns from it. Returns the pass and whether all of its samples were made; none where
    /// there was not even time for the first iteration.
    fn iterate(
        &mut self,
        part: &mut Part,
        learning: &mut Learning,
        reconstructor: &dyn Reconstructor,
    ) -> Result<Option<(FinishedPass, bool)>> {
        let Position { iteration: t, voxels, began, traced, .. } = self.state.position;
        let photon_share = learning.photon_share;
        let field = learning.field_of(voxels);
        let picture = self.pixel_values();
        if let StopRule::Time(seconds) = self.settings.stop {
            self.watcher.deadline = Some(self.settings.learning_share * seconds);
        }
        let complete = self.trace(part, Some(&field), Some(learning), picture.as_deref());
        let finished = self.finished(&part.pass);
        if t == 0 && !complete {
            self.state.passes.push(finished);
            return Ok(None);
        }
        let worst = outliers(self.pixels() as usize);
        let rays = self.reconstruction_rays();
        let iteration = learning.end_iteration(part.spp, worst, rays, reconstructor, &mut self.statistics.seconds)?;
        let seconds = self.watcher.elapsed() - began;
        let variance = part.pass.variance_relative_to(picture.as_deref());
        let trend = &mut self.state.trend;
        trend.verdict = variance.map_or(Verdict::Unknown, |v| judged(v, &learning.moments, finished.samples() as f64));
        trend.variances.extend(finished.sample_variance());
        trend.useful = ((self.statistics.seconds.trace - traced) / seconds.max(1e-9)).clamp(0.0, 1.0);
        trend.seconds = seconds;
        if let StopRule::TargetError(_) = self.settings.stop {
            trend.relative = part.pass.relative_variance();
        }
        self.statistics.iterations.push(Iteration {
            t,
            spp: part.spp,
            seconds,
            mean_variance: finished.sample_variance().map_or(f64::NAN, |v| v / f64::from(part.spp)),
            gain: trend.verdict.gain(),
            photon_share,
            ..iteration
        });
        Ok(Some((finished, complete)))
    }

    /// Iterations before guiding is given up. Learning costs several times what rendering does, so an easy scene should be known
    /// for one at once; but light that comes through glass or from mirrors is found late, and then it is most of the noise.
    fn patience(&self) -> u32 {
        let specular = self.scene.materials().iter().any(Material::is_delta);
        if specular { 4 } else { 2 }
    }

    /// Whether what guiding costs does not matter.
    fn is_always_guided(&self) -> bool {
        self.learn_only || !self.settings.gives_up
    }

    /// Whether the guide at hand is worth its price, or its price does not matter.
    fn pays(&self) -> bool {
        self.is_always_guided() || self.state.trend.verdict.pays()
    }

    /// Rays that reconstruction may have cost after this iteration: a share of those of the whole render as far as that can be
    /// foreseen, which is up to the end of the next iteration.
    fn reconstruction_rays(&self) -> f64 {
        let done = match self.settings.stop {
            StopRule::Spp(spp) => self.state.spent / f64::from(spp),
            StopRule::Time(seconds) => self.watcher.elapsed() / seconds,
            StopRule::TargetError(_) => 0.0,
        };
        let rays = self.statistics.rays as f64;
        self.settings.reconstruction_share * (rays / done.clamp(1.0 / 3.0, 1.0))
    }

    /// Whether another iteration of `camera` paths per pixel is worth its price.
    fn learns_on(&self, camera: u32, photon_share: f64) -> bool {
        let trend = &self.state.trend;
        let kinds = 1.0 + photon_share;
        let (cost, spent) = (f64::from(camera) * kinds, self.state.spent);
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
            // Variances of the first iterations are no trend; what is always guided is learned whatever is known.
            let iterations = trend.variances.len();
            let verdict = match trend.verdict {
                Verdict::Gain(_) if iterations < self.patience() as usize => Verdict::Unseen,
                Verdict::Unknown if iterations < LATEST_VERDICT || self.is_always_guided() => Verdict::Unseen,
                verdict => verdict,
            };
            learns_on(&outlook, &trend.variances, verdict)
        }
    }

    /// The picture with the field as it is, and the end.
    fn finish(mut self, field: Option<GuideField>) -> Result<Outcome> {
        let known = field.as_ref();
        self.statistics.guide = known.map_or(GuideStatistics::default(), GuideStatistics::of);
        self.watcher.control.progress.message("rendering");
        let (image, spread) = match self.settings.stop {
            StopRule::TargetError(error) => self.render_to(error, field.as_ref())?,
            StopRule::Spp(_) | StopRule::Time(_) => self.final_pass(field.as_ref())?,
        };
        self.watcher.control.progress.finish();
        let pixels = self.pixels() as f64;
        let mut statistics = self.statistics;
        statistics.seconds.total = self.watcher.elapsed();
        statistics.errors = self.watcher.errors;
        // A pass is spent when it begins.
        let traced = if self.interrupted { statistics.samples as f64 / pixels } else { f64::INFINITY };
        statistics.describe(self.scene, self.settings, self.state.spent.min(traced).ceil() as u32);
        Ok(Outcome {
            image,
            spread,
            statistics,
            field: field.unwrap_or_else(GuideField::empty),
            evidence: self.evidence,
            unkept: self.watcher.unkept,
            interrupted: self.interrupted,
        })
    }

    /// A first pass with a field that nothing was learned for: about what pixels will be, by which roulette judges the rest.
    fn look(&mut self, field: &GuideField, resumed: Option<Part>) {
        let spp = match self.settings.stop {
            StopRule::Spp(spp) => (spp / 16).min(LOOK),
            StopRule::Time(seconds) => {
                self.watcher.deadline = Some(seconds / 16.0);
                LOOK
            }
            StopRule::TargetError(_) => LOOK,
        };
        if spp > 0 {
            self.state.position = Position { phase: Phase::Look, ..Position::default() };
            let mut part = resumed.unwrap_or_else(|| self.begin_pass(spp));
            self.trace(&mut part, Some(field), None, None);
            let finished = self.finished(&part.pass);
            self.state.passes.push(finished);
        }
    }

    /// What is left of the budget goes into one pass.
    fn final_pass(&mut self, field: Option<&GuideField>) -> Result<Rendered> {
        let mut resumed = self.resume(Phase::Final);
        let batches = if resumed.is_some() { self.state.position.batches } else { 0 };
        self.state.position = Position { phase: Phase::Final, batches, ..Position::default() };
        let mut goes_on = resumed.is_some();
        let mut part = resumed.take().unwrap_or_else(|| self.begin_pass(0));
        let picture = field.and_then(|_| self.pixel_values());
        loop {
            if !goes_on {
                part.spp = match self.settings.stop {
                    StopRule::Spp(spp) => (f64::from(spp) - self.state.spent).max(0.0) as u32,
                    _ => self.batch(self.state.position.batches),
                };
                if part.spp == 0 {
                    break;
                }
                if self.watcher.stopped_between() {
                    self.interrupted = true;
                    break;
                }
                self.state.position.batches += part.spp;
            }
            goes_on = false;
            self.watcher.deadline = match self.settings.stop {
                StopRule::Time(seconds) => Some(seconds),
                _ => None,
            };
            if !self.trace(&mut part, field, None, picture.as_deref()) {
                break;
            }
        }
        if self.state.position.batches > 0 {
            let finished = self.finished(&part.pass);
            // Those of a guide that was given up stay: it was by what they contain, and what is kept must not depend on that.
            self.state.passes.push(finished);
        }
        if self.state.passes.is_empty() {
            // Stopped early: they are all there is.
            self.state.passes = std::mem::take(&mut self.state.early);
        }
        let image = combine(&self.state.passes).map_err(|_| {
            Error::Interrupted("no sample was rendered: the render was stopped before its first pass".into())
        })?;
        Ok((image, self.spread(&self.state.passes, None)?))
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
        if rendered == 0 && (self.state.passes.is_empty() || left > 0.0) {
            return 1;
        }
        let per_sample = traced / f64::from(self.state.rendered);
        let batch = if left <= 0.0 { 0 } else { ((left / per_sample.max(1e-9) * 0.1) as u32).clamp(1, 1 << 16) };
        // What no checkpoint could hold is not rendered: a few pixels and an hour get there.
        batch.min(MOST_SAMPLES.saturating_sub(self.state.rendered))
    }
}
