//! Reconstruction by denoising on dense matrices, as Nilsson 2022 does (*Hierarchical Reconstruction of Quadtree-Based Approximations of
//! Incident Radiance*, ch. 4).
//!
//! Each level of a tree from the sixth on is laid out as a matrix of densities, convolved with a Gaussian of 7 × 7 elements, outside of
//! which there is nothing, and the largest of all levels' densities is taken at each place. Of these a tree is made whose leaves hold at most 1 %
//! of all, as far as the matrix goes.

use rayon::prelude::*;

use super::{AsCounted, Reconstructor};
use crate::base::Result;
use crate::guiding::tree::CountedTree;
use crate::guiding::tree::distribution::Distribution;
use crate::guiding::tree::proposal::Proposal;
use crate::guiding::tree::topology::{MAX_NODES, Topology};

/// First level that is denoised (§4.1), and the last one of trees that are (§4.1, with workload limiting).
const LEVELS: [usize; 2] = [6, 10];
/// Elements of the kernel to either side of the middle.
const REACH: usize = 3;
/// Standard deviation of the kernel in elements; scenes are best with 0.3 to 1.2 (fig. 5.2), their example has this.
const SIGMA: f64 = 0.8;
/// Share of the whole that a leaf holds at most (§4.2).
const SHARE: f64 = 0.01;
/// Elements of all matrices of iteration 0 above which nothing is denoised; twice as many in each iteration (§4.5).
const WORKLOAD: f64 = 1.5e7;

/// See the module.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nilsson;

impl Reconstructor for Nilsson {
    fn name(&self) -> &'static str {
        "nilsson"
    }

    /// Nothing: the workload is limited by their rule.
    fn rays_per_node(&self) -> f64 {
        0.0
    }

    fn admits(&self, trees: &[CountedTree], iteration: u32) -> bool {
        let work: f64 = trees.iter().map(|tree| elements(tree.counted)).sum();
        work <= WORKLOAD * f64::from(iteration).exp2()
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        let uniform = AsCounted::default().uniform;
        Ok(trees.par_iter().map(|tree| (denoised(tree.counted), uniform).into()).collect())
    }
}

/// Levels of a tree that are denoised.
fn levels(of: &Distribution) -> std::ops::RangeInclusive<usize> {
    let deepest = of.topology().levels() - 1;
    // An empty range for trees that are too deep, as for those that are not deep enough.
    LEVELS[0]..=if deepest > LEVELS[1] { 0 } else { deepest }
}

/// Elements of the matrices that are convolved for a tree.
fn elements(of: &Distribution) -> f64 {
    levels(of).map(|level| 4f64.powi(level as i32)).sum()
}

/// The tree denoised; the same where it is too flat or too deep.
fn denoised(counted: &Distribution) -> Distribution {
    let levels = levels(counted);
    if levels.is_empty() {
        return counted.clone();
    }
    let deepest = *levels.end();
    let mut most = vec![0.0f32; 1 << (2 * deepest)];
    for level in levels {
        let smooth = convolved(matrix(counted, level), 1 << level);
        let (side, shift) = (1usize << deepest, deepest - level);
        for (y, row) in most.chunks_mut(side).enumerate() {
            let from = &smooth[(y >> shift) << level..];
            row.iter_mut().enumerate().for_each(|(x, most)| *most = most.max(from[x >> shift]));
        }
    }
    rebuilt(&most, deepest)
}

/// Densities of a level, rows of constant φ, relative to the uniform one. A node with children has the mean of its subtree's leaves were all as
/// deep as the deepest: its sum over 4^depth (§4.1), so that peaks that are known better below are not spread here.
fn matrix(of: &Distribution, level: usize) -> Vec<f32> {
    let (topology, side) = (of.topology(), 1usize << level);
    let below = depths(topology);
    let mut matrix = vec![0.0; side * side];
    for depth in 0..=level.min(topology.levels() - 1) {
        for node in topology.level(depth).filter(|&node| depth == level || topology.is_leaf(node)) {
            let density = of.node_mass()[node] * 4f64.powi(depth as i32 - i32::from(below[node]));
            let [x, y] = topology.cell[node].map(|of| (of as usize) << (level - depth));
            let width = 1usize << (level - depth);
            for row in matrix.chunks_mut(side).skip(y).take(width) {
                row[x..x + width].fill(density as f32);
            }
        }
    }
    matrix
}

