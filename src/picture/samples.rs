//! Pictures as they were decoded, alpha included, before anything is said of what their numbers mean.

use std::sync::Arc;

use glam::Vec3;

use super::image::Image;
use super::texels::{ByteImage, Texels, WordImage};

/// The samples of a picture, pixel by pixel from the top left.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Eight bits each.
    Eight(Vec<u8>),
    /// Sixteen bits each.
    Sixteen(Vec<u16>),
}

/// A decoded picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    size: [usize; 2],
    channels: usize,
    values: Values,
}

impl Samples {
    /// A picture of `size` (columns, rows) with 1 (grey), 2 (grey, alpha), 3 (red, green, blue) or 4 channels (with alpha). None
    /// where the number of values does not fit.
    pub fn new(size: [usize; 2], channels: usize, values: Values) -> Option<Self> {
        let count = match &values {
            Values::Eight(values) => values.len(),
            Values::Sixteen(values) => values.len(),
        };
        let fits = size[0].checked_mul(size[1])?.checked_mul(channels)? == count && (1..=4).contains(&channels);
        fits.then_some(Self { size, channels, values })
    }

    /// Whether it has an alpha channel.
    pub fn has_alpha(&self) -> bool {
        self.channels.is_multiple_of(2)
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The sample with index `at`, from 0 to 1.
    fn value(&self, at: usize) -> f32 {
        match &self.values {
            Values::Eight(values) => f32::from(values[at]) / 255.0,
            Values::Sixteen(values) => f32::from(values[at]) / 65535.0,
        }
    }

    /// A picture of its own with `of` each colour: linear floats, or of `raw` data numbers of sixteen bits from 0 to 1.
    pub fn mapped(&self, raw: bool, of: impl Fn(Vec3) -> Vec3) -> Texels {
        let ([width, height], stored) = (self.size, self.texels(raw));
        let pixels = (0..width * height).map(|index| of(stored.pixels([index])[0]));
        if raw {
            let word = |value: f32| (value.clamp(0.0, 1.0) * 65535.0).round() as u16;
            return self.of_words(3, pixels.flat_map(|pixel| pixel.to_array().map(word)).collect(), true);
        }
        Texels::Float(Arc::new(Image { width, height, pixels: pixels.collect() }))
    }

    /// The colours without alpha: sRGB values or, if `raw`, data.
    pub fn texels(&self, raw: bool) -> Texels {
        match &self.values {
            Values::Eight(values) => self.of_bytes(self.channels, values.clone(), raw),
            Values::Sixteen(values) => self.of_words(self.channels, values.clone(), raw),
        }
    }

    /// As [`Samples::texels`], without a copy.
    pub fn into_texels(mut self, raw: bool) -> Texels {
        match &mut self.values {
            Values::Eight(values) => {
                let values = std::mem::take(values);
                self.of_bytes(self.channels, values, raw)
            }
            Values::Sixteen(values) => {
                let values = std::mem::take(values);
                self.of_words(self.channels, values, raw)
            }
        }
    }

    /// `of` one channel's data, from 0 to 1, as a grey picture of eight bits: 0 to 2 are red, green and blue, 3 is alpha, which is 1
    /// where there is none.
    pub fn channel(&self, channel: usize, of: impl Fn(f32) -> f32) -> Texels {
        let at = match (channel, self.channels) {
            (3, 2 | 4) => Some(self.channels - 1),
            (3, _) => None,
            (_, 1 | 2) => Some(0),
            (channel, _) => Some(channel.min(2)),
        };
        let count = self.size[0] * self.size[1];
        let byte = |value: f32| (of(value).clamp(0.0, 1.0) * 255.0).round() as u8;
        let bytes = match at {
            Some(at) => (0..count).map(|index| byte(self.value(index * self.channels + at))).collect(),
            None => vec![byte(1.0); count],
        };
        self.of_bytes(1, bytes, true)
    }

    fn of_bytes(&self, channels: usize, bytes: Vec<u8>, raw: bool) -> Texels {
        let [width, height] = self.size;
        let image = ByteImage::new(width, height, channels, bytes, raw);
        image.map_or_else(nothing, |image| Texels::Bytes(Arc::new(image)))
    }

    fn of_words(&self, channels: usize, words: Vec<u16>, raw: bool) -> Texels {
        let [width, height] = self.size;
        let image = WordImage::new(width, height, channels, words, raw);
        image.map_or_else(nothing, |image| Texels::Words(Arc::new(image)))
    }
}

/// In the place of a picture whose number of samples is not that of its size, which cannot be: they were compared.
fn nothing() -> Texels {
    Texels::Float(Arc::new(Image::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_by_kind_of_picture() {
        let grey = |texels: &Texels, index: usize| texels.pixels([index])[0].x * 255.0;
        let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-3, "{a} {b}");
        let rgba = Samples::new([2, 1], 4, Values::Eight(vec![10, 20, 30, 40, 50, 60, 70, 80])).unwrap();
        (0..4).for_each(|channel| near(grey(&rgba.channel(channel, |v| v), 1), 50.0 + 10.0 * channel as f32));
        near(grey(&rgba.channel(3, |v| 1.0 - v), 0), 215.0);
        let alone = Samples::new([2, 1], 2, Values::Sixteen(vec![257, 514, 771, 1028])).unwrap();
        near(grey(&alone.channel(2, |v| v), 1), 3.0);
        near(grey(&alone.channel(3, |v| v), 1), 4.0);
        let opaque = Samples::new([1, 1], 3, Values::Eight(vec![1, 2, 3])).unwrap();
        near(grey(&opaque.channel(3, |v| v), 0), 255.0);
        assert!(rgba.has_alpha() && alone.has_alpha() && !opaque.has_alpha());
        assert_eq!(rgba.mapped(true, |c| 2.0 * c).pixels([0])[0], 2.0 * rgba.texels(true).pixels([0])[0]);
        assert!(matches!(rgba.mapped(true, |c| c), Texels::Words(_)));
        assert_eq!(rgba.mapped(false, |c| c).pixels([0, 1]), rgba.texels(false).pixels([0, 1]));
        assert!(Samples::new([2, 1], 4, Values::Eight(vec![0; 7])).is_none());
        assert!(Samples::new([usize::MAX, 2], 4, Values::Eight(vec![])).is_none());
    }
}
