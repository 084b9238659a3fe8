//! The one place that writes files: to a temporary file in the same folder, then a rename, so that a reader never sees half
//! a file and an older version survives every failure. A link is followed, and stays; what is no regular file, such as `/dev/null` or a
//! pipe, is written to and never replaced.

use std::fs::File;
#[cfg(unix)]
use std::fs::TryLockError;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Error, Place, Result};

/// Writes the output of `content` to `path` atomically.
///
/// # Errors
/// [`Error::Io`] naming `path`; the previous file, if any, is untouched then.
pub fn write_atomically(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    write_file(path, |file| {
        let mut buffered = BufWriter::new(file);
        content(&mut buffered).and_then(|()| buffered.flush()).map_err(|source| Error::io(path, source))
    })
}

/// The same for content that goes back and forth in the file.
///
/// # Errors
/// [`Error::Io`] naming `path`, those of `content`; the previous file, if any, is untouched then.
pub fn write_file(path: &Path, content: impl FnOnce(&mut File) -> Result<()>) -> Result<()> {
    let fail = |source| Error::io(path, source);
    if is_device(path) {
        return content(&mut File::options().write(true).open(path).map_err(fail)?);
    }
    let path = &followed(path);
    let mut part = Part::new(path).map_err(fail)?;
    content(&mut part.file)?;
    part.file.sync_all().map_err(fail)?;
    part.persist(path).map_err(fail)
}

