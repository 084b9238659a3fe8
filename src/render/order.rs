//! The order in which a pass takes its samples, by linear index.

use std::ops::Range;

use crate::picture::Window;

/// An uneven division of samples among pixels, for a pass that began evenly; see [`densities`](crate::film::densities).
#[derive(Debug, Clone, Copy)]
pub struct Uneven<'a> {
    /// Samples of each pixel over those of the mean pixel.
    pub densities: &'a [f32],
    /// Samples per pixel with which the pass began evenly.
    pub even: u32,
    /// Samples per pixel that were divided unevenly before.
    pub before: u32,
}

impl Uneven<'_> {
    /// Samples of a pixel when `spp` samples per pixel were divided unevenly. What is rounded differs from pixel to pixel, so that together
    /// they have about as many samples as the picture was to get.
    fn samples(&self, pixel: u64, spp: u32) -> u64 {
        // Golden multiples are spread evenly.
        let rounding = (pixel as f64 * 0.618_033_988_749_895).fract();
        let divided = f64::from(self.densities[pixel as usize]) * f64::from(spp) + rounding;
        u64::from(self.even) + divided as u64
    }

    /// Numbers of a pixel's samples in a batch of `spp` samples per pixel, counted from the beginning of the pass.
    fn batch(&self, pixel: u64, spp: u32) -> Range<u64> {
        self.samples(pixel, self.before)..self.samples(pixel, self.before + spp)
    }
}

/// Which sample of which pixel every linear index of a pass stands for.
pub(super) struct Order<'a> {
    width: u64,
    rows: Vec<u32>,
    spp: u32,
    division: Division<'a>,
    /// Whether an even division takes all samples of a pixel together.
    by_pixel: bool,
}

enum Division<'a> {
    /// Sample after sample, in each of so many places.
    Even(u64),
    /// Sample after sample, in each of these pixels.
    Few(Vec<u32>),
    /// Row after row, pixel after pixel, and the linear index at which each row begins.
    Uneven(Uneven<'a>, Vec<u64>),
}

