//! Places in the source of the parts of a [`SceneFile`](crate::scene::file::SceneFile), for error messages.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::base::Place;

/// Maps key paths such as `shapes[3].material` to places.
#[derive(Debug, Clone)]
pub struct Places {
    source: PathBuf,
    known: BTreeMap<String, Place>,
}

impl Places {
    /// No place known but the file itself: messages name the key path.
    pub fn new(source: &Path) -> Self {
        Self { source: source.to_owned(), known: BTreeMap::new() }
    }

    /// Sets the place of the part `key`.
    pub fn set(&mut self, key: impl Into<String>, place: Place) {
        self.known.insert(key.into(), place);
    }

    /// The document.
    pub fn source(&self) -> &Path {
        &self.source
    }

    /// The first place that names the picture `file`, else the place of the part `owner`.
    pub fn of_picture(&self, file: &str, owner: &str) -> Place {
        self.known.get(&picture(file)).cloned().unwrap_or_else(|| self.at(owner))
    }

    /// Sets a place that names the picture `file`; the first one stays.
    pub fn set_picture(&mut self, file: &str, place: Place) {
        self.known.entry(picture(file)).or_insert(place);
    }

    /// The place of `key`, or of the innermost known part that holds it.
    pub fn at(&self, key: &str) -> Place {
        let mut prefix = key;
        loop {
            if let Some(place) = self.known.get(prefix) {
                return place.clone();
            }
            match prefix.rfind(['.', '[']) {
                Some(end) => prefix = &prefix[..end],
                None => return Place::part(&self.source, key),
            }
        }
    }
}

/// The key of a picture.
fn picture(file: &str) -> String {
    format!("pictures.{file}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn innermost_known_part() {
        let mut places = Places::new(Path::new("a.xml"));
        places.set("shapes[3]", Place::line("b.xml", 7));
        assert_eq!(places.at("shapes[3].geometry.radius").to_string(), "b.xml:7");
        assert_eq!(places.at("shapes[33].geometry").to_string(), "a.xml (shapes[33].geometry)");
    }
}
