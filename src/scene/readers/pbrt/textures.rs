//! Textures, and parameters that may be textures.

use std::path::Path;

use glam::Vec3;

use crate::base::{Error, Place, Result};
use crate::materials::texture::luminance;
use crate::math::srgb;
use crate::scene::file::{Filter, TextureFile, Wrap};
use crate::scene::readers::mean;
use crate::scene::readers::slips::meant;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::parameters::{Parameter, Parameters};
use super::tokens::Tokens;

/// Values of textures that are made of noise: the mean of each.
const NOISE: [(&str, f32); 5] = [("fbm", 0.0), ("wrinkled", 0.5), ("windy", 0.5), ("marble", 0.35), ("ptex", 0.5)];

/// What a texture's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values {
    /// Numbers.
    Floats,
    /// Colours.
    Colors,
}

impl Reader {
    /// Keeps the texture that follows.
    pub(super) fn texture_directive(&mut self, tokens: &mut Tokens) -> Result<()> {
        let name = tokens.text("a texture's name")?;
        let values = match tokens.text("float or spectrum")?.as_str() {
            "float" => Values::Floats,
            "spectrum" | "color" => Values::Colors,
            other => {
                let (place, what) = (tokens.place(), format!("a texture of the type \"{other}\""));
                return Err(Error::Unsupported { place, what, supported: "float, spectrum".to_owned() });
            }
        };
        let class = tokens.text("a texture's kind")?;
        let mut parameters = self.parameters(format!("the texture \"{class}\""), tokens)?;
        if let Some(defaults) = self.state.defaults.get("texture") {
            parameters.add_defaults(defaults);
        }
        let texture = self.made(&class, &parameters, values)?;
        self.note_unused(&parameters);
        match values {
            Values::Floats => self.float_textures.insert(name, texture),
            Values::Colors => self.color_textures.insert(name, texture),
        };
        Ok(())
    }

    fn made(&mut self, class: &str, parameters: &Parameters, values: Values) -> Result<TextureFile> {
        let place = &parameters.place;
        match class {
            "constant" => self.part(parameters, "value", values, 1.0),
            "imagemap" => self.picture(parameters, values),
            "scale" => {
                let first = if parameters.has("tex1") { "tex1" } else { "tex" };
                let second = if parameters.has("tex2") { "tex2" } else { "scale" };
                let first = self.part(parameters, first, values, 1.0)?;
                let second = self.part(parameters, second, values, 1.0)?;
                self.product(first, second, place)
            }
            "mix" => {
                let ends = [self.part(parameters, "tex1", values, 0.0)?, self.part(parameters, "tex2", values, 1.0)?];
                let amount = self.part(parameters, "amount", Values::Floats, 0.5)?;
                self.mixture(ends, amount, place)
            }
            "directionmix" => {
                self.warn(place, "a directionmix is read as its first texture");
                parameters.ignore(&["tex2", "dir"]);
                self.part(parameters, "tex1", values, 0.0)
            }
            "checkerboard" => {
                if parameters.integer("dimension")?.is_some_and(|dimension| dimension != 2) {
                    self.warn(place, "a checkerboard in space is read as one over the texture coordinates");
                }
                parameters.ignore(&["aamode"]);
                let first = self.part(parameters, "tex1", values, 1.0)?;
                let second = self.part(parameters, "tex2", values, 0.0)?;
                let color0 = self.mean(&first, place, "a square")?;
                let color1 = self.mean(&second, place, "a square")?;
                // Squares are one unit wide, ours half of one.
                let to_uv = self.mapping(parameters, 0.5, false)?;
                Ok(TextureFile::Checkerboard { color0, color1, to_uv })
            }
            "dots" => {
                parameters.ignore(&["inside"]);
                self.warn(place, "dots are left out: what is between them is used");
                self.part(parameters, "outside", values, 0.0)
            }
            "bilerp" => {
                self.warn(place, "a bilerp texture is read as its mean");
                let mut sum = Vec3::ZERO;
                for (corner, default) in [("v00", 0.0), ("v01", 1.0), ("v10", 0.0), ("v11", 1.0)] {
                    let texture = self.part(parameters, corner, values, default)?;
                    sum += Vec3::from_array(self.mean(&texture, place, corner)?);
                }
                Ok(TextureFile::rgb((sum / 4.0).to_array()))
            }
            other => match NOISE.iter().find(|(name, _)| *name == other) {
                Some((_, mean)) => {
                    self.warn(place, format!("the texture \"{other}\" is read as its mean, about {mean}"));
                    parameters.ignore(&["octaves", "roughness", "scale", "variation", "filename", "encoding", "gamma"]);
                    Ok(TextureFile::rgb([*mean; 3]))
                }
                None => {
                    let (place, what) = (place.clone(), format!("the texture \"{other}\""));
                    let known = "constant, imagemap, scale, mix, directionmix, checkerboard, dots, bilerp";
                    let noise = NOISE.map(|(name, _)| name).join(", ");
                    Err(Error::Unsupported { place, what, supported: format!("{known}, {noise}") })
                }
            },
        }
    }

