//! One file of training pairs: noisy quadtrees and what they converge to, in safetensors.
//!
//! Arrays of all trees are concatenated; offsets say where each tree begins. Tensors, for T trees with H input nodes, L input
//! leaves, G target nodes and K target leaves together:
//!
//! | name | type | shape |
//! |---|---|---|
//! | `ids` | u32 | [T, 5]: scene, family, iteration, path samples, photon samples |
//! | `bounds` | f32 | [T, 6] |
//! | `target_samples` | u64 | [T] |
//! | `floor_kl` | f32 | [T] |
//! | `input_offset`, `target_offset` | u64 | [T + 1], nodes |
//! | `input_split`, `target_split` | u8 | [H], [G] |
//! | `input_sums` | f32 | [L, [`RAW_CHANNELS`]] |
//! | `target` | f32 | [K] |
//!
//! A tree of n nodes has (3n + 1)/4 leaves, so leaf offsets follow. The header's metadata hold `version` and `crc32`, over all
//! tensors' bytes in the order of their names.

use std::path::Path;

use crate::base::files::read_bytes;
use crate::base::tensors::{self, Dtype, Tensor, Tensors, vector};
use crate::base::{Error, Place, Result};
use crate::guiding::features::RAW_CHANNELS;
use crate::guiding::topology::Topology;

/// The version of shards that this program reads. 2: voxels are divided by facing, normals have the side of the path.
pub const VERSION: u32 = 2;

/// Largest accepted shard in bytes.
pub const SHARD_LIMIT: u64 = 1 << 30;

const IDS: usize = 5;

/// One voxel at one iteration: what had been collected, and the converged distribution there.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TreeSample {
    /// Number of the scene, so that data can be divided by scene.
    pub scene: u32,
    /// Number of the procedural family that the scene belongs to.
    pub family: u32,
    /// Iteration after which Q_h was taken.
    pub iteration: u32,
    /// The voxel in world space: minimum, maximum.
    pub bounds: [f32; 6],
    /// Split flags of Q_h, as for [`Topology::from_split`].
    pub input_split: Vec<bool>,
    /// [leaves, [`RAW_CHANNELS`]], see [`crate::guiding::features`].
    pub input_sums: Vec<f32>,
    /// Path samples in Q_h.
    pub path_samples: u32,
    /// Photons in Q_h.
    pub photon_samples: u32,
    /// Split flags of the converged tree, Q_gt.
    pub target_split: Vec<bool>,
    /// Mass per leaf of Q_gt; the sum is 1.
    pub target: Vec<f32>,
    /// Path samples in Q_gt.
    pub target_samples: u64,
    /// KL between two independent halves of Q_gt, in nats: no reconstruction can be measured below it.
    pub floor_kl: f32,
}

impl TreeSample {
    /// The quadtree Q_h.
    ///
    /// # Errors
    /// As [`Topology::from_split`].
    pub fn input_topology(&self) -> Result<Topology, String> {
        Topology::from_split(&self.input_split)
    }

    /// The quadtree Q_gt.
    ///
    /// # Errors
    /// As [`Topology::from_split`].
    pub fn target_topology(&self) -> Result<Topology, String> {
        Topology::from_split(&self.target_split)
    }

    /// Checks both trees, all sizes, and that every number is finite and in range.
    ///
    /// # Errors
    /// A sentence saying what is wrong.
    pub fn validate(&self) -> Result<(), String> {
        let input = self.input_topology().map_err(|e| format!("input: {e}"))?;
        let target = self.target_topology().map_err(|e| format!("target: {e}"))?;
        let expect = |what: &str, found: usize, expected: usize| {
            if found == expected { Ok(()) } else { Err(format!("{what}: {found} values, expected {expected}")) }
        };
        expect("input sums", self.input_sums.len(), input.leaves().count() * RAW_CHANNELS)?;
        expect("target", self.target.len(), target.leaves().count())?;
        if let Some(at) = self.input_sums.iter().position(|x| !x.is_finite()) {
            return Err(format!("input sum {at} is {}", self.input_sums[at]));
        }
        if let Some(mass) = self.target.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
            return Err(format!("a target mass is {mass}"));
        }
        let total: f64 = self.target.iter().map(|&m| f64::from(m)).sum();
        if (total - 1.0).abs() > 1e-3 {
            return Err(format!("target masses sum to {total}, expected 1"));
        }
        if !(self.floor_kl.is_finite() && self.bounds.iter().all(|b| b.is_finite())) {
            return Err("bounds or the KL floor are not finite".into());
        }
        Ok(())
    }
}

