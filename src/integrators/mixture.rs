//! One-sample multiple importance sampling of BSDF and guide (Müller 2017 §3.3; Zhu 2021 eq. 5):
//! p = α·p_bsdf + (1 − α)·p_guide.

use glam::Vec3;

use crate::base::random::Random;
use crate::geometry::Surface;
use crate::guiding::field::{DirectionGuide, VoxelGuide};
use crate::materials::bump::Shadowing;
use crate::materials::{BsdfSample, Material, Transport};

/// How directions are sampled at one vertex.
pub struct Mixture<'a> {
    surface: &'a Surface,
    material: &'a Material,
    wo: Vec3,
    guide: Option<DirectionGuide<'a>>,
    /// What bumps hide; none where there are none.
    bumps: Option<Shadowing>,
}

/// A direction drawn from a [`Mixture`].
#[derive(Debug, Clone, Copy)]
pub struct MixtureSample {
    /// Unit direction in the world.
    pub direction: Vec3,
    /// f·|cos θ| / p.
    pub weight: Vec3,
    /// f·|cos θ| / p_bsdf: what the surface reflects, whoever proposed the direction.
    pub bsdf_weight: Vec3,
    /// f·|cos θ|; zero for a delta lobe, where it has no finite value.
    pub value: Vec3,
    /// |cos θ| to the shading normal.
    pub cos: f32,
    /// Density p of the mixture w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: f32,
    /// Part of p that is the BSDF's.
    pub bsdf_share: f32,
    /// Whether the direction came from a delta lobe.
    pub delta: bool,
}

impl<'a> Mixture<'a> {
    /// The mixture at `surface` for light that leaves in the world direction `out`; `guide` is none for a delta material.
    pub fn new(surface: &'a Surface, material: &'a Material, out: Vec3, guide: Option<&'a VoxelGuide>) -> Self {
        let guide = guide.and_then(|guide| guide.directions(surface.point));
        let turned = material.bump.is_some() && surface.smooth != surface.frame.n;
        let bumps = turned.then(|| Shadowing::new(surface.smooth, surface.frame.n));
        Self { surface, material, wo: surface.frame.to_local(out), guide, bumps }
    }

    /// The part of the light from the world direction `wi`, in local coordinates `local`, that bumps do not hide.
    fn unhidden(&self, wi: Vec3, local: Vec3) -> f32 {
        self.bumps.map_or(1.0, |bumps| bumps.factor(wi, local.z))
    }

    /// f·|cos θ| towards the world direction `wi`, in local coordinates `local`.
    fn scattered(&self, wi: Vec3, local: Vec3) -> Vec3 {
        self.material.eval(self.surface.uv, self.wo, local) * self.unhidden(wi, local)
    }

    /// f·|cos θ| towards the world direction `wi`.
    pub fn eval(&self, wi: Vec3) -> Vec3 {
        self.scattered(wi, self.surface.frame.to_local(wi))
    }

    /// The density with which [`Mixture::sample`] chooses the world direction `wi`, and the part of it that is the BSDF's.
    pub fn pdf(&self, wi: Vec3) -> (f32, f32) {
        let pdf = self.material.pdf(self.surface.uv, self.wo, self.surface.frame.to_local(wi));
        let Some(guide) = self.guide else { return (pdf, 1.0) };
        let bsdf = guide.bsdf_fraction * pdf;
        let both = bsdf + (1.0 - guide.bsdf_fraction) * guide.pdf(wi);
        (both, if both > 0.0 { bsdf / both } else { 1.0 })
    }

    /// Draws a direction; none where the surface absorbs.
    pub fn sample(&self, random: &mut Random, transport: Transport) -> Option<MixtureSample> {
        let Some(guide) = self.guide else { return self.sample_bsdf(random, transport) };
        let alpha = guide.bsdf_fraction;
        if random.next_f32() < alpha {
            let (direction, sample) = self.sample_material(random, transport)?;
            if sample.delta {
                // No guide ever chooses a delta lobe's direction.
                return Some(self.delta(&sample, alpha));
            }
            let pdfs = [sample.pdf, guide.pdf(direction)];
            return self.combine(direction, sample.weight * sample.pdf, sample.wi.z, pdfs, alpha);
        }
        let (direction, guide_pdf) = guide.sample(random);
        let local = self.surface.frame.to_local(direction);
        let value = self.scattered(direction, local);
        let bsdf_pdf = self.material.pdf(self.surface.uv, self.wo, local);
        self.combine(direction, value, local.z, [bsdf_pdf, guide_pdf], alpha)
    }

    /// A direction of the material in the world, less what bumps hide.
    fn sample_material(&self, random: &mut Random, transport: Transport) -> Option<(Vec3, BsdfSample)> {
        let sample = self.material.sample(self.surface.uv, self.wo, random, transport)?;
        let direction = self.surface.frame.to_world(sample.wi);
        let unhidden = self.unhidden(direction, sample.wi);
        (unhidden > 0.0).then(|| (direction, BsdfSample { weight: sample.weight * unhidden, ..sample }))
    }

    fn combine(
        &self,
        direction: Vec3,
        value: Vec3,
        z: f32,
        [bsdf_pdf, guide_pdf]: [f32; 2],
        alpha: f32,
    ) -> Option<MixtureSample> {
        let pdf = alpha * bsdf_pdf + (1.0 - alpha) * guide_pdf;
        if value == Vec3::ZERO {
            return None;
        }
        let weight = value / pdf;
        let bsdf_share = alpha * bsdf_pdf / pdf;
        let bsdf_weight = if bsdf_pdf > 0.0 { value / bsdf_pdf } else { weight };
        Some(MixtureSample { direction, weight, bsdf_weight, value, cos: z.abs(), pdf, bsdf_share, delta: false })
    }

    fn sample_bsdf(&self, random: &mut Random, transport: Transport) -> Option<MixtureSample> {
        let (direction, sample) = self.sample_material(random, transport)?;
        if sample.delta {
            return Some(self.delta(&sample, 1.0));
        }
        Some(MixtureSample {
            direction,
            weight: sample.weight,
            bsdf_weight: sample.weight,
            value: sample.weight * sample.pdf,
            cos: sample.wi.z.abs(),
            pdf: sample.pdf,
            bsdf_share: 1.0,
            delta: false,
        })
    }

    /// A delta lobe's direction, the BSDF having been sampled with probability `alpha`.
    fn delta(&self, sample: &BsdfSample, alpha: f32) -> MixtureSample {
        MixtureSample {
            direction: self.surface.frame.to_world(sample.wi),
            weight: sample.weight / alpha,
            bsdf_weight: sample.weight,
            value: Vec3::ZERO,
            cos: sample.wi.z.abs(),
            pdf: sample.pdf * alpha,
            bsdf_share: 1.0,
            delta: true,
        }
    }
}
