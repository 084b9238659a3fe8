//! Sample count and variance of each pixel of a picture.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::accumulator::{FinishedPass, Summed, check_alike, tile_of, weights};
use crate::base::Result;

/// Sample count and variance of each pixel of a picture, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelSpread {
    /// Samples that the value is made of.
    pub samples: Vec<u32>,
    /// Variance of the value per channel; 0 below two samples.
    pub variance: Vec<Vec3>,
}

/// Sample counts and variances of [`combine`](super::combine)'s picture, or where `fixed` weights are given of that of
/// [`combine_weighted`](super::combine_weighted). A pass that took only one sample of a pixel is taken to be as noisy there as the
/// noisiest of the others. Passes must have been finished with their variances; those without count as unknown.
///
/// Samples that follow sequences are spread more evenly than independent ones, so their spread within a pixel overestimates the
/// variance. It only divides the variance of a tile among its pixels; the sum over a tile is measured by the difference of a
/// pass's halves, which are independent of each other.
///
/// # Errors
/// [`Error::Options`](crate::base::Error::Options) where passes differ in size or there is none.
pub fn pixel_spread(passes: &[FinishedPass], fixed: Option<&[f64]>) -> Result<PixelSpread> {
    let [width, pixels] = check_alike(passes)?;
    let own = if fixed.is_some() { [Vec::new(), Vec::new()] } else { [1, 0].map(|other| weights(passes, other)) };
    let evenness: Vec<Vec<f64>> = passes.par_iter().map(|pass| evenness(pass, width)).collect();
    let pixel = |i: usize| {
        let known = |(pass, evenness): (&FinishedPass, &Vec<f64>)| {
            let variance = pass.variance.get(i).copied().filter(|v| !v.is_nan())?;
            Some(variance * evenness[tile_of(i, width)] as f32)
        };
        let noisiest = passes.iter().zip(&evenness).filter_map(known).fold(Vec3::ZERO, Vec3::max);
        let (mut sum, mut samples) = (DVec3::ZERO, 0u32);
        for (half, own) in own.iter().enumerate() {
            let weights = fixed.unwrap_or_else(|| &own[tile_of(i, width)]);
            // A sample's weight, or one of the pass.
            let weight = |pass: &FinishedPass, weight: f64| match fixed {
                Some(_) => weight,
                None => weight * f64::from(pass.count(half, i)),
            };
            let sampled = || {
                let sampled =
                    passes.iter().zip(&evenness).zip(weights).filter(|((pass, _), _)| pass.count(half, i) > 0);
                sampled.map(|((pass, evenness), of)| ((pass, evenness), weight(pass, *of)))
            };
            let total: f64 = sampled().map(|(_, weight)| weight).sum();
            let count: u32 = sampled().map(|((pass, _), _)| pass.count(half, i)).sum();
            if total > 0.0 {
                samples += count;
                for ((pass, even), weight) in sampled() {
                    let variance = known((pass, even)).unwrap_or(noisiest).as_dvec3();
                    let share = f64::from(count) * weight / total;
                    sum += variance * (share * share / f64::from(pass.count(half, i)));
                }
            }
        }
        let variance = if samples > 0 { sum / f64::from(samples).powi(2) } else { DVec3::ZERO };
        (samples, variance.as_vec3())
    };
    let (samples, variance) = (0..pixels).into_par_iter().map(pixel).unzip();
    Ok(PixelSpread { samples, variance })
}

/// Sample counts and variances of the picture of `sum`, which has so many columns; none where it was not made for them.
///
/// # Errors
/// Those of [`pixel_spread`]; there are none for a sum.
pub fn spread_of_sum(sum: Summed, width: usize) -> Result<Option<PixelSpread>> {
    sum.into_pass(width).map(|pass| pixel_spread(&[pass], Some(&[1.0]))).transpose()
}

