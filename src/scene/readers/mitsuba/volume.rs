//! Quantities that vary in space: the mean of what a volume holds.

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::math::channel_mean;
use crate::scene::readers::missing::{Absent, is_absent};
use crate::scene::readers::path;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind};

/// Largest volume file, bytes.
const LARGEST: u64 = 2 << 30;
/// Bytes before the values of a grid.
const HEADER: usize = 48;

impl<'a> Reader<'a> {
    /// A colour, or the mean of the volume or texture that stands for it.
    pub(super) fn varying(&mut self, object: &Object<'a>, name: &str) -> Result<Option<[f32; 3]>> {
        match object.property(name) {
            Some(element) if element.tag == "volume" => self.volume(element).map(Some),
            _ => self.mean_color(object, name, Use::Index),
        }
    }

    fn volume(&mut self, element: &'a Element) -> Result<[f32; 3]> {
        let kind = kind(element)?;
        if kind == "constvolume" {
            let object = Object::new(element, &self.ids, &["value"], &[])?;
            return Ok(self.mean_color(&object, "value", Use::Index)?.unwrap_or([1.0; 3]));
        }
        let known = [
            "filename",
            "scale",
            "to_world",
            "use_grid_bbox",
            "raw",
            "filter_type",
            "wrap_mode",
            "accel",
            "min",
            "max",
        ];
        let object = Object::new(element, &self.ids, &known, &[])?;
        if kind != "gridvolume" {
            self.warn(element, format_args!("the volume \"{kind}\" is not known: the constant 1 is used"));
            return Ok([1.0; 3]);
        }
        let file = self.located(object.required_string("filename")?);
        if is_absent(&self.folder, &file) {
            let instead = Some("the constant 1 is used instead".to_owned());
            self.absent.push(Absent { file, place: element.place.clone(), instead });
            return Ok([1.0; 3]);
        }
        let path = path::resolve(&self.folder, &file, &element.place)?;
        self.warn(element, "a grid: the mean of its values is used everywhere");
        let mean = mean(&read_bytes(&path, LARGEST)?, &Place::file(path))?;
        Ok(mean.map(|x| x.max(0.0)))
    }
}

/// The mean of a grid in Mitsuba's format: three bytes "VOL" and the version 3; then little-endian integers: 1 for `f32` or 3 for
/// bytes, sizes along x, y and z, channels; a box of six `f32`; the values.
fn mean(bytes: &[u8], place: &Place) -> Result<[f32; 3]> {
    let malformed = |message: &str| Error::malformed(place.clone(), message);
    if !bytes.starts_with(b"VOL\x03") || bytes.len() < HEADER {
        return Err(malformed("not a grid volume: expected \"VOL\" and the version 3"));
    }
    let integer = |at: usize| bytes[at..at + 4].iter().rev().fold(0u32, |sum, byte| sum << 8 | u32::from(*byte));
    let (encoding, channels) = (integer(4), integer(20) as usize);
    let size = match encoding {
        1 => 4,
        3 => 1,
        other => {
            let what = format!("values of type {other} in a grid volume");
            let supported = "1 (f32), 3 (bytes)".to_owned();
            return Err(Error::Unsupported { place: place.clone(), what, supported });
        }
    };
    let cells = [8, 12, 16].iter().try_fold(1usize, |product, at| product.checked_mul(integer(*at) as usize));
    let values = &bytes[HEADER..];
    let needed = cells.and_then(|cells| cells.checked_mul(channels)?.checked_mul(size));
    if channels == 0 || needed.is_none_or(|needed| needed == 0 || needed > values.len()) {
        return Err(malformed("the grid is empty, or larger than its file"));
    }
    let mut sums = [0.0f64; 3];
    for cell in values.chunks_exact(size * channels).take(cells.unwrap_or(0)) {
        for (channel, sum) in sums.iter_mut().enumerate() {
            let at = size * if channels >= 3 { channel } else { 0 };
            *sum += match size {
                1 => f64::from(cell[at]) / 255.0,
                _ => f64::from(f32::from_le_bytes([cell[at], cell[at + 1], cell[at + 2], cell[at + 3]])),
            };
        }
    }
    let mean = sums.map(|sum| (sum / cells.unwrap_or(1) as f64) as f32);
    if channel_mean(mean.into()).is_finite() { Ok(mean) } else { Err(malformed("a value of the grid is not finite")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(encoding: u32, channels: u32, values: &[u8]) -> Vec<u8> {
        let mut bytes = b"VOL\x03".to_vec();
        [encoding, 2, 1, 1, channels].iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        bytes.extend([0; 24]);
        bytes.extend(values);
        bytes
    }

    #[test]
    fn means_of_grids() {
        let place = Place::file("a.vol");
        assert_eq!(mean(&grid(3, 1, &[0, 255]), &place).unwrap(), [0.5; 3]);
        let values: Vec<u8> = [1.0f32, 2.0, 3.0, 3.0, 2.0, 1.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(mean(&grid(1, 3, &values), &place).unwrap(), [2.0; 3]);
        let huge = {
            let mut bytes = grid(1, 1, &[0; 8]);
            bytes[8..20].fill(0xFF);
            bytes
        };
        for wrong in [b"VOL".to_vec(), grid(2, 1, &[0; 8]), grid(1, 1, &[0; 7]), grid(1, 0, &[0; 8]), huge] {
            assert!(mean(&wrong, &place).is_err());
        }
        let mut infinite = grid(1, 1, &[0; 8]);
        infinite[48..52].copy_from_slice(&f32::INFINITY.to_le_bytes());
        assert!(mean(&infinite, &place).is_err());
    }
}
