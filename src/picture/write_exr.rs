//! Writing OpenEXR: 32-bit linear RGB, ZIP-compressed, with further channels and text attributes that say how a picture was made.
//!
//! The same picture with the same attributes gives the same bytes. It is written a few rows at a time, so that channels need not be in memory.

use std::borrow::Cow;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::meta::BlockDescription;
use exr::meta::attribute::{AttributeValue, ChannelDescription, IntegerBounds, LineOrder, SampleType, Text};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use rayon::prelude::*;

use super::window::Placed;
use crate::base::files::write_file;
use crate::base::{Error, Result};
use crate::picture::Image;

/// Name and value of a text attribute.
pub type Attribute = (String, String);

/// Bytes that are written to a file at once.
const BUFFER: usize = 1 << 20;

/// A further channel of a picture: one number per pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Layer and channel, for example `albedo.R`.
    pub name: String,
    /// The numbers.
    pub values: Vec<f32>,
}

/// Further channels of a picture, wherever they are.
pub trait Layers: Sync {
    /// Names of the channels.
    fn names(&self) -> Vec<String>;

    /// Values of these pixels of a channel, counted row by row from the top left.
    ///
    /// # Errors
    /// Those of reading where they are not in memory.
    fn values(&self, channel: usize, pixels: Range<usize>) -> Result<Cow<'_, [f32]>>;

    /// A channel that has another number of pixels than the picture, by its name.
    fn unlike(&self, _pixels: usize) -> Option<String> {
        None
    }
}

impl Layers for Vec<Channel> {
    fn names(&self) -> Vec<String> {
        self.iter().map(|channel| channel.name.clone()).collect()
    }

    fn values(&self, channel: usize, pixels: Range<usize>) -> Result<Cow<'_, [f32]>> {
        Ok(Cow::Borrowed(&self[channel].values[pixels]))
    }

    fn unlike(&self, pixels: usize) -> Option<String> {
        self.iter().find(|channel| channel.values.len() != pixels).map(|channel| channel.name.clone())
    }
}

/// A picture with its channels, window and attributes, as written to a file.
#[derive(Clone, Copy)]
pub struct Picture<'a> {
    /// The picture itself, linear RGB.
    pub image: &'a Image,
    /// Further channels.
    pub channels: &'a dyn Layers,
    /// Window within a larger picture, with that picture's columns and rows; none for a whole picture.
    pub window: Placed,
    /// Text attributes that say how it was made. Those with an empty name are left out, `software` becomes the standard attribute.
    pub attributes: &'a [Attribute],
}

/// No further channels.
static NO_CHANNELS: Vec<Channel> = Vec::new();

impl<'a> Picture<'a> {
    /// A picture without further channels.
    pub fn plain(image: &'a Image, attributes: &'a [Attribute]) -> Self {
        Self { image, channels: &NO_CHANNELS, window: None, attributes }
    }
}

/// A channel of the file: its name, and where its values are.
struct Source {
    name: Text,
    of: Of,
}

enum Of {
    /// A channel of the colour.
    Colour(usize),
    /// A further channel.
    Layer(usize),
}

/// All channels by their names. Those whose name EXR cannot hold are left out.
fn sources(picture: &Picture) -> Vec<Source> {
    let colour = ["R", "G", "B"].into_iter().enumerate().map(|(c, name)| (name.to_owned(), Of::Colour(c)));
    let layers = picture.channels.names().into_iter().enumerate().map(|(number, name)| (name, Of::Layer(number)));
    let mut all: Vec<Source> =
        colour.chain(layers).filter_map(|(name, of)| Some(Source { name: name_of(&name)?, of })).collect();
    all.sort_by(|a, b| a.name.as_slice().cmp(b.name.as_slice()));
    all
}

