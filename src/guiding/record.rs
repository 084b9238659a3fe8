//! Records that paths leave at their vertices for learning, merged later in a fixed order.

use glam::Vec3;

use super::moments::Estimate;

/// A camera path's sampled direction at one vertex, with the light that the rest of the path brought back along it. It says what
/// happened; [`Learned`](super::target::Learned) decides which part of that is learned.
///
/// Emission that the path hit at its next vertex stands apart where light sampling could have found it too: it is weighted as it
/// enters the picture, by the balance heuristic.
#[derive(Debug, Clone, Copy)]
pub struct PathRecord {
    /// World position of the vertex.
    pub point: Vec3,
    /// Shading normal at the vertex, on the side that the path arrived at; zero in a medium.
    pub normal: Vec3,
    /// Unit direction that was sampled, away from the vertex; zero where none was drawn that could bring light.
    pub direction: Vec3,
    /// Distance to the next vertex; infinite for the background.
    pub distance: f32,
    /// Channel mean of the path's throughput before the vertex over the value of its pixel: the weight of the estimate in the
    /// picture.
    pub importance: f32,
    /// Density of the direction w.r.t. solid angle times the probability that the path went on.
    pub pdf: f32,
    /// Part of the mixture density that is the BSDF's, in [0, 1].
    pub bsdf_share: f32,
    /// Channel means of the radiance that arrived: emission that light sampling could have found too, weighted, and all other.
    pub radiance: Radiance,
    /// Channel means of f·|cos θ|·L / p of both parts, radiance.
    pub brought: Radiance,
    /// Density of light sampling over that of the mixture in the sampled direction, in [0, ∞].
    pub light_ratio: f32,
    /// Channel mean of the radiance that light sampling sent back from the vertex along the path.
    pub direct: f32,
    /// `bsdf_share` in the direction of the light that was sampled.
    pub direct_share: f32,
    /// `light_ratio` in that direction; ∞ for a light that only light sampling finds.
    pub direct_ratio: f32,
}

/// Radiance in two parts, by whether light sampling could have found it too.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Radiance {
    /// Emission that light sampling could have found too, weighted against it.
    pub emitted: f32,
    /// All other radiance.
    pub onward: f32,
}

impl Radiance {
    /// Sum of both parts, as it enters the picture.
    pub fn sum(self) -> f32 {
        self.emitted + self.onward
    }
}

impl PathRecord {
    /// Record of a path that ended at this vertex because the drawn direction is below the horizon, or absorbed. It counts in the
    /// mean of the light that the vertex sends back, of which it has only that of light sampling, and says nothing of directions.
    pub fn absorbed(point: Vec3, normal: Vec3) -> Self {
        Self {
            point,
            normal,
            direction: Vec3::ZERO,
            distance: f32::INFINITY,
            importance: 0.0,
            pdf: 0.0,
            bsdf_share: 0.0,
            radiance: Radiance::default(),
            brought: Radiance::default(),
            light_ratio: 0.0,
            direct: 0.0,
            direct_share: 1.0,
            direct_ratio: 0.0,
        }
    }

    /// Whether the record has a direction.
    pub fn is_directed(&self) -> bool {
        self.direction != Vec3::ZERO
    }

    /// Channel mean of f·|cos θ|·L̂ / p, radiance: light that was hit is weighted against light sampling. A choice between BSDF and
    /// guide by the light that trees learn alone, light that is hit left out, would give up the BSDF samples that a glossy surface
    /// needs for a large lamp.
    pub fn estimate(&self) -> f32 {
        self.brought.sum()
    }

    /// Squared contributions of the vertex to the picture, relative to the pixel: without and with light sampling.
    pub fn squares(&self) -> [f64; 2] {
        let [onward, direct] =
            [self.estimate(), self.direct].map(|x| (f64::from(self.importance) * f64::from(x)).powi(2));
        [onward, onward + direct]
    }

    /// Estimates of the light that the vertex sent back, by how it was found: rest of the path, emission that it hit, light
    /// sampling.
    pub fn estimates(&self) -> [Estimate; 3] {
        let (all, emitted, direct) =
            (f64::from(self.estimate()), f64::from(self.brought.emitted), f64::from(self.direct));
        [
            Estimate { square: all * all - emitted * emitted, bsdf_share: self.bsdf_share, light_ratio: 0.0 },
            Estimate { square: emitted * emitted, bsdf_share: self.bsdf_share, light_ratio: self.light_ratio },
            Estimate { square: direct * direct, bsdf_share: self.direct_share, light_ratio: self.direct_ratio },
        ]
    }
}

/// A photon that arrived at a surface.
#[derive(Debug, Clone, Copy)]
pub struct PhotonRecord {
    /// Number of the light path among those of its chunk.
    pub path: u32,
    /// World position of the surface point.
    pub point: Vec3,
    /// Unit direction towards where the photon came from.
    pub direction: Vec3,
    /// Channel mean of the photon's power, W.
    pub power: f32,
    /// Distance to the previous vertex; infinite from a light at infinity.
    pub distance: f32,
    /// Shading normal at the point, on the side that the photon arrived at.
    pub normal: Vec3,
    /// Whether a delta lobe sent it there: light that camera paths find by chance or not at all.
    pub caustic: bool,
}
