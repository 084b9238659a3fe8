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

impl Image {
    /// The picture cut into so many of the same height, from the top; rows that are left over are left out.
    pub fn parts(&self, count: usize) -> Vec<Self> {
        let height = self.height / count.max(1);
        let pixels = self.pixels.chunks_exact((self.width * height).max(1)).take(count);
        pixels.map(|pixels| Self { width: self.width, height, pixels: pixels.to_vec() }).collect()
    }
}
