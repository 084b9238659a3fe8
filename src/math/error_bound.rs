//! Ray origins that cannot hit the surface they leave.
//!
//! A computed hit point lies within a bound of the true surface; starting the next ray just outside that bound makes the
//! choice independent of the scene's scale (Pharr, Jakob, Humphreys 2016, §3.9).

use glam::Vec3;

/// Relative error of n rounded operations.
pub const fn gamma(n: u32) -> f32 {
    let n = n as f32 * (f32::EPSILON * 0.5);
    n / (1.0 - n)
}

/// Moves `point`, known to within `error` per coordinate, along the unit normal to the side of `direction`, at least past
/// the error box and by at least one float.
#[inline]
pub fn offset_origin(point: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let distance = normal.abs().dot(error);
    let offset = if direction.dot(normal) < 0.0 { -distance * normal } else { distance * normal };
    let moved = point + offset;
    let step = |moved: f32, offset: f32| {
        if offset > 0.0 {
            moved.next_up()
        } else if offset < 0.0 {
            moved.next_down()
        } else {
            moved
        }
    };
    Vec3::new(step(moved.x, offset.x), step(moved.y, offset.y), step(moved.z, offset.z))
}
