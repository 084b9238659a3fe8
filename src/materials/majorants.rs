//! Bounds of a density in coarse cells, and the cells that a ray crosses.

use glam::{Affine3A, Vec3};

use super::grid::Grid;
use crate::geometry::Ray;
use crate::math::lanes::functions::ln;

/// Most coarse cells along an axis: more take longer to cross than tighter bounds save.
const MOST_CELLS: usize = 16;

/// Bounds of the extinction in a coarse cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Density that there is everywhere in the cell, in every channel.
    pub least: f32,
    /// No extinction in the cell is larger, in any channel.
    pub most: f32,
    /// Nor, without that of the density `least`.
    pub rest: f32,
}

/// Coarse cells over the unit cube.
#[derive(Debug, Clone, PartialEq)]
pub struct Majorants {
    cells: [usize; 3],
    bounds: Vec<Bound>,
}

impl Majorants {
    /// Bounds of `extinction` times what `grid` says.
    pub fn new(grid: &Grid, extinction: Vec3) -> Self {
        let cells = grid.size().map(|side| side.min(MOST_CELLS));
        let sides = Vec3::from_array(cells.map(|side| side as f32));
        let mut bounds = Vec::with_capacity(cells.iter().product());
        for z in 0..cells[2] {
            for y in 0..cells[1] {
                for x in 0..cells[0] {
                    let low = Vec3::new(x as f32, y as f32, z as f32);
                    let [least, most] = grid.range(low / sides, (low + 1.0) / sides);
                    let least = least.min_element();
                    let (most, rest) = (extinction * most, extinction * (most - least));
                    bounds.push(Bound { least, most: most.max_element(), rest: rest.max_element() });
                }
            }
        }
        Self { cells, bounds }
    }

    /// The cells that a ray crosses up to the distance `limit`, in their order; `to_grid` takes the world to the unit cube.
    pub fn along(&self, ray: &Ray, to_grid: &Affine3A, limit: f32) -> Walk<'_> {
        let sides = Vec3::from_array(self.cells.map(|side| side as f32));
        // In coarse cells. Distances along the ray stay those of the world.
        let origin = to_grid.transform_point3(ray.origin) * sides;
        let direction = to_grid.transform_vector3(ray.direction) * sides;
        let (mut from, mut to) = (0f32, limit);
        for ((o, d), side) in origin.to_array().into_iter().zip(direction.to_array()).zip(sides.to_array()) {
            if d == 0.0 {
                // Along the sides: within them, or nowhere.
                to = if (0.0..=side).contains(&o) { to } else { f32::NEG_INFINITY };
                continue;
            }
            let (a, b) = (-o / d, (side - o) / d);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
        if !(from < to && to.is_finite()) {
            (from, to) = (0.0, 0.0);
        }
        Walk::new(self, origin, direction, [from, to])
    }
}

/// A part of a ray within a coarse cell.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// Where it begins and ends, as distances on the ray.
    pub from: f32,
    pub to: f32,
    /// What holds in the cell.
    pub bound: Bound,
}

/// Goes from cell to cell along a ray (Amanatides and Woo 1987).
#[derive(Debug, Clone)]
pub struct Walk<'a> {
    of: &'a Majorants,
    origin: Vec3,
    /// Of the direction.
    inverse: Vec3,
    cell: [i32; 3],
    /// 1 or −1 along each axis.
    step: [i32; 3],
    /// Distances at which the ray leaves the cell across the sides of each axis.
    leaves: [f32; 3],
    at: f32,
    to: f32,
}

impl<'a> Walk<'a> {
    /// The cells between two distances on a ray, in units of cells; none where the second is not larger.
    fn new(of: &'a Majorants, origin: Vec3, direction: Vec3, [from, to]: [f32; 2]) -> Self {
        let place = (origin + direction * from).floor().to_array();
        let mut walk = Self {
            of,
            origin,
            inverse: direction.recip(),
            cell: [0, 1, 2].map(|axis| (place[axis] as i32).clamp(0, of.cells[axis] as i32 - 1)),
            step: direction.to_array().map(|d| if d > 0.0 { 1 } else { -1 }),
            leaves: [f32::INFINITY; 3],
            at: from,
            to,
        };
        for axis in (0..3).filter(|&axis| direction[axis] != 0.0) {
            walk.leaves[axis] = walk.leaves(axis);
        }
        walk
    }

