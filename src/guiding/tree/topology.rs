//! The shape of a directional quadtree, apart from the data of its nodes.
//!
//! Directions map to the unit square by the cylindrical map (z, φ) → (x, y) = ((z+1)/2, φ/2π). Nodes are listed breadth first:
//! the root, then its four children, and so on; the four children of a node are adjacent, and groups follow the order of
//! their parents. Child k of cell (x, y) at level l is cell (2x + (k & 1), 2y + (k >> 1)) at level l+1. One flag per node
//! (has it children?) therefore determines the whole tree.

use std::ops::Deref;
use std::sync::Arc;

/// Deepest level; a cell there covers 2⁻⁴⁰ of the sphere.
pub const MAX_LEVEL: usize = 20;

/// Most nodes in one tree.
pub const MAX_NODES: usize = 8000;

/// Marks a leaf in [`Topology::first_child`].
pub const NO_CHILD: u32 = u32::MAX;

/// The shape of one quadtree. Copies share their nodes: every distribution has a shape, and most have that of another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology(Arc<Nodes>);

/// The nodes of one quadtree, breadth first.
#[derive(Debug, PartialEq, Eq)]
pub struct Nodes {
    /// For every node the index of its first child, or [`NO_CHILD`].
    pub first_child: Vec<u32>,
    /// For every node the index of its parent; the root's is 0.
    pub parent: Vec<u32>,
    /// For every node its integer cell coordinates (x, y) at its level.
    pub cell: Vec<[u32; 2]>,
    /// Index of the first node of each level, and the node count at the end.
    pub level_start: Vec<usize>,
}

impl Deref for Topology {
    type Target = Nodes;

    fn deref(&self) -> &Nodes {
        &self.0
    }
}

impl Topology {
    /// The tree whose `split` flags, breadth first, are given.
    ///
    /// # Errors
    /// A sentence saying what is inconsistent: a count that does not match the flags, or more than [`MAX_LEVEL`] levels or
    /// [`MAX_NODES`] nodes.
    pub fn from_split(split: &[bool]) -> Result<Self, String> {
        if split.len() > MAX_NODES {
            return Err(format!("{} nodes in a quadtree, the limit is {MAX_NODES}", split.len()));
        }
        if split.is_empty() {
            return Err("a quadtree without a root".into());
        }
        let mut tree = Nodes {
            first_child: Vec::with_capacity(split.len()),
            parent: Vec::with_capacity(split.len()),
            cell: Vec::with_capacity(split.len()),
            level_start: vec![0, 1],
        };
        tree.parent.push(0);
        tree.cell.push([0, 0]);
        let mut level_end = 1;
        for (node, &is_split) in split.iter().enumerate() {
            if node >= tree.cell.len() {
                return Err(format!("{} quadtree flags, but the tree ends after {node}", split.len()));
            }
            if node == level_end {
                level_end = tree.cell.len();
                tree.level_start.push(level_end);
            }
            if !is_split {
                tree.first_child.push(NO_CHILD);
                continue;
            }
            if tree.level_start.len() - 2 == MAX_LEVEL {
                return Err(format!("a quadtree deeper than {MAX_LEVEL} levels"));
            }
            tree.first_child.push(tree.cell.len() as u32);
            let [x, y] = tree.cell[node];
            for k in 0..4 {
                tree.parent.push(node as u32);
                tree.cell.push([2 * x + (k & 1), 2 * y + (k >> 1)]);
            }
        }
        if tree.cell.len() != split.len() {
            return Err(format!("{} quadtree flags for {} nodes", split.len(), tree.cell.len()));
        }
        Ok(Self(Arc::new(tree)))
    }

    /// Grows a tree from a root, breadth first: a node for which `splits` is true is divided into the four that `children` makes of
    /// it, within [`MAX_LEVEL`] levels, `most` nodes and [`MAX_NODES`].
    pub fn grown<T>(root: T, most: usize, splits: impl Fn(&T) -> bool, children: impl Fn(&T) -> [T; 4]) -> Self {
        let mut queue = vec![(root, 0usize)];
        let mut flags = Vec::new();
        while let Some((node, level)) = queue.get(flags.len()) {
            let level = *level;
            let split = splits(node) && level < MAX_LEVEL && queue.len() + 4 <= most.min(MAX_NODES);
            flags.push(split);
            if split {
                let four = children(node);
                queue.extend(four.into_iter().map(|child| (child, level + 1)));
            }
        }
        // The flags were made breadth first with every limit observed, which is all that from_split checks.
        Self::from_split(&flags).unwrap_or_else(|_| Self::root())
    }

    /// The tree that is only a root.
    pub fn root() -> Self {
        let (first_child, parent, cell) = (vec![NO_CHILD], vec![0], vec![[0, 0]]);
        Self(Arc::new(Nodes { first_child, parent, cell, level_start: vec![0, 1] }))
    }

    /// The tree that has all cells of `level`; levels that would take more than [`MAX_NODES`] are left out.
    pub fn complete(level: usize) -> Self {
        Self::grown(0, MAX_NODES, |&here| here < level, |&here| [here + 1; 4])
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.first_child.len()
    }

    /// Never true: a tree has a root.
    pub fn is_empty(&self) -> bool {
        self.first_child.is_empty()
    }

    /// Number of levels, at least 1.
    pub fn levels(&self) -> usize {
        self.level_start.len() - 1
    }

