//! One-sample multiple importance sampling of BSDF and guide (Müller 2017 §3.3; Zhu 2021 eq. 5):
//! p = α·p_bsdf + (1 − α)·p_guide.
//!
//! A delta lobe has no part in that: no guide can choose its direction. It is chosen as often as without a guide, with probability
//! p_δ, and what the guide proposes is for the rest: p = α·p_bsdf + (1 − α)(1 − p_δ)·p_guide. Were it chosen when the BSDF is, a small
//! α would make the mirror images in a varnished table noisy.

use std::marker::PhantomData;

use glam::Vec3;

use crate::base::random::{Dimension, Random};
use crate::geometry::Surface;
use crate::guiding::sample::field::{DirectionGuide, VoxelGuide};
use crate::materials::bump::Shadowing;
use crate::materials::diffuse::Diffuse;
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::{BsdfSample, Kind, Material, Transport};
use crate::scene::Scene;
use crate::scene::effects::Effects;
use crate::scene::media::Arrival;

/// Scatterer at a vertex.
#[derive(Debug, Clone, Copy)]
pub enum Scattering<'a> {
    /// The material of a surface.
    Material(&'a Material),
    /// The phase function of a medium.
    Phase(HenyeyGreenstein),
}

impl<'a> Scattering<'a> {
    /// Surface, or point of a medium, at which a ray arrived, and the scatterer there; none for the background.
    #[inline(always)]
    pub fn at(scene: &'a Scene, arrival: Arrival) -> Option<(Surface, Self)> {
        match arrival {
            Arrival::Background => None,
            Arrival::Surface(surface) => Some((surface, Self::Material(scene.material(&surface)))),
            Arrival::Medium(point, phase) => Some((point, Self::Phase(phase))),
        }
    }

    /// Whether it belongs to a surface.
    pub fn is_material(&self) -> bool {
        matches!(self, Self::Material(_))
    }

    /// Whether every lobe is a delta lobe.
    pub fn is_delta(&self) -> bool {
        matches!(self, Self::Material(material) if material.is_delta())
    }
}

/// How directions are sampled at one vertex, compiled for the effects `E`.
pub struct Mixture<'a, E> {
    surface: &'a Surface,
    scattering: Scattering<'a>,
    wo: Vec3,
    /// In scenes with none but plain diffuse materials, the one here and whether it is seen from the back of a two-sided one. Found
    /// without a look at all the others, this is most of what they would cost.
    plain: Option<(&'a Diffuse, bool)>,
    guide: Option<DirectionGuide<'a>>,
    /// Probability of a delta lobe, p_δ; 0 without a guide, where it is not needed.
    deltas: f32,
    /// Shadowing by bumps; none where the shading normal has none.
    bumps: Option<Shadowing>,
    effects: PhantomData<E>,
}

/// A direction drawn from a [`Mixture`].
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
    /// |cos θ| to the shading normal; 1 in a medium.
    pub cos: f32,
    /// Density p of the mixture w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: f32,
    /// Part of p that is the BSDF's.
    pub bsdf_share: f32,
    /// Whether the direction came from a delta lobe.
    pub delta: bool,
}

impl<'a, E: Effects> Mixture<'a, E> {
    /// The mixture at `surface` for light that leaves in the world direction `out`; `guide` is none for a delta material.
    #[inline(always)]
    pub fn new(surface: &'a Surface, scattering: Scattering<'a>, out: Vec3, guide: Option<&'a VoxelGuide>) -> Self {
        let guide = guide.and_then(|guide| guide.at(surface.point));
        let bumps = match scattering {
            Scattering::Material(material) if E::MATERIALS && material.bump.is_some() => {
                (surface.smooth != surface.frame.n).then(|| Shadowing::new(surface.smooth, surface.frame.n))
            }
            _ => None,
        };
        let wo = surface.frame.to_local(out);
        let plain = match scattering {
            Scattering::Material(Material { kind: Kind::Diffuse(diffuse), two_sided, .. }) if !E::MATERIALS => {
                Some((diffuse, *two_sided && wo.z < 0.0))
            }
            _ => None,
        };
        let deltas = match scattering {
            Scattering::Material(material) if E::MATERIALS && guide.is_some() => {
                material.delta_probability(surface.uv, wo)
            }
            _ => 0.0,
        };
        Self { surface, scattering, wo, plain, guide, deltas, bumps, effects: PhantomData }
    }

