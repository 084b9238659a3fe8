//! Cutting a binary hierarchy into nodes of eight at the least surface area cost (Ylitie, Karras, Laine 2017, §3.1).

use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::node::{LANES, WIDTH};

/// Cost of a node, relative to that of a packet, by measurement.
const NODE_COST: f32 = 1.5;
/// Cost of a packet of triangles, however many.
const PACKET_COST: f32 = 1.0;
/// Memory cost of a packet or a node, in areas of the scene's box divided by the number of triangles. It joins triangles that few
/// rays reach into fuller packets.
const MEMORY_COST: f32 = 2.0;
/// Number of subtrees that are shared out among threads.
const PARTS: usize = 256;

/// Least cost of a subtree of the binary hierarchy as at most 1, 2, … 8 children of one node, in units of area.
type Costs = [f32; WIDTH];

/// The content of a leaf.
pub enum Leaf {
    /// The triangles below a binary node.
    Packet(usize),
    /// Index of a primitive that is no triangle.
    Other(usize),
}

/// The choice of the binary nodes that become children of wide nodes. Costs and counts are written by several threads, each of
/// which has subtrees of its own.
pub struct Cut {
    /// The binary hierarchy.
    pub binary: Bvh2,
    /// [`Costs`] of each subtree, as bits.
    costs: Vec<[AtomicU32; WIDTH]>,
    /// Triangles of each subtree; more than a packet holds where it may not become one.
    counts: Vec<AtomicU8>,
    triangles: usize,
    /// Memory cost of a packet or a node, in units of area.
    memory: f32,
}

impl Cut {
    /// Finds the best cut. The first `triangles` primitives are triangles, which may share a leaf.
    pub fn new(binary: Bvh2, triangles: usize) -> Self {
        let is_empty = binary.nodes.is_empty();
        let area = binary.nodes.first().map_or(0.0, |root| root.aabb().half_area());
        let memory = MEMORY_COST * area / triangles.max(1) as f32;
        let costs = binary.nodes.par_iter().map(|_| Default::default()).collect();
        let counts = binary.nodes.par_iter().map(|_| AtomicU8::new(0)).collect();
        let cut = Self { binary, costs, counts, triangles, memory };
        if !is_empty {
            let (top, parts) = cut.parts();
            parts.into_par_iter().with_max_len(1).for_each(|part| cut.visit_subtree(part));
            top.into_iter().rev().for_each(|index| cut.visit(index));
        }
        cut
    }

    /// Subtrees that can be visited in parallel, and the nodes above them, parents first.
    fn parts(&self) -> (Vec<usize>, Vec<usize>) {
        let (mut order, mut next) = (vec![0], 0);
        while next < order.len() && order.len() - next < PARTS {
            order.extend(children(&self.binary.nodes[order[next]]).into_iter().flatten());
            next += 1;
        }
        let parts = order.split_off(next);
        (order, parts)
    }

    fn visit_subtree(&self, root: usize) {
        let (mut order, mut pending) = (Vec::new(), vec![root]);
        while let Some(index) = pending.pop() {
            order.push(index as u32);
            pending.extend(children(&self.binary.nodes[index]).into_iter().flatten());
        }
        order.into_iter().rev().for_each(|index| self.visit(index as usize));
    }

    /// Cost of the whole, in units of area; 0 of nothing. Costs of two cuts of the same scene can be compared.
    pub fn cost(&self) -> f32 {
        if self.costs.is_empty() { 0.0 } else { self.costs(0)[0] }
    }

    fn costs(&self, index: usize) -> Costs {
        self.costs[index].each_ref().map(|bits| f32::from_bits(bits.load(Ordering::Relaxed)))
    }

    fn count(&self, index: usize) -> u8 {
        self.counts[index].load(Ordering::Relaxed)
    }

    fn set(&self, index: usize, count: u8, costs: Costs) {
        self.counts[index].store(count, Ordering::Relaxed);
        for (bits, cost) in self.costs[index].iter().zip(costs) {
            bits.store(cost.to_bits(), Ordering::Relaxed);
        }
    }

