//! Elements of an XML document, each with its line, and the numbers in their attributes.

use crate::base::{Error, Place, Result};

/// An XML element.
#[derive(Debug, Clone)]
pub struct Element {
    /// Its name.
    pub tag: String,
    /// Attributes in their order, `$names` replaced.
    pub attributes: Vec<(String, String)>,
    /// Elements inside it.
    pub children: Vec<Element>,
    /// File and line where it begins.
    pub place: Place,
    /// Whether it is in the dialect of Mitsuba 3 already: an included file is upgraded by its own version.
    pub upgraded: bool,
}

impl Element {
    /// The value of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(other, _)| other == name).map(|(_, value)| value.as_str())
    }

    /// Gives an attribute a value.
    pub fn set(&mut self, name: &str, value: String) {
        match self.attributes.iter_mut().find(|(other, _)| other == name) {
            Some(attribute) => attribute.1 = value,
            None => self.attributes.push((name.to_owned(), value)),
        }
    }

    /// An element without attributes that stands at the same place.
    pub fn like(&self, tag: &str) -> Self {
        Self {
            tag: tag.to_owned(),
            attributes: Vec::new(),
            children: Vec::new(),
            place: self.place.clone(),
            upgraded: false,
        }
    }

    /// The value of an attribute that must be there.
    pub fn required(&self, name: &str) -> Result<&str> {
        self.attribute(name).ok_or_else(|| self.malformed(format!("<{}> lacks the attribute \"{name}\"", self.tag)))
    }

    /// Refuses attributes that are not listed.
    pub fn only_attributes(&self, known: &[&str]) -> Result<()> {
        match self.attributes.iter().find(|(name, _)| !known.contains(&name.as_str())) {
            Some((name, _)) => Err(self.unsupported(format!("attribute \"{name}\" of <{}>", self.tag), known)),
            None => Ok(()),
        }
    }

    /// Refuses elements inside.
    pub fn no_children(&self) -> Result<()> {
        match self.children.first() {
            Some(child) => Err(child.unsupported(format!("<{}> inside <{}>", child.tag, self.tag), &["none"])),
            None => Ok(()),
        }
    }

    /// An error at this element.
    pub fn malformed(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), message)
    }

    /// An error at this element that lists what is supported instead.
    pub fn unsupported(&self, what: impl Into<String>, supported: &[&str]) -> Error {
        Error::Unsupported { place: self.place.clone(), what: what.into(), supported: supported.join(", ") }
    }
}

/// One finite number.
pub fn number(element: &Element, text: &str) -> Result<f64> {
    match text.trim().parse::<f64>() {
        // A number that overflows single precision counts as infinite.
        Ok(value) if (value as f32).is_finite() => Ok(value),
        Ok(_) => Err(element.malformed(format!("\"{text}\" is not a finite number"))),
        Err(_) => Err(element.malformed(format!("\"{text}\" is not a number"))),
    }
}

/// Numbers separated by spaces or commas.
pub fn numbers(element: &Element, text: &str) -> Result<Vec<f64>> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    words.map(|word| number(element, word)).collect()
}

/// `x`, `y`, `z`, each `default` if absent; or `value` with one or three numbers.
pub fn xyz(element: &Element, default: f64) -> Result<[f64; 3]> {
    if let Some(text) = element.attribute("value") {
        if ["x", "y", "z"].iter().any(|axis| element.attribute(axis).is_some()) {
            return Err(element.malformed("\"value\" together with \"x\", \"y\" or \"z\""));
        }
        return match numbers(element, text)?.as_slice() {
            [all] => Ok([*all; 3]),
            [x, y, z] => Ok([*x, *y, *z]),
            other => Err(element.malformed(format!("expected one or three numbers, found {}", other.len()))),
        };
    }
    let axis = |name| element.attribute(name).map_or(Ok(default), |text| number(element, text));
    Ok([axis("x")?, axis("y")?, axis("z")?])
}
