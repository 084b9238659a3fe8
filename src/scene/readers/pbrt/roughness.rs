//! Roughness, refractive indices and metals.

use glam::Vec3;

use crate::base::Result;
use crate::materials::microfacet;
use crate::materials::texture::luminance;
use crate::scene::file::{Distribution, MaterialFile, TextureFile};
use crate::scene::readers::conductors::conductor;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::parameters::Parameters;
use super::textures::Values;

/// Facets with less roughness are smooth in pbrt.
const SMOOTH: f32 = 1e-3;
/// Largest reflectance at normal incidence that a metal may be made of: its index would grow without bound otherwise.
const MOST_REFLECTED: f32 = 0.9999;

/// Names of the parameters of a plain roughness.
pub const ROUGHNESS: [&str; 3] = ["roughness", "uroughness", "vroughness"];
/// Warning where facets cannot have a grain.
const EVEN: &str = "anisotropic roughness: the geometric mean of both directions is used";

/// A metal, by its index and a factor on its reflection.
pub struct Metal {
    /// Real part of the refractive index.
    pub eta: [f32; 3],
    /// Extinction coefficient.
    pub k: [f32; 3],
    /// Factor on the reflection.
    pub tint: TextureFile,
}

impl Metal {
    /// The metal's surface with this roughness.
    pub fn surface(self, alpha: f32) -> MaterialFile {
        let Self { eta, k, tint: specular_reflectance } = self;
        if alpha == 0.0 {
            return MaterialFile::Conductor { eta, k, specular_reflectance };
        }
        MaterialFile::RoughConductor { alpha, distribution: Distribution::Ggx, eta, k, specular_reflectance }
    }

    /// One that reflects `tint` of everything.
    pub fn mirror(tint: TextureFile) -> Self {
        Self { eta: [0.0; 3], k: [1.0; 3], tint }
    }
}

/// The roughness of GGX facets.
#[derive(Debug, Clone, PartialEq)]
struct Roughness {
    /// Root mean square slope; 0 is smooth.
    alpha: f32,
    /// The same along ∂p/∂u and across it, where they differ; `alpha` is the geometric mean of both then.
    axes: Option<[f32; 2]>,
    /// Factor on it, where it varies.
    factor: Option<TextureFile>,
}

impl Reader {
    /// Roughness of GGX facets from the parameters for both directions at once, for u and for v. It varies where it is a texture for both.
    fn roughness(&mut self, parameters: &Parameters, default: f32) -> Result<Roughness> {
        let [both, u, v] = ROUGHNESS;
        let is_even = !parameters.has(u) && !parameters.has(v);
        match self.texture(parameters, both, Values::Floats)? {
            Some(texture) if is_even && !matches!(texture, TextureFile::Rgb { .. }) => {
                let alpha = self.to_alpha(parameters)?;
                let place = &parameters.place;
                let factor = self.changed(texture, "as roughness", place, |roughness| {
                    Vec3::splat(alpha(luminance(roughness).max(0.0)).clamp(0.0, 1.0))
                })?;
                Ok(Roughness { alpha: 1.0, axes: None, factor: Some(factor) })
            }
            _ => {
                let [u, v] = self.both_roughnesses(parameters, ROUGHNESS, default)?;
                Ok(Roughness { alpha: mean(u, v), axes: (u != v).then_some([u, v]), factor: None })
            }
        }
    }

    /// What roughness is as the root mean square slope of facets.
    fn to_alpha(&self, parameters: &Parameters) -> Result<fn(f32) -> f32> {
        let remapped = parameters.boolean("remaproughness")?.unwrap_or(true);
        Ok(match (remapped, self.old) {
            (false, _) => |roughness| roughness,
            (true, false) => f32::sqrt,
            (true, true) => old_alpha,
        })
    }

