//! The records of a chunk, voxel by voxel.

use super::cache::parallax::Parallax;
use super::cache::{Ancestry, SpatialCache};
use super::record::{PathRecord, PhotonRecord};
use super::target::Learned;

/// What a chunk brought to the voxels of a cache. The order of records within a voxel is that in which they were traced.
pub struct Samples<'a> {
    paths: &'a [PathRecord],
    photons: &'a [PhotonRecord],
    by_voxel: [Groups; 2],
}

impl<'a> Samples<'a> {
    /// Records with the voxel of each; those at or above `voxels` belong to none.
    pub fn new(
        (paths, path_voxels): (&'a [PathRecord], &[u32]),
        (photons, photon_voxels): (&'a [PhotonRecord], &[u32]),
        voxels: usize,
    ) -> Self {
        Self { paths, photons, by_voxel: [path_voxels, photon_voxels].map(|keys| Groups::new(keys, voxels)) }
    }

    /// The path samples of a voxel.
    pub fn paths(&self, voxel: usize) -> impl Iterator<Item = &'a PathRecord> + Clone {
        let paths = self.paths;
        self.by_voxel[0].group(voxel).iter().map(move |&i| &paths[i as usize])
    }

    /// Its path samples that have a direction.
    pub fn directed(&self, voxel: usize) -> impl Iterator<Item = &'a PathRecord> + Clone {
        self.paths(voxel).filter(|record| record.is_directed())
    }

    /// The photons of a voxel.
    pub fn photons(&self, voxel: usize) -> impl Iterator<Item = &'a PhotonRecord> + Clone {
        let photons = self.photons;
        self.by_voxel[1].group(voxel).iter().map(move |&i| &photons[i as usize])
    }
}

/// How the directions of a voxel are carried to its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheres {
    /// For what is learned now.
    pub learned: Parallax,
    /// For the guide of the last iteration.
    pub guide: Parallax,
}

impl Default for Spheres {
    fn default() -> Self {
        Self { learned: Parallax::NONE, guide: Parallax::NONE }
    }
}

/// What a model of directions is told of a chunk.
pub struct Told<'a> {
    /// The samples.
    pub samples: &'a Samples<'a>,
    /// Whether path samples are learned from; they judge in any case.
    pub paths: bool,
    /// Per voxel how directions are seen.
    pub spheres: &'a [Spheres],
    /// What of path samples is learned.
    pub learned: Learned,
}

/// What a model of directions goes by, beside its samples, when it makes distributions.
pub struct Around<'a> {
    /// The voxels.
    pub cache: &'a SpatialCache,
    /// The groups that they belong to.
    pub ancestry: &'a Ancestry,
    /// Per voxel how directions are seen.
    pub spheres: &'a [Spheres],
    /// Per voxel what its path samples contributed to the picture, in any unit.
    pub contributions: &'a [f64],
    /// Whether distributions as counted are kept for [`Evidence`](super::sample::field::Evidence).
    pub keeps_evidence: bool,
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

    /// The indices whose key is `g`.
    fn group(&self, g: usize) -> &[u32] {
        &self.order[self.start[g] as usize..self.start[g + 1] as usize]
    }
}
