//! Reconstruction by the network (Zhu 2021 §6): encode Q_h from its leaves to the root, decode Q_r from the root down.

use rayon::prelude::*;

use super::Reconstructed;
use super::gaussian::Gaussian;
use super::growth::Growth;
use crate::base::{Error, Result};
use crate::guiding::tree::CountedTree;
use crate::guiding::tree::distribution::Distribution;
use crate::guiding::tree::features::{FEATURES, NodeInputs};
use crate::guiding::tree::topology::Topology;
use crate::network::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use crate::network::batch::Batch;
use crate::network::config::Config;
use crate::network::growing::DecodeLevel;
use crate::network::weights::Model;

/// Number of nodes that are reconstructed together: enough to keep calls few, few enough that all their features stay in the cache
/// (a quarter faster than 50,000).
const BATCH_NODES: usize = 6_000;
/// Least number of nodes that a tree counts as: a small one may grow.
const TREE_NODES: usize = 400;

/// Reconstructs all trees; the result's order is that of `inputs`, and does not depend on the number of threads.
///
/// Every root is split. A decoded node is split while its leaf probability is below the configured threshold, its share of the tree
/// above the configured minimum, and its level above [`MAX_LEVEL`](crate::guiding::tree::topology::MAX_LEVEL); of more splits than
/// [`MAX_NODES`](crate::guiding::tree::topology::MAX_NODES) allow, the most energetic remain. The children's shares are the
/// expected ones, so that a doubtful split counts in proportion to its probability.
///
/// # Errors
/// [`Error::Backend`] if the backend fails or a tree's sums do not match its leaves.
pub fn reconstruct_batch(model: &Model, backend: &dyn Backend, inputs: &[CountedTree]) -> Result<Vec<Reconstructed>> {
    Ok(correct_batch(model, backend, inputs)?.into_iter().map(|(reconstructed, _)| reconstructed).collect())
}

/// Reconstructs all trees as [`reconstruct_batch`] does; returns each beside the smoothed tree that it corrects.
///
/// # Errors
/// As [`reconstruct_batch`].
pub fn correct_batch(
    model: &Model,
    backend: &dyn Backend,
    inputs: &[CountedTree],
) -> Result<Vec<(Reconstructed, Distribution)>> {
    let parts: Vec<_> = partition(inputs).par_iter().map(|part| reconstruct(&model.config, backend, part)).collect();
    let parts = parts.into_iter().collect::<Result<Vec<_>>>()?;
    Ok(parts.into_iter().flatten().collect())
}

/// Consecutive trees of about [`BATCH_NODES`] nodes; a function of the trees alone.
fn partition<'a, 'b>(inputs: &'b [CountedTree<'a>]) -> Vec<&'b [CountedTree<'a>]> {
    let (mut parts, mut start, mut nodes) = (vec![], 0, 0);
    for (i, input) in inputs.iter().enumerate() {
        nodes += input.counted.topology().len().max(TREE_NODES);
        if nodes >= BATCH_NODES || i + 1 == inputs.len() {
            parts.push(&inputs[start..=i]);
            (start, nodes) = (i + 1, 0);
        }
    }
    parts
}

fn reconstruct(
    config: &Config,
    backend: &dyn Backend,
    inputs: &[CountedTree],
) -> Result<Vec<(Reconstructed, Distribution)>> {
    let fail = |message| Error::Backend { backend: backend.name(), message };
    let encoded: Vec<_> = inputs.iter().map(|input| config.encoded(input.counted)).collect();
    let inputs: Vec<_> =
        inputs.iter().zip(&encoded).map(|(input, counted)| CountedTree { counted, ..*input }).collect();
    let topologies: Vec<&Topology> = inputs.iter().map(|input| input.counted.topology()).collect();
    let batch = Batch::new(&topologies);
    let smoothed: Vec<Distribution> = inputs.iter().map(smoothed).collect();
    let nodes = all_inputs(&inputs, &smoothed);
    let encoded = encode(config, backend, &batch, &nodes.features)?;

    let mut growth = Growth::roots(inputs.len());
    let mut above = DecodeLevel::roots(&batch);
    let mut parents = encoded.first().cloned().unwrap_or_default();
    // A root is never a leaf.
    let mut leaf = vec![0.0; inputs.len()];
    loop {
        let mut level = above.grow(&batch, growth.split());
        if level.rows.is_empty() {
            return Ok(growth.finish(fail)?.into_iter().zip(smoothed).collect());
        }
        let output = decode(config, backend, &level, &parents, encoded.get(level.level), &nodes)?;
        let share = expected_shares(&level.rows.parent, &leaf, &output.share);
        growth.add(&level.rows.tree, &level.rows.parent, &share, |row, mass| {
            config.splits(level.level, output.leaf[row], mass)
        });
        parents = output.decoded;
        // Cells of an image above its last level are no leaves, whatever an untrained part of the network says.
        leaf = if config.image.is_some() { vec![0.0; output.leaf.len()] } else { output.leaf };
        std::mem::swap(&mut above, &mut level);
    }
}

