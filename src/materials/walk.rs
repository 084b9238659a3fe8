//! The cells of a grid that a ray crosses.

use glam::Vec3;

/// A part of a ray within a cell.
#[derive(Debug, Clone, Copy)]
pub struct Crossed {
    /// Where it begins and ends, as distances on the ray.
    pub from: f32,
    pub to: f32,
    /// The cell's place along each axis.
    pub cell: [usize; 3],
}

/// Goes from cell to cell along a ray (Amanatides and Woo 1987).
#[derive(Debug, Clone)]
pub struct Walk {
    /// Cells along each axis.
    cells: [i32; 3],
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

impl Walk {
    /// The cells of a grid that the part of a ray crosses, in their order, which lies in the box between two corners and up to the distance
    /// `limit`; `origin`, `direction` and the corners are in cells.
    pub fn new(cells: [usize; 3], origin: Vec3, direction: Vec3, [low, high]: [Vec3; 2], limit: f32) -> Self {
        let (mut from, mut to) = (0f32, limit);
        for axis in 0..3 {
            let [o, d, low, high] = [origin, direction, low, high].map(|vector| vector[axis]);
            if d == 0.0 {
                // Along the sides: within them, or nowhere.
                to = if (low..=high).contains(&o) { to } else { f32::NEG_INFINITY };
                continue;
            }
            let (a, b) = ((low - o) / d, (high - o) / d);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
        if !(from < to && to.is_finite()) {
            (from, to) = (0.0, 0.0);
        }
        let (cells, place) = (cells.map(|side| side as i32), (origin + direction * from).floor().to_array());
        let mut walk = Self {
            cells,
            origin,
            inverse: direction.recip(),
            cell: [0, 1, 2].map(|axis| (place[axis] as i32).clamp(0, cells[axis] - 1)),
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

    /// Where the next cell begins, and where the last ends.
    pub fn rest(&self) -> [f32; 2] {
        [self.at, self.to]
    }

    /// The distance at which the ray leaves its cell across the sides of an axis.
    fn leaves(&self, axis: usize) -> f32 {
        let side = self.cell[axis] + self.step[axis].max(0);
        (side as f32 - self.origin[axis]) * self.inverse[axis]
    }
}

impl Iterator for Walk {
    type Item = Crossed;

    #[inline]
    fn next(&mut self) -> Option<Crossed> {
        if self.at >= self.to {
            return None;
        }
        let cell = self.cell.map(|cell| cell as usize);
        let [a, b, c] = self.leaves;
        let axis = if a <= b && a <= c { 0 } else { 1 + usize::from(c < b) };
        // By rounding a cell may seem to end before it began.
        let (from, end) = (self.at, self.leaves[axis].max(self.at).min(self.to));
        self.at = end;
        self.cell[axis] += self.step[axis];
        if (0..self.cells[axis]).contains(&self.cell[axis]) {
            self.leaves[axis] = self.leaves(axis);
        } else {
            self.to = end;
        }
        Some(Crossed { from, to: end, cell })
    }
}
