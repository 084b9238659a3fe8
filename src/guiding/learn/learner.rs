//! Learning: records of a pass become distributions of directions, and those become the next guiding field. Directions are learned
//! by a [`Model`]; voxels, and all that is learned beside directions, are here.
//!
//! Everything is merged in a fixed order (by voxel, then by path), so the result does not depend on the number of threads.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::LEARNING_FRACTION;
use super::adjoint::Adjoint;
use super::fraction::FractionRule;
use super::outliers::Outliers;
use super::voxel::Voxel;
use crate::base::Result;
use crate::base::random::Random;
use crate::guiding::cache::{Ancestry, CELL_BYTES, SpatialCache, VoxelId};
use crate::guiding::model::{Directions, Model, ModelKind};
use crate::guiding::moments::{Moments, PictureMoments};
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::sample::field::{Evidence, GuideField, VoxelGuide};
use crate::guiding::sample::roulette::AdjointRoulette;
use crate::guiding::samples::{Around, Samples, Spheres, Told};
use crate::guiding::target::{DirectLight, Learned, Target};
use crate::guiding::tree::sampler::SamplingTree;
use crate::guiding::tree::{CountedTree, Propose, TreeSettings};

/// Settings of a [`Learner`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnerSettings {
    /// Cells along the diagonal of the scene's visited part, r_init (Zhu 2021 §7).
    pub resolution: f32,
    /// Whether surfaces that face differently have voxels of their own.
    pub facing: bool,
    /// Path samples above which a voxel is halved, k_spt (Zhu 2021 §7) or c (Müller 2017 §3.1).
    pub voxel_samples: u32,
    /// Whether `voxel_samples` grows with √(samples per pixel) of the iteration (Müller 2017 §3.1).
    pub growing: bool,
    /// Model that learns directions.
    pub model: ModelKind,
    /// Settings of its quadtrees, if it has any.
    pub tree: TreeSettings,
    /// Quantity that distributions become proportional to.
    pub target: Target,
    /// Rule for light that light sampling finds too.
    pub direct: DirectLight,
    /// Rule for the fraction of BSDF samples, the rest being drawn from the guide.
    pub fraction: FractionRule,
    /// Iterations in which the second moment is learned before that relative to the pixel: with few samples the values of pixels are
    /// mostly noise (Nilsson 2022 §4.4, after Rath 2020, who calls the former the simple target).
    pub simple_iterations: u32,
    /// Whether directions are kept for the centres of voxels, see [`Parallax`](crate::guiding::cache::parallax::Parallax).
    pub parallax: bool,
    /// Largest size of the field in bytes.
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
            model: ModelKind::Trees,
            tree: TreeSettings::default(),
            target: Target::Variance,
            direct: DirectLight::All,
            fraction: FractionRule::Moments,
            simple_iterations: 0,
            parallax: true,
            memory: 24 << 20,
            keeps_evidence: false,
        }
    }
}

/// Purpose of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// To learn more: half of the samples come from the BSDF, or the part that a descent has learned so far.
    Learning,
    /// Each voxel has its own fraction of BSDF samples; a voxel that is better off without its guide has no guide.
    Rendering,
    /// As for rendering, but without guides where too few paths have found light to tell, unless photons show where light is.
    WhereTold,
}

/// Learns the guides of voxels from the records of paths.
pub struct Learner {
    pub(super) settings: LearnerSettings,
    pub(super) cache: Option<SpatialCache>,
    pub(super) voxels: Vec<Voxel>,
    pub(super) model: Model,
    /// Groups that voxels belonged to when the last distributions were made.
    ancestry: Ancestry,
    pub(super) iterations: u32,
    /// Number of chunks so far, for random numbers.
    pub(super) chunks: u64,
    /// Whether the spheres that directions refer to are never fitted anew.
    pub(super) keeps_spheres: bool,
    pub(super) outliers: Outliers,
    /// Whether the fractions of BSDF samples go by all samples of this iteration.
    chosen: bool,
}

/// Largest number of samples that the moments of a voxel's surroundings count as.
const PRIOR_SAMPLES: f64 = 256.0;

