//! Bounds of a density in coarse cells.

use glam::{Affine3A, Vec3};

use super::grid::Grid;
use super::walk::{Crossed, Walk};
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
    pub fn along(&self, ray: &Ray, to_grid: &Affine3A, limit: f32) -> impl Iterator<Item = Span> {
        // In coarse cells. Distances along the ray stay those of the world.
        let sides = Vec3::from_array(self.cells.map(|side| side as f32));
        let origin = to_grid.transform_point3(ray.origin) * sides;
        let direction = to_grid.transform_vector3(ray.direction) * sides;
        Walk::new(self.cells, origin, direction, [Vec3::ZERO, sides], limit).map(
            |Crossed { from, to, cell: [x, y, z] }| {
                let [columns, rows, _] = self.cells;
                Span { from, to, bound: self.bounds[(z * rows + y) * columns + x] }
            },
        )
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
