//! The mixtures of all voxels while they learn.

use rayon::prelude::*;

use super::fit::{Arrived, LearnedMixture};
use super::mixture::GaussianMixture;
use crate::guiding::record::PathRecord;
use crate::guiding::samples::{Around, Told};
use crate::guiding::target::{Learned, Target};
use crate::math::cylindrical;

/// Part of their number that the samples of an iteration count as in the next.
const PAST: f64 = 0.5;
/// Largest number of a voxel's samples of one kind of one chunk that are learned from; of more of them, every second, every third and so on.
const LARGEST: usize = 4096;
/// Bytes of a mixture beside its own, where a field holds it.
const BESIDE: usize = 16;

/// The mixtures of all voxels while they learn.
#[derive(Debug, Clone)]
pub struct GaussianMixtures {
    target: Target,
    pub(super) voxels: Vec<LearnedMixture>,
}

impl GaussianMixtures {
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

    /// Learns from the samples of a chunk, as seen from the voxels' centres.
    pub(in crate::guiding) fn observe(&mut self, told: &Told) {
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let sphere = &told.spheres[v].learned;
            let at = |point, direction| cylindrical::to_square(sphere.to_centre(point, direction).direction);
            let paths = told.samples.directed(v).filter(|_| told.paths);
            let paths = some(paths, |of| Arrived { place: at(of.point, of.direction), value: value(of, told.learned) });
            let photons = some(told.samples.photons(v), |of| Arrived {
                place: at(of.point, of.direction),
                value: f64::from(of.power),
            });
            if !(paths.is_empty() && photons.is_empty()) {
                voxel.learn([&paths, &photons]);
            }
        });
    }

    /// Mixtures to sample next, one per voxel; none for a voxel that no light has reached, nor for those that contribute least where all
    /// together would exceed `memory` bytes.
    pub(in crate::guiding) fn fit(&self, around: &Around, memory: usize) -> Vec<Option<GaussianMixture>> {
        let mut order: Vec<usize> = (0..self.voxels.len()).filter(|&v| !self.voxels[v].is_empty()).collect();
        order.sort_by(|&a, &b| around.contributions[b].total_cmp(&around.contributions[a]).then(a.cmp(&b)));
        let (mut kept, mut left) = (vec![false; self.voxels.len()], memory);
        for v in order {
            let bytes = GaussianMixture::bytes_of(self.voxels[v].len()) + BESIDE;
            let Some(rest) = left.checked_sub(bytes) else { break };
            (kept[v], left) = (true, rest);
        }
        let frozen = |(voxel, kept): (&LearnedMixture, bool)| kept.then(|| voxel.frozen()).flatten();
        self.voxels.par_iter().zip(kept).map(frozen).collect()
    }

    /// Number of Gaussians.
    pub(in crate::guiding) fn gaussians(&self) -> usize {
        self.voxels.iter().map(LearnedMixture::len).sum()
    }

    /// Ends an iteration: its samples become part of the past.
    pub(in crate::guiding) fn turn(&mut self) {
        self.voxels.iter_mut().for_each(|voxel| voxel.decay(PAST));
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

/// At most [`LARGEST`] of the records.
fn some<'a, T: 'a>(records: impl Iterator<Item = &'a T> + Clone, arrived: impl Fn(&T) -> Arrived) -> Vec<Arrived> {
    let every = records.clone().count().div_ceil(LARGEST).max(1);
    records.step_by(every).map(arrived).collect()
}

/// Value of a path sample as mixtures learn it: radiance, or for the targets that are second moments f·|cos θ|·L, over density.
fn value(record: &PathRecord, learned: Learned) -> f64 {
    let value = f64::from(learned.value(record));
    if learned.target == Target::Radiance { value } else { value / f64::from(record.pdf).sqrt() }
}
