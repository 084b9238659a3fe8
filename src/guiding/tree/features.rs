//! Input features of the network for each node of a counted tree.
//!
//! The tree is that of the counted distribution, which has earlier iterations, spatial context and parallax in it; the voxel's
//! own samples have a tree of their own, and inside one of its leaves they count as evenly spread. Input channels, [`FEATURES`]
//! per node:
//!
//! | channels | content |
//! |---|---|
//! | 0, 1 | counted distribution: log of the density relative to uniform, share of the parent |
//! | 2, 3 | the same smoothed, see [`gaussian`](crate::reconstruct::gaussian) |
//! | 4, 5 | sampling weight of the voxel's own path samples: log density, share |
//! | 6, 7 | of its own photons |
//! | 8, 9 | ln(1 + own samples in the node) / 8 (path, photon) |
//! | 10, 11 | the same of effective samples, (ΣV)²/ΣV² (path, photon): one firefly is one sample, however bright |
//! | 12, 13 | the BSDF's mass as path samples tell it: log density, share |
//! | 14 | cosine between the cell's centre and the voxel's mean normal |
//! | 15 | level / 20 |
//! | 16, 17 | ln(1 + own samples of the tree) / 8 (path, photon) |
//! | 18 | share of path samples in the counted distribution, the rest being photons; about a half where there is one kind alone |
//! | 19 | half of the voxel's diagonal over the distance from which its light is taken to come, see [`Parallax`](crate::guiding::cache::parallax::Parallax) |
//! | 20 | 1 where the own tree ends above the node |
//! | 21, 22 | distribution of the [`Block`] around: log density, share |
//! | 23, 24 | ln(1 + samples of the block) / 8, and of the larger one around it |
//! | 25 | ln(1 + number of samples that earlier iterations count as) / 8 |
//!
//! Zhu 2021 eq. 11 has sums of values, directions, positions, distances, normals and BSDF values, normalised by their largest;
//! those hide how many samples there were, one firefly flattens them, and without them the network is as good (see the model's
//! card). Scaling every V by a constant changes nothing.

use glam::Vec3;

use super::context::Block;
use super::distribution::Distribution;
use super::leaves::{BSDF, COUNTS, Leaves, NETWORK_CHANNELS, SQUARES, VALUES};
use super::topology::{MAX_LEVEL, NO_CHILD, Topology};
use crate::math::cylindrical::cell_centre;
use crate::math::lanes::slices;

/// Network input channels per node.
pub const FEATURES: usize = 26;
/// Logarithms of densities per node that the decoder sees again: counted, smoothed, own path samples, own photons, block.
pub const LOG_SHARES: usize = 5;

/// Bound of the logarithms of densities, which are then divided by half of it.
const LOG_LIMIT: f32 = 12.0;
/// Divisor of ln(1 + count), so that usual values are near 1.
const LOG_SCALE: f32 = 8.0;
/// Smallest share of a parent whose logarithm the network starts from.
const LEAST_SHARE: f32 = 1e-4;

/// Features of a voxel as a whole, the same for all nodes of its tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelFeatures {
    /// Numbers of path samples and of photons in its tree.
    pub samples: [u32; 2],
    /// Number of samples that earlier iterations count as.
    pub past: f32,
    /// Share of path samples in the counted distribution.
    pub path_share: f32,
    /// Mean normal of its samples, length in [0, 1]; zero in a medium.
    pub normal: Vec3,
    /// Half of the voxel's diagonal over the distance from which its light is taken to come, ≥ 0; 0 for far away.
    pub nearness: f32,
}

impl VoxelFeatures {
    /// Number of own samples, with those of earlier iterations as many as they count.
    pub fn all_samples(&self) -> f64 {
        self.samples.iter().map(|&n| f64::from(n)).sum::<f64>() + f64::from(self.past)
    }
}

