//! Trees to evaluate on, ready to be reconstructed by any method and compared.

use anyhow::{Result, anyhow};
use fanal::generate::shard::TreeSample;
use fanal::guiding::distribution::{CommonCell, Distribution, kl_of_cells};
use fanal::guiding::topology::Topology;
use fanal::network::backend::Backend;
use fanal::network::weights::Model;
use fanal::reconstruct::TreeInput;
use fanal::reconstruct::neural::reconstruct_batch;
use rayon::prelude::*;

/// A pair, unpacked.
#[derive(Debug, Clone)]
pub struct Case {
    /// Shape of Q_h.
    pub topology: Topology,
    /// Sums of Q_h's leaves.
    pub sums: Vec<f32>,
    /// Path samples in Q_h.
    pub path_samples: u32,
    /// Photons in Q_h.
    pub photon_samples: u32,
    /// Q_gt.
    pub target: Distribution,
    /// KL between two halves of Q_gt.
    pub floor: f64,
}

impl Case {
    /// Unpacks a valid pair.
    ///
    /// # Errors
    /// When its trees are not valid.
    pub fn new(sample: &TreeSample) -> Result<Self> {
        let weights: Vec<f64> = sample.target.iter().map(|&m| f64::from(m)).collect();
        let target = sample.target_topology().map_err(|e| anyhow!("target tree: {e}"))?;
        Ok(Self {
            topology: sample.input_topology().map_err(|e| anyhow!("input tree: {e}"))?,
            sums: sample.input_sums.clone(),
            path_samples: sample.path_samples,
            photon_samples: sample.photon_samples,
            target: Distribution::from_leaf_weights(target, &weights),
            floor: f64::from(sample.floor_kl),
        })
    }
}

/// At most `limit` of the samples, evenly spread, unpacked.
///
/// # Errors
/// As [`Case::new`].
pub fn spread(samples: &[TreeSample], limit: usize) -> Result<Vec<Case>> {
    let stride = samples.len().div_ceil(limit.max(1)).max(1);
    samples.iter().step_by(stride).map(Case::new).collect()
}

/// What the network makes of the cases.
///
/// # Errors
/// Those of [`reconstruct_batch`].
pub fn reconstruct(model: &Model, backend: &dyn Backend, cases: &[Case]) -> Result<Vec<Distribution>> {
    let inputs: Vec<_> = cases.iter().map(|c| TreeInput { topology: &c.topology, leaf_sums: &c.sums }).collect();
    let trees = reconstruct_batch(model, backend, &inputs)?;
    Ok(trees.into_iter().map(|t| Distribution::from_shares(t.topology, &t.node_share)).collect())
}

/// For every case the cells that its target and a method's result have in common.
pub fn common(cases: &[Case], guides: &[Distribution]) -> Vec<Vec<CommonCell>> {
    cases.par_iter().zip(guides).map(|(case, guide)| Distribution::common_cells(&case.target, guide)).collect()
}

/// Mean KL at a uniform part.
pub fn mean_kl(cells: &[Vec<CommonCell>], uniform: f64) -> f64 {
    cells.par_iter().map(|c| kl_of_cells(c, uniform)).sum::<f64>() / cells.len().max(1) as f64
}

/// The uniform part, out of a logarithmic grid from 1e-3 to 0.5, with the lowest mean KL.
pub fn tune_uniform(cells: &[Vec<CommonCell>]) -> f64 {
    let grid = (0..=20).map(|i| 1e-3 * 500f64.powf(f64::from(i) / 20.0));
    grid.map(|u| (mean_kl(cells, u), u)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.1, |(_, u)| u)
}
