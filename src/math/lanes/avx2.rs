//! Lanes of AVX2, in two halves. Who holds a value got it from an [`Avx2`], which proves that the processor has the instructions.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

use super::{Bits, Job, Kernel, LANES, Mask, Real, Wide, as_bytes, columns_by_four, lane_by_lane, same_number};
use crate::base::processor::Avx2;

/// Numbers.
#[derive(Debug, Clone, Copy)]
pub struct Numbers([__m256; 2]);

/// Integers.
#[derive(Debug, Clone, Copy)]
pub struct Integers([__m256i; 2]);

/// Answers: all bits of a lane, or none.
#[derive(Debug, Clone, Copy)]
pub struct Answers([__m256; 2]);

/// Both halves by an instruction.
macro_rules! halves {
    ($make:ident, $intrinsic:ident $(::<$constant:tt>)?, $($value:expr),+) => {
        // SAFETY: the values prove that the processor has the instruction.
        unsafe { $make([$intrinsic$(::<$constant>)?($($value.0[0]),+), $intrinsic$(::<$constant>)?($($value.0[1]),+)]) }
    };
}

macro_rules! operators {
    ($type:ident: $($trait:ident $name:ident $intrinsic:ident),+) => {$(
        impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                halves!($type, $intrinsic, self, other)
            }
        }
    )+};
}

operators!(Numbers: Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps);
operators!(Integers: Add add _mm256_add_epi32, Sub sub _mm256_sub_epi32);
operators!(Integers: BitAnd bitand _mm256_and_si256, BitOr bitor _mm256_or_si256, BitXor bitxor _mm256_xor_si256);
operators!(Answers: BitAnd bitand _mm256_and_ps, BitOr bitor _mm256_or_ps);

same_number!(Numbers: Add add, Sub sub, Mul mul, Div div);

impl Numbers {
    /// The columns of sixteen rows of four.
    #[inline(always)]
    fn four_columns(self, of: impl Fn(usize) -> [f32; 4]) -> [Self; 4] {
        let [a, b, c, d] = self.half_columns(&of);
        let [e, f, g, h] = self.half_columns(|lane| of(LANES / 2 + lane));
        [Self([a, e]), Self([b, f]), Self([c, g]), Self([d, h])]
    }

    /// Half of their lanes. Quarters of registers are transposed by themselves, so each begins with the lane that its quarter of the
    /// column begins with.
    #[inline(always)]
    fn half_columns(self, of: impl Fn(usize) -> [f32; 4]) -> [__m256; 4] {
        let mut quarters = [self.0[0]; 4];
        for (i, quarter) in quarters.iter_mut().enumerate() {
            let (low, high) = (bytemuck::cast(of(i)), bytemuck::cast(of(i + 4)));
            // SAFETY: `self` proves that the processor has the instructions.
            *quarter = unsafe { _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(low), high) };
        }
        Self::four_by_four(quarters)
    }

    /// The rows of four columns: the way back from [`Numbers::four_columns`].
    #[inline(always)]
    fn four_rows(columns: [Self; 4]) -> [[f32; 4]; LANES] {
        let mut rows = [[0.0; 4]; LANES];
        for half in 0..2 {
            let turned = Self::four_by_four(columns.map(|column| column.0[half]));
            for i in 0..4 {
                let quarters: [[f32; 4]; 2] = bytemuck::cast(turned[i]);
                for of in 0..2 {
                    rows[LANES / 2 * half + 4 * of + i] = quarters[of];
                }
            }
        }
        rows
    }

    /// Transposes each quarter of four registers by itself. They come from [`Numbers`].
    #[inline(always)]
    fn four_by_four([a, b, c, d]: [__m256; 4]) -> [__m256; 4] {
        // SAFETY: the values prove that the processor has the instructions.
        unsafe {
            let (ab, cd) = (_mm256_castps_pd(_mm256_unpacklo_ps(a, b)), _mm256_castps_pd(_mm256_unpacklo_ps(c, d)));
            let (ab_behind, cd_behind) =
                (_mm256_castps_pd(_mm256_unpackhi_ps(a, b)), _mm256_castps_pd(_mm256_unpackhi_ps(c, d)));
            [
                _mm256_castpd_ps(_mm256_unpacklo_pd(ab, cd)),
                _mm256_castpd_ps(_mm256_unpackhi_pd(ab, cd)),
                _mm256_castpd_ps(_mm256_unpacklo_pd(ab_behind, cd_behind)),
                _mm256_castpd_ps(_mm256_unpackhi_pd(ab_behind, cd_behind)),
            ]
        }
    }
}

