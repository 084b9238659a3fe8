//! Parts of a data set, which several processes make in one folder: each has an index of its own until they are put together.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::dataset::{DatasetIndex, INDEX_FILE, ShardEntry};
use super::shard::VERSION;
use crate::base::files::{read_json, write_json};
use crate::base::{Error, Place, Result, Unfit, named};
use crate::network::config::Mode;
use crate::render::PartOf;

/// Largest accepted index of a part, bytes.
const LIMIT: u64 = 64 << 20;

/// Index of a part: a JSON file beside the shards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartIndex {
    /// Version of the shards, [`VERSION`].
    pub version: u32,
    /// Which part of how many.
    pub part: PartOf,
    /// Checksum of the whole recipe: parts of other recipes do not go together.
    pub recipe: String,
    /// Scenes of all parts together.
    pub jobs: u64,
    /// The part's shards, in the order of their scenes.
    pub shards: Vec<ShardEntry>,
}

impl PartIndex {
    /// Name of a part's index in the data folder.
    pub fn file_name(part: PartOf) -> String {
        format!("index.{}-{}.json", part.index(), part.count())
    }

    /// The index of a part in `folder`, empty where none was begun.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`]; [`Error::Parts`] for the part of another recipe.
    pub fn begun(folder: &Path, part: PartOf, recipe: String, jobs: u64) -> Result<Self> {
        let path = folder.join(Self::file_name(part));
        let empty = Self { version: VERSION, part, recipe, jobs, shards: Vec::new() };
        if !path.exists() {
            return Ok(empty);
        }
        let found = Self::read(&path)?;
        if (found.part, &found.recipe, found.jobs) != (part, &empty.recipe, jobs) {
            let message = format!("{}: the part is of another recipe; choose another folder", path.display());
            return Err(Error::Parts { fault: Unfit::Foreign, files: vec![path], message });
        }
        Ok(found)
    }

    /// Reads an index.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`].
    pub fn read(path: &Path) -> Result<Self> {
        let found: Self = read_json(path, LIMIT)?;
        let fail = |message: String| Err(Error::malformed(Place::file(path), message));
        if found.version != VERSION {
            return fail(format!("version {}, this program reads version {VERSION}", found.version));
        }
        if found.shards.len() as u64 > found.part.dealt(found.jobs) {
            return fail(format!("{} shards of {} scenes", found.shards.len(), found.part.dealt(found.jobs)));
        }
        if let Some(shard) = found.shards.iter().find(|shard| !shard.is_inside() || shard.version != VERSION) {
            return fail(format!("file {:?} is not inside the data folder, or has another version", shard.file));
        }
        if found.shards.iter().any(|shard| Some(&shard.mode) != found.mode()) {
            return fail("its shards are of several modes".into());
        }
        Ok(found)
    }

    /// Writes the index into `folder` atomically.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(Self::file_name(self.part)), self)
    }

    fn is_done(&self) -> bool {
        self.shards.len() as u64 == self.part.dealt(self.jobs)
    }

    fn mode(&self) -> Option<&Mode> {
        self.shards.first().map(|shard| &shard.mode)
    }
}

/// The indices of parts in a folder, with their files.
fn found(folder: &Path) -> Result<Vec<(PathBuf, PartIndex)>> {
    let io = |e| Error::io(folder, e);
    let mut parts = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with("index.") && name.ends_with(".json") {
            let index = PartIndex::read(&path)?;
            if name != PartIndex::file_name(index.part) {
                let message = format!("this is the index of part {}, under another name", index.part);
                return Err(Error::malformed(Place::file(path), message));
            }
            parts.push((path, index));
        }
    }
    parts.sort_by_key(|(_, index)| index.part);
    Ok(parts)
}

/// What [`merge`] has found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merging {
    /// So many parts, which are put together now.
    Done(usize),
    /// Parts that were put together before: what was left of them is removed.
    DoneBefore,
    /// No parts, and an index: of one process, or of parts that were put together. It need not have come to its end.
    NoParts,
}

