//! Reconstruction by smoothing: the baseline that the network has to beat.
//!
//! In the spirit of Nilsson's level-wise denoising of guiding quadtrees (2022 §4.3): on every level the densities of the nodes that
//! exist there are smoothed over their 3 × 3 neighbourhood, so that coarse levels smooth far and fine levels near. Nothing is laid
//! out as a dense matrix, so there is nothing to mask either; the workload is limited by
//! [`reconstruct_within`](super::reconstruct_within). A level decides in which shares its nodes divide their parent's mass, and a
//! node trusts the counted shares the more, the more samples it has: the shares are the mean of a Dirichlet distribution whose
//! prior is the level smoothed once (which counts as [`Gaussian::near`] samples), smoothed again and again ([`Gaussian::far`]), and
//! equal shares ([`Gaussian::flat`]).

use rayon::prelude::*;

use super::Reconstructor;
use crate::base::Result;
use crate::guiding::tree::CountedTree;
use crate::guiding::tree::distribution::{Distribution, NOTHING};
use crate::guiding::tree::proposal::Proposal;
use crate::guiding::tree::topology::{NO_CHILD, Topology, around_children};

/// Parameters, tuned by evaluation on training trees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Standard deviation in cells of each level.
    pub sigma: f64,
    /// Number of samples of a node that its level smoothed once counts as.
    pub near: f64,
    /// Number of samples of a node that its level smoothed [`FAR`] times counts as.
    pub far: f64,
    /// Number of samples of a node that equal shares count as.
    pub flat: f64,
    /// Part of the uniform distribution in the result.
    pub uniform: f32,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self { sigma: 0.7, near: 16.0, far: 16.0, flat: 16.0, uniform: 0.03 }
    }
}

/// Number of times that a level is smoothed to see far.
const FAR: usize = 3;

/// Offsets of the neighbourhood in the order of a row of [`neighbours`].
const OFFSETS: [[i32; 2]; 9] = [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 0], [0, 1], [1, -1], [1, 0], [1, 1]];

impl Gaussian {
    /// Smooths a voxel's counted tree.
    pub fn smooth_tree(&self, tree: &CountedTree) -> Distribution {
        self.smooth(tree.counted, tree.voxel_features.all_samples())
    }

    /// Smooths `noisy`, which was made from `samples` samples. φ wraps; beyond a pole lies the cell across (φ + π).
    pub fn smooth(&self, noisy: &Distribution, samples: f64) -> Distribution {
        let topology = noisy.topology();
        let (neighbours, level_of) = neighbours(topology);
        let density: Vec<f64> =
            noisy.node_mass().iter().zip(&level_of).map(|(m, &l)| m * (1u64 << (2 * l)) as f64).collect();
        let weights = OFFSETS.map(|[x, y]| (-0.5 * f64::from(x * x + y * y) / self.sigma.powi(2)).exp());
        let total: f64 = weights.iter().sum();
        let weights = weights.map(|w| w / total);
        let smooth = |density: &[f64]| -> Vec<f64> {
            let around = |row: &[u32; 9]| row.iter().zip(&weights).map(|(&n, w)| w * density[n as usize]).sum();
            neighbours.iter().map(around).collect()
        };
        let near = smooth(&density);
        let far = (1..FAR).fold(near.clone(), |density, _| smooth(&density));
        let mut shares = vec![1.0f32; topology.len()];
        for node in 0..topology.len() {
            let first = topology.first_child[node];
            if first == NO_CHILD {
                continue;
            }
            let first = first as usize;
            let mass = noisy.node_mass()[node];
            let counted = samples * mass;
            let siblings = |of: &[f64]| [of[first], of[first + 1], of[first + 2], of[first + 3]];
            let all = 1.0 / (counted + self.near + self.far + self.flat);
            let mut evidence = [0.25 * self.flat; 4];
            add_shares(&mut evidence, siblings(noisy.node_mass()), counted);
            add_shares(&mut evidence, siblings(&near), self.near);
            add_shares(&mut evidence, siblings(&far), self.far);
            for (share, evidence) in shares[first..first + 4].iter_mut().zip(evidence) {
                *share = (evidence * all) as f32;
            }
        }
        Distribution::from_shares(topology.clone(), &shares)
    }
}

/// Adds `weight` times the four siblings' parts of their sum, equal parts where the sum is nothing. One division for all four: this
/// is done three times for every node of every tree.
#[inline]
fn add_shares(evidence: &mut [f64; 4], siblings: [f64; 4], weight: f64) {
    let total: f64 = siblings.iter().sum();
    let (siblings, scale) = if total > NOTHING { (siblings, weight / total) } else { ([1.0; 4], 0.25 * weight) };
    for (evidence, sibling) in evidence.iter_mut().zip(siblings) {
        *evidence += sibling * scale;
    }
}

