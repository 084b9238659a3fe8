//! What becomes of paths at vertices that were shaded together, until they are taken on.

use glam::Vec3;

use crate::geometry::Ray;
use crate::guiding::sample::lanes::GuideLanes;
use crate::integrators::kept::{Column, Keep, Rows, row};
use crate::integrators::mixture::Guided;
use crate::integrators::site::{Lit, Onward};
use crate::lights::LightSamples;
use crate::math::lanes::{LANES, Mask, Real, V3, Vectors, vector};
use crate::sampling::mis;

/// What paths do at up to sixteen vertices, lane by lane, but for the densities of guides and for roulette.
#[derive(Default)]
pub(super) struct Shaded {
    /// Where a light was sampled from which something comes back, unless something is in the way, one bit each. What else is said of
    /// lights counts only there.
    pub lit: u32,
    /// Where no ray can hit the light.
    light_delta: u32,
    /// f·|cos θ|·L, and the density of light sampling w.r.t. solid angle.
    light: Rows,
    /// Where shadow rays start, and their lengths.
    shadow_origin: Rows,
    /// Their directions, and the BSDFs' densities in the directions of the lights; 0 where no ray can hit the light.
    shadow_direction: Rows,
    /// Weight of light sampling against the BSDFs over its density; not kept where there are guides.
    light_factor: Column,
    /// Unit directions to the lights; not kept where there are no guides.
    to_light: Vectors,
    /// See [`Onward`].
    any: u32,
    delta: u32,
    direction: Vectors,
    /// Not kept where there are no guides.
    value: Vectors,
    weight: Vectors,
    pdf: Column,
    /// Not kept where there are no guides.
    deltas: Column,
    /// Not kept where nothing refracts.
    squeeze: Column,
    origin: Vectors,
    /// Whether there are guides, and whether anything refracts.
    pub guided: bool,
    refracts: bool,
    /// Random numbers of roulette.
    pub roulette: Column,
    /// Which way the surfaces face, as the sky is sampled by it; [`ANYWHERE`](crate::lights::seen::ANYWHERE) where that does not matter.
    pub facing: [u8; LANES],
    /// The guides' proposals that are to be taken: where there is one, unit directions, and the guides' densities.
    proposed: u32,
    proposal: Vectors,
    proposal_pdf: Column,
    /// Of guides, see [`Shaded::keep_guides`]: where there is one and no delta lobe was drawn, the probability of sampling the BSDF instead, and
    /// the guide's density in the direction in which the path goes on.
    guides: u32,
    bsdf_fraction: Column,
    guide_pdf: Column,
}

/// Where guides propose directions, and which.
type Proposed<R> = (<R as Real>::Mask, V3<R>);

impl Shaded {
    #[inline(always)]
    pub fn keep_light<K: Keep>(&mut self, to: K, light: &LightSamples<K::Real>, lit: &Lit<K::Real>) {
        self.lit = lit.any.answers();
        self.light_delta = light.delta.answers();
        let (origin, direction, length) = lit.ray;
        to.keep_rows(row(lit.radiance, light.pdf), &mut self.light);
        to.keep_rows(row(origin, length), &mut self.shadow_origin);
        let pdf = lit.pdf.only(!light.delta);
        to.keep_rows(row(direction, pdf), &mut self.shadow_direction);
        if self.guided {
            to.keep_vectors(light.wi, &mut self.to_light);
        } else {
            to.keep(mis::balance(light.pdf, pdf) / light.pdf, &mut self.light_factor);
        }
    }

    #[inline(always)]
    pub fn keep_onward<K: Keep>(&mut self, to: K, onward: &Onward<K::Real>) {
        self.any = onward.any.answers();
        self.delta = onward.delta.answers();
        to.keep_vectors(onward.direction, &mut self.direction);
        to.keep_vectors(onward.weight, &mut self.weight);
        to.keep(onward.pdf, &mut self.pdf);
        to.keep_vectors(onward.origin, &mut self.origin);
        if self.guided {
            to.keep_vectors(onward.value, &mut self.value);
            to.keep(onward.deltas, &mut self.deltas);
        }
        self.refracts = onward.squeeze.is_some();
        if let Some(squeeze) = onward.squeeze {
            to.keep(squeeze, &mut self.squeeze);
        }
    }

    /// The light that was sampled at the vertex in a lane.
    #[inline(always)]
    pub fn light(&self, lane: usize) -> Option<Sampled> {
        (self.lit >> lane & 1 == 1).then(|| {
            let ([x, y, z, pdf], [ox, oy, oz, length], [dx, dy, dz, bsdf_pdf]) =
                (self.light[lane], self.shadow_origin[lane], self.shadow_direction[lane]);
            let shadow = Ray { origin: Vec3::new(ox, oy, oz), direction: Vec3::new(dx, dy, dz) };
            let delta = self.light_delta >> lane & 1 == 1;
            let (light, factor) = (Vec3::new(x, y, z), self.light_factor[lane]);
            Sampled { light, pdf, bsdf_pdf, factor, delta, shadow: (shadow, length) }
        })
    }

