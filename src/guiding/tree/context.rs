//! Spatial context: distributions of the voxels around, with which a voxel's own is mixed while it has few samples.
//!
//! Voxels are pooled by cell, cells by blocks of 2 × 2 × 2 and those of 4 × 4 × 4 cells that face the same way. A distribution is
//! then mixed with that of its block as if the block were so many samples more (the mean of a Dirichlet distribution whose prior
//! is the block): with few samples of its own a voxel samples like its surroundings, with many like itself.

use rayon::prelude::*;

use super::distribution::Distribution;
use super::topology::MAX_LEVEL;
use crate::guiding::cache::Ancestry;

/// Mass below which nodes of pooled distributions are not split further: their details belong to single voxels.
const POOLED_MASS: f64 = 0.003;
/// Mass below which nodes of a voxel's distribution mixed with its surroundings are not split further.
const MIXED_MASS: f64 = 0.003;

/// A distribution and the number of samples that it was made from, those of earlier iterations as many as they count.
pub type Counted = Option<(Distribution, f64)>;

/// Pooled distribution of the block of 2 × 2 × 2 cells that a voxel belongs to, the voxel's own samples among those of the block.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Distribution of all samples of the block; uniform where there are none.
    pub distribution: Distribution,
    /// Numbers of samples of the block and of the 4 × 4 × 4 cells around it; those of earlier iterations as many as they count.
    pub samples: [f32; 2],
}

impl Default for Block {
    fn default() -> Self {
        Self { distribution: Distribution::uniform(), samples: [0.0; 2] }
    }
}

/// Mixes every voxel's distribution with that of its surroundings, which counts as `pseudo` samples; none where neither has
/// samples. Also returns the blocks, in the order of [`Ancestry::block`].
pub fn with_context(own: Vec<Counted>, ancestry: &Ancestry, pseudo: f64) -> (Vec<Option<Distribution>>, Vec<Block>) {
    let mut levels: Vec<Vec<Counted>> = vec![own];
    for (parents, &groups) in ancestry.parents.iter().zip(&ancestry.sizes) {
        let pooled = pool(levels.last().map_or(&[], Vec::as_slice), parents, groups);
        levels.push(pooled);
    }
    let blocks = blocks(&levels, ancestry);
    let top = levels.pop().unwrap_or_default();
    let mut above: Vec<Option<Distribution>> = top.into_iter().map(|c| c.map(|(d, _)| d)).collect();
    for (own, parents) in levels.into_iter().zip(&ancestry.parents).rev() {
        above =
            own.into_par_iter().zip(parents).map(|(own, &p)| mix(own, above[p as usize].as_ref(), pseudo)).collect();
    }
    (above, blocks)
}

/// Makes the blocks from the pooled distributions of voxels, cells and blocks of two sizes.
fn blocks(levels: &[Vec<Counted>], ancestry: &Ancestry) -> Vec<Block> {
    let [_, _, small, large] = levels else { return Vec::new() };
    let block = |(counted, &around): (&Counted, &u32)| {
        let Some((distribution, samples)) = counted else { return Block::default() };
        let around = large[around as usize].as_ref().map_or(0.0, |(_, samples)| *samples);
        Block { distribution: distribution.clone(), samples: [*samples as f32, around as f32] }
    };
    small.iter().zip(&ancestry.parents[2]).map(block).collect()
}

fn mix(own: Counted, prior: Option<&Distribution>, pseudo: f64) -> Option<Distribution> {
    let mixed = match prior {
        Some(prior) if pseudo > 0.0 || own.is_none() => joined_with(own, prior, pseudo, MIXED_MASS),
        _ => own,
    };
    mixed.map(|(distribution, _)| distribution)
}

/// Mixture of a counted distribution and another that stands for `samples` samples; nodes of the result are not split further below
/// `least_mass`.
pub(super) fn joined_with(own: Counted, other: &Distribution, samples: f64, least_mass: f64) -> Counted {
    let Some((own, counted)) = own else { return Some((other.clone(), samples)) };
    let both = [(&own, counted), (other, samples)];
    Some((Distribution::weighted(&both, MAX_LEVEL, least_mass), counted + samples))
}

fn pool(below: &[Counted], parents: &[u32], groups: usize) -> Vec<Counted> {
    let mut members = vec![Vec::new(); groups];
    for (counted, &parent) in below.iter().zip(parents) {
        if let Some((distribution, samples)) = counted {
            members[parent as usize].push((distribution, *samples));
        }
    }
    let pooled = |group: Vec<(&Distribution, f64)>| match group[..] {
        [] => None,
        [(only, samples)] => Some((only.clone(), samples)),
        _ => {
            let samples = group.iter().map(|g| g.1).sum();
            Some((Distribution::weighted(&group, MAX_LEVEL, POOLED_MASS), samples))
        }
    };
    members.into_par_iter().map(pooled).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::tree::distribution::quarters;

    #[test]
    fn few_samples_yield_to_the_surroundings() {
        let ancestry = Ancestry { parents: vec![vec![0, 0, 1]], sizes: vec![2] };
        let many = quarters([1.0, 0.0, 0.0, 0.0]);
        let few = quarters([0.0, 1.0, 0.0, 0.0]);
        let own = || vec![Some((many.clone(), 990.0)), Some((few.clone(), 10.0)), None];
        let (mixed, _) = with_context(own(), &ancestry, 100.0);
        let mass = |i: usize| mixed[i].as_ref().unwrap().leaf_mass();
        // The pooled one has 0.99 and 0.01.
        assert!((mass(0)[0] - (990.0 + 99.0) / 1090.0).abs() < 1e-9);
        assert!((mass(1)[0] - 99.0 / 110.0).abs() < 1e-9 && (mass(1)[1] - 11.0 / 110.0).abs() < 1e-9);
        assert!(mixed[2].is_none(), "nothing around it either");
        let (alone, _) = with_context(own(), &ancestry, 0.0);
        assert_eq!(alone[1].as_ref(), Some(&few));
    }

    /// Three cells of one voxel each: two in one block, all in one of the larger ones.
    #[test]
    fn blocks_pool_their_cells() {
        let ancestry = Ancestry { parents: vec![vec![0, 1, 2], vec![0, 0, 1], vec![0, 0]], sizes: vec![3, 2, 1] };
        let voxel = |weights, samples| Some((quarters(weights), samples));
        let own = vec![voxel([1.0, 0.0, 0.0, 0.0], 30.0), voxel([0.0, 1.0, 0.0, 0.0], 10.0), None];
        let (mixed, blocks) = with_context(own, &ancestry, 100.0);
        assert_eq!(blocks[0].distribution.leaf_mass(), [0.75, 0.25, 0.0, 0.0]);
        assert_eq!(blocks[0].samples, [40.0, 40.0]);
        assert_eq!(blocks[1], Block::default(), "nothing in it, whatever is around");
        assert!(mixed.iter().all(Option::is_some));
    }
}
