//! Textures.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::base::Result;
use crate::scene::file::{Filter, TextureFile, Wrap, identity3};
use crate::scene::readers::mean;
use crate::scene::readers::slips::meant;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::color;
use super::element::Element;
use super::object::{Object, follow, kind, refuse_slip_of_kind};

const KINDS: [&str; 5] = ["bitmap", "checkerboard", "scale", "mesh_attribute", "vertexcolors"];

impl<'a> Reader<'a> {
    /// A colour or texture, `default` in all channels if absent.
    pub(super) fn texture(&mut self, object: &Object<'a>, name: &str, default: f32) -> Result<TextureFile> {
        match object.property(name) {
            Some(element) if element.tag == "texture" => self.texture_object(element),
            _ => Ok(TextureFile::rgb(object.color(name)?.unwrap_or([default; 3]))),
        }
    }

    /// A colour; of a texture the mean, with a warning.
    pub(super) fn mean_color(&mut self, object: &Object<'a>, name: &str, purpose: Use) -> Result<Option<[f32; 3]>> {
        match object.property(name) {
            Some(element) if element.tag == "texture" => {
                let texture = self.texture_object(element)?;
                self.mean(&texture, element, name).map(Some)
            }
            _ => object.color_for(name, purpose),
        }
    }

    /// The mean of a texture where only one value can be used, with a warning.
    pub(super) fn mean(&mut self, texture: &TextureFile, element: &Element, name: &str) -> Result<[f32; 3]> {
        if !matches!(texture, TextureFile::Rgb { .. }) {
            self.warn(element, format_args!("{name} cannot vary: the mean of its texture is used"));
        }
        mean::mean(texture, &self.folder, &element.place, &BTreeMap::new(), &mut self.absent)
    }

    pub(super) fn texture_object(&mut self, element: &'a Element) -> Result<TextureFile> {
        match kind(element)? {
            "bitmap" => self.bitmap(element),
            "checkerboard" => {
                let object = Object::new(element, &self.ids, &["color0", "color1", "to_uv"], &[])?;
                Ok(TextureFile::Checkerboard {
                    color0: self.mean_color(&object, "color0", Use::Reflectance)?.unwrap_or([0.4; 3]),
                    color1: self.mean_color(&object, "color1", Use::Reflectance)?.unwrap_or([0.2; 3]),
                    to_uv: to_uv(&object)?,
                })
            }
            "scale" => self.scaled(element),
            "mesh_attribute" => {
                let object = Object::new(element, &self.ids, &["name", "scale"], &[])?;
                let scale = object.float("scale")?.unwrap_or(1.0) as f32;
                Ok(TextureFile::Attribute { name: object.required_string("name")?.to_owned(), scale })
            }
            "vertexcolors" => {
                Object::new(element, &self.ids, &[], &[])?;
                Ok(TextureFile::Attribute { name: "vertex_color".to_owned(), scale: 1.0 })
            }
            _ => self.stand_in_texture(element),
        }
    }

    /// A texture of an unknown kind: the one inside it, or the mean of its colours.
    fn stand_in_texture(&mut self, element: &'a Element) -> Result<TextureFile> {
        refuse_slip_of_kind(element, &KINDS)?;
        let kind = kind(element)?;
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for child in &element.children {
            let target = follow(child, &self.ids)?;
            if target.tag == "texture" {
                self.warn(element, format_args!("the texture \"{kind}\" is not known: the one inside is used"));
                return self.nested(target, |reader| reader.texture_object(target));
            }
            if matches!(target.tag.as_str(), "rgb" | "srgb" | "spectrum") {
                sum += Vec3::from_array(color::read(target, Use::Reflectance)?);
                count += 1.0;
            }
        }
        let mean = if count > 0.0 { (sum / count).to_array() } else { [0.5; 3] };
        let told = if count > 0.0 { "the mean of its colours" } else { "the constant 0.5" };
        self.warn(element, format_args!("the texture \"{kind}\" is not known: {told} is used"));
        Ok(TextureFile::rgb(mean))
    }

