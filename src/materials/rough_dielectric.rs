//! Rough glass: the microfacet model for reflection and refraction.

use glam::Vec3;

use super::fresnel;
use super::microfacet::Microfacets;
use super::{BsdfSample, Transport};

/// A rough interface between two dielectrics (Walter et al. 2007), with separable shadowing.
#[derive(Debug, Clone, Copy)]
pub struct RoughDielectric {
    /// Refractive index behind the surface (−z) over the one in front.
    pub eta: f32,
    /// The facets.
    pub facets: Microfacets,
}

/// A pair of directions seen from the side of the first, and the facet normal that takes one to the other.
struct Geometry {
    wo: Vec3,
    wi: Vec3,
    h: Vec3,
    /// Index on the other side over that on the side of `wo`.
    eta: f32,
    /// Reflected part at the facet.
    reflected: f32,
}

impl Geometry {
    fn reflects(&self) -> bool {
        self.wi.z > 0.0
    }

    /// wo·h + η·wi·h, the length of the half vector of refraction.
    fn half_length(&self) -> f32 {
        self.wo.dot(self.h) + self.eta * self.wi.dot(self.h)
    }
}

impl RoughDielectric {
    /// The surface is the same seen from behind, but for its index.
    fn seen_from(&self, wo: Vec3) -> (Vec3, f32, f32) {
        if wo.z >= 0.0 { (wo, 1.0, self.eta) } else { (-wo, -1.0, 1.0 / self.eta) }
    }

    /// None where no facet takes `wi` to `wo`.
    fn geometry(&self, wo: Vec3, wi: Vec3) -> Option<Geometry> {
        let (wo, side, eta) = self.seen_from(wo);
        let wi = wi * side;
        if wo.z == 0.0 || wi.z == 0.0 {
            return None;
        }
        let h = if wi.z > 0.0 { wo + wi } else { wo + wi * eta }.try_normalize()?;
        let h = if h.z < 0.0 { -h } else { h };
        // A facet is seen from the same side as the surface, by both.
        if wo.dot(h) <= 0.0 || wi.dot(h) * wi.z <= 0.0 {
            return None;
        }
        Some(Geometry { wo, wi, h, eta, reflected: fresnel::dielectric(wo.dot(h).min(1.0), eta).0 })
    }

    /// f·|cos θᵢ| for radiance: Walter et al. 2007, eq. 20 and 21.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(g) = self.geometry(wo, wi) else { return 0.0 };
        let shadowing = self.facets.shadowing(g.wo, g.h) * self.facets.shadowing(g.wi, g.h);
        let facets = self.facets.density(g.h) * shadowing / g.wo.z;
        if g.reflects() {
            return 0.25 * g.reflected * facets;
        }
        let cosines = g.wo.dot(g.h) * g.wi.dot(g.h).abs();
        (1.0 - g.reflected) * facets * cosines / g.half_length().powi(2)
    }

    /// Density of [`RoughDielectric::sample`] w.r.t. solid angle: that of visible facets, times the Jacobians of Walter et al.
    /// 2007, eq. 14 and 17.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(g) = self.geometry(wo, wi) else { return 0.0 };
        let facets = self.facets.visible_density(g.wo, g.h);
        if g.reflects() {
            return g.reflected * facets / (4.0 * g.wo.dot(g.h));
        }
        let jacobian = g.eta * g.eta * g.wi.dot(g.h).abs() / g.half_length().powi(2);
        (1.0 - g.reflected) * facets * jacobian
    }

    /// Reflects or refracts at a visible facet, as `choice` says.
    pub fn sample(&self, wo: Vec3, u: [f32; 2], choice: f32, transport: Transport) -> Option<BsdfSample> {
        let (front, side, eta) = self.seen_from(wo);
        if front.z == 0.0 {
            return None;
        }
        let h = self.facets.sample_visible(front, u);
        let cos = front.dot(h);
        let (reflected, cos_t) = fresnel::dielectric(cos.clamp(0.0, 1.0), eta);
        let reflects = choice < reflected;
        let wi = if reflects { h * (2.0 * cos) - front } else { h * (cos / eta - cos_t) - front / eta };
        // A facet may send light to the wrong side of the surface, where another facet would catch it.
        let wi = wi.normalize() * side;
        if (wi.z * wo.z > 0.0) != reflects {
            return None;
        }
        let pdf = self.pdf(wo, wi);
        // Power is not squeezed into a smaller solid angle as radiance is.
        let squeezed = !reflects && transport == Transport::Importance;
        let scale = if squeezed { eta * eta } else { 1.0 };
        let weight = Vec3::splat(self.eval(wo, wi) / pdf * scale);
        (pdf > 0.0 && weight.is_finite()).then_some(BsdfSample { wi, weight, pdf, delta: false })
    }
}
