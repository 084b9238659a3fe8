//! Cuts a triangle along the lines of a grid over a picture.

use glam::DVec2;

/// A point of a triangle: where it is on the picture, and its second and third barycentric coordinate.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: DVec2,
    part: DVec2,
}

/// Cuts polygons along the lines across one axis of a grid with `side` lines to the unit.
fn strips(polygons: Vec<Vec<Point>>, side: usize, axis: usize) -> Vec<Vec<Point>> {
    let mut out = Vec::new();
    for polygon in polygons {
        let places = || polygon.iter().map(|point| point.at[axis] * side as f64);
        let first = places().fold(f64::INFINITY, f64::min).floor();
        let last = places().fold(f64::NEG_INFINITY, f64::max).ceil();
        let mut rest = polygon.clone();
        let mut line = first + 1.0;
        while line < last && rest.len() > 2 {
            let [below, above] = [1.0, -1.0].map(|sign| half(&rest, axis, line / side as f64, sign));
            out.push(below);
            rest = above;
            line += 1.0;
        }
        out.push(rest);
    }
    out.retain(|polygon| polygon.len() > 2);
    out
}

/// The part of a convex polygon below a line (`sign` 1) or above it (−1), after Sutherland and Hodgman 1974.
fn half(polygon: &[Point], axis: usize, line: f64, sign: f64) -> Vec<Point> {
    let depth = |point: &Point| sign * (line - point.at[axis]);
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (point, next) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let [here, there] = [depth(point), depth(next)];
        if here >= 0.0 {
            out.push(*point);
        }
        if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
            let t = here / (here - there);
            out.push(Point { at: point.at.lerp(next.at, t), part: point.part.lerp(next.part, t) });
        }
    }
    out
}

/// The parts of a triangle within the cells of a grid with `side` lines to the unit, as convex polygons in its second and third
/// barycentric coordinate; `corners` are where its corners are on the picture.
pub fn cells(corners: [DVec2; 3], side: usize) -> Vec<Vec<DVec2>> {
    let parts = [DVec2::ZERO, DVec2::X, DVec2::Y];
    let whole: Vec<Point> = corners.into_iter().zip(parts).map(|(at, part)| Point { at, part }).collect();
    let pieces = match side {
        1 => vec![whole],
        side => strips(strips(vec![whole], side, 0), side, 1),
    };
    pieces.into_iter().map(|polygon| polygon.iter().map(|point| point.part).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The pieces are within a cell each and fill the triangle, also one that is a line on the picture.
    #[test]
    fn pieces_fill_the_triangle() {
        let mut random = Random::new(41, 0, 0);
        for case in 0..200 {
            let mut corner = || DVec2::new(random.next_f64(), random.next_f64()) * 4.0 - 2.0;
            let mut corners = [corner(), corner(), corner()];
            if case % 10 == 0 {
                corners[2] = corners[0].lerp(corners[1], 1.5);
            }
            let pieces = cells(corners, 8);
            let mut area = 0.0;
            for polygon in &pieces {
                for pair in polygon.windows(2).skip(1) {
                    area += 0.5 * (pair[0] - polygon[0]).perp_dot(pair[1] - polygon[0]).abs();
                }
                let on_picture = polygon
                    .iter()
                    .map(|part| corners[0] * (1.0 - part.x - part.y) + corners[1] * part.x + corners[2] * part.y);
                let middle = on_picture.clone().sum::<DVec2>() / polygon.len() as f64;
                for point in on_picture {
                    let within = (point * 8.0 - (middle * 8.0).floor() - 0.5).abs().max_element();
                    assert!(within <= 0.5 + 1e-9 || pieces.len() == 1, "{point} {middle}");
                }
            }
            assert!((area - 0.5).abs() < 1e-9, "{area}");
        }
    }
}
