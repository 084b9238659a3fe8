//! Errors of a picture against a reference.
//!
//! x is the picture, r the reference; means run over pixels and channels.

use glam::Vec3;
use serde::Serialize;

use crate::base::{Error, Result};
use crate::math::srgb;
use crate::picture::Image;

/// Added to r² in relative errors, so that black pixels count finitely.
pub(super) const FLOOR: f64 = 0.01;
/// Share of pixels that the trimmed error drops.
const TRIM: f64 = 0.001;

/// Errors of a picture against its reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measures {
    /// Mean of (x−r)²/(r²+0.01).
    pub relmse: f64,
    /// The same without the worst 0.1 % of pixels (rounded down), so that a few fireflies do not decide.
    pub relmse_trimmed: f64,
    /// Mean of (x−r)².
    pub mse: f64,
    /// Mean of |x−r|/(|r|+0.01).
    pub mape: f64,
    /// Mean of x over mean of r; infinite (in JSON: null) where only the reference is black, 1 where both are.
    pub mean_ratio: f64,
    /// relMSE of the two as shown on a screen: clamped to [0, 1] and through the sRGB curve.
    pub relmse_ldr: f64,
}

/// Number of pixels that trimmed errors leave out of a picture of `pixels` pixels: 0.1 %, rounded down.
pub fn outliers(pixels: usize) -> usize {
    (pixels as f64 * TRIM) as usize
}

/// Compares a picture with its reference.
///
/// # Errors
/// [`Error::Options`] where sizes differ, a picture is empty, or a pixel of either is not finite; the pixel is named.
pub fn measure(picture: &Image, reference: &Image) -> Result<Measures> {
    measure_noisy(picture, reference, None)
}

/// [`measure`] where the reference is itself an estimate with a known variance per pixel and channel: in both relative errors that
/// variance is subtracted from (x−r)², so that what is left is the distance to the truth, on average over references. The other
/// measures are those of [`measure`].
///
/// # Errors
/// As [`measure`], for the variance too.
pub fn measure_noisy(picture: &Image, reference: &Image, variance: Option<&Image>) -> Result<Measures> {
    check(picture, reference, "picture")?;
    variance.map_or(Ok(()), |variance| check(variance, reference, "variance"))?;
    let pairs = || picture.pixels.iter().zip(&reference.pixels);
    let mean =
        |f: fn(f64, f64) -> f64| pairs().map(|(&x, &r)| per_pixel(x, r, f)).sum::<f64>() / picture.pixels.len() as f64;
    // Error of each pixel, and the part of it that is the reference's own.
    let own = |i: usize, r: Vec3| variance.map_or(0.0, |v| per_pixel(v.pixels[i], r, |v, r| v / (r * r + FLOOR)));
    let mut relative: Vec<(f64, f64)> =
        pairs().enumerate().map(|(i, (&x, &r))| (pixel_error(x, r), own(i, r))).collect();
    let mean_of = |all: &[(f64, f64)]| all.iter().map(|(e, own)| e - own).sum::<f64>() / all.len() as f64;
    let relmse = mean_of(&relative);
    relative.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    relative.truncate(relative.len() - outliers(relative.len()));
    Ok(Measures {
        relmse,
        relmse_trimmed: mean_of(&relative),
        mse: mean(|x, r| (x - r) * (x - r)),
        mape: mean(|x, r| (x - r).abs() / (r.abs() + FLOOR)),
        mean_ratio: ratio(mean(|x, _| x), mean(|_, r| r)),
        relmse_ldr: mean(|x, r| relative_square(srgb::encoded(x), srgb::encoded(r))),
    })
}

/// Mean over pixels and channels of variance / (r² + 0.01): what the noise of a reference adds to every relMSE.
///
/// # Errors
/// As [`measure`].
pub fn relative_variance(reference: &Image, variance: &Image) -> Result<f64> {
    check(variance, reference, "variance")?;
    let pairs = variance.pixels.iter().zip(&reference.pixels);
    let sum: f64 = pairs.map(|(&v, &r)| per_pixel(v, r, |v, r| v / (r * r + FLOOR))).sum();
    Ok(sum / reference.pixels.len() as f64)
}