/// Expected shares (Zhu 2021 eq. 15), by which training, too, decides what is split: a parent that is a leaf with probability p gives its
/// children a quarter each with that probability. `parent` and `share` [N], `leaf` of the level above.
pub fn expected_shares(parent: &[u32], leaf: &[f32], share: &[f32]) -> Vec<f32> {
    let of = |(&parent, &share): (&u32, &f32)| 0.25 * leaf[parent as usize] + (1.0 - leaf[parent as usize]) * share;
    parent.iter().zip(share).map(of).collect()
}

/// Inputs of the network for all trees, concatenated.
fn all_inputs(inputs: &[CountedTree], smoothed: &[Distribution]) -> NodeInputs {
    let mut all = NodeInputs::default();
    for (input, smoothed) in inputs.iter().zip(smoothed) {
        add_inputs(&mut all, input, smoothed);
    }
    all
}

/// Inputs of the network for one tree.
pub fn inputs_of(input: &CountedTree) -> NodeInputs {
    let mut inputs = NodeInputs::default();
    add_inputs(&mut inputs, input, &smoothed(input));
    inputs
}

/// The tree smoothed with the default [`Gaussian`], which the network corrects.
fn smoothed(input: &CountedTree) -> Distribution {
    Gaussian::default().smooth_tree(input)
}

fn add_inputs(to: &mut NodeInputs, input: &CountedTree, smoothed: &Distribution) {
    to.add(input.counted, smoothed.node_mass(), &input.own, input.block, &input.voxel_features);
}

/// The encoder's output of every level, from the root down.
fn encode(config: &Config, backend: &dyn Backend, batch: &Batch, features: &[f32]) -> Result<Vec<Vec<f32>>> {
    let mut encoded = vec![vec![]; batch.levels.len()];
    for level in (0..batch.levels.len()).rev() {
        let below = encoded.get(level + 1).map_or(&[][..], Vec::as_slice);
        let step = EncodeInputs {
            rows: batch.len(level),
            features: &batch.gather(level, features, FEATURES),
            pooled: &batch.pool(level, below, config.width),
            neighbours: &batch.levels[level].rows.neighbours,
        };
        encoded[level] = backend.encode(level, &step)?;
    }
    Ok(encoded)
}

fn decode(
    config: &Config,
    backend: &dyn Backend,
    level: &DecodeLevel,
    parents: &[f32],
    encoded: Option<&Vec<f32>>,
    nodes: &NodeInputs,
) -> Result<DecodeOutput> {
    let step = DecodeInputs {
        rows: level.rows.len(),
        parents,
        parent_index: &level.rows.parent,
        skip: &level.skip_rows(encoded.map_or(&[], Vec::as_slice), config.width),
        geometry: &level.geometry(&nodes.log_shares),
        base: &level.base(&nodes.base),
        neighbours: &level.rows.neighbours,
    };
    backend.decode(level.level, &step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parent that is surely split gives the shares as decoded, one that is surely a leaf equal ones.
    #[test]
    fn doubtful_splits_are_halfway_to_equal_shares() {
        let decoded = [0.1, 0.2, 0.3, 0.4].repeat(3);
        let parents = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2];
        let expected = expected_shares(&parents, &[0.0, 1.0, 0.5], &decoded);
        let halfway = [0.175, 0.225, 0.275, 0.325];
        assert!(expected[..4] == decoded[..4] && expected[4..8] == [0.25; 4]);
        assert!(expected[8..].iter().zip(halfway).all(|(found, right)| (found - right).abs() < 1e-6), "{expected:?}");
    }
}
