//! Points of the 2D Sobol' sequence, scrambled so that each key has a sequence of its own (Owen 1995).
//!
//! The scrambling is a hash in which every bit depends on the bits above it only (Laine and Karras 2011; Burley 2020, *Practical
//! hash-based Owen scrambling*; constants by Vegdahl 2021). The order of the points is scrambled in the same way, so that sequences
//! of different keys are pairwise independent: the dimensions of a path are padded with 2D points of different keys.

/// Point `index` of the sequence with key `seed`: two coordinates as fractions of 2³².
#[inline(always)]
pub fn point(index: u32, seed: u64) -> [u32; 2] {
    let more = seed.wrapping_mul(0x9E6C_63D0_876A_68EF) ^ (seed >> 29);
    let index = hash(index.reverse_bits(), seed as u32).reverse_bits();
    let x = hash(index, (seed >> 32) as u32).reverse_bits();
    let y = hash(superset_sums(index), (more >> 32) as u32).reverse_bits();
    [x, y]
}

/// The second dimension's matrix, reversed: bit r of the result is the sum of all bits c of `index` whose binomial coefficient
/// (c over r) is odd, which by Lucas's theorem are those with r's bits among c's.
#[inline(always)]
fn superset_sums(mut index: u32) -> u32 {
    for (shift, mask) in [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0F0F_0F0F), (8, 0x00FF_00FF), (16, 0x0000_FFFF)] {
        index ^= (index >> shift) & mask;
    }
    index
}

/// Flips each bit or not, by a hash of the bits below it and `seed`: Owen scrambling of reversed bits.
#[inline(always)]
fn hash(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Every box of area 1/n of every shape that is a power of two holds exactly one of any n = 2^m successive points that begin at
    /// a multiple of n: the sequence is a (0, 2)-sequence in base 2 (Niederreiter 1992), scrambled or not.
    #[test]
    fn every_elementary_box_holds_one_point() {
        for seed in 0..8 {
            let seed = Random::new(seed, 1, 2).next_u64();
            for m in [1u32, 4, 7] {
                for first in [0, 5 << m] {
                    for columns in 0..=m {
                        let mut seen = vec![false; 1 << m];
                        for index in first..first + (1 << m) {
                            let [x, y] = point(index, seed).map(u64::from);
                            let cell = ((x << columns) >> 32 << (m - columns)) | ((y << (m - columns)) >> 32);
                            assert!(!std::mem::replace(&mut seen[cell as usize], true), "{m} {columns} {index}");
                        }
                    }
                }
            }
        }
    }

    /// Over many keys the same index is anywhere: χ² of 16 × 16 cells; false alarm 1e-4 per index.
    #[test]
    fn keys_are_uniform() {
        for index in [0, 1, 1000] {
            let n = 1 << 16;
            let mut counts = [0u32; 256];
            for key in 0..n {
                let [x, y] = point(index, Random::new(7, key, 0).next_u64());
                counts[((x >> 28) << 4 | y >> 28) as usize] += 1;
            }
            let expected = n as f64 / 256.0;
            let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
            assert!(chi2 < 347.7, "{index}: {chi2}");
        }
    }

    /// Coordinates of two keys at the same indices are not correlated: |r| of 2^15 pairs below 4 / √n, false alarm 6e-5 per pair.
    #[test]
    fn keys_are_independent() {
        let n = 1 << 15;
        let centred = |x: u32| f64::from(x) / 4_294_967_296.0 - 0.5;
        for pair in 0..4 {
            let mut sum = 0.0;
            for key in 0..n / 64 {
                let seeds = [0, 1].map(|i| Random::new(3, 2 * (key + n * pair) + i, 0).next_u64());
                for index in 0..64 {
                    let [a, b] = seeds.map(|seed| point(index, seed));
                    sum += 12.0 * centred(a[(pair % 2) as usize]) * centred(b[(pair / 2) as usize]);
                }
            }
            assert!((sum / (n as f64).sqrt()).abs() < 4.0, "pair {pair}: {sum}");
        }
    }
}
