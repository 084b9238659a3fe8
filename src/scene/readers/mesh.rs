//! Loading and checking one mesh: every index in range, every number finite, every triangle with an area.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::MeshFile;

use super::LARGEST;
use super::curves::{self, Form};
use super::{builtin, normals, obj, path, ply, serialized};

/// Treatment of a mesh's vertex normals.
#[derive(Clone, Copy, PartialEq)]
enum Shading {
    /// Dropped.
    Flat,
    /// Kept; where the file has none, they are made from the faces, as Mitsuba does.
    Smooth,
    /// Kept, or flat where there are none.
    AsGiven,
}

/// A checked mesh. It may have no triangle left.
#[derive(Debug)]
pub struct Cleaned {
    /// The mesh.
    pub mesh: Mesh,
    /// Number of triangles that were left out.
    pub skipped: usize,
    /// The place that it comes from.
    pub place: Place,
}

impl Cleaned {
    /// Reason why nothing can be seen of the mesh; none where it has triangles.
    pub fn emptiness(&self) -> Option<String> {
        let Self { mesh, skipped, place } = self;
        mesh.triangles.is_empty().then(|| match skipped {
            0 => format!("{place}: the mesh has no triangles"),
            _ => format!("{place}: the mesh has no triangles with an area ({skipped} without)"),
        })
    }
}

/// Loads a mesh of the scene in `directory`. `place` is that of the mesh in the scene file, `held` the mesh if the document holds it.
///
/// # Errors
/// [`Error::Io`], [`Error::Malformed`], [`Error::Unsupported`], [`Error::Limit`].
pub fn load(file: &MeshFile, held: Option<Mesh>, directory: &Path, place: &Place) -> Result<Cleaned> {
    let flat_if = |face_normals: bool| if face_normals { Shading::Flat } else { Shading::Smooth };
    let open = |file: &str| path::resolve(directory, file, place);
    match file {
        MeshFile::Obj { file, face_normals, flip_v, materials } => {
            let path = open(file)?;
            finish(turned(obj::read(&path, materials)?, *flip_v), flat_if(*face_normals), &Place::file(path))
        }
        MeshFile::Ply { file, face_normals, flip_v, as_given } => {
            let path = open(file)?;
            let mut mesh = turned(ply::read(&path)?, *flip_v);
            if !as_given {
                return finish(mesh, flat_if(*face_normals), &Place::file(path));
            }
            normals::turn_faces(&mut mesh);
            finish(mesh, if *face_normals { Shading::Flat } else { Shading::AsGiven }, &Place::file(path))
        }
        MeshFile::Serialized { file, index, face_normals } => {
            let path = open(file)?;
            let (mesh, wants_flat) = serialized::read(&path, *index)?;
            finish(mesh, flat_if(*face_normals || wants_flat), &Place::part(path, format!("shape {index}")))
        }
        MeshFile::Curves { file, straight, wider } => {
            let path = open(file)?;
            let form = if *straight { Form::Linear } else { Form::BSpline };
            finish(curves::tubes(&curves::read(&path, *wider)?, form), Shading::AsGiven, &Place::file(path))
        }
        MeshFile::Rectangle {} => finish(builtin::rectangle(), Shading::AsGiven, place),
        MeshFile::Cube {} => finish(builtin::cube(), Shading::AsGiven, place),
        MeshFile::Disk {} => finish(builtin::disk(), Shading::AsGiven, place),
        MeshFile::Cylinder {} => finish(builtin::cylinder(), Shading::AsGiven, place),
        MeshFile::Inline { positions, normals, uvs, triangles } => {
            let mesh = Mesh {
                positions: positions.iter().map(|&p| Vec3::from_array(p)).collect(),
                normals: normals.iter().map(|&n| Vec3::from_array(n)).collect(),
                uvs: uvs.iter().map(|&uv| Vec2::from_array(uv)).collect(),
                triangles: triangles.clone(),
            };
            finish(mesh, Shading::AsGiven, place)
        }
        MeshFile::Held { part } => match held {
            Some(mesh) => finish(mesh, Shading::AsGiven, place),
            None => Err(not_held(place, part)),
        },
    }
}

/// Error for a mesh that no document holds any more.
pub fn not_held(place: &Place, part: &str) -> Error {
    let what = format!("a mesh that is in memory only, {part} of another document,");
    Error::Unsupported { place: place.clone(), what, supported: "meshes in files or written out".into() }
}

