//! The principled material, and blends.

use crate::base::Result;
use crate::materials::texture::luminance;
use crate::scene::file::{MaterialFile, PrincipledFile, TextureFile, burley_axes};
use crate::scene::readers::mixable::mixable;

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

/// Most materials of a mixture: each is inside a blend with the ones before it.
const MOST_MIXED: usize = 16;

/// Warning that is given once, for the first principled material.
const BOUNDED: &str = "principled is scaled down where its lobes together scatter more light than arrives";

impl<'a> Reader<'a> {
    pub(super) fn principled(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        let mut number = |name: &str| self.amount(&object, name);
        let anisotropic = number("anisotropic")?;
        let [spec_tint, sheen, sheen_tint] = [number("spec_tint")?, number("sheen")?, number("sheen_tint")?];
        let [clearcoat, clearcoat_gloss] = [number("clearcoat")?, number("clearcoat_gloss")?];
        let [flatness, spec_trans] = [number("flatness")?, number("spec_trans")?];
        if !self.warnings.iter().any(|warning| warning.ends_with(BOUNDED)) {
            self.warn(element, BOUNDED);
        }
        let eta = match (object.property("eta"), object.float("specular")?) {
            (Some(_), Some(_)) => return Err(element.malformed("eta and specular exclude each other")),
            (Some(_), None) => super::material::index(&object, "eta", "bk7")?,
            // Reflection at normal incidence is 0.08·specular (Burley 2012, §5.5).
            (None, specular) => 2.0 / (1.0 - (0.08 * specular.unwrap_or(0.5).clamp(0.0, 1.0)).sqrt() as f32) - 1.0,
        };
        let principled = MaterialFile::Principled(PrincipledFile {
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
        });
        Ok(principled.with_grain(Some(burley_axes(anisotropic))))
    }

    /// A number; of a texture the mean, with a warning.
    pub(super) fn amount(&mut self, object: &Object<'a>, name: &str) -> Result<f32> {
        let Some(property) = object.property(name).filter(|property| property.tag == "texture") else {
            return Ok(object.float(name)?.unwrap_or(0.0) as f32);
        };
        let texture = self.texture_object(property)?;
        Ok(luminance(self.mean(&texture, property, name)?.into()))
    }

    /// Two materials by weight: a texture in Mitsuba 3, a list of numbers in 0.6, which may be of more.
    pub(super) fn blend(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["weight", "weights"], &["bsdf"])?;
        if let Some(text) = object.string("weights")? {
            let weights = numbers(element, text)?;
            return self.mixture(&object, &weights);
        }
        let [first, second] = object.nested[..] else {
            let what = format!("a {} of {} bsdfs", kind(element)?, object.nested.len());
            return Err(element.unsupported(what, &["two bsdfs"]));
        };
        let weight = self.texture(&object, "weight", 0.5)?;
        let materials = [self.part(first)?, self.part(second)?];
        Ok(MaterialFile::Blend { weight, materials: Box::new(materials) })
    }

    /// A material that is mixed with others.
    fn part(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let material = self.nested(element, |reader| reader.material(element))?;
        Ok(mixable(material, &mut |what| self.warn(element, what)))
    }

    /// Any number of materials by constant weights, as blends of blends.
    fn mixture(&mut self, object: &Object<'a>, weights: &[f64]) -> Result<MaterialFile> {
        let element = object.element;
        let sum: f64 = weights.iter().sum();
        let count = object.nested.len();
        if count > MOST_MIXED {
            let what = format!("a mixture of {count} bsdfs");
            return Err(element.unsupported(what, &["at most 16"]));
        }
        if weights.len() != count || count == 0 || weights.iter().any(|weight| *weight < 0.0) || sum <= 0.0 {
            let found = weights.len();
            return Err(element.malformed(format!("expected {count} weights, one for each bsdf, found {found}")));
        }
        if sum > 1.0 + 1e-6 {
            self.warn(element, "the weights are scaled to a sum of 1");
        }
        // What is missing to 1 is absorbed.
        let black = 1.0 - sum;
        let (mut mixed, mut above) = match black > 1e-6 {
            true => (Some(MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.0; 3]) }), black),
            false => (None, 0.0),
        };
        for (inner, weight) in object.nested.iter().zip(weights) {
            let material = self.part(inner)?;
            above += weight;
            mixed = Some(match mixed {
                None => material,
                Some(before) => MaterialFile::Blend {
                    weight: TextureFile::rgb([if above > 0.0 { (weight / above) as f32 } else { 0.0 }; 3]),
                    materials: Box::new([before, material]),
                },
            });
        }
        mixed.ok_or_else(|| element.malformed("expected a bsdf inside"))
    }
}
