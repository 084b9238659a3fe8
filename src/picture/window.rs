//! A part of a picture.

use std::path::Path;

use exr::meta::MetaData;

use crate::base::{Error, Result};
use crate::picture::Image;

/// A rectangle of pixels, counted from the top left of the whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Columns to the left of it.
    pub x: u32,
    /// Rows above it.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Window {
    /// The window that is a whole picture with these columns and rows.
    pub fn whole([width, height]: [u32; 2]) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Checks that it holds a pixel and lies inside a picture of `size`.
    ///
    /// # Errors
    /// [`Error::Options`] naming both.
    pub fn check_inside(&self, size: [u32; 2]) -> Result<()> {
        let ends =
            |start: u32, length: u32, all: u32| length > 0 && u64::from(start) + u64::from(length) <= u64::from(all);
        if ends(self.x, self.width, size[0]) && ends(self.y, self.height, size[1]) {
            return Ok(());
        }
        Err(Error::Options(format!(
            "the window {},{},{},{} (columns to the left, rows above, columns, rows) is empty or not inside the picture of \
             {}x{} pixels",
            self.x, self.y, self.width, self.height, size[0], size[1]
        )))
    }

    /// Column and row in the whole picture of the window's pixel `index`, counted row by row.
    pub fn place(&self, index: u64) -> [u32; 2] {
        let width = u64::from(self.width);
        [self.x + (index % width) as u32, self.y + (index / width) as u32]
    }

    /// Index of the pixel of the window at this column and row of the picture; none outside of it.
    pub fn index(&self, [column, row]: [u32; 2]) -> Option<u64> {
        let [x, y] = [column.checked_sub(self.x)?, row.checked_sub(self.y)?];
        (x < self.width && y < self.height).then(|| u64::from(y) * u64::from(self.width) + u64::from(x))
    }

    /// Cuts the window out of a whole picture.
    ///
    /// # Errors
    /// As [`Window::check_inside`].
    pub fn cut(&self, image: &Image) -> Result<Image> {
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        self.check_inside([side(image.width), side(image.height)])?;
        let pixel = |i: u64| {
            let [column, row] = self.place(i).map(|n| n as usize);
            image.pixels[row * image.width + column]
        };
        let (width, height) = (self.width as usize, self.height as usize);
        Ok(Image { width, height, pixels: (0..self.pixels()).map(pixel).collect() })
    }
}

/// A window, with the columns and rows of the whole picture; none for a whole picture.
pub type Placed = Option<(Window, [u32; 2])>;

/// The part of `image`, placed at `own`, to compare with a picture placed at `other`: of a whole picture the other's window, else
/// all.
///
/// # Errors
/// [`Error::Options`] where both are different windows.
pub fn matched(image: Image, own: Placed, other: Placed) -> Result<Image> {
    match (own, other) {
        (None, Some((window, size))) if [image.width, image.height] == size.map(|n| n as usize) => window.cut(&image),
        (Some((a, _)), Some((b, _))) if own != other => Err(Error::Options(format!(
            "the pictures are different windows: {},{},{},{} and {},{},{},{}",
            a.x, a.y, a.width, a.height, b.x, b.y, b.width, b.height
        ))),
        _ => Ok(image),
    }
}

/// The window that the EXR file at `path` holds of a larger picture, with that picture's columns and rows; none where it holds a
/// whole picture, reaches beyond it, or is no EXR file that can be read.
pub fn window_of(path: &Path) -> Placed {
    let meta = MetaData::read_from_file(path, false).ok()?;
    let header = meta.headers.first()?;
    let display = header.shared_attributes.display_window;
    let at = header.own_attributes.layer_position - display.position;
    let side = |n: usize| u32::try_from(n).ok();
    let size = [side(display.size.width())?, side(display.size.height())?];
    let (x, y) = (u32::try_from(at.x()).ok()?, u32::try_from(at.y()).ok()?);
    let window = Window { x, y, width: side(header.layer_size.width())?, height: side(header.layer_size.height())? };
    (window != Window::whole(size) && window.check_inside(size).is_ok()).then_some((window, size))
}

#[cfg(test)]
mod tests {
    use super::super::write_exr::{Picture, write};
    use super::*;
    use glam::Vec3;

    #[test]
    fn windows_are_cut_and_found_again() {
        let pixels = (0..20).map(|i| Vec3::splat(i as f32)).collect();
        let whole = Image { width: 5, height: 4, pixels };
        let window = Window { x: 3, y: 1, width: 2, height: 2 };
        let image = window.cut(&whole).unwrap();
        assert_eq!(image.pixels, [8.0, 9.0, 13.0, 14.0].map(Vec3::splat));
        assert!(Window { width: 3, ..window }.cut(&whole).is_err());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.exr");
        let part = Picture { window: Some((window, [5, 4])), ..Picture::plain(&image, &[]) };
        write(&path, &part).unwrap();
        assert_eq!(window_of(&path), Some((window, [5, 4])));
        write(&path, &Picture::plain(&whole, &[])).unwrap();
        assert_eq!(window_of(&path), None);
        assert_eq!(window_of(folder.path()), None);
    }

    #[test]
    fn only_what_both_show_is_compared() {
        let image = |width, height| Image { width, height, pixels: vec![Vec3::ONE; width * height] };
        let window = Window { x: 3, y: 1, width: 2, height: 2 };
        let placed = Some((window, [5, 4]));
        assert_eq!(matched(image(5, 4), None, placed).unwrap(), image(2, 2));
        assert_eq!(matched(image(2, 2), None, placed).unwrap(), image(2, 2));
        assert_eq!(matched(image(2, 2), placed, placed).unwrap(), image(2, 2));
        assert_eq!(matched(image(2, 2), placed, None).unwrap(), image(2, 2));
        let moved = Some((Window { x: 2, ..window }, [5, 4]));
        assert!(matched(image(2, 2), placed, moved).is_err());
    }

    #[test]
    fn windows_outside_are_refused() {
        let inside = |x, y, width, height| Window { x, y, width, height }.check_inside([8, 6]).is_ok();
        assert!(inside(0, 0, 8, 6) && inside(7, 5, 1, 1));
        assert!(!inside(0, 0, 0, 1) && !inside(0, 0, 9, 1) && !inside(7, 0, 2, 1) && !inside(8, 0, 1, 1));
        assert!(!inside(u32::MAX, 0, u32::MAX, 1));
    }
}
