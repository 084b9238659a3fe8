//! The final pass, which spends the rest of the budget, and the end of a render.

use super::Outcome;
use super::checkpoint::MOST_SAMPLES;
use super::run::{Rendered, Run};
use super::settings::{RenderSettings, StopRule};
use super::state::{Blocks, Division, Part, Phase, Position};
use super::statistics::GuideStatistics;
use crate::base::{Error, Result};
use crate::film::{Pass, combine_sheet, densities, expected_values, without};
use crate::guiding::sample::field::GuideField;
use crate::picture::Image;

/// Samples per pixel of the first pass with a given field: enough to estimate pixel values.
const LOOK: u32 = 4;
/// Part of the final pass that is sampled evenly, to find out where noise is. What it costs is made up for by the rest: more than a
/// quarter of the samples would go to most pixels anyway.
const EVEN: f64 = 0.2;
/// Fewest samples per pixel that tell where noise is.
const TELLING: u32 = 4;

/// Samples per pixel of that pass, of so many.
fn look_of(spp: u32) -> u32 {
    (spp / 16).min(LOOK)
}

/// Samples per pixel of all parts of a picture together, guided by `field`, if there is one: those of `spp` that are no first look.
pub fn samples_of_parts(settings: &RenderSettings, spp: u32, size: [u32; 2], field: Option<&GuideField>) -> u32 {
    let window = settings.window(size);
    let looks = field.is_some_and(|field| field.pixel_values().and_then(|known| known.within(window)).is_none());
    spp - if looks { look_of(spp) } else { 0 }
}

/// Samples per pixel that one process makes of a picture guided by `field`, if there is one: with a first look its part of them, or all; 0
/// where they are not counted.
pub(super) fn own_samples(settings: &RenderSettings, size: [u32; 2], field: Option<&GuideField>) -> Result<u32> {
    let StopRule::Spp(spp) = settings.stop else { return Ok(0) };
    let Some(part) = settings.part else { return Ok(spp) };
    let of_all = samples_of_parts(settings, spp, size, field);
    Ok(spp - of_all + part.samples(of_all)?.len() as u32)
}

