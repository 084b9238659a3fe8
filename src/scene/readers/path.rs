//! Paths inside scene files: relative to the scene's folder, and never out of it, unless who renders names another folder whose files
//! scenes may use.

use std::path::{Component, Path, PathBuf};
use std::sync::LazyLock;

use crate::base::{Error, Place, Result};

/// Environment variable with a folder whose files scenes may use beside those below their own.
const ROOT: &str = "FANAL_SCENE_ROOT";

/// The folder of [`ROOT`], if there is one, or why it cannot be used.
static ALLOWED: LazyLock<std::result::Result<Option<PathBuf>, String>> = LazyLock::new(|| {
    let Some(given) = std::env::var_os(ROOT).filter(|given| !given.is_empty()) else { return Ok(None) };
    let folder = Path::new(&given);
    folder.canonicalize().map(Some).map_err(|error| format!("{ROOT}: {}: {error}", folder.display()))
});

/// The path of the file that the scene in `folder` calls `file`.
///
/// # Errors
/// [`Error::Malformed`] at `place` if the path is empty, absolute, leaves the folder (also by a symbolic link), or is not a
/// regular file; [`Error::Io`] if there is no such file; [`Error::Options`] if [`ROOT`] names no folder.
pub fn resolve(folder: &Path, file: &str, place: &Place) -> Result<PathBuf> {
    let allowed = ALLOWED.as_ref().map_err(|why| Error::Options(why.clone()))?;
    resolve_below(allowed.as_deref(), folder, file, place)
}

/// As [`resolve`], where files below the folder `allowed` may be named, too, by absolute paths as well.
fn resolve_below(allowed: Option<&Path>, folder: &Path, file: &str, place: &Place) -> Result<PathBuf> {
    let joined = match allowed {
        None => folder.join(normalize(file, place)?),
        Some(_) if file.is_empty() || file.contains('\0') => normalize(file, place)?,
        Some(_) => folder.join(file),
    };
    let real = joined.canonicalize().map_err(|e| Error::io(&joined, e))?;
    let root = folder_or_here(folder);
    let root = root.canonicalize().map_err(|e| Error::io(root, e))?;
    if !real.starts_with(&root) && !allowed.is_some_and(|allowed| real.starts_with(allowed)) {
        let message = format!("\"{file}\" leads out of the scene's folder; {ALLOWS}");
        return Err(Error::malformed(place.clone(), message));
    }
    // A pipe or a device would block or never end.
    if !real.is_file() {
        return Err(Error::malformed(place.clone(), format!("\"{file}\" is not a regular file")));
    }
    Ok(joined)
}

/// What helps where a path leads out of the scene's folder.
const ALLOWS: &str = "FANAL_SCENE_ROOT=FOLDER allows files below FOLDER";

fn folder_or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Removes `.` and `..` without asking the file system.
fn normalize(file: &str, place: &Place) -> Result<PathBuf> {
    let refuse = |why: &str| Err(Error::malformed(place.clone(), format!("path \"{file}\" {why}")));
    let mut out = PathBuf::new();
    for component in Path::new(file).components() {
        match component {
            Component::Normal(name) => out.push(name),
            Component::CurDir => {}
            Component::ParentDir => {
                if !out.pop() {
                    return refuse(&format!("climbs out of the scene's folder; {ALLOWS}"));
                }
            }
            Component::RootDir | Component::Prefix(_) => {
                return refuse(&format!("is absolute; expected one relative to the scene's folder; {ALLOWS}"));
            }
        }
    }
    if out.as_os_str().is_empty() || file.contains('\0') {
        return refuse("names no file");
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_inside() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene");
        std::fs::create_dir_all(scene.join("a")).unwrap();
        std::fs::write(folder.path().join("secret"), "s").unwrap();
        std::fs::write(scene.join("a/mesh.obj"), "m").unwrap();
        let place = Place::file("scene.json");
        for good in ["a/mesh.obj", "./a/mesh.obj", "a/../a/mesh.obj"] {
            resolve(&scene, good, &place).unwrap();
        }
        for bad in ["../secret", "a/../../secret", "/etc/passwd", "", ".", "a", "a/.."] {
            assert!(matches!(resolve(&scene, bad, &place), Err(Error::Malformed { .. })), "{bad}");
        }
        assert!(matches!(resolve(&scene, "missing.obj", &place), Err(Error::Io { .. })));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path().join("secret"), scene.join("link")).unwrap();
            assert!(matches!(resolve(&scene, "link", &place), Err(Error::Malformed { .. })));
        }
    }

    #[test]
    fn goes_where_it_may() {
        let folder = tempfile::tempdir().unwrap();
        let [allowed, scene] = ["allowed", "allowed/scene"].map(|name| folder.path().join(name));
        std::fs::create_dir_all(scene.join("a")).unwrap();
        for name in ["secret", "allowed/shared.obj", "allowed/scene/own.obj"] {
            std::fs::write(folder.path().join(name), "m").unwrap();
        }
        let (place, allowed) = (Place::file("scene.json"), allowed.canonicalize().unwrap());
        let absolute = allowed.join("shared.obj");
        for good in ["own.obj", "../shared.obj", "a/../../shared.obj", absolute.to_str().unwrap()] {
            resolve_below(Some(&allowed), &scene, good, &place).unwrap();
        }
        for bad in ["../../secret", "/etc/passwd", "", "..", "a"] {
            let found = resolve_below(Some(&allowed), &scene, bad, &place);
            assert!(matches!(found, Err(Error::Malformed { .. })), "{bad}: {found:?}");
        }
    }
}
