//! The learner at work inside a render: records in, distributions out, with the time that each takes.

use std::time::Instant;

use super::pass::Records;
use super::settings::{RenderSettings, SampleKinds};
use super::statistics::{GuideStatistics, Iteration, Seconds};
use crate::base::Result;
use crate::guiding::distribution::Distribution;
use crate::guiding::field::GuideField;
use crate::guiding::learner::Learner;
use crate::reconstruct::{Reconstructor, TreeInput};

/// Learns the guiding field of a render.
pub struct Learning {
    /// The trees.
    pub learner: Learner,
}

impl Learning {
    /// Nothing learned yet.
    pub fn new(settings: &RenderSettings) -> Self {
        Self { learner: Learner::new(settings.learner.clone()) }
    }

    /// Deposits one chunk.
    pub fn absorb(&mut self, records: &Records, kinds: SampleKinds, seconds: &mut Seconds) {
        let begun = Instant::now();
        self.learner.absorb(&records.paths, &records.photons, kinds.paths());
        seconds.splat += begun.elapsed().as_secs_f64();
    }

    /// Reconstructs every tree that holds energy, publishes the results, refines the voxels.
    ///
    /// # Errors
    /// Those of the reconstructor.
    pub fn end_iteration(&mut self, reconstructor: &dyn Reconstructor, seconds: &mut Seconds) -> Result<Iteration> {
        let begun = Instant::now();
        let distributions = self.distributions(reconstructor)?;
        self.learner.publish(&distributions, reconstructor.uniform());
        let reconstruct_seconds = begun.elapsed().as_secs_f64();
        seconds.reconstruct += reconstruct_seconds;
        let nodes = self.learner.trees().iter().map(|t| t.topology().len()).sum();
        let begun = Instant::now();
        self.learner.refine();
        seconds.splat += begun.elapsed().as_secs_f64();
        Ok(Iteration { voxels: self.learner.voxels(), nodes, reconstruct_seconds, ..Iteration::default() })
    }

    /// One distribution per voxel; none where the tree holds no energy, so that nothing can be learned from it.
    fn distributions(&self, reconstructor: &dyn Reconstructor) -> Result<Vec<Option<Distribution>>> {
        let trees = self.learner.trees();
        let useful: Vec<usize> = (0..trees.len()).filter(|&i| trees[i].has_energy()).collect();
        let input = |&i: &usize| TreeInput { topology: trees[i].topology(), leaf_sums: trees[i].leaf_sums() };
        let inputs: Vec<TreeInput> = useful.iter().map(input).collect();
        let mut distributions = vec![None; trees.len()];
        for (i, distribution) in useful.into_iter().zip(reconstructor.reconstruct(&inputs)?) {
            distributions[i] = Some(distribution);
        }
        Ok(distributions)
    }

    /// The field to sample from next.
    pub fn field(&self, learning: bool) -> GuideField {
        self.learner.field(learning)
    }

    /// Size of a field.
    pub fn statistics(&self, field: &GuideField) -> GuideStatistics {
        GuideStatistics {
            voxels: field.voxels().len(),
            trees: field.voxels().iter().filter(|v| v.tree.is_some()).count(),
            nodes: field.nodes(),
            bytes: field.bytes(),
        }
    }
}
