//! Trees between two chunks as arrays of a file, so that an interrupted render can go on.
//!
//! For V voxels, beside the packed trees `counted`, `kinds` and `judged` (two of the latter per voxel):
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `trees` | u64 | [1] | whether shapes are frozen |
//! | `tree_offset` | u64 | [V + 1] | index of each voxel's first node |
//! | `tree_split` | u8 | [..] | 1 for each node that has children |
//! | `tree_sums` | f32 | [.., channels] | sums of each leaf |
//! | `tree_voxel` | f64 | [V, ..] | all other numbers of a voxel's tree, in the order of [`TreeVoxel::numbers`] |
//! | `past_offset` | u64 | [V + 1] | index of the first node of each voxel's past |
//! | `past_split` | u8 | [..] | 1 for each of those nodes that has children |
//! | `past_mass` | f32 | [..] | mass of each of their leaves |
//! | `past_samples` | f64 | [V] | number of samples behind each past |

use glam::Vec3;

use super::arrays::{read_trees, tree_arrays};
use super::past::Past;
use super::proposal::Judged;
use super::quadtree::Quadtree;
use super::sampler::SamplingTree;
use super::topology::Topology;
use super::voxel::TreeVoxel;
use super::{TreeSettings, Trees};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, offsets, vector};
use crate::guiding::moments::Moments;
use crate::guiding::target::Target;

impl Trees {
    /// State of the trees, as arrays of a file.
    pub(in crate::guiding) fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        let voxels = &self.voxels;
        let trees = || voxels.iter().map(|v| &v.tree);
        let pasts = || voxels.iter().filter_map(|v| v.past.as_ref());
        let past_samples = |v: &TreeVoxel| v.past.as_ref().map_or(0.0, Past::samples).to_le_bytes();
        let past_nodes = voxels.iter().map(|v| v.past.as_ref().map_or(0, |past| past.split().len()));
        let flags = trees().flat_map(|tree| tree.topology().split_flags()).map(|split| [u8::from(split)]);
        let sums: Vec<u8> = trees().flat_map(|tree| tree.leaves().sums).flat_map(|x| x.to_le_bytes()).collect();
        let channels = self.settings.layout.channels();
        let numbers: Vec<f64> = voxels.iter().flat_map(TreeVoxel::numbers).collect();
        let columns = numbers.len() / voxels.len().max(1);
        let bytes: Vec<u8> = numbers.into_iter().flat_map(f64::to_le_bytes).collect();
        let pairs = |of: fn(&TreeVoxel) -> Option<&[SamplingTree; 2]>| -> Vec<_> {
            voxels.iter().flat_map(|v| [0, 1].map(|i| of(v).map(|pair| &pair[i]))).collect()
        };
        let mut all = tree_arrays("counted", &voxels.iter().map(|v| v.counted.as_ref()).collect::<Vec<_>>()).to_vec();
        all.extend(tree_arrays("kinds", &pairs(|v| v.kind_trees.as_deref())));
        all.extend(tree_arrays("judged", &pairs(|v| v.last_proposals.as_deref().map(|judged| &judged.trees))));
        all.extend([
            vector("trees", Dtype::U64, std::iter::once(u64::from(self.keeps_shapes).to_le_bytes())),
            vector("past_mass", Dtype::F32, pasts().flat_map(Past::mass).map(|x| x.to_le_bytes())),
            offsets("past_offset", past_nodes),
            vector("past_samples", Dtype::F64, voxels.iter().map(past_samples)),
            vector("past_split", Dtype::U8, pasts().flat_map(Past::split).map(|&split| [u8::from(split)])),
            offsets("tree_offset", trees().map(|tree| tree.topology().len())),
            vector("tree_split", Dtype::U8, flags),
            ("tree_sums".into(), Dtype::F32, vec![sums.len() / (4 * channels), channels], sums.into()),
            ("tree_voxel".into(), Dtype::F64, vec![voxels.len(), columns], bytes.into()),
        ]);
        all
    }

    /// Reads the trees of `count` voxels that [`Trees::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(in crate::guiding) fn from_arrays(
        settings: TreeSettings,
        target: Target,
        count: usize,
        file: &Tensors,
    ) -> Result<Self> {
        let mut all = Self::new(settings, target, count);
        all.keeps_shapes = file.read("trees", Dtype::U64, Some(1), 1, u64::from_le_bytes)?[0] != 0;
        let columns = all.voxels.first().map_or(0, |empty| empty.numbers().len());
        let numbers = file.read("tree_voxel", Dtype::F64, Some(count), columns, f64::from_le_bytes)?;
        let counted = read_trees(file, "counted", count)?;
        let [kinds, judged] = [read_pairs(file, "kinds", count)?, read_pairs(file, "judged", count)?];
        let mut pairs = kinds.into_iter().zip(judged);
        let quadtrees = all.read_quadtrees(file, count)?;
        for (v, ((tree, counted), voxel)) in quadtrees.into_iter().zip(counted).zip(&mut all.voxels).enumerate() {
            (voxel.tree, voxel.counted) = (tree, counted);
            let (kinds, judged) = pairs.next().unwrap_or_default();
            voxel.kind_trees = kinds.map(Box::new);
            voxel.last_proposals = judged.map(|trees| Box::new(Judged { trees, share: 1.0 }));
            if !voxel.set_numbers(&numbers[v * columns..][..columns]) {
                return file.fail("tree_voxel", format!("the numbers of voxel {v} are out of range"));
            }
        }
        read_pasts(file, &mut all.voxels)?;
        Ok(all)
    }

    fn read_quadtrees(&self, file: &Tensors, count: usize) -> Result<Vec<Quadtree>> {
        let (layout, target) = (self.settings.layout, self.target);
        let offsets = file.offsets("tree_offset", count)?;
        let flags = file.read("tree_split", Dtype::U8, Some(offsets[count]), 1, |[b]| b != 0)?;
        let sums = file.read("tree_sums", Dtype::F32, None, layout.channels(), f32::from_le_bytes)?;
        let mut rest = sums.as_slice();
        let mut trees = Vec::with_capacity(count);
        for v in 0..count {
            let topology = Topology::from_split(&flags[offsets[v]..offsets[v + 1]]);
            let topology = topology.or_else(|e| file.fail(format!("tree_split of voxel {v}"), e))?;
            let values = topology.leaves().count() * layout.channels();
            let Some((own, others)) = rest.split_at_checked(values) else {
                return file.fail("tree_sums", format!("no values for the leaves of voxel {v}"));
            };
            rest = others;
            trees.push(Quadtree::with_sums(topology, layout, target, own));
        }
        if !rest.is_empty() {
            return file.fail("tree_sums", format!("{} values belong to no leaf", rest.len()));
        }
        Ok(trees)
    }
}

