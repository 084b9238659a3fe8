//! Rendering until the picture's estimated error reaches a target.
//!
//! A rule that looks at the samples which make the picture biases it: skewed noise is darkest where it looks smallest, so dark
//! pictures would stop first. Two halves are rendered instead, and each decides when the *other* has enough: given its own
//! number of samples, no half knows anything about its values. The picture is the plain mean of the two; weights that follow the
//! counts would tie them again. A half that is done goes on being sampled for the estimate until the other is done too.

use super::{Rendered, Run};
use crate::base::Result;
use crate::film::{FinishedPass, Pass, combine_weighted};
use crate::guiding::field::GuideField;

/// Samples per pixel of each half before the first look.
const FIRST: u32 = 16;
/// Growth of the number of samples from look to look. The looks must not follow the samples either.
const GROWTH: f64 = 1.1;
/// Samples per pixel of a half at which even an unreachable target ends.
const MOST: u32 = 1 << 23;

/// Weights of the two halves.
const EQUAL: [f64; 2] = [0.5; 2];

struct Half {
    pass: Pass,
    /// The pass when the other half found it good enough.
    done: Option<FinishedPass>,
}

impl Run<'_> {
    pub(super) fn render_to(&mut self, target: f64, field: Option<&GuideField>) -> Result<Rendered> {
        let picture = field.and_then(|_| self.pixel_values());
        // What was learned from decides about the field and so about the number of samples.
        self.passes.clear();
        let mut halves = [0, 1].map(|_| Half { pass: self.empty_pass(), done: None });
        // Estimates of the error by the spread of samples hold for independent ones.
        self.sequences_from = None;
        let mut each = 0;
        let mut estimate = f64::NAN;
        let begun = self.watcher.elapsed();
        while halves.iter().any(|h| h.done.is_none()) && each < MOST && !(each > 0 && self.watcher.stopped()) {
            let next = if each == 0 { FIRST } else { ((f64::from(each) * GROWTH).ceil() as u32).min(MOST) };
            for half in &mut halves {
                self.trace(&mut half.pass, next - each, field, None, picture.as_deref());
            }
            each = next;
            let variances = [0, 1].map(|h| halves[h].pass.relative_variance());
            // The error of the mean of two halves of as many samples.
            let errors = variances.map(|v| v / (2.0 * f64::from(each)));
            for (half, error) in [(0, errors[1]), (1, errors[0])] {
                let half = &mut halves[half];
                if half.done.is_none() && error <= target {
                    half.done = Some(self.finished(&half.pass));
                }
            }
            estimate = 0.5 * (errors[0] + errors[1]);
            let seconds = self.watcher.elapsed() - begun;
            let left = seconds * (estimate / target - 1.0).max(0.0);
            let message = format!("relMSE about {estimate:.3e}, target {target:.3e}, about {left:.0} s left");
            self.watcher.control.progress.message(&message);
        }
        self.statistics.estimated_relmse = Some(estimate);
        let passes = halves.map(|half| half.done.unwrap_or_else(|| self.finished(&half.pass)));
        Ok((combine_weighted(&passes, &EQUAL)?, self.spread(&passes, Some(&EQUAL))?))
    }
}
