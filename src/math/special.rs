//! Special functions that the standard library lacks.

use super::lanes::functions::{exp, ln, polynomial};
use super::lanes::{Mask, Real};

/// Error function, absolute error below 1.5e-7 (Abramowitz and Stegun 1964, 7.1.26).
#[inline(always)]
pub fn erf<R: Real>(x: R) -> R {
    let t = (x.abs() * 0.327_591_1 + 1.0).inverse();
    let poly = t * polynomial(t, [1.061_405_4, -1.453_152_1, 1.421_413_8, -0.284_496_72, 0.254_829_6]);
    (poly * exp(-x * x)).rest().with_sign(x)
}

/// Inverse error function on (−1, 1), single precision (Giles 2012, "Approximating the erfinv function").
#[inline(always)]
pub fn erf_inv<R: Real>(x: R) -> R {
    const CENTRAL: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725e-3,
        -4.177_681_6e-3,
        2.466_407_3e-1,
        1.501_409_4,
    ];
    const TAIL: [f32; 9] = [
        -2.002_142_6e-4,
        1.009_505_6e-4,
        1.349_343_2e-3,
        -3.673_428_4e-3,
        5.739_507_8e-3,
        -7.622_461_3e-3,
        9.438_870_5e-3,
        1.001_674,
        2.832_976_8,
    ];
    let x = x.between(-0.999_999_94, 0.999_999_94);
    let w = -ln(x.rest() * (x + 1.0));
    let central = w.below(5.0);
    let mut slope = polynomial(w - 2.5, CENTRAL);
    if (!central).any() {
        slope = central.choose(slope, polynomial(w.sqrt() - 3.0, TAIL));
    }
    slope * x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_and_its_inverse() {
        for (x, y) in [(0.0, 0.0), (0.5, 0.520_499_9), (1.0, 0.842_700_8), (2.0, 0.995_322_3), (-1.0, -0.842_700_8)] {
            assert!((erf(x) - y).abs() < 5e-7, "{x}");
            assert!((erf_inv(y) - x).abs() < 2e-5, "{x}");
        }
        assert!(erf_inv(1.0).is_finite() && erf_inv(-1.0).is_finite());
    }
}
