//! Wavefront OBJ, by the crate `tobj`.

use std::path::Path;

use glam::{Vec2, Vec3};
use tobj::{LoadError, LoadOptions};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;

use super::mesh::LARGEST_FILE;

/// Reads all groups of an OBJ file as one mesh. v is turned around, because OBJ counts it from the bottom of a picture and we,
/// like Mitsuba, from the top.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] naming the file.
pub fn read(path: &Path) -> Result<Mesh> {
    let bytes = read_bytes(path, LARGEST_FILE)?;
    let text = geometry_lines(&bytes);
    let options = LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let fail = |why: &str| Error::malformed(Place::file(path), format!("not a readable OBJ file: {why}"));
    let parsed = tobj::load_obj_buf(&mut text.as_slice(), &options, no_materials);
    let (models, _) = parsed.map_err(|error| fail(explain(&error)))?;
    let mut mesh = Mesh::default();
    for model in models {
        append(&mut mesh, &model.mesh).map_err(fail)?;
    }
    Ok(mesh)
}

/// Only the lines that make up geometry. Without the group lines the parser returns one mesh, so that smooth normals do not
/// break where a group ends; material files are not ours to open.
fn geometry_lines(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + 1);
    for line in bytes.split(|&b| b == b'\n') {
        let word = line.split(|b| b.is_ascii_whitespace()).find(|word| !word.is_empty());
        if matches!(word, Some(b"v" | b"vn" | b"vt" | b"f")) {
            out.extend_from_slice(line);
            out.push(b'\n');
        }
    }
    out
}

fn append(mesh: &mut Mesh, part: &tobj::Mesh) -> Result<(), &'static str> {
    let first = u32::try_from(mesh.positions.len()).map_err(|_| "more than 2³² vertices")?;
    let count = part.positions.len() / 3;
    let (has_normals, has_uvs) = (!part.normals.is_empty(), !part.texcoords.is_empty());
    if has_normals && part.normals.len() != 3 * count || has_uvs && part.texcoords.len() != 2 * count {
        return Err("some faces have normals or texture coordinates and others do not");
    }
    mesh.positions.extend(part.positions.chunks_exact(3).map(Vec3::from_slice));
    mesh.normals.extend(part.normals.chunks_exact(3).map(Vec3::from_slice));
    mesh.uvs.extend(part.texcoords.chunks_exact(2).map(|uv| Vec2::new(uv[0], 1.0 - uv[1])));
    for corner in part.indices.chunks_exact(3) {
        let shift = |i: u32| i.checked_add(first).ok_or("more than 2³² vertices");
        mesh.triangles.push([shift(corner[0])?, shift(corner[1])?, shift(corner[2])?]);
    }
    // Several parts come only from a parser that splits anyway; their optional attributes must cover all vertices.
    if has_normals || !mesh.normals.is_empty() {
        mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
    }
    if has_uvs || !mesh.uvs.is_empty() {
        mesh.uvs.resize(mesh.positions.len(), Vec2::ZERO);
    }
    Ok(())
}

fn explain(error: &LoadError) -> &'static str {
    match error {
        LoadError::ReadError => "it is not text",
        LoadError::PositionParseError => "a line \"v\" does not hold three numbers",
        LoadError::NormalParseError => "a line \"vn\" does not hold three numbers",
        LoadError::TexcoordParseError => "a line \"vt\" does not hold two numbers",
        LoadError::FaceParseError => "a line \"f\" does not hold vertex indices",
        LoadError::FaceVertexOutOfBounds => "a face uses a vertex that does not exist",
        LoadError::FaceTexCoordOutOfBounds => "a face uses texture coordinates that do not exist",
        LoadError::FaceNormalOutOfBounds => "a face uses a normal that does not exist",
        LoadError::InvalidPolygon => "a face has no vertices",
        _ => "unknown content",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Mesh> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    #[test]
    fn groups_polygons_and_attributes() {
        let text = "mtllib none.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 0.25\nvn 0 0 1\n\
                    g first\nf 1/1/1 2/2/1 3/3/1 4/4/1\nusemtl m\ng second\nv 2 0 0\nf -5/1/1 -1/2/1 -4/3/1\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.triangles.len(), 3, "the square as two triangles, and one more");
        assert_eq!(mesh.uvs.len(), mesh.positions.len());
        assert_eq!(mesh.normals.len(), mesh.positions.len());
        let corner = mesh.positions.iter().position(|p| *p == Vec3::Y).unwrap();
        assert_eq!(mesh.uvs[corner], Vec2::new(0.0, 0.75), "v counts from the top");
    }

    #[test]
    fn bad_files_are_errors() {
        for text in [
            "v 0 0\n",
            "v 0 0 x\n",
            "v 0 0 0\nf 1 2 3\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/2 3/3\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//9 2//9 3//9\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf a b c\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 -8 -7\n",
        ] {
            assert!(matches!(parse(text), Err(Error::Malformed { .. })), "{text}");
        }
    }
}
