//! Materials: how surfaces scatter light, and the textures that vary it.
//!
//! Everything here works in the local frame of the shading normal (+z). `wo` points to where the light goes (the camera's
//! side of a camera path), `wi` to where it comes from; both point away from the surface.
//!
//! A [`Material`] varies over a surface; [`Material::at`] reads its textures at a point and gives a [`Bsdf`], which answers all questions
//! there. Its formulas are written over [`Real`](crate::math::lanes::Real): for one point in plain numbers, and for sixteen points of
//! one [`Variant`] at once, with the same bits.

pub mod blend;
pub mod bsdf;
pub mod bump;
mod burley;
pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod fresnel;
pub mod grid;
mod grid_flight;
pub mod grid_medium;
mod majorants;
pub mod medium;
pub mod microfacet;
pub mod phase;
pub mod plastic;
pub mod principled;
pub mod principled_thin;
pub mod rough_conductor;
pub mod rough_dielectric;
pub mod rough_diffuse;
mod table;
#[cfg(test)]
mod tests;
pub mod translucent;
mod walk;

use glam::{Vec2, Vec3};

pub use crate::picture::texture;
use blend::Blend;
pub use bsdf::{Bsdf, Drawn, Plain, Scatter, Variant};
use bsdf::{Model, Null, mirrored};
use bump::Bump;
use conductor::Conductor;
use dielectric::{Dielectric, ThinDielectric, seen_from};
use diffuse::Diffuse;
use microfacet::Grain;
use plastic::Plastic;
use principled::Principled;
use principled_thin::PrincipledThin;
use rough_conductor::RoughConductor;
use rough_dielectric::RoughDielectric;
use rough_diffuse::RoughDiffuse;
use texture::Texture;
use translucent::Translucent;

use crate::math::channel_mean;
use crate::math::lanes::V3;

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

/// Where on a surface: its texture coordinates, and the angle from the x axis of the local frame to ∂p/∂u, radians, which only grains go by.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Coordinates {
    /// Texture coordinates.
    pub uv: Vec2,
    /// Angle of ∂p/∂u.
    pub angle: f32,
}

impl From<Vec2> for Coordinates {
    #[inline(always)]
    fn from(uv: Vec2) -> Self {
        Self { uv, angle: 0.0 }
    }
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
    /// Part of the roughness of facets that they have at a point, see [`Material::vary_roughness`]; none where it is 1 everywhere.
    pub roughness: Option<Box<Texture>>,
    /// Grain of facets, its angle measured from ∂p/∂u; none where they are as rough in all directions. Only of rough metal, rough glass and
    /// principled materials.
    pub grain: Option<Grain>,
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
    /// The factors at `uv`.
    fn at(&self, uv: Vec2) -> [V3<f32>; 2] {
        [self.reflectance.eval(uv).into(), self.transmittance.eval(uv).into()]
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
    /// The same for thin sheets.
    PrincipledThin(Box<PrincipledThin>),
    /// A diffuse sheet that lets light through.
    Translucent(Translucent),
    /// Two materials mixed.
    Blend(Box<Blend>),
}

impl From<Kind> for Material {
    fn from(kind: Kind) -> Self {
        Self { two_sided: false, opacity: None, bump: None, tint: None, roughness: None, grain: None, kind }
    }
}

impl Material {
    /// The material somewhere: all that its textures say there, read once.
    #[inline(always)]
    pub fn at(&self, place: impl Into<Coordinates>) -> Bsdf<'_, f32> {
        let place = place.into();
        self.plain_at(place.uv).map_or_else(|| self.any_at(place), Bsdf::from)
    }

    /// The material at `uv`, if it is of the variant [`Variant::PLAIN`].
    #[inline(always)]
    pub fn plain_at(&self, uv: Vec2) -> Option<Plain> {
        match &self.kind {
            Kind::Diffuse(m) if self.tint.is_none() => Some(Plain::new(m.reflectance.eval(uv), self.two_sided)),
            _ => None,
        }
    }

