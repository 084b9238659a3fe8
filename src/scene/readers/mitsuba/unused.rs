//! Unused properties: warned of as in Mitsuba 0.6, or refused where the name looks like a slip of the pen.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use crate::base::Place;

use super::element::Element;

/// Warnings about unused properties, each text once with the places where it holds.
#[derive(Debug, Default)]
pub struct Unused(RefCell<Notes>);

#[derive(Debug, Default)]
struct Notes {
    /// Elements that were noted: some objects are read several times.
    seen: BTreeSet<*const Element>,
    /// Text, first place and number of places, in the order in which texts came up.
    told: Vec<(String, Place, usize)>,
    /// Index of each text in `told`.
    index: BTreeMap<String, usize>,
}

impl Unused {
    /// Notes `text` about `property`.
    pub fn note(&self, property: &Element, text: String) {
        let mut notes = self.0.borrow_mut();
        if !notes.seen.insert(property) {
            return;
        }
        if let Some(&at) = notes.index.get(&text) {
            notes.told[at].2 += 1;
            return;
        }
        let at = notes.told.len();
        notes.told.push((text.clone(), property.place.clone(), 1));
        notes.index.insert(text, at);
    }

    /// One warning for each text.
    pub fn into_warnings(self) -> Vec<String> {
        let line = |(text, place, count): (String, Place, usize)| match count {
            1 => format!("{place}: {text}"),
            _ => format!("{place}: {text}, nor are {} more like it", count - 1),
        };
        self.0.into_inner().told.into_iter().map(line).collect()
    }
}

/// The name in `known` that `name` seems to be a slip of: other capitals or underscores, or few letters wrong, left out, added or
/// exchanged: none in names of up to three letters, two in those of eight and more, else one. A name in `known` is no slip.
pub fn meant<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    if known.contains(&name) {
        return None;
    }
    let bare = |name: &str| name.replace(['_', '-', ' '], "").to_ascii_lowercase();
    let wrong = |near: &str| {
        // Far longer names need not be compared letter by letter.
        if name.len().abs_diff(near.len()) > 2 {
            return usize::MAX;
        }
        strsim::osa_distance(name, near)
    };
    let most = |near: &str| match near.len().min(name.len()) {
        ..4 => 0,
        4..8 => 1,
        _ => 2,
    };
    let same = known.iter().find(|near| bare(near) == bare(name));
    let near = || known.iter().filter(|near| wrong(near) <= most(near)).min_by_key(|near| wrong(near));
    same.or_else(near).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_told_from_other_names() {
        let known = ["reflectance", "alpha", "to_world", "int_ior", "fov", "k"];
        for (name, near) in [
            ("reflectence", "reflectance"),
            ("relfectance", "reflectance"),
            ("Reflectance", "reflectance"),
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("aplha", "alpha"),
            ("alphas", "alpha"),
            ("FOV", "fov"),
        ] {
            assert_eq!(meant(name, &known), Some(near), "{name}");
        }
        for name in ["alpha_u", "specular_reflectance", "ext_ior", "fox", "g", "material", "", "k", "sampling_weight"] {
            assert_eq!(meant(name, &known), None, "{name}");
        }
    }
}
