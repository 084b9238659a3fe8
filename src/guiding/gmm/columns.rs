//! The Gaussians of a mixture in columns, and the part of each in a density. Formulas are written once and run in lanes, or one by one with the
//! same bits.

use super::MOST;
use super::gaussian::Gaussian;
use crate::math::lanes::functions::exp;
use crate::math::lanes::{self, Kernel, LANES, Real, Wide};

/// Residual deviation above which more than two images of a wrapped Gaussian are summed: below, a third one adds less than 1e-7.
const NARROW: f32 = 0.15;
/// Pairs of images that are summed for wider ones: what is left out is below 2e-8 of the density.
const PAIRS: usize = 3;

/// Up to eight Gaussians, two lanes each: one for the images of a place below it and one for those above. Lanes without one have no weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    mean: [[f32; LANES]; 2],
    slope: [f32; LANES],
    /// 1/2σ² and 1/2τ².
    sharpness: [[f32; LANES]; 2],
    /// Weighted density at the mean.
    peak: [f32; LANES],
    /// Pairs of images.
    pairs: usize,
}

/// First image of each lane, and the step from one to the next.
const IMAGES: [[f32; LANES]; 2] = {
    let mut images = [[0.0; LANES], [1.0; LANES]];
    let mut lane = MOST;
    while lane < LANES {
        (images[0][lane], images[1][lane]) = (-1.0, -1.0);
        lane += 1;
    }
    images
};

impl Columns {
    /// Up to [`MOST`] Gaussians.
    pub fn of(all: &[Gaussian]) -> Self {
        let mut columns = Self {
            mean: [[0.5; LANES]; 2],
            slope: [0.0; LANES],
            sharpness: [[1.0; LANES]; 2],
            peak: [0.0; LANES],
            pairs: if all.iter().any(|of| of.residual > NARROW) { PAIRS } else { 1 },
        };
        for (k, of) in all.iter().enumerate().take(MOST) {
            for lane in [k, k + MOST] {
                for axis in 0..2 {
                    columns.mean[axis][lane] = of.mean[axis];
                    columns.sharpness[axis][lane] = 0.5 / [of.deviation, of.residual][axis].powi(2);
                }
                columns.slope[lane] = of.slope;
                columns.peak[lane] = of.peak() as f32;
            }
        }
        columns
    }

    /// Weighted density of each Gaussian at a place, over the unit square, and that of all.
    pub fn parts(&self, place: [f64; 2]) -> ([f32; MOST], f32) {
        let place = place.map(|of| of as f32);
        let lanes = lanes::run(At { columns: self, place }).unwrap_or_else(At::one_by_one);
        let parts: [f32; MOST] = std::array::from_fn(|k| lanes[k] + lanes[k + MOST]);
        let four = |i: usize| parts[i] + parts[i + 4];
        (parts, (four(0) + four(2)) + (four(1) + four(3)))
    }
}

/// All Gaussians at a place.
struct At<'a> {
    columns: &'a Columns,
    place: [f32; 2],
}

/// Half of the images of a Gaussian in each lane.
struct Images<R> {
    mean: [R; 2],
    slope: R,
    sharpness: [R; 2],
    peak: R,
    images: [R; 2],
}

impl<R: Real> Images<R> {
    #[inline(always)]
    fn density(self, [x, y]: [R; 2], pairs: usize) -> R {
        let along = x - self.mean[0];
        let off = y - self.mean[1] - self.slope * along;
        let along = along * along * self.sharpness[0];
        let mut image = off - off.floor() + self.images[0];
        let mut sum = exp(-(along + image * image * self.sharpness[1]));
        for _ in 1..pairs {
            image = image + self.images[1];
            sum = sum + exp(-(along + image * image * self.sharpness[1]));
        }
        sum * self.peak
    }
}

impl At<'_> {
    fn one_by_one(self) -> [f32; LANES] {
        let Columns { mean, slope, sharpness, peak, pairs } = self.columns;
        std::array::from_fn(|lane| {
            let images = Images {
                mean: [mean[0][lane], mean[1][lane]],
                slope: slope[lane],
                sharpness: [sharpness[0][lane], sharpness[1][lane]],
                peak: peak[lane],
                images: [IMAGES[0][lane], IMAGES[1][lane]],
            };
            images.density(self.place, *pairs)
        })
    }
}

impl Kernel for At<'_> {
    type Output = [f32; LANES];

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> [f32; LANES] {
        let Columns { mean, slope, sharpness, peak, pairs } = self.columns;
        let images = Images {
            mean: [wide.load(&mean[0]), wide.load(&mean[1])],
            slope: wide.load(slope),
            sharpness: [wide.load(&sharpness[0]), wide.load(&sharpness[1])],
            peak: wide.load(peak),
            images: [wide.load(&IMAGES[0]), wide.load(&IMAGES[1])],
        };
        let place = [images.slope.all(self.place[0]), images.slope.all(self.place[1])];
        wide.store(images.density(place, *pairs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Lanes have the bits of Gaussians one by one.
    #[test]
    fn lanes_have_the_bits_of_single_gaussians() {
        let mut random = Random::new(5, 0, 0);
        for round in 0..200 {
            let count = 1 + round % MOST;
            let gaussian = |_| Gaussian {
                weight: 1.0 / count as f32,
                mean: random.next_2d(),
                deviation: 5e-4 * 1000f32.powf(random.next_f32()),
                slope: random.range(-50.0, 50.0),
                residual: 5e-4 * 1000f32.powf(random.next_f32()),
            };
            let columns = Columns::of(&(0..count).map(gaussian).collect::<Vec<_>>());
            for _ in 0..20 {
                let place = random.next_2d();
                let at = || At { columns: &columns, place };
                assert_eq!(lanes::run(at()).unwrap_or_else(At::one_by_one), at().one_by_one());
            }
        }
    }
}
