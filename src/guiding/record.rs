//! What paths leave behind for learning: plain records, merged later in a fixed order.

use glam::Vec3;

use super::leaves::DirectLight;
use super::moments::Estimate;

/// A camera path's sampled direction at one vertex, with what the rest of the path brought back along it.
#[derive(Debug, Clone, Copy)]
pub struct PathRecord {
    /// World position of the vertex.
    pub point: Vec3,
    /// Unit direction that was sampled, away from the vertex; zero where none was that could bring anything.
    pub direction: Vec3,
    /// Channel mean of f·|cos θ|·L̂ / p, radiance. Here L̂ holds light that was hit as it enters the picture, weighted against
    /// light sampling: whoever chooses between BSDF and guide by what trees learn alone, light that is hit left out, gives up
    /// the BSDF samples that a glossy surface needs for a large lamp.
    pub estimate: f32,
    /// Channel mean of the path's throughput before the vertex over the value of its pixel: what the picture sees of the
    /// estimate.
    pub importance: f32,
    /// V for the radiance target, √V for second moments (see [`Target`](super::leaves::Target)): as a root, so that squares
    /// cannot overflow.
    pub value: f32,
    /// Part of the mixture density that is the BSDF's, in [0, 1].
    pub bsdf_share: f32,
    /// Part of `estimate` that is emission which light sampling could have found too.
    pub emitted: f32,
    /// Density of light sampling over that of the mixture in the sampled direction, in [0, ∞].
    pub light_ratio: f32,
    /// Channel mean of the radiance that light sampling sent back from the vertex along the path.
    pub direct: f32,
    /// `bsdf_share` in the direction of the light that was sampled.
    pub direct_share: f32,
    /// `light_ratio` in that direction; ∞ for a light that only light sampling finds.
    pub direct_ratio: f32,
    /// Distance to the next vertex; infinite for the background.
    pub distance: f32,
    /// Shading normal at the vertex, on the side that the path arrived at.
    pub normal: Vec3,
}

impl PathRecord {
    /// Of a path that ended at this vertex because what was drawn is below the horizon, or absorbed. It tells what the vertex sends
    /// back, which is nothing but what light sampling finds, and nothing of directions.
    pub fn absorbed(point: Vec3, normal: Vec3) -> Self {
        Self {
            point,
            direction: Vec3::ZERO,
            estimate: 0.0,
            importance: 0.0,
            value: 0.0,
            bsdf_share: 0.0,
            emitted: 0.0,
            light_ratio: 0.0,
            direct: 0.0,
            direct_share: 1.0,
            direct_ratio: 0.0,
            distance: f32::INFINITY,
            normal,
        }
    }

    /// Whether it has a direction.
    pub fn is_directed(&self) -> bool {
        self.direction != Vec3::ZERO
    }

    /// Squares of what it brought to the picture: without and with light sampling.
    pub fn squares(&self) -> [f64; 2] {
        let [onward, direct] =
            [self.estimate, self.direct].map(|x| (f64::from(self.importance) * f64::from(x)).powi(2));
        [onward, onward + direct]
    }

    /// The part of `value` that photons may show too, where trees learn `direct` light: photons straight from lights that light
    /// sampling finds are left out where they are traced.
    pub fn shown(&self, direct: DirectLight) -> f64 {
        let (all, emitted) = (f64::from(self.estimate), f64::from(self.emitted));
        if emitted <= 0.0 || all <= 0.0 {
            return f64::from(self.value);
        }
        let learned = match direct {
            DirectLight::Nothing => 0.0,
            DirectLight::Weighted => emitted,
            DirectLight::All => emitted + emitted * f64::from(self.light_ratio),
        };
        let onward = (all - emitted).max(0.0);
        if onward > 0.0 { f64::from(self.value) * (onward / (onward + learned)) } else { 0.0 }
    }

    /// What the vertex sent back, by how it was found: the rest of the path, light that the path ran into, light sampling.
    pub fn estimates(&self) -> [Estimate; 3] {
        let (all, emitted, direct) = (f64::from(self.estimate), f64::from(self.emitted), f64::from(self.direct));
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
}
