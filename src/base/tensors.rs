//! Arrays in a safetensors file with a version and a checksum: the format of shards and guide files.
//!
//! The header's metadata hold `version` and `crc32`, the latter over all tensors' bytes in the order of their names.

use std::borrow::Cow;
use std::path::Path;

pub use safetensors::Dtype;
use safetensors::SafeTensors;
use safetensors::tensor::Metadata;

use super::files::{crc32, write_atomically};
use super::{Error, Place, Result};

/// An array to write: name, type, shape, little-endian bytes.
pub type Tensor<'a> = (Cow<'static, str>, Dtype, Vec<usize>, Cow<'a, [u8]>);

/// A 1D tensor of elements of `B` bytes.
pub fn vector<'a, const B: usize>(
    name: impl Into<Cow<'static, str>>,
    dtype: Dtype,
    elements: impl Iterator<Item = [u8; B]>,
) -> Tensor<'a> {
    let bytes: Vec<u8> = elements.flatten().collect();
    (name.into(), dtype, vec![bytes.len() / B], bytes.into())
}

/// A 2D tensor of `f32` rows of `N` numbers.
pub fn floats<'a, const N: usize>(
    name: impl Into<Cow<'static, str>>,
    rows: impl Iterator<Item = [f32; N]>,
) -> Tensor<'a> {
    let bytes: Vec<u8> = rows.flatten().flat_map(f32::to_le_bytes).collect();
    (name.into(), Dtype::F32, vec![bytes.len() / (4 * N), N], bytes.into())
}

/// A 2D tensor of `f64` rows of `N` numbers.
pub fn doubles<'a, const N: usize>(
    name: impl Into<Cow<'static, str>>,
    rows: impl Iterator<Item = [f64; N]>,
) -> Tensor<'a> {
    let bytes: Vec<u8> = rows.flatten().flat_map(f64::to_le_bytes).collect();
    (name.into(), Dtype::F64, vec![bytes.len() / (8 * N), N], bytes.into())
}

/// A `u64` tensor of the beginnings of consecutive parts of these lengths, and the end of the last, for [`Tensors::offsets`].
pub fn offsets<'a>(name: impl Into<Cow<'static, str>>, lengths: impl Iterator<Item = usize>) -> Tensor<'a> {
    let ends = lengths.scan(0, |end, length| {
        *end += length as u64;
        Some(*end)
    });
    vector(name, Dtype::U64, std::iter::once(0).chain(ends).map(u64::to_le_bytes))
}

/// A tensor that borrows numbers from memory; they are copied only on big-endian machines.
pub fn borrowed<'a, T: bytemuck::NoUninit, const B: usize>(
    name: impl Into<Cow<'static, str>>,
    (dtype, columns): (Dtype, usize),
    values: &'a [T],
) -> Tensor<'a> {
    let bytes: &[u8] = bytemuck::cast_slice(values);
    let rows = bytes.len() / (B * columns);
    let shape = if columns == 1 { vec![rows] } else { vec![rows, columns] };
    let data = if cfg!(target_endian = "little") {
        Cow::Borrowed(bytes)
    } else {
        bytes.as_chunks::<B>().0.iter().flat_map(|b| b.iter().rev()).copied().collect()
    };
    (name.into(), dtype, shape, data)
}

/// Writes tensors atomically, without a second copy of them in memory.
///
/// # Errors
/// [`Error::Malformed`] where shapes do not fit the bytes, [`Error::Io`].
pub fn write(path: &Path, version: u32, tensors: &[Tensor]) -> Result<()> {
    let mut order: Vec<&Tensor> = tensors.iter().collect();
    order.sort_by(|a, b| a.0.cmp(&b.0));
    let crc = crc32(order.iter().map(|t| t.3.as_ref()));
    // Wide elements first, so that all are aligned.
    order.sort_by_key(|t| std::cmp::Reverse(t.1));
    let text = header(path, version, crc, &order)?;
    write_atomically(path, |out| {
        out.write_all(&(text.len() as u64).to_le_bytes())?;
        out.write_all(text.as_bytes())?;
        order.iter().try_for_each(|tensor| out.write_all(&tensor.3))
    })
}

