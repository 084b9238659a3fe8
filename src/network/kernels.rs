//! The embedded path's one hot loop: rows gathered from several inputs, times a matrix, plus bias and residual, rectified.
//!
//! A convolution over nine neighbours is nine inputs of the same rows under nine indices; a linear layer of concatenated
//! inputs is one input each. So neither the gathered nor the concatenated matrix is ever written to memory. Four rows are
//! computed at once, which are four siblings below the root and mostly lack the same neighbours.

use rayon::prelude::*;

use super::weights::LayerWeights;

/// Rows computed together: with up to 24 columns their sums fill the 16 vector registers of AVX2.
const BLOCK: usize = 4;
/// Blocks per parallel task.
const TASK: usize = 256;

/// Rule by which output rows find their rows of an input.
#[derive(Debug, Clone, Copy)]
pub enum Index<'a> {
    /// Output row i reads row i.
    Same,
    /// Output row i reads row `index[i · stride + offset]`; an index beyond the last row is a zero row.
    Gather {
        /// The indices.
        index: &'a [u32],
        /// Indices per output row.
        stride: usize,
        /// Position of the index among those of an output row.
        offset: usize,
    },
}

/// One block of a layer's input channels.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a> {
    /// [rows, channels].
    pub x: &'a [f32],
    /// Columns of `x`, not 0.
    pub channels: usize,
    /// Rule by which output rows find their rows of `x`.
    pub index: Index<'a>,
}

impl<'a> Part<'a> {
    /// The row that output row `row` reads; empty where it is missing.
    #[inline(always)]
    fn row(&self, row: usize) -> &'a [f32] {
        let source = match self.index {
            Index::Same => row,
            Index::Gather { index, stride, offset } => index[row * stride + offset] as usize,
        };
        let start = source * self.channels;
        self.x.get(start..start + self.channels).unwrap_or(&[])
    }
}

/// Operations that follow `x · W + b`.
#[derive(Debug, Clone, Copy)]
pub struct Epilogue<'a> {
    /// [rows, columns] to add, if any.
    pub residual: Option<&'a [f32]>,
    /// Whether max(·, 0) follows.
    pub relu: bool,
}

/// A layer's weights in panels of columns that fit the registers: [columns / panel][rows][panel].
#[derive(Debug, Clone)]
pub struct Packed {
    panel: usize,
    columns: usize,
    rows: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

/// Numbers of columns that are computed together, the fastest first.
const PANELS: [usize; 3] = [24, 16, 8];

impl Packed {
    /// Packs a layer.
    pub fn new(layer: &LayerWeights) -> Self {
        let LayerWeights { columns, weight: matrix, bias, .. } = layer;
        let panel = PANELS.into_iter().find(|panel| columns.is_multiple_of(*panel)).unwrap_or(1);
        let mut weight = Vec::with_capacity(matrix.len());
        for first in (0..*columns).step_by(panel) {
            for row in matrix.chunks_exact(*columns) {
                weight.extend_from_slice(&row[first..first + panel]);
            }
        }
        Self { panel, columns: *columns, rows: matrix.len() / columns, weight, bias: bias.clone() }
    }

    /// Output columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Input rows of the matrix: the sum of the parts' channels.
    pub fn rows(&self) -> usize {
        self.rows
    }
}

/// The layer on `rows` rows: [rows, columns]. The parts' channels together are [`Packed::rows`].
///
/// Every output depends on its own row's inputs only and is summed in a fixed order, so threads do not change a bit.
pub fn apply(packed: &Packed, parts: &[Part], epilogue: Epilogue, rows: usize) -> Vec<f32> {
    apply_with(Instructions::best(), packed, parts, epilogue, rows)
}

/// As [`apply`] with the given instructions, or the best that this processor has below them.
pub fn apply_with(
    instructions: Instructions,
    packed: &Packed,
    parts: &[Part],
    epilogue: Epilogue,
    rows: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; rows * packed.columns];
    let columns = packed.columns;
    let instructions = instructions.min(Instructions::best());
    out.par_chunks_mut(TASK * BLOCK * columns).enumerate().for_each(|(task, out)| {
        let first = task * TASK * BLOCK;
        let task = Task { packed, parts, epilogue, first };
        match packed.panel {
            8 => task.run::<8>(instructions, out),
            16 => task.run::<16>(instructions, out),
            24 => task.run::<24>(instructions, out),
            _ => task.run::<1>(instructions, out),
        }
    });
    out
}

/// Vector instructions, from fewest to most. All but the first fuse multiplication and addition, and give the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instructions {
    /// Those that the build assumes of every machine.
    Portable,
    /// 8 lanes.
    Avx2,
    /// 16 lanes.
    Avx512,
}

impl Instructions {
    /// Best instructions that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("fma") {
                return Self::Avx512;
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Self::Avx2;
            }
        }
        Self::Portable
    }
}

/// Adds `rows` times `weight` [channels, PANEL] to `sums`, number by number, which the compiler makes vectors of.
#[inline(always)]
fn multiply<const PANEL: usize, const FMA: bool>(
    sums: &mut [[f32; PANEL]; BLOCK],
    rows: [&[f32]; BLOCK],
    weight: &[f32],
) {
    // A local copy stays in registers; `sums` itself would be written back in every turn.
    let mut local = *sums;
    let [a, b, c, d] = rows;
    let (weight, _) = weight.as_chunks::<PANEL>();
    for ((((w, &a), &b), &c), &d) in weight.iter().zip(a).zip(b).zip(c).zip(d) {
        for (sums, x) in local.iter_mut().zip([a, b, c, d]) {
            for (sum, &w) in sums.iter_mut().zip(w) {
                // Without the instruction, `mul_add` is a slow library call.
                *sum = if FMA { x.mul_add(w, *sum) } else { x * w + *sum };
            }
        }
    }
    *sums = local;
}

