//! One file of training pairs: noisy quadtrees and what they converge to, in safetensors.
//!
//! Arrays of all trees are concatenated; offsets say where each tree begins. Tensors, for T pairs, whose `own`, `counted`, `block` and
//! `target` trees have together O, C, B and G nodes, and L, M, N and K leaves:
//!
//! | name | type | shape |
//! |---|---|---|
//! | `ids` | u32 | [T, 6]: scene, family, iteration, kinds of samples, path samples, photons |
//! | `traits` | f32 | [T, 6]: path share, mean normal, nearness, samples of earlier iterations |
//! | `bounds` | f32 | [T, 6] |
//! | `target_samples` | u64 | [T] |
//! | `floor_kl` | f32 | [T] |
//! | `block_samples` | f32 | [T, 2] |
//! | `own_offset`, `counted_offset`, `block_offset`, `target_offset` | u64 | [T + 1], nodes |
//! | `own_split`, `counted_split`, `block_split`, `target_split` | u8 | [O], [C], [B], [G] |
//! | `own_sums` | f32 | [L, [`NETWORK_CHANNELS`]] |
//! | `counted` | f32 | [M] |
//! | `block` | f32 | [N] |
//! | `target`, `target_bsdf` | f32 | [K] |
//!
//! A tree of n nodes has (3n + 1)/4 leaves, so leaf offsets follow. The header's metadata hold `version` and `crc32`, over all
//! tensors' bytes in the order of their names.

use std::path::Path;

use crate::base::files::read_bytes;
use crate::base::tensors::{self, Arrays, Dtype, Tensor, Tensors, vector};
use crate::base::{Error, Place, Result};
use glam::Vec3;

use crate::guiding::target::Target;
use crate::guiding::tree::features::VoxelFeatures;
use crate::guiding::tree::leaves::NETWORK_CHANNELS;
use crate::guiding::tree::topology::Topology;

/// The version of shards that this program reads. 4: inputs have earlier iterations in them, and the block around them.
pub const VERSION: u32 = 4;

/// Largest accepted shard in bytes.
pub const SHARD_LIMIT: u64 = 1 << 30;
/// Part of that which is left for the file's header.
const HEADER_SPACE: u64 = 1 << 20;
/// Length of a mean of unit normals, with what rounding adds.
const LONGEST_NORMAL: f32 = 1.001;

const IDS: usize = 6;
const TRAITS: usize = 6;

/// One voxel at one iteration: what had been collected, and the converged distribution there.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeSample {
    /// Number of the scene, so that data can be divided by scene.
    pub scene: u32,
    /// Number of the procedural family that the scene belongs to.
    pub family: u32,
    /// Iteration after which the input was taken.
    pub iteration: u32,
    /// Kinds of samples in the input: 0 path samples and photons, 1 path samples, 2 photons.
    pub kinds: u32,
    /// The voxel in world space: minimum, maximum.
    pub bounds: [f32; 6],
    /// Split flags of the voxel's own tree Q_h, as for [`Topology::from_split`].
    pub own_split: Vec<bool>,
    /// [leaves, [`NETWORK_CHANNELS`]], see [`Layout::Network`](crate::guiding::tree::leaves::Layout::Network).
    pub own_sums: Vec<f32>,
    /// Split flags of the counted distribution, which has the voxel's context.
    pub counted_split: Vec<bool>,
    /// Mass per leaf of the counted distribution; the sum is 1.
    pub counted: Vec<f32>,
    /// Split flags of the distribution of the voxel's [`Block`](crate::guiding::tree::context::Block).
    pub block_split: Vec<bool>,
    /// Mass per leaf of that; the sum is 1.
    pub block: Vec<f32>,
    /// Samples of the block and of the larger one around it.
    pub block_samples: [f32; 2],
    /// Features of the voxel as a whole.
    pub voxel_features: VoxelFeatures,
    /// Quantity that the sums of path samples hold. Not in the shard: the index's mode has it.
    pub quantity: Target,
    /// Split flags of the converged tree, Q_gt.
    pub target_split: Vec<bool>,
    /// Mass per leaf of Q_gt; the sum is 1.
    pub target: Vec<f32>,
    /// Mass per leaf of the density of BSDF samples in the voxel; the sum is 1.
    pub target_bsdf: Vec<f32>,
    /// Path samples in Q_gt.
    pub target_samples: u64,
    /// KL between two independent halves of Q_gt, in nats; their noise is four times that of Q_gt beside the truth.
    pub floor_kl: f32,
}

