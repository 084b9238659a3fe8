//! The XML document as a tree of our own, with includes spliced in and `$names` replaced.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};

use super::super::definitions::Definition;
use super::super::path;
use super::super::slips::meant;
use super::element::Element;
use super::spectrum_file;
use super::upgrade;

/// Longest XML file.
const LARGEST_FILE: u64 = 64 << 20;
/// Deepest nesting of elements, and of includes.
const DEEPEST: usize = 32;
/// Bytes of all files of a scene together, and of all replaced attributes: a small file must not grow without bound.
const BUDGET: u64 = 256 << 20;

/// Reads the scene document at `path` with its includes, upgraded to the dialect of Mitsuba 3, and the warnings of the upgrade.
/// Names stand for what `definitions` say, whatever the document's defaults are.
pub fn read(path: &Path, definitions: &[Definition]) -> Result<(Element, Vec<String>)> {
    let root = path.parent().unwrap_or(Path::new(""));
    let given = definitions.iter().map(|definition| (definition.name.clone(), definition.value.clone()));
    let mut source = Source {
        root,
        // The last says what holds, as of any option.
        defaults: given.collect(),
        names: BTreeSet::new(),
        open: Vec::new(),
        budget: BUDGET,
        warnings: Vec::new(),
    };
    let scene = source.file(path)?;
    match definitions.iter().find(|definition| !source.names.contains(&definition.name)) {
        Some(unknown) => Err(Error::malformed(Place::file(path), source.no_name(&unknown.name))),
        None => Ok((scene, source.warnings)),
    }
}

struct Source<'a> {
    /// The scene's folder, which includes may not leave.
    root: &'a Path,
    /// Values of `$names`; the first definition stands.
    defaults: BTreeMap<String, String>,
    /// Names that the document uses or has defaults for.
    names: BTreeSet<String>,
    /// The files that are being read, outermost first.
    open: Vec<PathBuf>,
    budget: u64,
    warnings: Vec<String>,
}