/// Reads two trees for each of `count` voxels, or none.
fn read_pairs(file: &Tensors, kind: &str, count: usize) -> Result<Vec<Option<[SamplingTree; 2]>>> {
    let mut trees = read_trees(file, kind, 2 * count)?.into_iter();
    let mut next = || trees.next().flatten();
    let pair = |_| {
        let [first, second] = [next(), next()];
        first.zip(second).map(<[_; 2]>::from)
    };
    Ok((0..count).map(pair).collect())
}

/// Reads the past of each voxel.
fn read_pasts(file: &Tensors, voxels: &mut [TreeVoxel]) -> Result<()> {
    let offsets = file.offsets("past_offset", voxels.len())?;
    let flags = file.read("past_split", Dtype::U8, Some(offsets[voxels.len()]), 1, |[b]| b != 0)?;
    let masses = file.read("past_mass", Dtype::F32, None, 1, f32::from_le_bytes)?;
    let samples = file.read("past_samples", Dtype::F64, Some(voxels.len()), 1, f64::from_le_bytes)?;
    let mut rest = masses.as_slice();
    for (v, voxel) in voxels.iter_mut().enumerate() {
        let split = &flags[offsets[v]..offsets[v + 1]];
        let Some((own, others)) = rest.split_at_checked(split.iter().filter(|s| !**s).count()) else {
            return file.fail("past_mass", format!("no values for the leaves of voxel {v}"));
        };
        rest = others;
        if !split.is_empty() {
            voxel.past = Past::from_parts(split, own, samples[v]);
            if voxel.past.is_none() {
                return file.fail("past_split", format!("the past of voxel {v} is no distribution"));
            }
        }
    }
    if !rest.is_empty() {
        return file.fail("past_mass", format!("{} values belong to no leaf", rest.len()));
    }
    Ok(())
}

impl TreeVoxel {
    /// All numbers of the voxel beside its trees. All are exact in double precision.
    fn numbers(&self) -> Vec<f64> {
        let mut all: Vec<f64> = Vec::with_capacity(32);
        all.extend(self.tree.scales().map(f64::from));
        all.extend(self.tree.counts().map(f64::from));
        all.extend(self.normals.to_array().map(f64::from));
        let share = self.last_proposals.as_ref().map_or(1.0, |judged| judged.share);
        all.extend([f64::from(u8::from(self.shaped)), f64::from(share), self.path_share]);
        self.kind_moments.push_to(&mut all);
        self.proposal_moments.push_to(&mut all);
        all
    }

    /// Sets the numbers that [`TreeVoxel::numbers`] lists; returns whether they are in range.
    fn set_numbers(&mut self, numbers: &[f64]) -> bool {
        let mut rest = numbers.iter().copied();
        let mut next = || rest.next().unwrap_or(f64::NAN);
        let scales = [0; 2].map(|_| next() as f32);
        let counts = [0; 2].map(|_| (next() as u32).min(1 << 30));
        self.tree.set_samples(scales, counts);
        self.normals = Vec3::from([0; 3].map(|_| next() as f32));
        self.shaped = next() != 0.0;
        let share = next();
        if let Some(judged) = &mut self.last_proposals {
            judged.share = share as f32;
        }
        self.path_share = next();
        self.kind_moments = Moments::pull_from(&mut next);
        self.proposal_moments = Moments::pull_from(&mut next);
        scales.iter().all(|s| *s >= 0.0)
            && (0.0..=1.0).contains(&share)
            && self.path_share > 0.0
            && self.path_share <= 1.0
            && self.normals.is_finite()
    }
}
