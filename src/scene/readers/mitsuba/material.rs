//! Materials and their textures.

use crate::base::Result;
use crate::scene::file::{Distribution, MaterialFile, TextureFile, identity3};

use super::Reader;
use super::conductors::{INDEX_NAMES, conductor, conductor_names, refractive_index};
use super::element::Element;
use super::object::{Object, kind};

const KINDS: [&str; 12] = [
    "diffuse",
    "conductor",
    "roughconductor",
    "dielectric",
    "thindielectric",
    "roughdielectric",
    "plastic",
    "roughplastic",
    "mask",
    "twosided",
    "bumpmap",
    "normalmap",
];

/// How deep materials may be inside one another.
const MOST_NESTED: u32 = 8;

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

    fn material(&mut self, element: &'a Element) -> Result<MaterialFile> {
        match kind(element)? {
            "diffuse" => {
                let object = Object::new(element, &self.ids, &["reflectance"], &[])?;
                Ok(MaterialFile::Diffuse { reflectance: self.texture(&object, "reflectance", 0.5)? })
            }
            "conductor" => self.conductor(element),
            "roughconductor" => self.rough_conductor(element),
            "dielectric" | "thindielectric" | "roughdielectric" => self.dielectric(element),
            "plastic" | "roughplastic" => self.plastic(element),
            "null" => Object::new(element, &self.ids, &[], &[]).map(|_| MaterialFile::Null),
            "mask" => self.mask(element),
            "twosided" => self.two_sided(element),
            "bumpmap" | "normalmap" => self.flat(element),
            other => Err(element.unsupported(format!("bsdf \"{other}\""), &KINDS)),
        }
    }

    fn two_sided(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &[], &["bsdf"])?;
        Ok(MaterialFile::TwoSided { material: Box::new(self.inside(&object)?) })
    }

    fn mask(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["opacity"], &["bsdf"])?;
        let opacity = self.texture(&object, "opacity", 0.5)?;
        Ok(MaterialFile::Mask { opacity, material: Box::new(self.inside(&object)?) })
    }

    /// Bumps are left out: what is under them stays.
    fn flat(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        self.warnings.push(format!("{}: the {kind} is left out: its surface is shaded without it", element.place));
        // The texture of a bump map may have any name.
        let names: Vec<&str> = element.children.iter().filter_map(|child| child.attribute("name")).collect();
        let object = Object::new(element, &self.ids, &names, &["bsdf"])?;
        self.inside(&object)
    }

    /// The one material inside another.
    fn inside(&mut self, object: &Object<'a>) -> Result<MaterialFile> {
        let kind = kind(object.element)?;
        let missing = || object.element.malformed(format!("{kind} needs a bsdf inside"));
        let inner = object.single("bsdf")?.ok_or_else(missing)?;
        // A material that contains itself ends here too.
        if self.depth == MOST_NESTED {
            return Err(inner.malformed(format!("bsdfs inside one another, more than {MOST_NESTED} deep")));
        }
        self.depth += 1;
        let material = self.material(inner)?;
        self.depth -= 1;
        Ok(material)
    }

    fn conductor(&self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["material", "eta", "k", "specular_reflectance"], &[])?;
        let (eta, k) = metal_index(&object)?;
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        Ok(MaterialFile::Conductor { eta, k, specular_reflectance })
    }

    fn rough_conductor(&self, element: &'a Element) -> Result<MaterialFile> {
        let known = [&ROUGHNESS[..], &["material", "eta", "k", "specular_reflectance"]].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        let (eta, k) = metal_index(&object)?;
        let (alpha, distribution) = roughness(&object)?;
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        Ok(MaterialFile::RoughConductor { alpha, distribution, eta, k, specular_reflectance })
    }

    fn plastic(&self, element: &'a Element) -> Result<MaterialFile> {
        let rough = kind(element)? == "roughplastic";
        let own = ["int_ior", "ext_ior", "diffuse_reflectance", "specular_reflectance", "nonlinear"];
        let known = [if rough { &ROUGHNESS[..] } else { &[] }, &own].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        let (alpha, distribution) = if rough { roughness(&object)? } else { (0.0, Distribution::default()) };
        Ok(MaterialFile::Plastic {
            alpha,
            distribution,
            int_ior: index(&object, "int_ior", "polypropylene")?,
            ext_ior: index(&object, "ext_ior", "air")?,
            diffuse_reflectance: self.texture(&object, "diffuse_reflectance", 0.5)?,
            specular_reflectance: self.texture(&object, "specular_reflectance", 1.0)?,
            nonlinear: object.boolean("nonlinear")?.unwrap_or(false),
        })
    }

    fn dielectric(&self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        let own = ["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"];
        let known = [if kind == "roughdielectric" { &ROUGHNESS[..] } else { &[] }, &own].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        for factor in ["specular_reflectance", "specular_transmittance"] {
            if object.color(factor)?.is_some_and(|color| color != [1.0; 3]) {
                return Err(element.unsupported(format!("{factor} other than 1 of a dielectric"), &["1"]));
            }
        }
        let [int_ior, ext_ior] = [index(&object, "int_ior", "bk7")?, index(&object, "ext_ior", "air")?];
        Ok(match kind {
            "thindielectric" => MaterialFile::ThinDielectric { int_ior, ext_ior },
            "roughdielectric" => {
                let (alpha, distribution) = roughness(&object)?;
                MaterialFile::RoughDielectric { alpha, distribution, int_ior, ext_ior }
            }
            _ => MaterialFile::Dielectric { int_ior, ext_ior },
        })
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

/// The properties of [`roughness`].
const ROUGHNESS: [&str; 5] = ["alpha", "alpha_u", "alpha_v", "distribution", "sample_visible"];

fn roughness(object: &Object) -> Result<(f32, Distribution)> {
    let element = object.element;
    object.boolean("sample_visible")?;
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
    Ok((alpha as f32, distribution))
}

/// A refractive index, by its value or by the medium's name.
fn index(object: &Object, name: &str, default: &str) -> Result<f32> {
    if let Some("float" | "integer") = object.property(name).map(|property| property.tag.as_str()) {
        return Ok(object.float(name)?.unwrap_or(1.0) as f32);
    }
    let medium = object.string(name)?.unwrap_or(default);
    let unknown = || object.element.unsupported(format!("{name} \"{medium}\""), &INDEX_NAMES);
    refractive_index(medium).ok_or_else(unknown)
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