    /// Unit direction to the light, where there are guides.
    #[inline(always)]
    pub fn to_light(&self, lane: usize) -> Vec3 {
        vector(&self.to_light, lane)
    }

    /// Probability of a delta lobe; 0 without guides, where it is not needed.
    #[inline(always)]
    pub fn deltas(&self, lane: usize) -> f32 {
        if self.guided { self.deltas[lane] } else { 0.0 }
    }

    /// Whether a delta lobe was drawn.
    #[inline(always)]
    pub fn delta(&self, lane: usize) -> bool {
        self.delta >> lane & 1 == 1
    }

    /// f·|cos θ| where the direction of this `weight` and density was drawn; zero for a delta lobe.
    #[inline(always)]
    pub fn value(&self, lane: usize, weight: Vec3, pdf: f32) -> Vec3 {
        match self.guided {
            true => vector(&self.value, lane),
            false if self.delta(lane) => Vec3::ZERO,
            false => weight * pdf,
        }
    }

    /// How the paths go on; without guides the value is not told.
    #[inline(always)]
    pub fn onward<K: Keep>(&self, from: K) -> Onward<K::Real> {
        let (weight, pdf) = (from.kept_vectors(&self.weight), from.kept(&self.pdf));
        Onward {
            any: from.mask(self.any),
            direction: from.kept_vectors(&self.direction),
            value: if self.guided { from.kept_vectors(&self.value) } else { weight },
            weight,
            pdf,
            delta: from.mask(self.delta),
            deltas: if self.guided { from.kept(&self.deltas) } else { pdf.all(0.0) },
            squeeze: self.refracts.then(|| from.kept(&self.squeeze)),
            origin: from.kept_vectors(&self.origin),
        }
    }

    /// Keeps directions that guides propose, where bits are set, with the guides' densities.
    #[inline(always)]
    pub fn keep_proposals<K: Keep>(&mut self, to: K, proposed: u32, direction: V3<K::Real>, pdf: K::Real) {
        self.proposed = proposed;
        to.keep_vectors(direction, &mut self.proposal);
        to.keep(pdf, &mut self.proposal_pdf);
    }

    /// Where guides propose directions, and which; none without any.
    #[inline(always)]
    pub fn proposals<K: Keep>(&self, from: K) -> Option<Proposed<K::Real>> {
        self.guided.then(|| (from.mask(self.proposed), from.kept_vectors(&self.proposal)))
    }

    /// Of guides that there are, those which are to be asked for their densities in the directions that the BSDFs have drawn.
    #[inline(always)]
    pub fn asks(&self, guides: u32) -> u32 {
        guides & self.any & !self.delta & !self.proposed
    }

    /// Directions in which the paths go on.
    #[inline(always)]
    pub fn directions<K: Keep>(&self, from: K) -> V3<K::Real> {
        from.kept_vectors(&self.direction)
    }

    /// Keeps what is known of the guides that there are: their densities in the directions of the BSDFs, where they were asked.
    #[inline(always)]
    pub fn keep_guides<K: Keep>(&mut self, to: K, guides: &GuideLanes, pdf: K::Real) {
        let asked = pdf.only(to.mask(self.asks(guides.any)));
        to.keep(to.mask(self.proposed).choose(to.kept(&self.proposal_pdf), asked), &mut self.guide_pdf);
        (self.guides, self.bsdf_fraction) = (guides.any & !self.delta, guides.bsdf_fractions);
    }

    /// What the guides say; none without any.
    #[inline(always)]
    pub fn guides<K: Keep>(&self, from: K) -> Option<Guided<K::Real>> {
        self.guided.then(|| Guided {
            any: from.mask(self.guides),
            bsdf_fraction: from.kept(&self.bsdf_fraction),
            pdf: from.kept(&self.guide_pdf),
        })
    }
}

/// A light that was sampled at a vertex, from which something comes back unless something is in the way.
pub(super) struct Sampled {
    /// f·|cos θ|·L.
    pub light: Vec3,
    /// Density of light sampling w.r.t. solid angle.
    pub pdf: f32,
    /// The BSDF's density in its direction; 0 where no ray can hit it.
    pub bsdf_pdf: f32,
    /// Weight of light sampling against the BSDF over its density; known only where there is no guide.
    pub factor: f32,
    /// Whether no ray can hit it.
    pub delta: bool,
    /// The shadow ray with its length.
    pub shadow: (Ray, f32),
}
