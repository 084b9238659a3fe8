//! Facets with a grain (KHR_materials_anisotropy).

use ::gltf::json::material::Material;
use ::gltf::json::texture::Info;
use serde::Deserialize;

use crate::base::Result;
use crate::materials::microfacet::SMOOTH;
use crate::materials::texture::Texture;
use crate::math::channel_mean;
use crate::scene::file::{ASPECTS, MaterialFile, PrincipledFile, TextureFile};

use super::slots::Slots;

const NAME: &str = "KHR_materials_anisotropy";

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct Anisotropy {
    anisotropy_strength: f32,
    anisotropy_rotation: f32,
    anisotropy_texture: Option<Info>,
}

/// Whether `material` asks for a grain, which goes by the texture coordinates.
pub fn is_asked(material: &Material) -> bool {
    let given = material.extensions.as_ref().and_then(|all| all.others.get(NAME));
    given.and_then(|grain| grain.get("anisotropyStrength")?.as_f64()).is_some_and(|strength| strength > 0.0)
}

/// Warns where a grain is left out.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for values of other types.
pub fn leave_out(slots: &mut Slots, material: &Material) -> Result<()> {
    if slots.extension::<Anisotropy>(material, NAME)?.is_some_and(|g| g.anisotropy_strength > 0.0) {
        slots.warn("the grain of what lets light through is left out");
    }
    Ok(())
}

/// The principled material, with a grain if `material` has one: of a strength s, facets of the roughness α across it have α + (1 − α)·s² along it.
///
/// # Errors
/// Those of [`Textures`](super::textures::Textures), and [`Error::Malformed`](crate::base::Error::Malformed) for values of other types.
pub fn brushed(slots: &mut Slots, material: &Material, mut given: PrincipledFile) -> Result<MaterialFile> {
    let Some(grain) = slots.extension::<Anisotropy>(material, NAME)? else {
        return Ok(MaterialFile::Principled(given));
    };
    let strength = slots.share(grain.anisotropy_strength, "anisotropyStrength");
    if grain.anisotropy_texture.is_some() && strength > 0.0 {
        slots.warn("the directions of anisotropyTexture are left out");
    }
    let strength = slots.number(grain.anisotropy_texture.as_ref(), 2, strength, "anisotropy")?;
    let root = channel_mean(Texture::new(&given.roughness, slots.textures.pictures.made())?.mean()).clamp(0.0, 1.0);
    let across = (root * root).max(SMOOTH);
    let along = across + (1.0 - across) * strength * strength;
    let aspect = (along / across).sqrt().min(ASPECTS[1]);
    if aspect == 1.0 {
        return Ok(MaterialFile::Principled(given));
    }
    // The geometric mean of both, whose root is given.
    let rougher = aspect.sqrt();
    match &mut given.roughness {
        TextureFile::Rgb { value } => *value = [(across.sqrt() * rougher).min(1.0); 3],
        TextureFile::Bitmap { scale, .. } => {
            slots.warn("the grain goes by the mean of the roughness");
            *scale *= rougher;
        }
        TextureFile::Checkerboard { .. } | TextureFile::Attribute { .. } => {}
    }
    // Where a picture is mirrored, what turns left on it turns right on the surface.
    let rotation =
        (grain.anisotropy_rotation % std::f32::consts::TAU).to_degrees() * if slots.mirrored { -1.0 } else { 1.0 };
    Ok(MaterialFile::Anisotropic { aspect, rotation, material: Box::new(MaterialFile::Principled(given)) })
}
