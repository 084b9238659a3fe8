//! Accumulating samples into passes, and passes into a picture.
//!
//! A pass is accumulated in f64 by Welford's update (Welford 1962), whose variance of a constant is exactly 0, where the
//! difference of a sum of squares and a squared sum leaves rounding noise that would pass for a very small variance.
//!
//! Precision: samples are f32, their sums f64. The same update in f32 is wrong by 2e-3 in the mean and by 2e-2 in the variance
//! after 4 million samples of a pixel, by 0.4 after 67 million; f64 stays below 1e-12 and costs 1 ns a sample and 28 bytes a pixel,
//! where a path takes a thousand (`cargo bench --bench precision`).

mod blocks;
mod stored;
mod sum;
mod summed;

pub use blocks::{BLOCK, Block};
pub use sum::Sum;
pub use summed::Summed;

use std::borrow::Borrow;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cascade::Cascade;
use super::error::{FLOOR, outliers};
use crate::base::{Error, Result};
use crate::math::trimmed_mean;
use crate::picture::Image;

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

/// [`check_size`] for so many pictures of that size on one sheet.
///
/// # Errors
/// As [`check_size`], also where all of them together have too many pixels.
pub fn check_sheet([width, height]: [u32; 2], views: usize) -> Result<()> {
    check_size(width, height)?;
    let pixels = u128::from(width) * u128::from(height) * views as u128;
    if pixels > u128::from(MAX_PIXELS) {
        return Err(Error::Options(format!(
            "{views} pictures of {width}x{height} pixels cannot be rendered together: all their pixels must be at most {MAX_PIXELS}; \
             give a smaller --size or fewer views"
        )));
    }
    Ok(())
}

/// How the variances of one sample differ between two passes that visit the same pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VarianceRatio {
    /// Mean variance in the second pass over that in the first.
    pub ratio: f64,
    /// Standard error of the logarithm of `ratio`.
    pub error: f64,
}

/// Fewest pixels of which the ratio's error is told: of n it is itself uncertain by a part of √(1/2n) or more.
const FEWEST_PAIRS: usize = 10;

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

    /// Both pixels' samples together (Chan, Golub and LeVeque 1979).
    fn merged(&self, other: &Self) -> Self {
        let (a, b) = (f64::from(self.count), f64::from(other.count));
        if a + b == 0.0 {
            return *self;
        }
        let between = |c: usize| other.mean[c] - self.mean[c];
        Self {
            mean: [0, 1, 2].map(|c| self.mean[c] + between(c) * (b / (a + b))),
            spread: [0, 1, 2].map(|c| self.spread[c] + other.spread[c] + between(c).powi(2) * (a * b / (a + b))),
            count: self.count + other.count,
        }
    }

    /// Unbiased variance of one sample per channel; `None` below two samples.
    pub fn sample_variance(&self) -> Option<[f64; 3]> {
        (self.count >= 2).then(|| self.spread.map(|s| s / f64::from(self.count - 1)))
    }
}

/// The samples of one pass over the picture, in two halves of which each can judge the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    width: usize,
    halves: [Vec<Pixel>; 2],
    /// The samples of each half by brightness, where someone asks for that.
    cascades: Option<[Cascade; 2]>,
}

impl Pass {
    /// A pass without samples.
    pub fn new(width: usize, height: usize) -> Self {
        let half = vec![Pixel::default(); width * height];
        Self { width, halves: [half.clone(), half], cascades: None }
    }

    /// One that also keeps its samples by brightness.
    pub fn with_cascades(width: usize, height: usize) -> Self {
        let cascade = Cascade::new(width * height);
        Self { cascades: Some([cascade.clone(), cascade]), ..Self::new(width, height) }
    }

    /// The samples of each half by brightness; none where they were not kept.
    pub fn cascades(&self) -> Option<&[Cascade; 2]> {
        self.cascades.as_ref()
    }

    /// Takes all samples out again.
    pub fn clear(&mut self) {
        self.cascades.iter_mut().flatten().for_each(Cascade::clear);
        self.halves.iter_mut().for_each(|half| half.par_iter_mut().for_each(|pixel| *pixel = Pixel::default()));
    }

