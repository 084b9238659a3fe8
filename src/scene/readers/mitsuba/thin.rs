//! The thin principled material.

use crate::base::Result;
use crate::scene::file::{MaterialFile, PrincipledThinFile, TextureFile};

use super::Reader;
use super::element::Element;
use super::material::index;
use super::object::Object;

const PROPERTIES: [&str; 14] = [
    "base_color",
    "roughness",
    "anisotropic",
    "spec_trans",
    "eta",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "flatness",
    "diff_trans",
    // The way in which lobes are sampled does not change their values.
    "diffuse_reflectance_sampling_rate",
    "specular_reflectance_sampling_rate",
    "specular_transmittance_sampling_rate",
    "diffuse_transmittance_sampling_rate",
];

impl<'a> Reader<'a> {
    pub(super) fn principled_thin(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        if self.amount(&object, "anisotropic")? != 0.0 {
            self.warn(element, "anisotropic is left out: the facets are as rough in all directions");
        }
        let [spec_tint, sheen] = [self.amount(&object, "spec_tint")?, self.amount(&object, "sheen")?];
        let [sheen_tint, flatness] = [self.amount(&object, "sheen_tint")?, self.amount(&object, "flatness")?];
        Ok(MaterialFile::PrincipledThin(PrincipledThinFile {
            base_color: self.texture(&object, "base_color", 0.5)?,
            roughness: self.texture(&object, "roughness", 0.5)?,
            spec_trans: self.texture(&object, "spec_trans", 0.0)?,
            // From 0 to 2 there, where all of the light goes through.
            diff_trans: halved(self.texture(&object, "diff_trans", 0.0)?),
            eta: if object.property("eta").is_some() { index(&object, "eta", "bk7")? } else { 1.5 },
            spec_tint,
            sheen,
            sheen_tint,
            flatness,
        }))
    }
}

/// Half of a texture.
fn halved(mut texture: TextureFile) -> TextureFile {
    let halve = |color: &mut [f32; 3]| color.iter_mut().for_each(|channel| *channel *= 0.5);
    match &mut texture {
        TextureFile::Rgb { value } => halve(value),
        TextureFile::Checkerboard { color0, color1, .. } => [color0, color1].into_iter().for_each(halve),
        TextureFile::Bitmap { scale, .. } | TextureFile::Attribute { scale, .. } => *scale *= 0.5,
    }
    texture
}
