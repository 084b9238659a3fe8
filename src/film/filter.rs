//! Pixel filters by filter importance sampling (Ernst, Stamminger and Greiner 2006).
//!
//! A pixel's value is the integral of the light around it, weighted by a filter. Here the filter is the density that the offsets of
//! the pixel's camera samples are drawn from, so the value is their plain mean: every sample belongs to one pixel, and estimates
//! from the spread of its samples stay valid. A splat would share samples between pixels instead, with less noise for wide
//! filters, but with noise that neighbours have in common, and with edges where the film ends.
//!
//! All filters are even and separable. Both axes are inverted from one uniform number each, in ascending order, so that numbers
//! that are spread evenly give offsets that are.

use std::f64::consts::PI;

use crate::base::{Error, Result};
use crate::scene::file::FilterFile;

/// Cells from the centre to the radius of a tabulated filter.
const CELLS: usize = 512;
/// Standard deviations beyond which a Gaussian holds nothing that f32 could tell from 0.
const GAUSSIAN_END: f64 = 8.0;

/// A filter ready to be sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelFilter {
    /// Radius, pixels.
    radius: f32,
    profile: Profile,
}

/// The filter from its centre (0) to its radius (1).
#[derive(Debug, Clone, PartialEq)]
enum Profile {
    Box,
    Tent,
    /// Distribution function at the bounds of [`CELLS`] cells of equal width; the density is constant within each.
    Table(Vec<f32>),
}

impl Default for PixelFilter {
    /// The mean over the pixel.
    fn default() -> Self {
        Self { radius: 0.5, profile: Profile::Box }
    }
}

impl PixelFilter {
    /// Makes a filter.
    ///
    /// # Errors
    /// [`Error::Options`] where a length is not in (0, [`FilterFile::MOST`]] pixels.
    pub fn new(file: FilterFile) -> Result<Self> {
        let usable = |length: f32| length > 0.0 && length <= FilterFile::MOST;
        let stddev = if let FilterFile::Gaussian { stddev, .. } = file { stddev } else { 1.0 };
        if !usable(file.radius()) || !usable(stddev) {
            let (name, most) = (file.name(), FilterFile::MOST);
            return Err(Error::Options(format!("the {name} filter needs lengths above 0 and up to {most} pixels")));
        }
        let radius = file.radius();
        Ok(match file {
            FilterFile::Box { .. } => Self { radius, profile: Profile::Box },
            FilterFile::Tent { .. } => Self { radius, profile: Profile::Tent },
            FilterFile::Gaussian { .. } => {
                let stddev = f64::from(stddev);
                let end = f64::from(radius).min(GAUSSIAN_END * stddev);
                // exp(−x²/2σ²) − exp(−r²/2σ²) up to a factor, without the cancellation.
                let weight = |x: f64| ((1.0 - x * x) * 0.5 * (end / stddev).powi(2)).exp_m1();
                Self { radius: end as f32, profile: Profile::table(weight) }
            }
            FilterFile::BlackmanHarris { .. } => Self { radius, profile: Profile::table(blackman_harris) },
        })
    }

    /// Maps uniform numbers in [0, 1)² to a place relative to the pixel's top left corner, in pixels; the identity for a box of
    /// radius 0.5.
    #[inline(always)]
    pub fn sample(&self, u: [f32; 2]) -> [f32; 2] {
        u.map(|u| {
            let signed = 2.0 * u - 1.0;
            0.5 + (self.radius * self.profile.invert(signed.abs())).copysign(signed)
        })
    }

    /// The pixels of a picture of `size` in whose surroundings a place of the film lies, with the density of that place around each.
    pub fn around(&self, film: [f32; 2], size: [u32; 2]) -> impl Iterator<Item = ([u32; 2], f32)> + '_ {
        let range = |axis: usize| {
            let first = (film[axis] - 0.5 - self.radius).floor().max(0.0);
            let last = (film[axis] - 0.5 + self.radius).floor();
            // Conversion saturates, and a range that ends before it begins is empty.
            first as u32..((last + 1.0).max(0.0) as u32).min(size[axis])
        };
        let columns = range(0);
        let pixels = range(1).flat_map(move |y| columns.clone().map(move |x| [x, y]));
        pixels.filter_map(move |pixel| {
            let place = [film[0] - pixel[0] as f32, film[1] - pixel[1] as f32];
            // The far edge of a box belongs to the next pixel.
            let inside = place.iter().all(|x| *x < 0.5 + self.radius);
            let density = if inside { self.pdf(place) } else { 0.0 };
            (density > 0.0).then_some((pixel, density))
        })
    }

    /// Density of [`PixelFilter::sample`] per square pixel.
    pub fn pdf(&self, place: [f32; 2]) -> f32 {
        place.iter().map(|x| self.profile.density((x - 0.5).abs() / self.radius) / (2.0 * self.radius)).product()
    }
}

