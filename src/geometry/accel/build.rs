//! Building: a binary hierarchy by `obvhs` (parallel locally ordered clustering, Meister and Bittner 2018, and reinsertion,
//! Meister and Bittner 2018), then the cut of it into nodes of eight that costs least by surface area (Ylitie, Karras, Laine
//! 2017, §3.1).

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::node::{Child, LANES, Node, Packet, Triangle, WIDTH};

/// Cost of a node, relative to that of a packet, by measurement.
const NODE_COST: f32 = 1.5;
/// Cost of a packet of triangles, however many.
const PACKET_COST: f32 = 1.0;
/// What the memory of a packet or a node costs, in areas of the scene's box divided by the number of triangles. It joins
/// triangles that few rays reach into fuller packets.
const MEMORY_COST: f32 = 2.0;
/// Part of the nodes that the first round of reinsertion tries; later rounds try fewer.
const REINSERTION: f32 = 0.05;

/// Nodes and packets, in depth-first order.
pub struct Tree {
    pub nodes: Vec<Node>,
    pub packets: Vec<Packet>,
    pub root: Child,
    /// Nodes on the longest way down.
    pub depth: usize,
}

/// A tree over `boxes`, of which the first `triangles` bound what `triangle` gives; the others are numbered from 0 after them.
pub fn build(boxes: &[Aabb], triangles: usize, triangle: impl Fn(usize) -> Triangle + Sync) -> Tree {
    let binary = binary(boxes);
    let cut = Cut::new(&binary, triangles);
    let mut tree = Tree { nodes: Vec::new(), packets: Vec::new(), root: Child::EMPTY, depth: 0 };
    if binary.nodes.is_empty() {
        return tree;
    }
    let leaves = cut.write(&mut tree);
    tree.packets = (leaves.par_iter())
        .map(|&leaf| {
            let mut packet = Packet::EMPTY;
            let mut slot = 0;
            cut.for_each_primitive(leaf, |primitive| {
                packet.set(slot, &triangle(primitive));
                slot += 1;
            });
            packet
        })
        .collect();
    tree
}

fn binary(boxes: &[Aabb]) -> Bvh2 {
    if boxes.is_empty() {
        return Bvh2::default();
    }
    let indices = (0..boxes.len() as u32).collect();
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    let mut bvh = builder.build(PlocSearchDistance::Medium, boxes, indices, SortPrecision::U64, 3);
    ReinsertionOptimizer::default().run(&mut bvh, REINSERTION, None);
    bvh
}

/// What a subtree of the binary hierarchy costs at best as at most 1, 2, … 8 children of one node, in units of area.
type Costs = [f32; WIDTH];

/// The choice of the binary nodes that become children of wide nodes.
struct Cut<'a> {
    binary: &'a Bvh2,
    costs: Vec<Costs>,
    /// Triangles of each subtree; more than a packet holds where they may not become one.
    counts: Vec<u8>,
    triangles: usize,
    /// What the memory of a packet or a node costs.
    memory: f32,
}

