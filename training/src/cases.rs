//! Training pairs unpacked for evaluation: any method can reconstruct them, and results are compared.

use anyhow::{Result, anyhow};
use fanal::generate::shard::TreeSample;
use fanal::guiding::target::Target;
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::context::Block;
use fanal::guiding::tree::distribution::{CommonCell, Distribution, kl_by_level, kl_of_cells, relative_moment};
use fanal::guiding::tree::features::VoxelFeatures;
use fanal::guiding::tree::leaves::{Layout, Leaves};
use fanal::guiding::tree::topology::Topology;
use fanal::network::backend::Backend;
use fanal::network::weights::Model;
use fanal::reconstruct::neural::reconstruct_batch;
use rayon::prelude::*;

/// An unpacked training pair.
#[derive(Debug, Clone)]
pub struct Case {
    /// The voxel's samples as counted, with its context.
    pub counted: Distribution,
    /// Shape of the voxel's own tree Q_h.
    pub own: Topology,
    /// Sums of its leaves.
    pub own_sums: Vec<f32>,
    /// Pooled distribution of the block of cells around the voxel.
    pub block: Block,
    /// Features of the voxel as a whole.
    pub voxel_features: VoxelFeatures,
    /// Quantity that the sums of path samples hold.
    pub quantity: Target,
    /// The target tree Q_gt.
    pub target: Distribution,
    /// Distribution of BSDF sampling, on the same tree.
    pub bsdf: Distribution,
    /// KL between two halves of Q_gt, nats.
    pub floor: f64,
}

impl Case {
    /// Unpacks a valid pair.
    ///
    /// # Errors
    /// When its trees are not valid.
    pub fn new(sample: &TreeSample) -> Result<Self> {
        let tree = |what: &str, split: &[bool]| Topology::from_split(split).map_err(|e| anyhow!("{what} tree: {e}"));
        let wide = |masses: &[f32]| masses.iter().map(|&m| f64::from(m)).collect::<Vec<_>>();
        let target = tree("target", &sample.target_split)?;
        let counted = tree("counted", &sample.counted_split)?;
        let block = on_tree(tree("block", &sample.block_split)?, &wide(&sample.block));
        Ok(Self {
            counted: on_tree(counted, &wide(&sample.counted)),
            own: tree("own", &sample.own_split)?,
            own_sums: sample.own_sums.clone(),
            block: Block { distribution: block, samples: sample.block_samples },
            voxel_features: sample.voxel_features,
            quantity: sample.quantity,
            bsdf: on_tree(target.clone(), &wide(&sample.target_bsdf)),
            target: on_tree(target, &wide(&sample.target)),
            floor: f64::from(sample.floor_kl),
        })
    }

    /// The input of a reconstructor.
    pub fn input(&self) -> CountedTree<'_> {
        let (counted, own, block) = (&self.counted, self.leaves(), &self.block);
        CountedTree { counted, own, block, voxel_features: self.voxel_features, contribution: 1.0 }
    }

    /// The voxel's own samples.
    pub fn leaves(&self) -> Leaves<'_> {
        Leaves { topology: &self.own, sums: &self.own_sums, layout: Layout::Network, target: self.quantity }
    }

    /// Number of path samples and photons in the own tree.
    pub fn samples(&self) -> f64 {
        self.voxel_features.samples.iter().map(|&n| f64::from(n)).sum()
    }
}

/// A distribution that keeps its tree, also where it is uniform.
fn on_tree(topology: Topology, masses: &[f64]) -> Distribution {
    if masses.iter().any(|&m| m > 0.0) {
        return Distribution::from_leaf_weights(topology, masses);
    }
    let shares = vec![0.25; topology.len()];
    Distribution::from_shares(topology, &shares)
}

/// Unpacks at most `limit` of the samples, evenly spread.
///
/// # Errors
/// As [`Case::new`].
pub fn spread(samples: &[TreeSample], limit: usize) -> Result<Vec<Case>> {
    every(samples, limit).map(Case::new).collect()
}

/// At most `limit` of the samples, evenly spread.
pub fn every(samples: &[TreeSample], limit: usize) -> impl Iterator<Item = &TreeSample> {
    let stride = samples.len().div_ceil(limit.max(1)).max(1);
    samples.iter().step_by(stride)
}

/// Distributions that the network reconstructs for the cases.
///
/// # Errors
/// Those of [`reconstruct_batch`].
pub fn reconstruct(model: &Model, backend: &dyn Backend, cases: &[Case]) -> Result<Vec<Distribution>> {
    let inputs: Vec<_> = cases.iter().map(Case::input).collect();
    let trees = reconstruct_batch(model, backend, &inputs)?;
    Ok(trees.into_iter().map(|t| Distribution::from_shares(t.topology, &t.node_share)).collect())
}

/// The cells that the target and a method's result have in common, for every case.
pub fn common(cases: &[Case], guides: &[Distribution]) -> Vec<Vec<CommonCell>> {
    let cells = |(case, guide): (&Case, &Distribution)| Distribution::common_cells(&case.target, &case.bsdf, guide);
    cases.par_iter().zip(guides).map(cells).collect()
}

/// Mean KL at a uniform part, nats.
pub fn mean_kl(cells: &[Vec<CommonCell>], uniform: f64) -> f64 {
    cells.par_iter().map(|c| kl_of_cells(c, uniform)).sum::<f64>() / cells.len().max(1) as f64
}

/// The uniform part, out of a logarithmic grid from 1e-3 to 0.5, at which the `score` (a mean KL or a mean log moment) is least.
pub fn tune_uniform(cells: &[Vec<CommonCell>], score: impl Fn(&[Vec<CommonCell>], f64) -> f64) -> f64 {
    let grid = (0..=20).map(|i| 1e-3 * 500f64.powf(f64::from(i) / 20.0));
    grid.map(|u| (score(cells, u), u)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.1, |(_, u)| u)
}

/// Mean logarithm of 1 + V, see [`relative_moment`], at a uniform part.
pub fn mean_log_moment(cells: &[Vec<CommonCell>], uniform: f64) -> f64 {
    cells.par_iter().map(|c| relative_moment(c, uniform).ln()).sum::<f64>() / cells.len().max(1) as f64
}

/// Mean KL that each level adds (entry 0 is level 1), in nats, at a uniform part.
pub fn levels(cases: &[Case], guides: &[Distribution], uniform: f64) -> Vec<f64> {
    let mut sums: Vec<f64> = vec![];
    for (case, guide) in cases.iter().zip(guides) {
        let levels = kl_by_level(&case.target, guide, uniform);
        sums.resize(sums.len().max(levels.len()), 0.0);
        sums.iter_mut().zip(&levels).for_each(|(sum, kl)| *sum += kl / cases.len() as f64);
    }
    sums
}
