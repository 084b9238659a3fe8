//! Materials.

use crate::base::{Error, Result};
use crate::materials::microfacet::SMOOTH;
use crate::materials::texture::luminance;
use crate::math::channel_mean;
use crate::scene::file::{Distribution, Filter, MaterialFile, TextureFile};
use crate::scene::readers::conductors::{INDEX_NAMES, conductor, conductor_names, refractive_index};
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind};

/// All of them, to find slips of the pen.
pub(super) const KINDS: [&str; 28] = [
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
    "principled",
    "principledthin",
    "blendbsdf",
    "mixturebsdf",
    "roughdiffuse",
    "difftrans",
    "phong",
    "ward",
    "coating",
    "roughcoating",
    "null",
    "hair",
    "pplastic",
    "polarizer",
    "retarder",
    "circular",
];

/// Deepest nesting of materials.
pub(super) const MOST_NESTED: u32 = 8;

/// Most materials, counted again wherever one is inside another: blends of blends must not grow without bound.
const MOST_MATERIALS: u64 = 1 << 17;

impl<'a> Reader<'a> {
    /// Reads a material at the top level, which is kept if it has an id.
    pub(super) fn named_material(&mut self, element: &'a Element) -> Result<()> {
        match element.attribute("id") {
            Some(id) => self.add_material(id.to_owned(), element),
            None => self.material(element).map(drop),
        }
    }

    /// Adds the material under `name`, unless it is there already.
    pub(super) fn add_material(&mut self, name: String, element: &'a Element) -> Result<()> {
        if !self.file.materials.contains_key(&name) {
            let material = self.material(element)?;
            self.places.set(format!("materials.{name}"), element.place.clone());
            self.file.materials.insert(name, material);
        }
        Ok(())
    }

    pub(super) fn material(&mut self, element: &'a Element) -> Result<MaterialFile> {
        self.materials += 1;
        if self.materials > MOST_MATERIALS {
            let (place, what) =
                (element.place.clone(), "number of materials, each counted where it is used".to_owned());
            return Err(Error::Limit { place, what, value: self.materials, limit: MOST_MATERIALS });
        }
        match kind(element)? {
            "diffuse" => {
                let object = Object::new(element, &self.ids, &["reflectance"], &[])?;
                Ok(MaterialFile::Diffuse { reflectance: self.texture(&object, "reflectance", 0.5)? })
            }
            "conductor" => self.conductor(element),
            "roughconductor" => self.rough_conductor(element),
            "dielectric" | "thindielectric" | "roughdielectric" => self.dielectric(element),
            rough @ ("plastic" | "roughplastic") => self.plastic(element, rough == "roughplastic"),
            "null" => Object::new(element, &self.ids, &[], &[]).map(|_| MaterialFile::Null {}),
            "mask" => self.mask(element),
            "twosided" => self.two_sided(element),
            "bumpmap" | "normalmap" => self.bumped(element),
            "principled" => self.principled(element),
            "principledthin" => self.principled_thin(element),
            "blendbsdf" | "mixturebsdf" => self.blend(element),
            "roughdiffuse" => self.rough_diffuse(element),
            "difftrans" => {
                let object = Object::new(element, &self.ids, &["transmittance"], &[])?;
                let transmittance = self.texture(&object, "transmittance", 0.5)?;
                Ok(MaterialFile::Translucent { reflectance: TextureFile::rgb([0.0; 3]), transmittance })
            }
            "phong" | "ward" => self.glossy(element),
            "coating" | "roughcoating" => self.coating(element),
            "hair" => self.hair(element),
            "pplastic" => self.polarized_plastic(element),
            "polarizer" | "retarder" | "circular" => self.polarizer(element),
            _ => self.stand_in(element),
        }
    }

    fn two_sided(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let mut object = Object::new(element, &self.ids, &[], &["bsdf"])?;
        if object.nested.len() > 1 {
            self.warn(element, "the first bsdf of a twosided one is used on both sides");
            object.nested.truncate(1);
        }
        let material = self.inside(&object)?;
        // Mitsuba takes a material that is already two-sided as it is.
        Ok(if material.is_two_sided() { material } else { MaterialFile::TwoSided { material: Box::new(material) } })
    }