    /// Adds sample number `sample` of pixel `pixel`, counted row by row from the top left; it must be finite. Each pixel's
    /// samples must come in a fixed order.
    pub fn add(&mut self, pixel: usize, sample: u64, value: Vec3) {
        let half = (sample % 2) as usize;
        self.halves[half][pixel].add(value);
        if let Some(cascades) = &mut self.cascades {
            cascades[half].add(pixel, value);
        }
    }

    /// Columns.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.halves.iter().flatten().map(|pixel| u64::from(pixel.count)).sum()
    }

    /// Both halves of each pixel.
    pub(super) fn both(&self) -> impl Iterator<Item = [&Pixel; 2]> + '_ {
        self.halves[0].iter().zip(&self.halves[1]).map(|(a, b)| [a, b])
    }

    /// The pixels with the samples of both halves.
    pub(super) fn pixels(&self) -> impl Iterator<Item = Pixel> + '_ {
        self.both().map(|[a, b]| a.merged(b))
    }

    /// Estimated relMSE (against the truth) of a picture with one sample per pixel: mean over pixels and channels of the sample
    /// variance over m² + 0.01, where m is the mean of the 3 × 3 pixels around, since a pixel's own mean follows its samples:
    /// the pixels that are too bright by chance would hide their error. 0 where no pixel has two samples. The largest, where the pass is
    /// of a sheet of several `views`.
    pub fn relative_variance(&self, views: usize) -> f64 {
        let pixels: Vec<Pixel> = self.pixels().collect();
        let of_view = |view: &[Pixel]| self.relative_variance_of(view);
        pixels.chunks((pixels.len() / views.max(1)).max(1)).map(of_view).fold(0.0, f64::max)
    }

    fn relative_variance_of(&self, pixels: &[Pixel]) -> f64 {
        let height = pixels.len().checked_div(self.width).unwrap_or(0);
        let mut sum = 0.0;
        let mut measured = 0u64;
        for (i, pixel) in pixels.iter().enumerate() {
            let Some(variance) = pixel.sample_variance() else { continue };
            let (x, y) = (i % self.width, i / self.width);
            let columns = x.saturating_sub(1)..(x + 2).min(self.width);
            let around = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|row| columns.clone().map(move |column| row * self.width + column));
            let (mut mean, mut count) = ([0.0; 3], 0.0);
            for neighbour in around.filter(|&neighbour| pixels[neighbour].count > 0) {
                mean.iter_mut().zip(pixels[neighbour].mean).for_each(|(m, x)| *m += x);
                count += 1.0;
            }
            measured += 1;
            sum += average([0, 1, 2].map(|c| variance[c] / ((mean[c] / count).powi(2) + FLOOR)));
        }
        if measured > 0 { sum / measured as f64 } else { 0.0 }
    }

    /// Variance of one sample over the squared value that the pixel is expected to have, `values` or 1: the mean over channels and all
    /// pixels but the worst 0.1 %, which trimmed errors leave out too; `None` where no pixel has two samples.
    pub fn variance_relative_to(&self, values: Option<&[f32]>) -> Option<f64> {
        let mut variances: Vec<f64> = self.variances(values).flatten().collect();
        let worst = outliers(variances.len());
        trimmed_mean(&mut variances, worst)
    }

    /// Variances as in [`variance_relative_to`](Self::variance_relative_to) of every pixel that has two samples.
    fn variances<'a>(&'a self, values: Option<&'a [f32]>) -> impl Iterator<Item = Option<f64>> + 'a {
        self.pixels().enumerate().map(move |(i, pixel)| {
            let variance = average(pixel.sample_variance()?);
            Some(variance / values.map_or(1.0, |v| f64::from(v[i]).powi(2)))
        })
    }

    /// How variances as in [`variance_relative_to`](Self::variance_relative_to) differ in `other`, without the pixels that are worst in both
    /// together. Its error is that of a ratio of sums of pairs (Cochran 1977 §6.5): that some pixels vary more than others in both passes says
    /// nothing against it. `None` where a pass has no variance, or fewer than ten pixels say how far it may be off.
    pub fn variance_ratio(&self, other: &Self, values: Option<&[f32]>) -> Option<VarianceRatio> {
        let mut pairs: Vec<[f64; 2]> =
            self.variances(values).zip(other.variances(values)).filter_map(|(a, b)| Some([a?, b?])).collect();
        let sums = |pairs: &[[f64; 2]]| [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f64>());
        let kept = pairs.len() - outliers(pairs.len());
        if kept < FEWEST_PAIRS {
            return None;
        }
        // Parts of both sums: whichever pass varies more, its pixels are left out no sooner.
        let [first, second] = sums(&pairs);
        let part = |[a, b]: &[f64; 2]| a / first + b / second;
        if kept < pairs.len() {
            pairs.select_nth_unstable_by(kept, |a, b| part(a).total_cmp(&part(b)));
            pairs.truncate(kept);
        }
        let [first, second] = sums(&pairs);
        let count = pairs.len() as f64;
        let differences: f64 = pairs.iter().map(|[a, b]| (b / second - a / first).powi(2)).sum();
        let error = (differences * count / (count - 1.0)).sqrt();
        Some(VarianceRatio { ratio: second / first, error }).filter(|of| of.ratio > 0.0 && of.error.is_finite())
    }

    /// Reduces the pass to what combining needs: the means in f32, the counts, and the variances.
    pub fn finish(&self) -> FinishedPass {
        FinishedPass { cascades: self.cascades.clone(), ..self.finish_plain() }
    }

    /// The same without the samples by brightness, for pictures on the way.
    pub fn finish_plain(&self) -> FinishedPass {
        let half = |half: &Vec<Pixel>| Half {
            means: half.par_iter().map(|p| Vec3::from_array(p.mean.map(|m| m as f32))).collect(),
            counts: half.par_iter().map(|p| p.count).collect(),
            tiles: tiles(half, self.width),
        };
        let [a, b] = &self.halves;
        let (spread, (a, b)) = rayon::join(|| Spread::of(self.pixels()), || rayon::join(|| half(a), || half(b)));
        FinishedPass { width: self.width, halves: [a, b], spread, variance: Vec::new(), cascades: None }
    }

    /// The same with the variance of each pixel's samples, for [`pixel_spread`](super::pixel_spread).
    pub fn finish_with_variance(&self) -> FinishedPass {
        let [first, second] = &self.halves;
        let variance = |(a, b): (&Pixel, &Pixel)| {
            a.merged(b).sample_variance().map_or(Vec3::NAN, |v| DVec3::from_array(v).as_vec3())
        };
        let variance = first.par_iter().zip(second).map(variance).collect();
        FinishedPass { variance, ..self.finish() }
    }
}

