//! Sums that the leaves of a quadtree hold, in either layout, and the sampling weights that follow from them.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::distribution::Distribution;
use super::topology::Topology;
use crate::guiding::target::Target;

/// Sums that are kept per leaf. Channels 0 to 3 of both layouts are ΣV and the number of path samples, and the same of photons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// These channels alone, which are all that counting needs.
    Values,
    /// These and, for the network, ΣV² of path samples, of photons, and the sum of
    /// [`PathRecord::bsdf_share`](crate::guiding::record::PathRecord).
    Network,
}

/// Number of sums per leaf of [`Layout::Network`].
pub const NETWORK_CHANNELS: usize = 7;
/// Channels of ΣV (path, photon).
pub const VALUES: [usize; 2] = [0, 2];
/// Channels of the number of samples (path, photon).
pub const COUNTS: [usize; 2] = [1, 3];
/// Channels of ΣV² (path, photon).
pub const SQUARES: [usize; 2] = [4, 5];
/// Channel of the BSDF's share: summed over samples of the mixture of BSDF and guide, it is proportional to the BSDF's mass.
pub const BSDF: usize = 6;

impl Layout {
    /// Number of sums per leaf.
    pub fn channels(self) -> usize {
        match self {
            Self::Values => 4,
            Self::Network => NETWORK_CHANNELS,
        }
    }
}

/// The leaves of one quadtree.
#[derive(Debug, Clone, Copy)]
pub struct Leaves<'a> {
    /// The tree.
    pub topology: &'a Topology,
    /// [leaves, channels of `layout`] in the order of [`Topology::leaves`]; missing rows count as zero.
    pub sums: &'a [f32],
    /// Layout of a row of `sums`.
    pub layout: Layout,
    /// Target that V is the value of.
    pub target: Target,
}

impl<'a> Leaves<'a> {
    /// ΣV of one kind of sample (0 path, 1 photon) per leaf; NaN counts as 0, an overflow as the largest number.
    pub fn values(&self, kind: usize) -> impl Iterator<Item = f64> + 'a {
        self.channel(VALUES[kind])
    }

    /// One channel per leaf, made usable as [`Leaves::values`] does.
    pub(super) fn channel(&self, channel: usize) -> impl Iterator<Item = f64> + 'a {
        let usable = |v: f32| if v.is_nan() { 0.0 } else { f64::from(v.clamp(0.0, f32::MAX)) };
        self.sums.chunks_exact(self.layout.channels()).map(move |row| usable(row[channel]))
    }

    /// Sampling weight of each leaf for one kind of sample: by the [`Target`] for paths, ΣV for photons.
    fn leaf_weights(&self, kind: usize) -> Vec<f64> {
        let weight = |(value, level)| if kind == 0 { self.target.weight(value, solid_angle(level)) } else { value };
        self.values(kind).zip(leaf_levels(self.topology)).map(weight).collect()
    }

    /// For every node the sampling weights (path, photon), breadth first, on no particular scale. An inner node has the sum
    /// of its leaves' weights, never a root of sums.
    pub fn weights(&self) -> Vec<[f64; 2]> {
        let mut weights = vec![[0.0; 2]; self.topology.len()];
        for kind in [0, 1] {
            for (leaf, weight) in self.topology.leaves().zip(self.leaf_weights(kind)) {
                weights[leaf][kind] = weight;
            }
        }
        for node in (1..weights.len()).rev() {
            let weight = weights[node];
            let to = &mut weights[self.topology.parent[node] as usize];
            *to = [to[0] + weight[0], to[1] + weight[1]];
        }
        weights
    }

    /// Whether any sample of a kind (0 path, 1 photon) had a value above 0.
    pub fn has(&self, kind: usize) -> bool {
        self.values(kind).any(|v| v > 0.0)
    }

    /// The distribution of one kind of sample alone (0 path, 1 photon); uniform without samples.
    pub fn distribution(&self, kind: usize) -> Distribution {
        Distribution::from_leaf_weights(self.topology.clone(), &self.leaf_weights(kind))
    }

    /// Mixture of `share` path samples and the rest photons, each normalised; where one of them is missing, the other alone.
    pub fn hybrid(&self, share: f64) -> Distribution {
        match [0, 1].map(|kind| self.has(kind)) {
            [true, true] if share >= 1.0 => self.distribution(0),
            [true, true] => Distribution::blend(&self.distribution(0), &self.distribution(1), share),
            [false, true] => self.distribution(1),
            _ => self.distribution(0),
        }
    }
}

/// The distribution of path samples with ΣV of `target` per leaf given, in the order of [`Topology::leaves`].
pub fn distribution_of_values(topology: &Topology, values: &[f64], target: Target) -> Distribution {
    let weight = |(&v, level): (&f64, usize)| target.weight(v, solid_angle(level));
    let weights: Vec<f64> = values.iter().zip(leaf_levels(topology)).map(weight).collect();
    Distribution::from_leaf_weights(topology.clone(), &weights)
}

/// Solid angle of a cell of this level, sr.
pub fn solid_angle(level: usize) -> f64 {
    4.0 * PI * 0.25f64.powi(level as i32)
}

/// Level of every leaf.
fn leaf_levels(topology: &Topology) -> impl Iterator<Item = usize> + '_ {
    (0..topology.levels()).flat_map(|l| topology.level(l).filter(|&n| topology.is_leaf(n)).map(move |_| l))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(path: [f32; 4], photons: [f32; 4]) -> Vec<f32> {
        (0..4).flat_map(|i| [path[i], 1.0, photons[i], 1.0]).collect()
    }

    #[test]
    fn weights_of_equal_density_add_up() {
        for target in [Target::Radiance, Target::Variance] {
            let parent = target.weight(3.0, solid_angle(2));
            assert!((4.0 * target.weight(0.75, solid_angle(3)) - parent).abs() < 1e-12);
        }
    }

    #[test]
    fn a04_hybrid_averages_or_takes_what_there_is() {
        let topology = Topology::from_split(&[true, false, false, false, false]).unwrap();
        let hybrid = |sums: &[f32], target, share| {
            Leaves { topology: &topology, sums, layout: Layout::Values, target }.hybrid(share)
        };
        let both = rows([9., 1., 0., 0.], [0., 0., 0., 5.]);
        assert_eq!(hybrid(&both, Target::Variance, 0.5).leaf_mass(), [0.375, 0.125, 0.0, 0.5]);
        let radiance = hybrid(&both, Target::Radiance, 0.5).leaf_mass();
        assert!(radiance.iter().zip([0.45, 0.05, 0.0, 0.5]).all(|(a, b)| (a - b).abs() < 1e-12), "{radiance:?}");
        assert_eq!(hybrid(&both, Target::Variance, 1.0).leaf_mass(), [0.75, 0.25, 0.0, 0.0]);
        let photons = rows([0.; 4], [0., 0., 0., 5.]);
        assert_eq!(hybrid(&photons, Target::Variance, 1.0).leaf_mass(), [0., 0., 0., 1.]);
        let none = rows([0.; 4], [0.; 4]);
        assert_eq!(hybrid(&none, Target::Variance, 0.5), Distribution::uniform());
    }
}
