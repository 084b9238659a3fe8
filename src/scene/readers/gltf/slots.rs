//! The textures of one material. A mesh has one set of texture coordinates, so that textures over another than the material's first
//! texture are replaced by their means.

use ::gltf::json::material::Material;
use ::gltf::json::texture::Info;
use glam::Vec3;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::base::Result;
use crate::scene::file::TextureFile;

use super::pictures::Use;
use super::textures::{Reference, Textures};

/// Textures of extensions whose descriptions the library leaves as they are.
const OTHERS: [(&str, &[&str]); 3] = [
    ("KHR_materials_anisotropy", &["anisotropyTexture"]),
    ("KHR_materials_clearcoat", &["clearcoatTexture", "clearcoatRoughnessTexture"]),
    ("KHR_materials_sheen", &["sheenColorTexture", "sheenRoughnessTexture"]),
];

/// All textures of a material that count, the most important first. Occlusion is not among them: paths find it themselves.
pub fn references(material: &Material) -> Vec<Reference> {
    let mut infos: Vec<Option<&Info>> = Vec::new();
    let extensions = material.extensions.as_ref();
    if let Some(old) = extensions.and_then(|all| all.pbr_specular_glossiness.as_ref()) {
        infos.extend([old.diffuse_texture.as_ref(), old.specular_glossiness_texture.as_ref()]);
    }
    let base = &material.pbr_metallic_roughness;
    infos.extend([base.base_color_texture.as_ref(), base.metallic_roughness_texture.as_ref()]);
    let mut found: Vec<Reference> = infos.into_iter().flatten().map(Reference::of).collect();
    found.extend(material.normal_texture.as_ref().map(Reference::of_normals));
    found.extend(material.emissive_texture.as_ref().map(Reference::of));
    if let Some(all) = extensions {
        let infos = [
            all.transmission.as_ref().and_then(|given| given.transmission_texture.as_ref()),
            all.specular.as_ref().and_then(|given| given.specular_texture.as_ref()),
            all.specular.as_ref().and_then(|given| given.specular_color_texture.as_ref()),
        ];
        found.extend(infos.into_iter().flatten().map(Reference::of));
        for (name, textures) in OTHERS {
            let value = all.others.get(name);
            found.extend(textures.iter().filter_map(|texture| Reference::of_value(value?.get(texture))));
        }
    }
    found
}

/// A material that is being translated.
pub struct Slots<'t, 'd> {
    /// What makes textures.
    pub textures: &'t mut Textures<'d>,
    /// The material's part of the document.
    pub part: &'t str,
    /// The set of texture coordinates that its textures have.
    pub set: u32,
    /// Whether it is for triangles whose pictures are mirrored.
    pub mirrored: bool,
}

impl Slots<'_, '_> {
    /// Warns of something about the material.
    pub fn warn(&mut self, message: impl std::fmt::Display) {
        self.textures.warnings.add(self.part, message);
    }

    /// A number in [0, 1], brought there with a warning.
    pub fn share(&mut self, value: f32, what: &str) -> f32 {
        if !(0.0..=1.0).contains(&value) {
            self.warn(format_args!("{what} is {value}, beyond 0 to 1"));
        }
        value.clamp(0.0, 1.0)
    }

    /// Whether a texture can vary over the material's meshes.
    pub fn is_in_set(&self, reference: &Reference) -> bool {
        reference.set == self.set
    }

    /// An sRGB texture times a factor, or the factor.
    pub fn color(&mut self, info: Option<&Info>, factor: [f32; 3], what: &str) -> Result<TextureFile> {
        let Some(reference) = info.map(Reference::of) else { return Ok(TextureFile::rgb(factor)) };
        if !self.is_in_set(&reference) {
            let mean = self.textures.mean(&reference, Use::Color([1.0; 3]), what, self.part)?;
            return Ok(TextureFile::rgb((mean * Vec3::from_array(factor)).to_array()));
        }
        let [r, g, b] = factor;
        let (purpose, scale) = if r == g && g == b { (Use::Color([1.0; 3]), r) } else { (Use::Color(factor), 1.0) };
        let texture = self.textures.bitmap(&reference, purpose, scale, self.part)?;
        Ok(texture.unwrap_or(TextureFile::rgb(factor)))
    }

    /// A channel of a texture times a factor, or the factor.
    pub fn channel(&mut self, info: Option<&Info>, channel: usize, factor: f32, what: &str) -> Result<TextureFile> {
        let constant = TextureFile::rgb([factor; 3]);
        let Some(reference) = info.map(Reference::of).filter(|_| factor > 0.0) else { return Ok(constant) };
        if !self.is_in_set(&reference) {
            return Ok(TextureFile::rgb([self.number(info, channel, factor, what)?; 3]));
        }
        let texture = self.textures.bitmap(&reference, Use::Channel(channel), factor, self.part)?;
        Ok(texture.unwrap_or(constant))
    }

    /// As [`Slots::channel`], the mean where there is a texture.
    pub fn number(&mut self, info: Option<&Info>, channel: usize, factor: f32, what: &str) -> Result<f32> {
        let Some(reference) = info.map(Reference::of).filter(|_| factor > 0.0) else { return Ok(factor) };
        Ok(factor * self.textures.mean(&reference, Use::Channel(channel), what, self.part)?.x)
    }

    /// An extension of the material whose description the library leaves as it is; none where there is none.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) for values of other types.
    pub fn extension<T: DeserializeOwned>(&self, material: &Material, name: &str) -> Result<Option<T>> {
        let value: Option<&Value> = material.extensions.as_ref().and_then(|all| all.others.get(name));
        let read = |value: &Value| serde_json::from_value(value.clone());
        value.map(read).transpose().map_err(|error| {
            let part = format!("{}.extensions.{name}", self.part);
            self.textures.document.malformed(part, error.to_string())
        })
    }
}
