//! One lane: plain numbers.

use super::{Bits, Job, LANES, Mask, Real};

impl Real for f32 {
    type Mask = bool;
    type Bits = i32;
    type Each<T: Copy> = [T; 1];

    #[inline(always)]
    fn repeated<T: Copy>(self, value: T) -> [T; 1] {
        [value]
    }

    #[inline(always)]
    fn count_up_to(self, numbers: &[f32; LANES], bound: f32) -> u32 {
        numbers.iter().map(|&number| u32::from(number <= bound)).sum()
    }

    #[inline(always)]
    fn rows<const N: usize>(numbers: [Self; N]) -> [[f32; N]; 1] {
        [numbers]
    }

    #[inline(always)]
    fn columns<const N: usize>(self, [row]: &[[f32; N]; 1]) -> [Self; N] {
        *row
    }

    #[inline(never)]
    fn apart<J: Job>(self, job: J) -> J::Output {
        job.run()
    }

    #[inline(always)]
    fn all(self, number: f32) -> Self {
        number
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn floor(self) -> Self {
        f32::floor(self)
    }

    #[inline(always)]
    fn nearest(self) -> i32 {
        // The last bit of doubles of this magnitude is worth 1; the processors that all have in common have no instruction for it.
        const WHOLE: f64 = 1.5 * (1u64 << 52) as f64;
        (f64::from(self) + WHOLE).to_bits() as i32
    }

    #[inline(always)]
    fn whole(self) -> i32 {
        self as i32
    }

    #[inline(always)]
    fn bits(self) -> i32 {
        self.to_bits().cast_signed()
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn same(self, other: Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
}

impl Bits for i32 {
    type Real = f32;
    type Mask = bool;

    #[inline(always)]
    fn all(self, integer: i32) -> Self {
        integer
    }

    #[inline(always)]
    fn left<const BY: u32>(self) -> Self {
        self << BY
    }

    #[inline(always)]
    fn right<const BY: u32>(self) -> Self {
        self >> BY
    }

    #[inline(always)]
    fn same(self, other: Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn real(self) -> f32 {
        self as f32
    }

    #[inline(always)]
    fn real_bits(self) -> f32 {
        f32::from_bits(self.cast_unsigned())
    }
}

impl Mask for bool {
    type Real = f32;

    #[inline(always)]
    fn choose(self, yes: f32, no: f32) -> f32 {
        if self { yes } else { no }
    }

    #[inline(always)]
    fn any(self) -> bool {
        self
    }

    #[inline(always)]
    fn answers(self) -> u32 {
        u32::from(self)
    }
}