impl Default for VoxelFeatures {
    fn default() -> Self {
        Self { samples: [0; 2], past: 0.0, path_share: 0.5, normal: Vec3::ZERO, nearness: 0.0 }
    }
}

/// The network's view of one tree, breadth first over its nodes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NodeInputs {
    /// [nodes, [`FEATURES`]], every value finite.
    pub features: Vec<f32>,
    /// [nodes] × [`LOG_SHARES`]. They are logarithms of densities, so a cell inside a leaf has that leaf's values.
    pub log_shares: Vec<[f32; LOG_SHARES]>,
    /// [nodes] logarithm of the smoothed share of the parent, which the network corrects.
    pub base: Vec<f32>,
}

/// Sampling weights and sums of the voxel's own samples in a node.
#[derive(Clone, Copy, Default)]
struct Own {
    weights: [f32; 2],
    sums: [f32; NETWORK_CHANNELS],
}

/// A node of another tree that holds a node of the counted tree, and the part of it that this is.
#[derive(Clone, Copy)]
struct Covering {
    node: u32,
    part: f32,
}

/// Channels of the logarithms of densities: counted, smoothed, own path samples, own photons, block, BSDF.
const DENSITIES: [usize; LOG_SHARES + 1] = [0, 2, 4, 6, 21, 12];
/// Channels of the logarithms of numbers of samples of a node.
const COUNTED: [usize; 4] = [8, 9, 10, 11];
/// Logarithms per node: those of both, and that of the smoothed share.
const LOGS: usize = DENSITIES.len() + COUNTED.len() + 1;

impl NodeInputs {
    /// Adds the inputs for a `counted` distribution, whose smoothed one has the node masses `smoothed`, with the `own` samples of the
    /// voxel in the layout [`Network`](super::leaves::Layout::Network) and the `block` around it; own samples in another layout count as
    /// none.
    pub fn add(
        &mut self,
        counted: &Distribution,
        smoothed: &[f64],
        own: &Leaves,
        block: &Block,
        voxel_features: &VoxelFeatures,
    ) {
        let topology = counted.topology();
        let own_nodes = own_nodes(own);
        let whole = own_nodes[0];
        let block_mass = block.distribution.node_mass();
        let mut covering = vec![[Covering { node: 0, part: 1.0 }; 2]; topology.len()];
        let first_new = self.features.len();
        self.features.reserve(topology.len() * FEATURES);
        let mut logs: Vec<[f32; LOGS]> = Vec::with_capacity(topology.len());
        let of_all = voxel_channels(block, voxel_features);
        for level in 0..topology.levels() {
            let cells = 4f32.powi(level as i32);
            for node in topology.level(level) {
                let parent = topology.parent[node] as usize;
                let [at, in_block] = covering[node];
                let inside = at.part < 1.0;
                let here = &own_nodes[at.node as usize];
                let above = &own_nodes[own.topology.parent[at.node as usize] as usize];
                let first = topology.first_child[node];
                if first != NO_CHILD {
                    let children = covering[first as usize..][..4].iter_mut();
                    let own = children_of(own.topology, at);
                    let block = children_of(block.distribution.topology(), in_block);
                    children.zip(own).zip(block).for_each(|((child, own), block)| *child = [own, block]);
                }
                let of_block = |at: Covering| block_mass[at.node as usize] as f32 * at.part;
                let masses = [counted.node_mass(), smoothed].map(|m| [m[node] as f32, m[parent] as f32]);
                let share_of_parent = |[part, whole]: [f32; 2]| if level == 0 { 1.0 } else { ratio(part, whole) };
                // Inside an own leaf everything is spread evenly.
                let share =
                    |part: f32, whole: f32| if inside && level > 0 { 0.25 } else { share_of_parent([part, whole]) };
                let density = |part: f32, whole: f32| ratio(part * at.part, whole) * cells;
                let [path, photon] = [0, 1].map(|kind| density(here.weights[kind], whole.weights[kind]));
                let block_part = of_block(in_block);
                let smooth_share = share_of_parent(masses[1]);
                let [path_count, photon_count] = COUNTS.map(|c| 1.0 + here.sums[c] * at.part);
                let [path_effective, photon_effective] = [0, 1].map(|kind| 1.0 + effective(here, kind) * at.part);
                logs.push([
                    masses[0][0] * cells,
                    masses[1][0] * cells,
                    path,
                    photon,
                    block_part * cells,
                    density(here.sums[BSDF], whole.sums[BSDF]),
                    path_count,
                    photon_count,
                    path_effective,
                    photon_effective,
                    smooth_share.max(LEAST_SHARE),
                ]);
                let mut row = of_all;
                row[1] = share_of_parent(masses[0]);
                row[3] = smooth_share;
                row[5] = share(here.weights[0], above.weights[0]);
                row[7] = share(here.weights[1], above.weights[1]);
                row[13] = share(here.sums[BSDF], above.sums[BSDF]);
                row[14] = Vec3::from(cell_centre(level, topology.cell[node])).dot(voxel_features.normal);
                row[15] = level as f32 / MAX_LEVEL as f32;
                row[20] = f32::from(u8::from(inside));
                row[22] = share_of_parent([block_part, of_block(covering[parent][1])]);
                self.features.extend_from_slice(&row);
            }
        }
        // All together: one by one they would be a third of what a tree costs.
        slices::ln(logs.as_flattened_mut());
        self.log_shares.reserve(logs.len());
        self.base.reserve(logs.len());
        let (rows, _) = self.features[first_new..].as_chunks_mut::<FEATURES>();
        for (row, logs) in rows.iter_mut().zip(&logs) {
            for (channel, log) in DENSITIES.into_iter().zip(logs) {
                row[channel] = bounded(*log);
            }
            for (channel, log) in COUNTED.into_iter().zip(&logs[DENSITIES.len()..]) {
                row[channel] = log / LOG_SCALE;
            }
            self.log_shares.push(std::array::from_fn(|i| row[DENSITIES[i]]));
            self.base.push(logs[LOGS - 1]);
        }
    }
}

