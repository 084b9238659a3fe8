//! Samples of pixels by how bright they are: what tells a lone bright sample from a light that many samples have seen.
//!
//! Levels of brightness lie a factor of 8 apart. A sample between two of them is divided between both, so that the number of samples of a level
//! is the brightness of what it holds over its own (Zirr, Hanika and Dachsbacher 2018, §4): a level needs no counter. Brightness is the mean of
//! the channels, and levels are powers of 8, whatever a picture's unit is, so that parts of a picture have the same.
//!
//! Sums are whole multiples of a quantum, 2⁻¹⁸ of their level's brightness: 2e-6 to 1.5e-5 of a sample. Whole numbers have the same sum in any
//! order, so that blocks, threads and parts of a picture can be added up as they come. A sum that is too large for 32 bits stays at the largest:
//! it is of thousands of samples, of which it matters that they are many; how much light they have is known by what the others leave of the whole.
//!
//! Memory is taken for 64 pixels and a level where one of them has a sample of that level: 12 bytes for each pixel and level.

mod stored;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Brightness of a level over that of the one below.
pub const BASE: f64 = 8.0;
/// log₂ of [`BASE`].
const STEP: i32 = 3;
/// log₂ of the brightness of level 0, negated: below all singles that are normal.
const LOWEST: i32 = 129;
/// Number of levels: the largest single lies below the last.
const LEVELS: u8 = 87;
/// log₂ of a level's brightness over the quantum of its sums.
const PRECISION: i32 = 18;
/// Pixels that have memory together.
const RUN: usize = 64;

/// Quanta of the three channels.
type Quanta = [u32; 3];

/// The samples of one level in a run of pixels.
#[derive(Debug, Clone, PartialEq)]
struct Plane {
    level: u8,
    sums: Box<[Quanta; RUN]>,
}

/// Sums of the samples of each pixel and level of brightness.
#[derive(Debug, Clone, PartialEq)]
pub struct Cascade {
    pixels: usize,
    /// The levels of each run of pixels, in ascending order.
    runs: Vec<Vec<Plane>>,
}

/// What a pixel has of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Number of the level.
    pub level: u8,
    /// Sum of its samples, or parts of samples.
    pub sum: DVec3,
    /// Whether the sum has reached the largest that there is.
    pub is_full: bool,
}

