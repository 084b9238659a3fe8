//! Curves with a thickness, such as hair, as tubes of triangles. A tube has flat sides, but the normals of a round one, and its mean width.

use std::f32::consts::TAU;
use std::path::Path;

use glam::{Vec2, Vec3, Vec4};

use super::lines::{lines, numbers, words};
use crate::base::{Error, Place, Result, files};
use crate::geometry::mesh::Mesh;

/// Largest file.
const MOST_BYTES: u64 = 1 << 30;
/// Most triangles of tubes with more than the fewest sides.
const MANY: usize = 1 << 22;
/// Numbers of sides, the most first.
const SIDES: [u32; 4] = [16, 8, 6, 4];
/// Most control points of a file.
const MOST_POINTS: usize = 1 << 23;
/// Most straight pieces for a cubic one, and the most of all together where each cubic one has more than one.
const MOST_STEPS: usize = 16;
const MANY_STEPS: usize = 1 << 22;
/// How far straight pieces may be from a curve, in radii.
const OFF: f32 = 0.05;

/// How control points make a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Straight from one to the next.
    Linear,
    /// A uniform cubic B-spline.
    BSpline,
    /// Cubic Bézier curves, each of which begins at the last point of the one before.
    Bezier,
}

impl Form {
    /// Number of pieces that so many control points make.
    fn pieces(self, points: usize) -> usize {
        match self {
            Self::Linear => points.saturating_sub(1),
            Self::BSpline => points.saturating_sub(3),
            Self::Bezier => points.saturating_sub(1) / 3,
        }
    }
}

/// A point of a curve, and its direction.
#[derive(Debug, Clone, Copy)]
struct Knot {
    center: Vec3,
    radius: f32,
    along: Vec3,
    /// Number of pieces before it, of its curve and those before, with the part of its own.
    pieces: f64,
}

/// Reads Mitsuba's text files: a control point a line, x y z radius, and an empty line between curves. Radii are multiplied by `wider`.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`] for larger files than 1 GiB or more than 2²³ points, [`Error::Malformed`] with the line.
pub fn read(path: &Path, wider: f32) -> Result<Vec<Vec<Vec4>>> {
    let text = files::read_bytes(path, MOST_BYTES)?;
    let (mut curves, mut points, mut count) = (Vec::new(), Vec::new(), 0);
    for (number, line) in (1u32..).zip(lines(&text)) {
        let mut words = words(line);
        let Some(first) = words.next() else {
            curves.extend((!points.is_empty()).then(|| std::mem::take(&mut points)));
            continue;
        };
        count += 1;
        if count > MOST_POINTS {
            let (place, what) = (Place::file(path), "number of control points".to_owned());
            return Err(Error::Limit { place, what, value: count as u64, limit: MOST_POINTS as u64 });
        }
        let mut words = std::iter::once(first).chain(words);
        let point = numbers::<4>(&mut words).filter(|_| words.next().is_none());
        let wrong = || Error::malformed(Place::line(path, number), "expected x, y, z and a radius");
        let point =
            point.filter(|[x, y, z, r]| x.is_finite() && y.is_finite() && z.is_finite() && *r >= 0.0 && r.is_finite());
        let [x, y, z, radius] = point.ok_or_else(wrong)?;
        points.push(Vec4::new(x, y, z, radius * wider));
    }
    curves.extend((!points.is_empty()).then_some(points));
    Ok(curves)
}

/// The tubes of curves given by their control points (x, y, z, radius). Texture coordinates go around each (u), and along all of them, one after the
/// other, by their pieces (v), as Mitsuba's do; those of Bézier curves along each (u) and around it (v), as pbrt's do. Curves of too few points are left out.
pub fn tubes(curves: &[Vec<Vec4>], form: Form) -> Mesh {
    let points: usize = curves.iter().map(Vec::len).sum();
    let most = (MANY_STEPS / points.max(1)).clamp(1, MOST_STEPS);
    let mut before = 0;
    let mut of_curve = |points: &Vec<Vec4>| {
        let knots = knots(points, form, most, before);
        before += form.pieces(points.len());
        knots
    };
    let knots: Vec<Vec<Knot>> = curves.iter().map(&mut of_curve).filter(|knots| knots.len() > 1).collect();
    let pieces = before as f64;
    let rings: usize = knots.iter().map(Vec::len).sum();
    let fits = |sides: &u32| 2 * rings * *sides as usize <= MANY;
    let sides = SIDES.into_iter().find(fits).unwrap_or(SIDES[SIDES.len() - 1]);
    let mut mesh = Mesh::default();
    knots.iter().for_each(|knots| tube(&mut mesh, knots, sides, form, pieces));
    mesh
}

