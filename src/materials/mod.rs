//! Materials: how surfaces scatter light, and the textures that vary it.
//!
//! Everything here works in the local frame of the shading normal (+z). `wo` points to where the light goes (the camera's
//! side of a camera path), `wi` to where it comes from; both point away from the surface.

pub mod blend;
pub mod bump;
pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod fresnel;
pub mod medium;
pub mod microfacet;
pub mod phase;
pub mod plastic;
pub mod principled;
pub mod rough_conductor;
pub mod rough_dielectric;
pub mod rough_diffuse;
pub mod texture;

use glam::{Vec2, Vec3};

use blend::Blend;
use bump::Bump;
use conductor::Conductor;
use dielectric::{Dielectric, ThinDielectric};
use diffuse::Diffuse;
use plastic::Plastic;
use principled::Principled;
use rough_conductor::RoughConductor;
use rough_dielectric::RoughDielectric;
use rough_diffuse::RoughDiffuse;
use texture::Texture;

/// The quantity that a path carries: radiance from the lights to the camera, or importance the other way (photons). Refraction
/// scales only radiance (Veach 1997, §5.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    /// The path starts at the camera.
    Radiance,
    /// The path starts at a light.
    Importance,
}

/// A sampled direction.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// The direction.
    pub wi: Vec3,
    /// f·|cos θ| / pdf; for a delta lobe the factor on the radiance.
    pub weight: Vec3,
    /// Density w.r.t. solid angle; for a delta lobe the probability of the lobe.
    pub pdf: f32,
    /// Whether `wi` came from a delta lobe.
    pub delta: bool,
}

/// A surface material.
#[derive(Debug, Clone)]
pub struct Material {
    /// Whether the back scatters like the front.
    pub two_sided: bool,
    /// Opacity: the probability that a ray meets the surface; none where it is 1 everywhere.
    pub opacity: Option<Texture>,
    /// Bump or normal map; the code that finds a surface applies it to the shading normal.
    pub bump: Option<Box<Bump>>,
    /// Factors on scattered light; none where both are 1.
    pub tint: Option<Box<Tint>>,
    /// The scattering model.
    pub kind: Kind,
}

/// Factors on scattered light.
#[derive(Debug, Clone)]
pub struct Tint {
    /// Factor on reflected light.
    pub reflectance: Texture,
    /// Factor on transmitted light.
    pub transmittance: Texture,
}

impl Tint {
    fn factor(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        if wo.z * wi.z > 0.0 { self.reflectance.eval(uv) } else { self.transmittance.eval(uv) }
    }
}

/// The scattering model of a material.
#[derive(Debug, Clone)]
pub enum Kind {
    /// Lambertian.
    Diffuse(Diffuse),
    /// Diffuse facets.
    RoughDiffuse(Box<RoughDiffuse>),
    /// Smooth metal.
    Conductor(Conductor),
    /// Rough metal.
    RoughConductor(RoughConductor),
    /// Smooth glass.
    Dielectric(Dielectric),
    /// A thin pane.
    ThinDielectric(ThinDielectric),
    /// Rough glass.
    RoughDielectric(RoughDielectric),
    /// A coated diffuse surface.
    Plastic(Plastic),
    /// The border of a medium, which light passes as if it were not there.
    Null,
    /// Burley's mixture of lobes.
    Principled(Box<Principled>),
    /// Two materials mixed.
    Blend(Box<Blend>),
}

impl From<Kind> for Material {
    fn from(kind: Kind) -> Self {
        Self { two_sided: false, opacity: None, bump: None, tint: None, kind }
    }
}

impl Material {
    /// Whether every lobe is a delta lobe: such a surface is never connected to a light, guided, or stored in.
    pub fn is_delta(&self) -> bool {
        match &self.kind {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => true,
            Kind::Blend(blend) => blend.parts.iter().all(Self::is_delta),
            _ => false,
        }
    }

    /// Probability with which [`Material::sample`] chooses a delta lobe.
    pub fn delta_probability(&self, uv: Vec2, wo: Vec3) -> f32 {
        let (wo, _) = self.to_front(wo, wo);
        match &self.kind {
            Kind::Conductor(_) if wo.z <= 0.0 => 0.0,
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => 1.0,
            Kind::Plastic(m) => m.delta_probability(wo),
            Kind::Blend(m) => m.delta_probability(uv, wo),
            Kind::Diffuse(_)
            | Kind::RoughDiffuse(_)
            | Kind::RoughConductor(_)
            | Kind::RoughDielectric(_)
            | Kind::Principled(_) => 0.0,
        }
    }