/// The header as the format has it: JSON, filled up with spaces to a multiple of 8 bytes.
fn header(path: &Path, version: u32, crc: u32, tensors: &[&Tensor]) -> Result<String> {
    let mut header = serde_json::Map::new();
    let metadata = serde_json::json!({ "version": version.to_string(), "crc32": crc.to_string() });
    header.insert("__metadata__".into(), metadata);
    let mut end = 0;
    for (name, dtype, shape, data) in tensors {
        let begin = end;
        end += data.len();
        let entry = serde_json::json!({ "dtype": dtype, "shape": shape, "data_offsets": [begin, end] });
        if shape.iter().product::<usize>() * dtype.bitsize() != 8 * data.len() {
            return Err(Error::malformed(
                Place::part(path, name.as_ref()),
                format!("no {} bytes: {entry}", data.len()),
            ));
        }
        header.insert(name.clone().into_owned(), entry);
    }
    let text = serde_json::Value::Object(header).to_string();
    let length = text.len().next_multiple_of(8);
    Ok(format!("{text:length$}"))
}

/// An entry of a header's metadata.
pub(super) fn entry<'m>(header: &'m Metadata, key: &str) -> &'m str {
    header.metadata().as_ref().and_then(|entries| entries.get(key)).map_or("none", String::as_str)
}

/// Refuses the header of a file of this `kind` that has not this `version`.
pub(super) fn checked_version(path: &Path, header: &Metadata, kind: &str, version: u32) -> Result<()> {
    let found = entry(header, "version");
    if found == version.to_string() {
        return Ok(());
    }
    let what = format!("{kind} version {found}");
    Err(Error::Unsupported { place: Place::file(path), what, supported: version.to_string() })
}

/// Rows of an array of this shape whose trailing dimension is `columns` (1: a vector); none where that is another.
pub(super) fn length(shape: &[usize], columns: usize) -> Option<usize> {
    match *shape {
        [rows] if columns == 1 => Some(rows),
        [rows, found] if found == columns => Some(rows),
        _ => None,
    }
}

/// Turns numbers as files have them into those of this machine.
fn native<T: bytemuck::Pod>(dtype: Dtype, values: &mut [T]) {
    if cfg!(target_endian = "big") {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(values);
        bytes.chunks_exact_mut((dtype.bitsize() / 8).max(1)).for_each(<[u8]>::reverse);
    }
}

/// Arrays that can be read by their names, wherever they are.
pub trait Arrays {
    /// The file.
    fn path(&self) -> &Path;

    /// Where the rows of an array begin among its bytes, and how many bytes they are. Its trailing dimension is `columns` (1: a vector), its
    /// length `rows`, if given.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is missing or has another type or shape.
    fn find(&self, name: &str, dtype: Dtype, rows: Option<usize>, columns: usize) -> Result<(u64, usize)>;

    /// Reads so many bytes of an array from `begin` on, which [`Arrays::find`] has found.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] where the file has become shorter.
    fn take(&self, name: &str, begin: u64, bytes: &mut [u8]) -> Result<()>;

    /// Reads the elements of an array whose trailing dimension is `columns` (1: a vector) and whose length is `rows`, if given.
    ///
    /// # Errors
    /// Those of [`Arrays::find`] and [`Arrays::take`].
    fn read<const B: usize, T>(
        &self,
        name: &str,
        dtype: Dtype,
        rows: Option<usize>,
        columns: usize,
        decode: impl Fn([u8; B]) -> T,
    ) -> Result<Vec<T>> {
        let (begin, length) = self.find(name, dtype, rows, columns)?;
        let mut bytes = vec![0; length];
        self.take(name, begin, &mut bytes)?;
        Ok(bytes.as_chunks::<B>().0.iter().map(|&b| decode(b)).collect())
    }

    /// The same as plain numbers, one or more for a `T`, into memory that may be there already.
    ///
    /// # Errors
    /// As [`Arrays::read`].
    fn fill<T: bytemuck::Pod>(
        &self,
        name: &str,
        dtype: Dtype,
        rows: Option<usize>,
        columns: usize,
        values: &mut Vec<T>,
    ) -> Result<()> {
        let (begin, length) = self.find(name, dtype, rows, columns)?;
        values.resize(length / size_of::<T>(), T::zeroed());
        self.take(name, begin, bytemuck::cast_slice_mut(values))?;
        native(dtype, values);
        Ok(())
    }

