//! What the twins in double precision share: random inputs, most of them extreme, and the largest relative error.

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::materials::microfacet::Shape;
use glam::{DVec3, Vec3};

/// Inputs of each comparison.
pub const INPUTS: usize = 100_000;
/// Densities and values below this are no normal singles any more once they are multiplied by anything.
pub const VANISHING: f64 = 1e-30;

/// The largest relative error so far, and where it was.
pub struct Worst {
    what: String,
    error: f64,
    at: String,
    compared: usize,
}

impl Worst {
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), error: 0.0, at: String::new(), compared: 0 }
    }

    /// An error counts by its excess over what is `inherent`.
    pub fn compare(&mut self, found: f32, expected: f64, inherent: f64, at: impl FnOnce() -> String) {
        let found = f64::from(found);
        if found.max(expected) < VANISHING && found >= 0.0 {
            return;
        }
        self.compared += 1;
        let error = (found - expected).abs() / expected.abs().max(VANISHING) - inherent;
        if error.is_nan() || error > self.error {
            (self.error, self.at) = (error, format!("{}: {found:e}, not {expected:e}", at()));
        }
    }

    pub fn check(&self, inputs: usize) {
        println!("{}: {:.1e} over {} ({})", self.what, self.error, self.compared, self.at);
        assert!(self.compared >= inputs, "{}: only {} comparisons", self.what, self.compared);
        assert!(self.error <= 1e-4, "{}: {:.1e} at {}", self.what, self.error, self.at);
    }
}

/// Spread evenly over the decades from `low` to `high`.
pub fn decades(random: &mut Random, low: f32, high: f32) -> f32 {
    (low.ln() + (high.ln() - low.ln()) * random.next_f32()).exp().clamp(low, high)
}

/// A direction of this cosine, turned at random.
pub fn toward(cos: f32, random: &mut Random) -> Vec3 {
    let phi = std::f32::consts::TAU * random.next_f32();
    let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

/// A direction in front, most often at a grazing angle or close to the normal.
pub fn in_front(random: &mut Random) -> Vec3 {
    let cos = match random.below(3) {
        0 => decades(random, 1e-6, 1.0),
        1 => 1.0 - decades(random, 1e-7, 1.0) * 0.999,
        _ => random.range(0.001, 1.0),
    };
    toward(cos, random)
}

/// The error function.
pub fn erf64(x: f64) -> f64 {
    // The series for small x, the continued fraction (Lentz) for large.
    if x.abs() < 2.5 {
        let (mut term, mut sum) = (x, x);
        for n in 1..80 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        return 2.0 / PI.sqrt() * sum;
    }
    let mut fraction = 0.0;
    for k in (1..60).rev() {
        fraction = 0.5 * f64::from(k) / (x.abs() + fraction);
    }
    (1.0 - (-x * x).exp() / (PI.sqrt() * (x.abs() + fraction))).copysign(x)
}

/// Henyey and Greenstein 1941 with mean cosine `g`, for light from the unit direction `wi` that goes on in direction `wo`. Written
/// with the half of both, since what is left of a cosine near 1 has no digits.
pub fn henyey_greenstein(g: f32, wi: DVec3, wo: DVec3) -> f64 {
    let (g, half) = (f64::from(g), (0.5 * (wi + wo)).length_squared());
    (1.0 - g * g) / (4.0 * PI * ((1.0 - g).powi(2) + 4.0 * g * half).powf(1.5))
}

/// Microfacets by Walter et al. 2007 (eq. 25, 33) and Heitz 2014 (eq. 72, 83; with two roughnesses 80, 85).
pub struct Facets {
    pub shape: Shape,
    /// Roughness, or its geometric mean.
    pub alpha: f64,
    /// Roughness along the grain over that mean.
    pub aspect: f64,
    /// Angle of the grain.
    pub angle: f64,
}

impl Facets {
    pub fn even(shape: Shape, alpha: f64) -> Self {
        Self { shape, alpha, aspect: 1.0, angle: 0.0 }
    }

    /// Cosine and sine of the angle between a direction and the grain.
    fn beside_grain(&self, w: DVec3) -> [f64; 2] {
        let (sin, cos) = (w.y.atan2(w.x) - self.angle).sin_cos();
        [cos, sin]
    }

    /// α in the plane of the normal and `w`.
    fn towards(&self, w: DVec3) -> f64 {
        let [cos, sin] = self.beside_grain(w);
        (self.alpha * self.aspect * cos).hypot(self.alpha / self.aspect * sin)
    }

    pub fn density(&self, h: DVec3) -> f64 {
        let (cos2, tan2) = (h.z * h.z, (h.x * h.x + h.y * h.y) / (h.z * h.z));
        let ([cos, sin], [u, v]) = (self.beside_grain(h), [self.alpha * self.aspect, self.alpha / self.aspect]);
        let e = tan2 * ((cos / u).powi(2) + (sin / v).powi(2));
        let scale = 1.0 / (PI * u * v * cos2 * cos2);
        match self.shape {
            Shape::Beckmann => scale * (-e).exp(),
            Shape::Ggx => scale / (1.0 + e).powi(2),
        }
    }

    /// Relative error of the density of `h` that is inherent where there is a grain: turning a direction to it rounds the slopes along and across to
    /// some 2e-7 of the slope, however small they are themselves.
    pub fn inherent(&self, h: DVec3) -> f64 {
        if self.aspect == 1.0 {
            return 0.0;
        }
        let ([cos, sin], [u, v]) = (self.beside_grain(h), [self.alpha * self.aspect, self.alpha / self.aspect]);
        let tan = h.truncate().length() / h.z.abs();
        let [x, y] = [tan * cos.abs(), tan * sin.abs()];
        let (e, error) = ((x / u).powi(2) + (y / v).powi(2), 2.0 * 2e-7 * tan * (x / (u * u) + y / (v * v)));
        match self.shape {
            Shape::Beckmann => error,
            Shape::Ggx => 2.0 * error / (1.0 + e),
        }
    }

    pub fn visible(&self, w: DVec3, h: DVec3) -> f64 {
        if w.dot(h) * w.z <= 0.0 {
            return 0.0;
        }
        let tan = w.truncate().length() / w.z.abs();
        if tan == 0.0 {
            return 1.0;
        }
        let a = 1.0 / (self.towards(w) * tan);
        let lambda = match self.shape {
            Shape::Ggx => 0.5 * ((1.0 + 1.0 / (a * a)).sqrt() - 1.0),
            Shape::Beckmann => 0.5 * ((-a * a).exp() / (a * PI.sqrt()) - 1.0 + erf64(a)).max(0.0),
        };
        1.0 / (1.0 + lambda)
    }

    /// As light is reflected: for Beckmann Walter's rational fit, eq. 27.
    pub fn shadowing(&self, w: DVec3, h: DVec3) -> f64 {
        if self.shape == Shape::Ggx || w.dot(h) * w.z <= 0.0 {
            return self.visible(w, h);
        }
        let a = w.z.abs() / (self.towards(w) * w.truncate().length());
        if a < 1.6 { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) } else { 1.0 }
    }

    pub fn visible_density(&self, w: DVec3, h: DVec3) -> f64 {
        self.density(h) * self.visible(w, h) * w.dot(h).max(0.0) / w.z
    }
}
