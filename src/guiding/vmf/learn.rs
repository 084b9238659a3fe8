//! The mixtures of all voxels while they learn.

use rayon::prelude::*;

use super::fit::{Arrived, LearnedMixture};
use super::mixture::VmfMixture;
use crate::guiding::cache::parallax::middle;
use crate::guiding::record::PathRecord;
use crate::guiding::samples::{Around, Told};
use crate::guiding::target::{Learned, Target};

/// Part of their number that the samples of an iteration count as in the next.
const PAST: f64 = 0.5;
/// Largest number of a voxel's samples of one chunk that are learned from; of more of them, every second, every third and so on.
const LARGEST: usize = 4096;
/// Bytes of a mixture beside its own, where a field holds it.
const BESIDE: usize = 16;

/// The mixtures of all voxels while they learn.
#[derive(Debug, Clone)]
pub struct VmfMixtures {
    target: Target,
    pub(super) voxels: Vec<LearnedMixture>,
}

impl VmfMixtures {
    /// Empty mixtures of `voxels` voxels, for samples of `target`.
    pub(in crate::guiding) fn new(target: Target, voxels: usize) -> Self {
        Self { target, voxels: vec![LearnedMixture::default(); voxels] }
    }

    /// Those of `voxels`, as a file has them.
    pub(super) fn of(target: Target, voxels: Vec<LearnedMixture>) -> Self {
        Self { target, voxels }
    }

    /// Adds empty voxels, up to `voxels` of them.
    pub(in crate::guiding) fn resize(&mut self, voxels: usize) {
        self.voxels.resize_with(voxels, LearnedMixture::default);
    }

    /// Learns from the path samples of a chunk.
    pub(in crate::guiding) fn observe(&mut self, told: &Told) {
        if !told.paths {
            return;
        }
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let records = told.samples.directed(v);
            let number = records.clone().count();
            if number > 0 {
                let every = number.div_ceil(LARGEST);
                let (pivot, least) = middle(&told.cache.bounds(v as u32));
                voxel.learn(records.step_by(every).map(|record| arrived(record, told.learned)), pivot, least);
            }
        });
    }

    /// Mixtures to sample next, one per voxel; none for a voxel that no light has reached, nor for those that contribute least where all
    /// together would exceed `memory` bytes.
    pub(in crate::guiding) fn fit(&self, around: &Around, memory: usize) -> Vec<Option<VmfMixture>> {
        let mut order: Vec<usize> = (0..self.voxels.len()).filter(|&v| !self.voxels[v].is_empty()).collect();
        order.sort_by(|&a, &b| around.contributions[b].total_cmp(&around.contributions[a]).then(a.cmp(&b)));
        let (mut kept, mut left) = (vec![false; self.voxels.len()], memory);
        for v in order {
            let bytes = VmfMixture::bytes_of(self.voxels[v].len()) + BESIDE;
            let Some(rest) = left.checked_sub(bytes) else { break };
            (kept[v], left) = (true, rest);
        }
        let of_radiance = self.target == Target::Radiance;
        let frozen = |(voxel, kept): (&LearnedMixture, bool)| kept.then(|| voxel.frozen(of_radiance)).flatten();
        self.voxels.par_iter().zip(kept).map(frozen).collect()
    }

    /// Number of lobes.
    pub(in crate::guiding) fn lobes(&self) -> usize {
        self.voxels.iter().map(LearnedMixture::len).sum()
    }

    /// Ends an iteration: its samples become part of the past.
    pub(in crate::guiding) fn turn(&mut self) {
        self.voxels.par_iter_mut().for_each(|voxel| voxel.decay(PAST));
    }

    /// Halves voxel `old` into `old` and `new`, which get the shares `parts` of its samples.
    pub(in crate::guiding) fn halve(&mut self, old: usize, new: usize, parts: [f64; 2]) {
        self.voxels[new] = self.voxels[old].clone();
        for (v, part) in [old, new].into_iter().zip(parts) {
            self.voxels[v].decay(part);
        }
    }

    /// From now on `target` is learned; where that is another than before, all is forgotten.
    pub(in crate::guiding) fn clear(&mut self, target: Target) {
        if target != self.target {
            self.voxels.fill(LearnedMixture::default());
        }
        self.target = target;
    }
}

/// A record as mixtures learn it: radiance, or for the targets that are second moments f·|cos θ|·L, over density.
fn arrived(record: &PathRecord, learned: Learned) -> Arrived {
    let PathRecord { point, direction, distance, pdf, .. } = *record;
    let value = f64::from(learned.value(record));
    let value = if learned.target == Target::Radiance { value } else { value / f64::from(pdf).sqrt() };
    Arrived { point, direction, distance, value, pdf }
}
