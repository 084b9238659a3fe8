//! A sheet: the pictures of several cameras, all of one size, one below the other in one picture. One render makes all of them then:
//! their passes are one pass, the hierarchy is built once, and one guide learns from what all of them see.

use super::Scene;
use crate::camera::Camera;

/// Columns and rows of a sheet of so many pictures of `size`. As many rows as there can be, where that were too many.
pub(super) fn size([width, height]: [u32; 2], views: usize) -> [u32; 2] {
    [width, height.saturating_mul(u32::try_from(views).unwrap_or(u32::MAX))]
}

impl Scene {
    /// Number of pictures on the sheet: 1 for a scene with one camera.
    pub fn views(&self) -> usize {
        1 + self.further.len()
    }

    /// Columns and rows of the picture of each camera.
    pub fn view_size(&self) -> [u32; 2] {
        [self.size[0], self.size[1] / self.views() as u32]
    }

    /// Index of the view whose picture holds the row `row` of the sheet, and that row's number in it.
    pub fn view_of(&self, row: u32) -> (usize, u32) {
        if self.further.is_empty() {
            return (0, row);
        }
        let [_, rows] = self.view_size();
        let view = (row / rows.max(1)).min(self.further.len() as u32);
        (view as usize, row - view * rows)
    }

    /// The camera of a view.
    pub fn camera_of(&self, view: usize) -> &Camera {
        view.checked_sub(1).and_then(|further| self.further.get(further)).unwrap_or(&self.camera)
    }
}
