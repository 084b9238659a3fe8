//! Tables of numbers, one in each lane.

use crate::math::lanes::{Bits, Real, by_lane};

/// Linear interpolation at `position`, in [0, `count` − 1], of tables of `count` numbers, at least two.
#[inline(always)]
pub(super) fn interpolated<R: Real, T: Copy + AsRef<[f32]>>(tables: &R::Each<T>, count: usize, position: R) -> R {
    let below = position.whole().real().at_most((count - 2) as f32);
    let [a, b] = by_lane!([below], |lane, [below]| {
        let (table, below) = (tables.as_ref()[lane].as_ref(), below as usize);
        [table[below], table[below + 1]]
    });
    a + (b - a) * (position - below)
}
