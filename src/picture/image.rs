//! Pictures held in memory as linear RGB.

use glam::Vec3;

/// A linear RGB picture, row by row from the top left.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<Vec3>,
}
