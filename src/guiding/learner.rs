//! Learning: records of a pass become quadtrees, and distributions made from those become the next guiding field.
//!
//! Everything is merged in a fixed order (by voxel, then by path), so the result does not depend on the number of threads.

mod groups;
mod outliers;
mod stored;
mod voxel;

use glam::Vec3;
use rayon::prelude::*;

use self::groups::Groups;
use self::outliers::Outliers;
use self::voxel::Voxel;
use super::cache::{Ancestry, CELL_BYTES, SpatialCache, VoxelId};
use super::context::{Block, Counted, with_context};
use super::distribution::Distribution;
use super::effort::{Effort, Returns};
use super::features::Traits;
use super::field::{Evidence, GuideField, VoxelGuide};
use super::fraction::FractionRule;
use super::leaves::{DirectLight, Layout, Leaves, Target};
use super::moments::{FRACTIONS, Moments, PATH_SHARES, PictureMoments};
use super::past::{Past, joined};
use super::proposal::{Guess, Judged, LEAST_EFFECTIVE, Proposal, SHARES, UNTOLD};
use super::quadtree::Quadtree;
use super::record::{PathRecord, PhotonRecord};
use super::sampler::{NODE_BYTES, SamplingTree};
use crate::base::random::Random;

/// How the field is learned.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnerSettings {
    /// Cells along the diagonal of the scene's visited part, r_init (Zhu 2021 §7).
    pub resolution: f32,
    /// Whether surfaces that face differently have voxels of their own.
    pub facing: bool,
    /// Path samples above which a voxel is halved, k_spt (Zhu 2021 §7) or c (Müller 2017 §3.1).
    pub voxel_samples: u32,
    /// Whether that number grows with √(samples per pixel) of the iteration (Müller 2017 §3.1).
    pub growing: bool,
    /// Share of a tree's energy above which a node is split, ρ.
    pub split_share: f64,
    /// What is deposited.
    pub target: Target,
    /// What of direct light.
    pub direct: DirectLight,
    /// What is summed per leaf.
    pub layout: Layout,
    /// How often the BSDF is sampled instead of the guide.
    pub fraction: FractionRule,
    /// Whether samples are moved at random within their leaf's and their voxel's size (Müller 2019 §10.2).
    pub filtered: bool,
    /// Iterations in which the second moment is learned before that relative to the pixel: with few samples the values of pixels are
    /// mostly noise (Nilsson 2022 §4.4, after Rath 2020, who calls the former the simple target).
    pub simple_iterations: u32,
    /// Whether directions are kept for the centres of voxels, see [`Parallax`](super::parallax::Parallax).
    pub parallax: bool,
    /// As how many samples a voxel's surroundings count; 0 for none.
    pub context: f64,
    /// As what part of their number the samples of an iteration count in the next, see [`Past`]; 0 for not at all.
    pub past: f64,
    /// Ceiling of the field in bytes.
    pub memory: usize,
    /// Whether [`Evidence`] is kept, beside the field.
    pub keeps_evidence: bool,
}

impl Default for LearnerSettings {
    fn default() -> Self {
        Self {
            resolution: 24.0,
            facing: true,
            voxel_samples: 8000,
            growing: false,
            split_share: 0.02,
            target: Target::Variance,
            direct: DirectLight::All,
            layout: Layout::Values,
            fraction: FractionRule::Moments,
            filtered: false,
            simple_iterations: 0,
            parallax: true,
            context: 1024.0,
            past: 0.5,
            memory: 24 << 20,
            keeps_evidence: false,
        }
    }
}

/// What a field is wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// To learn more: half of the samples come from the BSDF.
    Learning,
    /// Each voxel has its own fraction of BSDF samples; one that is better off without its guide has none.
    Rendering,
    /// The same, and a voxel where too few paths have found light to tell has none either, unless photons show where light is.
    WhereTold,
}

/// A tree as counted, ready to be reconstructed.
#[derive(Debug, Clone)]
pub struct CountedTree<'a> {
    /// What the leaves hold.
    pub leaves: Leaves<'a>,
    /// The samples' own distribution, with what the settings ask for of earlier iterations and of the surroundings.
    pub distribution: Distribution,
    /// What is known around the voxel; nothing without context.
    pub block: &'a Block,
    /// What is known of the voxel as a whole.
    pub traits: Traits,
    /// What the voxel's path samples contributed to the picture, in any unit.
    pub contribution: f64,
}

