//! Several networks in one model folder, each for trees of a range of sample counts (Zhu 2021, §8: five of them).
//!
//! The folder has a file `networks.json` and a folder for each network, which is a model folder by itself:
//!
//! ```json
//! {"version": 1, "networks": [{"folder": "0", "end": 100}, {"folder": "1", "end": 500}, {"folder": "2"}]}
//! ```
//!
//! `end` is the first number of samples, paths and photons together, that is too many; ends grow, and the last network has none.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Neural, Reconstructor, built_in};
use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::guiding::tree::CountedTree;
use crate::guiding::tree::proposal::Proposal;
use crate::network::config::Mode;

/// Name of the list in a folder of several networks.
pub const NETWORKS_FILE: &str = "networks.json";
/// The version of it that this program reads.
const VERSION: u32 = 1;
/// Largest accepted list in bytes, and the most networks in it.
const LIMIT: u64 = 1 << 16;
const MOST: usize = 16;

/// Content of `networks.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Networks {
    version: u32,
    networks: Vec<Listed>,
}

/// A network of the list.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    folder: PathBuf,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    end: Option<u32>,
}

impl Networks {
    /// Reads the list at `path`.
    ///
    /// # Errors
    /// [`Error::Malformed`] for one that is broken, of another version, or whose ranges are not in order.
    fn parse(text: &[u8], path: &Path) -> Result<Self> {
        let fail = |message: String| Error::malformed(Place::file(path), message);
        let list: Self = serde_json::from_slice(text)
            .map_err(|e| Error::malformed(Place::line(path, e.line() as u32), e.to_string()))?;
        if list.version != VERSION {
            return Err(fail(format!("format version {}, this renderer reads version {VERSION}", list.version)));
        }
        if list.networks.is_empty() || list.networks.len() > MOST {
            return Err(fail(format!("{} networks, expected 1 to {MOST}", list.networks.len())));
        }
        // A list is not to have files read that lie elsewhere.
        let lies_in = |folder: &Path| folder.file_name() == Some(folder.as_os_str());
        if let Some(Listed { folder, .. }) = list.networks.iter().find(|listed| !lies_in(&listed.folder)) {
            return Err(fail(format!("{} is not the name of a folder beside it", folder.display())));
        }
        let ends = list.networks.iter().map(|listed| listed.end.unwrap_or(u32::MAX));
        if !ends.is_sorted_by(|a, b| a < b) || list.networks.iter().rev().skip(1).any(|listed| listed.end.is_none()) {
            return Err(fail("ends must grow, and all but the last network have one".into()));
        }
        if list.networks.last().is_some_and(|last| last.end.is_some()) {
            return Err(fail("the last network must have no end: there is none for trees of more samples".into()));
        }
        Ok(list)
    }
}

/// Networks for ranges of sample counts.
pub struct Buckets {
    /// Each with the first number of samples that is too many for it.
    networks: Vec<(u32, Neural)>,
}

impl Buckets {
    /// The networks in `folder`, each of which `load` makes of its own folder; a folder that is one model is a single one.
    ///
    /// # Errors
    /// [`Error::Malformed`] for a broken list, and those of `load`.
    pub fn load(folder: &Path, load: impl Fn(&Path) -> Result<Neural>) -> Result<Self> {
        let file = folder.join(NETWORKS_FILE);
        if !file.exists() {
            return load(folder).map(Self::from);
        }
        let list = Networks::parse(&read_bytes(&file, LIMIT)?, &file)?;
        Self::of(&list, |name| load(&folder.join(name)))
    }

    /// The networks that were compiled into the program for `mode`: one, or those of Zhu 2021.
    ///
    /// # Errors
    /// [`Error::Model`] where the program has none for it.
    pub fn built_in(mode: &Mode) -> Result<Self> {
        let default = Neural::built_in()?;
        let Err(misfit) = default.check_mode(mode) else { return Ok(default.into()) };
        let list = Networks::parse(built_in::ZHU_LIST, &Path::new("built-in").join(NETWORKS_FILE))?;
        let zhu = Self::of(&list, |folder| Neural::with_embedded(built_in::zhu(folder)?))?;
        zhu.check_mode(mode).map_err(|_| misfit)?;
        Ok(zhu)
    }

