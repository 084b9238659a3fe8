//! How alike the trees of several data sets are, such as those of the generator and of scenes by others: the distributions of what
//! tells trees apart, side by side.

use std::fmt::{Display, Formatter};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use fanal::generate::dataset::Dataset;
use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::distribution::Distribution;
use rayon::prelude::*;
use serde::Serialize;

use crate::cases::Case;
use crate::plot::{self, Panel};

/// Pairs of a data set that are looked at.
const MOST_PAIRS: usize = 20_000;
/// Level of the quadtree on whose cells peaks are counted, 16 × 16 of them.
const PEAK_LEVEL: usize = 4;
/// Density of a peak at least, relative to the mean over all directions.
const PEAK: f64 = 2.0;

/// What is compared, in the order of [`traits`].
const TRAITS: [&str; 6] = [
    "levels of the target",
    "target: nats below the uniform sphere",
    "target: peaks",
    "share of the target that the BSDF covers",
    "half the voxel over the distance of its light",
    "nodes of the counted tree",
];

/// Levels of the target, its KL divergence from the uniform distribution (nats), its [`peaks`], the mass that it has in common with the
/// distribution of BSDF samples, the voxel's nearness, nodes of the counted tree.
fn traits(pair: &TreeSample) -> Result<[f64; TRAITS.len()]> {
    let case = Case::new(pair)?;
    let (masses, bsdf) = (case.target.leaf_mass(), case.bsdf.leaf_mass());
    let topology = case.target.topology();
    let areas = topology.leaves().map(|leaf| 0.25f64.powi(topology.level_of(leaf) as i32));
    let below = masses.iter().zip(areas).filter(|(m, _)| **m > 0.0).map(|(m, a)| m * (m / a).ln()).sum();
    let covered = masses.iter().zip(&bsdf).map(|(a, b)| a.min(*b)).sum();
    let nearness = f64::from(case.voxel_features.nearness);
    let levels = (topology.levels() - 1) as f64;
    Ok([levels, below, peaks(&case.target) as f64, covered, nearness, case.counted.topology().len() as f64])
}

/// Cells of a 16 × 16 grid with at least twice the mean density that none of the eight cells around exceeds; of cells alike that touch
/// the first in the order of rows counts. The grid goes on around, not beyond the poles.
fn peaks(of: &Distribution) -> usize {
    let side = 1i64 << PEAK_LEVEL;
    let mass = |x: i64, y: i64| of.cell_mass(PEAK_LEVEL, [x, y].map(|at| at.rem_euclid(side) as u32));
    let least = PEAK / (side * side) as f64;
    let is_peak = |x: i64, y: i64| {
        let own = mass(x, y);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [dx, dy])).filter(|d| *d != [0, 0]);
        // The first coordinate is the height.
        let mut inside = around.filter(|d| (0..side).contains(&(x + d[0])));
        own >= least
            && inside.all(|[dx, dy]| {
                let other = mass(x + dx, y + dy);
                if [dx, dy] < [0, 0] { own > other } else { own >= other }
            })
    };
    (0..side).flat_map(|x| (0..side).map(move |y| (x, y))).filter(|&(x, y)| is_peak(x, y)).count()
}

/// Traits of one data set.
#[derive(Debug, Clone, Serialize)]
pub struct Set {
    /// Name of the folder.
    pub name: String,
    /// Pairs that were looked at.
    pub pairs: usize,
    /// Deciles of every trait, from the least to the largest.
    pub deciles: [[f64; 11]; TRAITS.len()],
    /// Kolmogorov-Smirnov distance of every trait to that of the last set: the largest difference of their distribution functions.
    pub distance: [f64; TRAITS.len()],
}

