//! Accumulating samples into passes, and passes into a picture.
//!
//! A pass is accumulated in f64 by Welford's update (Welford 1962), whose variance of a constant is exactly 0, where the
//! difference of a sum of squares and a squared sum leaves rounding noise that would pass for a very small variance.
//!
//! Precision: samples are f32, their sums f64. The same update in f32 is wrong by 2e-3 in the mean and by 2e-2 in the variance
//! after 4 million samples of a pixel, by 0.4 after 67 million; f64 stays below 1e-12 and costs 1 ns a sample and 28 bytes a pixel,
//! where a path takes a thousand (`cargo bench --bench precision`).

use glam::Vec3;

use crate::base::{Error, Result};
use crate::materials::image::Image;

/// Largest accepted number of columns or rows.
pub const MAX_SIDE: u32 = 1 << 15;
/// Largest accepted number of pixels.
pub const MAX_PIXELS: u64 = 1 << 27;

/// Checks the size of a picture before anything is allocated for it.
///
/// # Errors
/// [`Error::Options`] where a side is 0 or the picture is too large.
pub fn check_size(width: u32, height: u32) -> Result<()> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
        return Err(Error::Options(format!(
            "a picture of {width}x{height} pixels cannot be made: each side must be 1 to {MAX_SIDE}, all pixels together at \
             most {MAX_PIXELS}"
        )));
    }
    Ok(())
}

/// Running mean and spread of one pixel's samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pixel {
    mean: [f64; 3],
    /// Sum of squared deviations from the mean.
    spread: [f64; 3],
    count: u32,
}

impl Pixel {
    /// Adds one sample of radiance, W·m⁻²·sr⁻¹ per channel; it must be finite.
    pub fn add(&mut self, value: Vec3) {
        debug_assert!(value.is_finite(), "samples that are not finite are dropped before they reach the film");
        self.count += 1;
        let n = f64::from(self.count);
        for (channel, value) in value.to_array().into_iter().enumerate() {
            let value = f64::from(value);
            let before = value - self.mean[channel];
            self.mean[channel] += before / n;
            self.spread[channel] += before * (value - self.mean[channel]);
        }
    }

    /// Mean of the samples; 0 where there are none.
    pub fn mean(&self) -> [f64; 3] {
        self.mean
    }

    /// Number of samples.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Unbiased variance of one sample per channel; `None` below two samples.
    pub fn sample_variance(&self) -> Option<[f64; 3]> {
        (self.count >= 2).then(|| self.spread.map(|s| s / f64::from(self.count - 1)))
    }
}

/// The samples of one pass over the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    width: usize,
    pixels: Vec<Pixel>,
}

impl Pass {
    /// A pass without samples.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, pixels: vec![Pixel::default(); width * height] }
    }

    /// Pixels row by row from the top left.
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// The same, to add samples to. Threads may share them out by rows; each pixel's samples must come in a fixed order.
    pub fn pixels_mut(&mut self) -> &mut [Pixel] {
        &mut self.pixels
    }

    /// Estimated relMSE (against the truth) of a picture with one sample per pixel: mean over pixels and channels of the sample
    /// variance over m² + 0.01, where m is the mean of the 3 × 3 pixels around, since a pixel's own mean follows its samples:
    /// the pixels that are too bright by chance would hide their error. 0 where no pixel has two samples.
    pub fn relative_variance(&self) -> f64 {
        let height = self.pixels.len().checked_div(self.width).unwrap_or(0);
        let mut sum = 0.0;
        let mut measured = 0u64;
        for (i, pixel) in self.pixels.iter().enumerate() {
            let Some(variance) = pixel.sample_variance() else { continue };
            let (x, y) = (i % self.width, i / self.width);
            let columns = x.saturating_sub(1)..(x + 2).min(self.width);
            let around = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|row| columns.clone().map(move |column| row * self.width + column));
            let (mut mean, mut count) = ([0.0; 3], 0.0);
            for neighbour in around {
                mean.iter_mut().zip(self.pixels[neighbour].mean).for_each(|(m, x)| *m += x);
                count += 1.0;
            }
            measured += 1;
            sum += average([0, 1, 2].map(|c| variance[c] / ((mean[c] / count).powi(2) + super::error::FLOOR)));
        }
        if measured > 0 { sum / measured as f64 } else { 0.0 }
    }

    /// Keeps of the pass what combining needs: the means in f32, the counts, and the pass's variance.
    pub fn finish(&self) -> FinishedPass {
        let mut finished = FinishedPass {
            width: self.width,
            means: self.pixels.iter().map(|p| Vec3::from_array(p.mean.map(|m| m as f32))).collect(),
            counts: self.pixels.iter().map(|p| p.count).collect(),
            freedom: 0,
            spread: 0.0,
            mean_variance: None,
        };
        let (mut variance, mut measured) = (0.0, 0u64);
        for pixel in &self.pixels {
            if let Some(per_sample) = pixel.sample_variance() {
                measured += 1;
                variance += average(per_sample) / f64::from(pixel.count);
                finished.freedom += u64::from(pixel.count - 1);
                finished.spread += average(pixel.spread);
            }
        }
        finished.mean_variance = (measured > 0).then(|| variance / measured as f64);
        finished
    }
}

