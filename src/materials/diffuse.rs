//! Lambertian reflection on the front side.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::texture::Texture;
use super::{BsdfSample, Drawn, Scatter, Transport};
use crate::math::lanes::{Real, V3, lanes_of};
use crate::sampling::warp;

/// f = albedo/π where both directions are in front.
#[derive(Debug, Clone)]
pub struct Diffuse {
    /// Albedo.
    pub reflectance: Texture,
}

/// A diffuse surface at points.
#[derive(Debug, Clone, Copy)]
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
    #[inline]
    pub fn at(&self, uv: Vec2) -> At<f32> {
        At { reflectance: self.reflectance.eval(uv).into() }
    }

    /// f·cos θᵢ.
    #[inline]
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        self.at(uv).eval(wo.into(), wi.into()).into()
    }

    /// Density w.r.t. solid angle.
    #[inline]
    pub fn pdf(wo: Vec3, wi: Vec3) -> f32 {
        cosine_pdf(wo.into(), wi.into())
    }

    /// Cosine-distributed direction.
    #[inline]
    pub fn sample(&self, uv: Vec2, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        self.at(uv).sample(wo.into(), 0.0, u, Transport::Radiance).into()
    }
}

impl<R: Real> Scatter<R> for At<R> {
    #[inline(always)]
    fn eval(&self, wo: V3<R>, wi: V3<R>) -> V3<R> {
        (self.reflectance * (wi.z * FRAC_1_PI)).only(wo.z.above(0.0) & wi.z.above(0.0))
    }

    #[inline(always)]
    fn pdf(&self, wo: V3<R>, wi: V3<R>) -> R {
        cosine_pdf(wo, wi)
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
