//! The cameras of a document that may hold several: the first is the default one.

use crate::base::Place;
use crate::picture::Window;
use crate::scene::file::{CameraFile, FilmFile, SceneFile};

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

/// The camera that sees the window of the film that this camera sees all of; the film becomes as large as the window, which must lie inside of it.
pub fn cropped(camera: &CameraFile, film: &mut FilmFile, window: Window) -> CameraFile {
    let part = f64::from(window.width) / f64::from(film.width);
    // The middle of the window, in pixels from that of the film, which is its offset from the axis where the film has none.
    let offset = |offset: f32, sides: [u32; 2], start: u32| {
        let [whole, own] = sides.map(f64::from);
        ((f64::from(offset) * whole + f64::from(start) + 0.5 * (own - whole)) / own) as f32
    };
    let [x, y] = camera.principal_point_offset;
    let principal_point_offset =
        [offset(x, [film.width, window.width], window.x), offset(y, [film.height, window.height], window.y)];
    (film.width, film.height) = (window.width, window.height);
    let half_tangent = (0.5 * f64::from(camera.fov)).to_radians().tan();
    CameraFile {
        fov: (2.0 * (half_tangent * part).atan().to_degrees()) as f32,
        orthographic_width: camera.orthographic_width.map(|width| (f64::from(width) * part) as f32),
        principal_point_offset,
        ..camera.clone()
    }
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

    use glam::Affine3A;

    use super::*;
    use crate::camera::Camera;
    use crate::scene::file::{FilterFile, IDENTITY};

    #[test]
    fn windows_are_seen_as_within_the_whole_film() {
        let film = FilmFile { width: 120, height: 80, filter: FilterFile::default() };
        let window = Window { x: 70, y: 5, width: 30, height: 50 };
        let seen = |file: &CameraFile, film: &FilmFile, [x, y]: [f32; 2]| {
            let size = [film.width, film.height];
            let camera = match file.orthographic_width {
                Some(width) => Camera::orthographic(Affine3A::IDENTITY, width, size),
                None => Camera::new(Affine3A::IDENTITY, file.fov, size, 0.0, 1.0),
            };
            camera.shifted(file.principal_point_offset).ray([x, y], [0.5; 2])
        };
        let perspective = CameraFile { principal_point_offset: [0.2, -0.1], ..CameraFile::pinhole(IDENTITY, 70.0) };
        for camera in [CameraFile { orthographic_width: Some(3.0), ..perspective.clone() }, perspective] {
            let mut part = film.clone();
            let own = cropped(&camera, &mut part, window);
            assert_eq!([part.width, part.height], [30, 50]);
            for [x, y] in [[0.0, 0.0], [30.0, 50.0], [11.5, 42.25]] {
                let (whole, seen) = (seen(&camera, &film, [x + 70.0, y + 5.0]), seen(&own, &part, [x, y]));
                let off = (whole.origin - seen.origin).length() + (whole.direction - seen.direction).length();
                assert!(off < 1e-5, "{x} {y}: {whole:?} {seen:?}");
            }
        }
    }

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
