//! Choice of the decoded nodes that are split: as many as the classifier asks for, but never more than a tree may have.
//!
//! The cap keeps the most energetic splits of the whole tree. A child never holds more than its parent, so the splits that
//! rank first by mass (ties: by level, then row) always form a tree, and a split that later levels push out takes all its
//! descendants with it. Hence one ranking per tree suffices, kept up while levels are added.

use crate::base::Result;
use crate::guiding::tree::topology::{MAX_NODES, Topology};

use super::Reconstructed;

/// Most split nodes in one tree: each adds four to the root.
const MAX_SPLITS: usize = (MAX_NODES - 1) / 4;

/// A split, ranked by mass.
#[derive(Debug, Clone, Copy)]
struct Split {
    mass: f32,
    level: u32,
    row: u32,
}

impl Split {
    fn rank(&self, other: &Self) -> std::cmp::Ordering {
        other.mass.total_cmp(&self.mass).then(self.level.cmp(&other.level)).then(self.row.cmp(&other.row))
    }
}

/// One decoded level of all trees; rows are ordered by tree.
#[derive(Debug, Default)]
struct GrownLevel {
    tree: Vec<u32>,
    parent: Vec<u32>,
    share: Vec<f32>,
    mass: Vec<f32>,
    split: Vec<bool>,
}

/// The levels decoded so far and the splits that they keep.
#[derive(Debug)]
pub struct Growth {
    levels: Vec<GrownLevel>,
    splits: Vec<Vec<Split>>,
}

impl Growth {
    /// `trees` roots, all split.
    pub fn roots(trees: usize) -> Self {
        let root = GrownLevel {
            tree: (0..trees as u32).collect(),
            parent: vec![0; trees],
            share: vec![1.0; trees],
            mass: vec![1.0; trees],
            split: vec![true; trees],
        };
        let splits = (0..trees as u32).map(|row| vec![Split { mass: 1.0, level: 0, row }]).collect();
        Self { levels: vec![root], splits }
    }

    /// Split flags of the deepest level so far.
    pub fn split(&self) -> &[bool] {
        self.levels.last().map_or(&[], |level| &level.split)
    }

    /// Adds a level: `tree`, `parent` [N] as in the batch, `share` [N] of the parent, and which rows [N] the classifier
    /// `wants` to split, given the row and the mass.
    pub fn add(&mut self, tree: &[u32], parent: &[u32], share: &[f32], wants: impl Fn(usize, f32) -> bool) {
        let level = self.levels.len();
        let mut grown = GrownLevel {
            tree: tree.to_vec(),
            parent: parent.to_vec(),
            share: sane_shares(share),
            ..GrownLevel::default()
        };
        // A level always follows the roots.
        let above = &self.levels[level - 1].mass;
        grown.mass = parent.iter().zip(&grown.share).map(|(&p, share)| above[p as usize] * share).collect();
        grown.split = grown.mass.iter().enumerate().map(|(row, &mass)| wants(row, mass)).collect();
        let mut crowded = vec![];
        for (row, (&mass, &tree)) in grown.mass.iter().zip(tree).enumerate().filter(|(row, _)| grown.split[*row]) {
            let splits = &mut self.splits[tree as usize];
            splits.push(Split { mass, level: level as u32, row: row as u32 });
            if splits.len() == MAX_SPLITS + 1 {
                crowded.push(tree as usize);
            }
        }
        self.levels.push(grown);
        for tree in crowded {
            self.splits[tree].sort_unstable_by(Split::rank);
            for out in self.splits[tree].drain(MAX_SPLITS..) {
                self.levels[out.level as usize].split[out.row as usize] = false;
            }
        }
    }

