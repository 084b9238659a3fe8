//! What Burley's materials have in common (Burley 2012; Burley 2015): their diffuse base, their facets, and tables of albedos by which
//! the sum of their lobes is kept from scattering more than arrives.

use std::f32::consts::PI;

use glam::Vec4;

use super::fresnel;
use super::microfacet::{Microfacets, Shape};
use super::texture::{Texture, luminance};
use crate::math::lanes::{Bits, Mask, Real, V3, by_lane};
use crate::sampling::warp::lanes as warp;

/// Burley's least α, which keeps densities finite.
const LEAST_ALPHA: f32 = 1e-3;

/// Schlick's (1 − cos θ)⁵.
#[inline(always)]
pub(super) fn schlick<R: Real>(cos: R) -> R {
    let x = cos.rest().between(0.0, 1.0);
    x * x.squared().squared()
}

/// Facets of a material with some roughness.
#[inline(always)]
pub(super) fn facets_of<R: Real>(roughness: R) -> Microfacets<R> {
    Microfacets { shape: Shape::Ggx, alpha: roughness.squared().at_least(LEAST_ALPHA), grain: None }
}

/// Schlick's reflectance from the one at normal incidence, where [`schlick`] is `weight`.
#[inline(always)]
pub(super) fn approximate<R: Real>(normal: V3<R>, weight: R) -> V3<R> {
    normal + normal.rest() * weight
}

/// `wo` mirrored at a facet with the normal `h`.
#[inline(always)]
pub(super) fn mirrored_at<R: Real>(wo: V3<R>, h: V3<R>) -> V3<R> {
    h * (wo.dot(h) * 2.0) - wo
}

/// π·f of a white base: Burley 2012, §5.3 in the form of Burley 2015, eq. 4, or flattened (§2.3 there).
#[inline(always)]
pub(super) fn diffuse<R: Real>(roughness: R, flatness: R, wo: V3<R>, wi: V3<R>, h: V3<R>) -> R {
    let (fo, fi) = (schlick(wo.z), schlick(wi.z));
    let cos_d = wi.dot(h);
    let retro = roughness * 2.0 * cos_d * cos_d;
    let plain = (fo * 0.5).rest() * (fi * 0.5).rest() + retro * (fo + fi + fo * fi * (retro - 1.0));
    let flattened = !flatness.is(0.0);
    if !flattened.any() {
        return plain;
    }
    let at_grazing = retro / 2.0;
    let ss = ((at_grazing - 1.0) * fo + 1.0) * ((at_grazing - 1.0) * fi + 1.0);
    let flat = (ss * ((wo.z + wi.z).inverse() - 0.5) + 0.5) * 1.25;
    flattened.choose(plain + (flat - plain) * flatness, plain)
}

/// Numbers of cosines (closer to one another at grazing angles) and roughnesses at which albedos are tabulated, both from 0 to 1.
const COSINES: usize = 24;
const ROUGHNESSES: usize = 8;
/// Points along each axis of the quadratures.
const POINTS: usize = 24;

/// Albedos of a material's four lobes, each at full strength: a row of cosines for each roughness. Four numbers of an entry are
/// interpolated as fast as one.
#[derive(Debug)]
pub(super) struct Bounds([Vec4; COSINES * ROUGHNESSES]);

impl Bounds {
    /// Tabulates the albedos that `entry` gives for a roughness and a direction, with what `along` says of the direction alone.
    pub(super) fn new<C>(
        roughness: &Texture,
        along: impl Fn(V3<f32>) -> C,
        entry: impl Fn(f32, V3<f32>, &C) -> [f32; 4],
    ) -> Self {
        let rough = |i: usize| i as f32 / (ROUGHNESSES - 1) as f32;
        // Where the roughness does not vary, only the rows around it are asked for.
        let asked = |i: usize| match roughness {
            Texture::Constant(value) => {
                (luminance(*value).clamp(0.0, 1.0) - rough(i)).abs() * ((ROUGHNESSES - 1) as f32) < 1.01
            }
            _ => true,
        };
        let mut table = [Vec4::ZERO; COSINES * ROUGHNESSES];
        for column in 0..COSINES {
            let cos = (column as f32 / (COSINES - 1) as f32).powi(2).max(1e-3);
            let wo = V3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let of_column = along(wo);
            for row in 0..ROUGHNESSES {
                if asked(row) {
                    table[row * COSINES + column] = entry(rough(row), wo, &of_column).into();
                }
            }
        }
        Self(table)
    }

    /// Interpolates in a cell: `along` the cosines and `across` the roughnesses, from the entry `first`.
    #[inline(always)]
    fn between(&self, first: u16, along: f32, across: f32) -> [f32; 4] {
        let cell = &self.0[usize::from(first)..][..COSINES + 2];
        let between = |row: Vec4, next: Vec4| row + (next - row) * along;
        let (a, b) = (between(cell[0], cell[1]), between(cell[COSINES], cell[COSINES + 1]));
        (a + (b - a) * across).to_array()
    }
}

/// Albedos of the lobes at angles with cosines `cos`, in the order of [`Bounds`].
#[inline(always)]
pub(super) fn tabulated<R: Real>(bounds: R::Each<&Bounds>, roughness: R, cos: R) -> [R; 4] {
    let (column, along) = cell(cos.sqrt(), COSINES);
    let (row, across) = cell(roughness, ROUGHNESSES);
    let first = row * COSINES as f32 + column;
    by_lane!([first, along, across], |lane, [first, along, across]| {
        bounds.as_ref()[lane].between(first as u16, along, across)
    })
}

/// The cell of a table with `count` entries from 0 to 1 in which `x` lies, and how far into it.
#[inline(always)]
fn cell<R: Real>(x: R, count: usize) -> (R, R) {
    let position = x * (count - 1) as f32;
    let below = position.between(0.0, (count - 2) as f32).whole().real();
    (below, position - below)
}

pub(super) fn albedo_of_base(roughness: f32, flatness: f32, wo: V3<f32>) -> f32 {
    over_cosines(wo, |wi, h| diffuse(roughness, flatness, wo, wi, h))
}

pub(super) fn albedo_of_facets(roughness: f32, eta: f32, wo: V3<f32>) -> f32 {
    let facets = facets_of(roughness);
    mean(|u| {
        let h = facets.sample_visible(wo, u);
        let wi = mirrored_at(wo, h);
        let reflected = fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), eta).0;
        if wi.z > 0.0 { reflected * facets.shadowing(wi, h) } else { 0.0 }
    })
}

pub(super) fn albedo_of_sheen(wo: V3<f32>) -> f32 {
    over_cosines(wo, |wi, h| PI * schlick(wi.dot(h)))
}

/// The mean of π·f, a function of the other direction and of the half vector, over cosine-distributed directions.
fn over_cosines(wo: V3<f32>, f: impl Fn(V3<f32>, V3<f32>) -> f32) -> f32 {
    mean(|u| {
        let wi = warp::square_to_cosine_hemisphere(u);
        let (h, found) = (wo + wi).try_normalize();
        let h = if found { h } else { V3::new(0.0, 0.0, 1.0) };
        if wi.z > 0.0 { f(wi, h) } else { 0.0 }
    })
}

/// The mean over the unit square.
pub(super) fn mean(f: impl Fn([f32; 2]) -> f32) -> f32 {
    let at = |k: usize| (k as f32 + 0.5) / POINTS as f32;
    let sum: f32 = (0..POINTS * POINTS).map(|i| f([at(i % POINTS), at(i / POINTS)])).sum();
    sum / (POINTS * POINTS) as f32
}
