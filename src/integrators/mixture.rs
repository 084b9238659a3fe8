//! One-sample multiple importance sampling of BSDF and guide (Müller 2017 §3.3; Zhu 2021 eq. 5):
//! p = α·p_bsdf + (1 − α)·p_guide.
//!
//! A delta lobe has no part in that: no guide can choose its direction. It is chosen as often as without a guide, with probability
//! p_δ, and what the guide proposes is for the rest: p = α·p_bsdf + (1 − α)(1 − p_δ)·p_guide. Were it chosen when the BSDF is, a small
//! α would make the mirror images in a varnished table noisy.

use glam::Vec3;

use super::site::{Draw, Onward, Site};
use crate::base::random::{Dimension, Random};
use crate::geometry::Surface;
use crate::guiding::sample::field::{DirectionGuide, VoxelGuide};
use crate::materials::{Bsdf, Transport, Variant};
use crate::math::lanes::{LANES, Mask, Real, V3};

/// How directions are sampled at one vertex.
pub struct Mixture<'a, 'g> {
    site: Site<'a, f32>,
    chooses_lobe: bool,
    guide: Option<DirectionGuide<'g>>,
}

impl<'a, 'g> Mixture<'a, 'g> {
    /// The mixture at `surface` for light that leaves in the world direction `out`; `bumped` says whether its shading normal is turned
    /// by bumps. `guide` is none where all lobes are delta lobes.
    pub fn new(surface: &Surface, bsdf: Bsdf<'a, f32>, bumped: bool, out: Vec3, guide: Option<&'g VoxelGuide>) -> Self {
        let (normal, smooth, chooses_lobe) = (surface.shading.into(), surface.smooth.into(), bsdf.chooses_lobe());
        let cosine = cosine_normal(bsdf.variant(), surface, out);
        let guide = guide.and_then(|guide| guide.at(surface.point)).map(|guide| guide.facing(cosine));
        let site = Site::new(surface.origin(), normal, smooth, out.into(), bsdf, bumped);
        Self { site, chooses_lobe, guide }
    }

    /// f·|cos θ| towards the world direction `wi`; in a medium the phase function.
    pub fn eval(&self, wi: Vec3) -> Vec3 {
        self.site.eval_and_pdf(wi.into()).0.into()
    }

    /// The density with which [`Mixture::sample`] chooses the world direction `wi`, and the part of it that is the BSDF's.
    pub fn pdf(&self, wi: Vec3) -> (f32, f32) {
        let MixtureSample { pdf, bsdf_share, .. } = self.towards(wi);
        (pdf, bsdf_share)
    }

    /// The world direction `wi`, as if it had been drawn by all that can draw it but delta lobes; its weights are not finite where none can.
    pub fn towards(&self, wi: Vec3) -> MixtureSample {
        let (value, pdf) = self.site.eval_and_pdf(wi.into());
        let mut sample = MixtureSample {
            direction: wi,
            weight: Vec3::ZERO,
            bsdf_weight: Vec3::ZERO,
            value: value.into(),
            pdf,
            bsdf_share: 1.0,
            delta: false,
        };
        if let Some(guide) = self.guide {
            let (bsdf_fraction, deltas, guide_pdf) =
                (guide.bsdf_fraction, self.site.delta_probability(), guide.pdf(wi));
            (sample.pdf, sample.bsdf_share) = MixtureDensity { bsdf_fraction, deltas, guide_pdf }.pdf(pdf);
        }
        sample.weight = sample.value / sample.pdf;
        sample.bsdf_weight = if pdf > 0.0 { sample.value / pdf } else { sample.weight };
        sample
    }