/// Data sets side by side; the last is what the others are compared with.
#[derive(Debug, Clone, Serialize)]
pub struct Likeness {
    /// The traits' names.
    pub traits: [&'static str; TRAITS.len()],
    /// The data sets.
    pub sets: Vec<Set>,
}

impl Likeness {
    /// Looks at all pairs of named data sets, or evenly drawn ones of large sets.
    ///
    /// # Errors
    /// Where a set has no pairs, or an invalid one.
    pub fn new(sets: &[(String, Dataset)]) -> Result<Self> {
        let sorted = |(name, data): &(String, Dataset)| -> Result<[Vec<f64>; TRAITS.len()]> {
            let all: Vec<&TreeSample> = data.train.iter().chain(&data.held_out).collect();
            ensure!(!all.is_empty(), "{name} has no trees");
            let pairs: Vec<&TreeSample> = all.iter().copied().step_by(all.len().div_ceil(MOST_PAIRS)).collect();
            let found: Vec<[f64; TRAITS.len()]> = pairs.into_par_iter().map(traits).collect::<Result<_>>()?;
            Ok(std::array::from_fn(|t| {
                let mut values: Vec<f64> = found.iter().map(|traits| traits[t]).collect();
                values.sort_by(f64::total_cmp);
                values
            }))
        };
        let values = sets.iter().map(sorted).collect::<Result<Vec<_>>>()?;
        let last = values.last().context("there are no data sets")?;
        let set = |((name, _), values): (&(String, Dataset), &[Vec<f64>; TRAITS.len()])| Set {
            name: name.clone(),
            pairs: values[0].len(),
            deciles: std::array::from_fn(|t| std::array::from_fn(|k| values[t][(values[t].len() - 1) * k / 10])),
            distance: std::array::from_fn(|t| distance(&values[t], &last[t])),
        };
        Ok(Self { traits: TRAITS, sets: sets.iter().zip(&values).map(set).collect() })
    }

    /// Writes `likeness.json` and `likeness.svg` into `folder`.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        plot::write(folder, "likeness", self, &self.panels())
    }

    fn panels(&self) -> Vec<Panel> {
        let panel = |t: usize| Panel {
            title: format!("{}: deciles", TRAITS[t]),
            labels: (0..=10).map(|k| format!("{} %", 10 * k)).collect(),
            // The largest ones would leave no room for the others.
            series: self.sets.iter().map(|set| (set.name.clone(), set.deciles[t][..10].to_vec())).collect(),
            bars: false,
        };
        (0..TRAITS.len()).map(panel).collect()
    }
}

impl Display for Likeness {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "first, fifth (median) and ninth decile of each set, and its Kolmogorov-Smirnov distance to the last"
        )?;
        for (t, name) in TRAITS.iter().enumerate() {
            writeln!(f, "{name}")?;
            for set in &self.sets {
                let [low, median, high] = [1, 5, 9].map(|k| set.deciles[t][k]);
                let (name, distance) = (&set.name, set.distance[t]);
                writeln!(f, "  {name:<20}{low:>10.3}{median:>10.3}{high:>10.3}{distance:>10.3}")?;
            }
        }
        Ok(())
    }
}

/// Largest difference between the distribution functions of two sorted samples.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let below = |values: &[f64], x: f64| values.partition_point(|v| *v <= x) as f64 / values.len() as f64;
    a.iter().chain(b).map(|&x| (below(a, x) - below(b, x)).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use fanal::guiding::tree::topology::Topology;
    use fanal::render::{GuideMode, RenderSettings, StopRule};

    use super::*;
    use crate::synthetic::{Settings, tree_samples};

    #[test]
    fn distances_are_those_of_distribution_functions() {
        assert_eq!(distance(&[1.0, 2.0], &[1.0, 2.0]), 0.0);
        assert_eq!(distance(&[1.0, 2.0], &[3.0]), 1.0);
        assert_eq!(distance(&[1.0, 2.0, 3.0, 4.0], &[3.0, 4.0]), 0.5);
    }

    #[test]
    fn peaks_stand_apart() {
        assert_eq!(peaks(&Distribution::uniform()), 0);
        // Quarters of 1 % and 97 %: of the bright one's 64 cells, all alike, the first is the peak.
        let mut split = vec![true];
        split.extend([false; 4]);
        let tree = Topology::from_split(&split).unwrap();
        assert_eq!(peaks(&Distribution::from_leaf_weights(tree, &[0.97, 0.01, 0.01, 0.01])), 1);
    }

    #[test]
    fn data_are_like_themselves() {
        let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
        let data = |first| Dataset {
            mode: mode.clone(),
            train: tree_samples(&Settings::default(), 1, first, 40),
            held_out: vec![],
        };
        let sets = [("a".to_owned(), data(0)), ("b".to_owned(), data(90)), ("b".to_owned(), data(90))];
        let likeness = Likeness::new(&sets).unwrap();
        assert_eq!(likeness.sets[1].distance, [0.0; TRAITS.len()]);
        assert!(likeness.sets[0].distance.iter().any(|&d| d > 0.0));
        // Nothing can cover more than all of a target, nor less than nothing.
        assert!(likeness.sets[0].deciles[3].iter().all(|d| (0.0..=1.0 + 1e-6).contains(d)));
        assert!(plot::panels(&likeness.panels(), 2).unwrap().contains("</svg>"));
        assert!(Likeness::new(&[]).is_err());
    }
}
