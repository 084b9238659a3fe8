//! Writing PNG for display: 8 bits per channel.

use std::path::Path;

use crate::base::files::write_bytes;
use crate::base::{Error, Result};
use crate::picture::{Display, Image};

/// Encodes a picture as `display` shows it.
///
/// # Errors
/// [`Error::Options`] where the picture is empty or cannot be encoded.
pub fn encode(image: &Image, display: Display) -> Result<Vec<u8>> {
    if image.width == 0 || image.pixels.len() != image.width * image.height {
        return Err(Error::Options("an empty picture cannot be written".into()));
    }
    let data: Vec<u8> = image.pixels.iter().flat_map(|&pixel| display.bytes(pixel)).collect();
    let fail = |e: png::EncodingError| Error::Options(format!("the picture could not be encoded as PNG: {e}"));
    let side =
        |n: usize| u32::try_from(n).map_err(|_| Error::Options(format!("a side of {n} pixels is too long for PNG")));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side(image.width)?, side(image.height)?);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(fail)?;
    writer.write_image_data(&data).map_err(fail)?;
    writer.finish().map_err(fail)?;
    Ok(bytes)
}

/// Writes a picture atomically.
///
/// # Errors
/// As [`encode`], and [`Error::Io`] naming `path`.
pub fn write(path: &Path, image: &Image, display: Display) -> Result<()> {
    write_bytes(path, &encode(image, display)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn exposure_and_curve_as_decoded() {
        let pixels = vec![Vec3::new(0.0, 0.107_93, 0.5), Vec3::new(-1.0, f32::NAN, 9.0)];
        let bytes =
            encode(&Image { width: 2, height: 1, pixels }, Display { exposure: 1.0, ..Display::default() }).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut data = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut data).unwrap();
        // 0.21586 is the linear value of 128 in every sRGB table.
        assert_eq!(data, [0, 128, 255, 0, 0, 255]);
    }
}