fn average(channels: [f64; 3]) -> f64 {
    channels.iter().sum::<f64>() / 3.0
}

/// A pass that gets no more samples.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedPass {
    width: usize,
    means: Vec<Vec3>,
    counts: Vec<u32>,
    /// Degrees of freedom and sum of squared deviations over all pixels, for the pooled variance.
    freedom: u64,
    spread: f64,
    mean_variance: Option<f64>,
}

impl FinishedPass {
    /// Variance of a pixel's mean, averaged over channels and those pixels that have two samples; `None` where none has.
    pub fn mean_variance(&self) -> Option<f64> {
        self.mean_variance
    }

    /// Variance of one sample, averaged over channels and pixels; `None` below two samples.
    pub fn sample_variance(&self) -> Option<f64> {
        (self.freedom > 0).then(|| self.spread / self.freedom as f64)
    }

    /// Samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.counts.iter().map(|&c| u64::from(c)).sum()
    }
}

/// The weight of each pass; they sum to 1 unless there are no passes.
///
/// A weight is the inverse of the pass's mean variance, one for the whole picture: a weight per pixel would correlate with that
/// pixel's samples and darken it (`SEMANTICS`, Film). A pass of one sample per pixel has no variance of its own; it gets the
/// per-sample variance pooled over the other passes, divided by its samples per pixel. Where some pass has variance 0 (all
/// black or constant), or none can tell its variance, passes count by their samples, which is the plain mean.
pub fn weights(passes: &[FinishedPass]) -> Vec<f64> {
    let freedom: u64 = passes.iter().map(|p| p.freedom).sum();
    let pooled = passes.iter().map(|p| p.spread).sum::<f64>() / freedom as f64;
    let inverse = |pass: &FinishedPass| {
        let spp = pass.samples() as f64 / pass.counts.len().max(1) as f64;
        1.0 / pass.mean_variance.unwrap_or(pooled / spp)
    };
    let mut weights: Vec<f64> = passes.iter().map(inverse).collect();
    if freedom == 0 || weights.iter().any(|w| !w.is_finite()) {
        weights = passes.iter().map(|p| p.samples() as f64).collect();
    }
    let total: f64 = weights.iter().sum();
    weights.iter().map(|w| if total > 0.0 { w / total } else { 0.0 }).collect()
}

/// The picture that passes make together, each with its [weight](weights). A pixel without samples in a pass leaves that pass
/// out; one without samples in any is black.
///
/// # Errors
/// [`Error::Options`] where passes differ in size or there is none.
pub fn combine(passes: &[FinishedPass]) -> Result<Image> {
    combine_weighted(passes, &weights(passes))
}