    fn part(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
        values: Values,
        default: f32,
    ) -> Result<TextureFile> {
        Ok(self.texture(parameters, name, values)?.unwrap_or(TextureFile::rgb([default; 3])))
    }

    /// A parameter that may be a texture. One that is not there is as if it were not given in v3.
    pub(super) fn texture(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
        values: Values,
    ) -> Result<Option<TextureFile>> {
        let Some(parameter) = parameters.find(name) else { return Ok(None) };
        if parameter.kind == "texture" {
            return match self.texture_named(parameter.text()?, values) {
                Ok(texture) => Ok(Some(texture)),
                Err(why) if self.old => {
                    self.warn(&parameter.place, format!("{why}: the default of \"{name}\" is used"));
                    Ok(None)
                }
                Err(why) => {
                    self.lacks_textures = true;
                    Err(parameter.malformed(why))
                }
            };
        }
        let color = match values {
            Values::Floats if parameter.kind == "float" => match parameter.numbers()? {
                [number] => [*number as f32; 3],
                _ => return Err(parameter.expected("one number")),
            },
            _ => self.palette(parameters).color(parameter, Use::Index)?,
        };
        Ok(Some(TextureFile::rgb(color)))
    }

    /// The texture of this name, or what there is instead.
    fn texture_named(&self, name: &str, values: Values) -> Result<TextureFile, String> {
        let (own, other) = match values {
            Values::Floats => (&self.float_textures, &self.color_textures),
            Values::Colors => (&self.color_textures, &self.float_textures),
        };
        let missing = || {
            let names: Vec<&str> = own.keys().chain(other.keys()).map(String::as_str).collect();
            let slip = meant(name, &names).map(|near| format!("; \"{near}\" seems to be meant")).unwrap_or_default();
            format!("there is no texture \"{name}\"{slip}")
        };
        own.get(name).or_else(|| other.get(name)).cloned().ok_or_else(missing)
    }

    /// A reflectance or the like, within [0, 1].
    pub(super) fn albedo(&mut self, parameters: &Parameters, name: &'static str, default: f32) -> Result<TextureFile> {
        Ok(self.given_albedo(parameters, name)?.unwrap_or(TextureFile::rgb([default; 3])))
    }

    /// A reflectance or the like, within [0, 1], if it is given.
    pub(super) fn given_albedo(&mut self, parameters: &Parameters, name: &'static str) -> Result<Option<TextureFile>> {
        let spectrum = parameters.find(name).filter(|parameter| parameter.kind != "texture");
        if let Some(parameter) = spectrum {
            let color = self.palette(parameters).color(parameter, Use::Reflectance)?;
            return Ok(Some(within(TextureFile::rgb(color))));
        }
        match self.texture(parameters, name, Values::Colors)? {
            // v4 bounds every colour of a picture, v3 only below.
            Some(picture @ TextureFile::Bitmap { scale, .. }) if scale > 1.0 && !self.old => {
                let bounded = |color: Vec3| color.clamp(Vec3::ZERO, Vec3::ONE);
                self.changed(picture, "within 1", &parameters.place, bounded).map(Some)
            }
            texture => Ok(texture.map(within)),
        }
    }

    /// A number; of a texture the mean.
    pub(super) fn number(&mut self, parameters: &Parameters, name: &'static str) -> Result<Option<f32>> {
        match self.texture(parameters, name, Values::Floats)? {
            None => Ok(None),
            Some(texture) => Ok(Some(luminance(self.mean(&texture, &parameters.place, name)?.into()))),
        }
    }

    /// The mean of a texture where only one value can be used, with a warning.
    pub(super) fn mean(&mut self, texture: &TextureFile, place: &Place, name: &str) -> Result<[f32; 3]> {
        if !matches!(texture, TextureFile::Rgb { .. }) {
            self.warn(place, format!("{name} cannot vary: the mean of its texture is used"));
        }
        mean::mean(texture, &self.folder, place, &self.held.pictures, &mut self.absent)
    }

