//! The usual binary layout, read in parallel: little-endian vertices of floats, then faces that are one list each.

use std::path::Path;

use glam::{Vec2, Vec3};
use ply_rs_bw::ply::{Encoding, Header, PropertyType, ScalarType};
use rayon::prelude::*;

use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;

use super::{check_triangles, scalar_size, slot, usual};

/// Offset of a number in a vertex, and whether it takes eight bytes.
#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    double: bool,
}

/// Layout of the body.
pub struct Layout {
    vertices: usize,
    stride: usize,
    /// Fields x, y, z, nx, ny, nz, u, v.
    fields: [Option<Field>; 8],
    faces: usize,
    /// Whether indices are signed.
    signed: bool,
}

/// Bytes of a triangle: its length and three indices.
const TRIANGLE: usize = 13;

impl Layout {
    /// The layout of a file; none for one that only the library reads.
    pub fn of(header: &Header) -> Option<Self> {
        let (vertex, face, list) = usual(header)?;
        if header.encoding != Encoding::BinaryLittleEndian {
            return None;
        }
        let mut fields = [None; 8];
        let mut stride = 0;
        for (name, property) in vertex.properties.iter() {
            let PropertyType::Scalar(scalar) = &property.data_type else { return None };
            if let Some(slot) = slot(name) {
                let double = match scalar {
                    ScalarType::Float => false,
                    ScalarType::Double => true,
                    _ => return None,
                };
                fields[slot] = Some(Field { offset: stride, double });
            }
            stride += scalar_size(scalar) as usize;
        }
        let signed = match list {
            PropertyType::List(ScalarType::UChar, ScalarType::Int) => true,
            PropertyType::List(ScalarType::UChar, ScalarType::UInt) => false,
            _ => return None,
        };
        let sound = fields[..3].iter().all(Option::is_some);
        sound.then_some(Self { vertices: vertex.count, stride, fields, faces: face.count, signed })
    }

    /// The mesh in `body`, which follows the header, of at most `most` triangles. Nothing is allocated that the body is too
    /// short for.
    ///
    /// # Errors
    /// [`Error::Malformed`] where the body ends too early or an index is negative; [`Error::Limit`].
    pub fn read(&self, path: &Path, body: &[u8], most: u64) -> Result<Mesh> {
        let short = || Error::malformed(Place::file(path), "not a readable PLY file: it ends too early");
        let size = self.vertices.checked_mul(self.stride).ok_or_else(short)?;
        let (vertices, faces) = body.split_at_checked(size).ok_or_else(short)?;
        let mut mesh = Mesh { positions: self.vectors(vertices, 0), ..Mesh::default() };
        if self.fields[3..6].iter().all(Option::is_some) {
            mesh.normals = self.vectors(vertices, 3);
        }
        if let [Some(u), Some(v)] = self.fields[6..8] {
            let uv = |vertex: &[u8]| Vec2::new(number(vertex, u), number(vertex, v));
            mesh.uvs = vertices.par_chunks_exact(self.stride).map(uv).collect();
        }
        mesh.triangles = match self.faces.checked_mul(TRIANGLE).and_then(|size| faces.get(..size)) {
            Some(all) if all.par_chunks_exact(TRIANGLE).all(|face| face[0] == 3) => {
                let triangle = |face: &[u8]| [1, 5, 9].map(|at| index(&face[at..]));
                all.par_chunks_exact(TRIANGLE).map(triangle).collect()
            }
            _ => polygons(self.faces, faces, most).ok_or_else(short)?,
        };
        check_triangles(path, mesh.triangles.len() as u64, most)?;
        self.check_signs(path, &mesh.triangles)?;
        Ok(mesh)
    }

    fn vectors(&self, vertices: &[u8], first: usize) -> Vec<Vec3> {
        let [Some(x), Some(y), Some(z)] = self.fields[first..first + 3] else { return Vec::new() };
        let vector = |vertex: &[u8]| Vec3::new(number(vertex, x), number(vertex, y), number(vertex, z));
        vertices.par_chunks_exact(self.stride).map(vector).collect()
    }

    /// Refuses negative indices, which read as ones above 2³¹.
    fn check_signs(&self, path: &Path, triangles: &[[u32; 3]]) -> Result<()> {
        let negative = |triangle: &[u32; 3]| triangle.iter().any(|&i| i > i32::MAX as u32);
        match triangles.par_iter().position_first(negative) {
            Some(i) if self.signed => {
                let place = Place::part(path, format!("triangle {i}"));
                Err(Error::malformed(place, "expected a list vertex_indices of indices from 0"))
            }
            _ => Ok(()),
        }
    }
}

/// Triangle fans of the polygons, up to the first one that makes more than `most`; none where the body ends too early.
fn polygons(count: usize, mut body: &[u8], most: u64) -> Option<Vec<[u32; 3]>> {
    let mut triangles = Vec::new();
    for _ in 0..count {
        let (&[corners], rest) = body.split_first_chunk()?;
        let (list, rest) = rest.split_at_checked(4 * usize::from(corners))?;
        body = rest;
        let at = |i: usize| index(&list[4 * i..]);
        triangles.extend((2..usize::from(corners)).map(|i| [at(0), at(i - 1), at(i)]));
        if triangles.len() as u64 > most {
            break;
        }
    }
    Some(triangles)
}

/// The number in the first four bytes, which must exist.
fn index(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |&four| u32::from_le_bytes(four))
}

/// The value of a field of a vertex, which has it.
fn number(vertex: &[u8], field: Field) -> f32 {
    let bytes = &vertex[field.offset..];
    if field.double {
        bytes.first_chunk().map_or(0.0, |&eight| f64::from_le_bytes(eight) as f32)
    } else {
        bytes.first_chunk().map_or(0.0, |&four| f32::from_le_bytes(four))
    }
}
