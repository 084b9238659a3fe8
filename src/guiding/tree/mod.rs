//! Directional quadtrees, the model of directions that fanal is about (Müller 2017; Zhu 2021 §5): samples are counted in leaves,
//! mixed with the distributions of earlier iterations and of the surroundings, reconstructed ([`Propose`]) and packed.
//!
//! A voxel's data from one form to the next:
//!
//! | form | holds |
//! |---|---|
//! | [`Quadtree`] | sums of the deposited samples, per leaf (Q_h) |
//! | [`Distribution`] | probabilities per node, made of sums or of other distributions |
//! | [`CountedTree`] | a distribution with the sums, the surroundings and the features that reconstruction reads |
//! | [`Proposal`] | the distributions that reconstruction makes of it |
//! | [`SamplingTree`] | the packed form that is sampled (Q_r) |

pub mod context;
pub mod distribution;
pub mod features;
pub mod leaves;
pub mod past;
pub mod proposal;
pub mod quadtree;
pub mod sampler;
pub mod topology;

pub(in crate::guiding) mod arrays;
mod stored;
mod voxel;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::context::{Block, Counted, with_context};
use self::distribution::Distribution;
use self::features::VoxelFeatures;
use self::leaves::{Layout, Leaves};
use self::proposal::{Guess, Judged, LEAST_EFFECTIVE, Proposal, SHARES, UNTOLD};
use self::quadtree::Quadtree;
use self::sampler::{NODE_BYTES, SamplingTree};
use self::voxel::TreeVoxel;
use super::cache::VoxelId;
use super::moments::Moments;
use super::samples::{Around, Told};
use super::target::Target;
use crate::base::Result;

/// Settings of the quadtrees that samples are counted in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TreeSettings {
    /// Share of a tree's energy above which a node is split, ρ.
    pub split_share: f64,
    /// Number of samples that a node of a tree's first shape has to exceed to be split. Of few samples most nodes would only tell where
    /// a single one lies, and each costs reconstruction as much as any other.
    pub first_least: u32,
    /// Sums that are kept per leaf.
    pub layout: Layout,
    /// Whether samples are moved at random within their leaf's and their voxel's size (Müller 2019 §10.2).
    pub filtered: bool,
    /// Number of samples that a voxel's surroundings count as; 0 for none.
    pub context: f64,
    /// Part of their number that the samples of an iteration count as in the next, see [`Past`](past::Past); 0 for not at all.
    pub past: f64,
}

impl Default for TreeSettings {
    fn default() -> Self {
        Self { split_share: 0.02, first_least: 0, layout: Layout::Values, filtered: false, context: 1024.0, past: 0.5 }
    }
}

/// A voxel's tree as counted, with all data that reconstruction reads.
#[derive(Debug, Clone, Copy)]
pub struct CountedTree<'a> {
    /// The voxel's samples as counted, with its past and its surroundings.
    pub counted: &'a Distribution,
    /// The voxel's own samples of the last iteration.
    pub own: Leaves<'a>,
    /// Pooled distribution of the block around the voxel; the default without context.
    pub block: &'a Block,
    /// Features of the voxel as a whole.
    pub voxel_features: VoxelFeatures,
    /// Contribution of the voxel's path samples to the picture, in any unit.
    pub contribution: f64,
}

/// Makes a proposal of every tree, in their order.
pub type Propose<'a> = dyn FnMut(&[CountedTree]) -> Result<Vec<Proposal>> + 'a;

/// The trees of all voxels while they learn.
#[derive(Debug, Clone)]
pub struct Trees {
    settings: TreeSettings,
    target: Target,
    voxels: Vec<TreeVoxel>,
    /// Whether trees keep their shapes.
    keeps_shapes: bool,
    /// Each voxel's distribution and the blocks, between [`Trees::counted`] and the end of [`Trees::fit`].
    counted: Vec<Option<Distribution>>,
    blocks: Vec<Block>,
}

impl Trees {
    /// Empty trees of `voxels` voxels, for samples of `target`.
    pub fn new(settings: TreeSettings, target: Target, voxels: usize) -> Self {
        let mut trees =
            Self { settings, target, voxels: Vec::new(), keeps_shapes: false, counted: Vec::new(), blocks: Vec::new() };
        trees.resize(voxels);
        trees
    }

