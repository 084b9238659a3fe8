//! Writing finished pictures: the path is checked before the work, and a picture that cannot be written there is saved elsewhere.

use std::path::{Path, PathBuf};

use super::write_exr::{Attribute, Picture};
use super::{Display, write_exr, write_png};
use crate::base::files::{folder_of, followed, is_device};
use crate::base::{Error, Result};
use crate::picture::Image;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Exr,
    Png,
}

fn format(path: &Path) -> Result<Format> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(Format::Exr),
        Some("png") => Ok(Format::Png),
        _ => Err(Error::Options(format!("{}: a picture's name must end in .exr or .png", path.display()))),
    }
}

/// Whether a picture of this name is written as PNG.
pub fn is_png(path: &Path) -> bool {
    matches!(format(path), Ok(Format::Png))
}

/// Checks, before any work, that a picture could be written to `path`: its format is known, its folder exists and takes files.
///
/// # Errors
/// [`Error::Options`] for an unknown format, [`Error::Io`] naming the folder otherwise.
pub fn check_writable(path: &Path) -> Result<()> {
    format(path)?;
    check_folder(path)
}

/// As [`check_writable`], for a file of any format.
///
/// # Errors
/// [`Error::Io`] naming the file or its folder.
pub fn check_folder(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::io(path, std::io::Error::other("this is a folder, a file is to be written here")));
    }
    if is_device(path) {
        return Ok(());
    }
    let file = followed(path);
    let folder = folder_of(&file);
    tempfile::tempfile_in(folder).map(drop).map_err(|e| Error::io(folder, e))
}

/// Writes a picture without further channels or window, see [`write_picture`].
///
/// # Errors
/// As [`write_picture`].
pub fn write(path: &Path, image: &Image, attributes: &[Attribute]) -> Result<()> {
    write_picture(path, &Picture::plain(image, attributes), Display::default())
}

/// Writes a picture in the format that its name tells; channels, window and attributes go into EXR files, which stay linear;
/// PNG files hold it as `display` shows it.
///
/// # Errors
/// [`Error::Options`] for an unknown format or an empty picture, [`Error::Io`] naming `path`.
pub fn write_picture(path: &Path, picture: &Picture, display: Display) -> Result<()> {
    match format(path)? {
        Format::Exr => write_exr::write(path, picture),
        Format::Png => write_png::write(path, picture.image, display),
    }
}

/// As [`write_picture`], but a picture that cannot be written to `path` is written to the folder for temporary files instead.
///
/// # Errors
/// The error of the first attempt, with the fallback path where that worked: the picture is safe then, but not where wanted.
pub fn write_or_rescue(path: &Path, picture: &Picture, display: Display) -> Result<()> {
    let Err(first) = write_picture(path, picture, display) else { return Ok(()) };
    match rescue(path, picture, display) {
        Ok(fallback) => Err(Error::io(
            path,
            std::io::Error::other(format!("{first}; the picture was saved as {} instead", fallback.display())),
        )),
        Err(second) => Err(Error::io(path, std::io::Error::other(format!("{first}; nor could it be saved: {second}")))),
    }
}

/// Writes the picture to the folder for temporary files; the file's name carries the process id, so that it replaces nothing.
fn rescue(path: &Path, picture: &Picture, display: Display) -> Result<PathBuf> {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("picture");
    let extension = if format(path).is_ok_and(|f| f == Format::Png) { "png" } else { "exr" };
    let fallback = std::env::temp_dir().join(format!("fanal-{}-{stem}.{extension}", std::process::id()));
    write_picture(&fallback, picture, display)?;
    Ok(fallback)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn picture() -> Image {
        Image { width: 1, height: 1, pixels: vec![Vec3::ONE] }
    }

    #[test]
    fn bad_outputs_are_found_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check_writable(&folder.path().join("a.exr")).is_ok());
        assert!(matches!(check_writable(&folder.path().join("a.jpg")), Err(Error::Options(_))));
        assert!(matches!(check_writable(&folder.path().join("missing/a.exr")), Err(Error::Io { .. })));
        let named_like_a_picture = folder.path().join("b.exr");
        std::fs::create_dir(&named_like_a_picture).unwrap();
        assert!(matches!(check_writable(&named_like_a_picture), Err(Error::Io { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "checking leaves nothing behind");
    }

    #[test]
    fn picture_outlives_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gone/lantern.exr");
        let message =
            write_or_rescue(&path, &Picture::plain(&picture(), &[]), Display::default()).unwrap_err().to_string();
        let fallback = std::env::temp_dir().join(format!("fanal-{}-lantern.exr", std::process::id()));
        assert!(message.contains(&*fallback.to_string_lossy()), "{message}");
        assert!(std::fs::metadata(&fallback).is_ok_and(|m| m.len() > 0));
        std::fs::remove_file(fallback).unwrap();
    }
}
