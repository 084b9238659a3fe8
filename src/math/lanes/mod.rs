//! Sixteen numbers at once, or one: formulas are written once, over [`Real`], and run in the lanes of AVX-512 or AVX2, or with
//! plain `f32`, which is the renderer of all other processors.
//!
//! All give the same bits. Sums, products, quotients and square roots are rounded as IEEE 754 says and never fused; everything else,
//! sines and exponentials too ([`functions`]), is made of these. A branch becomes a choice between values that are both computed, so
//! what is not chosen may be infinite or NaN.
//!
//! Values of wide types come from a token of [`Wide`], which proves that the processor has the instructions, or from other values.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "intrinsics; each value proves that the processor has them")]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "intrinsics; each value proves that the processor has them")]
mod avx512;
pub mod functions;
mod gather;
mod one;
pub mod slices;
#[cfg(test)]
mod tests;
mod vector;

use std::fmt::Debug;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

use glam::Vec3;

use crate::base::processor::Avx2;
#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx512;

pub use gather::Gather;
pub(crate) use gather::lanes_of;
pub use vector::V3;

/// Lanes of the wide types.
pub const LANES: usize = 16;

/// A vector in each lane as plain numbers, coordinate by coordinate.
pub type Vectors = [[f32; LANES]; 3];

/// The vector of a lane.
#[inline(always)]
pub fn vector(of: &Vectors, lane: usize) -> Vec3 {
    Vec3::new(of[0][lane], of[1][lane], of[2][lane])
}

/// Puts a vector into a lane.
#[inline(always)]
pub fn set_vector(of: &mut Vectors, lane: usize, vector: Vec3) {
    of.iter_mut().zip(vector.to_array()).for_each(|(column, x)| column[lane] = x);
}

/// Numbers in single precision, one per lane.
pub trait Real:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
    + Div<f32, Output = Self>
{
    /// Answers to a comparison.
    type Mask: Mask<Real = Self>;
    /// The numbers' bits, and whole numbers.
    type Bits: Bits<Real = Self, Mask = Self::Mask>;
    /// One value of any other type per lane.
    type Each<T: Copy>: Copy + AsRef<[T]> + AsMut<[T]>;

    /// The same value for every lane.
    fn repeated<T: Copy>(self, value: T) -> Self::Each<T>;
    /// The numbers of each lane as a row.
    fn rows<const N: usize>(numbers: [Self; N]) -> Self::Each<[f32; N]>;
    /// The columns of rows of which each lane has one.
    fn columns<const N: usize>(self, rows: &Self::Each<[f32; N]>) -> [Self; N];
    /// Does a job in a function of its own, compiled for the instruction set that these numbers need.
    fn apart<J: Job>(self, job: J) -> J::Output;
    /// The same number in every lane.
    fn all(self, number: f32) -> Self;
    /// Square root; NaN below 0.
    fn sqrt(self) -> Self;
    /// The largest whole number that is not larger.
    fn floor(self) -> Self;
    /// The nearest whole number, the even one of two, as an integer. Numbers must be below 2³¹ in magnitude.
    fn nearest(self) -> Self::Bits;
    /// The whole part, towards 0, as an integer. Numbers must be below 2³¹ in magnitude.
    fn whole(self) -> Self::Bits;
    /// The bits of each number.
    fn bits(self) -> Self::Bits;
    /// self < other; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// self ≤ other; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// self = other; false for NaN, true for zeros of either sign.
    fn same(self, other: Self) -> Self::Mask;
    /// The lesser; `other` where one is NaN or both are equal.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` where one is NaN or both are equal.
    fn max(self, other: Self) -> Self;

    /// self > other; false for NaN.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }

    /// self ≥ other; false for NaN.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }

    /// self > number; false for NaN.
    #[inline(always)]
    fn above(self, number: f32) -> Self::Mask {
        self.gt(self.all(number))
    }

    /// self < number; false for NaN.
    #[inline(always)]
    fn below(self, number: f32) -> Self::Mask {
        self.lt(self.all(number))
    }

    /// self = number; false for NaN, true for zeros of either sign.
    #[inline(always)]
    fn is(self, number: f32) -> Self::Mask {
        self.same(self.all(number))
    }

    /// The number where yes, zero where no.
    #[inline(always)]
    fn only(self, mask: Self::Mask) -> Self {
        mask.choose(self, self.all(0.0))
    }

    /// The number, or the bound where it is less; the bound for NaN.
    #[inline(always)]
    fn at_least(self, low: f32) -> Self {
        self.max(self.all(low))
    }

    /// The number, or the bound where it is greater; the bound for NaN.
    #[inline(always)]
    fn at_most(self, high: f32) -> Self {
        self.min(self.all(high))
    }

    /// 1 − self.
    #[inline(always)]
    fn rest(self) -> Self {
        self.all(1.0) - self
    }

    /// The number without its sign.
    #[inline(always)]
    fn abs(self) -> Self {
        let bits = self.bits();
        (bits & bits.all(i32::MAX)).real_bits()
    }

    /// The magnitude with the sign of another number.
    #[inline(always)]
    fn with_sign(self, of: Self) -> Self {
        let (magnitude, sign) = (self.bits(), of.bits());
        (magnitude & magnitude.all(i32::MAX) | sign & sign.all(i32::MIN)).real_bits()
    }

    /// The number between the bounds; the lower one for NaN.
    #[inline(always)]
    fn between(self, low: f32, high: f32) -> Self {
        self.max(self.all(low)).min(self.all(high))
    }

    /// Neither infinite nor NaN.
    #[inline(always)]
    fn finite(self) -> Self::Mask {
        self.abs().lt(self.all(f32::INFINITY))
    }

    /// The square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }

    /// How many of sixteen numbers are at most `bound`; it does not matter which number is asked.
    fn count_up_to(self, numbers: &[f32; LANES], bound: f32) -> u32;

    /// 1 / self.
    #[inline(always)]
    fn inverse(self) -> Self {
        self.all(1.0) / self
    }
}

