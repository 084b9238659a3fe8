//! Learning while rendering: iterations, and when they end.

use super::Learned;
use super::budget::{LATEST_VERDICT, Outlook, Tried, Verdict, judged, learns_on};
use super::learning::{Learning, MUCH};
use super::run::Run;
use super::settings::StopRule;
use super::state::{Part, Phase, Position, Trend};
use super::statistics::{GuideStatistics, Iteration};
use crate::base::Result;
use crate::film::{FinishedPass, outliers};
use crate::guiding::learn::learner::Use;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::materials::Material;
use crate::reconstruct::Reconstructor;

/// Growth of the time in which guides are made from one iteration to the next: trees grow less than the samples in them.
const MAKING_GROWTH: f64 = 1.5;

impl Run<'_> {
    /// Iterations, each with more paths than the one before, while learning pays (Zhu 2021 §7; Müller 2017 §3.5).
    pub(super) fn learn(&mut self, reconstructor: &dyn Reconstructor) -> Result<GuideField> {
        let mut learning = self.begin_learning();
        if !self.iterations_of(&mut learning, reconstructor)? {
            return Ok(GuideField::empty());
        }
        let gave_up = !self.is_always_guided() && !self.state.trend.pays();
        let (trend, iterations) = (&self.state.trend, &self.statistics.iterations);
        self.statistics.decisions = decisions(gave_up, trend, iterations, learning.photon_share);
        // Of a guide that was given up there is nothing to look at.
        self.evidence = if gave_up { Evidence::default() } else { learning.learner.evidence() };
        Ok(match self.state.trend.verdict {
            _ if gave_up => GuideField::empty(),
            Verdict::Few if !self.is_always_guided() => learning.learner.field(Use::WhereTold),
            _ => learning.learner.field(Use::Rendering),
        })
    }

    /// What an earlier process has learned, or nothing yet.
    pub(super) fn begin_learning(&mut self) -> Learning {
        let learned = self.resumed.as_mut().and_then(|resumed| resumed.learning.take());
        learned.unwrap_or_else(|| Learning::new(self.settings, &self.scene.lights.emission))
    }

    /// Iterations while learning pays; returns whether there was time for the first.
    pub(super) fn iterations_of(&mut self, learning: &mut Learning, reconstructor: &dyn Reconstructor) -> Result<bool> {
        let mut resumed = self.resume(Phase::Learning);
        let first = resumed.as_ref().map_or(0, |_| self.state.position.iteration);
        for t in first..31 {
            let mut part = match resumed.take() {
                Some(part) => part,
                None if self.goes_on_learning(t, learning.photon_share) => self.begin_iteration(t, learning),
                None => break,
            };
            self.watcher.control.progress.message(&format!("learning, iteration {t}"));
            let Some(finished) = self.iterate(&mut part, learning, reconstructor)? else {
                // Too many pixels for the time: what little there is left is better spent on samples than on trees.
                return Ok(false);
            };
            // Passes of a guide that knows little are not worth their noise; they make the picture only where there is nothing else.
            if self.learned_before(t) > 1.0 {
                self.state.passes.push(finished);
            } else {
                self.state.early.push(finished);
            }
        }
        Ok(true)
    }

    /// Ends a render that only learned this field.
    pub(super) fn learned(self, field: GuideField) -> Learned {
        let (pixel_values, stopped) = (self.pixel_values(), self.watcher.stopped());
        let mut statistics = self.statistics;
        statistics.guide = GuideStatistics::of(&field);
        statistics.seconds.total = self.watcher.elapsed();
        statistics.describe(self.scene, self.settings, self.state.spent.ceil() as u32);
        // Between two passes nothing was left out, but more would have been learned.
        let interrupted = self.interrupted || stopped;
        Learned { field, evidence: self.evidence, pixel_values, statistics, unkept: self.watcher.unkept, interrupted }
    }

    /// Whether iteration `t` is to be rendered and learned from.
    fn goes_on_learning(&self, t: u32, photon_share: f64) -> bool {
        !self.is_hopeless(t) && !self.watcher.stopped_between() && self.learns_on(t, photon_share)
    }

    /// Camera paths per pixel that the guide of iteration `t` was learned from.
    pub(super) fn learned_before(&self, t: u32) -> f64 {
        (0..t).map(|t| self.paths_of(t)).sum()
    }

    /// Camera paths of iteration `t`, per pixel of the picture.
    fn paths_of(&self, t: u32) -> f64 {
        let (places, spp) = self.iteration_size(t);
        f64::from(spp) * (places as f64 / self.pixels() as f64)
    }

    /// Whether the iterations before `next` have shown that guiding will not pay.
    pub(super) fn is_hopeless(&self, next: u32) -> bool {
        let Trend { verdict, doubted, guided_cost, making, .. } = self.state.trend;
        // Guides have to win back the time in which they are made.
        let making = match self.settings.stop {
            StopRule::Time(budget) => {
                let left = (budget - self.watcher.elapsed()).max(0.0);
                if left > MAKING_GROWTH * making { left / (left - MAKING_GROWTH * making) } else { f64::INFINITY }
            }
            _ => 1.0,
        };
        let cost = guided_cost * making;
        // The next verdict rests on more paths, but one wait is enough.
        let waits = doubted.is_none() && next < LATEST_VERDICT && verdict.is_doubtful(cost);
        next >= self.patience() && !self.is_always_guided() && !waits && !verdict.may_pay(cost, doubted)
    }

    fn begin_iteration(&mut self, t: u32, learning: &Learning) -> Part {
        let (patience, trend) = (self.patience(), &mut self.state.trend);
        if t >= patience && !trend.pays() {
            trend.doubted = trend.doubted.or(trend.verdict.gain());
        }
        self.state.position = Position {
            phase: Phase::Learning,
            iteration: t,
            voxels: learning.learner.voxels(),
            began: self.watcher.elapsed(),
            traced: self.statistics.seconds.trace,
            ..Position::default()
        };
        self.begin_pass(self.iteration_size(t).1)
    }

    /// Makes the pass of an iteration and learns from it. Returns the pass; none where there was not even time for the first
    /// iteration.
    fn iterate(
        &mut self,
        part: &mut Part,
        learning: &mut Learning,
        reconstructor: &dyn Reconstructor,
    ) -> Result<Option<FinishedPass>> {
        let Position { iteration: t, voxels, began, traced, .. } = self.state.position;
        let photon_share = learning.photon_share;
        let field = learning.field_of(voxels);
        let picture = self.pixel_values();
        if let StopRule::Time(seconds) = self.settings.stop {
            self.watcher.deadline =
                Some(if self.learn_only { seconds } else { self.settings.learning_share * seconds });
        }
        let on_trial = self.is_tried(t, learning);
        let (given_up, complete) = if on_trial {
            (self.try_pass(part, &field, learning, picture.as_deref()), true)
        } else {
            (false, self.trace(part, Some(&field), Some(learning), picture.as_deref()))
        };
        let finished = self.finished(&part.pass);
        if t == 0 && !complete {
            self.state.passes.push(finished);
            return Ok(None);
        }
        if !given_up {
            let variance = part.pass.variance_relative_to(picture.as_deref());
            self.judge(variance, learning, finished.samples());
        }
        // Of a guide that does not pay no better one is made: that takes longer than all else that was learned.
        let hopeless = self.is_hopeless(t + 1);
        let iteration = if hopeless {
            Iteration {
                voxels: learning.learner.voxels(),
                nodes: learning.learner.model().nodes(),
                ..Iteration::default()
            }
        } else {
            let rays = self.reconstruction_rays();
            let made = learning.end_iteration(part.spp, rays, reconstructor, &mut self.statistics.seconds)?;
            // Judged were the last guides, but these are rendered with. They are better than those that clearly paid.
            if !self.state.trend.clearly_pays() {
                self.state.trend.tried = Tried::default();
                self.try_guides(learning, learning.learner.voxels());
            }
            made
        };
        let seconds = self.watcher.elapsed() - began;
        let trend = &mut self.state.trend;
        trend.variances.extend(finished.sample_variance());
        trend.camera_part = ((self.statistics.seconds.trace - traced) / seconds.max(1e-9)).clamp(0.0, 1.0);
        trend.seconds = seconds;
        // What is hopeless stays so when it is asked again.
        trend.making = if hopeless { trend.making } else { iteration.reconstruct_seconds };
        if let StopRule::TargetError(_) = self.settings.stop {
            trend.relative = part.pass.relative_variance(self.scene.views());
        }
        self.statistics.iterations.push(Iteration {
            t,
            spp: part.spp,
            seconds,
            mean_variance: finished.sample_variance().map_or(f64::NAN, |v| v / f64::from(part.spp)),
            gain: trend.verdict.gain(),
            cost: trend.guided_cost,
            // Light paths of a pass on trial are made when its guides may pay.
            photon_share: if given_up { 0.0 } else { photon_share },
            ..iteration
        });
        Ok(Some(finished))
    }

    /// Judges the guides that a pass was made with by its `samples` camera paths and by its photons, and by the trial in which they were
    /// compared.
    fn judge(&mut self, variance: Option<f64>, learning: &mut Learning, samples: u64) {
        let caustics = learning.caustics();
        match caustics {
            Some(part) => self.state.trend.caustics = part > MUCH,
            None if !self.settings.samples.photons() => self.state.trend.caustics = self.has_delta_lobes(),
            // Photons are not traced any more; what they have told holds.
            None => {}
        }
        let moments = learning.learner.picture_moments(self.outliers_of(samples));
        learning.unseen = caustics.map(|_| moments.unseen);
        self.decide(judged(variance, &moments, samples as f64), learning);
    }

    /// How many of so many samples the variances of pictures leave out.
    pub(super) fn outliers_of(&self, samples: u64) -> usize {
        outliers(samples.min(self.pixels()) as usize)
    }

    /// Iterations before guiding is given up. Learning costs several times what rendering does, so an easy scene should be known
    /// as one at once; but light that comes through glass or from mirrors is found late, and then it is most of the noise.
    pub(super) fn patience(&self) -> u32 {
        if self.state.trend.caustics { 4 } else { 2 }
    }

    /// Whether there can be caustics, for guides that no photon tells of them.
    fn has_delta_lobes(&self) -> bool {
        self.scene.materials().iter().any(Material::is_delta)
    }

    /// Whether guiding is never given up, whatever it costs.
    pub(super) fn is_always_guided(&self) -> bool {
        self.learn_only || !self.settings.gives_up
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

    /// Whether iteration `t` is worth its cost.
    fn learns_on(&self, t: u32, photon_share: f64) -> bool {
        let trend = &self.state.trend;
        let kinds = 1.0 + photon_share;
        let (cost, spent) = (self.paths_of(t) * kinds, self.state.spent);
        let limit = self.settings.learning_share;
        let outlook = match self.settings.stop {
            StopRule::Spp(spp) => {
                let budget = f64::from(spp);
                Outlook { budget, left: budget - spent, cost, camera_part: 1.0 / kinds, limit }
            }
            StopRule::Time(budget) => {
                let left = budget - self.watcher.elapsed();
                let growth = self.paths_of(t) / self.paths_of(t.saturating_sub(1));
                let cost = growth * (trend.seconds - trend.making) + MAKING_GROWTH * trend.making;
                Outlook { budget, left, cost, camera_part: trend.camera_part, limit }
            }
            // Iterations do not enter a picture that ends by its own samples; the first of them find out how many samples that
            // will take.
            StopRule::TargetError(error) => {
                let left = if trend.relative > 0.0 { trend.relative / error } else { 100.0 * cost };
                Outlook { budget: spent + left, left, cost, camera_part: 0.0, limit }
            }
        };
        if self.learn_only {
            // Parts learn in common with half of the budget, and share what the other half learns.
            let kept = if self.settings.part.is_some() { 0.5 * outlook.budget } else { 0.0 };
            outlook.cost <= outlook.left - kept
        } else if matches!(self.settings.stop, StopRule::Spp(_)) && outlook.left - outlook.cost < 1.0 {
            // A picture of no whole sample per pixel would have gaps.
            false
        } else {
            let verdict = trend.verdict.believed(t, self.patience(), trend.tried, self.is_always_guided());
            learns_on(&outlook, &trend.variances, verdict)
        }
    }
}

/// Decisions on guiding and photons that learning has taken, a sentence each.
fn decisions(gave_up: bool, trend: &Trend, iterations: &[Iteration], photon_share: f64) -> Vec<String> {
    let count = iterations.len();
    let on = if gave_up { "off: it does not pay" } else { "on" };
    let measured = match trend.verdict {
        Verdict::Gain(gain) if trend.tried == Tried::Gain(gain) => {
            let price = trend.verdict.price(trend.guided_cost).unwrap_or(gain);
            format!("{on}: by samples with and without it, it costs {price:.2} times what it brings")
        }
        Verdict::Gain(gain) => format!("{on}: the variance of a sample with it is {gain:.2} times that without"),
        Verdict::Unknown if gave_up => "off: no sample has shown that it helps".to_owned(),
        Verdict::Unseen => format!("{on}: photons know of light that paths have not found yet"),
        Verdict::Few | Verdict::Unknown => {
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
