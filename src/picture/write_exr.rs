//! Writing OpenEXR: 32-bit linear RGB, ZIP-compressed, with further channels and text attributes that say how a picture was made.
//!
//! The same picture with the same attributes gives the same bytes.

use std::io::Cursor;
use std::path::Path;

use exr::image::{AnyChannel, AnyChannels, FlatSamples};
use exr::meta::attribute::{AttributeValue, IntegerBounds, Text};
use exr::meta::header::ImageAttributes;
use exr::prelude::{Encoding, Image as ExrImage, Layer, LayerAttributes, WritableImage};

use super::window::Placed;
use crate::base::files::write_bytes;
use crate::base::{Error, Result};
use crate::picture::Image;

/// Name and value of a text attribute.
pub type Attribute = (String, String);

/// A further channel of a picture: one number per pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Layer and channel, for example `albedo.R`.
    pub name: String,
    /// The numbers.
    pub values: Vec<f32>,
}

/// A picture with its channels, window and attributes, as written to a file.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    /// The picture itself, linear RGB.
    pub image: &'a Image,
    /// Further channels.
    pub channels: &'a [Channel],
    /// Window within a larger picture, with that picture's columns and rows; none for a whole picture.
    pub window: Placed,
    /// Text attributes that say how it was made. Those with an empty name are left out, `software` becomes the standard attribute.
    pub attributes: &'a [Attribute],
}

impl<'a> Picture<'a> {
    /// A picture without further channels.
    pub fn plain(image: &'a Image, attributes: &'a [Attribute]) -> Self {
        Self { image, channels: &[], window: None, attributes }
    }
}

