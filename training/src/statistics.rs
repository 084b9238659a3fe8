//! Statistics of a data set, as a table and as plots.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};
use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use fanal::generate::dataset::Dataset;
use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::topology::Topology;
use serde::Serialize;

use crate::plot::{self, Panel};

/// Numbers of pairs whose quantity lies in [2^k, 2^(k + 1)), k from 0 on; the first also counts smaller ones.
type Octaves = Vec<u64>;

/// Statistics of all pairs of a data set.
#[derive(Debug, Clone, Serialize)]
pub struct Statistics {
    /// Number of scenes to train on, and held out.
    pub scenes: [usize; 2],
    /// Number of pairs to train on, and of held-out scenes.
    pub pairs: [usize; 2],
    /// Pairs by the kinds of samples in the input: both, paths only, photons only.
    pub kinds: [u64; 3],
    /// Pairs by iteration.
    pub iterations: BTreeMap<u32, u64>,
    /// Pairs by their own path samples.
    pub path_samples: Octaves,
    /// Pairs by their own photons.
    pub photons: Octaves,
    /// Pairs by nodes of the counted tree.
    pub counted_nodes: Octaves,
    /// Pairs by nodes of the target.
    pub target_nodes: Octaves,
    /// Pairs by path samples in the target.
    pub target_samples: Octaves,
    /// Pairs by levels of the target.
    pub target_levels: Vec<u64>,
    /// Deciles of the convergence floor in nats, from the least to the largest.
    pub floor: [f64; 11],
    /// Deciles of the voxel's diagonal, in units of the scene.
    pub voxels: [f64; 11],
}

impl Statistics {
    /// Computes the statistics of all pairs.
    ///
    /// # Errors
    /// When there are no pairs, or a pair is not valid.
    pub fn new(folders: &[Dataset]) -> Result<Self> {
        let all = || folders.iter().flat_map(|data| data.train.iter().chain(&data.held_out));
        ensure!(all().next().is_some(), "the data folders have no trees");
        // Scenes are numbered anew in every folder.
        let scenes = |pairs: &[TreeSample]| pairs.iter().map(|pair| pair.scene).collect::<BTreeSet<_>>().len();
        let sum = |of: &dyn Fn(&Dataset) -> usize| folders.iter().map(of).sum();
        let mut kinds = [0; 3];
        let mut iterations = BTreeMap::new();
        for pair in all() {
            if let Some(count) = kinds.get_mut(pair.kinds as usize) {
                *count += 1;
            }
            *iterations.entry(pair.iteration).or_default() += 1;
        }
        let mut target_levels = vec![];
        for pair in all() {
            let tree = Topology::from_split(&pair.target_split).map_err(|e| anyhow!("target tree: {e}"))?;
            let levels = tree.levels() - 1;
            target_levels.resize(target_levels.len().max(levels + 1), 0);
            target_levels[levels] += 1;
        }
        Ok(Self {
            scenes: [sum(&|data| scenes(&data.train)), sum(&|data| scenes(&data.held_out))],
            pairs: [sum(&|data| data.train.len()), sum(&|data| data.held_out.len())],
            kinds,
            iterations,
            path_samples: octaves(all().map(|pair| u64::from(pair.voxel_features.samples[0]))),
            photons: octaves(all().map(|pair| u64::from(pair.voxel_features.samples[1]))),
            counted_nodes: octaves(all().map(|pair| pair.counted_split.len() as u64)),
            target_nodes: octaves(all().map(|pair| pair.target_split.len() as u64)),
            target_samples: octaves(all().map(|pair| pair.target_samples)),
            target_levels,
            floor: deciles(all().map(|pair| f64::from(pair.floor_kl)).collect()),
            voxels: deciles(all().map(diagonal).collect()),
        })
    }

