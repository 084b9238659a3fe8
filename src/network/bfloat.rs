//! Layers in bfloat16: single precision without the lower half of its bits, two numbers to a word.
//!
//! Weights and inputs are rounded, products and sums are not: on processors that have the instruction, one takes two products of
//! sixteen columns at once. What that saves in time and costs in accuracy, `eval --pareto` shows.

use super::kernels::{Arithmetic, BLOCK, Instructions, Number, Task, multiply};

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

impl Number for Pair {
    fn run<const PANEL: usize>(task: &Task<Self>, instructions: Instructions, out: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if instructions == Instructions::Avx512 && is_x86_feature_detected!("avx512bf16") && PANEL > 1 {
            // SAFETY: AVX-512 with bfloat16 was detected on this processor.
            return unsafe { rows_dot::<PANEL>(task, out) };
        }
        #[cfg(target_arch = "x86_64")]
        if instructions >= Instructions::Avx2 {
            // SAFETY: `apply_with` lets these pass only after their features were detected on this processor.
            return unsafe { rows_avx2::<PANEL>(task, out) };
        }
        task.rows::<PANEL, Unpacked<false>>(out);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bf16,fma")]
fn rows_dot<const PANEL: usize>(task: &Task<Pair>, out: &mut [f32]) {
    task.rows::<PANEL, Dot>(out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn rows_avx2<const PANEL: usize>(task: &Task<Pair>, out: &mut [f32]) {
    task.rows::<PANEL, Unpacked<true>>(out);
}

/// Pairs unpacked to single precision, with fused multiplication and addition or without.
struct Unpacked<const FMA: bool>;

impl<const FMA: bool> Arithmetic<Pair> for Unpacked<FMA> {
    #[inline(always)]
    fn multiply<const PANEL: usize>(sums: &mut [[f32; PANEL]; BLOCK], rows: [&[Pair]; BLOCK], weight: &[Pair]) {
        multiply(sums, rows, weight, |sum, x, w| {
            let (x, w) = (x.numbers(), w.numbers());
            if FMA { x[1].mul_add(w[1], x[0].mul_add(w[0], sum)) } else { x[1] * w[1] + (x[0] * w[0] + sum) }
        });
    }
}

/// The processor's own instruction for the scalar product of pairs.
#[cfg(target_arch = "x86_64")]
struct Dot;

#[cfg(target_arch = "x86_64")]
impl Arithmetic<Pair> for Dot {
    #[inline(always)]
    fn multiply<const PANEL: usize>(sums: &mut [[f32; PANEL]; BLOCK], rows: [&[Pair]; BLOCK], weight: &[Pair]) {
        use std::arch::x86_64::{
            __m256, __m256bh, __m256i, __m512, __m512bh, __m512i, _mm256_dpbf16_ps, _mm256_set1_epi32,
            _mm512_dpbf16_ps, _mm512_set1_epi32,
        };
        let [a, b, c, d] = rows;
        let words = weight.as_chunks::<PANEL>().0.iter().zip(a).zip(b).zip(c).zip(d);
        // SAFETY: only `rows_dot` uses this, whose features have these instructions. Arrays of PANEL floats or pairs have the
        // size of the vectors that they are read as, all bits of which are valid.
        unsafe {
            if PANEL == 16 {
                let mut local = sums.each_ref().map(|row| std::mem::transmute_copy::<[f32; PANEL], __m512>(row));
                for ((((w, a), b), c), d) in words {
                    let w = std::mem::transmute_copy::<[Pair; PANEL], __m512bh>(w);
                    for (sum, x) in local.iter_mut().zip([a, b, c, d]) {
                        let x = std::mem::transmute::<__m512i, __m512bh>(_mm512_set1_epi32(x.0.cast_signed()));
                        *sum = _mm512_dpbf16_ps(*sum, x, w);
                    }
                }
                *sums = local.map(|row| std::mem::transmute_copy::<__m512, [f32; PANEL]>(&row));
            } else if PANEL == 8 {
                let mut local = sums.each_ref().map(|row| std::mem::transmute_copy::<[f32; PANEL], __m256>(row));
                for ((((w, a), b), c), d) in words {
                    let w = std::mem::transmute_copy::<[Pair; PANEL], __m256bh>(w);
                    for (sum, x) in local.iter_mut().zip([a, b, c, d]) {
                        let x = std::mem::transmute::<__m256i, __m256bh>(_mm256_set1_epi32(x.0.cast_signed()));
                        *sum = _mm256_dpbf16_ps(*sum, x, w);
                    }
                }
                *sums = local.map(|row| std::mem::transmute_copy::<__m256, [f32; PANEL]>(&row));
            } else {
                Unpacked::<true>::multiply(sums, rows, weight);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::network::kernels::{Epilogue, Index, Packed, Part, apply_with};
    use crate::network::weights::LayerWeights;

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
            let packed = Packed::pairs(&layer, &[channels, channels]);
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
