//! Rendering until the picture's estimated error reaches a target.
//!
//! A rule that looks at the samples which make the picture biases it: skewed noise is darkest where it looks smallest, so dark
//! pictures would stop first. Two halves are rendered instead, and each decides when the *other* has enough: given its own
//! number of samples, no half knows anything about its values. The picture is the plain mean of the two; weights that follow the
//! counts would tie them again. A half that is done goes on being sampled for the estimate until the other is done too.
//! Of several views on a sheet the noisiest has to reach the target.

use super::run::{Rendered, Run};
use super::state::{Half, Part, Phase, Position};
use crate::base::Result;
use crate::film::{FinishedPass, Pass, combine_weighted};
use crate::guiding::sample::field::GuideField;

/// Samples per pixel of each half before the first look.
const FIRST: u32 = 16;
/// Growth of the number of samples from look to look. The looks must not follow the samples either.
const GROWTH: f64 = 1.1;
/// Samples per pixel of a half at which even an unreachable target ends.
const MOST: u32 = 1 << 23;
/// Samples per pixel at which a picture without any noise is believed; before, it may be black because no light was found yet.
const UNSEEN: u32 = 256;

/// Weights of the two halves.
const EQUAL: [f64; 2] = [0.5; 2];

impl Run<'_> {
    pub(super) fn render_to(&mut self, target: f64, field: Option<&GuideField>) -> Result<Rendered> {
        let mut resumed = self.resume(Phase::Target);
        if resumed.is_none() {
            // Iterations decide about the field and so about the number of samples: they stay out of the picture.
            if !self.state.passes.is_empty() {
                self.state.early = std::mem::take(&mut self.state.passes);
            }
            self.state.halves = [0, 1].map(|_| Half { pass: self.empty_pass(), done: None }).into();
            self.state.position =
                Position { phase: Phase::Target, began: self.watcher.elapsed(), ..Position::default() };
            // Estimates of the error by the spread of samples hold for independent ones.
            self.state.sequences_from = None;
        }
        let picture = field.and_then(|_| self.pixel_values());
        let (mut each, begun) = (self.state.position.each, self.state.position.began);
        let mut estimate = f64::NAN;
        while self.state.halves.iter().any(|h| h.done.is_none()) && each < MOST {
            if each > 0 && self.watcher.stopped_between() {
                self.interrupted = true;
                break;
            }
            let next = if each == 0 { FIRST } else { ((f64::from(each) * GROWTH).ceil() as u32).min(MOST) };
            let first = resumed.as_ref().map_or(0, |_| self.state.position.half);
            for half in first..2 {
                self.state.position.half = half;
                let mut part = resumed.take().unwrap_or_else(|| {
                    let pass = std::mem::replace(&mut self.state.halves[half].pass, Pass::new(0, 0));
                    Part { pass, spp: next - each, start: 0 }
                });
                self.trace(&mut part, field, None, picture.as_deref());
                self.state.halves[half].pass = part.pass;
            }
            each = next;
            self.state.position.each = each;
            let variances = [0, 1].map(|h| self.state.halves[h].pass.relative_variance(self.scene.views()));
            // The error of the mean of two halves of as many samples.
            let errors = variances.map(|v| v / (2.0 * f64::from(each)));
            for (half, error) in [(0, errors[1]), (1, errors[0])] {
                let Half { pass, done } = &self.state.halves[half];
                let seen = error > 0.0 || each >= UNSEEN;
                if done.is_none() && error <= target && seen {
                    self.state.halves[half].done = Some(self.finished(pass));
                }
            }
            estimate = 0.5 * (errors[0] + errors[1]);
            let seconds = self.watcher.elapsed() - begun;
            let left = seconds * (estimate / target - 1.0).max(0.0);
            let message = format!("relMSE about {estimate:.3e}, target {target:.3e}, about {left:.0} s left");
            self.watcher.control.progress.message(&message);
        }
        self.statistics.estimated_relmse = Some(estimate);
        let halves = std::mem::take(&mut self.state.halves).into_iter();
        let passes: Vec<FinishedPass> =
            halves.map(|half| half.done.unwrap_or_else(|| self.finished(&half.pass))).collect();
        self.rendered(combine_weighted(&passes, &EQUAL, self.scene.views())?, &passes, Some(&EQUAL))
    }
}
