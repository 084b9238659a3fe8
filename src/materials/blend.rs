//! Two materials mixed by a weight.
//!
//! The parts are any materials at all, so that points of a blend have nothing in common to compute in lanes: they are asked one by one.

use glam::{Vec2, Vec3};

use super::texture::Texture;
use super::{BsdfSample, Coordinates, Drawn, Material, Scatter, Transport};
use crate::math::lanes::{Real, V3, by_lane, lanes_of};

/// (1 − w)·first + w·second.
#[derive(Debug, Clone)]
pub struct Blend {
    /// Weight of the second material, in [0, 1]; the luminance of a colour.
    pub weight: Texture,
    /// The materials; their masks and bumps do not count.
    pub parts: [Material; 2],
}

/// A blend at surface points.
#[derive(Clone, Copy)]
pub struct At<'a, R: Real> {
    /// Weight of the second material, in [0, 1].
    weight: R,
    points: R::Each<Point<'a>>,
}

lanes_of!(At<'a> { weight, points });

/// The materials of a blend and where they are asked.
#[derive(Clone, Copy)]
struct Point<'a> {
    parts: &'a [Material; 2],
    place: Coordinates,
}

impl Blend {
    /// See [`Material::prefetch`](super::Material::prefetch).
    pub(super) fn prefetch(&self, uv: Vec2) {
        self.weight.prefetch(uv);
        self.parts.iter().for_each(|part| part.prefetch(uv));
    }

    /// The blend somewhere.
    pub fn at(&self, place: Coordinates) -> At<'_, f32> {
        let weight = self.weight.value(place.uv).clamp(0.0, 1.0);
        At { weight, points: [Point { parts: &self.parts, place }] }
    }

    /// Refractive index on the other side over that on the side of `wo`. Of two parts that refract, the first decides.
    pub fn eta(&self, wo: Vec3) -> f32 {
        eta(&self.parts, wo)
    }
}

fn eta(parts: &[Material; 2], wo: Vec3) -> f32 {
    parts.iter().map(|part| part.eta(wo, -wo)).find(|&eta| eta != 1.0).unwrap_or(1.0)
}

// None of these is inlined: their code is that of all materials, which they themselves are part of.
impl Point<'_> {
    #[inline(never)]
    fn eval_and_pdf(&self, weight: f32, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let [a, b] = [1.0 - weight, weight];
        let (value_a, pdf_a) = self.parts[0].eval_and_pdf(self.place, wo, wi);
        let (value_b, pdf_b) = self.parts[1].eval_and_pdf(self.place, wo, wi);
        (value_a * a + value_b * b, pdf_a * a + pdf_b * b)
    }

    #[inline(never)]
    fn delta_probability(&self, weight: f32, wo: Vec3) -> f32 {
        let [a, b] = [1.0 - weight, weight];
        self.parts[0].delta_probability(self.place, wo) * a + self.parts[1].delta_probability(self.place, wo) * b
    }

    /// Samples one of the two materials, chosen by weight with `lobe`; the rest of that number then chooses the material's lobe.
    #[inline(never)]
    fn sample(&self, weight: f32, wo: Vec3, lobe: f32, u: [f32; 2], transport: Transport) -> Option<BsdfSample> {
        let (place, weights) = (self.place, [1.0 - weight, weight]);
        let (chosen, left) =
            if lobe < weights[1] { (1, lobe / weights[1]) } else { (0, (lobe - weights[1]) / weights[0]) };
        let left = left.min(1.0 - f32::EPSILON / 2.0);
        let sample = self.parts[chosen].sample(place, wo, left, u, transport)?;
        if sample.delta {
            return Some(BsdfSample { pdf: sample.pdf * weights[chosen], ..sample });
        }
        let other = 1 - chosen;
        let (mut value, pdf) = self.parts[other].eval_and_pdf(place, wo, sample.wi);
        if transport == Transport::Importance {
            // What is sampled has it already: power is not squeezed where it is refracted.
            value *= self.parts[other].eta(wo, sample.wi).powi(2);
        }
        let value = sample.weight * (sample.pdf * weights[chosen]) + value * weights[other];
        let pdf = sample.pdf * weights[chosen] + pdf * weights[other];
        Some(BsdfSample { weight: value / pdf, pdf, ..sample })
    }

    #[inline(never)]
    fn albedo(&self, weight: f32) -> Vec3 {
        let [a, b] = [1.0 - weight, weight];
        self.parts[0].albedo(self.place) * a + self.parts[1].albedo(self.place) * b
    }
}

impl<'a, R: Real> At<'a, R> {
    #[inline(always)]
    fn point(&self, lane: usize) -> &Point<'a> {
        &self.points.as_ref()[lane]
    }
}

impl<R: Real> Scatter<R> for At<'_, R> {
    #[inline(always)]
    fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let given = [self.weight, wo.x, wo.y, wo.z, wi.x, wi.y, wi.z];
        let [x, y, z, pdf] = by_lane!(given, |lane, [weight, ox, oy, oz, ix, iy, iz]| {
            let (value, pdf) = self.point(lane).eval_and_pdf(weight, Vec3::new(ox, oy, oz), Vec3::new(ix, iy, iz));
            [value.x, value.y, value.z, pdf]
        });
        (V3::new(x, y, z), pdf)
    }

    #[inline(always)]
    fn sample(&self, wo: V3<R>, lobe: R, [u, v]: [R; 2], transport: Transport) -> Drawn<R> {
        let given = [self.weight, wo.x, wo.y, wo.z, lobe, u, v];
        let [x, y, z, red, green, blue, pdf, delta, found] = by_lane!(given, |lane, [weight, x, y, z, lobe, u, v]| {
            let sample = self.point(lane).sample(weight, Vec3::new(x, y, z), lobe, [u, v], transport);
            sample.map_or([0.0; 9], |BsdfSample { wi, weight, pdf, delta }| {
                [wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf, if delta { 1.0 } else { 0.0 }, 1.0]
            })
        });
        let (wi, weight) = (V3::new(x, y, z), V3::new(red, green, blue));
        Drawn { wi, weight, pdf, delta: delta.above(0.0), found: found.above(0.0) }
    }

    #[inline(always)]
    fn delta_probability(&self, wo: V3<R>) -> R {
        let given = [self.weight, wo.x, wo.y, wo.z];
        let [deltas] = by_lane!(given, |lane, [weight, x, y, z]| {
            [self.point(lane).delta_probability(weight, Vec3::new(x, y, z))]
        });
        deltas
    }

    #[inline(always)]
    fn eta(&self, wo: V3<R>) -> R {
        let [eta] = by_lane!([wo.x, wo.y, wo.z], |lane, wo| [eta(self.point(lane).parts, wo.into())]);
        eta
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        let [x, y, z] = by_lane!([self.weight], |lane, [weight]| self.point(lane).albedo(weight).to_array());
        V3::new(x, y, z)
    }
}
