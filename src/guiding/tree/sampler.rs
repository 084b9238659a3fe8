//! Q_r packed for sampling: drawing a direction and looking up a density touch one small node per level.
//!
//! Precision: shares are 16-bit fractions, their products f64, and the cylindrical map counts in steps of 2⁻³². An f32 product is right to 5e-7,
//! but over- or underflows for 2 in 1,000 of the deepest leaves, which no check downstream could tell from a direction without light. A map to
//! f32 puts 6 % of the directions drawn in a cell of level 20 into a neighbour when their density is looked up, ours 1.5 %, and an exact
//! one 1 %, as the directions themselves are f32 (`cargo bench --bench precision`).

use std::f64::consts::PI;

use glam::Vec3;

use super::distribution::{Distribution, NOTHING};
use super::topology::{MAX_LEVEL, MAX_NODES, NO_CHILD};
use crate::base::processor::prefetch_line;
use crate::math::cylindrical;
use crate::math::lanes::LANES;

/// Sum of the shares of a node's children. Sixteen bits are enough: directions are drawn and densities computed with the same
/// rounded shares, so nothing is biased, and a child below 1/65536 of its parent is left to the uniform part.
const WHOLE: f64 = 65536.0;

/// Largest coordinate within a node: one that rounding carried to 1 would select a child of no share.
const BELOW_ONE: f64 = 1.0 - 1.0 / (1u64 << 36) as f64;

/// An inner node: the probability of each child given the node, and the indices of the children that are inner nodes themselves. From
/// the lowest bit on: three times 16 bits, the cumulative shares at which children 1, 2 and 3 begin, on a scale of [`WHOLE`], child 0 beginning
/// at 0; 4 bits, of which k is set where child k is an inner node; 12 bits, the index of the first such child, which the others follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::guiding) struct Node(u64);

/// Bits of all cumulative shares.
const SHARES: u32 = 48;

/// No index of a node has more bits than there is room for.
const _: () = assert!(MAX_NODES / 4 < 1 << 12);

impl Node {
    /// See [`Node`]; `inner` has 4 bits, and `first` is at most [`MAX_NODES`] / 4.
    #[inline]
    pub fn new([a, b, c]: [u16; 3], inner: u16, first: u32) -> Self {
        let shares = u64::from(a) | u64::from(b) << 16 | u64::from(c) << 32;
        Self(shares | u64::from(inner & 15) << SHARES | u64::from(first & 0xFFF) << (SHARES + 4))
    }

    /// Cumulative shares at which children 1, 2 and 3 begin.
    #[inline(always)]
    pub fn begin(self) -> [u16; 3] {
        [0, 16, 32].map(|bits| (self.0 >> bits) as u16)
    }

    /// The children that are inner nodes, one bit each.
    #[inline(always)]
    pub fn inner(self) -> u16 {
        (self.0 >> SHARES & 15) as u16
    }

    /// Index of the first child that is an inner node.
    #[inline(always)]
    pub fn first(self) -> u32 {
        (self.0 >> (SHARES + 4)) as u32
    }

    /// The index of child `k`'s node, 0 where that is a leaf, and whether it is none.
    #[inline(always)]
    fn child(self, k: u32) -> (usize, bool) {
        let inner = (self.0 >> SHARES) as u32;
        let (is_inner, before) = (inner >> k & 1, (inner & ((1 << k) - 1)).count_ones());
        (((self.first() + before) * is_inner) as usize, is_inner == 1)
    }

    /// Cumulative shares at which child `k` begins and child `last` ends. Bits are shifted and nothing is chosen, as a processor that
    /// guesses the way of a random number is wrong half of the time.
    #[inline(always)]
    fn span(self, k: u32, last: u32) -> [f64; 2] {
        let begin = (self.0 << 16 >> (16 * k)) as u32 & 0xFFFF;
        let shares = self.0 & ((1 << SHARES) - 1);
        let end = (shares >> (16 * last)) as u32 & 0xFFFF | (last + 1) >> 2 << 16;
        [begin, end].map(f64::from)
    }

    /// The child that a point of the unit square selects, the point's place in it, and the child's share (Clarberg 2005, *Wavelet
    /// Importance Sampling*, §4): a row by the second coordinate, then a column by the first. Points that are spread evenly stay so.
    #[inline(always)]
    fn choose(self, [u, v]: [f64; 2]) -> (u32, [f64; 2], f64) {
        let row = v * WHOLE;
        let lower = 2 * u32::from(row >= f64::from((self.0 >> 16) as u16));
        let [begin, end] = self.span(lower, lower + 1);
        let v = (row - begin) / (end - begin);
        let column = begin + u * (end - begin);
        let k = lower + u32::from(column >= self.span(lower, lower)[1]);
        let [begin, end] = self.span(k, k);
        let u = (column - begin) / (end - begin);
        (k, [u, v].map(|x| x.min(BELOW_ONE)), end - begin)
    }
}

