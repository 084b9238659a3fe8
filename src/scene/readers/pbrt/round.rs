//! Round shapes as meshes.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::scene::readers::builtin::SEGMENTS;
use crate::scene::readers::revolved::{Ring, curve, revolved, sphere};

use super::parameters::Parameters;

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

fn cone(radius: f64, height: f64) -> Vec<Ring> {
    let normal = DVec2::new(height, radius).normalize_or(DVec2::X);
    [(0.0, DVec2::new(radius, 0.0)), (1.0, DVec2::new(0.0, height))].map(|(v, at)| Ring { at, normal, v }).to_vec()
}
