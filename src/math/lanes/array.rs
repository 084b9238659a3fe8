//! Lanes in arrays, for processors of any kind: the compiler makes of them what it can.

use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

use super::{Bits, Kernel, LANES, Mask, Real, Wide};

/// Lanes in arrays; every processor has them.
#[derive(Debug, Clone, Copy)]
pub struct Arrays;

/// Numbers.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Numbers([f32; LANES]);

/// Integers.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Integers([i32; LANES]);

/// Answers.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
pub struct Answers([bool; LANES]);

/// Loops instead of `array::map`, whose closures are not always inlined.
macro_rules! each {
    ($make:ident, |$lane:ident| $value:expr) => {{
        let mut made = [Default::default(); LANES];
        for $lane in 0..LANES {
            made[$lane] = $value;
        }
        $make(made)
    }};
}

macro_rules! operators {
    ($type:ident: $($trait:ident $name:ident),+) => {$(
        impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                each!($type, |lane| $trait::$name(self.0[lane], other.0[lane]))
            }
        }
    )+};
}

operators!(Numbers: Add add, Sub sub, Mul mul, Div div);
operators!(Integers: Add add, Sub sub, BitAnd bitand, BitOr bitor, BitXor bitxor);
operators!(Answers: BitAnd bitand, BitOr bitor);

impl Neg for Numbers {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        each!(Numbers, |lane| -self.0[lane])
    }
}

impl Not for Answers {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        each!(Answers, |lane| !self.0[lane])
    }
}

impl Real for Numbers {
    type Mask = Answers;
    type Bits = Integers;

    #[inline(always)]
    fn all(self, number: f32) -> Self {
        Self([number; LANES])
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        each!(Numbers, |lane| self.0[lane].sqrt())
    }

    #[inline(always)]
    fn floor(self) -> Self {
        each!(Numbers, |lane| self.0[lane].floor())
    }

    #[inline(always)]
    fn nearest(self) -> Integers {
        each!(Integers, |lane| Real::nearest(self.0[lane]))
    }

    #[inline(always)]
    fn whole(self) -> Integers {
        each!(Integers, |lane| self.0[lane] as i32)
    }

    #[inline(always)]
    fn bits(self) -> Integers {
        each!(Integers, |lane| Real::bits(self.0[lane]))
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Answers {
        each!(Answers, |lane| self.0[lane] < other.0[lane])
    }

    #[inline(always)]
    fn le(self, other: Self) -> Answers {
        each!(Answers, |lane| self.0[lane] <= other.0[lane])
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        each!(Answers, |lane| self.0[lane] == other.0[lane])
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        each!(Numbers, |lane| Real::min(self.0[lane], other.0[lane]))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        each!(Numbers, |lane| Real::max(self.0[lane], other.0[lane]))
    }
}

impl Bits for Integers {
    type Real = Numbers;
    type Mask = Answers;

    #[inline(always)]
    fn all(self, integer: i32) -> Self {
        Self([integer; LANES])
    }

    #[inline(always)]
    fn left<const BY: u32>(self) -> Self {
        each!(Integers, |lane| self.0[lane] << BY)
    }

    #[inline(always)]
    fn right<const BY: u32>(self) -> Self {
        each!(Integers, |lane| self.0[lane] >> BY)
    }

    #[inline(always)]
    fn same(self, other: Self) -> Answers {
        each!(Answers, |lane| self.0[lane] == other.0[lane])
    }

    #[inline(always)]
    fn real(self) -> Numbers {
        each!(Numbers, |lane| self.0[lane] as f32)
    }

    #[inline(always)]
    fn real_bits(self) -> Numbers {
        each!(Numbers, |lane| self.0[lane].real_bits())
    }
}

impl Mask for Answers {
    type Real = Numbers;

    #[inline(always)]
    fn choose(self, yes: Numbers, no: Numbers) -> Numbers {
        each!(Numbers, |lane| if self.0[lane] { yes.0[lane] } else { no.0[lane] })
    }

    #[inline(always)]
    fn any(self) -> bool {
        self.answers() != 0
    }

    #[inline(always)]
    fn answers(self) -> u32 {
        let mut answers = 0;
        for lane in 0..LANES {
            answers |= u32::from(self.0[lane]) << lane;
        }
        answers
    }
}

impl Wide for Arrays {
    type Real = Numbers;

    #[inline(always)]
    fn load(self, numbers: &[f32; LANES]) -> Numbers {
        Numbers(*numbers)
    }

    #[inline(always)]
    fn store(self, numbers: Numbers) -> [f32; LANES] {
        numbers.0
    }

    #[inline(always)]
    fn load_bits(self, integers: &[i32; LANES]) -> Integers {
        Integers(*integers)
    }

    #[inline(always)]
    fn store_bits(self, integers: Integers) -> [i32; LANES] {
        integers.0
    }

    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
}
