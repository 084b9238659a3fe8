//! Materials and their textures.

use crate::base::Result;
use crate::scene::file::{Distribution, MaterialFile, TextureFile, identity3};

use super::Reader;
use super::conductors::{INDEX_NAMES, conductor, conductor_names, refractive_index};
use super::element::Element;
use super::object::{Object, kind};

const KINDS: [&str; 5] = ["diffuse", "conductor", "roughconductor", "dielectric", "twosided"];

impl<'a> Reader<'a> {
    /// A material of its own: kept if it has an id, read in any case.
    pub(super) fn named_material(&mut self, element: &'a Element) -> Result<()> {
        match element.attribute("id") {
            Some(id) => self.add_material(id.to_owned(), element),
            None => self.material(element).map(drop),
        }
    }

    /// Puts the material under `name`, once.
    pub(super) fn add_material(&mut self, name: String, element: &'a Element) -> Result<()> {
        if !self.file.materials.contains_key(&name) {
            let material = self.material(element)?;
            self.places.set(format!("materials.{name}"), element.place.clone());
            self.file.materials.insert(name, material);
        }
        Ok(())
    }

    fn material(&self, element: &'a Element) -> Result<MaterialFile> {
        match kind(element)? {
            "diffuse" => {
                let object = Object::new(element, &self.ids, &["reflectance"], &[])?;
                Ok(MaterialFile::Diffuse { reflectance: self.texture(&object, "reflectance", 0.5)? })
            }
            "conductor" => self.conductor(element),
            "roughconductor" => self.rough_conductor(element),
            "dielectric" => self.dielectric(element),
            "twosided" => self.two_sided(element),
            other => Err(element.unsupported(format!("bsdf \"{other}\""), &KINDS)),
        }
    }