/// Puts the parts in `folder` together: its index has the bytes that one process would have written, and those of the parts are removed.
///
/// # Errors
/// [`Error::Parts`] where parts are missing, unfinished or of other data, naming them; those of reading and writing.
pub fn merge(folder: &Path) -> Result<Merging> {
    let parts = found(folder)?;
    let Some((path, first)) = parts.first().filter(|_| !folder.join(INDEX_FILE).exists()) else {
        return left_over(folder, &parts);
    };
    let foreign = |(_, other): &&(PathBuf, PartIndex)| {
        let same = (other.part.count(), &other.recipe, other.jobs) == (first.part.count(), &first.recipe, first.jobs);
        !same || other.mode().zip(first.mode()).is_some_and(|(a, b)| a != b)
    };
    if let Some((other, _)) = parts.iter().find(foreign) {
        let message = format!("{} and {} are parts of other data", path.display(), other.display());
        return Err(Error::Parts { fault: Unfit::Foreign, files: vec![path.clone(), other.clone()], message });
    }
    let absent = PartOf::absent(first.part.count(), parts.iter().map(|(_, part)| part.part.index()));
    if !absent.is_empty() {
        let message = format!("{}: parts are missing: {}", folder.display(), named(absent));
        return Err(Error::Parts { fault: Unfit::Missing, files: Vec::new(), message });
    }
    if let Some((path, part)) = parts.iter().find(|(_, part)| !part.is_done()) {
        let (done, all) = (part.shards.len(), part.part.dealt(part.jobs));
        let message = format!("{}: {done} of {all} scenes are done; the command that began it goes on", path.display());
        return Err(Error::Parts { fault: Unfit::Unfinished, files: vec![path.clone()], message });
    }
    let mut shards: Vec<_> = parts.iter().map(|(_, part)| part.shards.iter()).collect();
    let turns = (0..first.jobs as usize).map(|number| number % parts.len());
    let shards: Vec<ShardEntry> = turns.filter_map(|part| shards[part].next().cloned()).collect();
    let lost: Vec<PathBuf> =
        shards.iter().map(|shard| folder.join(&shard.file)).filter(|path| !path.is_file()).collect();
    if let Some(path) = lost.first() {
        let message = format!("{} shards are missing, {} first", lost.len(), path.display());
        return Err(Error::Parts { fault: Unfit::Missing, files: lost, message });
    }
    DatasetIndex { shards }.write(folder)?;
    remove(&parts)?;
    Ok(Merging::Done(parts.len()))
}

fn remove(parts: &[(PathBuf, PartIndex)]) -> Result<()> {
    parts.iter().try_for_each(|(path, _)| std::fs::remove_file(path).map_err(|e| Error::io(path, e)))
}

/// Removes what a merge that was killed has left of the parts of whole data.
fn left_over(folder: &Path, parts: &[(PathBuf, PartIndex)]) -> Result<Merging> {
    let whole = DatasetIndex::read(folder)?;
    let listed = |part: &PartIndex| {
        whole.shards.len() as u64 == part.jobs && part.shards.iter().all(|shard| whole.shards.contains(shard))
    };
    match parts.iter().find(|(_, part)| !listed(part)) {
        None if parts.is_empty() => Ok(Merging::NoParts),
        None => remove(parts).map(|()| Merging::DoneBefore),
        Some((path, _)) => {
            let message = format!("{}: the folder has an index already, and not with this part", path.display());
            Err(Error::Parts { fault: Unfit::Foreign, files: vec![path.clone()], message })
        }
    }
}

/// Refuses a folder whose data are whole already.
///
/// # Errors
/// [`Error::Parts`].
pub fn check_unfinished(folder: &Path) -> Result<()> {
    let path = folder.join(INDEX_FILE);
    if !path.exists() {
        return Ok(());
    }
    let message =
        format!("{}: the data are whole already, or are made by one process; choose another folder", path.display());
    Err(Error::Parts { fault: Unfit::Double, files: vec![path], message })
}
