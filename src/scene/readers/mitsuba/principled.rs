//! The principled material, and blends.

use crate::base::Result;
use crate::materials::texture::luminance;
use crate::scene::file::{MaterialFile, PrincipledFile, TextureFile};

use super::Reader;
use super::element::{Element, numbers};
use super::object::{Object, kind};

const PROPERTIES: [&str; 17] = [
    "base_color",
    "roughness",
    "anisotropic",
    "metallic",
    "spec_trans",
    "eta",
    "specular",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "flatness",
    "clearcoat",
    "clearcoat_gloss",
    // The way in which lobes are sampled does not change their values.
    "diffuse_reflectance_sampling_rate",
    "main_specular_sampling_rate",
    "clearcoat_sampling_rate",
    "main_specular_rate",
];

/// Warning that is given once, for the first principled material.
const BOUNDED: &str = "principled is scaled down where its lobes together scatter more light than arrives";

impl<'a> Reader<'a> {
    pub(super) fn principled(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        let mut number = |name: &str| -> Result<f32> {
            let Some(property) = object.property(name).filter(|property| property.tag == "texture") else {
                return Ok(object.float(name)?.unwrap_or(0.0) as f32);
            };
            let texture = self.texture_object(property)?;
            Ok(luminance(self.mean(&texture, property, name)?.into()))
        };
        let anisotropic = number("anisotropic")?;
        let [spec_tint, sheen, sheen_tint] = [number("spec_tint")?, number("sheen")?, number("sheen_tint")?];
        let [clearcoat, clearcoat_gloss] = [number("clearcoat")?, number("clearcoat_gloss")?];
        let [flatness, spec_trans] = [number("flatness")?, number("spec_trans")?];
        if anisotropic != 0.0 {
            self.warn(element, "anisotropic is left out: the facets are as rough in all directions");
        }
        if !self.warnings.iter().any(|warning| warning.ends_with(BOUNDED)) {
            self.warn(element, BOUNDED);
        }
        let eta = match (object.property("eta"), object.float("specular")?) {
            (Some(_), Some(_)) => return Err(element.malformed("eta and specular exclude each other")),
            (Some(_), None) => super::material::index(&object, "eta", "bk7")?,
            // Reflection at normal incidence is 0.08·specular (Burley 2012, §5.5).
            (None, specular) => 2.0 / (1.0 - (0.08 * specular.unwrap_or(0.5).clamp(0.0, 1.0)).sqrt() as f32) - 1.0,
        };
        Ok(MaterialFile::Principled(PrincipledFile {
            base_color: self.texture(&object, "base_color", 0.5)?,
            roughness: self.texture(&object, "roughness", 0.5)?,
            metallic: self.texture(&object, "metallic", 0.0)?,
            eta,
            spec_tint,
            sheen,
            sheen_tint,
            clearcoat,
            clearcoat_gloss,
            flatness,
            spec_trans,
        }))
    }

    /// Two materials by weight: a texture in Mitsuba 3, a list of numbers in 0.6.
    pub(super) fn blend(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["weight", "weights"], &["bsdf"])?;
        let [first, second] = object.nested[..] else {
            let what = format!("a {} of {} bsdfs", kind(element)?, object.nested.len());
            return Err(element.unsupported(what, &["two bsdfs"]));
        };
        let weight = match object.string("weights")? {
            None => self.texture(&object, "weight", 0.5)?,
            Some(text) => match numbers(element, text)?[..] {
                [a, b] if a >= 0.0 && b >= 0.0 && a + b > 0.0 => {
                    if (a + b - 1.0).abs() > 1e-6 {
                        self.warn(element, "the weights are scaled to a sum of 1");
                    }
                    TextureFile::rgb([(b / (a + b)) as f32; 3])
                }
                _ => return Err(element.malformed("expected two weights")),
            },
        };
        let materials = [
            self.nested(first, |reader| reader.material(first))?,
            self.nested(second, |reader| reader.material(second))?,
        ];
        Ok(MaterialFile::Blend { weight, materials: Box::new(materials) })
    }
}