impl Learner {
    /// A learner without voxels.
    pub fn new(settings: LearnerSettings) -> Self {
        let mut learner = Self {
            model: Model::new(settings.model, &settings.tree, settings.target, 0),
            settings,
            cache: None,
            voxels: Vec::new(),
            ancestry: Ancestry::default(),
            iterations: 0,
            chunks: 0,
            keeps_spheres: false,
            outliers: Outliers::default(),
            chosen: false,
        };
        learner.model.clear(learner.target());
        learner
    }

    /// Target of this iteration.
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

    /// Model that learns directions.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Model that learns directions, mutable.
    pub fn model_mut(&mut self) -> &mut Model {
        &mut self.model
    }

    /// A new learner with the voxels of this one and the spheres on which their light starts, and nothing else.
    pub fn restarted(&self, settings: LearnerSettings) -> Self {
        let learned = |old: &Voxel| Spheres { learned: old.spheres.learned, ..Spheres::default() };
        let mut learner = Self::new(settings);
        learner.voxels = self.voxels.iter().map(|old| Voxel { spheres: learned(old), ..Voxel::default() }).collect();
        learner.model.resize(self.voxels.len());
        Self { cache: self.cache.clone(), keeps_spheres: true, ..learner }
    }

    /// Keeps the spheres that directions refer to from now on.
    pub fn freeze_spheres(&mut self) {
        self.keeps_spheres = true;
    }

    /// Forgets the samples of this iteration, and keeps from now on the shapes that they gave trees and spheres: samples of several
    /// learners can be added up then.
    pub fn begin_share(&mut self) {
        self.clear();
        self.freeze_spheres();
        if let Some(trees) = self.model.trees_mut() {
            trees.freeze_shapes();
        }
    }

    /// Adds the samples that another learner has taken of the first `voxels` voxels since both were the same at
    /// [`Learner::begin_share`]; returns whether they were.
    pub fn add(&mut self, other: &Self, voxels: usize) -> bool {
        let enough = self.voxels.len() >= voxels && other.voxels.len() >= voxels;
        let (Some(own), Some(trees), true) = (self.model.trees_mut(), other.model.trees(), enough) else {
            return false;
        };
        let same = own.add(trees, voxels);
        self.voxels.iter_mut().zip(&other.voxels).take(voxels).for_each(|(own, other)| own.add(other));
        self.outliers.add(&other.outliers, voxels);
        self.chosen = false;
        same
    }

    /// Adds one chunk of records. Path samples make voxels where there are none; photons only enter voxels that exist. The first
    /// chunk of a pass also gives trees their shapes. Where `deposit_paths` is off, path samples make voxels and judge guides, but
    /// are not learned from.
    ///
    /// Returns the voxel that each photon fell into, [`VoxelId::MAX`] for none.
    pub fn absorb(&mut self, paths: &[PathRecord], photons: &[PhotonRecord], deposit_paths: bool) -> Vec<VoxelId> {
        let mut path_voxels = self.make_voxels(paths);
        let reached = self.find_voxels(photons, |photon| (photon.point, photon.normal));
        let Some(cache) = &self.cache else { return reached };
        let samples = Samples::new((paths, &path_voxels), (photons, &reached), self.voxels.len());
        self.outliers.absorb(paths, &path_voxels);
        let moved = self.settings.tree.filtered.then(|| {
            self.chunks += 1;
            let mut photon_voxels = reached.clone();
            let moved = |kind, points: Vec<(Vec3, Vec3)>, voxels: &mut [VoxelId]| {
                move_voxels(cache, (self.chunks, kind), &points, voxels)
            };
            moved(0, paths.iter().map(|r| (r.point, r.normal)).collect(), &mut path_voxels);
            moved(1, photons.iter().map(|r| (r.point, r.normal)).collect(), &mut photon_voxels);
            Samples::new((paths, &path_voxels), (photons, &photon_voxels), self.voxels.len())
        });
        self.judge_samples(&samples);
        self.deposit_samples(&samples, moved.as_ref().unwrap_or(&samples), deposit_paths);
        reached
    }

