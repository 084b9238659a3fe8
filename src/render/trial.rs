//! Passes on trial: small iterations whose guides are judged before anything is learned from them. A guide that does not pay should cost
//! little, and most of such an iteration is what would be learned for the next one: light paths, voxels' spheres, trees.

use super::budget::{Verdict, judged, judged_roughly};
use super::iterations::LEAST_COST;
use super::learning::Learning;
use super::pass::{CHUNK, PassTracer};
use super::run::Run;
use super::state::{Part, Position};
use crate::guiding::moments::PictureMoments;
use crate::guiding::sample::field::GuideField;

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
    }

    /// Whether the whole pass shows that its guides do not pay.
    fn is_given_up_on_trial(&mut self, part: &Part, learning: &mut Learning, picture: Option<&[f32]>) -> bool {
        let Position { iteration: t, voxels, .. } = self.state.position;
        let moments = learning.learner.picture_moments(self.outliers_of(part.pass.samples()));
        if self.is_clearly_hopeless(part, &moments, learning, picture) {
            return true;
        }
        self.state.trend.verdict = self.judged_by_paths(judged, part, &moments, learning, picture);
        self.try_cost(learning, voxels);
        self.is_hopeless(t + 1)
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
        let hopeless = learning.unseen.is_some() && !verdict.may_pay(LEAST_COST, None);
        if hopeless {
            self.state.trend.verdict = verdict;
        }
        hopeless
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