    /// `given`, where it was trained in `mode`, or else the program's own for that.
    ///
    /// # Errors
    /// [`Error::Model`] where neither is.
    pub fn fitting<'n>(given: &'n Neural, mode: &Mode) -> Result<Box<dyn Reconstructor + 'n>> {
        match given.check_mode(mode) {
            Ok(()) => Ok(Box::new(given)),
            Err(misfit) => Ok(Box::new(Self::built_in(mode).map_err(|_| misfit)?)),
        }
    }

    /// The networks of a list.
    ///
    /// # Errors
    /// Those of `load`, which is given the names of their folders.
    fn of(list: &Networks, load: impl Fn(&Path) -> Result<Neural>) -> Result<Self> {
        let load = |listed: &Listed| Ok((listed.end.unwrap_or(u32::MAX), load(&listed.folder)?));
        Ok(Self { networks: list.networks.iter().map(load).collect::<Result<_>>()? })
    }

    /// The networks in their order.
    pub fn networks(&self) -> impl Iterator<Item = &Neural> {
        self.networks.iter().map(|(_, network)| network)
    }

    /// As [`Neural::check_mode`], for each.
    ///
    /// # Errors
    /// As [`Neural::check_mode`].
    pub fn check_mode(&self, mode: &Mode) -> Result<()> {
        self.networks().try_for_each(|network| network.check_mode(mode))
    }

    /// Which network a tree is for.
    fn place(&self, tree: &CountedTree) -> usize {
        let samples = tree.voxel_features.samples.iter().fold(0u32, |sum, &kind| sum.saturating_add(kind));
        self.networks.iter().position(|(end, _)| samples < *end).unwrap_or(self.networks.len() - 1)
    }
}

impl From<Neural> for Buckets {
    fn from(network: Neural) -> Self {
        Self { networks: vec![(u32::MAX, network)] }
    }
}

impl Reconstructor for Buckets {
    fn name(&self) -> &'static str {
        "neural"
    }

    fn rays_per_node(&self) -> f64 {
        self.networks().map(Neural::rays_per_node).fold(0.0, f64::max)
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        let places: Vec<usize> = trees.iter().map(|tree| self.place(tree)).collect();
        let mut made = Vec::with_capacity(self.networks.len());
        for (number, network) in self.networks().enumerate() {
            let own: Vec<CountedTree> =
                trees.iter().zip(&places).filter(|(_, place)| **place == number).map(|(tree, _)| *tree).collect();
            made.push(network.reconstruct(&own)?.into_iter());
        }
        Ok(places.into_iter().filter_map(|place| made[place].next()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Networks> {
        Networks::parse(text.as_bytes(), Path::new(NETWORKS_FILE))
    }

    #[test]
    fn lists_are_checked() {
        let five = r#"{"version": 1, "networks": [{"folder": "0", "end": 100}, {"folder": "1", "end": 500}, {"folder": "2"}]}"#;
        assert_eq!(parse(five).unwrap().networks.len(), 3);
        assert!(parse(r#"{"version": 1, "networks": [{"folder": "all"}]}"#).is_ok());
        for broken in [
            r#"{"version": 2, "networks": [{"folder": "0"}]}"#,
            r#"{"version": 1, "networks": []}"#,
            r#"{"version": 1, "networks": [{"folder": "0", "end": 100}]}"#,
            r#"{"version": 1, "networks": [{"folder": "0", "end": 100}, {"folder": "1", "end": 100}, {"folder": "2"}]}"#,
            r#"{"version": 1, "networks": [{"folder": "0"}, {"folder": "1"}]}"#,
            r#"{"version": 1, "networks": [{"folder": "0", "end": -1}]}"#,
            r#"{"version": 1, "networks": [{"folder": "../0"}]}"#,
            r#"{"version": 1, "networks": [{"folder": "/models"}]}"#,
            r#"{"version": 1, "networks": [{"folder": ""}]}"#,
            r#"{"version": 1, "networks""#,
        ] {
            assert!(matches!(parse(broken), Err(Error::Malformed { .. })), "{broken}");
        }
    }
}