/// Blackman and Harris' window of four terms from its centre at 0 to its end at 1 (Harris 1978, table 1).
fn blackman_harris(x: f64) -> f64 {
    0.35875 + 0.48829 * (PI * x).cos() + 0.14128 * (2.0 * PI * x).cos() + 0.01168 * (3.0 * PI * x).cos()
}

impl Profile {
    /// Tabulates a smooth weight over [0, 1] that is not negative.
    fn table(weight: impl Fn(f64) -> f64) -> Self {
        let at = |i: usize, part: f64| weight((i as f64 + part) / CELLS as f64);
        let mut sum = 0.0;
        let mut sums = vec![0.0];
        for i in 0..CELLS {
            // Simpson's rule.
            sum += (at(i, 0.0) + 4.0 * at(i, 0.5) + at(i, 1.0)).max(0.0);
            sums.push(sum);
        }
        Self::Table(sums.iter().map(|part| (part / sum) as f32).collect())
    }

    /// The quantile of `t` in [0, 1].
    #[inline(always)]
    fn invert(&self, t: f32) -> f32 {
        match self {
            Self::Box => t,
            // 1 − √(1 − t) without the cancellation.
            Self::Tent => t / (1.0 + (1.0 - t).sqrt()),
            Self::Table(sums) => {
                let above = sums.partition_point(|&sum| sum < t).clamp(1, CELLS);
                let (low, high) = (sums[above - 1], sums[above]);
                ((above - 1) as f32 + (t - low) / (high - low)) / CELLS as f32
            }
        }
    }

