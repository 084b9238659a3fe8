//! Q_r packed for sampling: drawing a direction and looking up a density touch one small node per level.
//!
//! Precision: shares are 16-bit fractions, their products and the cylindrical map f64. An f32 product is right to 5e-7, but over-
//! or underflows for 2 in 1,000 of the deepest leaves, which no check downstream could tell from a direction without light. The f32
//! map puts 6 % of the directions drawn in a cell of level 20 into a neighbour when their density is looked up, the f64 map 1 %
//! (the directions themselves are f32), for 9 ns more (`cargo bench --bench precision`).

use std::f64::consts::PI;

use glam::Vec3;

use super::distribution::Distribution;
use super::topology::{MAX_LEVEL, MAX_NODES, NO_CHILD};
use crate::math::cylindrical;

/// Sum of the shares of a node's children. Sixteen bits are enough: directions are drawn and densities computed with the same
/// rounded shares, so nothing is biased, and a child below 1/65536 of its parent is left to the uniform part.
const WHOLE: f64 = 65536.0;

/// Largest coordinate within a node: one that rounding carried to 1 would select a child of no share.
const BELOW_ONE: f64 = 1.0 - 1.0 / (1u64 << 36) as f64;

/// An inner node: the probability of each child given the node, and the indices of the children that are inner nodes themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::guiding) struct Node {
    /// Cumulative shares at which children 1, 2 and 3 begin, on a scale of [`WHOLE`]; child 0 begins at 0.
    pub begin: [u16; 3],
    /// Bit k is set where child k is an inner node.
    pub inner: u16,
    /// Index of the first child that is an inner node; the others follow it.
    pub first: u32,
}

impl Node {
    /// The node of child `k`; none where that is a leaf.
    fn child(self, k: usize) -> Option<usize> {
        let before = (self.inner & ((1 << k) - 1)).count_ones();
        (self.inner >> k & 1 == 1).then_some((self.first + before) as usize)
    }

    /// The child that a point of the unit square selects, and the point's place in it (Clarberg 2005, *Wavelet Importance
    /// Sampling*, §4): a row by the second coordinate, then a column by the first. Points that are spread evenly stay so.
    fn choose(self, [u, v]: [f64; 2]) -> (usize, [f64; 2]) {
        let [a, b, c] = self.begin.map(f64::from);
        let row = v * WHOLE;
        let lower = row >= b;
        let (begin, middle, end) = if lower { (b, c, WHOLE) } else { (0.0, a, b) };
        let v = if lower { (row - b) / (WHOLE - b) } else { row / b };
        let column = begin + u * (end - begin);
        let right = column >= middle;
        let (begin, end) = if right { (middle, end) } else { (begin, middle) };
        let u = (column - begin) / (end - begin);
        (usize::from(right) + 2 * usize::from(lower), [u, v].map(|x| x.min(BELOW_ONE)))
    }

    /// Density of child `k` relative to that of the node.
    fn relative(self, k: usize) -> f64 {
        let [a, b, c] = self.begin.map(i32::from);
        let share = [a, b - a, c - b, 65536 - c][k];
        f64::from(share) * (4.0 / WHOLE)
    }
}