/// Encodes a picture: one part with all channels, those of layers with dotted names.
///
/// # Errors
/// [`Error::Options`] where the picture is empty, a channel has another size, or it cannot be encoded.
pub fn encode(picture: &Picture) -> Result<Vec<u8>> {
    let image = picture.image;
    let pixels = image.width * image.height;
    if image.width == 0 || image.pixels.len() != pixels {
        return Err(Error::Options("an empty picture cannot be written".into()));
    }
    if let Some(channel) = picture.channels.iter().find(|channel| channel.values.len() != pixels) {
        return Err(Error::Options(format!("the channel {} is not of the picture's size", channel.name)));
    }
    let colour = ["R", "G", "B"].into_iter().enumerate().map(|(c, name)| {
        let values = image.pixels.iter().map(|pixel| pixel[c]).collect();
        AnyChannel::new(name, FlatSamples::F32(values))
    });
    let layers = picture.channels.iter().filter_map(|channel| {
        // Channels whose name EXR cannot hold are left out.
        Some(AnyChannel::new(latin(&channel.name)?, FlatSamples::F32(channel.values.clone())))
    });
    let channels = AnyChannels::sort(colour.chain(layers).collect());
    let attributes = layer_attributes(picture);
    let display = match picture.window {
        Some((_, [width, height])) => IntegerBounds::from_dimensions((width as usize, height as usize)),
        None => IntegerBounds::from_dimensions((image.width, image.height)),
    };
    let layer = Layer::new((image.width, image.height), attributes, Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::new(ImageAttributes::new(display), layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::Options(format!("the picture could not be encoded as EXR: {e}")))?;
    let mut bytes = bytes.into_inner();
    sort_header(&mut bytes);
    Ok(bytes)
}

fn layer_attributes(picture: &Picture) -> LayerAttributes {
    let mut own = LayerAttributes::default();
    if let Some((window, _)) = picture.window {
        // Sides are at most 2^15.
        own.layer_position = exr::math::Vec2(window.x as i32, window.y as i32);
    }
    for (name, value) in picture.attributes {
        if name == "software" {
            own.software_name = latin(value);
        } else if let (Some(name), Some(value)) = (latin(name).filter(|_| !name.is_empty()), latin(value)) {
            own.other.insert(name, AttributeValue::Text(value));
        }
    }
    own
}

/// EXR texts are Latin-1; other characters become question marks.
fn latin(text: &str) -> Option<Text> {
    Text::new_or_none(text.chars().map(|c| if u32::from(c) < 256 { c } else { '?' }).collect::<String>())
}

/// Sorts the attributes of a file's only header by name: the encoder keeps ours in a hash map, whose order differs from run to
/// run. All lengths stay, so offsets into the file do too. A file without such a header is left as it is.
fn sort_header(bytes: &mut [u8]) {
    // After magic number and version: name, 0, type, 0, length, value; an empty name ends the header.
    const START: usize = 8;
    let text_end = |at: usize| Some(at + bytes.get(at..)?.iter().position(|&b| b == 0)? + 1);
    let entry_end = |at: usize| {
        let length_at = text_end(text_end(at)?)?;
        let length = u32::from_le_bytes(*bytes.get(length_at..)?.first_chunk()?);
        Some(length_at + 4 + length as usize).filter(|&end| end <= bytes.len())
    };
    let mut entries: Vec<&[u8]> = Vec::new();
    let mut at = START;
    while bytes.get(at).is_some_and(|&b| b != 0) {
        let Some(end) = entry_end(at) else { return };
        entries.push(&bytes[at..end]);
        at = end;
    }
    // A name ends in 0, which is below every letter, so whole entries are ordered as their names are.
    entries.sort_unstable();
    let sorted = entries.concat();
    if let Some(header) = bytes.get_mut(START..at) {
        header.copy_from_slice(&sorted);
    }
}

/// Writes a picture atomically.
///
/// # Errors
/// As [`encode`], and [`Error::Io`] naming `path`.
pub fn write(path: &Path, picture: &Picture) -> Result<()> {
    write_bytes(path, &encode(picture)?)
}

#[cfg(test)]
mod tests {
    use super::super::window::Window;
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers};
    use glam::Vec3;

    fn texts<const N: usize>(pairs: [(&str, &str); N]) -> [Attribute; N] {
        pairs.map(|(name, value)| (name.to_owned(), value.to_owned()))
    }

    #[test]
    fn pixels_and_attributes_survive() {
        let pixels: Vec<Vec3> = (0..35).map(|i| Vec3::new(i as f32, 1e30, 1e-30 * i as f32)).collect();
        let image = Image { width: 7, height: 5, pixels: pixels.clone() };
        let attributes =
            texts([("software", "fanal 1"), ("seed", "7"), ("scene", "灯台"), ("", "nameless"), ("empty", "")]);
        let bytes = encode(&Picture::plain(&image, &attributes)).unwrap();
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
    fn channels_and_windows_survive_in_one_part() {
        let image = Image { width: 3, height: 2, pixels: vec![Vec3::ONE; 6] };
        let values: Vec<f32> = (0..6).map(|i| i as f32).collect();
        let channels = ["normal.X", "albedo.R"].map(|name| Channel { name: name.into(), values: values.clone() });
        let window = Some((Window { x: 4, y: 5, width: 3, height: 2 }, [10, 9]));
        let picture = Picture { image: &image, channels: &channels, window, attributes: &[] };
        let read = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .from_buffered(Cursor::new(encode(&picture).unwrap()))
            .unwrap();
        assert_eq!(read.layer_data.len(), 1);
        let layer = &read.layer_data[0];
        let names: Vec<String> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R", "albedo.R", "normal.X"]);
        assert_eq!(layer.channel_data.list[4].sample_data, FlatSamples::F32(values));
        assert_eq!(layer.attributes.layer_position, exr::math::Vec2(4, 5));
        assert_eq!(read.attributes.display_window, IntegerBounds::from_dimensions((10, 9)));
        let short = [Channel { name: "depth.Z".into(), values: vec![0.0; 5] }];
        let message = encode(&Picture { channels: &short, ..picture }).unwrap_err().to_string();
        assert!(message.contains("depth.Z"), "{message}");
    }

    /// With 20 attributes, two hash maps have the same order by chance once in 10¹⁸.
    #[test]
    fn the_same_picture_gives_the_same_bytes() {
        let image = Image { width: 3, height: 2, pixels: vec![Vec3::ONE; 6] };
        let attributes: Vec<Attribute> = (0..20).map(|i| (format!("name{i}"), format!("value{}", i * i))).collect();
        let first = encode(&Picture::plain(&image, &attributes)).unwrap();
        assert_eq!(encode(&Picture::plain(&image, &attributes)).unwrap(), first);
        let at = |name: &str| first.windows(name.len()).position(|w| w == name.as_bytes()).unwrap();
        assert!(at("name0\0") < at("name10\0") && at("name10\0") < at("name2\0"));
    }

    #[test]
    fn empty_picture_is_an_error() {
        assert!(matches!(encode(&Picture::plain(&Image::default(), &[])), Err(Error::Options(_))));
    }
}
