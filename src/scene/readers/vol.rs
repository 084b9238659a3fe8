//! Mitsuba's grid volumes, `.vol`: the bytes "VOL" and the version 3; then little-endian integers: 1 for values of `f32` or 3 for bytes,
//! cells along x, y and z, channels; a box of six `f32`; the values, x fastest, the channels of a cell together.

use std::path::Path;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::materials::grid::Values;

/// Largest volume file, bytes.
const LARGEST: u64 = 2 << 30;
/// Bytes before the values.
const HEADER: usize = 48;
/// How a file of version 3 begins.
const MAGIC: &[u8; 4] = b"VOL\x03";

/// A volume file.
#[derive(Debug, Clone, PartialEq)]
pub struct Vol {
    /// Cells along x, y and z.
    pub size: [u32; 3],
    /// Values of a cell.
    pub channels: u32,
    /// Lowest and highest corner of its box.
    pub corners: [[f32; 3]; 2],
    /// Values of all cells, x fastest.
    pub values: Values,
}

impl Vol {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], and those of [`Vol::decode`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::decode(&read_bytes(path, LARGEST)?, &Place::file(path))
    }

    /// What the bytes of a file say; `place` names it.
    ///
    /// # Errors
    /// [`Error::Malformed`] for what is no volume, is cut, or has values that are not finite; [`Error::Unsupported`] for values of
    /// other types.
    pub fn decode(bytes: &[u8], place: &Place) -> Result<Self> {
        let malformed = |message: &str| Error::malformed(place.clone(), message);
        if !bytes.starts_with(MAGIC) || bytes.len() < HEADER {
            return Err(malformed("not a grid volume: expected \"VOL\" and the version 3"));
        }
        let word = |index: usize| [0, 1, 2, 3].map(|byte| bytes[4 + 4 * index + byte]);
        let integer = |index| u32::from_le_bytes(word(index));
        let (size, channels) = ([1, 2, 3].map(integer), integer(4));
        let width = match integer(0) {
            1 => 4,
            3 => 1,
            other => {
                let what = format!("values of type {other} in a grid volume");
                let supported = "1 (f32), 3 (bytes)".to_owned();
                return Err(Error::Unsupported { place: place.clone(), what, supported });
            }
        };
        let sides = size.iter().chain([&channels]);
        let count = sides.clone().try_fold(1u64, |product, &side| product.checked_mul(u64::from(side)));
        let needed = count.and_then(|count| count.checked_mul(width)).filter(|&needed| needed > 0);
        let needed = needed.filter(|&needed| needed <= (bytes.len() - HEADER) as u64);
        let Some(needed) = needed.and_then(|needed| usize::try_from(needed).ok()) else {
            return Err(malformed("the grid is empty, or larger than its file"));
        };
        let values = &bytes[HEADER..HEADER + needed];
        let values = match width {
            1 => Values::Bytes(values.to_vec()),
            _ => Values::Floats(values.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()),
        };
        if let Values::Floats(values) = &values
            && !values.iter().all(|value| value.is_finite())
        {
            return Err(malformed("a value of the grid is not finite"));
        }
        let corners = [5, 8].map(|first| [0, 1, 2].map(|axis| f32::from_le_bytes(word(first + axis))));
        Ok(Self { size, channels, corners, values })
    }

    /// The bytes of a file that says this.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        let encoding = if matches!(self.values, Values::Bytes(_)) { 3 } else { 1 };
        for word in [encoding].iter().chain(&self.size).chain([&self.channels]) {
            bytes.extend(word.to_le_bytes());
        }
        self.corners.iter().flatten().for_each(|coordinate| bytes.extend(coordinate.to_le_bytes()));
        match &self.values {
            Values::Bytes(values) => bytes.extend(values),
            Values::Floats(values) => values.iter().for_each(|value| bytes.extend(value.to_le_bytes())),
        }
        bytes
    }

    /// Mean of the values, per channel; a single channel is the same in all three.
    pub fn mean(&self) -> [f32; 3] {
        let channels = self.channels as usize;
        let cells = self.values.len() / channels;
        [0, 1, 2].map(|channel| {
            let own = if channels >= 3 { channel } else { 0 };
            let sum: f64 = (0..cells).map(|cell| f64::from(self.values.at(cell * channels + own))).sum();
            (sum / cells as f64) as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(channels: u32, values: Values) -> Vol {
        let size = [values.len() as u32 / channels, 1, 1];
        Vol { size, channels, corners: [[-1.0, 0.0, 2.0], [1.0, 3.0, 4.5]], values }
    }

    #[test]
    fn what_is_written_is_read() {
        for vol in
            [volume(1, Values::Bytes(vec![0, 255, 7])), volume(3, Values::Floats(vec![1.0, 2.0, 3.0, 3.0, 2.0, 1e-3]))]
        {
            assert_eq!(Vol::decode(&vol.encode(), &Place::file("a.vol")).unwrap(), vol);
        }
    }

    #[test]
    fn means_of_grids() {
        assert_eq!(volume(1, Values::Bytes(vec![0, 255])).mean(), [0.5; 3]);
        assert_eq!(volume(3, Values::Floats(vec![1.0, 2.0, 3.0, 3.0, 2.0, 1.0])).mean(), [2.0; 3]);
    }

    #[test]
    fn what_is_cut_or_damaged_is_refused() {
        let place = Place::file("a.vol");
        let good = volume(1, Values::Floats(vec![0.5, 1.5])).encode();
        for end in 0..good.len() {
            assert!(matches!(Vol::decode(&good[..end], &place), Err(Error::Malformed { .. })), "{end}");
        }
        let with = |at: usize, bytes: &[u8]| {
            let mut damaged = good.clone();
            damaged[at..at + bytes.len()].copy_from_slice(bytes);
            Vol::decode(&damaged, &place)
        };
        assert!(matches!(with(4, &[2]), Err(Error::Unsupported { .. })));
        for (at, bytes) in [(3, &[2][..]), (8, &[0xFF; 16]), (20, &[0; 4]), (48, &f32::INFINITY.to_le_bytes())] {
            assert!(matches!(with(at, bytes), Err(Error::Malformed { .. })), "{at}");
        }
    }
}
