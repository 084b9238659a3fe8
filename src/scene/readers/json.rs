//! Our own format: a [`SceneFile`] as JSON.

use std::path::Path;

use crate::base::files::{read_bytes, write_atomically};
use crate::base::{Error, Place, Result};
use crate::scene::file::{MeshFile, SceneFile, VERSION};

use super::mesh::not_held;
use super::places::Places;
use super::validate::{unsupported_version, validate};

/// Largest scene file, bytes: meshes may be written out in it.
const LARGEST_FILE: u64 = 1 << 30;

/// Reads a scene file without looking at its values.
pub(super) fn read(path: &Path) -> Result<SceneFile> {
    let bytes = read_bytes(path, LARGEST_FILE)?;
    serde_json::from_slice(&bytes).map_err(|error| explain(path, &bytes, &error))
}

fn explain(path: &Path, bytes: &[u8], error: &serde_json::Error) -> Error {
    // A newer version may well have other keys: check the version first.
    #[derive(serde::Deserialize)]
    struct Versioned {
        version: u32,
    }
    if let Ok(Versioned { version }) = serde_json::from_slice(bytes)
        && version != VERSION
    {
        return unsupported_version(Place::part(path, "version"), version);
    }
    let line = u32::try_from(error.line()).unwrap_or(u32::MAX);
    Error::malformed(Place::line(path, line), error.to_string())
}

/// Writes a scene file as indented JSON, atomically.
///
/// # Errors
/// The errors of [`resolve`](super::resolve) for invalid values (JSON has no infinity or NaN), [`Error::Io`], and
/// [`Error::Unsupported`] for a scene whose meshes are in memory only.
pub fn save(file: &SceneFile, path: &Path) -> Result<()> {
    for (name, mesh) in &file.meshes {
        if let MeshFile::Held { part } = mesh {
            return Err(not_held(&Place::part(path, format!("meshes.{name}")), part));
        }
    }
    validate(file, &Places::new(path))?;
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, file)?;
        out.write_all(b"\n")
    })
}
