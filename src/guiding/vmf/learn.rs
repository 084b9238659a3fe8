//! The mixtures of all voxels while they learn.

use rayon::prelude::*;

use super::fit::{Arrived, LearnedMixture};
use super::mixture::VmfMixture;
use crate::guiding::cache::parallax::middle;
use crate::guiding::mixtures::{Learning, Mixtures, some, value};
use crate::guiding::record::PathRecord;
use crate::guiding::samples::Told;
use crate::guiding::target::{Learned, Target};

/// The mixtures of all voxels while they learn.
pub type VmfMixtures = Mixtures<LearnedMixture>;

impl Learning for LearnedMixture {
    type Frozen = VmfMixture;
    const NAME: &'static str = "vmf";

    fn len(&self) -> usize {
        self.len()
    }

    fn decay(&mut self, part: f64) {
        self.decay(part);
    }

    fn bytes(&self) -> usize {
        VmfMixture::bytes_of(self.len())
    }

    fn frozen(&self, target: Target) -> Option<VmfMixture> {
        self.frozen(target == Target::Radiance)
    }
}

impl VmfMixtures {
    /// Learns from the path samples of a chunk.
    pub(in crate::guiding) fn observe(&mut self, told: &Told) {
        if !told.paths {
            return;
        }
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let records = told.samples.directed(v);
            if records.clone().next().is_some() {
                let (pivot, least) = middle(&told.cache.bounds(v as u32));
                voxel.learn(some(records).map(|record| arrived(record, told.learned)), pivot, least);
            }
        });
    }
}

fn arrived(record: &PathRecord, learned: Learned) -> Arrived {
    let PathRecord { point, direction, distance, pdf, .. } = *record;
    Arrived { point, direction, distance, value: value(record, learned), pdf }
}
