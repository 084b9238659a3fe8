//! Exact symmetries of the cylindrical map, applied to training pairs, and other changes that keep a pair true.
//!
//! φ + π, φ → −φ and z → −z map cells of every level to cells of the same level, so a quadtree and its sums transform without
//! being sampled again. Together they make eight elements; a rotation by any other angle would cut through cells.

use fanal::base::random::Random;
use fanal::generate::shard::TreeSample;
use fanal::guiding::features::{PATH_CHANNELS, RAW_CHANNELS};
use fanal::guiding::topology::{NO_CHILD, Topology};

/// One of the eight symmetries: bit 0 is φ + π, bit 1 is φ → −φ, bit 2 is z → −z. All are involutions and commute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symmetry(pub u8);

/// All eight.
pub const ALL: [Symmetry; 8] =
    [Symmetry(0), Symmetry(1), Symmetry(2), Symmetry(3), Symmetry(4), Symmetry(5), Symmetry(6), Symmetry(7)];

/// First channels of vectors (direction, normal, next normal) and of the position within a kind of sample, and its count.
const VECTORS: [usize; 3] = [1, 8, 11];
const POSITION: usize = 4;
const COUNT: usize = 14;

impl Symmetry {
    /// Whether each axis (x, y, z) changes sign.
    pub fn flips(self) -> [bool; 3] {
        let [half_turn, mirror_phi, mirror_z] = [0, 1, 2].map(|bit| self.0 >> bit & 1 == 1);
        // φ + π negates x and y; −φ negates y.
        [half_turn, half_turn ^ mirror_phi, mirror_z]
    }

    /// Which old child lies where child `k` of a node at `level` is in the new tree: x runs along z, y along φ, and half a turn
    /// changes only the topmost bit of y.
    fn child(self, level: usize, k: usize) -> usize {
        let phi = (self.0 >> 1 & 1) ^ if level == 0 { self.0 & 1 } else { 0 };
        k ^ usize::from(self.0 >> 2 & 1) ^ usize::from(phi) << 1
    }

    /// The transformed sample; every quantity in it, the target too.
    pub fn apply(self, sample: &TreeSample) -> Result<TreeSample, String> {
        let (input_split, input_leaves) = self.permute(&sample.input_topology()?);
        let (target_split, target_leaves) = self.permute(&sample.target_topology()?);
        let flips = self.flips();
        let mut input_sums = Vec::with_capacity(sample.input_sums.len());
        for leaf in input_leaves {
            let mut row: [f32; RAW_CHANNELS] = std::array::from_fn(|c| sample.input_sums[leaf * RAW_CHANNELS + c]);
            flip_sums(&mut row, flips);
            input_sums.extend(row);
        }
        let mut bounds = sample.bounds;
        for axis in (0..3).filter(|&a| flips[a]) {
            (bounds[axis], bounds[axis + 3]) = (-sample.bounds[axis + 3], -sample.bounds[axis]);
        }
        let target = target_leaves.into_iter().map(|leaf| sample.target[leaf]).collect();
        Ok(TreeSample { bounds, input_split, input_sums, target_split, target, ..sample.clone() })
    }

    /// The new tree's flags, and for each of its leaves the rank of the old leaf.
    fn permute(self, tree: &Topology) -> (Vec<bool>, Vec<usize>) {
        let mut rank = vec![0; tree.len()];
        tree.leaves().enumerate().for_each(|(i, leaf)| rank[leaf] = i);
        let (mut split, mut leaves) = (Vec::with_capacity(tree.len()), vec![]);
        let mut nodes = vec![0usize];
        for level in 0..tree.levels() {
            let mut below = vec![];
            for node in nodes {
                let first = tree.first_child[node];
                split.push(first != NO_CHILD);
                if first == NO_CHILD {
                    leaves.push(rank[node]);
                } else {
                    below.extend((0..4).map(|k| first as usize + self.child(level, k)));
                }
            }
            nodes = below;
        }
        (split, leaves)
    }
}

/// Negates components of vector sums; a position sum Σp in [0, 1] becomes Σ(1 − p).
fn flip_sums(row: &mut [f32; RAW_CHANNELS], flips: [bool; 3]) {
    for kind in [0, PATH_CHANNELS] {
        for axis in (0..3).filter(|&a| flips[a]) {
            VECTORS.iter().for_each(|vector| row[kind + vector + axis] *= -1.0);
            row[kind + POSITION + axis] = row[kind + COUNT] - row[kind + POSITION + axis];
        }
    }
}

/// How often a sample loses all photons, or all path samples, so that the network serves scenes without one of them.
const DROP: f32 = 0.05;

