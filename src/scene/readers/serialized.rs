//! Mitsuba's `.serialized` meshes, versions 3 and 4: little-endian, each shape compressed by itself, a table of offsets at the
//! end of the file.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;
use glam::{Vec2, Vec3};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;

use super::{LARGEST_MESH_FILE, MOST_ELEMENTS};

const IDENTIFIER: u16 = 0x041C;
const HEADER_BYTES: usize = 4;
/// DEFLATE cannot expand more than this (258 bytes from two bits).
const LARGEST_EXPANSION: u64 = 1032;
const LONGEST_NAME: usize = 4096;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const FACE_NORMALS: u32 = 0x0010;
const DOUBLE_PRECISION: u32 = 0x2000;

/// Reads shape `index` (0-based), and whether it asks for flat shading.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`], [`Error::Unsupported`] naming the file.
pub fn read(path: &Path, index: u32) -> Result<(Mesh, bool)> {
    let bytes = read_bytes(path, LARGEST_MESH_FILE)?;
    let version = header(path, &bytes, 0)?;
    let start = if index == 0 { 0 } else { offset(path, &bytes, version, index)? };
    header(path, &bytes, start)?;
    let compressed = &bytes[start + HEADER_BYTES..];
    Shape {
        input: ZlibDecoder::new(compressed),
        place: Place::part(path, format!("shape {index}")),
        size: compressed.len(),
    }
    .read(version)
}

/// Checks the header at `start` and returns its version.
fn header(path: &Path, bytes: &[u8], start: usize) -> Result<u16> {
    let place = || Place::byte(path, start as u64);
    let field = |at: usize| Some(u16::from_le_bytes(bytes.get(start + at..start + at + 2)?.try_into().ok()?));
    match (field(0), field(2)) {
        (Some(IDENTIFIER), Some(version @ (3 | 4))) => Ok(version),
        (Some(IDENTIFIER), Some(version)) => Err(Error::Unsupported {
            place: place(),
            what: format!("version {version} of .serialized"),
            supported: "3 and 4".into(),
        }),
        _ => Err(Error::malformed(place(), "no shape of a .serialized file begins here")),
    }
}

/// Byte at which shape `index` begins, from the table at the end of the file.
fn offset(path: &Path, bytes: &[u8], version: u16, index: u32) -> Result<usize> {
    let fail = |message: String| Error::malformed(Place::byte(path, bytes.len() as u64), message);
    let count = bytes.last_chunk::<4>().map_or(0, |last| u32::from_le_bytes(*last));
    if index >= count {
        return Err(fail(format!("shape {index} was asked for, but the file has {count}")));
    }
    let width: u64 = if version == 4 { 8 } else { 4 };
    let before_end = 4 + width * u64::from(count - index);
    let entry = (bytes.len() as u64).checked_sub(before_end).and_then(|at| {
        let at = usize::try_from(at).ok()?;
        bytes.get(at..at + width as usize)
    });
    let entry = entry.ok_or_else(|| fail(format!("there is no room for a table of {count} shapes")))?;
    let mut wide = [0; 8];
    wide[..entry.len()].copy_from_slice(entry);
    let start = u64::from_le_bytes(wide);
    match usize::try_from(start) {
        Ok(start) if start < bytes.len() => Ok(start),
        _ => Err(fail(format!("shape {index} would begin at byte {start}, beyond the end"))),
    }
}

struct Shape<'a> {
    input: ZlibDecoder<&'a [u8]>,
    place: Place,
    size: usize,
}

