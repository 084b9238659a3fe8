//! Smooth metal: a mirror with a coloured Fresnel factor.

use glam::{Vec2, Vec3};

use super::BsdfSample;
use super::fresnel::Metal;

/// A perfectly smooth conductor on the front side.
#[derive(Debug, Clone)]
pub struct Conductor {
    /// The metal.
    pub metal: Metal,
}

impl Conductor {
    /// The mirrored direction.
    pub fn sample(&self, uv: Vec2, wo: Vec3) -> Option<BsdfSample> {
        (wo.z > 0.0).then(|| BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: self.metal.reflection(uv, wo.z),
            pdf: 1.0,
            delta: true,
        })
    }
}
