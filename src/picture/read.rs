//! Reading pictures: EXR and PNG by their own crates, JPEG, TGA, BMP, WebP, QOI and HDR (RGBE) by the crate `image`, PFM by our own lines.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use ::image::{DynamicImage, ImageError, ImageFormat, ImageReader, Limits, Rgb};
use glam::Vec3;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::math::srgb;
use crate::picture::{ByteImage, Image, Texels};

use super::samples::{Samples, Values};
use super::{LARGEST_FILE, MOST_PIXELS, read_exr, read_pfm};

const EXR_MAGIC: [u8; 4] = [0x76, 0x2F, 0x31, 0x01];
const PNG_MAGIC: [u8; 4] = [0x89, b'P', b'N', b'G'];

/// Reads a picture as linear RGB, see [`read_texels`].
///
/// # Errors
/// Those of [`read_texels`].
pub fn read_image(path: &Path, raw: bool) -> Result<Image> {
    Ok(Arc::unwrap_or_clone(decoded(path, raw)?.to_image()))
}

/// Reads a picture. Its content decides on the format; only TGA, which has no signature, goes by the name. All formats but EXR,
/// HDR and PFM hold sRGB values, unless `raw` says that they are data. Alpha is ignored. What has sixteen bits a channel or fewer is kept so.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] (also for NaN or infinite pixels), [`Error::Unsupported`].
pub fn read_texels(path: &Path, raw: bool) -> Result<Texels> {
    Ok(decoded(path, raw)?.compact())
}

/// As [`read_texels`], floats as floats.
fn decoded(path: &Path, raw: bool) -> Result<Texels> {
    let bytes = read_bytes(path, LARGEST_FILE)?;
    let texels = match bytes.first_chunk() {
        Some(&EXR_MAGIC) => Texels::Float(Arc::new(read_exr::read_color(path, &bytes)?)),
        Some(&PNG_MAGIC) => read_png(&Place::file(path), &bytes)?.into_texels(raw),
        _ if read_pfm::is_pfm(&bytes) => Texels::Float(Arc::new(read_pfm::read_pfm(&Place::file(path), &bytes)?)),
        _ => match other_format(path, &bytes) {
            Some(format) => read_other(path, &bytes, format, raw)?,
            None => {
                return Err(Error::Unsupported {
                    place: Place::file(path),
                    what: "this picture format".into(),
                    supported: "EXR, PNG, JPEG, TGA, BMP, WebP, QOI, HDR and PFM".into(),
                });
            }
        },
    };
    if let Texels::Float(image) = &texels
        && let Some(i) = image.pixels.iter().position(|pixel| !pixel.is_finite())
    {
        let (x, y) = (i % image.width, i / image.width);
        return Err(Error::malformed(Place::part(path, format!("pixel {x}, {y}")), "the pixel is not finite"));
    }
    Ok(texels)
}

/// Reads the bytes of a PNG, JPEG or WebP picture at `place`, with its alpha.
///
/// # Errors
/// [`Error::Limit`], [`Error::Malformed`], [`Error::Unsupported`].
pub fn read_samples(place: &Place, bytes: &[u8]) -> Result<Samples> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => read_png(place, bytes),
        [0xFF, 0xD8, 0xFF, ..] => {
            let decoded = decode_other(place, bytes, ImageFormat::Jpeg)?;
            let (width, height) = (decoded.width() as usize, decoded.height() as usize);
            let (channels, values) = match decoded {
                DynamicImage::ImageLuma8(pixels) => (1, Values::Eight(pixels.into_raw())),
                DynamicImage::ImageRgb8(pixels) => (3, Values::Eight(pixels.into_raw())),
                other => (3, Values::Sixteen(other.into_rgb16().into_raw())),
            };
            Samples::new([width, height], channels, values).ok_or_else(|| wrong_count(place))
        }
        _ if is_webp(bytes) => {
            let decoded = decode_other(place, bytes, ImageFormat::WebP)?;
            let (width, height) = (decoded.width() as usize, decoded.height() as usize);
            let (channels, values) = match decoded {
                DynamicImage::ImageRgba8(pixels) => (4, pixels.into_raw()),
                other => (3, other.into_rgb8().into_raw()),
            };
            Samples::new([width, height], channels, Values::Eight(values)).ok_or_else(|| wrong_count(place))
        }
        _ => Err(Error::Unsupported {
            place: place.clone(),
            what: "this picture format".into(),
            supported: "PNG, JPEG and WebP".into(),
        }),
    }
}

fn wrong_count(place: &Place) -> Error {
    Error::malformed(place.clone(), "it holds another number of pixels than it says")
}