/// The same with given weights, for passes whose sample counts were chosen by what others saw.
///
/// # Errors
/// As [`combine`].
pub fn combine_weighted(passes: &[FinishedPass], weights: &[f64]) -> Result<Image> {
    let first = passes.first().ok_or_else(|| Error::Options("no pass was rendered, so there is no picture".into()))?;
    if passes.iter().any(|p| p.width != first.width || p.means.len() != first.means.len()) {
        return Err(Error::Options("passes of different sizes cannot be combined".into()));
    }
    let pixel = |i: usize| {
        let (mut sum, mut total) = ([0.0f64; 3], 0.0);
        for (pass, weight) in passes.iter().zip(weights).filter(|(pass, _)| pass.counts[i] > 0) {
            total += weight;
            for (sum, mean) in sum.iter_mut().zip(pass.means[i].to_array()) {
                *sum += weight * f64::from(mean);
            }
        }
        if total > 0.0 { Vec3::from_array(sum.map(|s| (s / total) as f32)) } else { Vec3::ZERO }
    };
    let pixels: Vec<Vec3> = (0..first.means.len()).map(pixel).collect();
    let height = pixels.len().checked_div(first.width).unwrap_or(0);
    Ok(Image { width: first.width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn pass(spp: u32, mut value: impl FnMut(usize) -> f32) -> FinishedPass {
        let mut pass = Pass::new(4, 4);
        for _ in 0..spp {
            pass.pixels_mut().iter_mut().enumerate().for_each(|(i, p)| p.add(Vec3::splat(value(i))));
        }
        pass.finish()
    }

    fn noise(seed: u64, width: f32) -> impl FnMut(usize) -> f32 {
        let mut random = Random::new(seed, 0, 0);
        move |_| 1.0 + width * (random.next_f32() - 0.5)
    }

    /// HARD_CASES A16: an f32 sum of 1e6 values of 0.1 is off by 1 %.
    #[test]
    fn mean_of_a_million_samples_is_exact() {
        let mut constant = Pixel::default();
        let mut alternating = Pixel::default();
        for i in 0..1_000_000 {
            constant.add(Vec3::splat(0.1));
            alternating.add(Vec3::splat(if i % 2 == 0 { 1000.1 } else { 0.1 }));
        }
        assert!((constant.mean()[0] - f64::from(0.1f32)).abs() < 1e-7);
        assert_eq!(constant.sample_variance(), Some([0.0; 3]));
        let expected = (f64::from(1000.1f32) + f64::from(0.1f32)) / 2.0;
        assert!((alternating.mean()[0] / expected - 1.0).abs() < 1e-9);
        assert!((alternating.sample_variance().unwrap()[0] / 250_000.0 - 1.0).abs() < 1e-5);
    }

    /// HARD_CASES A13: no division by a variance of 0; the result is the plain mean.
    #[test]
    fn zero_variance_falls_back_to_the_plain_mean() {
        let constant = [pass(2, |_| 1.0), pass(6, |_| 3.0)];
        let picture = combine(&constant).unwrap();
        assert!(picture.pixels.iter().all(|p| (p.x - 2.5).abs() < 1e-6));
        let black = [pass(4, |_| 0.0), pass(8, noise(1, 1.0))];
        assert_eq!(weights(&black), [4.0 / 12.0, 8.0 / 12.0]);
        assert!(combine(&black).unwrap().pixels.iter().all(|p| p.is_finite()));
    }

    #[test]
    fn weight_is_the_inverse_variance() {
        let passes = [pass(4096, noise(1, 1.0)), pass(1024, noise(2, 0.25))];
        let weights = weights(&passes);
        // Variances 1/12/4096 and 1/16/12/1024: a ratio of 4.
        assert!((weights[1] / weights[0] / 4.0 - 1.0).abs() < 0.05, "{weights:?}");
    }

    #[test]
    fn one_sample_per_pixel_gets_the_pooled_variance() {
        let passes = [pass(1, noise(1, 1.0)), pass(255, noise(2, 1.0))];
        let weights = weights(&passes);
        assert!((weights[0] * 256.0 - 1.0).abs() < 0.05, "{weights:?}");
        let alone = [pass(1, noise(1, 1.0)), pass(1, noise(2, 1.0))];
        assert_eq!(super::weights(&alone), [0.5, 0.5]);
    }

    #[test]
    fn pixel_without_samples_leaves_its_pass_out() {
        let mut holed = Pass::new(2, 1);
        holed.pixels_mut()[0].add(Vec3::ONE);
        let mut full = Pass::new(2, 1);
        full.pixels_mut().iter_mut().for_each(|p| p.add(Vec3::splat(3.0)));
        let picture = combine(&[holed.finish(), full.finish()]).unwrap();
        assert_eq!(picture.pixels[1], Vec3::splat(3.0));
        assert_eq!(combine(&[Pass::new(1, 1).finish()]).unwrap().pixels, [Vec3::ZERO]);
    }

    #[test]
    fn absurd_sizes_are_refused() {
        assert!(check_size(1, 1).is_ok());
        for (width, height) in [(0, 4), (4, 0), (MAX_SIDE + 1, 1), (MAX_SIDE, MAX_SIDE), (u32::MAX, u32::MAX)] {
            assert!(matches!(check_size(width, height), Err(Error::Options(_))), "{width}x{height}");
        }
    }
}
