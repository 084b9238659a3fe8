//! Sums by blocks of samples: what makes a picture that several processes render the one that a single process renders, bit for bit.
//!
//! Sums of floating-point numbers depend on their order. So each pixel's samples are summed in blocks of [`BLOCK`], each block by itself
//! and rounded to singles, and the blocks are added up in the order of their index: by the process that rendered them, or by another
//! one that reads them from the files of several. A mean of singles is off by 6e-8 for each block, and the mean of the picture by no more.
//!
//! Names of arrays have the block's name and a dot before them. For P pixels:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `means` | f32 | [P, 3] | of the block's samples |
//! | `counts` | u8 | [P] | its samples |
//! | `even_means`, `even_counts` | f32, u8 | [P, 3], [P] | those of them with even numbers; only where variances are wanted |
//! | `deviations` | f32 | [P, 3] | root of the sum of squared deviations from the mean; only where variances are wanted |

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::stored::{pixel_arrays, read_pixels};
use super::{FinishedPass, Half, Pass, Pixel, Spread, filled};
use crate::base::Result;
use crate::base::streamed::Streamed;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, borrowed};
use crate::picture::Image;

/// Samples of each pixel in a block.
pub const BLOCK: u32 = 64;

/// What variances are made of.
#[derive(Debug, Clone, PartialEq)]
struct Detail {
    even_means: Vec<Vec3>,
    even_counts: Vec<u8>,
    deviations: Vec<Vec3>,
}

/// The samples of a block, of which the pixels may be a range of the picture's.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    means: Vec<Vec3>,
    counts: Vec<u8>,
    detail: Option<Detail>,
}

fn single(numbers: [f64; 3]) -> Vec3 {
    DVec3::from_array(numbers).as_vec3()
}

/// The root of a sum of squares of singles, which is a single but for the largest of them.
fn root(squares: [f64; 3]) -> Vec3 {
    single(squares.map(f64::sqrt)).min(Vec3::MAX)
}

/// A pixel never has more samples than a block.
fn few(count: u32) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX)
}

impl Block {
    /// The samples of a pass with at most [`BLOCK`] samples per pixel; with what variances are made of where it is `detailed`.
    pub fn of(pass: &Pass, detailed: bool) -> Self {
        let [even, odd] = &pass.halves;
        let both = |(a, b): (&Pixel, &Pixel)| a.merged(b);
        let merged = || even.par_iter().zip(odd).map(both);
        let detail = || Detail {
            even_means: even.par_iter().map(|pixel| single(pixel.mean)).collect(),
            even_counts: even.iter().map(|pixel| few(pixel.count)).collect(),
            deviations: merged().map(|pixel| root(pixel.spread)).collect(),
        };
        Self {
            means: merged().map(|pixel| single(pixel.mean)).collect(),
            counts: merged().map(|pixel| few(pixel.count)).collect(),
            detail: detailed.then(detail),
        }
    }