/// The mesh, with v replaced by 1 − v if `flip_v`.
fn turned(mut mesh: Mesh, flip_v: bool) -> Mesh {
    if flip_v {
        mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    }
    mesh
}

fn finish(mut mesh: Mesh, shading: Shading, place: &Place) -> Result<Cleaned> {
    check(&mesh, place)?;
    let before = mesh.triangles.len();
    let positions = &mesh.positions;
    mesh.triangles.retain(|triangle| has_area(triangle.map(|i| positions[i as usize])));
    let skipped = before - mesh.triangles.len();
    match shading {
        Shading::Flat => mesh.normals = Vec::new(),
        Shading::AsGiven if mesh.normals.is_empty() => {}
        Shading::AsGiven | Shading::Smooth => normals::complete(&mut mesh),
    }
    Ok(Cleaned { mesh, skipped, place: place.clone() })
}

fn check(mesh: &Mesh, place: &Place) -> Result<()> {
    let vertices = mesh.positions.len();
    let fail = |message: String| Err(Error::malformed(place.clone(), message));
    for (what, count) in [("normals", mesh.normals.len()), ("uvs", mesh.uvs.len())] {
        if count != 0 && count != vertices {
            return fail(format!("{count} {what} for {vertices} vertices; expected as many, or none"));
        }
    }
    if let Some(i) = mesh.positions.par_iter().position_first(|p| !p.is_finite()) {
        return fail(format!("vertex {i} has the position {}, which is not finite", mesh.positions[i]));
    }
    if let Some(i) = mesh.positions.par_iter().position_first(|p| p.abs().max_element() > LARGEST) {
        return fail(format!("vertex {i} has the position {}, the limit is {LARGEST:e} units", mesh.positions[i]));
    }
    if let Some(i) = mesh.normals.par_iter().position_first(|n| !n.is_finite()) {
        return fail(format!("vertex {i} has the normal {}, which is not finite", mesh.normals[i]));
    }
    if let Some(i) = mesh.uvs.par_iter().position_first(|uv| !uv.is_finite()) {
        return fail(format!("vertex {i} has the texture coordinates {}, which are not finite", mesh.uvs[i]));
    }
    if let Some(i) = mesh.triangles.par_iter().position_first(|t| t.iter().any(|&v| v as usize >= vertices)) {
        return fail(format!("triangle {i} uses the vertices {:?}, but there are only {vertices}", mesh.triangles[i]));
    }
    Ok(())
}

/// Whether a triangle has an area. Edges are subtracted in double precision, so only triangles that truly collapse are lost. The
/// bound keeps triangles whose normals would underflow in single precision.
pub fn has_area(corners: [Vec3; 3]) -> bool {
    const SMALLEST_CROSS: f64 = 1e-30;
    let [a, b, c]: [DVec3; 3] = corners.map(|p| p.as_dvec3());
    (b - a).cross(c - a).length() > SMALLEST_CROSS
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inline(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Cleaned> {
        let file = MeshFile::Inline { positions, normals: vec![], uvs: vec![], triangles };
        load(&file, None, Path::new(""), &Place::part("scene.json", "meshes.m"))
    }

    #[test]
    fn a08_drops_and_counts_triangles_without_area() {
        let corners = vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [2., 0., 0.]];
        let cleaned = inline(corners.clone(), vec![[0, 1, 2], [0, 1, 1], [0, 1, 3]]).unwrap();
        assert!(cleaned.emptiness().is_none());
        assert!(cleaned.mesh.normals.is_empty(), "written out without normals means flat");
        assert_eq!((cleaned.mesh.triangles, cleaned.skipped), (vec![[0, 1, 2]], 2));
        let told = |triangles| inline(corners.clone(), triangles).unwrap().emptiness().unwrap();
        assert_eq!(told(vec![[0, 1, 3]]), "scene.json (meshes.m): the mesh has no triangles with an area (1 without)");
        assert_eq!(told(vec![]), "scene.json (meshes.m): the mesh has no triangles");
    }

    #[test]
    fn a08_refuses_what_cannot_be_repaired() {
        let corners = vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
        for (positions, triangles) in [
            (corners.clone(), vec![[0, 1, 3]]),
            (vec![[0., 0., 0.], [f32::NAN, 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]),
            (vec![[0., 0., 0.], [f32::INFINITY, 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]),
        ] {
            let error = inline(positions, triangles).unwrap_err();
            assert!(matches!(error, Error::Malformed { .. }), "{error}");
        }
    }
}
