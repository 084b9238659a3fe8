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
use crate::base::processor::prefetch_line;
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
    /// The index of child `k`'s node, 0 where that is a leaf, and whether it is none.
    #[inline(always)]
    fn child(self, k: u32) -> (usize, bool) {
        let (inner, before) = (u32::from(self.inner >> k & 1), (self.inner & ((1 << k) - 1)).count_ones());
        (((self.first + before) * inner) as usize, inner == 1)
    }

    /// Cumulative shares at which child `k` begins and child `last` ends. Bits are shifted and nothing is chosen, as a processor that
    /// guesses the way of a random number is wrong half of the time.
    #[inline(always)]
    fn span(self, k: u32, last: u32) -> [f64; 2] {
        let [a, b, c] = self.begin.map(u64::from);
        let shares = a | b << 16 | c << 32;
        let begin = (shares << 16 >> (16 * k)) as u32 & 0xFFFF;
        let end = (shares >> (16 * last)) as u32 & 0xFFFF | (last + 1) >> 2 << 16;
        [begin, end].map(f64::from)
    }

    /// The child that a point of the unit square selects, the point's place in it, and the child's share (Clarberg 2005, *Wavelet
    /// Importance Sampling*, §4): a row by the second coordinate, then a column by the first. Points that are spread evenly stay so.
    #[inline(always)]
    fn choose(self, [u, v]: [f64; 2]) -> (u32, [f64; 2], f64) {
        let row = v * WHOLE;
        let lower = 2 * u32::from(row >= f64::from(self.begin[1]));
        let [begin, end] = self.span(lower, lower + 1);
        let v = (row - begin) / (end - begin);
        let column = begin + u * (end - begin);
        let k = lower + u32::from(column >= self.span(lower, lower)[1]);
        let [begin, end] = self.span(k, k);
        let u = (column - begin) / (end - begin);
        (k, [u, v].map(|x| x.min(BELOW_ONE)), end - begin)
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
        let mut draw = self.draw(u);
        while draw.step() {}
        self.direction(&draw)
    }

    /// Maps an evenly distributed point of the unit square to one of this distribution; also returns its density over the uniform
    /// one.
    pub fn sample_square(&self, u: [f64; 2]) -> ([f64; 2], f64) {
        let mut descent = self.draw(u);
        while descent.step() {}
        self.drawn(&descent)
    }

    /// Begins to draw the direction that a point of the unit square maps to.
    #[inline(always)]
    pub fn draw(&self, [u, v]: [f64; 2]) -> Draw<'_> {
        let uniform = f64::from(self.uniform);
        if u < uniform || self.nodes.is_empty() {
            let place = [if self.nodes.is_empty() { u } else { u / uniform }, v];
            return Draw::Uniform(place, self.look_up_cell(cylindrical::cell_of(place)));
        }
        let within = [((u - uniform) / (1.0 - uniform)).min(BELOW_ONE), v.min(BELOW_ONE)];
        fetch(&self.nodes, 0);
        Draw::Tree(Descent { nodes: &self.nodes, node: 0, within, cell: [0; 2], level: 0, relative: 1.0 })
    }

    /// The direction that was drawn, and its density w.r.t. solid angle.
    #[inline(always)]
    pub fn direction(&self, draw: &Draw) -> (Vec3, f32) {
        let (place, relative) = self.drawn(draw);
        // Rounding to three f32 may carry the direction over the edge of its cell; it was drawn with this cell's density.
        (cylindrical::to_direction(place), (relative / (4.0 * PI)) as f32)
    }

    #[inline(always)]
    fn drawn(&self, draw: &Draw) -> ([f64; 2], f64) {
        match draw {
            Draw::Uniform(place, found) => (*place, self.mixed(found.relative)),
            Draw::Tree(descent) => (descent.place(), self.mixed(descent.relative)),
        }
    }

    /// Density of [`SamplingTree::sample`], w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.pdf_at(cylindrical::to_cell(direction))
    }

    /// Densities of two trees in one direction, whose cell is found once.
    pub fn pdfs(trees: &[Self; 2], direction: Vec3) -> [f32; 2] {
        let cell = cylindrical::to_cell(direction);
        trees.each_ref().map(|tree| tree.pdf_at(cell))
    }

    /// Density in a cell (x, y) of level 20.
    pub fn pdf_at(&self, cell: [u32; 2]) -> f32 {
        let mut found = self.look_up_cell(cell);
        while found.step() {}
        self.density(&found)
    }

    /// Begins to look up the density in a direction.
    #[inline(always)]
    pub fn look_up(&self, direction: Vec3) -> LookUp<'_> {
        self.look_up_cell(cylindrical::to_cell(direction))
    }

    #[inline(always)]
    fn look_up_cell(&self, cell: [u32; 2]) -> LookUp<'_> {
        fetch(&self.nodes, 0);
        LookUp { nodes: &self.nodes, node: 0, cell, level: MAX_LEVEL, relative: 1.0 }
    }

    /// The density that was looked up, w.r.t. solid angle. Never zero.
    #[inline(always)]
    pub fn density(&self, found: &LookUp) -> f32 {
        (self.mixed(found.relative) / (4.0 * PI)) as f32
    }

    /// The tree's density with the uniform part.
    fn mixed(&self, relative: f64) -> f64 {
        let uniform = f64::from(self.uniform);
        (1.0 - uniform) * relative + uniform
    }
}