/// Merges records into per-voxel quadtrees.
pub struct Learner {
    settings: LearnerSettings,
    cache: Option<SpatialCache>,
    voxels: Vec<Voxel>,
    /// Groups of voxels in the iteration that is being judged.
    ancestry: Ancestry,
    /// What its blocks have learned.
    blocks: Vec<Block>,
    iterations: u32,
    /// Chunks so far, for random numbers.
    absorbed: u64,
    kept: Kept,
    outliers: Outliers,
}

/// What of voxels is never fitted anew.
#[derive(Debug, Clone, Copy, Default)]
struct Kept {
    /// The shapes of their trees.
    shapes: bool,
    /// The spheres that directions refer to.
    spheres: bool,
}

/// Fraction of BSDF samples while learning.
const LEARNING_FRACTION: f64 = 0.5;
/// As how many samples the moments of a voxel's surroundings count.
const PRIOR_SAMPLES: f64 = 256.0;
/// Photons keep a part where there are any: path samples do not know of the light that they have not found.
const MOST_PATH_SHARE: f64 = 0.9;

impl Learner {
    /// A learner that has seen nothing.
    pub fn new(settings: LearnerSettings) -> Self {
        Self {
            settings,
            cache: None,
            voxels: Vec::new(),
            ancestry: Ancestry::default(),
            blocks: Vec::new(),
            iterations: 0,
            absorbed: 0,
            kept: Kept::default(),
            outliers: Outliers::default(),
        }
    }

    /// What is deposited now.
    pub fn target(&self) -> Target {
        match self.settings.target {
            Target::VariancePixel if self.iterations < self.settings.simple_iterations => Target::Variance,
            target => target,
        }
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.voxels.len()
    }

    /// The spatial cache, once samples have arrived.
    pub fn cache(&self) -> Option<&SpatialCache> {
        self.cache.as_ref()
    }

    /// Changes ρ for the passes to come.
    pub fn set_split_share(&mut self, share: f64) {
        self.settings.split_share = share;
    }

    /// A learner that knows the voxels of this one and where their light starts, and nothing else.
    pub fn restarted(&self, settings: LearnerSettings) -> Self {
        let (layout, target) = (settings.layout, settings.target);
        let fresh = |old: &Voxel| Voxel { parallax: old.parallax, ..Voxel::new(layout, target) };
        Self {
            cache: self.cache.clone(),
            voxels: self.voxels.iter().map(fresh).collect(),
            kept: Kept { shapes: false, spheres: true },
            ..Self::new(settings)
        }
    }

    /// From now on trees keep their shape and what their directions refer to: samples of several passes can be compared leaf by
    /// leaf.
    pub fn freeze_shapes(&mut self) {
        self.kept = Kept { shapes: true, spheres: true };
    }

    /// The quadtrees Q_h, one per voxel.
    pub fn trees(&self) -> Vec<&Quadtree> {
        self.voxels.iter().map(|v| &v.tree).collect()
    }

