//! Many quadtrees together, level by level: the rows and indices that the network's steps take.
//!
//! Within a level, rows are ordered by tree and then breadth first, so the four siblings are adjacent and, below the root,
//! a level's row count is a multiple of four. No hashing is needed to find neighbours: the parent of a cell's neighbour is the
//! parent or one of the parent's neighbours, so each level follows from the one above in constant time per entry.

use crate::guiding::topology::{MAX_LEVEL, Topology};

use super::program::GEOMETRY;

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

    fn roots(trees: usize) -> Self {
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
    fn split(&mut self, level: usize, split: impl Iterator<Item = bool>) -> Self {
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
        for row in 0..below.len() {
            let found = self.neighbours_of_child(level, below.parent[row] as usize, below.cell[row]);
            below.neighbours.extend(found.map(|child| child.unwrap_or(below.tree.len() as u32)));
        }
        below
    }

    /// The rows, in the level below this `level`, around the child `cell` of row `parent`.
    fn neighbours_of_child(&self, level: usize, parent: usize, cell: [u32; 2]) -> [Option<u32>; SLOTS] {
        let size = 2i64 << level;
        let around = &self.neighbours[parent * SLOTS..][..SLOTS];
        std::array::from_fn(|slot| {
            let mut x = i64::from(cell[0]) + slot as i64 / 3 - 1;
            let mut y = i64::from(cell[1]) + slot as i64 % 3 - 1;
            // Taken before crossing a pole or wrapping: the parent's own slots cross and wrap in the same way.
            let up = [(x >> 1) - i64::from(cell[0] >> 1), (y >> 1) - i64::from(cell[1] >> 1)];
            if x < 0 || x >= size {
                x = x.clamp(0, size - 1);
                y += size / 2;
            }
            let row = if level == 0 { parent as u32 } else { around[((up[0] + 1) * 3 + up[1] + 1) as usize] };
            let first = *self.first_child.get(row as usize)?;
            (first != NONE).then(|| first + (x & 1) as u32 + 2 * (y & 1) as u32)
        })
    }
}

/// One level of the trees that are encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Level {
    /// Cells and indices.
    pub rows: Rows,
    /// [N] index of each row's node in the concatenation of all trees' nodes, see [`Batch::tree_start`].
    pub node: Vec<u32>,
}

/// The trees that are encoded (Q_h), level by level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch {
    /// The levels from the root down, as many as the deepest tree has; none without trees.
    pub levels: Vec<Level>,
    /// For every tree the index of its root in the concatenation of all trees' nodes, and their total at the end.
    pub tree_start: Vec<usize>,
}

impl Batch {
    /// Lays out `trees`, which together have at most 2³² − 2 nodes.
    pub fn new(trees: &[&Topology]) -> Self {
        let mut tree_start = vec![0];
        let mut total = 0;
        tree_start.extend(trees.iter().map(|tree| {
            total += tree.len();
            total
        }));
        let mut batch = Self { levels: vec![], tree_start };
        let mut rows = Rows::roots(trees.len());
        for level in 0..=MAX_LEVEL {
            if rows.is_empty() {
                break;
            }
            let nodes = || {
                let of_level = |tree: &Topology| if level < tree.levels() { tree.level(level) } else { 0..0 };
                trees.iter().enumerate().flat_map(move |(t, tree)| of_level(tree).map(move |node| (t, *tree, node)))
            };
            let node = nodes().map(|(t, _, node)| (batch.tree_start[t] + node) as u32).collect();
            let below = rows.split(level, nodes().map(|(_, tree, node)| !tree.is_leaf(node)));
            batch.levels.push(Level { rows: std::mem::replace(&mut rows, below), node });
        }
        batch
    }

    /// Number of trees.
    pub fn trees(&self) -> usize {
        self.tree_start.len() - 1
    }

    /// Number of rows of a level, 0 beyond the last.
    pub fn len(&self, level: usize) -> usize {
        self.levels.get(level).map_or(0, |level| level.rows.len())
    }

    /// Whether there are no trees.
    pub fn is_empty(&self) -> bool {
        self.levels.is_empty()
    }

    /// The rows [N, channels] of a level out of per-node rows of all trees, concatenated in tree order.
    pub fn gather(&self, level: usize, per_node: &[f32], channels: usize) -> Vec<f32> {
        let nodes = self.levels.get(level).map_or(&[][..], |level| &level.node);
        nodes.iter().flat_map(|&node| &per_node[node as usize * channels..][..channels]).copied().collect()
    }

