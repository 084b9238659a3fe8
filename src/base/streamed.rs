//! Files of arrays (see [`tensors`](super::tensors)) that are read in pieces: for files that together are larger than memory.
//!
//! The checksum of the whole is put together from those of the pieces, whatever their order, so that every byte is read once.

use std::cell::RefCell;
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use flate2::Crc;
use safetensors::tensor::Metadata;

use super::tensors::{Arrays, Dtype, checked_version, entry, length};
use super::{Error, Place, Result};

/// Largest accepted header in bytes: some ten thousand arrays.
const HEADER_LIMIT: u64 = 16 << 20;
/// Bytes before the header, which hold its length.
const LENGTH: u64 = 8;

/// A file of arrays whose header was read.
pub struct Streamed {
    path: PathBuf,
    metadata: Metadata,
    /// Where the arrays begin, in bytes.
    begin: u64,
}

/// Checksum of some rows of an array that were read, and where they begin among its bytes.
pub struct Checked {
    name: String,
    begin: u64,
    length: u64,
    crc: Crc,
}

impl Checked {
    /// The checksums of consecutive rows put together.
    pub fn joined(mut pieces: Vec<Self>) -> Vec<Self> {
        pieces.sort_by(|a, b| (&a.name, a.begin).cmp(&(&b.name, b.begin)));
        let mut joined: Vec<Self> = Vec::new();
        for piece in pieces {
            match joined.last_mut().filter(|last| last.name == piece.name && last.begin + last.length == piece.begin) {
                Some(last) => {
                    last.crc.combine(&piece.crc);
                    last.length += piece.length;
                }
                None => joined.push(piece),
            }
        }
        joined
    }
}

/// A file of arrays that is open, for any number of threads.
pub struct Reader<'a> {
    of: &'a Streamed,
    file: File,
}

/// Some rows of the arrays of a file. What is read of them is added up for [`Streamed::check`].
pub struct Rows<'a> {
    of: &'a Streamed,
    file: &'a File,
    rows: Option<Range<usize>>,
    checked: RefCell<Vec<Checked>>,
}

impl Streamed {
    /// Opens the file `path`, of any kind.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] where it is no safetensors file, or not as long as its header says.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |e| Error::io(path, e);
        let broken =
            |what: String| Error::malformed(Place::file(path), format!("not a whole safetensors file: {what}"));
        let mut file = File::open(path).map_err(io)?;
        let size = file.metadata().map_err(io)?.len();
        let mut length = [0; LENGTH as usize];
        file.read_exact(&mut length).map_err(|_| broken(format!("it has {size} bytes")))?;
        let length = u64::from_le_bytes(length);
        let begin = LENGTH.saturating_add(length);
        if length > HEADER_LIMIT || begin > size {
            return Err(broken(format!("it has {size} bytes, and its header would have {length}")));
        }
        let mut header = vec![0; length as usize];
        file.read_exact(&mut header).map_err(io)?;
        let metadata: Metadata = serde_json::from_slice(&header).map_err(|e| broken(e.to_string()))?;
        if begin.checked_add(metadata.data_len() as u64) != Some(size) {
            let expected = begin.saturating_add(metadata.data_len() as u64);
            return Err(broken(format!("it has {size} bytes, its header tells of {expected}")));
        }
        Ok(Self { path: path.to_owned(), metadata, begin })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Refuses a file of this `kind` that has not this `version`.
    ///
    /// # Errors
    /// [`Error::Unsupported`].
    pub fn check_version(&self, kind: &str, version: u32) -> Result<()> {
        checked_version(&self.path, &self.metadata, kind, version)
    }

    /// Refuses an array that is missing, or has another type or shape; see [`Arrays::read`].
    ///
    /// # Errors
    /// [`Error::Malformed`] naming the array.
    pub fn expect(&self, name: &str, dtype: Dtype, rows: usize, columns: usize) -> Result<()> {
        let fail = |message: String| Err(Error::malformed(Place::part(&self.path, name), message));
        let Some(info) = self.metadata.info(name) else { return fail("the array is missing".into()) };
        let shape = if columns == 1 { vec![rows] } else { vec![rows, columns] };
        if (info.dtype, &info.shape) != (dtype, &shape) {
            return fail(format!("{:?} {:?}, expected {dtype:?} {shape:?}", info.dtype, info.shape));
        }
        Ok(())
    }

    /// Bytes of an array; 0 where there is none.
    pub fn bytes(&self, name: &str) -> usize {
        self.metadata.info(name).map_or(0, |info| info.data_offsets.1 - info.data_offsets.0)
    }

    /// Whether there is an array of this name.
    pub fn has(&self, name: &str) -> bool {
        self.metadata.info(name).is_some()
    }

    /// Opens the file again, to read its arrays.
    ///
    /// # Errors
    /// [`Error::Io`] where the file is gone.
    pub fn reader(&self) -> Result<Reader<'_>> {
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, e))?;
        Ok(Reader { of: self, file })
    }

    /// Holds the pieces that were read against the checksum of the file. Every row of every array must be among them.
    ///
    /// # Errors
    /// [`Error::Malformed`] where the file is damaged.
    pub fn check(&self, pieces: Vec<Checked>) -> Result<()> {
        let fail = |message: String| Err(Error::malformed(Place::part(&self.path, "crc32"), message));
        let mut all = Crc::new();
        let mut read = 0;
        for piece in &Checked::joined(pieces) {
            all.combine(&piece.crc);
            read += piece.length;
        }
        if read != self.metadata.data_len() as u64 {
            return fail(format!(
                "the file has arrays that a part does not have: {read} of {} bytes were read",
                self.metadata.data_len()
            ));
        }
        let (found, expected) = (all.sum().to_string(), entry(&self.metadata, "crc32"));
        if found != expected {
            return fail(format!("the content's checksum is {found}, the header says {expected}: the file is damaged"));
        }
        Ok(())
    }
}

