//! The one place that writes files: to a temporary file in the same folder, then a rename, so that a reader never sees half
//! a file and an older version survives every failure.

use std::io::{BufWriter, Write};
use std::path::Path;

use super::{Error, Place, Result};

/// Writes `path` atomically with what `content` produces.
///
/// # Errors
/// [`Error::Io`] naming `path`; the previous file, if any, is untouched then.
pub fn write_atomically(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let fail = |source| Error::io(path, source);
    let mut file = tempfile::Builder::new().prefix(".fanal-").suffix(".part").tempfile_in(folder).map_err(fail)?;
    {
        let mut buffered = BufWriter::new(file.as_file_mut());
        content(&mut buffered).map_err(fail)?;
        buffered.flush().map_err(fail)?;
    }
    file.as_file().sync_all().map_err(fail)?;
    allow_reading(file.path()).map_err(fail)?;
    file.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}

/// Writes `bytes` to `path` atomically.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |out| out.write_all(bytes))
}

/// Reads a whole file, refusing one that is larger than `limit` bytes.
///
/// # Errors
/// [`Error::Io`] or [`Error::Limit`].
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > limit {
        return Err(Error::Limit { place: Place::file(path), what: "file size in bytes".into(), value: size, limit });
    }
    std::fs::read(path).map_err(|e| Error::io(path, e))
}

/// CRC-32 of bytes given in parts: tells damage and differences, not malice.
pub fn crc32<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> u32 {
    let mut crc = flate2::Crc::new();
    parts.into_iter().for_each(|part| crc.update(part));
    crc.sum()
}

/// Temporary files are private by default; a finished output gets the usual permissions.
#[cfg(unix)]
fn allow_reading(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn allow_reading(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_write_keeps_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        write_bytes(&path, b"old").unwrap();
        let failed = write_atomically(&path, |out| {
            out.write_all(b"new but broken")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays behind");
    }
}
