//! Building the hierarchy: a binary one by `obvhs` (parallel locally ordered clustering, Meister and Bittner 2018, and reinsertion,
//! Meister and Bittner 2018), which is cut into nodes of eight. Large slanted
//! triangles are split where that lowers the cost of the whole.

use std::hash::BuildHasher;

use hashbrown::{DefaultHashBuilder, HashMap};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;
use smallvec::SmallVec;

use super::cut::{Cut, Leaf};
use super::node::{Child, Node, Packet, Triangle, WIDTH};
use super::split::split;

/// Part of the nodes that the first round of reinsertion tries; later rounds try fewer.
const REINSERTION: f32 = 0.05;

/// Most equal boxes that clustering gets. Of more it would join one pair a round, and make a chain as long as they are
/// many.
const MOST_EQUAL: usize = 8;

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

/// A binary hierarchy over boxes, each around the primitive in the same place, or around a part of it.
fn binary(boxes: &[Aabb], primitives: Vec<u32>) -> Bvh2 {
    let groups = equal(boxes);
    if groups.is_empty() {
        let mut bvh = clustered(boxes);
        bvh.primitive_indices = primitives;
        return bvh;
    }
    // Of equal boxes clustering gets the first, whose leaf then becomes a subtree.
    let mut is_kept = vec![true; boxes.len()];
    for &later in groups.values().flat_map(|group| &group[1..]) {
        is_kept[later as usize] = false;
    }
    let kept: Vec<u32> = (0..boxes.len() as u32).filter(|&number| is_kept[number as usize]).collect();
    let mut bvh = clustered(&kept.iter().map(|&number| boxes[number as usize]).collect::<Vec<_>>());
    bvh.primitive_indices = kept.iter().map(|&number| primitives[number as usize]).collect();
    for index in 0..bvh.nodes.len() {
        let node = bvh.nodes[index];
        if node.is_leaf()
            && let Some(group) = groups.get(&kept[node.first_index as usize])
        {
            let first = bvh.primitive_indices.len() as u32;
            bvh.primitive_indices.extend(group.iter().map(|&number| primitives[number as usize]));
            grow(&mut bvh.nodes, index, first, group.len() as u32);
        }
    }
    bvh.parents.clear();
    bvh
}

/// A binary hierarchy whose primitives are the boxes.
fn clustered(boxes: &[Aabb]) -> Bvh2 {
    if boxes.is_empty() {
        return Bvh2::default();
    }
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    // A leaf gets an index itself, not its place, and is then looked up there: both have to be the same.
    let indices = (0..boxes.len() as u32).collect();
    let mut bvh = builder.build(PlocSearchDistance::Medium, boxes, indices, SortPrecision::U64, 3);
    ReinsertionOptimizer::default().run(&mut bvh, REINSERTION, None);
    bvh
}

/// Makes a leaf the root of a subtree over `count` primitives, the `first` and those after it, all in its box. Each
/// left half is a power of two, so that packets get full.
fn grow(nodes: &mut Vec<Bvh2Node>, leaf: usize, first: u32, count: u32) {
    let bounds = *nodes[leaf].aabb();
    let mut pending = vec![(leaf, first, count)];
    while let Some((index, first, count)) = pending.pop() {
        if count == 1 {
            nodes[index] = Bvh2Node::new(bounds, 1, first);
            continue;
        }
        let (below, left) = (nodes.len(), count.next_power_of_two() / 2);
        nodes[index] = Bvh2Node::new(bounds, 0, below as u32);
        nodes.extend([Bvh2Node::default(); 2]);
        pending.extend([(below, first, left), (below + 1, first + left, count - left)]);
    }
}

/// Groups of more than [`MOST_EQUAL`] equal boxes, in their order, by the first of each.
fn equal(boxes: &[Aabb]) -> HashMap<u32, Vec<u32>> {
    let bits = |b: &Aabb| [b.min, b.max].map(|corner| corner.to_array().map(f32::to_bits));
    let hasher = DefaultHashBuilder::default();
    let mut counts = vec![0u8; 2 * boxes.len().next_power_of_two()];
    let mask = counts.len() - 1;
    let place = |b: &Aabb| hasher.hash_one(bits(b)) as usize & mask;
    // Nearly everywhere a count by hash, of which there are twice as many as boxes or more, tells that there is none.
    for b in boxes {
        let count = &mut counts[place(b)];
        *count = count.saturating_add(1);
    }
    let is_many = |count: usize| count > MOST_EQUAL;
    if !counts.iter().any(|&count| is_many(count.into())) {
        return HashMap::new();
    }
    let mut groups: HashMap<[[u32; 3]; 2], Vec<u32>> = HashMap::new();
    for (b, number) in boxes.iter().zip(0..) {
        if is_many(counts[place(b)].into()) {
            groups.entry(bits(b)).or_default().push(number);
        }
    }
    groups.into_values().filter(|group| is_many(group.len())).map(|group| (group[0], group)).collect()
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
    use glam::Vec3;

    use super::super::node::LANES;
    use super::super::tests::{fewer, soup};
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

    /// Equal boxes make a balanced tree of full packets, alone and beside others, in which every primitive has its
    /// leaf.
    #[test]
    fn equal_boxes_make_no_chain() {
        for (others, count) in [(0, MOST_EQUAL + 1), (0, fewer(20_000)), (fewer(300), fewer(3000))] {
            let mesh = soup(&mut Random::new(52, 0, 0), others, 0.05);
            let mut boxes: Vec<Aabb> =
                mesh.triangles.iter().map(|t| box_of(&t.map(|vertex| mesh.positions[vertex as usize]))).collect();
            let sphere = Sphere { center: Vec3::splat(0.5), radius: 0.1 };
            boxes.extend(std::iter::repeat_n(sphere_box(&sphere), count));
            let numbers: Vec<u32> = (0..boxes.len() as u32).collect();
            let tree = binary(&boxes, numbers.clone());
            let leaves = tree.nodes.iter().filter(|node| node.is_leaf());
            let mut found: Vec<u32> = leaves.map(|leaf| tree.primitive_indices[leaf.first_index as usize]).collect();
            found.sort_unstable();
            assert!(found == numbers && tree.nodes.len() == 2 * boxes.len() - 1, "{others} and {count}");
            let part = Part::of(&Cut::new(tree, boxes.len()), 0, 0);
            let packets = others + count.div_ceil(LANES);
            assert!(part.leaves.len() <= packets, "{} packets for {others} and {count}", part.leaves.len());
            assert!(part.depth <= 2 * boxes.len().ilog2() as usize, "depth {} for {others} and {count}", part.depth);
        }
    }
}