/// Bytes of one inner node: three for each quadtree node that it stands for. The largest cost of a pass is to fetch nodes of trees
/// that no cache holds all of, so small nodes are fast nodes.
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
        let mass = distribution.node_mass();
        let mut nodes = Vec::with_capacity(kept.iter().filter(|&&k| k).count());
        // Breadth first, so the inner nodes among siblings follow one another.
        let mut next = 1u32;
        for node in (0..topology.len()).filter(|&n| kept[n]) {
            let first = topology.first_child[node] as usize;
            let mask = (0..4).fold(0, |mask, k| mask | u16::from(kept[first + k]) << k);
            nodes.push(Node { begin: begins([0, 1, 2, 3].map(|k| mass[first + k])), inner: mask, first: next });
            next += mask.count_ones();
        }
        Self { nodes: nodes.into(), uniform: uniform.clamp(1e-4, 1.0) }
    }

    /// The tree with these nodes, as read from a file.
    ///
    /// # Errors
    /// A sentence saying what is inconsistent.
    pub(in crate::guiding) fn from_nodes(nodes: Vec<Node>, uniform: f32) -> Result<Self, String> {
        if !(uniform > 0.0 && uniform <= 1.0) {
            return Err(format!("a uniform part of {uniform}, expected one above 0 and at most 1"));
        }
        if nodes.len() > MAX_NODES / 4 {
            return Err(format!("{} inner nodes, the limit is {}", nodes.len(), MAX_NODES / 4));
        }
        let mut level = vec![0; nodes.len()];
        let mut next = 1;
        for (i, node) in nodes.iter().enumerate() {
            let children = (node.inner & 15).count_ones() as usize;
            let rises = node.begin.is_sorted();
            if node.inner > 15 || !rises || node.first as usize != next || next + children > nodes.len() {
                return Err(format!("node {i} has shares that do not rise, or children out of order"));
            }
            if level[i] >= MAX_LEVEL {
                return Err(format!("deeper than {MAX_LEVEL} levels"));
            }
            let below = level[i] + 1;
            level[next..next + children].fill(below);
            next += children;
        }
        if next != nodes.len().max(1) {
            return Err(format!("{} inner nodes, but the tree ends after {next}", nodes.len()));
        }
        Ok(Self { nodes: nodes.into(), uniform })
    }

    /// The packed nodes, breadth first, and the uniform part.
    pub(in crate::guiding) fn nodes(&self) -> (&[Node], f32) {
        (&self.nodes, self.uniform)
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

    /// Direction that a point of the unit square maps to, and its density w.r.t. solid angle.
    pub fn sample(&self, u: [f64; 2]) -> (Vec3, f32) {
        let (place, relative) = self.sample_square(u);
        // Rounding to three f32 may carry the direction over the edge of its cell; it was drawn with this cell's density.
        (cylindrical::to_direction(place), (relative / (4.0 * PI)) as f32)
    }

    /// Maps an evenly distributed point of the unit square to one of this distribution; also returns its density over the uniform
    /// one.
    pub fn sample_square(&self, [u, v]: [f64; 2]) -> ([f64; 2], f64) {
        let uniform = f64::from(self.uniform);
        if u < uniform || self.nodes.is_empty() {
            let place = [if self.nodes.is_empty() { u } else { u / uniform }, v];
            return (place, self.relative_at(cylindrical::cell_of(place)));
        }
        let mut within = [((u - uniform) / (1.0 - uniform)).min(BELOW_ONE), v.min(BELOW_ONE)];
        let (mut x, mut y, mut level) = (0u32, 0u32, 0u32);
        let mut relative = 1.0;
        let mut node = self.nodes[0];
        loop {
            let k;
            (k, within) = node.choose(within);
            relative *= node.relative(k);
            (x, y, level) = (2 * x + (k as u32 & 1), 2 * y + (k as u32 >> 1), level + 1);
            let Some(child) = node.child(k) else { break };
            node = self.nodes[child];
        }
        let side = 1.0 / f64::from(1u32 << level);
        let place = [(f64::from(x) + within[0]) * side, (f64::from(y) + within[1]) * side];
        (place, self.mixed(relative))
    }

    /// Density of [`SamplingTree::sample`], w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        if self.nodes.is_empty() {
            return (1.0 / (4.0 * PI)) as f32;
        }
        self.pdf_at(cylindrical::to_cell(direction))
    }

    /// Densities of two trees in one direction, whose cell is found once.
    pub fn pdfs(trees: &[Self; 2], direction: Vec3) -> [f32; 2] {
        let cell = cylindrical::to_cell(direction);
        trees.each_ref().map(|tree| tree.pdf_at(cell))
    }

    /// Density in a cell (x, y) of level 20.
    pub fn pdf_at(&self, cell: [u32; 2]) -> f32 {
        (self.relative_at(cell) / (4.0 * PI)) as f32
    }

    /// Density relative to the uniform one in a cell (x, y) of level 20.
    fn relative_at(&self, [x, y]: [u32; 2]) -> f64 {
        let mut relative = 1.0f64;
        if !self.nodes.is_empty() {
            let mut node = self.nodes[0];
            for bit in (0..MAX_LEVEL).rev() {
                let k = (((x >> bit) & 1) | (((y >> bit) & 1) << 1)) as usize;
                relative *= node.relative(k);
                let Some(child) = node.child(k) else { break };
                node = self.nodes[child];
            }
        }
        self.mixed(relative)
    }

    /// The tree's density with the uniform part.
    fn mixed(&self, relative: f64) -> f64 {
        let uniform = f64::from(self.uniform);
        (1.0 - uniform) * relative + uniform
    }
}

/// Cumulative shares at which the last three of four siblings begin; equal shares where there is no mass.
fn begins(mass: [f64; 4]) -> [u16; 3] {
    let total: f64 = mass.iter().sum();
    let mut sum = 0.0;
    [0, 1, 2].map(|k| {
        sum += if total > 0.0 { mass[k] / total } else { 0.25 };
        // The last child keeps at least the smallest share, as the scale's end does not fit into sixteen bits.
        (sum * WHOLE).round().min(WHOLE - 1.0) as u16
    })
}

/// Inner nodes to keep: all, or the `max_inner` most probable. A child is never more probable than its parent, and ties go to the
/// earlier node, so the kept nodes are a tree.
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
