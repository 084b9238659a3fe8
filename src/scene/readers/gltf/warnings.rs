//! Warnings about what is read in another way than it may have been meant.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::base::Place;

/// Warnings with their places, each once.
#[derive(Debug)]
pub struct Warnings {
    path: PathBuf,
    told: BTreeSet<String>,
    lines: Vec<String>,
}

impl Warnings {
    /// None so far, of the document at `path`.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), told: BTreeSet::new(), lines: Vec::new() }
    }

    /// Warns of something at `part` of the document.
    pub fn add(&mut self, part: impl Into<String>, message: impl Display) {
        let line = format!("{}: {message}", Place::part(&self.path, part));
        if self.told.insert(line.clone()) {
            self.lines.push(line);
        }
    }

    /// All of them, in the order in which they came up.
    pub fn into_lines(self) -> Vec<String> {
        self.lines
    }
}
