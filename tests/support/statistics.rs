//! Quantiles and tests of hypotheses for tests that draw random samples.

use std::f64::consts::{FRAC_PI_2, SQRT_2};

/// Level of each of `tests` independent tests that together raise a false alarm with probability `alpha` (Šidák 1967).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    1.0 - (1.0 - alpha).powf(1.0 / tests as f64)
}

/// erfc with a relative error below 1.2e-7 (Press et al. 1992, §6.2).
fn erfc(x: f64) -> f64 {
    const TERMS: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let t = 1.0 / (1.0 + 0.5 * x.abs());
    let y = t * (-x * x + TERMS.iter().rev().fold(0.0, |sum, c| sum * t + c)).exp();
    if x >= 0.0 { y } else { 2.0 - y }
}

/// The z that a standard normal variable exceeds with probability `tail`.
pub fn normal_quantile(tail: f64) -> f64 {
    bisect(-40.0, 40.0, |z| 0.5 * erfc(z / SQRT_2) > tail)
}

/// The t whose absolute value a Student variable with `freedom` degrees exceeds with probability `tail`.
/// With t = √ν·tan θ the density is proportional to cos^(ν−1) θ.
pub fn student_quantile(tail: f64, freedom: f64) -> f64 {
    let integral = |from: f64| {
        let (n, width) = (4000, FRAC_PI_2 - from);
        (0..n).map(|i| (from + (f64::from(i) + 0.5) * width / f64::from(n)).cos().powf(freedom - 1.0)).sum::<f64>()
            * width
    };
    let total = integral(0.0);
    freedom.sqrt() * bisect(0.0, FRAC_PI_2, |theta| integral(theta) / total > tail).tan()
}

/// Where a condition that holds at `low` and not at `high` stops holding.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The value that χ² with `freedom` degrees exceeds with probability `tail` (Wilson and Hilferty 1931).
pub fn chi2_quantile(tail: f64, freedom: f64) -> f64 {
    let h = 2.0 / (9.0 * freedom);
    freedom * (1.0 - h + normal_quantile(tail) * h.sqrt()).powi(3)
}

/// Pearson's χ² of counts against expected counts; cells below five expected counts are pooled. Fails above the quantile of
/// `tail`, and where a sample fell where none can.
pub fn assert_chi2(name: &str, counts: &[f64], expected: &[f64], tail: f64) {
    let (mut chi2, mut cells, mut pooled) = (0.0, 0.0, [0.0, 0.0]);
    for (&count, &expected) in counts.iter().zip(expected) {
        if expected >= 5.0 {
            chi2 += (count - expected).powi(2) / expected;
            cells += 1.0;
        } else {
            pooled = [pooled[0] + count, pooled[1] + expected];
        }
    }
    if pooled[1] >= 5.0 {
        chi2 += (pooled[0] - pooled[1]).powi(2) / pooled[1];
        cells += 1.0;
    } else {
        // A Poisson variable of mean m ≤ 5 exceeds m + 30 with probability below 1e-12.
        assert!(pooled[0] <= pooled[1] + 30.0, "{name}: {} samples where {} are expected", pooled[0], pooled[1]);
    }
    assert!(cells > 1.0, "{name}: nothing to compare");
    let limit = chi2_quantile(tail, cells - 1.0);
    assert!(chi2 < limit, "{name}: χ² {chi2:.1} over {cells} cells, limit {limit:.1}");
}

/// Mean and variance of independent numbers.
#[derive(Debug, Clone, Copy)]
pub struct Summary {
    pub mean: f64,
    /// Variance of the mean.
    pub variance: f64,
    pub freedom: f64,
}

impl Summary {
    pub fn new(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let spread: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
        Self { mean, variance: spread / (n - 1.0) / n, freedom: n - 1.0 }
    }

    pub fn error(&self) -> f64 {
        self.variance.sqrt()
    }

    /// |t| of the difference of two means, and its degrees of freedom by Welch.
    fn difference(&self, other: &Self) -> (f64, f64) {
        let variance = self.variance + other.variance;
        let difference = (self.mean - other.mean).abs();
        if variance == 0.0 {
            return (if difference == 0.0 { 0.0 } else { f64::INFINITY }, self.freedom);
        }
        let freedom =
            variance.powi(2) / (self.variance.powi(2) / self.freedom + other.variance.powi(2) / other.freedom);
        (difference / variance.sqrt(), freedom)
    }

    /// Welch's test that two means are equal: |t| over the two-sided quantile of `tail`, so that above 1 they differ.
    pub fn welch(&self, other: &Self, tail: f64) -> f64 {
        let (t, freedom) = self.difference(other);
        t / student_quantile(tail, freedom)
    }

    /// Whether they differ by that test. For many: Student's quantile takes milliseconds, and is not needed where the normal one,
    /// which is less, is not reached.
    pub fn differs(&self, other: &Self, tail: f64) -> bool {
        let (t, freedom) = self.difference(other);
        t > normal_quantile(0.5 * tail) && t > student_quantile(tail, freedom)
    }
}
