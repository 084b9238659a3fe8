//! Reconstruction: from the quadtree that accumulated samples (Q_h) to the one that is sampled (Q_r).

pub mod buckets;
pub mod gaussian;
pub mod neural;
pub mod nilsson;
#[cfg(feature = "onnx")]
pub mod onnx;

mod built_in;
mod growth;

use std::path::Path;

use rayon::prelude::*;

use crate::base::{Error, Result};
use crate::guiding::tree::CountedTree;
use crate::guiding::tree::distribution::Distribution;
use crate::guiding::tree::leaves::Layout;
use crate::guiding::tree::proposal::Proposal;
use crate::guiding::tree::topology::Topology;
use crate::network::backend::Backend;
use crate::network::config::Mode;
use crate::network::embedded::Embedded;
use crate::network::weights::Model;

/// A reconstructed distribution.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstructed {
    /// Shape of the tree.
    pub topology: Topology,
    /// Per node its share of the parent, ≥ 0; four siblings' sum to 1 up to rounding, the root's is 1.
    pub node_share: Vec<f32>,
}

/// Makes sampling distributions of accumulated trees.
pub trait Reconstructor: Sync {
    /// Name in statistics.
    fn name(&self) -> &'static str;

    /// Cost of reconstructing one node of Q_h, in rays traced; 0 for nothing. A ray with its shading takes 0.5 to 0.7 µs of a core, a
    /// tree of 448 nodes 178 µs by the network and 15 µs by smoothing (`cargo bench --bench network`).
    fn rays_per_node(&self) -> f64;

    /// Whether trees of this iteration, counted from 0, are reconstructed at all.
    fn admits(&self, _trees: &[CountedTree], _iteration: u32) -> bool {
        true
    }

    /// One proposal per tree, in the same order.
    ///
    /// # Errors
    /// Those of the inference backend.
    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>>;
}

impl<T: Reconstructor> Reconstructor for &T {
    fn name(&self) -> &'static str {
        (**self).name()
    }

    fn rays_per_node(&self) -> f64 {
        (**self).rays_per_node()
    }

    fn admits(&self, trees: &[CountedTree], iteration: u32) -> bool {
        (**self).admits(trees, iteration)
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        (**self).reconstruct(trees)
    }
}

/// Reconstructs the trees of the voxels that contribute most to the picture, until that has cost as much as tracing `rays`
/// rays. The others are smoothed where that is much cheaper, else they stay as they were counted. Returns the proposals in the
/// order of `trees`, and the cost in rays.
///
/// # Errors
/// Those of the reconstructor.
pub fn reconstruct_within(
    rays: f64,
    trees: &[CountedTree],
    reconstructor: &dyn Reconstructor,
) -> Result<(Vec<Proposal>, f64)> {
    let nodes = |tree: &CountedTree| tree.counted.topology().len().max(LEAST_NODES) as f64;
    let cost = |tree: &CountedTree| reconstructor.rays_per_node() * nodes(tree);
    let mut order: Vec<usize> = (0..trees.len()).collect();
    order.sort_by(|&a, &b| trees[b].contribution.total_cmp(&trees[a].contribution).then(a.cmp(&b)));
    let mut spent = 0.0;
    let mut chosen = vec![false; trees.len()];
    for i in order {
        let after = spent + cost(&trees[i]);
        if after <= rays {
            (spent, chosen[i]) = (after, true);
        }
    }
    let (counted, gaussian) = (AsCounted::default(), gaussian::Gaussian::default());
    let cheaper = gaussian.rays_per_node() < 0.5 * reconstructor.rays_per_node();
    let fallback: &dyn Reconstructor = if cheaper { &gaussian } else { &counted };
    let (mut worth, mut rest) = (Vec::new(), Vec::new());
    for (tree, &chosen) in trees.iter().zip(&chosen) {
        if chosen { worth.push(*tree) } else { rest.push(*tree) }
    }
    let mut worth = reconstructor.reconstruct(&worth)?.into_iter();
    let mut rest = fallback.reconstruct(&rest)?.into_iter();
    let proposals = chosen.iter().filter_map(|&chosen| if chosen { worth.next() } else { rest.next() }).collect();
    Ok((proposals, spent))
}

/// Least number of nodes by which the cost of a tree is counted.
const LEAST_NODES: usize = 32;

/// No reconstruction: trees as counted.
#[derive(Debug, Clone, Copy)]
pub struct AsCounted {
    /// Part of the uniform distribution in the result.
    pub uniform: f32,
}

impl Default for AsCounted {
    fn default() -> Self {
        Self { uniform: 0.05 }
    }
}

impl Reconstructor for AsCounted {
    fn name(&self) -> &'static str {
        "none"
    }

    fn rays_per_node(&self) -> f64 {
        0.0
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        Ok(trees.iter().map(|tree| (tree.counted.clone(), self.uniform).into()).collect())
    }
}

/// Reconstruction by the network.
pub struct Neural {
    /// The model.
    pub model: Model,
    /// Backend that runs the model.
    pub backend: Box<dyn Backend + Send>,
}

