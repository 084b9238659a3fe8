//! Rough glass: the microfacet model for reflection and refraction.

use glam::DVec3;

use super::dielectric::seen_from;
use super::fresnel;
use super::microfacet::Microfacets;
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::{Mask, Real, V3, by_lane, lanes_of};

/// A rough interface between two dielectrics (Walter et al. 2007), with separable shadowing.
#[derive(Debug, Clone, Copy)]
pub struct RoughDielectric<R = f32> {
    /// Refractive index behind the surface (−z) over the one in front.
    pub eta: R,
    /// The facets.
    pub facets: Microfacets<R>,
}

lanes_of!(RoughDielectric { eta, facets });

/// Indices closer to 1 than this are no interface: refraction would turn light by less than single precision resolves, into a
/// lobe of infinite density, and next to nothing would be reflected (2.5e-7).
pub const LEAST_STEP: f32 = 1e-3;

/// A pair of directions seen from the side of the first, and the facet normal that takes one to the other.
#[derive(Clone, Copy)]
pub(super) struct Geometry<R> {
    pub wo: V3<R>,
    pub wi: V3<R>,
    pub h: V3<R>,
    /// wo·h > 0.
    pub cos_o: R,
    /// |wi·h|.
    pub cos_i: R,
    /// Index on the other side over that on the side of `wo`.
    pub eta: R,
    /// Squared length of wo + η·wi where light is refracted, else 0.
    half_squared: R,
}

impl<R: Real> Geometry<R> {
    /// The geometry of a pair, and where some facet takes `wi` to `wo`. `eta` is the index behind the surface over the one in front.
    #[inline(always)]
    pub fn new(wo: V3<R>, wi: V3<R>, eta: R) -> (Self, R::Mask) {
        let oblique = !wo.z.is(0.0) & !wi.z.is(0.0);
        let side = eta.all(1.0).with_sign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        let (front, one) = (side.above(0.0), eta.all(1.0));
        let indices = [front.choose(one, eta), front.choose(eta, one)];
        let pair = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z, indices[0], indices[1]];
        let [x, y, z, cos_o, cos_i, half_squared, eta, found] = by_lane!(pair, |_, pair| half_vector(pair));
        (Self { wo, wi, h: V3::new(x, y, z), cos_o, cos_i, eta, half_squared }, oblique & found.above(0.0))
    }

    /// Where light is reflected.
    #[inline(always)]
    pub fn reflects(&self) -> R::Mask {
        self.wi.z.above(0.0)
    }

    /// Fresnel reflectance and transmittance of the facet.
    #[inline(always)]
    pub fn fresnel(&self) -> [R; 2] {
        let cos = self.cos_o.at_most(1.0);
        [fresnel::dielectric(cos, self.eta).0, fresnel::transmitted(cos, self.eta)]
    }

    /// dω_h/dω_i of refraction (Walter et al. 2007, eq. 17).
    #[inline(always)]
    pub fn jacobian(&self) -> R {
        self.eta * self.eta * self.cos_i / self.half_squared
    }
}

/// Of two directions and the indices on their sides, seen from the first: the facet normal, the cosines of both with it, the squared
/// length of the half vector of refraction, the quotient of the indices, and 1 where there is such a facet, else 0.
///
/// The half vector of refraction is a small difference of long vectors, which decides how far from the centre of a narrow
/// lobe a direction lies: it takes double precision.
#[inline]
fn half_vector([ox, oy, oz, ix, iy, iz, outer, inner]: [f32; 8]) -> [f32; 8] {
    let (wo, wi) = (DVec3::new(ox.into(), oy.into(), oz.into()), DVec3::new(ix.into(), iy.into(), iz.into()));
    let (outer, inner) = (f64::from(outer), f64::from(inner));
    let refracts = iz < 0.0;
    let half = if refracts { wo * outer + wi * inner } else { wo + wi };
    let squared = half.length_squared();
    let h = half / (squared.sqrt().copysign(half.z));
    let (cos_o, cos_i) = (wo.dot(h), wi.dot(h) * if refracts { -1.0 } else { 1.0 });
    // A facet is seen from the same side as the surface, by both.
    let found = h.is_finite() && cos_o > 0.0 && cos_i > 0.0;
    let half_squared = if refracts { squared / (outer * outer) } else { 0.0 };
    let [x, y, z] = h.as_vec3().to_array();
    [x, y, z, cos_o as f32, cos_i as f32, half_squared as f32, (inner / outer) as f32, f32::from(u8::from(found))]
}

impl<R: Real> RoughDielectric<R> {
    /// f·|cos θᵢ| for radiance, of facets with the density `facets`: Walter et al. 2007, eq. 20 and 21.
    #[inline(always)]
    fn value(&self, g: &Geometry<R>, [reflected, passed]: [R; 2], density: R) -> R {
        let shadowing = self.facets.shadowing(g.wo, g.h) * self.facets.shadowing(g.wi, g.h);
        let facets = density * shadowing / g.wo.z;
        // Radiance is squeezed by η², which the Jacobian has once.
        let refracted = passed * facets * g.cos_o * g.jacobian() / (g.eta * g.eta);
        g.reflects().choose(reflected * 0.25 * facets, refracted)
    }

    /// That of visible facets, times the Jacobians of Walter et al. 2007, eq. 14 and 17.
    #[inline(always)]
    fn density(&self, g: &Geometry<R>, [reflected, passed]: [R; 2], density: R) -> R {
        let facets = self.facets.visible_part(density, g.wo, g.h);
        g.reflects().choose(reflected * facets / (g.cos_o * 4.0), passed * facets * g.jacobian())
    }
}

impl<R: Real> Scatter<R> for RoughDielectric<R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let (g, found) = Geometry::new(wo, wi, self.eta);
        let (fresnel, density) = (g.fresnel(), self.facets.density(g.h));
        let (value, pdf) = (self.value(&g, fresnel, density), self.density(&g, fresnel, density));
        (V3::splat(value.only(found)), pdf.only(found))
    }

    /// Reflects or refracts at a visible facet, as `lobe` says.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], transport: Transport) -> Drawn<R> {
        // From behind, only the index differs.
        let (side, eta) = (wo.z.ge(wo.z.all(0.0)), seen_from(wo, self.eta));
        let side = side.choose(eta.all(1.0), eta.all(-1.0));
        let front = wo * side;
        let h = self.facets.sample_visible(front, u);
        let cos = front.dot(h);
        let (reflected, cos_t) = fresnel::dielectric(cos.between(0.0, 1.0), eta);
        let reflects = lobe.lt(reflected);
        let mirrored = h * (cos * 2.0) - front;
        let bent = h * (cos / eta - cos_t) - front / eta;
        let wi = V3::choose(reflects, mirrored, bent).normalize() * side;
        // A facet may send light to the wrong side of the surface, where another facet would catch it.
        let same_side = (wi.z * wo.z).above(0.0);
        let leaves = reflects.agrees(same_side);
        let (value, pdf) = self.eval_and_pdf(wo, wi);
        // Power is not squeezed into a smaller solid angle as radiance is.
        let squeezed = if transport == Transport::Importance { eta * eta } else { eta.all(1.0) };
        let weight = value.x / pdf * reflects.choose(eta.all(1.0), squeezed);
        let found = !wo.z.is(0.0) & leaves & pdf.above(0.0) & weight.finite();
        Drawn { wi, weight: V3::splat(weight), pdf, delta: found.none(), found }
    }

    #[inline(always)]
    fn eta(&self, wo: V3<R>) -> R {
        seen_from(wo, self.eta)
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        V3::splat(self.eta.all(1.0))
    }
}
