//! An element that stands for an object, with its named properties and the objects inside it. Objects that are not expected are
//! refused, properties warned of.

use std::collections::BTreeMap;

use glam::DMat4;

use crate::base::Result;
use crate::scene::file::Matrix;
use crate::scene::readers::frames::rounded;
use crate::scene::readers::slips::{meant, same};
use crate::scene::readers::spectrum::Use;

use super::color;
use super::element::{Element, number, xyz};
use super::transform;
use super::unused::Unused;

const PROPERTY_TAGS: [&str; 11] =
    ["float", "integer", "boolean", "string", "rgb", "srgb", "spectrum", "blackbody", "point", "vector", "transform"];

/// Objects that may stand inside others which have no use for them here.
const OBJECT_TAGS: [&str; 14] = [
    "sensor",
    "subsurface",
    "film",
    "sampler",
    "rfilter",
    "phase",
    "volume",
    "integrator",
    "medium",
    "emitter",
    "bsdf",
    "texture",
    "shape",
    "field",
];

/// Elements by their id, and the unused properties that reading objects finds.
#[derive(Default)]
pub struct Ids<'a> {
    elements: BTreeMap<&'a str, &'a Element>,
    /// Properties that were not used.
    pub unused: Unused,
}

impl<'a> Ids<'a> {
    /// The element with this id.
    pub fn get(&self, id: &str) -> Option<&'a Element> {
        self.elements.get(id).copied()
    }

    /// Gives `element` an id; returns the element that had it before.
    pub fn insert(&mut self, id: &'a str, element: &'a Element) -> Option<&'a Element> {
        self.elements.insert(id, element)
    }
}

/// An object with its parts sorted out.
pub struct Object<'a> {
    /// The element itself.
    pub element: &'a Element,
    /// Objects inside it, references followed.
    pub nested: Vec<&'a Element>,
    properties: BTreeMap<String, &'a Element>,
}

/// The `type` of an object.
pub fn kind(element: &Element) -> Result<&str> {
    element.required("type")
}

/// Refuses an object whose type is one of `known` but for one letter or for what separates words: plugins of others often have
/// names that are like Mitsuba's.
pub fn refuse_slip_of_kind(element: &Element, known: &[&str]) -> Result<()> {
    let kind = kind(element)?;
    let near = |near: &&str| same(kind, &[*near]).is_some() || strsim::osa_distance(kind, near) <= 1;
    match meant(kind, known).filter(near) {
        Some(near) => {
            Err(element.malformed(format!("there is no {} \"{kind}\"; \"{near}\" seems to be meant", element.tag)))
        }
        None => Ok(()),
    }
}

impl<'a> Object<'a> {
    /// Sorts the children of `element`: `properties` are the names that it may have, `nested` the tags of objects. Textures may be
    /// either, and so may volumes. Names may have any case. Other properties and objects are noted as unused, but a property that is a
    /// slip of the pen is an error. Of an animation there is the beginning.
    pub fn new(element: &'a Element, ids: &Ids<'a>, properties: &[&str], nested: &[&str]) -> Result<Self> {
        element.only_attributes(&["type", "id", "name"])?;
        let mut object = Self { element, nested: Vec::new(), properties: BTreeMap::new() };
        for child in &element.children {
            let target = follow(child, ids)?;
            let tag = target.tag.as_str();
            let is_varied = matches!(tag, "texture" | "volume") && !nested.contains(&tag);
            if PROPERTY_TAGS.contains(&tag) || is_varied {
                // A reference has a name of its own, not that of its target.
                let name = child.required("name")?;
                if let Some(known) = same(name, properties) {
                    object.add_property(known, target)?;
                } else {
                    object.refuse_slip(name, child, properties)?;
                    ids.unused.note(child, format!("the property \"{name}\" of {} is not used", object.called()));
                }
            } else if nested.contains(&tag) {
                object.nested.push(target);
            } else if OBJECT_TAGS.contains(&tag) {
                ids.unused.note(child, format!("the <{tag}> inside {} is not used", object.called()));
            } else if tag == "animation" {
                ids.unused.note(child, format!("nothing moves: {} stands where its animation begins", object.called()));
                if let Some(first) = target.children.first().filter(|_| properties.contains(&"to_world")) {
                    object.add_property("to_world", first)?;
                }
            } else {
                let what = format!("<{}> inside <{}>", target.tag, element.tag);
                let known: Vec<&str> = nested.iter().copied().chain(["named properties"]).collect();
                return Err(child.unsupported(what, &known));
            }
        }
        Ok(object)
    }

    /// Takes every property and object as it is: for objects that are read only in part, by the properties `used`.
    pub fn lenient(element: &'a Element, ids: &Ids<'a>, used: &[&str]) -> Result<Self> {
        let mut object = Self { element, nested: Vec::new(), properties: BTreeMap::new() };
        for child in &element.children {
            let target = follow(child, ids)?;
            match child.attribute("name") {
                Some(name) if PROPERTY_TAGS.contains(&target.tag.as_str()) => {
                    let known = same(name, used);
                    if known.is_none() {
                        object.refuse_slip(name, child, used)?;
                    }
                    object.properties.insert(known.unwrap_or(name).to_owned(), target);
                }
                _ => object.nested.push(target),
            }
        }
        Ok(object)
    }