impl Shape<'_> {
    fn read(mut self, version: u16) -> Result<(Mesh, bool)> {
        let flags = self.u32()?;
        if version == 4 {
            self.skip_name()?;
        }
        let (vertices, triangles) = (self.count("vertices")?, self.count("triangles")?);
        self.check_size(flags, vertices, triangles)?;
        let double = flags & DOUBLE_PRECISION != 0;
        let mut mesh = Mesh { positions: self.vectors(vertices, double)?, ..Mesh::default() };
        if flags & HAS_NORMALS != 0 {
            mesh.normals = self.vectors(vertices, double)?;
        }
        if flags & HAS_UVS != 0 {
            let values = self.floats(2 * vertices, double)?;
            mesh.uvs = values.chunks_exact(2).map(Vec2::from_slice).collect();
        }
        if flags & HAS_COLORS != 0 {
            self.floats(3 * vertices, double)?;
        }
        let indices = self.bytes(12 * triangles)?;
        let index = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        mesh.triangles = indices.chunks_exact(12).map(|t| [index(t), index(&t[4..]), index(&t[8..])]).collect();
        Ok((mesh, flags & FACE_NORMALS != 0))
    }

    /// Refuses counts that no compression could have squeezed into this file.
    fn check_size(&self, flags: u32, vertices: u64, triangles: u64) -> Result<()> {
        let mut floats = 3;
        for (flag, components) in [(HAS_NORMALS, 3), (HAS_UVS, 2), (HAS_COLORS, 3)] {
            floats += if flags & flag != 0 { components } else { 0 };
        }
        let width = if flags & DOUBLE_PRECISION != 0 { 8 } else { 4 };
        let needed = vertices * floats * width + 12 * triangles;
        let most = self.size as u64 * LARGEST_EXPANSION;
        if needed > most {
            return Err(self.malformed(format!(
                "{vertices} vertices and {triangles} triangles take {needed} bytes, more than the file can hold ({most})"
            )));
        }
        Ok(())
    }

    fn malformed(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), message)
    }

    /// Reads `count` bytes. Memory grows with the data that exist, not with the announced count.
    fn bytes(&mut self, count: u64) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        let read = self.input.by_ref().take(count).read_to_end(&mut out);
        match read {
            Ok(read) if read as u64 == count => Ok(out),
            Ok(read) => Err(self.malformed(format!("the data end after {read} of {count} bytes"))),
            Err(error) => Err(self.malformed(format!("the compressed data are damaged: {error}"))),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut out = [0; N];
        self.input.read_exact(&mut out).map_err(|error| self.malformed(format!("the data end early: {error}")))?;
        Ok(out)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn count(&mut self, what: &str) -> Result<u64> {
        let value = u64::from_le_bytes(self.array()?);
        if value > MOST_ELEMENTS {
            let what = format!("number of {what}");
            return Err(Error::Limit { place: self.place.clone(), what, value, limit: MOST_ELEMENTS });
        }
        Ok(value)
    }

    fn skip_name(&mut self) -> Result<()> {
        for _ in 0..LONGEST_NAME {
            if self.array::<1>()? == [0] {
                return Ok(());
            }
        }
        Err(self.malformed(format!("the shape's name does not end within {LONGEST_NAME} bytes")))
    }

    fn floats(&mut self, count: u64, double: bool) -> Result<Vec<f32>> {
        if double {
            let bytes = self.bytes(8 * count)?;
            let (values, _) = bytes.as_chunks::<8>();
            return Ok(values.iter().map(|value| f64::from_le_bytes(*value) as f32).collect());
        }
        let bytes = self.bytes(4 * count)?;
        let (values, _) = bytes.as_chunks::<4>();
        Ok(values.iter().map(|value| f32::from_le_bytes(*value)).collect())
    }

    fn vectors(&mut self, count: u64, double: bool) -> Result<Vec<Vec3>> {
        Ok(self.floats(3 * count, double)?.chunks_exact(3).map(Vec3::from_slice).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// A file of two triangles, the second moved along x.
    fn file(version: u16, flags: u32) -> Vec<u8> {
        let (mut out, mut starts) = (Vec::new(), Vec::new());
        for shape in 0..2u8 {
            starts.push(out.len() as u64);
            out.extend(IDENTIFIER.to_le_bytes());
            out.extend(version.to_le_bytes());
            let mut body = flags.to_le_bytes().to_vec();
            if version == 4 {
                body.extend(b"name\0");
            }
            body.extend(3u64.to_le_bytes());
            body.extend(1u64.to_le_bytes());
            let mut put = |values: &[f64]| {
                for value in values {
                    match flags & DOUBLE_PRECISION {
                        0 => body.extend((*value as f32).to_le_bytes()),
                        _ => body.extend(value.to_le_bytes()),
                    }
                }
            };
            let x = f64::from(shape);
            put(&[x, 0., 0., x + 1., 0., 0., x, 1., 0.]);
            if flags & HAS_NORMALS != 0 {
                put(&[0., 0., 1., 0., 0., 1., 0., 0., 1.]);
            }
            if flags & HAS_UVS != 0 {
                put(&[0., 0., 1., 0., 0., 1.]);
            }
            if flags & HAS_COLORS != 0 {
                put(&[0.5; 9]);
            }
            for index in 0..3u32 {
                body.extend(index.to_le_bytes());
            }
            let mut encoder = flate2::write::ZlibEncoder::new(&mut out, flate2::Compression::default());
            encoder.write_all(&body).unwrap();
            encoder.finish().unwrap();
        }
        for start in starts {
            let bytes = start.to_le_bytes();
            out.extend(if version == 4 { &bytes[..] } else { &bytes[..4] });
        }
        out.extend(2u32.to_le_bytes());
        out
    }

    fn parse(bytes: &[u8], index: u32) -> Result<(Mesh, bool)> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read(file.path(), index)
    }

    #[test]
    fn both_versions_and_precisions() {
        for version in [3, 4] {
            for flags in [0, 0x1000 | HAS_NORMALS, DOUBLE_PRECISION | HAS_NORMALS | HAS_UVS | HAS_COLORS | FACE_NORMALS]
            {
                let bytes = file(version, flags);
                for index in 0..2 {
                    let (mesh, flat) = parse(&bytes, index).unwrap();
                    assert_eq!(mesh.positions[1], Vec3::new(index as f32 + 1.0, 0., 0.));
                    assert_eq!(mesh.triangles, [[0, 1, 2]]);
                    assert_eq!(mesh.normals.len(), if flags & HAS_NORMALS != 0 { 3 } else { 0 });
                    assert_eq!(mesh.uvs.len(), if flags & HAS_UVS != 0 { 3 } else { 0 });
                    assert_eq!(flat, flags & FACE_NORMALS != 0);
                }
                assert!(matches!(parse(&bytes, 2), Err(Error::Malformed { .. })));
            }
        }
    }

    #[test]
    fn any_cut_or_flipped_byte_is_survived() {
        let bytes = file(4, HAS_NORMALS);
        for cut in 0..bytes.len() {
            assert!(parse(&bytes[..cut], 1).is_err(), "cut at {cut}");
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x55;
            let _ = parse(&damaged, 1);
        }
    }

    #[test]
    fn announced_counts_are_not_believed() {
        for (vertices, limit) in [(1u64 << 40, true), (1 << 27, false)] {
            let mut bytes = vec![0x1C, 0x04, 3, 0];
            let mut encoder = flate2::write::ZlibEncoder::new(&mut bytes, flate2::Compression::default());
            encoder.write_all(&0u32.to_le_bytes()).unwrap();
            encoder.write_all(&vertices.to_le_bytes()).unwrap();
            encoder.write_all(&1u64.to_le_bytes()).unwrap();
            encoder.finish().unwrap();
            let error = parse(&bytes, 0).unwrap_err();
            assert_eq!(matches!(error, Error::Limit { .. }), limit, "{error}");
        }
    }
}
