//! Fireflies: samples so bright and so rare that they stand alone, taken out of a finished picture by their density (after Zirr, Hanika and
//! Dachsbacher 2018, *Re-weighting Firefly Samples for Improved Finite-Sample Monte Carlo Estimates*).
//!
//! The samples of each pixel are known by level of brightness ([`Cascade`]). From the darkest level up, what a pixel has of a level is kept in so
//! far as one of two reasons is there to believe it:
//!
//! - **Company**: n samples of this level and its two neighbours in the 3 × 3 pixels around, the pixel included: (n − 1) / κ.
//! - **It does not matter**: the light that the pixel has kept of darker levels, over what a sample of this level adds: E · N / (κ b), of N samples
//!   of brightness b. E is not taken to be less than a twentieth of what pixels of the picture have on the whole.
//!
//! Half of the sum of both, 1 at most, is the part that is kept. A sample without company whose light is small beside the pixel's stays what it is;
//! one that is the pixel's light is taken out. With κ more samples are asked for: 1 + 2 κ of them always keep their light.
//!
//! The result is biased: what is taken out is missing. With more samples all levels that have any density get company, and the part that is taken
//! out goes to 0. What is taken out is at most what there is, so that both together are the plain picture.
//!
//! In passes of which each has a weight of its own, a sample is what it brings to the picture: N is the number of samples of the same weight that
//! would have as much noise (Kish 1965), and so one sample of a pass that counts little is less than one.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::accumulator::{FinishedPass, Summed, filled, sample_weights};
use super::cascade::{BASE, Cascade, Layer, brightness, brightness_of};
use super::error::outliers;
use crate::math::{channel_mean, trimmed_mean};
use crate::picture::Image;

/// What light of pixels is not taken to be less than, over the mean of the picture (Zirr 2018: 0.05 at an exposure that suits the picture).
const LEAST: f64 = 0.05;
/// Rows that are judged together: what they are made of is found out once, that of the rows beside them twice.
const STRIPE: usize = 16;
/// Pixels around one.
const NEIGHBOURS: f64 = 8.0;

/// What a pixel's value is made of at one level.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    level: u8,
    /// Its part of the value.
    light: DVec3,
    /// Number of samples.
    count: f64,
}

/// What a pixel's value is made of.
#[derive(Debug, Clone, Default, PartialEq)]
struct Value {
    /// Number of samples.
    samples: f64,
    /// Brightness of the whole, by which the light of levels that hold no more is known; 0 where nothing else tells of it.
    whole: f64,
    /// In ascending order of levels.
    parts: Vec<Part>,
}

impl Value {
    /// Of samples that have the same weight.
    fn of_sum(layers: impl Iterator<Item = Layer>, samples: u32) -> Self {
        let mut value = Self { samples: f64::from(samples), ..Self::default() };
        layers.for_each(|layer| value.add(layer, 1.0 / value.samples));
        value
    }

    /// Adds samples of one level, each of which is weighted by `weight`.
    fn add(&mut self, Layer { level, sum, is_full }: Layer, weight: f64) {
        let at = self.parts.partition_point(|part| part.level < level);
        if self.parts.get(at).is_none_or(|part| part.level != level) {
            self.parts.insert(at, Part { level, light: DVec3::ZERO, count: 0.0 });
        }
        let (part, light) = (&mut self.parts[at], sum * weight);
        part.light += light;
        part.count += if is_full { f64::INFINITY } else { self.samples * brightness(light) / brightness_of(level) };
    }

    /// Samples of a level and its neighbours.
    fn near(&self, level: u8) -> f64 {
        self.parts.iter().filter(|part| part.level.abs_diff(level) <= 1).map(|part| part.count).sum()
    }

