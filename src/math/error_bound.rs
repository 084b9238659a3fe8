//! Ray origins that cannot hit the surface they leave.
//!
//! A computed hit point lies within a bound of the true surface; starting the next ray just outside that bound makes the
//! choice independent of the scene's scale (Pharr, Jakob, Humphreys 2016, §3.9).

use glam::Vec3;

use super::lanes::{Bits, Mask, Real, V3};

/// Bound of the relative error of n rounded operations.
pub const fn gamma(n: u32) -> f32 {
    let n = n as f32 * (f32::EPSILON * 0.5);
    n / (1.0 - n)
}

/// Moves `point`, known to within `error` per coordinate, along the unit normal to the side of `direction`, at least past
/// the error box and by at least one float.
#[inline(always)]
pub fn offset_origins<R: Real>(point: V3<R>, error: V3<R>, normal: V3<R>, direction: V3<R>) -> V3<R> {
    let distance = normal.abs().dot(error);
    let behind = direction.dot(normal).lt(distance.all(0.0));
    let offset = normal * behind.choose(-distance, distance);
    let moved = point + offset;
    V3::new(step(moved.x, offset.x), step(moved.y, offset.y), step(moved.z, offset.z))
}

/// [`offset_origins`] of one point.
#[inline(always)]
pub fn offset_origin(point: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    offset_origins::<f32>(point.into(), error.into(), normal.into(), direction.into()).into()
}

/// The next float after the finite `x` in the direction of the sign of `side`, or `x` where `side` is 0. Branch-free, since
/// branches would be unpredictable here: floats are ordered like their bits, taken as sign and magnitude.
#[inline(always)]
fn step<R: Real>(x: R, side: R) -> R {
    let bits = x.bits();
    let (magnitude, lowest, zero, one) = (bits.all(i32::MAX), bits.all(i32::MIN), x.all(0.0), x.all(1.0));
    let sign = bits.right::<31>();
    let ordered = ((bits & magnitude) ^ sign) - sign;
    let next = ordered + (side.gt(zero).choose(one, zero) - side.lt(zero).choose(one, zero)).whole();
    let sign = next.right::<31>();
    (((next ^ sign) - sign) | (sign & lowest)).real_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_those_of_the_standard_library() {
        let mut values = vec![0.0, f32::MIN_POSITIVE, f32::from_bits(1), 1.0, 1.5, 2.0, f32::MAX / 2.0];
        values.extend((1..1000).map(|i| f32::from_bits(i * 0x0020_3041)).filter(|x| x.is_finite()));
        for x in values.into_iter().flat_map(|x| [x, -x]) {
            assert_eq!([step(x, 1e-30), step(x, -2.0), step(x, 0.0)], [x.next_up(), x.next_down(), x], "{x:e}");
        }
    }
}
