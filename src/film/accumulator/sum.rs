//! Blocks added up, in the order of their samples.
//!
//! Names of arrays have the sum's name and a dot before them. For P pixels:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `means` | f64 | [P, 3] | of the samples |
//! | `counts` | u32 | [P] | the samples |
//! | `even_means`, `even_counts` | f64, u32 | [P, 3], [P] | those of them with even numbers; only where variances are wanted |
//! | `squares` | f64 | [P, 3] | sum of squared deviations from the mean; only where variances are wanted |

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::stored::MOST_SAMPLES;
use super::{Block, Half, Summed};
use crate::base::Result;
use crate::base::streamed::Streamed;
use crate::base::tensors::{Arrays, Dtype, Tensor, borrowed};

/// Pixels that a thread adds to at least.
const TASK: usize = 1 << 12;
/// Pixels that are looked at together: most have as many samples as their neighbours, and then the same weights.
const RUN: usize = 64;

/// Means of the samples of pixels.
#[derive(Debug, Clone, Default, PartialEq)]
struct Means {
    means: Vec<DVec3>,
    counts: Vec<u32>,
}

/// Blocks added up (Chan, Golub and LeVeque 1979), in the order in which they are to be.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sum {
    all: Means,
    /// The samples with even numbers, and the sum of squared deviations of all; none where no variances are wanted.
    detail: Option<(Means, Vec<DVec3>)>,
}

impl Sum {
    /// No samples yet of so many pixels; with what variances are made of where it is `detailed`.
    pub fn new(pixels: usize, detailed: bool) -> Self {
        let none = || Means { means: vec![DVec3::ZERO; pixels], counts: vec![0; pixels] };
        Self { all: none(), detail: detailed.then(|| (none(), vec![DVec3::ZERO; pixels])) }
    }

    /// Bytes that a pixel takes.
    pub fn bytes_per_pixel(detailed: bool) -> usize {
        let means = size_of::<DVec3>() + size_of::<u32>();
        if detailed { 2 * means + size_of::<DVec3>() } else { means }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.all.counts.len()
    }

    /// Adds the next block, which has as many pixels, and what variances are made of where the sum has it.
    pub fn add(&mut self, block: &Block) {
        let Means { means, counts } = &mut self.all;
        let (means, counts) = (means.par_chunks_mut(TASK), counts.par_chunks_mut(TASK));
        let next = block.means.par_chunks(TASK).zip(block.counts.par_chunks(TASK));
        match (&mut self.detail, &block.detail) {
            (Some((even, squares)), Some(detail)) => {
                let spread = squares.par_chunks_mut(TASK).zip(detail.deviations.par_chunks(TASK));
                let all = means.zip(counts).zip(next).zip(spread);
                all.for_each(|(((means, counts), next), (squares, roots))| {
                    add_spread(squares, roots, (means, counts), next);
                    add_means(means, counts, next);
                });
                let even = even.means.par_chunks_mut(TASK).zip(even.counts.par_chunks_mut(TASK));
                let next = detail.even_means.par_chunks(TASK).zip(detail.even_counts.par_chunks(TASK));
                even.zip(next).for_each(|((means, counts), next)| add_means(means, counts, next));
            }
            _ => means.zip(counts).zip(next).for_each(|((means, counts), next)| add_means(means, counts, next)),
        }
    }

    /// Puts the pixels of `other` behind these.
    pub fn append(&mut self, mut other: Self) {
        self.all.append(&mut other.all);
        if let (Some((even, squares)), Some((others, more))) = (&mut self.detail, &mut other.detail) {
            even.append(others);
            squares.append(more);
        }
    }

    /// Reduces it to what the picture needs.
    pub fn finish(&self) -> Summed {
        let variance = |(squares, &count): (&DVec3, &u32)| {
            if count >= 2 { (*squares / f64::from(count - 1)).as_vec3() } else { Vec3::NAN }
        };
        let detail = self.detail.as_ref().map(|(even, squares)| {
            let variances = squares.par_iter().zip(&self.all.counts).map(variance);
            (even.half(), variances.collect())
        });
        Summed { all: self.all.half(), detail }
    }

