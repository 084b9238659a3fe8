//! Lambertian reflection on the front side.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::BsdfSample;
use super::texture::Texture;
use crate::sampling::warp;

/// f = albedo/π where both directions are in front.
#[derive(Debug, Clone)]
pub struct Diffuse {
    /// Albedo.
    pub reflectance: Texture,
}

impl Diffuse {
    /// f·cos θᵢ.
    #[inline]
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z > 0.0 && wi.z > 0.0 { self.reflectance.eval(uv) * (wi.z * FRAC_1_PI) } else { Vec3::ZERO }
    }

    /// Density w.r.t. solid angle.
    #[inline]
    pub fn pdf(wo: Vec3, wi: Vec3) -> f32 {
        if wo.z > 0.0 { warp::square_to_cosine_hemisphere_pdf(wi) } else { 0.0 }
    }

    /// Cosine-distributed direction.
    #[inline]
    pub fn sample(&self, uv: Vec2, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        let wi = warp::square_to_cosine_hemisphere(u);
        let pdf = Self::pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: self.reflectance.eval(uv), pdf, delta: false })
    }
}
