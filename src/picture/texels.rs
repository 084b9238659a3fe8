//! Pictures for textures. Those of eight or sixteen bits a channel stay so, which takes a twelfth to a half of the memory of floats.

use std::sync::{Arc, LazyLock};

use glam::Vec3;
use half::f16;

use super::image::Image;
use crate::base::processor::prefetch;
use crate::math::srgb;

/// The picture of a texture or of an environment.
#[derive(Debug, Clone, PartialEq)]
pub enum Texels {
    /// Linear RGB floats.
    Float(Arc<Image>),
    /// Linear RGB floats of half precision.
    Half(Arc<HalfImage>),
    /// Whole numbers of sixteen bits a channel.
    Words(Arc<WordImage>),
    /// Whole numbers of eight bits a channel.
    Bytes(Arc<ByteImage>),
}

/// A picture of whole numbers, row by row from the top left; a table of linear values decodes them.
#[derive(Debug, PartialEq)]
pub struct CodedImage<S: 'static, const CODES: usize> {
    width: usize,
    height: usize,
    /// One number a pixel (grey) or three (red, green, blue).
    samples: Vec<S>,
    grey: bool,
    /// Linear value of each number.
    values: &'static [f32; CODES],
}

/// Eight bits a channel.
pub type ByteImage = CodedImage<u8, 256>;
/// Sixteen bits a channel.
pub type WordImage = CodedImage<u16, 65536>;

/// Linear values of numbers that hold sRGB.
static SRGB_BYTES: LazyLock<[f32; 256]> = LazyLock::new(|| DATA_BYTES.map(srgb::linear));
static SRGB_WORDS: LazyLock<Box<[f32; 65536]>> = LazyLock::new(|| words(|word| srgb::linear(word / 65535.0)));
/// Values of numbers that hold data: from 0 to 1.
static DATA_BYTES: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|byte| byte as f32 / 255.0));
static DATA_WORDS: LazyLock<Box<[f32; 65536]>> = LazyLock::new(|| words(|word| word / 65535.0));

/// A table for all numbers of sixteen bits.
fn words(value: impl Fn(f32) -> f32) -> Box<[f32; 65536]> {
    let mut table = Box::new([0.0; 65536]);
    table.iter_mut().zip(0u16..=u16::MAX).for_each(|(entry, word)| *entry = value(f32::from(word)));
    table
}

impl ByteImage {
    /// A picture from samples of 1 (grey), 2 (grey, alpha), 3 (red, green, blue) or 4 channels (with alpha); alpha is dropped.
    /// Samples are sRGB values or, if `raw`, data. None where their number does not fit.
    pub fn new(width: usize, height: usize, channels: usize, samples: Vec<u8>, raw: bool) -> Option<Self> {
        Self::of([width, height], channels, samples, if raw { &DATA_BYTES } else { &SRGB_BYTES })
    }
}

impl WordImage {
    /// As [`ByteImage::new`].
    pub fn new(width: usize, height: usize, channels: usize, samples: Vec<u16>, raw: bool) -> Option<Self> {
        Self::of([width, height], channels, samples, if raw { &DATA_WORDS } else { &SRGB_WORDS })
    }
}

impl<S: Copy + Into<usize>, const CODES: usize> CodedImage<S, CODES> {
    fn of(
        [width, height]: [usize; 2],
        channels: usize,
        samples: Vec<S>,
        values: &'static [f32; CODES],
    ) -> Option<Self> {
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
        Some(Self { width, height, samples, grey: channels < 3, values })
    }

    /// Pixel number `index`, linear RGB.
    #[inline]
    fn pixel(&self, index: usize) -> Vec3 {
        pixel(&self.samples, self.grey, index, |sample| self.values[sample.into()])
    }

    fn pixels(&self) -> impl Iterator<Item = Vec3> {
        (0..self.width * self.height).map(|index| self.pixel(index))
    }
}

/// Pixel number `index` of samples of one number a pixel (grey) or three.
#[inline]
fn pixel<S: Copy>(samples: &[S], grey: bool, index: usize, value: impl Fn(S) -> f32) -> Vec3 {
    if grey {
        return Vec3::splat(value(samples[index]));
    }
    let rgb = &samples[3 * index..][..3];
    Vec3::new(value(rgb[0]), value(rgb[1]), value(rgb[2]))
}

