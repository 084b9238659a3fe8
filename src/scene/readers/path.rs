//! Paths inside scene files: relative to the scene's folder, and never out of it.

use std::path::{Component, Path, PathBuf};

use crate::base::{Error, Place, Result};

/// The path of the file that the scene in `folder` calls `file`.
///
/// # Errors
/// [`Error::Malformed`] at `place` if the path is empty, absolute, leaves the folder (also by a symbolic link), or is not a
/// regular file; [`Error::Io`] if there is no such file.
pub fn resolve(folder: &Path, file: &str, place: &Place) -> Result<PathBuf> {
    let relative = normalize(file, place)?;
    let joined = folder.join(relative);
    let real = joined.canonicalize().map_err(|e| Error::io(&joined, e))?;
    let root = folder_or_here(folder);
    let root = root.canonicalize().map_err(|e| Error::io(root, e))?;
    if !real.starts_with(&root) {
        return Err(Error::malformed(place.clone(), format!("\"{file}\" leads out of the scene's folder")));
    }
    // A pipe or a device would block or never end.
    if !real.is_file() {
        return Err(Error::malformed(place.clone(), format!("\"{file}\" is not a regular file")));
    }
    Ok(joined)
}

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
                    return refuse("climbs out of the scene's folder");
                }
            }
            Component::RootDir | Component::Prefix(_) => {
                return refuse("is absolute; expected one relative to the scene's folder");
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
}