    /// The arrays of a block `name`.
    pub fn arrays<'a>(&'a self, name: &str) -> Vec<Tensor<'a>> {
        let vectors = |part, values| borrowed::<_, 4>(format!("{name}.{part}"), (Dtype::F32, 3), values);
        let counts = |part, values| borrowed::<u8, 1>(format!("{name}.{part}"), (Dtype::U8, 1), values);
        let mut all = vec![vectors("means", &self.means), counts("counts", &self.counts)];
        if let Some(detail) = &self.detail {
            all.push(vectors("even_means", &detail.even_means));
            all.push(counts("even_counts", &detail.even_counts));
            all.push(vectors("deviations", &detail.deviations));
        }
        all
    }

    /// The block of so many pixels that [`Block::arrays`] were made of, `detailed` or not.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn read(file: &impl Arrays, name: &str, pixels: usize, detailed: bool) -> Result<Self> {
        let vectors = |part: &str, sound: fn(Vec3) -> bool| -> Result<Vec<Vec3>> {
            let name = format!("{name}.{part}");
            let values: Vec<Vec3> = file.read(&name, Dtype::F32, Some(pixels), 3, vector)?;
            if values.iter().all(|&value| sound(value)) {
                Ok(values)
            } else {
                file.fail(name, "numbers that no samples have")
            }
        };
        let counts = |part: &str, most: &[u8]| -> Result<Vec<u8>> {
            let name = format!("{name}.{part}");
            let counts = file.read(&name, Dtype::U8, Some(pixels), 1, |[count]: [u8; 1]| count)?;
            let bounds = most.iter().copied().chain(std::iter::repeat(BLOCK as u8));
            match counts.iter().zip(bounds).find(|(count, most)| *count > most) {
                Some((count, most)) => file.fail(name, format!("{count} samples of a pixel, the limit is {most}")),
                None => Ok(counts),
            }
        };
        let means = vectors("means", Vec3::is_finite)?;
        let all = counts("counts", &[])?;
        let detail = || -> Result<Detail> {
            Ok(Detail {
                even_means: vectors("even_means", Vec3::is_finite)?,
                even_counts: counts("even_counts", &all)?,
                deviations: vectors("deviations", |value| value.is_finite() && value.min_element() >= 0.0)?,
            })
        };
        let detail = if detailed { Some(detail()?) } else { None };
        Ok(Self { means, counts: all, detail })
    }

    /// Whether a file has the arrays of a block `name` of so many pixels.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn expect(file: &Streamed, name: &str, pixels: usize, detailed: bool) -> Result<()> {
        let vectors = |part: &str| file.expect(&format!("{name}.{part}"), Dtype::F32, pixels, 3);
        let counts = |part: &str| file.expect(&format!("{name}.{part}"), Dtype::U8, pixels, 1);
        vectors("means").and(counts("counts"))?;
        if detailed { vectors("even_means").and(counts("even_counts")).and(vectors("deviations")) } else { Ok(()) }
    }
}

/// A pixel's samples in a block, by the root of the sum of their squared deviations.
#[inline(always)]
fn pixel(mean: Vec3, deviation: Vec3, count: u8) -> Pixel {
    let square = |x: f32| f64::from(x) * f64::from(x);
    Pixel { mean: mean.to_array().map(f64::from), spread: deviation.to_array().map(square), count: count.into() }
}

/// Adds to each pixel what `next` says of it.
#[inline(always)]
fn each(pixels: &mut [Pixel], next: impl Fn(usize) -> Pixel + Sync) {
    let add = |(i, pixel): (usize, &mut Pixel)| *pixel = pixel.followed(&next(i));
    pixels.par_iter_mut().with_min_len(1 << 12).enumerate().for_each(add);
}

fn vector(bytes: [u8; 12]) -> Vec3 {
    let (numbers, _) = bytes.as_chunks::<4>();
    Vec3::new(f32::from_le_bytes(numbers[0]), f32::from_le_bytes(numbers[1]), f32::from_le_bytes(numbers[2]))
}

/// Blocks added up, in the order in which they are to be.
#[derive(Debug, Clone, PartialEq)]
pub struct Sum {
    pixels: Vec<Pixel>,
    /// The samples with even numbers; empty where no variances are wanted.
    even: Vec<Pixel>,
}

impl Sum {
    /// No samples yet of so many pixels; with what variances are made of where it is `detailed`.
    pub fn new(pixels: usize, detailed: bool) -> Self {
        let none = |pixels| vec![Pixel::default(); pixels];
        Self { pixels: none(pixels), even: none(if detailed { pixels } else { 0 }) }
    }

    /// Adds the next block, which has as many pixels.
    pub fn add(&mut self, block: &Block) {
        // Where nothing asks for them, there are no deviations to be looked for pixel by pixel.
        match &block.detail {
            None => each(&mut self.pixels, |i| pixel(block.means[i], Vec3::ZERO, block.counts[i])),
            Some(detail) => {
                each(&mut self.pixels, |i| pixel(block.means[i], detail.deviations[i], block.counts[i]));
                each(&mut self.even, |i| pixel(detail.even_means[i], Vec3::ZERO, detail.even_counts[i]));
            }
        }
    }

    /// Reduces it to what the picture needs.
    pub fn finish(&self) -> Summed {
        let half = |pixels: &[Pixel]| Half {
            means: pixels.par_iter().map(|pixel| single(pixel.mean)).collect(),
            counts: pixels.iter().map(|pixel| pixel.count).collect(),
            tiles: Vec::new(),
        };
        let variance = |pixel: &Pixel| pixel.sample_variance().map_or(Vec3::NAN, single);
        let detail = || (half(&self.even), self.pixels.par_iter().map(variance).collect());
        Summed { all: half(&self.pixels), detail: (!self.even.is_empty()).then(detail) }
    }

