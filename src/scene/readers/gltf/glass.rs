//! Materials that let light through: KHR_materials_transmission, thin unless KHR_materials_volume gives them a thickness.

use ::gltf::json::material::Material;

use crate::base::Result;
use crate::materials::texture::{Texture, luminance};
use crate::scene::file::{MaterialFile, MediumFile, PrincipledFile, PrincipledThinFile, TextureFile};

use super::lobes::index;
use super::slots::Slots;

/// Roughest thin pane that is read as a smooth one.
const MOST_ROUGH: f32 = 0.1;
/// Least transmittance of a medium over its attenuation distance: a logarithm is taken of it.
const LEAST_TRANSMITTANCE: f32 = 1e-4;

/// A material that lets light through, and the medium inside.
pub struct Glass {
    /// The material, without mask and normal map.
    pub material: MaterialFile,
    /// What is behind its surface.
    pub medium: Option<MediumFile>,
}

/// The material `opaque` with the transmission that the document gives it; none where it lets no light through.
///
/// # Errors
/// Those of [`Textures`](super::textures::Textures).
pub fn glass(slots: &mut Slots, material: &Material, opaque: &PrincipledFile) -> Result<Option<Glass>> {
    let extensions = material.extensions.as_ref();
    let Some(given) = extensions.and_then(|all| all.transmission.as_ref()) else { return Ok(None) };
    let factor = slots.share(given.transmission_factor.0, "transmissionFactor");
    if factor == 0.0 || opaque.metallic == TextureFile::rgb([1.0; 3]) {
        return Ok(None);
    }
    let texture = given.transmission_texture.as_ref();
    let eta = index(slots, material);
    let volume = extensions.and_then(|all| all.volume.as_ref()).filter(|volume| volume.thickness_factor.0 > 0.0);
    let rough = luminance(Texture::new(&opaque.roughness, slots.textures.pictures.made())?.mean());
    if volume.is_none() && rough > MOST_ROUGH && opaque.metallic == TextureFile::rgb([0.0; 3]) {
        let material = MaterialFile::PrincipledThin(PrincipledThinFile {
            base_color: opaque.base_color.clone(),
            roughness: opaque.roughness.clone(),
            spec_trans: slots.channel(texture, 0, factor, "transmission")?,
            diff_trans: TextureFile::rgb([0.0; 3]),
            eta: eta.max(1.0),
            spec_tint: 0.0,
            sheen: opaque.sheen,
            sheen_tint: opaque.sheen_tint,
            flatness: 0.0,
        });
        return Ok(Some(Glass { material, medium: None }));
    }
    if volume.is_none() && rough > MOST_ROUGH {
        slots.warn("a rough thin pane that is partly metal is read as the surface of something solid");
    }
    if volume.is_some() || rough > MOST_ROUGH {
        let varies = !matches!(opaque.roughness, TextureFile::Rgb { .. });
        let rough = if varies { 1.0 } else { rough };
        let spec_trans = slots.number(texture, 0, factor, "transmission")?;
        let solid = solid(PrincipledFile { eta, spec_trans, ..opaque.clone() }, rough);
        let medium = volume.and_then(|volume| medium(volume.attenuation_color.0, volume.attenuation_distance.0));
        return Ok(Some(Glass { material: solid, medium }));
    }
    let pane = tinted(opaque.base_color.clone(), MaterialFile::ThinDielectric { int_ior: eta, ext_ior: 1.0 });
    let weight = slots.channel(texture, 0, factor, "transmission")?;
    let material = if weight == TextureFile::rgb([1.0; 3]) {
        pane
    } else {
        let opaque = MaterialFile::TwoSided { material: Box::new(MaterialFile::Principled(opaque.clone())) };
        MaterialFile::Blend { weight, materials: Box::new([opaque, pane]) }
    };
    Ok(Some(Glass { material, medium: None }))
}

/// Something solid: smooth and clear as glass is, if it is that.
fn solid(file: PrincipledFile, rough: f32) -> MaterialFile {
    let is_clear = file.spec_trans == 1.0 && file.metallic == TextureFile::rgb([0.0; 3]);
    match file.base_color {
        // As of the principled material: what passes both sides has the colour once.
        TextureFile::Rgb { value } if is_clear && rough == 0.0 && file.clearcoat == 0.0 && file.sheen == 0.0 => {
            tinted(TextureFile::rgb(value.map(f32::sqrt)), MaterialFile::Dielectric { int_ior: file.eta, ext_ior: 1.0 })
        }
        _ => MaterialFile::Principled(file),
    }
}

fn tinted(color: TextureFile, material: MaterialFile) -> MaterialFile {
    material.tinted(TextureFile::rgb([1.0; 3]), color)
}

/// The medium that lets the colour through over the distance (KHR_materials_volume, "Attenuation"); none where it takes nothing.
fn medium(color: [f32; 3], distance: f32) -> Option<MediumFile> {
    let takes = color.iter().any(|&channel| channel < 1.0) && distance > 0.0 && distance.is_finite();
    let sigma_t = color.map(|channel| -channel.clamp(LEAST_TRANSMITTANCE, 1.0).ln() / distance);
    takes.then_some(MediumFile::Homogeneous { sigma_t, albedo: [0.0; 3], g: 0.0 })
}
