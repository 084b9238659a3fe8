//! Quantities that vary in space: values at the centres of the cells of a unit cube, trilinear between them.

use std::ops::{Add, Mul, Sub};

use glam::Vec3;

/// Values of the cells of a grid in x, y, z order, x fastest, the channels of a cell together.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Of which 255 stands for 1.
    Bytes(Vec<u8>),
    /// As they are.
    Floats(Vec<f32>),
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Bytes(values) => values.len(),
            Self::Floats(values) => values.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The value at `index`.
    pub fn at(&self, index: usize) -> f32 {
        match self {
            Self::Bytes(values) => f32::from(values[index]) * OF_BYTE,
            Self::Floats(values) => values[index],
        }
    }

    /// What is in memory.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Bytes(values) => values,
            Self::Floats(values) => bytemuck::cast_slice(values),
        }
    }
}

/// What a byte's unit stands for.
const OF_BYTE: f32 = 1.0 / 255.0;

/// What lies beyond the outermost centres of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The value at the edge goes on (Mitsuba).
    Continues,
    /// Cells of value 0, to which values fall within half a cell of the edge (pbrt).
    Fades,
}

/// A grid of one or three channels over the unit cube. A shell of cells is kept around it, so that no look-up asks where the edge is.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    size: [usize; 3],
    channels: usize,
    /// With the shell: two more cells along each axis.
    values: Values,
}

impl Grid {
    /// Most values with the shell.
    pub const MOST_VALUES: u64 = 1 << 29;

    /// Values with the shell of a grid of `size` cells; none beyond 64 bits.
    pub fn with_shell(size: [u32; 3], channels: u32) -> Option<u64> {
        size.iter().try_fold(u64::from(channels), |product, &side| product.checked_mul(u64::from(side) + 2))
    }

    /// A grid of `size` cells along x, y, z; none unless there is a cell, one or three channels, as many values as these have and no
    /// more than [`Grid::MOST_VALUES`].
    pub fn new(size: [u32; 3], channels: u32, values: &Values, edge: Edge) -> Option<Self> {
        let all = Self::with_shell(size, channels)?;
        let cells = size.iter().map(|&side| u64::from(side)).product::<u64>();
        let right = cells > 0 && matches!(channels, 1 | 3) && cells * u64::from(channels) == values.len() as u64;
        if !right || all > Self::MOST_VALUES {
            return None;
        }
        let (size, channels) = (size.map(|side| side as usize), channels as usize);
        let values = match values {
            Values::Bytes(values) => Values::Bytes(shelled(size, channels, values, edge)),
            Values::Floats(values) => Values::Floats(shelled(size, channels, values, edge)),
        };
        Some(Self { size, channels, values })
    }

    /// Cells along each axis.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// What is in memory.
    pub fn bytes(&self) -> &[u8] {
        self.values.bytes()
    }

    /// The value at `p`, which counts as the nearest point of the unit cube; a single channel is the same in all three.
    #[inline]
    pub fn at(&self, p: Vec3) -> Vec3 {
        let sides = Vec3::from_array(self.size.map(|side| side as f32));
        // In cells, the shell's included, from the centre of the first: 1/2 at the cube's side.
        let q = p.clamp(Vec3::ZERO, Vec3::ONE) * sides + 0.5;
        let cell = q.floor().min(sides);
        let [x, y, z] = cell.to_array().map(|cell| cell as usize);
        let steps = self.steps();
        let (first, f) = (x * steps[0] + y * steps[1] + z * steps[2], q - cell);
        match &self.values {
            Values::Bytes(values) => self.between(values, first, f) * OF_BYTE,
            Values::Floats(values) => self.between(values, first, f),
        }
    }

    /// Places from a cell to the next along each axis.
    fn steps(&self) -> [usize; 3] {
        let row = self.channels * (self.size[0] + 2);
        [self.channels, row, row * (self.size[1] + 2)]
    }

    #[inline(always)]
    fn between<T: Copy + Into<f32>>(&self, values: &[T], first: usize, f: Vec3) -> Vec3 {
        let steps = self.steps();
        if self.channels == 1 {
            Vec3::splat(blend(f, first, steps, |at| values[at].into()))
        } else {
            blend(f, first, steps, |at| Vec3::new(values[at].into(), values[at + 1].into(), values[at + 2].into()))
        }
    }

    /// Least and largest value of each channel within the box from `low` to `high`, corners in the unit cube.
    pub fn range(&self, low: Vec3, high: Vec3) -> [Vec3; 2] {
        let sides = Vec3::from_array(self.size.map(|side| side as f32));
        // All cells whose centres the interpolation can ask for, and one that rounding might.
        let from = (low * sides + 0.5 - 1e-3).floor().max(Vec3::ZERO).to_array().map(|cell| cell as usize);
        let to = ((high * sides + 0.5 + 1e-3).floor() + 1.0).min(sides + 1.0).to_array().map(|cell| cell as usize);
        let (steps, mut range) = (self.steps(), [Vec3::INFINITY, Vec3::NEG_INFINITY]);
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    let at = x * steps[0] + y * steps[1] + z * steps[2];
                    let value = Vec3::from_array([0, 1, 2].map(|c| self.values.at(at + c.min(self.channels - 1))));
                    range = [range[0].min(value), range[1].max(value)];
                }
            }
        }
        range
    }
}