/// A direction that is being drawn: by the uniform part or by the tree.
#[derive(Debug, Clone, Copy)]
pub enum Draw<'t> {
    /// The point of the square that was drawn, where the density is being looked up.
    Uniform([f64; 2], LookUp<'t>),
    /// On its way down.
    Tree(Descent<'t>),
}

/// A point of the unit square on its way to a leaf that it selects.
#[derive(Debug, Clone, Copy)]
pub struct Descent<'t> {
    nodes: &'t [Node],
    /// Index of the node that it has reached.
    node: usize,
    /// Where the point lies within the node.
    within: [f64; 2],
    cell: [u32; 2],
    level: u32,
    /// Density of the node relative to the uniform one.
    relative: f64,
}

/// A cell of level 20 on its way to the leaf that holds it.
#[derive(Debug, Clone, Copy)]
pub struct LookUp<'t> {
    nodes: &'t [Node],
    /// Index of the node that it has reached.
    node: usize,
    cell: [u32; 2],
    /// Level that the node's children are above.
    level: usize,
    /// Density of the node relative to the uniform one.
    relative: f64,
}

/// A way down a tree, step by step. A step has no branches and fetches the node of the next one, so that the steps of several ways
/// do not wait for each other's nodes.
pub trait Way {
    /// Goes down one level; returns whether there is another below.
    fn step(&mut self) -> bool;
}

impl Way for Draw<'_> {
    #[inline(always)]
    fn step(&mut self) -> bool {
        match self {
            Self::Uniform(_, look_up) => look_up.step(),
            Self::Tree(descent) => descent.step(),
        }
    }
}

impl Way for Descent<'_> {
    #[inline(always)]
    fn step(&mut self) -> bool {
        let node = self.nodes[self.node];
        let (k, within, share) = node.choose(self.within);
        self.within = within;
        self.relative *= share * (4.0 / WHOLE);
        self.cell = [2 * self.cell[0] + (k & 1), 2 * self.cell[1] + (k >> 1)];
        self.level += 1;
        let (child, is_inner) = node.child(k);
        self.node = child;
        fetch(self.nodes, child);
        is_inner
    }
}

impl Descent<'_> {
    /// The point of the square that was drawn.
    #[inline(always)]
    fn place(&self) -> [f64; 2] {
        let side = 1.0 / f64::from(1u32 << self.level);
        [0, 1].map(|axis| (f64::from(self.cell[axis]) + self.within[axis]) * side)
    }
}

impl Way for LookUp<'_> {
    #[inline(always)]
    fn step(&mut self) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        self.level -= 1;
        let [x, y] = self.cell.map(|cell| cell >> self.level & 1);
        let k = x | y << 1;
        let node = self.nodes[self.node];
        let [begin, end] = node.span(k, k);
        self.relative *= (end - begin) * (4.0 / WHOLE);
        let (child, is_inner) = node.child(k);
        self.node = child;
        fetch(self.nodes, child);
        is_inner && self.level > 0
    }
}

/// Brings a node near.
#[inline(always)]
fn fetch(nodes: &[Node], index: usize) {
    prefetch_line(nodes.as_ptr().wrapping_add(index));
}

/// Takes several ways to their ends, all of them a level before any goes down the next.
#[inline(always)]
pub fn walk<const N: usize>(ways: &mut [Option<impl Way>; N]) {
    let (mut going, mut count) = ([0; N], 0);
    for (number, way) in ways.iter().enumerate() {
        going[count] = number;
        count += usize::from(way.is_some());
    }
    while count > 0 {
        let mut kept = 0;
        for place in 0..count {
            let number = going[place];
            let goes_on = ways[number].as_mut().is_some_and(Way::step);
            going[kept] = number;
            kept += usize::from(goes_on);
        }
        count = kept;
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
