//! What a quadtree stores per leaf, and what the network reads per node.
//!
//! Raw sums per leaf, [`RAW_CHANNELS`] in this order (Zhu 2021 eq. 11): [`PATH_CHANNELS`] of path samples
//! `V, ωx, ωy, ωz, px, py, pz, d, nx, ny, nz, n'x, n'y, n'z, count, bsdf`, then [`PHOTON_CHANNELS`] of photons, the same
//! without `bsdf`. V is the deposited value, ω the direction, p the voxel-local position in [0, 1]³, d the log-scaled distance
//! relative to the voxel size, n the normal at the vertex, n' the normal at the next vertex, each on the side that light takes
//! to or from it; count is 1 per sample.
//!
//! The network's input, [`FEATURES`] per node:
//!
//! | channels | content |
//! |---|---|
//! | 0-30 | the raw sums, each divided by its largest magnitude in the tree |
//! | 31-37 | path: mean of p mapped to [-1, 1], mean of d / 8 within ±2, mean of n |
//! | 38-44 | photon: the same |
//! | 45, 46 | log of the sampling weight relative to uniform (path, photon), see [`node_log_shares`] |
//! | 47, 48 | sampling weight as share of the parent's (path, photon); the root's is 1 |
//! | 49, 50 | log of the sample count relative to uniform (path, photon) |
//! | 51 | level / 20 |
//! | 52, 53 | ln(1 + samples of the tree) / 8 (path, photon) |
//! | 54, 55 | ln(1 + samples of the node) / 8 (path, photon) |
//!
//! Zhu's own channels are 0-30; they hide how many samples there were, and one firefly flattens them, hence the rest. Where a
//! tree has no path samples, or no photons, the channels of that kind are zero. Scaling every V by a constant changes nothing.

use std::borrow::Cow;

use super::leaves::Leaves;
use super::topology::{MAX_LEVEL, Topology};

/// Raw sums of path samples.
pub const PATH_CHANNELS: usize = 16;
/// Raw sums of photons.
pub const PHOTON_CHANNELS: usize = 15;
/// Raw sums per leaf: those of path samples, then those of photons.
pub const RAW_CHANNELS: usize = PATH_CHANNELS + PHOTON_CHANNELS;
/// Network input channels per node.
pub const FEATURES: usize = RAW_CHANNELS + 2 * MEANS + 11;

/// First raw channel of a kind of sample (path, photon): ΣV.
pub(super) const KIND: [usize; 2] = [0, PATH_CHANNELS];
/// Offsets within a kind.
pub(super) const DIRECTION: usize = 1;
pub(super) const POSITION: usize = 4;
pub(super) const DISTANCE: usize = 7;
pub(super) const NORMAL: usize = 8;
pub(super) const OTHER_NORMAL: usize = 11;
pub(super) const COUNT: usize = 14;
/// The channel that only path samples have.
pub(super) const BSDF: usize = 15;
/// Channels of means per kind.
const MEANS: usize = 7;
/// Logarithms of densities are cut here, then divided by half of it.
const LOG_LIMIT: f64 = 12.0;
/// ln(1 + count) and distances are divided by this, so that usual values are near 1.
const LOG_SCALE: f64 = 8.0;

