//! Light from all around: one colour, or a picture in the layout of pbrt-v4 or v3.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::base::{Place, Result};
use crate::materials::texture::luminance;
use crate::picture::{Image, read_texels};
use crate::scene::file::{IDENTITY, LightFile};
use crate::scene::readers::missing::is_absent;
use crate::scene::readers::path;

use super::Reader;
use super::octahedral::to_lat_long;
use super::parameters::Parameters;
use super::state::linear;

impl Reader {
    /// An infinite light.
    pub(super) fn infinite(&mut self, parameters: &Parameters) -> Result<()> {
        if parameters.find("portal").is_some() {
            self.warn(&parameters.place, "portals are left out: light comes from all directions");
        }
        match parameters.string("filename")?.or(parameters.string("mapname")?).map(str::to_owned) {
            Some(name) if !name.is_empty() => self.environment(parameters, &name),
            _ => {
                let radiance = self.emitted(parameters, "L")? * self.photometric(parameters, "illuminance", PI)?;
                self.add_light(parameters, LightFile::Constant { radiance: radiance.to_array() });
                Ok(())
            }
        }
    }

    fn environment(&mut self, parameters: &Parameters, name: &str) -> Result<()> {
        let place = &parameters.place;
        let color = self.emitted(parameters, "L")?;
        let file = self.locate(name);
        let to_world = orientation(&self.state.transform);
        if is_absent(&self.folder, &file) {
            let scale = color.element_sum() / 3.0;
            self.add_light(parameters, LightFile::Envmap { file, scale, to_world });
            return Ok(());
        }
        let texels = read_texels(&path::resolve(&self.folder, &file, place)?, false)?;
        let mut picture = texels.to_image();
        let mut key = file.clone();
        // v4 knows nothing but squares, v3 nothing but pictures twice as wide as high.
        if picture.width == picture.height && picture.width > 1 {
            key = format!("{file} (latitudes and longitudes)");
            if !self.held.pictures.contains_key(&key) {
                self.held.pictures.insert(key.clone(), Arc::new(to_lat_long(&picture)).into());
            }
            picture = self.held.pictures[&key].to_image();
        }
        if color != Vec3::splat(color.x) {
            key = format!("{key} (times {} {} {})", color.x, color.y, color.z);
            let pixels = picture.pixels.iter().map(|pixel| *pixel * color).collect();
            picture = Arc::new(Image { width: picture.width, height: picture.height, pixels });
        }
        let scale = if color == Vec3::splat(color.x) { color.x } else { 1.0 };
        let scale = scale * self.photometric(parameters, "illuminance", illuminance(&picture).max(1e-9))?;
        self.held.pictures.entry(key.clone()).or_insert(picture.into());
        self.add_light(parameters, LightFile::Envmap { file: key, scale, to_world });
        Ok(())
    }

    /// Makes one light of all environments: colours are added up, and added to a picture.
    pub(super) fn join_environments(&mut self) {
        let is_constant = |light: &LightFile| matches!(light, LightFile::Constant { .. });
        let is_picture = |light: &LightFile| matches!(light, LightFile::Envmap { .. });
        let (mut sum, mut constants, mut pictures, mut kept) = (Vec3::ZERO, 0, 0, Vec::new());
        let mut first: Option<(usize, Place)> = None;
        for (index, light) in std::mem::take(&mut self.file.lights).into_iter().enumerate() {
            let place = self.places.at(&format!("lights[{index}]"));
            if let LightFile::Constant { radiance } = light {
                sum += Vec3::from_array(radiance);
                constants += 1;
                if constants > 1 {
                    continue;
                }
            } else if is_picture(&light) {
                pictures += 1;
                if pictures > 1 {
                    self.warn(&place, "only the first of several environment pictures is used");
                    continue;
                }
                first = Some((kept.len(), place.clone()));
            }
            self.places.set(format!("lights[{}]", kept.len()), place);
            kept.push(light);
        }
        if let Some((at, place)) = first.filter(|_| constants > 0)
            && let LightFile::Envmap { file, scale, .. } = &mut kept[at]
            && let Some(texels) = self.held.pictures.get(file.as_str())
        {
            let key = format!("{file} (times {scale}, plus {} {} {})", sum.x, sum.y, sum.z);
            let image = texels.to_image();
            let pixels = image.pixels.iter().map(|pixel| *pixel * *scale + sum).collect();
            let image = Image { width: image.width, height: image.height, pixels };
            self.held.pictures.insert(key.clone(), Arc::new(image).into());
            (*file, *scale) = (key, 1.0);
            self.warn(&place, "light of one colour is added to the environment's picture");
        } else if pictures == 0 {
            let mut constants = kept.iter_mut().filter(|light| is_constant(light));
            if let Some(LightFile::Constant { radiance }) = constants.next() {
                *radiance = sum.to_array();
            }
            self.file.lights = kept;
            return;
        }
        let places: Vec<Place> = (0..kept.len()).map(|index| self.places.at(&format!("lights[{index}]"))).collect();
        for (light, place) in kept.into_iter().zip(places) {
            if pictures > 0 && is_constant(&light) {
                continue;
            }
            self.places.set(format!("lights[{}]", self.file.lights.len()), place);
            self.file.lights.push(light);
        }
    }
}

/// Rotation of our environment, whose +y is up, for one of pbrt, whose +z is: our columns run along atan2(x, −z), pbrt's along
/// atan2(y, x).
fn orientation(to_world: &DMat4) -> [f32; 16] {
    let turned = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::NEG_X);
    let rotation = linear(to_world) * turned;
    let mut matrix = IDENTITY;
    for (row, values) in [0, 1, 2].map(|row| rotation.row(row)).into_iter().enumerate() {
        matrix[4 * row..4 * row + 3].copy_from_slice(&values.to_array().map(|value| value as f32));
    }
    matrix
}

/// Illuminance of a surface that faces +z by a picture in latitudes and longitudes.
fn illuminance(image: &Image) -> f64 {
    let rows = (image.height.max(2) - 1) as f64;
    let row = |(y, pixels): (usize, &[Vec3])| {
        let (sin, cos) = (PI * y as f64 / rows).sin_cos();
        let sum: f64 = pixels.iter().map(|pixel| f64::from(luminance(*pixel))).sum();
        sum * sin * cos.max(0.0)
    };
    let sum: f64 = image.pixels.chunks(image.width.max(1)).enumerate().map(row).sum();
    sum * PI / rows * 2.0 * PI / image.width.max(1) as f64
}
