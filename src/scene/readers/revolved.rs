//! Surfaces of revolution about z as meshes, with pbrt's texture coordinates.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DMat4, DVec2, DVec3, Vec2};

use crate::geometry::mesh::Mesh;
use crate::scene::readers::builtin::SEGMENTS;

/// A circle of a surface of revolution.
#[derive(Debug, Clone, Copy)]
pub struct Ring {
    /// Its radius and height.
    pub at: DVec2,
    /// The normal there: its part outwards and upwards.
    pub normal: DVec2,
    /// Second texture coordinate.
    pub v: f64,
}

/// The whole sphere of this radius as a mesh.
pub fn sphere_mesh(radius: f64) -> Mesh {
    revolved(&sphere(radius, -radius, radius), 360.0)
}

/// The rings of a sphere between two heights.
pub fn sphere(radius: f64, low: f64, high: f64) -> Vec<Ring> {
    let angle = |z: f64| (z / radius).clamp(-1.0, 1.0).asin();
    let (first, last) = (angle(low), angle(high));
    let steps = steps(last - first, PI);
    let ring = |i: u32| {
        let latitude = first + (last - first) * f64::from(i) / f64::from(steps);
        // The poles are points to the bit.
        let out = if latitude.abs() >= FRAC_PI_2 - 1e-12 { 0.0 } else { latitude.cos() };
        let normal = DVec2::new(out, latitude.sin());
        Ring { at: radius * normal, normal, v: f64::from(i) / f64::from(steps) }
    };
    (0..=steps).map(ring).collect()
}

/// Rings along a profile, whose normals are across it.
pub fn curve(first: f64, last: f64, at: impl Fn(f64) -> DVec2) -> Vec<Ring> {
    let steps = SEGMENTS / 4;
    let ring = |i: u32| {
        let part = f64::from(i) / f64::from(steps);
        let (s, step) = (first + (last - first) * part, 1e-4 * (last - first));
        let along = at(s + step) - at((s - step).max(0.0));
        Ring { at: at(s), normal: DVec2::new(along.y, -along.x).normalize_or(DVec2::X), v: part }
    };
    (0..=steps).map(ring).collect()
}

/// Number of steps for a part of a turn, `whole` of which are half of [`SEGMENTS`].
fn steps(part: f64, whole: f64) -> u32 {
    ((part / whole * f64::from(SEGMENTS / 2)).ceil() as u32).clamp(1, SEGMENTS / 2)
}

/// The surface that rings span, from the first to the last.
pub fn revolved(rings: &[Ring], sweep: f64) -> Mesh {
    let columns = ((sweep / 360.0 * f64::from(SEGMENTS)).ceil() as u32).clamp(1, SEGMENTS);
    let mut mesh = Mesh::default();
    for column in 0..=columns {
        let u = f64::from(column) / f64::from(columns);
        // The last corners of a whole turn are the first, to the bit.
        let turn = if column == columns && sweep >= 360.0 { 0.0 } else { u };
        let (sin, cos) = (turn * sweep).to_radians().sin_cos();
        for ring in rings {
            let turned = |p: DVec2| DVec3::new(p.x * cos, p.x * sin, p.y).as_vec3();
            mesh.positions.push(turned(ring.at));
            mesh.normals.push(turned(ring.normal));
            mesh.uvs.push(Vec2::new(u as f32, ring.v as f32));
        }
    }
    let height = rings.len() as u32;
    for column in 0..columns {
        for (row, pair) in (0u32..).zip(rings.windows(2)) {
            let [below, above] = [column * height + row, column * height + row + 1];
            let [next, next_above] = [below + height, above + height];
            // Where a ring is a point, one of the triangles has no area.
            if pair[0].at.x != 0.0 {
                mesh.triangles.push([below, next, next_above]);
            }
            if pair[1].at.x != 0.0 {
                mesh.triangles.push([below, next_above, above]);
            }
        }
    }
    mesh
}

/// Whether a transform scales alike in all directions, up to the rounding of numbers with six digits.
pub fn is_uniform(m: &DMat4) -> bool {
    let linear = DMat3::from_mat4(*m);
    let gram = linear.transpose() * linear;
    let mean = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let off = gram - DMat3::from_diagonal(DVec3::splat(mean));
    // Half of what a scene file may be off.
    off.to_cols_array().iter().all(|x| x.abs() <= 5e-5 * mean)
}
