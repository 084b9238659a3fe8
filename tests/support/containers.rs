//! What lies inside of files with lengths and checksums, and files around what was damaged inside, so that damage gets past the gate.

use std::collections::BTreeMap;
use std::io::{Read, Write};

use flate2::Crc;

use crate::gltf::binary;

/// How a format packs its content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// Not at all.
    Plain,
    /// A header of JSON and data, with a checksum over the data in the header.
    Tensors,
    /// Chunks with checksums, pixels deflated.
    Png,
    /// Deflated meshes with a table of their places.
    Serialized,
    /// JSON and a buffer, each after its length.
    Glb,
}

impl Container {
    /// The parts inside a good file; none where it cannot be taken apart.
    pub fn open(self, bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
        match self {
            Self::Plain => None,
            Self::Tensors => {
                let length = usize::try_from(u64::from_le_bytes(*bytes.first_chunk()?)).ok()?;
                let header = bytes.get(8..length.checked_add(8)?)?;
                Some(vec![header.to_vec(), bytes[8 + length..].to_vec()])
            }
            Self::Png => open_png(bytes),
            Self::Serialized => open_serialized(bytes),
            Self::Glb => open_glb(bytes),
        }
    }

    /// A file with these parts, whose lengths and checksums are right.
    pub fn close(self, parts: &[Vec<u8>]) -> Vec<u8> {
        match self {
            Self::Plain => parts.concat(),
            Self::Tensors => close_tensors(&parts[0], &parts[1]),
            Self::Png => close_png(parts),
            Self::Serialized => close_serialized(parts),
            Self::Glb => binary(&parts[0], &parts[1]),
        }
    }
}

/// The checksum goes where the header has one, over the tensors that it describes in the order of their names.
fn close_tensors(header: &[u8], data: &[u8]) -> Vec<u8> {
    let mut header = String::from_utf8_lossy(header).into_owned();
    let tensors: BTreeMap<String, serde_json::Value> = serde_json::from_str(&header).unwrap_or_default();
    let mut crc = Crc::new();
    for tensor in tensors.values() {
        let offset = |i: usize| tensor["data_offsets"][i].as_u64().unwrap_or(0) as usize;
        crc.update(data.get(offset(0)..offset(1)).unwrap_or_default());
    }
    const KEY: &str = "\"crc32\":\"";
    if let Some(start) = header.find(KEY).map(|at| at + KEY.len())
        && let Some(length) = header[start..].find('"')
    {
        header.replace_range(start..start + length, &crc.sum().to_string());
    }
    while !header.len().is_multiple_of(8) {
        header.push(' ');
    }
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

const PNG_MAGIC: &[u8] = &[0x89, b'P', b'N', b'G', 0x0D, 0x0A, 0x1A, 0x0A];

/// Each chunk without length and checksum; that of the pixels inflated.
fn open_png(bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
    let mut rest = bytes.strip_prefix(PNG_MAGIC)?;
    let mut parts = vec![];
    while !rest.is_empty() {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        let mut part = rest.get(4..8 + length)?.to_vec();
        if part.starts_with(b"IDAT") {
            let mut pixels = vec![];
            flate2::read::ZlibDecoder::new(&part[4..]).read_to_end(&mut pixels).ok()?;
            part.splice(4.., pixels);
        }
        parts.push(part);
        rest = rest.get(12 + length..)?;
    }
    Some(parts)
}

fn close_png(parts: &[Vec<u8>]) -> Vec<u8> {
    let mut out = PNG_MAGIC.to_vec();
    for part in parts {
        let mut part = part.clone();
        part.resize(part.len().max(4), b'A');
        if part.starts_with(b"IDAT") {
            let pixels = deflated(&part[4..]);
            part.splice(4.., pixels);
        }
        out.extend((part.len() as u32 - 4).to_be_bytes());
        let mut crc = Crc::new();
        crc.update(&part);
        out.extend(part);
        out.extend(crc.sum().to_be_bytes());
    }
    out
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(vec![], flate2::Compression::fast());
    encoder.write_all(bytes).expect("memory takes everything");
    encoder.finish().expect("memory takes everything")
}

/// Each mesh, inflated.
fn open_serialized(bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
    let count = u32::from_le_bytes(*bytes.last_chunk()?) as usize;
    let table = bytes.len().checked_sub(4 + 8 * count)?;
    let starts = bytes[table..bytes.len() - 4].as_chunks::<8>().0.iter().map(|&b| u64::from_le_bytes(b) as usize);
    starts
        .map(|start| {
            let mut mesh = vec![];
            flate2::read::ZlibDecoder::new(bytes.get(start + 4..table)?).read_to_end(&mut mesh).ok()?;
            Some(mesh)
        })
        .collect()
}

fn close_serialized(parts: &[Vec<u8>]) -> Vec<u8> {
    let (mut out, mut starts) = (vec![], vec![]);
    for part in parts {
        starts.push(out.len() as u64);
        out.extend([0x1C, 0x04, 0x04, 0x00]);
        out.extend(deflated(part));
    }
    starts.iter().for_each(|start| out.extend(start.to_le_bytes()));
    out.extend((parts.len() as u32).to_le_bytes());
    out
}

/// The two chunks.
fn open_glb(bytes: &[u8]) -> Option<Vec<Vec<u8>>> {
    let mut rest = bytes.strip_prefix(b"glTF")?.get(8..)?;
    let mut parts = vec![];
    while !rest.is_empty() {
        let length = u32::from_le_bytes(*rest.first_chunk()?) as usize;
        parts.push(rest.get(8..length.checked_add(8)?)?.to_vec());
        rest = &rest[8 + length..];
    }
    (parts.len() == 2).then_some(parts)
}
