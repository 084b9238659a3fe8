//! The embedded path's one hot loop: rows gathered from several inputs, times a matrix, plus bias and residual, rectified.
//!
//! A convolution over nine neighbours is nine inputs of the same rows under nine indices; a linear layer of concatenated
//! inputs is one input each. So neither the gathered nor the concatenated matrix is ever written to memory. Each input is added to all
//! output rows of a block that have it before the next one is: a sparse tree lacks many neighbours, and those cost nothing. As many rows
//! are computed at once as their sums fit into registers, so that additions need not wait for one another.

use rayon::prelude::*;

use super::weights::LayerWeights;

/// Rows computed together: with up to 24 columns their sums fill the 16 vector registers of AVX2.
const ROWS: usize = 4;
/// The same with the 32 registers of AVX-512.
const ROWS_AVX512: usize = 8;
/// Rows to which an input is added before the next one: their sums stay in the nearest cache.
const BLOCK: usize = 128;
/// Rows per parallel task.
const TASK: usize = 8 * BLOCK;

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

impl Part<'_> {
    /// Lists those of `count` output rows from `first` on that have a row of this input, counted from `first`, beside that row; returns
    /// how many there are.
    #[inline(always)]
    fn list(&self, first: usize, count: usize, present: &mut [Pair; BLOCK]) -> usize {
        let rows = self.x.len() / self.channels;
        let mut found = 0;
        for place in 0..count {
            let row = first + place;
            let source = match self.index {
                Index::Same => row,
                Index::Gather { index, stride, offset } => index[row * stride + offset] as usize,
            };
            // Without a branch, which could not be guessed.
            present[found % BLOCK] = Pair { place: place as u32, source: source as u32 };
            found += usize::from(source < rows);
        }
        found
    }
}

/// An output row, counted from the first of its block, and the row of an input that it reads.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    place: u32,
    source: u32,
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
    out.par_chunks_mut(TASK * columns).enumerate().for_each(|(task, out)| {
        let task = Task { packed, parts, epilogue, first: task * TASK };
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

/// Channels whose numbers are read without comparing their indices with lengths.
const RUN: usize = 8;

/// Adds `rows` times `weight` [channels, PANEL] to `sums`, number by number, which the compiler makes vectors of. Here and in what calls it
/// there are no closures: they would be compiled without the instructions of the caller.
#[inline(always)]
fn multiply<const PANEL: usize, const ROWS: usize, const FMA: bool>(
    sums: &mut [[f32; PANEL]; ROWS],
    rows: &[&[f32]; ROWS],
    weight: &[f32],
) {
    let (weight, _) = weight.as_chunks::<PANEL>();
    let (runs, rest) = weight.as_chunks::<RUN>();
    for (run, weight) in runs.iter().enumerate() {
        let mut x = [&[0.0; RUN]; ROWS];
        for i in 0..ROWS {
            x[i] = &rows[i].as_chunks::<RUN>().0[run];
        }
        for channel in 0..RUN {
            for i in 0..ROWS {
                add::<PANEL, FMA>(&mut sums[i], x[i][channel], &weight[channel]);
            }
        }
    }
    for (channel, weight) in rest.iter().enumerate() {
        for i in 0..ROWS {
            add::<PANEL, FMA>(&mut sums[i], rows[i][RUN * runs.len() + channel], weight);
        }
    }
}

#[inline(always)]
fn add<const PANEL: usize, const FMA: bool>(sums: &mut [f32; PANEL], x: f32, weight: &[f32; PANEL]) {
    for i in 0..PANEL {
        // Without the instruction, `mul_add` is a slow library call.
        sums[i] = if FMA { x.mul_add(weight[i], sums[i]) } else { x * weight[i] + sums[i] };
    }
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
    task.rows::<PANEL, ROWS_AVX512, true>(out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn rows_avx2<const PANEL: usize>(task: &Task, out: &mut [f32]) {
    task.rows::<PANEL, ROWS, true>(out);
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
            _ => self.rows::<PANEL, ROWS, false>(out),
        }
    }

    #[inline(always)]
    fn rows<const PANEL: usize, const ROWS: usize, const FMA: bool>(&self, out: &mut [f32]) {
        let columns = self.packed.columns;
        for (block, out) in out.chunks_mut(BLOCK * columns).enumerate() {
            let first = self.first + block * BLOCK;
            out.chunks_exact_mut(columns).for_each(|row| row.copy_from_slice(&self.packed.bias));
            let mut rows_before = 0;
            for part in self.parts {
                self.add::<PANEL, ROWS, FMA>(part, rows_before, first, out);
                rows_before += part.channels;
            }
            self.finish(out, first * columns);
        }
    }

    /// Adds a part, whose channels are those of the matrix after `rows_before`, to the rows of `out`, the first of which is `first`.
    #[inline(always)]
    fn add<const PANEL: usize, const ROWS: usize, const FMA: bool>(
        &self,
        part: &Part,
        rows_before: usize,
        first: usize,
        out: &mut [f32],
    ) {
        let mut present = [Pair::default(); BLOCK];
        let count = part.list(first, out.len() / self.packed.columns, &mut present);
        let (full, rest) = present[..count].as_chunks::<ROWS>();
        for group in full {
            self.add_group::<PANEL, ROWS, FMA>(part, rows_before, group, ROWS, out);
        }
        if let Some(&filler) = rest.first() {
            let mut group = [filler; ROWS];
            group[..rest.len()].copy_from_slice(rest);
            self.add_group::<PANEL, ROWS, FMA>(part, rows_before, &group, rest.len(), out);
        }
    }

    /// Adds the rows of a part to those of `out` that are paired with them; only the first `count` pairs are meant.
    #[inline(always)]
    fn add_group<const PANEL: usize, const ROWS: usize, const FMA: bool>(
        &self,
        part: &Part,
        rows_before: usize,
        group: &[Pair; ROWS],
        count: usize,
        out: &mut [f32],
    ) {
        let Packed { columns, rows, weight, .. } = self.packed;
        let mut x: [&[f32]; ROWS] = [&[]; ROWS];
        for i in 0..ROWS {
            x[i] = &part.x[group[i].source as usize * part.channels..][..part.channels];
        }
        for panel in 0..columns / PANEL {
            let weight = &weight[(panel * rows + rows_before) * PANEL..][..part.channels * PANEL];
            let mut sums = [[0.0; PANEL]; ROWS];
            for i in 0..ROWS {
                sums[i].copy_from_slice(&out[group[i].place as usize * columns + panel * PANEL..][..PANEL]);
            }
            multiply::<PANEL, ROWS, FMA>(&mut sums, &x, weight);
            for i in 0..ROWS {
                if i < count {
                    out[group[i].place as usize * columns + panel * PANEL..][..PANEL].copy_from_slice(&sums[i]);
                }
            }
        }
    }

    /// What follows, for the rows of `out`, whose first number is the one with this index of all.
    #[inline(always)]
    fn finish(&self, out: &mut [f32], start: usize) {
        if let Some(residual) = self.epilogue.residual {
            out.iter_mut().zip(&residual[start..]).for_each(|(x, r)| *x += r);
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