    /// Judges guides by one chunk of path samples, which make voxels where there are none. What is to be learned from them is told to
    /// [`Learner::deposit`] later, in one chunk of the whole pass, which must not [move](TreeSettings::filtered) them.
    pub fn judge(&mut self, paths: &[PathRecord]) {
        let voxels = self.make_voxels(paths);
        self.outliers.absorb(paths, &voxels);
        self.judge_samples(&Samples::new((paths, &voxels), (&[], &[]), self.voxels.len()));
    }

    /// Learns from path samples that have [judged](Learner::judge) guides, and from photons: both steps together do what
    /// [`Learner::absorb`] does. Returns the voxel that each photon fell into.
    pub fn deposit(&mut self, paths: &[PathRecord], photons: &[PhotonRecord], deposit_paths: bool) -> Vec<VoxelId> {
        let path_voxels = self.find_voxels(paths, |path| (path.point, path.normal));
        let reached = self.find_voxels(photons, |photon| (photon.point, photon.normal));
        let samples = Samples::new((paths, &path_voxels), (photons, &reached), self.voxels.len());
        self.deposit_samples(&samples, &samples, deposit_paths);
        reached
    }

    /// Voxels of path samples; missing ones are made, as far as the memory allows.
    fn make_voxels(&mut self, paths: &[PathRecord]) -> Vec<VoxelId> {
        if paths.is_empty() && self.cache.is_none() {
            return Vec::new();
        }
        let LearnerSettings { resolution, facing, memory, .. } = self.settings;
        let cache = self.cache.get_or_insert_with(|| {
            let cache = SpatialCache::fit(&paths.iter().map(|r| r.point).collect::<Vec<_>>(), resolution);
            if facing { cache } else { cache.without_facing() }
        });
        let voxels = voxels_of(cache, paths, most_voxels(memory));
        self.voxels.resize_with(cache.len(), Voxel::default);
        self.model.resize(cache.len());
        voxels
    }

    /// Voxels of records with these points and normals, [`VoxelId::MAX`] where there is none.
    fn find_voxels<R: Sync>(&self, records: &[R], place: impl Fn(&R) -> (Vec3, Vec3) + Sync) -> Vec<VoxelId> {
        let find = |record| {
            let (point, normal) = place(record);
            self.cache.as_ref()?.find(point, normal)
        };
        records.par_iter().map(|record| find(record).unwrap_or(VoxelId::MAX)).collect()
    }

    fn judge_samples(&mut self, samples: &Samples) {
        let rule = self.settings.fraction;
        self.chosen = false;
        let judge = |(v, voxel): (usize, &mut Voxel)| samples.paths(v).for_each(|record| voxel.judge(record, rule));
        self.voxels.par_iter_mut().enumerate().for_each(judge);
    }

