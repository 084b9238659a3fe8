//! Meshes that are written out in the document.

use glam::{Vec2, Vec3};

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::scene::file::MeshFile;
use crate::scene::readers::normals;

use super::parameters::Parameters;

/// How far a patch's corner may be from the plane of the others, relative to the patch.
const FLAT: f32 = 1e-3;

/// A mesh of triangles. Faces are turned to the side of their vertices' normals, as pbrt has it.
pub fn triangles(parameters: &Parameters) -> Result<MeshFile> {
    parameters.ignore(&["S", "faceIndices", "displacement", "displacement.edgelength", "edgelength"]);
    let positions = parameters.tuples("P")?;
    let triangles = match indices::<3>(parameters)? {
        given if given.is_empty() && positions.len() == 3 => vec![[0, 1, 2]],
        given => given,
    };
    Ok(turned(positions, parameters.tuples("N")?, coordinates(parameters)?, triangles))
}

/// The control mesh of a subdivision surface; normals of 0 are to be made from its faces.
pub fn control(parameters: &Parameters) -> Result<MeshFile> {
    parameters.ignore(&["levels", "nlevels", "scheme"]);
    let positions: Vec<[f32; 3]> = parameters.tuples("P")?;
    let normals = vec![[0.0; 3]; positions.len()];
    Ok(MeshFile::Inline { positions, normals, uvs: coordinates(parameters)?, triangles: indices::<3>(parameters)? })
}

/// Bilinear patches as two triangles each, and whether all of them are flat. Corners are in the order of rows.
pub fn patches(parameters: &Parameters) -> Result<(MeshFile, bool)> {
    parameters.ignore(&["faceIndices", "emissionfilename"]);
    let mut positions: Vec<[f32; 3]> = parameters.tuples("P")?;
    let mut normals: Vec<[f32; 3]> = parameters.tuples("N")?;
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
        let spread =
            |values: &[[f32; 3]]| all.iter().filter_map(|&i| values.get(i as usize).copied()).collect::<Vec<_>>();
        (positions, normals) = (spread(&positions), spread(&normals));
        uvs = patches.iter().flat_map(|_| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]).collect();
        patches = (0..patches.len() as u32).map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]).collect();
    }
    let at = |i: u32| Vec3::from_array(positions[i as usize]);
    let is_flat = |[a, b, c, d]: &[u32; 4]| {
        let (u, v, w) = (at(*b) - at(*a), at(*c) - at(*a), at(*d) - at(*a));
        let size = u.length().max(v.length()).max(w.length());
        u.cross(v).normalize_or_zero().dot(w).abs() <= FLAT * size
    };
    let flat = patches.iter().all(is_flat);
    let triangles = patches.iter().flat_map(|&[a, b, c, d]| [[a, b, d], [a, d, c]]).collect();
    Ok((turned(positions, normals, uvs, triangles), flat))
}

fn turned(positions: Vec<[f32; 3]>, normals: Vec<[f32; 3]>, uvs: Vec<[f32; 2]>, triangles: Vec<[u32; 3]>) -> MeshFile {
    if normals.is_empty() {
        return MeshFile::Inline { positions, normals, uvs, triangles };
    }
    let vectors = |values: &[[f32; 3]]| values.iter().map(|&value| Vec3::from_array(value)).collect();
    let mut mesh = Mesh { positions: vectors(&positions), normals: vectors(&normals), uvs: Vec::new(), triangles };
    normals::turn_faces(&mut mesh);
    MeshFile::Inline { positions, normals, uvs, triangles: mesh.triangles }
}

fn coordinates(parameters: &Parameters) -> Result<Vec<[f32; 2]>> {
    let found = ["uv", "st", "UV"].into_iter().find(|name| parameters.has(name));
    found.map_or(Ok(Vec::new()), |name| parameters.tuples(name))
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

/// Two sheets of a mesh, one in front of it and one behind it that faces backwards, `gap` parts of its size away.
pub fn sheets(mesh: &Mesh, gap: f64) -> MeshFile {
    let bounds =
        mesh.positions.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)]);
    let step = 0.5 * gap as f32 * (bounds[1] - bounds[0]).max_element().max(0.0);
    let (mut positions, mut normals, mut uvs, mut triangles) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for side in [1.0, -1.0] {
        for triangle in &mesh.triangles {
            let corners = triangle.map(|i| mesh.positions[i as usize]);
            let [a, b, c] = corners.map(|p| p.as_dvec3());
            let offset = (b - a).cross(c - a).normalize_or_zero().as_vec3() * step * side;
            let first = positions.len() as u32;
            let order = if side > 0.0 { [0, 1, 2] } else { [0, 2, 1] };
            triangles.push(order.map(|corner| first + corner));
            positions.extend(corners.map(|p| (p + offset).to_array()));
            let normal = |i: u32| mesh.normals.get(i as usize).map(|n| (*n * side).to_array());
            normals.extend(triangle.iter().filter_map(|&i| normal(i)));
            uvs.extend(triangle.iter().filter_map(|&i| mesh.uvs.get(i as usize).map(Vec2::to_array)));
        }
    }
    MeshFile::Inline { positions, normals, uvs, triangles }
}
