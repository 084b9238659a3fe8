//! Warnings that hold at many places.

use std::collections::BTreeMap;

use crate::base::Place;

/// Texts, each once with the first place where it holds and the number of places.
#[derive(Debug, Default)]
pub struct Notes {
    /// In the order in which texts came up.
    told: Vec<(String, Place, usize)>,
    /// Index of each text in `told`.
    index: BTreeMap<String, usize>,
}

impl Notes {
    /// Notes that `text` holds at `place`.
    pub fn add(&mut self, place: &Place, text: String) {
        if let Some(&at) = self.index.get(&text) {
            self.told[at].2 += 1;
            return;
        }
        self.index.insert(text.clone(), self.told.len());
        self.told.push((text, place.clone(), 1));
    }

    /// One warning for each text; `also` (such as "nor are") counts in the other places.
    pub fn into_warnings(self, also: &str) -> Vec<String> {
        let line = |(text, place, count): (String, Place, usize)| match count {
            1 => format!("{place}: {text}"),
            _ => format!("{place}: {text}, {also} {} more like it", count - 1),
        };
        self.told.into_iter().map(line).collect()
    }
}
