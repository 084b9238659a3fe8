//! The document of a glTF scene: JSON, alone in a `.gltf` file or as the first chunk of a binary one (glTF 2.0 specification, §4).
//!
//! Nothing in it is validated when it is parsed: every index is looked up by [`Document::item`], and every number is checked where it
//! is used.

use std::ops::Range;
use std::path::{Path, PathBuf};

use ::gltf::json::{Index, Root};
use serde::Deserialize;
use serde_json::Value;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::scene::readers::LARGEST_MESH_FILE;

use super::glb;

/// A parsed document with the chunk of binary data beside it.
#[derive(Debug)]
pub struct Document {
    path: PathBuf,
    /// The document.
    pub root: Root,
    /// Whether it has animations.
    pub moves: bool,
    bytes: Vec<u8>,
    chunk: Option<Range<usize>>,
}

impl Document {
    /// Reads the document at `path`, whose first bytes say whether it is binary.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`]; [`Error::Unsupported`] for another version of glTF.
    pub fn open(path: &Path) -> Result<Self> {
        let bytes = read_bytes(path, LARGEST_MESH_FILE)?;
        let (json, chunk) = match glb::chunks(path, &bytes)? {
            Some(chunks) => (chunks.json, chunks.binary),
            None => (0..bytes.len(), None),
        };
        let text = &bytes[json];
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
        // Chunks should be padded with spaces; some are with zeros.
        let padding = text.iter().rev().take_while(|&&byte| byte == 0).count();
        let text = &text[..text.len() - padding];
        check_version(path, text)?;
        let (root, moves) = match serde_json::from_slice::<Root>(text) {
            Ok(root) => {
                let moves = !root.animations.is_empty();
                (root, moves)
            }
            Err(error) => without_what_is_not_read(text).ok_or_else(|| explain(path, &error))?,
        };
        Ok(Self { path: path.to_owned(), root, moves, bytes, chunk })
    }

    /// The document's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder that file names are relative to.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Bytes of the document's file.
    pub fn size(&self) -> usize {
        self.bytes.len()
    }

    /// The binary chunk, if there is one.
    pub fn chunk(&self) -> Option<&[u8]> {
        self.chunk.clone().and_then(|range| self.bytes.get(range))
    }

    /// The place of a part such as `nodes[3].mesh`.
    pub fn place(&self, part: impl Into<String>) -> Place {
        Place::part(&self.path, part)
    }

    /// An error at a part.
    pub fn malformed(&self, part: impl Into<String>, message: impl Into<String>) -> Error {
        Error::malformed(self.place(part), message)
    }

    /// An error at a part for something that is not read.
    pub fn unsupported(&self, part: impl Into<String>, what: impl Into<String>, supported: impl Into<String>) -> Error {
        Error::Unsupported { place: self.place(part), what: what.into(), supported: supported.into() }
    }

    /// The item of the list called `name` that `user` names.
    ///
    /// # Errors
    /// [`Error::Malformed`] at `user` where the list is shorter.
    pub fn item<'a, T>(&self, list: &'a [T], name: &str, index: Index<T>, user: &str) -> Result<&'a T> {
        self.at(list, name, index.value(), user)
    }

    /// As [`Document::item`], by number.
    ///
    /// # Errors
    /// As [`Document::item`].
    pub fn at<'a, T>(&self, list: &'a [T], name: &str, index: usize, user: &str) -> Result<&'a T> {
        list.get(index).ok_or_else(|| {
            let message = format!("there is no {name}[{index}]: there are {} {name}", list.len());
            self.malformed(user, message)
        })
    }
}

#[derive(Deserialize)]
struct Versioned {
    asset: Asset,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    version: String,
    min_version: Option<String>,
}

/// A document that the library finds wrong, without the parts that are not read anyway, where exporters are careless: animations, extras,
/// members that are null. None where it is wrong elsewhere.
fn without_what_is_not_read(text: &[u8]) -> Option<(Root, bool)> {
    let mut document: Value = serde_json::from_slice(text).ok()?;
    let moves = document.get("animations").and_then(Value::as_array).is_some_and(|all| !all.is_empty());
    document.as_object_mut()?.remove("animations");
    tidy(&mut document);
    for scene in document.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
        scene.as_object_mut()?.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    Some((serde_json::from_value(document).ok()?, moves))
}

/// Removes extras and members that are null, at any depth: what is parsed is no deeper than the parser allows.
fn tidy(value: &mut Value) {
    match value {
        Value::Object(members) => {
            members.retain(|name, member| name != "extras" && !member.is_null());
            members.values_mut().for_each(tidy);
        }
        Value::Array(items) => items.iter_mut().for_each(tidy),
        _ => {}
    }
}

/// Checks the version first: another one may well have other keys.
fn check_version(path: &Path, text: &[u8]) -> Result<()> {
    let Versioned { asset } = serde_json::from_slice(text).map_err(|error| explain(path, &error))?;
    let needed = asset.min_version.as_ref().unwrap_or(&asset.version);
    let known = if asset.min_version.is_some() { needed == "2.0" } else { needed.split('.').next() == Some("2") };
    if known {
        return Ok(());
    }
    let (place, what) = (Place::part(path, "asset"), format!("version \"{needed}\" of glTF"));
    Err(Error::Unsupported { place, what, supported: "2.0".into() })
}

fn explain(path: &Path, error: &serde_json::Error) -> Error {
    let line = u32::try_from(error.line()).unwrap_or(u32::MAX);
    Error::malformed(Place::line(path, line), format!("not a readable glTF document: {error}"))
}