    /// The nodes of a level.
    pub fn level(&self, level: usize) -> std::ops::Range<usize> {
        self.level_start[level]..self.level_start[level + 1]
    }

    /// The level of a node.
    pub fn level_of(&self, node: usize) -> usize {
        self.level_start.partition_point(|&start| start <= node) - 1
    }

    /// The flags that [`Topology::from_split`] takes.
    pub fn split_flags(&self) -> Vec<bool> {
        self.first_child.iter().map(|&c| c != NO_CHILD).collect()
    }

    /// Whether a node has no children.
    pub fn is_leaf(&self, node: usize) -> bool {
        self.first_child[node] == NO_CHILD
    }

    /// The leaves in breadth-first order: the order in which per-leaf data is stored.
    pub fn leaves(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|&n| self.is_leaf(n))
    }

    /// The leaf that covers the cell (x, y) of level 20.
    pub fn leaf_at(&self, [x, y]: [u32; 2]) -> usize {
        let mut node = 0;
        let mut bit = MAX_LEVEL;
        while self.first_child[node] != NO_CHILD {
            bit -= 1;
            let child = ((x >> bit) & 1) | (((y >> bit) & 1) << 1);
            node = (self.first_child[node] + child) as usize;
        }
        node
    }

    /// Adds up per-leaf rows of `channels` values (in the order of [`Topology::leaves`]) to per-node rows: leaves keep
    /// theirs, inner nodes are sums of their children.
    pub fn sum_to_root(&self, leaf_rows: &[f32], channels: usize) -> Vec<f64> {
        let mut rows = vec![0.0f64; self.len() * channels];
        for (node, row) in self.leaves().zip(leaf_rows.chunks_exact(channels)) {
            for (to, &from) in rows[node * channels..][..channels].iter_mut().zip(row) {
                *to = f64::from(from);
            }
        }
        for node in (1..self.len()).rev() {
            let parent = self.parent[node] as usize;
            let (head, tail) = rows.split_at_mut(node * channels);
            for (to, from) in head[parent * channels..][..channels].iter_mut().zip(&tail[..channels]) {
                *to += *from;
            }
        }
        rows
    }
}

/// Table of the cells around children: for each of four children k and each of nine slots, the slot around the parent and the child
/// of the cell there.
pub type ChildSlots = [[(u8, u8); 9]; 4];

/// The cells around the children of `cell` at `level`, given the cells around itself. Slot s is (dx, dy) = (s/3 − 1, s%3 − 1), x along
/// z and y along φ; φ wraps, and beyond a pole lies the cell of the same row at φ + π. Tables, since this is asked for every
/// node of every tree.
pub fn around_children(level: usize, cell: [u32; 2]) -> &'static ChildSlots {
    static INNER: ChildSlots = child_slots(false, false);
    static LOW: ChildSlots = child_slots(true, false);
    static HIGH: ChildSlots = child_slots(false, true);
    static ROOT: ChildSlots = child_slots(true, true);
    match cell[0] {
        _ if level == 0 => &ROOT,
        0 => &LOW,
        x if x + 1 == 1 << level => &HIGH,
        _ => &INNER,
    }
}

/// `low` and `high`: whether the parent lies at the pole of z = −1, of z = 1; only the root lies at both.
const fn child_slots(low: bool, high: bool) -> ChildSlots {
    let mut slots = [[(0, 0); 9]; 4];
    let mut i = 0;
    while i < 36 {
        let (k, slot) = (i / 9, i % 9);
        // Before crossing a pole: the parent's own slots cross in the same way.
        let x = (k % 2) as i32 + (slot / 3) as i32 - 1;
        let y = (k / 2) as i32 + (slot % 3) as i32 - 1;
        let (mut parent, mut child) = (3 * ((x >> 1) + 1) + (y >> 1) + 1, (x & 1) + 2 * (y & 1));
        let beyond = (low && x < 0) || (high && x > 1);
        if beyond {
            child ^= 1;
        }
        // All around the root is the root; half a turn is one of its children's columns.
        if low && high {
            parent = 4;
            child ^= if beyond { 2 } else { 0 };
        }
        slots[k][slot] = (parent as u8, child as u8);
        i += 1;
    }
    slots
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_adjacent_and_cells_nest() {
        let tree = Topology::from_split(&[true, false, true, false, false, false, false, false, false]).unwrap();
        assert_eq!(tree.levels(), 3);
        assert_eq!(tree.first_child[0], 1);
        assert_eq!(tree.first_child[2], 5);
        assert_eq!(tree.cell[6], [3, 0]);
        assert_eq!(tree.cell[7], [2, 1]);
        assert_eq!(tree.level(2), 5..9);
        assert_eq!(Topology::from_split(&tree.split_flags()).unwrap(), tree);
    }

    #[test]
    fn sums_reach_the_root() {
        let tree = Topology::from_split(&[true, false, true, false, false, false, false, false, false]).unwrap();
        let rows = tree.sum_to_root(&[1., 2., 3., 4., 5., 6., 7.], 1);
        assert_eq!(rows[0], 28.0);
        assert_eq!(rows[2], 22.0);
    }

    #[test]
    fn inconsistent_flags_are_refused() {
        for flags in [&[][..], &[true], &[false, false], &[true, false, false, false]] {
            assert!(Topology::from_split(flags).is_err());
        }
    }
}
