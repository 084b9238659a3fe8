//! A material's base: metallic and rough (specification, §3.9.2), or specular and glossy
//! (KHR_materials_pbrSpecularGlossiness, which older documents have).

use ::gltf::json::extensions::material::PbrSpecularGlossiness;
use ::gltf::json::material::Material;
use ::gltf::json::texture::Info;
use glam::Vec3;

use crate::base::Result;
use crate::scene::file::TextureFile;

use super::pictures::Use;
use super::slots::Slots;
use super::textures::Reference;

/// Colours of vertices, by which the base colour is multiplied.
#[derive(Debug, Clone, PartialEq)]
pub enum Paint {
    /// The same everywhere; white changes nothing.
    Plain(Vec3),
    /// A picture of them, for a material without textures.
    Picture(TextureFile),
}

/// What all kinds of materials have in common.
#[derive(Debug, Clone)]
pub struct Base {
    /// Albedo of the base, colour of a metal.
    pub color: TextureFile,
    /// Square root of the facets' roughness.
    pub roughness: TextureFile,
    /// Blend from dielectric to metal.
    pub metallic: TextureFile,
    /// Reflectance at normal incidence where the kind of material gives it.
    pub reflectance: Option<f32>,
    /// Opacity, which the alpha mode may ignore: a factor and the texture whose alpha it multiplies.
    pub alpha: (f32, Option<Info>),
}

impl Base {
    /// The base of `material`.
    ///
    /// # Errors
    /// Those of [`Textures`](super::textures::Textures).
    pub fn of(slots: &mut Slots, material: &Material, paint: &Paint) -> Result<Self> {
        if let Some(old) = material.extensions.as_ref().and_then(|all| all.pbr_specular_glossiness.as_ref()) {
            return Self::glossy(slots, old, paint);
        }
        let given = &material.pbr_metallic_roughness;
        let [r, g, b, alpha] = given.base_color_factor.0;
        let color = painted(slots, given.base_color_texture.as_ref(), [r, g, b], paint)?;
        let pair = given.metallic_roughness_texture.as_ref();
        let rough = slots.share(given.roughness_factor.0, "roughnessFactor");
        let metallic = slots.share(given.metallic_factor.0, "metallicFactor");
        Ok(Self {
            color,
            roughness: slots.channel(pair, 1, rough, "roughness")?,
            metallic: slots.channel(pair, 2, metallic, "metallic")?,
            reflectance: None,
            alpha: (slots.share(alpha, "alpha"), given.base_color_texture.clone()),
        })
    }

    /// Factor on the colour that vertices and textures give.
    pub fn factor(material: &Material) -> [f32; 3] {
        let old = material.extensions.as_ref().and_then(|all| all.pbr_specular_glossiness.as_ref());
        let [r, g, b, _] =
            old.map_or(material.pbr_metallic_roughness.base_color_factor.0, |given| given.diffuse_factor.0);
        [r, g, b]
    }

    fn glossy(slots: &mut Slots, given: &PbrSpecularGlossiness, paint: &Paint) -> Result<Self> {
        slots.warn("specular and glossy: it is read as rough, with the mean of the specular colour's channels");
        let [r, g, b, alpha] = given.diffuse_factor.0;
        let gloss = slots.share(given.glossiness_factor.0, "glossinessFactor");
        let pair = given.specular_glossiness_texture.as_ref();
        let mut specular = Vec3::from_array(given.specular_factor.0);
        let mut roughness = TextureFile::rgb([1.0 - gloss; 3]);
        if let Some(reference) = pair.map(Reference::of) {
            specular *= slots.textures.mean(&reference, Use::Color([1.0; 3]), "the specular colour", slots.part)?;
            roughness = if gloss == 1.0 && slots.is_in_set(&reference) {
                slots.textures.bitmap(&reference, Use::Inverse(3), 1.0, slots.part)?.unwrap_or(roughness)
            } else {
                TextureFile::rgb([1.0 - slots.number(pair, 3, gloss, "glossiness")?; 3])
            };
        }
        let diffuse = painted(slots, given.diffuse_texture.as_ref(), [r, g, b], paint)?;
        let is_black = diffuse == TextureFile::rgb([0.0; 3]);
        let alpha = (slots.share(alpha, "alpha"), given.diffuse_texture.clone());
        // What reflects more than any dielectric and has no diffuse base is a metal.
        let (color, metallic) = if is_black && specular.max_element() > 0.2 {
            (TextureFile::rgb(specular.clamp(Vec3::ZERO, Vec3::ONE).to_array()), 1.0)
        } else {
            (diffuse, 0.0)
        };
        let reflectance = Some(specular.element_sum() / 3.0);
        Ok(Self { color, roughness, metallic: TextureFile::rgb([metallic; 3]), reflectance, alpha })
    }
}

fn painted(slots: &mut Slots, info: Option<&Info>, factor: [f32; 3], paint: &Paint) -> Result<TextureFile> {
    let factor = factor.map(|channel| slots.share(channel, "the colour's factor"));
    match paint {
        Paint::Picture(picture) => Ok(picture.clone()),
        Paint::Plain(tint) => slots.color(info, (Vec3::from_array(factor) * *tint).to_array(), "colour"),
    }
}