/// Consecutive output rows from `first` on.
struct Task<'a> {
    packed: &'a Packed,
    parts: &'a [Part<'a>],
    epilogue: Epilogue<'a>,
    first: usize,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,fma")]
fn rows_avx512<const PANEL: usize>(task: &Task, out: &mut [f32]) {
    task.rows::<PANEL, true>(out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn rows_avx2<const PANEL: usize>(task: &Task, out: &mut [f32]) {
    task.rows::<PANEL, true>(out);
}

impl Task<'_> {
    /// Computes the rows with these instructions, which this processor has.
    fn run<const PANEL: usize>(&self, instructions: Instructions, out: &mut [f32]) {
        match instructions {
            // SAFETY: `apply_with` lets these pass only after their features were detected on this processor.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { rows_avx512::<PANEL>(self, out) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { rows_avx2::<PANEL>(self, out) },
            _ => self.rows::<PANEL, false>(out),
        }
    }

    #[inline(always)]
    fn rows<const PANEL: usize, const FMA: bool>(&self, out: &mut [f32]) {
        let columns = self.packed.columns;
        for (block, out) in out.chunks_mut(BLOCK * columns).enumerate() {
            let first = self.first + block * BLOCK;
            for panel in 0..columns / PANEL {
                let sums = self.block::<PANEL, FMA>(first, out.len() / columns, panel);
                for (row, (out, sums)) in out.chunks_exact_mut(columns).zip(&sums).enumerate() {
                    self.finish(&mut out[panel * PANEL..][..PANEL], sums, (first + row) * columns + panel * PANEL);
                }
            }
        }
    }

    /// x · W + b of one panel for the `count` ≤ [`BLOCK`] rows from `first` on.
    #[inline(always)]
    fn block<const PANEL: usize, const FMA: bool>(
        &self,
        first: usize,
        count: usize,
        panel: usize,
    ) -> [[f32; PANEL]; BLOCK] {
        let packed = self.packed;
        let mut sums = [[0.0; PANEL]; BLOCK];
        sums.iter_mut().for_each(|row| row.copy_from_slice(&packed.bias[panel * PANEL..][..PANEL]));
        let mut weight = &packed.weight[panel * packed.rows * PANEL..][..packed.rows * PANEL];
        let zeros = [0.0; MAX_CHANNELS];
        for part in self.parts {
            let (of_part, rest) = weight.split_at(part.channels * PANEL);
            weight = rest;
            let rows: [&[f32]; BLOCK] = std::array::from_fn(|r| if r < count { part.row(first + r) } else { &[] });
            if rows.iter().all(|row| row.is_empty()) {
                continue;
            }
            let rows = rows.map(|row| if row.is_empty() { &zeros[..part.channels] } else { row });
            multiply::<PANEL, FMA>(&mut sums, rows, of_part);
        }
        sums
    }

    #[inline(always)]
    fn finish<const PANEL: usize>(&self, out: &mut [f32], sums: &[f32; PANEL], start: usize) {
        out.copy_from_slice(sums);
        if let Some(residual) = self.epilogue.residual {
            out.iter_mut().zip(&residual[start..start + PANEL]).for_each(|(x, r)| *x += r);
        }
        if self.epilogue.relu {
            out.iter_mut().for_each(|x| *x = x.max(0.0));
        }
    }
}

/// Most channels of one part.
pub const MAX_CHANNELS: usize = 128;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Odd row counts, missing neighbours, and every panel width.
    #[test]
    fn portable_and_vector_code_agree() {
        let mut random = Random::new(1, 0, 0);
        for (rows, channels, columns) in
            [(1, 16, 16), (7, 8, 8), (1031, 24, 24), (50, 48, 48), (9, 64, 64), (33, 16, 1)]
        {
            let mut uniform = |n: usize| (0..n).map(|_| random.range(-1.0, 1.0)).collect::<Vec<f32>>();
            let (x, residual) = (uniform(rows * channels), uniform(rows * columns));
            let (weight, bias) = (uniform(9 * channels * columns), uniform(columns));
            let packed = Packed::new(&LayerWeights { rows: 9 * channels, columns, weight, bias });
            let index: Vec<u32> = (0..9 * rows).map(|_| random.below(2 * rows as u32).min(rows as u32)).collect();
            let part = |offset| Part { x: &x, channels, index: Index::Gather { index: &index, stride: 9, offset } };
            let parts: Vec<Part> = (0..9).map(part).collect();
            let epilogue = Epilogue { residual: Some(&residual), relu: columns > 8 };
            let with = |instructions| apply_with(instructions, &packed, &parts, epilogue, rows);
            let (portable, avx2) = (with(Instructions::Portable), with(Instructions::Avx2));
            for (a, b) in avx2.iter().zip(&portable) {
                assert!((a - b).abs() <= 1e-5 * (b.abs() + 1.0), "{a} {b}, {columns} columns");
            }
            assert_eq!(with(Instructions::Avx512), avx2);
        }
    }
}
