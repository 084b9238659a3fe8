//! Curves, such as hair: all that are alike become one mesh of tubes.

use std::collections::BTreeMap;

use glam::{DMat4, Vec3, Vec4};

use crate::base::{Error, Place, Result};
use crate::scene::readers::curves::{Form, tubes};

use super::Reader;
use super::parameters::Parameters;

/// Most control points of all curves of a document, and most triangles that they are made of.
const MOST_POINTS: usize = 1 << 23;
const MOST_TRIANGLES: usize = 1 << 27;

/// Curves of a document that are not meshes yet.
#[derive(Debug, Default)]
pub struct Strands {
    /// Those that are alike, by what they have in common.
    alike: BTreeMap<String, Alike>,
    /// Number of control points, and of triangles of those that are meshes.
    points: usize,
    triangles: usize,
}

/// Curves that are alike in all but their points.
#[derive(Debug)]
struct Alike {
    /// The control points of Bézier curves, with their radii.
    curves: Vec<Vec<Vec4>>,
    to_world: DMat4,
    flip: bool,
    material: String,
    object: Option<String>,
    place: Place,
}

impl Reader {
    /// Keeps a curve until all that are like it are known.
    pub(super) fn curve(&mut self, parameters: &Parameters) -> Result<()> {
        if self.state.light.is_some() {
            self.warn(&parameters.place, "curves do not shine");
        }
        self.warn(&parameters.place, "curves are tubes with flat sides, whatever their type");
        parameters.ignore(&["type", "N", "splitdepth"]);
        let points = control_points(parameters)?;
        let width = parameters.float_or("width", 1.0)?;
        let widths = [parameters.float_or("width0", width)?, parameters.float_or("width1", width)?];
        if widths.iter().any(|width| width.is_nan() || *width < 0.0) {
            return Err(parameters.malformed(format!("the curve is {widths:?} wide, expected at least 0")));
        }
        self.strands.points += points.len();
        limit(&parameters.place, "number of points of curves", self.strands.points, MOST_POINTS)?;
        let last = (points.len() - 1) as f64;
        let radius = |i: usize| (0.5 * (widths[0] + (widths[1] - widths[0]) * i as f64 / last)) as f32;
        let curve = points.iter().enumerate().map(|(i, point)| point.extend(radius(i))).collect();
        let opacity = self.opacity(parameters)?;
        let material = self.masked_material(opacity, parameters);
        let (to_world, flip, object) = (self.state.transform, self.state.reversed, self.object.clone());
        let key = format!("{to_world:?} {flip} {material:?} {object:?}");
        let place = parameters.place.clone();
        let new = || Alike { curves: Vec::new(), to_world, flip, material, object, place };
        self.strands.alike.entry(key).or_insert_with(new).curves.push(curve);
        Ok(())
    }

    /// Adds the curves that were kept.
    pub(super) fn add_strands(&mut self) -> Result<()> {
        for Alike { curves, to_world, flip, material, object, place } in
            std::mem::take(&mut self.strands.alike).into_values()
        {
            let mesh = tubes(&curves, Form::Bezier);
            self.strands.triangles += mesh.triangles.len();
            limit(&place, "number of triangles of curves", self.strands.triangles, MOST_TRIANGLES)?;
            let geometry = self.hold("curves", mesh, &place);
            self.add_plain(geometry, to_world, flip, material, object, place)?;
        }
        Ok(())
    }
}

fn limit(place: &Place, what: &str, value: usize, limit: usize) -> Result<()> {
    if value <= limit {
        return Ok(());
    }
    Err(Error::Limit { place: place.clone(), what: what.to_owned(), value: value as u64, limit: limit as u64 })
}

/// The control points of cubic Bézier curves that follow one another.
fn control_points(parameters: &Parameters) -> Result<Vec<Vec3>> {
    let points: Vec<Vec3> = parameters.tuples::<3>("P")?.into_iter().map(Vec3::from_array).collect();
    let degree = parameters.integer("degree")?.unwrap_or(3);
    let basis = parameters.string("basis")?.unwrap_or("bezier");
    let wrong = || {
        let what = format!("a {basis} curve of degree {degree} with {} points: ", points.len());
        parameters.malformed(what + "expected bezier (3n + 1 points, or 2n + 1) or bspline of the degree 3 or 2")
    };
    // Of a quadratic curve's three points the four of the same cubic one.
    let raised = |[a, b, c]: [Vec3; 3]| [a.lerp(b, 2.0 / 3.0), c.lerp(b, 2.0 / 3.0), c];
    let count = points.len();
    let mut out = Vec::new();
    match (basis, degree) {
        ("bezier", 3) if count >= 4 && count % 3 == 1 => return Ok(points),
        ("bezier", 2) if count >= 3 && count % 2 == 1 => {
            out.push(points[0]);
            points.windows(3).step_by(2).for_each(|p| out.extend(raised([p[0], p[1], p[2]])));
        }
        ("bspline", 3) if count >= 4 => {
            out.push((points[0] + 4.0 * points[1] + points[2]) / 6.0);
            for p in points.windows(4) {
                out.extend([(2.0 * p[1] + p[2]) / 3.0, (p[1] + 2.0 * p[2]) / 3.0, (p[1] + 4.0 * p[2] + p[3]) / 6.0]);
            }
        }
        ("bspline", 2) if count >= 3 => {
            out.push(0.5 * (points[0] + points[1]));
            points.windows(3).for_each(|p| out.extend(raised([0.5 * (p[0] + p[1]), p[1], 0.5 * (p[1] + p[2])])));
        }
        _ => return Err(wrong()),
    }
    Ok(out)
}
