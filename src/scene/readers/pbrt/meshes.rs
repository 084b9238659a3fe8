//! Meshes that are written out in the document.

use glam::{Vec2, Vec3};

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::scene::readers::normals;

use super::parameters::Parameters;

/// How far a patch's corner may be from the plane of the others, relative to the patch.
const FLAT: f32 = 1e-3;

/// A mesh of triangles. Faces are turned to the side of their vertices' normals, as pbrt has it.
pub fn triangles(parameters: &Parameters) -> Result<Mesh> {
    parameters.ignore(&["S", "faceIndices", "displacement", "displacement.edgelength", "edgelength"]);
    let positions = vectors(parameters, "P")?;
    let triangles = match indices::<3>(parameters)? {
        given if given.is_empty() && positions.len() == 3 => vec![[0, 1, 2]],
        given => given,
    };
    let (normals, uvs) = (vectors(parameters, "N")?, coordinates(parameters)?);
    Ok(turned(Mesh { positions, normals, uvs, triangles }))
}

/// The control mesh of a subdivision surface; normals of 0 are to be made from its faces.
pub fn control(parameters: &Parameters) -> Result<Mesh> {
    parameters.ignore(&["levels", "nlevels", "scheme"]);
    let positions = vectors(parameters, "P")?;
    let normals = vec![Vec3::ZERO; positions.len()];
    Ok(Mesh { positions, normals, uvs: coordinates(parameters)?, triangles: indices::<3>(parameters)? })
}

/// Bilinear patches as two triangles each, and whether all of them are flat. Corners are in the order of rows.
pub fn patches(parameters: &Parameters) -> Result<(Mesh, bool)> {
    parameters.ignore(&["faceIndices", "emissionfilename"]);
    let (mut positions, mut normals) = (vectors(parameters, "P")?, vectors(parameters, "N")?);
    let mut uvs = coordinates(parameters)?;
    let mut patches = match indices::<4>(parameters)? {
        given if given.is_empty() && positions.len() == 4 => vec![[0, 1, 2, 3]],
        given => given,
    };
    let corners = positions.len();
    if let Some(patch) = patches.iter().find(|patch| patch.iter().any(|&corner| corner as usize >= corners)) {
        return Err(parameters.malformed(format!("a patch uses the corners {patch:?}, but there are only {corners}")));
    }
    if uvs.is_empty() {
        // Every patch spans the unit square, so none shares its corners.
        let all = patches.as_flattened();
        let spread = |values: &[Vec3]| all.iter().filter_map(|&i| values.get(i as usize).copied()).collect::<Vec<_>>();
        (positions, normals) = (spread(&positions), spread(&normals));
        uvs = patches.iter().flat_map(|_| [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE]).collect();
        patches = (0..patches.len() as u32).map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]).collect();
    }
    let at = |i: u32| positions[i as usize];
    let is_flat = |[a, b, c, d]: &[u32; 4]| {
        let (u, v, w) = (at(*b) - at(*a), at(*c) - at(*a), at(*d) - at(*a));
        let size = u.length().max(v.length()).max(w.length());
        u.cross(v).normalize_or_zero().dot(w).abs() <= FLAT * size
    };
    let flat = patches.iter().all(is_flat);
    let triangles = patches.iter().flat_map(|&[a, b, c, d]| [[a, b, d], [a, d, c]]).collect();
    Ok((turned(Mesh { positions, normals, uvs, triangles }), flat))
}

fn turned(mut mesh: Mesh) -> Mesh {
    normals::turn_faces(&mut mesh);
    mesh
}

fn vectors(parameters: &Parameters, name: &'static str) -> Result<Vec<Vec3>> {
    Ok(parameters.tuples(name)?.into_iter().map(Vec3::from_array).collect())
}

fn coordinates(parameters: &Parameters) -> Result<Vec<Vec2>> {
    let found = ["uv", "st", "UV"].into_iter().find(|name| parameters.has(name));
    let values = found.map_or(Ok(Vec::new()), |name| parameters.tuples(name))?;
    Ok(values.into_iter().map(Vec2::from_array).collect())
}

fn indices<const N: usize>(parameters: &Parameters) -> Result<Vec<[u32; N]>> {
    let numbers = parameters.numbers("indices")?;
    let (tuples, []) = numbers.as_chunks::<N>() else {
        return Err(parameters.malformed(format!("there are {} indices, expected a multiple of {N}", numbers.len())));
    };
    let wrong = |index: &&f64| index.fract() != 0.0 || !(0.0..=f64::from(u32::MAX)).contains(*index);
    if let Some(index) = numbers.iter().find(wrong) {
        return Err(parameters.malformed(format!("the index {index} is not a whole number of at least 0")));
    }
    Ok(tuples.iter().map(|tuple| tuple.map(|index| index as u32)).collect())
}
