//! A Gaussian on the unit square of directions, x = (z + 1)/2 and y = φ/2π: N(x; μ_x, σ²) cut to [0, 1] times, given x, N(y; μ_y + s·(x − μ_x), τ²)
//! wrapped around [0, 1). So every covariance is had by σ, the slope s and the residual deviation τ: σ_xx = σ², σ_xy = s·σ², σ_yy = τ² + s²·σ².

use std::f64::consts::{PI, SQRT_2};

use crate::math::special::{erf, erf_inv};

/// Least standard deviation: as an angle about 0.06° along z at the equator, a fifth of the sun.
pub const LEAST_DEVIATION: f64 = 5e-4;
/// Largest standard deviation; wrapped, this is even to 1.5 %.
pub const MOST_DEVIATION: f64 = 0.5;
/// Largest slope, so that rounding of x moves no Gaussian.
pub const MOST_SLOPE: f64 = 50.0;

/// Largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// A weighted Gaussian on the square of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Weight in the mixture, in [0, 1].
    pub weight: f32,
    /// Mean, in [0, 1]².
    pub mean: [f32; 2],
    /// Standard deviation σ of x before it is cut, in [[`LEAST_DEVIATION`], [`MOST_DEVIATION`]].
    pub deviation: f32,
    /// Slope of the mean of y over x, in ±[`MOST_SLOPE`].
    pub slope: f32,
    /// Standard deviation τ of y given x before it is wrapped, in the range of σ.
    pub residual: f32,
}

impl Gaussian {
    /// The Gaussian of this mean and covariance (xx, xy, yy) with deviations and slope brought into range.
    pub fn new(weight: f64, mean: [f64; 2], [xx, xy, yy]: [f64; 3]) -> Self {
        let range = |variance: f64| variance.max(0.0).sqrt().clamp(LEAST_DEVIATION, MOST_DEVIATION);
        let deviation = range(xx);
        let slope = (xy / deviation.powi(2)).clamp(-MOST_SLOPE, MOST_SLOPE);
        let residual = range(yy - 2.0 * slope * xy + slope * slope * xx);
        Self {
            weight: weight as f32,
            mean: [mean[0].clamp(0.0, 1.0) as f32, mean[1].rem_euclid(1.0) as f32],
            deviation: deviation as f32,
            slope: slope as f32,
            residual: residual as f32,
        }
    }

    /// Whether it has a density.
    pub fn is_sound(&self) -> bool {
        let deviation =
            |of: f32| (0.999..=1.001 * MOST_DEVIATION / LEAST_DEVIATION).contains(&(f64::from(of) / LEAST_DEVIATION));
        (0.0..=1.001).contains(&self.weight)
            && self.mean.iter().all(|of| (0.0..=1.0).contains(of))
            && deviation(self.deviation)
            && deviation(self.residual)
            && f64::from(self.slope.abs()) <= 1.001 * MOST_SLOPE
    }

    /// Error function at both ends of [0, 1], in standard deviations of x.
    fn ends(&self) -> [f64; 2] {
        let [mean, deviation] = [self.mean[0], self.deviation].map(f64::from);
        [0.0, 1.0].map(|end| f64::from(erf(((end - mean) / (SQRT_2 * deviation)) as f32)))
    }

    /// Density over x and y at the mean, times the weight.
    pub fn peak(&self) -> f64 {
        let [low, high] = self.ends();
        let [weight, deviation, residual] = [self.weight, self.deviation, self.residual].map(f64::from);
        weight / (2.0 * PI * deviation * residual * 0.5 * (high - low))
    }

    /// Place that a point of the unit square maps to. Points that are evenly spread stay so.
    pub fn sample(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [low, high] = self.ends();
        let normal = |even: f64| SQRT_2 * f64::from(erf_inv(even as f32));
        let offset = f64::from(self.deviation) * normal(low + u * (high - low));
        let y =
            f64::from(self.mean[1]) + f64::from(self.slope) * offset + f64::from(self.residual) * normal(2.0 * v - 1.0);
        [(f64::from(self.mean[0]) + offset).clamp(0.0, BELOW_ONE), y.rem_euclid(1.0).min(BELOW_ONE)]
    }
}
