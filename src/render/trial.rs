//! Trials of guides. Passes on trial are small iterations whose guides are judged before anything is learned from them: a guide that does
//! not pay should cost little, and most of such an iteration is what would be learned for the next one: light paths, voxels' spheres,
//! trees. And guides of which paths do not tell clearly whether they pay are tried: samples with and without them are compared.

use std::time::Instant;

use super::budget::{GUIDED_RAY_COST, STRONG, Tried, Verdict, compared, judged, judged_roughly};
use super::learning::Learning;
use super::pass::{CHUNK, PassTracer};
use super::run::Run;
use super::settings::StopRule;
use super::state::Part;
use super::statistics::Statistics;
use crate::film::steady_values;
use crate::guiding::learn::learner::Use;
use crate::guiding::moments::PictureMoments;
use crate::guiding::sample::field::GuideField;

/// Part of a budget for a comparison of samples with and without a guide, in seconds or in samples, and how often each is made in turns.
const TRIAL_SHARE: [f64; 2] = [0.005, 0.01];
const TRIALS: u32 = 3;
/// Most of a budget in seconds that a comparison of the fewest samples may take.
const MOST_SHARE: f64 = 0.02;
/// Least samples of each of their pixels, each time: variances take two.
const PER_PIXEL: u32 = 2;
/// Fewest samples of one, for the clock and for variances.
const FEWEST: [u64; 2] = [1 << 12, 1 << 10];
/// First sample of those that are compared, beyond all that pictures have: what decides on a guide must not be what it makes.
const FIRST_TRIED: u32 = 1 << 31;
/// Least cost of a guided sample over another that counts beside what moments tell; a clock that says less was disturbed, or roulette is
/// harsher with the guide, which moments do not tell.
const LEAST_COST: f64 = 1.1;
/// Bounds of what the clock tells over what rays are taken to cost: 1.08 to 1.32 on five scenes with nothing beside it.
const CLOCK: [f64; 2] = [0.9, 1.4];
/// Gain by moments above which nobody looks closer.
const HOPELESS: f64 = 1.25;

