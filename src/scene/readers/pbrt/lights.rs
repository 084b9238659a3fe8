//! Lights that are not environments.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use crate::base::{Error, Result};
use crate::materials::texture::luminance;
use crate::scene::file::{Filter, LightFile, TextureFile, Wrap, identity3};
use crate::scene::readers::frames::{facing, rounded};
use crate::scene::readers::mean;
use crate::scene::readers::spectrum::Use;
use crate::scene::readers::textures::upside_down;

use super::Reader;
use super::parameters::Parameters;
use super::state::AreaLight;

const KINDS: &str = "point, spot, goniometric, projection, distant, infinite";

impl Reader {
    /// A light source.
    pub(super) fn light(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        // How light is sampled, and the times at which it shines, do not change the picture.
        parameters.ignore(&["samples", "nsamples"]);
        match kind {
            "point" => self.point(parameters),
            "spot" => self.spot(parameters),
            "goniometric" => self.goniometric(parameters),
            "projection" => self.projection(parameters),
            "distant" => self.distant(parameters),
            "infinite" | "exinfinite" => self.infinite(parameters),
            other => {
                let (place, what) = (parameters.place.clone(), format!("the light \"{other}\""));
                Err(Error::Unsupported { place, what, supported: KINDS.to_owned() })
            }
        }
    }

    /// The colour `name` of a light times its scale.
    pub(super) fn emitted(&self, parameters: &Parameters, name: &'static str) -> Result<Vec3> {
        let palette = self.palette(parameters);
        let color = parameters.find(name).map_or(Ok([1.0; 3]), |found| palette.color(found, Use::Light))?;
        // v3's scale may be a colour.
        let scale = parameters.find("scale").map_or(Ok([1.0; 3]), |found| palette.color(found, Use::Index))?;
        Ok(Vec3::from_array(color) * Vec3::from_array(scale))
    }

    /// Factor by which a light that would have the luminous power (or the like) `own` for luminance 1 has what is asked for.
    pub(super) fn photometric(&self, parameters: &Parameters, name: &'static str, own: f64) -> Result<f32> {
        let asked = parameters.float(name)?.filter(|asked| *asked > 0.0);
        Ok(asked.map_or(1.0, |asked| asked / own) as f32)
    }

    /// Adds a light.
    pub(super) fn add_light(&mut self, parameters: &Parameters, light: LightFile) {
        self.places.set(format!("lights[{}]", self.file.lights.len()), parameters.place.clone());
        self.file.lights.push(light);
    }

    fn point(&mut self, parameters: &Parameters) -> Result<()> {
        let intensity = self.emitted(parameters, "I")? * self.photometric(parameters, "power", 4.0 * PI)?;
        let from = parameters.vector("from")?.unwrap_or(DVec3::ZERO);
        self.add_point(parameters, from, intensity);
        Ok(())
    }

    fn add_point(&mut self, parameters: &Parameters, from: DVec3, intensity: Vec3) {
        let position = self.state.transform.transform_point3(from).as_vec3().to_array();
        self.add_light(parameters, LightFile::Point { position, intensity: intensity.to_array() });
    }

    fn spot(&mut self, parameters: &Parameters) -> Result<()> {
        let cutoff = parameters.float_or("coneangle", 30.0)?;
        let beam = (cutoff - parameters.float_or("conedeltaangle", 5.0)?).clamp(0.0, cutoff.max(0.0));
        let [end, start] = [cutoff, beam].map(|angle| angle.to_radians().cos());
        let cone = 2.0 * PI * ((1.0 - start) + (start - end) / 2.0);
        let intensity = self.emitted(parameters, "I")? * self.photometric(parameters, "power", cone)?;
        let from = parameters.vector("from")?.unwrap_or(DVec3::ZERO);
        let to = parameters.vector("to")?.unwrap_or(DVec3::Z);
        if beam < cutoff {
            self.warn(&parameters.place, "the edge of a spot falls off linearly");
        }
        self.add_spot(parameters, [from, to], intensity, [cutoff, beam])
    }

