//! Fresnel equations.

use glam::{Vec2, Vec3};

use super::texture::Texture;
use crate::math::lanes::{Mask, Real, V3, lanes_of};

/// A metal: its refractive index per channel and a factor on the reflection.
#[derive(Debug, Clone)]
pub struct Metal {
    /// Real part of the refractive index relative to the outside.
    pub eta: Vec3,
    /// Extinction coefficient.
    pub k: Vec3,
    /// Factor on the reflection.
    pub reflectance: Texture,
}

/// A metal at surface points.
#[derive(Debug, Clone, Copy)]
pub struct MetalAt<R> {
    eta: V3<R>,
    k: V3<R>,
    reflectance: V3<R>,
}

lanes_of!(MetalAt { eta, k, reflectance });

impl Metal {
    /// The metal at `uv`.
    pub fn at(&self, uv: Vec2) -> MetalAt<f32> {
        MetalAt { eta: self.eta.into(), k: self.k.into(), reflectance: self.reflectance.eval(uv).into() }
    }
}

impl<R: Real> MetalAt<R> {
    /// Reflected share per channel under the angle with cosine `cos`.
    #[inline(always)]
    pub fn reflection(&self, cos: R) -> V3<R> {
        let Self { eta, k, reflectance } = self;
        let fresnel = V3::new(conductor(cos, eta.x, k.x), conductor(cos, eta.y, k.y), conductor(cos, eta.z, k.z));
        fresnel * *reflectance
    }

    /// Reflection at normal incidence.
    #[inline(always)]
    pub fn albedo(&self) -> V3<R> {
        self.reflection(self.eta.x.all(1.0))
    }
}

/// Unpolarised Fresnel reflectance of a conductor with refractive index `eta` + i·`k` relative to the outside.
/// The exact form, e.g. Born and Wolf 1999, §14.2.
#[inline(always)]
pub fn conductor<R: Real>(cos: R, eta: R, k: R) -> R {
    let cos2 = cos * cos;
    let sin2 = cos2.rest();
    let (eta2, k2) = (eta * eta, k * k);
    let t0 = eta2 - k2 - sin2;
    let a2b2 = (t0 * t0 + eta2 * 4.0 * k2).sqrt();
    let a = ((a2b2 + t0) * 0.5).at_least(0.0).sqrt();
    let t1 = a * 2.0 * cos;
    let perpendicular = (a2b2 + cos2 - t1) / (a2b2 + cos2 + t1);
    let (t3, t4) = (cos2 * a2b2 + sin2 * sin2, t1 * sin2);
    let parallel = perpendicular * (t3 - t4) / (t3 + t4);
    let r = (perpendicular + parallel) * 0.5;
    // 0/0 only where there is no interface: eta = 1, k = 0 at grazing incidence.
    r.finite().choose(r.between(0.0, 1.0), r.all(1.0))
}

/// Unpolarised Fresnel reflectance at a dielectric interface and the cosine on the other side (0 under total internal
/// reflection). `eta` is the index behind the interface over the index on the side of the direction; `cos` ≥ 0.
#[inline(always)]
pub fn dielectric<R: Real>(cos: R, eta: R) -> (R, R) {
    let sin2_t = (cos * cos).rest().at_least(0.0) / (eta * eta);
    let passes = sin2_t.below(1.0);
    let cos_t = sin2_t.rest().sqrt();
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    let reflected = (s * s + p * p) * 0.5;
    let nothing = eta.is(1.0);
    let (reflected, cos_t) = (nothing.choose(cos.all(0.0), reflected), nothing.choose(cos, cos_t));
    (passes.choose(reflected, cos.all(1.0)), cos_t.only(passes))
}

/// 1 − R of [`dielectric`], precise also where hardly anything passes: at grazing angles.
#[inline(always)]
pub fn transmitted<R: Real>(cos: R, eta: R) -> R {
    let cos_t = dielectric(cos, eta).1;
    let (s, p) = (cos + eta * cos_t, eta * cos + cos_t);
    (eta * 2.0 * cos * cos_t * ((s * s).inverse() + (p * p).inverse())).only(cos_t.above(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert_eq!(dielectric(0.1, 1.0 / 1.5), (1.0, 0.0), "total internal reflection");
        assert_eq!(dielectric(0.3, 1.0), (0.0, 0.3), "no interface");
        assert!((dielectric(0.0, 1.5).0 - 1.0).abs() < 1e-5);
        // Aluminium at normal incidence: ((η−1)² + k²)/((η+1)² + k²).
        let (eta, k) = (0.880_405f32, 6.269_502f32);
        let expected = ((eta - 1.0).powi(2) + k * k) / ((eta + 1.0).powi(2) + k * k);
        assert!((conductor(1.0, eta, k) - expected).abs() < 1e-5);
        assert!((0..=100).all(|i| conductor(i as f32 / 100.0, 1.0, 0.0).is_finite()));
    }
}
