//! Lanes of AVX-512. Who holds a value got it from an [`Avx512`], which proves that the processor has the instructions.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

use super::{Bits, Job, Kernel, LANES, Mask, Real, Wide, as_bytes, columns_by_four, lane_by_lane, same_number};
use crate::base::processor::Avx512;

/// Numbers.
#[derive(Debug, Clone, Copy)]
pub struct Numbers(__m512);

/// Integers.
#[derive(Debug, Clone, Copy)]
pub struct Integers(__m512i);

/// Answers.
#[derive(Debug, Clone, Copy)]
pub struct Answers(u16);

macro_rules! operators {
    ($type:ident: $($trait:ident $name:ident $intrinsic:ident),+) => {$(
        impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                // SAFETY: the values prove that the processor has the instruction.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )+};
}

operators!(Numbers: Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);
operators!(Integers: Add add _mm512_add_epi32, Sub sub _mm512_sub_epi32);
operators!(Integers: BitAnd bitand _mm512_and_si512, BitOr bitor _mm512_or_si512, BitXor bitxor _mm512_xor_si512);

same_number!(Numbers: Add add, Sub sub, Mul mul, Div div);

impl Numbers {
    /// The columns of sixteen rows of four. Quarters of registers are transposed by themselves, so each begins with the lane that its
    /// quarter of the column begins with. Rows go straight into registers: from an array that was just written the compiler reads more than
    /// one at a time, and has to wait until that much has left the processor's buffer of stores.
    #[inline(always)]
    fn four_columns(self, of: impl Fn(usize) -> [f32; 4]) -> [Self; 4] {
        let mut quarters = [self.0; 4];
        for (i, quarter) in quarters.iter_mut().enumerate() {
            let (first, second) = (bytemuck::cast(of(i)), bytemuck::cast(of(i + 4)));
            let (third, fourth) = (bytemuck::cast(of(i + 8)), bytemuck::cast(of(i + 12)));
            // SAFETY: `self` proves that the processor has the instructions.
            *quarter = unsafe {
                let half = _mm512_insertf32x4::<1>(_mm512_castps128_ps512(first), second);
                _mm512_insertf32x4::<3>(_mm512_insertf32x4::<2>(half, third), fourth)
            };
        }
        Self::four_by_four(quarters.map(Self))
    }

    /// The rows of four columns: the way back from [`Numbers::four_columns`].
    #[inline(always)]
    fn four_rows(columns: [Self; 4]) -> [[f32; 4]; LANES] {
        let mut rows = [[0.0; 4]; LANES];
        let turned = Self::four_by_four(columns);
        for i in 0..4 {
            let quarters: [[f32; 4]; 4] = bytemuck::cast(turned[i].0);
            for of in 0..4 {
                rows[4 * of + i] = quarters[of];
            }
        }
        rows
    }

    /// Transposes each quarter of four registers by itself.
    #[inline(always)]
    fn four_by_four([Self(a), Self(b), Self(c), Self(d)]: [Self; 4]) -> [Self; 4] {
        // SAFETY: the values prove that the processor has the instructions.
        unsafe {
            let (ab, cd) = (_mm512_castps_pd(_mm512_unpacklo_ps(a, b)), _mm512_castps_pd(_mm512_unpacklo_ps(c, d)));
            let (ab_behind, cd_behind) =
                (_mm512_castps_pd(_mm512_unpackhi_ps(a, b)), _mm512_castps_pd(_mm512_unpackhi_ps(c, d)));
            [
                Self(_mm512_castpd_ps(_mm512_unpacklo_pd(ab, cd))),
                Self(_mm512_castpd_ps(_mm512_unpackhi_pd(ab, cd))),
                Self(_mm512_castpd_ps(_mm512_unpacklo_pd(ab_behind, cd_behind))),
                Self(_mm512_castpd_ps(_mm512_unpackhi_pd(ab_behind, cd_behind))),
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

impl BitAnd for Answers {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Answers {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for Answers {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
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
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
        fn compiled<J: Job>(job: J) -> J::Output {
            job.run()
        }
        // SAFETY: the value proves that the processor has the features.
        unsafe { compiled(job) }
    }

    #[inline(always)]
    fn all(self, number: f32) -> Self {
        // SAFETY: the value proves that the processor has the instruction.
        Self(unsafe { _mm512_set1_ps(number) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn floor(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0) })
    }

    #[inline(always)]
    fn nearest(self) -> Integers {
        // SAFETY: as above.
        Integers(unsafe { _mm512_cvtps_epi32(self.0) })
    }

    #[inline(always)]
    fn whole(self) -> Integers {
        // SAFETY: as above.
        Integers(unsafe { _mm512_cvttps_epi32(self.0) })
    }

    #[inline(always)]
    fn bits(self) -> Integers {
        // SAFETY: as above.
        Integers(unsafe { _mm512_castps_si512(self.0) })
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Answers {
        // SAFETY: as above.
        Answers(unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn le(self, other: Self) -> Answers {
        // SAFETY: as above.
        Answers(unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        // SAFETY: as above.
        Answers(unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_max_ps(self.0, other.0) })
    }
}

impl Bits for Integers {
    type Real = Numbers;
    type Mask = Answers;

    #[inline(always)]
    fn all(self, integer: i32) -> Self {
        // SAFETY: the value proves that the processor has the instruction.
        Self(unsafe { _mm512_set1_epi32(integer) })
    }

    #[inline(always)]
    fn left<const BY: u32>(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_slli_epi32::<BY>(self.0) })
    }

    #[inline(always)]
    fn right<const BY: u32>(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_srai_epi32::<BY>(self.0) })
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        // SAFETY: as above.
        Answers(unsafe { _mm512_cmpeq_epi32_mask(self.0, other.0) })
    }

    #[inline(always)]
    fn real(self) -> Numbers {
        // SAFETY: as above.
        Numbers(unsafe { _mm512_cvtepi32_ps(self.0) })
    }

    #[inline(always)]
    fn real_bits(self) -> Numbers {
        // SAFETY: as above.
        Numbers(unsafe { _mm512_castsi512_ps(self.0) })
    }
}

impl Mask for Answers {
    type Real = Numbers;

    #[inline(always)]
    fn choose(self, yes: Numbers, no: Numbers) -> Numbers {
        // SAFETY: the values prove that the processor has the instruction.
        Numbers(unsafe { _mm512_mask_blend_ps(self.0, no.0, yes.0) })
    }

    #[inline(always)]
    fn any(self) -> bool {
        self.0 != 0
    }

    #[inline(always)]
    fn answers(self) -> u32 {
        u32::from(self.0)
    }
}

impl Wide for Avx512 {
    as_bytes!();

    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
        fn compiled<K: Kernel>(wide: Avx512, kernel: K) -> K::Output {
            kernel.run(wide)
        }
        // SAFETY: `self` proves that the processor has the features.
        unsafe { compiled(self, kernel) }
    }
}