/// A picture of finite numbers that all are floats of half precision (IEEE 754 binary16), as most pictures of high dynamic range hold
/// them; row by row from the top left.
#[derive(Debug, PartialEq)]
pub struct HalfImage {
    width: usize,
    height: usize,
    /// Bits of one number a pixel (grey) or three (red, green, blue).
    samples: Vec<u16>,
    grey: bool,
}

impl HalfImage {
    /// The picture in half of the memory or less; none if that changed any of its numbers.
    pub fn exact(image: &Image) -> Option<Self> {
        let half = |value: f32| {
            let half = f16::from_f32(value);
            (half.is_finite() && half.to_f32().to_bits() == value.to_bits()).then_some(half.to_bits())
        };
        let Image { width, height, pixels } = image;
        let grey = pixels.iter().all(|p| p.to_array().map(f32::to_bits) == [p.x.to_bits(); 3]);
        let samples = if grey {
            pixels.iter().map(|p| half(p.x)).collect::<Option<_>>()?
        } else {
            pixels.iter().flat_map(|p| p.to_array()).map(half).collect::<Option<_>>()?
        };
        Some(Self { width: *width, height: *height, samples, grey })
    }

    /// Pixel number `index`, linear RGB.
    #[inline]
    fn pixel(&self, index: usize) -> Vec3 {
        pixel(&self.samples, self.grey, index, single)
    }

    fn pixels(&self) -> impl Iterator<Item = Vec3> {
        (0..self.width * self.height).map(|index| self.pixel(index))
    }
}

/// The value of a finite half: its exponent and fraction in their places of a single whose exponent counts from 2⁻¹¹² times as low, which
/// holds for subnormal ones, too.
#[inline]
fn single(half: u16) -> f32 {
    const UP: f32 = f32::from_bits((127 + 112) << 23);
    let (sign, rest) = (u32::from(half & 0x8000) << 16, u32::from(half & 0x7FFF) << 13);
    f32::from_bits(sign | rest) * UP
}

impl From<Arc<Image>> for Texels {
    fn from(image: Arc<Image>) -> Self {
        Self::Float(image)
    }
}

impl Texels {
    /// In half of the memory or less where that changes nothing.
    pub fn compact(self) -> Self {
        match &self {
            Self::Float(image) => HalfImage::exact(image).map_or(self, |image| Self::Half(Arc::new(image))),
            Self::Half(_) | Self::Words(_) | Self::Bytes(_) => self,
        }
    }

    /// Columns and rows.
    #[inline]
    pub fn size(&self) -> [usize; 2] {
        match self {
            Self::Float(image) => [image.width, image.height],
            Self::Half(image) => [image.width, image.height],
            Self::Words(image) => [image.width, image.height],
            Self::Bytes(image) => [image.width, image.height],
        }
    }

    /// The pixels of these indices, counted row by row from the top left; linear RGB.
    #[inline]
    pub fn pixels<const N: usize>(&self, indices: [usize; N]) -> [Vec3; N] {
        let mut pixels = [Vec3::ZERO; N];
        let each = pixels.iter_mut().zip(indices);
        match self {
            Self::Float(image) => each.for_each(|(pixel, index)| *pixel = image.pixels[index]),
            Self::Half(image) => each.for_each(|(pixel, index)| *pixel = image.pixel(index)),
            Self::Words(image) => each.for_each(|(pixel, index)| *pixel = image.pixel(index)),
            Self::Bytes(image) => each.for_each(|(pixel, index)| *pixel = image.pixel(index)),
        }
        pixels
    }

    /// Brings a pixel near, which will be needed soon.
    #[inline]
    pub fn prefetch(&self, index: usize) {
        let first = |grey: bool| if grey { index } else { 3 * index };
        match self {
            Self::Float(image) => image.pixels.get(index).into_iter().for_each(prefetch),
            Self::Half(image) => image.samples.get(first(image.grey)).into_iter().for_each(prefetch),
            Self::Words(image) => image.samples.get(first(image.grey)).into_iter().for_each(prefetch),
            Self::Bytes(image) => image.samples.get(first(image.grey)).into_iter().for_each(prefetch),
        }
    }

    /// Mean of all pixels; zero for an empty picture.
    pub fn mean(&self) -> Vec3 {
        let [width, height] = self.size();
        let sum: glam::DVec3 = match self {
            Self::Float(image) => image.pixels.iter().map(|pixel| pixel.as_dvec3()).sum(),
            Self::Half(image) => image.pixels().map(|pixel| pixel.as_dvec3()).sum(),
            Self::Words(image) => image.pixels().map(|pixel| pixel.as_dvec3()).sum(),
            Self::Bytes(image) => image.pixels().map(|pixel| pixel.as_dvec3()).sum(),
        };
        (sum / (width * height).max(1) as f64).as_vec3()
    }