impl Neg for Numbers {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let bits = self.bits();
        (bits ^ bits.all(i32::MIN)).real_bits()
    }
}

impl Not for Answers {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: the value proves that the processor has the instructions.
        let all = unsafe { _mm256_castsi256_ps(_mm256_set1_epi32(-1)) };
        halves!(Answers, _mm256_xor_ps, self, Self([all; 2]))
    }
}

impl Real for Numbers {
    type Mask = Answers;
    type Bits = Integers;

    lane_by_lane!();
    columns_by_four!();

    #[inline(always)]
    fn apart<J: Job>(self, job: J) -> J::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn compiled<J: Job>(job: J) -> J::Output {
            job.run()
        }
        // SAFETY: the value proves that the processor has the features.
        unsafe { compiled(job) }
    }

    #[inline(always)]
    fn all(self, number: f32) -> Self {
        // SAFETY: the value proves that the processor has the instruction.
        Self([unsafe { _mm256_set1_ps(number) }; 2])
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        halves!(Self, _mm256_sqrt_ps, self)
    }

    #[inline(always)]
    fn floor(self) -> Self {
        halves!(Self, _mm256_floor_ps, self)
    }

    #[inline(always)]
    fn nearest(self) -> Integers {
        halves!(Integers, _mm256_cvtps_epi32, self)
    }

    #[inline(always)]
    fn whole(self) -> Integers {
        halves!(Integers, _mm256_cvttps_epi32, self)
    }

    #[inline(always)]
    fn bits(self) -> Integers {
        halves!(Integers, _mm256_castps_si256, self)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Answers {
        halves!(Answers, _mm256_cmp_ps::<_CMP_LT_OQ>, self, other)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Answers {
        halves!(Answers, _mm256_cmp_ps::<_CMP_LE_OQ>, self, other)
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        halves!(Answers, _mm256_cmp_ps::<_CMP_EQ_OQ>, self, other)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        halves!(Self, _mm256_min_ps, self, other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        halves!(Self, _mm256_max_ps, self, other)
    }
}

impl Bits for Integers {
    type Real = Numbers;
    type Mask = Answers;

    #[inline(always)]
    fn all(self, integer: i32) -> Self {
        // SAFETY: the value proves that the processor has the instruction.
        Self([unsafe { _mm256_set1_epi32(integer) }; 2])
    }

    #[inline(always)]
    fn left<const BY: u32>(self) -> Self {
        // SAFETY: the values prove that the processor has the instructions.
        let by = unsafe { _mm_cvtsi32_si128(BY.cast_signed()) };
        // SAFETY: as above.
        Self(unsafe { [_mm256_sll_epi32(self.0[0], by), _mm256_sll_epi32(self.0[1], by)] })
    }

    #[inline(always)]
    fn right<const BY: u32>(self) -> Self {
        // SAFETY: the values prove that the processor has the instructions.
        let by = unsafe { _mm_cvtsi32_si128(BY.cast_signed()) };
        // SAFETY: as above.
        Self(unsafe { [_mm256_sra_epi32(self.0[0], by), _mm256_sra_epi32(self.0[1], by)] })
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        let same = halves!(Integers, _mm256_cmpeq_epi32, self, other);
        halves!(Answers, _mm256_castsi256_ps, same)
    }

    #[inline(always)]
    fn real(self) -> Numbers {
        halves!(Numbers, _mm256_cvtepi32_ps, self)
    }

    #[inline(always)]
    fn real_bits(self) -> Numbers {
        halves!(Numbers, _mm256_castsi256_ps, self)
    }
}

impl Mask for Answers {
    type Real = Numbers;

    #[inline(always)]
    fn choose(self, yes: Numbers, no: Numbers) -> Numbers {
        halves!(Numbers, _mm256_blendv_ps, no, yes, self)
    }

    #[inline(always)]
    fn any(self) -> bool {
        self.answers() != 0
    }

    #[inline(always)]
    fn answers(self) -> u32 {
        // SAFETY: the value proves that the processor has the instruction.
        let [low, high] = unsafe { [_mm256_movemask_ps(self.0[0]), _mm256_movemask_ps(self.0[1])] };
        (low | high << 8).cast_unsigned()
    }
}

impl Wide for Avx2 {
    as_bytes!();

    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn compiled<K: Kernel>(wide: Avx2, kernel: K) -> K::Output {
            kernel.run(wide)
        }
        // SAFETY: `self` proves that the processor has the features.
        unsafe { compiled(self, kernel) }
    }
}