    /// Learns from `samples`; `drawn` are the same in the voxels whose guides drew them.
    fn deposit_samples(&mut self, drawn: &Samples, samples: &Samples, deposit_paths: bool) {
        let Some(cache) = &self.cache else { return };
        let learned = Learned { target: self.target(), direct: self.settings.direct };
        let model = &self.model;
        let fits = self.settings.parallax && !self.keeps_spheres;
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let bounds = cache.bounds(v as VoxelId);
            let deposited = samples.directed(v).filter(|_| deposit_paths);
            let any = deposited.clone().next().is_some() || samples.photons(v).next().is_some();
            if any && fits && !voxel.begun {
                let share = model.path_share(v);
                voxel.spheres.learned = voxel.fitted_sphere(&bounds, learned, share, deposited, samples.photons(v));
            }
            voxel.begun |= any;
            voxel.count(&bounds, samples.directed(v), samples.photons(v));
        });
        let spheres = self.spheres();
        self.model.observe(&Told { drawn, samples, cache, paths: deposit_paths, spheres: &spheres, learned });
    }

    fn spheres(&self) -> Vec<Spheres> {
        self.voxels.iter().map(|voxel| voxel.spheres).collect()
    }

    /// Whether light paths have reached a voxel in this iteration.
    pub fn has_photons(&self) -> bool {
        self.voxels.iter().any(|voxel| voxel.photons > 0)
    }

    /// The quadtrees as counted, one per voxel, where the model is of quadtrees; none where neither a voxel nor its surroundings
    /// hold energy.
    pub fn counted(&mut self) -> Vec<Option<CountedTree<'_>>> {
        let spheres = self.spheres();
        let contributions: Vec<f64> = self.voxels.iter().map(|voxel| voxel.contribution).collect();
        let Some(cache) = &self.cache else { return Vec::new() };
        self.ancestry = cache.ancestry();
        self.model.counted(&Around {
            cache,
            ancestry: &self.ancestry,
            spheres: &spheres,
            contributions: &contributions,
            keeps_evidence: false,
        })
    }

    /// Factor in (0, 1] by which photons lower the second moment of guided samples, averaged over voxels by their contribution to
    /// the picture; none before it was measured.
    pub fn photon_gain(&self) -> Option<f64> {
        // Voxels whose few samples do not tell have to be left out: they are those that photons may be needed for.
        let measured =
            self.voxels.iter().enumerate().filter_map(|(v, voxel)| Some((voxel, self.model.photon_gain(v)?)));
        let (sum, weight) =
            measured.fold((0.0, 0.0), |s, (v, gain)| (s.0 + v.contribution * gain, s.1 + v.contribution));
        (weight > 0.0).then(|| sum / weight)
    }

    /// Second moments of the picture with and without the guides that were sampled, the `worst` samples left out. To be asked before
    /// [`Learner::fit`] makes others. Voxels have the fractions of BSDF samples from then on that were best with these guides.
    pub fn picture_moments(&mut self, worst: usize) -> PictureMoments {
        self.choose_fractions();
        let mut sum = PictureMoments::default();
        let (mut squares, mut shown) = (Moments::<1>::default(), 0.0);
        let bounds = |v: usize| self.cache.as_ref().map(|cache| cache.bounds(v as VoxelId));
        let mut outliers = self.outliers.by_voxel(worst).peekable();
        for (v, voxel) in self.voxels.iter().enumerate() {
            let by_photons = bounds(v).map_or(0.0, |bounds| voxel.shown_by_photons(&bounds));
            shown += by_photons;
            sum.unseen += if voxel.contribution > 0.0 { 0.0 } else { by_photons };
            let drawn = f64::from(voxel.drawn_fraction);
            let (mut own, mut all, mut fractions) = (voxel.squares, voxel.all_squares, voxel.fractions);
            while let Some(outlier) = outliers.next_if(|outlier| outlier.voxel as usize == v) {
                own.remove([outlier.squares[0]]);
                all = (all - outlier.squares[1]).max(0.0);
                fractions.remove_estimates(&outlier.estimates, drawn);
            }
            let relative = fractions.relative(drawn, f64::from(voxel.bsdf_fraction)).unwrap_or([1.0; 3]);
            let [learning, guided, unguided] = relative.map(|moment| all * moment);
            sum.learning += learning;
            sum.guided += guided;
            sum.unguided += unguided;
            squares.merge(&own);
        }
        [sum.onward] = squares.sums();
        sum.effective = squares.effective();
        sum.unseen /= if shown > 0.0 { shown } else { 1.0 };
        sum
    }

    /// [`Learner::picture_moments`] in the middle of a pass: nothing is chosen by them.
    pub fn moments_so_far(&mut self, worst: usize) -> PictureMoments {
        let outliers = self.outliers.clone();
        let chosen: Vec<_> = self.voxels.iter().map(|voxel| (voxel.bsdf_fraction, voxel.best, voxel.gain)).collect();
        let moments = self.picture_moments(worst);
        (self.outliers, self.chosen) = (outliers, false);
        for (voxel, chosen) in self.voxels.iter_mut().zip(chosen) {
            (voxel.bsdf_fraction, voxel.best, voxel.gain) = chosen;
        }
        moments
    }

    /// Makes the next guides, those on quadtrees from the proposals of `propose`. A voxel that gets none keeps the one that it has.
    ///
    /// # Errors
    /// Those of `propose`.
    pub fn fit(&mut self, propose: &mut Propose) -> Result<()> {
        self.choose_fractions();
        let spheres = self.spheres();
        let contributions: Vec<f64> = self.voxels.iter().map(|voxel| voxel.contribution).collect();
        let Some(cache) = &self.cache else { return Ok(()) };
        let around = Around {
            cache,
            ancestry: &self.ancestry,
            spheres: &spheres,
            contributions: &contributions,
            keeps_evidence: self.settings.keeps_evidence,
        };
        let fixed = cache.bytes() + self.voxels.len() * (size_of::<VoxelGuide>() + size_of::<SamplingTree>());
        let guides = self.model.fit(&around, propose, self.settings.memory.saturating_sub(fixed))?;
        self.publish(guides);
        Ok(())
    }

    /// Chooses for each voxel the fraction of BSDF samples by what this iteration has measured of the guides that it sampled; a voxel of
    /// which too little is known keeps the fraction that it has.
    fn choose_fractions(&mut self) {
        let Some(cache) = self.cache.as_ref().filter(|_| !self.chosen) else { return };
        self.chosen = true;
        self.ancestry = cache.ancestry();
        let ancestry = &self.ancestry;
        let fractions = ancestry.pooled(&self.voxels, |sum: &mut Moments<_>, v| sum.merge(&v.fractions));
        let LearnerSettings { fraction: rule, keeps_evidence, .. } = self.settings;
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let mut measured = voxel.fractions;
            measured.add_prior(&fractions[ancestry.block(v)].without(&voxel.fractions), PRIOR_SAMPLES);
            voxel.best = measured.best();
            let chosen = voxel.chosen_fraction(rule);
            voxel.bsdf_fraction = chosen.unwrap_or(voxel.bsdf_fraction);
            if keeps_evidence {
                let relative = measured.relative(voxel.drawn_fraction.into(), voxel.bsdf_fraction.into());
                voxel.gain = relative.map_or(f32::NAN, |[_, chosen, bsdf]| (chosen / bsdf) as f32);
            }
        });
    }

    /// Gives voxels their guides, with the fractions that were best with those before.
    fn publish(&mut self, guides: Vec<Option<Directions>>) {
        let (ancestry, keeps) = (&self.ancestry, self.model.keeps_guides());
        let adjoint = pooled_adjoint(&self.voxels, ancestry);
        let rule = self.settings.fraction;
        self.voxels.par_iter_mut().zip(guides).enumerate().for_each(|(v, (voxel, guide))| {
            let block = ancestry.block(v);
            voxel.known_adjoint = voxel.adjoint;
            voxel.known_adjoint.add_prior(&adjoint[block], PRIOR_SAMPLES);
            if guide.is_none() && keeps {
                return;
            }
            voxel.spheres.guide = voxel.spheres.learned;
            voxel.guide = guide;
            voxel.told = voxel.best.is_some() || voxel.lit;
            voxel.bsdf_fraction = voxel.chosen_fraction(rule).unwrap_or(LEARNING_FRACTION as f32);
            // Müller 2019 §10.5 draws by what has been learned so far; other rules by what judges all fractions alike.
            voxel.drawn_fraction =
                if rule == FractionRule::Adam { voxel.bsdf_fraction } else { LEARNING_FRACTION as f32 };
        });
    }

    /// Ends a pass: halves voxels with many samples (both halves inherit the guide and the past) until none has too many (Müller
    /// 2017 §3.2, Zhu 2021 §7), and forgets the samples. The pass had `spp` camera paths per pixel. How the samples lie within an eighth of a
    /// voxel is not known: no part becomes smaller than that, unless the limit is growing, where they are taken to lie evenly (Müller 2017).
    pub fn refine(&mut self, spp: u32) {
        if self.cache.is_none() {
            return;
        }
        self.model.turn();
        let growth = if self.settings.growing { f64::from(spp).sqrt() } else { 1.0 };
        let limit = (f64::from(self.settings.voxel_samples) * growth) as u32;
        loop {
            let before = self.voxels.len();
            // Once along each axis.
            for _ in 0..3 {
                self.halve(limit);
            }
            if !self.settings.growing || self.voxels.len() == before {
                break;
            }
            self.voxels.iter_mut().for_each(Voxel::spread);
        }
        self.iterations += 1;
        self.clear();
    }

    /// Halves the voxels with more path samples than `limit`, as far as the memory allows.
    fn halve(&mut self, limit: u32) {
        let Some(cache) = &mut self.cache else { return };
        // A voxel costs its guide; half of the ceiling is left for the depth of the trees.
        let guides: usize = self.voxels.iter().filter_map(|v| v.guide.as_ref()).map(Directions::bytes).sum();
        let mean = guides / self.voxels.len().max(1) + size_of::<VoxelGuide>() + CELL_BYTES;
        let most = (self.settings.memory / 2) / mean;
        let mut count = self.voxels.len();
        let voxels = &self.voxels;
        let pairs = cache.split(|v| {
            let wanted = voxels[v as usize].paths() > limit && count < most;
            count += usize::from(wanted);
            wanted
        });
        self.voxels.resize_with(cache.len(), Voxel::default);
        self.model.resize(cache.len());
        for (old, new) in pairs {
            let axis = (cache.bounds(new).depth - 1) % 3;
            let (old, new) = (old as usize, new as usize);
            let halves = [0, 1].map(|half| self.voxels[old].half(axis, half));
            let all = f64::from(self.voxels[old].paths());
            self.model.halve(old, new, halves.each_ref().map(|half| f64::from(half.paths()) / all));
            [self.voxels[old], self.voxels[new]] = halves;
        }
    }

    /// Forgets the samples of this iteration, keeps voxels, guides and the distributions of earlier iterations.
    pub fn clear(&mut self) {
        (self.outliers, self.chosen) = (Outliers::default(), false);
        self.model.clear(self.target());
        self.voxels.par_iter_mut().for_each(Voxel::clear);
    }

    /// Measurements behind the field; empty unless the settings ask for them.
    pub fn evidence(&self) -> Evidence {
        if !self.settings.keeps_evidence {
            return Evidence::default();
        }
        Evidence { counted: self.model.evidence(), gain: self.voxels.iter().map(|v| v.gain).collect() }
    }

    /// The field to sample from.
    pub fn field(&self, of: Use) -> GuideField {
        self.field_of(self.voxels.len(), of)
    }

    /// The field of the first `count` voxels, as it was at a time when there were no more.
    pub fn field_of(&self, count: usize, of: Use) -> GuideField {
        let Some(cache) = &self.cache else { return GuideField::empty() };
        let guide = |voxel: &Voxel| {
            let bsdf_fraction = match of {
                Use::Learning => voxel.drawn_fraction,
                Use::WhereTold if !voxel.told => 1.0,
                Use::Rendering | Use::WhereTold => voxel.bsdf_fraction,
            };
            VoxelGuide {
                directions: voxel.guide.clone().filter(|_| bsdf_fraction < 1.0),
                parallax: voxel.spheres.guide,
                bsdf_fraction,
                roulette: AdjointRoulette::expecting(voxel.known_adjoint.means()),
            }
        };
        GuideField::new(cache.clone(), self.voxels.iter().take(count).map(guide).collect())
    }
}

/// Radiance that each block sends back, with the whole scene as a prior.
fn pooled_adjoint(voxels: &[Voxel], ancestry: &Ancestry) -> Vec<Adjoint> {
    let mut scene = Adjoint::default();
    voxels.iter().for_each(|voxel| scene.merge(&voxel.adjoint));
    let mut blocks = ancestry.pooled(voxels, |sum: &mut Adjoint, voxel| sum.merge(&voxel.adjoint));
    blocks.iter_mut().for_each(|block| block.add_scene(&scene));
    blocks
}

/// Largest number of voxels whose cells and empty guides take at most half of a ceiling of so many bytes.
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