/// A row of the channels that are the same for all nodes, the others 0.
fn voxel_channels(block: &Block, voxel_features: &VoxelFeatures) -> [f32; FEATURES] {
    let scaled = |count: f32| count.ln_1p() / LOG_SCALE;
    let mut row = [0.0; FEATURES];
    [row[16], row[17]] = voxel_features.samples.map(|n| scaled(n as f32));
    (row[18], row[19]) = (voxel_features.path_share, voxel_features.nearness.min(2.0));
    [row[23], row[24]] = block.samples.map(scaled);
    row[25] = scaled(voxel_features.past);
    row
}

/// Nodes of the other tree that cover the four children of a cell that `above` covers.
fn children_of(other: &Topology, above: Covering) -> [Covering; 4] {
    match other.first_child[above.node as usize] {
        NO_CHILD => [Covering { part: 0.25 * above.part, ..above }; 4],
        first => [0, 1, 2, 3].map(|k| Covering { node: first + k, part: 1.0 }),
    }
}

/// Sums and weights of every node of the own tree, relative to the largest of their kind.
fn own_nodes(own: &Leaves) -> Vec<Own> {
    let mut nodes = vec![Own::default(); own.topology.len()];
    if own.layout.channels() != NETWORK_CHANNELS {
        return nodes;
    }
    let weights = own.weights();
    let sums = own.topology.sum_to_root(own.sums, NETWORK_CHANNELS);
    for ((node, weights), sums) in nodes.iter_mut().zip(weights).zip(sums.chunks_exact(NETWORK_CHANNELS)) {
        // A sum of finite f32 is within the range of f64; a tree whose sums leave that of f32 has no meaningful values left.
        let usable = |x: f64| if x.is_finite() { x.clamp(0.0, f64::from(f32::MAX)) as f32 } else { 0.0 };
        *node = Own { weights: weights.map(usable), sums: std::array::from_fn(|c| usable(sums[c])) };
    }
    nodes
}