/// By tile: squared difference of the pass's halves over that expected of independent samples with the pixels' spread.
fn evenness(pass: &FinishedPass, width: usize) -> Vec<f64> {
    let tiles = (0..pass.variance.len()).map(|i| tile_of(i, width) + 1).max().unwrap_or(0);
    let mut sums = vec![[0.0f64; 2]; tiles];
    for (i, variance) in pass.variance.iter().enumerate().filter(|(_, variance)| !variance.is_nan()) {
        let counts = [0, 1].map(|half| f64::from(pass.count(half, i)));
        if counts[0] > 0.0 && counts[1] > 0.0 {
            let [a, b] = [0, 1].map(|half| pass.mean(half, i).as_dvec3());
            let sum = &mut sums[tile_of(i, width)];
            sum[0] += (a - b).length_squared();
            sum[1] += variance.as_dvec3().element_sum() * (1.0 / counts[0] + 1.0 / counts[1]);
        }
    }
    sums.into_iter()
        .map(|[measured, independent]| if independent > 0.0 { measured / independent } else { 1.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Pass, combine};
    use super::*;
    use crate::base::random::Random;

    /// 4 × 4 pixels, each sample uniform in [0, width): its variance is width² / 12.
    fn pass(random: &mut Random, spp: u64, width: f32) -> FinishedPass {
        let mut pass = Pass::new(4, 4);
        for sample in 0..spp {
            (0..16).for_each(|i| pass.add(i, sample, Vec3::new(1.0, 2.0, 3.0) * width * random.next_f32()));
        }
        pass.finish_with_variance()
    }

    /// Two passes of different noise, many times: the mean of the estimated variances is the variance of the pictures. 16 pixels and
    /// 2000 pictures leave 0.8 % of chance; 5 % is allowed.
    #[test]
    fn variance_is_that_of_pictures() {
        let mut random = Random::new(3, 0, 0);
        let (mut estimated, mut squares, mut sum, n) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 2000);
        for _ in 0..n {
            let passes = [pass(&mut random, 16, 1.0), pass(&mut random, 8, 0.5)];
            let spread = pixel_spread(&passes, None).unwrap();
            assert!(spread.samples.iter().all(|&count| count == 24));
            estimated += spread.variance.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / 16.0;
            for pixel in combine(&passes).unwrap().pixels {
                // Both passes have known means; the picture's lies between them.
                let off = pixel.as_dvec3();
                sum += off / 16.0;
                squares += off * off / 16.0;
            }
        }
        let n = f64::from(n);
        let measured = squares / n - (sum / n).powf(2.0);
        for c in 0..3 {
            let ratio = estimated[c] / n / measured[c];
            assert!((ratio - 1.0).abs() < 0.05, "channel {c}: {ratio}");
        }
    }

    #[test]
    fn what_is_not_known_is_said() {
        let mut random = Random::new(4, 0, 0);
        let single = pixel_spread(&[pass(&mut random, 1, 1.0)], None).unwrap();
        assert!(single.samples == [1; 16] && single.variance == [Vec3::ZERO; 16]);
        let nothing = pixel_spread(&[Pass::new(4, 4).finish_with_variance()], None).unwrap();
        assert!(nothing.samples == [0; 16] && nothing.variance == [Vec3::ZERO; 16]);
        assert!(pixel_spread(&[], None).is_err());
    }

    #[test]
    fn fixed_weights_count_as_given() {
        // The halves of 16 pixels tell their variance to a third; those of 400 times 16 to 2 %.
        let mut random = Random::new(5, 0, 0);
        let mean = |spread: &PixelSpread| f64::from(spread.variance.iter().map(|v| v.x).sum::<f32>()) / (16.0 * 400.0);
        let (mut one, mut both) = (0.0, 0.0);
        for _ in 0..400 {
            let passes = [pass(&mut random, 64, 1.0), pass(&mut random, 64, 1.0)];
            both += mean(&pixel_spread(&passes, Some(&[0.5; 2])).unwrap());
            one += mean(&pixel_spread(&passes[..1], Some(&[1.0])).unwrap());
        }
        assert!((both / one - 0.5).abs() < 0.1, "{both} {one}");
        assert!((one * 64.0 * 12.0 - 1.0).abs() < 0.1, "{one}");
    }
}