    /// The parts with the share of each that is kept, where there are `company` samples near a level in the 3 × 3 pixels around, and light
    /// of `least` never matters.
    fn shares(&self, kappa: f64, least: f64, company: impl Fn(u8) -> f64) -> impl Iterator<Item = (&Part, f64)> {
        let mut kept = DVec3::ZERO;
        // What has been taken out, and what is at least as bright; and whether a darker level holds less than there was.
        let (mut taken, mut rest) = (0.0, self.parts.iter().map(|part| brightness(part.light)).sum::<f64>());
        let mut lacks = false;
        self.parts.iter().map(move |part| {
            let believed = (company(part.level) - 1.0) / kappa;
            let darker = if lacks { brightness(kept).max(self.whole - rest - taken) } else { brightness(kept) };
            let small = darker.max(least) * self.samples / (kappa * brightness_of(part.level));
            let share = (0.5 * (believed + small)).clamp(0.0, 1.0);
            kept += part.light * share;
            taken += brightness(part.light) * (1.0 - share);
            rest -= brightness(part.light);
            lacks |= part.count.is_infinite();
            (part, share)
        })
    }

    /// The light that is taken out.
    fn taken(&self, kappa: f64, least: f64, company: impl Fn(u8) -> f64) -> DVec3 {
        self.shares(kappa, least, company).map(|(part, share)| part.light * (1.0 - share)).sum()
    }
}

/// Judges single samples of a picture by its samples of like brightness, as [`taken_from_sum`] does the light of pixels: which of them are
/// fireflies is known while there is no picture yet.
pub struct Judge<'a> {
    /// The samples so far, of pixels or larger cells.
    pub cascade: &'a Cascade,
    /// Columns and rows of cells.
    pub size: [usize; 2],
    /// Samples of each cell, about; above 0.
    pub samples: f64,
    /// See [`taken_from_sum`].
    pub kappa: f64,
    /// Mean of the samples' brightness.
    pub mean: f64,
}

impl Judge<'_> {
    /// The share of the light of a sample in a cell that is believed, in [0, 1].
    pub fn believed(&self, cell: usize, value: Vec3) -> f64 {
        let [width, height] = self.size;
        let (x, y) = (cell % width, cell / width);
        let of = |cell: usize| {
            let mut value = Value { samples: self.samples, ..Value::default() };
            self.cascade.layers(cell).for_each(|layer| value.add(layer, 1.0 / self.samples));
            value
        };
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let around: Vec<Value> = rows.flat_map(|row| columns.clone().map(move |x| row * width + x)).map(of).collect();
        let company = |level: u8| around.iter().map(|value| value.near(level)).sum::<f64>();
        let own = of(cell);
        let light = brightness(value.as_dvec3());
        // A sample between two levels is that of the brighter one, which fewer are of.
        let shares = own.shares(self.kappa, LEAST * self.mean, company);
        shares.filter(|(part, _)| brightness_of(part.level) < BASE * light).last().map_or(1.0, |(_, share)| share)
    }
}

/// The light that is taken out of a view of so many columns, pixel by pixel; none for pixels without samples. `value` tells of its pixels, and
/// `least` is light that never matters.
fn taken_from_view(
    [width, height]: [usize; 2],
    kappa: f64,
    least: f64,
    value: impl Fn(usize) -> Option<Value> + Sync,
) -> Vec<Option<Vec3>> {
    let around = |y: usize| y.saturating_sub(1)..(y + 2).min(height);
    let row = |y: usize, rows: &[Vec<Option<Value>>]| {
        let own = &rows[y.min(1)];
        let pixel = |x: usize| {
            let own = own[x].as_ref()?;
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let around = || rows.iter().flat_map(|row| &row[columns.clone()]).flatten();
            let neighbours = around().count() as f64 - 1.0;
            let company = |level: u8| {
                let alone = own.near(level);
                let others: f64 = around().filter(|other| !std::ptr::eq(*other, own)).map(|v| v.near(level)).sum();
                // At the edge of the picture as inside.
                alone + others * (NEIGHBOURS / neighbours.max(1.0))
            };
            Some(own.taken(kappa, least, company).as_vec3())
        };
        (0..width).map(pixel).collect::<Vec<_>>()
    };
    let stripe = |stripe: usize| {
        let own = stripe * STRIPE..((stripe + 1) * STRIPE).min(height);
        let first = around(own.start).start;
        let rows: Vec<Vec<Option<Value>>> =
            (first..around(own.end - 1).end).map(|row| (0..width).map(|x| value(row * width + x)).collect()).collect();
        own.flat_map(|y| row(y, &rows[around(y).start - first..around(y).end - first])).collect::<Vec<_>>()
    };
    (0..height.div_ceil(STRIPE)).into_par_iter().flat_map_iter(stripe).collect()
}

