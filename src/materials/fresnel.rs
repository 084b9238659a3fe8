//! Fresnel equations.

use glam::{Vec2, Vec3};

use super::texture::Texture;

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

impl Metal {
    /// Reflected share per channel under the angle with cosine `cos`.
    pub fn reflection(&self, uv: Vec2, cos: f32) -> Vec3 {
        let channel = |i: usize| conductor(cos, self.eta[i], self.k[i]);
        Vec3::new(channel(0), channel(1), channel(2)) * self.reflectance.eval(uv)
    }

    /// Reflection at normal incidence.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        self.reflection(uv, 1.0)
    }
}

/// Unpolarised Fresnel reflectance of a conductor with refractive index `eta` + i·`k` relative to the outside.
/// The exact form, e.g. Born and Wolf 1999, §14.2.
pub fn conductor(cos: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    let (eta2, k2) = (eta * eta, k * k);
    let t0 = eta2 - k2 - sin2;
    let a2b2 = (t0 * t0 + 4.0 * eta2 * k2).sqrt();
    let a = (0.5 * (a2b2 + t0)).max(0.0).sqrt();
    let perpendicular = (a2b2 + cos2 - 2.0 * a * cos) / (a2b2 + cos2 + 2.0 * a * cos);
    let (t3, t4) = (cos2 * a2b2 + sin2 * sin2, 2.0 * a * cos * sin2);
    let parallel = perpendicular * (t3 - t4) / (t3 + t4);
    let r = 0.5 * (perpendicular + parallel);
    // 0/0 only where there is no interface: eta = 1, k = 0 at grazing incidence.
    if r.is_finite() { r.clamp(0.0, 1.0) } else { 1.0 }
}

/// Unpolarised Fresnel reflectance at a dielectric interface and the cosine on the other side (0 under total internal
/// reflection). `eta` is the index behind the interface over the index on the side of the direction; `cos` ≥ 0.
pub fn dielectric(cos: f32, eta: f32) -> (f32, f32) {
    let sin2_t = (1.0 - cos * cos).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    if eta == 1.0 {
        return (0.0, cos);
    }
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    (0.5 * (s * s + p * p), cos_t)
}

/// 1 − R of [`dielectric`], precise also where hardly anything passes: at grazing angles.
pub fn transmitted(cos: f32, eta: f32) -> f32 {
    let cos_t = dielectric(cos, eta).1;
    let (s, p) = (cos + eta * cos_t, eta * cos + cos_t);
    if cos_t > 0.0 { 2.0 * eta * cos * cos_t * (1.0 / (s * s) + 1.0 / (p * p)) } else { 0.0 }
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
