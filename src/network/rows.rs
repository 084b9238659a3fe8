//! The cells of one level of many quadtrees, and how the level below follows from it.
//!
//! No hashing is needed to find neighbours: the parent of a cell's neighbour is the parent or one of the parent's neighbours,
//! so each level follows from the one above in constant time per entry.

use crate::guiding::tree::topology::around_children;

/// Cells of a 3×3 neighbourhood; slot k is (dx, dy) = (k/3 − 1, k%3 − 1), x along z and y along φ.
pub const SLOTS: usize = 9;

/// The slot of the cell itself.
pub const CENTRE: usize = 4;

/// Marks an absent row, except in neighbours, where the level's row count does.
pub const NONE: u32 = u32::MAX;

/// The nodes of one level of all trees.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Rows {
    /// [N] index of the tree.
    pub tree: Vec<u32>,
    /// [N] integer coordinates of the cell at this level.
    pub cell: Vec<[u32; 2]>,
    /// [N, 9] rows of the cells around each, N where there is none. φ wraps; across a pole the neighbour is the cell of the
    /// same row at φ + π. At level 0 only the centre is present.
    pub neighbours: Vec<u32>,
    /// [N] row of the parent in the level above; 0 at level 0.
    pub parent: Vec<u32>,
    /// [N] row of the first of four children in the level below, or [`NONE`].
    pub first_child: Vec<u32>,
}

impl Rows {
    /// Number of rows, N.
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// Whether the level has no rows.
    pub fn is_empty(&self) -> bool {
        self.tree.is_empty()
    }

    pub(super) fn roots(trees: usize) -> Self {
        let mut neighbours = vec![trees as u32; trees * SLOTS];
        neighbours.iter_mut().skip(CENTRE).step_by(SLOTS).zip(0..).for_each(|(slot, row)| *slot = row);
        Self {
            tree: (0..trees as u32).collect(),
            cell: vec![[0, 0]; trees],
            neighbours,
            parent: vec![0; trees],
            first_child: vec![NONE; trees],
        }
    }

    /// Splits the rows whose flag is set; `level` is this level. Sets `first_child` and returns the level below.
    pub(super) fn split(&mut self, level: usize, split: impl Iterator<Item = bool>) -> Self {
        let mut below = Self::default();
        for (row, is_split) in split.enumerate().take(self.len()) {
            self.first_child[row] = if is_split { below.len() as u32 } else { NONE };
            if !is_split {
                continue;
            }
            let [x, y] = self.cell[row];
            below.tree.extend([self.tree[row]; 4]);
            below.parent.extend([row as u32; 4]);
            below.cell.extend((0..4).map(|k| [2 * x + (k & 1), 2 * y + (k >> 1)]));
        }
        below.first_child = vec![NONE; below.len()];
        below.neighbours = Vec::with_capacity(below.len() * SLOTS);
        let absent = below.len() as u32;
        for row in (0..self.len()).filter(|&row| self.first_child[row] != NONE) {
            let mut first = [NONE; SLOTS];
            for (first, &around) in first.iter_mut().zip(&self.neighbours[row * SLOTS..][..SLOTS]) {
                *first = self.first_child.get(around as usize).copied().unwrap_or(NONE);
            }
            for child in around_children(level, self.cell[row]) {
                let found = child.iter().map(|&(parent, k)| match first[usize::from(parent)] {
                    NONE => absent,
                    first => first + u32::from(k),
                });
                below.neighbours.extend(found);
            }
        }
        below
    }
}