/// Points along a curve that comes after so many pieces of others, of a spline at most so `many` for each of its pieces.
fn knots(points: &[Vec4], form: Form, many: usize, before: usize) -> Vec<Knot> {
    let knot = |point: Vec4, along: Vec3, piece: usize, part: f32| {
        let pieces = (before + piece) as f64 + f64::from(part);
        Knot { center: point.truncate(), radius: point.w, along, pieces }
    };
    match form {
        Form::Linear => {
            let mut distinct: Vec<(usize, Vec4)> = points.iter().copied().enumerate().collect();
            distinct.dedup_by_key(|(_, point)| point.truncate());
            let towards = |a: usize, b: usize| (distinct[b].1 - distinct[a].1).truncate().normalize_or_zero();
            let along = |i: usize| {
                let (into, on) = (towards(i.saturating_sub(1), i), towards(i, (i + 1).min(distinct.len() - 1)));
                (into + on).normalize_or(on)
            };
            (0..distinct.len()).map(|i| knot(distinct[i].1, along(i), distinct[i].0, 0.0)).collect()
        }
        Form::BSpline | Form::Bezier => {
            let mut knots = Vec::new();
            let between = if form == Form::Bezier { 3 } else { 1 };
            for (i, piece) in points.windows(4).step_by(between).enumerate() {
                let piece = bezier(&[piece[0], piece[1], piece[2], piece[3]], form);
                let steps = steps(&piece).min(many as u32);
                let first = if i == 0 { 0 } else { 1 };
                for step in first..=steps {
                    let part = step as f32 / steps as f32;
                    let (point, along) = on_bezier(&piece, part);
                    knots.push(knot(point, along.truncate(), i, part));
                }
            }
            // Where control points coincide, the curve has no direction of its own.
            let chord = |i: usize| {
                let [before, after] = [i.saturating_sub(1), (i + 1).min(knots.len() - 1)];
                (knots[after].center - knots[before].center).normalize_or(Vec3::Z)
            };
            let along: Vec<Vec3> =
                (0..knots.len()).map(|i| knots[i].along.try_normalize().unwrap_or_else(|| chord(i))).collect();
            knots.iter_mut().zip(along).for_each(|(knot, along)| knot.along = along);
            knots
        }
    }
}

/// A piece's control points as those of a Bézier curve.
fn bezier(points: &[Vec4; 4], form: Form) -> [Vec4; 4] {
    let [a, b, c, d] = *points;
    match form {
        Form::BSpline => [(a + 4.0 * b + c) / 6.0, (2.0 * b + c) / 3.0, (b + 2.0 * c) / 3.0, (b + 4.0 * c + d) / 6.0],
        Form::Linear | Form::Bezier => *points,
    }
}

/// How many straight pieces are near enough to a Bézier curve: of a curve with the second derivative d, n pieces are off by d/8n².
fn steps(points: &[Vec4; 4]) -> u32 {
    let [a, b, c, d] = points.map(|point| point.truncate());
    let bend = 6.0 * (a - 2.0 * b + c).length().max((b - 2.0 * c + d).length());
    let radius = 0.25 * (points[0].w + points[1].w + points[2].w + points[3].w);
    (bend / (8.0 * OFF * radius).max(f32::MIN_POSITIVE)).sqrt().ceil().clamp(1.0, MOST_STEPS as f32).max(1.0) as u32
}

/// A point of a Bézier curve, and the derivative there, by de Casteljau's construction.
fn on_bezier(points: &[Vec4; 4], t: f32) -> (Vec4, Vec4) {
    let [a, b, c, d] = *points;
    let (ab, bc, cd) = (a.lerp(b, t), b.lerp(c, t), c.lerp(d, t));
    let (abc, bcd) = (ab.lerp(bc, t), bc.lerp(cd, t));
    (abc.lerp(bcd, t), 3.0 * (bcd - abc))
}

