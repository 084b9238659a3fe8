//! Closed surfaces of revolution about +y: bowls and rings that hold light as glass or bend it as metal.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

use crate::geometry::mesh::Mesh;
use crate::scene::file::MeshFile;

/// A point (distance from the axis, height) of a profile and its outward normal.
type ProfilePoint = (Vec2, Vec2);

/// Steps around the axis.
const AROUND: u32 = 48;

/// A ring: an ellipse with half axes `across` and `tall` at distance `radius` > `across` from the axis.
pub fn ring(radius: f32, across: f32, tall: f32) -> Mesh {
    let steps = 16;
    let profile: Vec<ProfilePoint> = (0..steps)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / steps as f32).sin_cos();
            let normal = Vec2::new(cos / across, sin / tall).normalize_or(Vec2::X);
            (Vec2::new(radius + across * cos, tall * sin), normal)
        })
        .collect();
    revolve(&profile, true)
}

/// A bowl about the origin: a shell between two spheres of `radius` and `radius` − `thickness`, open upwards above the polar
/// angle `opening` (radians from +y), with a round rim.
pub fn bowl(radius: f32, thickness: f32, opening: f32) -> Mesh {
    let steps = 12;
    let arc = |r: f32, sign: f32, polar: f32| {
        let normal = Vec2::new(polar.sin(), polar.cos());
        (normal * r, normal * sign)
    };
    let polar = |i: u32| PI + (opening - PI) * i as f32 / steps as f32;
    let mut profile: Vec<ProfilePoint> = (0..=steps).map(|i| arc(radius, 1.0, polar(i))).collect();
    let out = Vec2::new(opening.sin(), opening.cos());
    let middle = out * (radius - 0.5 * thickness);
    let up = Vec2::new(-out.y, out.x);
    for i in 1..4 {
        let (sin, cos) = (FRAC_PI_2 - PI * i as f32 / 4.0).sin_cos();
        let normal = out * sin + up * cos;
        profile.push((middle + normal * 0.5 * thickness, normal));
    }
    profile.extend((0..=steps).rev().map(|i| arc(radius - thickness, -1.0, polar(i))));
    let last = profile.len() - 1;
    for (point, normal) in [0, last].map(|i| (i, profile[i].1)) {
        profile[point] = (Vec2::new(0.0, profile[point].0.y), Vec2::new(0.0, normal.y.signum()));
    }
    revolve(&profile, false)
}

/// A closed solid whose profile (points with outward normals) starts and ends on the axis and runs with the solid on its left.
pub fn closed(profile: &[(Vec2, Vec2)]) -> Mesh {
    revolve(profile, false)
}

/// Sweeps a profile, which runs with the solid on its left, about the axis. A `looped` profile closes upon itself; another
/// one starts and ends on the axis.
fn revolve(profile: &[ProfilePoint], looped: bool) -> Mesh {
    let count = profile.len() as u32;
    let mut mesh = Mesh::default();
    for step in 0..AROUND {
        let (sin, cos) = (TAU * step as f32 / AROUND as f32).sin_cos();
        let place = |p: Vec2| Vec3::new(p.x * cos, p.y, -p.x * sin);
        for &(point, normal) in profile {
            mesh.positions.push(place(point));
            mesh.normals.push(place(normal));
        }
    }
    // A point on the axis is shared by all steps, so that the mesh is closed.
    let on_axis = |i: u32| !looped && (i == 0 || i == count - 1);
    let vertex = |step: u32, i: u32| if on_axis(i) { i } else { (step % AROUND) * count + i };
    for step in 0..AROUND {
        for i in 0..if looped { count } else { count - 1 } {
            let next = (i + 1) % count;
            let [a, b, c, d] = [vertex(step, i), vertex(step + 1, i), vertex(step + 1, next), vertex(step, next)];
            mesh.triangles
                .extend([[a, b, c], [a, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        }
    }
    without_unused(mesh)
}

/// Drops the vertices that no triangle uses.
fn without_unused(mesh: Mesh) -> Mesh {
    let mut new_index = vec![None; mesh.positions.len()];
    let mut kept = Mesh::default();
    for triangle in &mesh.triangles {
        kept.triangles.push(triangle.map(|old| {
            let old = old as usize;
            *new_index[old].get_or_insert_with(|| {
                kept.positions.push(mesh.positions[old]);
                kept.normals.push(mesh.normals[old]);
                (kept.positions.len() - 1) as u32
            })
        }));
    }
    kept
}

/// The mesh as part of a scene file.
pub fn inline(mesh: &Mesh) -> MeshFile {
    MeshFile::Inline {
        positions: mesh.positions.iter().map(|p| p.to_array()).collect(),
        normals: mesh.normals.iter().map(|n| n.to_array()).collect(),
        uvs: Vec::new(),
        triangles: mesh.triangles.clone(),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    fn signed_volume(mesh: &Mesh) -> f32 {
        let volume = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        mesh.triangles.iter().map(volume).sum()
    }

    /// Every edge is used once in each direction, and the normals of faces and vertices point outwards.
    fn assert_watertight(mesh: &Mesh, volume: f32) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry((*edge.0, *edge.1)).or_default() += 1;
            }
        }
        assert!(edges.iter().all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1)));
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let normal = (b - a).cross(c - a);
            assert!(t.iter().all(|&i| normal.dot(mesh.normals[i as usize]) > 0.0));
        }
        let measured = signed_volume(mesh);
        assert!((measured / volume - 1.0).abs() < 0.03, "{measured} instead of {volume}");
    }

    #[test]
    fn ring_is_watertight() {
        // Pappus: area of the ellipse times the way of its centre.
        assert_watertight(&ring(1.0, 0.1, 0.3), PI * 0.1 * 0.3 * TAU);
    }

    #[test]
    fn bowl_is_watertight() {
        let shell = 2.0 / 3.0 * PI * (1.0 - 0.8f32.powi(3));
        let rim = PI * 0.1 * 0.1 / 2.0 * TAU * 0.9;
        assert_watertight(&bowl(1.0, 0.2, FRAC_PI_2), shell + rim);
    }
}
