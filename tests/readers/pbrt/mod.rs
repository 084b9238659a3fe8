//! pbrt's scenes: each feature by a small one, and a box that must look like the same box in our own format.

mod faults;
mod frame;
mod habits;
mod lights;
mod materials;
mod shapes;
mod textures;
mod twins;

use std::path::Path;

use fanal::base::Error;
use fanal::picture::Image;
use fanal::scene::Scene;
use fanal::scene::file::SceneFile;
use fanal::scene::readers::{LoadedScene, load};
use tempfile::TempDir;

use crate::support::{files, scenes};

/// Loads `text` as a scene of its own in `folder`.
pub fn load_text(folder: &Path, text: &str) -> Result<LoadedScene, Error> {
    let path = folder.join("tested.pbrt");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

/// A folder with good files of every kind.
fn folder() -> TempDir {
    files::folder()
}

/// What is loaded of a world with `body` in it.
pub fn world(body: &str) -> LoadedScene {
    let folder = folder();
    load_text(folder.path(), &format!("WorldBegin\n{body}")).unwrap_or_else(|error| panic!("{body}: {error}"))
}

/// The scene file of a world with `body` in it, which gives no warning but that there is no camera.
fn quiet(body: &str) -> SceneFile {
    let loaded = world(body);
    assert!(loaded.warnings.iter().all(|warning| warning.contains("no camera")), "{:?}", loaded.warnings);
    loaded.file
}

/// The scene file of a world with `body` in it, which gives a warning with `words`.
fn warned(body: &str, words: &str) -> SceneFile {
    let loaded = world(body);
    let told = loaded.warnings.iter().any(|warning| warning.contains(words) && warning.contains("tested.pbrt:"));
    assert!(told, "{body}: {:?} lacks {words}", loaded.warnings);
    loaded.file
}

/// A plain picture of a few pixels.
fn picture(loaded: &LoadedScene, spp: u32) -> Image {
    let size = [loaded.file.film.width, loaded.file.film.height];
    scenes::picture(&Scene::build(loaded, size).unwrap(), &scenes::settings(scenes::GUIDES[0], spp, 1))
}

/// Whether colours agree to one part in a thousand.
fn close(a: [f32; 3], b: [f32; 3]) -> bool {
    (0..3).all(|i| (a[i] - b[i]).abs() <= 1e-3 * b[i].abs().max(1e-3))
}
