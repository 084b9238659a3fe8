//! Files that gzip packed.

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use crate::base::{Error, Place, Result};

const MAGIC: [u8; 2] = [0x1F, 0x8B];

/// The content of the file at `path`, whose bytes may be packed: unpacked if they begin as gzip's do.
///
/// # Errors
/// [`Error::Limit`] if there is more than `limit` bytes of it; [`Error::Malformed`] if it cannot be unpacked.
pub fn unpacked(bytes: Vec<u8>, path: &Path, limit: u64) -> Result<Vec<u8>> {
    if bytes.first_chunk() != Some(&MAGIC) {
        return Ok(bytes);
    }
    let mut out = Vec::new();
    let read = MultiGzDecoder::new(bytes.as_slice()).take(limit + 1).read_to_end(&mut out);
    read.map_err(|error| Error::malformed(Place::file(path), format!("not a readable gzip file: {error}")))?;
    let value = out.len() as u64;
    if value > limit {
        let what = "unpacked size in bytes, at least,".to_owned();
        return Err(Error::Limit { place: Place::file(path), what, value, limit });
    }
    Ok(out)
}
