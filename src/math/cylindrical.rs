//! The area-preserving cylindrical map between directions and the unit square: (z, φ) ↔ (x, y) = ((z+1)/2, φ/2π).
//!
//! Cells are half-open, [k, k+1)/2ⁿ, so every direction lies in exactly one cell of every level. Coordinates are integers of 32 bits: a cell
//! at level 20 is 2⁻²⁰ wide, which single precision cannot subdivide.

use std::f32::consts::TAU;
use std::sync::LazyLock;

use glam::Vec3;

use super::lanes::functions::{sin_cos_turn, turn};
use super::lanes::{Bits, Real, V3};

/// Cells along one side at the deepest level, 2²⁰.
pub const CELLS: u32 = 1 << 20;

/// Steps of coordinates along one side.
const STEPS: f64 = 4_294_967_296.0;

/// Half of the steps.
const HALF: f32 = 2_147_483_648.0;

/// Maps unit vectors to points of the square, in steps of 2⁻³² along each side, as bits of unsigned numbers.
#[inline(always)]
pub fn to_place<R: Real>(direction: V3<R>) -> [R::Bits; 2] {
    // 1 would be a step too far.
    let z = direction.z.between(-1.0, 1.0 - f32::EPSILON / 2.0);
    let x = (z * z.all(HALF)).whole();
    [x ^ x.all(i32::MIN), turn(direction.y, direction.x)]
}

/// Maps points of the square to unit vectors. Inverse of [`to_place`] up to rounding: to 3e-8 of a side.
#[inline(always)]
pub fn to_directions<R: Real>([x, y]: [R::Bits; 2]) -> V3<R> {
    let around = x ^ x.all(i32::MIN);
    let z: R = around.real();
    // What is left to the nearer pole, exactly: the root of 1 − z² has no digits there.
    let inside: R = (x.all(i32::MAX) - (around ^ around.right::<31>())).real();
    let inside = inside * inside.all(1.0 / HALF);
    let r = (inside * (inside.all(2.0) - inside)).sqrt();
    let (sin, cos) = sin_cos_turn::<R>(y);
    V3::new(r * cos, r * sin, z * z.all(1.0 / HALF))
}

/// The point of the square [0, 1)² in steps of 2⁻³² along each side; the nearest one for others.
#[inline]
pub fn place_of(square: [f64; 2]) -> [i32; 2] {
    square.map(|c| ((c * STEPS) as u32).cast_signed())
}

/// Maps a unit vector to the square [0, 1)².
#[inline]
pub fn to_square(direction: Vec3) -> [f64; 2] {
    square_of(to_place::<f32>(direction.into()))
}

/// The point of the square [0, 1)² of coordinates in steps of 2⁻³².
#[inline]
pub fn square_of(place: [i32; 2]) -> [f64; 2] {
    place.map(|c| f64::from(c.cast_unsigned()) / STEPS)
}

/// Maps a point of the square to a unit vector. Inverse of [`to_square`] up to the rounding of the result. φ is the same a turn away.
#[inline]
pub fn to_direction([x, y]: [f64; 2]) -> Vec3 {
    to_directions::<f32>(place_of([x, y.rem_euclid(1.0)])).into()
}

/// The direction of the centre of a cell at `level`.
pub fn cell_centre(level: usize, cell: [u32; 2]) -> [f32; 3] {
    let along = |c: u32| if level <= TABLED { CENTRES[(1 << level) - 1 + c as usize] } else { centre(level, c) };
    let ([z, radius, ..], [.., sin, cos]) = (along(cell[0]), along(cell[1]));
    [radius * cos, radius * sin, z]
}

/// Levels whose centres are kept: nearly all cells that are asked for are of these.
const TABLED: usize = 9;

/// [`centre`] of all coordinates of the levels up to [`TABLED`], one level after another.
static CENTRES: LazyLock<Vec<[f32; 4]>> =
    LazyLock::new(|| (0..=TABLED).flat_map(|level| (0..1 << level).map(move |c| centre(level, c))).collect());

/// What the middle of the cells with this coordinate is: z and the radius there where it is the first coordinate, sine and cosine of φ
/// where it is the second.
fn centre(level: usize, c: u32) -> [f32; 4] {
    let at = (c as f32 + 0.5) * 0.5f32.powi(level as i32);
    let z = 2.0 * at - 1.0;
    let (sin, cos) = (TAU * at).sin_cos();
    [z, (1.0 - z * z).max(0.0).sqrt(), sin, cos]
}

/// Integer cell of a direction at level 20; shifting right by 20−n gives its cell at level n.
#[inline]
pub fn to_cell(direction: Vec3) -> [u32; 2] {
    to_place::<f32>(direction.into()).map(cell_at)
}

/// Integer cell at level 20 of a coordinate in steps of 2⁻³².
#[inline(always)]
pub fn cell_at(steps: i32) -> u32 {
    steps.cast_unsigned() >> 12
}

/// Integer cell at level 20 of a point of the square [0, 1)².
#[inline]
pub fn cell_of(square: [f64; 2]) -> [u32; 2] {
    // Multiplying by a power of two is exact, so no value below 1 reaches CELLS.
    square.map(|c| (c * f64::from(CELLS)) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    #[test]
    fn a01_inverse_within_rounding_and_half_open_at_the_poles() {
        let mut random = Random::new(3, 0, 0);
        for _ in 0..10_000 {
            let square = [random.next_f64(), random.next_f64()];
            let back = to_square(to_direction(square));
            assert!((back[0] - square[0]).abs() < 1e-7);
        }
        for pole in [Vec3::Z, Vec3::NEG_Z, Vec3::new(1e-20, -1e-20, 1.000_000_1)] {
            let [x, y] = to_cell(pole);
            assert!(x < CELLS && y < CELLS);
            assert!(to_direction(to_square(pole)).is_finite());
        }
        assert!(to_square(Vec3::new(1.0, -1e-30, 0.0))[1] < 1.0, "just below a full turn stays below 1");
    }
}