/// Pooled deviations of the samples of many pixels from their pixels' means.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Spread {
    /// Degrees of freedom and sum of squared deviations over all pixels, averaged over channels.
    freedom: u64,
    sum: f64,
}

impl Spread {
    fn of(pixels: impl Iterator<Item = Pixel>) -> Self {
        let mut spread = Self::default();
        pixels.filter(|pixel| pixel.count > 0).for_each(|pixel| {
            spread.freedom += u64::from(pixel.count - 1);
            spread.sum += average(pixel.spread);
        });
        spread
    }

    fn merge(&mut self, other: &Self) {
        self.freedom += other.freedom;
        self.sum += other.sum;
    }

    /// Variance of one sample, pooled over the pixels; none where no pixel has two samples.
    fn variance(&self) -> Option<f64> {
        (self.freedom > 0).then(|| self.sum / self.freedom as f64)
    }
}

/// Side in pixels of the squares of which each has weights of its own.
const TILE: usize = 16;

/// Pooled spread of each tile of a picture together with the tiles around it; row by row.
fn tiles(pixels: &[Pixel], width: usize) -> Vec<Spread> {
    let height = pixels.len().checked_div(width).unwrap_or(0);
    let [columns, rows] = [width, height].map(|size| size.div_ceil(TILE));
    let reach = |tile: usize, size: usize| tile * TILE..((tile + 1) * TILE).min(size);
    let alone = |tile: usize| {
        let across = reach(tile % columns, width);
        Spread::of(reach(tile / columns, height).flat_map(|y| pixels[y * width..][across.clone()].iter().copied()))
    };
    let alone: Vec<Spread> = (0..columns * rows).into_par_iter().map(alone).collect();
    let near = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
    let around = |tile: usize| {
        let mut spread = Spread::default();
        for y in near(tile / columns, rows) {
            near(tile % columns, columns).for_each(|x| spread.merge(&alone[y * columns + x]));
        }
        spread
    };
    (0..alone.len()).map(around).collect()
}

