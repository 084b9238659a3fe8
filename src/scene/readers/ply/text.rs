//! The usual layout as text, read in parallel: a vertex of numbers a line, then a face of one list a line.

use glam::{Vec2, Vec3};
use ply_rs_bw::ply::{Encoding, Header, PropertyType, ScalarType};
use rayon::prelude::*;

use crate::geometry::mesh::Mesh;
use crate::scene::readers::lines::{integer, lines, number, pieces, words};

use super::{slot, usual};

/// A column of the vertices.
#[derive(Clone, Copy)]
struct Column {
    /// Index of its property among x, y, z, nx, ny, nz, u, v; none for a column that is not read.
    slot: Option<usize>,
    double: bool,
}

/// Layout of the body.
pub struct Layout {
    vertices: usize,
    columns: Vec<Column>,
    /// Whether each of x, y, z, nx, ny, nz, u, v exists.
    has: [bool; 8],
    faces: usize,
}

impl Layout {
    /// The layout of a file; none for one that only the library reads.
    pub fn of(header: &Header) -> Option<Self> {
        let (vertex, face, list) = usual(header)?;
        if header.encoding != Encoding::Ascii || !matches!(list, PropertyType::List(..)) {
            return None;
        }
        let mut has = [false; 8];
        let mut columns = Vec::new();
        for (name, property) in vertex.properties.iter() {
            let PropertyType::Scalar(scalar) = &property.data_type else { return None };
            let slot = slot(name);
            if let Some(slot) = slot {
                if !matches!(scalar, ScalarType::Float | ScalarType::Double) {
                    return None;
                }
                has[slot] = true;
            }
            columns.push(Column { slot, double: *scalar == ScalarType::Double });
        }
        has[..3].iter().all(|&has| has).then_some(Self { vertices: vertex.count, columns, has, faces: face.count })
    }

    /// Number of triangles that the faces in `body` say they are made of.
    pub fn triangles(&self, body: &[u8]) -> u64 {
        let corners = |line| words(line).next().and_then(integer).and_then(|count| u64::try_from(count).ok());
        let faces = lines(body).skip(self.vertices).take(self.faces);
        faces.filter_map(corners).map(|count| count.saturating_sub(2)).fold(0, u64::saturating_add)
    }

    /// Reads the mesh in `body`, which follows the header; none where anything is not as expected.
    pub fn read(&self, body: &[u8]) -> Option<Mesh> {
        let pieces = pieces(body);
        let counts: Vec<usize> = pieces.par_iter().map(|piece| lines(piece).count()).collect();
        let begins: Vec<usize> = counts
            .iter()
            .scan(0, |sum, count| {
                *sum += count;
                Some(*sum - count)
            })
            .collect();
        if counts.iter().sum::<usize>() < self.vertices.checked_add(self.faces)? {
            return None;
        }
        let parts: Vec<Option<Mesh>> =
            pieces.par_iter().zip(&begins).map(|(piece, &begin)| self.part(piece, begin)).collect();
        let mut mesh = Mesh::default();
        for part in parts {
            let mut part = part?;
            mesh.positions.append(&mut part.positions);
            mesh.normals.append(&mut part.normals);
            mesh.uvs.append(&mut part.uvs);
            mesh.triangles.append(&mut part.triangles);
        }
        Some(mesh)
    }

    /// Reads a piece whose first line is number `begin` of the body.
    fn part(&self, piece: &[u8], begin: usize) -> Option<Mesh> {
        let mut mesh = Mesh::default();
        for (index, line) in (begin..self.vertices + self.faces).zip(lines(piece)) {
            if index < self.vertices {
                self.vertex(line, &mut mesh)?;
            } else {
                face(line, &mut mesh.triangles)?;
            }
        }
        Some(mesh)
    }

    fn vertex(&self, line: &[u8], mesh: &mut Mesh) -> Option<()> {
        let mut values = [0.0; 8];
        let mut words = words(line);
        for column in &self.columns {
            let word = words.next()?;
            let Some(slot) = column.slot else { continue };
            values[slot] = if column.double { number::<f64>(word)? as f32 } else { number(word)? };
        }
        let [x, y, z, nx, ny, nz, u, v] = values;
        mesh.positions.push(Vec3::new(x, y, z));
        if self.has[3..6] == [true; 3] {
            mesh.normals.push(Vec3::new(nx, ny, nz));
        }
        if self.has[6..] == [true; 2] {
            mesh.uvs.push(Vec2::new(u, v));
        }
        Some(())
    }
}

/// Adds the triangles of a polygon.
fn face(line: &[u8], triangles: &mut Vec<[u32; 3]>) -> Option<()> {
    let mut words = words(line);
    let count = u32::try_from(integer(words.next()?)?).ok()?;
    let (mut first, mut last) = (0, 0);
    for corner in 0..count {
        // The library refuses values that are no index of the type in the header.
        let index = u32::try_from(integer(words.next()?)?).ok()?;
        match corner {
            0 => first = index,
            1 => {}
            _ => triangles.push([first, last, index]),
        }
        last = index;
    }
    Some(())
}