/// Signed 32-bit integers, one per lane; sums must not overflow.
pub trait Bits:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
{
    /// Numbers with these bits.
    type Real;
    /// Answers to a comparison.
    type Mask;

    /// The same integer in every lane.
    fn all(self, integer: i32) -> Self;
    /// Shifted left, zeros behind.
    fn left<const BY: u32>(self) -> Self;
    /// Shifted right, copies of the sign before.
    fn right<const BY: u32>(self) -> Self;
    /// self = other.
    fn same(self, other: Self) -> Self::Mask;
    /// The nearest number.
    fn real(self) -> Self::Real;
    /// The number of these bits.
    fn real_bits(self) -> Self::Real;
}

/// Yes or no, one per lane.
pub trait Mask: Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// What is chosen between.
    type Real;

    /// The first where yes, the second where no.
    fn choose(self, yes: Self::Real, no: Self::Real) -> Self::Real;
    /// No in every lane.
    #[inline(always)]
    fn none(self) -> Self {
        self & !self
    }

    /// Where both say the same.
    #[inline(always)]
    fn agrees(self, other: Self) -> Self {
        self & other | !(self | other)
    }

    /// Whether any lane says yes.
    fn any(self) -> bool;
    /// The answers, lane 0 in the lowest bit.
    fn answers(self) -> u32;
}

/// What makes values of a wide type: proof of an instruction set.
pub trait Wide: Copy + Send + Sync {
    /// Numbers in [`LANES`] lanes.
    type Real: Real;

    /// Lane by lane.
    fn load(self, numbers: &[f32; LANES]) -> Self::Real;
    /// Lane by lane.
    fn store(self, numbers: Self::Real) -> [f32; LANES];
    /// Vectors lane by lane, coordinate by coordinate.
    #[inline(always)]
    fn load_vectors(self, [x, y, z]: &Vectors) -> V3<Self::Real> {
        V3::new(self.load(x), self.load(y), self.load(z))
    }

    /// Vectors lane by lane, coordinate by coordinate.
    #[inline(always)]
    fn store_vectors(self, v: V3<Self::Real>) -> Vectors {
        [self.store(v.x), self.store(v.y), self.store(v.z)]
    }

