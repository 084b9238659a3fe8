//! Rough metal: the Torrance-Sparrow microfacet model.

use glam::Vec2;

use super::fresnel::{Metal, MetalAt};
use super::microfacet::{Grain, Microfacets};
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::{Mask, Real, V3, lanes_of};

/// f = F·D·G / (4 cos θₒ cos θᵢ) on the front side (Walter et al. 2007, eq. 20), with separable shadowing.
#[derive(Debug, Clone)]
pub struct RoughConductor {
    /// The metal.
    pub metal: Metal,
    /// The facets.
    pub facets: Microfacets,
}

/// Rough metal at surface points.
#[derive(Debug, Clone, Copy)]
pub struct At<R> {
    metal: MetalAt<R>,
    pub(super) facets: Microfacets<R>,
}

lanes_of!(At { metal, facets });

impl RoughConductor {
    /// The metal at `uv`.
    pub fn at(&self, uv: Vec2) -> At<f32> {
        At { metal: self.metal.at(uv), facets: self.facets }
    }
}

impl At<f32> {
    /// The same with this part of the roughness, and with a grain.
    pub(super) fn with(self, part: f32, grain: Option<Grain>) -> Self {
        Self { facets: self.facets.scaled(part).with_grain(grain), ..self }
    }
}

/// The facet that reflects one direction to another, both in front.
struct Facet<R: Real> {
    h: V3<R>,
    /// Cosine between `h` and either.
    cos: R,
    density: R,
    found: R::Mask,
}

impl<R: Real> At<R> {
    #[inline(always)]
    fn facet(&self, wo: V3<R>, wi: V3<R>) -> Facet<R> {
        let (h, halved) = (wo + wi).try_normalize();
        let found = halved & wo.z.above(0.0) & wi.z.above(0.0);
        Facet { h, cos: wo.dot(h), density: self.facets.density(h), found }
    }

    #[inline(always)]
    fn value(&self, facet: &Facet<R>, wo: V3<R>, wi: V3<R>) -> V3<R> {
        let Facet { h, cos, density, found } = *facet;
        let found = found & !density.is(0.0);
        if !found.any() {
            return V3::splat(cos.all(0.0));
        }
        let g = self.facets.shadowing(wo, h) * self.facets.shadowing(wi, h);
        (self.metal.reflection(cos) * (density * g / (wo.z * 4.0))).only(found)
    }

    #[inline(always)]
    fn density(&self, facet: &Facet<R>, wo: V3<R>) -> R {
        let Facet { h, cos, density, found } = *facet;
        (self.facets.visible_part(density, wo, h) / (cos * 4.0)).only(found & cos.above(0.0))
    }
}

impl<R: Real> Scatter<R> for At<R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let facet = self.facet(wo, wi);
        (self.value(&facet, wo, wi), self.density(&facet, wo))
    }

    /// Reflects at a visible facet.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let h = self.facets.sample_visible(wo, u);
        let wi = h * (wo.dot(h) * 2.0) - wo;
        let (value, pdf) = self.eval_and_pdf(wo, wi);
        Drawn::of_lobe(wi, value / pdf, pdf)
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        self.metal.albedo()
    }
}
