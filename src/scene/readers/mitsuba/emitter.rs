//! Emitters.

use std::f64::consts::PI;

use glam::{DMat4, DVec3};

use crate::base::Result;
use crate::picture::read_texels;
use crate::scene::file::{LightFile, ProfileFile, TextureFile};
use crate::scene::readers::frames::rounded;
use crate::scene::readers::missing::is_absent;
use crate::scene::readers::path;
use crate::scene::readers::spectrum::Use;
use crate::scene::readers::textures::{is_even, turned};

use super::Reader;
use super::element::Element;
use super::object::{Object, kind, refuse_slip_of_kind};
use super::sensor::horizontal_fov;
use super::upgrade::OLD_SUNSKY;

const KINDS: [&str; 10] =
    ["area", "point", "spot", "directional", "projector", "constant", "envmap", "sunsky", "sky", "sun"];
/// Half angle in degrees below which a spot has a picture: one that is wider has none to the side.
const WIDEST_PICTURE: f32 = 89.5;

impl<'a> Reader<'a> {
    /// The radiance of a shape's emitter, and a factor on it.
    pub(super) fn area_light(&mut self, element: &'a Element) -> Result<Option<([f32; 3], Option<TextureFile>)>> {
        if kind(element)? != "area" {
            refuse_slip_of_kind(element, &["area"])?;
            self.warn(element, format_args!("the emitter \"{}\" inside a shape is left out", kind(element)?));
            return Ok(None);
        }
        let object = Object::new(element, &self.ids, &["radiance", "sampling_weight"], &[])?;
        Ok(Some(match object.property("radiance") {
            Some(texture) if texture.tag == "texture" => ([1.0; 3], Some(self.texture_object(texture)?)),
            _ => (object.color_for("radiance", Use::Light)?.unwrap_or([1.0; 3]), None),
        }))
    }

    pub(super) fn emitter(&mut self, element: &'a Element) -> Result<()> {
        let light = match kind(element)? {
            "point" => self.point(element)?,
            "spot" => self.spot(element)?,
            "directional" => self.directional(element)?,
            "projector" => self.projector(element)?,
            "constant" => {
                let object = Object::new(element, &self.ids, &["radiance", "sampling_weight"], &[])?;
                LightFile::Constant { radiance: object.color_for("radiance", Use::Light)?.unwrap_or([1.0; 3]) }
            }
            "envmap" => self.envmap(element)?,
            "sunsky" | OLD_SUNSKY | "sky" | "sun" => return self.daylight(element),
            "area" => return Err(element.unsupported("emitter \"area\" outside of a shape", &KINDS)),
            other => {
                refuse_slip_of_kind(element, &KINDS)?;
                self.warn(element, format_args!("the emitter \"{other}\" is left out"));
                return Ok(());
            }
        };
        self.add_light(element, light);
        Ok(())
    }

    /// Adds the light that `element` describes to the scene.
    pub(super) fn add_light(&mut self, element: &Element, light: LightFile) {
        self.places.set(format!("lights[{}]", self.file.lights.len()), element.place.clone());
        self.file.lights.push(light);
    }

    fn point(&self, element: &'a Element) -> Result<LightFile> {
        let object = Object::new(element, &self.ids, &["position", "to_world", "intensity", "sampling_weight"], &[])?;
        let position = match (object.vector("position")?, object.transform("to_world")?) {
            (Some(_), Some(_)) => return Err(element.malformed("position and to_world exclude each other")),
            (Some(position), None) => DVec3::from_array(position),
            (None, to_world) => to_world.unwrap_or(DMat4::IDENTITY).transform_point3(DVec3::ZERO),
        };
        let intensity = object.color_for("intensity", Use::Light)?.unwrap_or([1.0; 3]);
        Ok(LightFile::Point { position: position.as_vec3().to_array(), intensity })
    }