/// Writes a shard atomically.
///
/// # Errors
/// [`Error::Malformed`] for a sample that [`TreeSample::validate`] refuses, [`Error::Io`].
pub fn write_shard(path: &Path, samples: &[TreeSample]) -> Result<()> {
    for (i, sample) in samples.iter().enumerate() {
        sample.validate().map_err(|e| Error::malformed(Place::part(path, format!("tree {i}")), e))?;
    }
    tensors::write(path, VERSION, &tensors_of(samples))
}

/// All tensors, sorted by name.
fn tensors_of(samples: &[TreeSample]) -> Vec<Tensor<'_>> {
    let trees = samples.len();
    let f32s = |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let offsets = |len: fn(&TreeSample) -> usize| {
        let ends = samples.iter().scan(0u64, move |at, s| {
            *at += len(s) as u64;
            Some(*at)
        });
        std::iter::once(0).chain(ends).flat_map(u64::to_le_bytes).collect::<Vec<u8>>()
    };
    let flags =
        |of: fn(&TreeSample) -> &Vec<bool>| samples.iter().flat_map(of).map(|&f| u8::from(f)).collect::<Vec<_>>();
    let ids = |s: &TreeSample| [s.scene, s.family, s.iteration, s.path_samples, s.photon_samples];
    let (input_split, target_split) = (flags(|s| &s.input_split), flags(|s| &s.target_split));
    let sums = f32s(&mut samples.iter().flat_map(|s| &s.input_sums).copied());
    let target = f32s(&mut samples.iter().flat_map(|s| &s.target).copied());
    vec![
        ("bounds".into(), Dtype::F32, vec![trees, 6], f32s(&mut samples.iter().flat_map(|s| s.bounds)).into()),
        ("floor_kl".into(), Dtype::F32, vec![trees], f32s(&mut samples.iter().map(|s| s.floor_kl)).into()),
        ("ids".into(), Dtype::U32, vec![trees, IDS], samples.iter().flat_map(ids).flat_map(u32::to_le_bytes).collect()),
        ("input_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.input_split.len()).into()),
        ("input_split".into(), Dtype::U8, vec![input_split.len()], input_split.into()),
        ("input_sums".into(), Dtype::F32, vec![sums.len() / (4 * RAW_CHANNELS), RAW_CHANNELS], sums.into()),
        ("target".into(), Dtype::F32, vec![target.len() / 4], target.into()),
        ("target_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.target_split.len()).into()),
        vector("target_samples", Dtype::U64, samples.iter().map(|s| s.target_samples.to_le_bytes())),
        ("target_split".into(), Dtype::U8, vec![target_split.len()], target_split.into()),
    ]
}

/// Reads a shard.
///
/// # Errors
/// [`Error::Io`]; [`Error::Limit`] for a file above [`SHARD_LIMIT`]; [`Error::Unsupported`] for another version;
/// [`Error::Malformed`] naming the tensor or the tree for everything else that is wrong with it.
pub fn read_shard(path: &Path) -> Result<Vec<TreeSample>> {
    let bytes = read_bytes(path, SHARD_LIMIT)?;
    Reader { file: Tensors::open(path, &bytes, "shard", VERSION)? }.samples()
}

struct Reader<'a> {
    file: Tensors<'a>,
}