/// Mean of the channels.
pub(super) fn average(channels: [f64; 3]) -> f64 {
    channels.iter().sum::<f64>() / 3.0
}

/// A pass that gets no more samples.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedPass {
    width: usize,
    halves: [Half; 2],
    spread: Spread,
    /// Variance of one sample of each pixel, NaN below two samples; empty where it was not asked for.
    pub(super) variance: Vec<Vec3>,
    /// The samples of each half by brightness; none where they were not kept.
    pub(super) cascades: Option<[Cascade; 2]>,
}

/// One half of a finished pass: its even or its odd samples.
#[derive(Debug, Clone, PartialEq)]
struct Half {
    means: Vec<Vec3>,
    counts: Vec<u32>,
    tiles: Vec<Spread>,
}

impl Half {
    /// Samples of all pixels together.
    fn samples(&self) -> u64 {
        self.counts.iter().map(|&c| u64::from(c)).sum()
    }
}

impl FinishedPass {
    /// Samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.halves.iter().map(Half::samples).sum()
    }

    /// Samples of one pixel in one half.
    pub(super) fn count(&self, half: usize, pixel: usize) -> u32 {
        self.halves[half].counts[pixel]
    }

    /// Mean of one pixel's samples in one half.
    pub(super) fn mean(&self, half: usize, pixel: usize) -> Vec3 {
        self.halves[half].means[pixel]
    }

    /// Variance of one sample, averaged over channels and pixels; `None` below two samples.
    pub fn sample_variance(&self) -> Option<f64> {
        self.spread.variance()
    }
}

/// The weights of a sample in one half of each pass, in each tile: over the variance of a sample. With a pixel's number of samples they
/// are the precision of its mean.
///
/// Later passes are guided by more than earlier ones, so none is believed to be worse: where fewer samples have missed rare light,
/// their variance looks far too small. At worst all samples count alike. So they do where the last passes are without variance.
pub(super) fn weights<P: Borrow<FinishedPass> + Sync>(passes: &[P], half: usize) -> Vec<Vec<f64>> {
    let tiles = passes.first().map_or(0, |pass| pass.borrow().halves[half].tiles.len());
    let tile = |tile: usize| {
        let mut variance = 0.0f64;
        let mut weights = vec![1.0; passes.len()];
        for (weight, half) in weights.iter_mut().zip(passes.iter().map(|pass| &pass.borrow().halves[half])).rev() {
            variance = variance.max(half.tiles[tile].variance().unwrap_or(0.0));
            *weight /= variance;
        }
        if weights.iter().any(|w| !w.is_finite()) {
            weights.fill(1.0);
        }
        weights
    };
    (0..tiles).into_par_iter().map(tile).collect()
}

/// Combines passes into a picture. A pixel without samples in a pass leaves that pass out; one without samples in any has
/// the value of the nearest pixel above or below that has some, and is black where there is none within [`REACH`] rows.
///
/// Each half of the passes is weighted by what the *other* half measured. With weights of their own samples, passes with a firefly
/// would count less, and pictures be too dark by what fireflies carry: 4 % in a furnace of 64 pixels, less in larger ones.
///
/// # Errors
/// [`Error::Options`] where passes differ in size or there is none.
pub fn combine<P: Borrow<FinishedPass> + Sync>(passes: &[P]) -> Result<Image> {
    combine_sheet(passes, 1)
}

/// [`combine`] for passes over a sheet of several `views`, none of which shows what another one sees.
///
/// # Errors
/// As [`combine`].
pub fn combine_sheet<P: Borrow<FinishedPass> + Sync>(passes: &[P], views: usize) -> Result<Image> {
    check_alike(passes)?;
    if passes.len() == 1 {
        // Then no pixel depends on its tile, so that a window of a picture is what it is in the whole.
        return mixed(passes, views, |_, _, _, _| 1.0);
    }
    let by_other = [1, 0].map(|other| weights(passes, other));
    mixed(passes, views, |half, tile, pass, samples| by_other[half][tile][pass] * f64::from(samples))
}

/// [`combine_sheet`] with given weights, for passes whose sample counts were decided by the samples of others.
///
/// # Errors
/// As [`combine`].
pub fn combine_weighted(passes: &[FinishedPass], weights: &[f64], views: usize) -> Result<Image> {
    mixed(passes, views, |_, _, pass, _| weights[pass])
}

