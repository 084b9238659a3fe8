//! The views that a render makes, and the file of each.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::args::{RenderArgs, SceneArgs};
use crate::base::{Error, Result};
use crate::picture::Attribute;
use crate::scene::file::SceneFile;
use crate::scene::orbit::{ahead, orbit};
use crate::scene::readers::LoadedScene;
use crate::scene::views::{ALL, choose};

/// A view and its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name of its camera; none where no camera was asked for.
    pub camera: Option<String>,
    /// The picture to write.
    pub output: PathBuf,
}

impl View {
    /// What the picture's header says of the view.
    pub fn attribute(&self) -> Option<Attribute> {
        self.camera.as_ref().map(|name| ("camera".to_owned(), name.clone()))
    }
}

/// Most bytes of a camera's name in that of a file.
const LONGEST: usize = 100;

/// Leaves the scene with the cameras that are asked for.
///
/// # Errors
/// [`Error::Options`] for cameras that are not there, or that cannot go around.
pub fn select(args: &SceneArgs, loaded: &mut LoadedScene) -> Result<()> {
    choose(&mut loaded.file, args.camera.as_deref())?;
    let Some(count) = args.orbit else { return Ok(()) };
    if !loaded.file.cameras.is_empty() {
        return Err(Error::Options("--orbit goes around with one camera; choose it with --camera NAME".into()));
    }
    let around = args.around.map(|point| Ok(point.as_dvec3()));
    let point = around.unwrap_or_else(|| ahead(&loaded.file.camera, loaded.bounds()))?;
    orbit(&mut loaded.file, count, point)
}

/// The views of a scene with the cameras that are asked for: with `--camera all`, a list of names, or `--orbit`, each has a file of
/// its own beside that which `--output` names.
///
/// # Errors
/// [`Error::Options`] for options that mean nothing to several pictures, and for pictures of several sizes.
pub fn views(args: &RenderArgs, scene: &SceneFile) -> Result<Vec<View>> {
    let output = args.output.clone().unwrap_or_default();
    let several = !scene.cameras.is_empty();
    if !several && args.of.orbit.is_none() && args.of.camera.as_deref() != Some(ALL) {
        let camera = args.of.camera.as_ref().map(|_| scene.camera_name.clone());
        return Ok(vec![View { camera, output }]);
    }
    let one = [
        ("--crop", args.of.crop.is_some()),
        ("--part", args.part.is_some()),
        ("--reference", args.reference.is_some()),
        ("--replay", args.replay.is_some()),
    ];
    if let Some((name, _)) = one.iter().find(|(_, given)| *given && several) {
        return Err(Error::Options(format!("{name} is about one picture; choose its camera with --camera NAME")));
    }
    let first = [scene.film.width, scene.film.height];
    let other = scene.cameras.iter().find_map(|(name, camera)| Some((name, camera.size?)));
    if let (None, Some((name, [width, height]))) = (args.of.size, other) {
        return Err(Error::Options(format!(
            "the picture of the camera {name:?} has {width}x{height} pixels, that of {:?} {}x{}: give --size for all of them, or render \
             them one by one",
            scene.camera_name, first[0], first[1]
        )));
    }
    let mut taken = BTreeSet::new();
    let view = |(name, _): (&str, _)| {
        let output = beside(&output, &free(&harmless(name), &mut taken));
        View { camera: Some(name.to_owned()), output }
    };
    Ok(scene.views().map(view).collect())
}

/// A camera's name as a part of a file's: letters, digits, dots and hyphens stay.
fn harmless(name: &str) -> String {
    let mut part = String::new();
    for c in name.chars() {
        let c = if c.is_alphanumeric() || matches!(c, '.' | '-') { c } else { '_' };
        if part.len() + c.len_utf8() > LONGEST {
            break;
        }
        part.push(c);
    }
    part
}

/// `part`, or the first of `part-2`, `part-3` and so on that is not `taken`, whatever its capitals: some file systems know no difference.
fn free(part: &str, taken: &mut BTreeSet<String>) -> String {
    let further = (2..).map(|number| format!("{part}-{number}")).take(taken.len() + 1);
    let mut all = std::iter::once(part.to_owned()).chain(further);
    all.find(|name| taken.insert(name.to_lowercase())).unwrap_or_default()
}

/// The file beside `output` with `part` before its extension.
fn beside(output: &Path, part: &str) -> PathBuf {
    let mut name = OsString::from(output.file_stem().unwrap_or_default());
    name.push(".");
    name.push(part);
    if let Some(extension) = output.extension() {
        name.push(".");
        name.push(extension);
    }
    output.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever cameras are called, their files lie beside the one that was asked for, under names that no two of them share.
    #[test]
    fn files_stay_in_their_folder_and_apart() {
        let long = "x".repeat(5000);
        let names = [
            "../../etc/passwd",
            "/root",
            "C:\\x",
            "a b",
            "a_b",
            "A B",
            "..",
            "",
            "a\0b\n",
            "Küche",
            "ё\u{202e}gpj",
            &long,
            "a_b-2",
        ];
        let mut taken = BTreeSet::new();
        let files: Vec<PathBuf> =
            names.iter().map(|name| beside(Path::new("out/door.exr"), &free(&harmless(name), &mut taken))).collect();
        for (name, file) in names.iter().zip(&files) {
            assert_eq!(file.parent(), Some(Path::new("out")), "{name:?}");
            let text = file.file_name().and_then(|name| name.to_str()).expect("it is text");
            assert!(text.starts_with("door.") && text.ends_with(".exr") && text.len() < 200, "{text}");
            assert!(
                !text.contains(|c: char| c.is_control() || c.is_whitespace() || "/\\:\u{202e}".contains(c)),
                "{text:?}"
            );
        }
        let lower: BTreeSet<String> = files.iter().map(|file| file.to_string_lossy().to_lowercase()).collect();
        assert_eq!(lower.len(), names.len(), "{files:?}");
        assert_eq!(files[3..6], ["out/door.a_b.exr", "out/door.a_b-2.exr", "out/door.A_B-3.exr"].map(PathBuf::from));
        assert_eq!(files[9], Path::new("out/door.Küche.exr"));
    }
}