    /// The density of `invert` at `x`.
    fn density(&self, x: f32) -> f32 {
        match self {
            _ if x > 1.0 => 0.0,
            Self::Box => 1.0,
            Self::Tent => 2.0 * (1.0 - x),
            Self::Table(sums) => {
                let cell = ((x * CELLS as f32) as usize).min(CELLS - 1);
                (sums[cell + 1] - sums[cell]) * CELLS as f32
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    const ALL: [FilterFile; 7] = [
        FilterFile::Box { radius: 0.5 },
        FilterFile::Box { radius: 1.25 },
        FilterFile::Tent { radius: 1.0 },
        FilterFile::GAUSSIAN,
        FilterFile::Gaussian { stddev: 1.0, radius: Some(1.5) },
        FilterFile::BLACKMAN_HARRIS,
        FilterFile::BlackmanHarris { radius: 3.0 },
    ];

    /// The filter as defined, up to a factor.
    fn defined(file: FilterFile, x: f64) -> f64 {
        let radius = f64::from(file.radius());
        match file {
            _ if x.abs() > radius => 0.0,
            FilterFile::Box { .. } => 1.0,
            FilterFile::Tent { .. } => 1.0 - x.abs() / radius,
            FilterFile::Gaussian { stddev, .. } => {
                let gauss = |x: f64| (-0.5 * (x / f64::from(stddev)).powi(2)).exp();
                gauss(x) - gauss(radius)
            }
            FilterFile::BlackmanHarris { .. } => blackman_harris(x.abs() / radius),
        }
    }

    /// Integral by the midpoint rule, which is exact to 1e-6 here.
    fn integral(low: f64, high: f64, f: impl Fn(f64) -> f64) -> f64 {
        let n = 4000;
        let step = (high - low) / f64::from(n);
        (0..n).map(|i| f(low + (f64::from(i) + 0.5) * step)).sum::<f64>() * step
    }

    /// χ² of 1,000,000 offsets on each axis over 40 cells against the filter's definition; 14 tests with a false alarm of 1e-5 each.
    #[test]
    fn s01_offsets_follow_the_filter() {
        let n = 1_000_000;
        for (stream, file) in ALL.into_iter().enumerate() {
            let filter = PixelFilter::new(file).unwrap();
            let radius = f64::from(file.radius());
            let total = integral(-radius, radius, |x| defined(file, x));
            let mut random = Random::new(7, stream as u64, 0);
            let mut counts = [[0u32; 40]; 2];
            for _ in 0..n {
                for (counts, x) in counts.iter_mut().zip(filter.sample(random.next_2d())) {
                    let place = (f64::from(x) - 0.5 + radius) / (2.0 * radius) * 40.0;
                    assert!((-1e-4..40.0001).contains(&place), "{file:?}: {x}");
                    counts[place.clamp(0.0, 39.0) as usize] += 1;
                }
            }
            let width = radius / 20.0;
            for counts in counts {
                let (mut chi2, mut cells, mut rest) = (0.0, 0, [0.0, 0.0]);
                for (i, &count) in counts.iter().enumerate() {
                    let low = i as f64 * width - radius;
                    let expected = f64::from(n) * integral(low, low + width, |x| defined(file, x)) / total;
                    if expected >= 5.0 {
                        chi2 += (f64::from(count) - expected).powi(2) / expected;
                        cells += 1;
                    } else {
                        rest = [rest[0] + f64::from(count), rest[1] + expected];
                    }
                }
                // The 1 − 1e-5 quantile of χ² with 39 degrees of freedom is 87.6; with fewer it is less.
                assert!(cells > 10 && chi2 < 87.6, "{file:?}: χ² {chi2} over {cells} cells");
                assert!(rest[0] <= rest[1] + 30.0, "{file:?}: {rest:?}");
            }
        }
    }

    #[test]
    fn s02_density_has_the_integral_one_and_the_filters_variance() {
        for file in ALL {
            let filter = PixelFilter::new(file).unwrap();
            let radius = f64::from(file.radius());
            // Along one axis, through the centre of the other, whose part is divided out.
            let across = f64::from(filter.pdf([0.5; 2])).sqrt();
            let pdf = |x: f64| f64::from(filter.pdf([0.5 + x as f32, 0.5])) / across;
            // Beyond the ends too, in 22 pieces, so that no step of a box is inside of one.
            let whole = |f: &dyn Fn(f64) -> f64| -> f64 {
                (-11..11).map(|i| integral(f64::from(i) * radius / 10.0, f64::from(i + 1) * radius / 10.0, f)).sum()
            };
            let total = whole(&pdf);
            assert!((total - 1.0).abs() < 1e-3, "{file:?}: {total}");
            let weights = whole(&|x| defined(file, x));
            let variance = |f: &dyn Fn(f64) -> f64| whole(&|x| x * x * f(x));
            let (own, meant) = (variance(&pdf), variance(&|x| defined(file, x)) / weights);
            assert!((own / meant - 1.0).abs() < 1e-3, "{file:?}: {own} against {meant}");
        }
        let variance_of_the_pixel = 1.0 / 12.0;
        let tent = integral(-1.0, 1.0, |x| x * x * (1.0 - x.abs()));
        assert!((tent - 2.0 * variance_of_the_pixel).abs() < 1e-6, "a tent is two boxes, one after the other");
    }

    /// The standard error of the variance of a million offsets is 0.14 % at most; the limit is seven of them.
    #[test]
    fn sampled_variance_is_the_filters() {
        for (file, variance) in [
            (FilterFile::default(), 1.0 / 12.0),
            (FilterFile::TENT, 1.0 / 6.0),
            // Cut at 4 standard deviations and lowered, which takes 0.6 % of 0.5².
            (FilterFile::GAUSSIAN, 0.25 * 0.9943),
        ] {
            let filter = PixelFilter::new(file).unwrap();
            let mut random = Random::new(8, 0, 0);
            let n = 1_000_000;
            let square = |_| f64::from(filter.sample(random.next_2d())[0] - 0.5).powi(2);
            let measured = (0..n).map(square).sum::<f64>() / f64::from(n);
            assert!((measured / variance - 1.0).abs() < 0.01, "{file:?}: {measured}");
        }
    }

    #[test]
    fn the_plain_box_changes_no_number_and_all_keep_order() {
        let mut random = Random::new(9, 0, 0);
        for _ in 0..1000 {
            let u = random.next_2d();
            assert_eq!(PixelFilter::default().sample(u).map(f32::to_bits), u.map(f32::to_bits));
        }
        for file in ALL {
            let filter = PixelFilter::new(file).unwrap();
            let places: Vec<f32> = (0..1 << 12).map(|i| filter.sample([i as f32 / 4096.0, 0.5])[0]).collect();
            assert!(places.is_sorted() && places.iter().all(|x| x.is_finite()), "{file:?}");
            assert_eq!(filter.sample([0.5; 2]), [0.5; 2], "{file:?}");
        }
    }

    #[test]
    fn extremes_are_finite_or_refused() {
        for stddev in [1e-38, 1e-6, 64.0] {
            for radius in [1e-38, 1e-3, 64.0] {
                let filter = PixelFilter::new(FilterFile::Gaussian { stddev, radius: Some(radius) }).unwrap();
                for u in [0.0, 0.25, 1.0 - f32::EPSILON / 2.0] {
                    let [x, y] = filter.sample([u, 0.5]);
                    assert!((x - 0.5).abs() <= radius && y == 0.5, "{stddev} {radius} {u}: {x}");
                }
            }
        }
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, 65.0] {
            assert!(PixelFilter::new(FilterFile::Box { radius: bad }).is_err());
            assert!(PixelFilter::new(FilterFile::Gaussian { stddev: bad, radius: Some(1.0) }).is_err());
        }
    }
}