    /// Draws a direction by the numbers of this vertex, and where a ray in it starts; none where the surface absorbs.
    pub fn sample(&self, random: &Random, transport: Transport) -> Option<(MixtureSample, Vec3)> {
        let proposal = self.guide.and_then(|guide| {
            let u = guided_point(guide.bsdf_fraction, random)?;
            Some(guide.sample(u))
        });
        let (towards, _) = proposal.unwrap_or_default();
        let guided = self.guide.map(|_| (proposal.is_some(), towards.into()));
        let onward = self.site.draw(&one_draw(random, self.chooses_lobe, guided, transport));
        let density = |guide: DirectionGuide| match proposal {
            Some((_, pdf)) => pdf,
            None if onward.any => guide.pdf(onward.direction.into()),
            None => 0.0,
        };
        let guide = self.guide.filter(|_| !onward.delta).map(|guide| (guide.bsdf_fraction, density(guide)));
        let sample = MixtureSample::new(&onward, guide)?;
        Some((sample, onward.origin.into()))
    }
}

/// The normal, on the side of `out`, of a surface that reflects light alone, for [`DirectionGuide::facing`]; zero for others.
#[inline(always)]
pub(super) fn cosine_normal(variant: Variant, surface: &Surface, out: Vec3) -> Vec3 {
    if variant.reflects() { surface.normal_towards(out) } else { Vec3::ZERO }
}

/// The numbers of one vertex by which a direction is drawn; see [`Draw::guided`].
pub(super) fn one_draw(
    random: &Random,
    chooses_lobe: bool,
    guided: Option<(bool, V3<f32>)>,
    transport: Transport,
) -> Draw<f32> {
    Draw {
        lobe: if chooses_lobe { random.at(Dimension::LOBE).next_f32() } else { 0.0 },
        u: random.at(Dimension::DIRECTION).next_2d(),
        guided,
        transport,
    }
}

/// The point of the unit square by which a guide is to propose a direction at a vertex with these random numbers, where the BSDF is
/// chosen with probability `bsdf_fraction`; none where it is.
#[inline(always)]
pub(super) fn guided_point(bsdf_fraction: f32, random: &Random) -> Option<[f64; 2]> {
    let (taken, point) = left_by_bsdf(bsdf_fraction, random.at(Dimension::GUIDE).next_2d_f64());
    taken.then_some(point)
}

/// [`guided_point`] of sixteen vertices, of their numbers, and where it is none no bit.
#[inline(always)]
pub(super) fn guided_points(bsdf_fractions: &[f32; LANES], points: &[[f64; 2]; LANES]) -> (u32, [[f64; 2]; LANES]) {
    let (mut all, mut left) = (0, *points);
    for (lane, (point, &fraction)) in left.iter_mut().zip(bsdf_fractions).enumerate() {
        let taken;
        (taken, *point) = left_by_bsdf(fraction, *point);
        all |= u32::from(taken) << lane;
    }
    (all, left)
}

/// One point of the plane chooses the strategy and the guide's direction, so that directions are spread evenly.
#[inline(always)]
fn left_by_bsdf(bsdf_fraction: f32, [u, v]: [f64; 2]) -> (bool, [f64; 2]) {
    let alpha = f64::from(bsdf_fraction);
    (u >= alpha, [(u - alpha) / (1.0 - alpha), v])
}

/// The density of BSDF and guide together, for the direction of each lane.
#[derive(Debug, Clone, Copy)]
pub struct MixtureDensity<R: Real> {
    /// Probability α of sampling the BSDF, in (0, 1].
    pub bsdf_fraction: R,
    /// Probability p_δ of a delta lobe.
    pub deltas: R,
    /// The guide's density w.r.t. solid angle.
    pub guide_pdf: R,
}

impl<R: Real> MixtureDensity<R> {
    /// The mixture's density where the BSDF's is `bsdf_pdf`, and the part of it that is the BSDF's.
    #[inline(always)]
    pub fn pdf(&self, bsdf_pdf: R) -> (R, R) {
        let bsdf = self.bsdf_fraction * bsdf_pdf;
        let both = bsdf + self.bsdf_fraction.rest() * (self.deltas.rest().at_least(0.0) * self.guide_pdf);
        (both, both.above(0.0).choose(bsdf / both, both.all(1.0)))
    }
}