    /// What [`Material::plain_at`] says anywhere, if that is the same everywhere.
    pub fn plain(&self) -> Option<Plain> {
        let one_colour = matches!(&self.kind, Kind::Diffuse(m) if matches!(m.reflectance, Texture::Constant(_)));
        if one_colour { self.plain_at(Vec2::ZERO) } else { None }
    }

    /// Lets the roughness of facets vary: at a point they have the part of it that the texture says, in [0, 1].
    pub fn vary_roughness(&mut self, part: Texture) {
        match &mut self.kind {
            Kind::RoughConductor(_) | Kind::RoughDielectric(_) => {}
            Kind::Plastic(plastic) if plastic.is_rough() => plastic.vary_roughness(),
            // What has no facets does not vary.
            _ => return,
        }
        self.roughness = Some(Box::new(part));
    }

    #[inline(never)]
    fn any_at(&self, place: Coordinates) -> Bsdf<'_, f32> {
        let uv = place.uv;
        let grain = self.grain.map(|grain| grain.turned(place.angle));
        let part = self.roughness.as_ref().map_or(1.0, |texture| texture.value(uv).clamp(0.0, 1.0));
        let model = match &self.kind {
            Kind::Diffuse(m) => Model::Diffuse(m.at(uv)),
            Kind::RoughDiffuse(m) => Model::RoughDiffuse(m.at(uv)),
            Kind::Conductor(m) => Model::Conductor(m.at(uv)),
            Kind::RoughConductor(m) => Model::RoughConductor(m.at(uv).with(part, grain)),
            Kind::Dielectric(m) => Model::Dielectric(*m),
            Kind::ThinDielectric(m) => Model::ThinDielectric(*m),
            Kind::RoughDielectric(m) => {
                Model::RoughDielectric(RoughDielectric { facets: m.facets.scaled(part).with_grain(grain), ..*m })
            }
            Kind::Plastic(m) => Model::Plastic(m.at(uv, part)),
            Kind::Null => Model::Null(Null { one: 1.0 }),
            Kind::Principled(m) => Model::Principled(m.at(uv, grain)),
            Kind::PrincipledThin(m) => Model::PrincipledThin(m.at(uv)),
            Kind::Translucent(m) => Model::Translucent(m.at(uv)),
            Kind::Blend(m) => Model::Blend(m.at(place)),
        };
        Bsdf { two_sided: self.two_sided, tint: self.tint.as_ref().map(|tint| tint.at(uv)), model }
    }

    /// Brings near what the textures of [`Material::at`] hold at `uv`.
    pub fn prefetch(&self, uv: Vec2) {
        match &self.kind {
            Kind::Diffuse(m) => m.reflectance.prefetch(uv),
            Kind::RoughDiffuse(m) => m.prefetch(uv),
            Kind::Conductor(m) => m.metal.reflectance.prefetch(uv),
            Kind::RoughConductor(m) => m.metal.reflectance.prefetch(uv),
            Kind::Plastic(m) => m.prefetch(uv),
            Kind::Principled(m) => m.prefetch(uv),
            Kind::PrincipledThin(m) => m.prefetch(uv),
            Kind::Translucent(m) => m.prefetch(uv),
            Kind::Blend(m) => m.prefetch(uv),
            Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::RoughDielectric(_) | Kind::Null => {}
        }
        self.opacity.iter().for_each(|mask| mask.prefetch(uv));
        self.roughness.iter().for_each(|part| part.prefetch(uv));
    }

    /// What points of the material have in common with points of others: the same everywhere on it.
    pub fn variant(&self) -> Variant {
        self.at(Vec2::ZERO).variant()
    }

    /// Whether it has facets that may have a grain: what is too smooth has none.
    pub fn can_have_grain(&self) -> bool {
        matches!(self.kind, Kind::RoughConductor(_) | Kind::RoughDielectric(_) | Kind::Principled(_))
    }

    /// Whether it matters how ∂p/∂u lies.
    pub fn has_grain(&self) -> bool {
        match &self.kind {
            Kind::Blend(blend) => blend.parts.iter().any(Self::has_grain),
            _ => self.grain.is_some(),
        }
    }

    /// Whether every lobe is a delta lobe: such a surface is never connected to a light, guided, or stored in.
    pub fn is_delta(&self) -> bool {
        match &self.kind {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => true,
            Kind::Blend(blend) => blend.parts.iter().all(Self::is_delta),
            _ => false,
        }
    }

    /// Whether it is known to scatter nothing, as the surfaces of lamps often do.
    pub fn is_black(&self) -> bool {
        matches!(&self.kind, Kind::Diffuse(Diffuse { reflectance: Texture::Constant(albedo), .. }) if *albedo == Vec3::ZERO)
    }

    /// About the roughness α of the narrowest lobe that is no delta lobe, in [0, 1]; 1 where all are diffuse.
    pub fn roughness(&self) -> f32 {
        let squared = |root: &Texture| channel_mean(root.mean()).clamp(0.0, 1.0).powi(2);
        let part = self.roughness.as_ref().map_or(1.0, |texture| channel_mean(texture.mean()).clamp(0.0, 1.0));
        // Across a grain, or along it, facets are smoother than in the mean.
        let grain = self.grain.map_or(1.0, |Grain { aspect, .. }| aspect.min(aspect.recip()));
        match &self.kind {
            Kind::RoughConductor(m) => (grain * part * m.facets.alpha).min(1.0),
            Kind::RoughDielectric(m) => (grain * part * m.facets.alpha).min(1.0),
            Kind::Plastic(m) => part * m.roughness(),
            Kind::Principled(m) => grain * squared(m.root_of_roughness()),
            Kind::PrincipledThin(m) => squared(m.root_of_roughness()),
            Kind::Blend(blend) => blend.parts.iter().map(Self::roughness).fold(1.0, f32::min),
            Kind::Diffuse(_) | Kind::RoughDiffuse(_) | Kind::Translucent(_) => 1.0,
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Null => 1.0,
        }
    }

    /// [`Bsdf::eta`], which no texture changes.
    pub fn eta(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z * wi.z >= 0.0 {
            return 1.0;
        }
        let wo = if self.two_sided && wo.z < 0.0 { -wo } else { wo };
        match &self.kind {
            Kind::Dielectric(m) => seen_from(wo.into(), m.eta),
            Kind::RoughDielectric(m) => seen_from(wo.into(), m.eta),
            Kind::Principled(m) => seen_from(wo.into(), m.eta()),
            Kind::Blend(m) => m.eta(wo),
            Kind::Diffuse(_) | Kind::Conductor(_) | Kind::RoughConductor(_) | Kind::ThinDielectric(_) => 1.0,
            Kind::RoughDiffuse(_) | Kind::Plastic(_) | Kind::PrincipledThin(_) | Kind::Translucent(_) | Kind::Null => {
                1.0
            }
        }
    }

    /// [`Bsdf::eval`] somewhere.
    pub fn eval(&self, place: impl Into<Coordinates>, wo: Vec3, wi: Vec3) -> Vec3 {
        self.at(place).eval(wo.into(), wi.into()).into()
    }

    /// [`Bsdf::pdf`] somewhere.
    pub fn pdf(&self, place: impl Into<Coordinates>, wo: Vec3, wi: Vec3) -> f32 {
        self.at(place).pdf(wo.into(), wi.into())
    }

    /// [`Bsdf::eval_and_pdf`] somewhere.
    pub fn eval_and_pdf(&self, place: impl Into<Coordinates>, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (value, pdf) = self.at(place).eval_and_pdf(wo.into(), wi.into());
        (value.into(), pdf)
    }

    /// [`Bsdf::sample`] somewhere; none where the surface absorbs.
    pub fn sample(
        &self,
        place: impl Into<Coordinates>,
        wo: Vec3,
        lobe: f32,
        u: [f32; 2],
        transport: Transport,
    ) -> Option<BsdfSample> {
        self.at(place).sample(wo.into(), lobe, u, transport).into()
    }

    /// [`Bsdf::delta_probability`] somewhere.
    pub fn delta_probability(&self, place: impl Into<Coordinates>, wo: Vec3) -> f32 {
        self.at(place).delta_probability(wo.into())
    }

    /// [`Bsdf::albedo`] somewhere.
    pub fn albedo(&self, place: impl Into<Coordinates>) -> Vec3 {
        self.at(place).albedo().into()
    }
}