    /// Adds empty voxels, up to `voxels` of them.
    pub(super) fn resize(&mut self, voxels: usize) {
        self.voxels.resize_with(voxels, || TreeVoxel::new(self.settings.layout, self.target));
    }

    /// Changes ρ for the passes to come.
    pub fn set_split_share(&mut self, share: f64) {
        self.settings.split_share = share;
    }

    /// Makes trees keep their shapes from now on: samples of several passes can be compared leaf by leaf.
    pub fn freeze_shapes(&mut self) {
        self.keeps_shapes = true;
    }

    /// Adds the samples of the first `voxels` voxels of trees of the same shapes; returns whether they are of those.
    pub(super) fn add(&mut self, other: &Self, voxels: usize) -> bool {
        let enough = self.voxels.len() >= voxels && other.voxels.len() >= voxels;
        enough && self.voxels.iter_mut().zip(&other.voxels).take(voxels).all(|(own, other)| own.add(other))
    }

    /// The quadtrees Q_h, one per voxel.
    pub fn quadtrees(&self) -> impl Iterator<Item = &Quadtree> {
        self.voxels.iter().map(|voxel| &voxel.tree)
    }

    /// Share of path samples in a voxel's counted distribution, the rest being photons.
    pub(super) fn path_share(&self, voxel: usize) -> f64 {
        self.voxels[voxel].path_share
    }