/// A random symmetry, rarely without one kind of sample, and at a random scale of energy (which changes nothing but rounding).
///
/// # Errors
/// A sentence if the sample is not valid.
pub fn augment(sample: &TreeSample, random: &mut Random) -> Result<TreeSample, String> {
    let mut sample = ALL[random.below(8) as usize].apply(sample)?;
    let [which, scale] = random.next_2d();
    if which < DROP && sample.path_samples > 0 {
        drop_kind(&mut sample, PATH_CHANNELS..RAW_CHANNELS);
        sample.photon_samples = 0;
    } else if which > 1.0 - DROP && sample.photon_samples > 0 {
        drop_kind(&mut sample, 0..PATH_CHANNELS);
        sample.path_samples = 0;
    }
    let scale = 10f32.powf(4.0 * scale - 2.0);
    for row in sample.input_sums.chunks_exact_mut(RAW_CHANNELS) {
        // A sum near the largest f32 would overflow.
        row[0] = (row[0] * scale).min(f32::MAX);
        row[PATH_CHANNELS] = (row[PATH_CHANNELS] * scale).min(f32::MAX);
    }
    Ok(sample)
}

/// Empties the channels of one kind of sample in every leaf.
pub fn drop_kind(sample: &mut TreeSample, channels: std::ops::Range<usize>) {
    sample.input_sums.chunks_exact_mut(RAW_CHANNELS).for_each(|row| row[channels.clone()].fill(0.0));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Settings, tree_sample};
    use fanal::guiding::features::{FEATURES, node_features};

    /// Channels of the features that hold a component of a vector or of a mean position: (channel, axis).
    fn signed_channels() -> Vec<(usize, usize)> {
        let vectors = |first: usize| (0..3).map(move |axis| (first + axis, axis));
        let raw = [0, PATH_CHANNELS].into_iter().flat_map(|kind| VECTORS.map(|v| kind + v));
        let means = [31, 38].into_iter().flat_map(|kind| [kind, kind + 4]);
        raw.chain(means).flat_map(vectors).collect()
    }

    #[test]
    fn twice_is_the_identity() {
        let sample = tree_sample(&Settings::default(), 5, 0);
        for symmetry in ALL {
            let twice = symmetry.apply(&symmetry.apply(&sample).unwrap()).unwrap();
            assert_eq!(twice.input_split, sample.input_split);
            assert_eq!(twice.target, sample.target);
            assert_eq!(twice.bounds, sample.bounds);
            for (a, b) in twice.input_sums.iter().zip(&sample.input_sums) {
                assert!((a - b).abs() <= 1e-5 * a.abs().max(1.0), "{symmetry:?}: {a} {b}");
            }
        }
    }

    /// Directions of the leaf sums must still lie in their cells: Σω of a leaf points into the leaf.
    #[test]
    fn directions_stay_in_their_cells() {
        let sample = tree_sample(&Settings::default(), 6, 0);
        for symmetry in ALL {
            let moved = symmetry.apply(&sample).unwrap();
            let tree = moved.input_topology().unwrap();
            for (row, leaf) in moved.input_sums.chunks_exact(RAW_CHANNELS).zip(tree.leaves()) {
                let level = (0..).find(|&l| tree.level(l).contains(&leaf)).unwrap();
                let side = 0.5f32.powi(level as i32);
                if row[COUNT] == 0.0 || level < 3 {
                    continue;
                }
                let z = (row[3] / row[COUNT] + 1.0) / 2.0;
                let phi = row[2].atan2(row[1]).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
                let at = [z / side, phi / side].map(|u| u - 0.5);
                for (u, cell) in at.into_iter().zip(tree.cell[leaf]) {
                    assert!((u - cell as f32).abs() < 0.51, "{symmetry:?} {u} {cell}");
                }
            }
        }
    }

    #[test]
    fn features_transform_with_their_cells() {
        let sample = tree_sample(&Settings::default(), 7, 0);
        let before = sample.input_topology().unwrap();
        let features = node_features(&before, &sample.input_sums);
        let signed = signed_channels();
        for symmetry in ALL {
            let moved = symmetry.apply(&sample).unwrap();
            let after = moved.input_topology().unwrap();
            let moved_features = node_features(&after, &moved.input_sums);
            // Node for node: walk both trees together.
            let mut pairs = vec![(0usize, 0usize, 0usize)];
            while let Some((new, old, level)) = pairs.pop() {
                for channel in 0..FEATURES {
                    let (a, b) = (moved_features[new * FEATURES + channel], features[old * FEATURES + channel]);
                    let axis = signed.iter().find(|(c, _)| *c == channel).map(|&(_, axis)| axis);
                    // Normalised position sums change their maximum under 1 − p; their means are checked instead.
                    let position =
                        [0, PATH_CHANNELS].iter().any(|k| (k + POSITION..k + POSITION + 3).contains(&channel));
                    let sign = if axis.is_some_and(|axis| symmetry.flips()[axis]) { -1.0 } else { 1.0 };
                    assert!(position || (a - sign * b).abs() < 1e-3, "{symmetry:?} {channel}: {a} {b}");
                }
                if !after.is_leaf(new) {
                    let (new, old) = (after.first_child[new] as usize, before.first_child[old] as usize);
                    pairs.extend((0..4).map(|k| (new + k, old + symmetry.child(level, k), level + 1)));
                }
            }
        }
    }
}
