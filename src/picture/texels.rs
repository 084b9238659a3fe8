//! Pictures for textures. Those of eight bits a channel stay bytes, which take a twelfth to a quarter of the memory of floats.

use std::sync::{Arc, LazyLock};

use glam::Vec3;

use super::image::Image;
use crate::base::processor::prefetch;
use crate::math::srgb;

/// The picture of a texture or of an environment.
#[derive(Debug, Clone, PartialEq)]
pub enum Texels {
    /// Linear RGB floats.
    Float(Arc<Image>),
    /// Eight bits a channel.
    Bytes(Arc<ByteImage>),
}

/// A picture of bytes, row by row from the top left; a table of 256 linear values decodes them.
#[derive(Debug, PartialEq)]
pub struct ByteImage {
    width: usize,
    height: usize,
    /// One byte a pixel (grey) or three (red, green, blue).
    samples: Vec<u8>,
    grey: bool,
    /// Linear value of each byte.
    values: &'static [f32; 256],
}

/// Linear values of bytes that hold sRGB.
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| DATA.map(srgb::linear));
/// Values of bytes that hold data: from 0 to 1.
static DATA: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|byte| byte as f32 / 255.0));

impl ByteImage {
    /// A picture from samples of 1 (grey), 2 (grey, alpha), 3 (red, green, blue) or 4 channels (with alpha); alpha is dropped.
    /// Samples are sRGB values or, if `raw`, data. None where their number does not fit.
    pub fn new(width: usize, height: usize, channels: usize, samples: Vec<u8>, raw: bool) -> Option<Self> {
        let expected = width.checked_mul(height)?.checked_mul(channels)?;
        if samples.len() != expected {
            return None;
        }
        let samples = match channels {
            1 | 3 => samples,
            2 => samples.into_iter().step_by(2).collect(),
            4 => samples.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
            _ => return None,
        };
        let values = if raw { &*DATA } else { &*SRGB };
        Some(Self { width, height, samples, grey: channels < 3, values })
    }

    /// Pixel number `index`, linear RGB.
    #[inline]
    fn pixel(&self, index: usize) -> Vec3 {
        let value = |byte: u8| self.values[usize::from(byte)];
        if self.grey {
            return Vec3::splat(value(self.samples[index]));
        }
        let bytes = &self.samples[3 * index..][..3];
        Vec3::new(value(bytes[0]), value(bytes[1]), value(bytes[2]))
    }

    fn pixels(&self) -> impl Iterator<Item = Vec3> {
        (0..self.width * self.height).map(|index| self.pixel(index))
    }
}

impl From<Arc<Image>> for Texels {
    fn from(image: Arc<Image>) -> Self {
        Self::Float(image)
    }
}

impl Texels {
    /// Columns and rows.
    #[inline]
    pub fn size(&self) -> [usize; 2] {
        match self {
            Self::Float(image) => [image.width, image.height],
            Self::Bytes(image) => [image.width, image.height],
        }
    }

    /// The pixels of these indices, counted row by row from the top left; linear RGB.
    #[inline]
    pub fn pixels<const N: usize>(&self, indices: [usize; N]) -> [Vec3; N] {
        let mut pixels = [Vec3::ZERO; N];
        match self {
            Self::Float(image) => {
                pixels.iter_mut().zip(indices).for_each(|(pixel, index)| *pixel = image.pixels[index])
            }
            Self::Bytes(image) => pixels.iter_mut().zip(indices).for_each(|(pixel, index)| *pixel = image.pixel(index)),
        }
        pixels
    }

    /// Brings a pixel near, which will be needed soon.
    #[inline]
    pub fn prefetch(&self, index: usize) {
        match self {
            Self::Float(image) => image.pixels.get(index).into_iter().for_each(prefetch),
            Self::Bytes(image) => {
                image.samples.get(if image.grey { index } else { 3 * index }).into_iter().for_each(prefetch);
            }
        }
    }

    /// Mean of all pixels; zero for an empty picture.
    pub fn mean(&self) -> Vec3 {
        let mean = |sum: glam::DVec3, count: usize| (sum / count.max(1) as f64).as_vec3();
        match self {
            Self::Float(image) => mean(image.pixels.iter().map(|pixel| pixel.as_dvec3()).sum(), image.pixels.len()),
            Self::Bytes(image) => mean(image.pixels().map(|p| p.as_dvec3()).sum(), image.width * image.height),
        }
    }

    /// The whole picture in linear RGB floats.
    pub fn to_image(&self) -> Arc<Image> {
        match self {
            Self::Float(image) => Arc::clone(image),
            Self::Bytes(image) => {
                Arc::new(Image { width: image.width, height: image.height, pixels: image.pixels().collect() })
            }
        }
    }

    /// The pixels' bytes as stored; equal for equal pictures.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Float(image) => bytemuck::cast_slice(&image.pixels),
            Self::Bytes(image) => &image.samples,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte, grey and coloured, with and without alpha, sRGB and raw, has the value of the transfer curve to the last bit.
    #[test]
    fn bytes_mean_what_the_curve_says() {
        for raw in [false, true] {
            let value = |byte: u8| {
                let encoded = f32::from(byte) / 255.0;
                if raw { encoded } else { srgb::linear(encoded) }
            };
            for channels in 1..=4usize {
                let byte = |pixel: usize, channel: usize| (pixel * (1 + 2 * channel) % 256) as u8;
                let samples = (0..256 * channels).map(|i| byte(i / channels, i % channels)).collect();
                let texels = Texels::Bytes(Arc::new(ByteImage::new(32, 8, channels, samples, raw).unwrap()));
                let image = texels.to_image();
                for i in 0..256 {
                    let rgb = if channels < 3 { [0; 3] } else { [0, 1, 2] };
                    let expected = Vec3::from_array(rgb.map(|channel| value(byte(i, channel))));
                    assert_eq!((texels.pixels([i]), image.pixels[i]), ([expected], expected), "{channels} channels");
                }
                assert_eq!(texels.mean(), Texels::Float(image).mean());
                assert_eq!(texels.size(), [32, 8]);
            }
        }
        assert!(ByteImage::new(2, 2, 3, vec![0; 11], false).is_none());
        assert!(ByteImage::new(2, 2, 5, vec![0; 20], false).is_none());
        assert!(ByteImage::new(usize::MAX, 2, 3, vec![0; 6], false).is_none());
    }
}