/// The values of some rows as the file has them before it is compressed: row by row, each channel by channel.
fn rows(picture: &Picture, sources: &[Source], rows: Range<usize>) -> Result<Vec<u8>> {
    let width = picture.image.width;
    let pixels = rows.start * width..rows.end * width;
    let mut bytes = vec![0; pixels.len() * sources.len() * size_of::<f32>()];
    for (number, source) in sources.iter().enumerate() {
        let values: Cow<[f32]> = match source.of {
            Of::Colour(c) => picture.image.pixels[pixels.clone()].iter().map(|pixel| pixel[c]).collect(),
            Of::Layer(layer) => picture.channels.values(layer, pixels.clone())?,
        };
        let row_bytes = width * size_of::<f32>();
        for (row, values) in values.chunks(width).enumerate() {
            let at = (row * sources.len() + number) * row_bytes;
            bytes[at..at + row_bytes].copy_from_slice(bytemuck::cast_slice(values));
        }
    }
    Ok(bytes)
}

/// Writes a picture to `out`, which is at its begin and called `path`: one part with all channels, those of layers with dotted names.
fn encode(picture: &Picture, path: &Path, out: &mut (impl Read + Write + Seek)) -> Result<()> {
    let image = picture.image;
    let pixels = image.width * image.height;
    if image.width == 0 || image.pixels.len() != pixels {
        return Err(Error::Options("an empty picture cannot be written".into()));
    }
    if let Some(name) = picture.channels.unlike(pixels) {
        return Err(Error::Options(format!("the channel {name} is not of the picture's size")));
    }
    let sources = sources(picture);
    let described = |source: &Source| ChannelDescription::new(source.name.clone(), SampleType::F32, false);
    let display = match picture.window {
        Some((_, [width, height])) => IntegerBounds::from_dimensions((width as usize, height as usize)),
        None => IntegerBounds::from_dimensions((image.width, image.height)),
    };
    let header = Header::new(Text::default(), (image.width, image.height), sources.iter().map(described).collect())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(layer_attributes(picture))
        .with_shared_attributes(ImageAttributes::new(display));
    let failed = |e: exr::error::Error| match e {
        exr::error::Error::Io(e) => Error::io(path, e),
        other => Error::Options(format!("the picture could not be encoded as EXR: {other}")),
    };
    // What reading the channels may end with.
    let mut unread = None;
    let written = exr::block::write(
        BufWriter::with_capacity(BUFFER, &mut *out),
        std::iter::once(header).collect(),
        true,
        |meta, chunks| {
            let blocks: Vec<(usize, BlockIndex)> =
                exr::block::enumerate_ordered_header_block_indices(&meta.headers).collect();
            // A few at a time, which threads compress.
            for few in blocks.chunks(2 * rayon::current_num_threads()) {
                let compressed = few.par_iter().map(|&(number, index)| {
                    let first = index.pixel_position.y();
                    let data = rows(picture, &sources, first..first + index.pixel_size.y())?;
                    Ok((number, UncompressedBlock { index, data }.compress_to_chunk(&meta.headers).map_err(failed)?))
                });
                match compressed.collect::<Result<Vec<_>>>() {
                    Ok(all) => all.into_iter().try_for_each(|(number, chunk)| chunks.write_chunk(number, chunk))?,
                    Err(error) => {
                        let told = error.to_string();
                        unread = Some(error);
                        return Err(exr::error::Error::Invalid(told.into()));
                    }
                }
            }
            Ok(())
        },
    );
    match (unread, written) {
        (Some(error), _) => Err(error),
        (None, written) => written.map_err(failed).and_then(|()| sort_header(out).map_err(|e| Error::io(path, e))),
    }
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
        } else if let (Some(name), Some(value)) = (name_of(name), latin(value)) {
            own.other.insert(name, AttributeValue::Text(value));
        }
    }
    own
}

/// Longest name of a channel or an attribute in an EXR file, in bytes.
const LONGEST_NAME: usize = 255;

/// Whether a channel or an attribute of an EXR file can have this name, which ends in a zero there.
pub fn is_name(text: &str) -> bool {
    (1..=LONGEST_NAME).contains(&text.chars().count()) && !text.contains('\0')
}

fn name_of(text: &str) -> Option<Text> {
    if is_name(text) { latin(text) } else { None }
}