    fn spot(&mut self, element: &'a Element) -> Result<LightFile> {
        let known = ["to_world", "intensity", "cutoff_angle", "beam_width", "texture", "sampling_weight"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        let cutoff = object.float("cutoff_angle")?.unwrap_or(20.0);
        let (cutoff_angle, to_world) = (cutoff as f32, object.to_world()?);
        let beam_width = object.float("beam_width")?.unwrap_or(cutoff * 0.75) as f32;
        let mut intensity = object.color_for("intensity", Use::Light)?.unwrap_or([1.0; 3]);
        if let Some(property) = object.property("texture") {
            let texture = self.light_texture(&object, "texture")?;
            if !is_even(&texture) && cutoff_angle < WIDEST_PICTURE {
                let profile = ProfileFile::Cone { beam_width };
                // The picture's coordinates grow along x and y, a projector's against them.
                let texture = turned(texture);
                return Ok(LightFile::Projector {
                    to_world,
                    fov: 2.0 * cutoff_angle,
                    aspect: 1.0,
                    intensity,
                    texture,
                    profile,
                });
            }
            let mean = self.mean(&texture, property, "the texture of a spot this wide")?;
            intensity = [0, 1, 2].map(|i| intensity[i] * mean[i]);
        }
        Ok(LightFile::Spot { to_world, intensity, cutoff_angle, beam_width })
    }

    fn directional(&self, element: &'a Element) -> Result<LightFile> {
        let object = Object::new(element, &self.ids, &["direction", "to_world", "irradiance", "sampling_weight"], &[])?;
        let direction = match (object.vector("direction")?, object.transform("to_world")?) {
            (Some(_), Some(_)) => return Err(element.malformed("direction and to_world exclude each other")),
            (Some(direction), None) => DVec3::from_array(direction),
            (None, to_world) => to_world.unwrap_or(DMat4::IDENTITY).transform_vector3(DVec3::Z),
        };
        let irradiance = object.color_for("irradiance", Use::Light)?.unwrap_or([1.0; 3]);
        Ok(LightFile::Directional { direction: direction.normalize_or_zero().as_vec3().to_array(), irradiance })
    }

    /// A picture through a perspective. On a plane across the axis, at a distance of 1, the irradiance is π times the picture's.
    fn projector(&mut self, element: &'a Element) -> Result<LightFile> {
        let known = ["irradiance", "scale", "to_world", "fov", "fov_axis", "focal_length", "sampling_weight"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        let texture = self.light_texture(&object, "irradiance")?;
        let size = match &texture {
            TextureFile::Bitmap { file, raw, .. } => self.picture_size(element, file, *raw)?,
            _ => [1; 2],
        };
        let aspect = size[0] as f64 / size[1].max(1) as f64;
        let to_world = object.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        // A scaled one is brighter in the same proportion.
        let scale = PI * object.float("scale")?.unwrap_or(1.0) * to_world.transform_vector3(DVec3::Z).length();
        Ok(LightFile::Projector {
            to_world: rounded(to_world),
            fov: horizontal_fov(&object, aspect)? as f32,
            aspect: aspect as f32,
            intensity: [scale as f32; 3],
            texture,
            profile: ProfileFile::Plane {},
        })
    }

    /// What a light shines with, white if it is not said.
    fn light_texture(&mut self, object: &Object<'a>, name: &str) -> Result<TextureFile> {
        match object.property(name) {
            Some(texture) if texture.tag == "texture" => match self.texture_object(texture)? {
                attribute @ TextureFile::Attribute { .. } => {
                    Ok(TextureFile::rgb(self.mean(&attribute, texture, name)?))
                }
                other => Ok(other),
            },
            _ => Ok(TextureFile::rgb(object.color_for(name, Use::Light)?.unwrap_or([1.0; 3]))),
        }
    }

    /// Columns and rows of a picture; of one that is missing, which grey replaces later, one of each.
    fn picture_size(&self, element: &Element, file: &str, raw: bool) -> Result<[usize; 2]> {
        if is_absent(&self.folder, file) {
            return Ok([1; 2]);
        }
        Ok(read_texels(&path::resolve(&self.folder, file, &element.place)?, raw)?.size())
    }

    fn envmap(&self, element: &'a Element) -> Result<LightFile> {
        // mis_compensation and sampling_weight only change how directions are drawn.
        let known = ["filename", "scale", "to_world", "mis_compensation", "sampling_weight"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        object.boolean("mis_compensation")?;
        Ok(LightFile::Envmap {
            file: self.located(object.required_string("filename")?),
            scale: object.float("scale")?.unwrap_or(1.0) as f32,
            to_world: object.to_world()?,
        })
    }
}