/// Levels below each node.
fn depths(topology: &Topology) -> Vec<u8> {
    let mut depths = vec![0u8; topology.len()];
    for node in (1..topology.len()).rev() {
        let parent = topology.parent[node] as usize;
        depths[parent] = depths[parent].max(depths[node] + 1);
    }
    depths
}

/// A square matrix with `side` columns convolved with the kernel, which is a product of a row and a column.
fn convolved(mut matrix: Vec<f32>, side: usize) -> Vec<f32> {
    let weight = |i: usize| (-0.5 * ((i as f64 - REACH as f64) / SIGMA).powi(2)).exp();
    let total: f64 = (0..=2 * REACH).map(weight).sum();
    let kernel: [f32; 2 * REACH + 1] = std::array::from_fn(|i| (weight(i) / total) as f32);
    let mut padded = vec![0.0f32; side + 2 * REACH];
    for row in matrix.chunks_mut(side) {
        padded[REACH..REACH + side].copy_from_slice(row);
        for (x, value) in row.iter_mut().enumerate() {
            *value = kernel.iter().zip(&padded[x..]).map(|(k, v)| k * v).sum();
        }
    }
    let mut result = vec![0.0f32; matrix.len()];
    for y in 0..side {
        for (i, k) in kernel.iter().enumerate() {
            let Some(from) = (y + i).checked_sub(REACH).filter(|&from| from < side) else { continue };
            let (to, from) = (&mut result[y * side..][..side], &matrix[from * side..][..side]);
            to.iter_mut().zip(from).for_each(|(to, from)| *to += k * from);
        }
    }
    result
}

