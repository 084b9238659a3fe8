//! Passes as arrays of a file, so that an interrupted render can go on.
//!
//! Names have the name of the pass and a dot before them; those of a half also its number and a dot. For P pixels and T tiles:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `pixels` | f64 | [2 P, 6] | a pass that is being made: means and squared deviations, halves one after the other |
//! | `counts` | u32 | [2 P] | its samples |
//! | `means`, `counts` | f32, u32 | [P, 3], [P] | of a finished pass's half |
//! | `tiles` | f64 | [T, 2] | degrees of freedom and squared deviations of its tiles |
//! | `spread` | f64 | [1, 2] | the same of the whole pass |
//! | `variance` | f32 | [P, 3] or [0, 3] | of a finished pass |
//! | `cascade0`, `cascade1` | | | samples of each half by brightness, where they are kept, see [`Cascade::arrays`] |

use glam::Vec3;

use super::{FinishedPass, Half, Pass, Pixel, Spread, TILE};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, borrowed, doubles, vector};
use crate::film::cascade::Cascade;

/// Most samples of a pixel: as many passes as a render makes can be added up without an overflow.
pub(super) const MOST_SAMPLES: u32 = 1 << 26;

impl Pass {
    /// The arrays of a pass `name`.
    pub fn arrays<'a>(&self, name: &str) -> Vec<Tensor<'a>> {
        let mut all = pixel_arrays(name, self.halves.iter().flatten());
        all.extend(cascade_arrays(name, self.cascades.as_ref()));
        all
    }

    /// The pass of so many columns and rows that [`Pass::arrays`] were made of.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn from_arrays([width, height]: [usize; 2], file: &Tensors, name: &str) -> Result<Self> {
        let mut all = read_pixels(file, name, 2 * width * height)?;
        let second = all.split_off(width * height);
        Ok(Self { width, halves: [all, second], cascades: read_cascades(file, name, width * height)? })
    }
}

fn cascade_name(name: &str, half: usize) -> String {
    format!("{name}.cascade{half}")
}

/// The arrays of the cascades of a pass `name`, if it has them.
fn cascade_arrays<'a>(name: &str, cascades: Option<&[Cascade; 2]>) -> Vec<Tensor<'a>> {
    let halves = cascades.into_iter().flatten().enumerate();
    halves.flat_map(|(half, cascade)| cascade.arrays(&cascade_name(name, half))).collect()
}

/// The cascades of so many pixels that [`cascade_arrays`] were made of.
fn read_cascades(file: &Tensors, name: &str, pixels: usize) -> Result<Option<[Cascade; 2]>> {
    let read = |half| Cascade::read(file, &cascade_name(name, half), pixels);
    let kept = file.has(&format!("{}.runs", cascade_name(name, 0)));
    if kept { Ok(Some([read(0)?, read(1)?])) } else { Ok(None) }
}

