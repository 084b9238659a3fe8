//! Lambertian reflection on the front side.

use std::f32::consts::FRAC_1_PI;

use glam::Vec2;

use super::texture::Texture;
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::{Real, V3, lanes_of};
use crate::sampling::warp;

/// f = albedo/π where both directions are in front.
#[derive(Debug, Clone)]
pub struct Diffuse {
    /// Albedo.
    pub reflectance: Texture,
}

/// A diffuse surface at points.
#[derive(Debug, Clone, Copy, Default)]
pub struct At<R> {
    reflectance: V3<R>,
}

lanes_of!(At { reflectance });

/// Density of cosine-distributed directions on the front side.
#[inline(always)]
pub(super) fn cosine_pdf<R: Real>(wo: V3<R>, wi: V3<R>) -> R {
    warp::lanes::square_to_cosine_hemisphere_pdf(wi).only(wo.z.above(0.0))
}

impl Diffuse {
    /// The surface at `uv`.
    #[inline(always)]
    pub fn at(&self, uv: Vec2) -> At<f32> {
        At { reflectance: self.reflectance.eval(uv).into() }
    }
}

impl<R: Real> At<R> {
    /// A surface of this albedo.
    #[inline(always)]
    pub fn new(reflectance: V3<R>) -> Self {
        Self { reflectance }
    }
}

impl<R: Real> Scatter<R> for At<R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let value = (self.reflectance * (wi.z * FRAC_1_PI)).only(wo.z.above(0.0) & wi.z.above(0.0));
        (value, cosine_pdf(wo, wi))
    }

    /// Cosine-distributed direction.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let wi = warp::lanes::square_to_cosine_hemisphere(u);
        Drawn::of_lobe(wi, self.reflectance, cosine_pdf(wo, wi))
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        self.reflectance
    }
}