    fn add_spot(
        &mut self,
        parameters: &Parameters,
        [from, to]: [DVec3; 2],
        intensity: Vec3,
        [cutoff, beam]: [f64; 2],
    ) -> Result<()> {
        let undirected = || parameters.malformed("the light has no direction: from and to are the same");
        let direction = (to - from).try_normalize().ok_or_else(undirected)?;
        let to_world = self.state.transform * facing(from, direction);
        let light = LightFile::Spot {
            to_world: rounded(to_world),
            intensity: intensity.to_array(),
            cutoff_angle: cutoff as f32,
            beam_width: beam as f32,
        };
        self.add_light(parameters, light);
        Ok(())
    }

    fn distant(&mut self, parameters: &Parameters) -> Result<()> {
        let irradiance = self.emitted(parameters, "L")? * self.photometric(parameters, "illuminance", 1.0)?;
        let from = parameters.vector("from")?.unwrap_or(DVec3::ZERO);
        let to = parameters.vector("to")?.unwrap_or(DVec3::Z);
        let direction = self.state.transform.transform_vector3(to - from).normalize_or_zero().as_vec3().to_array();
        self.add_light(parameters, LightFile::Directional { direction, irradiance: irradiance.to_array() });
        Ok(())
    }

    /// A light whose directions have a picture: a point with the picture's mean.
    fn goniometric(&mut self, parameters: &Parameters) -> Result<()> {
        let mean = self.mean_of_picture(parameters)?;
        self.warn(&parameters.place, "a goniometric light is read as a point of the same mean");
        let own = 4.0 * PI * f64::from(mean.element_sum() / 3.0).max(1e-9);
        let intensity = self.emitted(parameters, "I")? * mean * self.photometric(parameters, "power", own)?;
        self.add_point(parameters, DVec3::ZERO, intensity);
        Ok(())
    }

    /// The mean of the picture `filename` (`mapname` in v3); white without one.
    fn mean_of_picture(&mut self, parameters: &Parameters) -> Result<Vec3> {
        let Some(picture) = self.light_picture(parameters, Filter::Bilinear)? else { return Ok(Vec3::ONE) };
        let mean = mean::mean(&picture, &self.folder, &parameters.place, &self.held.pictures, &mut self.absent)?;
        Ok(Vec3::from_array(mean))
    }

    /// The picture `filename` (`mapname` in v3) of a light.
    pub(super) fn light_picture(&mut self, parameters: &Parameters, filter: Filter) -> Result<Option<TextureFile>> {
        let Some(name) = parameters.string("filename")?.or(parameters.string("mapname")?) else { return Ok(None) };
        let file = self.locate(name);
        self.places.set_picture(&file, parameters.place.clone());
        let (to_uv, wrap) = (identity3(), Wrap::Clamp);
        Ok(Some(TextureFile::Bitmap { file, to_uv, raw: false, scale: 1.0, wrap, filter }))
    }

    /// The light of the shapes that follow.
    pub(super) fn area_light(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        if !["diffuse", "area"].contains(&kind) {
            let (place, what) = (parameters.place.clone(), format!("the area light \"{kind}\""));
            return Err(Error::Unsupported { place, what, supported: "diffuse".to_owned() });
        }
        parameters.ignore(&["samples", "nsamples"]);
        let mut radiance = self.emitted(parameters, "L")?;
        // v counts from the picture's bottom.
        let picture = self.light_picture(parameters, Filter::Bilinear)?.map(upside_down);
        let two_sided = parameters.boolean("twosided")?.unwrap_or(false);
        let power = parameters.float("power")?.filter(|power| *power > 0.0);
        if picture.is_some() && power.is_some() {
            // As if the picture were spread evenly over the light.
            radiance /= luminance(self.mean_of_picture(parameters)?).max(1e-9);
        }
        self.state.light = Some(AreaLight { radiance: radiance.to_array(), picture, two_sided, power });
        Ok(())
    }
}