impl<'a> Cut<'a> {
    fn new(binary: &'a Bvh2, triangles: usize) -> Self {
        let nodes = &binary.nodes;
        let area = nodes.first().map_or(0.0, |root| root.aabb().half_area());
        let memory = MEMORY_COST * area / triangles.max(1) as f32;
        let (costs, counts) = (vec![[0.0; WIDTH]; nodes.len()], vec![0; nodes.len()]);
        let mut cut = Self { binary, costs, counts, triangles, memory };
        let mut order = Vec::with_capacity(nodes.len());
        order.extend((!nodes.is_empty()).then_some(0));
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            if let Some(children) = children(&nodes[node]) {
                order.extend(children);
            }
            next += 1;
        }
        for &node in order.iter().rev() {
            cut.visit(node);
        }
        cut
    }

    fn visit(&mut self, index: usize) {
        const TOO_MANY: u8 = LANES as u8 + 1;
        let node = &self.binary.nodes[index];
        let area = node.aabb().half_area();
        let Some([left, right]) = children(node) else {
            let is_triangle = self.primitive(node) < self.triangles;
            self.counts[index] = if is_triangle { 1 } else { TOO_MANY };
            self.costs[index] = [self.packet_cost(area); WIDTH];
            return;
        };
        self.counts[index] = (self.counts[left] + self.counts[right]).min(TOO_MANY);
        let mut costs = [0.0; WIDTH];
        for roots in 2..=WIDTH {
            let shared = self.split(left, right, roots).1;
            costs[roots - 1] = shared;
        }
        let node_cost = area * NODE_COST + self.memory + costs[WIDTH - 1];
        let packet = if self.counts[index] < TOO_MANY { self.packet_cost(area) } else { f32::INFINITY };
        costs[0] = node_cost.min(packet);
        for roots in 1..WIDTH {
            costs[roots] = costs[roots].min(costs[roots - 1]);
        }
        self.costs[index] = costs;
    }

    fn packet_cost(&self, area: f32) -> f32 {
        area * PACKET_COST + self.memory
    }

    /// How many of `roots` children the left subtree gets at best, and the cost.
    fn split(&self, left: usize, right: usize, roots: usize) -> (usize, f32) {
        let (left, right) = (&self.costs[left], &self.costs[right]);
        let mut best = (1, f32::INFINITY);
        for k in 1..roots {
            let cost = left[k - 1] + right[roots - k - 1];
            if cost < best.1 {
                best = (k, cost);
            }
        }
        best
    }

    fn primitive(&self, leaf: &Bvh2Node) -> usize {
        self.binary.primitive_indices[leaf.first_index as usize] as usize
    }

    /// Whether a child of a node is a leaf.
    fn is_leaf(&self, index: usize) -> bool {
        let node = &self.binary.nodes[index];
        children(node).is_none()
            || usize::from(self.counts[index]) <= LANES
                && self.costs[index][0] == self.packet_cost(node.aabb().half_area())
    }

    /// Appends the roots into which a subtree falls when it may have at most `roots`.
    fn gather(&self, index: usize, mut roots: usize, out: &mut Vec<usize>) {
        while roots > 1 && self.costs[index][roots - 2] <= self.costs[index][roots - 1] {
            roots -= 1;
        }
        match children(&self.binary.nodes[index]) {
            Some([left, right]) if roots > 1 => {
                let (k, _) = self.split(left, right, roots);
                self.gather(left, k, out);
                self.gather(right, roots - k, out);
            }
            _ => out.push(index),
        }
    }

    /// Writes the nodes, and returns the binary node of each packet.
    fn write(&self, tree: &mut Tree) -> Vec<usize> {
        let mut leaves = Vec::new();
        let mut roots = Vec::with_capacity(WIDTH);
        let mut leaf = |index: usize| {
            let node = &self.binary.nodes[index];
            match children(node) {
                None if self.primitive(node) >= self.triangles => Child::other(self.primitive(node) - self.triangles),
                _ => {
                    leaves.push(index);
                    Child::packet(leaves.len() - 1)
                }
            }
        };
        if self.is_leaf(0) {
            tree.root = leaf(0);
            return leaves;
        }
        tree.root = Child::node(0);
        // Binary node, the slot of the parent that refers to it, and its depth.
        let mut pending = vec![(0, None, 1)];
        while let Some((index, parent, depth)) = pending.pop() {
            let at = tree.nodes.len();
            tree.nodes.push(Node::EMPTY);
            tree.depth = tree.depth.max(depth);
            if let Some((parent, slot)) = parent {
                let parent: &mut Node = &mut tree.nodes[parent];
                parent.children[slot] = Child::node(at);
            }
            roots.clear();
            if let Some([left, right]) = children(&self.binary.nodes[index]) {
                let (k, _) = self.split(left, right, WIDTH);
                self.gather(left, k, &mut roots);
                self.gather(right, WIDTH - k, &mut roots);
            }
            for (slot, &root) in roots.iter().enumerate() {
                let b = self.binary.nodes[root].aabb();
                let child = if self.is_leaf(root) {
                    leaf(root)
                } else {
                    pending.push((root, Some((at, slot)), depth + 1));
                    Child::EMPTY
                };
                tree.nodes[at].set(slot, child, b.min.into(), b.max.into());
            }
        }
        leaves
    }

    fn for_each_primitive(&self, leaf: usize, mut visit: impl FnMut(usize)) {
        let mut pending = [leaf; LANES];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let node = &self.binary.nodes[pending[count]];
            match children(node) {
                None => visit(self.primitive(node)),
                Some(both) => {
                    pending[count..count + 2].copy_from_slice(&both);
                    count += 2;
                }
            }
        }
    }
}

fn children(node: &Bvh2Node) -> Option<[usize; 2]> {
    (!node.is_leaf()).then_some([node.first_index as usize, node.first_index as usize + 1])
}
