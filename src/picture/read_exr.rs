//! Reading OpenEXR, by the crate `exr`.

use std::collections::{HashMap, HashSet};
use std::io::Cursor;
use std::path::Path;

use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use glam::Vec3;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result, named};
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
    let Some(rgb) = colour(&channels) else {
        return Err(Error::Unsupported {
            place: Place::file(path),
            what: format!("a picture with the channels {}", named(channels.iter().map(|(name, _)| name))),
            supported: "R, G and B, or Y".into(),
        });
    };
    let pixels = (0..width * height).map(|i| Vec3::from_array(rgb.map(|channel| channel[i]))).collect();
    Ok(Image { width, height, pixels })
}

/// The channels that are a picture's colour, three times the same one where it is grey. Each is looked up: a file of
/// two megabytes may have a hundred thousand.
fn colour(channels: &[(String, Vec<f32>)]) -> Option<[&[f32]; 3]> {
    let mut first: HashMap<&str, &[f32]> = HashMap::with_capacity(channels.len());
    for (name, values) in channels {
        first.entry(name).or_insert(values);
    }
    let mut seen = HashSet::new();
    let layers = channels.iter().filter_map(|(name, _)| Some(name.rsplit_once('.')?.0));
    std::iter::once("").chain(layers).filter(|layer| seen.insert(*layer)).find_map(|layer| {
        let find = |name: &str| match layer {
            "" => first.get(name).copied(),
            _ => first.get(format!("{layer}.{name}").as_str()).copied(),
        };
        match ((find("R"), find("G"), find("B")), find("Y")) {
            ((Some(r), Some(g), Some(b)), _) => Some([r, g, b]),
            (_, Some(y)) => Some([y; 3]),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels<const N: usize>(of: [(&str, f32); N]) -> [(String, Vec<f32>); N] {
        of.map(|(name, value)| (name.to_owned(), vec![value]))
    }

    /// Comparing each with each would take minutes.
    #[test]
    fn colours_are_found_among_many_channels() {
        let mut all: Vec<_> = (0..100_000).map(|i| (format!("layer{i}.Z"), vec![0.0])).collect();
        assert_eq!(colour(&all), None);
        // The first layer that has them, and of channels of one name the first.
        all.extend(channels([("c.R", 1.0), ("c.G", 2.0), ("b.Y", 3.0), ("c.B", 4.0), ("c.B", 5.0), ("c.Y", 6.0)]));
        assert_eq!(colour(&all), Some([&[1.0][..], &[2.0], &[4.0]]));
        all.extend(channels([("Y", 7.0), ("R", 8.0), ("G", 9.0)]));
        assert_eq!(colour(&all), Some([&[7.0][..]; 3]));
        all.extend(channels([("B", 10.0)]));
        assert_eq!(colour(&all), Some([&[8.0][..], &[9.0], &[10.0]]));
    }
}