/// Mean of independent pictures, and the variance of that mean per pixel and channel.
///
/// # Errors
/// [`Error::Options`] for fewer than two pictures, otherwise as [`measure`].
pub fn mean_and_variance(parts: &[Image]) -> Result<(Image, Image)> {
    let [first, second, ..] = parts else {
        return Err(Error::Options("a variance needs at least two pictures".into()));
    };
    check(first, second, "picture")?;
    parts.iter().try_for_each(|part| check(part, first, "picture"))?;
    let n = parts.len() as f32;
    let (mut mean, mut variance) = (first.clone(), first.clone());
    for i in 0..mean.pixels.len() {
        mean.pixels[i] = parts.iter().map(|p| p.pixels[i]).sum::<Vec3>() / n;
        let deviations = parts.iter().map(|p| p.pixels[i] - mean.pixels[i]);
        variance.pixels[i] = deviations.map(|d| d * d).sum::<Vec3>() / ((n - 1.0) * n);
    }
    Ok((mean, variance))
}

/// One pixel's part of the relMSE: the mean over channels of (x−r)²/(r²+0.01).
pub fn pixel_error(x: Vec3, r: Vec3) -> f64 {
    per_pixel(x, r, relative_square)
}

fn relative_square(x: f64, r: f64) -> f64 {
    (x - r) * (x - r) / (r * r + FLOOR)
}

fn per_pixel(x: Vec3, r: Vec3, f: fn(f64, f64) -> f64) -> f64 {
    (0..3).map(|c| f(f64::from(x[c]), f64::from(r[c]))).sum::<f64>() / 3.0
}

fn ratio(x: f64, r: f64) -> f64 {
    if x == r { 1.0 } else { x / r }
}

/// Refuses a `picture`, called so, that does not fit its reference, and values that are not finite.
fn check(picture: &Image, reference: &Image, called: &str) -> Result<()> {
    if (picture.width, picture.height) != (reference.width, reference.height) {
        return Err(Error::Options(format!(
            "the {called} is {}x{} pixels, the reference {}x{}; they must be equal",
            picture.width, picture.height, reference.width, reference.height
        )));
    }
    if picture.pixels.is_empty() {
        return Err(Error::Options("pictures without pixels cannot be compared".into()));
    }
    for (name, image) in [(called, picture), ("reference", reference)] {
        if let Some(i) = image.pixels.iter().position(|p| !p.is_finite()) {
            let (x, y) = (i % image.width, i / image.width);
            return Err(Error::Options(format!("pixel ({x}, {y}) of the {name} is not finite: {}", image.pixels[i])));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f32, n: usize) -> Image {
        Image { width: n, height: 1, pixels: vec![Vec3::splat(value); n] }
    }

    #[test]
    fn values_by_hand() {
        let m = measure(&flat(0.3, 10), &flat(0.1, 10)).unwrap();
        assert!((m.relmse - 0.04 / 0.02).abs() < 1e-6);
        assert!((m.mse - 0.04).abs() < 1e-7);
        assert!((m.mape - 0.2 / 0.11).abs() < 1e-6);
        assert!((m.mean_ratio - 3.0).abs() < 1e-6);
        assert_eq!(measure(&flat(5.0, 4), &flat(2.0, 4)).unwrap().relmse_ldr, 0.0, "both are white on a screen");
        assert_eq!(measure(&flat(0.0, 4), &flat(0.0, 4)).unwrap().mean_ratio, 1.0);
    }

    #[test]
    fn trimming_drops_a_firefly_in_a_thousand() {
        let mut picture = flat(1.0, 1000);
        picture.pixels[17] = Vec3::splat(1e6);
        let m = measure(&picture, &flat(1.0, 1000)).unwrap();
        assert!(m.relmse > 1e8);
        assert_eq!(m.relmse_trimmed, 0.0);
    }

    #[test]
    fn what_cannot_be_compared_is_named() {
        let mut broken = flat(1.0, 4);
        broken.pixels[2].y = f32::NAN;
        let message = measure(&flat(1.0, 4), &broken).unwrap_err().to_string();
        assert!(message.contains("pixel (2, 0) of the reference"), "{message}");
        assert!(measure(&flat(1.0, 4), &flat(1.0, 3)).is_err());
        assert!(measure(&flat(1.0, 0), &flat(1.0, 0)).is_err());
    }
}
