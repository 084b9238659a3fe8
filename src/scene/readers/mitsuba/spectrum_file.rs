//! Spectra in files: one wavelength in nm and its value in each line.

use std::path::Path;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};

use super::super::path;
use super::element::Element;

/// Longest file of a spectrum.
const LARGEST: u64 = 1 << 20;

/// Puts the values of the file that a `<spectrum>` of the scene in `root` names into its `value`; one that names none is left as it is.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] with file and line.
pub fn write_out(element: &mut Element, root: &Path) -> Result<()> {
    let inside = |child: &Element| child.tag == "string" && child.attribute("name") == Some("filename");
    let named = element.children.iter().find(|child| inside(child)).unwrap_or(element);
    let given = named.attribute("filename").or(named.attribute("value").filter(|_| inside(named)));
    let Some(name) = given else { return Ok(()) };
    let path = path::resolve(root, name, &element.place)?;
    let pairs = pairs(&read_bytes(&path, LARGEST)?, &path)?;
    element.attributes.retain(|(name, _)| !matches!(name.as_str(), "filename" | "type"));
    element.children.clear();
    element.set("value", pairs);
    Ok(())
}

/// `wavelength:value` pairs of the lines; `#` begins a comment.
fn pairs(bytes: &[u8], path: &Path) -> Result<String> {
    let text = String::from_utf8_lossy(bytes);
    let mut out = String::with_capacity(text.len());
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.split('#').next().unwrap_or_default();
        let mut words =
            line.split(|c: char| c.is_whitespace() || matches!(c, ',' | ';' | ':')).filter(|w| !w.is_empty());
        match (words.next(), words.next()) {
            (None, _) => {}
            (Some(wavelength), Some(value)) => {
                out.push_str(wavelength);
                out.push(':');
                out.push_str(value);
                out.push(' ');
            }
            (Some(_), None) => {
                return Err(Error::malformed(Place::line(path, number), "expected a wavelength and a value"));
            }
        }
    }
    Ok(out)
}
