//! Multiple importance sampling (Veach and Guibas 1995).

use crate::math::lanes::{Mask, Real};

/// Balance heuristic weight of the strategy with density `p` against one with density `q`, one sample each.
/// Both in the same measure; 0 where `p` is 0.
#[inline(always)]
pub fn balance<R: Real>(p: R, q: R) -> R {
    let share = p.same(p.all(f32::INFINITY)).choose(p.all(1.0), p / (p + q));
    share.only(p.above(0.0))
}