    /// Adds the samples of a chunk, after judging the distributions that drew them.
    pub(super) fn observe(&mut self, told: &Told) {
        let (settings, keeps) = (&self.settings, self.keeps_shapes);
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let spheres = &told.spheres[v];
            told.drawn.directed(v).for_each(|record| voxel.judge(record, &spheres.guide));
            let deposited = told.samples.directed(v).filter(|_| told.paths);
            voxel.deposit(deposited, told.samples.photons(v), (spheres, told.learned), settings, keeps);
        });
    }

    /// Every voxel's tree as counted; none where neither it nor its surroundings hold energy. Path samples and photons are mixed in
    /// the shares that measured best in the iteration.
    pub(super) fn counted(&mut self, around: &Around) -> Vec<Option<CountedTree<'_>>> {
        let ancestry = around.ancestry;
        let priors = ancestry.pooled(&self.voxels, |sum: &mut Moments<_>, v| sum.merge(&v.kind_moments));
        let TreeSettings { past, context, .. } = self.settings;
        let count = |(v, voxel): (usize, &mut TreeVoxel)| voxel.count(&priors[ancestry.block(v)], past);
        let own: Vec<Counted> = self.voxels.par_iter_mut().enumerate().map(count).collect();
        (self.counted, self.blocks) = if context > 0.0 {
            with_context(own, ancestry, context)
        } else {
            (own.into_iter().map(|c| c.map(|c| c.0)).collect(), vec![Block::default(); ancestry.sizes[1]])
        };
        let tree = |(v, (voxel, counted)): (usize, (_, _))| {
            let (voxel, counted): (&TreeVoxel, &Option<Distribution>) = (voxel, counted);
            let voxel_features = voxel.voxel_features(around.cache.bounds(v as VoxelId), &around.spheres[v], past);
            let (own, block) = (voxel.tree.leaves(), &self.blocks[ancestry.block(v)]);
            let counted = counted.as_ref()?;
            Some(CountedTree { counted, own, block, voxel_features, contribution: around.contributions[v] })
        };
        self.voxels.iter().zip(&self.counted).enumerate().map(tree).collect()
    }

    /// Packed trees to sample next, from the proposals that `propose` makes of the counted trees: where a proposal is two
    /// distributions, mixed as the iteration measured it to be best. None for a voxel without a counted tree. Trees are cut to the
    /// most probable nodes where all together would exceed `memory` bytes.
    ///
    /// # Errors
    /// Those of `propose`.
    pub(super) fn fit(
        &mut self,
        around: &Around,
        propose: &mut Propose,
        memory: usize,
    ) -> Result<Vec<Option<SamplingTree>>> {
        let mut proposals = vec![None; self.voxels.len()];
        let (places, trees): (Vec<usize>, Vec<_>) =
            self.counted(around).into_iter().enumerate().filter_map(|(v, tree)| Some((v, tree?))).unzip();
        let proposed = propose(&trees)?;
        places.into_iter().zip(proposed).for_each(|(v, proposal)| proposals[v] = Some(proposal));
        (self.counted, self.blocks) = (Vec::new(), Vec::new());

        let merits = around.ancestry.pooled(&self.voxels, |sum: &mut Moments<_>, v| sum.merge(&v.proposal_moments));
        let voxels = &self.voxels;
        let mixed = |(v, proposal): (usize, Option<Proposal>)| {
            let best = voxels[v].proposal_moments_with(&merits[around.ancestry.block(v)]).least(LEAST_EFFECTIVE);
            let share = best.map_or(UNTOLD, |best| SHARES[best]);
            proposal.map(|proposal| (proposal.mixed(share), proposal, share))
        };
        let guides: Vec<Option<(Guess, Proposal, f64)>> = proposals.into_par_iter().enumerate().map(mixed).collect();
        let cap = inner_nodes_cap(guides.iter().flatten().map(|(guide, ..)| &guide.0), memory);
        let pack = |(voxel, guide): (&mut TreeVoxel, Option<(Guess, Proposal, f64)>)| {
            voxel.kind_trees = voxel.separated();
            let ((distribution, uniform), proposal, share) = guide?;
            voxel.last_proposals = Judged::new(&proposal, share, cap).map(Box::new);
            if around.keeps_evidence {
                let counted = voxel.tree.has_energy().then(|| voxel.tree.leaves().hybrid(voxel.path_share));
                voxel.counted = counted.map(|counted| SamplingTree::new(&counted, 1e-3, cap));
            }
            Some(SamplingTree::new(&distribution, uniform, cap))
        };
        Ok(self.voxels.par_iter_mut().zip(guides).map(pack).collect())
    }

    /// Q_h of the last iteration, where evidence is kept.
    pub(super) fn evidence(&self) -> Vec<Option<SamplingTree>> {
        self.voxels.iter().map(|voxel| voxel.counted.clone()).collect()
    }

    /// Factor in (0, 1] by which photons lower the second moment of guided samples in a voxel; none where too little is known.
    pub(super) fn photon_gain(&self, voxel: usize) -> Option<f64> {
        let moments = &self.voxels[voxel].kind_moments;
        moments.best().map(|_| moments.gain())
    }

    /// Makes the distributions of this iteration the past of the next.
    pub(super) fn turn(&mut self) {
        self.voxels.iter_mut().for_each(|voxel| voxel.past = voxel.next_past.take());
    }

    /// Halves voxel `old` into `old` and `new`, which get the shares `parts` of its samples.
    pub(super) fn halve(&mut self, old: usize, new: usize, parts: [f64; 2]) {
        let whole = self.voxels[old].clone();
        let half = |part: f64| TreeVoxel { past: whole.past.as_ref().map(|past| past.of_part(part)), ..whole.clone() };
        [self.voxels[old], self.voxels[new]] = parts.map(half);
    }

    /// Forgets the samples of the iteration, and the past too where `target` is another than before.
    pub(super) fn clear(&mut self, target: Target) {
        (self.counted, self.blocks) = (Vec::new(), Vec::new());
        let changes = target != self.target;
        self.target = target;
        self.voxels.par_iter_mut().for_each(|voxel| {
            voxel.clear();
            if changes {
                (voxel.tree, voxel.past) = (voxel.tree.emptied_for(target), None);
            }
        });
    }
}

/// The largest number of inner nodes per tree with which all packed trees together take at most `memory` bytes.
fn inner_nodes_cap<'a>(distributions: impl Iterator<Item = &'a Distribution>, memory: usize) -> usize {
    let inner: Vec<usize> = distributions.map(|d| (d.topology().len() - 1) / 4).collect();
    let available = memory / NODE_BYTES;
    let total = |cap: usize| inner.iter().map(|&inner| inner.min(cap)).sum::<usize>();
    let largest = inner.iter().copied().max().unwrap_or(0);
    if total(largest) <= available {
        return largest;
    }
    // Smallest cap that is too large, by bisection; one less is the answer.
    let (mut low, mut high) = (0, largest);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if total(middle) <= available { low = middle } else { high = middle }
    }
    low
}
