//! A learner between two chunks as arrays of a file, so that an interrupted render can go on.
//!
//! For V voxels and O outliers, beside the arrays of the cache and of the trees `guide`, `counted`, `kinds` and `judged` (two of the
//! latter per voxel), which guide files have too:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `learner` | u64 | [4] | whether there is a cache, iterations, chunks, whether shapes are frozen |
//! | `past_offset` | u64 | [V + 1] | where the nodes of each voxel's past begin |
//! | `past_split` | u8 | [..] | which of those have children |
//! | `past_mass` | f32 | [..] | of each leaf |
//! | `past_samples` | f64 | [V] | |
//! | `outliers` | f64 | [O, 12] | voxel, squares, estimates |
//! | `outlier_least` | f64 | [1] | |
//! | `tree_offset` | u64 | [V + 1] | where each voxel's nodes begin |
//! | `tree_split` | u8 | [..] | which nodes have children |
//! | `tree_sums` | f32 | [.., channels] | of each leaf |
//! | `voxel` | f64 | [V, ..] | all other numbers of a voxel, in the order of [`Voxel::numbers`] |

use glam::Vec3;

use super::super::arrays::{cache_arrays, read_cache, read_offsets, read_trees, tree_arrays};
use super::super::effort::Returns;
use super::super::fraction::Adam;
use super::super::moments::{Estimate, Moments};
use super::super::parallax::Parallax;
use super::super::past::Past;
use super::super::proposal::Judged;
use super::super::quadtree::Quadtree;
use super::super::sampler::SamplingTree;
use super::super::topology::Topology;
use super::outliers::{Outlier, Outliers};
use super::voxel::Voxel;
use super::{Kept, Learner, LearnerSettings};
use crate::base::Result;
use crate::base::tensors::{Dtype, Tensor, Tensors, doubles, vector};
use crate::guiding::cache::SpatialCache;