/// Four trees that are roots alone, without samples.
impl Default for TreeSample {
    fn default() -> Self {
        Self {
            scene: 0,
            family: 0,
            iteration: 0,
            kinds: 0,
            bounds: [0.0; 6],
            own_split: vec![false],
            own_sums: vec![0.0; NETWORK_CHANNELS],
            counted_split: vec![false],
            counted: vec![1.0],
            block_split: vec![false],
            block: vec![1.0],
            block_samples: [0.0; 2],
            voxel_features: VoxelFeatures::default(),
            quantity: Target::Variance,
            target_split: vec![false],
            target: vec![1.0],
            target_bsdf: vec![1.0],
            target_samples: 0,
            floor_kl: 0.0,
        }
    }
}

impl TreeSample {
    /// Checks all trees and sizes, and that every number is finite and in range.
    ///
    /// # Errors
    /// A sentence saying what is wrong.
    pub fn validate(&self) -> Result<(), String> {
        let leaves = |what: &str, split: &[bool]| match Topology::from_split(split) {
            Ok(tree) => Ok(tree.leaves().count()),
            Err(e) => Err(format!("{what}: {e}")),
        };
        let expect = |what: &str, found: usize, expected: usize| {
            if found == expected { Ok(()) } else { Err(format!("{what}: {found} values, expected {expected}")) }
        };
        expect("own sums", self.own_sums.len(), leaves("own tree", &self.own_split)? * NETWORK_CHANNELS)?;
        expect("counted", self.counted.len(), leaves("counted tree", &self.counted_split)?)?;
        expect("block", self.block.len(), leaves("block tree", &self.block_split)?)?;
        expect("target", self.target.len(), leaves("target tree", &self.target_split)?)?;
        expect("target BSDF", self.target_bsdf.len(), self.target.len())?;
        if let Some(at) = self.own_sums.iter().position(|x| !(x.is_finite() && *x >= 0.0)) {
            return Err(format!("own sum {at} is {}", self.own_sums[at]));
        }
        let masses = [&self.counted, &self.block, &self.target, &self.target_bsdf];
        for (what, masses) in ["counted", "block", "target", "target BSDF"].into_iter().zip(masses) {
            if let Some(mass) = masses.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
                return Err(format!("a {what} mass is {mass}"));
            }
            let total: f64 = masses.iter().map(|&m| f64::from(m)).sum();
            if (total - 1.0).abs() > 1e-3 {
                return Err(format!("{what} masses sum to {total}, expected 1"));
            }
        }
        let VoxelFeatures { path_share, normal, nearness, past, .. } = self.voxel_features;
        let in_range = (0.0..=1.0).contains(&path_share) && normal.length() <= LONGEST_NORMAL;
        if !(in_range && [nearness, past].iter().all(|x| x.is_finite() && *x >= 0.0)) {
            return Err("path share, normal, nearness or samples of earlier iterations are out of range".into());
        }
        if let Some(samples) = self.block_samples.iter().find(|n| !(n.is_finite() && **n >= 0.0)) {
            return Err(format!("a block has {samples} samples"));
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
/// [`Error::Malformed`] for a sample that [`TreeSample::validate`] refuses, [`Error::Limit`] for more than can be read again, [`Error::Io`].
pub fn write_shard(path: &Path, samples: &[TreeSample]) -> Result<()> {
    for (i, sample) in samples.iter().enumerate() {
        sample.validate().map_err(|e| Error::malformed(Place::part(path, format!("tree {i}")), e))?;
    }
    let tensors = tensors_of(samples);
    let value = tensors.iter().map(|(.., bytes)| bytes.len() as u64).sum();
    if value > SHARD_LIMIT - HEADER_SPACE {
        let (place, what) = (Place::file(path), "size of the shard in bytes".into());
        return Err(Error::Limit { place, what, value, limit: SHARD_LIMIT - HEADER_SPACE });
    }
    tensors::write(path, VERSION, &tensors)
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
    let ids = |s: &TreeSample| {
        let [paths, photons] = s.voxel_features.samples;
        [s.scene, s.family, s.iteration, s.kinds, paths, photons]
    };
    let voxel_features = |s: &TreeSample| {
        let VoxelFeatures { path_share, normal, nearness, past, .. } = s.voxel_features;
        [path_share, normal.x, normal.y, normal.z, nearness, past]
    };
    let column = |of: fn(&TreeSample) -> &Vec<f32>| f32s(&mut samples.iter().flat_map(of).copied());
    let [block_split, counted_split] = [flags(|s| &s.block_split), flags(|s| &s.counted_split)];
    let [own_split, target_split] = [flags(|s| &s.own_split), flags(|s| &s.target_split)];
    let [block, counted, own_sums] = [column(|s| &s.block), column(|s| &s.counted), column(|s| &s.own_sums)];
    let [target, target_bsdf] = [column(|s| &s.target), column(|s| &s.target_bsdf)];
    vec![
        ("block".into(), Dtype::F32, vec![block.len() / 4], block.into()),
        ("block_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.block_split.len()).into()),
        (
            "block_samples".into(),
            Dtype::F32,
            vec![trees, 2],
            f32s(&mut samples.iter().flat_map(|s| s.block_samples)).into(),
        ),
        ("block_split".into(), Dtype::U8, vec![block_split.len()], block_split.into()),
        ("bounds".into(), Dtype::F32, vec![trees, 6], f32s(&mut samples.iter().flat_map(|s| s.bounds)).into()),
        ("counted".into(), Dtype::F32, vec![counted.len() / 4], counted.into()),
        ("counted_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.counted_split.len()).into()),
        ("counted_split".into(), Dtype::U8, vec![counted_split.len()], counted_split.into()),
        ("floor_kl".into(), Dtype::F32, vec![trees], f32s(&mut samples.iter().map(|s| s.floor_kl)).into()),
        ("ids".into(), Dtype::U32, vec![trees, IDS], samples.iter().flat_map(ids).flat_map(u32::to_le_bytes).collect()),
        ("own_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.own_split.len()).into()),
        ("own_split".into(), Dtype::U8, vec![own_split.len()], own_split.into()),
        (
            "own_sums".into(),
            Dtype::F32,
            vec![own_sums.len() / (4 * NETWORK_CHANNELS), NETWORK_CHANNELS],
            own_sums.into(),
        ),
        ("target".into(), Dtype::F32, vec![target.len() / 4], target.into()),
        ("target_bsdf".into(), Dtype::F32, vec![target_bsdf.len() / 4], target_bsdf.into()),
        ("target_offset".into(), Dtype::U64, vec![trees + 1], offsets(|s| s.target_split.len()).into()),
        vector("target_samples", Dtype::U64, samples.iter().map(|s| s.target_samples.to_le_bytes())),
        ("target_split".into(), Dtype::U8, vec![target_split.len()], target_split.into()),
        ("traits".into(), Dtype::F32, vec![trees, TRAITS], f32s(&mut samples.iter().flat_map(voxel_features)).into()),
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

    /// f32 values of a tensor of so many rows.
    fn floats(&self, name: &str, rows: usize, columns: usize) -> Result<Vec<f32>> {
        self.file.read(name, Dtype::F32, Some(rows), columns, f32::from_le_bytes)
    }

    fn samples(&self) -> Result<Vec<TreeSample>> {
        let ids = self.file.read("ids", Dtype::U32, None, IDS, u32::from_le_bytes)?;
        let trees = ids.len() / IDS;
        let (bounds, voxel_features) = (self.floats("bounds", trees, 6)?, self.floats("traits", trees, TRAITS)?);
        let floor_kl = self.floats("floor_kl", trees, 1)?;
        let target_samples = self.file.read("target_samples", Dtype::U64, Some(trees), 1, u64::from_le_bytes)?;
        let [own, counted] = [self.trees("own", trees)?, self.trees("counted", trees)?];
        let [block, target] = [self.trees("block", trees)?, self.trees("target", trees)?];
        let block_samples = self.floats("block_samples", trees, 2)?;
        let block_mass = self.floats("block", block.leaves(trees), 1)?;
        let sums = self.floats("own_sums", own.leaves(trees), NETWORK_CHANNELS)?;
        let masses = self.floats("counted", counted.leaves(trees), 1)?;
        let [target_mass, target_bsdf] =
            [self.floats("target", target.leaves(trees), 1)?, self.floats("target_bsdf", target.leaves(trees), 1)?];
        (0..trees)
            .map(|t| {
                let (ids, voxel_features) = (&ids[t * IDS..][..IDS], &voxel_features[t * TRAITS..][..TRAITS]);
                let sample = TreeSample {
                    scene: ids[0],
                    family: ids[1],
                    iteration: ids[2],
                    kinds: ids[3],
                    bounds: std::array::from_fn(|i| bounds[t * 6 + i]),
                    own_split: own.split_of(t),
                    own_sums: sums[own.leaves(t) * NETWORK_CHANNELS..own.leaves(t + 1) * NETWORK_CHANNELS].to_vec(),
                    counted_split: counted.split_of(t),
                    counted: masses[counted.leaves(t)..counted.leaves(t + 1)].to_vec(),
                    block_split: block.split_of(t),
                    block: block_mass[block.leaves(t)..block.leaves(t + 1)].to_vec(),
                    block_samples: [block_samples[2 * t], block_samples[2 * t + 1]],
                    voxel_features: VoxelFeatures {
                        samples: [ids[4], ids[5]],
                        past: voxel_features[5],
                        path_share: voxel_features[0],
                        normal: Vec3::new(voxel_features[1], voxel_features[2], voxel_features[3]),
                        nearness: voxel_features[4],
                    },
                    quantity: Target::Variance,
                    target_split: target.split_of(t),
                    target: target_mass[target.leaves(t)..target.leaves(t + 1)].to_vec(),
                    target_bsdf: target_bsdf[target.leaves(t)..target.leaves(t + 1)].to_vec(),
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
    fn split_of(&self, t: usize) -> Vec<bool> {
        self.split[self.offsets[t]..self.offsets[t + 1]].to_vec()
    }

    /// Leaves before tree `t`: every tree of n nodes has (3n + 1)/4.
    fn leaves(&self, t: usize) -> usize {
        (3 * self.offsets[t] + t) / 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn samples() -> Vec<TreeSample> {
        let root = TreeSample { own_sums: vec![0.5; NETWORK_CHANNELS], ..TreeSample::default() };
        let split = TreeSample {
            scene: 3,
            family: 2,
            iteration: 4,
            kinds: 1,
            bounds: [0., 1., 2., 3., 4., 5.],
            own_split: vec![true, false, false, false, false],
            own_sums: (0..4 * NETWORK_CHANNELS).map(|i| i as f32).collect(),
            counted_split: vec![true, false, false, false, false],
            counted: vec![0.5, 0.25, 0.25, 0.0],
            block_split: vec![true, false, false, true, false, false, false, false, false],
            block: vec![0.25, 0.25, 0.1, 0.1, 0.1, 0.1, 0.1],
            block_samples: [170.0, 800.0],
            voxel_features: VoxelFeatures {
                samples: [17, 5],
                past: 9.5,
                path_share: 0.25,
                normal: Vec3::new(0.0, 0.6, 0.8),
                nearness: 0.5,
            },
            quantity: Target::Variance,
            target_split: vec![true, false, true, false, false, false, false, false, false],
            target: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
            target_bsdf: vec![0.5, 0.0, 0.25, 0.1, 0.05, 0.05, 0.05],
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
        let spoil: [fn(&mut TreeSample); 12] = [
            |s| s.own_sums[3] = f32::NAN,
            |s| s.own_sums[3] = -1.0,
            |s| s.target[0] = 0.5,
            |s| s.target[0] = -0.25,
            |s| s.counted[0] = 0.75,
            |s| s.own_split.truncate(4),
            |s| s.target_bsdf.truncate(2),
            |s| s.voxel_features.path_share = f32::NAN,
            |s| s.voxel_features.past = -1.0,
            |s| s.block[0] = 0.5,
            |s| s.block_split.truncate(8),
            |s| s.block_samples[1] = f32::NAN,
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
