//! Points where paths scatter, one per lane: what their BSDFs send back of a sampled light, the direction in which paths go on, and
//! the rays that leave for both.

use crate::geometry::Origins;
use crate::lights::LightSamples;
use crate::materials::bump::Shadowing;
use crate::materials::{Bsdf, Drawn, Transport};
use crate::math::Frames;
use crate::math::lanes::{Mask, Real, V3};

/// Scatterers at points, for light that leaves in given directions.
pub struct Site<'a, R: Real> {
    origins: Origins<R>,
    frames: Frames<R>,
    /// Local direction in which the light leaves.
    wo: V3<R>,
    bsdf: Bsdf<'a, R>,
    /// Shadowing by bumps; none where no shading normal has any.
    bumps: Option<Shadowing<R>>,
}

/// A sampled light as it is seen from a site.
#[derive(Clone, Copy)]
pub struct Lit<R: Real> {
    /// Where f·|cos θ| is not zero.
    pub any: R::Mask,
    /// f·|cos θ|·L, unless something is in the way.
    pub radiance: V3<R>,
    /// Density with which the BSDF chooses the direction, w.r.t. solid angle.
    pub pdf: R,
    /// The shadow ray: origin, unit direction, length.
    pub ray: (V3<R>, V3<R>, R),
}

/// How directions are drawn at a site.
#[derive(Clone, Copy)]
pub struct Draw<R: Real> {
    /// Chooses a lobe, in [0, 1).
    pub lobe: R,
    /// Choose a direction of it, in [0, 1).
    pub u: [R; 2],
    /// Where a guide chooses, unless the BSDF draws a delta lobe, and the world directions that it chose; none without guides.
    pub guided: Option<(R::Mask, V3<R>)>,
    /// What paths carry.
    pub transport: Transport,
}

/// Directions in which paths go on.
#[derive(Clone, Copy)]
pub struct Onward<R: Real> {
    /// Where there is one; elsewhere the surface absorbs.
    pub any: R::Mask,
    /// Unit direction in the world.
    pub direction: V3<R>,
    /// f·|cos θ|; zero for a delta lobe, where it has no finite value.
    pub value: V3<R>,
    /// f·|cos θ| over the density of the BSDF, if that drew the direction.
    pub weight: V3<R>,
    /// The BSDF's density w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: R,
    /// Whether a delta lobe was drawn.
    pub delta: R::Mask,
    /// Probability of a delta lobe; 0 without guides, where it is not needed.
    pub deltas: R,
    /// Square of the refractive index there over that on the side that light leaves to; none where nothing refracts.
    pub squeeze: Option<R>,
    /// Where the ray in the direction starts.
    pub origin: V3<R>,
}

impl<'a, R: Real> Site<'a, R> {
    /// Sites with shading normals `normal` for light that leaves in the unit directions `out`. Of `bumped` ones, `smooth` is the normal
    /// without bumps.
    #[inline(always)]
    pub fn new(origins: Origins<R>, normal: V3<R>, smooth: V3<R>, out: V3<R>, bsdf: Bsdf<'a, R>, bumped: bool) -> Self {
        let frames = Frames::new(normal);
        let bumps = bumped.then(|| Shadowing::new(smooth, normal));
        Self { origins, wo: frames.to_local(out), frames, bsdf, bumps }
    }

    /// Share of the light from the world direction `wi`, in local coordinates `local`, that bumps do not shadow.
    #[inline(always)]
    fn unhidden(&self, wi: V3<R>, local: V3<R>) -> R {
        match &self.bumps {
            Some(bumps) => bumps.factor(wi, local.z),
            None => wi.x.all(1.0),
        }
    }

    /// f·|cos θ| towards the world direction `wi`, and the BSDF's density there.
    #[inline(always)]
    pub fn eval_and_pdf(&self, wi: V3<R>) -> (V3<R>, R) {
        let local = self.frames.to_local(wi);
        let (value, pdf) = self.bsdf.eval_and_pdf(self.wo, local);
        (value * self.unhidden(wi, local), pdf)
    }

    /// Probability with which [`Site::draw`] draws a delta lobe where no guide chooses.
    #[inline(always)]
    pub fn delta_probability(&self) -> R {
        self.bsdf.delta_probability(self.wo)
    }

    /// What sampled lights bring, and the rays to them.
    #[inline(always)]
    pub fn light(&self, light: &LightSamples<R>) -> Lit<R> {
        let (value, pdf) = self.eval_and_pdf(light.wi);
        let ray = self.origins.towards(light.wi, light.distance);
        Lit { any: light.found & !value.is_zero(), radiance: value * light.radiance, pdf, ray }
    }

    /// Directions drawn from the BSDFs, or chosen by guides.
    #[inline(always)]
    pub fn draw(&self, draw: &Draw<R>) -> Onward<R> {
        let Drawn { wi, weight, pdf, delta, found } = self.bsdf.sample(self.wo, draw.lobe, draw.u, draw.transport);
        let (zero, direction) = (pdf.all(0.0), self.frames.to_world(wi));
        let weight = weight * self.unhidden(direction, wi);
        let black = weight.is_zero();
        // A direction that bumps shadow is no sample, nor is a black mirror; one that is black otherwise is, and is learned from.
        let lost = if self.bumps.is_some() { black } else { black & delta };
        let value = (weight * pdf).only(!delta);
        let drawn = Onward {
            any: found & !lost,
            direction,
            value,
            weight,
            pdf,
            delta,
            deltas: zero,
            squeeze: None,
            origin: direction,
        };
        let onward = match draw.guided {
            Some((guided, to)) => self.guided(drawn, guided, to, found & delta),
            None => drawn,
        };
        let refracts = self.bsdf.refracts();
        let squeeze = refracts.then(|| self.bsdf.eta(self.wo, self.frames.to_local(onward.direction)).squared());
        Onward { squeeze, origin: self.origins.leave(onward.direction), ..onward }
    }

    /// The direction `to` where a guide chooses and no `mirror` was drawn.
    #[inline(always)]
    fn guided(&self, drawn: Onward<R>, guided: R::Mask, to: V3<R>, mirror: R::Mask) -> Onward<R> {
        let guided = guided & !mirror;
        let (value, pdf) = self.eval_and_pdf(to);
        Onward {
            any: guided | drawn.any,
            direction: V3::choose(guided, to, drawn.direction),
            value: V3::choose(guided, value, drawn.value),
            pdf: guided.choose(pdf, drawn.pdf),
            delta: drawn.delta & !guided,
            deltas: self.delta_probability(),
            ..drawn
        }
    }
}