/// Values with a cell more at each end of each axis.
fn shelled<T: Copy + Default>(size: [usize; 3], channels: usize, values: &[T], edge: Edge) -> Vec<T> {
    let mut all = Vec::with_capacity(channels * size.iter().map(|side| side + 2).product::<usize>());
    let [within_x, within_y, within_z] = size.map(|side| move |at: usize| (1..=side).contains(&at));
    let nearest = |at: usize, side: usize| at.clamp(1, side) - 1;
    for z in 0..size[2] + 2 {
        for y in 0..size[1] + 2 {
            for x in 0..size[0] + 2 {
                if edge == Edge::Fades && !(within_x(x) && within_y(y) && within_z(z)) {
                    all.extend(std::iter::repeat_n(T::default(), channels));
                } else {
                    let cell = (nearest(z, size[2]) * size[1] + nearest(y, size[1])) * size[0] + nearest(x, size[0]);
                    all.extend_from_slice(&values[cell * channels..(cell + 1) * channels]);
                }
            }
        }
    }
    all
}

/// Trilinear between the eight cells from the one at place `first` on, at the fractions `f` of the ways to the next.
#[inline(always)]
fn blend<V>(f: Vec3, first: usize, [x, y, z]: [usize; 3], value: impl Fn(usize) -> V) -> V
where
    V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f32, Output = V>,
{
    let mix = |a: V, b: V, t: f32| a + (b - a) * t;
    let along_x = |at: usize| mix(value(at), value(at + x), f.x);
    let along_y = |at: usize| mix(along_x(at), along_x(at + y), f.y);
    mix(along_y(first), along_y(first + z), f.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(size: [u32; 3], edge: Edge) -> Grid {
        let value = |i: u32| {
            let (x, y, z) = (i % size[0], i / size[0] % size[1], i / size[0] / size[1]);
            x as f32 + 10.0 * y as f32 + 100.0 * z as f32
        };
        Grid::new(size, 1, &Values::Floats((0..size.iter().product()).map(value).collect()), edge).unwrap()
    }

    /// A linear field is itself between centres, and goes on or fades within half a cell of the edge.
    #[test]
    fn look_ups_are_trilinear_between_centres() {
        let grid = linear([4, 3, 2], Edge::Continues);
        for p in [Vec3::new(0.125, 0.5, 0.25), Vec3::new(0.3, 0.4, 0.6), Vec3::new(0.875, 1.0 / 6.0, 0.75)] {
            let expected = (4.0 * p.x - 0.5) + 10.0 * (3.0 * p.y - 0.5) + 100.0 * (2.0 * p.z - 0.5);
            assert!((grid.at(p) - expected).abs().max_element() < 1e-4, "{p}: {} {expected}", grid.at(p));
        }
        assert_eq!(grid.at(Vec3::ZERO), Vec3::ZERO);
        assert!((grid.at(Vec3::ONE) - 123.0).abs().max_element() < 1e-4);
        assert_eq!(grid.at(Vec3::splat(7.0)), grid.at(Vec3::ONE));
        let fading = linear([4, 3, 2], Edge::Fades);
        assert_eq!(fading.at(Vec3::new(0.875, 5.0 / 6.0, 0.75)), Vec3::splat(123.0));
        // Half of it is left at a side, a quarter at an edge, an eighth at a corner.
        assert!((fading.at(Vec3::ONE) - 123.0 / 8.0).abs().max_element() < 1e-4);
    }

    #[test]
    fn channels_bytes_and_one_cell() {
        let colours = Values::Bytes(vec![0, 51, 255, 255, 102, 0]);
        let grid = Grid::new([2, 1, 1], 3, &colours, Edge::Continues).unwrap();
        assert!((grid.at(Vec3::splat(0.5)) - Vec3::new(0.5, 0.3, 0.5)).abs().max_element() < 1e-6);
        let one = Grid::new([1; 3], 1, &Values::Floats(vec![3.0]), Edge::Continues).unwrap();
        assert_eq!([Vec3::ZERO, Vec3::splat(0.3), Vec3::ONE].map(|p| one.at(p)), [Vec3::splat(3.0); 3]);
        for (size, channels) in [([2, 1, 1], 2), ([1, 1, 1], 1), ([0, 1, 1], 1), ([u32::MAX; 3], 3)] {
            assert!(Grid::new(size, channels, &colours, Edge::Continues).is_none(), "{size:?} {channels}");
        }
    }

    /// No look-up within a box leaves its range.
    #[test]
    fn ranges_hold_what_is_looked_up() {
        use crate::base::random::Random;
        let mut random = Random::new(4, 0, 0);
        let values = Values::Floats((0..5 * 7 * 3).map(|_| random.next_f32()).collect());
        for edge in [Edge::Continues, Edge::Fades] {
            let grid = Grid::new([5, 7, 3], 1, &values, edge).unwrap();
            for _ in 0..300 {
                let mut corner = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
                let (a, b) = (corner(), corner());
                let (low, high) = (a.min(b), a.max(b));
                let [least, most] = grid.range(low, high);
                for _ in 0..30 {
                    let value = grid
                        .at(low + (high - low) * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()));
                    assert!(
                        value.cmpge(least - 1e-6).all() && value.cmple(most + 1e-6).all(),
                        "{value} {least} {most}"
                    );
                }
            }
        }
    }
}