/// The light that is taken out of the picture `plain` on a sheet of several `views`. `value` tells of the sheet's pixels.
fn taken(plain: &Image, views: usize, kappa: f64, value: impl Fn(usize) -> Option<Value> + Sync) -> Image {
    let height = plain.height / views.max(1);
    let pixels = plain.width * height;
    let of_view = |(view, seen): (usize, &[Vec3])| {
        let mut all: Vec<f64> = seen.iter().map(|&pixel| f64::from(channel_mean(pixel))).collect();
        let worst = outliers(all.len());
        let least = LEAST * trimmed_mean(&mut all, worst).unwrap_or(0.0);
        let known = |i: usize| {
            let value = value(view * pixels + i)?;
            Some(Value { whole: f64::from(channel_mean(seen[i])), ..value })
        };
        let taken = taken_from_view([plain.width, height], kappa, least, known);
        filled(&taken, plain.width)
            .into_iter()
            .zip(seen)
            .map(|(taken, &seen)| taken.clamp(Vec3::ZERO, seen.max(Vec3::ZERO)))
            .collect::<Vec<_>>()
    };
    let pixels = plain.pixels.chunks_exact(pixels.max(1)).take(views).enumerate().flat_map(of_view).collect();
    Image { pixels, ..*plain }
}

/// The light that is taken out of the picture `plain` that [`combine_sheet`](super::combine_sheet) has made of passes over a sheet of several
/// `views`, or, where `fixed` weights are given, [`combine_weighted`](super::combine_weighted). `kappa` is above 0.
pub fn taken_from_passes(
    passes: &[FinishedPass],
    fixed: Option<&[f64]>,
    views: usize,
    plain: &Image,
    kappa: f64,
) -> Image {
    let weights = sample_weights(passes, fixed);
    let value = |i: usize| {
        let weights = weights(i);
        let squares: f64 = weights.iter().map(|of| f64::from(of.count) * of.weight * of.weight).sum();
        let mut value = Value { samples: 1.0 / squares, ..Value::default() };
        for of in &weights {
            let cascade = passes[of.pass].cascades.as_ref().map(|cascades| &cascades[of.half]);
            cascade.into_iter().flat_map(|cascade| cascade.layers(i)).for_each(|layer| value.add(layer, of.weight));
        }
        (squares > 0.0).then_some(value)
    };
    taken(plain, views, kappa, value)
}

/// The light that is taken out of the picture `plain` of a sum of samples, of which `cascade` tells how bright they are, on a sheet of several
/// `views`. `kappa` is above 0.
pub fn taken_from_sum(summed: &Summed, cascade: &Cascade, views: usize, plain: &Image, kappa: f64) -> Image {
    let counts = summed.counts();
    let value = |i: usize| (counts[i] > 0).then(|| Value::of_sum(cascade.layers(i), counts[i]));
    taken(plain, views, kappa, value)
}

/// The picture without the light that is taken out of it.
pub fn without(plain: &Image, taken: &Image) -> Image {
    let pixels = plain.pixels.iter().zip(&taken.pixels).map(|(&plain, &taken)| plain - taken).collect();
    Image { pixels, ..*plain }
}

#[cfg(test)]
mod tests {
    use super::super::accumulator::{Block, Pass, Sum, combine};
    use super::*;
    use crate::base::random::Random;

    const SIDE: usize = 9;
    const MIDDLE: usize = 4 * SIDE + 4;
    const KAPPA: f64 = 4.0;

    /// Samples between 0.5 and 1.5 in all pixels, or as `value` says by pixel and sample.
    fn pass(spp: u64, value: impl Fn(usize, u64) -> Option<f32>) -> Pass {
        let mut random = Random::new(5, 0, 0);
        let mut pass = Pass::with_cascades(SIDE, SIDE);
        for sample in 0..spp {
            for pixel in 0..SIDE * SIDE {
                let noise = 0.5 + random.next_f32();
                pass.add(pixel, sample, Vec3::new(1.0, 0.8, 0.6) * value(pixel, sample).unwrap_or(noise));
            }
        }
        pass
    }

