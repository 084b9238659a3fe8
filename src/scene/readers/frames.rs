//! Frames of cameras and lights, whose +z points forwards, and matrices as scene files hold them.

use glam::{DMat4, DVec3};

use crate::scene::file::Matrix;

/// The frame at `eye` that looks along the unit vector `direction`, with +y on the side of `up`; none where `up` is along it.
pub fn looking(eye: DVec3, direction: DVec3, up: DVec3) -> Option<DMat4> {
    let x = up.cross(direction).try_normalize()?;
    let y = direction.cross(x);
    Some(DMat4::from_cols(x.extend(0.0), y.extend(0.0), direction.extend(0.0), eye.extend(1.0)))
}

/// The frame at `eye` that looks along the unit vector `direction`, turned around it anyhow.
pub fn facing(eye: DVec3, direction: DVec3) -> DMat4 {
    let (x, y) = direction.any_orthonormal_pair();
    DMat4::from_cols(x.extend(0.0), y.extend(0.0), direction.extend(0.0), eye.extend(1.0))
}

/// The matrix row by row in single precision.
pub fn rounded(matrix: DMat4) -> Matrix {
    matrix.transpose().to_cols_array().map(|value| value as f32)
}
