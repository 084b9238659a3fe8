//! Training pairs laid out on the host for one step, so that a background thread can prepare them.

use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::features::{FEATURES, LOG_SHARES, NodeInputs};
use fanal::guiding::tree::topology::NO_CHILD;
use fanal::network::batch::{Batch, NONE};
use fanal::network::config::Config;
use fanal::reconstruct::neural::inputs_of;
use rayon::prelude::*;

use crate::cases::Case;

/// Several pairs, merged level by level.
#[derive(Debug, Clone)]
pub struct HostBatch {
    /// The input trees.
    pub input: Batch,
    /// Per level of the input [N, [`FEATURES`]].
    pub features: Vec<Vec<f32>>,
    /// Log-shares of all input nodes, trees concatenated.
    pub log_shares: Vec<[f32; LOG_SHARES]>,
    /// Logarithms of the smoothed shares of all input nodes.
    pub base: Vec<f32>,
    /// The converged trees.
    pub target: Targets,
}

/// The converged trees of a batch, concatenated.
#[derive(Debug, Clone, Default)]
pub struct Targets {
    /// Per node the concatenated index of its first child, or [`NONE`].
    pub first_child: Vec<u32>,
    /// Per node its share of the tree.
    pub mass: Vec<f32>,
    /// Per node its mass in the distribution of BSDF sampling.
    pub bsdf: Vec<f32>,
    /// Per tree the index of its root.
    pub root: Vec<u32>,
}

/// One pair, prepared for a batch.
struct Prepared {
    case: Case,
    inputs: NodeInputs,
}

fn prepare(sample: &TreeSample, config: &Config) -> Result<Prepared, String> {
    let case = Case::new(sample).map_err(|e| e.to_string())?;
    let case = Case { counted: config.encoded(&case.counted).into_owned(), ..case };
    Ok(Prepared { inputs: inputs_of(&case.input()), case })
}

impl HostBatch {
    /// Lays out `samples` for a network of this configuration, in parallel.
    ///
    /// # Errors
    /// A sentence if a sample is not valid.
    pub fn new(samples: &[TreeSample], config: &Config) -> Result<Self, String> {
        let prepared: Vec<Prepared> =
            samples.par_iter().map(|sample| prepare(sample, config)).collect::<Result<_, _>>()?;
        let input = Batch::new(&prepared.iter().map(|p| p.case.counted.topology()).collect::<Vec<_>>());
        let per_node: Vec<f32> = prepared.iter().flat_map(|p| &p.inputs.features).copied().collect();
        let features = (0..input.levels.len()).map(|level| input.gather(level, &per_node, FEATURES)).collect();
        let log_shares = prepared.iter().flat_map(|p| &p.inputs.log_shares).copied().collect();
        let base = prepared.iter().flat_map(|p| &p.inputs.base).copied().collect();
        let mut target = Targets::default();
        prepared.iter().for_each(|p| target.push(&p.case.target, &p.case.bsdf));
        Ok(Self { input, features, log_shares, base, target })
    }

    /// Number of trees.
    pub fn trees(&self) -> usize {
        self.input.trees()
    }
}

impl Targets {
    /// Appends a converged tree and the distribution of BSDF sampling, which is on the same tree.
    fn push(&mut self, tree: &Distribution, bsdf: &Distribution) {
        let start = self.mass.len() as u32;
        self.root.push(start);
        self.mass.extend(tree.node_mass().iter().map(|&m| m as f32));
        self.bsdf.extend(bsdf.node_mass().iter().map(|&m| m as f32));
        let children = tree.topology().first_child.iter();
        self.first_child.extend(children.map(|&c| if c == NO_CHILD { NONE } else { start + c }));
    }
}

/// Positions of the rows of a decoded level in the converged trees.
#[derive(Debug, Clone, Default)]
pub struct Aligned {
    /// Per row the converged node of the same cell, or [`NONE`] below the converged tree's leaves.
    pub node: Vec<u32>,
    /// Per row the converged mass of its cell; below a leaf its part of the leaf.
    pub mass: Vec<f32>,
    /// Per row the mass of its cell under BSDF sampling, likewise.
    pub bsdf: Vec<f32>,
    /// Per row how many levels it lies below a converged leaf.
    pub below: Vec<u8>,
}

impl Aligned {
    /// The alignment of the roots of all trees.
    pub fn roots(targets: &Targets) -> Self {
        let trees = targets.root.len();
        Self { node: targets.root.clone(), mass: vec![1.0; trees], bsdf: vec![1.0; trees], below: vec![0; trees] }
    }

    /// Whether the converged tree divides the cell of `row`.
    pub fn has_children(&self, targets: &Targets, row: usize) -> bool {
        self.node[row] != NONE && targets.first_child[self.node[row] as usize] != NONE
    }

    /// The alignment of the level below, whose rows have these parents; siblings are adjacent in fours.
    pub fn children(&self, targets: &Targets, parents: &[u32]) -> Self {
        let mut next = Self::default();
        for (row, &parent) in parents.iter().enumerate() {
            let parent = parent as usize;
            if self.has_children(targets, parent) {
                let node = targets.first_child[self.node[parent] as usize] + row as u32 % 4;
                next.node.push(node);
                next.mass.push(targets.mass[node as usize]);
                next.bsdf.push(targets.bsdf[node as usize]);
                next.below.push(0);
            } else {
                next.node.push(NONE);
                next.mass.push(0.25 * self.mass[parent]);
                next.bsdf.push(0.25 * self.bsdf[parent]);
                next.below.push(self.below[parent] + 1);
            }
        }
        next
    }
}