    /// The arrays of a sum `name`, as those of a pass that is being made.
    pub fn arrays<'a>(&self, name: &str) -> Vec<Tensor<'a>> {
        pixel_arrays(name, self.pixels.iter().chain(&self.even))
    }

    /// The sum of so many pixels that [`Sum::arrays`] were made of.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn from_arrays(pixels: usize, detailed: bool, file: &Tensors, name: &str) -> Result<Self> {
        let mut all = read_pixels(file, name, if detailed { 2 * pixels } else { pixels })?;
        let even = all.split_off(pixels);
        Ok(Self { pixels: all, even })
    }
}

impl Pixel {
    /// This pixel's samples and then those of `next`; exact where there are none yet.
    fn followed(&self, next: &Self) -> Self {
        if self.count == 0 { *next } else { self.merged(next) }
    }
}

/// A sum that gets no more samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Summed {
    all: Half,
    /// The samples with even numbers, and the variance of one sample of each pixel.
    detail: Option<(Half, Vec<Vec3>)>,
}

impl Summed {
    /// No samples of so many pixels.
    pub fn empty(pixels: usize, detailed: bool) -> Self {
        let none = || Half { means: vec![Vec3::ZERO; pixels], counts: vec![0; pixels], tiles: Vec::new() };
        Self { all: none(), detail: detailed.then(|| (none(), vec![Vec3::NAN; pixels])) }
    }

    /// Puts the pixels of `other` from number `from` on to the places that `place` names.
    pub fn place(&mut self, other: &Self, mut place: impl FnMut(usize) -> usize) {
        for i in 0..other.all.counts.len() {
            let at = place(i);
            self.all.put(at, &other.all, i);
            if let (Some((even, variance)), Some((other, of))) = (&mut self.detail, &other.detail) {
                even.put(at, other, i);
                variance[at] = of[i];
            }
        }
    }

    /// Samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.all.samples()
    }

    /// The picture of so many columns, on a sheet of several `views`. A pixel without samples has the value of the nearest one above or
    /// below that has some, see [`combine`](super::combine).
    pub fn image(&self, width: usize, views: usize) -> Image {
        let Half { means, counts, .. } = &self.all;
        let pixels = means.len();
        if counts.iter().all(|&count| count > 0) {
            return Image { width, height: pixels.checked_div(width).unwrap_or(0), pixels: means.clone() };
        }
        let sampled: Vec<Option<Vec3>> =
            means.iter().zip(counts).map(|(&mean, &count)| (count > 0).then_some(mean)).collect();
        let views = sampled.chunks((pixels / views.max(1)).max(1)).flat_map(|view| filled(view, width));
        Image { width, height: pixels.checked_div(width).unwrap_or(0), pixels: views.collect() }
    }

    /// The samples as those of a pass of so many columns, without tiles; none where no variances are wanted.
    pub(in crate::film) fn into_pass(self, width: usize) -> Option<FinishedPass> {
        let (even, variance) = self.detail?;
        let odd = even.rest_of(&self.all);
        Some(FinishedPass { width, halves: [even, odd], spread: Spread::default(), variance })
    }
}

impl Half {
    fn put(&mut self, at: usize, other: &Self, i: usize) {
        (self.means[at], self.counts[at]) = (other.means[i], other.counts[i]);
    }

    /// The samples of `all` without those of this half.
    fn rest_of(&self, all: &Self) -> Self {
        let rest = |i: usize| {
            let [all_count, own] = [all.counts[i], self.counts[i]].map(f64::from);
            let sum = all.means[i].as_dvec3() * all_count - self.means[i].as_dvec3() * own;
            if all_count > own { (sum / (all_count - own)).as_vec3() } else { Vec3::ZERO }
        };
        let counts = all.counts.iter().zip(&self.counts).map(|(all, own)| all - own).collect();
        Self { means: (0..all.means.len()).into_par_iter().map(rest).collect(), counts, tiles: Vec::new() }
    }
}