/// EXR texts are Latin-1; other characters become question marks.
fn latin(text: &str) -> Option<Text> {
    Text::new_or_none(text.chars().map(|c| if u32::from(c) < 256 { c } else { '?' }).collect::<String>())
}

/// Sorts the attributes of a file's only header by name: the encoder keeps ours in a hash map, whose order differs from run to
/// run. All lengths stay, so offsets into the file do too. A file without such a header is left as it is.
fn sort_header(file: &mut (impl Read + Write + Seek)) -> std::io::Result<()> {
    let length = file.seek(SeekFrom::End(0))?;
    // Headers have some kilobytes, or some more where they name what mattes show.
    let mut known = 1 << 14;
    loop {
        file.rewind()?;
        let mut begin = Vec::new();
        Read::by_ref(file).take(known).read_to_end(&mut begin)?;
        if let Some(sorted) = sorted_header(&begin) {
            file.seek(SeekFrom::Start(HEADER as u64))?;
            return file.write_all(&sorted);
        }
        if known >= length {
            return Ok(());
        }
        known *= 8;
    }
}

/// Where the header begins, after magic number and version.
const HEADER: usize = 8;

/// The sorted entries of the header of a file that begins with these bytes; none where it does not end among them.
fn sorted_header(bytes: &[u8]) -> Option<Vec<u8>> {
    // Name, 0, type, 0, length, value; an empty name ends the header.
    let text_end = |at: usize| Some(at + bytes.get(at..)?.iter().position(|&b| b == 0)? + 1);
    let entry_end = |at: usize| {
        let length_at = text_end(text_end(at)?)?;
        let length = u32::from_le_bytes(*bytes.get(length_at..)?.first_chunk()?);
        Some(length_at + 4 + length as usize).filter(|&end| end <= bytes.len())
    };
    let mut entries: Vec<&[u8]> = Vec::new();
    let mut at = HEADER;
    while *bytes.get(at)? != 0 {
        let end = entry_end(at)?;
        entries.push(&bytes[at..end]);
        at = end;
    }
    // A name ends in 0, which is below every letter, so whole entries are ordered as their names are.
    entries.sort_unstable();
    Some(entries.concat())
}

/// Writes a picture atomically.
///
/// # Errors
/// [`Error::Options`] where the picture is empty, a channel has another size, or it cannot be encoded; [`Error::Io`] naming `path`; those of
/// reading channels.
pub fn write(path: &Path, picture: &Picture) -> Result<()> {
    write_file(path, |file| encode(picture, path, file))
}

#[cfg(test)]
mod tests {
    use super::super::window::Window;
    use super::encode as encode_to;
    use super::*;
    use std::io::Cursor;

    fn encode(picture: &Picture) -> Result<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        encode_to(picture, Path::new("out.exr"), &mut bytes).map(|()| bytes.into_inner())
    }
    use exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
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
        let channels =
            ["normal.X", "albedo.R"].map(|name| Channel { name: name.into(), values: values.clone() }).to_vec();
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
        assert_eq!(layer.channel_data.list[4].sample_data, FlatSamples::F32(values.clone()));
        assert_eq!(layer.attributes.layer_position, exr::math::Vec2(4, 5));
        assert_eq!(read.attributes.display_window, IntegerBounds::from_dimensions((10, 9)));
        let names = ["a\0b", "", &"a".repeat(256), &"b".repeat(255)].map(str::to_owned);
        let odd = names.map(|name| Channel { name, values: values.clone() }).to_vec();
        let attributes = ["a\0b", "c"].map(|name| (name.to_owned(), "some\0thing".to_owned()));
        let bytes = encode(&Picture { channels: &odd, attributes: &attributes, ..picture }).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.exr"), bytes).unwrap();
        let (.., read) = crate::picture::read_exr_channels(&folder.path().join("a.exr")).unwrap();
        assert_eq!(read.len(), 4, "what has a name that EXR does not know is left out");
        let short = vec![Channel { name: "depth.Z".into(), values: vec![0.0; 5] }];
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
