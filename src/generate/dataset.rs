//! A folder of shards and its index: `index.jsonl`, one JSON object per shard.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::shard::{TreeSample, VERSION, read_shard};
use crate::base::files::{read_bytes, write_atomically};
use crate::base::{Error, Place, Result};
use crate::guiding::target::Target;
use crate::network::config::Mode;

/// Name of the index in a data folder.
pub const INDEX_FILE: &str = "index.jsonl";

const INDEX_LIMIT: u64 = 64 << 20;

/// One line of the index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardEntry {
    /// Format version, [`VERSION`].
    pub version: u32,
    /// File name inside the folder.
    pub file: String,
    /// The scene's name.
    pub scene: String,
    /// Name of the procedural family.
    pub family: String,
    /// Seed that the scene and its samples were made with.
    pub seed: u64,
    /// Whether the shard is kept from training, for evaluation; a whole scene is, or is not.
    pub held_out: bool,
    /// Trees in the shard.
    pub samples: u64,
    /// Mode that its trees were collected in.
    pub mode: Mode,
}

impl ShardEntry {
    /// Whether the file is inside of the data folder.
    pub(super) fn is_inside(&self) -> bool {
        let mut parts = Path::new(&self.file).components();
        !self.file.is_empty() && parts.all(|part| matches!(part, Component::Normal(_)))
    }
}

/// Keys that an index line of any version has.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// All lines of the index.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DatasetIndex {
    /// The shards, in the order of the file.
    pub shards: Vec<ShardEntry>,
}

impl DatasetIndex {
    /// Reads `folder/index.jsonl`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], or [`Error::Malformed`] naming the line: broken JSON, an unknown key or version, a
    /// file outside the folder, a mode that differs from the first line's.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(INDEX_FILE);
        let bytes = read_bytes(&path, INDEX_LIMIT)?;
        let mut index = Self::default();
        for (line, text) in (1..).zip(bytes.split(|&b| b == b'\n')) {
            if text.iter().all(u8::is_ascii_whitespace) {
                continue;
            }
            let fail = |message: String| Error::malformed(Place::line(&path, line), message);
            // The version first: lines of another one have other keys.
            let Versioned { version } = serde_json::from_slice(text).map_err(|e| fail(e.to_string()))?;
            if version != VERSION {
                return Err(fail(format!("version {version}, this program reads version {VERSION}")));
            }
            let entry: ShardEntry = serde_json::from_slice(text).map_err(|e| fail(e.to_string()))?;
            if !entry.is_inside() {
                return Err(fail(format!("file {:?} is not inside the data folder", entry.file)));
            }
            if index.shards.first().is_some_and(|first| first.mode != entry.mode) {
                return Err(fail("the mode differs from the first shard's; keep one folder per mode".into()));
            }
            index.shards.push(entry);
        }
        Ok(index)
    }

    /// Writes `folder/index.jsonl` atomically.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_atomically(&folder.join(INDEX_FILE), |out| {
            for entry in &self.shards {
                serde_json::to_writer(&mut *out, entry)?;
                out.write_all(b"\n")?;
            }
            Ok(())
        })
    }
}

/// All trees of a data folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Mode that the trees were collected in.
    pub mode: Mode,
    /// Trees to train on.
    pub train: Vec<TreeSample>,
    /// Trees of held-out scenes.
    pub held_out: Vec<TreeSample>,
}

/// Reads every shard of a data folder.
///
/// # Errors
/// Those of [`DatasetIndex::read`] and [`read_shard`]; [`Error::Malformed`] if a shard holds another number of trees than its
/// line says, or there is no shard at all.
pub fn read_dataset(folder: &Path) -> Result<Dataset> {
    let index = DatasetIndex::read(folder)?;
    let Some(first) = index.shards.first() else {
        return Err(Error::malformed(Place::file(folder.join(INDEX_FILE)), "the index lists no shard"));
    };
    let mut data = Dataset { mode: first.mode.clone(), train: vec![], held_out: vec![] };
    for entry in &index.shards {
        let trees = read_entry(folder, entry)?;
        if entry.held_out { &mut data.held_out } else { &mut data.train }.extend(trees);
    }
    Ok(data)
}

/// Reads several data folders as one.
///
/// # Errors
/// Those of [`read_dataset`]; [`Error::Malformed`] where their modes differ, [`Error::Options`] without any folder.
pub fn read_datasets(folders: &[PathBuf]) -> Result<Dataset> {
    let Some((first, others)) = folders.split_first() else {
        return Err(Error::Options("give a data folder".into()));
    };
    let mut all = read_dataset(first)?;
    for folder in others {
        let part = read_dataset(folder)?;
        if part.mode != all.mode {
            let message = "the mode differs from the first folder's";
            return Err(Error::malformed(Place::file(folder.join(INDEX_FILE)), message));
        }
        all.train.extend(part.train);
        all.held_out.extend(part.held_out);
    }
    Ok(all)
}