impl Neural {
    /// The model that was compiled into the program, run by the embedded backend.
    ///
    /// # Errors
    /// [`Error::Model`] where the model is of another version than the program.
    pub fn built_in() -> Result<Self> {
        Self::with_embedded(built_in::model()?)
    }

    /// The model in `folder`, run by the embedded backend.
    ///
    /// # Errors
    /// As [`Model::load`].
    pub fn embedded(folder: &Path) -> Result<Self> {
        Self::with_embedded(Model::load(folder)?)
    }

    /// The model in `folder`, run by onnxruntime.
    ///
    /// # Errors
    /// As [`Model::load`]; [`Error::Backend`] where onnxruntime or its model files are missing or fail.
    #[cfg(feature = "onnx")]
    pub fn onnx(folder: &Path) -> Result<Self> {
        let model = Model::load(folder)?;
        Ok(Self { model, backend: Box::new(onnx::OnnxBackend::load(folder)?) })
    }

    /// The model that was compiled into the program, run by onnxruntime.
    ///
    /// # Errors
    /// As [`Neural::onnx`].
    #[cfg(feature = "onnx")]
    pub fn built_in_onnx() -> Result<Self> {
        Ok(Self { model: built_in::model()?, backend: Box::new(onnx::OnnxBackend::built_in()?) })
    }

    fn with_embedded(model: Model) -> Result<Self> {
        let backend = Box::new(Embedded::new(&model)?);
        Ok(Self { model, backend })
    }

    /// Refuses to work in a mode that the model was not trained in.
    ///
    /// # Errors
    /// [`Error::Model`] naming both modes.
    pub fn check_mode(&self, mode: &Mode) -> Result<()> {
        if self.model.config.mode == *mode {
            return Ok(());
        }
        Err(Error::Model {
            path: self.model.config.name.clone().into(),
            message: format!(
                "was trained with {:?}, but is asked to work with {mode:?}; train another model or change the options",
                self.model.config.mode
            ),
        })
    }
}

impl Reconstructor for Neural {
    fn name(&self) -> &'static str {
        "neural"
    }

    fn rays_per_node(&self) -> f64 {
        0.8
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        if trees.iter().any(|tree| tree.own.layout != Layout::Network) {
            let message = "the network needs trees with all their features".into();
            return Err(Error::Backend { backend: self.backend.name(), message });
        }
        let corrected = neural::correct_batch(&self.model, self.backend.as_ref(), trees)?;
        let proposal = |(reconstructed, smoothed): (Reconstructed, Distribution)| {
            let first = Distribution::from_shares(reconstructed.topology, &reconstructed.node_share);
            let plain = Some((smoothed, gaussian::Gaussian::default().uniform));
            Proposal { first: (first, self.model.config.uniform), plain }
        };
        Ok(corrected.into_par_iter().map(proposal).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::target::Target;
    use crate::guiding::tree::context::Block;
    use crate::guiding::tree::features::VoxelFeatures;
    use crate::guiding::tree::leaves::Leaves;

    /// Makes every tree uniform, at a price.
    struct Flat(f64);

    impl Reconstructor for Flat {
        fn name(&self) -> &'static str {
            "flat"
        }

        fn rays_per_node(&self) -> f64 {
            self.0
        }

        fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
            Ok(vec![(Distribution::uniform(), 0.5).into(); trees.len()])
        }
    }

    /// Reconstructs within `rays` three trees that contribute 1, 3 and 2: which of them are reconstructed, the uniform part of
    /// each, the cost.
    fn within(rays: f64, price: f64) -> ([bool; 3], [f32; 3], f64) {
        let topology = Topology::from_split(&[true, false, false, false, false]).unwrap();
        let (sums, block) = ([1.0, 1.0, 0.0, 0.0].repeat(4), Block::default());
        let counted = Distribution::from_leaf_weights(topology.clone(), &[0.7, 0.1, 0.1, 0.1]);
        let tree = |contribution| CountedTree {
            counted: &counted,
            own: Leaves { topology: &topology, sums: &sums, layout: Layout::Values, target: Target::Variance },
            block: &block,
            voxel_features: VoxelFeatures { samples: [4, 0], ..VoxelFeatures::default() },
            contribution,
        };
        let (made, spent) = reconstruct_within(rays, &[1.0, 3.0, 2.0].map(tree), &Flat(price)).unwrap();
        let made = [0, 1, 2].map(|i| &made[i].first);
        (made.map(|of| of.0 == Distribution::uniform()), made.map(|of| of.1), spent)
    }

    #[test]
    fn what_contributes_most_comes_first() {
        let nodes = LEAST_NODES as f64;
        let counted = AsCounted::default().uniform;
        assert_eq!(within(0.0, 0.1), ([false; 3], [counted; 3], 0.0));
        assert_eq!(within(0.1 * nodes, 0.1), ([false, true, false], [counted, 0.5, counted], 0.1 * nodes));
        assert_eq!(within(2.5 * nodes, 1.0).0, [false, true, true]);
        assert_eq!(within(f64::INFINITY, 1.0), ([true; 3], [0.5; 3], 3.0 * nodes));
        let smoothed = gaussian::Gaussian::default().uniform;
        assert_eq!(within(0.0, 5.0).1, [smoothed; 3], "smoothing is cheap beside it");
    }
}