    fn mask(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["opacity"], &["bsdf"])?;
        let opacity = self.texture(&object, "opacity", 0.5)?;
        Ok(MaterialFile::Mask { opacity, material: Box::new(self.inside(&object)?) })
    }

    fn bumped(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        let known =
            [&["flip_invalid_normals", "use_shadowing_function"][..], if kind == "bumpmap" { &["scale"] } else { &[] }];
        // The texture may have any name, or none.
        let object = Object::new(element, &self.ids, &known.concat(), &["bsdf", "texture"])?;
        for option in known[0] {
            if object.boolean(option)? == Some(false) {
                self.warn(element, format_args!("{option} is always on"));
            }
        }
        let missing = || element.malformed(format!("{kind} needs a texture inside"));
        let texture = self.texture_object(object.single("texture")?.ok_or_else(missing)?)?;
        if matches!(texture, TextureFile::Checkerboard { .. } | TextureFile::Bitmap { filter: Filter::Nearest, .. })
            && kind == "bumpmap"
        {
            self.warn(element, "a bumpmap's texture without slopes changes nothing");
        }
        let scale = object.float("scale")?.unwrap_or(1.0) as f32;
        let material = Box::new(self.inside(&object)?);
        Ok(match kind {
            "bumpmap" => MaterialFile::BumpMap { texture, scale, material },
            _ => MaterialFile::NormalMap { texture, material },
        })
    }

    /// The one material inside another.
    pub(super) fn inside(&mut self, object: &Object<'a>) -> Result<MaterialFile> {
        let kind = kind(object.element)?;
        let missing = || object.element.malformed(format!("{kind} needs a bsdf inside"));
        let inner = object.single("bsdf")?.ok_or_else(missing)?;
        self.nested(inner, |reader| reader.material(inner))
    }

    /// Reads an object inside another of its kind; one that contains itself fails here.
    pub(super) fn nested<T>(&mut self, inner: &'a Element, read: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        if self.depth == MOST_NESTED {
            return Err(inner.malformed(format!("<{}>s inside one another, more than {MOST_NESTED} deep", inner.tag)));
        }
        self.depth += 1;
        let result = read(self);
        self.depth -= 1;
        result
    }

    fn rough_diffuse(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &["reflectance", "alpha", "use_fast_approx"], &[])?;
        Ok(MaterialFile::RoughDiffuse {
            reflectance: self.texture(&object, "reflectance", 0.5)?,
            alpha: self.mean_color(&object, "alpha", Use::Index)?.map_or(0.2, |alpha| channel_mean(alpha.into())),
            qualitative: object.boolean("use_fast_approx")?.unwrap_or(false),
        })
    }

    fn conductor(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &METAL, &[])?;
        let (eta, k) = metal_index(&object)?;
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        Ok(MaterialFile::Conductor { eta, k, specular_reflectance })
    }

    fn rough_conductor(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let known = [&ROUGHNESS[..], &METAL].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        let (eta, k) = metal_index(&object)?;
        let Roughness { alpha, axes, factor, distribution } = self.roughness(&object)?;
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        let metal = MaterialFile::RoughConductor { alpha, distribution, eta, k, specular_reflectance };
        Ok(metal.roughened(factor).with_grain(axes))
    }

    pub(super) fn plastic(&mut self, element: &'a Element, rough: bool) -> Result<MaterialFile> {
        let own = ["int_ior", "ext_ior", "diffuse_reflectance", "specular_reflectance", "nonlinear"];
        let known = [if rough { &ROUGHNESS[..] } else { &[] }, &own].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        let Roughness { alpha, axes, factor, distribution } =
            if rough { self.roughness(&object)? } else { Roughness::default() };
        if axes.is_some() {
            self.warn(element, "anisotropic roughness: the geometric mean of alpha_u and alpha_v is used");
        }
        let plastic = MaterialFile::Plastic {
            alpha,
            distribution,
            int_ior: index(&object, "int_ior", "polypropylene")?,
            ext_ior: index(&object, "ext_ior", "air")?,
            diffuse_reflectance: self.texture(&object, "diffuse_reflectance", 0.5)?,
            specular_reflectance: self.texture(&object, "specular_reflectance", 1.0)?,
            nonlinear: object.boolean("nonlinear")?.unwrap_or(false),
        };
        Ok(plastic.roughened(factor))
    }

    fn dielectric(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        let own = ["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"];
        let known = [if kind == "roughdielectric" { &ROUGHNESS[..] } else { &[] }, &own].concat();
        let object = Object::new(element, &self.ids, &known, &[])?;
        let [int_ior, ext_ior] = [index(&object, "int_ior", "bk7")?, index(&object, "ext_ior", "air")?];
        let (mut varying, mut grain) = (None, None);
        let clear = match kind {
            "thindielectric" => MaterialFile::ThinDielectric { int_ior, ext_ior },
            "roughdielectric" => {
                let Roughness { alpha, axes, factor, distribution } = self.roughness(&object)?;
                (varying, grain) = (factor, axes);
                MaterialFile::RoughDielectric { alpha, distribution, int_ior, ext_ior }
            }
            _ => MaterialFile::Dielectric { int_ior, ext_ior },
        };
        let specular_reflectance = self.texture(&object, "specular_reflectance", 1.0)?;
        let specular_transmittance = self.texture(&object, "specular_transmittance", 1.0)?;
        let clear = clear.tinted(specular_reflectance, specular_transmittance).roughened(varying);
        Ok(clear.with_grain(grain))
    }

    /// The roughness of facets.
    pub(super) fn roughness(&mut self, object: &Object<'a>) -> Result<Roughness> {
        let element = object.element;
        object.boolean("sample_visible")?;
        let mut factor = None;
        if let Some(property) = object.property("alpha").filter(|property| property.tag == "texture") {
            factor = Some(self.texture_object(property)?).filter(|texture| !matches!(texture, TextureFile::Rgb { .. }));
        }
        let mut alpha = |name: &str| -> Result<Option<f32>> {
            let Some(property) = object.property(name) else { return Ok(None) };
            if factor.is_some() && name == "alpha" {
                return Ok(Some(1.0));
            }
            if property.tag == "texture" {
                let texture = self.texture_object(property)?;
                return Ok(Some(luminance(self.mean(&texture, property, name)?.into())));
            }
            Ok(object.float(name)?.map(|alpha| alpha as f32))
        };
        let (alpha, axes) = match (alpha("alpha")?, alpha("alpha_u")?, alpha("alpha_v")?) {
            (alpha, None, None) => (alpha.unwrap_or(0.1), None),
            (None, Some(u), Some(v)) if u == v => (u, None),
            (None, u, v) => {
                let (u, v) = (u.unwrap_or(0.1), v.unwrap_or(0.1));
                (if u < 0.0 || v < 0.0 { u.min(v) } else { (u.max(SMOOTH) * v.max(SMOOTH)).sqrt() }, Some([u, v]))
            }
            _ => return Err(element.malformed("alpha and alpha_u, alpha_v exclude each other")),
        };
        let distribution = match object.string("distribution")?.unwrap_or("beckmann") {
            "beckmann" => Distribution::Beckmann,
            "ggx" => Distribution::Ggx,
            // Mitsuba 0.6 has them; both have Gaussian-like slopes.
            old @ ("phong" | "as") => {
                self.warn(element, format_args!("the distribution beckmann is used instead of \"{old}\""));
                Distribution::Beckmann
            }
            other => return Err(element.unsupported(format!("distribution \"{other}\""), &["beckmann", "ggx"])),
        };
        Ok(Roughness { alpha, axes, factor, distribution })
    }
}