fn read_entry(folder: &Path, entry: &ShardEntry) -> Result<Vec<TreeSample>> {
    let path = folder.join(&entry.file);
    let mut trees = read_shard(&path)?;
    if trees.len() as u64 != entry.samples {
        let message = format!("{} trees, the index says {}", trees.len(), entry.samples);
        return Err(Error::malformed(Place::file(path), message));
    }
    let Some(quantity) = Target::named(&entry.mode.target) else {
        let place = Place::part(folder.join(INDEX_FILE), "mode.target");
        return Err(Error::malformed(place, format!("there is no target {:?}", entry.mode.target)));
    };
    trees.iter_mut().for_each(|tree| tree.quantity = quantity);
    Ok(trees)
}

/// Counts and means over a data folder, found by [`check`].
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct Summary {
    /// Shards read.
    pub shards: usize,
    /// Distinct scenes.
    pub scenes: usize,
    /// Distinct families.
    pub families: usize,
    /// Trees to train on.
    pub train: usize,
    /// Trees held out.
    pub held_out: usize,
    /// Mean nodes of the counted trees.
    pub input_nodes: f64,
    /// Mean nodes of Q_gt.
    pub target_nodes: f64,
    /// Mean path samples of Q_h.
    pub path_samples: f64,
    /// Mean photons of Q_h.
    pub photon_samples: f64,
    /// Mean convergence floor in nats.
    pub floor_kl: f64,
}

/// Reads and validates a whole data folder, one shard at a time.
///
/// # Errors
/// As [`read_dataset`]; also [`Error::Malformed`] for a scene that is both trained on and held out.
pub fn check(folder: &Path) -> Result<Summary> {
    let index = DatasetIndex::read(folder)?;
    let names = |held_out| -> BTreeSet<&str> {
        index.shards.iter().filter(|s| s.held_out == held_out).map(|s| s.scene.as_str()).collect()
    };
    let (train, held_out) = (names(false), names(true));
    if let Some(both) = train.intersection(&held_out).next() {
        let message = format!("scene {both:?} is both trained on and held out");
        return Err(Error::malformed(Place::file(folder.join(INDEX_FILE)), message));
    }
    let mut summary =
        Summary { shards: index.shards.len(), scenes: train.union(&held_out).count(), ..Summary::default() };
    summary.families = index.shards.iter().map(|s| &s.family).collect::<BTreeSet<_>>().len();
    for entry in &index.shards {
        let trees = read_entry(folder, entry)?;
        *(if entry.held_out { &mut summary.held_out } else { &mut summary.train }) += trees.len();
        for tree in &trees {
            summary.input_nodes += tree.counted_split.len() as f64;
            summary.target_nodes += tree.target_split.len() as f64;
            summary.path_samples += f64::from(tree.voxel_features.samples[0]);
            summary.photon_samples += f64::from(tree.voxel_features.samples[1]);
            summary.floor_kl += f64::from(tree.floor_kl);
        }
    }
    let scale = 1.0 / (summary.train + summary.held_out).max(1) as f64;
    let means = [&mut summary.input_nodes, &mut summary.target_nodes, &mut summary.path_samples];
    means.into_iter().chain([&mut summary.photon_samples, &mut summary.floor_kl]).for_each(|x| *x *= scale);
    Ok(summary)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::shard::write_shard;
    use crate::render::{GuideMode, RenderSettings, StopRule};

    fn entry(file: &str, scene: &str, held_out: bool) -> ShardEntry {
        let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
        let (file, scene, family) = (file.into(), scene.into(), "rooms".into());
        ShardEntry { version: VERSION, file, scene, family, seed: 1, held_out, samples: 1, mode }
    }

    fn folder(entries: Vec<ShardEntry>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let tree = TreeSample::default();
        for file in ["a.safetensors", "b.safetensors"] {
            write_shard(&folder.path().join(file), std::slice::from_ref(&tree)).unwrap();
        }
        DatasetIndex { shards: entries }.write(folder.path()).unwrap();
        folder
    }

    #[test]
    fn reads_what_it_wrote_and_divides_it() {
        let folder = folder(vec![entry("a.safetensors", "x", false), entry("b.safetensors", "y", true)]);
        let data = read_dataset(folder.path()).unwrap();
        assert_eq!((data.train.len(), data.held_out.len()), (1, 1));
        let summary = check(folder.path()).unwrap();
        assert_eq!((summary.scenes, summary.families, summary.input_nodes), (2, 1, 1.0));
    }

    #[test]
    fn bad_indices_are_refused_with_their_line() {
        let spoil: [fn(&mut ShardEntry); 4] = [
            |e| e.file = "../a.safetensors".into(),
            |e| e.file = "/a.safetensors".into(),
            |e| e.version = 9,
            |e| e.mode.light_sampling = false,
        ];
        for spoil in spoil {
            let mut second = entry("b.safetensors", "y", true);
            spoil(&mut second);
            let folder = folder(vec![entry("a.safetensors", "x", false), second]);
            let error = DatasetIndex::read(folder.path()).expect_err("a bad line").to_string();
            assert!(error.contains("index.jsonl:2"), "{error}");
        }
        let mut wrong_count = entry("a.safetensors", "x", false);
        wrong_count.samples = 2;
        assert!(read_dataset(folder(vec![wrong_count]).path()).is_err());
        assert!(read_dataset(folder(vec![]).path()).is_err());
        let both = folder(vec![entry("a.safetensors", "x", false), entry("b.safetensors", "x", true)]);
        assert!(check(both.path()).is_err());
    }
}
