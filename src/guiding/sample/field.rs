//! The guiding field: the guides of all voxels, which a pass samples from, frozen while it runs.

use glam::Vec3;

use super::roulette::AdjointRoulette;
use crate::guiding::cache::SpatialCache;
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::model::Directions;
use crate::guiding::vmf::mixture::Spot;
use crate::picture::Window;

/// Guide of one voxel.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGuide {
    /// The distribution of directions; where there is none, the BSDF samples alone.
    pub directions: Option<Directions>,
    /// Sphere by which its directions are carried from the centre to the points of the voxel.
    pub parallax: Parallax,
    /// Probability α of sampling the BSDF instead, in (0, 1].
    pub bsdf_fraction: f32,
    /// Probabilities of light sampling and of going on at vertices in the voxel.
    pub roulette: AdjointRoulette,
}

/// A distribution of directions at a point.
#[derive(Debug, Clone, Copy)]
pub struct DirectionGuide<'a> {
    directions: &'a Directions,
    parallax: &'a Parallax,
    /// Where directions are asked for.
    spot: Spot,
    /// Probability α of sampling the BSDF instead, in (0, 1].
    pub bsdf_fraction: f32,
}

impl VoxelGuide {
    /// Distribution of directions at `point`, of whatever surface; none where the BSDF samples alone.
    pub fn at(&self, point: Vec3) -> Option<DirectionGuide<'_>> {
        let (parallax, bsdf_fraction) = (&self.parallax, self.bsdf_fraction);
        let directions = self.directions.as_ref()?;
        let spot = Spot { point, normal: Vec3::ZERO };
        Some(DirectionGuide { directions, parallax, spot, bsdf_fraction })
    }
}

impl DirectionGuide<'_> {
    /// The distribution at a surface that reflects light alone, with this unit normal on the side that is looked at; zero for another
    /// surface, or none. Models of radiance are multiplied with the cosine there.
    #[inline(always)]
    pub fn facing(mut self, normal: Vec3) -> Self {
        self.spot.normal = normal;
        self
    }

    /// Direction that a point of the unit square maps to, and its density w.r.t. solid angle.
    pub fn sample(&self, u: [f64; 2]) -> (Vec3, f32) {
        if let Some(mixture) = self.directions.mixture() {
            return mixture.sample(u, &self.spot);
        }
        let (direction, pdf) = self.directions.sample(u);
        let seen = self.parallax.from_centre(self.spot.point, direction);
        (seen.direction, pdf * seen.density)
    }

    /// Density of [`DirectionGuide::sample`] w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        if let Some(mixture) = self.directions.mixture() {
            return mixture.pdf(direction, &self.spot);
        }
        let seen = self.parallax.to_centre(self.spot.point, direction);
        self.directions.pdf(seen.direction) * seen.density
    }
}

/// Measurements behind the field, per voxel: to look at, not to sample from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Evidence {
    /// Q_h: the distribution as counted, before reconstruction; none where nothing was, or nothing is reconstructed.
    pub counted: Vec<Option<Directions>>,
    /// Second moment of a path sample's contribution to the picture, relative to that with BSDF samples alone, in (0, ∞): below 1
    /// guiding helps. NaN where it was not measured.
    pub gain: Vec<f32>,
}

/// Values that the pixels of a picture will about have, over which guided paths are judged.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelValues {
    /// The picture that they are of, as text: they are of use for no other.
    pub of: String,
    /// The part of the picture that they are of.
    pub window: Window,
    /// Expected channel mean of each pixel of the window, row by row, above 0.
    pub values: Vec<f32>,
}

impl PixelValues {
    /// Those of a part of the picture; none where they are not known.
    pub fn within(&self, part: Window) -> Option<Vec<f32>> {
        let Window { x, y, width, height } = self.window;
        let (right, down) = (part.x.checked_sub(x)?, part.y.checked_sub(y)?);
        let inside = right.checked_add(part.width)? <= width && down.checked_add(part.height)? <= height;
        let row = |row: u32| {
            let begin = (row as usize + down as usize) * width as usize + right as usize;
            self.values.get(begin..begin + part.width as usize)
        };
        let rows: Option<Vec<&[f32]>> = (0..part.height).map(row).collect();
        rows.filter(|_| inside).map(|rows| rows.concat())
    }
}