impl Run<'_> {
    /// Whether iteration `t` is one on trial: where its guides may be given up, it fits into one chunk, and photons of the iteration before
    /// have told how much light paths do not find.
    pub(super) fn is_tried(&self, t: u32, learning: &Learning) -> bool {
        let (places, spp) = self.iteration_size(t);
        let may_end = t + 1 >= self.patience() && !self.is_always_guided();
        let knows = learning.unseen.is_some() || learning.photon_share == 0.0;
        // Samples that are moved are judged where they are moved to.
        may_end && knows && places * u64::from(spp) <= CHUNK && !self.settings.learner.tree.filtered
    }

    /// Makes the pass of an iteration on trial and returns whether its guides are given up. If not, all of it is learned from, and its
    /// photons may change the verdict.
    pub(super) fn try_pass(
        &mut self,
        part: &mut Part,
        field: &GuideField,
        learning: &mut Learning,
        picture: Option<&[f32]>,
    ) -> bool {
        learning.begin_trial();
        let complete = self.trace(part, Some(field), Some(learning), picture);
        let given_up = !complete && self.is_given_up_halfway(part, learning, picture);
        if !complete && !given_up {
            self.trace(part, Some(field), Some(learning), picture);
        }
        let given_up = given_up || self.is_given_up_on_trial(part, learning, picture);
        let paths = learning.end_trial();
        if given_up {
            // Light paths that were counted when the pass began, and camera paths that were left out.
            let (made, all) = (part.pass.samples() as f64, self.samples_of(part) as f64);
            self.state.spent -= ((all - made) + all * learning.photon_share) / self.pixels() as f64;
        } else {
            let tracer = PassTracer {
                first_sample: self.state.rendered - part.spp,
                spp: part.spp,
                places: self.places(),
                ..PassTracer::new(self.scene, self.settings, self.window, &self.filter)
            };
            let photons = tracer.settle(paths, learning, &mut self.statistics);
            self.watcher.control.progress.advance(photons);
        }
        given_up
    }

    /// Camera paths of a whole pass.
    fn samples_of(&self, part: &Part) -> u64 {
        self.places() * u64::from(part.spp)
    }

    /// Whether half of the pass shows already that its guides do not pay. A pass that enters the picture is completed, since how many
    /// samples it has must not depend on them.
    fn is_given_up_halfway(&mut self, part: &Part, learning: &mut Learning, picture: Option<&[f32]>) -> bool {
        if self.learned_before(self.state.position.iteration) > 1.0 {
            return false;
        }
        let moments = learning.learner.moments_so_far(self.outliers_of(part.pass.samples()));
        self.is_clearly_hopeless(part, &moments, learning, picture)
            && self.is_hopeless(self.state.position.iteration + 1)
    }

    /// Whether the whole pass shows that its guides do not pay.
    fn is_given_up_on_trial(&mut self, part: &Part, learning: &mut Learning, picture: Option<&[f32]>) -> bool {
        let moments = learning.learner.picture_moments(self.outliers_of(part.pass.samples()));
        let next = self.state.position.iteration + 1;
        if self.is_clearly_hopeless(part, &moments, learning, picture) && self.is_hopeless(next) {
            return true;
        }
        let told = self.judged_by_paths(judged, part, &moments, learning, picture);
        self.decide(told, learning);
        self.is_hopeless(next)
    }

    /// Whether guides would not pay if samples with them cost as little as any, for which less evidence is enough. Photons must have told
    /// that there is no light which paths have not found: that could not be judged by paths.
    fn is_clearly_hopeless(
        &mut self,
        part: &Part,
        moments: &PictureMoments,
        learning: &Learning,
        picture: Option<&[f32]>,
    ) -> bool {
        let verdict = self.judged_by_paths(judged_roughly, part, moments, learning, picture);
        if learning.unseen.is_none() || verdict.may_pay(LEAST_COST, None) {
            return false;
        }
        self.decide(verdict, learning);
        let trend = &self.state.trend;
        !trend.verdict.may_pay(if trend.tried.gain().is_some() { trend.guided_cost } else { LEAST_COST }, None)
    }

    /// Decides on the guides at hand, of which moments have `told`: by what trying them tells, where it does. The same guides are tried once.
    pub(super) fn decide(&mut self, told: Verdict, learning: &Learning) {
        self.state.trend.verdict = told.or_tried(self.state.trend.tried);
        if self.state.trend.tried == Tried::Not {
            self.try_guides(learning, self.state.position.voxels);
        }
    }

    /// Tries the guides of the first `voxels` voxels where the verdict on guiding depends on it: the same samples, which are in no picture,
    /// in each turn of other pixels, are traced with and without them in turns, and tell what they cost and how their variances differ. Under a budget in samples
    /// their rays are what they cost, so that the same picture is made everywhere.
    pub(super) fn try_guides(&mut self, learning: &Learning, voxels: usize) {
        let open = self.state.trend.verdict.gain().is_some_and(|gain| (STRONG..HOPELESS).contains(&gain));
        let Some(samples) = self.tried_samples().filter(|_| open && !self.is_always_guided()) else { return };
        let (Some(picture), Some(weights)) = (self.pixel_values(), self.values_so_far(steady_values)) else { return };
        let field = learning.learner.field_of(voxels, Use::Rendering);
        // Values mean another thing to paths without a guide.
        let plain = self.over_views(&picture);
        let places = (samples / u64::from(PER_PIXEL)).clamp(1, self.pixels());
        let spp = ((samples / places) as u32).max(PER_PIXEL);
        let (mut passes, mut seconds) = ([self.pass(false), self.pass(false)], [[0.0; TRIALS as usize]; 2]);
        let mut statistics = [Statistics::default(), Statistics::default()];
        for trial in 0..2 * TRIALS {
            let turn = trial / 2;
            // Each goes first in its turn: the second finds the scene's memory at hand.
            let guided = (trial + turn) as usize % 2;
            let tracer = PassTracer {
                field: (guided == 1).then_some(&field),
                lights: (&self.lights).into(),
                picture: if guided == 1 { Some(&picture) } else { self.settings.adaptive.then_some(&plain) }
                    .map(Vec::as_slice),
                first_sample: FIRST_TRIED + self.state.rendered + turn * spp,
                spp,
                places,
                few: Some(places * u64::from(turn)),
                ..PassTracer::new(self.scene, self.settings, self.window, &self.filter)
            };
            let begun = Instant::now();
            tracer.run(&mut passes[guided], 0, None, &mut statistics[guided], &mut |_| true);
            seconds[guided][turn as usize] = begun.elapsed().as_secs_f64();
        }
        let over = |[unguided, guided]: [f64; 2]| guided / unguided.max(1e-9);
        let by_rays = GUIDED_RAY_COST * over([0, 1].map(|kind: usize| statistics[kind].rays as f64));
        let cost = if let StopRule::Time(_) = self.settings.stop {
            // In each turn both have the same pixels; the median leaves out one that other programs have disturbed. Where they disturb
            // more, rays say about what is possible.
            let mut costs: [f64; TRIALS as usize] = std::array::from_fn(|turn| over(seconds.map(|of| of[turn])));
            costs.sort_unstable_by(f64::total_cmp);
            costs[costs.len() / 2].clamp(CLOCK[0] * by_rays, CLOCK[1] * by_rays)
        } else {
            self.state.spent += statistics.iter().map(|of| of.samples as f64).sum::<f64>() / self.pixels() as f64;
            by_rays
        };
        let trend = &mut self.state.trend;
        trend.guided_cost = cost.max(LEAST_COST);
        let [unguided, guided] = &passes;
        let ratio = unguided.variance_ratio(guided, Some(&weights));
        trend.tried = match (ratio, trend.verdict.gain()) {
            (Some(ratio), Some(told)) => compared(ratio, cost, trend.guided_cost, told),
            _ => Tried::Unclear,
        };
        trend.verdict = trend.verdict.or_tried(trend.tried);
    }

    /// Samples of a trial of a guide, one of [`TRIALS`] with it or without; none where the budget is too small for trials.
    fn tried_samples(&self) -> Option<u64> {
        let of = |share: f64, budget: f64| (share / f64::from(2 * TRIALS) * budget) as u64;
        match self.settings.stop {
            StopRule::Time(seconds) => {
                let budget = seconds * self.statistics.rate();
                let samples = of(TRIAL_SHARE[0], budget).clamp(FEWEST[0], CHUNK);
                Some(samples).filter(|&samples| samples <= of(MOST_SHARE, budget))
            }
            StopRule::Spp(spp) => {
                let samples = of(TRIAL_SHARE[1], f64::from(spp) * self.pixels() as f64).min(CHUNK);
                Some(samples).filter(|&samples| samples >= FEWEST[1])
            }
            StopRule::TargetError(_) => None,
        }
    }

    /// What `rule` says of guides by the paths of a pass so far, and by what the photons of the iteration before have told.
    fn judged_by_paths(
        &self,
        rule: impl Fn(Option<f64>, &PictureMoments, f64) -> Verdict,
        part: &Part,
        moments: &PictureMoments,
        learning: &Learning,
        picture: Option<&[f32]>,
    ) -> Verdict {
        let variance = part.pass.variance_relative_to(picture);
        let unseen = learning.unseen.filter(|_| learning.photon_share > 0.0).unwrap_or(0.0);
        rule(variance, &PictureMoments { unseen, ..*moments }, part.pass.samples() as f64)
    }
}
