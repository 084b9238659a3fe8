//! Unused properties: warned of as in Mitsuba 0.6, or refused where the name looks like a slip of the pen.

use std::cell::RefCell;
use std::collections::BTreeSet;

use crate::scene::readers::notes::Notes;

use super::element::Element;

/// Warnings about unused properties, each text once with the places where it holds.
#[derive(Debug, Default)]
pub struct Unused(RefCell<Seen>);

#[derive(Debug, Default)]
struct Seen {
    /// Elements that were noted: some objects are read several times.
    elements: BTreeSet<*const Element>,
    notes: Notes,
}

impl Unused {
    /// Notes `text` about `property`.
    pub fn note(&self, property: &Element, text: String) {
        let mut seen = self.0.borrow_mut();
        if seen.elements.insert(property) {
            seen.notes.add(&property.place, text);
        }
    }

    /// One warning for each text.
    pub fn into_warnings(self) -> Vec<String> {
        self.0.into_inner().notes.into_warnings("nor are")
    }
}
