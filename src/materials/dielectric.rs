//! Smooth glass: reflects and refracts.

use glam::Vec3;

use super::fresnel;
use super::{BsdfSample, Transport};

/// A smooth interface between two dielectrics.
#[derive(Debug, Clone, Copy)]
pub struct Dielectric {
    /// Refractive index behind the surface (−z) over the one in front.
    pub eta: f32,
}

impl Dielectric {
    /// Reflects with the Fresnel probability, else refracts.
    pub fn sample(&self, wo: Vec3, u: f32, transport: Transport) -> Option<BsdfSample> {
        let eta = if wo.z >= 0.0 { self.eta } else { 1.0 / self.eta };
        let (reflected, cos_t) = fresnel::dielectric(wo.z.abs(), eta);
        if wo.z == 0.0 {
            return None;
        }
        if u < reflected {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            return Some(BsdfSample { wi, weight: Vec3::ONE, pdf: reflected, delta: true });
        }
        let wi = Vec3::new(-wo.x / eta, -wo.y / eta, -cos_t.copysign(wo.z)).normalize();
        // Radiance is squeezed into a smaller solid angle on the denser side; power is not.
        let scale = if transport == Transport::Radiance { 1.0 / (eta * eta) } else { 1.0 };
        Some(BsdfSample { wi, weight: Vec3::splat(scale), pdf: 1.0 - reflected, delta: true })
    }
}

/// A thin pane of smooth glass: light goes straight through or is mirrored, all rounds between its two faces together.
#[derive(Debug, Clone, Copy)]
pub struct ThinDielectric {
    /// Refractive index of the pane over that around it.
    pub eta: f32,
}

impl ThinDielectric {
    /// Mirrors with probability 2F/(1 + F), the sum over the rounds, else lets through.
    pub fn sample(&self, wo: Vec3, u: f32) -> Option<BsdfSample> {
        let once = fresnel::dielectric(wo.z.abs(), self.eta).0;
        let reflected = 2.0 * once / (1.0 + once);
        let (wi, pdf) = if u < reflected { (Vec3::new(-wo.x, -wo.y, wo.z), reflected) } else { (-wo, 1.0 - reflected) };
        (wo.z != 0.0).then_some(BsdfSample { wi, weight: Vec3::ONE, pdf, delta: true })
    }
}
