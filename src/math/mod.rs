//! Small geometric mathematics: frames, the cylindrical map of directions, error-bounded ray origins, special functions; the sRGB curve.

pub mod cylindrical;
pub mod error_bound;
pub mod frame;
pub mod special;
pub mod srgb;

pub use frame::Frame;

/// Mean of the three channels: how a colour becomes the scalar that guiding works on.
pub fn channel_mean(c: glam::Vec3) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}
