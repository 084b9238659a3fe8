//! Boxes around the parts of large slanted triangles, which are smaller than one box around the whole (Ernst and Greiner 2007, *Early Split
//! Clipping for Bounding Volume Hierarchies*; limits after `obvhs`' preset).

use glam::{DVec3, Vec3};
use obvhs::aabb::Aabb;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::{box_of, widened};

/// Area of boxes that are split, over the mean area of all.
const LARGE: f32 = 3.0;
/// Factor by which a split has to lower the area. Halves of a square, cut along its diagonal, have 1.33: a hierarchy gains nothing there.
const LEAST_GAIN: f32 = 1.6;
/// Planes that are tried for each split.
const PLANES: usize = 11;
/// Times that a triangle is halved.
const MOST_HALVINGS: u32 = 12;

/// A convex polygon: a triangle that two planes for each axis have cut.
type Polygon = SmallVec<[DVec3; 9]>;

/// Boxes around parts of triangles and the index of the triangle of each, in the order of the triangles; none where no triangle is worth
/// splitting. `boxes` bound the triangles whose corners `corners` returns.
pub fn split(boxes: &[Aabb], corners: impl Fn(usize) -> [Vec3; 3] + Sync) -> Option<(Vec<Aabb>, Vec<u32>)> {
    let mean = boxes.iter().map(|b| f64::from(b.half_area())).sum::<f64>() / boxes.len() as f64;
    let large = LARGE * mean as f32;
    let parts = |triangle: usize| {
        let mut parts = Vec::new();
        let corners = corners(triangle);
        halve(&corners.map(Vec3::as_dvec3).into_iter().collect(), box_of(&corners), large, MOST_HALVINGS, &mut parts);
        (triangle, parts)
    };
    let found: Vec<(usize, Vec<Aabb>)> = (boxes.par_iter().enumerate())
        .filter(|(_, whole)| whole.half_area() > large)
        .map(|(triangle, _)| parts(triangle))
        .filter(|(_, parts)| parts.len() > 1)
        .collect();
    if found.is_empty() {
        return None;
    }
    let (mut all, mut triangles) = (boxes.to_vec(), (0..boxes.len() as u32).collect::<Vec<_>>());
    for (triangle, parts) in found {
        all[triangle] = parts[0];
        all.extend(&parts[1..]);
        triangles.resize(all.len(), triangle as u32);
    }
    Some((all, triangles))
}

/// Appends the boxes of the parts of `polygon`, which `whole` bounds.
fn halve(polygon: &Polygon, whole: Aabb, large: f32, halvings: u32, parts: &mut Vec<Aabb>) {
    let area = whole.half_area();
    let best = if area > large && halvings > 0 { best_halves(polygon, &whole) } else { None };
    match best {
        Some((halves, both)) if both * LEAST_GAIN < area => {
            for (polygon, bounds) in &halves {
                halve(polygon, *bounds, large, halvings - 1, parts);
            }
        }
        _ => parts.push(whole),
    }
}

/// Halves with the least area of both boxes, and that area, of several planes across the longest side of the box.
fn best_halves(polygon: &Polygon, whole: &Aabb) -> Option<([(Polygon, Aabb); 2], f32)> {
    let axis = whole.largest_axis();
    let (low, high) = (f64::from(whole.min[axis]), f64::from(whole.max[axis]));
    let halves = (1..=PLANES).filter_map(|plane| {
        let at = low + (high - low) * plane as f64 / (PLANES + 1) as f64;
        let [below, above] = [-1.0, 1.0].map(|side| beyond(polygon, axis, at, side));
        let halves = [(bounds(&below)?, below), (bounds(&above)?, above)].map(|(bounds, part)| (part, bounds));
        let both = halves[0].1.half_area() + halves[1].1.half_area();
        Some((halves, both))
    });
    halves.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The part of a polygon that lies on one side of a plane across an axis (Sutherland and Hodgman 1974).
fn beyond(polygon: &Polygon, axis: usize, at: f64, side: f64) -> Polygon {
    let distance = |point: DVec3| side * (point[axis] - at);
    let mut part = Polygon::new();
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (da, db) = (distance(a), distance(b));
        if da >= 0.0 {
            part.push(a);
        }
        if da * db < 0.0 {
            let mut cut = a + (b - a) * (da / (da - db));
            cut[axis] = at;
            part.push(cut);
        }
    }
    part
}

