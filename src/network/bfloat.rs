//! Layers in bfloat16: single precision without the lower half of its bits, two numbers to a word.
//!
//! Weights and inputs are rounded, products and sums are not: on processors that have the instruction, one takes two products of
//! sixteen columns at once. What that saves in time and costs in accuracy, `eval --pareto` shows.

use super::kernels::{Arithmetic, BLOCK, Instructions, Number, Packed, Task};
use super::weights::LayerWeights;

/// Two numbers in bfloat16, the first in the lower bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(transparent)]
pub struct Pair(u32);

impl Pair {
    /// Rounds both, ties to even.
    pub fn new(low: f32, high: f32) -> Self {
        Self(rounded(low) | rounded(high) << 16)
    }

    /// The two numbers.
    #[inline(always)]
    pub fn numbers(self) -> [f32; 2] {
        [f32::from_bits(self.0 << 16), f32::from_bits(self.0 & 0xffff_0000)]
    }
}

/// The bits of `x` in bfloat16, ties to even. Without branches, so that it can be done for many numbers at once.
#[inline(always)]
fn rounded(x: f32) -> u32 {
    let bits = x.to_bits();
    let number = bits.wrapping_add(0x7fff + (bits >> 16 & 1)) >> 16;
    if x.is_nan() { 0x7fc0 } else { number }
}

/// Rows [rows, channels] as pairs; an odd number of channels gets one of zeros.
pub fn pairs(rows: &[f32], channels: usize) -> Vec<Pair> {
    let pair = |&[low, high]: &[f32; 2]| Pair::new(low, high);
    if channels.is_multiple_of(2) {
        return rows.as_chunks().0.iter().map(pair).collect();
    }
    let mut paired = Vec::with_capacity(rows.len() / channels * channels.div_ceil(2));
    for row in rows.chunks_exact(channels) {
        let (two, one) = row.as_chunks();
        paired.extend(two.iter().map(pair));
        paired.extend(one.iter().map(|&last| Pair::new(last, 0.0)));
    }
    paired
}

/// A layer whose inputs have these numbers of `channels`; an odd number gets a channel of zeros, as in [`pairs`].
pub fn packed(layer: &LayerWeights, channels: &[usize]) -> Packed<Pair> {
    let columns = layer.columns;
    let mut matrix = Vec::with_capacity(layer.weight.len() / 2);
    let mut rows = layer.weight.as_slice();
    for &channels in channels {
        let (of_input, rest) = rows.split_at(channels * columns);
        rows = rest;
        for two in of_input.chunks(2 * columns) {
            let (low, high) = two.split_at(columns);
            matrix.extend((0..columns).map(|c| Pair::new(low[c], high.get(c).copied().unwrap_or(0.0))));
        }
    }
    Packed::of(&matrix, columns, &layer.bias)
}

impl Number for Pair {
    const PANELS: [usize; 3] = [16, 24, 8];

    #[inline(always)]
    fn add<const FMA: bool>(sum: f32, x: Self, w: Self) -> f32 {
        let (x, w) = (x.numbers(), w.numbers());
        f32::add::<FMA>(f32::add::<FMA>(sum, x[0], w[0]), x[1], w[1])
    }