    /// The arrays of a sum `name`.
    pub fn arrays<'a>(&'a self, name: &str) -> Vec<Tensor<'a>> {
        let vectors = |part, values: &'a [DVec3]| borrowed::<_, 8>(format!("{name}.{part}"), (Dtype::F64, 3), values);
        let counts = |part, counts: &'a [u32]| borrowed::<_, 4>(format!("{name}.{part}"), (Dtype::U32, 1), counts);
        let mut all = vec![vectors("means", &self.all.means), counts("counts", &self.all.counts)];
        if let Some((even, squares)) = &self.detail {
            all.push(vectors("even_means", &even.means));
            all.push(counts("even_counts", &even.counts));
            all.push(vectors("squares", squares));
        }
        all
    }

    /// The sum of so many pixels that [`Sum::arrays`] were made of, `detailed` or not.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn read(file: &impl Arrays, name: &str, pixels: usize, detailed: bool) -> Result<Self> {
        let all = Means::read(file, [&format!("{name}.means"), &format!("{name}.counts")], pixels)?;
        if !detailed {
            return Ok(Self { all, detail: None });
        }
        let even_counts = format!("{name}.even_counts");
        let even = Means::read(file, [&format!("{name}.even_means"), &even_counts], pixels)?;
        if even.counts.iter().zip(&all.counts).any(|(even, all)| even > all) {
            return file.fail(even_counts, "more samples than the pixel has");
        }
        let sound = |square: f64| square.is_finite() && square >= 0.0;
        let squares = read_vectors(file, &format!("{name}.squares"), pixels, sound)?;
        Ok(Self { all, detail: Some((even, squares)) })
    }

    /// Whether a file has the arrays of a sum `name` of so many pixels.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn expect(file: &Streamed, name: &str, pixels: usize, detailed: bool) -> Result<()> {
        let vectors = |part: &str| file.expect(&format!("{name}.{part}"), Dtype::F64, pixels, 3);
        let counts = |part: &str| file.expect(&format!("{name}.{part}"), Dtype::U32, pixels, 1);
        vectors("means").and(counts("counts"))?;
        if detailed { vectors("even_means").and(counts("even_counts")).and(vectors("squares")) } else { Ok(()) }
    }
}

impl Means {
    fn append(&mut self, other: &mut Self) {
        self.means.append(&mut other.means);
        self.counts.append(&mut other.counts);
    }

    fn half(&self) -> Half {
        let means = self.means.par_iter().map(|mean| mean.as_vec3()).collect();
        Half { means, counts: self.counts.clone(), tiles: Vec::new() }
    }

    fn read(file: &impl Arrays, [means, counts]: [&str; 2], pixels: usize) -> Result<Self> {
        let means = read_vectors(file, means, pixels, |mean| mean.abs() <= f64::from(f32::MAX))?;
        let counts_name = counts;
        let mut counts: Vec<u32> = Vec::new();
        file.fill(counts_name, Dtype::U32, Some(pixels), 1, &mut counts)?;
        match counts.iter().find(|&&count| count > MOST_SAMPLES) {
            Some(count) => file.fail(counts_name, format!("{count} samples of a pixel, the limit is {MOST_SAMPLES}")),
            None => Ok(Self { means, counts }),
        }
    }
}

fn read_vectors(file: &impl Arrays, name: &str, pixels: usize, sound: impl Fn(f64) -> bool) -> Result<Vec<DVec3>> {
    let mut vectors: Vec<DVec3> = Vec::new();
    file.fill(name, Dtype::F64, Some(pixels), 3, &mut vectors)?;
    let all_sound = vectors.iter().all(|vector| vector.to_array().into_iter().all(&sound));
    if all_sound { Ok(vectors) } else { file.fail(name, "numbers that no samples have") }
}

/// The number that all of some counts are; none where they differ.
#[inline(always)]
fn common<C: Copy + PartialEq>(counts: &[C]) -> Option<C> {
    let first = *counts.first()?;
    counts.iter().fold(true, |same, &count| same & (count == first)).then_some(first)
}

/// Share of the next samples, `b` of them, in all.
#[inline(always)]
fn share(a: u32, b: u8) -> f64 {
    f64::from(b) / (f64::from(a) + f64::from(b))
}

/// Adds the next samples to means of earlier ones. The first are taken as they are.
fn add_means(means: &mut [DVec3], counts: &mut [u32], (next, next_counts): (&[Vec3], &[u8])) {
    let runs = means.chunks_mut(RUN).zip(counts.chunks_mut(RUN)).zip(next.chunks(RUN).zip(next_counts.chunks(RUN)));
    for ((means, counts), (next, next_counts)) in runs {
        match (common(counts), common(next_counts)) {
            (Some(0), _) => means.iter_mut().zip(next).for_each(|(mean, next)| *mean = next.as_dvec3()),
            (Some(a), Some(b)) => {
                let share = share(a, b);
                let (means, next): (&mut [f64], &[f32]) = (bytemuck::cast_slice_mut(means), bytemuck::cast_slice(next));
                means.iter_mut().zip(next).for_each(|(mean, &next)| *mean += (f64::from(next) - *mean) * share);
            }
            _ => {
                for ((mean, next), (&a, &b)) in means.iter_mut().zip(next).zip(counts.iter().zip(next_counts)) {
                    match a {
                        0 => *mean = next.as_dvec3(),
                        _ => *mean += (next.as_dvec3() - *mean) * share(a, b),
                    }
                }
            }
        }
        counts.iter_mut().zip(next_counts).for_each(|(count, &next)| *count += u32::from(next));
    }
}

