//! Arrays in a safetensors file with a version and a checksum: what shards and guide files are made of.
//!
//! The header's metadata hold `version` and `crc32`, the latter over all tensors' bytes in the order of their names.

use std::collections::HashMap;
use std::path::Path;

pub use safetensors::Dtype;
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;

use super::files::{crc32, write_bytes};
use super::{Error, Place, Result};

/// An array to write: name, type, shape, little-endian bytes.
pub type Tensor = (&'static str, Dtype, Vec<usize>, Vec<u8>);

/// Writes tensors, which must be sorted by name, atomically.
///
/// # Errors
/// [`Error::Malformed`] where shapes do not fit the bytes, [`Error::Io`].
pub fn write(path: &Path, version: u32, tensors: &[Tensor]) -> Result<()> {
    let metadata = HashMap::from([
        ("version".to_owned(), version.to_string()),
        ("crc32".to_owned(), crc32(tensors.iter().map(|t| t.3.as_slice())).to_string()),
    ]);
    let fail = |e| Error::malformed(Place::file(path), format!("the arrays cannot be stored: {e}"));
    let views: Vec<_> = tensors
        .iter()
        .map(|(name, dtype, shape, data)| {
            TensorView::new(*dtype, shape.clone(), data).map(|v| (*name, v)).map_err(fail)
        })
        .collect::<Result<_>>()?;
    write_bytes(path, &safetensors::serialize(views, Some(metadata)).map_err(fail)?)
}

/// The arrays of a file.
pub struct Tensors<'a> {
    file: SafeTensors<'a>,
    path: &'a Path,
}

impl<'a> Tensors<'a> {
    /// Takes the content of the file `path` of this `kind` and `version`.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is no safetensors file or damaged, [`Error::Unsupported`] where it has another version.
    pub fn open(path: &'a Path, bytes: &'a [u8], kind: &str, version: u32) -> Result<Self> {
        let broken = |e| Error::malformed(Place::file(path), format!("not a safetensors file: {e}"));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let entry =
            |key: &str| header.metadata().as_ref().and_then(|m| m.get(key)).map(String::as_str).unwrap_or("none");
        if entry("version") != version.to_string() {
            let what = format!("{kind} version {}", entry("version"));
            return Err(Error::Unsupported { place: Place::file(path), what, supported: version.to_string() });
        }
        let tensors = Self { file: SafeTensors::deserialize(bytes).map_err(broken)?, path };
        tensors.check_crc(entry("crc32"))?;
        Ok(tensors)
    }

    /// An error about a part of the file.
    ///
    /// # Errors
    /// Always [`Error::Malformed`].
    pub fn fail<T>(&self, part: impl Into<String>, message: impl Into<String>) -> Result<T> {
        Err(Error::malformed(Place::part(self.path, part), message))
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

    /// The elements of a tensor whose trailing dimension is `columns` (1: a vector) and whose length is `rows`, if given.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is missing or has another type or shape.
    pub fn read<const B: usize, T>(
        &self,
        name: &str,
        dtype: Dtype,
        rows: Option<usize>,
        columns: usize,
        decode: fn([u8; B]) -> T,
    ) -> Result<Vec<T>> {
        let Ok(tensor) = self.file.tensor(name) else { return self.fail(name, "the tensor is missing") };
        let shape_ok = match tensor.shape() {
            [n] => columns == 1 && rows.is_none_or(|r| r == *n),
            [n, c] => columns == *c && rows.is_none_or(|r| r == *n),
            _ => false,
        };
        if tensor.dtype() != dtype || !shape_ok {
            let found = format!("{:?} {:?}", tensor.dtype(), tensor.shape());
            return self.fail(name, format!("{found}, expected {dtype:?} of {rows:?} rows and {columns} columns"));
        }
        Ok(tensor.data().as_chunks::<B>().0.iter().map(|&b| decode(b)).collect())
    }
}