    /// Share of the light from the world direction `wi`, in local coordinates `local`, that bumps do not shadow.
    #[inline(always)]
    fn unhidden(&self, wi: Vec3, local: Vec3) -> f32 {
        if !E::MATERIALS {
            return 1.0;
        }
        self.bumps.map_or(1.0, |bumps| bumps.factor(wi, local.z))
    }

    /// f·|cos θ| towards the world direction `wi`, in local coordinates `local`; in a medium the phase function.
    #[inline(always)]
    fn value(&self, wi: Vec3, local: Vec3) -> Vec3 {
        if !E::MATERIALS {
            return self.plain.map_or(Vec3::ZERO, |(diffuse, back)| {
                let [wo, wi] = [self.wo, local].map(|w| turned(w, back));
                diffuse.eval(self.surface.uv, wo, wi)
            });
        }
        match self.scattering {
            Scattering::Material(material) => material.eval(self.surface.uv, self.wo, local) * self.unhidden(wi, local),
            Scattering::Phase(phase) => Vec3::splat(phase.pdf(local)),
        }
    }

    /// Density of the BSDF or phase function alone for a local direction, w.r.t. solid angle.
    #[inline(always)]
    fn density(&self, local: Vec3) -> f32 {
        if !E::MATERIALS {
            return self.plain.map_or(0.0, |(_, back)| Diffuse::pdf(turned(self.wo, back), turned(local, back)));
        }
        match self.scattering {
            Scattering::Material(material) => material.pdf(self.surface.uv, self.wo, local),
            Scattering::Phase(phase) => phase.pdf(local),
        }
    }

    /// Draws a world direction from the BSDF or phase function alone; what bumps shadow of its weight is taken off, up to all.
    #[inline(always)]
    fn draw(&self, random: &Random, transport: Transport) -> Option<(Vec3, BsdfSample)> {
        let direction = || random.at(Dimension::DIRECTION).next_2d();
        if !E::MATERIALS {
            let (diffuse, back) = self.plain?;
            let sample = diffuse.sample(self.surface.uv, turned(self.wo, back), direction())?;
            let wi = turned(sample.wi, back);
            return Some((self.surface.frame.to_world(wi), BsdfSample { wi, delta: false, ..sample }));
        }
        let sample = match self.scattering {
            Scattering::Material(material) => {
                let lobe = if material.chooses_lobe() { random.at(Dimension::LOBE).next_f32() } else { 0.0 };
                material.sample(self.surface.uv, self.wo, lobe, direction(), transport)?
            }
            Scattering::Phase(phase) => {
                let wi = phase.sample(direction());
                BsdfSample { wi, weight: Vec3::ONE, pdf: phase.pdf(wi), delta: false }
            }
        };
        let wi = self.surface.frame.to_world(sample.wi);
        let unhidden = self.unhidden(wi, sample.wi);
        Some((wi, BsdfSample { weight: sample.weight * unhidden, ..sample }))
    }

    /// Refractive index on the side of the world direction `wi` over that on the side that light leaves to, see [`Material::eta`].
    #[inline(always)]
    pub fn eta(&self, wi: Vec3) -> f32 {
        match self.scattering {
            Scattering::Material(material) if E::MATERIALS => material.eta(self.wo, self.surface.frame.to_local(wi)),
            _ => 1.0,
        }
    }

    /// |cos θ| of a local direction.
    fn cos(&self, wi: Vec3) -> f32 {
        if self.scattering.is_material() { wi.z.abs() } else { 1.0 }
    }

    /// f·|cos θ| towards the world direction `wi`.
    #[inline(always)]
    pub fn eval(&self, wi: Vec3) -> Vec3 {
        self.value(wi, self.surface.frame.to_local(wi))
    }

    /// The density with which [`Mixture::sample`] chooses the world direction `wi`, and the part of it that is the BSDF's.
    #[inline(always)]
    pub fn pdf(&self, wi: Vec3) -> (f32, f32) {
        let pdf = self.density(self.surface.frame.to_local(wi));
        let Some(guide) = self.guide else { return (pdf, 1.0) };
        let bsdf = guide.bsdf_fraction * pdf;
        let both = bsdf + (1.0 - guide.bsdf_fraction) * self.guided(guide.pdf(wi));
        (both, if both > 0.0 { bsdf / both } else { 1.0 })
    }