    /// Adds one chunk of records. Path samples make voxels where there are none; photons only enter voxels that exist. The
    /// first chunk of a pass also gives the trees their shape: deposit, split, deposit again.
    /// Where `deposit_paths` is off, path samples make voxels and are not learned from.
    ///
    /// Returns the voxel that each photon fell into, [`VoxelId::MAX`] for none.
    pub fn absorb(&mut self, paths: &[PathRecord], photons: &[PhotonRecord], deposit_paths: bool) -> Vec<VoxelId> {
        if paths.is_empty() && self.cache.is_none() {
            return vec![VoxelId::MAX; photons.len()];
        }
        let target = self.target();
        let resolution = self.settings.resolution;
        let faces = self.settings.facing;
        let cache = self.cache.get_or_insert_with(|| {
            let cache = SpatialCache::fit(&paths.iter().map(|r| r.point).collect::<Vec<_>>(), resolution);
            if faces { cache } else { cache.without_facing() }
        });
        let mut path_voxels = voxels_of(cache, paths, most_voxels(self.settings.memory));
        self.voxels.resize_with(cache.len(), || Voxel::new(self.settings.layout, target));
        let mut photon_voxels: Vec<VoxelId> =
            photons.par_iter().map(|r| cache.find(r.point, r.normal).unwrap_or(VoxelId::MAX)).collect();
        let reached = photon_voxels.clone();
        let filtered = self.settings.filtered;
        if filtered {
            self.absorbed += 1;
            let moved = |kind, points: Vec<(Vec3, Vec3)>, voxels: &mut [VoxelId]| {
                move_voxels(cache, (self.absorbed, kind), &points, voxels)
            };
            moved(0, paths.iter().map(|r| (r.point, r.normal)).collect(), &mut path_voxels);
            moved(1, photons.iter().map(|r| (r.point, r.normal)).collect(), &mut photon_voxels);
        }
        let paths_by_voxel = Groups::new(&path_voxels, self.voxels.len());
        let photons_by_voxel = Groups::new(&photon_voxels, self.voxels.len());
        self.outliers.absorb(paths, &path_voxels);
        let (cache, settings, kept) = (&*cache, &self.settings, self.kept);
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let bounds = cache.bounds(v as VoxelId);
            let own_paths = paths_by_voxel.group(v).iter().map(|&i| &paths[i as usize]);
            let own_photons = photons_by_voxel.group(v).iter().map(|&i| &photons[i as usize]);
            own_paths.clone().for_each(|record| voxel.judge(record, settings.fraction));
            let deposited = own_paths.filter(|record| deposit_paths && record.is_directed());
            voxel.deposit(&bounds, deposited, own_photons, settings, kept);
        });
        reached
    }

    /// Every voxel's tree as counted; none where neither it nor its surroundings hold energy. Path samples and photons are mixed
    /// by what the iteration measured of their use.
    pub fn counted(&mut self) -> Vec<Option<CountedTree<'_>>> {
        let Some(cache) = &self.cache else { return Vec::new() };
        self.ancestry = cache.ancestry();
        let ancestry = &self.ancestry;
        let priors = pooled(&self.voxels, ancestry, |sum: &mut Moments<_>, v| sum.merge(&v.shares));
        let part = self.settings.past;
        let own = |(v, voxel): (usize, &mut Voxel)| -> Counted {
            let mut shares = voxel.shares;
            shares.add_prior(&priors[ancestry.block(v)], PRIOR_SAMPLES);
            voxel.path_share = shares.best().map_or(0.5, |best| PATH_SHARES[best].min(MOST_PATH_SHARE));
            let samples: u32 = voxel.tree.counts().iter().sum();
            let energy = voxel.tree.has_energy();
            let own = energy.then(|| (voxel.tree.leaves().hybrid(voxel.path_share), f64::from(samples)));
            let own = joined(own, voxel.past.as_ref(), part);
            voxel.next_past = own.as_ref().filter(|_| part > 0.0).map(|(of, samples)| Past::new(of, *samples));
            own
        };
        let own: Vec<Counted> = self.voxels.par_iter_mut().enumerate().map(own).collect();
        let distributions: Vec<Option<Distribution>>;
        (distributions, self.blocks) = if self.settings.context > 0.0 {
            with_context(own, ancestry, self.settings.context)
        } else {
            (own.into_iter().map(|c| c.map(|c| c.0)).collect(), vec![Block::default(); ancestry.sizes[1]])
        };
        let blocks = &self.blocks;
        let tree = |(v, (voxel, distribution)): (usize, (_, _))| {
            let voxel: &Voxel = voxel;
            let (block, distribution): (_, Option<Distribution>) = (&blocks[ancestry.block(v)], distribution);
            let (leaves, contribution) = (voxel.tree.leaves(), voxel.contribution);
            let traits = voxel.traits(cache.bounds(v as VoxelId), part);
            distribution.map(|distribution| CountedTree { leaves, distribution, block, traits, contribution })
        };
        self.voxels.iter().zip(distributions).enumerate().map(tree).collect()
    }

    /// How far photons lower the second moment of guided samples, as a factor in (0, 1], averaged over voxels by what they
    /// contribute; none before it was measured.
    pub fn photon_gain(&self) -> Option<f64> {
        // Voxels whose few samples do not tell have to be left out: they are those that photons may be needed for.
        let measured = self.voxels.iter().filter(|v| v.shares.best().is_some());
        let (sum, weight) =
            measured.fold((0.0, 0.0), |s, v| (s.0 + v.contribution * v.shares.gain(), s.1 + v.contribution));
        (weight > 0.0).then(|| sum / weight)
    }

    /// What guiding changes, as the picture sees it, the `worst` samples left out. To be asked between [`Learner::publish`] and
    /// [`Learner::refine`].
    pub fn picture_moments(&mut self, worst: usize) -> PictureMoments {
        let mut sum = PictureMoments::default();
        let (mut squares, mut photons) = (Moments::<1>::default(), 0.0);
        let mut outliers = self.outliers.by_voxel(worst).peekable();
        for (v, voxel) in self.voxels.iter().enumerate() {
            let arrived = f64::from(voxel.tree.counts()[1]);
            photons += arrived;
            sum.unseen += if voxel.contribution > 0.0 { 0.0 } else { arrived };
            let (mut own, mut all, mut fractions) = (voxel.squares, voxel.all_squares, voxel.fractions);
            while let Some(outlier) = outliers.next_if(|outlier| outlier.voxel as usize == v) {
                own.remove([outlier.squares[0]]);
                all = (all - outlier.squares[1]).max(0.0);
                fractions.remove_estimates(&outlier.estimates, LEARNING_FRACTION);
            }
            let relative = fractions.relative(LEARNING_FRACTION, f64::from(voxel.bsdf_fraction));
            let [learning, guided, unguided] = relative.map(|moment| all * moment);
            sum.learning += learning;
            sum.guided += guided;
            sum.unguided += unguided;
            squares.merge(&own);
        }
        [sum.onward] = squares.sums();
        sum.effective = squares.effective();
        sum.unseen /= if photons > 0.0 { photons } else { 1.0 };
        sum
    }

    /// Takes the proposals made from [`Learner::counted`] (same order) for the next guides: where there are two, mixed as the
    /// iteration measured it to be best. A voxel for which there is none keeps its old guide. Trees are cut to the most probable
    /// nodes where the field would exceed its ceiling.
    pub fn publish(&mut self, proposals: Vec<Option<Proposal>>) {
        if self.cache.is_none() {
            return;
        }
        let ancestry = &self.ancestry;
        let merits = pooled(&self.voxels, ancestry, |sum: &mut Moments<_>, v| sum.merge(&v.merits));
        let mixed = |(v, proposal): (usize, Option<Proposal>)| {
            let mut own = self.voxels[v].merits;
            own.add_prior(&merits[ancestry.block(v)], PRIOR_SAMPLES);
            let share = own.least(LEAST_EFFECTIVE).map_or(UNTOLD, |best| SHARES[best]);
            proposal.map(|proposal| (proposal.mixed(share), proposal, share))
        };
        let guides: Vec<Option<(Guess, Proposal, f64)>> = proposals.into_par_iter().enumerate().map(mixed).collect();
        let cap = self.inner_nodes_cap(guides.iter().flatten().map(|(guide, ..)| &guide.0));
        let priors = pooled(&self.voxels, ancestry, |sum: &mut Moments<_>, v| sum.merge(&v.fractions));
        let returns = pooled_returns(&self.voxels, ancestry);
        let LearnerSettings { fraction: rule, keeps_evidence, .. } = self.settings;
        self.voxels.par_iter_mut().zip(guides).enumerate().for_each(|(v, (voxel, guide))| {
            voxel.kinds = voxel.kinds();
            voxel.guide_parallax = voxel.parallax;
            voxel.known_returns = voxel.returns;
            voxel.known_returns.add_prior(&returns[ancestry.block(v)], PRIOR_SAMPLES);
            let Some(((distribution, uniform), proposal, share)) = guide else { return };
            voxel.guide = Some(SamplingTree::new(&distribution, uniform, cap));
            voxel.judged = Judged::new(&proposal, share, cap).map(Box::new);
            let mut fractions = voxel.fractions;
            fractions.add_prior(&priors[ancestry.block(v)], PRIOR_SAMPLES);
            voxel.told = fractions.best().is_some() || voxel.tree.leaves().has(1);
            voxel.bsdf_fraction = match rule {
                FractionRule::Half => LEARNING_FRACTION,
                FractionRule::Moments => fractions.best().map_or(LEARNING_FRACTION, |best| FRACTIONS[best]),
                FractionRule::Adam => voxel.adam.fraction(),
            } as f32;
            if keeps_evidence {
                let counted = voxel.tree.has_energy().then(|| voxel.tree.leaves().hybrid(voxel.path_share));
                voxel.counted = counted.map(|counted| SamplingTree::new(&counted, 1e-3, cap));
                let [_, chosen, bsdf] = fractions.relative(LEARNING_FRACTION, f64::from(voxel.bsdf_fraction));
                voxel.gain = (chosen / bsdf) as f32;
            }
        });
    }

    /// The largest number of inner nodes per tree with which the whole field stays below its ceiling.
    fn inner_nodes_cap<'a>(&self, distributions: impl Iterator<Item = &'a Distribution>) -> usize {
        let inner: Vec<usize> = distributions.map(|d| (d.topology().len() - 1) / 4).collect();
        let fixed = self.cache.as_ref().map_or(0, SpatialCache::bytes)
            + self.voxels.len() * (size_of::<VoxelGuide>() + size_of::<SamplingTree>());
        let available = self.settings.memory.saturating_sub(fixed) / NODE_BYTES;
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

    /// Ends a pass: halves voxels with many samples (both halves inherit the tree and the guide) until none has too many (Müller
    /// 2017 §3.2, Zhu 2021 §7) or is an eighth of what it was, and forgets values but for what becomes the [`Past`].
    /// The pass had `spp` camera paths per pixel.
    pub fn refine(&mut self, spp: u32) {
        let target = self.target();
        if self.cache.is_none() {
            return;
        }
        self.voxels.iter_mut().for_each(|voxel| voxel.past = voxel.next_past.take());
        let growth = if self.settings.growing { f64::from(spp).sqrt() } else { 1.0 };
        let limit = (f64::from(self.settings.voxel_samples) * growth) as u32;
        // Once along each axis: how the samples lie within an eighth is not known.
        for _ in 0..3 {
            self.halve(limit);
        }
        self.clear();
        self.iterations += 1;
        if self.target() != target {
            let target = self.target();
            self.voxels.par_iter_mut().for_each(|voxel| {
                (voxel.tree, voxel.past) = (voxel.tree.emptied_for(target), None);
            });
        }
    }

    /// Halves the voxels with more path samples than `limit`, as far as the memory allows.
    fn halve(&mut self, limit: u32) {
        let target = self.target();
        let Some(cache) = &mut self.cache else { return };
        // A voxel costs its guide; half of the ceiling is left for the depth of the trees.
        let guides: usize = self.voxels.iter().filter_map(|v| v.guide.as_ref()).map(SamplingTree::bytes).sum();
        let mean = guides / self.voxels.len().max(1) + size_of::<VoxelGuide>() + CELL_BYTES;
        let most = (self.settings.memory / 2) / mean;
        let mut count = self.voxels.len();
        let voxels = &self.voxels;
        let pairs = cache.split(|v| {
            let wanted = voxels[v as usize].eighths.iter().sum::<u32>() > limit && count < most;
            count += usize::from(wanted);
            wanted
        });
        self.voxels.resize_with(cache.len(), || Voxel::new(self.settings.layout, target));
        for (old, new) in pairs {
            let axis = (cache.bounds(new).depth - 1) % 3;
            let [lower, upper] = [0, 1].map(|half| self.voxels[old as usize].half(axis, half));
            (self.voxels[old as usize], self.voxels[new as usize]) = (lower, upper);
        }
    }

    /// Forgets the values of this iteration, keeps voxels, shapes, guides and what earlier iterations left.
    pub fn clear(&mut self) {
        self.outliers = Outliers::default();
        self.blocks.clear();
        self.voxels.par_iter_mut().for_each(|voxel| {
            voxel.tree.clear();
            (voxel.contribution, voxel.squares, voxel.all_squares) = (0.0, Moments::default(), 0.0);
            (voxel.fractions, voxel.shares, voxel.merits) =
                (Moments::default(), Moments::default(), Moments::default());
            voxel.returns = Returns::default();
            (voxel.shaped, voxel.normals, voxel.next_past) = (false, Vec3::ZERO, None);
            voxel.eighths = [0; 8];
        });
    }

    /// What the field was made of; empty unless the settings ask for it.
    pub fn evidence(&self) -> Evidence {
        let voxels = || self.voxels.iter().filter(|_| self.settings.keeps_evidence);
        Evidence { counted: voxels().map(|v| v.counted.clone()).collect(), gain: voxels().map(|v| v.gain).collect() }
    }

    /// The field to sample from.
    pub fn field(&self, of: Use) -> GuideField {
        self.field_of(self.voxels.len(), of)
    }

    /// The same of the first `count` voxels, which is the field of a time when there were no more.
    pub fn field_of(&self, count: usize, of: Use) -> GuideField {
        let Some(cache) = &self.cache else { return GuideField::empty() };
        let guide = |voxel: &Voxel| {
            let bsdf_fraction = match of {
                Use::Learning => LEARNING_FRACTION as f32,
                Use::WhereTold if !voxel.told => 1.0,
                Use::Rendering | Use::WhereTold => voxel.bsdf_fraction,
            };
            let tree = voxel.guide.clone().filter(|_| bsdf_fraction < 1.0);
            VoxelGuide {
                tree,
                parallax: voxel.guide_parallax,
                bsdf_fraction,
                effort: Effort::new(&voxel.known_returns),
            }
        };
        GuideField::new(cache.clone(), self.voxels.iter().take(count).map(guide).collect())
    }
}

