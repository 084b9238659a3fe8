//! The cameras of a document that may hold several: the first is the default one.

use crate::base::Place;
use crate::scene::file::{CameraFile, SceneFile};

use super::places::Places;

/// Adds the next camera of a document to `file`, where `before` says how many came before it. One without a name, or with that of
/// another camera, is given one.
pub fn add(
    file: &mut SceneFile,
    places: &mut Places,
    before: usize,
    name: Option<&str>,
    camera: CameraFile,
    place: Place,
) {
    let name = name.filter(|name| !name.is_empty());
    if before == 0 {
        file.camera = camera;
        name.into_iter().for_each(|name| name.clone_into(&mut file.camera_name));
        return places.set("camera", place);
    }
    let name = free(file, &name.map_or_else(|| format!("camera{}", before + 1), str::to_owned));
    places.set(format!("cameras.{name}"), place);
    file.cameras.insert(name, camera);
}

/// `name`, or the first of `name-2`, `name-3` and so on that no camera has.
fn free(file: &SceneFile, name: &str) -> String {
    let is_taken = |name: &String| *name == file.camera_name || file.cameras.contains_key(name);
    // More than the cameras that there are need not be tried.
    let further = (2..).map(|number| format!("{name}-{number}")).take(file.cameras.len() + 1);
    std::iter::once(name.to_owned()).chain(further).find(|name| !is_taken(name)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::file::{FilmFile, FilterFile, IDENTITY};

    #[test]
    fn every_camera_has_a_name_of_its_own() {
        let (mut places, camera) = (Places::new(Path::new("a")), CameraFile::pinhole(IDENTITY, 40.0));
        let film = FilmFile { width: 1, height: 1, filter: FilterFile::default() };
        let mut file = SceneFile::empty(String::new(), camera.clone(), film);
        let names = [None, Some("a"), Some("default"), Some("a"), None, Some(""), Some("a-2"), Some("a")];
        for (before, name) in names.into_iter().enumerate() {
            add(&mut file, &mut places, before, name, camera.clone(), Place::line("a", before as u32));
        }
        let found: Vec<&str> = file.views().map(|(name, _)| name).collect();
        assert_eq!(found, ["default", "a", "a-2", "a-2-2", "a-3", "camera5", "camera6", "default-2"]);
        assert_eq!(places.at("cameras.a-3.fov").to_string(), "a:7");
    }
}
