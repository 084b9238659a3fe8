//! The meshes that need no file. Texture coordinates follow Mitsuba's shapes of the same name.

use std::f64::consts::TAU;

use glam::{DVec2, Vec2, Vec3};

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

/// Number of segments of round shapes.
pub const SEGMENTS: u32 = 128;

/// The unit disk in z = 0 facing +z, as a polygon of the same area; u is the radius, v the turn.
pub fn disk() -> Mesh {
    let step = TAU / f64::from(SEGMENTS);
    // A sector of the polygon has sin(step)/2·r².
    let radius = (step / step.sin()).sqrt();
    let mut mesh = Mesh::default();
    for i in 0..SEGMENTS {
        let turns = [i, i, i + 1].map(|k| f64::from(k) / f64::from(SEGMENTS));
        let middle = 0.5 * (turns[1] + turns[2]);
        let corners = [(0.0, middle), (radius, turns[1]), (radius, turns[2])];
        for (r, turn) in corners {
            let (sin, cos) = (TAU * turn).sin_cos();
            mesh.positions.push(DVec2::new(r * cos, r * sin).as_vec2().extend(0.0));
            mesh.normals.push(Vec3::Z);
            mesh.uvs.push(Vec2::new(r.min(1.0) as f32, turn as f32));
        }
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// The side of a cylinder with radius 1 from z = 0 to z = 1, facing outwards; u is the turn, v the height.
pub fn cylinder() -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=SEGMENTS {
        let turn = f64::from(i) / f64::from(SEGMENTS);
        // The last corners are the first, to the bit.
        let (sin, cos) = (TAU * if i == SEGMENTS { 0.0 } else { turn }).sin_cos();
        let normal = DVec2::new(cos, sin).as_vec2().extend(0.0);
        for height in [0.0, 1.0] {
            mesh.positions.push(normal + Vec3::Z * height);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(turn as f32, height));
        }
    }
    for i in 0..SEGMENTS {
        let [below, above, next, next_above] = [0, 1, 2, 3].map(|k| 2 * i + k);
        mesh.triangles.push([below, next, next_above]);
        mesh.triangles.push([below, next_above, above]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn round_shapes_face_outwards() {
        for (mesh, area, up) in [(disk(), PI, true), (cylinder(), TAU, false)] {
            let mut total = 0.0;
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
                let cross = (b - a).cross(c - a);
                total += 0.5 * cross.length();
                let outward = if up { glam::DVec3::Z } else { (a + b + c).with_z(0.0).normalize() };
                assert!(cross.normalize().dot(outward) > 0.999);
            }
            // The strips of a cylinder are chords.
            assert!((total / area - 1.0).abs() < 2e-4, "{total} {area}");
        }
    }

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
