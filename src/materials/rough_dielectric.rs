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

/// Indices closer to 1 than this are no interface: refraction would turn light by less than single precision resolves, into a
/// lobe of infinite density, and next to nothing would be reflected (2.5e-7).
pub const LEAST_STEP: f32 = 1e-3;

/// A pair of directions seen from the side of the first, and the facet normal that takes one to the other.
pub(super) struct Geometry {
    pub wo: Vec3,
    pub wi: Vec3,
    pub h: Vec3,
    /// wo·h > 0.
    pub cos_o: f32,
    /// |wi·h|.
    pub cos_i: f32,
    /// Index on the other side over that on the side of `wo`.
    pub eta: f32,
    /// Squared length of wo + η·wi where light is refracted, else 0.
    half_squared: f32,
}

impl Geometry {
    /// The geometry of a pair; none where no facet takes `wi` to `wo`. `eta` is the index behind the surface over the one in front.
    ///
    /// The half vector of refraction is a small difference of long vectors, which decides how far from the centre of a narrow
    /// lobe a direction lies: it takes double precision.
    pub fn new(wo: Vec3, wi: Vec3, eta: f32) -> Option<Self> {
        if wo.z == 0.0 || wi.z == 0.0 {
            return None;
        }
        let side = 1.0f32.copysign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        // Indices on the sides of wo and wi.
        let [outer, inner] = if side > 0.0 { [1.0, f64::from(eta)] } else { [f64::from(eta), 1.0] };
        let (long_o, long_i) = (wo.as_dvec3(), wi.as_dvec3());
        let refracts = wi.z < 0.0;
        let half = if refracts { long_o * outer + long_i * inner } else { long_o + long_i };
        let squared = half.length_squared();
        let h = half / (squared.sqrt().copysign(half.z));
        let (cos_o, cos_i) = (long_o.dot(h), long_i.dot(h) * if refracts { -1.0 } else { 1.0 });
        // A facet is seen from the same side as the surface, by both.
        if !(h.is_finite() && cos_o > 0.0 && cos_i > 0.0) {
            return None;
        }
        let half_squared = if refracts { (squared / (outer * outer)) as f32 } else { 0.0 };
        let eta = (inner / outer) as f32;
        Some(Self { wo, wi, h: h.as_vec3(), cos_o: cos_o as f32, cos_i: cos_i as f32, eta, half_squared })
    }

    pub fn reflects(&self) -> bool {
        self.wi.z > 0.0
    }

    /// Fresnel reflectance and transmittance of the facet.
    pub fn fresnel(&self) -> [f32; 2] {
        let cos = self.cos_o.min(1.0);
        [fresnel::dielectric(cos, self.eta).0, fresnel::transmitted(cos, self.eta)]
    }

    /// dω_h/dω_i of refraction (Walter et al. 2007, eq. 17).
    pub fn jacobian(&self) -> f32 {
        self.eta * self.eta * self.cos_i / self.half_squared
    }
}

impl RoughDielectric {
    /// `wo` turned to the front, its side (1 front, -1 back), and the index from there: from behind, only the index differs.
    fn seen_from(&self, wo: Vec3) -> (Vec3, f32, f32) {
        if wo.z >= 0.0 { (wo, 1.0, self.eta) } else { (-wo, -1.0, 1.0 / self.eta) }
    }

    /// f·|cos θᵢ| for radiance: Walter et al. 2007, eq. 20 and 21.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(g) = Geometry::new(wo, wi, self.eta) else { return 0.0 };
        let shadowing = self.facets.shadowing(g.wo, g.h) * self.facets.shadowing(g.wi, g.h);
        let facets = self.facets.density(g.h) * shadowing / g.wo.z;
        let [reflected, passed] = g.fresnel();
        if g.reflects() {
            return 0.25 * reflected * facets;
        }
        // Radiance is squeezed by η², which the Jacobian has once.
        passed * facets * g.cos_o * g.jacobian() / (g.eta * g.eta)
    }

    /// Density of [`RoughDielectric::sample`] w.r.t. solid angle: that of visible facets, times the Jacobians of Walter et al.
    /// 2007, eq. 14 and 17.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(g) = Geometry::new(wo, wi, self.eta) else { return 0.0 };
        let facets = self.facets.visible_density(g.wo, g.h);
        let [reflected, passed] = g.fresnel();
        if g.reflects() { reflected * facets / (4.0 * g.cos_o) } else { passed * facets * g.jacobian() }
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