    /// A texture times a number or colour.
    fn scaled(&mut self, element: &'a Element) -> Result<TextureFile> {
        let object = Object::new(element, &self.ids, &["scale"], &["texture"])?;
        let factor = Vec3::from_array(object.color_for("scale", Use::Index)?.unwrap_or([1.0; 3]));
        let missing = || element.malformed("a scaled texture needs a texture inside");
        let inner = object.single("texture")?.ok_or_else(missing)?;
        let times = |color: [f32; 3]| (Vec3::from_array(color) * factor).to_array();
        Ok(match self.nested(inner, |reader| reader.texture_object(inner))? {
            TextureFile::Rgb { value } => TextureFile::rgb(times(value)),
            TextureFile::Checkerboard { color0, color1, to_uv } => {
                TextureFile::Checkerboard { color0: times(color0), color1: times(color1), to_uv }
            }
            TextureFile::Attribute { name, scale } => {
                if factor != Vec3::splat(factor.x) {
                    self.warn(element, "a coloured scale: the mean of its channels is used");
                }
                TextureFile::Attribute { name, scale: scale * factor.element_sum() / 3.0 }
            }
            TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } => {
                if factor != Vec3::splat(factor.x) {
                    self.warn(element, "a coloured scale: the mean of its channels is used");
                }
                let scale = scale * factor.element_sum() / 3.0;
                TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter }
            }
        })
    }

    fn bitmap(&mut self, element: &'a Element) -> Result<TextureFile> {
        // How a picture is kept in memory does not change its values.
        let known =
            ["filename", "raw", "to_uv", "filter_type", "wrap_mode", "wrap_mode_u", "wrap_mode_v", "format", "accel"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        let filter = match object.string("filter_type")?.unwrap_or("bilinear") {
            "bilinear" => Filter::Bilinear,
            "nearest" => Filter::Nearest,
            old @ ("trilinear" | "ewa") => {
                self.warn(element, format_args!("filter_type bilinear is used instead of \"{old}\""));
                Filter::Bilinear
            }
            other => {
                refuse_slip(element, "filter_type", other, &["bilinear", "nearest", "trilinear", "ewa"])?;
                self.warn(element, format_args!("filter_type bilinear is used instead of \"{other}\""));
                Filter::Bilinear
            }
        };
        let both = object.string("wrap_mode")?;
        let axis = |name: &str| -> Result<&str> { Ok(object.string(name)?.or(both).unwrap_or("repeat")) };
        let (u, v) = (axis("wrap_mode_u")?, axis("wrap_mode_v")?);
        if u != v {
            self.warn(element, format_args!("wrap_mode \"{u}\" is used in both directions"));
        }
        let wrap = match u {
            "repeat" => Wrap::Repeat,
            "mirror" => Wrap::Mirror,
            "clamp" => Wrap::Clamp,
            old @ ("zero" | "one") => {
                self.warn(element, format_args!("wrap_mode clamp is used instead of \"{old}\""));
                Wrap::Clamp
            }
            other => {
                refuse_slip(element, "wrap_mode", other, &["repeat", "mirror", "clamp", "zero", "one"])?;
                self.warn(element, format_args!("wrap_mode repeat is used instead of \"{other}\""));
                Wrap::Repeat
            }
        };
        let file = self.located(object.required_string("filename")?);
        self.places.set_picture(&file, element.place.clone());
        Ok(TextureFile::Bitmap {
            file,
            to_uv: to_uv(&object)?,
            raw: object.boolean("raw")?.unwrap_or(false),
            scale: 1.0,
            wrap,
            filter,
        })
    }
}

/// Refuses a word that is nearly one of `known`.
fn refuse_slip(element: &Element, name: &str, word: &str, known: &[&str]) -> Result<()> {
    match meant(word, known) {
        Some(near) => Err(element.malformed(format!("{name} is \"{word}\"; \"{near}\" seems to be meant"))),
        None => Ok(()),
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
