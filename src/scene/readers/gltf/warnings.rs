//! Warnings about what is read in another way than it may have been meant.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::base::Place;
use crate::scene::readers::notes::Notes;

/// Warnings, each once with the first part of the document where it holds.
#[derive(Debug)]
pub struct Warnings {
    path: PathBuf,
    /// Parts and warnings so far.
    told: BTreeSet<(String, String)>,
    notes: Notes,
}

impl Warnings {
    /// None so far, of the document at `path`.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), told: BTreeSet::new(), notes: Notes::default() }
    }

    /// Warns of something at `part` of the document.
    pub fn add(&mut self, part: impl Into<String>, message: impl Display) {
        let (part, message) = (part.into(), message.to_string());
        if self.told.insert((part.clone(), message.clone())) {
            self.notes.add(&Place::part(&self.path, part), message);
        }
    }

    /// All of them, in the order in which they came up.
    pub fn into_lines(self) -> Vec<String> {
        self.notes.into_warnings("and")
    }
}