/// The samples of a chunk.
pub(super) enum Places<'o> {
    Even(&'o [u32], u64, u64),
    Few(&'o [u32]),
    /// Pixels and samples from a linear index on.
    Listed(Vec<(u32, u32)>, u64),
}

/// The order in which the rows of a picture are visited, that of van der Corput (1935): any beginning of it, however short beside the
/// picture, is spread evenly.
fn row_order(height: u32) -> Vec<u32> {
    let mut rows: Vec<u32> = (0..height).collect();
    rows.sort_unstable_by_key(|y| y.reverse_bits());
    rows
}

/// Pixels in a row that are visited together where few are: rays of neighbours take the same ways.
const SPAN: u32 = 16;

/// All pixels of a picture in an order of which every part is spread over rows and columns alike: short spans, each in the next row of
/// [`row_order`], a golden part of the width farther on, and a row's own spans in that order too.
fn spread(window: Window) -> impl Iterator<Item = u32> + Clone {
    let (rows, spans) = (row_order(window.height), row_order(window.width.div_ceil(SPAN)));
    let all = (0..spans.len() * rows.len()).map(move |k| {
        let (i, count) = (k % rows.len(), spans.len());
        let shift = (i as f64 * 0.618_033_988_749_895).fract() * count as f64;
        (rows[i], (spans[k / rows.len()] + shift as u32) % count as u32 * SPAN)
    });
    all.flat_map(move |(row, first)| {
        (first..(first + SPAN).min(window.width)).map(move |column| row * window.width + column)
    })
}

impl<'a> Order<'a> {
    /// `spp` samples in each of the first so many `places` of `window` in the order of rows, or divided among all pixels.
    pub fn new(window: Window, places: u64, spp: u32, uneven: Option<Uneven<'a>>) -> Self {
        let (width, rows) = (u64::from(window.width), row_order(window.height));
        let Some(uneven) = uneven else {
            return Self { width, rows, spp, division: Division::Even(places), by_pixel: false };
        };
        let samples = |&row: &u32| -> u64 {
            let pixels = u64::from(row) * width..u64::from(row + 1) * width;
            pixels.map(|pixel| uneven.batch(pixel, spp)).map(|batch| batch.end - batch.start).sum()
        };
        let mut starts = vec![0];
        for row in &rows {
            starts.push(starts[starts.len() - 1] + samples(row));
        }
        Self { width, rows, spp, division: Division::Uneven(uneven, starts), by_pixel: true }
    }

    /// One sample after the other in so many pixels after the first `skipped`, in an order in which they are spread over the picture however
    /// few they are; from its beginning again after all pixels.
    pub fn of_few(window: Window, skipped: u64, count: u64, spp: u32) -> Self {
        let pixels = spread(window).cycle().skip((skipped % window.pixels()) as usize).take(count as usize);
        let division = Division::Few(pixels.collect());
        Self { width: window.width.into(), rows: Vec::new(), spp, division, by_pixel: false }
    }

    /// The order pixel by pixel: any part of an even pass then has all samples of its pixels.
    pub fn by_pixel(self) -> Self {
        Self { by_pixel: true, ..self }
    }

    /// Number of samples.
    pub fn total(&self) -> u64 {
        match &self.division {
            Division::Even(places) => places * u64::from(self.spp),
            Division::Few(pixels) => pixels.len() as u64 * u64::from(self.spp),
            Division::Uneven(_, starts) => starts.last().copied().unwrap_or(0),
        }
    }

    /// The samples of a range of linear indices.
    pub fn places(&self, range: Range<u64>) -> Places<'_> {
        let even = match &self.division {
            Division::Even(places) => Places::Even(&self.rows, *places, self.width),
            Division::Few(pixels) => Places::Few(pixels),
            Division::Uneven(uneven, starts) => return self.unevenly(range, uneven, starts),
        };
        if self.by_pixel { even.listed(range, self.spp.into()) } else { even }
    }

    fn unevenly(&self, range: Range<u64>, uneven: &Uneven<'a>, starts: &[u64]) -> Places<'_> {
        // The last row that begins no later; rows without samples begin where the next one does.
        let first = starts.partition_point(|&start| start <= range.start).max(1) - 1;
        let pixels = self.rows[first.min(self.rows.len())..].iter().flat_map(|&row| {
            let start = u64::from(row) * self.width;
            start..start + self.width
        });
        let samples =
            pixels.flat_map(|pixel| uneven.batch(pixel, self.spp).map(move |sample| (pixel as u32, sample as u32)));
        let (skipped, count) = (range.start - starts[first], range.end - range.start);
        Places::Listed(samples.skip(skipped as usize).take(count as usize).collect(), range.start)
    }
}

impl<'o> Places<'o> {
    /// The samples of a range of linear indices, `spp` in a place before those of the next.
    fn listed(&self, range: Range<u64>, spp: u64) -> Places<'o> {
        let sample = |index: u64| (self.at(index / spp).0 as u32, (index % spp) as u32);
        Places::Listed(range.clone().map(sample).collect(), range.start)
    }

    /// Pixel and sample of a linear index: in an even pass the sample's number in the pass, or else the number that it has among the
    /// pixel's since the pass began.
    #[inline(always)]
    pub fn at(&self, index: u64) -> (u64, u64) {
        match self {
            Self::Even(rows, places, width) => {
                let sample = index / places;
                // Pixels are fewer than 2³², and short numbers are divided sooner.
                let (place, width) = ((index - sample * places) as u32, *width as u32);
                let (row, column) = (place / width, place % width);
                (u64::from(rows[row as usize]) * u64::from(width) + u64::from(column), sample)
            }
            Self::Few(pixels) => {
                let count = pixels.len() as u64;
                (pixels[(index % count) as usize].into(), index / count)
            }
            Self::Listed(listed, first) => {
                let (pixel, sample) = listed[(index - first) as usize];
                (pixel.into(), sample.into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same samples in both orders, in one of them those of a pixel together.
    #[test]
    fn a_part_of_an_order_by_pixel_has_all_samples_of_its_pixels() {
        let window = Window { x: 0, y: 0, width: 20, height: 40 };
        let order = || Order::new(window, 300, 3, None);
        let samples = |order: &Order, range: Range<u64>| -> Vec<(u64, u64)> {
            let places = order.places(range.clone());
            range.map(|index| places.at(index)).collect()
        };
        let (by_sample, by_pixel) = (order(), order().by_pixel());
        let mut all = [&by_sample, &by_pixel].map(|order| samples(order, 0..order.total()));
        assert_eq!(all[1][..6].iter().map(|(_, sample)| *sample).collect::<Vec<_>>(), [0, 1, 2, 0, 1, 2]);
        assert_eq!(all[1][450..], samples(&by_pixel, 450..900)[..]);
        all.iter_mut().for_each(|samples| samples.sort_unstable());
        assert_eq!(all[0], all[1]);
    }

    /// Among the first n rows of h is every 2ᵏ-th, the least power of two that is h / n or more.
    #[test]
    fn rows_are_visited_once_and_evenly() {
        for height in [1, 7, 16, 100, 2160, 25_920] {
            let mut rows = row_order(height);
            for count in [1, 3, 68, 137, height / 8, height.div_ceil(4), height] {
                let count = count.clamp(1, height);
                let mut beginning = rows[..count as usize].to_vec();
                beginning.sort_unstable();
                let most = height.div_ceil(count).next_power_of_two();
                let mut gaps = beginning.iter().zip(beginning[1..].iter().chain([&height])).map(|(y, next)| next - y);
                assert!(beginning[0] == 0 && gaps.all(|gap| gap <= most), "{count} of {height}");
            }
            rows.sort_unstable();
            assert!(rows.into_iter().eq(0..height));
        }
    }

    /// All pixels are visited once, and the first few are in all quarters of the picture's width and height as often.
    #[test]
    fn few_pixels_are_spread_over_rows_and_columns() {
        for (width, height) in [(1, 1), (1, 40), (7, 20), (33, 5), (320, 180), (512, 512), (1280, 720)] {
            let window = Window { x: 0, y: 0, width, height };
            let order = Order::of_few(window, 0, window.pixels(), 2);
            let places = order.places(0..order.total());
            let mut pixels: Vec<u64> = (0..window.pixels()).map(|index| places.at(index).0).collect();
            assert_eq!(places.at(window.pixels()), (pixels[0], 1));
            let third = window.pixels() / 3;
            let rest = Order::of_few(window, third + window.pixels(), window.pixels() - third, 1);
            let rest = (rest.places(0..rest.total()), rest.total());
            assert!((0..rest.1).map(|index| rest.0.at(index).0).eq(pixels[third as usize..].iter().copied()));
            if width >= 320 {
                let mut found = [[0; 4]; 2];
                for pixel in &pixels[..1536] {
                    found[0][(pixel % u64::from(width) * 4 / u64::from(width)) as usize] += 1;
                    found[1][(pixel / u64::from(width) * 4 / u64::from(height)) as usize] += 1;
                }
                assert!(found.as_flattened().iter().all(|&count: &i32| (count - 384).abs() <= 48), "{found:?}");
            }
            pixels.sort_unstable();
            assert!(pixels.into_iter().eq(0..window.pixels()), "{width} {height}");
        }
    }

    /// Batches give every pixel the next numbers of its samples, without gaps, in any chunks, and as many as its density says.
    #[test]
    fn uneven_batches_follow_one_another() {
        let window = Window { x: 0, y: 0, width: 7, height: 20 };
        let densities: Vec<f32> = (0..140).map(|i| [0.0, 0.1, 0.9, 3.0][i % 4]).collect();
        let mut next = [4u64; 140];
        let mut before = 0;
        for spp in [1, 1, 2, 13, 100] {
            let order = Order::new(window, 140, spp, Some(Uneven { densities: &densities, even: 4, before }));
            let mut begin = 0;
            while begin < order.total() {
                let end = (begin + 37).min(order.total());
                let places = order.places(begin..end);
                for index in begin..end {
                    let (pixel, sample) = places.at(index);
                    assert_eq!(sample, next[pixel as usize]);
                    next[pixel as usize] += 1;
                }
                begin = end;
            }
            before += spp;
        }
        for (pixel, (samples, density)) in next.into_iter().zip(&densities).enumerate() {
            let expected = 4.0 + f64::from(*density) * 117.0;
            assert!((samples as f64 - expected).abs() <= 1.0, "{pixel}: {samples} instead of {expected}");
        }
    }
}
