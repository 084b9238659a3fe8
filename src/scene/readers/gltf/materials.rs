//! Materials (specification, §3.9): the principled material, with holes, normal maps and light.

use ::gltf::json::material::{AlphaMode, Material};
use ::gltf::json::validation::Checked;
use glam::{Vec2, Vec3};

use crate::base::Result;
use crate::materials::texture::Texture;
use crate::scene::file::{MaterialFile, MediumFile, PrincipledFile, TextureFile};

use super::base::{Base, Paint};
use super::glass::glass;
use super::grain;
use super::lobes::lobes;
use super::pictures::Use;
use super::slots::Slots;
use super::textures::Reference;

/// Light that a material emits.
#[derive(Debug, Clone, PartialEq)]
pub struct Emission {
    /// Radiance, where the texture is white.
    pub radiance: Vec3,
    /// Factor on it.
    pub texture: Option<TextureFile>,
}

/// A translated material.
#[derive(Debug, Clone)]
pub struct Surface {
    /// How it scatters.
    pub material: MaterialFile,
    /// What is behind it.
    pub medium: Option<MediumFile>,
    /// What it emits.
    pub emission: Option<Emission>,
}

/// Translates `material` for vertices of these colours.
///
/// # Errors
/// Those of [`Textures`](super::textures::Textures); [`Error::Malformed`](crate::base::Error::Malformed) for extensions with values of
/// other types.
pub fn surface(slots: &mut Slots, material: &Material, paint: &Paint) -> Result<Surface> {
    let base = Base::of(slots, material, paint)?;
    let opacity = opacity(slots, material, &base)?;
    let emission = emission(slots, material)?;
    let (scattering, medium) = scattering(slots, material, base)?;
    let material = match opacity {
        Some(opacity) => MaterialFile::Mask { opacity, material: Box::new(scattering) },
        None => scattering,
    };
    Ok(Surface { material, medium, emission })
}

/// All but the holes. What lets no light through has two sides even where `doubleSided` does not say so: it would be black from
/// behind, where other renderers either show both sides or none.
fn scattering(slots: &mut Slots, material: &Material, base: Base) -> Result<(MaterialFile, Option<MediumFile>)> {
    let two_sided = |material| MaterialFile::TwoSided { material: Box::new(material) };
    if material.extensions.as_ref().is_some_and(|all| all.unlit.is_some()) {
        slots.warn("unlit: it is lit as a diffuse material");
        return Ok((two_sided(MaterialFile::Diffuse { reflectance: base.color }), None));
    }
    let lobes = lobes(slots, material, base.reflectance)?;
    let opaque = PrincipledFile {
        base_color: base.color,
        roughness: base.roughness,
        metallic: base.metallic,
        eta: lobes.eta,
        spec_tint: 0.0,
        sheen: lobes.sheen,
        sheen_tint: 0.0,
        clearcoat: lobes.clearcoat,
        clearcoat_gloss: lobes.clearcoat_gloss,
        flatness: 0.0,
        spec_trans: 0.0,
    };
    Ok(match glass(slots, material, &opaque)? {
        Some(glass) => {
            grain::leave_out(slots, material)?;
            (mapped(slots, material, glass.material)?, glass.medium)
        }
        None => {
            let brushed = grain::brushed(slots, material, opaque)?;
            // The same relief from either side.
            (mapped(slots, material, two_sided(brushed))?, None)
        }
    })
}

/// The material under its normal map, if it has one.
fn mapped(slots: &mut Slots, material: &Material, inner: MaterialFile) -> Result<MaterialFile> {
    let Some(given) = &material.normal_texture else { return Ok(inner) };
    let reference = Reference::of_normals(given);
    if !slots.is_in_set(&reference) {
        slots.warn("normalTexture has other texture coordinates than the first texture: it is left out");
        return Ok(inner);
    }
    // Where a picture is mirrored, what is up on it (green) is down across ∂p/∂u.
    let scale = given.scale * Vec2::new(1.0, if slots.mirrored { -1.0 } else { 1.0 });
    let purpose = Use::Normals(reference.axes().map(|axis| (scale * axis).to_array()));
    match slots.textures.bitmap(&reference, purpose, 1.0, slots.part)? {
        Some(texture @ TextureFile::Bitmap { .. }) => {
            Ok(MaterialFile::NormalMap { texture, material: Box::new(inner) })
        }
        _ => Ok(inner),
    }
}

/// Opacity by the alpha mode; none where the surface is there everywhere.
fn opacity(slots: &mut Slots, material: &Material, base: &Base) -> Result<Option<TextureFile>> {
    let (factor, info) = &base.alpha;
    let cut = match material.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => return Ok(None),
        Checked::Valid(AlphaMode::Mask) => Some(material.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0)),
        Checked::Valid(AlphaMode::Blend) => None,
        Checked::Invalid => {
            slots.warn("an unknown alphaMode: the material is opaque");
            return Ok(None);
        }
    };
    let constant = match cut {
        Some(least) => f32::from(u8::from(*factor >= least)),
        None => *factor,
    };
    let constant = (constant < 1.0).then(|| TextureFile::rgb([constant; 3]));
    let Some(reference) = info.as_ref().map(Reference::of) else { return Ok(constant) };
    let picture = slots.textures.picture(&reference, slots.part)?;
    let has_alpha = picture.and_then(|index| slots.textures.pictures.samples(index)).is_some_and(|s| s.has_alpha());
    if !has_alpha {
        return Ok(constant);
    }
    let (purpose, scale) = match cut {
        Some(least) => (Use::Cut([*factor, least]), 1.0),
        None => (Use::Channel(3), *factor),
    };
    let Some(texture) = slots.textures.bitmap(&reference, purpose, scale, slots.part)? else { return Ok(constant) };
    // Many exporters blend what has no hole.
    let whole = Texture::new(&texture, slots.textures.pictures.made())?.mean() == Vec3::ONE;
    Ok((!whole).then_some(texture))
}

fn emission(slots: &mut Slots, material: &Material) -> Result<Option<Emission>> {
    let strength = material.extensions.as_ref().and_then(|all| all.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |given| given.emissive_strength.0);
    let mut radiance = (Vec3::from_array(material.emissive_factor.0) * strength).max(Vec3::ZERO);
    if radiance == Vec3::ZERO {
        return Ok(None);
    }
    let mut texture = None;
    if let Some(reference) = material.emissive_texture.as_ref().map(Reference::of) {
        if slots.is_in_set(&reference) {
            texture = slots.textures.bitmap(&reference, Use::Color([1.0; 3]), 1.0, slots.part)?;
        } else {
            radiance *= slots.textures.mean(&reference, Use::Color([1.0; 3]), "emission", slots.part)?;
        }
    }
    Ok(Some(Emission { radiance, texture }))
}
