//! What mixtures of lobes of all kinds have in common: those of all voxels while they learn, frozen and as arrays of a file.

use rayon::prelude::*;

use super::record::PathRecord;
use super::samples::Around;
use super::target::{Learned, Target};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, doubles, offsets};

/// Part of their number that the samples of an iteration count as in the next.
const PAST: f64 = 0.5;
/// Largest number of a voxel's samples of one kind of one chunk that are learned from; of more of them, every second, every third and so on.
const LARGEST: usize = 4096;
/// Bytes of a mixture beside its own, where a field holds it.
const BESIDE: usize = 16;

/// The mixture of a voxel while it learns.
pub trait Learning: Clone + Default + Send + Sync {
    /// The mixture as it is sampled.
    type Frozen: Send;
    /// What the names of its arrays begin with.
    const NAME: &'static str;

    /// Number of components.
    fn len(&self) -> usize;
    /// Whether no light has arrived.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Lets the samples so far count as a part of their number.
    fn decay(&mut self, part: f64);
    /// Bytes of the frozen mixture.
    fn bytes(&self) -> usize;
    /// The mixture as it is sampled, if `target` is what it has learned; none where no light has arrived.
    fn frozen(&self, target: Target) -> Option<Self::Frozen>;
}

/// The mixtures of all voxels while they learn.
#[derive(Debug, Clone)]
pub struct Mixtures<L> {
    pub(super) target: Target,
    pub(super) voxels: Vec<L>,
}

impl<L: Learning> Mixtures<L> {
    /// Empty mixtures of `voxels` voxels, for samples of `target`.
    pub(super) fn new(target: Target, voxels: usize) -> Self {
        Self { target, voxels: vec![L::default(); voxels] }
    }

    /// Adds empty voxels, up to `voxels` of them.
    pub(super) fn resize(&mut self, voxels: usize) {
        self.voxels.resize_with(voxels, L::default);
    }

    /// Mixtures to sample next, one per voxel; none for a voxel that no light has reached, nor for those that contribute least where all
    /// together would exceed `memory` bytes.
    pub(super) fn fit(&self, around: &Around, memory: usize) -> Vec<Option<L::Frozen>> {
        let mut order: Vec<usize> = (0..self.voxels.len()).filter(|&v| !self.voxels[v].is_empty()).collect();
        order.sort_by(|&a, &b| around.contributions[b].total_cmp(&around.contributions[a]).then(a.cmp(&b)));
        let (mut kept, mut left) = (vec![false; self.voxels.len()], memory);
        for v in order {
            let Some(rest) = left.checked_sub(self.voxels[v].bytes() + BESIDE) else { break };
            (kept[v], left) = (true, rest);
        }
        let frozen = |(voxel, kept): (&L, bool)| kept.then(|| voxel.frozen(self.target)).flatten();
        self.voxels.par_iter().zip(kept).map(frozen).collect()
    }

    /// Number of components.
    pub(super) fn components(&self) -> usize {
        self.voxels.iter().map(L::len).sum()
    }

    /// Ends an iteration: its samples become part of the past.
    pub(super) fn turn(&mut self) {
        self.voxels.par_iter_mut().for_each(|voxel| voxel.decay(PAST));
    }

    /// Halves voxel `old` into `old` and `new`, which get the shares `parts` of its samples.
    pub(super) fn halve(&mut self, old: usize, new: usize, parts: [f64; 2]) {
        self.voxels[new] = self.voxels[old].clone();
        for (v, part) in [old, new].into_iter().zip(parts) {
            self.voxels[v].decay(part);
        }
    }

    /// From now on `target` is learned; where that is another than before, all is forgotten.
    pub(super) fn clear(&mut self, target: Target) {
        if target != self.target {
            self.voxels.fill(L::default());
        }
        self.target = target;
    }

    /// State of the mixtures, as arrays of a file. `numbers` are those of a voxel beside its components', and those of each component.
    pub(super) fn state<'a, const V: usize, const N: usize>(
        &self,
        numbers: impl Fn(&L) -> ([f64; V], Vec<[f64; N]>),
    ) -> Vec<Tensor<'a>> {
        let all: Vec<_> = self.voxels.iter().map(numbers).collect();
        let [components, offset, voxel] = names::<L>();
        vec![
            doubles(components, all.iter().flat_map(|of| of.1.iter().copied())),
            offsets(offset, all.iter().map(|of| of.1.len())),
            doubles(voxel, all.iter().map(|of| of.0)),
        ]
    }

    /// Reads the mixtures of `count` voxels that [`Mixtures::state`] wrote. `voxel` makes one of its numbers; none where they are out of range.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn of_state<const V: usize, const N: usize>(
        target: Target,
        count: usize,
        file: &Tensors,
        voxel: impl Fn(&[f64; V], &[[f64; N]]) -> Option<L>,
    ) -> Result<Self> {
        let [components, offset, own] = names::<L>();
        let offsets = file.offsets(&offset, count)?;
        let rows = file.read(&components, Dtype::F64, Some(offsets[count]), N, f64::from_le_bytes)?;
        let own = file.read(&own, Dtype::F64, Some(count), V, f64::from_le_bytes)?;
        let (rows, own) = (rows.as_chunks::<N>().0, own.as_chunks::<V>().0);
        let mut voxels = Vec::with_capacity(count);
        for (v, numbers) in own.iter().enumerate() {
            let Some(voxel) = voxel(numbers, &rows[offsets[v]..offsets[v + 1]]) else {
                return file.fail(&components, format!("the numbers of voxel {v} are out of range"));
            };
            voxels.push(voxel);
        }
        Ok(Self { target, voxels })
    }
}

/// Names of the arrays of mixtures that learn.
fn names<L: Learning>() -> [String; 3] {
    ["components", "offset", "voxel"].map(|part| format!("{}_{part}", L::NAME))
}

/// At most [`LARGEST`] of the records.
pub(super) fn some<T>(records: impl Iterator<Item = T> + Clone) -> impl Iterator<Item = T> + Clone {
    let every = records.clone().count().div_ceil(LARGEST).max(1);
    records.step_by(every)
}

/// Value of a path sample as mixtures learn it: radiance, or for the targets that are second moments f·|cos θ|·L, over density.
pub(super) fn value(record: &PathRecord, learned: Learned) -> f64 {
    let value = f64::from(learned.value(record));
    if learned.target == Target::Radiance { value } else { value / f64::from(record.pdf).sqrt() }
}