/// Adds the next samples, of which the `roots` of the sums of squared deviations are known, to the sums of earlier ones with these means and
/// counts.
fn add_spread(
    squares: &mut [DVec3],
    roots: &[Vec3],
    (means, counts): (&[DVec3], &[u32]),
    (next, next_counts): (&[Vec3], &[u8]),
) {
    let numbers = means.iter().zip(counts).zip(next.iter().zip(next_counts));
    for ((squares, root), ((mean, &a), (next, &b))) in squares.iter_mut().zip(roots).zip(numbers) {
        let (root, between) = (root.as_dvec3(), next.as_dvec3() - *mean);
        *squares = match a {
            0 => root * root,
            _ => *squares + root * root + between * between * (f64::from(a) * share(a, b)),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::base::tensors::{self, Tensors};
    use crate::film::Pass;

    /// Blocks of a picture some of whose samples were dropped.
    fn blocks(pixels: usize, detailed: bool) -> Vec<Block> {
        let mut random = Random::new(7, 0, 0);
        let block = |count: u64| {
            let mut pass = Pass::new(pixels, 1);
            for sample in 0..count {
                let mut pixel = |i: usize| i < 200 || random.next_f32() > 0.1;
                let kept: Vec<usize> = (0..pixels).filter(|&i| i != 5).filter(|&i| pixel(i)).collect();
                let value = |at: f32| Vec3::new(at, 2.0 * at, 1e-3 + at * at);
                kept.into_iter().for_each(|i| pass.add(i, sample, value(i as f32 + sample as f32)));
            }
            Block::of(&pass, detailed)
        };
        [64, 64, 7].map(block).to_vec()
    }

    /// Runs of pixels with as many samples have the bits of pixels one by one, which are those of all samples but for rounding.
    #[test]
    fn runs_of_pixels_are_pixels() {
        for detailed in [false, true] {
            let blocks = blocks(1000, detailed);
            let mut sum = Sum::new(1000, detailed);
            blocks.iter().for_each(|block| sum.add(block));
            for i in 0..1000 {
                let (mut mean, mut count) = (DVec3::ZERO, 0);
                for block in &blocks {
                    let next = block.means[i].as_dvec3();
                    let b = block.counts[i];
                    mean = if count == 0 { next } else { mean + (next - mean) * share(count, b) };
                    count += u32::from(b);
                }
                assert_eq!((sum.all.means[i], sum.all.counts[i]), (mean, count), "pixel {i}");
            }
            assert_eq!((sum.all.counts[0], sum.all.counts[5]), (135, 0));
            assert!(sum.all.counts[200..].iter().any(|&count| count < 135));
            // Samples 0 to 63 twice, and 0 to 6.
            let mean = (2.0 * 2016.0 + 21.0) / 135.0;
            assert!((sum.all.means[0].x - mean).abs() < 1e-5 && sum.all.means[5] == DVec3::ZERO);
            let Some((even, squares)) = &sum.detail else { continue };
            let squared = (2.0 * 85344.0 + 91.0) - 135.0 * mean * mean;
            assert!((squares[0].x / squared - 1.0).abs() < 1e-6 && even.counts[0] == 68);
        }
    }

    #[test]
    fn sums_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sums");
        for detailed in [false, true] {
            let mut sum = Sum::new(300, detailed);
            blocks(300, detailed).iter().for_each(|block| sum.add(block));
            tensors::write(&path, 7, &sum.arrays("a")).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let file = Tensors::open(&path, &bytes, "sums", 7).unwrap();
            assert_eq!(Sum::read(&file, "a", 300, detailed).unwrap(), sum);
            assert!(Sum::read(&file, "a", 299, detailed).is_err() && Sum::read(&file, "b", 300, detailed).is_err());
            assert!(Sum::expect(&Streamed::open(&path).unwrap(), "a", 300, detailed).is_ok());
            let mut both = sum.clone();
            both.append(sum.clone());
            assert!(both.pixels() == 600 && both.all.means[300..] == sum.all.means);
        }
    }

    /// A sum that goes on from what was written is the one that was never written.
    #[test]
    fn impossible_sums_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sums");
        let sum = |change: fn(&mut Sum)| {
            let mut sum = Sum::new(3, true);
            change(&mut sum);
            tensors::write(&path, 7, &sum.arrays("a")).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            Sum::read(&Tensors::open(&path, &bytes, "sums", 7).unwrap(), "a", 3, true)
        };
        assert!(sum(|_| {}).is_ok());
        assert!(sum(|sum| sum.all.means[1].y = f64::NAN).is_err());
        assert!(sum(|sum| sum.all.means[1].y = 1e39).is_err());
        assert!(sum(|sum| sum.all.counts[2] = MOST_SAMPLES + 1).is_err());
        assert!(sum(|sum| sum.detail.as_mut().unwrap().1[0].z = -1.0).is_err());
        assert!(sum(|sum| sum.detail.as_mut().unwrap().0.counts[0] = 1).is_err());
    }
}