/// The tree of the densities of a level, nodes with more than [`SHARE`] of the whole being divided.
fn rebuilt(densities: &[f32], level: usize) -> Distribution {
    // Sums of each level's cells, from the deepest up.
    let mut sums = vec![densities.iter().map(|&density| f64::from(density)).collect::<Vec<f64>>()];
    for level in (0..level).rev() {
        let (side, fine) = (1usize << level, &sums[sums.len() - 1]);
        let four = |x: usize, y: usize| {
            let at = 4 * side * y + 2 * x;
            fine[at] + fine[at + 1] + fine[at + 2 * side] + fine[at + 2 * side + 1]
        };
        sums.push((0..side * side).map(|i| four(i % side, i / side)).collect());
    }
    sums.reverse();
    let total = sums[0][0];
    let mass = |(depth, [x, y]): (usize, [usize; 2])| sums[depth][(y << depth) + x];
    let splits = |node: &(usize, [usize; 2])| node.0 < level && mass(*node) > SHARE * total;
    let children = |&(depth, [x, y]): &(usize, [usize; 2])| {
        std::array::from_fn(|k| (depth + 1, [2 * x + (k & 1), 2 * y + (k >> 1)]))
    };
    let topology = Topology::grown((0, [0, 0]), MAX_NODES, splits, children);
    let leaf = |node: usize| mass((topology.level_of(node), topology.cell[node].map(|of| of as usize)));
    let weights: Vec<f64> = topology.leaves().map(leaf).collect();
    Distribution::from_leaf_weights(topology, &weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// A tree whose leaf around a place is at `depth`, with most of the light there.
    fn peaked(depth: usize, place: [u32; 2]) -> Distribution {
        let splits = |&(level, [x, y]): &(usize, [u32; 2])| {
            level < 2 || level < depth && [x, y] == place.map(|of| of >> (depth - level))
        };
        let children = |&(level, [x, y]): &(usize, [u32; 2])| {
            [0, 1, 2, 3].map(|k| (level + 1, [2 * x + (k & 1), 2 * y + (k >> 1)]))
        };
        let topology = Topology::grown((0, [0, 0]), MAX_NODES, splits, children);
        let weight =
            |node: usize| if topology.level_of(node) == depth && topology.cell[node] == place { 30.0 } else { 1.0 };
        let weights: Vec<f64> = topology.leaves().map(weight).collect();
        Distribution::from_leaf_weights(topology, &weights)
    }

    /// The kernel is that of all 49 elements, with nothing outside.
    #[test]
    fn convolution_is_the_sum_over_the_neighbourhood() {
        let (side, mut random) = (64usize, Random::new(1, 0, 0));
        let noise: Vec<f32> = (0..side * side).map(|_| random.next_f32()).collect();
        let found = convolved(noise.clone(), side);
        let gauss = |i: i64| (-0.5 * (i as f64 / SIGMA).powi(2)).exp();
        let total: f64 = (-3..=3).map(gauss).sum::<f64>().powi(2);
        for [x, y] in [[0, 0], [63, 1], [30, 40], [2, 63], [61, 62]] {
            let mut sum = 0.0;
            for (dx, dy) in (-3..=3i64).flat_map(|dx| (-3..=3i64).map(move |dy| (dx, dy))) {
                let (i, j) = (x + dx, y + dy);
                if (0..side as i64).contains(&i) && (0..side as i64).contains(&j) {
                    sum += gauss(dx) * gauss(dy) / total * f64::from(noise[(j as usize) * side + i as usize]);
                }
            }
            assert!((f64::from(found[y as usize * side + x as usize]) - sum).abs() < 1e-6, "{x}, {y}");
        }
    }

    /// Densities of the deepest level are those of the tree; above it, a subtree counts as thinned out over its depth.
    #[test]
    fn matrices_have_the_densities_of_the_tree() {
        let tree = peaked(8, [100, 30]);
        let (fine, coarse) = (matrix(&tree, 8), matrix(&tree, 6));
        let mean = |of: &[f32]| of.iter().map(|&of| f64::from(of)).sum::<f64>() / of.len() as f64;
        assert!((mean(&fine) - 1.0).abs() < 1e-6, "{}", mean(&fine));
        for [x, y] in [[100u32, 30], [0, 0], [101, 30], [96, 31], [255, 255]] {
            let density = tree.cell_mass(8, [x, y]) * 65536.0;
            assert!((f64::from(fine[(y * 256 + x) as usize]) / density - 1.0).abs() < 1e-5);
        }
        let thinned = tree.cell_mass(6, [25, 7]) * 4096.0 / 16.0;
        assert!((f64::from(coarse[7 * 64 + 25]) / thinned - 1.0).abs() < 1e-5);
        assert!((f64::from(coarse[0]) / (tree.cell_mass(6, [0, 0]) * 4096.0) - 1.0).abs() < 1e-5);
    }

    /// What lies beside a bright leaf becomes brighter, what lies far from it does not, and no leaf above the last level is left with more than 1 %.
    #[test]
    fn bright_leaves_are_blurred() {
        let place = [100, 30];
        let tree = peaked(8, place);
        let smooth = denoised(&tree);
        let relative = |[x, y]: [u32; 2]| smooth.cell_mass(8, [x, y]) / tree.cell_mass(8, [x, y]);
        // Two cells off, 30·k(2)·k(0) = 0.33 is added to the 0.25 of a leaf of the level above.
        assert!(relative([102, 30]) > 2.2 * relative([10, 200]), "{} {}", relative([102, 30]), relative([10, 200]));
        assert!(relative(place) < 0.5 && relative([99, 29]) > 1.0);
        assert!((smooth.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-9);
        let topology = smooth.topology();
        let large = topology.leaves().filter(|&n| topology.level_of(n) < 8 && smooth.node_mass()[n] > SHARE).count();
        assert_eq!(large, 0);
    }

    /// Flat trees, and those too deep, stay as they are; so does everything where there is too much to do.
    #[test]
    fn the_workload_is_limited() {
        for depth in [3, 5, 11] {
            let tree = peaked(depth, [0, 0]);
            assert_eq!(denoised(&tree), tree);
            assert_eq!(elements(&tree), 0.0);
        }
        assert_eq!(elements(&peaked(7, [3, 3])), 4096.0 + 16384.0);
    }
}