/// (ΣV)²/ΣV², at most the number of samples; 0 without any value.
fn effective(node: &Own, kind: usize) -> f32 {
    let [sum, square, count] = [VALUES[kind], SQUARES[kind], COUNTS[kind]].map(|c| f64::from(node.sums[c]));
    match () {
        () if sum <= 0.0 => 0.0,
        () if square <= 0.0 => count.min(1.0) as f32,
        () => (sum * sum / square).min(count) as f32,
    }
}

fn ratio(part: f32, whole: f32) -> f32 {
    if whole > 0.0 { (part / whole).min(1.0) } else { 0.0 }
}

/// The logarithm of a density relative to uniform, cut at ±[`LOG_LIMIT`] and divided by half of that; that of 0 counts as the least.
fn bounded(log: f32) -> f32 {
    log.clamp(-LOG_LIMIT, LOG_LIMIT) / (0.5 * LOG_LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::guiding::target::Target;
    use crate::guiding::tree::leaves::Layout;

    /// A counted tree, and own samples in a tree that is finer in one corner and coarser in another.
    fn trees(seed: u64) -> (Distribution, Topology, Vec<f32>) {
        let counted = Topology::from_split(&[
            true, false, true, false, true, false, false, false, false, false, false, false, false,
        ]);
        let own = Topology::from_split(&[
            true, true, true, false, false, false, false, false, false, false, false, false, false,
        ]);
        let (counted, own) = (counted.expect("two levels"), own.expect("two levels"));
        let mut random = Random::new(seed, 0, 0);
        let weights: Vec<f64> = counted.leaves().map(|_| random.next_f64().powi(3)).collect();
        let mut sums = Vec::new();
        for _ in own.leaves() {
            let counts = [1 + random.below(30), random.below(3)].map(|n| n as f32);
            let values = counts.map(|n| n * random.next_f32().powi(4));
            let squares = [0, 1].map(|k| values[k] * values[k] / (0.3 + 0.7 * random.next_f32()));
            sums.extend([values[0], counts[0], values[1], counts[1], squares[0], squares[1], 0.5 * counts[0]]);
        }
        (Distribution::from_leaf_weights(counted, &weights), own, sums)
    }

    fn leaves<'a>(topology: &'a Topology, sums: &'a [f32]) -> Leaves<'a> {
        Leaves { topology, sums, layout: Layout::Network, target: Target::Variance }
    }

    /// With a block whose tree is that of [`trees`] as if it were own.
    fn inputs(counted: &Distribution, own: &Leaves) -> NodeInputs {
        let voxel_features =
            VoxelFeatures { samples: [120, 8], past: 70.0, normal: Vec3::Y, ..VoxelFeatures::default() };
        let (_, topology, _) = trees(5);
        let weights: Vec<f64> = (1..).map(f64::from).take(topology.leaves().count()).collect();
        let distribution = Distribution::from_leaf_weights(topology, &weights);
        let block = Block { distribution, samples: [900.0, 5000.0] };
        let mut inputs = NodeInputs::default();
        inputs.add(counted, counted.node_mass(), own, &block, &voxel_features);
        inputs
    }

    #[test]
    fn a10_scaling_radiance_changes_nothing() {
        let (counted, own, sums) = trees(1);
        let expected = inputs(&counted, &leaves(&own, &sums)).features;
        for scale in [1e-8f32, 3.0, 1e8] {
            let mut scaled = sums.clone();
            for row in scaled.chunks_exact_mut(NETWORK_CHANNELS) {
                VALUES.iter().for_each(|&c| row[c] *= scale);
                SQUARES.iter().for_each(|&c| row[c] *= scale * scale);
            }
            let found = inputs(&counted, &leaves(&own, &scaled)).features;
            for (i, (a, b)) in expected.iter().zip(&found).enumerate() {
                assert!((a - b).abs() <= 1e-5 * a.abs().max(0.1), "feature {}: {a} {b}", i % FEATURES);
            }
        }
    }

    /// Densities integrate to one, and shares of siblings to one, also where the own tree ends above.
    #[test]
    fn densities_and_shares_are_those_of_distributions() {
        let (counted, own, sums) = trees(2);
        let made = inputs(&counted, &leaves(&own, &sums));
        let topology = counted.topology();
        for log in 0..LOG_SHARES {
            let mass = |node: usize| {
                (made.log_shares[node][log] * 0.5 * LOG_LIMIT).exp() * 0.25f32.powi(topology.level_of(node) as i32)
            };
            let total: f32 = topology.leaves().map(mass).sum();
            assert!((total - 1.0).abs() < 1e-3, "{log}: {total}");
        }
        for node in (0..topology.len()).filter(|&n| !topology.is_leaf(n)) {
            let first = topology.first_child[node] as usize;
            for share in [1, 3, 5, 7, 13, 22] {
                let total: f32 = (first..first + 4).map(|n| made.features[n * FEATURES + share]).sum();
                assert!((total - 1.0).abs() < 1e-5, "share {share} of node {node}: {total}");
            }
            let shares: f32 = (first..first + 4).map(|n| made.base[n].exp()).sum();
            assert!((shares - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn one_bright_sample_counts_as_one() {
        let topology = Topology::root();
        let sums = |values: [f32; 4]| {
            let (sum, square) = (values.iter().sum::<f32>(), values.iter().map(|v| v * v).sum::<f32>());
            [sum, 4.0, 0.0, 0.0, square, 0.0, 2.0]
        };
        let effective_of = |values| {
            let sums = sums(values);
            effective(&own_nodes(&leaves(&topology, &sums))[0], 0)
        };
        assert!((effective_of([1.0, 1e-6, 1e-6, 1e-6]) - 1.0).abs() < 1e-4);
        assert!((effective_of([0.5; 4]) - 4.0).abs() < 1e-4);
        assert_eq!(effective_of([0.0; 4]), 0.0);
    }

    #[test]
    fn a10_empty_and_overflowed_trees_are_finite() {
        let (counted, own, mut sums) = trees(3);
        sums[0] = f32::INFINITY;
        sums[NETWORK_CHANNELS] = f32::NAN;
        for sums in [vec![0.0; sums.len()], sums.clone(), vec![f32::MAX; sums.len()], vec![]] {
            let made = inputs(&counted, &leaves(&own, &sums));
            assert!(made.features.iter().all(|x| x.is_finite() && x.abs() < 100.0));
            assert!(made.log_shares.iter().flatten().chain(&made.base).all(|x| x.is_finite()));
        }
        let values = Leaves { layout: Layout::Values, ..leaves(&own, &[]) };
        assert!(inputs(&counted, &values).features.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn layout_is_as_documented() {
        let (counted, own, sums) = trees(4);
        let made = inputs(&counted, &leaves(&own, &sums));
        assert_eq!(made.features.len(), counted.topology().len() * FEATURES);
        let root = &made.features[..FEATURES];
        assert_eq!([root[0], root[1], root[15], root[20]], [0.0, 1.0, 0.0, 0.0]);
        assert!((root[16] - 120f32.ln_1p() / 8.0).abs() < 1e-6);
        // Node 9 is a child of node 4, a leaf of the own tree; its centre is at z = 0.25, φ = 9/8 π.
        let below = &made.features[9 * FEATURES..][..FEATURES];
        assert_eq!([below[15], below[20], below[5]], [0.1, 1.0, 0.25]);
        assert_eq!(below[22], 0.25, "the block's tree ends there as well");
        assert_eq!(below[23..26], [900.0f32, 5000.0, 70.0].map(|n| n.ln_1p() / 8.0));
    }
}
