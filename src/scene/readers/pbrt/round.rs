//! Round shapes as meshes: surfaces of revolution about z, with pbrt's texture coordinates.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec2};

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::scene::readers::builtin::SEGMENTS;

use super::parameters::Parameters;

/// A circle of a surface of revolution.
#[derive(Debug, Clone, Copy)]
struct Ring {
    /// Its radius and height.
    at: DVec2,
    /// The normal there: its part outwards and upwards.
    normal: DVec2,
    /// Second texture coordinate.
    v: f64,
}

/// The kinds that [`mesh`] makes.
pub const KINDS: [&str; 6] = ["sphere", "disk", "cylinder", "cone", "paraboloid", "hyperboloid"];

/// Whether the parameters of a sphere describe a whole one, and its radius.
pub fn whole_sphere(parameters: &Parameters) -> Result<(bool, f64)> {
    let radius = parameters.float_or("radius", 1.0)?;
    let [low, high] = [parameters.float_or("zmin", -radius)?, parameters.float_or("zmax", radius)?];
    let whole = low <= -radius && high >= radius && parameters.float_or("phimax", 360.0)? >= 360.0;
    Ok((whole, radius))
}

/// The mesh of a round shape; its front is that of pbrt.
pub fn mesh(kind: &str, parameters: &Parameters) -> Result<Mesh> {
    let sweep = parameters.float_or("phimax", 360.0)?.clamp(0.0, 360.0);
    let radius = parameters.float_or("radius", 1.0)?;
    if radius < 0.0 {
        return Err(parameters.malformed(format!("the radius is {radius}, expected at least 0")));
    }
    let number = |name, default| parameters.float_or(name, default);
    let rings = match kind {
        "sphere" => {
            let [low, high] = [number("zmin", -radius)?, number("zmax", radius)?];
            sphere(radius, low.min(high), low.max(high))
        }
        "disk" => {
            let (height, inner) = (number("height", 0.0)?, number("innerradius", 0.0)?);
            // Sectors of the polygon have sin(step)/2·r²: widened to the area of the disk.
            let step = TAU / f64::from(SEGMENTS);
            let widened = (step / step.sin()).sqrt();
            let ring = |r: f64, v| Ring { at: DVec2::new(r * widened, height), normal: DVec2::Y, v };
            vec![ring(radius, 0.0), ring(inner.clamp(0.0, radius), 1.0)]
        }
        "cone" => cone(radius, number("height", 1.0)?),
        "paraboloid" => {
            let [low, high] = [number("zmin", 0.0)?, number("zmax", 1.0)?];
            curve(low.max(0.0).sqrt(), high.max(0.0).sqrt(), |s| {
                let r = if high > 0.0 { radius * s / high.sqrt() } else { 0.0 };
                DVec2::new(r, s * s)
            })
        }
        "hyperboloid" => {
            let [a, b] = [parameters.vector("p1")?, parameters.vector("p2")?];
            let (a, b) = (a.unwrap_or_default(), b.unwrap_or(DVec3::ONE));
            curve(0.0, 1.0, |s| {
                let point = a.lerp(b, s);
                DVec2::new(point.truncate().length(), point.z)
            })
        }
        _ => {
            let [low, high] = [number("zmin", -1.0)?, number("zmax", 1.0)?];
            let ring = |z, v| Ring { at: DVec2::new(radius, z), normal: DVec2::X, v };
            vec![ring(low, 0.0), ring(high, 1.0)]
        }
    };
    Ok(revolved(&rings, sweep))
}

/// The whole sphere of this radius as a mesh.
pub fn sphere_mesh(radius: f64) -> Mesh {
    revolved(&sphere(radius, -radius, radius), 360.0)
}

fn sphere(radius: f64, low: f64, high: f64) -> Vec<Ring> {
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

fn cone(radius: f64, height: f64) -> Vec<Ring> {
    let normal = DVec2::new(height, radius).normalize_or(DVec2::X);
    [(0.0, DVec2::new(radius, 0.0)), (1.0, DVec2::new(0.0, height))].map(|(v, at)| Ring { at, normal, v }).to_vec()
}

/// Rings along a profile, whose normals are across it.
fn curve(first: f64, last: f64, at: impl Fn(f64) -> DVec2) -> Vec<Ring> {
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
fn revolved(rings: &[Ring], sweep: f64) -> Mesh {
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