    /// The vector that `of` tells for each lane.
    #[inline(always)]
    fn vectors(self, of: impl Fn(usize) -> Vec3) -> V3<Self::Real> {
        let mut columns = [[0.0; LANES]; 3];
        let [x, y, z] = &mut columns;
        for lane in 0..LANES {
            [x[lane], y[lane], z[lane]] = of(lane).to_array();
        }
        self.load_vectors(&columns)
    }

    /// Both coordinates of the point of each lane.
    #[inline(always)]
    fn points(self, of: &[[f32; 2]; LANES]) -> [Self::Real; 2] {
        let mut columns = [[0.0; LANES]; 2];
        let [x, y] = &mut columns;
        for (lane, point) in of.iter().enumerate() {
            [x[lane], y[lane]] = *point;
        }
        [self.load(&columns[0]), self.load(&columns[1])]
    }

    /// The columns of rows of which each lane has one.
    fn columns<const N: usize>(self, rows: &[[f32; N]; LANES]) -> [Self::Real; N];
    /// The columns of rows of four that `of` tells for each lane: nothing is copied where it takes them from memory.
    fn four_columns(self, of: impl Fn(usize) -> [f32; 4]) -> [Self::Real; 4];
    /// The rows of four columns, one for each lane.
    fn four_rows(self, columns: [Self::Real; 4]) -> [[f32; 4]; LANES];
    /// Integers lane by lane.
    fn load_bits(self, integers: &[i32; LANES]) -> <Self::Real as Real>::Bits;
    /// Integers lane by lane.
    fn store_bits(self, integers: <Self::Real as Real>::Bits) -> [i32; LANES];
    /// Values of any other type lane by lane.
    fn each<T: Copy>(self, values: [T; LANES]) -> <Self::Real as Real>::Each<T>;
    /// Runs a kernel, compiled for the instruction set.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;
}

/// What an expression makes of each lane and its numbers, as in `by_lane!([a, b], |lane, [a, b]| [a + b])`: for look-ups in tables, and for
/// what takes double precision. It looks like a closure but is none: that would be a function for any processor, which is called
/// sixteen times by one that has to put all its registers aside.
macro_rules! by_lane {
    ($numbers:expr, |$lane:pat_param, $one:pat_param| $row:expr) => {{
        let numbers = $numbers;
        let rows = $crate::math::lanes::Real::rows(numbers);
        let mut made = $crate::math::lanes::Real::repeated(numbers[0], $crate::math::lanes::empty_row());
        for (lane, row) in rows.as_ref().iter().enumerate() {
            let ($lane, $one) = (lane, *row);
            made.as_mut()[lane] = $row;
        }
        $crate::math::lanes::Real::columns(numbers[0], &made)
    }};
}
pub(crate) use by_lane;

/// A row of zeros.
#[inline(always)]
pub(crate) fn empty_row<const N: usize>() -> [f32; N] {
    [0.0; N]
}

/// Arithmetic of wide numbers with one that is the same in every lane.
#[cfg(target_arch = "x86_64")]
macro_rules! same_number {
    ($type:ident: $($trait:ident $name:ident),+) => {$(
        impl $trait<f32> for $type {
            type Output = Self;

            #[inline(always)]
            fn $name(self, number: f32) -> Self {
                $trait::$name(self, self.all(number))
            }
        }
    )+};
}

/// What wide numbers do lane by lane, in plain numbers.
#[cfg(target_arch = "x86_64")]
macro_rules! lane_by_lane {
    () => {
        type Each<T: Copy> = [T; LANES];

        #[inline(always)]
        fn repeated<T: Copy>(self, value: T) -> [T; LANES] {
            [value; LANES]
        }

        #[inline(always)]
        fn count_up_to(self, numbers: &[f32; LANES], bound: f32) -> u32 {
            Self(bytemuck::cast(*numbers)).le(self.all(bound)).answers().count_ones()
        }

        #[inline(always)]
        fn rows<const N: usize>(numbers: [Self; N]) -> [[f32; N]; LANES] {
            let mut rows = [[0.0; N]; LANES];
            for first in (0..N).step_by(4) {
                // The last is repeated where there are fewer than four.
                let mut four = [numbers[N - 1]; 4];
                let count = (N - first).min(4);
                four[..count].copy_from_slice(&numbers[first..first + count]);
                let parts = Self::four_rows(four);
                for lane in 0..LANES {
                    rows[lane][first..first + count].copy_from_slice(&parts[lane][..count]);
                }
            }
            rows
        }
    };
}