/// Whether `path` names, perhaps by a link, what is there and neither a regular file nor a folder: a device or a pipe.
pub fn is_device(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Links that are followed one after the other, as many as Linux follows.
const MOST_LINKS: usize = 40;

/// The file that writing to `path` makes or replaces: that which a link leads to, perhaps by others, also where there
/// is none yet, else `path`.
pub fn followed(path: &Path) -> PathBuf {
    let mut file = path.to_owned();
    for _ in 0..MOST_LINKS {
        let Ok(target) = std::fs::read_link(&file) else { break };
        file = std::fs::canonicalize(&file).unwrap_or_else(|_| folder_of(&file).join(target));
    }
    file
}

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A temporary file, deleted on drop unless it was renamed to its final name.
///
/// A process that is killed leaves its own behind. So an output always has the same temporary file, which the next process that
/// writes it takes over. A lock, which ends with its owner, tells whether another process is writing; a file of a random name is
/// used then.
struct Part {
    file: File,
    name: PathBuf,
    renamed: bool,
}

impl Part {
    fn new(path: &Path) -> std::io::Result<Self> {
        let folder = folder_of(path);
        // Only Unix can tell whether an open file is still the one under its name.
        #[cfg(unix)]
        if let Some(part) = path.file_name().and_then(|name| Self::usual(&folder.join(part_of(name)), File::try_lock)) {
            return Ok(part);
        }
        let mut builder = tempfile::Builder::new();
        // Temporary files are private otherwise; an output has what the user's mask leaves, as any new file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let (file, name) = builder.prefix(".fanal-").suffix(".part").tempfile_in(folder)?.keep()?;
        Ok(Self { file, name, renamed: false })
    }

    /// Opens the usual temporary file, emptied and locked by `lock`; none where another process may be writing to it,
    /// or where the name is a link or the file has just got its final name.
    #[cfg(unix)]
    fn usual(name: &Path, lock: impl FnOnce(&File) -> Result<(), TryLockError>) -> Option<Self> {
        let open = |new: bool| File::options().read(true).write(true).create_new(new).open(name);
        let (file, is_new) = match open(true) {
            Ok(file) => (file, true),
            Err(_) => (open(false).ok()?, false),
        };
        let locked = lock(&file);
        let found = file.metadata().ok()?;
        let is_own = is_alone_at(&found, &std::fs::symlink_metadata(name).ok()?);
        match locked {
            Ok(()) if is_own && file.set_len(0).is_ok() => Some(Self { file, name: name.to_owned(), renamed: false }),
            // Where there are no locks every process uses files of random names, so nobody else has begun to write to
            // this one.
            Err(TryLockError::Error(_)) if is_new && is_own && found.len() == 0 => {
                let _ = std::fs::remove_file(name);
                None
            }
            _ => None,
        }
    }

    /// Renames the file to its final name. The lock ends afterwards.
    fn persist(mut self, path: &Path) -> std::io::Result<()> {
        std::fs::rename(&self.name, path)?;
        self.renamed = true;
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if !self.renamed {
            // A file that cannot be removed is taken over by the next write.
            let _ = std::fs::remove_file(&self.name);
        }
    }
}

#[cfg(unix)]
fn part_of(name: &std::ffi::OsStr) -> std::ffi::OsString {
    let mut part = std::ffi::OsString::from(".fanal-");
    part.push(name);
    part.push(".part");
    part
}

/// Whether an open file is regular, has a single link, and is the file under the name (same device and inode).
#[cfg(unix)]
fn is_alone_at(file: &std::fs::Metadata, named: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.is_file() && file.nlink() == 1 && (file.dev(), file.ino()) == (named.dev(), named.ino())
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

/// Reads a JSON file of at most `limit` bytes.
///
/// # Errors
/// Those of [`read_bytes`]; [`Error::Malformed`] naming the line.
pub fn read_json<T: DeserializeOwned>(path: &Path, limit: u64) -> Result<T> {
    serde_json::from_slice(&read_bytes(path, limit)?)
        .map_err(|e| Error::malformed(Place::line(path, u32::try_from(e.line()).unwrap_or(u32::MAX)), e.to_string()))
}

/// Writes any value as JSON, atomically.
///
/// # Errors
/// [`Error::Io`]; [`Error::Options`] for a value that JSON cannot express.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let fail = |e: serde_json::Error| Error::Options(format!("{}: {e}", path.display()));
    write_bytes(path, &serde_json::to_vec_pretty(value).map_err(fail)?)
}

/// CRC-32 of bytes given in parts: detects damage and differences, not malice.
pub fn crc32<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> u32 {
    let mut crc = flate2::Crc::new();
    parts.into_iter().for_each(|part| crc.update(part));
    crc.sum()
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

    /// The temporary file of a killed process is gone after the next write, and its content never gets into the file.
    #[cfg(unix)]
    #[test]
    fn f01_leftovers_are_taken_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        std::fs::write(folder.path().join(".fanal-picture.part"), "half of a long picture").unwrap();
        write_bytes(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Links under the temporary name are left alone, and so are their targets.
    #[cfg(unix)]
    #[test]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, victim, part] = ["picture", "victim", ".fanal-picture.part"].map(|name| folder.path().join(name));
        std::fs::write(&victim, "precious").unwrap();
        for link in [std::os::unix::fs::symlink::<&Path, &Path>, |from, to| std::fs::hard_link(from, to)] {
            link(&victim, &part).unwrap();
            write_bytes(&path, b"new").unwrap();
            assert_eq!(
                (std::fs::read(&path).unwrap(), std::fs::read(&victim).unwrap()),
                (b"new".to_vec(), b"precious".to_vec())
            );
            std::fs::remove_file(&part).unwrap();
        }
    }

    /// A link to an output stays one, and so do those that lead to it by each other, whether their target is there or
    /// not.
    #[cfg(unix)]
    #[test]
    fn links_stay() {
        let folder = tempfile::tempdir().unwrap();
        let [between, elsewhere] = ["between", "elsewhere"].map(|name| folder.path().join(name));
        for folder in [&between, &elsewhere] {
            std::fs::create_dir(folder).unwrap();
        }
        let links = [("picture", "elsewhere/picture"), ("far", "between/link"), ("between/link", "../elsewhere/far")];
        let links = links.map(|(link, target)| {
            let link = folder.path().join(link);
            std::os::unix::fs::symlink(target, &link).unwrap();
            link
        });
        for content in [b"first", b"later"] {
            for (link, file) in [(&links[0], "picture"), (&links[1], "far")] {
                write_bytes(link, content).unwrap();
                assert_eq!(std::fs::read(elsewhere.join(file)).unwrap(), content);
            }
            assert!(links.iter().all(|link| std::fs::symlink_metadata(link).unwrap().is_symlink()));
        }
        for (folder, count) in [(folder.path(), 4), (between.as_path(), 1), (elsewhere.as_path(), 2)] {
            assert_eq!(std::fs::read_dir(folder).unwrap().count(), count, "{}", folder.display());
        }
    }

    /// Links that lead to each other are not followed for ever.
    #[cfg(unix)]
    #[test]
    fn circles_of_links_have_an_end() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("b", &a).unwrap();
        std::os::unix::fs::symlink("a", &b).unwrap();
        assert!([&a, &b].contains(&&followed(&a)));
    }

    /// Where a file system has no locks, the file that was made for one does not stay; what was there before does, and
    /// so does what another process has locked.
    #[cfg(unix)]
    #[test]
    fn files_that_cannot_be_locked_are_taken_away() {
        let folder = tempfile::tempdir().unwrap();
        let part = folder.path().join(".fanal-picture.part");
        let unsupported = || TryLockError::Error(std::io::ErrorKind::Unsupported.into());
        assert!(Part::usual(&part, |_| Err(unsupported())).is_none() && !part.exists());
        assert!(Part::usual(&part, |_| Err(TryLockError::WouldBlock)).is_none() && part.exists());
        for content in ["", "half a picture"] {
            std::fs::write(&part, content).unwrap();
            assert!(Part::usual(&part, |_| Err(unsupported())).is_none());
            assert_eq!(std::fs::read_to_string(&part).unwrap(), content);
        }
    }

    /// A pipe is written to, not replaced. (Nor is `/dev/null`, for which a test would need the rights to destroy it.)
    #[cfg(unix)]
    #[test]
    fn pipes_are_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let read = {
            let pipe = pipe.clone();
            std::thread::spawn(move || std::fs::read(pipe).unwrap())
        };
        write_bytes(&pipe, b"statistics").unwrap();
        assert_eq!(read.join().unwrap(), b"statistics");
        assert!(std::fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Outputs have the permissions of any new file, by whichever temporary file they were written.
    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_new_files() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [path, other, part] = ["picture", "other", ".fanal-picture.part"].map(|name| folder.path().join(name));
        std::fs::write(&other, "any file").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        write_bytes(&path, b"by the usual file").unwrap();
        assert_eq!(mode(&path), mode(&other));
        // Another process holds the usual one.
        let held = File::create(&part).unwrap();
        held.lock().unwrap();
        write_bytes(&path, b"by a file of a random name").unwrap();
        assert_eq!(mode(&path), mode(&other));
    }

    /// When several threads write the same file at once, it always holds the whole content of one of them.
    #[test]
    fn writers_do_not_mix() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        std::thread::scope(|scope| {
            for byte in 0..8u8 {
                let path = &path;
                scope.spawn(move || {
                    for round in 1..40 {
                        write_bytes(path, &vec![byte; 1000 * round]).unwrap();
                        let found = std::fs::read(path).unwrap();
                        assert!(
                            !found.is_empty()
                                && found.len().is_multiple_of(1000)
                                && found.iter().all(|b| *b == found[0])
                        );
                    }
                });
            }
        });
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