/// Voxels with their guides.
#[derive(Debug, Clone)]
pub struct GuideField {
    cache: SpatialCache,
    voxels: Vec<VoxelGuide>,
    usual: Option<f32>,
    pixel_values: Option<PixelValues>,
}

impl GuideField {
    /// A field with one guide per voxel of `cache`.
    pub fn new(cache: SpatialCache, voxels: Vec<VoxelGuide>) -> Self {
        let usual = usual_radiance(&voxels);
        Self { cache, voxels, usual, pixel_values: None }
    }

    /// The field with what is known of the picture that it was learned for, or without.
    pub fn with_pixel_values(mut self, values: Option<PixelValues>) -> Self {
        self.pixel_values = values;
        self
    }

    /// What is known of the picture that it was learned for.
    pub fn pixel_values(&self) -> Option<&PixelValues> {
        self.pixel_values.as_ref()
    }

    /// The field without voxels.
    pub fn empty() -> Self {
        Self::new(SpatialCache::new(Vec3::ZERO, 1.0), Vec::new())
    }

    /// The voxel that holds a point of a surface, on the side that `normal` points to; none where there is none.
    #[inline(always)]
    pub fn find(&self, point: Vec3, normal: Vec3) -> Option<u32> {
        self.cache.find(point, normal).filter(|&voxel| (voxel as usize) < self.voxels.len())
    }

    /// Guide of that voxel.
    pub fn at(&self, point: Vec3, normal: Vec3) -> Option<&VoxelGuide> {
        self.find(point, normal).map(|voxel| &self.voxels[voxel as usize])
    }

    /// The voxels.
    pub fn cache(&self) -> &SpatialCache {
        &self.cache
    }

    /// The voxels' guides.
    pub fn voxels(&self) -> &[VoxelGuide] {
        &self.voxels
    }

    /// Radiance that a vertex is taken to send back where no voxel tells, at glass and mirrors above all, W·m⁻²·sr⁻¹: the mean of all
    /// voxels; none where they know nothing, or only of darkness.
    #[inline(always)]
    pub fn usual_radiance(&self) -> Option<f32> {
        self.usual
    }

    /// Bytes in use: cache and distributions.
    pub fn bytes(&self) -> usize {
        let distributions: usize = self.distributions().map(Directions::bytes).sum();
        self.cache.bytes() + self.voxels.len() * size_of::<VoxelGuide>() + distributions
    }

    /// Distributions of all voxels that have one.
    pub fn distributions(&self) -> impl Iterator<Item = &Directions> {
        self.voxels.iter().filter_map(|voxel| voxel.directions.as_ref())
    }

    /// Number of nodes, cells, lobes or Gaussians of all distributions.
    pub fn nodes(&self) -> usize {
        self.distributions().map(Directions::nodes).sum()
    }
}

/// See [`GuideField::usual_radiance`].
fn usual_radiance(voxels: &[VoxelGuide]) -> Option<f32> {
    let known = || voxels.iter().filter_map(|voxel| voxel.roulette.expected());
    let mean = known().map(f64::from).sum::<f64>() / known().count() as f64;
    Some(mean as f32).filter(|mean| mean.is_normal())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_usual_is_the_mean_of_voxels_that_know() {
        let usual = |means: &[Option<f64>]| {
            let of = |&mean: &Option<f64>| VoxelGuide {
                directions: None,
                parallax: Parallax::NONE,
                bsdf_fraction: 1.0,
                roulette: AdjointRoulette::expecting([Some(0.0), mean]),
            };
            GuideField::new(SpatialCache::new(Vec3::ZERO, 1.0), means.iter().map(of).collect()).usual_radiance()
        };
        let known = usual(&[Some(1.0), None, Some(4.0)]).expect("two voxels know");
        assert!((known - 2.5).abs() < 1e-5, "{known}");
        assert_eq!([usual(&[]), usual(&[None]), usual(&[Some(0.0)])], [None; 3]);
    }
}