/// How values of wide types come from memory and go there: as the same bytes.
#[cfg(target_arch = "x86_64")]
macro_rules! as_bytes {
    () => {
        type Real = Numbers;

        #[inline(always)]
        fn load(self, numbers: &[f32; LANES]) -> Numbers {
            Numbers(bytemuck::cast(*numbers))
        }

        #[inline(always)]
        fn store(self, numbers: Numbers) -> [f32; LANES] {
            bytemuck::cast(numbers.0)
        }

        #[inline(always)]
        fn columns<const N: usize>(self, rows: &[[f32; N]; LANES]) -> [Numbers; N] {
            self.load(&[0.0; LANES]).columns(rows)
        }

        #[inline(always)]
        fn four_columns(self, of: impl Fn(usize) -> [f32; 4]) -> [Numbers; 4] {
            self.load(&[0.0; LANES]).four_columns(of)
        }

        #[inline(always)]
        fn four_rows(self, columns: [Numbers; 4]) -> [[f32; 4]; LANES] {
            Numbers::four_rows(columns)
        }

        #[inline(always)]
        fn load_bits(self, integers: &[i32; LANES]) -> Integers {
            Integers(bytemuck::cast(*integers))
        }

        #[inline(always)]
        fn store_bits(self, integers: Integers) -> [i32; LANES] {
            bytemuck::cast(integers.0)
        }

        #[inline(always)]
        fn each<T: Copy>(self, values: [T; LANES]) -> [T; LANES] {
            values
        }
    };
}

/// The columns of sixteen rows, four at a time.
#[cfg(target_arch = "x86_64")]
macro_rules! columns_by_four {
    () => {
        #[inline(always)]
        fn columns<const N: usize>(self, rows: &[[f32; N]; LANES]) -> [Self; N] {
            let mut columns = [self; N];
            for first in (0..N / 4 * 4).step_by(4) {
                let part = |lane: usize| std::array::from_fn(|i| rows[lane][first + i]);
                columns[first..first + 4].copy_from_slice(&self.four_columns(part));
            }
            for i in N / 4 * 4..N {
                let mut column = [0.0; LANES];
                for lane in 0..LANES {
                    column[lane] = rows[lane][i];
                }
                columns[i] = Self(bytemuck::cast(column));
            }
            columns
        }
    };
}
#[cfg(target_arch = "x86_64")]
use {as_bytes, columns_by_four, lane_by_lane, same_number};

/// Code for any wide type.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Its code. Marked `#[inline(always)]`, like all that it calls with wide values: what is not inlined is compiled for the oldest
    /// processor.
    fn run<W: Wide>(self, wide: W) -> Self::Output;
}

/// A part of a kernel that is large and done in several places, so that a call costs less than copies of it, see [`Real::apart`].
pub trait Job {
    /// What it returns.
    type Output;
    /// Its code, marked `#[inline(always)]` as that of a [`Kernel`].
    fn run(self) -> Self::Output;
}

/// Whether [`run`] runs kernels here.
#[inline]
pub fn available() -> bool {
    Avx2::detect().is_some()
}

/// Runs a kernel in the widest lanes that this processor has and [`LANES`](crate::base::processor::LANES) allows; where there are
/// none, gives it back.
///
/// # Errors
/// The kernel.
#[inline]
pub fn run<K: Kernel>(kernel: K) -> Result<K::Output, K> {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(avx512) = Avx512::detect() {
            return Ok(avx512.run(kernel));
        }
        if let Some(avx2) = Avx2::detect() {
            return Ok(avx2.run(kernel));
        }
    }
    Err(kernel)
}