    /// Writes `statistics.json` and `statistics.svg` into `folder`.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        plot::write(folder, "statistics", self, &self.panels())
    }

    fn panels(&self) -> Vec<Panel> {
        let panel = |title: &str, labels: Vec<String>, series: &[(&str, Vec<f64>)]| Panel {
            title: title.into(),
            labels,
            series: series.iter().map(|(name, values)| ((*name).to_owned(), values.clone())).collect(),
            bars: true,
        };
        let numbers = |counts: &[u64]| counts.iter().map(|&n| n as f64).collect::<Vec<_>>();
        let powers = |n: usize| (0..n).map(|k| format!("2^{k}")).collect::<Vec<_>>();
        let longest = |all: [&Octaves; 2]| all.iter().map(|o| o.len()).max().unwrap_or(0);
        let tenths = || (0..=10).map(|k| format!("{} %", 10 * k)).collect::<Vec<_>>();
        let iterations: Vec<u64> = self.iterations.values().copied().collect();
        vec![
            panel(
                "pairs by samples in the voxel",
                powers(longest([&self.path_samples, &self.photons])),
                &[("path samples", numbers(&self.path_samples)), ("photons", numbers(&self.photons))],
            ),
            panel(
                "pairs by nodes",
                powers(longest([&self.counted_nodes, &self.target_nodes])),
                &[("counted", numbers(&self.counted_nodes)), ("target", numbers(&self.target_nodes))],
            ),
            panel(
                "pairs by iteration",
                self.iterations.keys().map(u32::to_string).collect(),
                &[("", numbers(&iterations))],
            ),
            panel(
                "pairs by levels of the target",
                (0..self.target_levels.len()).map(|l| l.to_string()).collect(),
                &[("", numbers(&self.target_levels))],
            ),
            panel("deciles of the convergence floor, nats", tenths(), &[("", self.floor.to_vec())]),
            panel("deciles of the voxels' diagonals", tenths(), &[("", self.voxels.to_vec())]),
        ]
    }
}

impl Display for Statistics {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let [scenes, held] = self.scenes;
        writeln!(
            f,
            "{} pairs of {scenes} scenes to train on, {} of {held} held-out scenes",
            self.pairs[0], self.pairs[1]
        )?;
        let [both, paths, photons] = self.kinds;
        writeln!(f, "inputs: {both} of path samples and photons, {paths} of path samples, {photons} of photons")?;
        let median = |values: &[f64; 11]| values[5];
        writeln!(
            f,
            "medians: convergence floor {:.3} nats, diagonal of a voxel {:.3}",
            median(&self.floor),
            median(&self.voxels)
        )?;
        let octaves = [
            ("path samples", &self.path_samples),
            ("photons", &self.photons),
            ("counted nodes", &self.counted_nodes),
            ("target nodes", &self.target_nodes),
            ("target samples", &self.target_samples),
        ];
        writeln!(f, "pairs by powers of two, from 1 on:")?;
        for (name, counts) in octaves {
            let counts: Vec<String> = counts.iter().map(|n| format!("{n:>6}")).collect();
            writeln!(f, "  {name:<15}{}", counts.join(""))?;
        }
        Ok(())
    }
}

fn diagonal(pair: &TreeSample) -> f64 {
    let side = |axis: usize| f64::from(pair.bounds[axis + 3] - pair.bounds[axis]);
    (0..3).map(|axis| side(axis).powi(2)).sum::<f64>().sqrt()
}

fn octaves(values: impl Iterator<Item = u64>) -> Octaves {
    let mut counts = vec![];
    for value in values {
        let octave = value.max(1).ilog2() as usize;
        counts.resize(counts.len().max(octave + 1), 0);
        counts[octave] += 1;
    }
    counts
}

fn deciles(mut values: Vec<f64>) -> [f64; 11] {
    values.sort_by(f64::total_cmp);
    std::array::from_fn(|k| values[(values.len() - 1) * k / 10])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Settings, tree_samples};
    use fanal::render::{GuideMode, RenderSettings, StopRule};

    #[test]
    fn every_pair_is_counted_once() {
        let (train, held_out) =
            (tree_samples(&Settings::default(), 1, 0, 30), tree_samples(&Settings::default(), 1, 90, 5));
        let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
        let data = Dataset { mode, train, held_out };
        let statistics = Statistics::new(std::slice::from_ref(&data)).unwrap();
        for counts in
            [&statistics.path_samples, &statistics.photons, &statistics.target_nodes, &statistics.target_levels]
        {
            assert_eq!(counts.iter().sum::<u64>(), 35);
        }
        assert_eq!(statistics.kinds.iter().sum::<u64>(), 35);
        assert!(statistics.floor.is_sorted() && statistics.voxels.is_sorted());
        assert!(plot::panels(&statistics.panels(), 2).unwrap().contains("</svg>"));
        assert!(Statistics::new(&[Dataset { train: vec![], held_out: vec![], ..data }]).is_err());
    }

    #[test]
    fn octaves_are_powers_of_two() {
        assert_eq!(octaves([0, 1, 2, 3, 9].into_iter()), [2, 2, 0, 1]);
    }
}
