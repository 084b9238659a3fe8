//! The container of binary glTF files (specification, §4.4): a header and chunks, of which the first is JSON and the second, if any,
//! holds a buffer.

use std::ops::Range;
use std::path::Path;

use crate::base::{Error, Place, Result};

const MAGIC: &[u8] = b"glTF";
const HEADER: usize = 12;
const JSON: &[u8; 4] = b"JSON";
const BINARY: &[u8; 4] = b"BIN\0";

/// Places of the chunks in a file.
#[derive(Debug, PartialEq, Eq)]
pub struct Chunks {
    /// The document.
    pub json: Range<usize>,
    /// The first buffer, if it is inside.
    pub binary: Option<Range<usize>>,
}

/// Finds the chunks in `bytes`, the content of the file at `path`; none where it is no binary file.
///
/// # Errors
/// [`Error::Malformed`] for a file that is cut off or begins with another chunk; [`Error::Unsupported`] for another version.
pub fn chunks(path: &Path, bytes: &[u8]) -> Result<Option<Chunks>> {
    if !bytes.starts_with(MAGIC) {
        return Ok(None);
    }
    let cut_off = |at: usize| Error::malformed(Place::byte(path, at as u64), "the file ends in the midst of a chunk");
    let word = |at: usize| {
        let word = bytes.get(at..).and_then(|rest| rest.first_chunk());
        word.map(|&word| u32::from_le_bytes(word)).ok_or_else(|| cut_off(at))
    };
    let version = word(4)?;
    if version != 2 {
        let (place, what) = (Place::byte(path, 4), format!("version {version} of binary glTF"));
        return Err(Error::Unsupported { place, what, supported: "2".into() });
    }
    // What follows the length in the header is none of the scene.
    let end = word(8)? as usize;
    if end > bytes.len() {
        let message = format!("the file should have {end} bytes, it has {}", bytes.len());
        return Err(Error::malformed(Place::byte(path, 8), message));
    }
    let (mut at, mut json, mut binary) = (HEADER, None, None);
    while at + 8 <= end {
        let length = word(at)? as usize;
        let range = at + 8..at.saturating_add(8).saturating_add(length);
        if range.end > end {
            return Err(cut_off(at));
        }
        match (bytes.get(at + 4..).and_then(|rest| rest.first_chunk()), &json) {
            (Some(JSON), None) => json = Some(range.clone()),
            (_, None) => return Err(Error::malformed(Place::byte(path, at as u64), "the first chunk is not JSON")),
            (Some(BINARY), Some(_)) if binary.is_none() => binary = Some(range.clone()),
            // Chunks of other kinds are for extensions.
            _ => {}
        }
        at = range.end;
    }
    match json {
        Some(json) => Ok(Some(Chunks { json, binary })),
        None => Err(cut_off(at)),
    }
}
