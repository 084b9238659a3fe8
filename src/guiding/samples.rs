//! The records of a chunk, voxel by voxel.

use super::cache::parallax::Parallax;
use super::cache::{Ancestry, SpatialCache};
use super::record::{PathRecord, PhotonRecord};
use super::target::Learned;
use crate::base::processor::{prefetch, prefetch_line};

/// Records of a chunk, grouped by voxel. Within a voxel they have the order in which they were traced.
pub struct Samples<'a> {
    paths: &'a [PathRecord],
    photons: &'a [PhotonRecord],
    by_voxel: [Groups; 2],
}

impl<'a> Samples<'a> {
    /// Groups records by the voxel given for each; records of a voxel at or above `voxels` are left out.
    pub fn new(
        (paths, path_voxels): (&'a [PathRecord], &[u32]),
        (photons, photon_voxels): (&'a [PhotonRecord], &[u32]),
        voxels: usize,
    ) -> Self {
        Self { paths, photons, by_voxel: [path_voxels, photon_voxels].map(|keys| Groups::new(keys, voxels)) }
    }

    /// The path samples of a voxel.
    pub fn paths(&self, voxel: usize) -> impl Iterator<Item = &'a PathRecord> + Clone {
        brought_near(self.by_voxel[0].group(voxel), self.paths)
    }

    /// The path samples of a voxel that have a direction.
    pub fn directed(&self, voxel: usize) -> impl Iterator<Item = &'a PathRecord> + Clone {
        self.paths(voxel).filter(|record| record.is_directed())
    }

    /// The photons of a voxel.
    pub fn photons(&self, voxel: usize) -> impl Iterator<Item = &'a PhotonRecord> + Clone {
        brought_near(self.by_voxel[1].group(voxel), self.photons)
    }
}

/// The records of a group, which lie all over the memory: each is on its way before it is read.
fn brought_near<'g, 'a: 'g, R>(group: &'g [u32], records: &'a [R]) -> impl Iterator<Item = &'a R> + Clone {
    const AHEAD: usize = 8;
    group.iter().enumerate().map(move |(place, &index)| {
        if let Some(&ahead) = group.get(place + AHEAD) {
            let ahead = &records[ahead as usize];
            prefetch(ahead);
            prefetch_line(std::ptr::from_ref(ahead).wrapping_add(1).cast::<u8>().wrapping_sub(1));
        }
        &records[index as usize]
    })
}

/// Spheres by which the directions of a voxel are carried to its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheres {
    /// Sphere for the samples that are learned from now.
    pub learned: Parallax,
    /// Sphere for the guide of the last iteration.
    pub guide: Parallax,
}

impl Default for Spheres {
    fn default() -> Self {
        Self { learned: Parallax::NONE, guide: Parallax::NONE }
    }
}

/// Samples of a chunk for a model of directions, with the rules for learning from them.
pub struct Told<'a> {
    /// The samples, in the voxels whose guides drew them.
    pub drawn: &'a Samples<'a>,
    /// The same where they are learned from: filters move them.
    pub samples: &'a Samples<'a>,
    /// The voxels.
    pub cache: &'a SpatialCache,
    /// Whether path samples are learned from; they judge guides in any case.
    pub paths: bool,
    /// Spheres of each voxel.
    pub spheres: &'a [Spheres],
    /// Target of path samples, and the rule for their direct light.
    pub learned: Learned,
}

/// Data beside the samples from which a model of directions makes distributions.
pub struct Around<'a> {
    /// The voxels.
    pub cache: &'a SpatialCache,
    /// The groups that they belong to.
    pub ancestry: &'a Ancestry,
    /// Spheres of each voxel.
    pub spheres: &'a [Spheres],
    /// Contribution of each voxel's path samples to the picture, in any unit.
    pub contributions: &'a [f64],
    /// Whether distributions are also kept as counted, for [`Evidence`](super::sample::field::Evidence).
    pub keeps_evidence: bool,
}

/// Indices grouped by key with their order kept (a counting sort).
struct Groups {
    start: Vec<u32>,
    order: Vec<u32>,
}

impl Groups {
    /// Groups the indices of `keys`; keys at or above `groups` belong to no group.
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
