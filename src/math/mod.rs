//! Small geometric mathematics: frames, the cylindrical map of directions, error-bounded ray origins, special functions, lanes; the sRGB curve.

pub mod cylindrical;
pub mod error_bound;
pub mod frame;
pub mod lanes;
pub mod special;
pub mod srgb;

pub use frame::{Frame, Frames};

/// Mean of the three channels: how a colour becomes the scalar that guiding works on.
pub fn channel_mean(c: glam::Vec3) -> f32 {
    lanes::V3::from(c).mean()
}

/// Mean of the values without the `outliers` largest; none where no value is left. Reorders `values`.
pub fn trimmed_mean(values: &mut [f64], outliers: usize) -> Option<f64> {
    let kept = values.len().checked_sub(outliers).filter(|&kept| kept > 0)?;
    if outliers > 0 {
        values.select_nth_unstable_by(kept, f64::total_cmp);
    }
    // Their order depends on nothing but the values, and so does their sum.
    Some(values[..kept].iter().sum::<f64>() / kept as f64)
}
