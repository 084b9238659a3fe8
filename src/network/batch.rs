//! Many quadtrees together, level by level: the rows and indices that the network's steps take.
//!
//! Within a level, rows are ordered by tree and then breadth first, so the four siblings are adjacent and, below the root,
//! a level's row count is a multiple of four. [`Batch`] holds trees that exist,
//! [`DecodeLevel`](super::growing::DecodeLevel) is a level of trees that grow.

use crate::guiding::tree::topology::{MAX_LEVEL, Topology};

pub use super::rows::{CENTRE, NONE, Rows, SLOTS};

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
        let mut rows = Vec::with_capacity(nodes.len() * channels);
        for &node in nodes {
            rows.extend_from_slice(&per_node[node as usize * channels..][..channels]);
        }
        rows
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
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| &below[(first as usize + k) * channels..][..channels]);
            for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *to = 0.25 * (a + b + c + d);
            }
        }
        pooled
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::network::growing::DecodeLevel;
    use crate::network::program::GEOMETRY;
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
        let log_shares = vec![[0.5, -0.5, 0.0, 1.0, 0.25]; *batch.tree_start.last().unwrap()];
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