/// Number of columns and of pixels, which must be the same for all passes.
pub(super) fn check_alike<P: Borrow<FinishedPass>>(passes: &[P]) -> Result<[usize; 2]> {
    let mut passes = passes.iter().map(P::borrow);
    let first = passes.next().ok_or_else(|| Error::Options("no pass was rendered, so there is no picture".into()))?;
    let size = |pass: &FinishedPass| [pass.width, pass.halves[0].means.len()];
    if passes.any(|pass| size(pass) != size(first)) {
        return Err(Error::Options("passes of different sizes cannot be combined".into()));
    }
    Ok(size(first))
}

/// The tile of a pixel in a picture of so many columns.
pub(super) fn tile_of(pixel: usize, width: usize) -> usize {
    pixel / width / TILE * width.div_ceil(TILE) + pixel % width / TILE
}

/// Combines passes half by half, with the `weight` of half, tile, pass and number of the pixel's samples there; halves count by their
/// samples.
fn mixed<P: Borrow<FinishedPass> + Sync>(
    passes: &[P],
    views: usize,
    weight: impl Fn(usize, usize, usize, u32) -> f64 + Sync,
) -> Result<Image> {
    let [width, pixels] = check_alike(passes)?;
    let pixel = |i: usize| {
        let (mut sum, mut samples) = (DVec3::ZERO, 0.0);
        let tile = tile_of(i, width);
        for half in 0..2 {
            let (mut mean, mut total, mut count) = (DVec3::ZERO, 0.0, 0.0);
            let sampled =
                passes.iter().map(|pass| &pass.borrow().halves[half]).enumerate().filter(|(_, p)| p.counts[i] > 0);
            for (number, pass) in sampled {
                let weight = weight(half, tile, number, pass.counts[i]);
                total += weight;
                count += f64::from(pass.counts[i]);
                mean += pass.means[i].as_dvec3() * weight;
            }
            if total > 0.0 {
                sum += mean * (count / total);
                samples += count;
            }
        }
        (samples > 0.0).then(|| (sum / samples).as_vec3())
    };
    let sampled: Vec<Option<Vec3>> = (0..pixels).into_par_iter().map(pixel).collect();
    let filled = sampled.chunks((pixels / views.max(1)).max(1)).flat_map(|view| filled(view, width));
    Ok(Image { width, height: pixels.checked_div(width).unwrap_or(0), pixels: filled.collect() })
}

/// The number of a pixel's samples in one half of one pass, and the part that each of them has in the picture.
pub(super) struct Weighted {
    pub half: usize,
    pub pass: usize,
    pub count: u32,
    pub weight: f64,
}

/// By pixel, what single samples weigh in the picture of some passes, or with `fixed` weights of passes if they are given: 1 all together.
/// Passes must be alike, see [`combine`].
pub(super) fn sample_weights<'a>(
    passes: &'a [FinishedPass],
    fixed: Option<&'a [f64]>,
) -> impl Fn(usize) -> Vec<Weighted> + Sync + 'a {
    let by_tile = if passes.len() > 1 && fixed.is_none() {
        [1, 0].map(|other| weights(passes, other))
    } else {
        Default::default()
    };
    let width = passes.first().map_or(1, |pass| pass.width);
    move |i| {
        let (mut all, mut samples) = (Vec::new(), 0.0);
        for (half, by_tile) in by_tile.iter().enumerate() {
            let of_tile = by_tile.get(tile_of(i, width));
            let weight = |pass: usize, count: u32| match fixed {
                Some(fixed) => fixed[pass],
                None => of_tile.map_or(1.0, |tile| tile[pass]) * f64::from(count),
            };
            let counts = || passes.iter().map(|pass| pass.halves[half].counts[i]).enumerate();
            let sampled = || counts().filter(|(_, count)| *count > 0);
            let total: f64 = sampled().map(|(pass, count)| weight(pass, count)).sum();
            if total > 0.0 {
                let of_half: f64 = sampled().map(|(_, count)| f64::from(count)).sum();
                samples += of_half;
                let each = |(pass, count)| weight(pass, count) / total * of_half / f64::from(count);
                all.extend(sampled().map(|(pass, count)| Weighted { half, pass, count, weight: each((pass, count)) }));
            }
        }
        all.iter_mut().for_each(|sample| sample.weight /= samples);
        all
    }
}