/// The arrays of these pixels, all their sums in full.
fn pixel_arrays<'a, 'p>(name: &str, pixels: impl Iterator<Item = &'p Pixel> + Clone) -> Vec<Tensor<'a>> {
    let numbers = |pixel: &Pixel| {
        let ([a, b, c], [d, e, f]) = (pixel.mean, pixel.spread);
        [a, b, c, d, e, f]
    };
    vec![
        doubles(format!("{name}.pixels"), pixels.clone().map(numbers)),
        vector(format!("{name}.counts"), Dtype::U32, pixels.map(|pixel| pixel.count.to_le_bytes())),
    ]
}

/// So many pixels that [`pixel_arrays`] were made of.
fn read_pixels(file: &Tensors, name: &str, pixels: usize) -> Result<Vec<Pixel>> {
    let [numbers_name, counts_name] = ["pixels", "counts"].map(|part| format!("{name}.{part}"));
    let numbers = file.read(&numbers_name, Dtype::F64, Some(pixels), 6, f64::from_le_bytes)?;
    let counts = read_counts(file, &counts_name, pixels)?;
    // Means of singles, and sums of squares.
    let in_range = |numbers: &[f64; 6]| {
        let (means, squares) = numbers.split_at(3);
        means.iter().all(|x| x.abs() <= f64::from(f32::MAX)) && squares.iter().all(|x| x.is_finite() && *x >= 0.0)
    };
    if !numbers.as_chunks::<6>().0.iter().all(in_range) {
        return file.fail(numbers_name, "numbers that no samples have");
    }
    let pixel = |(&[a, b, c, d, e, f], &count): (&[f64; 6], &u32)| Pixel { mean: [a, b, c], spread: [d, e, f], count };
    Ok(numbers.as_chunks::<6>().0.iter().zip(&counts).map(pixel).collect())
}

impl FinishedPass {
    /// The arrays of a pass `name`.
    pub fn arrays<'a>(&'a self, name: &str) -> Vec<Tensor<'a>> {
        let mut all = vec![
            doubles(format!("{name}.spread"), std::iter::once(self.spread.numbers())),
            borrowed::<_, 4>(format!("{name}.variance"), (Dtype::F32, 3), &self.variance),
        ];
        for (i, half) in self.halves.iter().enumerate() {
            all.extend([
                borrowed::<_, 4>(format!("{name}.{i}.means"), (Dtype::F32, 3), &half.means),
                borrowed::<_, 4>(format!("{name}.{i}.counts"), (Dtype::U32, 1), &half.counts),
                doubles(format!("{name}.{i}.tiles"), half.tiles.iter().map(Spread::numbers)),
            ]);
        }
        all.extend(cascade_arrays(name, self.cascades.as_ref()));
        all
    }

    /// The pass of so many columns and rows that [`FinishedPass::arrays`] were made of.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn from_arrays([width, height]: [usize; 2], file: &Tensors, name: &str) -> Result<Self> {
        let pixels = width * height;
        let vectors = |name: &str, rows: Option<usize>| -> Result<Vec<Vec3>> {
            let values = file.read(name, Dtype::F32, rows, 3, f32::from_le_bytes)?;
            Ok(values.as_chunks::<3>().0.iter().map(|&v| Vec3::from_array(v)).collect())
        };
        let spreads = |name: &str, rows: usize| -> Result<Vec<Spread>> {
            let values = file.read(name, Dtype::F64, Some(rows), 2, f64::from_le_bytes)?;
            Ok(values.as_chunks::<2>().0.iter().map(Spread::from_numbers).collect())
        };
        let half = |i: usize| -> Result<Half> {
            let means = vectors(&format!("{name}.{i}.means"), Some(pixels))?;
            if !means.iter().all(|mean| mean.is_finite()) {
                return file.fail(format!("{name}.{i}.means"), "samples that are not finite");
            }
            let counts = read_counts(file, &format!("{name}.{i}.counts"), pixels)?;
            let tiles = spreads(&format!("{name}.{i}.tiles"), width.div_ceil(TILE) * height.div_ceil(TILE))?;
            Ok(Half { means, counts, tiles })
        };
        let variance = vectors(&format!("{name}.variance"), None)?;
        if !variance.is_empty() && variance.len() != pixels {
            return file.fail(format!("{name}.variance"), format!("{} variances for {pixels} pixels", variance.len()));
        }
        let spread = spreads(&format!("{name}.spread"), 1)?[0];
        let cascades = read_cascades(file, name, pixels)?;
        Ok(Self { width, halves: [half(0)?, half(1)?], spread, variance, cascades })
    }
}

fn read_counts(file: &Tensors, name: &str, pixels: usize) -> Result<Vec<u32>> {
    let counts = file.read(name, Dtype::U32, Some(pixels), 1, u32::from_le_bytes)?;
    match counts.iter().find(|&&count| count > MOST_SAMPLES) {
        Some(count) => file.fail(name, format!("{count} samples of a pixel, the limit is {MOST_SAMPLES}")),
        None => Ok(counts),
    }
}

impl Spread {
    /// Both sums as numbers; exact, since there are fewer than 2⁵³ samples.
    fn numbers(&self) -> [f64; 2] {
        [self.freedom as f64, self.sum]
    }

    fn from_numbers(&[freedom, sum]: &[f64; 2]) -> Self {
        Self { freedom: freedom.clamp(0.0, 9e15) as u64, sum }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::base::tensors;

    #[test]
    fn passes_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("passes");
        for mut pass in [Pass::new(20, 3), Pass::with_cascades(20, 3)] {
            let mut random = Random::new(1, 0, 0);
            for sample in 0..5 {
                (0..60)
                    .for_each(|i| pass.add(i, sample, Vec3::new(random.next_f32(), 1e-30, random.next_f32() * 1e20)));
            }
            let finished = [pass.finish(), pass.finish_with_variance()];
            let mut all = pass.arrays("a");
            all.extend(finished.iter().zip(["b", "c"]).flat_map(|(pass, name)| pass.arrays(name)));
            tensors::write(&path, 7, &all).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let file = Tensors::open(&path, &bytes, "passes", 7).unwrap();
            assert_eq!(Pass::from_arrays([20, 3], &file, "a").unwrap(), pass);
            for (pass, name) in finished.iter().zip(["b", "c"]) {
                assert_eq!(&FinishedPass::from_arrays([20, 3], &file, name).unwrap(), pass);
            }
            assert!(Pass::from_arrays([20, 4], &file, "a").is_err());
            assert!(FinishedPass::from_arrays([60, 1], &file, "b").is_err(), "other tiles");
            assert!(FinishedPass::from_arrays([20, 3], &file, "d").is_err());
        }
    }
}
