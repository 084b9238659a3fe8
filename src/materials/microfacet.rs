//! Isotropic microfacet distributions, their shadowing, and sampling of visible normals.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::Vec3;

use crate::math::lanes::functions::{acos, exp, ln, pow, sin_cos};
use crate::math::special::{erf, erf_inv};

/// Below this roughness a surface is treated as perfectly smooth: its lobe is narrower than single precision resolves.
pub const SMOOTH: f32 = 1e-4;

/// Slope distribution of the facets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Gaussian slopes (Beckmann and Spizzichino 1963).
    Beckmann,
    /// Long tails (Trowbridge and Reitz 1975; Walter et al. 2007).
    Ggx,
}

/// A microfacet distribution with roughness `alpha`.
#[derive(Debug, Clone, Copy)]
pub struct Microfacets {
    /// Slope distribution.
    pub shape: Shape,
    /// Roughness, at least [`SMOOTH`].
    pub alpha: f32,
}

impl Microfacets {
    /// Density of facet normals D(h), sr⁻¹; ∫ D cos θ dω = 1.
    pub fn density(&self, h: Vec3) -> f32 {
        if h.z <= 0.0 {
            return 0.0;
        }
        let (cos2, sin2, alpha2) = (h.z * h.z, h.x * h.x + h.y * h.y, self.alpha * self.alpha);
        match self.shape {
            Shape::Beckmann => {
                let falloff = exp(-sin2 / (cos2 * alpha2));
                // At grazing angles cos⁴ vanishes too, but later.
                if falloff > 0.0 { FRAC_1_PI * falloff / (alpha2 * cos2 * cos2) } else { 0.0 }
            }
            Shape::Ggx => {
                let spread = sin2 + alpha2 * cos2;
                FRAC_1_PI * alpha2 / (spread * spread)
            }
        }
    }

    /// Share of the facets facing `w` that others do not hide (Smith 1967), as the reflected light uses it. For Beckmann this is
    /// Walter's fit (Walter et al. 2007, eq. 27), off by up to 0.35 % from the integral: other renderers use it, so pictures
    /// of the same scene would differ by half a percent in places without it.
    pub fn shadowing(&self, w: Vec3, h: Vec3) -> f32 {
        if self.shape == Shape::Ggx || w.dot(h) * w.z <= 0.0 {
            return self.visible_share(w, h);
        }
        match w.z.abs() / self.stretched_sine(w) {
            a if a >= 1.6 => 1.0,
            a => (3.535 + 2.181 * a) * a / (1.0 + (2.276 + 2.577 * a) * a),
        }
    }

    /// Smith's shadowing without approximation (Heitz 2014, eq. 72 and 83): sampling visible normals inverts this form, so its
    /// density must be this one.
    fn visible_share(&self, w: Vec3, h: Vec3) -> f32 {
        if w.dot(h) * w.z <= 0.0 {
            return 0.0;
        }
        // 1 / (α·tan θ) is cos/sine; the sine of a direction along the normal is 0, and nothing hides a facet from there.
        let (cos, sine) = (w.z.abs(), self.stretched_sine(w));
        match self.shape {
            Shape::Beckmann => {
                let a = cos / sine;
                1.0 / (1.0 + 0.5 * (exp(-a * a) / (a * PI.sqrt()) - (1.0 - erf(a))).max(0.0))
            }
            Shape::Ggx => 2.0 * cos / (cos + (cos * cos + sine * sine).sqrt()),
        }
    }

    /// α·sin θ.
    fn stretched_sine(&self, w: Vec3) -> f32 {
        self.alpha * (w.x * w.x + w.y * w.y).sqrt()
    }

    /// Density of [`Microfacets::sample_visible`] w.r.t. the solid angle of the facet normal (Heitz and d'Eon 2014, eq. 2).
    pub fn visible_density(&self, w: Vec3, h: Vec3) -> f32 {
        if w.z <= 0.0 {
            return 0.0;
        }
        self.density(h) * self.visible_share(w, h) * w.dot(h).max(0.0) / w.z
    }

    /// A facet normal visible from `w` (in front).
    ///
    /// Stretches `w` to unit roughness, samples slopes there, rotates and unstretches (Heitz and d'Eon 2014).
    pub fn sample_visible(&self, w: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(self.alpha * w.x, self.alpha * w.y, w.z).normalize();
        if self.shape == Shape::Ggx {
            return self.sample_visible_ggx(stretched, u);
        }
        let sin = (stretched.x * stretched.x + stretched.y * stretched.y).sqrt();
        let (cos_phi, sin_phi) = if sin > 0.0 { (stretched.x / sin, stretched.y / sin) } else { (1.0, 0.0) };
        let [sx, sy] = beckmann_slopes(stretched.z, u);
        let slope_x = (cos_phi * sx - sin_phi * sy) * self.alpha;
        let slope_y = (sin_phi * sx + cos_phi * sy) * self.alpha;
        Vec3::new(-slope_x, -slope_y, 1.0).normalize()
    }

    /// Projected-disk sampling of the GGX visible normals (Heitz 2018).
    fn sample_visible_ggx(&self, w: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let length2 = w.x * w.x + w.y * w.y;
        let t1 = if length2 > 0.0 { Vec3::new(-w.y, w.x, 0.0) / length2.sqrt() } else { Vec3::X };
        let t2 = w.cross(t1);
        let (r, (sin, cos)) = (u.sqrt(), sin_cos(TAU * v));
        let p1 = r * cos;
        let s = 0.5 * (1.0 + w.z);
        let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * r * sin;
        let n = t1 * p1 + t2 * p2 + w * (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        Vec3::new(self.alpha * n.x, self.alpha * n.y, n.z.max(1e-6)).normalize()
    }
}

/// Slopes of the facets visible under the angle with cosine `cos`, for Beckmann with unit roughness: the marginal's CDF is
/// inverted by Newton iterations kept inside a bracket (Heitz and d'Eon 2014, supplement; the start is Jakob's 2014 fit).
fn beckmann_slopes(cos: f32, [u, v]: [f32; 2]) -> [f32; 2] {
    if cos > 0.999_9 {
        let (r, (sin, cos)) = ((-ln(1.0 - u)).sqrt(), sin_cos(TAU * v));
        return [r * cos, r * sin];
    }
    let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos.max(1e-6);
    let cot = 1.0 / tan;
    let inverse_sqrt_pi = 1.0 / PI.sqrt();
    let u = u.max(1e-6);
    let (mut low, mut high) = (-1.0f32, erf(cot));
    let theta = acos(cos);
    let fit = 1.0 + theta * (-0.876 + theta * (0.4265 - 0.0594 * theta));
    let mut b = high - (1.0 + high) * pow(1.0 - u, fit);
    let norm = 1.0 / (1.0 + high + inverse_sqrt_pi * tan * exp(-cot * cot));
    for _ in 0..10 {
        if !(b >= low && b <= high) {
            b = 0.5 * (low + high);
        }
        let slope = erf_inv(b);
        let value = norm * (1.0 + b + inverse_sqrt_pi * tan * exp(-slope * slope)) - u;
        if value.abs() < 1e-6 {
            break;
        }
        if value > 0.0 {
            high = b;
        } else {
            low = b;
        }
        b -= value / (norm * (1.0 - slope * tan));
    }
    [erf_inv(b), erf_inv(2.0 * v.max(1e-6) - 1.0)]
}