/// What `merge` adds up over the voxels of each block of cells.
fn pooled<M: Default + Clone>(voxels: &[Voxel], ancestry: &Ancestry, merge: impl Fn(&mut M, &Voxel)) -> Vec<M> {
    let mut blocks = vec![M::default(); ancestry.sizes[1]];
    for (v, voxel) in voxels.iter().enumerate() {
        merge(&mut blocks[ancestry.block(v)], voxel);
    }
    blocks
}

/// What the blocks send back, each with the whole scene as its surroundings.
fn pooled_returns(voxels: &[Voxel], ancestry: &Ancestry) -> Vec<Returns> {
    let mut scene = Returns::default();
    voxels.iter().for_each(|voxel| scene.merge(&voxel.returns));
    let mut blocks = pooled(voxels, ancestry, |sum: &mut Returns, voxel| sum.merge(&voxel.returns));
    blocks.iter_mut().for_each(|block| block.add_scene(&scene));
    blocks
}

/// Most voxels whose cells and empty guides take at most half of a ceiling of so many bytes.
fn most_voxels(memory: usize) -> usize {
    memory / 2 / (size_of::<VoxelGuide>() + CELL_BYTES)
}

/// Voxels of the records' points; missing ones are made in the order of the records, up to `most`, then there are none.
fn voxels_of(cache: &mut SpatialCache, records: &[PathRecord], most: usize) -> Vec<VoxelId> {
    let known: Vec<Option<VoxelId>> = records.par_iter().map(|r| cache.find(r.point, r.normal)).collect();
    let find = |(voxel, r): (Option<VoxelId>, &PathRecord)| match voxel {
        Some(voxel) => voxel,
        None if cache.len() < most => cache.find_or_insert(r.point, r.normal),
        None => cache.find(r.point, r.normal).unwrap_or(VoxelId::MAX),
    };
    known.into_iter().zip(records).map(find).collect()
}

/// Moves samples by up to half of their voxel's size along each axis, to another voxel where there is one (Müller 2019 §10.2,
/// the stochastic filter). `stream` makes the random numbers.
fn move_voxels(cache: &SpatialCache, stream: (u64, u64), points: &[(Vec3, Vec3)], voxels: &mut [VoxelId]) {
    voxels.par_iter_mut().zip(points).enumerate().filter(|(_, (voxel, _))| **voxel != VoxelId::MAX).for_each(
        |(i, (voxel, &(point, normal)))| {
            let bounds = cache.bounds(*voxel);
            let mut random = Random::new(stream.0, stream.1, i as u64);
            let step = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - 0.5;
            *voxel = cache.find(point + step * (bounds.high - bounds.low), normal).unwrap_or(*voxel);
        },
    );
}
