//! Smooth metal: a mirror with a coloured Fresnel factor.

use glam::Vec2;

use super::fresnel::{Metal, MetalAt};
use super::{Drawn, Scatter, Transport, mirrored};
use crate::math::lanes::{Real, V3, lanes_of};

/// A perfectly smooth conductor on the front side.
#[derive(Debug, Clone)]
pub struct Conductor {
    /// The metal.
    pub metal: Metal,
}

/// A conductor at surface points.
#[derive(Debug, Clone, Copy)]
pub struct At<R> {
    metal: MetalAt<R>,
}

lanes_of!(At { metal });

impl Conductor {
    /// The conductor at `uv`.
    pub fn at(&self, uv: Vec2) -> At<f32> {
        At { metal: self.metal.at(uv) }
    }
}

impl<R: Real> Scatter<R> for At<R> {
    /// The mirrored direction.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, _: [R; 2], _: Transport) -> Drawn<R> {
        Drawn::of_delta(mirrored(wo), self.metal.reflection(wo.z), wo.z.all(1.0), wo.z.above(0.0))
    }

    #[inline(always)]
    fn delta_probability(&self, wo: V3<R>) -> R {
        wo.z.all(1.0).only(wo.z.above(0.0))
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        self.metal.albedo()
    }
}