    /// An error about an array of another type or shape than is wanted: type, rows if they are given, columns.
    ///
    /// # Errors
    /// Always [`Error::Malformed`].
    fn unlike<T>(
        &self,
        name: &str,
        (found, shape): (Dtype, &[usize]),
        (dtype, rows, columns): (Dtype, Option<usize>, usize),
    ) -> Result<T> {
        let wanted = format!("{dtype:?} of {rows:?} rows and {columns} columns");
        self.fail(name, format!("{found:?} {shape:?}, expected {wanted}"))
    }

    /// An error about a part of the file.
    ///
    /// # Errors
    /// Always [`Error::Malformed`].
    fn fail<T>(&self, part: impl Into<String>, message: impl Into<String>) -> Result<T> {
        Err(Error::malformed(Place::part(self.path(), part), message))
    }
}

/// The arrays of a file.
pub struct Tensors<'a> {
    file: SafeTensors<'a>,
    path: &'a Path,
}

impl<'a> Tensors<'a> {
    /// Opens `bytes`, the content of the file `path` of this `kind` and `version`.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is no safetensors file or damaged, [`Error::Unsupported`] where it has another version.
    pub fn open(path: &'a Path, bytes: &'a [u8], kind: &str, version: u32) -> Result<Self> {
        let broken = |e| Error::malformed(Place::file(path), format!("not a safetensors file: {e}"));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        checked_version(path, &header, kind, version)?;
        let tensors = Self { file: SafeTensors::deserialize(bytes).map_err(broken)?, path };
        tensors.check_crc(entry(&header, "crc32"))?;
        Ok(tensors)
    }

    fn check_crc(&self, expected: &str) -> Result<()> {
        let mut tensors = self.file.tensors();
        tensors.sort_by(|a, b| a.0.cmp(&b.0));
        let found = crc32(tensors.iter().map(|(_, t)| t.data())).to_string();
        if found == expected {
            return Ok(());
        }
        self.fail(
            "crc32",
            format!("the content's checksum is {found}, the header says {expected}: the file is damaged"),
        )
    }

    /// Reads the beginnings of `count` consecutive parts, and the end of the last: rising from 0.
    ///
    /// # Errors
    /// [`Error::Malformed`] naming the tensor.
    pub fn offsets(&self, name: &str, count: usize) -> Result<Vec<usize>> {
        let offsets = self.read(name, Dtype::U64, Some(count + 1), 1, u64::from_le_bytes)?;
        if offsets[0] != 0 || !offsets.is_sorted() {
            return self.fail(name, "offsets do not rise from 0");
        }
        Ok(offsets.into_iter().map(|o| usize::try_from(o).unwrap_or(usize::MAX)).collect())
    }

    /// Whether there is a tensor of this name.
    pub fn has(&self, name: &str) -> bool {
        self.file.tensor(name).is_ok()
    }
}

impl Arrays for Tensors<'_> {
    fn path(&self) -> &Path {
        self.path
    }

    fn find(&self, name: &str, dtype: Dtype, rows: Option<usize>, columns: usize) -> Result<(u64, usize)> {
        let Ok(tensor) = self.file.tensor(name) else { return self.fail(name, "the tensor is missing") };
        let length = length(tensor.shape(), columns).filter(|length| rows.is_none_or(|rows| rows == *length));
        if tensor.dtype() != dtype || length.is_none() {
            return self.unlike(name, (tensor.dtype(), tensor.shape()), (dtype, rows, columns));
        }
        Ok((0, tensor.data().len()))
    }

    fn take(&self, name: &str, begin: u64, bytes: &mut [u8]) -> Result<()> {
        let tensor = self.file.tensor(name).ok();
        let data = tensor.as_ref().and_then(|tensor| tensor.data().get(begin as usize..)?.get(..bytes.len()));
        let Some(data) = data else { return self.fail(name, "the tensor is missing") };
        bytes.copy_from_slice(data);
        Ok(())
    }
}