    fn add_property(&mut self, name: &str, value: &'a Element) -> Result<()> {
        match self.properties.insert(name.to_owned(), value) {
            Some(_) => Err(value.malformed(format!("property \"{name}\" is given twice"))),
            None => Ok(()),
        }
    }

    /// Refuses a property whose name is nearly one of `known`.
    fn refuse_slip(&self, name: &str, property: &Element, known: &[&str]) -> Result<()> {
        match meant(name, known) {
            Some(near) => Err(property
                .malformed(format!("{} has no property \"{name}\"; \"{near}\" seems to be meant", self.called()))),
            None => Ok(()),
        }
    }

    /// Description of the object in messages.
    fn called(&self) -> String {
        format!("the {} \"{}\"", self.element.tag, self.element.attribute("type").unwrap_or_default())
    }

    /// The only nested object with this tag, if any.
    pub fn single(&self, tag: &str) -> Result<Option<&'a Element>> {
        let mut found = self.nested.iter().copied().filter(|element| element.tag == tag);
        let first = found.next();
        match found.next() {
            Some(second) => Err(second.malformed(format!("a second <{tag}> inside <{}>", self.element.tag))),
            None => Ok(first),
        }
    }

    /// The element of a property.
    pub fn property(&self, name: &str) -> Option<&'a Element> {
        self.properties.get(name).copied()
    }

    /// A number.
    pub fn float(&self, name: &str) -> Result<Option<f64>> {
        self.typed(name, &["float", "integer"], |element| number(element, value(element)?))
    }

    /// A whole number.
    pub fn integer(&self, name: &str) -> Result<Option<i64>> {
        self.typed(name, &["integer", "float"], |element| {
            let text = value(element)?;
            let whole = || number(element, text).ok().filter(|x| x.fract() == 0.0 && x.abs() < 1e15).map(|x| x as i64);
            let not_whole = || element.malformed(format!("\"{text}\" is not a whole number"));
            text.trim().parse().ok().or_else(whole).ok_or_else(not_whole)
        })
    }

    /// True or false.
    pub fn boolean(&self, name: &str) -> Result<Option<bool>> {
        self.typed(name, &["boolean"], |element| match value(element)?.trim().to_ascii_lowercase().as_str() {
            "true" => Ok(true),
            "false" => Ok(false),
            other => Err(element.malformed(format!("\"{other}\" is neither true nor false"))),
        })
    }

    /// A text.
    pub fn string(&self, name: &str) -> Result<Option<&'a str>> {
        self.typed(name, &["string"], value)
    }

    /// A text that must be given.
    pub fn required_string(&self, name: &str) -> Result<&'a str> {
        let missing = || self.element.malformed(format!("the {} lacks the property \"{name}\"", self.element.tag));
        self.string(name)?.ok_or_else(missing)
    }

    /// A point or vector.
    pub fn vector(&self, name: &str) -> Result<Option<[f64; 3]>> {
        self.typed(name, &["point", "vector"], |element| {
            element.only_attributes(&["id", "name", "x", "y", "z", "value"])?;
            element.no_children()?;
            if ["x", "y", "z"].iter().all(|axis| element.attribute(axis).is_none()) {
                element.required("value")?;
            }
            xyz(element, 0.0)
        })
    }

    /// A reflectance of any kind.
    pub fn color(&self, name: &str) -> Result<Option<[f32; 3]>> {
        self.typed(name, &color::TAGS, |element| color::read(element, Use::Reflectance))
    }

    /// A colour for another use.
    pub fn color_for(&self, name: &str, purpose: Use) -> Result<Option<[f32; 3]>> {
        self.typed(name, &color::TAGS, |element| color::read(element, purpose))
    }

    /// A transform in double precision.
    pub fn transform(&self, name: &str) -> Result<Option<DMat4>> {
        self.typed(name, &["transform"], transform::read)
    }

    /// `to_world`, or the identity.
    pub fn to_world(&self) -> Result<Matrix> {
        Ok(rounded(self.transform("to_world")?.unwrap_or(DMat4::IDENTITY)))
    }

    fn typed<T>(&self, name: &str, tags: &[&str], read: impl FnOnce(&'a Element) -> Result<T>) -> Result<Option<T>> {
        let Some(element) = self.property(name) else { return Ok(None) };
        if !tags.contains(&element.tag.as_str()) {
            return Err(element.unsupported(format!("<{}> for the property \"{name}\"", element.tag), tags));
        }
        read(element).map(Some)
    }
}

/// The element that a reference refers to, or the element itself.
pub fn follow<'a>(element: &'a Element, ids: &Ids<'a>) -> Result<&'a Element> {
    if element.tag != "ref" {
        return Ok(element);
    }
    element.only_attributes(&["id", "name"])?;
    element.no_children()?;
    let id = element.required("id")?;
    ids.get(id).ok_or_else(|| element.malformed(format!("nothing has the id \"{id}\"")))
}

/// The `value` of a property.
fn value(element: &Element) -> Result<&str> {
    element.only_attributes(&["id", "name", "value"])?;
    element.no_children()?;
    element.required("value")
}
