//! Building the hierarchy: a binary one by `obvhs` (parallel locally ordered clustering, Meister and Bittner 2018, and reinsertion,
//! Meister and Bittner 2018), which is cut into nodes of eight. Large slanted
//! triangles are split where that lowers the cost of the whole.

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;
use smallvec::SmallVec;

use super::cut::{Cut, Leaf};
use super::node::{Child, Node, Packet, Triangle, WIDTH};
use super::split::split;

/// Part of the nodes that the first round of reinsertion tries; later rounds try fewer.
const REINSERTION: f32 = 0.05;

/// Levels of nodes whose subtrees are made in parallel: up to 64.
const PARALLEL_LEVELS: usize = 2;

/// Nodes and packets, in depth-first order.
pub struct Tree {
    pub nodes: Vec<Node>,
    pub packets: Vec<Packet>,
    pub root: Child,
    /// Nodes on the longest path from the root.
    pub depth: usize,
}

/// A tree over `boxes`, of which the first `triangles` bound the results of `triangle`; the others are numbered from 0 after them.
/// A triangle may be in several packets, where it takes less to trace.
pub fn build(boxes: &[Aabb], triangles: usize, triangle: impl Fn(usize) -> Triangle + Sync) -> Tree {
    let whole = binary(boxes, (0..boxes.len() as u32).collect());
    if whole.nodes.is_empty() {
        return Tree { nodes: Vec::new(), packets: Vec::new(), root: Child::EMPTY, depth: 0 };
    }
    let whole = Cut::new(whole, triangles);
    let parts = split(&boxes[..triangles], |i| triangle(i).vertices).map(|(mut parts, mut indices)| {
        parts.extend(&boxes[triangles..]);
        indices.extend(triangles as u32..boxes.len() as u32);
        Cut::new(binary(&parts, indices), triangles)
    });
    tree(&parts.into_iter().fold(whole, |best, next| if next.cost() < best.cost() { next } else { best }), triangle)
}

fn tree(cut: &Cut, triangle: impl Fn(usize) -> Triangle + Sync) -> Tree {
    let mut part = Part::default();
    let root = match cut.leaf(0) {
        Some(leaf) => part.leaf(leaf),
        None => {
            part = Part::of(cut, 0, PARALLEL_LEVELS);
            Child::node(0)
        }
    };
    let packets = (part.leaves.par_iter())
        .map(|&leaf| {
            let mut packet = Packet::EMPTY;
            let mut slot = 0;
            cut.for_each_primitive(leaf, |primitive| {
                let triangle = triangle(primitive);
                // Two parts of a triangle may have come together again.
                if !packet.holds(&triangle) {
                    packet.set(slot, &triangle);
                    slot += 1;
                }
            });
            packet
        })
        .collect();
    Tree { nodes: part.nodes, packets, root, depth: part.depth }
}

/// A binary hierarchy over boxes around the primitives `indices`.
fn binary(boxes: &[Aabb], indices: Vec<u32>) -> Bvh2 {
    if boxes.is_empty() {
        return Bvh2::default();
    }
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    let mut bvh = builder.build(PlocSearchDistance::Medium, boxes, indices, SortPrecision::U64, 3);
    ReinsertionOptimizer::default().run(&mut bvh, REINSERTION, None);
    bvh
}

/// A subtree whose nodes and packets are numbered from 0.
#[derive(Default)]
struct Part {
    nodes: Vec<Node>,
    /// The binary node of each packet.
    leaves: Vec<usize>,
    depth: usize,
}

impl Part {
    /// The node that binary node `index` becomes, and after it the subtrees of its children, the last first. The first `levels`
    /// levels of subtrees are built in parallel.
    fn of(cut: &Cut, index: usize, levels: usize) -> Self {
        let mut part = Self::default();
        if levels == 0 {
            part.fill(cut, index);
            return part;
        }
        let inner = part.push(cut, index);
        part.depth = 1;
        let below: Vec<Self> = inner.par_iter().rev().map(|&(_, root)| Self::of(cut, root, levels - 1)).collect();
        for ((slot, _), below) in inner.into_iter().rev().zip(below) {
            part.nodes[0].children[slot] = Child::node(part.nodes.len());
            part.append(below);
        }
        part
    }

    /// The same on this thread alone.
    fn fill(&mut self, cut: &Cut, index: usize) {
        // Binary node, the slot of the parent that refers to it, and its depth.
        let mut pending = vec![(index, None, 1)];
        while let Some((index, parent, depth)) = pending.pop() {
            let at = self.nodes.len();
            self.depth = self.depth.max(depth);
            if let Some((parent, slot)) = parent {
                let parent: &mut Node = &mut self.nodes[parent];
                parent.children[slot] = Child::node(at);
            }
            pending.extend(self.push(cut, index).into_iter().map(|(slot, root)| (root, Some((at, slot)), depth + 1)));
        }
    }

    /// Appends a node with its boxes and leaves. Returns slots and binary nodes of its other children.
    fn push(&mut self, cut: &Cut, index: usize) -> SmallVec<[(usize, usize); WIDTH]> {
        let mut node = Node::EMPTY;
        let mut inner = SmallVec::new();
        for (slot, root) in cut.roots(index).into_iter().enumerate() {
            let b = cut.binary.nodes[root].aabb();
            let child = match cut.leaf(root) {
                Some(leaf) => self.leaf(leaf),
                None => {
                    inner.push((slot, root));
                    Child::EMPTY
                }
            };
            node.set(slot, child, b.min.into(), b.max.into());
        }
        self.nodes.push(node);
        inner
    }

    fn leaf(&mut self, leaf: Leaf) -> Child {
        match leaf {
            Leaf::Other(index) => Child::other(index),
            Leaf::Packet(index) => {
                self.leaves.push(index);
                Child::packet(self.leaves.len() - 1)
            }
        }
    }

    fn append(&mut self, below: Self) {
        let (nodes, packets) = (self.nodes.len(), self.leaves.len());
        self.nodes.extend(below.nodes.into_iter().map(|mut node| {
            for child in &mut node.children {
                *child = child.moved(nodes, packets);
            }
            node
        }));
        self.leaves.extend(below.leaves);
        self.depth = self.depth.max(below.depth + 1);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::soup;
    use super::super::{box_of, sphere_box};
    use super::*;
    use crate::base::random::Random;
    use crate::geometry::sphere::Sphere;

    /// A tree built by several threads equals that of one thread.
    #[test]
    #[cfg_attr(miri, ignore = "only large trees are built by several threads")]
    fn parts_make_the_whole() {
        let mesh = soup(&mut Random::new(51, 0, 0), 6000, 0.03);
        let mut boxes: Vec<Aabb> =
            mesh.triangles.iter().map(|t| box_of(&t.map(|vertex| mesh.positions[vertex as usize]))).collect();
        boxes.extend(mesh.positions[..500].iter().map(|&center| sphere_box(&Sphere { center, radius: 0.01 })));
        let cut = Cut::new(binary(&boxes, (0..boxes.len() as u32).collect()), mesh.triangles.len());
        let whole = Part::of(&cut, 0, 0);
        assert!(whole.nodes.len() > 500 && whole.depth > 4, "{} nodes, depth {}", whole.nodes.len(), whole.depth);
        for levels in 1..8 {
            let parts = Part::of(&cut, 0, levels);
            assert!(parts.nodes == whole.nodes && parts.leaves == whole.leaves, "{levels} levels");
            assert_eq!(parts.depth, whole.depth, "{levels} levels");
        }
    }
}