    /// The plain picture of a pass, and what is taken out of it: as a pass, and as a sum of blocks.
    fn judged(pass: &Pass, kappa: f64) -> (Image, Image) {
        let finished = [pass.finish()];
        let plain = combine(&finished).unwrap();
        let taken = taken_from_passes(&finished, None, 1, &plain, kappa);
        let mut sum = Sum::new(SIDE * SIDE, false);
        sum.add(&Block::of(pass, false));
        let mut cascade = Cascade::new(SIDE * SIDE);
        pass.cascades().unwrap().iter().for_each(|half| cascade.absorb(half));
        let summed = sum.finish();
        let other = taken_from_sum(&summed, &cascade, 1, &summed.image(SIDE, 1), kappa);
        for (a, b) in taken.pixels.iter().zip(&other.pixels) {
            assert!((*a - *b).abs().max_element() <= 1e-4 * a.max_element(), "{a} and {b}");
        }
        (plain, taken)
    }

    /// One sample in one pixel of 81 that is 10,000 times as bright as all others leaves about as much light as the pixel has without it.
    #[test]
    fn a_lone_firefly_is_taken_out() {
        let firefly = |pixel: usize, sample: u64| (pixel == MIDDLE && sample == 17).then_some(1e4);
        let (plain, taken) = judged(&pass(32, firefly), KAPPA);
        assert!(plain.pixels[MIDDLE].x > 300.0);
        let left = plain.pixels[MIDDLE] - taken.pixels[MIDDLE];
        assert!(left.cmpge(0.85 * Vec3::new(1.0, 0.8, 0.6)).all() && left.x < 1.6, "{left}");
        let others: f32 = (0..81).filter(|&i| i != MIDDLE).map(|i| taken.pixels[i].x / plain.pixels[i].x).sum();
        assert!(others < 0.01, "{others}");
        // At an edge and in a corner as well.
        for pixel in [0, 4, 80] {
            let (plain, taken) = judged(&pass(32, |i, sample| (i == pixel && sample == 3).then_some(1e4)), KAPPA);
            assert!(plain.pixels[pixel].x - taken.pixels[pixel].x < 1.6);
        }
    }

    /// A lamp that fills a pixel, and one that a tenth of its samples see, as all around it do: their samples are many.
    #[test]
    fn a_small_bright_light_stays() {
        let (plain, taken) = judged(&pass(32, |pixel, _| (pixel == MIDDLE).then_some(1e4)), KAPPA);
        assert!(plain.pixels[MIDDLE].x > 9e3 && taken.pixels == [Vec3::ZERO; 81]);
        let spread = |pixel: usize, sample: u64| ((sample + 3 * pixel as u64).is_multiple_of(10)).then_some(1e4);
        let (plain, taken) = judged(&pass(40, spread), KAPPA);
        assert!(plain.pixels[MIDDLE].x > 900.0 && taken.pixels == [Vec3::ZERO; 81]);
    }

    /// What many samples have lit outweighs a lone one of 4,096 times their brightness, also where there are more than a level can hold.
    #[test]
    fn full_levels_are_known_by_the_rest() {
        let share = |samples: u32| {
            let mut cascade = Cascade::new(1);
            (1..samples).for_each(|_| cascade.add(0, Vec3::ONE));
            cascade.add(0, Vec3::splat(4096.0));
            let whole = (f64::from(samples) + 4095.0) / f64::from(samples);
            let value = Value { whole, ..Value::of_sum(cascade.layers(0), samples) };
            let shares = value.shares(KAPPA, LEAST * whole, |level| value.near(level));
            shares.last().map(|(_, share)| share).unwrap()
        };
        // Half of E N / (κ b), and no company.
        assert!((share(8192) - 0.25).abs() < 1e-3 && (share(16_000) - 16_000.0 / 32_768.0).abs() < 1e-3);
        assert!((share(20_000) - 20_000.0 / 32_768.0).abs() < 1e-3 && share(40_000) == 1.0 && share(65_536) == 1.0);
    }

    /// Samples that are few are not lone where all around are like them, and darkness takes nothing.
    #[test]
    fn few_samples_and_darkness() {
        let (_, taken) = judged(&pass(1, |_, _| None), 1.0);
        assert_eq!(taken.pixels, [Vec3::ZERO; 81]);
        let (plain, taken) = judged(&pass(4, |_, _| Some(0.0)), KAPPA);
        assert_eq!((plain.pixels, taken.pixels), (vec![Vec3::ZERO; 81], vec![Vec3::ZERO; 81]));
    }