impl Run<'_> {
    /// Renders the picture with the field as it is, and ends the render.
    pub(super) fn finish(mut self, field: Option<GuideField>) -> Result<Outcome> {
        let known = field.as_ref();
        self.statistics.guide = known.map_or(GuideStatistics::default(), GuideStatistics::of);
        if self.settings.complete_paths > 0.0
            && let Some(rendered) = self.by_paths(known)?
        {
            return Ok(self.end(rendered, field));
        }
        self.watcher.control.progress.message("rendering");
        let rendered = match self.settings.stop {
            StopRule::TargetError(error) => self.render_to(error, field.as_ref())?,
            StopRule::Spp(spp) if self.goes_by_blocks() => self.block_pass(spp, field.as_ref())?,
            StopRule::Spp(_) | StopRule::Time(_) => self.final_pass(field.as_ref())?,
        };
        Ok(self.end(rendered, field))
    }

    /// Ends a render with its picture and the field that has guided it.
    pub(super) fn end(self, Rendered { plain, spread, fireflies }: Rendered, field: Option<GuideField>) -> Outcome {
        let keeps = self.settings.learner.keeps_evidence && self.statistics.guide.trees > 0;
        let pixel_values = if keeps { self.values_of(&plain, expected_values) } else { None };
        let image = fireflies.as_ref().map(|taken| without(&plain, taken)).unwrap_or(plain);
        self.watcher.control.progress.finish();
        let pixels = self.pixels() as f64;
        let mut statistics = self.statistics;
        statistics.seconds.total = self.watcher.elapsed();
        statistics.errors = self.watcher.errors;
        // A pass is spent when it begins.
        let traced = if self.interrupted { statistics.samples as f64 / pixels } else { f64::INFINITY };
        statistics.decisions.extend(self.lights.sky.as_ref().map(|sky| {
            let gain = sky.gain();
            format!("sky sampled as it is seen from surfaces: {gain:.2} times the second moment of its light")
        }));
        statistics.decisions.extend(self.lights.places.as_ref().map(|places| {
            let (gain, cells) = (places.gain(), places.cells());
            format!(
                "lights sampled as they pay in {cells} parts of space: {gain:.2} times the second moment of their light"
            )
        }));
        statistics.decisions.extend(fireflies.as_ref().map(|taken| {
            let sum = |image: &Image| image.pixels.iter().map(|pixel| f64::from(pixel.element_sum())).sum::<f64>();
            let (taken, kept) = (sum(taken), sum(&image));
            let part = if taken > 0.0 { 100.0 * taken / (taken + kept) } else { 0.0 };
            format!("fireflies: {part:.3} % of the picture's light taken out")
        }));
        statistics.describe(self.scene, self.settings, self.state.spent.min(traced).ceil() as u32);
        Outcome {
            image,
            fireflies,
            spread,
            statistics,
            field: field.unwrap_or_else(GuideField::empty),
            evidence: self.evidence,
            pixel_values,
            blocks: match self.state.blocks {
                Some(Blocks::Kept(blocks)) => blocks,
                _ => Vec::new(),
            },
            cascade: self.state.cascade.filter(|_| self.settings.part.is_some()),
            unkept: self.watcher.unkept,
            interrupted: self.interrupted,
        }
    }

    /// Renders a first pass with a given field, which estimates the pixel values that roulette judges the rest by, where the field does
    /// not know them. It is no part of the picture, so that processes that render parts of one can all make the same.
    pub(super) fn look(&mut self, field: &GuideField, resumed: Option<Part>) {
        if self.known.is_some() {
            return;
        }
        let spp = match self.settings.stop {
            StopRule::Spp(spp) => look_of(spp),
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
            self.state.early.push(finished);
        }
    }

    /// Spends the rest of the budget on one pass.
    fn final_pass(&mut self, field: Option<&GuideField>) -> Result<Rendered> {
        let mut resumed = self.resume(Phase::Final);
        if resumed.is_none() {
            let began = self.watcher.elapsed();
            self.state.position = Position { phase: Phase::Final, began, ..Position::default() };
        }
        let mut goes_on = resumed.is_some();
        let mut part = resumed.take().unwrap_or_else(|| self.begin_pass(0));
        let guide = field.filter(|field| !field.voxels().is_empty());
        let picture = guide.and_then(|_| self.pixel_values());
        loop {
            if !goes_on {
                if self.settings.adaptive && self.state.division.is_none() {
                    self.state.division = self.divide(&part.pass, guide.is_some());
                }
                part.spp = match self.settings.stop {
                    StopRule::Spp(spp) => self.rest(spp),
                    _ => self.batch(self.state.position.batches),
                };
                if !self.begins(part.spp) {
                    break;
                }
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
            // Passes of a guide that was given up stay: their samples decided that, and what is kept must not depend on samples.
            self.state.passes.push(finished);
        }
        self.of_passes()
    }

    /// Begins a batch of `spp` samples per pixel of the final pass; says no where these are none, or a signal ends the render.
    pub(super) fn begins(&mut self, spp: u32) -> bool {
        if spp == 0 {
            return false;
        }
        if self.watcher.stopped_between() {
            self.interrupted = true;
            return false;
        }
        self.state.position.batches += spp;
        true
    }

    /// The picture of the passes so far.
    pub(super) fn of_passes(&mut self) -> Result<Rendered> {
        if self.state.passes.is_empty() {
            // Stopped early: they are all there is.
            self.state.passes = std::mem::take(&mut self.state.early);
        }
        let image = combine_sheet(&self.state.passes, self.scene.views()).map_err(|_| {
            Error::Interrupted("no sample was rendered: the render was stopped before its first pass".into())
        })?;
        self.rendered(image, &self.state.passes, None)
    }

    /// How the rest of the final pass, which has taken `pass` so far, `guided` or not, is divided among the pixels; none while it is to be
    /// even.
    fn divide(&self, pass: &Pass, guided: bool) -> Option<Division> {
        let even = self.state.position.batches;
        let taken = match self.settings.stop {
            StopRule::Spp(spp) => f64::from(even) / (f64::from(even) + f64::from(self.left(spp))).max(1.0),
            StopRule::Time(seconds) => {
                let began = self.state.position.began;
                (self.watcher.elapsed() - began) / (seconds - began).max(1e-9)
            }
            StopRule::TargetError(_) => 0.0,
        };
        if even < TELLING || !(EVEN..1.0).contains(&taken) {
            return None;
        }
        let values = || if guided { None } else { self.roulette_values(pass) }.unwrap_or_default();
        densities(pass, self.scene.views(), taken).map(|densities| Division { densities, values: values(), even })
    }

    /// Samples per pixel of the next batch under a budget of `spp`: all that are left, or what has to be sampled evenly.
    fn rest(&self, spp: u32) -> u32 {
        let left = self.left(spp);
        let even = ((f64::from(left) * EVEN).ceil() as u32).max(TELLING);
        let begins = self.settings.adaptive && self.state.position.batches == 0;
        if begins && even <= left / 2 { even } else { left }
    }

    /// Samples per pixel of the next batch under a time budget: about a tenth of those for the rest of it, at the speed so far.
    fn batch(&self, rendered: u32) -> u32 {
        let StopRule::Time(seconds) = self.settings.stop else { return 0 };
        let left = seconds - self.watcher.elapsed();
        if rendered == 0 && (self.state.passes.is_empty() || left > 0.0) {
            return 1;
        }
        let per_second = self.statistics.rate() / self.pixels() as f64;
        let batch = if left <= 0.0 { 0 } else { ((left * per_second * 0.1) as u32).clamp(1, 1 << 16) };
        // No more samples than a checkpoint can hold: pictures of a few pixels get there within an hour.
        let division = self.state.division.as_ref();
        let most = division.map_or(MOST_SAMPLES, |division| division.mean_within(MOST_SAMPLES));
        batch.min(most.saturating_sub(self.state.rendered))
    }
}
