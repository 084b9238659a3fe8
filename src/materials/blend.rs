//! Two materials mixed by a weight.

use glam::{Vec2, Vec3};

use super::texture::Texture;
use super::{BsdfSample, Material, Transport};

/// (1 − w)·first + w·second.
#[derive(Debug, Clone)]
pub struct Blend {
    /// Weight of the second material, in [0, 1]; the luminance of a colour.
    pub weight: Texture,
    /// The materials; their masks and bumps do not count.
    pub parts: [Material; 2],
}

impl Blend {
    /// The weights of both materials at `uv`.
    fn weights(&self, uv: Vec2) -> [f32; 2] {
        let weight = self.weight.value(uv).clamp(0.0, 1.0);
        [1.0 - weight, weight]
    }

    /// f·|cos θᵢ|.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        let [a, b] = self.weights(uv);
        self.parts[0].eval(uv, wo, wi) * a + self.parts[1].eval(uv, wo, wi) * b
    }

    /// Density over the lobes that are not delta, w.r.t. solid angle.
    pub fn pdf(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> f32 {
        let [a, b] = self.weights(uv);
        self.parts[0].pdf(uv, wo, wi) * a + self.parts[1].pdf(uv, wo, wi) * b
    }

    /// Probability with which [`Blend::sample`] chooses a delta lobe.
    pub fn delta_probability(&self, uv: Vec2, wo: Vec3) -> f32 {
        let [a, b] = self.weights(uv);
        self.parts[0].delta_probability(uv, wo) * a + self.parts[1].delta_probability(uv, wo) * b
    }

    /// Samples one of the two materials, chosen by weight with `lobe`; the rest of that number then chooses the material's lobe.
    pub fn sample(&self, uv: Vec2, wo: Vec3, lobe: f32, u: [f32; 2], transport: Transport) -> Option<BsdfSample> {
        let weights = self.weights(uv);
        let (chosen, left) =
            if lobe < weights[1] { (1, lobe / weights[1]) } else { (0, (lobe - weights[1]) / weights[0]) };
        let left = left.min(1.0 - f32::EPSILON / 2.0);
        let sample = self.parts[chosen].sample(uv, wo, left, u, transport)?;
        if sample.delta {
            return Some(BsdfSample { pdf: sample.pdf * weights[chosen], ..sample });
        }
        let other = 1 - chosen;
        let value =
            sample.weight * (sample.pdf * weights[chosen]) + self.parts[other].eval(uv, wo, sample.wi) * weights[other];
        let pdf = sample.pdf * weights[chosen] + self.parts[other].pdf(uv, wo, sample.wi) * weights[other];
        Some(BsdfSample { weight: value / pdf, pdf, ..sample })
    }

    /// Reflectance for pictures of the albedo.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        let [a, b] = self.weights(uv);
        self.parts[0].albedo(uv) * a + self.parts[1].albedo(uv) * b
    }
}