/// The roughness of facets.
#[derive(Default)]
pub(super) struct Roughness {
    pub alpha: f32,
    /// α along ∂p/∂u and across it, where they differ; `alpha` is the geometric mean of both then.
    axes: Option<[f32; 2]>,
    /// Factor on it, where it varies.
    factor: Option<TextureFile>,
    distribution: Distribution,
}

/// The properties of a metal.
const METAL: [&str; 5] = ["material", "eta", "k", "ext_eta", "specular_reflectance"];

/// The properties of [`Reader::roughness`].
pub(super) const ROUGHNESS: [&str; 5] = ["alpha", "alpha_u", "alpha_v", "distribution", "sample_visible"];

/// A refractive index, by its value or by the medium's name.
pub(super) fn index(object: &Object, name: &str, default: &str) -> Result<f32> {
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
    let outside = match object.property("ext_eta") {
        Some(_) => index(object, "ext_eta", "vacuum")?,
        None => 1.0,
    };
    if outside <= 0.0 {
        return Err(object.element.malformed(format!("ext_eta is {outside}, expected a number above 0")));
    }
    let relative = |color: [f32; 3]| color.map(|channel| channel / outside);
    let (eta, k) = (object.color_for("eta", Use::Index)?, object.color_for("k", Use::Index)?);
    if eta.is_none() && k.is_none() {
        let name = name.unwrap_or("none");
        let unknown = || object.element.unsupported(format!("metal \"{name}\""), &conductor_names());
        let (eta, k) = conductor(name).ok_or_else(unknown)?;
        return Ok((relative(eta), relative(k)));
    }
    if name.is_some_and(|name| name != "none") {
        return Err(object.element.malformed("material and eta, k exclude each other"));
    }
    Ok((relative(eta.unwrap_or([0.0; 3])), relative(k.unwrap_or([1.0; 3]))))
}