    /// Light whose brightness has no variance, u^(−0.6) with u uniform: less is taken out the more samples there are, N^(−0.4) in theory. Means over
    /// 16 pictures: 256 times the samples leave a ninth; half is allowed.
    #[test]
    fn less_is_taken_out_of_more_samples() {
        let share = |spp: u64| {
            let mut sums = [0.0; 2];
            for picture in 0..16 {
                let mut random = Random::new(9, spp, picture);
                let mut pass = Pass::with_cascades(SIDE, SIDE);
                for sample in 0..spp {
                    for pixel in 0..SIDE * SIDE {
                        pass.add(pixel, sample, Vec3::splat((1.0 - random.next_f32()).powf(-0.6)));
                    }
                }
                let (plain, taken) = judged_alone(&pass);
                let sum = |image: &Image| image.pixels.iter().map(|pixel| f64::from(pixel.x)).sum::<f64>();
                sums = [sums[0] + sum(&taken), sums[1] + sum(&plain)];
            }
            sums[0] / sums[1]
        };
        let shares = [16, 256, 4096].map(share);
        assert!(shares.is_sorted_by(|a, b| a > b) && shares[0] > 2.0 * shares[2] && shares[2] > 0.0, "{shares:?}");
    }

    fn judged_alone(pass: &Pass) -> (Image, Image) {
        let finished = [pass.finish()];
        let plain = combine(&finished).unwrap();
        let taken = taken_from_passes(&finished, None, 1, &plain, KAPPA);
        (plain, taken)
    }

    /// A firefly in a pass that hardly counts is a small part of the picture, and no more than that is taken out.
    #[test]
    fn passes_count_as_in_the_picture() {
        let firefly = |pixel: usize, sample: u64| (pixel == MIDDLE && sample == 2).then_some(1e5);
        let weights = [0.01, 0.99];
        let passes = [pass(4, firefly).finish(), pass(64, |_, _| None).finish()];
        let plain = super::super::combine_weighted(&passes, &weights, 1).unwrap();
        let taken = taken_from_passes(&passes, Some(&weights), 1, &plain, KAPPA);
        assert!((plain.pixels[MIDDLE].x - 251.0).abs() < 2.0, "{}", plain.pixels[MIDDLE]);
        let left = plain.pixels[MIDDLE].x - taken.pixels[MIDDLE].x;
        assert!(left > 0.7 && left < 1.7, "{left}");
        // Weights of samples add up to 1 in the pixels of all passes, whatever decides them.
        for fixed in [Some(&weights[..]), None] {
            let weights = sample_weights(&passes, fixed);
            let sum: f64 = weights(MIDDLE).iter().map(|of| of.weight * f64::from(of.count)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        }
    }

    /// Pixels without samples take what their value is taken from.
    #[test]
    fn gaps_follow_their_donors() {
        let mut holed = Pass::with_cascades(SIDE, SIDE);
        for sample in 0..32 {
            for pixel in (0..SIDE * SIDE).filter(|pixel| pixel / SIDE != 5) {
                holed.add(pixel, sample, Vec3::splat(if (pixel, sample) == (MIDDLE, 9) { 1e4 } else { 1.0 }));
            }
        }
        let (plain, taken) = judged_alone(&holed);
        let below = MIDDLE + SIDE;
        assert_eq!((plain.pixels[below], taken.pixels[below]), (plain.pixels[MIDDLE], taken.pixels[MIDDLE]));
        assert!(taken.pixels[below].x > 300.0);
        assert!(without(&plain, &taken).pixels[below].x < 1.6);
    }

    /// What one view of a sheet shows is no company for another's.
    #[test]
    fn views_are_no_company() {
        let bright =
            |pixel: usize, sample: u64| (pixel / SIDE == 2 || pixel == 3 * SIDE + 4 && sample == 3).then_some(1e4);
        let (finished, kappa) = ([pass(16, bright).finish()], 1.0);
        let plain = combine(&finished).unwrap();
        let taken = |views| taken_from_passes(&finished, None, views, &plain, kappa).pixels[3 * SIDE + 4].x;
        assert!(taken(1) == 0.0 && taken(3) > 500.0, "{} {}", taken(1), taken(3));
    }
}
