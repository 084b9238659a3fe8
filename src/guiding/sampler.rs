//! Q_r packed for sampling: drawing a direction and looking up a density touch one small node per level.
//!
//! Precision: shares are f32, products of them and the cylindrical map f64. An f32 product is right to 5e-7, but over- or underflows for
//! 2 in 1,000 of the deepest leaves, which no check downstream could tell from a direction without light. The f32 map puts 6 % of
//! the directions drawn in a cell of level 20 into a neighbour when their density is looked up, the f64 map 1 % (the directions
//! themselves are f32), for 9 ns more (`cargo bench --bench precision`).

use std::f64::consts::PI;

use glam::Vec3;

use super::distribution::Distribution;
use super::topology::{MAX_LEVEL, NO_CHILD};
use crate::base::random::Random;
use crate::math::cylindrical;

/// Marks a child that is a leaf.
const LEAF: u32 = 0;

/// An inner node: the probability of each child given the node, and where the child's own node is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    share: [f32; 4],
    child: [u32; 4],
}

/// Bytes of one inner node. With four leaves' worth of sphere in every node this is 8 bytes a quadtree node; 16-bit shares
/// would halve it, at the price of densities known to only three digits at depth.
pub const NODE_BYTES: usize = size_of::<Node>();

/// A distribution over directions that is piecewise constant on a quadtree, mixed with a uniform part.
#[derive(Debug, Clone, PartialEq)]
pub struct SamplingTree {
    nodes: Box<[Node]>,
    uniform: f32,
}

impl SamplingTree {
    /// Packs `distribution`, keeping at most `max_inner` inner nodes, the most probable ones (a cut node's mass becomes
    /// uniform inside it). `uniform` in (0, 1] is the part of the uniform sphere that keeps every density positive.
    pub fn new(distribution: &Distribution, uniform: f32, max_inner: usize) -> Self {
        let kept = kept_nodes(distribution, max_inner);
        let topology = distribution.topology();
        let mut packed = vec![LEAF; topology.len()];
        let mut order = Vec::with_capacity(kept.iter().filter(|&&k| k).count());
        for node in (0..topology.len()).filter(|&n| kept[n]) {
            packed[node] = order.len() as u32;
            order.push(node);
        }
        let nodes = order
            .iter()
            .map(|&node| {
                let first = topology.first_child[node] as usize;
                let mass = distribution.node_mass();
                let share = |k: usize| if mass[node] > 0.0 { (mass[first + k] / mass[node]) as f32 } else { 0.25 };
                // The root is node 0 and nobody's child, so 0 can mark leaves.
                let child = |k: usize| if kept[first + k] { packed[first + k] } else { LEAF };
                Node { share: std::array::from_fn(share), child: std::array::from_fn(child) }
            })
            .collect();
        Self { nodes, uniform: uniform.clamp(1e-4, 1.0) }
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.nodes.len() * NODE_BYTES
    }

    /// Number of quadtree nodes that the packed nodes stand for.
    pub fn len(&self) -> usize {
        4 * self.nodes.len() + 1
    }

    /// Whether the distribution is the uniform one.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Draws a direction.
    pub fn sample(&self, random: &mut Random) -> Vec3 {
        if random.next_f32() < self.uniform || self.nodes.is_empty() {
            return cylindrical::to_direction([random.next_f64(), random.next_f64()]);
        }
        let (mut x, mut y, mut level) = (0u32, 0u32, 0u32);
        let mut node = &self.nodes[0];
        loop {
            let k = choose(&node.share, random.next_f32());
            (x, y, level) = (2 * x + (k as u32 & 1), 2 * y + (k as u32 >> 1), level + 1);
            if node.child[k] == LEAF {
                break;
            }
            node = &self.nodes[node.child[k] as usize];
        }
        let side = 1.0 / f64::from(1u32 << level);
        cylindrical::to_direction([
            (f64::from(x) + random.next_f64()) * side,
            (f64::from(y) + random.next_f64()) * side,
        ])
    }

    /// Density of [`SamplingTree::sample`], w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let mut relative = 1.0f64;
        if !self.nodes.is_empty() {
            let [x, y] = cylindrical::to_cell(direction);
            let mut node = &self.nodes[0];
            for bit in (0..MAX_LEVEL).rev() {
                let k = (((x >> bit) & 1) | (((y >> bit) & 1) << 1)) as usize;
                relative *= 4.0 * f64::from(node.share[k]);
                if node.child[k] == LEAF {
                    break;
                }
                node = &self.nodes[node.child[k] as usize];
            }
        }
        let uniform = f64::from(self.uniform);
        (((1.0 - uniform) * relative + uniform) / (4.0 * PI)) as f32
    }
}

/// The child that `u` selects; shares need not sum to exactly one.
fn choose(share: &[f32; 4], u: f32) -> usize {
    let mut rest = u * (share[0] + share[1] + share[2] + share[3]);
    for (k, &s) in share.iter().enumerate().take(3) {
        if rest < s {
            return k;
        }
        rest -= s;
    }
    // Rounding may leave a remainder; it goes to the last child that can be chosen at all.
    (0..4).rev().find(|&k| share[k] > 0.0).unwrap_or(3)
}

/// Inner nodes to keep: all, or the `max_inner` most probable. A child is never more probable than its parent, and ties go
/// to the earlier node, so what is kept is a tree.
fn kept_nodes(distribution: &Distribution, max_inner: usize) -> Vec<bool> {
    let (topology, mass) = (distribution.topology(), distribution.node_mass());
    let mut inner: Vec<usize> = (0..topology.len()).filter(|&n| topology.first_child[n] != NO_CHILD).collect();
    if inner.len() > max_inner {
        inner.sort_by(|&a, &b| mass[b].total_cmp(&mass[a]).then(a.cmp(&b)));
        inner.truncate(max_inner);
    }
    let mut kept = vec![false; topology.len()];
    inner.iter().for_each(|&n| kept[n] = true);
    kept
}