fn read_png(place: &Place, bytes: &[u8]) -> Result<Samples> {
    let fail = |why: String| Error::malformed(place.clone(), format!("not a readable PNG file: {why}"));
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    // Palettes and fewer than 8 bits become 8 bits per channel.
    decoder.set_transformations(png::Transformations::EXPAND);
    let info = decoder.read_header_info().map_err(|error| fail(error.to_string()))?;
    let pixels = u64::from(info.width) * u64::from(info.height);
    if pixels > MOST_PIXELS {
        let (place, what) = (place.clone(), "number of pixels".into());
        return Err(Error::Limit { place, what, value: pixels, limit: MOST_PIXELS });
    }
    // DEFLATE expands at most 1032-fold.
    if pixels / 8 * info.bits_per_pixel() as u64 > 1032 * bytes.len() as u64 {
        return Err(fail(format!("{pixels} pixels cannot be in {} bytes", bytes.len())));
    }
    let mut reader = decoder.read_info().map_err(|error| fail(error.to_string()))?;
    // The decoder relies on whole colours.
    if let Some(bytes) = reader.info().palette.as_ref().map(|palette| palette.len()).filter(|bytes| bytes % 3 != 0) {
        return Err(fail(format!("a palette of {bytes} bytes, expected a multiple of three")));
    }
    let size = reader.output_buffer_size().ok_or_else(|| fail("it is too large".into()))?;
    let mut samples = vec![0; size];
    let frame = reader.next_frame(&mut samples).map_err(|error| fail(error.to_string()))?;
    let (width, height, channels) = (frame.width as usize, frame.height as usize, frame.color_type.samples());
    let values = if frame.bit_depth == png::BitDepth::Sixteen {
        Values::Sixteen(samples.as_chunks::<2>().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect())
    } else {
        Values::Eight(samples)
    };
    Samples::new([width, height], channels, values)
        .ok_or_else(|| fail("it holds another number of pixels than it says".into()))
}

/// Replaces the first line of an HDR file, which may name the program or the pixel format, by the only one that the decoder knows.
fn radiance_header(bytes: &[u8]) -> Cow<'_, [u8]> {
    const NAME: &[u8] = b"#?RADIANCE";
    let end = bytes.iter().position(|&byte| byte == b'\n').unwrap_or(bytes.len());
    if bytes[..end] == *NAME { Cow::Borrowed(bytes) } else { Cow::Owned([NAME, &bytes[end..]].concat()) }
}

fn is_webp(bytes: &[u8]) -> bool {
    bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP")
}

fn other_format(path: &Path, bytes: &[u8]) -> Option<ImageFormat> {
    let named = |extension: &str| path.extension().is_some_and(|other| other.eq_ignore_ascii_case(extension));
    match bytes {
        [0xFF, 0xD8, 0xFF, ..] => Some(ImageFormat::Jpeg),
        [b'B', b'M', ..] => Some(ImageFormat::Bmp),
        [b'#', b'?', ..] => Some(ImageFormat::Hdr),
        [b'q', b'o', b'i', b'f', ..] => Some(ImageFormat::Qoi),
        _ if is_webp(bytes) => Some(ImageFormat::WebP),
        _ if named("tga") => Some(ImageFormat::Tga),
        _ => None,
    }
}

/// Most pixels that a file of so many `bytes` may have: what the longest runs of a format make of them, and of WebP, which needs no bits for
/// what is all alike, a small picture whatever its bytes.
fn most_pixels(format: ImageFormat, bytes: u64) -> u64 {
    match format {
        ImageFormat::Bmp | ImageFormat::Hdr => 128 * bytes,
        ImageFormat::Qoi | ImageFormat::Tga => 64 * bytes,
        ImageFormat::WebP => (4096 * bytes).max(1 << 22),
        _ => 4096 * bytes,
    }
}

fn decode_other(place: &Place, bytes: &[u8], format: ImageFormat) -> Result<DynamicImage> {
    let bytes = &*if format == ImageFormat::Hdr { radiance_header(bytes) } else { Cow::Borrowed(bytes) };
    let fail = |error: ImageError| Error::malformed(place.clone(), format!("not a readable picture: {error}"));
    let mut limits = Limits::default();
    // The sides are compared with this before anything is allocated; so are the bytes.
    limits.max_image_width = Some(1 << 16);
    limits.max_image_height = Some(1 << 16);
    limits.max_alloc = Some(16 * MOST_PIXELS);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits.clone());
    let (width, height) = reader.into_dimensions().map_err(fail)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MOST_PIXELS {
        let (place, what) = (place.clone(), "number of pixels".into());
        return Err(Error::Limit { place, what, value: pixels, limit: MOST_PIXELS });
    }
    if pixels > most_pixels(format, bytes.len() as u64) {
        let message = format!("not a readable picture: {pixels} pixels cannot be in {} bytes", bytes.len());
        return Err(Error::malformed(place.clone(), message));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    reader.decode().map_err(fail)
}

