//! Reading PFM ("portable float map"): a header of three lines, then rows of singles from the bottom up.

use glam::Vec3;

use crate::base::{Error, Place, Result};
use crate::picture::Image;

use super::MOST_PIXELS;

/// Whether the bytes begin as PFM does.
pub fn is_pfm(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'F' | b'f', next, ..] if next.is_ascii_whitespace())
}

/// Reads linear colours, or greys of a file with one channel. The last number of the header says by its sign in which order bytes are; its
/// size is a unit that readers leave to themselves.
///
/// # Errors
/// [`Error::Limit`], [`Error::Malformed`].
pub fn read_pfm(place: &Place, bytes: &[u8]) -> Result<Image> {
    let fail = |why: String| Error::malformed(place.clone(), format!("not a readable PFM file: {why}"));
    let mut rest = bytes;
    let mut word = || -> Option<&str> {
        let begin = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let length = rest[begin..].iter().position(u8::is_ascii_whitespace)?;
        let (word, after) = rest[begin..].split_at(length);
        // One white space ends the header: what follows may look like more.
        rest = &after[1..];
        std::str::from_utf8(word).ok()
    };
    let channels = if word() == Some("PF") { 3 } else { 1 };
    let mut size = || word().and_then(|word| word.parse::<u32>().ok()).filter(|size| *size > 0);
    let (Some(width), Some(height)) = (size(), size()) else { return Err(fail("it has no size".into())) };
    let scale = word().and_then(|word| word.parse::<f32>().ok()).filter(|scale| *scale != 0.0 && scale.is_finite());
    let scale = scale.ok_or_else(|| fail("nothing says in which order bytes are".into()))?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MOST_PIXELS {
        let (place, what) = (place.clone(), "number of pixels".into());
        return Err(Error::Limit { place, what, value: pixels, limit: MOST_PIXELS });
    }
    let expected = pixels * channels * 4;
    if (rest.len() as u64) < expected {
        return Err(fail(format!("{} bytes of pixels, expected {expected}", rest.len())));
    }
    let number = |four: &[u8; 4]| if scale < 0.0 { f32::from_le_bytes(*four) } else { f32::from_be_bytes(*four) };
    let (numbers, _) = rest.as_chunks::<4>();
    let color = |numbers: &[[u8; 4]]| match numbers {
        [r, g, b] => Vec3::new(number(r), number(g), number(b)),
        _ => Vec3::splat(number(&numbers[0])),
    };
    let (width, height, channels) = (width as usize, height as usize, channels as usize);
    let rows = numbers[..width * height * channels].chunks_exact(width * channels).rev();
    let pixels = rows.flat_map(|row| row.chunks_exact(channels)).map(color).collect();
    Ok(Image { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(header: &str, numbers: &[f32], little: bool) -> Result<Image> {
        let mut bytes = header.as_bytes().to_vec();
        let four = |number: &f32| if little { number.to_le_bytes() } else { number.to_be_bytes() };
        bytes.extend(numbers.iter().flat_map(four));
        assert!(is_pfm(&bytes));
        read_pfm(&Place::file("test.pfm"), &bytes)
    }

    #[test]
    fn rows_and_bytes_in_their_order() {
        let numbers: Vec<f32> = (0..12).map(|i| i as f32).collect();
        for (header, little) in [("PF\n2 2\n-1.0\n", true), ("PF 2 2 1\n", false)] {
            let Image { width, height, pixels } = read(header, &numbers, little).unwrap();
            let row = |first: f32| [0.0, 3.0].map(|x| Vec3::new(first + x, first + x + 1.0, first + x + 2.0));
            assert_eq!((width, height, &pixels[..]), (2, 2, &[row(6.0), row(0.0)].concat()[..]));
        }
        // The first byte of the pixels is a line's end.
        let grey = read("Pf\n1 2\n-2\n", &[f32::from_le_bytes([b'\n', 0, 0, 64]), 3.0], true).unwrap();
        assert_eq!(grey.pixels, [Vec3::splat(3.0), Vec3::splat(f32::from_le_bytes([b'\n', 0, 0, 64]))]);
    }

    #[test]
    fn headers_are_not_believed() {
        for header in
            ["PF\n", "PF\n2\n", "PF\n2 0\n-1\n", "PF\n-2 2\n-1\n", "PF\n2 2\n0\n", "PF\n2 2\nnan\n", "PF\n9 9\n-1\n"]
        {
            assert!(matches!(read(header, &[0.0; 12], true), Err(Error::Malformed { .. })), "{header}");
        }
        assert!(matches!(read("PF\n4294967295 4294967295\n-1\n", &[0.0; 3], true), Err(Error::Limit { .. })));
    }
}
