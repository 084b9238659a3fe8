//! Reading OpenEXR, by the crate `exr`.

use std::io::Cursor;
use std::path::Path;

use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use glam::Vec3;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::picture::Image;

use super::{LARGEST_FILE, MOST_PIXELS};

/// Most samples of all channels and layers together: enough for a picture of 3840 × 2160 with every layer that a render writes.
const MOST_SAMPLES: u64 = 1 << 29;

/// Most pixels of a tile, where the picture has fewer.
const LARGEST_TILE: u64 = 1 << 22;
/// Largest expansion of a byte: DEFLATE's factor of 1032, times 4/3 for PXR24, which leaves out a quarter of each number.
const MOST_EXPANSION: u64 = 1032 * 4 / 3;

/// Width, height and named channels of a picture, row by row from the top left.
pub type Channels = (usize, usize, Vec<(String, Vec<f32>)>);

/// Reads every channel of every layer that has the size of the first one. Channels of a named layer are called
/// `layer.channel`. Values may be infinite or NaN.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] naming the file.
pub fn read_exr_channels(path: &Path) -> Result<Channels> {
    decode(path, &read_bytes(path, LARGEST_FILE)?)
}

fn decode(path: &Path, bytes: &[u8]) -> Result<Channels> {
    let fail = |why: String| Error::malformed(Place::file(path), format!("not a readable EXR file: {why}"));
    check_sizes(path, bytes)?;
    let layers = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = layers.non_parallel().from_buffered(Cursor::new(bytes)).map_err(|error| fail(error.to_string()))?;
    let size = image.layer_data.first().ok_or_else(|| fail("it holds no layer".into()))?.size;
    let mut channels = Vec::new();
    for layer in image.layer_data.into_iter().filter(|layer| layer.size == size) {
        let prefix = layer.attributes.layer_name.as_ref().map_or(String::new(), |name| format!("{name}."));
        // Channels at a lower resolution (chroma) are not colours that we know.
        for channel in layer.channel_data.list.into_iter().filter(|channel| channel.sample_data.len() == size.area()) {
            channels.push((format!("{prefix}{}", channel.name), floats(channel.sample_data)));
        }
    }
    Ok((size.width(), size.height(), channels))
}

fn floats(samples: FlatSamples) -> Vec<f32> {
    match samples {
        FlatSamples::F16(values) => values.into_iter().map(f32::from).collect(),
        FlatSamples::F32(values) => values,
        FlatSamples::U32(values) => values.into_iter().map(|value| value as f32).collect(),
    }
}

/// Reads only the header, and refuses pictures that would not fit in memory or cannot be in the file.
fn check_sizes(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail = |why: String| Error::malformed(Place::file(path), format!("not a readable EXR file: {why}"));
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|error| fail(error.to_string()))?;
    let (mut samples, mut unpacked) = (0u64, 0u64);
    for header in &meta.headers {
        let limit = |what: &str, value: u64, limit: u64| match value > limit {
            true => Err(Error::Limit { place: Place::file(path), what: what.to_owned(), value, limit }),
            false => Ok(()),
        };
        let size = header.layer_size;
        let pixels = (size.width() as u64).saturating_mul(size.height() as u64);
        limit("number of pixels", pixels, MOST_PIXELS)?;
        samples = samples.saturating_add(pixels.saturating_mul(header.channels.list.len() as u64));
        limit("number of samples", samples, MOST_SAMPLES)?;
        if let BlockDescription::Tiles(tiles) = header.blocks {
            // Buffers have the size of a tile, also where the picture is smaller.
            let tile = (tiles.tile_size.width() as u64).saturating_mul(tiles.tile_size.height() as u64);
            limit("number of pixels of a tile", tile, pixels.max(LARGEST_TILE))?;
        }
        for channel in &header.channels.list {
            let sampling = (channel.sampling.x() as u64).saturating_mul(channel.sampling.y() as u64).max(1);
            unpacked = unpacked.saturating_add(pixels / sampling * channel.sample_type.bytes_per_sample() as u64);
        }
        // Each chunk has an entry of eight bytes in a table.
        if header.chunk_count as u64 > bytes.len() as u64 / 8 {
            return Err(fail(format!("{} chunks in {} bytes", header.chunk_count, bytes.len())));
        }
    }
    if unpacked / MOST_EXPANSION > bytes.len() as u64 {
        return Err(fail(format!("{unpacked} bytes of pixels cannot be in {} bytes", bytes.len())));
    }
    Ok(())
}

/// Picks the colour of an EXR file: R, G, B, or else Y, or else those of the first layer that has them.
pub(super) fn read_color(path: &Path, bytes: &[u8]) -> Result<Image> {
    let (width, height, channels) = decode(path, bytes)?;
    let find = |name: &str| channels.iter().find(|(other, _)| other == name).map(|(_, values)| values);
    let prefixes = std::iter::once("").chain(channels.iter().filter_map(|(name, _)| Some(name.rsplit_once('.')?.0)));
    for prefix in prefixes {
        let in_layer = |name: &str| if prefix.is_empty() { find(name) } else { find(&format!("{prefix}.{name}")) };
        let rgb = (in_layer("R"), in_layer("G"), in_layer("B"));
        let rgb = match (rgb, in_layer("Y")) {
            ((Some(r), Some(g), Some(b)), _) => [r, g, b],
            (_, Some(y)) => [y, y, y],
            _ => continue,
        };
        let pixels = (0..width * height).map(|i| Vec3::from_array(rgb.map(|channel| channel[i]))).collect();
        return Ok(Image { width, height, pixels });
    }
    let names: Vec<&str> = channels.iter().map(|(name, _)| name.as_str()).collect();
    Err(Error::Unsupported {
        place: Place::file(path),
        what: format!("a picture with the channels {}", names.join(", ")),
        supported: "R, G and B, or Y".into(),
    })
}
