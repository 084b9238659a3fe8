//! Primitives (specification, §3.7.2.1): from columns of vertices to a mesh.

use ::gltf::json::accessor::Type;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{Vec2, Vec3};

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::readers::MOST_ELEMENTS;

use super::accessor::Column;
use super::buffers::Buffers;
use super::corners::{Numbers, triangles};
use super::document::Document;
use super::pose::{Pose, Posed};

/// A primitive's mesh, and the colours of its vertices if it has some.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The mesh, unchecked but for its indices.
    pub mesh: Mesh,
    /// Linear colours of the vertices, in [0, 1], or empty.
    pub colors: Vec<Vec3>,
    /// Whether colours of vertices have an alpha below 1.
    pub fades: bool,
    /// Whether the texture coordinates that were asked for are missing.
    pub lacks_uvs: bool,
}

/// Whether a primitive consists of triangles; points and lines have no surface.
pub fn is_surface(primitive: &Primitive) -> bool {
    !matches!(primitive.mode, Checked::Valid(Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip))
}

/// Reads the primitive called `part` in this pose, with the texture coordinates number `set`.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Limit`]; those of [`Buffers::view`].
pub fn read(
    document: &Document,
    buffers: &Buffers<'_>,
    primitive: &Primitive,
    part: &str,
    set: u32,
    pose: &Pose,
) -> Result<Drawn> {
    let open = |semantic: Semantic, kinds: &[Type], count: Option<usize>| -> Result<Option<Column>> {
        let Some(&index) = primitive.attributes.get(&Checked::Valid(semantic)) else { return Ok(None) };
        let part = format!("{part}.attributes");
        let column = Column::new(document, buffers, index, &part, kinds)?;
        match count.filter(|&count| count != column.count) {
            Some(count) => Err(document.malformed(
                part,
                format!("accessors[{}] has {} elements, POSITION has {count}", index.value(), column.count),
            )),
            None => Ok(Some(column)),
        }
    };
    // Nothing can be drawn of it (specification, §3.7.2.1).
    let Some(positions) = open(Semantic::Positions, &[Type::Vec3], None)? else {
        return Ok(Drawn { mesh: Mesh::default(), colors: Vec::new(), fades: false, lacks_uvs: false });
    };
    let count = positions.count;
    positions.check_bytes(document, part)?;
    let normals = open(Semantic::Normals, &[Type::Vec3], Some(count))?;
    let uvs = open(Semantic::TexCoords(set), &[Type::Vec2], Some(count))?;
    let colors = open(Semantic::Colors(0), &[Type::Vec3, Type::Vec4], Some(count))?;
    let (triangles, used) = indexed(document, buffers, primitive, part, count)?;
    let posed = Posed::new(document, buffers, primitive, pose, part, count)?;
    let mut mesh = Mesh { triangles, ..Mesh::default() };
    for vertex in used.iter().map(|&vertex| vertex as usize) {
        let normal = normals.as_ref().map_or(Vec3::ZERO, |column| Vec3::from_array(column.get(vertex)));
        let [position, normal] = posed.apply(vertex, [Vec3::from_array(positions.get(vertex)), normal]);
        mesh.positions.push(position);
        if normals.is_some() {
            mesh.normals.push(normal);
        }
        mesh.uvs.extend(uvs.as_ref().map(|column| Vec2::from_array(column.get(vertex))));
    }
    let color =
        |column: &Column, vertex: u32| Vec3::from_array(column.get(vertex as usize)).clamp(Vec3::ZERO, Vec3::ONE);
    let fading = |column: &Column| used.iter().any(|&vertex| column.get::<4>(vertex as usize)[3] < 1.0);
    let fades = colors.as_ref().is_some_and(|column| column.components() == 4 && fading(column));
    let colors = colors.map_or(Vec::new(), |column| used.iter().map(|&vertex| color(&column, vertex)).collect());
    Ok(Drawn { mesh, colors, fades, lacks_uvs: uvs.is_none() })
}

/// The triangles of a primitive with `count` vertices, and the vertices that they use, in their new order.
fn indexed(
    document: &Document,
    buffers: &Buffers<'_>,
    primitive: &Primitive,
    part: &str,
    count: usize,
) -> Result<(Vec<[u32; 3]>, Vec<u32>)> {
    let Checked::Valid(mode) = primitive.mode else {
        return Err(document.unsupported(part, "this mode", "4 (triangles), 5 (strips), 6 (fans)"));
    };
    let indices = match primitive.indices {
        Some(accessor) => Some(Column::new(document, buffers, accessor, part, &[Type::Scalar])?),
        None => None,
    };
    if indices.as_ref().is_some_and(|column| !column.is_unsigned()) {
        return Err(document.malformed(part, "its indices are not unsigned integers"));
    }
    if let Some(column) = &indices {
        column.check_bytes(document, part)?;
    }
    let uses = indices.as_ref().map_or(count, |column| column.count);
    for (what, value) in [("number of vertices", count), ("number of indices", uses)] {
        if value as u64 > MOST_ELEMENTS {
            let (place, what) = (document.place(part), what.to_owned());
            return Err(Error::Limit { place, what, value: value as u64, limit: MOST_ELEMENTS });
        }
    }
    let mut numbers = Numbers::new(count, uses);
    let mut out = Vec::new();
    for corners in triangles(mode, uses).into_iter().flatten() {
        let vertices = corners.map(|corner| indices.as_ref().map_or(corner as u32, |column| column.indices(corner)[0]));
        if let Some(vertex) = vertices.iter().find(|&&vertex| vertex as usize >= count) {
            let message = format!("an index is {vertex}, but there are only {count} vertices");
            return Err(document.malformed(part, message));
        }
        out.push(vertices.map(|vertex| numbers.of(vertex)));
    }
    Ok((out, numbers.used))
}
