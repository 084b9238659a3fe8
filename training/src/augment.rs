//! Exact symmetries of the cylindrical map, applied to training pairs.
//!
//! φ + π, φ → −φ and z → −z map cells of every level to cells of the same level, so a quadtree and its sums transform without
//! being sampled again. Together they make eight elements; a rotation by any other angle would cut through cells. Inputs without
//! path samples or without photons are in the data, and energies have no scale in the trees.

use fanal::base::random::Random;
use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::features::VoxelFeatures;
use fanal::guiding::tree::leaves::NETWORK_CHANNELS;
use fanal::guiding::tree::topology::{NO_CHILD, Topology};
use glam::Vec3;

/// One of the eight symmetries: bit 0 is φ + π, bit 1 is φ → −φ, bit 2 is z → −z. All are involutions and commute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symmetry(pub u8);

/// All eight symmetries.
pub const ALL: [Symmetry; 8] =
    [Symmetry(0), Symmetry(1), Symmetry(2), Symmetry(3), Symmetry(4), Symmetry(5), Symmetry(6), Symmetry(7)];

impl Symmetry {
    /// Whether each axis (x, y, z) changes sign.
    pub fn flips(self) -> [bool; 3] {
        let [half_turn, mirror_phi, mirror_z] = [0, 1, 2].map(|bit| self.0 >> bit & 1 == 1);
        // φ + π negates x and y; −φ negates y.
        [half_turn, half_turn ^ mirror_phi, mirror_z]
    }

    /// Index of the old child that lies where child `k` of a node at `level` is in the new tree: x runs along z, y along φ, and
    /// half a turn changes only the topmost bit of y.
    fn child(self, level: usize, k: usize) -> usize {
        let phi = (self.0 >> 1 & 1) ^ if level == 0 { self.0 & 1 } else { 0 };
        k ^ usize::from(self.0 >> 2 & 1) ^ usize::from(phi) << 1
    }

    /// The transformed sample: every quantity in it, the target too.
    ///
    /// # Errors
    /// A sentence if the sample is not valid.
    pub fn apply(self, sample: &TreeSample) -> Result<TreeSample, String> {
        let (own_split, own_leaves) = self.permute(&Topology::from_split(&sample.own_split)?);
        let (counted_split, counted_leaves) = self.permute(&Topology::from_split(&sample.counted_split)?);
        let (block_split, block_leaves) = self.permute(&Topology::from_split(&sample.block_split)?);
        let (target_split, target_leaves) = self.permute(&Topology::from_split(&sample.target_split)?);
        let own = |leaf: usize| &sample.own_sums[leaf * NETWORK_CHANNELS..][..NETWORK_CHANNELS];
        let pick = |from: &[f32], leaves: &[usize]| leaves.iter().map(|&leaf| from[leaf]).collect();
        let flips = self.flips();
        let mut bounds = sample.bounds;
        for axis in (0..3).filter(|&a| flips[a]) {
            (bounds[axis], bounds[axis + 3]) = (-sample.bounds[axis + 3], -sample.bounds[axis]);
        }
        let signs = Vec3::from(flips.map(|flip| if flip { -1.0 } else { 1.0 }));
        Ok(TreeSample {
            bounds,
            own_sums: own_leaves.iter().flat_map(|&leaf| own(leaf)).copied().collect(),
            own_split,
            counted: pick(&sample.counted, &counted_leaves),
            counted_split,
            block: pick(&sample.block, &block_leaves),
            block_split,
            voxel_features: VoxelFeatures { normal: sample.voxel_features.normal * signs, ..sample.voxel_features },
            target: pick(&sample.target, &target_leaves),
            target_bsdf: pick(&sample.target_bsdf, &target_leaves),
            target_split,
            ..*sample
        })
    }

    /// The new tree's split flags, and for each of its leaves the rank of the old leaf.
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

/// A random symmetry.
///
/// # Errors
/// A sentence if the sample is not valid.
pub fn augment(sample: &TreeSample, random: &mut Random) -> Result<TreeSample, String> {
    ALL[random.below(8) as usize].apply(sample)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::Case;
    use crate::synthetic::{Settings, tree_sample};
    use fanal::guiding::tree::features::FEATURES;
    use fanal::reconstruct::neural::inputs_of;

    /// A sample with the block of another one.
    fn sample(seed: u64) -> TreeSample {
        let [sample, other] = [0, 1].map(|index| tree_sample(&Settings::default(), seed, index));
        TreeSample { block_split: other.counted_split, block: other.counted, block_samples: [300.0, 900.0], ..sample }
    }

    #[test]
    fn twice_is_the_identity() {
        let sample = sample(5);
        for symmetry in ALL {
            assert_eq!(symmetry.apply(&symmetry.apply(&sample).unwrap()).unwrap(), sample, "{symmetry:?}");
        }
    }

    /// Every feature of a node equals that of the node it came from: the network's input has no preferred frame but the map's.
    #[test]
    fn features_transform_with_their_cells() {
        let sample = sample(7);
        let before = Case::new(&sample).unwrap();
        let features = inputs_of(&before.input()).features;
        for symmetry in ALL {
            let after = Case::new(&symmetry.apply(&sample).unwrap()).unwrap();
            let moved = inputs_of(&after.input()).features;
            // Node for node: walk both trees together.
            let (old_tree, new_tree) = (before.counted.topology(), after.counted.topology());
            let mut pairs = vec![(0usize, 0usize, 0usize)];
            while let Some((new, old, level)) = pairs.pop() {
                for channel in 0..FEATURES {
                    let (a, b) = (moved[new * FEATURES + channel], features[old * FEATURES + channel]);
                    // The direction of a whole level's centre is no direction at the root.
                    let centre = channel == 14 && level == 0;
                    assert!(centre || (a - b).abs() < 1e-3, "{symmetry:?} {channel}: {a} {b}");
                }
                if !new_tree.is_leaf(new) {
                    let (new, old) = (new_tree.first_child[new] as usize, old_tree.first_child[old] as usize);
                    pairs.extend((0..4).map(|k| (new + k, old + symmetry.child(level, k), level + 1)));
                }
            }
        }
    }
}
