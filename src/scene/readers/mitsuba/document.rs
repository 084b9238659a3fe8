//! The XML document as a tree of our own, with includes spliced in and `$names` replaced.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};

use super::super::path;
use super::element::Element;
use super::upgrade;

/// Longest XML file.
const LARGEST_FILE: u64 = 64 << 20;
/// Deepest nesting of elements, and of includes.
const DEEPEST: usize = 32;
/// Bytes of all files of a scene together, and of all replaced attributes: a small file must not grow without bound.
const BUDGET: u64 = 256 << 20;

/// Reads the scene document at `path` with its includes, upgraded to the dialect of Mitsuba 3, and the warnings of the upgrade.
pub fn read(path: &Path) -> Result<(Element, Vec<String>)> {
    let root = path.parent().unwrap_or(Path::new(""));
    let mut source = Source { root, defaults: BTreeMap::new(), open: Vec::new(), budget: BUDGET, warnings: Vec::new() };
    let scene = source.file(path)?;
    Ok((scene, source.warnings))
}

struct Source<'a> {
    /// The scene's folder, which includes may not leave.
    root: &'a Path,
    /// Values of `$names`; the first definition stands.
    defaults: BTreeMap<String, String>,
    /// The files that are being read, outermost first.
    open: Vec<PathBuf>,
    budget: u64,
    warnings: Vec<String>,
}

impl Source<'_> {
    fn file(&mut self, path: &Path) -> Result<Element> {
        let bytes = read_bytes(path, LARGEST_FILE)?;
        self.spend(bytes.len() as u64, &Place::file(path))?;
        let text = std::str::from_utf8(&bytes)
            .map_err(|error| Error::malformed(Place::byte(path, error.valid_up_to() as u64), "not UTF-8 text"))?;
        let document = roxmltree::Document::parse(text)
            .map_err(|error| Error::malformed(Place::line(path, error.pos().row), format!("not sound XML: {error}")))?;
        self.open.push(path.to_owned());
        let lines = Lines::new(path, text);
        let mut root = self.element(document.root_element(), &lines, 0)?;
        self.open.pop();
        if root.tag != "scene" {
            return Err(root.unsupported(format!("<{}> as the outermost element", root.tag), &["scene"]));
        }
        upgrade::document(&mut root, &mut self.warnings)?;
        root.children.iter_mut().for_each(|child| child.upgraded = true);
        Ok(root)
    }

    fn spend(&mut self, bytes: u64, place: &Place) -> Result<()> {
        let left = self.budget.checked_sub(bytes);
        self.budget = left.ok_or_else(|| Error::Limit {
            place: place.clone(),
            what: "size of the scene with its includes and replaced names, in bytes".into(),
            value: BUDGET - self.budget + bytes,
            limit: BUDGET,
        })?;
        Ok(())
    }

    fn element(&mut self, node: roxmltree::Node, lines: &Lines, depth: usize) -> Result<Element> {
        let place = lines.place(node.range().start);
        if depth > DEEPEST {
            return Err(Error::malformed(place, format!("elements are nested more than {DEEPEST} deep")));
        }
        let mut element = Element {
            tag: node.tag_name().name().to_owned(),
            attributes: Vec::new(),
            children: Vec::new(),
            place,
            upgraded: false,
        };
        for attribute in node.attributes() {
            let value = self.replace(attribute.value(), &element.place)?;
            element.attributes.push((attribute.name().to_owned(), value));
        }
        for child in node.children() {
            if child.is_text() && !child.text().unwrap_or_default().trim().is_empty() {
                let place = lines.place(child.range().start);
                return Err(Error::malformed(place, "text between elements; values belong into attributes"));
            }
            if !child.is_element() {
                continue;
            }
            let inner = self.element(child, lines, depth + 1)?;
            match (inner.tag.as_str(), depth) {
                // Inside any object, as in Mitsuba: it holds from there on to the end of the scene.
                ("default", _) if !is_value(&element) => self.default(&inner)?,
                ("include", 0) => element.children.extend(self.include(&inner)?),
                _ => element.children.push(inner),
            }
        }
        Ok(element)
    }

    fn default(&mut self, element: &Element) -> Result<()> {
        element.only_attributes(&["name", "value"])?;
        element.no_children()?;
        let (name, value) = (element.required("name")?, element.required("value")?);
        if name.is_empty() {
            return Err(element.malformed("a default needs a name"));
        }
        self.defaults.entry(name.to_owned()).or_insert_with(|| value.to_owned());
        Ok(())
    }

    /// The children of the included scene.
    fn include(&mut self, element: &Element) -> Result<Vec<Element>> {
        element.only_attributes(&["filename"])?;
        element.no_children()?;
        let path = path::resolve(self.root, element.required("filename")?, &element.place)?;
        let same = |other: &PathBuf| other.canonicalize().ok() == path.canonicalize().ok();
        if self.open.iter().any(same) {
            return Err(element.malformed(format!("{} includes itself", path.display())));
        }
        if self.open.len() > DEEPEST {
            return Err(element.malformed(format!("includes are nested more than {DEEPEST} deep")));
        }
        Ok(self.file(&path)?.children)
    }

    /// Replaces `$name`; where several names fit, the longest. `\$` stands for the sign itself.
    fn replace(&mut self, value: &str, place: &Place) -> Result<String> {
        let mut out = String::new();
        let mut rest = value;
        while let Some(at) = rest.find('$') {
            let (before, after) = (&rest[..at], &rest[at + 1..]);
            if let Some(before) = before.strip_suffix('\\') {
                out.push_str(before);
                out.push('$');
                rest = after;
                continue;
            }
            let fits = self.defaults.iter().filter(|(name, _)| after.starts_with(name.as_str()));
            let Some((name, replacement)) = fits.max_by_key(|(name, _)| name.len()) else {
                let name: String = after.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                return Err(Error::malformed(
                    place.clone(),
                    format!("nothing says what ${name} is; expected a <default> before"),
                ));
            };
            out.push_str(before);
            out.push_str(replacement);
            rest = &after[name.len()..];
            let grown = out.len() as u64;
            self.spend(grown, place)?;
        }
        out.push_str(rest);
        Ok(out)
    }
}

/// Maps byte offsets to lines, without counting from the start each time.
struct Lines<'a> {
    path: &'a Path,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn new(path: &'a Path, text: &str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        Self { path, starts: ends.map(|(at, _)| at + 1).collect() }
    }

    fn place(&self, offset: usize) -> Place {
        let line = 1 + self.starts.partition_point(|start| *start <= offset);
        Place::line(self.path, u32::try_from(line).unwrap_or(u32::MAX))
    }
}

/// Whether an element, in any dialect, is a property and no object: only its own parts can stand inside.
fn is_value(element: &Element) -> bool {
    const VALUES: [&str; 12] = [
        "float",
        "integer",
        "boolean",
        "string",
        "rgb",
        "srgb",
        "spectrum",
        "blackbody",
        "point",
        "vector",
        "transform",
        "ref",
    ];
    VALUES.contains(&element.tag.as_str()) && (element.tag != "spectrum" || element.attribute("type").is_none())
}