    /// Draws a direction by the numbers of this vertex; none where the surface absorbs.
    #[inline(always)]
    pub fn sample(&self, random: &Random, transport: Transport) -> Option<MixtureSample> {
        let Some(guide) = self.guide else { return self.sample_bsdf(random, transport) };
        let alpha = guide.bsdf_fraction;
        // Whether it is a delta lobe is only known once the BSDF was sampled.
        let drawn = if self.deltas > 0.0 { Some(self.draw(random, transport)) } else { None };
        if let Some(Some((direction, sample))) = &drawn
            && sample.delta
        {
            return self.delta(*direction, sample);
        }
        // One point of the plane chooses the strategy and the guide's direction, so that directions are spread evenly.
        let (alpha64, [u, v]) = (f64::from(alpha), random.at(Dimension::GUIDE).next_2d_f64());
        if u < alpha64 {
            let drawn = if let Some(drawn) = drawn { drawn } else { self.draw(random, transport) };
            let (direction, sample) = drawn?;
            let pdfs = [sample.pdf, guide.pdf(direction)];
            return self.combine(direction, sample.weight * sample.pdf, sample.wi, pdfs, alpha);
        }
        let (direction, guide_pdf) = guide.sample([(u - alpha64) / (1.0 - alpha64), v]);
        let local = self.surface.frame.to_local(direction);
        let value = self.value(direction, local);
        let bsdf_pdf = self.density(local);
        self.combine(direction, value, local, [bsdf_pdf, guide_pdf], alpha)
    }

    fn combine(
        &self,
        direction: Vec3,
        value: Vec3,
        wi: Vec3,
        [bsdf_pdf, guide_pdf]: [f32; 2],
        alpha: f32,
    ) -> Option<MixtureSample> {
        let pdf = alpha * bsdf_pdf + (1.0 - alpha) * self.guided(guide_pdf);
        if value == Vec3::ZERO || pdf <= 0.0 {
            return None;
        }
        let weight = value / pdf;
        let bsdf_share = alpha * bsdf_pdf / pdf;
        let bsdf_weight = if bsdf_pdf > 0.0 { value / bsdf_pdf } else { weight };
        Some(MixtureSample { direction, weight, bsdf_weight, value, cos: self.cos(wi), pdf, bsdf_share, delta: false })
    }

    /// Density of a direction by way of the guide, (1 − p_δ)·`pdf`; the factor 1 − α is left out.
    #[inline(always)]
    fn guided(&self, pdf: f32) -> f32 {
        if E::MATERIALS { (1.0 - self.deltas).max(0.0) * pdf } else { pdf }
    }

    #[inline(always)]
    fn sample_bsdf(&self, random: &Random, transport: Transport) -> Option<MixtureSample> {
        let (direction, sample) = self.draw(random, transport)?;
        if sample.delta {
            return self.delta(direction, &sample);
        }
        // A direction that bumps shadow is no sample; one that is black is, and is learned from.
        let hidden = self.bumps.is_some() && sample.weight == Vec3::ZERO;
        (!hidden).then(|| MixtureSample {
            direction,
            weight: sample.weight,
            bsdf_weight: sample.weight,
            value: sample.weight * sample.pdf,
            cos: self.cos(sample.wi),
            pdf: sample.pdf,
            bsdf_share: 1.0,
            delta: false,
        })
    }

    /// Sample of a delta lobe; none where its weight is zero.
    fn delta(&self, direction: Vec3, sample: &BsdfSample) -> Option<MixtureSample> {
        (sample.weight != Vec3::ZERO).then(|| MixtureSample {
            direction,
            weight: sample.weight,
            bsdf_weight: sample.weight,
            value: Vec3::ZERO,
            cos: self.cos(sample.wi),
            pdf: sample.pdf,
            bsdf_share: 1.0,
            delta: true,
        })
    }
}

/// A local direction, or its opposite.
#[inline(always)]
fn turned(w: Vec3, opposite: bool) -> Vec3 {
    if opposite { -w } else { w }
}