    /// The encoder's `pooled` input [N, channels] of a level: the mean over the four children of `below`, the encoder's
    /// output at the next level; zero where a node has none.
    pub fn pool(&self, level: usize, below: &[f32], channels: usize) -> Vec<f32> {
        let mut pooled = vec![0.0; self.len(level) * channels];
        let Some(level) = self.levels.get(level) else { return pooled };
        for (to, &first) in pooled.chunks_exact_mut(channels).zip(&level.rows.first_child) {
            if first == NONE {
                continue;
            }
            let children = &below[first as usize * channels..][..4 * channels];
            for (c, to) in to.iter_mut().enumerate() {
                *to = 0.25 * (0..4).map(|k| children[k * channels + c]).sum::<f32>();
            }
        }
        pooled
    }
}

/// One level of the trees that are decoded (Q_r), grown level by level from the roots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DecodeLevel {
    /// The level, 0 for the roots.
    pub level: usize,
    /// Cells and indices; `rows.parent` is the step's `parent_index`.
    pub rows: Rows,
    /// [N] row of the same cell in the same level of the encoded batch, or [`NONE`].
    pub skip: Vec<u32>,
    /// [N] the same node or, where the encoded tree ends above, its nearest ancestor, in the concatenation of all nodes.
    pub ancestor: Vec<u32>,
}

impl DecodeLevel {
    /// The roots of all trees of `batch`.
    pub fn roots(batch: &Batch) -> Self {
        let trees = batch.trees();
        let ancestor = batch.tree_start[..trees].iter().map(|&start| start as u32).collect();
        Self { level: 0, rows: Rows::roots(trees), skip: (0..trees as u32).collect(), ancestor }
    }

    /// The children of the rows whose flag in `split` [N] is set, siblings adjacent; sets `rows.first_child` of this level.
    /// `batch` is the one that [`DecodeLevel::roots`] took. At [`MAX_LEVEL`] there are no children.
    pub fn grow(&mut self, batch: &Batch, split: &[bool]) -> Self {
        let may_split = self.level < MAX_LEVEL;
        let rows = self.rows.split(self.level, split.iter().map(|&s| s && may_split));
        let mut below = Self { level: self.level + 1, rows, skip: vec![], ancestor: vec![] };
        for (row, &parent) in below.rows.parent.iter().enumerate() {
            let parent = parent as usize;
            let first = match self.skip[parent] {
                NONE => NONE,
                skip => batch.levels[self.level].rows.first_child[skip as usize],
            };
            if first == NONE {
                below.skip.push(NONE);
                below.ancestor.push(self.ancestor[parent]);
            } else {
                let skip = first + row as u32 % 4;
                below.skip.push(skip);
                below.ancestor.push(batch.levels[below.level].node[skip as usize]);
            }
        }
        below
    }

    /// The step's `skip` input [N, channels] out of the encoder's output at the same level: zero where there is no such node.
    pub fn skip_rows(&self, encoded: &[f32], channels: usize) -> Vec<f32> {
        let mut rows = vec![0.0; self.rows.len() * channels];
        for (to, &skip) in rows.chunks_exact_mut(channels).zip(&self.skip).filter(|(_, skip)| **skip != NONE) {
            to.copy_from_slice(&encoded[skip as usize * channels..][..channels]);
        }
        rows
    }

    /// The step's `geometry` input [N, [`GEOMETRY`]]; `log_shares` are those of
    /// [`node_log_shares`](crate::guiding::features::node_log_shares), all trees' concatenated.
    pub fn geometry(&self, log_shares: &[[f32; 2]]) -> Vec<f32> {
        let mut geometry = Vec::with_capacity(self.rows.len() * GEOMETRY);
        for (row, &cell) in self.rows.cell.iter().enumerate() {
            geometry.extend([f32::from(self.skip[row] != NONE), self.level as f32 / MAX_LEVEL as f32]);
            geometry.extend((0..4).map(|k| f32::from(k == (cell[0] & 1) + 2 * (cell[1] & 1))));
            geometry.extend(cell_centre(self.level, cell));
            geometry.extend(log_shares[self.ancestor[row] as usize]);
        }
        geometry
    }
}

