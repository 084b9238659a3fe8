//! Emitters.

use std::f64::consts::PI;

use glam::{DMat4, DVec3};

use crate::base::Result;
use crate::scene::file::{FilmFile, FilterFile, LightFile, TextureFile};
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind, refuse_slip_of_kind};
use super::sensor::horizontal_fov;
use super::upgrade::OLD_SUNSKY;

const KINDS: [&str; 10] =
    ["area", "point", "spot", "directional", "projector", "constant", "envmap", "sunsky", "sky", "sun"];

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

    fn spot(&self, element: &'a Element) -> Result<LightFile> {
        let known = ["to_world", "intensity", "cutoff_angle", "beam_width", "sampling_weight"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        let cutoff = object.float("cutoff_angle")?.unwrap_or(20.0);
        Ok(LightFile::Spot {
            to_world: object.to_world()?,
            intensity: object.color_for("intensity", Use::Light)?.unwrap_or([1.0; 3]),
            cutoff_angle: cutoff as f32,
            beam_width: object.float("beam_width")?.unwrap_or(cutoff * 0.75) as f32,
        })
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

    /// A projector as a spot of its mean: where its picture ends there is no light, but between there is no picture.
    fn projector(&mut self, element: &'a Element) -> Result<LightFile> {
        let known = ["irradiance", "scale", "to_world", "fov", "fov_axis", "focal_length", "sampling_weight"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        self.warn(element, "the projector is read as a spot of the mean of its picture");
        let irradiance = self.mean_color(&object, "irradiance", Use::Light)?.unwrap_or([1.0; 3]);
        let scale = (PI * object.float("scale")?.unwrap_or(1.0)) as f32;
        let square = FilmFile { width: 1, height: 1, filter: FilterFile::default() };
        // Beyond 1° of the horizon a spot would shine backwards.
        let half = (0.5 * horizontal_fov(&object, &square)?).min(89.0) as f32;
        Ok(LightFile::Spot {
            to_world: object.to_world()?,
            intensity: irradiance.map(|channel| channel * scale),
            cutoff_angle: half,
            beam_width: half,
        })
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
