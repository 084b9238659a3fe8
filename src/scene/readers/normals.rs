//! Smooth vertex normals, made from the faces where a mesh has none.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::geometry::mesh::Mesh;

/// Number of triangles whose normals are computed before they are added up, in the order of the mesh.
const CHUNK: usize = 1 << 16;

/// Normalizes the normals of `mesh`; zero and missing ones become the mean of the adjacent face normals, weighted by the
/// faces' angles at the vertex (Thürmer and Wüthrich 1998). Every triangle must have an area.
pub fn complete(mesh: &mut Mesh) {
    let given = |n: &Vec3| n.as_dvec3().length() > 0.0;
    let all_given = !mesh.normals.is_empty() && mesh.normals.iter().all(given);
    let smooth = if all_given { Vec::new() } else { from_faces(mesh) };
    mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
    for (i, normal) in mesh.normals.iter_mut().enumerate() {
        // Double precision: a short normal must not underflow.
        *normal = if given(normal) { normal.as_dvec3().normalize().as_vec3() } else { smooth[i] };
    }
}

/// Turns around every triangle that faces away from its vertices' normals, if there are any. Indices out of range are left alone.
pub fn turn_faces(mesh: &mut Mesh) {
    let (positions, normals) = (&mesh.positions, &mesh.normals);
    let away = |triangle: &[u32; 3]| {
        let corner = |i: u32| Some((positions.get(i as usize)?.as_dvec3(), normals.get(i as usize)?.as_dvec3()));
        let [a, b, c] = triangle.map(corner);
        let (Some((a, m)), Some((b, n)), Some((c, o))) = (a, b, c) else { return false };
        (b - a).cross(c - a).dot(m + n + o) < 0.0
    };
    mesh.triangles.par_iter_mut().filter(|triangle| away(triangle)).for_each(|triangle| triangle.swap(1, 2));
}

fn from_faces(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for triangles in mesh.triangles.chunks(CHUNK) {
        let shares: Vec<[DVec3; 3]> = triangles.par_iter().map(|triangle| shares(mesh, triangle)).collect();
        for (triangle, shares) in triangles.iter().zip(shares) {
            for (&vertex, share) in triangle.iter().zip(shares) {
                sums[vertex as usize] += share;
            }
        }
    }
    // A vertex that no triangle uses, or whose faces cancel, gets any unit vector: nothing is shaded with it, or nothing
    // better is known.
    sums.par_iter().map(|sum| sum.try_normalize().map_or(Vec3::X, |n| n.as_vec3())).collect()
}

/// The normal of a triangle times its angle, at each corner.
fn shares(mesh: &Mesh, triangle: &[u32; 3]) -> [DVec3; 3] {
    let corners = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    [0, 1, 2].map(|i| {
        let to_next = corners[(i + 1) % 3] - corners[i];
        let to_last = corners[(i + 2) % 3] - corners[i];
        normal * to_next.angle_between(to_last)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At a cube's corner three faces meet at right angles: whatever the split into triangles, the normal is the diagonal.
    #[test]
    fn corner_of_a_cube() {
        let cube = super::super::builtin::cube();
        let mut unique: Vec<Vec3> = Vec::new();
        let index = cube.positions.iter().map(|p| match unique.iter().position(|q| q == p) {
            Some(i) => i as u32,
            None => {
                unique.push(*p);
                unique.len() as u32 - 1
            }
        });
        let index: Vec<u32> = index.collect();
        let triangles = cube.triangles.iter().map(|t| t.map(|i| index[i as usize])).collect();
        let mut welded = Mesh { positions: unique, triangles, ..Mesh::default() };
        complete(&mut welded);
        for (p, n) in welded.positions.iter().zip(&welded.normals) {
            assert!(n.distance(p.normalize()) < 1e-6, "{n} at {p}");
        }
    }

    #[test]
    fn keeps_what_is_given() {
        let mut mesh = super::super::builtin::rectangle();
        mesh.normals = vec![Vec3::new(0., 3., 4.), Vec3::ZERO, Vec3::new(1e-30, 0., 0.), Vec3::Z];
        complete(&mut mesh);
        assert_eq!(mesh.normals, [Vec3::new(0., 0.6, 0.8), Vec3::Z, Vec3::X, Vec3::Z]);
    }
}