/// Guides in the directions that were drawn, lane by lane.
#[derive(Clone, Copy)]
pub struct Guided<R: Real> {
    /// Where there is a guide and no delta lobe was drawn.
    pub any: R::Mask,
    /// Probability α of sampling the BSDF there.
    pub bsdf_fraction: R,
    /// The guide's density w.r.t. solid angle.
    pub pdf: R,
}

/// What the directions that were drawn are worth, lane by lane, with the density of all that could have drawn them.
#[derive(Clone, Copy)]
pub struct Mixed<R: Real> {
    /// Where something may come back.
    pub any: R::Mask,
    /// f·|cos θ| / p.
    pub weight: V3<R>,
    /// f·|cos θ| / p_bsdf: share that the surface reflects, whoever proposed the direction.
    pub bsdf_weight: V3<R>,
    /// Density p of the mixture w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: R,
    /// Part of p that is the BSDF's.
    pub bsdf_share: R,
}

impl<R: Real> Mixed<R> {
    /// Without guides there are no densities of theirs.
    #[inline(always)]
    pub fn new(onward: &Onward<R>, guided: Option<Guided<R>>) -> Self {
        let &Onward { any, value, weight, pdf, .. } = onward;
        let alone = Self { any, weight, bsdf_weight: weight, pdf, bsdf_share: pdf.all(1.0) };
        let Some(Guided { any: guided, bsdf_fraction, pdf: guide_pdf }) = guided else { return alone };
        let (mixed, bsdf_share) = MixtureDensity { bsdf_fraction, deltas: onward.deltas, guide_pdf }.pdf(pdf);
        let weight = value / mixed;
        let brings = !value.is_zero() & !mixed.le(mixed.all(0.0));
        let by_bsdf = V3::choose(pdf.above(0.0), value / pdf, weight);
        Self {
            any: any & (brings | !guided),
            weight: V3::choose(guided, weight, alone.weight),
            bsdf_weight: V3::choose(guided, by_bsdf, alone.bsdf_weight),
            pdf: guided.choose(mixed, alone.pdf),
            bsdf_share: guided.choose(bsdf_share, alone.bsdf_share),
        }
    }
}

/// A direction drawn from a mixture, or from a BSDF alone.
#[derive(Debug, Clone, Copy)]
pub struct MixtureSample {
    /// Unit direction in the world.
    pub direction: Vec3,
    /// f·|cos θ| / p.
    pub weight: Vec3,
    /// f·|cos θ| / p_bsdf: share that the surface reflects, whoever proposed the direction.
    pub bsdf_weight: Vec3,
    /// f·|cos θ|; zero for a delta lobe, where it has no finite value.
    pub value: Vec3,
    /// Density p of the mixture w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: f32,
    /// Part of p that is the BSDF's.
    pub bsdf_share: f32,
    /// Whether the direction came from a delta lobe.
    pub delta: bool,
}

impl MixtureSample {
    /// The direction that was drawn, with the density of all that could have drawn it; none where nothing comes back from it.
    /// `guide` is the probability α of sampling the BSDF and the guide's density in that direction; it is none where there is no
    /// guide, or a delta lobe was drawn.
    #[inline(always)]
    pub fn new(onward: &Onward<f32>, guide: Option<(f32, f32)>) -> Option<Self> {
        let guided = guide.map(|(bsdf_fraction, pdf)| Guided { any: true, bsdf_fraction, pdf });
        let mixed = Mixed::new(onward, guided);
        mixed.any.then(|| Self {
            direction: onward.direction.into(),
            weight: mixed.weight.into(),
            bsdf_weight: mixed.bsdf_weight.into(),
            value: onward.value.into(),
            pdf: mixed.pdf,
            bsdf_share: mixed.bsdf_share,
            delta: onward.delta,
        })
    }
}
