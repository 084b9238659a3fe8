//! Meshes of many parts in one: boxes of all sizes, waving cloth, rounded cushions.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec2, Vec3};

use crate::scene::file::MeshFile;

/// A mesh that grows; every vertex has a normal and texture coordinates.
#[derive(Debug, Default)]
pub struct Soup {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// Adds a box with half extents `half`, turned by `turn` about its centre.
    pub fn add_box(&mut self, center: Vec3, half: Vec3, turn: Quat) {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for out in [axis, -axis] {
                let along = Vec3::new(out.y, out.z, out.x);
                let across = out.cross(along);
                let first = self.positions.len() as u32;
                for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                    let corner = out + along * (2.0 * u - 1.0) + across * (2.0 * v - 1.0);
                    self.positions.push(center + turn * (corner * half));
                    self.normals.push(turn * out);
                    self.uvs.push(Vec2::new(u, v));
                }
                self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| first + i)));
            }
        }
    }

    /// Adds a surface over the unit square of texture coordinates in `steps` × `steps` pieces; it faces ∂p/∂u × ∂p/∂v. `at` gives its
    /// points and normals.
    pub fn add_surface(&mut self, steps: [u32; 2], at: impl Fn(Vec2) -> [Vec3; 2]) {
        let first = self.positions.len() as u32;
        for j in 0..=steps[1] {
            for i in 0..=steps[0] {
                let uv = Vec2::new(i as f32 / steps[0] as f32, j as f32 / steps[1] as f32);
                let [position, normal] = at(uv);
                self.positions.push(position);
                self.normals.push(normal);
                self.uvs.push(uv);
            }
        }
        for j in 0..steps[1] {
            for i in 0..steps[0] {
                let corner = first + j * (steps[0] + 1) + i;
                let [a, b, c, d] = [corner, corner + 1, corner + steps[0] + 2, corner + steps[0] + 1];
                let pieces = [[a, b, c], [a, c, d]];
                let area = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(|i| self.positions[i as usize]);
                    (b - a).cross(c - a).length()
                };
                // At a pole two corners are one point.
                self.triangles.extend(pieces.into_iter().filter(|t| area(t) > 1e-9));
            }
        }
    }

    /// Number of triangles so far.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// The mesh as part of a scene file.
    pub fn finish(self) -> MeshFile {
        MeshFile::Inline {
            positions: self.positions.iter().map(|p| p.to_array()).collect(),
            normals: self.normals.iter().map(|n| n.to_array()).collect(),
            uvs: self.uvs.iter().map(|uv| uv.to_array()).collect(),
            triangles: self.triangles,
        }
    }
}

/// Cloth that hangs in the plane z = 0 from (0, 1) to (1, 0), in so many waves of depth `deep`.
pub fn curtain(waves: u32, deep: f32) -> MeshFile {
    let mut soup = Soup::default();
    let turns = TAU * waves as f32;
    soup.add_surface([10 * waves, 4], |uv| {
        let (sin, cos) = (turns * uv.x).sin_cos();
        [Vec3::new(uv.x, uv.y, deep * sin), Vec3::new(-deep * turns * cos, 0.0, 1.0).normalize_or(Vec3::Z)]
    });
    soup.finish()
}

/// A cushion in [-1, 1]³: |x|^n + |y|^n + |z|^n = 1 with n = 2/`round`, in latitudes and longitudes (Barr 1981); a ball for 1, nearly a box for 0.2.
pub fn cushion(round: f32) -> MeshFile {
    // What rounding leaves of a zero would not stay small under a power: seams would gape.
    let power = |x: f32, p: f32| if x.abs() < 1e-5 { 0.0 } else { x.signum() * x.abs().powf(p) };
    let mut soup = Soup::default();
    soup.add_surface([32, 18], |uv| {
        let ((sin_u, cos_u), (sin_v, cos_v)) = ((TAU * uv.x).sin_cos(), (PI * (uv.y - 0.5)).sin_cos());
        let point = |p: f32| {
            let ring = power(cos_v, p);
            Vec3::new(ring * power(cos_u, p), power(sin_v, p), -ring * power(sin_u, p))
        };
        [point(round), point(2.0 - round).normalize_or(Vec3::Y)]
    });
    soup.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All triangles face the side that their normals point to, and a closed mesh has this volume.
    fn check(file: &MeshFile, volume: Option<f32>) {
        let MeshFile::Inline { positions, normals, triangles, uvs } = file else {
            panic!("a mesh that is written out")
        };
        assert_eq!([normals.len(), uvs.len()], [positions.len(); 2]);
        let mut signed = 0.0;
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| Vec3::from_array(positions[i as usize]));
            let face = (b - a).cross(c - a);
            let shading: Vec3 = triangle.iter().map(|&i| Vec3::from_array(normals[i as usize])).sum();
            assert!(face.dot(shading) > 0.0, "{triangle:?}");
            signed += a.dot(b.cross(c)) / 6.0;
        }
        if let Some(volume) = volume {
            assert!((signed / volume - 1.0).abs() < 0.05, "{signed} instead of {volume}");
        }
    }

    #[test]
    fn meshes_face_outwards() {
        let mut boxes = Soup::default();
        boxes.add_box(Vec3::ONE, Vec3::new(0.5, 1.0, 2.0), Quat::from_rotation_y(0.3));
        boxes.add_box(Vec3::NEG_ONE, Vec3::splat(0.5), Quat::from_rotation_x(2.0));
        assert_eq!(boxes.triangles(), 24);
        check(&boxes.finish(), Some(9.0));
        check(&curtain(5, 0.03), None);
        // The ball's, and a little less than the cube's.
        check(&cushion(1.0), Some(4.0 / 3.0 * PI));
        check(&cushion(0.2), Some(7.7));
    }
}