impl Learner {
    /// All that it knows.
    pub fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        let kept = u64::from(self.kept.shapes) + 2 * u64::from(self.kept.spheres);
        let state = [u64::from(self.cache.is_some()), self.iterations.into(), self.absorbed, kept];
        let empty = SpatialCache::new(Vec3::ZERO, 1.0);
        let voxels = &self.voxels;
        let trees = || voxels.iter().map(|v| &v.tree);
        let offsets = ends(trees().map(|tree| tree.topology().len()));
        let pasts = || voxels.iter().filter_map(|v| v.past.as_ref());
        let past_offsets = ends(voxels.iter().map(|v| v.past.as_ref().map_or(0, |past| past.split().len())));
        let past_samples = |v: &Voxel| v.past.as_ref().map_or(0.0, Past::samples).to_le_bytes();
        let flags = trees().flat_map(|tree| tree.topology().split_flags()).map(|split| [u8::from(split)]);
        let sums: Vec<u8> = trees().flat_map(|tree| tree.leaves().sums).flat_map(|x| x.to_le_bytes()).collect();
        let channels = self.settings.layout.channels();
        let numbers: Vec<f64> = voxels.iter().flat_map(Voxel::numbers).collect();
        let columns = numbers.len() / voxels.len().max(1);
        let bytes: Vec<u8> = numbers.into_iter().flat_map(f64::to_le_bytes).collect();
        let pairs = |of: fn(&Voxel) -> Option<&[SamplingTree; 2]>| -> Vec<_> {
            voxels.iter().flat_map(|v| [0, 1].map(|i| of(v).map(|pair| &pair[i]))).collect()
        };
        let mut all = cache_arrays(self.cache.as_ref().unwrap_or(&empty));
        all.extend(tree_arrays("guide", &voxels.iter().map(|v| v.guide.as_ref()).collect::<Vec<_>>()));
        all.extend(tree_arrays("counted", &voxels.iter().map(|v| v.counted.as_ref()).collect::<Vec<_>>()));
        all.extend(tree_arrays("kinds", &pairs(|v| v.kinds.as_deref())));
        all.extend(tree_arrays("judged", &pairs(|v| v.judged.as_deref().map(|judged| &judged.trees))));
        all.extend([
            vector("learner", Dtype::U64, state.into_iter().map(u64::to_le_bytes)),
            vector("past_mass", Dtype::F32, pasts().flat_map(Past::mass).map(|x| x.to_le_bytes())),
            vector("past_offset", Dtype::U64, std::iter::once(0).chain(past_offsets).map(u64::to_le_bytes)),
            vector("past_samples", Dtype::F64, voxels.iter().map(past_samples)),
            vector("past_split", Dtype::U8, pasts().flat_map(Past::split).map(|&split| [u8::from(split)])),
            doubles("outliers", self.outliers.found.iter().map(Outlier::numbers)),
            vector("outlier_least", Dtype::F64, std::iter::once(self.outliers.least.to_le_bytes())),
            vector("tree_offset", Dtype::U64, std::iter::once(0).chain(offsets).map(u64::to_le_bytes)),
            vector("tree_split", Dtype::U8, flags),
            ("tree_sums".into(), Dtype::F32, vec![sums.len() / (4 * channels), channels], sums.into()),
            ("voxel".into(), Dtype::F64, vec![voxels.len(), columns], bytes.into()),
        ]);
        all
    }

    /// The learner with these settings that [`Learner::arrays`] were made of.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn from_arrays(settings: LearnerSettings, file: &Tensors) -> Result<Self> {
        let state = file.read("learner", Dtype::U64, Some(4), 1, u64::from_le_bytes)?;
        let cache = read_cache(file)?;
        let mut learner = Self::new(settings);
        learner.voxels = learner.read_voxels(file, cache.len())?;
        (learner.cache, learner.iterations) = ((state[0] != 0).then_some(cache), state[1].min(1 << 20) as u32);
        learner.absorbed = state[2];
        learner.kept = Kept { shapes: state[3] & 1 != 0, spheres: state[3] & 2 != 0 };
        let outliers = file.read("outliers", Dtype::F64, None, 12, f64::from_le_bytes)?;
        let found = outliers.as_chunks::<12>().0.iter().map(Outlier::from_numbers).collect();
        let least = file.read("outlier_least", Dtype::F64, Some(1), 1, f64::from_le_bytes)?[0];
        learner.outliers = Outliers { found, least };
        Ok(learner)
    }

    fn read_voxels(&self, file: &Tensors, count: usize) -> Result<Vec<Voxel>> {
        let empty = || Voxel::new(self.settings.layout, self.settings.target);
        let columns = if count > 0 { empty().numbers().len() } else { 0 };
        let numbers = file.read("voxel", Dtype::F64, Some(count), columns, f64::from_le_bytes)?;
        let mut voxels = Vec::with_capacity(count);
        let [guides, counted] = [read_trees(file, "guide", count)?, read_trees(file, "counted", count)?];
        let [kinds, judged] = [read_pairs(file, "kinds", count)?, read_pairs(file, "judged", count)?];
        let mut pairs = kinds.into_iter().zip(judged);
        let trees = self.read_quadtrees(file, count)?;
        for (v, ((tree, guide), counted)) in trees.into_iter().zip(guides).zip(counted).enumerate() {
            let mut voxel = Voxel { tree, guide, counted, ..empty() };
            let (kinds, judged) = pairs.next().unwrap_or_default();
            voxel.kinds = kinds.map(Box::new);
            voxel.judged = judged.map(|trees| Box::new(Judged { trees, share: 1.0 }));
            if !voxel.set_numbers(&numbers[v * columns..][..columns]) {
                return file.fail("voxel", format!("the numbers of voxel {v} are out of range"));
            }
            voxels.push(voxel);
        }
        read_pasts(file, &mut voxels)?;
        Ok(voxels)
    }

    fn read_quadtrees(&self, file: &Tensors, count: usize) -> Result<Vec<Quadtree>> {
        let LearnerSettings { layout, .. } = self.settings;
        let state = file.read("learner", Dtype::U64, Some(4), 1, u64::from_le_bytes)?;
        let target = Self { iterations: state[1].min(1 << 20) as u32, ..Self::new(self.settings.clone()) }.target();
        let offsets = read_offsets(file, "tree_offset", count)?;
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

/// Where each of consecutive parts of these lengths ends.
fn ends(lengths: impl Iterator<Item = usize>) -> impl Iterator<Item = u64> {
    lengths.scan(0, |end, length| {
        *end += length as u64;
        Some(*end)
    })
}

/// Two trees for each of `count` voxels, or none.
fn read_pairs(file: &Tensors, kind: &str, count: usize) -> Result<Vec<Option<[SamplingTree; 2]>>> {
    let mut trees = read_trees(file, kind, 2 * count)?.into_iter();
    let mut next = || trees.next().flatten();
    let pair = |_| {
        let [first, second] = [next(), next()];
        first.zip(second).map(<[_; 2]>::from)
    };
    Ok((0..count).map(pair).collect())
}

/// Gives voxels their past.
fn read_pasts(file: &Tensors, voxels: &mut [Voxel]) -> Result<()> {
    let offsets = read_offsets(file, "past_offset", voxels.len())?;
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

impl Voxel {
    /// Everything but trees. All are exact in double precision.
    fn numbers(&self) -> Vec<f64> {
        let (scales, counts) = (self.tree.scales(), self.tree.counts());
        let mut all: Vec<f64> = Vec::with_capacity(72);
        all.extend(self.parallax.to_array().into_iter().chain(self.guide_parallax.to_array()).map(f64::from));
        all.extend([self.bsdf_fraction, self.gain].into_iter().chain(scales).map(f64::from));
        all.extend(counts.into_iter().chain(self.eighths).map(f64::from));
        all.extend(self.normals.to_array().map(f64::from));
        let share = self.judged.as_ref().map_or(1.0, |judged| judged.share);
        all.extend([
            f64::from(u8::from(self.shaped)),
            f64::from(u8::from(self.told)),
            f64::from(share),
            self.path_share,
            self.contribution,
            self.all_squares,
        ]);
        self.squares.push_to(&mut all);
        self.fractions.push_to(&mut all);
        self.returns.push_to(&mut all);
        self.known_returns.push_to(&mut all);
        self.shares.push_to(&mut all);
        self.merits.push_to(&mut all);
        all.extend(self.adam.numbers());
        all
    }

    /// Sets what [`Voxel::numbers`] has; returns whether it is in range.
    fn set_numbers(&mut self, numbers: &[f64]) -> bool {
        let mut rest = numbers.iter().copied();
        let mut next = || rest.next().unwrap_or(f64::NAN);
        let mut sphere = || {
            let [x, y, z, curvature] = [0; 4].map(|_| next() as f32);
            Parallax { centre: Vec3::new(x, y, z), curvature }
        };
        [self.parallax, self.guide_parallax] = [sphere(), sphere()];
        [self.bsdf_fraction, self.gain] = [0; 2].map(|_| next() as f32);
        let scales = [0; 2].map(|_| next() as f32);
        let counts = [0; 2].map(|_| (next() as u32).min(1 << 30));
        self.tree.set_samples(scales, counts);
        self.eighths = [0; 8].map(|_| (next() as u32).min(1 << 26));
        self.normals = Vec3::from([0; 3].map(|_| next() as f32));
        [self.shaped, self.told] = [0; 2].map(|_| next() != 0.0);
        let share = next();
        if let Some(judged) = &mut self.judged {
            judged.share = share as f32;
        }
        [self.path_share, self.contribution, self.all_squares] = [0; 3].map(|_| next());
        self.squares = Moments::pull_from(&mut next);
        self.fractions = Moments::pull_from(&mut next);
        self.returns = Returns::pull_from(&mut next);
        self.known_returns = Returns::pull_from(&mut next);
        self.shares = Moments::pull_from(&mut next);
        self.merits = Moments::pull_from(&mut next);
        self.adam = Adam::from_numbers([0; 4].map(|_| next()));
        let spheres = [self.parallax, self.guide_parallax];
        let fractions = [f64::from(self.bsdf_fraction), self.path_share];
        spheres.iter().all(|s| s.to_array().iter().all(|x| x.is_finite()))
            && fractions.iter().all(|f| *f > 0.0 && *f <= 1.0)
            && (0.0..=1.0).contains(&share)
            && scales.iter().all(|s| *s >= 0.0)
            && self.normals.is_finite()
    }
}

impl Outlier {
    fn numbers(&self) -> [f64; 12] {
        let [a, b] = self.squares;
        let of = |i: usize| {
            let Estimate { square, bsdf_share, light_ratio } = self.estimates[i];
            [square, bsdf_share.into(), light_ratio.into()]
        };
        let [[c, d, e], [f, g, h], [i, j, k]] = [of(0), of(1), of(2)];
        [self.voxel.into(), a, b, c, d, e, f, g, h, i, j, k]
    }

    fn from_numbers(&[voxel, a, b, c, d, e, f, g, h, i, j, k]: &[f64; 12]) -> Self {
        let estimate =
            |[square, share, ratio]: [f64; 3]| Estimate { square, bsdf_share: share as f32, light_ratio: ratio as f32 };
        let estimates = [[c, d, e], [f, g, h], [i, j, k]].map(estimate);
        Self { voxel: voxel as u32, squares: [a, b], estimates }
    }
}