/// Adds the tube around a curve. Straight pieces have normals of their own, and closed ends.
fn tube(mesh: &mut Mesh, knots: &[Knot], sides: u32, form: Form, pieces: f64) {
    // The width of a polygon, averaged over its turns, is that of a circle with its perimeter: so many times as wide as the circle around it.
    let angle = TAU / sides as f32;
    let wider = angle / (2.0 * (0.5 * angle).sin());
    let lengths: Vec<f32> = knots.windows(2).map(|pair| pair[0].center.distance(pair[1].center)).collect();
    let last = knots.len() - 1;
    let mut across = knots[0].along.any_orthonormal_vector();
    let (first, own) = (mesh.positions.len() as u32, knots[last].pieces - knots[0].pieces);
    let mut rings = 0;
    for (i, knot) in knots.iter().enumerate() {
        // Carried along the curve without a turn about it.
        across = (across - knot.along * across.dot(knot.along)).normalize_or(knot.along.any_orthonormal_vector());
        let beside = knot.along.cross(across);
        let piece = |i: usize| (knots[i + 1].center - knots[i].center) / lengths[i].max(f32::MIN_POSITIVE);
        // Where pieces meet, the ring lies in the plane between them, where it is wider.
        let joins = i > 0 && i < last;
        let sharp = if joins { piece(i - 1).dot(knot.along).max(0.5) } else { 1.0 };
        let radius = knot.radius * wider / sharp.sqrt();
        let slope = |from: usize, to: usize| {
            let run: f32 = lengths[from..to].iter().sum();
            if run > 0.0 { (knots[to].radius - knots[from].radius) / run } else { 0.0 }
        };
        // Each ring has the direction of the piece that its normals belong to, and how fast that widens.
        let smooth = [Some((knot.along, slope(i.saturating_sub(1), (i + 1).min(last)))), None];
        let apart = [(i > 0).then(|| (piece(i - 1), slope(i - 1, i))), (i < last).then(|| (piece(i), slope(i, i + 1)))];
        for (along, slope) in (if form == Form::Linear { apart } else { smooth }).into_iter().flatten() {
            rings += 1;
            for side in 0..=sides {
                // The last corners of a turn are the first, to the bit.
                let (sin, cos) = ((side % sides) as f32 * angle).sin_cos();
                let out = across * cos + beside * sin;
                let normal = (out - along * out.dot(along)).normalize_or(out);
                mesh.positions.push(knot.center + out * radius);
                mesh.normals.push((normal - along * slope).normalize_or(normal));
                let around = side as f32 / sides as f32;
                mesh.uvs.push(match form {
                    Form::Linear | Form::BSpline => Vec2::new(around, (knot.pieces / pieces) as f32),
                    Form::Bezier => Vec2::new(((knot.pieces - knots[0].pieces) / own) as f32, around),
                });
            }
        }
    }
    let corner = |ring: u32, side: u32| first + ring * (sides + 1) + side;
    // Of straight pieces every other pair of rings is one between them.
    for ring in (0..rings - 1).step_by(if form == Form::Linear { 2 } else { 1 }) {
        for side in 0..sides {
            let [a, b, c, d] =
                [corner(ring, side), corner(ring, side + 1), corner(ring + 1, side + 1), corner(ring + 1, side)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    // Mitsuba's splines are open.
    let ends = [(0, -knots[0].along), (rings - 1, knots[last].along)];
    for (ring, outward) in if form == Form::Linear { &ends[..] } else { &[] } {
        let begun = mesh.positions.len() as u32;
        for side in 0..sides {
            let corner = corner(*ring, side) as usize;
            mesh.positions.push(mesh.positions[corner]);
            mesh.normals.push(*outward);
            mesh.uvs.push(mesh.uvs[corner]);
        }
        for side in 1..sides - 1 {
            let [b, c] = if *ring > 0 { [side, side + 1] } else { [side + 1, side] };
            mesh.triangles.push([begun, begun + b, begun + c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(mesh: &Mesh) -> f32 {
        let corner = |i: u32| mesh.positions[i as usize];
        mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
    }

    /// A straight tube holds what a cylinder holds, but for its flat sides, and faces outwards; a cone what a cone holds.
    #[test]
    fn tubes_are_closed_and_as_wide_as_they_should_be() {
        let line = |radii: [f32; 2]| vec![Vec4::new(1.0, 2.0, 3.0, radii[0]), Vec4::new(1.0, 2.0, 5.0, radii[1])];
        let cylinder = volume(&tubes(&[line([0.5, 0.5])], Form::Linear));
        assert!((cylinder / (2.0 * std::f32::consts::PI * 0.25) - 1.0).abs() < 0.02, "{cylinder}");
        let cone = volume(&tubes(&[line([0.5, 0.0])], Form::Linear));
        assert!((cone / (2.0 * std::f32::consts::PI * 0.25 / 3.0) - 1.0).abs() < 0.02, "{cone}");
    }

    /// Points of a spline lie where Cox and de Boor's weights say, and a bent one is near its curve everywhere.
    #[test]
    fn splines_follow_their_control_points() {
        let points: Vec<Vec4> = [[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [3.0, 3.0, 0.0], [3.0, 0.0, 1.0], [6.0, 0.0, 0.0]]
            .map(|[x, y, z]| Vec4::new(x, y, z, 0.1))
            .to_vec();
        let knots = knots(&points, Form::BSpline, MOST_STEPS, 0);
        let expected = (points[0] + 4.0 * points[1] + points[2]).truncate() / 6.0;
        assert!(knots[0].center.distance(expected) < 1e-6);
        let expected = (points[2] + 4.0 * points[3] + points[4]).truncate() / 6.0;
        assert!(knots[knots.len() - 1].center.distance(expected) < 1e-6);
        assert!(knots.len() > 6);
        let piece = bezier(&[points[0], points[1], points[2], points[3]], Form::BSpline);
        for i in 0..100 {
            let (point, along) = on_bezier(&piece, i as f32 / 100.0);
            let far = on_bezier(&piece, (i as f32 + 0.01) / 100.0).0;
            assert!((far - point).truncate().distance(along.truncate() * 1e-4) < 2e-6);
            let near = knots.windows(2).map(|pair| {
                let chord = pair[1].center - pair[0].center;
                let t = ((point.truncate() - pair[0].center).dot(chord) / chord.length_squared()).clamp(0.0, 1.0);
                point.truncate().distance(pair[0].center + t * chord)
            });
            assert!(near.fold(f32::MAX, f32::min) < OFF * 0.1 + 1e-5, "{i}");
        }
    }

    /// Where many curves are, each has few sides; what is no curve is none.
    #[test]
    fn many_curves_are_plain() {
        let hair = |i: usize| (0..5).map(|j| Vec4::new(i as f32, j as f32, 0.0, 0.01)).collect::<Vec<_>>();
        let few = tubes(&(0..2).map(hair).collect::<Vec<_>>(), Form::Linear);
        assert_eq!(few.triangles.len(), 2 * (4 * 16 * 2 + 2 * 14));
        let [low, high] = [f32::min, f32::max].map(|extreme| few.uvs.iter().map(|uv| uv.y).reduce(extreme));
        assert_eq!((low, high), (Some(0.0), Some(1.0)));
        assert_eq!(few.uvs[few.uvs.len() / 2].y, 0.5, "the second curve");
        let many = tubes(&(0..100_000).map(hair).collect::<Vec<_>>(), Form::Linear);
        assert_eq!(many.triangles.len(), 100_000 * (4 * 4 * 2 + 2 * 2));
        let nothing = [vec![], vec![Vec4::ONE], vec![Vec4::ONE; 3]];
        assert!(tubes(&nothing, Form::Linear).triangles.is_empty());
        assert!(tubes(&nothing, Form::BSpline).triangles.is_empty());
    }

    #[test]
    fn files_hold_curves_line_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hair.txt");
        std::fs::write(&path, "0 0 0 .1\r\n1 0 0 0.2\n\n\n  5 5 5 1\n6 5 5 1e-3").unwrap();
        let curves = read(&path, 1.0).unwrap();
        assert_eq!(curves.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2]);
        assert_eq!(curves[1][1], Vec4::new(6.0, 5.0, 5.0, 1e-3));
        for (text, line) in [("0 0 0\n", 1), ("0 0 0 1\n0 0 0 -1", 2), ("0 0 0 1\n\n0 0 nan 1", 3), ("0 0 0 1 2", 1)] {
            std::fs::write(&path, text).unwrap();
            let message = read(&path, 1.0).unwrap_err().to_string();
            assert!(message.contains(&format!("hair.txt:{line}")), "{message}");
        }
    }
}