    /// The distance at which the ray leaves its cell across the sides of an axis.
    fn leaves(&self, axis: usize) -> f32 {
        let side = self.cell[axis] + self.step[axis].max(0);
        (side as f32 - self.origin[axis]) * self.inverse[axis]
    }
}

impl Iterator for Walk<'_> {
    type Item = Span;

    #[inline]
    fn next(&mut self) -> Option<Span> {
        if self.at >= self.to {
            return None;
        }
        let [x, y, z] = self.cell.map(|cell| cell as usize);
        let [columns, rows, _] = self.of.cells;
        let bound = self.of.bounds[(z * rows + y) * columns + x];
        let [a, b, c] = self.leaves;
        let axis = if a <= b && a <= c { 0 } else { 1 + usize::from(c < b) };
        // By rounding a cell may seem to end before it began.
        let (from, end) = (self.at, self.leaves[axis].max(self.at).min(self.to));
        self.at = end;
        self.cell[axis] += self.step[axis];
        if (0..self.of.cells[axis] as i32).contains(&self.cell[axis]) {
            self.leaves[axis] = self.leaves(axis);
        } else {
            self.to = end;
        }
        Some(Span { from, to: end, bound })
    }
}

/// Tentative collisions of a ray with an extinction that is known cell by cell (Woodcock 1965).
#[derive(Debug, Clone, Copy)]
pub struct Tentative {
    /// Optical depth that is left to the next.
    depth: f32,
}

impl Tentative {
    /// With the first uniform number in [0, 1).
    pub fn new(u: f32) -> Self {
        Self { depth: -ln(1.0 - u) }
    }

    /// The distance of the next collision behind the distance `at` with the extinction `most` up to the end of a cell; none where the
    /// cell ends before.
    pub fn next(&mut self, at: f32, to: f32, most: f32) -> Option<f32> {
        let collision = at + self.depth / most;
        if collision < to {
            return Some(collision);
        }
        self.depth = (self.depth - most * (to - at)).max(0.0);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::{Edge, Values};
    use super::*;
    use crate::base::random::Random;

    /// The spans of any ray are those of the cells that it crosses, without gap, and bounds hold what is there.
    #[test]
    fn walks_cross_the_cube() {
        let mut random = Random::new(9, 0, 0);
        let values = Values::Floats((0..20 * 3 * 7).map(|_| random.next_f32()).collect());
        let grid = Grid::new([20, 3, 7], 1, &values, Edge::Continues).unwrap();
        let majorants = Majorants::new(&grid, Vec3::new(1.0, 2.0, 0.5));
        assert_eq!(majorants.cells, [16, 3, 7]);
        let to_grid = Affine3A::from_scale(Vec3::new(0.5, 0.25, 1.0));
        let mut met = 0;
        for number in 0..3000 {
            let mut point = || Vec3::new(random.range(-1.0, 3.0), random.range(-2.0, 6.0), random.range(-1.0, 2.0));
            let (origin, towards) = (point(), point());
            let direction = match number % 10 {
                0 => Vec3::AXES[number / 10 % 3],
                _ => (towards - origin).normalize(),
            };
            let (ray, limit) = (Ray { origin, direction }, if number % 3 == 0 { f32::INFINITY } else { 2.0 });
            let spans: Vec<Span> = majorants.along(&ray, &to_grid, limit).collect();
            assert!(spans.len() <= 16 + 3 + 7, "{}", spans.len());
            // The part in the cube by halving: points of the ray that are inside.
            let inside = |t: f32| {
                let p = to_grid.transform_point3(ray.at(t));
                p.cmpge(Vec3::splat(1e-5)).all() && p.cmple(Vec3::splat(1.0 - 1e-5)).all()
            };
            let within =
                (0..2000).filter(|i| inside(*i as f32 * 0.01 + 0.005) && *i as f32 * 0.01 + 0.005 < limit).count();
            let length: f32 = spans.iter().map(|span| span.to - span.from).sum();
            assert!((length - 0.01 * within as f32).abs() < 0.03, "{length} {within}");
            assert!(spans.windows(2).all(|pair| pair[0].to == pair[1].from));
            for span in &spans {
                let at = span.from + (span.to - span.from) * random.next_f32();
                let density = grid.at(to_grid.transform_point3(ray.at(at))).x;
                let Bound { least, most, rest } = span.bound;
                assert!(
                    density >= least - 1e-4 && 2.0 * density <= most + 1e-3 && 2.0 * (density - least) <= rest + 1e-3
                );
            }
            met += usize::from(!spans.is_empty());
        }
        assert!(met > 1000, "{met}");
    }
}