/// 2 to the power of `exponent`, which is that of a normal double.
fn power(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// Brightness of a level.
pub fn brightness_of(level: u8) -> f64 {
    power(STEP * i32::from(level) - LOWEST)
}

/// Brightness of light: the mean of its channels.
pub fn brightness(light: DVec3) -> f64 {
    light.element_sum() / 3.0
}

/// The level of a sample of this brightness, and the part of it that belongs there and not to the level above: so much that the brightnesses
/// of both parts, each over that of its level, add up to 1. None for darkness.
fn divided(brightness: f64) -> Option<(u8, f64)> {
    if !(brightness >= f64::from(f32::MIN_POSITIVE) && brightness.is_finite()) {
        return None;
    }
    let exponent = (brightness.to_bits() >> 52) as i32 - 1023;
    let level = ((exponent + LOWEST) / STEP).clamp(0, i32::from(LEVELS) - 2) as u8;
    let part = (BASE * brightness_of(level) / brightness - 1.0) / (BASE - 1.0);
    Some((level, part.clamp(0.0, 1.0)))
}

/// Adds to a level of a place in a run, which has these `planes`.
fn put(planes: &mut Vec<Plane>, place: usize, level: u8, quanta: Quanta) {
    if quanta == [0; 3] {
        return;
    }
    let at = planes.partition_point(|plane| plane.level < level);
    if planes.get(at).is_none_or(|plane| plane.level != level) {
        planes.insert(at, Plane { level, sums: Box::new([[0; 3]; RUN]) });
    }
    let sums = &mut planes[at].sums[place];
    sums.iter_mut().zip(quanta).for_each(|(sum, more)| *sum = sum.saturating_add(more));
}

impl Cascade {
    /// No samples yet of so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { pixels, runs: vec![Vec::new(); pixels.div_ceil(RUN)] }
    }

    /// Takes all samples out again.
    pub fn clear(&mut self) {
        self.runs.iter_mut().for_each(Vec::clear);
    }

    /// Adds a sample of a pixel; what is not above 0 is left out.
    pub fn add(&mut self, pixel: usize, value: Vec3) {
        let value = value.as_dvec3();
        let Some((level, lower)) = divided(brightness(value)) else { return };
        for (level, part) in [(level, lower), (level + 1, 1.0 - lower)] {
            let scale = part * power(PRECISION + LOWEST - STEP * i32::from(level));
            // Conversion saturates.
            self.put(pixel, level, (value * scale).to_array().map(|quanta| (quanta + 0.5) as u32));
        }
    }

    fn put(&mut self, pixel: usize, level: u8, quanta: Quanta) {
        put(&mut self.runs[pixel / RUN], pixel % RUN, level, quanta);
    }

    /// Adds the samples of the same pixels, in whatever order.
    pub fn absorb(&mut self, other: &Self) {
        self.runs.par_iter_mut().zip(&other.runs).for_each(|(planes, others)| {
            for plane in others {
                let sums = plane.sums.iter().enumerate();
                sums.for_each(|(place, quanta)| put(planes, place, plane.level, *quanta));
            }
        });
    }

    /// Adds the samples of other pixels to the places that `place` names by their numbers.
    pub fn place(&mut self, other: &Self, mut place: impl FnMut(usize) -> usize) {
        for (run, plane) in other.runs.iter().enumerate().flat_map(|(run, planes)| planes.iter().map(move |p| (run, p)))
        {
            let pixels = (run * RUN..other.pixels).zip(plane.sums.iter());
            pixels.filter(|(_, quanta)| **quanta != [0; 3]).for_each(|(i, quanta)| {
                self.put(place(i), plane.level, *quanta);
            });
        }
    }

    /// What a pixel has of each level, in ascending order; levels of which it has nothing are left out.
    pub fn layers(&self, pixel: usize) -> impl Iterator<Item = Layer> + '_ {
        let layer = move |plane: &Plane| {
            let quanta = plane.sums[pixel % RUN];
            let quantum = power(STEP * i32::from(plane.level) - LOWEST - PRECISION);
            (quanta != [0; 3]).then(|| Layer {
                level: plane.level,
                sum: DVec3::from_array(quanta.map(f64::from)) * quantum,
                is_full: quanta.contains(&u32::MAX),
            })
        };
        self.runs.get(pixel / RUN).into_iter().flatten().filter_map(layer)
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        let planes: usize = self.runs.iter().map(Vec::len).sum();
        planes * (size_of::<Plane>() + size_of::<[Quanta; RUN]>()) + self.runs.len() * size_of::<Vec<Plane>>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Whatever the brightness, a sample counts once, and both its parts together are the sample.
    #[test]
    fn a_sample_counts_once() {
        let mut random = Random::new(11, 0, 0);
        for _ in 0..10_000 {
            let scale = (240.0 * random.next_f32() - 118.0).exp2();
            let value = Vec3::new(random.next_f32(), random.next_f32(), 0.1 + random.next_f32()) * scale;
            let mut cascade = Cascade::new(70);
            cascade.add(66, value);
            let layers: Vec<Layer> = cascade.layers(66).collect();
            let count: f64 = layers.iter().map(|l| brightness(l.sum) / brightness_of(l.level)).sum();
            assert!((count - 1.0).abs() < 1e-4, "{value}: {count}");
            let sum: DVec3 = layers.iter().map(|l| l.sum).sum();
            assert!(
                (sum - value.as_dvec3()).abs().max_element() < 3e-5 * brightness(value.as_dvec3()),
                "{value}: {sum}"
            );
            assert!(layers.len() <= 2 && cascade.layers(65).count() == 0);
        }
    }

    #[test]
    fn darkness_is_no_sample() {
        let mut cascade = Cascade::new(1);
        for value in [Vec3::ZERO, -Vec3::ONE, Vec3::splat(1e-42)] {
            cascade.add(0, value);
        }
        assert_eq!(cascade, Cascade::new(1));
        // A channel that some rounding made negative takes nothing away.
        cascade.add(0, Vec3::new(1.0, -1e-3, 1.0));
        assert!(cascade.layers(0).all(|layer| layer.sum.y == 0.0 && layer.sum.x > 0.0));
    }

    fn values(seed: u64) -> Vec<(usize, Vec3)> {
        let mut random = Random::new(seed, 0, 0);
        let mut value = || (40.0 * random.next_f32() - 20.0).exp2() * Vec3::new(1.0, 0.3, 0.7);
        (0..5000).map(|i| (i * 37 % 150, value())).collect()
    }

    fn made<'a>(values: impl IntoIterator<Item = &'a (usize, Vec3)>) -> Cascade {
        let mut cascade = Cascade::new(150);
        values.into_iter().for_each(|&(pixel, value)| cascade.add(pixel, value));
        cascade
    }

    #[test]
    fn any_order_has_the_same_bits() {
        let all = values(3);
        let whole = made(&all);
        assert_eq!(made(all.iter().rev()), whole);
        let (first, second) = all.split_at(1234);
        let mut sum = made(second);
        sum.absorb(&made(first));
        assert_eq!(sum, whole);
        let mut placed = made(first);
        placed.place(&made(second), |i| i);
        assert_eq!(placed, whole);
        let mut moved = Cascade::new(300);
        moved.place(&whole, |i| 299 - i);
        assert!((0..150).all(|i| moved.layers(299 - i).eq(whole.layers(i))));
        placed.clear();
        assert_eq!(placed, Cascade::new(150));
        // Twenty levels and a half at most, of 64 pixels each.
        assert!(whole.bytes() < 3 * 22 * 800, "{}", whole.bytes());
    }

    #[test]
    fn sums_end_at_the_largest() {
        let mut cascade = Cascade::new(1);
        (0..20_000).for_each(|_| cascade.add(0, Vec3::ONE));
        assert!(cascade.layers(0).all(|layer| layer.is_full));
        let twice = cascade.clone();
        cascade.absorb(&twice);
        assert_eq!(cascade, twice);
    }
}