    /// Refractive index on the side of `wi` over that on the side of `wo`: radiance that is refracted is divided by its square
    /// (Veach 1997, §5.2). 1 where both are on one side, and where transmitted light is not refracted.
    pub fn eta(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z * wi.z >= 0.0 {
            return 1.0;
        }
        let (wo, _) = self.to_front(wo, wi);
        let behind = match &self.kind {
            Kind::Dielectric(m) => m.eta,
            Kind::RoughDielectric(m) => m.eta,
            Kind::Principled(m) => m.eta(),
            // Of two parts that refract, the first decides.
            Kind::Blend(m) => {
                return m.parts.iter().map(|part| part.eta(wo, -wo)).find(|&eta| eta != 1.0).unwrap_or(1.0);
            }
            Kind::Diffuse(_) | Kind::Conductor(_) | Kind::RoughConductor(_) | Kind::ThinDielectric(_) => 1.0,
            Kind::RoughDiffuse(_) | Kind::Plastic(_) | Kind::Null => 1.0,
        };
        if wo.z > 0.0 { behind } else { 1.0 / behind }
    }

    /// f(wo, wi)·|cos θᵢ| of the lobes that are not delta, sr⁻¹.
    pub fn eval(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> Vec3 {
        let (wo, wi) = self.to_front(wo, wi);
        let value = match &self.kind {
            Kind::Diffuse(m) => m.eval(uv, wo, wi),
            Kind::RoughDiffuse(m) => m.eval(uv, wo, wi),
            Kind::RoughConductor(m) => m.eval(uv, wo, wi),
            Kind::RoughDielectric(m) => Vec3::splat(m.eval(wo, wi)),
            Kind::Plastic(m) => m.eval(uv, wo, wi),
            Kind::Principled(m) => m.eval(uv, wo, wi),
            Kind::Blend(m) => m.eval(uv, wo, wi),
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => Vec3::ZERO,
        };
        self.tint.as_ref().map_or(value, |tint| value * tint.factor(uv, wo, wi))
    }

    /// Density of [`Material::sample`] over the lobes that are not delta, w.r.t. solid angle.
    pub fn pdf(&self, uv: Vec2, wo: Vec3, wi: Vec3) -> f32 {
        let (wo, wi) = self.to_front(wo, wi);
        match &self.kind {
            Kind::Diffuse(_) => Diffuse::pdf(wo, wi),
            Kind::RoughDiffuse(_) => RoughDiffuse::pdf(wo, wi),
            Kind::RoughConductor(m) => m.pdf(wo, wi),
            Kind::RoughDielectric(m) => m.pdf(wo, wi),
            Kind::Plastic(m) => m.pdf(wo, wi),
            Kind::Principled(m) => m.pdf(uv, wo, wi),
            Kind::Blend(m) => m.pdf(uv, wo, wi),
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => 0.0,
        }
    }

    /// Whether [`Material::sample`] reads the number that chooses a lobe: of most materials the other two say everything.
    #[inline]
    pub fn chooses_lobe(&self) -> bool {
        matches!(self.kind, Kind::RoughDielectric(_) | Kind::Principled(_) | Kind::Blend(_))
    }

    /// Samples `wi` by numbers in [0, 1), the first for the lobe where there are several, the others for its direction; none where the
    /// surface absorbs.
    pub fn sample(&self, uv: Vec2, wo: Vec3, lobe: f32, u: [f32; 2], transport: Transport) -> Option<BsdfSample> {
        let flip = self.two_sided && wo.z < 0.0;
        let wo = if flip { -wo } else { wo };
        let mut sample = match &self.kind {
            Kind::Diffuse(m) => m.sample(uv, wo, u),
            Kind::RoughDiffuse(m) => m.sample(uv, wo, u),
            Kind::RoughConductor(m) => m.sample(uv, wo, u),
            Kind::Conductor(m) => m.sample(uv, wo),
            Kind::Dielectric(m) => m.sample(wo, u[0], transport),
            Kind::ThinDielectric(m) => m.sample(wo, u[0]),
            Kind::RoughDielectric(m) => m.sample(wo, u, lobe, transport),
            Kind::Plastic(m) => m.sample(uv, wo, u),
            Kind::Null => Some(BsdfSample { wi: -wo, weight: Vec3::ONE, pdf: 1.0, delta: true }),
            Kind::Principled(m) => m.sample(uv, wo, u, lobe, transport),
            Kind::Blend(m) => m.sample(uv, wo, lobe, u, transport),
        }?;
        if let Some(tint) = &self.tint {
            sample.weight *= tint.factor(uv, wo, sample.wi);
        }
        Some(if flip { BsdfSample { wi: -sample.wi, ..sample } } else { sample })
    }

    /// Reflectance for pictures of the albedo.
    pub fn albedo(&self, uv: Vec2) -> Vec3 {
        match &self.kind {
            Kind::Diffuse(m) => m.reflectance.eval(uv),
            Kind::RoughDiffuse(m) => m.albedo(uv),
            Kind::Conductor(m) => m.metal.albedo(uv),
            Kind::RoughConductor(m) => m.metal.albedo(uv),
            Kind::Plastic(m) => m.albedo(uv),
            Kind::Principled(m) => m.albedo(uv),
            Kind::Blend(m) => m.albedo(uv),
            Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::RoughDielectric(_) | Kind::Null => Vec3::ONE,
        }
    }

    fn to_front(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
        if self.two_sided && wo.z < 0.0 { (-wo, -wi) } else { (wo, wi) }
    }
}
