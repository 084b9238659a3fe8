//! Smooth glass: reflects and refracts.

use super::fresnel;
use super::{Drawn, Scatter, Transport, mirrored};
use crate::math::lanes::{Mask, Real, V3, lanes_of};

/// A smooth interface between two dielectrics.
#[derive(Debug, Clone, Copy)]
pub struct Dielectric<R = f32> {
    /// Refractive index behind the surface (−z) over the one in front.
    pub eta: R,
}

lanes_of!(Dielectric { eta });

/// Index on the other side over that on the side of `wo`, where `eta` is that behind the surface over the one in front.
#[inline(always)]
pub(super) fn seen_from<R: Real>(wo: V3<R>, eta: R) -> R {
    wo.z.ge(eta.all(0.0)).choose(eta, eta.inverse())
}

impl<R: Real> Scatter<R> for Dielectric<R> {
    /// Reflects with the Fresnel probability, else refracts.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, u: [R; 2], transport: Transport) -> Drawn<R> {
        let eta = seen_from(wo, self.eta);
        let (reflected, cos_t) = fresnel::dielectric(wo.z.abs(), eta);
        let reflects = u[0].lt(reflected);
        let bent = V3::new(-wo.x / eta, -wo.y / eta, -cos_t.with_sign(wo.z)).normalize();
        let wi = V3::choose(reflects, mirrored(wo), bent);
        // Radiance is squeezed into a smaller solid angle on the denser side; power is not.
        let one = eta.all(1.0);
        let scale = if transport == Transport::Radiance { (eta * eta).inverse() } else { one };
        let weight = V3::splat(reflects.choose(one, scale));
        Drawn::of_delta(wi, weight, reflects.choose(reflected, reflected.rest()), !wo.z.is(0.0))
    }

    #[inline(always)]
    fn delta_probability(&self, _: V3<R>) -> R {
        self.eta.all(1.0)
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

/// A thin pane of smooth glass: light goes straight through or is mirrored, all rounds between its two faces together.
#[derive(Debug, Clone, Copy)]
pub struct ThinDielectric<R = f32> {
    /// Refractive index of the pane over that around it.
    pub eta: R,
}

lanes_of!(ThinDielectric { eta });

impl<R: Real> Scatter<R> for ThinDielectric<R> {
    /// Mirrors with probability 2F/(1 + F), the sum over the rounds, else lets through.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let once = fresnel::dielectric(wo.z.abs(), self.eta).0;
        let reflected = once * 2.0 / (once + 1.0);
        let reflects = u[0].lt(reflected);
        let wi = V3::choose(reflects, mirrored(wo), -wo);
        let pdf = reflects.choose(reflected, reflected.rest());
        Drawn::of_delta(wi, V3::splat(pdf.all(1.0)), pdf, !wo.z.is(0.0))
    }

    #[inline(always)]
    fn delta_probability(&self, _: V3<R>) -> R {
        self.eta.all(1.0)
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        V3::splat(self.eta.all(1.0))
    }
}
