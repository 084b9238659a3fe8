//! Rough metal: the Torrance-Sparrow microfacet model.

use glam::{Vec2, Vec3};

use super::BsdfSample;
use super::fresnel::Metal;
use super::microfacet::Microfacets;

/// f = F·D·G / (4 cos θₒ cos θᵢ) on the front side (Walter et al. 2007, eq. 20), with separable shadowing.
#[derive(Debug, Clone)]
pub struct RoughConductor {
    /// The metal.
    pub metal: Metal,
    /// The facets.
    pub facets: Microfacets,
}

impl RoughConductor {
    /// f·cos θᵢ.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Vec3::ZERO;
        }
        let Some(h) = (wo + wi).try_normalize() else { return Vec3::ZERO };
        let d = self.facets.density(h);
        if d == 0.0 {
            return Vec3::ZERO;
        }
        let g = self.facets.shadowing(wo, h) * self.facets.shadowing(wi, h);
        self.metal.reflection(uv, wo.dot(h)) * (d * g / (4.0 * wo.z))
    }

    /// Density w.r.t. solid angle of the reflected direction.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let Some(h) = (wo + wi).try_normalize() else { return 0.0 };
        let cos = wo.dot(h);
        if cos <= 0.0 { 0.0 } else { self.facets.visible_density(wo, h) / (4.0 * cos) }
    }

    /// Reflects at a visible facet.
    pub fn sample(&self, uv: Vec2, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let h = self.facets.sample_visible(wo, u);
        let wi = h * (2.0 * wo.dot(h)) - wo;
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: self.eval(uv, wo, wi) / pdf, pdf, delta: false })
    }
}
