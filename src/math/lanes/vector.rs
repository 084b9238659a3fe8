//! Vectors of three numbers per lane, with the arithmetic of [`glam::Vec3`]: the same operations in the same order.

use std::ops::{Add, Div, Mul, Neg, Sub};

use glam::Vec3;

use super::{Mask, Real};

/// A vector in each lane.
#[derive(Debug, Clone, Copy, Default)]
pub struct V3<R> {
    /// First coordinate.
    pub x: R,
    /// Second coordinate.
    pub y: R,
    /// Third coordinate.
    pub z: R,
}

impl From<Vec3> for V3<f32> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<V3<f32>> for Vec3 {
    #[inline(always)]
    fn from(v: V3<f32>) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

macro_rules! operators {
    ($($trait:ident $name:ident),+) => {$(
        impl<R: Real> $trait for V3<R> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let (x, y, z) = ($trait::$name(self.x, other.x), $trait::$name(self.y, other.y), $trait::$name(self.z, other.z));
                Self { x, y, z }
            }
        }
    )+};
}

operators!(Add add, Sub sub, Mul mul, Div div);

impl<R: Real> Mul<R> for V3<R> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, by: R) -> Self {
        Self { x: self.x * by, y: self.y * by, z: self.z * by }
    }
}

impl<R: Real> Div<R> for V3<R> {
    type Output = Self;

    #[inline(always)]
    fn div(self, by: R) -> Self {
        Self { x: self.x / by, y: self.y / by, z: self.z / by }
    }
}

impl<R: Real> Neg for V3<R> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<R: Real> V3<R> {
    /// From coordinates.
    #[inline(always)]
    pub fn new(x: R, y: R, z: R) -> Self {
        Self { x, y, z }
    }

    /// The same number along each axis.
    #[inline(always)]
    pub fn splat(number: R) -> Self {
        Self { x: number, y: number, z: number }
    }

    /// The same vector in every lane.
    #[inline(always)]
    pub fn all(self, v: Vec3) -> Self {
        Self { x: self.x.all(v.x), y: self.y.all(v.y), z: self.z.all(v.z) }
    }

    /// The first vector where yes, the second where no.
    #[inline(always)]
    pub fn choose(mask: R::Mask, yes: Self, no: Self) -> Self {
        Self { x: mask.choose(yes.x, no.x), y: mask.choose(yes.y, no.y), z: mask.choose(yes.z, no.z) }
    }

    /// The vector where yes, zero where no.
    #[inline(always)]
    pub fn only(self, mask: R::Mask) -> Self {
        Self::choose(mask, self, Self::splat(self.x.all(0.0)))
    }

    /// Dot product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Cross product.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - other.y * self.z,
            y: self.z * other.x - other.z * self.x,
            z: self.x * other.y - other.x * self.y,
        }
    }

    /// Mean of the coordinates.
    #[inline(always)]
    pub fn mean(self) -> R {
        (self.x + self.y + self.z) * (1.0 / 3.0)
    }

    /// Squared length.
    #[inline(always)]
    pub fn length_squared(self) -> R {
        self.dot(self)
    }

    /// Length.
    #[inline(always)]
    pub fn length(self) -> R {
        self.length_squared().sqrt()
    }

    /// The vector over its length.
    #[inline(always)]
    pub fn normalize(self) -> Self {
        self * self.length().inverse()
    }

    /// The vector over its length, and where there is such a direction.
    #[inline(always)]
    pub fn try_normalize(self) -> (Self, R::Mask) {
        let inverse = self.length().inverse();
        (self * inverse, inverse.finite() & inverse.gt(inverse.all(0.0)))
    }

    /// Where all coordinates are zero.
    #[inline(always)]
    pub fn is_zero(self) -> R::Mask {
        let zero = self.x.all(0.0);
        self.x.same(zero) & self.y.same(zero) & self.z.same(zero)
    }

    /// Where all coordinates are finite.
    #[inline(always)]
    pub fn is_finite(self) -> R::Mask {
        self.x.finite() & self.y.finite() & self.z.finite()
    }

    /// The magnitude of each coordinate.
    #[inline(always)]
    pub fn abs(self) -> Self {
        Self { x: self.x.abs(), y: self.y.abs(), z: self.z.abs() }
    }

    /// Each coordinate, or the bound where that is less.
    #[inline(always)]
    pub fn at_least(self, low: f32) -> Self {
        Self { x: self.x.at_least(low), y: self.y.at_least(low), z: self.z.at_least(low) }
    }

    /// Each coordinate, or the bound where that is greater.
    #[inline(always)]
    pub fn at_most(self, high: f32) -> Self {
        Self { x: self.x.at_most(high), y: self.y.at_most(high), z: self.z.at_most(high) }
    }

    /// 1 − self.
    #[inline(always)]
    pub fn rest(self) -> Self {
        Self { x: self.x.rest(), y: self.y.rest(), z: self.z.rest() }
    }

    /// The greater of each coordinate.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self { x: self.x.max(other.x), y: self.y.max(other.y), z: self.z.max(other.z) }
    }

    /// The greatest coordinate.
    #[inline(always)]
    pub fn max_element(self) -> R {
        self.x.max(self.y.max(self.z))
    }
}