/// The box of a polygon, as far outside of it as that of a triangle. Corners were cut in double precision, so that they err by less than
/// rounding to single precision.
fn bounds(polygon: &Polygon) -> Option<Aabb> {
    let low = polygon.iter().copied().reduce(DVec3::min)?;
    let high = polygon.iter().copied().reduce(DVec3::max)?;
    Some(widened(Aabb::new(low.as_vec3a(), high.as_vec3a())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn boxes(triangles: &[[Vec3; 3]]) -> Vec<Aabb> {
        triangles.iter().map(box_of).collect()
    }

    /// Small triangles, and `count` long ones across all of them in any direction.
    fn needles(count: usize) -> Vec<[Vec3; 3]> {
        let mut random = Random::new(11, 0, 0);
        let mut point = |size: f32| Vec3::from_array(std::array::from_fn(|_| size * (random.next_f32() - 0.5)));
        let mut triangles: Vec<[Vec3; 3]> = (0..4000)
            .map(|_| point(10.0))
            .collect::<Vec<_>>()
            .into_iter()
            .map(|c| [c, c + Vec3::X * 0.1, c + Vec3::Y * 0.1])
            .collect();
        triangles.extend((0..count).map(|_| {
            let (from, to) = (point(10.0), point(10.0));
            [from, to, to + point(0.1)]
        }));
        triangles
    }

    /// Every point of a triangle is in one of its boxes, all boxes are within that of the whole, and they are smaller together.
    #[test]
    fn parts_cover_their_triangle() {
        let triangles = needles(50);
        let wholes = boxes(&triangles);
        let (parts, owners) = split(&wholes, |i| triangles[i]).expect("needles are worth splitting");
        assert!(parts.len() > triangles.len() + 50, "{} boxes", parts.len());
        let area = |boxes: &[Aabb]| boxes.iter().map(Aabb::half_area).sum::<f32>();
        assert!(area(&parts) < 0.5 * area(&wholes), "{} of {}", area(&parts), area(&wholes));
        let mut random = Random::new(12, 0, 0);
        for (i, triangle) in triangles.iter().enumerate().skip(3990) {
            let own: Vec<&Aabb> =
                parts.iter().zip(&owners).filter(|(_, owner)| **owner as usize == i).map(|(part, _)| part).collect();
            let slack = Vec3::splat(1e-5);
            for part in &own {
                let (low, high) = (Vec3::from(part.min) + slack, Vec3::from(part.max) - slack);
                assert!(
                    low.cmpge(wholes[i].min.into()).all() && high.cmple(wholes[i].max.into()).all(),
                    "triangle {i}"
                );
            }
            for _ in 0..500 {
                let (u, v) = (random.next_f32(), random.next_f32());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let [a, b, c] = triangle.map(Vec3::as_dvec3);
                let point = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
                let inside = |part: &&&Aabb| {
                    let (low, high) = (Vec3::from(part.min).as_dvec3(), Vec3::from(part.max).as_dvec3());
                    point.cmpge(low).all() && point.cmple(high).all()
                };
                assert!(own.iter().any(|part| inside(&part)), "triangle {i}: {point}");
            }
        }
    }

    /// Triangles that boxes fit, and small ones, stay whole.
    #[test]
    fn walls_stay_whole() {
        let mut triangles = needles(0);
        assert!(split(&boxes(&triangles), |i| triangles[i]).is_none());
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        triangles.push([corner(-5.0, -5.0), corner(5.0, -5.0), corner(5.0, 5.0)]);
        triangles.push([corner(-5.0, -5.0), corner(5.0, 5.0), corner(-5.0, 5.0)]);
        assert!(split(&boxes(&triangles), |i| triangles[i]).is_none());
    }
}
