//! The smoke of one of our scenes: values of a grid by a formula.

use glam::Vec3;

use crate::base::random::Random;
use crate::materials::grid::Values;
use crate::scene::readers::Vol;

/// Cells along x, y and z.
const SIZE: [u32; 3] = [40, 24, 36];
/// Octaves of noise, each of half the amplitude and twice the frequency of the one before.
const OCTAVES: u32 = 4;
/// Knots of the first octave along the longest axis.
const KNOTS: f32 = 3.0;
const SEED: u64 = 17;

/// Drifts of smoke, denser towards the floor, in the unit cube.
pub fn smoke() -> Vol {
    let longest = SIZE.iter().fold(0, |longest, side| longest.max(*side)) as f32;
    let value = |index: u32| {
        let cell = [index % SIZE[0], index / SIZE[0] % SIZE[1], index / SIZE[0] / SIZE[1]];
        let p = (Vec3::from_array(cell.map(|at| at as f32)) + 0.5) / longest;
        let height = (cell[1] as f32 + 0.5) / SIZE[1] as f32;
        let density = 3.0 * (noise(p * KNOTS) - 0.42) + 0.35 * (0.7 - height);
        (density.clamp(0.0, 1.0) * 255.0).round() as u8
    };
    let values = Values::Bytes((0..SIZE.iter().product()).map(value).collect());
    Vol { size: SIZE, channels: 1, corners: [[0.0; 3], [1.0; 3]], values }
}

/// Octaves of value noise, in [0, 1].
fn noise(p: Vec3) -> f32 {
    let octave = |octave: u32| {
        let (amplitude, frequency) = (0.5f32.powi(octave as i32), 2f32.powi(octave as i32));
        [amplitude * lattice(p * frequency, u64::from(octave)), amplitude]
    };
    let [sum, most] = (0..OCTAVES).map(octave).fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
    sum / most
}

/// Random values at whole coordinates, smooth between them.
fn lattice(p: Vec3, octave: u64) -> f32 {
    let (cell, f) = (p.floor(), p - p.floor());
    let f = f * f * (3.0 - 2.0 * f);
    let knot = |x: f32, y: f32, z: f32| {
        let [x, y, z] = (cell + Vec3::new(x, y, z)).to_array().map(|at| at as u64);
        Random::new(SEED, octave, x << 40 | y << 20 | z).next_f32()
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let along_x = |y: f32, z: f32| mix(knot(0.0, y, z), knot(1.0, y, z), f.x);
    let along_y = |z: f32| mix(along_x(0.0, z), along_x(1.0, z), f.y);
    mix(along_y(0.0), along_y(1.0), f.z)
}