/// Most rows between a pixel without samples and the one whose value it takes.
const REACH: usize = 32;

/// Values of all pixels of a picture of so many columns; those without take that of a pixel above or below.
pub(super) fn filled(sampled: &[Option<Vec3>], width: usize) -> Vec<Vec3> {
    let near = |i: usize| {
        let rows = (1..=REACH).flat_map(|d| [i.checked_sub(d * width), Some(i + d * width)]);
        rows.flatten().find_map(|at| sampled.get(at).copied().flatten())
    };
    sampled.par_iter().enumerate().map(|(i, own)| own.or_else(|| near(i)).unwrap_or(Vec3::ZERO)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn pass(spp: u32, mut value: impl FnMut(usize) -> f32) -> FinishedPass {
        let mut pass = Pass::new(4, 4);
        for sample in 0..u64::from(spp) {
            (0..16).for_each(|i| pass.add(i, sample, Vec3::splat(value(i))));
        }
        pass.finish()
    }

    #[test]
    fn variances_leave_the_worst_pixels_out() {
        let of = |spread: fn(usize) -> f32| varying(spread).variance_relative_to(Some(&[2.0; 64 * 64]));
        // Samples 1 and 3 have the variance 2, a half of the square of 2; four pixels are left out.
        assert_eq!(of(|_| 2.0), Some(0.5));
        assert_eq!(of(|i| if i < 4 { 1e9 } else { 0.0 }), Some(0.0));
        assert_eq!(Pass::new(4, 4).variance_relative_to(None), None);
    }

    /// Two samples in each of 64 × 64 pixels that differ by `spread`; none where that is no number.
    fn varying(spread: impl Fn(usize) -> f32) -> Pass {
        let mut pass = Pass::new(64, 64);
        for sample in [0, 1] {
            let values = (0..64 * 64).map(|i| (i, 1.0 + sample as f32 * spread(i)));
            values
                .filter(|(_, value)| value.is_finite())
                .for_each(|(i, value)| pass.add(i, sample, Vec3::splat(value)));
        }
        pass
    }

    #[test]
    fn variances_are_compared_pixel_by_pixel() {
        let ratio = |a: fn(usize) -> f32, b: fn(usize) -> f32| varying(a).variance_ratio(&varying(b), None);
        // Where both vary alike from pixel to pixel nothing is uncertain.
        let alike = ratio(|i| (i % 7) as f32, |i| 2.0 * (i % 7) as f32).expect("variances");
        assert!((alike.ratio - 4.0).abs() < 1e-9 && alike.error < 1e-9, "{alike:?}");
        // 16 pixels of one and 16 others of the other, 4 of which are left out.
        let apart = ratio(|i| if i % 256 == 0 { 1.0 } else { 0.0 }, |i| if i % 256 == 1 { 1.0 } else { 0.0 });
        let VarianceRatio { ratio: found, error } = apart.expect("variances");
        assert!((0.7..1.4).contains(&found) && (error - (1.0 / 14.0 + 1.0 / 14.0f64).sqrt()).abs() < 0.02, "{apart:?}");
        // Bright pixels of either are left out of both.
        let bright = ratio(|i| if i < 2 { 1e9 } else { 1.0 }, |i| if i > 4093 { 1e9 } else { 1.0 });
        assert!(bright.is_some_and(|of| (of.ratio - 1.0).abs() < 1e-9), "{bright:?}");
        assert_eq!(ratio(|_| 0.0, |_| 1.0), None);
        assert_eq!(ratio(|_| 1.0, |_| 0.0), None);
        let few = |pixels: usize| {
            let pass = |bright: usize| varying(|i| if i < pixels { (i % bright) as f32 } else { f32::NAN });
            pass(2).variance_ratio(&pass(3), None)
        };
        assert_eq!(Pass::new(4, 4).variance_ratio(&Pass::new(4, 4), None), None);
        assert!(few(9).is_none() && few(12).is_some(), "nine pixels may agree by chance");
    }

    /// Of pixels whose variances spread over four powers of ten the error says how far ratios of repetitions are from one another.
    #[test]
    fn errors_of_ratios_are_those_of_repetitions() {
        let mut random = Random::new(3, 0, 0);
        let mut pass = |scale: f32| {
            let mut pass = Pass::new(40, 40);
            for sample in 0..2 {
                for i in 0..40 * 40 {
                    let size = 10f32.powf((i % 40) as f32 / 10.0) * scale;
                    pass.add(i, sample, Vec3::splat(size * (random.next_f32() + random.next_f32())));
                }
            }
            pass
        };
        let found: Vec<VarianceRatio> =
            (0..200).map(|_| pass(1.0).variance_ratio(&pass(2.0), None).expect("variances")).collect();
        let logs = || found.iter().map(|of| of.ratio.ln());
        let mean = logs().sum::<f64>() / 200.0;
        let spread = (logs().map(|log| (log - mean).powi(2)).sum::<f64>() / 199.0).sqrt();
        let told = found.iter().map(|of| of.error).sum::<f64>() / 200.0;
        // Three standard errors of 200 logarithms and of their spread: 0.3 % of right code would fail either.
        assert!((mean - 4f64.ln()).abs() < 3.0 * spread / 200f64.sqrt(), "{mean}");
        assert!((told / spread - 1.0).abs() < 0.15 + 0.05, "{told} {spread}");
    }

    #[test]
    fn gaps_take_the_nearest_row() {
        let mut pass = Pass::new(1, 100);
        (0..40).step_by(8).for_each(|row| pass.add(row, 0, Vec3::splat(row as f32)));
        let rows: Vec<f32> = combine(&[pass.finish()]).unwrap().pixels.iter().map(|p| p.x).collect();
        assert_eq!((rows[3], rows[5], rows[8], rows[64], rows[65]), (0.0, 8.0, 8.0, 32.0, 0.0));
        // Not that of another view, of which the second begins at row 50 and has no samples.
        let sheet = combine_sheet(&[pass.finish()], 2).unwrap();
        assert!(sheet.pixels[49].x == 32.0 && sheet.pixels[50..].iter().all(|p| p.x == 0.0));
    }

    fn noise(seed: u64, width: f32) -> impl FnMut(usize) -> f32 {
        let mut random = Random::new(seed, 0, 0);
        move |_| 1.0 + width * (random.next_f32() - 0.5)
    }

    /// Weights of the samples of each pass in a picture's first tile, as parts of 1.
    fn shares(passes: &[FinishedPass], half: usize) -> Vec<f64> {
        let samples = passes.iter().map(|pass| pass.samples() as f64);
        let all: Vec<f64> =
            weights(passes, half)[0].iter().zip(samples).map(|(weight, samples)| weight * samples).collect();
        let total: f64 = all.iter().sum();
        all.iter().map(|w| w / total).collect()
    }

    #[test]
    fn places_that_learning_does_not_change_lose_no_samples() {
        let mut random = Random::new(5, 0, 0);
        // Rare light on the left, which the second pass finds often.
        let mut pass = |probability: f32| {
            let mut pass = Pass::new(5 * TILE, TILE);
            for sample in 0..64 {
                for pixel in 0..5 * TILE * TILE {
                    let rare = pixel % (5 * TILE) < TILE && random.next_f32() < probability;
                    let value = random.next_f32() + if rare { 1.0 / probability } else { 0.0 };
                    pass.add(pixel, sample, Vec3::splat(value));
                }
            }
            pass.finish()
        };
        let passes = [pass(0.01), pass(0.5)];
        let weights = weights(&passes, 0);
        let share = |tile: usize| weights[tile][0] / weights[tile].iter().sum::<f64>();
        assert!(share(0) < 0.03 && share(1) < 0.03, "{} {}", share(0), share(1));
        assert!((2..5).all(|tile| (share(tile) - 0.5).abs() < 0.01), "{weights:?}");
    }

    /// docs/stability.md, A16: an f32 sum of 1e6 values of 0.1 is off by 1 %.
    #[test]
    fn a16_mean_of_a_million_samples_is_exact() {
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

    /// docs/stability.md, A13: no division by a variance of 0; the result is the plain mean.
    #[test]
    fn a13_zero_variance_falls_back_to_the_plain_mean() {
        let constant = [pass(2, |_| 1.0), pass(6, |_| 3.0)];
        let picture = combine(&constant).unwrap();
        assert!(picture.pixels.iter().all(|p| (p.x - 2.5).abs() < 1e-6));
        let black = [pass(4, |_| 0.0), pass(8, noise(1, 1.0))];
        assert_eq!(shares(&black, 0), [4.0 / 12.0, 8.0 / 12.0], "few samples that found nothing");
        let dark = [pass(4, noise(1, 1.0)), pass(8, |_| 0.0)];
        assert_eq!(shares(&dark, 0), [4.0 / 12.0, 8.0 / 12.0]);
        assert!(combine(&black).unwrap().pixels.iter().all(|p| p.is_finite()));
    }

    #[test]
    fn weight_is_the_inverse_variance() {
        let passes = [pass(4096, noise(1, 1.0)), pass(1024, noise(2, 0.25))];
        let weights = shares(&passes, 1);
        // Variances 1/12/4096 and 1/16/12/1024: a ratio of 4.
        assert!((weights[1] / weights[0] / 4.0 - 1.0).abs() < 0.05, "{weights:?}");
    }

    #[test]
    fn one_sample_per_pixel_gets_the_pooled_variance() {
        let passes = [pass(2, noise(1, 1.0)), pass(510, noise(2, 1.0))];
        let weights = shares(&passes, 0);
        assert!((weights[0] * 256.0 - 1.0).abs() < 0.05, "{weights:?}");
        let alone = [pass(1, noise(1, 1.0)), pass(1, noise(2, 1.0))];
        assert_eq!([0, 1].map(|half| shares(&alone, half)), [[0.5, 0.5]; 2]);
        assert!(combine(&alone).unwrap().pixels.iter().all(|p| p.x > 0.0), "the other half is empty");
    }

    #[test]
    fn pixel_without_samples_leaves_its_pass_out() {
        let mut holed = Pass::new(2, 1);
        holed.add(0, 0, Vec3::ONE);
        let mut full = Pass::new(2, 1);
        (0..2).for_each(|i| full.add(i, 0, Vec3::splat(3.0)));
        let picture = combine(&[holed.finish(), full.finish()]).unwrap();
        assert_eq!(picture.pixels[1], Vec3::splat(3.0));
        assert_eq!(combine(&[Pass::new(1, 1).finish()]).unwrap().pixels, [Vec3::ZERO]);
        let sizes = [Pass::new(1, 1), Pass::new(40, 40)];
        for order in [[0, 1], [1, 0]] {
            assert!(matches!(combine(&order.map(|i: usize| sizes[i].finish())), Err(Error::Options(_))));
        }
        assert_eq!(combine(&[Pass::new(0, 0).finish()]).unwrap().pixels, []);
    }

    /// Passes of 8 samples of which one in 40 is 40 times as bright: the mean over 20,000 pictures of 3 passes is that of the
    /// samples within five standard errors (1.3 %). Weights by the passes' own variances lose a third of the light here.
    #[test]
    fn fireflies_are_not_weighted_away() {
        let mut random = Random::new(3, 0, 0);
        let n = 20_000;
        let mut means = Vec::with_capacity(n);
        for _ in 0..n {
            let mut pass = || {
                let mut pass = Pass::new(1, 1);
                for sample in 0..8 {
                    let bright = random.next_f32() < 0.025;
                    pass.add(0, sample, Vec3::splat(if bright { 40.0 } else { random.next_f32() }));
                }
                pass.finish()
            };
            let passes = [pass(), pass(), pass()];
            means.push(f64::from(combine(&passes).unwrap().pixels[0].x));
        }
        let mean = means.iter().sum::<f64>() / n as f64;
        let error = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * n) as f64).sqrt();
        let expected = 0.025 * 40.0 + 0.975 * 0.5;
        assert!(error < 0.01 * expected, "{error}");
        assert!((mean - expected).abs() < 5.0 * error, "{mean} ± {error} instead of {expected}");
    }

    #[test]
    fn absurd_sizes_are_refused() {
        assert!(check_size(1, 1).is_ok());
        for (width, height) in [(0, 4), (4, 0), (MAX_SIDE + 1, 1), (MAX_SIDE, MAX_SIDE), (u32::MAX, u32::MAX)] {
            assert!(matches!(check_size(width, height), Err(Error::Options(_))), "{width}x{height}");
        }
    }
}