/// Bytes of one inner node: two for each quadtree node that it stands for. The largest cost of a pass is to fetch nodes of trees
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
            nodes.push(Node::new(begins([0, 1, 2, 3].map(|k| mass[first + k])), mask, next));
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
            let children = node.inner().count_ones() as usize;
            let rises = node.begin().is_sorted();
            if !rises || node.first() as usize != next || next + children > nodes.len() {
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
    pub(in crate::guiding) fn parts(&self) -> (&[Node], f32) {
        (&self.nodes, self.uniform)
    }

    /// Brings the nodes near with which all ways begin.
    #[inline(always)]
    pub fn prefetch(&self) {
        fetch(&self.nodes, 0);
        fetch(&self.nodes, 8);
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
        let (place, relative) = match draw {
            Draw::Uniform(place, found) => (*place, found.relative),
            Draw::Tree(descent) => (descent.place(), descent.relative),
        };
        // Rounding to three f32 may carry the direction over the edge of its cell; it was drawn with this cell's density.
        (cylindrical::to_direction(place), self.over_sphere(relative))
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
        self.over_sphere(found.relative)
    }

    #[inline(always)]
    fn look_up_cell(&self, cell: [u32; 2]) -> LookUp<'_> {
        fetch(&self.nodes, 0);
        LookUp { nodes: &self.nodes, node: 0, cell, level: MAX_LEVEL, relative: 1.0 }
    }

    /// The density w.r.t. solid angle where the tree has that of a leaf, relative to the uniform one. Never zero.
    #[inline(always)]
    fn over_sphere(&self, relative: f64) -> f32 {
        (self.mixed(relative) / (4.0 * PI)) as f32
    }

    /// The tree's density with the uniform part.
    #[inline(always)]
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
trait Way {
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

impl Descent<'_> {
    /// In no tree.
    const NOWHERE: Self = Self { nodes: &[], node: 0, within: [0.0; 2], cell: [0; 2], level: 0, relative: 0.0 };

    /// The point of the square that was drawn.
    #[inline(always)]
    fn place(&self) -> [f64; 2] {
        let side = 1.0 / f64::from(1u32 << self.level);
        [0, 1].map(|axis| (f64::from(self.cell[axis]) + self.within[axis]) * side)
    }
}

impl LookUp<'_> {
    /// In no tree.
    const NOWHERE: Self = Self { nodes: &[], node: 0, cell: [0; 2], level: 0, relative: 0.0 };
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

/// Takes the first `count` ways to their ends, all of them a level before any goes down the next.
#[inline(always)]
fn walk(ways: &mut [impl Way; LANES], mut count: usize) {
    let mut going: [usize; LANES] = std::array::from_fn(|number| number);
    while count > 0 {
        let mut kept = 0;
        for place in 0..count.min(LANES) {
            let number = going[place];
            going[kept] = number;
            // There are no others, which the compiler does not know.
            kept += usize::from(ways[number % LANES].step());
        }
        count = kept;
    }
}

/// Ways of lanes, those that there are side by side.
struct Ways<W> {
    ways: [W; LANES],
    lanes: [usize; LANES],
    count: usize,
}

impl<W: Way + Copy> Ways<W> {
    #[inline(always)]
    fn new(nowhere: W) -> Self {
        Self { ways: [nowhere; LANES], lanes: [0; LANES], count: 0 }
    }

    #[inline(always)]
    fn push(&mut self, lane: usize, way: W) {
        (self.ways[self.count % LANES], self.lanes[self.count % LANES]) = (way, lane % LANES);
        self.count += 1;
    }

    /// Takes all to their ends, and tells their lanes and where they have come.
    #[inline(always)]
    fn ends(&mut self) -> impl Iterator<Item = (usize, &W)> {
        walk(&mut self.ways, self.count);
        self.lanes.iter().copied().zip(&self.ways).take(self.count)
    }
}

/// Points of the square that were drawn in lanes.
pub struct Places {
    /// In steps of 2⁻³² along each side, see [`cylindrical::to_place`].
    pub steps: [[i32; LANES]; 2],
    /// Their densities w.r.t. solid angle.
    pub pdf: [f32; LANES],
}

