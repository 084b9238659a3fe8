//! Pictures as OpenEXR: 32-bit linear RGB, ZIP-compressed, with text attributes that say how they were made.

use std::io::Cursor;
use std::path::Path;

use exr::meta::attribute::{AttributeValue, Text};
use exr::prelude::{Encoding, Image as ExrImage, Layer, LayerAttributes, SpecificChannels, WritableImage};

use crate::base::files::write_bytes;
use crate::base::{Error, Result};
use crate::materials::image::Image;

/// Name and value of a text attribute.
pub type Attribute = (String, String);

/// Encodes a picture. Attributes with an empty name are left out, `software` becomes the standard attribute.
///
/// # Errors
/// [`Error::Options`] where the picture is empty or cannot be encoded.
pub fn encode(image: &Image, attributes: &[Attribute]) -> Result<Vec<u8>> {
    if image.width == 0 || image.pixels.len() != image.width * image.height {
        return Err(Error::Options("an empty picture cannot be written".into()));
    }
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
        let pixel = image.pixels[at.y() * image.width + at.x()];
        (pixel.x, pixel.y, pixel.z)
    });
    let mut own = LayerAttributes::default();
    for (name, value) in attributes {
        if name == "software" {
            own.software_name = latin(value);
        } else if let (Some(name), Some(value)) = (latin(name).filter(|_| !name.is_empty()), latin(value)) {
            own.other.insert(name, AttributeValue::Text(value));
        }
    }
    let layer = Layer::new((image.width, image.height), own, Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::Options(format!("the picture could not be encoded as EXR: {e}")))?;
    Ok(bytes.into_inner())
}

/// EXR texts are Latin-1; other characters become question marks.
fn latin(text: &str) -> Option<Text> {
    Text::new_or_none(text.chars().map(|c| if u32::from(c) < 256 { c } else { '?' }).collect::<String>())
}

/// Writes a picture atomically.
///
/// # Errors
/// As [`encode`], and [`Error::Io`] naming `path`.
pub fn write(path: &Path, image: &Image, attributes: &[Attribute]) -> Result<()> {
    write_bytes(path, &encode(image, attributes)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers};
    use glam::Vec3;

    #[test]
    fn pixels_and_attributes_survive() {
        let pixels: Vec<Vec3> = (0..35).map(|i| Vec3::new(i as f32, 1e30, 1e-30 * i as f32)).collect();
        let image = Image { width: 7, height: 5, pixels: pixels.clone() };
        let attributes = [("software", "fanal 1"), ("seed", "7"), ("scene", "灯台"), ("", "nameless"), ("empty", "")]
            .map(|(name, value)| (name.to_owned(), value.to_owned()));
        let bytes = encode(&image, &attributes).unwrap();
        let read = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |size, _| vec![Vec3::ZERO; size.area()],
                |pixels: &mut Vec<Vec3>, at, (r, g, b): (f32, f32, f32)| {
                    pixels[at.y() * 7 + at.x()] = Vec3::new(r, g, b)
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .unwrap();
        assert_eq!(read.layer_data.channel_data.pixels, pixels);
        let own = &read.layer_data.attributes;
        assert_eq!(own.software_name, Some("fanal 1".into()));
        assert_eq!(own.other.get(&Text::from("seed")), Some(&AttributeValue::Text("7".into())));
        assert_eq!(own.other.get(&Text::from("scene")), Some(&AttributeValue::Text("??".into())));
        assert_eq!(read.layer_data.encoding.compression, exr::compression::Compression::ZIP16);
    }

    #[test]
    fn empty_picture_is_an_error() {
        assert!(matches!(encode(&Image::default(), &[]), Err(Error::Options(_))));
    }
}
