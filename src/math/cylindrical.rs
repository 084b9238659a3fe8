//! The area-preserving cylindrical map between directions and the unit square: (z, φ) ↔ (x, y) = ((z+1)/2, φ/2π).
//!
//! Cells are half-open, [k, k+1)/2ⁿ, so every direction lies in exactly one cell of every level. Coordinates are kept in
//! double precision: a cell at level 20 is 2⁻²⁰ wide, which single precision cannot subdivide.

use std::f64::consts::TAU;

use glam::Vec3;

/// Cells along one side at the deepest level, 2²⁰.
pub const CELLS: u32 = 1 << 20;

const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// Maps a unit vector to the square [0, 1)².
#[inline]
pub fn to_square(direction: Vec3) -> [f64; 2] {
    let x = (f64::from(direction.z) + 1.0) * 0.5;
    let turn = f64::from(direction.y).atan2(f64::from(direction.x)) / TAU;
    let y = if turn < 0.0 { turn + 1.0 } else { turn };
    [x.clamp(0.0, BELOW_ONE), y.clamp(0.0, BELOW_ONE)]
}

/// Maps a point of the square to a unit vector. Inverse of [`to_square`] up to the rounding of the result.
#[inline]
pub fn to_direction([x, y]: [f64; 2]) -> Vec3 {
    let z = 2.0 * x - 1.0;
    // At the poles rounding can push 1 - z² below zero.
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * y).sin_cos();
    Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32)
}

/// The direction of the centre of a cell at `level`.
pub fn cell_centre(level: usize, cell: [u32; 2]) -> [f32; 3] {
    let side = 0.5f32.powi(level as i32);
    let [x, y] = cell.map(|c| (c as f32 + 0.5) * side);
    let z = 2.0 * x - 1.0;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * y).sin_cos();
    [radius * cos, radius * sin, z]
}

/// Integer cell of a direction at level 20; shifting right by 20−n gives its cell at level n.
#[inline]
pub fn to_cell(direction: Vec3) -> [u32; 2] {
    cell_of(to_square(direction))
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