/// The direction of a cell's centre under the cylindrical map.
fn cell_centre(level: usize, cell: [u32; 2]) -> [f32; 3] {
    let [u, v] = cell.map(|c| (f64::from(c) + 0.5) * 0.5f64.powi(level as i32));
    let z = 2.0 * u - 1.0;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    [radius * cos, radius * sin, z].map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use hashbrown::HashMap;

    /// A random tree whose nodes split with the given probability, to `depth`.
    fn random_tree(seed: u64, probability: f32, depth: usize) -> Topology {
        let mut random = Random::new(seed, 0, 0);
        let (mut flags, mut level) = (vec![], 1);
        for l in 0..=depth {
            let split: Vec<bool> = (0..level).map(|_| l < depth && random.next_f32() < probability).collect();
            level = 4 * split.iter().filter(|&&s| s).count();
            flags.extend(split);
        }
        Topology::from_split(&flags).unwrap()
    }

    /// Neighbours by definition, through a map of all cells of a level.
    fn check_neighbours(level: usize, rows: &Rows) {
        let map: HashMap<_, _> = rows.tree.iter().zip(&rows.cell).zip(0u32..).collect();
        let size = 1i64 << level;
        for row in 0..rows.len() {
            for slot in 0..SLOTS {
                let mut x = i64::from(rows.cell[row][0]) + slot as i64 / 3 - 1;
                let mut y = i64::from(rows.cell[row][1]) + slot as i64 % 3 - 1;
                if x < 0 || x >= size {
                    x = x.clamp(0, size - 1);
                    y += size / 2;
                }
                let cell = [x as u32, y.rem_euclid(size) as u32];
                let expected = map.get(&(&rows.tree[row], &cell)).copied();
                let expected = if level == 0 && slot != CENTRE { None } else { expected };
                let found = rows.neighbours[row * SLOTS + slot];
                assert_eq!(found, expected.unwrap_or(rows.len() as u32), "level {level}, row {row}, slot {slot}");
            }
        }
    }

    fn trees() -> Vec<Topology> {
        let chain: Vec<bool> = std::iter::once(true).chain((0..80).map(|i| i < 76 && i % 4 == 3)).collect();
        let mut trees = vec![Topology::root(), Topology::from_split(&chain).unwrap(), random_tree(1, 1.0, 5)];
        trees.extend((0..6).map(|seed| random_tree(seed, 0.55, 9)));
        trees
    }

    #[test]
    fn neighbours_follow_their_definition() {
        let trees = trees();
        let batch = Batch::new(&trees.iter().collect::<Vec<_>>());
        assert_eq!(batch.levels.len(), MAX_LEVEL + 1);
        assert_eq!(batch.levels.iter().map(|l| l.rows.len()).sum::<usize>(), *batch.tree_start.last().unwrap());
        for (level, rows) in batch.levels.iter().enumerate() {
            check_neighbours(level, &rows.rows);
            for (row, &node) in rows.node.iter().enumerate() {
                let tree = rows.rows.tree[row] as usize;
                assert_eq!(trees[tree].cell[node as usize - batch.tree_start[tree]], rows.rows.cell[row]);
            }
        }
    }

    #[test]
    fn growing_along_the_encoded_trees_meets_every_node() {
        let trees = trees();
        let batch = Batch::new(&trees.iter().collect::<Vec<_>>());
        let mut level = DecodeLevel::roots(&batch);
        for encoded in &batch.levels {
            assert_eq!(level.skip, (0..encoded.rows.len() as u32).collect::<Vec<_>>());
            assert_eq!(level.ancestor, encoded.node);
            let split: Vec<bool> = encoded.rows.first_child.iter().map(|&c| c != NONE).collect();
            let below = level.grow(&batch, &split);
            assert_eq!(level.rows, encoded.rows);
            level = below;
        }
        assert!(level.rows.is_empty());
    }

    #[test]
    fn growing_beyond_the_encoded_trees_keeps_the_ancestor() {
        let trees = [random_tree(3, 0.5, 2), Topology::root()];
        let batch = Batch::new(&trees.iter().collect::<Vec<_>>());
        let mut level = DecodeLevel::roots(&batch);
        let log_shares = vec![[0.5, -0.5]; *batch.tree_start.last().unwrap()];
        for _ in 0..5 {
            let split = vec![true; level.rows.len()];
            level = level.grow(&batch, &split);
            check_neighbours(level.level, &level.rows);
            for row in 0..level.rows.len() {
                let tree = level.rows.tree[row] as usize;
                let node = level.ancestor[row] as usize - batch.tree_start[tree];
                let depth = (0..).find(|&l| trees[tree].level(l).contains(&node)).unwrap();
                let up = level.rows.cell[row].map(|c| c >> (level.level - depth));
                assert_eq!(trees[tree].cell[node], up);
                assert_eq!(level.skip[row] == NONE, depth < level.level);
            }
            let geometry = level.geometry(&log_shares);
            assert_eq!(geometry.len(), level.rows.len() * GEOMETRY);
            assert!(
                geometry.chunks_exact(GEOMETRY).all(|g| (g[6] * g[6] + g[7] * g[7] + g[8] * g[8] - 1.0).abs() < 1e-6)
            );
        }
    }

    #[test]
    fn pooling_means_children() {
        let tree = random_tree(1, 1.0, 1);
        let batch = Batch::new(&[&tree]);
        assert_eq!(batch.pool(0, &[1., 0., 2., 0., 3., 0., 6., 4.], 2), [3.0, 1.0]);
        assert_eq!(batch.pool(1, &[], 2), [0.0; 8]);
        assert!(Batch::new(&[]).is_empty());
    }
}