    /// Finds the costs of a subtree, once those of its children are known.
    fn visit(&self, index: usize) {
        const TOO_MANY: u8 = LANES as u8 + 1;
        let node = &self.binary.nodes[index];
        let area = node.aabb().half_area();
        let Some([left, right]) = children(node) else {
            let is_triangle = self.primitive(node) < self.triangles;
            let count = if is_triangle { 1 } else { TOO_MANY };
            return self.set(index, count, [self.packet_cost(area); WIDTH]);
        };
        let count = (self.count(left) + self.count(right)).min(TOO_MANY);
        let below = [left, right].map(|child| self.costs(child));
        let mut costs = [0.0; WIDTH];
        for roots in 2..=WIDTH {
            costs[roots - 1] = split(&below, roots).1;
        }
        let node_cost = area * NODE_COST + self.memory + costs[WIDTH - 1];
        let packet = if count < TOO_MANY { self.packet_cost(area) } else { f32::INFINITY };
        costs[0] = node_cost.min(packet);
        for roots in 1..WIDTH {
            costs[roots] = costs[roots].min(costs[roots - 1]);
        }
        self.set(index, count, costs);
    }

    fn packet_cost(&self, area: f32) -> f32 {
        area * PACKET_COST + self.memory
    }

    fn primitive(&self, leaf: &Bvh2Node) -> usize {
        self.binary.primitive_indices[leaf.first_index as usize] as usize
    }

    /// The leaf that subtree `index` becomes; none where it becomes a node.
    pub fn leaf(&self, index: usize) -> Option<Leaf> {
        let node = &self.binary.nodes[index];
        if children(node).is_none() {
            let other = self.primitive(node).checked_sub(self.triangles);
            return Some(other.map_or(Leaf::Packet(index), Leaf::Other));
        }
        let is_packet = usize::from(self.count(index)) <= LANES
            && self.costs(index)[0] == self.packet_cost(node.aabb().half_area());
        is_packet.then_some(Leaf::Packet(index))
    }

    /// The subtrees that become the children of the node that subtree `index` becomes.
    pub fn roots(&self, index: usize) -> SmallVec<[usize; WIDTH]> {
        let mut roots = SmallVec::new();
        self.gather_below(index, WIDTH, &mut roots);
        roots
    }

    /// Appends the roots of the at most `roots` children that a subtree is best divided into.
    fn gather(&self, index: usize, mut roots: usize, out: &mut SmallVec<[usize; WIDTH]>) {
        let costs = self.costs(index);
        while roots > 1 && costs[roots - 2] <= costs[roots - 1] {
            roots -= 1;
        }
        if roots > 1 {
            self.gather_below(index, roots, out);
        } else {
            out.push(index);
        }
    }

    /// As [`Cut::gather`] for the two subtrees of a node; a binary leaf is its own root.
    fn gather_below(&self, index: usize, roots: usize, out: &mut SmallVec<[usize; WIDTH]>) {
        let Some(both) = children(&self.binary.nodes[index]) else { return out.push(index) };
        let (k, _) = split(&both.map(|child| self.costs(child)), roots);
        self.gather(both[0], k, out);
        self.gather(both[1], roots - k, out);
    }

    /// Visits the primitives of the packet that binary node `leaf` becomes.
    pub fn for_each_primitive(&self, leaf: usize, mut visit: impl FnMut(usize)) {
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

/// Best number of children, out of `roots`, for the left of two subtrees, and the cost of both.
fn split([left, right]: &[Costs; 2], roots: usize) -> (usize, f32) {
    let mut best = (1, f32::INFINITY);
    for k in 1..roots {
        let cost = left[k - 1] + right[roots - k - 1];
        if cost < best.1 {
            best = (k, cost);
        }
    }
    best
}

fn children(node: &Bvh2Node) -> Option<[usize; 2]> {
    (!node.is_leaf()).then_some([node.first_index as usize, node.first_index as usize + 1])
}
