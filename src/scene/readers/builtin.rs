//! The meshes that need no file. Texture coordinates follow Mitsuba's shapes of the same name.

use glam::{Vec2, Vec3};

use crate::geometry::mesh::Mesh;

/// The square [-1, 1]² in z = 0 facing +z; (u, v) = ((x + 1)/2, (y + 1)/2).
pub fn rectangle() -> Mesh {
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    Mesh {
        positions: uvs.iter().map(|uv| (*uv * 2.0 - 1.0).extend(0.0)).collect(),
        normals: vec![Vec3::Z; 4],
        uvs: uvs.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// The faces of [`cube`]: outward normal, then the directions in which u and v grow.
const FACES: [[Vec3; 3]; 6] = [
    [Vec3::NEG_Y, Vec3::Z, Vec3::X],
    [Vec3::Y, Vec3::NEG_X, Vec3::NEG_Z],
    [Vec3::X, Vec3::Y, Vec3::NEG_Z],
    [Vec3::Z, Vec3::Y, Vec3::X],
    [Vec3::NEG_X, Vec3::Y, Vec3::Z],
    [Vec3::NEG_Z, Vec3::NEG_Y, Vec3::X],
];

/// The cube [-1, 1]³ facing outwards; every face spans the unit square of texture coordinates.
pub fn cube() -> Mesh {
    let mut mesh = Mesh::default();
    // Counter-clockwise from outside, starting at the corner (0, 1).
    let corners = [Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO];
    for (face, [normal, u, v]) in (0u32..).zip(FACES) {
        for uv in corners {
            let signed = uv * 2.0 - 1.0;
            mesh.positions.push(normal + u * signed.x + v * signed.y);
            mesh.normals.push(normal);
            mesh.uvs.push(uv);
        }
        let first = 4 * face;
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangles.push([first + 3, first, first + 2]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(mesh: &Mesh, area: f32) {
        let mut total = 0.0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
            let cross = (b - a).cross(c - a);
            for i in triangle {
                assert!(mesh.normals[*i as usize].distance(cross.normalize()) < 1e-6, "winding agrees with the normal");
            }
            total += cross.length() / 2.0;
        }
        assert!((total - area).abs() < 1e-5);
    }

    #[test]
    fn closed_and_outward() {
        check(&rectangle(), 4.0);
        let cube = cube();
        check(&cube, 24.0);
        assert!(cube.positions.iter().zip(&cube.normals).all(|(p, n)| p.dot(*n) == 1.0 && p.abs() == Vec3::ONE));
        // Divergence theorem: the volume is 8.
        let volume: f32 = cube
            .triangles
            .iter()
            .map(|t| t.map(|i| cube.positions[i as usize]))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!((volume - 8.0).abs() < 1e-5);
    }

    /// Corners of Mitsuba's cube: the first vertices of its faces -y, +y and -z.
    #[test]
    fn texture_coordinates_as_in_mitsuba() {
        let cube = cube();
        let uv_at =
            |p: Vec3, n: Vec3| (0..24).find(|&i| cube.positions[i] == p && cube.normals[i] == n).map(|i| cube.uvs[i]);
        assert_eq!(uv_at(Vec3::new(1., -1., -1.), Vec3::NEG_Y), Some(Vec2::new(0., 1.)));
        assert_eq!(uv_at(Vec3::new(1., -1., 1.), Vec3::NEG_Y), Some(Vec2::new(1., 1.)));
        assert_eq!(uv_at(Vec3::new(-1., 1., -1.), Vec3::Y), Some(Vec2::new(1., 1.)));
        assert_eq!(uv_at(Vec3::new(1., 1., 1.), Vec3::Y), Some(Vec2::new(0., 0.)));
        assert_eq!(uv_at(Vec3::new(1., 1., -1.), Vec3::X), Some(Vec2::new(1., 1.)));
        assert_eq!(uv_at(Vec3::new(-1., 1., 1.), Vec3::Z), Some(Vec2::new(1., 0.)));
        assert_eq!(uv_at(Vec3::new(-1., 1., 1.), Vec3::NEG_X), Some(Vec2::new(1., 1.)));
        assert_eq!(uv_at(Vec3::new(1., -1., -1.), Vec3::NEG_Z), Some(Vec2::new(1., 1.)));
    }
}
