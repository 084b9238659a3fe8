//! Phase functions: how a medium scatters light.
//!
//! Directions are in a frame whose +z is `wo`, where the light goes; `wi` points to where it comes from. Light that is not
//! turned comes from -z.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::{Drawn, Scatter, Transport};
use crate::math::lanes::functions::sin_cos;
use crate::math::lanes::{Mask, Real, V3, by_lane, lanes_of};

/// Henyey and Greenstein 1941: p(cos θ) = (1 - g²) / (4π (1 + g² - 2 g cos θ)^{3/2}), where θ is the angle by which light is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HenyeyGreenstein {
    /// Mean cosine of θ, in (-1, 1): positive scatters forwards, 0 alike in all directions.
    g: f32,
}

/// Largest |g|: the density of a sharper peak has no digits left in single precision.
pub const SHARPEST: f32 = 0.999;

impl HenyeyGreenstein {
    /// The phase function with mean cosine `g`, cut to ±[`SHARPEST`].
    pub fn new(g: f32) -> Self {
        Self { g: g.clamp(-SHARPEST, SHARPEST) }
    }

    /// Scattering at points of a medium.
    #[inline(always)]
    pub(super) fn at(self) -> At<f32> {
        At { g: self.g }
    }

    /// The roughness α of facets whose reflection would be about as wide. Half of the light is turned by no more than about √3·(1 − |g|), by
    /// g near 1, from the way on or back, and facets by GGX turn half of theirs by no more than about 2α.
    pub fn roughness(self) -> f32 {
        0.5 * 3f32.sqrt() * (1.0 - self.g.abs())
    }

    /// Value towards `wi`, sr⁻¹; at the same time the density of [`HenyeyGreenstein::sample`] w.r.t. solid angle.
    pub fn pdf(self, wi: Vec3) -> f32 {
        self.at().density(wi.into())
    }

    /// Samples `wi` in proportion to the phase function.
    pub fn sample(self, u: [f32; 2]) -> Vec3 {
        self.at().direction(u).into()
    }
}

/// The phase function at points.
#[derive(Debug, Clone, Copy)]
pub struct At<R> {
    /// Mean cosine, see [`HenyeyGreenstein`].
    g: R,
}

lanes_of!(At { g });

impl<R: Real> At<R> {
    #[inline(always)]
    fn density(&self, wi: V3<R>) -> R {
        // 1 + g² - 2 g cos θ, written so that the difference of nearly equal numbers does not arise for g near 1 or -1.
        let (g, one) = (self.g.abs(), self.g.all(1.0));
        let cos = -wi.z * one.with_sign(self.g);
        // 1 − cos θ of a small θ has no digits left, its sine has all.
        let sine2 = wi.x * wi.x + wi.y * wi.y;
        let one_less = cos.above(0.0).choose(sine2 / (one + cos), one - cos);
        let base = (one - g) * (one - g) + g * 2.0 * one_less;
        (one - g) * (one + g) / (base * (4.0 * PI) * base.sqrt())
    }

    /// The inverse of the distribution is expanded so that nothing is divided by g, which may be 0; in double precision, since
    /// directions near the peak have no digits left in single.
    #[inline(always)]
    fn direction(&self, [u, v]: [R; 2]) -> V3<R> {
        let [cos, sin] = by_lane!([self.g, u], |_, [g, u]| {
            let (g, x) = (f64::from(g), 2.0 * f64::from(u) - 1.0);
            let top = x + g * (0.5 * (x * x + 3.0) + g * (x + 0.5 * g * (x * x - 1.0)));
            let cos = (top / (1.0 + g * x).powi(2)).clamp(-1.0, 1.0);
            [cos as f32, (1.0 - cos * cos).sqrt() as f32]
        });
        let (y, x) = sin_cos(v * TAU);
        V3::new(sin * x, sin * y, -cos)
    }
}

impl<R: Real> Scatter<R> for At<R> {
    #[inline(always)]
    fn eval_and_pdf(&self, _: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let density = self.density(wi);
        (V3::splat(density), density)
    }

    #[inline(always)]
    fn sample(&self, _: V3<R>, _: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let wi = self.direction(u);
        Drawn::of_lobe(wi, V3::splat(self.g.all(1.0)), self.density(wi))
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        V3::splat(self.g.all(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// docs/stability.md, A12: from backwards to forwards, through isotropic.
    const ALL: [f32; 9] = [-1.0, -0.99, -0.7, -1e-4, 0.0, 1e-6, 0.3, 0.95, 1.0];

    #[test]
    fn s02_density_integrates_to_one_and_has_the_mean_cosine() {
        for g in ALL {
            let phase = HenyeyGreenstein::new(g);
            // Substituted cos θ = 1 - s³ from the side of the peak, where the density needs many cells.
            let n = 200_000;
            let (mut mass, mut mean) = (0.0, 0.0);
            for i in 0..n {
                let s = (f64::from(i) + 0.5) / f64::from(n) * 2f64.cbrt();
                let turned = (1.0 - s.powi(3)) * f64::from(if g < 0.0 { -1.0f32 } else { 1.0 });
                let weight = 3.0 * s * s * (2f64.cbrt() / f64::from(n)) * std::f64::consts::TAU;
                let density =
                    f64::from(phase.pdf(Vec3::new(0.0, (1.0 - turned * turned).sqrt() as f32, -turned as f32)));
                mass += weight * density;
                mean += weight * density * turned;
            }
            assert!((mass - 1.0).abs() < 1e-4, "g {g}: {mass}");
            assert!((mean - f64::from(phase.g)).abs() < 1e-4, "g {g}: {mean}");
        }
    }

    #[test]
    fn a12_samples_turn_by_the_mean_cosine() {
        for g in ALL {
            let phase = HenyeyGreenstein::new(g);
            let n = 1 << 12;
            let mean: f64 =
                (0..n).map(|i| -f64::from(phase.sample([(i as f32 + 0.5) / n as f32, 0.3]).z) / f64::from(n)).sum();
            assert!((mean - f64::from(phase.g)).abs() < 2e-3, "g {g}: {mean}");
            for u in [0.0, 0.5, 1.0 - f32::EPSILON] {
                let wi = phase.sample([u, 0.7]);
                assert!((wi.length() - 1.0).abs() < 1e-5 && phase.pdf(wi).is_finite(), "g {g}, u {u}: {wi}");
            }
        }
    }
}