    fn picture(&mut self, parameters: &Parameters, values: Values) -> Result<TextureFile> {
        let place = &parameters.place;
        let name =
            parameters.string("filename")?.ok_or_else(|| parameters.malformed("an imagemap needs a filename"))?;
        let file = self.locate(name);
        self.places.set_picture(&file, place.clone());
        let filter = match parameters.string("filter")?.unwrap_or("bilinear") {
            "point" => Filter::Nearest,
            _ => Filter::Bilinear,
        };
        parameters.ignore(&["maxanisotropy", "trilinear"]);
        let wrap = match parameters.string("wrap")?.unwrap_or("repeat") {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            other => {
                self.warn(place, format!("the wrap mode \"{other}\" is read as \"clamp\""));
                Wrap::Clamp
            }
        };
        // v4 takes the bytes of other files than PNG for sRGB, whatever is said.
        let encoding =
            parameters.string("encoding")?.filter(|_| self.old || has_extension(name, &["png"])).unwrap_or("sRGB");
        let gamma = encoding.strip_prefix("gamma").and_then(|number| number.trim().parse::<f32>().ok());
        let gamma = gamma.filter(|gamma| gamma.is_finite() && *gamma > 0.0);
        let raw = match encoding {
            _ if gamma.is_some() => true,
            "linear" => true,
            // v3 looks for a truth of that name; exporters write numbers, too.
            "sRGB" | "srgb" => {
                let gamma = parameters.find("gamma").filter(|gamma| gamma.kind == "bool");
                gamma.map(Parameter::truth).transpose()? == Some(false)
            }
            other => {
                self.warn(place, format!("the encoding \"{other}\" is read as \"sRGB\""));
                false
            }
        };
        let scale = parameters.float_or("scale", 1.0)? as f32;
        let to_uv = self.mapping(parameters, 1.0, true)?;
        let alpha = match values {
            Values::Floats if !self.old => {
                let linear = |alpha: Vec3| match gamma {
                    Some(gamma) => alpha.powf(gamma),
                    None if raw => alpha,
                    None => alpha.map(srgb::linear),
                };
                self.alpha(&file, encoding, place, linear)?
            }
            _ => None,
        };
        let is_alpha = alpha.is_some();
        let mut picture = match alpha {
            Some(file) => TextureFile::Bitmap { file, to_uv, raw: false, scale: 1.0, wrap, filter },
            None => TextureFile::Bitmap { file, to_uv, raw, scale: 1.0, wrap, filter },
        };
        // Float formats hold light as it is, whatever the encoding.
        if let Some(gamma) =
            gamma.filter(|gamma| *gamma != 1.0 && !is_alpha && !has_extension(name, &["exr", "hdr", "pfm"]))
        {
            let power = |color: Vec3| color.max(Vec3::ZERO).powf(gamma);
            picture = self.baked(picture, &format!("to the power of {gamma}"), place, power)?;
        }
        if parameters.boolean("invert")?.unwrap_or(false) {
            return self.baked(picture, &format!("inverted, scale {scale}"), place, |color| {
                (Vec3::ONE - color * scale).max(Vec3::ZERO)
            });
        }
        self.product(picture, TextureFile::rgb([scale; 3]), place)
    }

    /// Texture coordinates to those of a picture, whose v runs downwards if `flip`, or of a board.
    fn mapping(&mut self, parameters: &Parameters, unit: f64, flip: bool) -> Result<[f32; 9]> {
        let mapping = parameters.string("mapping")?.unwrap_or("uv");
        if mapping != "uv" {
            self.warn(
                &parameters.place,
                format!("the mapping \"{mapping}\" is left out: texture coordinates are used"),
            );
            parameters.ignore(&["v1", "v2"]);
        }
        let number = |name, default| parameters.float_or(name, default);
        let (us, vs) = (unit * number("uscale", 1.0)?, unit * number("vscale", 1.0)?);
        let (ud, vd) = (unit * number("udelta", 0.0)?, unit * number("vdelta", 0.0)?);
        let (vs, vd) = if flip { (-vs, 1.0 - vd) } else { (vs, vd) };
        Ok([us, 0.0, ud, 0.0, vs, vd, 0.0, 0.0, 1.0].map(|value| value as f32 + 0.0))
    }
}

/// Whether a picture's name is that of a format of linear floats.
fn has_extension(name: &str, known: &[&str]) -> bool {
    let extension = Path::new(name).extension().unwrap_or_default();
    known.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// The texture with its own colours within [0, 1], as pbrt has reflectances.
pub fn within(texture: TextureFile) -> TextureFile {
    let clamp = |color: [f32; 3]| color.map(|channel| channel.clamp(0.0, 1.0));
    match texture {
        TextureFile::Rgb { value } => TextureFile::Rgb { value: clamp(value) },
        TextureFile::Checkerboard { color0, color1, to_uv } => {
            TextureFile::Checkerboard { color0: clamp(color0), color1: clamp(color1), to_uv }
        }
        TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } => {
            TextureFile::Bitmap { file, to_uv, raw, scale: scale.max(0.0), wrap, filter }
        }
        attribute @ TextureFile::Attribute { .. } => attribute,
    }
}