impl Reconstructor for Gaussian {
    fn name(&self) -> &'static str {
        "gaussian"
    }

    fn rays_per_node(&self) -> f64 {
        0.1
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        Ok(trees.par_iter().map(|tree| (self.smooth_tree(tree), self.uniform).into()).collect())
    }
}

/// For every node the nodes around it on its level, itself in the middle; where that level has none, the leaf that covers the
/// place. A node's neighbours are children of its parent's neighbours, so each level follows from the one above. Also every
/// node's level.
fn neighbours(topology: &Topology) -> (Vec<[u32; 9]>, Vec<u8>) {
    let mut around = vec![[0u32; 9]; topology.len()];
    let mut level_of = vec![0u8; topology.len()];
    for level in 0..topology.levels() {
        for node in topology.level(level) {
            level_of[node] = level as u8;
        }
        for node in topology.level(level).filter(|&node| !topology.is_leaf(node)) {
            let beside = around[node];
            let first_child = topology.first_child[node] as usize;
            let slots = around_children(level, topology.cell[node]);
            for (children, slots) in around[first_child..first_child + 4].iter_mut().zip(slots) {
                for (found, &(parent, k)) in children.iter_mut().zip(slots) {
                    let row = beside[usize::from(parent)];
                    let first = topology.first_child[row as usize];
                    let deeper = first != NO_CHILD && usize::from(level_of[row as usize]) == level;
                    *found = if deeper { first + u32::from(k) } else { row };
                }
            }
        }
    }
    (around, level_of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::tree::distribution::kl;

    /// All mass in one cell at `depth`, at the corner z = −1, φ = 0.
    fn spike(depth: usize) -> Distribution {
        let split: Vec<bool> =
            std::iter::once(true).chain((0..4 * depth).map(|i| i < 4 * (depth - 1) && i % 4 == 0)).collect();
        let tree = Topology::from_split(&split).unwrap();
        let deepest = tree.len() - 4;
        let weights: Vec<f64> = tree.leaves().map(|n| if n == deepest { 1.0 } else { 0.0 }).collect();
        Distribution::from_leaf_weights(tree, &weights)
    }

    fn full(levels: usize) -> Topology {
        let inner = (4usize.pow(levels as u32) - 1) / 3;
        let split: Vec<bool> = (0..inner + 4usize.pow(levels as u32)).map(|n| n < inner).collect();
        Topology::from_split(&split).unwrap()
    }

    #[test]
    fn neighbours_wrap_and_cross_the_poles() {
        let tree = full(4);
        let (around, _) = neighbours(&tree);
        for level in 1..=4usize {
            let side = 1i64 << level;
            for node in tree.level(level) {
                let [x, y] = tree.cell[node].map(i64::from);
                for (slot, [dx, dy]) in OFFSETS.iter().enumerate() {
                    let (mut to_x, mut to_y) = (x + i64::from(*dx), y + i64::from(*dy));
                    if to_x < 0 || to_x >= side {
                        (to_x, to_y) = (to_x.clamp(0, side - 1), to_y + side / 2);
                    }
                    let expected = [to_x as u32, to_y.rem_euclid(side) as u32];
                    assert_eq!(tree.cell[around[node][slot] as usize], expected, "level {level}, {x},{y} + {dx},{dy}");
                }
            }
        }
    }

    #[test]
    fn where_a_level_ends_the_leaf_above_is_the_neighbour() {
        let d = spike(5);
        let (around, level_of) = neighbours(d.topology());
        for node in 0..d.topology().len() {
            assert_eq!(around[node][4] as usize, node);
            for &n in &around[node] {
                let n = n as usize;
                assert!(level_of[n] == level_of[node] || d.topology().is_leaf(n));
            }
        }
    }

    #[test]
    fn uniform_stays_uniform() {
        let flat = Distribution::from_leaf_weights(full(3), &[1.0; 64]);
        let smooth = Gaussian::default().smooth(&flat, 10.0);
        assert!(kl(&Distribution::uniform(), &smooth, 0.0) < 1e-9);
    }

    #[test]
    fn few_samples_are_spread_many_are_kept() {
        let noisy = Distribution::blend(&spike(6), &Distribution::from_leaf_weights(full(4), &[1.0; 256]), 0.9);
        let gaussian = Gaussian::default();
        let few = gaussian.smooth(&noisy, 8.0);
        let many = gaussian.smooth(&noisy, 1e7);
        assert!(kl(&noisy, &many, 0.0) < 1e-3);
        let mass = |d: &Distribution, cell| d.cell_mass(4, cell);
        assert!(mass(&few, [0, 0]) < 0.5 * mass(&noisy, [0, 0]));
        for beside in [[0, 1], [0, 15], [1, 0], [0, 8]] {
            assert!(mass(&few, beside) > 2.0 * mass(&noisy, beside), "{beside:?}");
        }
        assert!((few.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }
}
