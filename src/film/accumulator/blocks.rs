//! Sums by blocks of samples: what makes a picture that several processes render the one that a single process renders, bit for bit.
//!
//! Sums of floating-point numbers depend on their order. So each pixel's samples are summed in blocks of [`BLOCK`], each block by itself
//! and rounded to singles, and the blocks are added up in the order of their index: by the process that rendered them, or by another
//! one that reads them from the files of several (see [`Sum`](super::Sum)). A mean of singles is off by 6e-8 for each block, and the mean of the
//! picture by no more.
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

use super::{Pass, Pixel};
use crate::base::Result;
use crate::base::streamed::Streamed;
use crate::base::tensors::{Arrays, Dtype, Tensor, borrowed};

/// Samples of each pixel in a block.
pub const BLOCK: u32 = 64;

/// What variances are made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Detail {
    pub even_means: Vec<Vec3>,
    pub even_counts: Vec<u8>,
    pub deviations: Vec<Vec3>,
}

/// The samples of a block, of which the pixels may be a range of the picture's.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Block {
    pub(super) means: Vec<Vec3>,
    pub(super) counts: Vec<u8>,
    pub(super) detail: Option<Detail>,
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
        let mut block = Self::default();
        block.fill(file, name, pixels, detailed).map(|()| block)
    }

    /// The same in the memory of this block.
    ///
    /// # Errors
    /// As [`Block::read`].
    pub fn fill(&mut self, file: &impl Arrays, name: &str, pixels: usize, detailed: bool) -> Result<()> {
        let vectors = |part: &str, values: &mut Vec<Vec3>, sound: fn(f32) -> bool| -> Result<()> {
            let name = format!("{name}.{part}");
            file.fill(&name, Dtype::F32, Some(pixels), 3, values)?;
            // No early end: so it takes a tenth of the time.
            let numbers: &[f32] = bytemuck::cast_slice(values);
            let all_sound = numbers.iter().fold(true, |all, &number| all & sound(number));
            if all_sound { Ok(()) } else { file.fail(name, "numbers that no samples have") }
        };
        let counts = |part: &str, counts: &mut Vec<u8>| -> Result<()> {
            let name = format!("{name}.{part}");
            file.fill(&name, Dtype::U8, Some(pixels), 1, counts)?;
            match counts.iter().copied().fold(0, u8::max) {
                most if u32::from(most) > BLOCK => {
                    file.fail(name, format!("{most} samples of a pixel, the limit is {BLOCK}"))
                }
                _ => Ok(()),
            }
        };
        vectors("means", &mut self.means, |mean| mean.abs() <= f32::MAX)?;
        counts("counts", &mut self.counts)?;
        if !detailed {
            self.detail = None;
            return Ok(());
        }
        let detail = self.detail.get_or_insert_default();
        vectors("even_means", &mut detail.even_means, |mean| mean.abs() <= f32::MAX)?;
        counts("even_counts", &mut detail.even_counts)?;
        vectors("deviations", &mut detail.deviations, |root| (0.0..=f32::MAX).contains(&root))?;
        match detail.even_counts.iter().zip(&self.counts).find(|(even, all)| even > all) {
            Some((even, all)) => {
                file.fail(format!("{name}.even_counts"), format!("{even} of {all} samples of a pixel"))
            }
            None => Ok(()),
        }
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