/// [`SamplingTree::sample`] of several trees, which wait for memory together, up to the place on the square; 0 where there is none.
#[inline(always)]
pub fn sample_lanes(draws: &[Option<(&SamplingTree, [f64; 2])>; LANES]) -> Places {
    let (mut trees, mut uniform) = (Ways::new(Descent::NOWHERE), Ways::new(LookUp::NOWHERE));
    let mut places = Places { steps: [[0; LANES]; 2], pdf: [0.0; LANES] };
    let mut keep = |lane: usize, place: [f64; 2]| {
        [places.steps[0][lane], places.steps[1][lane]] = cylindrical::place_of(place);
    };
    for (lane, draw) in draws.iter().enumerate() {
        match draw.map(|(tree, u)| tree.draw(u)) {
            Some(Draw::Tree(descent)) => trees.push(lane, descent),
            Some(Draw::Uniform(place, look_up)) => {
                uniform.push(lane, look_up);
                keep(lane, place);
            }
            None => {}
        }
    }
    let density = |lane: usize, relative: f64| draws[lane].map_or(0.0, |(tree, _)| tree.over_sphere(relative));
    for (lane, descent) in trees.ends() {
        keep(lane, descent.place());
        places.pdf[lane] = density(lane, descent.relative);
    }
    for (lane, found) in uniform.ends() {
        places.pdf[lane] = density(lane, found.relative);
    }
    places
}

/// [`SamplingTree::pdf`] of several trees at places as [`cylindrical::to_place`] finds them; 0 where there is none.
#[inline(always)]
pub fn pdf_lanes(trees: &[Option<&SamplingTree>; LANES], [x, y]: &[[i32; LANES]; 2]) -> [f32; LANES] {
    let (mut ways, mut densities) = (Ways::new(LookUp::NOWHERE), [0.0; LANES]);
    for (lane, tree) in trees.iter().enumerate() {
        if let Some(tree) = tree {
            ways.push(lane, tree.look_up_cell([x[lane], y[lane]].map(cylindrical::cell_at)));
        }
    }
    for (lane, found) in ways.ends() {
        densities[lane] = trees[lane].map_or(0.0, |tree| tree.over_sphere(found.relative));
    }
    densities
}

/// Cumulative shares at which the last three of four siblings begin; equal shares where there is no mass.
fn begins(mass: [f64; 4]) -> [u16; 3] {
    let total: f64 = mass.iter().sum();
    let (mass, scale) = if total > NOTHING { (mass, WHOLE / total) } else { ([1.0; 4], 0.25 * WHOLE) };
    let mut sum = 0.0;
    [0, 1, 2].map(|k| {
        sum += mass[k] * scale;
        // The last child keeps at least the smallest share, as the scale's end does not fit into sixteen bits. Numbers are positive, so
        // that what a half more ends at is the nearest one, without a call.
        (sum + 0.5).min(WHOLE - 1.0) as u16
    })
}

/// Inner nodes to keep: all, or the `max_inner` most probable. Ties go to the earlier node, and a child that rounding has made more
/// probable than its parent counts as much as that, so the kept nodes are a tree.
fn kept_nodes(distribution: &Distribution, max_inner: usize) -> Vec<bool> {
    let (topology, mass) = (distribution.topology(), distribution.node_mass());
    let mut inner: Vec<usize> = (0..topology.len()).filter(|&n| topology.first_child[n] != NO_CHILD).collect();
    if inner.len() > max_inner {
        let mut rank = mass.to_vec();
        for &parent in &inner {
            let first = topology.first_child[parent] as usize;
            let most = rank[parent];
            rank[first..first + 4].iter_mut().for_each(|child| *child = child.min(most));
        }
        inner.sort_by(|&a, &b| rank[b].total_cmp(&rank[a]).then(a.cmp(&b)));
        inner.truncate(max_inner);
    }
    let mut kept = vec![false; topology.len()];
    inner.iter().for_each(|&n| kept[n] = true);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::guiding::tree::topology::Topology;

    /// Nearly all mass at the end of one way down, where rounding makes some children of unions more probable than their parents.
    #[test]
    fn cut_trees_are_trees() {
        let mut random = Random::new(61, 0, 0);
        let mut more_than_parents = 0;
        for _ in 0..1000 {
            let mut chain = |levels: usize| {
                let (mut split, mut shares) = (vec![true], vec![1.0]);
                for level in 1..=levels {
                    let goes_on = random.below(4);
                    split.extend((0..4).map(|k| level < levels && k == goes_on));
                    shares
                        .extend((0..4).map(|k| if level == levels || k == goes_on { random.next_f32() } else { 0.0 }));
                }
                Distribution::from_shares(Topology::from_split(&split).unwrap(), &shares)
            };
            let parts = [chain(12), chain(9), chain(15)].map(|of| (of, random.next_f64()));
            let union = Distribution::weighted(&parts.each_ref().map(|(of, weight)| (of, *weight)), 20, 0.0);
            let (topology, mass) = (union.topology(), union.node_mass());
            more_than_parents += (1..mass.len()).filter(|&n| mass[n] > mass[topology.parent[n] as usize]).count();
            for most in 1..40 {
                let tree = SamplingTree::new(&union, 0.05, most);
                let again = SamplingTree::from_nodes(tree.parts().0.to_vec(), tree.uniform);
                assert_eq!(again.as_ref(), Ok(&tree), "{most} inner nodes");
            }
        }
        assert!(more_than_parents > 20, "{more_than_parents} children that would count more than their parents");
    }
}