    fn two_sided(&self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &[], &["bsdf"])?;
        let inner = object.single("bsdf")?.ok_or_else(|| element.malformed("twosided needs a bsdf inside"))?;
        // Also what ends a material that contains itself.
        if kind(inner)? == "twosided" {
            return Err(inner.malformed("a twosided bsdf inside another"));
        }
        Ok(MaterialFile::TwoSided { material: Box::new(self.material(inner)?) })
    }

    fn conductor(&self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["material", "eta", "k", "specular_reflectance"], &[])?;
        let (eta, k) = metal_index(&object)?;
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        Ok(MaterialFile::Conductor { eta, k, specular_reflectance })
    }

    fn rough_conductor(&self, element: &'a Element) -> Result<MaterialFile> {
        let known = [
            "material",
            "eta",
            "k",
            "specular_reflectance",
            "alpha",
            "alpha_u",
            "alpha_v",
            "distribution",
            "sample_visible",
        ];
        let object = Object::new(element, &self.ids, &known, &[])?;
        object.boolean("sample_visible")?;
        let (eta, k) = metal_index(&object)?;
        let alpha = match (object.float("alpha")?, object.float("alpha_u")?, object.float("alpha_v")?) {
            (alpha, None, None) => alpha.unwrap_or(0.1),
            (None, Some(u), Some(v)) if u == v => u,
            _ => return Err(element.unsupported("anisotropic roughness", &["alpha", "alpha_u and alpha_v if equal"])),
        };
        let distribution = match object.string("distribution")?.unwrap_or("beckmann") {
            "beckmann" => Distribution::Beckmann,
            "ggx" => Distribution::Ggx,
            other => return Err(element.unsupported(format!("distribution \"{other}\""), &["beckmann", "ggx"])),
        };
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        Ok(MaterialFile::RoughConductor { alpha: alpha as f32, distribution, eta, k, specular_reflectance })
    }

    fn dielectric(&self, element: &'a Element) -> Result<MaterialFile> {
        let known = ["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        for factor in ["specular_reflectance", "specular_transmittance"] {
            if object.color(factor)?.is_some_and(|color| color != [1.0; 3]) {
                return Err(element.unsupported(format!("{factor} other than 1 of a dielectric"), &["1"]));
            }
        }
        let index = |name: &str, default: &str| match object.property(name).map(|property| property.tag.as_str()) {
            Some("float" | "integer") => Ok(object.float(name)?.unwrap_or(1.0) as f32),
            _ => {
                let medium = object.string(name)?.unwrap_or(default);
                let unknown = || element.unsupported(format!("{name} \"{medium}\""), &INDEX_NAMES);
                refractive_index(medium).ok_or_else(unknown)
            }
        };
        Ok(MaterialFile::Dielectric { int_ior: index("int_ior", "bk7")?, ext_ior: index("ext_ior", "air")? })
    }

    /// A colour or texture, `default` in all channels if absent.
    fn texture(&self, object: &Object<'a>, name: &str, default: f32) -> Result<TextureFile> {
        match object.property(name) {
            Some(element) if element.tag == "texture" => self.texture_object(element),
            _ => Ok(TextureFile::rgb(object.color(name)?.unwrap_or([default; 3]))),
        }
    }

    fn texture_object(&self, element: &'a Element) -> Result<TextureFile> {
        match kind(element)? {
            "bitmap" => self.bitmap(element),
            "checkerboard" => {
                let object = Object::new(element, &self.ids, &["color0", "color1", "to_uv"], &[])?;
                Ok(TextureFile::Checkerboard {
                    color0: object.color("color0")?.unwrap_or([0.4; 3]),
                    color1: object.color("color1")?.unwrap_or([0.2; 3]),
                    to_uv: to_uv(&object)?,
                })
            }
            other => Err(element.unsupported(format!("texture \"{other}\""), &["bitmap", "checkerboard"])),
        }
    }

    fn bitmap(&self, element: &'a Element) -> Result<TextureFile> {
        let known = ["filename", "raw", "to_uv", "filter_type", "wrap_mode"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        for (name, only) in [("filter_type", "bilinear"), ("wrap_mode", "repeat")] {
            if let Some(other) = object.string(name)?.filter(|value| *value != only) {
                return Err(element.unsupported(format!("{name} \"{other}\""), &[only]));
            }
        }
        Ok(TextureFile::Bitmap {
            file: object.required_string("filename")?.to_owned(),
            to_uv: to_uv(&object)?,
            raw: object.boolean("raw")?.unwrap_or(false),
            scale: 1.0,
        })
    }
}

/// The plane part of a transform: x, y and their translation. A third coordinate of a texture does not exist, and Mitsuba's
/// versions disagree on what a matrix that uses it means.
fn to_uv(object: &Object) -> Result<[f32; 9]> {
    let Some(matrix) = object.transform("to_uv")? else { return Ok(identity3()) };
    let m = matrix.transpose().to_cols_array_2d();
    if [m[0][2], m[1][2], m[2][0], m[2][1]] != [0.0; 4] || m[3] != [0.0, 0.0, 0.0, 1.0] {
        let known = ["scale", "rotate about z", "translate", "a matrix that leaves z alone"];
        return Err(object.element.unsupported("a to_uv that mixes in a third coordinate", &known));
    }
    let row = |i: usize| [m[i][0] as f32, m[i][1] as f32, m[i][3] as f32];
    let mut out = identity3();
    out[..6].copy_from_slice([row(0), row(1)].as_flattened());
    Ok(out)
}

/// eta and k, given or by the metal's name; without any, a perfect mirror.
fn metal_index(object: &Object) -> Result<([f32; 3], [f32; 3])> {
    let name = object.string("material")?;
    let (eta, k) = (object.color("eta")?, object.color("k")?);
    if eta.is_none() && k.is_none() {
        let name = name.unwrap_or("none");
        let unknown = || object.element.unsupported(format!("metal \"{name}\""), &conductor_names());
        return conductor(name).ok_or_else(unknown);
    }
    if name.is_some_and(|name| name != "none") {
        return Err(object.element.malformed("material and eta, k exclude each other"));
    }
    Ok((eta.unwrap_or([0.0; 3]), k.unwrap_or([1.0; 3])))
}
