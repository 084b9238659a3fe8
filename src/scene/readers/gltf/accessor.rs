//! Accessors (specification, §3.6.2): columns of numbers in buffers, with sparse replacements. Elements are read one by one where they
//! are used, so that no count makes anything grow that is not in the file.

use ::gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, IndexComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, accessor::sparse::Sparse};

use crate::base::{Error, Result};

use super::buffers::Buffers;
use super::document::Document;

/// Most elements of a column without bytes where each element makes something.
const MOST_ZEROS: usize = 1 << 16;

/// A column of elements of one to sixteen numbers each.
#[derive(Debug)]
pub struct Column<'a> {
    /// Number of elements.
    pub count: usize,
    component: ComponentType,
    components: usize,
    normalized: bool,
    /// The bytes from the first element on; none where all elements are zero.
    bytes: Option<&'a [u8]>,
    stride: usize,
    /// Elements that others replace, in ascending order, and the bytes of those.
    replaced: Vec<u32>,
    replacements: &'a [u8],
}

fn size(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// One number, `normalized` to [-1, 1] or [0, 1] if it is an integer (specification, §3.11).
fn number(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let one = |most: f32| if normalized { most } else { 1.0 };
    match (component, bytes) {
        (ComponentType::I8, &[byte, ..]) => {
            (f32::from(byte as i8) / one(127.0)).max(if normalized { -1.0 } else { -128.0 })
        }
        (ComponentType::U8, &[byte, ..]) => f32::from(byte) / one(255.0),
        (ComponentType::I16, &[a, b, ..]) => {
            let least = if normalized { -1.0 } else { -32768.0 };
            (f32::from(i16::from_le_bytes([a, b])) / one(32767.0)).max(least)
        }
        (ComponentType::U16, &[a, b, ..]) => f32::from(u16::from_le_bytes([a, b])) / one(65535.0),
        (ComponentType::U32, &[a, b, c, d, ..]) => u32::from_le_bytes([a, b, c, d]) as f32,
        (ComponentType::F32, &[a, b, c, d, ..]) => f32::from_le_bytes([a, b, c, d]),
        _ => 0.0,
    }
}

/// One index.
fn whole(component: ComponentType, bytes: &[u8]) -> u32 {
    match (component, bytes) {
        (ComponentType::U8, &[byte, ..]) => u32::from(byte),
        (ComponentType::U16, &[a, b, ..]) => u32::from(u16::from_le_bytes([a, b])),
        (ComponentType::U32, &[a, b, c, d, ..]) => u32::from_le_bytes([a, b, c, d]),
        _ => 0,
    }
}

impl<'a> Column<'a> {
    /// The accessor that `user` names, whose elements must be of one of the `kinds`.
    ///
    /// # Errors
    /// [`Error::Malformed`] for elements of another kind and for ranges beyond their views; those of [`Buffers::view`].
    pub fn new(
        document: &Document,
        buffers: &'a Buffers<'_>,
        index: Index<Accessor>,
        user: &str,
        kinds: &[Type],
    ) -> Result<Self> {
        let accessor = document.item(&document.root.accessors, "accessors", index, user)?;
        let part = format!("accessors[{}]", index.value());
        let (Checked::Valid(kind), Checked::Valid(GenericComponentType(component))) =
            (accessor.type_, accessor.component_type)
        else {
            return Err(document.malformed(part, "its type or componentType is not one of glTF"));
        };
        if !kinds.contains(&kind) {
            return Err(document.malformed(user, format!("{part} has the type {kind:?}, expected {kinds:?}")));
        }
        let components = kind.multiplicity();
        let element = components * size(component);
        let (bytes, stride) = match accessor.buffer_view {
            None => (None, element),
            Some(view) => {
                let slice = buffers.view(view, &part)?;
                let stride = slice.stride.unwrap_or(element);
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                (Some(fitting(document, &part, slice.bytes, [offset, accessor.count.0], stride, element)?), stride)
            }
        };
        let beyond = |_| document.malformed(&part, format!("{} elements", accessor.count.0));
        let count = usize::try_from(accessor.count.0).map_err(beyond)?;
        let normalized = accessor.normalized;
        let mut column =
            Self { count, component, components, normalized, bytes, stride, replaced: Vec::new(), replacements: &[] };
        if let Some(sparse) = &accessor.sparse {
            column.replace(document, buffers, &part, sparse)?;
        }
        Ok(column)
    }

    fn replace(&mut self, document: &Document, buffers: &'a Buffers<'_>, part: &str, sparse: &Sparse) -> Result<()> {
        let part = format!("{part}.sparse");
        let Checked::Valid(IndexComponentType(component)) = sparse.indices.component_type else {
            return Err(document.malformed(part, "the componentType of its indices is not one of glTF"));
        };
        let step = size(component);
        let indices = buffers.view(sparse.indices.buffer_view, &part)?.bytes;
        let indices = fitting(document, &part, indices, [sparse.indices.byte_offset.0, sparse.count.0], step, step)?;
        let element = self.components * size(self.component);
        let values = buffers.view(sparse.values.buffer_view, &part)?.bytes;
        let values = fitting(document, &part, values, [sparse.values.byte_offset.0, sparse.count.0], element, element)?;
        self.replaced = indices.chunks_exact(step).take(sparse.count.0 as usize).map(|b| whole(component, b)).collect();
        self.replacements = values;
        if !self.replaced.is_sorted_by(|a, b| a < b) || self.replaced.last().is_some_and(|&i| i as usize >= self.count)
        {
            return Err(document.malformed(part, "its indices are not ascending, or go beyond the accessor"));
        }
        Ok(())
    }

    /// The bytes of element `index`; none where it is zero.
    fn element(&self, index: usize) -> Option<&'a [u8]> {
        let length = self.components * size(self.component);
        if let Some(at) = u32::try_from(index).ok().and_then(|index| self.replaced.binary_search(&index).ok()) {
            return self.replacements.get(at * length..(at + 1) * length);
        }
        let start = index * self.stride;
        self.bytes?.get(start..start + length)
    }

    /// The first `N` numbers of element `index`; what the element does not have is 0.
    pub fn get<const N: usize>(&self, index: usize) -> [f32; N] {
        let mut out = [0.0; N];
        if let Some(bytes) = self.element(index) {
            let numbers = bytes.chunks_exact(size(self.component));
            out.iter_mut().zip(numbers).for_each(|(out, bytes)| *out = number(self.component, self.normalized, bytes));
        }
        out
    }

    /// Element `index` as up to four indices.
    pub fn indices(&self, index: usize) -> [u32; 4] {
        let mut out = [0; 4];
        if let Some(bytes) = self.element(index) {
            let numbers = bytes.chunks_exact(size(self.component));
            out.iter_mut().zip(numbers).for_each(|(out, bytes)| *out = whole(self.component, bytes));
        }
        out
    }

    /// Refuses a column without bytes, all of whose elements are zero, that is too long to be made of nothing.
    ///
    /// # Errors
    /// [`Error::Limit`] at `user`.
    pub fn check_bytes(&self, document: &Document, user: &str) -> Result<()> {
        if self.bytes.is_some() || self.count <= MOST_ZEROS {
            return Ok(());
        }
        let (place, what) = (document.place(user), "number of elements without bytes".to_owned());
        Err(Error::Limit { place, what, value: self.count as u64, limit: MOST_ZEROS as u64 })
    }

    /// Number of numbers of an element.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Whether its numbers are unsigned integers.
    pub fn is_unsigned(&self) -> bool {
        matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
    }
}

/// `bytes` from the offset on, checked to hold as many elements of `element` bytes, one each `stride`.
fn fitting<'a>(
    document: &Document,
    part: &str,
    bytes: &'a [u8],
    [offset, count]: [u64; 2],
    stride: usize,
    element: usize,
) -> Result<&'a [u8]> {
    if stride < element {
        return Err(document.malformed(part, format!("elements of {element} bytes every {stride} bytes")));
    }
    let length = if count == 0 {
        Some(0)
    } else {
        (count - 1).checked_mul(stride as u64).and_then(|length| length.checked_add(element as u64))
    };
    let end = length.and_then(|length| offset.checked_add(length)).filter(|&end| end <= bytes.len() as u64);
    match (usize::try_from(offset), end) {
        (Ok(start), Some(_)) if start <= bytes.len() => Ok(&bytes[start..]),
        _ => {
            let message =
                format!("{count} elements from byte {offset} on do not fit into a view of {} bytes", bytes.len());
            Err(document.malformed(part, message))
        }
    }
}