impl Reader<'_> {
    /// Node offsets of T trees into `total` nodes.
    fn offsets(&self, name: &str, trees: usize, total: usize) -> Result<Vec<usize>> {
        let offsets = self.file.read(name, Dtype::U64, Some(trees + 1), 1, u64::from_le_bytes)?;
        let rises = offsets.windows(2).all(|w| w[0] < w[1] && (w[1] - w[0]) % 4 == 1);
        if offsets[0] != 0 || offsets[trees] != total as u64 || !rises {
            return self.file.fail(name, format!("offsets do not divide {total} nodes into quadtrees"));
        }
        Ok(offsets.into_iter().map(|o| o as usize).collect())
    }

    fn samples(&self) -> Result<Vec<TreeSample>> {
        let ids = self.file.read("ids", Dtype::U32, None, IDS, u32::from_le_bytes)?;
        let trees = ids.len() / IDS;
        let bounds = self.file.read("bounds", Dtype::F32, Some(trees), 6, f32::from_le_bytes)?;
        let floor_kl = self.file.read("floor_kl", Dtype::F32, Some(trees), 1, f32::from_le_bytes)?;
        let target_samples = self.file.read("target_samples", Dtype::U64, Some(trees), 1, u64::from_le_bytes)?;
        let input = self.trees("input", trees)?;
        let target = self.trees("target", trees)?;
        let sums =
            self.file.read("input_sums", Dtype::F32, Some(input.leaves(trees)), RAW_CHANNELS, f32::from_le_bytes)?;
        let masses = self.file.read("target", Dtype::F32, Some(target.leaves(trees)), 1, f32::from_le_bytes)?;
        (0..trees)
            .map(|t| {
                let sample = TreeSample {
                    scene: ids[t * IDS],
                    family: ids[t * IDS + 1],
                    iteration: ids[t * IDS + 2],
                    path_samples: ids[t * IDS + 3],
                    photon_samples: ids[t * IDS + 4],
                    bounds: std::array::from_fn(|i| bounds[t * 6 + i]),
                    input_split: input.split[input.offsets[t]..input.offsets[t + 1]].to_vec(),
                    input_sums: sums[input.leaves(t) * RAW_CHANNELS..input.leaves(t + 1) * RAW_CHANNELS].to_vec(),
                    target_split: target.split[target.offsets[t]..target.offsets[t + 1]].to_vec(),
                    target: masses[target.leaves(t)..target.leaves(t + 1)].to_vec(),
                    target_samples: target_samples[t],
                    floor_kl: floor_kl[t],
                };
                sample.validate().or_else(|e| self.file.fail(format!("tree {t}"), e)).map(|()| sample)
            })
            .collect()
    }

    fn trees(&self, kind: &str, trees: usize) -> Result<Trees> {
        let name = format!("{kind}_split");
        let flags = self.file.read(&name, Dtype::U8, None, 1, |[b]| b)?;
        if let Some(at) = flags.iter().position(|&f| f > 1) {
            return self.file.fail(name, format!("flag {at} is {}, expected 0 or 1", flags[at]));
        }
        let offsets = self.offsets(&format!("{kind}_offset"), trees, flags.len())?;
        Ok(Trees { split: flags.into_iter().map(|f| f == 1).collect(), offsets })
    }
}

/// Split flags of concatenated trees.
struct Trees {
    split: Vec<bool>,
    offsets: Vec<usize>,
}

impl Trees {
    /// Leaves before tree `t`: every tree of n nodes has (3n + 1)/4.
    fn leaves(&self, t: usize) -> usize {
        (3 * self.offsets[t] + t) / 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn samples() -> Vec<TreeSample> {
        let root = TreeSample {
            input_split: vec![false],
            input_sums: vec![0.5; RAW_CHANNELS],
            target_split: vec![false],
            target: vec![1.0],
            ..TreeSample::default()
        };
        let split = TreeSample {
            scene: 3,
            family: 2,
            iteration: 4,
            bounds: [0., 1., 2., 3., 4., 5.],
            input_split: vec![true, false, false, false, false],
            input_sums: (0..4 * RAW_CHANNELS).map(|i| i as f32).collect(),
            path_samples: 17,
            photon_samples: 5,
            target_split: vec![true, false, true, false, false, false, false, false, false],
            target: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
            target_samples: 1 << 40,
            floor_kl: 0.01,
        };
        vec![root.clone(), split, root]
    }

    #[test]
    fn round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        for samples in [samples(), vec![]] {
            write_shard(&path, &samples).unwrap();
            assert_eq!(read_shard(&path).unwrap(), samples);
        }
    }

    #[test]
    fn damaged_shards_are_refused_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write_shard(&path, &samples()).unwrap();
        let good = std::fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let error = read_shard(&path).expect_err("a damaged shard").to_string();
            assert!(error.contains("a.safetensors"), "{error}");
        };
        for end in (0..good.len()).step_by(13) {
            refused(&good[..end]);
        }
        // Flips in the header's JSON may rename metadata or only white space; every flip in the data must be found.
        let data = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
        for at in data..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            refused(&bad);
        }
        for at in 0..data {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            std::fs::write(&path, &bad).unwrap();
            let _ = read_shard(&path);
        }
    }

    #[test]
    fn inconsistent_samples_are_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let spoil: [fn(&mut TreeSample); 5] = [
            |s| s.input_sums[3] = f32::NAN,
            |s| s.target[0] = 0.5,
            |s| s.target[0] = -0.25,
            |s| s.input_split.truncate(4),
            |s| s.target.truncate(2),
        ];
        for spoil in spoil {
            let mut all = samples();
            spoil(&mut all[1]);
            let error = write_shard(&path, &all).expect_err("a bad sample").to_string();
            assert!(error.contains("tree 1"), "{error}");
        }
        assert!(!path.exists());
    }
}
