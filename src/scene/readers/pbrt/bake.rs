//! Textures made of others: of constants and boards by arithmetic, of one picture as another picture in memory.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use crate::base::files::read_bytes;
use crate::base::{Place, Result};
use crate::materials::texture::luminance;
use crate::picture::{Image, LARGEST_FILE, read_samples, read_texels};
use crate::scene::file::TextureFile;
use crate::scene::readers::missing::is_absent;
use crate::scene::readers::{image_key, path};

use super::Reader;

/// Most pixels of pictures made of others.
const MOST_PIXELS: usize = 1 << 28;

impl Reader {
    /// One texture times another.
    pub(super) fn product(&mut self, a: TextureFile, b: TextureFile, place: &Place) -> Result<TextureFile> {
        let (factor, texture) = match (a, b) {
            (TextureFile::Rgb { value }, other) | (other, TextureFile::Rgb { value }) => {
                (Vec3::from_array(value), other)
            }
            (a, b) => {
                let mean = self.mean(&b, place, "the second texture of a product")?;
                (Vec3::from_array(mean), a)
            }
        };
        match texture {
            TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } if factor == Vec3::splat(factor.x) => {
                Ok(TextureFile::Bitmap { file, to_uv, raw, scale: scale * factor.x, wrap, filter })
            }
            texture => {
                let mark = format!("times {} {} {}", factor.x, factor.y, factor.z);
                self.changed(texture, &mark, place, |color| color * factor)
            }
        }
    }

    /// (1 − amount) of the first and `amount` of the second texture.
    pub(super) fn mixture(
        &mut self,
        [first, second]: [TextureFile; 2],
        amount: TextureFile,
        place: &Place,
    ) -> Result<TextureFile> {
        let between = |a: [f32; 3], b: [f32; 3], part: f32| Vec3::from_array(a).lerp(b.into(), part).to_array();
        let is_picture = |texture: &TextureFile| matches!(texture, TextureFile::Bitmap { .. });
        if let TextureFile::Rgb { value: [part, ..] } = amount {
            return match (first, second) {
                (first, _) if part == 0.0 => Ok(first),
                (_, second) if part == 1.0 => Ok(second),
                (picture, TextureFile::Rgb { value }) if is_picture(&picture) => {
                    self.blended(picture, value, part, place)
                }
                (TextureFile::Rgb { value }, picture) if is_picture(&picture) => {
                    self.blended(picture, value, 1.0 - part, place)
                }
                (TextureFile::Checkerboard { color0, color1, to_uv }, TextureFile::Rgb { value }) => {
                    let [color0, color1] = [color0, color1].map(|color| between(color, value, part));
                    Ok(TextureFile::Checkerboard { color0, color1, to_uv })
                }
                (TextureFile::Rgb { value }, TextureFile::Checkerboard { color0, color1, to_uv }) => {
                    let [color0, color1] = [color0, color1].map(|color| between(value, color, part));
                    Ok(TextureFile::Checkerboard { color0, color1, to_uv })
                }
                (TextureFile::Rgb { value: a }, TextureFile::Rgb { value: b }) => {
                    Ok(TextureFile::rgb(between(a, b, part)))
                }
                (first, second) => {
                    let b = self.mean(&second, place, "the second texture of a mixture")?;
                    self.mixture([first, TextureFile::rgb(b)], TextureFile::rgb([part; 3]), place)
                }
            };
        }
        let a = self.mean(&first, place, "a texture mixed by another")?;
        let b = self.mean(&second, place, "a texture mixed by another")?;
        match amount {
            TextureFile::Checkerboard { color0, color1, to_uv } => {
                let [color0, color1] = [color0, color1].map(|part| between(a, b, luminance(part.into())));
                Ok(TextureFile::Checkerboard { color0, color1, to_uv })
            }
            TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } => {
                let picture = TextureFile::Bitmap { file, to_uv, raw, scale: 1.0, wrap, filter };
                let mark = format!("from {a:?} to {b:?}, scale {scale}");
                let color = |part| Vec3::from_array(between(a, b, (luminance(part) * scale).clamp(0.0, 1.0)));
                self.baked(picture, &mark, place, color)
            }
            TextureFile::Rgb { .. } | TextureFile::Attribute { .. } => Ok(first),
        }
    }

    /// (1 − part) of a picture and `part` of a colour.
    fn blended(&mut self, picture: TextureFile, color: [f32; 3], part: f32, place: &Place) -> Result<TextureFile> {
        let TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } = picture else { return Ok(picture) };
        let picture = TextureFile::Bitmap { file, to_uv, raw, scale: 1.0, wrap, filter };
        let mark = format!("times {}, plus {part} of {color:?}", scale * (1.0 - part));
        let color = Vec3::from_array(color);
        self.baked(picture, &mark, place, |pixel| (pixel * scale).lerp(color, part))
    }

    /// The texture with every colour of it changed.
    pub(super) fn changed(
        &mut self,
        texture: TextureFile,
        mark: &str,
        place: &Place,
        change: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Result<TextureFile> {
        let color = |color: [f32; 3]| change(Vec3::from_array(color)).to_array();
        match texture {
            TextureFile::Rgb { value } => Ok(TextureFile::rgb(color(value))),
            TextureFile::Checkerboard { color0, color1, to_uv } => {
                Ok(TextureFile::Checkerboard { color0: color(color0), color1: color(color1), to_uv })
            }
            TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } => {
                let picture = TextureFile::Bitmap { file, to_uv, raw, scale: 1.0, wrap, filter };
                self.baked(picture, &format!("{mark}, scale {scale}"), place, |pixel| change(pixel * scale))
            }
            attribute @ TextureFile::Attribute { .. } => Ok(attribute),
        }
    }

    /// The key of a picture made of another one's alpha, which pbrt-v4 takes for the numbers of a PNG file that has any
    /// (`MIPMap::Bilerp<Float>` in its mipmap.cpp), decoded by `linear` as its colours are; none where the file is opaque.
    pub(super) fn alpha(
        &mut self,
        file: &str,
        mark: &str,
        place: &Place,
        linear: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Result<Option<String>> {
        let name = format!("{file} (alpha, {mark})");
        if self.held.pictures.contains_key(&name) {
            return Ok(Some(name));
        }
        if is_absent(&self.folder, file) {
            return Ok(None);
        }
        let path = path::resolve(&self.folder, file, place)?;
        let bytes = read_bytes(&path, LARGEST_FILE)?;
        if !bytes.starts_with(b"\x89PNG") {
            return Ok(None);
        }
        let samples = read_samples(&Place::file(&path), &bytes)?;
        if !samples.has_alpha() {
            return Ok(None);
        }
        let alpha = samples.channel(3, |value| value).to_image();
        if alpha.pixels.iter().all(|alpha| *alpha == Vec3::ONE) || !self.has_room([alpha.width, alpha.height], place) {
            return Ok(None);
        }
        let pixels = alpha.pixels.par_iter().map(|alpha| linear(*alpha)).collect();
        let image = Image { width: alpha.width, height: alpha.height, pixels };
        self.held.pictures.insert(name.clone(), Arc::new(image).into());
        Ok(Some(name))
    }

    /// Whether another picture of this size may be made; it counts then.
    fn has_room(&mut self, [width, height]: [usize; 2], place: &Place) -> bool {
        let fits = self.baked + width * height <= MOST_PIXELS;
        if fits {
            self.baked += width * height;
        } else {
            self.warn(place, "there is no room for another picture made of one: that one is used");
        }
        fits
    }

    /// The picture with every pixel changed. One that is not there stays as it is, to be told of with the others.
    pub(super) fn baked(
        &mut self,
        picture: TextureFile,
        mark: &str,
        place: &Place,
        change: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Result<TextureFile> {
        let TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } = picture else { return Ok(picture) };
        let key = image_key(&file, raw);
        let name = format!("{key} ({mark})");
        let made = |file| TextureFile::Bitmap { file, to_uv, raw: false, scale: 1.0, wrap, filter };
        let unchanged = |file| TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter };
        if self.held.pictures.contains_key(&name) {
            return Ok(made(name));
        }
        let texels = match self.held.pictures.get(&key) {
            Some(texels) => texels.clone(),
            None if is_absent(&self.folder, &file) => return Ok(unchanged(file)),
            None => read_texels(&path::resolve(&self.folder, &file, place)?, raw)?,
        };
        let [width, height] = texels.size();
        if !self.has_room([width, height], place) {
            return Ok(unchanged(file));
        }
        let image = texels.to_image();
        let pixels = image.pixels.par_iter().map(|pixel| change(*pixel * scale)).collect();
        self.held.pictures.insert(name.clone(), Arc::new(Image { width, height, pixels }).into());
        Ok(made(name))
    }
}
