//! Learning: records of a pass become quadtrees, and distributions made from those become the next guiding field.
//!
//! Everything is merged in a fixed order (by voxel, then by path), so the result does not depend on the number of threads.

use rayon::prelude::*;

use super::cache::{SpatialCache, VoxelId};
use super::distribution::Distribution;
use super::field::{GuideField, VoxelGuide};
use super::quadtree::Quadtree;
use super::record::{PathRecord, PhotonRecord};
use super::sampler::{NODE_BYTES, SamplingTree};

/// How the field is learned.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnerSettings {
    /// Cells along the diagonal of the scene's visited part, r_init (Zhu 2021 §7).
    pub resolution: f32,
    /// Path samples above which a voxel is halved, k_spt (Zhu 2021 §7).
    pub voxel_samples: u32,
    /// Share of a tree's energy above which a node is split, ρ.
    pub split_share: f64,
    /// Ceiling of the field in bytes.
    pub memory: usize,
}

impl Default for LearnerSettings {
    fn default() -> Self {
        Self { resolution: 24.0, voxel_samples: 8000, split_share: 0.01, memory: 24 << 20 }
    }
}

/// A voxel while it learns.
#[derive(Debug, Clone, Default)]
struct Voxel {
    tree: Quadtree,
    /// Q_r of the last iteration with energy.
    guide: Option<SamplingTree>,
    bsdf_fraction: f32,
    /// Σ of the samples' contributions, and the part that the BSDF is responsible for.
    contribution: f64,
    bsdf_contribution: f64,
    /// Whether the tree got its shape in the current pass.
    shaped: bool,
}

/// Merges records into per-voxel quadtrees.
pub struct Learner {
    settings: LearnerSettings,
    cache: Option<SpatialCache>,
    voxels: Vec<Voxel>,
    frozen: bool,
}

/// Bounds of the learned fraction of BSDF samples.
const FRACTION: [f64; 2] = [0.1, 0.9];