/// The input of the network: [nodes, [`FEATURES`]], breadth first, every value finite.
///
/// `leaf_sums` is [leaves, [`RAW_CHANNELS`]] in the order of [`Topology::leaves`]; path values are those of the variance
/// target (see [`Leaves::weights`]). Missing rows count as zero.
pub fn node_features(topology: &Topology, leaf_sums: &[f32]) -> Vec<f32> {
    let leaf_sums = finite(leaf_sums);
    let sums = topology.sum_to_root(&leaf_sums, RAW_CHANNELS);
    let weights = Leaves::full(topology, &leaf_sums).weights();
    let counts = |node: usize| KIND.map(|kind| sums[node * RAW_CHANNELS + kind + COUNT].max(0.0));
    let inverse_maxima = inverse_maxima(&sums);
    let mut rows = Vec::with_capacity(topology.len() * FEATURES);
    for (level, node) in (0..topology.levels()).flat_map(|l| topology.level(l).map(move |n| (l, n))) {
        let raw = &sums[node * RAW_CHANNELS..][..RAW_CHANNELS];
        rows.extend(raw.iter().zip(&inverse_maxima).map(|(&x, &scale)| (x * scale) as f32));
        for kind in KIND {
            push_means(&mut rows, &raw[kind..]);
        }
        let parent = topology.parent[node] as usize;
        rows.extend(log_shares(weights[node], weights[0], level));
        rows.extend([0, 1].map(|kind| share(weights[node][kind], weights[parent][kind]) as f32));
        rows.extend(log_shares(counts(node), counts(0), level));
        rows.push(level as f32 / MAX_LEVEL as f32);
        rows.extend(counts(0).map(|count| (count.ln_1p() / LOG_SCALE) as f32));
        rows.extend(counts(node).map(|count| (count.ln_1p() / LOG_SCALE) as f32));
    }
    rows
}

/// For every node, breadth first, the logarithm of its share of the tree's sampling weight relative to the uniform
/// distribution (path, photon): ln(w/w_root · 4^level), cut at ±12 and divided by 6; zero where the tree has no weight.
///
/// It is the logarithm of a density, so a cell inside a leaf has that leaf's value.
pub fn node_log_shares(topology: &Topology, leaf_sums: &[f32]) -> Vec<[f32; 2]> {
    let weights = Leaves::full(topology, leaf_sums).weights();
    let levels = (0..topology.levels()).flat_map(|l| topology.level(l).map(move |_| l));
    levels.zip(&weights).map(|(level, &weight)| log_shares(weight, weights[0], level)).collect()
}

