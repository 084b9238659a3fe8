//! The path samples of a pass that brought most to the picture, kept so that judgements by the rest can leave them out.

use crate::guiding::cache::VoxelId;
use crate::guiding::moments::Estimate;
use crate::guiding::record::PathRecord;

/// The path samples of a pass that brought most to the picture.
#[derive(Debug, Clone, Default)]
pub(super) struct Outliers {
    pub found: Vec<Outlier>,
    /// Squared contribution that a sample must exceed to be one of them.
    pub least: f64,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Outlier {
    pub voxel: VoxelId,
    /// See [`PathRecord::squares`].
    pub squares: [f64; 2],
    pub estimates: [Estimate; 3],
}

/// Most samples that are remembered as outliers.
const MOST_OUTLIERS: usize = 1 << 13;

impl Outliers {
    /// Keeps those of `paths` that are among the largest, given the voxel of each.
    pub fn absorb(&mut self, paths: &[PathRecord], voxels: &[VoxelId]) {
        for (record, &voxel) in paths.iter().zip(voxels).filter(|(_, voxel)| **voxel != VoxelId::MAX) {
            let squares = record.squares();
            if squares[1] > self.least {
                self.found.push(Outlier { voxel, squares, estimates: record.estimates() });
            }
            if self.found.len() >= 2 * MOST_OUTLIERS {
                self.keep(MOST_OUTLIERS);
                self.least = self.found.iter().map(|o| o.squares[1]).fold(f64::INFINITY, f64::min);
            }
        }
    }

    /// Adds those of another learner in the first `voxels` voxels.
    pub fn add(&mut self, other: &Self, voxels: usize) {
        self.found.extend(other.found.iter().filter(|outlier| (outlier.voxel as usize) < voxels));
        self.least = self.least.max(other.least);
    }

    fn keep(&mut self, most: usize) {
        if self.found.len() > most {
            self.found.select_nth_unstable_by(most, |a, b| b.squares[1].total_cmp(&a.squares[1]));
            self.found.truncate(most);
        }
    }

    /// The `worst` of them, ordered by voxel.
    pub fn by_voxel(&mut self, worst: usize) -> impl Iterator<Item = &Outlier> {
        self.keep(worst.min(MOST_OUTLIERS));
        self.found.sort_by_key(|outlier| outlier.voxel);
        self.found.iter()
    }
}
