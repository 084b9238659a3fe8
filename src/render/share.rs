//! Learning that several processes share: all begin with the same iterations, so that they have the same voxels, trees and guides; the
//! samples of the last one are dealt out among them, and what they count is added up (see [`guide_part`](super::guide_part)).

use super::guide_part::PartLearned;
use super::learning::Learning;
use super::part::PartOf;
use super::pass::PassTracer;
use super::run::Run;
use super::state::{Part, Phase, Position};
use crate::base::{Error, Result};
use crate::guiding::learn::fraction::FractionRule;
use crate::guiding::model::ModelKind;
use crate::reconstruct::Reconstructor;

impl Run<'_> {
    /// Learns in common with half of the budget of `spp`, and this part's share with the other half.
    pub(super) fn learn_part(
        mut self,
        part: PartOf,
        spp: u32,
        reconstructor: &dyn Reconstructor,
    ) -> Result<PartLearned> {
        if self.settings.learner.model != ModelKind::Trees {
            return Err(Error::Options(
                "histograms and mixtures are not added up: parts of other modes than jensen, vmf and gmm learn".into(),
            ));
        }
        let rule = self.settings.learner.fraction;
        if matches!(rule, FractionRule::Adam | FractionRule::Found) {
            let name = rule.name();
            return Err(Error::Options(format!(
                "--fraction {name}: what it has learned is not added up; parts learn with another rule"
            )));
        }
        let mut learning = self.begin_learning();
        let (begun, mut own) = match self.resume(Phase::Share) {
            Some(own) => (true, own),
            None => {
                let begun = self.iterations_of(&mut learning, reconstructor)? && !self.is_stopped();
                let own = if begun { self.begin_share(part, spp, &mut learning)? } else { self.begin_pass(0) };
                (begun, own)
            }
        };
        let pixel_values = self.pixel_values();
        if begun {
            let field = learning.field_of(self.state.position.voxels);
            self.watcher.control.progress.message("learning, a share");
            self.trace(&mut own, Some(&field), Some(&mut learning), pixel_values.as_deref());
        }
        self.watcher.control.progress.finish();
        let mut statistics = self.statistics;
        statistics.seconds.total = self.watcher.elapsed();
        statistics.describe(self.scene, self.settings, self.state.spent.ceil() as u32);
        Ok(PartLearned {
            voxels: self.state.position.voxels,
            learner: learning.learner,
            pixel_values,
            rays: self.settings.reconstruction_share * statistics.rays as f64,
            statistics,
            unkept: self.watcher.unkept,
            interrupted: self.interrupted || !begun,
        })
    }

    fn is_stopped(&self) -> bool {
        self.interrupted || self.watcher.stopped_between()
    }

    /// Takes the first chunk of the first part, which gives trees and spheres their shapes in all parts, and forgets its samples.
    fn begin_share(&mut self, part: PartOf, budget: u32, learning: &mut Learning) -> Result<Part> {
        let spp = ((f64::from(budget) - self.state.spent) / (1.0 + learning.photon_share)) as u32;
        let last = u64::from(self.state.rendered) + u64::from(spp) * u64::from(part.count());
        if spp == 0 || last > u64::from(super::checkpoint::MOST_SAMPLES) {
            return Err(Error::Options(format!(
                "{budget} samples per pixel in each of {} parts leave none to share, or are too many together",
                part.count()
            )));
        }
        let (voxels, began, traced) =
            (learning.learner.voxels(), self.watcher.elapsed(), self.statistics.seconds.trace);
        if voxels == 0 && part.count() > 1 {
            return Err(Error::Options(format!(
                "{budget} samples per pixel in each of {} parts leave none of the same places in all of them, of which the samples could be \
                 added up: give more --spp, or learn in one process",
                part.count()
            )));
        }
        self.state.position = Position { phase: Phase::Share, voxels, began, traced, ..Position::default() };
        let field = Some(learning.field_of(voxels)).filter(|field| !field.voxels().is_empty());
        let picture = field.as_ref().and_then(|_| self.pixel_values());
        let tracer = PassTracer {
            field: field.as_ref(),
            lights: (&self.lights).into(),
            picture: picture.as_deref(),
            first_sample: self.state.rendered,
            sequences_from: Some(self.state.rendered),
            spp,
            ..PassTracer::new(self.scene, self.settings, self.window, &self.filter)
        };
        tracer.run(&mut self.empty_pass(), 0, Some(learning), &mut self.statistics, &mut |_| false);
        learning.learner.begin_share();
        self.state.position.voxels = voxels;
        let own = self.begin_pass(spp);
        // The samples of the parts before count as rendered: theirs are the random numbers.
        self.state.rendered += (part.index() - 1) * spp;
        Ok(own)
    }
}