    fn run<const PANEL: usize>(task: &Task<Self>, instructions: Instructions, out: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if PANEL == 16 && instructions == Instructions::Avx512 && is_x86_feature_detected!("avx512bf16") {
            // SAFETY: AVX-512 with bfloat16 was detected on this processor.
            return unsafe { rows_dot::<PANEL>(task, out) };
        }
        task.run::<PANEL>(instructions, out);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bf16")]
fn rows_dot<const PANEL: usize>(task: &Task<Pair>, out: &mut [f32]) {
    task.rows::<PANEL, Dot>(out);
}

/// The processor's own instruction for the scalar product of pairs, sixteen columns at once.
#[cfg(target_arch = "x86_64")]
struct Dot;

#[cfg(target_arch = "x86_64")]
impl Arithmetic<Pair> for Dot {
    #[inline(always)]
    fn multiply<const PANEL: usize>(sums: &mut [[f32; PANEL]; BLOCK], rows: [&[Pair]; BLOCK], weight: &[Pair]) {
        use std::arch::x86_64::{__m512, __m512bh, __m512i, _mm512_dpbf16_ps, _mm512_set1_epi32};
        assert!(PANEL == 16, "sixteen columns are a vector");
        let [a, b, c, d] = rows;
        // SAFETY: only `rows_dot` uses this, whose features have these instructions, and only for panels of 16: arrays of 16
        // floats or pairs have the size of the vectors that they are read as, all bits of which are valid.
        unsafe {
            let mut local = sums.each_ref().map(|row| std::mem::transmute_copy::<[f32; PANEL], __m512>(row));
            for ((((w, a), b), c), d) in weight.as_chunks::<PANEL>().0.iter().zip(a).zip(b).zip(c).zip(d) {
                let w = std::mem::transmute_copy::<[Pair; PANEL], __m512bh>(w);
                for (sum, x) in local.iter_mut().zip([a, b, c, d]) {
                    let x = std::mem::transmute::<__m512i, __m512bh>(_mm512_set1_epi32(x.0.cast_signed()));
                    *sum = _mm512_dpbf16_ps(*sum, x, w);
                }
            }
            *sums = local.map(|row| std::mem::transmute_copy::<__m512, [f32; PANEL]>(&row));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::network::kernels::{Epilogue, Index, Part, apply_with};

    #[test]
    fn numbers_are_rounded_to_even() {
        assert_eq!(Pair::new(1.0, -2.5).numbers(), [1.0, -2.5]);
        // 1 + 2⁻⁸ lies between two numbers of eight bits, 1 + 3·2⁻⁸ too.
        assert_eq!(Pair::new(1.0 + 0.003_906_25, 1.0 + 3.0 * 0.003_906_25).numbers(), [1.0, 1.015_625]);
        assert_eq!(pairs(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3).len(), 4);
    }

    /// Every kind of instructions gives the layer of the rounded numbers, with odd channels, missing rows and every panel.
    #[test]
    fn layers_are_those_of_rounded_numbers() {
        let mut random = Random::new(2, 0, 0);
        let round = |x: f32| Pair::new(x, 0.0).numbers()[0];
        for (rows, channels, columns) in [(1, 16, 16), (7, 21, 8), (1031, 24, 24), (33, 13, 1), (9, 48, 64)] {
            let mut uniform = |n: usize| (0..n).map(|_| random.range(-1.0, 1.0)).collect::<Vec<f32>>();
            let (x, weight, bias) = (uniform(rows * channels), uniform(2 * channels * columns), uniform(columns));
            let layer = LayerWeights { rows: 2 * channels, columns, weight, bias };
            let packed = packed(&layer, &[channels, channels]);
            let paired = pairs(&x, channels);
            let index: Vec<u32> =
                (0..rows as u32).map(|row| if row % 3 == 1 { rows as u32 } else { (row * 7) % rows as u32 }).collect();
            let part = |index| Part { x: &paired, channels: channels.div_ceil(2), index };
            let parts = [part(Index::Same), part(Index::Gather { index: &index, stride: 1, offset: 0 })];
            for instructions in [Instructions::Portable, Instructions::Avx2, Instructions::Avx512] {
                let found = apply_with(instructions, &packed, &parts, Epilogue { residual: None, relu: false }, rows);
                for row in 0..rows {
                    for column in 0..columns {
                        let weight = |r: usize| f64::from(round(layer.weight[r * columns + column]));
                        let term = |from: usize, c: usize, r: usize| {
                            x.get(from * channels + c).map_or(0.0, |&x| f64::from(round(x))) * weight(r)
                        };
                        let terms = (0..channels).map(|c| term(row, c, c) + term(index[row] as usize, c, channels + c));
                        let expected = f64::from(layer.bias[column]) + terms.sum::<f64>();
                        let found = f64::from(found[row * columns + column]);
                        assert!(
                            (found - expected).abs() < 1e-4,
                            "{instructions:?} {channels} {columns}: {found} {expected}"
                        );
                    }
                }
            }
        }
    }
}