fn log_shares(part: [f64; 2], whole: [f64; 2], level: usize) -> [f32; 2] {
    [0, 1].map(|kind| {
        if whole[kind] <= 0.0 {
            return 0.0;
        }
        let log = share(part[kind], whole[kind]).ln() + level as f64 * 4f64.ln();
        (log.clamp(-LOG_LIMIT, LOG_LIMIT) / (0.5 * LOG_LIMIT)) as f32
    })
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// Per raw channel the inverse of the largest magnitude in the tree, or 0 where all are zero.
fn inverse_maxima(sums: &[f64]) -> [f64; RAW_CHANNELS] {
    let mut maxima = [0.0f64; RAW_CHANNELS];
    for row in sums.chunks_exact(RAW_CHANNELS) {
        for (max, &x) in maxima.iter_mut().zip(row) {
            *max = max.max(x.abs());
        }
    }
    maxima.map(|max| if max > 0.0 { 1.0 / max } else { 0.0 })
}

/// Position, distance and normal of the mean sample of one kind; zeros where there is none.
fn push_means(rows: &mut Vec<f32>, kind: &[f64]) {
    if kind[COUNT] <= 0.0 {
        rows.extend([0.0; MEANS]);
        return;
    }
    let mean = |channel: usize| kind[channel] / kind[COUNT];
    rows.extend((POSITION..DISTANCE).map(|c| (2.0 * mean(c) - 1.0).clamp(-1.0, 1.0) as f32));
    rows.push((mean(DISTANCE) / LOG_SCALE).clamp(-2.0, 2.0) as f32);
    rows.extend((NORMAL..NORMAL + 3).map(|c| mean(c).clamp(-1.0, 1.0) as f32));
}

/// The sums with NaN as 0 and infinities as the largest finite number: a sum of finite samples may overflow f32.
fn finite(sums: &[f32]) -> Cow<'_, [f32]> {
    if sums.iter().all(|x| x.is_finite()) {
        return Cow::Borrowed(sums);
    }
    Cow::Owned(sums.iter().map(|&x| if x.is_nan() { 0.0 } else { x.clamp(f32::MIN, f32::MAX) }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn tree() -> (Topology, Vec<f32>) {
        let topology = Topology::from_split(&[true, false, true, false, false, false, false, false, false]).unwrap();
        let mut random = Random::new(7, 0, 0);
        let sums = (0..7 * RAW_CHANNELS)
            .map(|i| match i % RAW_CHANNELS {
                c if KIND.contains(&c) => random.next_f32().powi(4),
                c if KIND.contains(&(c.wrapping_sub(COUNT))) => 1.0 + random.below(30) as f32,
                _ => random.range(-1.0, 1.0),
            })
            .collect();
        (topology, sums)
    }

    fn scaled(sums: &[f32], scale: f32) -> Vec<f32> {
        let value = |i: usize| KIND.contains(&(i % RAW_CHANNELS));
        sums.iter().enumerate().map(|(i, &x)| if value(i) { x * scale } else { x }).collect()
    }

    #[test]
    fn a10_scaling_radiance_changes_no_feature() {
        let (topology, sums) = tree();
        let expected = node_features(&topology, &sums);
        assert_eq!(expected.len(), topology.len() * FEATURES);
        for scale in [1e-20, 1e-10, 3.0, 1e20] {
            let features = node_features(&topology, &scaled(&sums, scale));
            for (i, (a, b)) in expected.iter().zip(&features).enumerate() {
                assert!((a - b).abs() <= 1e-6 * a.abs().max(1e-3), "feature {}: {a} {b}", i % FEATURES);
            }
        }
    }

    #[test]
    fn without_photons_their_channels_are_zero() {
        let (topology, mut sums) = tree();
        sums.chunks_exact_mut(RAW_CHANNELS).for_each(|row| row[PATH_CHANNELS..].fill(0.0));
        let photon = (PATH_CHANNELS..RAW_CHANNELS).chain(38..45).chain([46, 48, 50, 53, 55]);
        let photon: Vec<_> = photon.collect();
        for row in node_features(&topology, &sums).chunks_exact(FEATURES) {
            assert!(photon.iter().all(|&c| row[c] == 0.0), "{row:?}");
            assert!(row[54] > 0.0 && row[52] > 0.0);
        }
    }

    #[test]
    fn a10_empty_and_overflowed_trees_are_finite() {
        let (topology, mut sums) = tree();
        sums[0] = f32::INFINITY;
        sums[RAW_CHANNELS] = f32::NAN;
        let empty = vec![0.0; sums.len()];
        for sums in [&empty, &sums, &vec![f32::MAX; sums.len()]] {
            let features = node_features(&topology, sums);
            assert!(features.iter().all(|x| x.is_finite() && x.abs() < 100.0));
            assert!(node_log_shares(&topology, sums).iter().flatten().all(|x| x.is_finite()));
        }
    }

    /// Uniform samples have the same root-mean-square everywhere: ΣV is proportional to the solid angle, and the path weight
    /// must be too, at every level.
    #[test]
    fn weights_of_a_uniform_tree_are_uniform() {
        let (topology, mut sums) = tree();
        for (row, node) in sums.chunks_exact_mut(RAW_CHANNELS).zip(topology.leaves()) {
            let level = if node < 5 { 1 } else { 2 };
            KIND.iter().for_each(|&kind| row[kind] = 0.25f32.powi(level));
        }
        for shares in node_log_shares(&topology, &sums) {
            assert!(shares.iter().all(|x| x.abs() < 1e-6), "{shares:?}");
        }
    }

    #[test]
    fn layout_is_as_documented() {
        let (topology, sums) = tree();
        let features = node_features(&topology, &sums);
        assert_eq!(FEATURES, 56);
        let root = &features[..FEATURES];
        assert_eq!(root[45..49], [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(root[51], 0.0);
        assert_eq!(features[5 * FEATURES + 51], 0.1);
        let count: f32 = sums.chunks_exact(RAW_CHANNELS).map(|row| row[COUNT]).sum();
        assert!((root[52] - count.ln_1p() / 8.0).abs() < 1e-6);
        assert_eq!(root[52], root[54]);
    }
}
