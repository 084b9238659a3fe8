//! Text of pbrt files: the scene's own and those that it includes.

use std::path::{Path, PathBuf};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::scene::readers::gzip::unpacked;

/// Largest text of a scene with all that it includes, bytes: meshes may be written out in it.
const MOST_TEXT: u64 = 4 << 30;
/// Most files that are included.
const MOST_FILES: usize = 1 << 14;
/// Deepest nesting of included files.
const MOST_NESTED: usize = 16;

/// The files that are being read, from the scene's own to the innermost, and what was read so far.
#[derive(Default)]
pub struct Sources {
    open: Vec<PathBuf>,
    files: usize,
    text: u64,
}

impl Sources {
    /// Opens the file at `path`, which is included at `place`, and returns its text. [`Sources::close`] ends it.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] for a file inside itself; [`Error::Limit`] for too many, too deep or too large files.
    pub fn open(&mut self, path: &Path, place: &Place) -> Result<String> {
        let real = path.canonicalize().map_err(|e| Error::io(path, e))?;
        if self.open.contains(&real) {
            return Err(Error::malformed(place.clone(), format!("{} includes itself", path.display())));
        }
        let limit = |what: &str, value: usize, limit: usize| match value > limit {
            true => Err(Error::Limit {
                place: place.clone(),
                what: what.to_owned(),
                value: value as u64,
                limit: limit as u64,
            }),
            false => Ok(()),
        };
        limit("depth of included files", self.open.len(), MOST_NESTED)?;
        self.files += 1;
        limit("number of included files", self.files, MOST_FILES)?;
        let left = MOST_TEXT - self.text;
        let bytes = unpacked(read_bytes(path, left)?, path, left)?;
        self.text += bytes.len() as u64;
        self.open.push(real);
        // Comments and names may be in any encoding; what matters is ASCII.
        Ok(String::from_utf8(bytes).unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
    }

    /// Ends the innermost file.
    pub fn close(&mut self) {
        self.open.pop();
    }
}
