//! Buffers and the views of them (specification, §3.6.1): every range is checked against the bytes that are there.

use std::borrow::Cow;

use ::gltf::json::Index;
use ::gltf::json::buffer::View;

use crate::base::files::read_bytes;
use crate::base::{Error, Result};
use crate::scene::readers::LARGEST_MESH_FILE;
use crate::scene::readers::missing::{self, Absent};
use crate::scene::readers::path;

use super::document::Document;
use super::uri::{self, Target};

/// The bytes of a buffer.
#[derive(Debug)]
enum Buffer<'a> {
    Bytes(Cow<'a, [u8]>),
    /// A file of this name that is not there.
    Absent(String),
    /// An extension would make it.
    Nothing,
}

/// All buffers of a document.
#[derive(Debug)]
pub struct Buffers<'a> {
    document: &'a Document,
    buffers: Vec<Buffer<'a>>,
}

/// A range of a buffer.
#[derive(Debug, Clone, Copy)]
pub struct Slice<'a> {
    /// Its bytes.
    pub bytes: &'a [u8],
    /// Bytes from one element to the next; none where they follow one another.
    pub stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// Reads the buffers of `document`; files that are not there are added to `absent`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] (also for a buffer that is shorter than it says), [`Error::Unsupported`].
    pub fn read(document: &'a Document, absent: &mut Vec<Absent>) -> Result<Self> {
        let mut buffers = Vec::new();
        for (index, buffer) in document.root.buffers.iter().enumerate() {
            let part = format!("buffers[{index}]");
            let place = document.place(&part);
            let bytes = match (&buffer.uri, document.chunk()) {
                (Some(uri), _) => match uri::target(uri, &place)? {
                    Target::Data(bytes) => Cow::Owned(bytes),
                    Target::File(file) if missing::is_absent(document.folder(), &file) => {
                        absent.push(Absent { file: file.clone(), place, instead: None });
                        buffers.push(Buffer::Absent(file));
                        continue;
                    }
                    Target::File(file) => {
                        Cow::Owned(read_bytes(&path::resolve(document.folder(), &file, &place)?, LARGEST_MESH_FILE)?)
                    }
                },
                (None, Some(chunk)) if index == 0 => Cow::Borrowed(chunk),
                (None, _) => {
                    buffers.push(Buffer::Nothing);
                    continue;
                }
            };
            if buffer.byte_length.0 > bytes.len() as u64 {
                let message = format!("it should have {} bytes, there are {}", buffer.byte_length.0, bytes.len());
                return Err(document.malformed(part, message));
            }
            buffers.push(Buffer::Bytes(bytes));
        }
        Ok(Self { document, buffers })
    }

    /// Bytes of all buffers together.
    pub fn size(&self) -> usize {
        let size = |buffer: &Buffer| if let Buffer::Bytes(bytes) = buffer { bytes.len() } else { 0 };
        self.buffers.iter().map(size).sum()
    }

    /// The bytes of the view that `user` names.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it goes beyond its buffer; [`Error::Missing`] where the buffer's file is not there.
    pub fn view(&self, index: Index<View>, user: &str) -> Result<Slice<'_>> {
        let document = self.document;
        let view = document.item(&document.root.buffer_views, "bufferViews", index, user)?;
        let part = format!("bufferViews[{}]", index.value());
        let bytes = match document.at(&self.buffers, "buffers", view.buffer.value(), &part)? {
            Buffer::Bytes(bytes) => bytes,
            Buffer::Absent(file) => {
                let (scene, files) = (document.path().to_owned(), vec![(file.clone(), document.place(part))]);
                return Err(Error::Missing { scene, files });
            }
            Buffer::Nothing => return Err(document.malformed(part, "its buffer has neither a uri nor a binary chunk")),
        };
        let (start, length) = (view.byte_offset.map_or(0, |offset| offset.0), view.byte_length.0);
        let range =
            usize::try_from(start).ok().zip(start.checked_add(length).and_then(|end| usize::try_from(end).ok()));
        let found = range.and_then(|(start, end)| bytes.get(start..end));
        let found = found.ok_or_else(|| {
            let message = format!("{length} bytes from {start} on, but its buffer has {}", bytes.len());
            document.malformed(part, message)
        })?;
        Ok(Slice { bytes: found, stride: view.byte_stride.as_ref().map(|stride| stride.0) })
    }
}