    /// The whole picture in linear RGB floats.
    pub fn to_image(&self) -> Arc<Image> {
        let pixels = match self {
            Self::Float(image) => return Arc::clone(image),
            Self::Half(image) => image.pixels().collect(),
            Self::Words(image) => image.pixels().collect(),
            Self::Bytes(image) => image.pixels().collect(),
        };
        let [width, height] = self.size();
        Arc::new(Image { width, height, pixels })
    }

    /// The pixels' bytes as stored; equal for equal pictures.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Float(image) => bytemuck::cast_slice(&image.pixels),
            Self::Half(image) => bytemuck::cast_slice(&image.samples),
            Self::Words(image) => bytemuck::cast_slice(&image.samples),
            Self::Bytes(image) => &image.samples,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every number, grey and coloured, with and without alpha, sRGB and raw, has the value of the transfer curve to the last bit.
    #[test]
    fn numbers_mean_what_the_curve_says() {
        for raw in [false, true] {
            let value = |encoded: f32| if raw { encoded } else { srgb::linear(encoded) };
            for channels in 1..=4usize {
                let number = |pixel: usize, channel: usize| pixel * (1 + 2 * channel);
                let all = |count: usize| (0..count * channels).map(move |i| number(i / channels, i % channels));
                let bytes = all(256).map(|number| number as u8).collect();
                let words = all(65536).map(|number| number as u16).collect();
                let bytes = Texels::Bytes(Arc::new(ByteImage::new(32, 8, channels, bytes, raw).unwrap()));
                let words = Texels::Words(Arc::new(WordImage::new(256, 256, channels, words, raw).unwrap()));
                for (texels, most) in [(bytes, 255), (words, 65535)] {
                    let image = texels.to_image();
                    for i in 0..=most {
                        let rgb = if channels < 3 { [0; 3] } else { [0, 1, 2] };
                        let encoded = |channel: usize| (number(i, channel) & most) as f32 / most as f32;
                        let expected = Vec3::from_array(rgb.map(|channel| value(encoded(channel))));
                        assert_eq!(
                            (texels.pixels([i]), image.pixels[i]),
                            ([expected], expected),
                            "{channels} channels"
                        );
                    }
                    assert_eq!(texels.mean(), Texels::Float(image).mean());
                    assert_eq!(texels.size()[0] * texels.size()[1], most + 1);
                }
            }
        }
        assert!(ByteImage::new(2, 2, 3, vec![0; 11], false).is_none());
        assert!(ByteImage::new(2, 2, 5, vec![0; 20], false).is_none());
        assert!(WordImage::new(usize::MAX, 2, 3, vec![0; 6], false).is_none());
    }

    /// Every finite half, as grey and in each channel of a colour, is kept to the last bit; what would change is not taken.
    #[test]
    fn halves_stay_halves() {
        let finite: Vec<f32> = (0..=u16::MAX).map(f16::from_bits).filter(|h| h.is_finite()).map(f16::to_f32).collect();
        let image = |pixels: Vec<Vec3>| Arc::new(Image { width: pixels.len(), height: 1, pixels });
        let grey = image(finite.iter().map(|&value| Vec3::splat(value)).collect());
        let colour = image(finite.iter().map(|&value| Vec3::new(value, 0.5, -value)).collect());
        for (image, bytes) in [(grey, 2), (colour, 6)] {
            let texels = Texels::from(Arc::clone(&image)).compact();
            assert!(matches!(texels, Texels::Half(_)) && texels.bytes().len() == bytes * finite.len());
            let bits = |pixel: Vec3| pixel.to_array().map(f32::to_bits);
            for (index, pixel) in image.pixels.iter().enumerate() {
                assert_eq!(bits(texels.pixels([index])[0]), bits(*pixel), "{pixel}");
            }
            assert_eq!((texels.to_image(), texels.mean()), (Arc::clone(&image), Texels::Float(image).mean()));
        }
        for changed in [0.1, 65536.0, 1e-8, f32::INFINITY, f32::NAN] {
            let texels = Texels::from(image(vec![Vec3::ONE, Vec3::new(0.25, changed, 0.5)]));
            assert!(matches!(texels.compact(), Texels::Float(_)), "{changed}");
        }
    }
}
