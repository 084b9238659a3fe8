//! Lobes that extensions add: another reflectance (KHR_materials_ior, _specular), a coat (_clearcoat), cloth (_sheen).

use ::gltf::json::material::Material;
use ::gltf::json::texture::Info;
use glam::Vec3;
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::base::Result;
use crate::scene::readers::conductors::{index_of, reflectance_of};

use super::pictures::Use;
use super::slots::Slots;
use super::textures::Reference;

/// Refractive index where nothing is said.
const USUAL_INDEX: f32 = 1.5;
/// Largest reflectance of a dielectric at normal incidence: its index would grow without bound otherwise.
const MOST_REFLECTANCE: f32 = 0.9;
/// Roughnesses of a satin and of a glossy coat (Burley 2012, §5.6).
const COATS: [f32; 2] = [0.1, 0.001];

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_texture: Option<Info>,
    clearcoat_roughness_factor: f32,
    clearcoat_roughness_texture: Option<Info>,
    clearcoat_normal_texture: Option<IgnoredAny>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct Sheen {
    sheen_color_factor: [f32; 3],
    sheen_color_texture: Option<Info>,
}

/// Parameters of a principled material beside those of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobes {
    /// Refractive index of the dielectric's reflection.
    pub eta: f32,
    /// Strength of the coat.
    pub clearcoat: f32,
    /// Its gloss.
    pub clearcoat_gloss: f32,
    /// Strength of the sheen.
    pub sheen: f32,
}

/// The refractive index of a material.
pub fn index(slots: &mut Slots, material: &Material) -> f32 {
    let given = material.extensions.as_ref().and_then(|all| all.ior.as_ref()).map(|ior| ior.ior.0);
    match given {
        Some(index) if index >= 1.0 => index,
        Some(index) => {
            slots.warn(format_args!("ior is {index}: {USUAL_INDEX} is used"));
            USUAL_INDEX
        }
        None => USUAL_INDEX,
    }
}

/// The lobes of `material`; `reflectance` at normal incidence overrides its index.
///
/// # Errors
/// Those of [`Textures`](super::textures::Textures), and
/// [`Error::Malformed`](crate::base::Error::Malformed) for values of other types.
pub fn lobes(slots: &mut Slots, material: &Material, reflectance: Option<f32>) -> Result<Lobes> {
    let eta = index(slots, material);
    let factor = specular(slots, material)?;
    let eta = match (reflectance, factor) {
        (None, None) => eta,
        (given, factor) => {
            let reflected = given.unwrap_or(reflectance_of(eta)) * factor.unwrap_or(1.0);
            index_of(reflected.clamp(0.0, MOST_REFLECTANCE))
        }
    };
    let (clearcoat, clearcoat_gloss) = coat(slots, material)?;
    Ok(Lobes { eta, clearcoat, clearcoat_gloss, sheen: sheen(slots, material)? })
}

/// Factor on the dielectric's reflectance; none where nothing is said.
fn specular(slots: &mut Slots, material: &Material) -> Result<Option<f32>> {
    let Some(given) = material.extensions.as_ref().and_then(|all| all.specular.clone()) else { return Ok(None) };
    let strength = slots.share(given.specular_factor.0, "specularFactor");
    let strength = slots.number(given.specular_texture.as_ref(), 3, strength, "specular")?;
    let mut color = Vec3::from_array(given.specular_color_factor.0).max(Vec3::ZERO);
    if let Some(reference) = given.specular_color_texture.as_ref().map(Reference::of) {
        color *= slots.textures.mean(&reference, Use::Color([1.0; 3]), "specularColor", slots.part)?;
    }
    if color != Vec3::splat(color.x) {
        slots.warn("specularColor: the mean of its channels is used");
    }
    Ok(Some(strength * color.element_sum() / 3.0).filter(|&factor| factor != 1.0))
}

/// Strength and gloss of the coat.
fn coat(slots: &mut Slots, material: &Material) -> Result<(f32, f32)> {
    let Some(given) = slots.extension::<Clearcoat>(material, "KHR_materials_clearcoat")? else { return Ok((0.0, 0.0)) };
    let strength = slots.share(given.clearcoat_factor, "clearcoatFactor");
    let strength = slots.number(given.clearcoat_texture.as_ref(), 0, strength, "clearcoat")?;
    if strength == 0.0 {
        return Ok((0.0, 0.0));
    }
    let rough = slots.share(given.clearcoat_roughness_factor, "clearcoatRoughnessFactor");
    let rough = slots.number(given.clearcoat_roughness_texture.as_ref(), 1, rough, "clearcoatRoughness")?;
    if given.clearcoat_normal_texture.is_some() {
        slots.warn("clearcoatNormalTexture is left out: the coat has the surface's own normal");
    }
    slots.warn("the clear coat is that of the principled material: of a quarter of the strength at most, with wider highlights");
    let [satin, glossy] = COATS;
    Ok(((4.0 * strength).min(1.0), ((satin - rough * rough) / (satin - glossy)).clamp(0.0, 1.0)))
}

fn sheen(slots: &mut Slots, material: &Material) -> Result<f32> {
    let Some(given) = slots.extension::<Sheen>(material, "KHR_materials_sheen")? else { return Ok(0.0) };
    let mut color = Vec3::from_array(given.sheen_color_factor).clamp(Vec3::ZERO, Vec3::ONE);
    if let Some(reference) = given.sheen_color_texture.as_ref().map(Reference::of).filter(|_| color != Vec3::ZERO) {
        color *= slots.textures.mean(&reference, Use::Color([1.0; 3]), "sheenColor", slots.part)?;
    }
    if color != Vec3::ZERO {
        slots.warn(
            "the sheen is that of the principled material, white and as strong as the mean of sheenColor's channels",
        );
    }
    Ok(color.element_sum() / 3.0)
}