    /// The trees, made of all nodes that still hang on a kept split.
    ///
    /// # Errors
    /// Those of [`Topology::from_split`], as `fail` wraps them.
    pub fn finish(self, fail: impl Fn(String) -> crate::base::Error) -> Result<Vec<Reconstructed>> {
        let mut trees = vec![(vec![], vec![]); self.splits.len()];
        let mut alive_above = vec![];
        for (level, grown) in self.levels.iter().enumerate() {
            let above = level.checked_sub(1).map(|l| &self.levels[l].split);
            let mut alive = Vec::with_capacity(grown.tree.len());
            for row in 0..grown.tree.len() {
                let parent = grown.parent[row] as usize;
                alive.push(above.is_none_or(|split| split[parent] && alive_above[parent]));
                if alive[row] {
                    let (flags, shares): &mut (Vec<bool>, Vec<f32>) = &mut trees[grown.tree[row] as usize];
                    flags.push(grown.split[row]);
                    shares.push(grown.share[row]);
                }
            }
            alive_above = alive;
        }
        let tree = |(flags, node_share): (Vec<bool>, Vec<f32>)| {
            Ok(Reconstructed { topology: Topology::from_split(&flags).map_err(&fail)?, node_share })
        };
        trees.into_iter().map(tree).collect()
    }
}

/// Shares as given, except where four siblings' are not a distribution (weights so large that the network overflows):
/// there ¼ each.
fn sane_shares(shares: &[f32]) -> Vec<f32> {
    let mut shares = shares.to_vec();
    for group in shares.chunks_mut(4) {
        let sum: f32 = group.iter().sum();
        if !((sum - 1.0).abs() < 1e-3 && group.iter().all(|&s| s >= 0.0)) {
            group.fill(0.25);
        }
        // Rounding must not let a child outrank its parent.
        group.iter_mut().for_each(|s| *s = s.min(1.0));
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::tree::topology::MAX_LEVEL;
    use crate::network::batch::Batch;
    use crate::network::growing::DecodeLevel;

    /// Grows one tree with shares by `share(level, row)` of siblings, everything wanting to split.
    fn grow(share: impl Fn(usize, usize) -> f32) -> Reconstructed {
        let root = Topology::root();
        let batch = Batch::new(&[&root]);
        let mut level = DecodeLevel::roots(&batch);
        let mut growth = Growth::roots(1);
        loop {
            let below = level.grow(&batch, growth.split());
            if below.rows.is_empty() {
                break;
            }
            let shares: Vec<f32> = (0..below.rows.len()).map(|row| share(below.level, row)).collect();
            growth.add(&below.rows.tree, &below.rows.parent, &shares, |_, _| below.level < MAX_LEVEL);
            level = below;
        }
        growth.finish(crate::base::Error::Options).unwrap().remove(0)
    }

    #[test]
    fn a_classifier_that_always_splits_ends_at_the_cap() {
        let tree = grow(|_, _| 0.25);
        assert_eq!(tree.topology.len(), 1 + 4 * MAX_SPLITS);
        assert!(tree.topology.levels() <= 8, "equal masses grow breadth first");
    }

    /// A peak deep down is worth more than a wide plateau above it, although the plateau is seen first.
    #[test]
    fn the_cap_keeps_the_most_energetic() {
        let tree = grow(|_, row| if row % 4 == 0 { 0.97 } else { 0.01 });
        assert_eq!(tree.topology.len(), 1 + 4 * MAX_SPLITS);
        assert_eq!(tree.topology.levels(), MAX_LEVEL + 1);
        let mut mass = vec![1.0f32; tree.topology.len()];
        for node in 1..mass.len() {
            mass[node] = mass[tree.topology.parent[node] as usize] * tree.node_share[node];
        }
        let splits = (0..mass.len()).filter(|&n| !tree.topology.is_leaf(n));
        let least_split = splits.map(|n| mass[n]).fold(f32::INFINITY, f32::min);
        let deepest = tree.topology.level(MAX_LEVEL);
        let leaves = tree.topology.leaves().filter(|leaf| !deepest.contains(leaf));
        let greatest_leaf = leaves.map(|n| mass[n]).fold(0.0, f32::max);
        assert!(least_split >= greatest_leaf, "{least_split} {greatest_leaf}");
    }

    #[test]
    fn a19_broken_shares_become_uniform() {
        let shares = sane_shares(&[f32::NAN, 1., 0., 0., 0.5, 0.5, 0., 0., 1., 1., 1., 1.]);
        assert_eq!(shares, [0.25, 0.25, 0.25, 0.25, 0.5, 0.5, 0.0, 0.0, 0.25, 0.25, 0.25, 0.25]);
    }
}
