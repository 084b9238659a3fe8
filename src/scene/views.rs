//! The cameras that are asked for.

use std::collections::BTreeSet;

use super::file::{CameraFile, SceneFile};
use super::readers::slips::meant;
use crate::base::{Error, Result};

/// What stands for all cameras, also where one of them has that name.
pub const ALL: &str = "all";

/// Most names that a message lists.
const LISTED: usize = 16;

/// Leaves the scene with the cameras that `choice` names alone: one by its name, several with commas between them, or [`ALL`]; the
/// default one where nothing is asked for. The first of them is the default one then, and the picture has its size.
///
/// # Errors
/// [`Error::Options`] for a name that no camera has, with those that there are.
pub fn choose(file: &mut SceneFile, choice: Option<&str>) -> Result<()> {
    let default = file.camera_name.clone();
    let chosen: Vec<&str> = match choice {
        None => vec![default.as_str()],
        Some(ALL) => return settle(file, &names(file)),
        Some(name) if find(file, name).is_some() => vec![name],
        Some(list) => list.split(',').map(str::trim).collect(),
    };
    settle(file, &chosen.into_iter().map(str::to_owned).collect::<Vec<_>>())
}

fn names(file: &SceneFile) -> Vec<String> {
    file.views().map(|(name, _)| name.to_owned()).collect()
}

fn find<'a>(file: &'a SceneFile, name: &str) -> Option<&'a CameraFile> {
    file.views().find(|(other, _)| *other == name).map(|(_, camera)| camera)
}

fn settle(file: &mut SceneFile, chosen: &[String]) -> Result<()> {
    let known = [file.film.width, file.film.height];
    let mut cameras = Vec::new();
    for name in chosen {
        let camera = find(file, name).ok_or_else(|| unknown(file, name))?;
        cameras.push((name.clone(), CameraFile { size: Some(camera.size.unwrap_or(known)), ..camera.clone() }));
    }
    let Some((name, first)) = cameras.first().cloned() else { return Ok(()) };
    let size = first.size.unwrap_or(known);
    [file.film.width, file.film.height] = size;
    cameras.iter_mut().for_each(|(_, camera)| camera.size = camera.size.filter(|own| *own != size));
    (file.camera_name, file.camera) = (name.clone(), CameraFile { size: None, ..first });
    file.cameras = cameras.into_iter().filter(|(other, _)| *other != name).collect();
    Ok(())
}

fn unknown(file: &SceneFile, name: &str) -> Error {
    let known: BTreeSet<&str> = file.views().map(|(name, _)| name).collect();
    let listed: Vec<String> = known.iter().take(LISTED).map(|name| format!("{name:?}")).collect();
    let more = known.len() - listed.len();
    let more = if more > 0 { format!(" and {more} more (see fanal plan)") } else { String::new() };
    let meant = meant(name, &known.into_iter().collect::<Vec<_>>()).map(|near| format!("; is {near:?} meant?"));
    let meant = meant.unwrap_or_default();
    Error::Options(format!("there is no camera {name:?}; there are {}{more}{meant}", listed.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::file::{FilmFile, FilterFile, IDENTITY};

    fn scene() -> SceneFile {
        let film = FilmFile { width: 40, height: 30, filter: FilterFile::default() };
        let mut file = SceneFile::empty(String::new(), CameraFile::pinhole(IDENTITY, 10.0), film);
        for (name, fov, size) in [("door", 20.0, None), ("from above, left", 30.0, Some([16, 64])), ("all", 40.0, None)]
        {
            file.cameras.insert(name.into(), CameraFile { size, ..CameraFile::pinhole(IDENTITY, fov) });
        }
        file
    }

    fn chosen(choice: Option<&str>) -> SceneFile {
        let mut file = scene();
        choose(&mut file, choice).expect("there is such a camera");
        file
    }

    #[test]
    fn cameras_are_chosen_by_name() {
        let seen = |file: &SceneFile| file.views().map(|(_, camera)| camera.fov as u32).collect::<Vec<_>>();
        assert_eq!(seen(&chosen(None)), [10]);
        assert_eq!(seen(&chosen(Some("default"))), [10]);
        assert_eq!(seen(&chosen(Some("all"))), [10, 40, 20, 30]);
        assert_eq!(seen(&chosen(Some("door, default,door"))), [20, 10], "each once, the first one first");
        let tall = chosen(Some("from above, left"));
        assert_eq!((seen(&tall), [tall.film.width, tall.film.height]), (vec![30], [16, 64]));
        assert_eq!((tall.camera.size, tall.camera_name.as_str()), (None, "from above, left"));
        // Those of another size than the first one's keep it.
        let all = chosen(Some("all"));
        assert_eq!((all.cameras["door"].size, all.cameras["from above, left"].size), (None, Some([16, 64])));
    }

    #[test]
    fn an_unknown_camera_is_told_from_the_known() {
        for (choice, words) in [
            ("dorr", &["no camera \"dorr\"", "\"default\"", "is \"door\" meant?"][..]),
            ("door,lantern", &["no camera \"lantern\"", "\"from above, left\""]),
            ("", &["no camera \"\""]),
        ] {
            let told = choose(&mut scene(), Some(choice)).expect_err(choice).to_string();
            assert!(words.iter().all(|word| told.contains(word)), "{told}");
        }
        let mut many = scene();
        many.cameras.extend((0..500).map(|i| (format!("c{i}"), CameraFile::pinhole(IDENTITY, 10.0))));
        let told = choose(&mut many, Some("lantern")).expect_err("no such camera").to_string();
        assert!(told.len() < 400 && told.contains("488 more"), "{told}");
    }
}