fn read_other(path: &Path, bytes: &[u8], format: ImageFormat, raw: bool) -> Result<Texels> {
    let place = Place::file(path);
    let decoded = decode_other(&place, bytes, format)?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let bytes = |channels: usize, samples: Vec<u8>| ByteImage::new(width, height, channels, samples, raw);
    let image = match decoded {
        DynamicImage::ImageLuma8(pixels) => bytes(1, pixels.into_raw()),
        DynamicImage::ImageLumaA8(pixels) => bytes(2, pixels.into_raw()),
        DynamicImage::ImageRgb8(pixels) => bytes(3, pixels.into_raw()),
        DynamicImage::ImageRgba8(pixels) => bytes(4, pixels.into_raw()),
        other => {
            let value = |sample: f32| if raw || format == ImageFormat::Hdr { sample } else { srgb::linear(sample) };
            let pixel = |pixel: &Rgb<f32>| Vec3::from_array(pixel.0.map(value));
            let pixels = other.into_rgb32f().pixels().map(pixel).collect();
            return Ok(Texels::Float(Arc::new(Image { width, height, pixels })));
        }
    };
    Ok(Texels::Bytes(Arc::new(image.ok_or_else(|| wrong_count(&place))?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png_file(color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 2, 1);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        out
    }

    fn parse(bytes: &[u8], raw: bool) -> Result<Image> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read_image(file.path(), raw)
    }

    #[test]
    fn png_kinds() {
        let rgb = png_file(png::ColorType::Rgb, png::BitDepth::Eight, &[255, 0, 188, 51, 102, 204]);
        let image = parse(&rgb, true).unwrap();
        assert_eq!((image.width, image.height), (2, 1));
        assert!(image.pixels[1].distance(Vec3::new(0.2, 0.4, 0.8)) < 1e-6);
        // sRGB 188 is the middle grey: about half the light.
        let image = parse(&rgb, false).unwrap();
        assert!((image.pixels[0] - Vec3::new(1.0, 0.0, 0.5029)).length() < 1e-3, "{}", image.pixels[0]);
        let grey = png_file(png::ColorType::GrayscaleAlpha, png::BitDepth::Sixteen, &[0x80, 0, 0, 0, 0xFF, 0xFF, 0, 0]);
        let image = parse(&grey, true).unwrap();
        assert!(image.pixels[0].distance(Vec3::splat(0.5)) < 1e-4 && image.pixels[1] == Vec3::ONE);
    }

    /// Claims 2³¹ × 2³¹ pixels, then 10000 × 10000, in fifty bytes.
    #[test]
    fn png_sizes_are_not_believed() {
        for side in [i32::MAX as u32, 11_000] {
            let mut bytes = png_file(png::ColorType::Grayscale, png::BitDepth::Eight, &[0, 0]);
            bytes[16..20].copy_from_slice(&side.to_be_bytes());
            bytes[20..24].copy_from_slice(&side.to_be_bytes());
            let mut crc = flate2::Crc::new();
            crc.update(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&crc.sum().to_be_bytes());
            let error = parse(&bytes, true).unwrap_err();
            assert!(matches!(error, Error::Limit { .. } | Error::Malformed { .. }), "{error}");
        }
    }

    /// Sixteen bits of four channels are more than DEFLATE makes of so little, where one bit of one might be there.
    #[test]
    fn png_sizes_go_by_their_bits() {
        let cut = |depth| {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, 8192, 8192);
            encoder.set_color(png::ColorType::Rgba);
            encoder.set_depth(depth);
            std::mem::forget(encoder.write_header().unwrap());
            bytes.resize(20_000, 0);
            parse(&bytes, true).unwrap_err().to_string()
        };
        assert!(cut(png::BitDepth::Sixteen).contains("cannot be in 20000 bytes"));
    }

    /// WebP needs no bits for pixels that are all alike: a lossless file of 32 bytes.
    #[test]
    fn webp_of_one_colour() {
        let mut bits = 0u128;
        let mut end = 0;
        let mut push = |value: u128, count: u32| {
            bits |= value << end;
            end += count;
        };
        // Signature, columns and rows less 1, no alpha, version 0, no transforms, no cache, one group of codes.
        [(0x2F, 8), (1023, 14), (1023, 14), (0, 1), (0, 3), (0, 3)].into_iter().for_each(|(v, n)| push(v, n));
        // Codes of one symbol each: green, red, blue and alpha of eight bits, and a distance of one.
        [188, 188, 188, 255].into_iter().for_each(|symbol| push(0b101 | symbol << 3, 11));
        push(0b001, 4);
        let data = &bits.to_le_bytes()[..12];
        let bytes = [&b"RIFF"[..], &24u32.to_le_bytes(), b"WEBPVP8L", &12u32.to_le_bytes(), data].concat();
        let image = parse(&bytes, true).unwrap();
        assert_eq!((image.width, image.height, bytes.len()), (1024, 1024, 32));
        assert!(image.pixels.iter().all(|pixel| pixel.distance(Vec3::splat(188.0 / 255.0)) < 1e-6));
    }

    #[test]
    fn other_content_is_named() {
        assert!(matches!(parse(b"GIF89a", false), Err(Error::Unsupported { .. })));
        assert!(matches!(parse(b"", false), Err(Error::Unsupported { .. })));
    }
}