impl Reader<'_> {
    /// These rows of the arrays, or all of each.
    pub fn rows(&self, rows: Option<Range<usize>>) -> Rows<'_> {
        Rows { of: self.of, file: &self.file, rows, checked: RefCell::default() }
    }
}

impl Rows<'_> {
    /// Checksums of all that was read.
    pub fn checked(self) -> Vec<Checked> {
        self.checked.into_inner()
    }
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, at)?;
        if read == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[read..];
        at += read as u64;
    }
    Ok(())
}

impl Arrays for Rows<'_> {
    fn path(&self) -> &Path {
        &self.of.path
    }

    /// Of the view's rows, which must be as many as `rows`, if that is given.
    fn find(&self, name: &str, dtype: Dtype, rows: Option<usize>, columns: usize) -> Result<(u64, usize)> {
        let Some(info) = self.of.metadata.info(name) else { return self.fail(name, "the array is missing") };
        let length = length(&info.shape, columns);
        let range = length.map(|length| self.rows.clone().unwrap_or(0..length));
        let fits = |range: &Range<usize>| {
            range.end <= length.unwrap_or(0) && rows.is_none_or(|rows| rows == range.len()) && range.start <= range.end
        };
        let Some(range) = range.filter(|range| info.dtype == dtype && fits(range)) else {
            return self.unlike(name, (info.dtype, &info.shape), (dtype, rows, columns));
        };
        let row = dtype.bitsize() / 8 * columns;
        Ok(((range.start * row) as u64, range.len() * row))
    }

    fn take(&self, name: &str, begin: u64, bytes: &mut [u8]) -> Result<()> {
        let offset = self.of.metadata.info(name).map_or(0, |info| info.data_offsets.0 as u64);
        read_at(self.file, bytes, self.of.begin + offset + begin).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                Error::malformed(Place::part(&self.of.path, name), "the file has become shorter")
            }
            _ => Error::io(&self.of.path, e),
        })?;
        let mut crc = Crc::new();
        crc.update(bytes);
        self.checked.borrow_mut().push(Checked { name: name.to_owned(), begin, length: bytes.len() as u64, crc });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tensors::{borrowed, vector, write};
    use super::*;

    fn folder(version: u32) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let rows: Vec<f32> = (0..30).map(|i| i as f32).collect();
        let arrays = [
            borrowed::<_, 4>("rows", (Dtype::F32, 3), &rows),
            vector("few", Dtype::U8, [7u8, 9].map(|n| [n]).into_iter()),
        ];
        write(&path, version, &arrays).unwrap();
        (folder, path)
    }

    /// Reads all in pieces, the last first.
    fn read(path: &Path) -> Result<Vec<f32>> {
        let file = Streamed::open(path)?;
        file.check_version("test", 3)?;
        let mut all = Vec::new();
        let open = file.reader()?;
        let whole = open.rows(None);
        assert_eq!(whole.read("few", Dtype::U8, None, 1, |[b]: [u8; 1]| b)?, [7, 9]);
        let mut checked = whole.checked();
        for range in [7..10, 3..7, 0..3] {
            let rows = open.rows(Some(range.clone()));
            let mut piece: Vec<[f32; 3]> = Vec::new();
            rows.fill("rows", Dtype::F32, Some(range.len()), 3, &mut piece)?;
            all.splice(0..0, piece.iter().map(|row| row[0]));
            checked.extend(rows.checked());
        }
        file.check(checked).map(|()| all)
    }

    #[test]
    fn pieces_are_checked_as_a_whole() {
        let (_folder, path) = folder(3);
        assert_eq!(read(&path).unwrap(), (0..10).map(|i| 3.0 * i as f32).collect::<Vec<_>>());
        let good = std::fs::read(&path).unwrap();
        let begin = good.len() - 122;
        for at in begin..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 4;
            std::fs::write(&path, bad).unwrap();
            let refused = std::panic::catch_unwind(|| read(&path)).is_ok_and(|read| read.is_ok());
            assert!(!refused, "byte {at}");
        }
        for end in 0..good.len() {
            std::fs::write(&path, &good[..end]).unwrap();
            assert!(read(&path).is_err(), "{end} bytes");
        }
    }

    #[test]
    fn rows_that_are_not_there_are_refused() {
        let (_folder, path) = folder(3);
        let file = Streamed::open(&path).unwrap();
        let open = file.reader().unwrap();
        let number = |bytes: [u8; 4]| f32::from_le_bytes(bytes);
        assert!(open.rows(Some(8..11)).read("rows", Dtype::F32, None, 3, number).is_err());
        assert!(open.rows(Some(0..2)).read("rows", Dtype::F32, Some(3), 3, number).is_err());
        assert!(open.rows(None).read("rows", Dtype::F32, None, 2, number).is_err());
        assert!(open.rows(None).read("other", Dtype::F32, None, 3, number).is_err());
        assert!(file.check(Vec::new()).is_err(), "nothing was read");
        let (_folder, other) = folder(4);
        let other = Streamed::open(&other).unwrap();
        assert!(matches!(other.check_version("test", 3), Err(Error::Unsupported { .. })));
        assert!(file.expect("rows", Dtype::F32, 10, 3).is_ok() && file.expect("rows", Dtype::F32, 30, 1).is_err());
    }
}
