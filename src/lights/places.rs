//! Which lights pay where: a light behind a wall is near, and yet it brings nothing. Space is divided into cells, and in each the turns near
//! the root of the [`LightTree`](super::tree) are taken by the odds that were [found](super::tried) to pay there.

use glam::Vec3;

/// Pairs of nodes whose odds are learned, from the root down; below, lights are so close to one another that they are seen alike.
pub const LEARNED: usize = 63;
/// Number of odds in a row: those of [`LEARNED`] pairs, and 1 for all others.
pub(super) const ROW: usize = LEARNED + 1;

/// How much more the first of two nodes is worth than its estimate says, relative to the second, for the pairs of a tree.
pub type Odds = [f32; ROW];

/// Odds that change nothing.
pub(super) const EVEN: Odds = [1.0; ROW];

/// The odds that pay, by place.
#[derive(Debug, Clone)]
pub struct LightPlaces {
    division: Division,
    /// By cell.
    odds: Vec<Odds>,
    gain: f64,
}

impl LightPlaces {
    /// The odds of each cell of a division, and what they gain.
    pub(super) fn new(division: Division, odds: Vec<Odds>, gain: f64) -> Self {
        Self { division, odds, gain }
    }

    /// Second moment of the light that samples of lights with a place bring, over that without what was learned, in (0, 1).
    pub fn gain(&self) -> f64 {
        self.gain
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.odds.len()
    }

    /// The odds at a point.
    #[inline(always)]
    pub(super) fn at(&self, point: Vec3) -> &Odds {
        &self.odds[self.division.cell(point) as usize]
    }
}

/// A division of space into cells by planes across the axes, each of which halves what is on one side of another.
#[derive(Debug, Clone, Default)]
pub(super) struct Division {
    planes: Vec<Plane>,
}

/// What is on one side of a plane: the index of another, or [`CELL`] and that of a cell.
type Beyond = u32;
/// The highest bit.
const CELL: Beyond = 1 << 31;

#[derive(Debug, Clone, Copy)]
struct Plane {
    axis: u32,
    at: f32,
    /// Below it, and at or above it.
    beyond: [Beyond; 2],
}

impl Division {
    /// The cell of a point; one that is not a number is in some cell.
    #[inline(always)]
    pub fn cell(&self, point: Vec3) -> u32 {
        if self.planes.is_empty() {
            return 0;
        }
        let (point, mut beyond) = (point.to_array(), 0);
        while beyond & CELL == 0 {
            let plane = &self.planes[beyond as usize];
            // No branch: which side it is cannot be foreseen.
            beyond = plane.beyond[usize::from(point[plane.axis as usize] >= plane.at)];
        }
        beyond ^ CELL
    }
}

/// A part of space while it is divided.
pub(super) enum Part {
    /// A cell with these odds.
    Cell(Box<Odds>),
    /// Two parts, below a place on an axis and from there on.
    Divided { axis: u32, at: f32, parts: Box<[Self; 2]> },
}

impl Division {
    /// The division that is made of a part, and the odds of its cells.
    pub fn new(part: &Part) -> (Self, Vec<Odds>) {
        let (mut division, mut odds) = (Self::default(), Vec::new());
        division.add(part, &mut odds);
        (division, odds)
    }

    fn add(&mut self, part: &Part, odds: &mut Vec<Odds>) -> Beyond {
        match part {
            Part::Cell(own) => {
                odds.push(**own);
                CELL | (odds.len() - 1) as u32
            }
            Part::Divided { axis, at, parts } => {
                let index = self.planes.len();
                self.planes.push(Plane { axis: *axis, at: *at, beyond: [0; 2] });
                let beyond = [self.add(&parts[0], odds), self.add(&parts[1], odds)];
                self.planes[index].beyond = beyond;
                index as u32
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Every point is in one cell, on the side of each plane that the part said.
    #[test]
    fn points_are_in_the_cells_of_their_parts() {
        let cell = |value: f32| Part::Cell(Box::new([value; ROW]));
        let right = Part::Divided { axis: 2, at: -1.0, parts: Box::new([cell(2.0), cell(3.0)]) };
        let whole = Part::Divided { axis: 0, at: 0.5, parts: Box::new([cell(1.0), right]) };
        let (division, odds) = Division::new(&whole);
        let places = LightPlaces::new(division, odds, 0.5);
        assert_eq!(places.cells(), 3);
        let mut random = Random::new(3, 0, 0);
        for _ in 0..1000 {
            let point = Vec3::from_array([(); 3].map(|()| random.range(-2.0, 2.0)));
            let expected = if point.x < 0.5 {
                1.0
            } else if point.z < -1.0 {
                2.0
            } else {
                3.0
            };
            assert_eq!(places.at(point)[0], expected, "{point}");
        }
        for odd in [Vec3::NAN, Vec3::INFINITY, Vec3::NEG_INFINITY] {
            assert!(places.at(odd)[0] > 0.0);
        }
        let (division, odds) = Division::new(&cell(7.0));
        assert_eq!(LightPlaces::new(division, odds, 0.5).at(Vec3::ONE)[0], 7.0);
    }
}
