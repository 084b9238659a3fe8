//! Lights that project a picture.

use glam::{DVec2, Vec3};

use crate::base::Result;
use crate::materials::texture::luminance;
use crate::picture::{Image, read_texels};
use crate::scene::file::{Filter, LightFile, ProfileFile, TextureFile};
use crate::scene::readers::frames::rounded;
use crate::scene::readers::missing::is_absent;
use crate::scene::readers::path;
use crate::scene::readers::textures::{mirrored, turned};

use super::Reader;
use super::parameters::Parameters;

impl Reader {
    /// A light that projects a picture. `fov` is the angle of its shorter side.
    pub(super) fn projection(&mut self, parameters: &Parameters) -> Result<()> {
        let filter = if self.old { Filter::Bilinear } else { Filter::Nearest };
        let texture = self.light_picture(parameters, filter)?;
        let image = match &texture {
            Some(TextureFile::Bitmap { file, .. }) if !is_absent(&self.folder, file) => {
                Some(read_texels(&path::resolve(&self.folder, file, &parameters.place)?, false)?.to_image())
            }
            _ => None,
        };
        let size = image.as_ref().map_or(DVec2::ONE, |image| DVec2::new(image.width as f64, image.height as f64));
        let fov = parameters.float_or("fov", 90.0)?;
        if !(fov > 0.0 && fov < 180.0) {
            return Err(parameters.malformed(format!("the fov is {fov}°, expected one between 0° and 180°")));
        }
        let half = (fov.to_radians() / 2.0).tan() * size / size.min_element();
        // Without a picture white is shown, and grey stands for one that is missing.
        let flat = if texture.is_some() { 0.5 } else { 1.0 };
        let even = || Image { width: 64, height: 64, pixels: vec![Vec3::splat(flat); 64 * 64] };
        let own = match (parameters.float("power")?, &image) {
            (None, _) => 1.0,
            (Some(_), Some(image)) => flux(image, half),
            (Some(_), None) => flux(&even(), half),
        };
        let intensity = self.emitted(parameters, "I")? * self.photometric(parameters, "power", own.max(1e-9))?;
        // Pictures stand upright in v4, on their heads in v3; both have +x to the right.
        let place = if self.old { turned } else { mirrored };
        let light = LightFile::Projector {
            to_world: rounded(self.state.transform),
            fov: (2.0 * half.x.atan()).to_degrees() as f32,
            aspect: (size.x / size.y) as f32,
            intensity: intensity.to_array(),
            texture: texture.map_or(TextureFile::rgb([1.0; 3]), place),
            profile: ProfileFile::Even {},
        };
        self.add_light(parameters, light);
        Ok(())
    }
}

/// Luminous flux of a picture whose half width and height at a distance of 1 are `half`: the sum over pixels of their luminance times
/// their solid angle.
fn flux(image: &Image, half: DVec2) -> f64 {
    let [columns, rows] = [image.width, image.height].map(|count| count as f64);
    let pixel = |(index, color): (usize, &Vec3)| {
        let at = DVec2::new((index % image.width) as f64 + 0.5, (index / image.width) as f64 + 0.5);
        let place = half * (2.0 * at / DVec2::new(columns, rows) - 1.0);
        f64::from(luminance(*color)) / (1.0 + place.length_squared()).powf(1.5)
    };
    let sum: f64 = image.pixels.iter().enumerate().map(pixel).sum();
    4.0 * half.x * half.y * sum / (columns * rows)
}