    /// What `make` makes of the roughness, with facets of it.
    pub(super) fn faceted(
        &mut self,
        parameters: &Parameters,
        default: f32,
        make: impl FnOnce(f32) -> MaterialFile,
    ) -> Result<MaterialFile> {
        let Roughness { alpha, axes, factor } = self.roughness(parameters, default)?;
        let material = make(alpha).roughened(factor);
        if axes.is_some() && !material.can_have_grain() {
            self.warn(&parameters.place, EVEN);
        }
        Ok(material.with_grain(axes))
    }

    /// The same as one number: of a texture the mean.
    pub(super) fn even_roughness(
        &mut self,
        parameters: &Parameters,
        names: [&'static str; 3],
        default: f32,
    ) -> Result<f32> {
        let [u, v] = self.both_roughnesses(parameters, names, default)?;
        if u != v {
            self.warn(&parameters.place, EVEN);
        }
        Ok(mean(u, v))
    }

    /// Roughness along u and along v; of textures the means.
    fn both_roughnesses(
        &mut self,
        parameters: &Parameters,
        [both, u, v]: [&'static str; 3],
        default: f32,
    ) -> Result<[f32; 2]> {
        let both = self.number(parameters, both)?.unwrap_or(default);
        let (u, v) = (self.number(parameters, u)?.unwrap_or(both), self.number(parameters, v)?.unwrap_or(both));
        if u.min(v) < 0.0 {
            return Err(parameters.malformed(format!("the roughness is {}, expected at least 0", u.min(v))));
        }
        Ok([u, v].map(self.to_alpha(parameters)?))
    }

    /// A refractive index; of a spectrum the luminance.
    pub(super) fn index(&mut self, parameters: &Parameters, names: [&'static str; 2], default: f32) -> Result<f32> {
        for name in names {
            if let Some(texture) = self.texture(parameters, name, Values::Colors)? {
                let index = luminance(self.mean(&texture, &parameters.place, name)?.into());
                return Ok(if index > 0.0 { index } else { default });
            }
        }
        Ok(default)
    }

    /// A metal from its index, or from its reflectance at normal incidence; copper without either.
    pub(super) fn metal(&mut self, parameters: &Parameters, names: [&'static str; 3]) -> Result<Metal> {
        let [eta, k, reflectance] = names;
        let white = TextureFile::rgb([1.0; 3]);
        match self.given_albedo(parameters, reflectance)? {
            // F = k²/(k² + 4) for eta = 1.
            Some(TextureFile::Rgb { value }) => {
                let k = value.map(|r| {
                    let r = r.clamp(0.0, MOST_REFLECTED);
                    2.0 * (r / (1.0 - r)).sqrt()
                });
                Ok(Metal { eta: [1.0; 3], k, tint: white })
            }
            Some(texture) => Ok(Metal::mirror(texture)),
            None => {
                let (copper_eta, copper_k) = conductor("Cu").unwrap_or(([1.0; 3], [3.0; 3]));
                let eta = self.index_color(parameters, eta, copper_eta)?;
                Ok(Metal { eta, k: self.index_color(parameters, k, copper_k)?, tint: white })
            }
        }
    }

    fn index_color(&mut self, parameters: &Parameters, name: &'static str, default: [f32; 3]) -> Result<[f32; 3]> {
        let Some(parameter) = parameters.find(name) else { return Ok(default) };
        if parameter.kind != "texture" {
            return self.palette(parameters).color(parameter, Use::Index);
        }
        let texture = self.texture(parameters, name, Values::Colors)?.unwrap_or(TextureFile::rgb(default));
        self.mean(&texture, &parameters.place, name)
    }
}

/// The geometric mean; 0 where facets are smooth in both directions.
fn mean(u: f32, v: f32) -> f32 {
    match u.max(v) {
        alpha if alpha < SMOOTH => 0.0,
        alpha if u == v => alpha,
        _ => (u.max(microfacet::SMOOTH) * v.max(microfacet::SMOOTH)).sqrt(),
    }
}

/// Roughness of facets in pbrt-v3 (Pharr, Jakob, Humphreys 2016, §8.4.2).
pub fn old_alpha(roughness: f32) -> f32 {
    let x = roughness.max(1e-3).ln();
    1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)))
}
