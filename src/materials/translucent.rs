//! Leaves, paper, lamp shades: thin sheets that scatter light evenly to both sides, each with its own colour.

use std::f32::consts::FRAC_1_PI;

use glam::Vec2;

use super::texture::Texture;
use super::{Drawn, Scatter, Transport};
use crate::math::lanes::{Mask, Real, V3, lanes_of};
use crate::sampling::warp::lanes as warp;

/// f = reflectance/π on the side of the light, transmittance/π on the other; both sides are alike. Where the sum would exceed 1 both
/// are scaled down.
#[derive(Debug, Clone)]
pub struct Translucent {
    /// Albedo of what comes back.
    pub reflectance: Texture,
    /// Albedo of what goes through.
    pub transmittance: Texture,
}

/// A translucent sheet at points.
#[derive(Debug, Clone, Copy)]
pub struct At<R> {
    reflectance: V3<R>,
    transmittance: V3<R>,
    /// Probability of sampling the side of `wo`.
    back: R,
}

lanes_of!(At { reflectance, transmittance, back });

impl Translucent {
    /// The sheet at `uv`.
    pub fn at(&self, uv: Vec2) -> At<f32> {
        let [reflectance, transmittance] = [&self.reflectance, &self.transmittance].map(|texture| texture.eval(uv));
        let scale = 1.0 / (reflectance + transmittance).max_element().max(1.0);
        let [reflectance, transmittance] = [reflectance * scale, transmittance * scale].map(V3::from);
        let (back, through) = (reflectance.mean(), transmittance.mean());
        At { reflectance, transmittance, back: if back > 0.0 { back / (back + through) } else { 0.0 } }
    }

    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        self.reflectance.prefetch(uv);
        self.transmittance.prefetch(uv);
    }
}

impl<R: Real> Scatter<R> for At<R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let sides = wo.z * wi.z;
        let (same, cos) = (sides.above(0.0), wi.z.abs() * FRAC_1_PI);
        let value = V3::choose(same, self.reflectance, self.transmittance) * cos;
        let pdf = same.choose(self.back, self.back.rest()) * cos;
        let seen = same | sides.below(0.0);
        (value.only(seen), pdf.only(seen))
    }

    /// Chooses a side with `lobe` and a cosine-distributed direction on it with `u`.
    #[inline(always)]
    fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], _: Transport) -> Drawn<R> {
        let same = lobe.lt(self.back);
        let wi = warp::square_to_cosine_hemisphere(u);
        let down = wo.z.below(0.0) & same | wo.z.above(0.0) & !same;
        let wi = V3::new(wi.x, wi.y, down.choose(-wi.z, wi.z));
        let (value, pdf) = self.eval_and_pdf(wo, wi);
        Drawn::of_lobe(wi, value / pdf, pdf)
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        self.reflectance + self.transmittance
    }
}
