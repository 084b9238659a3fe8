//! The guiding field: what a pass samples from, frozen while the pass runs.

use glam::Vec3;

use super::roulette::AdjointRoulette;
use crate::guiding::cache::SpatialCache;
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::model::Directions;

/// What is known of one voxel.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGuide {
    /// The distribution of directions; none while nothing is known, then the BSDF samples alone.
    pub directions: Option<Directions>,
    /// How its directions are seen from the points of the voxel.
    pub parallax: Parallax,
    /// Probability α of sampling the BSDF instead, in (0, 1].
    pub bsdf_fraction: f32,
    /// How much work a vertex here is worth.
    pub roulette: AdjointRoulette,
}

/// A distribution of directions at a point.
#[derive(Debug, Clone, Copy)]
pub struct DirectionGuide<'a> {
    directions: &'a Directions,
    parallax: &'a Parallax,
    point: Vec3,
    /// Probability α of sampling the BSDF instead, in (0, 1].
    pub bsdf_fraction: f32,
}

impl VoxelGuide {
    /// Its distribution at `point`; none where the BSDF samples alone.
    pub fn at(&self, point: Vec3) -> Option<DirectionGuide<'_>> {
        let (parallax, bsdf_fraction) = (&self.parallax, self.bsdf_fraction);
        let directions = self.directions.as_ref()?;
        Some(DirectionGuide { directions, parallax, point, bsdf_fraction })
    }
}

impl DirectionGuide<'_> {
    /// The direction that a point of the unit square stands for, and its density w.r.t. solid angle.
    pub fn sample(&self, u: [f64; 2]) -> (Vec3, f32) {
        let (direction, pdf) = self.directions.sample(u);
        let seen = self.parallax.from_centre(self.point, direction);
        (seen.direction, pdf * seen.density)
    }

    /// Density of [`DirectionGuide::sample`]. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let seen = self.parallax.to_centre(self.point, direction);
        self.directions.pdf(seen.direction) * seen.density
    }
}

/// What the field was made of, per voxel: to look at, not to sample from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Evidence {
    /// Q_h: the distribution as counted, before reconstruction; none where nothing was, or nothing is reconstructed.
    pub counted: Vec<Option<Directions>>,
    /// Second moment of what a path sample brings to the picture, relative to what BSDF samples alone would bring, in (0, ∞):
    /// below 1 guiding helps. NaN where it was not measured.
    pub gain: Vec<f32>,
}

/// Voxels with their distributions.
#[derive(Debug, Clone)]
pub struct GuideField {
    cache: SpatialCache,
    voxels: Vec<VoxelGuide>,
}

impl GuideField {
    /// A field with one guide per voxel of `cache`.
    pub fn new(cache: SpatialCache, voxels: Vec<VoxelGuide>) -> Self {
        Self { cache, voxels }
    }

    /// The field that knows nothing.
    pub fn empty() -> Self {
        Self::new(SpatialCache::new(Vec3::ZERO, 1.0), Vec::new())
    }

    /// What is known at a point of a surface, on the side that `normal` points to, if anything is.
    pub fn at(&self, point: Vec3, normal: Vec3) -> Option<&VoxelGuide> {
        self.voxels.get(self.cache.find(point, normal)? as usize)
    }

    /// The voxels.
    pub fn cache(&self) -> &SpatialCache {
        &self.cache
    }

    /// The voxels' guides.
    pub fn voxels(&self) -> &[VoxelGuide] {
        &self.voxels
    }

    /// Bytes in use: cache and distributions.
    pub fn bytes(&self) -> usize {
        let distributions: usize = self.distributions().map(Directions::bytes).sum();
        self.cache.bytes() + self.voxels.len() * size_of::<VoxelGuide>() + distributions
    }

    /// The distributions that there are.
    pub fn distributions(&self) -> impl Iterator<Item = &Directions> {
        self.voxels.iter().filter_map(|voxel| voxel.directions.as_ref())
    }

    /// Nodes or cells of all distributions.
    pub fn nodes(&self) -> usize {
        self.distributions().map(Directions::nodes).sum()
    }
}