impl Learner {
    /// A learner that has seen nothing.
    pub fn new(settings: LearnerSettings) -> Self {
        Self { settings, cache: None, voxels: Vec::new(), frozen: false }
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

    /// From now on trees keep their shape: samples of several passes can be compared leaf by leaf.
    pub fn freeze_shapes(&mut self) {
        self.frozen = true;
    }

    /// The quadtrees Q_h, one per voxel.
    pub fn trees(&self) -> Vec<&Quadtree> {
        self.voxels.iter().map(|v| &v.tree).collect()
    }

    /// Adds one chunk of records. Path samples make voxels where there are none; photons only enter voxels that exist. The
    /// first chunk of a pass also gives the trees their shape: deposit, split, deposit again.
    /// Where `deposit_paths` is off, path samples make voxels and are not learned from.
    pub fn absorb(&mut self, paths: &[PathRecord], photons: &[PhotonRecord], deposit_paths: bool) {
        if paths.is_empty() && self.cache.is_none() {
            return;
        }
        let resolution = self.settings.resolution;
        let cache = self
            .cache
            .get_or_insert_with(|| SpatialCache::fit(&paths.iter().map(|r| r.point).collect::<Vec<_>>(), resolution));
        let path_voxels = voxels_of(cache, paths);
        self.voxels.resize_with(cache.len(), Voxel::default);
        let photon_voxels: Vec<VoxelId> =
            photons.par_iter().map(|r| cache.find(r.point, r.normal).unwrap_or(VoxelId::MAX)).collect();
        let paths_by_voxel = Groups::new(&path_voxels, self.voxels.len());
        let photons_by_voxel = Groups::new(&photon_voxels, self.voxels.len());
        let cache = &*cache;
        let (share, frozen) = (self.settings.split_share, self.frozen);
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let bounds = cache.bounds(v as VoxelId);
            let own_paths = paths_by_voxel.group(v).iter().map(|&i| &paths[i as usize]);
            let own_photons = photons_by_voxel.group(v).iter().map(|&i| &photons[i as usize]);
            for record in own_paths.clone() {
                let contribution = f64::from(record.estimate);
                voxel.contribution += contribution;
                voxel.bsdf_contribution += contribution * f64::from(record.bsdf_share);
            }
            if own_paths.len() + own_photons.len() == 0 {
                return;
            }
            let deposit = |tree: &mut Quadtree| {
                if deposit_paths {
                    tree.deposit_paths(&bounds, own_paths.clone());
                }
                tree.deposit_photons(&bounds, own_photons.clone());
            };
            deposit(&mut voxel.tree);
            // A tree that is only a root first becomes equal leaves; the second round gives it direction.
            let rounds = if voxel.shaped || frozen { 0 } else { 1 + usize::from(voxel.tree.topology().len() == 1) };
            for _ in 0..rounds {
                voxel.tree = voxel.tree.refined(share);
                deposit(&mut voxel.tree);
            }
            voxel.shaped = true;
        });
    }

    /// Takes the distributions made from [`Learner::trees`] (same order) as the next guides. `uniform` is the part of the
    /// uniform distribution mixed into each. A voxel whose tree holds nothing keeps its old guide. Trees are cut to the most
    /// probable nodes where the field would exceed its ceiling.
    pub fn publish(&mut self, distributions: &[Option<Distribution>], uniform: f32) {
        let cap = self.inner_nodes_cap(distributions);
        self.voxels.par_iter_mut().zip(distributions).for_each(|(voxel, distribution)| {
            if let Some(distribution) = distribution {
                voxel.guide = Some(SamplingTree::new(distribution, uniform, cap));
                voxel.bsdf_fraction = if voxel.contribution > 0.0 {
                    (voxel.bsdf_contribution / voxel.contribution).clamp(FRACTION[0], FRACTION[1]) as f32
                } else {
                    0.5
                };
            }
        });
    }

    /// The largest number of inner nodes per tree with which the whole field stays below its ceiling.
    fn inner_nodes_cap(&self, distributions: &[Option<Distribution>]) -> usize {
        let inner = |d: &Option<Distribution>| d.as_ref().map_or(0, |d| (d.topology().len() - 1) / 4);
        let fixed = self.cache.as_ref().map_or(0, SpatialCache::bytes)
            + self.voxels.len() * (size_of::<VoxelGuide>() + size_of::<SamplingTree>());
        let available = self.settings.memory.saturating_sub(fixed) / NODE_BYTES;
        let total = |cap: usize| distributions.iter().map(|d| inner(d).min(cap)).sum::<usize>();
        let largest = distributions.iter().map(inner).max().unwrap_or(0);
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

    /// Ends a pass: halves voxels with many samples (both halves inherit the tree and the guide) and forgets values.
    pub fn refine(&mut self) {
        let Some(cache) = &mut self.cache else { return };
        // A voxel costs its guide; half of the ceiling is left for the depth of the trees.
        let guides: usize = self.voxels.iter().filter_map(|v| v.guide.as_ref()).map(SamplingTree::bytes).sum();
        let mean = guides / self.voxels.len().max(1) + size_of::<VoxelGuide>() + 64;
        let most = (self.settings.memory / 2) / mean;
        let mut count = self.voxels.len();
        let (limit, voxels) = (self.settings.voxel_samples, &self.voxels);
        let pairs = cache.split(|v| {
            let wanted = voxels[v as usize].tree.counts()[0] > limit && count < most;
            count += usize::from(wanted);
            wanted
        });
        self.voxels.resize_with(cache.len(), Voxel::default);
        for (old, new) in pairs {
            self.voxels[new as usize] = self.voxels[old as usize].clone();
        }
        self.clear();
    }

    /// Forgets all values, keeps voxels, shapes and guides.
    pub fn clear(&mut self) {
        self.voxels.par_iter_mut().for_each(|voxel| {
            voxel.tree.clear();
            (voxel.contribution, voxel.bsdf_contribution) = (0.0, 0.0);
            voxel.shaped = false;
        });
    }

    /// The field to sample from: while `learning` half of the samples come from the BSDF, afterwards each voxel's own share.
    pub fn field(&self, learning: bool) -> GuideField {
        let Some(cache) = &self.cache else { return GuideField::empty() };
        let voxels = self
            .voxels
            .iter()
            .map(|v| VoxelGuide { tree: v.guide.clone(), bsdf_fraction: if learning { 0.5 } else { v.bsdf_fraction } });
        GuideField::new(cache.clone(), voxels.collect())
    }
}

/// Voxels of the records' points; missing ones are made in the order of the records.
fn voxels_of(cache: &mut SpatialCache, records: &[PathRecord]) -> Vec<VoxelId> {
    let known: Vec<Option<VoxelId>> = records.par_iter().map(|r| cache.find(r.point, r.normal)).collect();
    let find =
        |(voxel, r): (Option<VoxelId>, &PathRecord)| voxel.unwrap_or_else(|| cache.find_or_insert(r.point, r.normal));
    known.into_iter().zip(records).map(find).collect()
}

/// Indices grouped by key with their order kept (a counting sort).
struct Groups {
    start: Vec<u32>,
    order: Vec<u32>,
}

impl Groups {
    /// Keys at or above `groups` belong to no group.
    fn new(keys: &[u32], groups: usize) -> Self {
        let mut start = vec![0u32; groups + 1];
        let valid = |key: &u32| (*key as usize) < groups;
        keys.iter().filter(|k| valid(k)).for_each(|&k| start[k as usize + 1] += 1);
        for g in 0..groups {
            start[g + 1] += start[g];
        }
        let mut next = start.clone();
        let mut order = vec![0; start[groups] as usize];
        for (i, &key) in keys.iter().enumerate().filter(|(_, k)| valid(k)) {
            order[next[key as usize] as usize] = i as u32;
            next[key as usize] += 1;
        }
        Self { start, order }
    }

    fn group(&self, g: usize) -> &[u32] {
        &self.order[self.start[g] as usize..self.start[g + 1] as usize]
    }
}