impl Source<'_> {
    fn file(&mut self, path: &Path) -> Result<Element> {
        let bytes = read_bytes(path, LARGEST_FILE)?;
        self.spend(bytes.len() as u64, &Place::file(path))?;
        let text = self.text(bytes, path)?;
        let document = roxmltree::Document::parse(&text)
            .map_err(|error| Error::malformed(Place::line(path, error.pos().row), format!("not sound XML: {error}")))?;
        self.open.push(path.to_owned());
        let lines = Lines::new(path, &text);
        let root = self.element(document.root_element(), &lines, 0)?;
        let mut root = root.ok_or_else(|| Error::malformed(Place::file(path), "nothing says what its names are"))?;
        self.open.pop();
        if root.tag != "scene" {
            return Err(root.unsupported(format!("<{}> as the outermost element", root.tag), &["scene"]));
        }
        upgrade::document(&mut root, &mut self.warnings)?;
        root.children.iter_mut().for_each(|child| child.upgraded = true);
        Ok(root)
    }

    /// The text of a document; one that says it is in Latin-1 is taken so where it is not UTF-8.
    fn text(&mut self, bytes: Vec<u8>, path: &Path) -> Result<String> {
        let error = match String::from_utf8(bytes) {
            Ok(text) => return Ok(text),
            Err(error) => error,
        };
        let declaration: String =
            error.as_bytes().iter().take(128).map(|byte| char::from(*byte).to_ascii_lowercase()).collect();
        if !declaration.starts_with("<?xml") || !(declaration.contains("8859-1") || declaration.contains("latin")) {
            let place = Place::byte(path, error.utf8_error().valid_up_to() as u64);
            return Err(Error::malformed(place, "not UTF-8 text"));
        }
        self.warnings.push(format!("{}: read as Latin-1 text", Place::file(path)));
        Ok(error.as_bytes().iter().map(|byte| char::from(*byte)).collect())
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

    /// An element with all that is in it; none for a setting whose name nothing says.
    fn element(&mut self, node: roxmltree::Node, lines: &Lines, depth: usize) -> Result<Option<Element>> {
        let place = lines.place(node.range().start);
        if depth > DEEPEST {
            return Err(Error::malformed(place, format!("elements are nested more than {DEEPEST} deep")));
        }
        let mut element = Element {
            tag: node.tag_name().name().to_ascii_lowercase(),
            attributes: Vec::new(),
            children: Vec::new(),
            place,
            upgraded: false,
        };
        for attribute in node.attributes() {
            let name = attribute.name().to_ascii_lowercase();
            let mut value = match self.replace(attribute.value(), &element.place) {
                Err(error @ Error::Malformed { .. }) if is_setting(node) => {
                    self.warnings.push(format!("{error}; the default is used"));
                    return Ok(None);
                }
                other => other?,
            };
            // The kinds of objects; other attributes have values of their own.
            if name == "type" {
                value.make_ascii_lowercase();
            }
            element.attributes.push((name, value));
        }
        for child in node.children() {
            if child.is_text() && !child.text().unwrap_or_default().trim().is_empty() {
                let place = lines.place(child.range().start);
                return Err(Error::malformed(place, "text between elements; values belong into attributes"));
            }
            if !child.is_element() {
                continue;
            }
            let Some(inner) = self.element(child, lines, depth + 1)? else { continue };
            match (inner.tag.as_str(), depth) {
                // Inside any object, as in Mitsuba: it holds from there on to the end of the scene.
                ("default", _) if !is_value(&element) => self.default(&inner)?,
                ("include", 0) => element.children.extend(self.include(&inner)?),
                _ => element.children.push(inner),
            }
        }
        // A spectrum with a texture's type is one, whose kinds are those of textures.
        if element.tag == "spectrum" && element.attribute("type").is_some_and(|kind| kind == "bitmap") {
            element.tag = "texture".to_owned();
        }
        if element.tag == "spectrum" {
            let root = self.root;
            spectrum_file::write_out(&mut element, root)?;
            self.spend(element.attribute("value").map_or(0, str::len) as u64, &element.place)?;
        }
        Ok(Some(element))
    }

    fn default(&mut self, element: &Element) -> Result<()> {
        element.only_attributes(&["name", "value"])?;
        element.no_children()?;
        let (name, value) = (element.required("name")?, element.required("value")?);
        if name.is_empty() {
            return Err(element.malformed("a default needs a name"));
        }
        self.names.insert(name.to_owned());
        self.defaults.entry(name.to_owned()).or_insert_with(|| value.to_owned());
        Ok(())
    }

    /// Message about a definition of a name that the document does not know.
    fn no_name(&self, name: &str) -> String {
        let known: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let near = meant(name, &known).map(|near| format!("; \"{near}\" seems to be meant")).unwrap_or_default();
        match known[..] {
            [] => format!("-D {name}: the scene has no names to define"),
            _ => format!("-D {name}: the scene has no such name{near}; there is {}", known.join(", ")),
        }
    }

    /// The children of the included scene.
    fn include(&mut self, element: &Element) -> Result<Vec<Element>> {
        element.only_attributes(&["filename"])?;
        element.no_children()?;
        let file = element.required("filename")?;
        let path = match path::resolve(self.root, file, &element.place) {
            Err(error @ Error::Malformed { .. }) => {
                self.warnings.push(format!("{error}: the include is left out"));
                return Ok(self.integrator_of(file, element));
            }
            other => other?,
        };
        let same = |other: &PathBuf| other.canonicalize().ok() == path.canonicalize().ok();
        if self.open.iter().any(same) {
            return Err(element.malformed(format!("{} includes itself", path.display())));
        }
        if self.open.len() > DEEPEST {
            return Err(element.malformed(format!("includes are nested more than {DEEPEST} deep")));
        }
        Ok(self.file(&path)?.children)
    }

    /// What stands in for an include that is left out: many scenes share the settings of integrators, which lie beside their folders and
    /// take the depth from a name.
    fn integrator_of(&self, file: &str, element: &Element) -> Vec<Element> {
        let depth = ["maxDepth", "max_depth", "depth"].into_iter().find_map(|name| self.defaults.get(name));
        let Some(depth) = depth.filter(|_| file.to_ascii_lowercase().contains("integrator")) else { return Vec::new() };
        let (mut integrator, mut limit) = (element.like("integrator"), element.like("integer"));
        integrator.set("type", "path".to_owned());
        limit.set("name", "max_depth".to_owned());
        limit.set("value", depth.clone());
        integrator.children.push(limit);
        vec![integrator]
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
                    format!("nothing says what ${name} is; expected a <default> before, or -D {name}=VALUE"),
                ));
            };
            self.names.insert(name.clone());
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

/// Whether an element is a number, word or truth that says how to render, whose default serves as well.
fn is_setting(node: roxmltree::Node) -> bool {
    let is =
        |node: roxmltree::Node, tags: &[&str]| tags.iter().any(|tag| node.tag_name().name().eq_ignore_ascii_case(tag));
    is(node, &["integer", "float", "boolean", "string"])
        && node.parent().is_some_and(|parent| is(parent, &["sampler", "film", "integrator", "rfilter"]))
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
