//! From what a quadtree has accumulated to the distributions that it stands for.

use std::f64::consts::PI;

use super::distribution::Distribution;
use super::features::{PATH_CHANNELS, RAW_CHANNELS};
use super::topology::Topology;

/// Channel of a raw row that holds ΣV of path samples.
pub const PATH_VALUE: usize = 0;

/// Channel that holds the number of path samples.
pub const PATH_COUNT: usize = 14;

/// Channel that holds ΣV of photons, and the first of their block.
pub const PHOTON_VALUE: usize = PATH_CHANNELS;

/// Channel that holds the number of photons.
pub const PHOTON_COUNT: usize = PHOTON_VALUE + PATH_COUNT;

/// Sampling weight of a leaf at `level` that holds ΣV of squared contributions over the pdf: √(ΣV · A), A its solid angle
/// in sr (Rath 2020; Zhu 2021 eq. 7). Summed over children of equal density it gives the parent's own.
pub fn path_weight(sum: f64, level: usize) -> f64 {
    (sum.max(0.0) * 4.0 * PI * 0.25f64.powi(level as i32)).sqrt()
}

/// Level of every leaf in the order of [`Topology::leaves`].
fn leaf_levels(topology: &Topology) -> impl Iterator<Item = usize> + '_ {
    (0..topology.levels()).flat_map(|l| topology.level(l).filter(|&n| topology.is_leaf(n)).map(move |_| l))
}

fn column(leaf_sums: &[f32], channel: usize) -> impl Iterator<Item = f64> + '_ {
    leaf_sums.chunks_exact(RAW_CHANNELS).map(move |row| f64::from(row[channel]))
}

/// The distribution of the path samples alone; `leaf_sums` is [leaves, [`RAW_CHANNELS`]]. Uniform without samples.
pub fn path_distribution(topology: &Topology, leaf_sums: &[f32]) -> Distribution {
    path_distribution_of(topology, &column(leaf_sums, PATH_VALUE).collect::<Vec<_>>())
}

/// The distribution of path samples with ΣV per leaf given, in the order of [`Topology::leaves`].
pub fn path_distribution_of(topology: &Topology, values: &[f64]) -> Distribution {
    let weights: Vec<f64> = values.iter().zip(leaf_levels(topology)).map(|(&v, level)| path_weight(v, level)).collect();
    Distribution::from_leaf_weights(topology.clone(), &weights)
}

/// The distribution of the photons alone, proportional to their power; uniform without photons.
pub fn photon_distribution(topology: &Topology, leaf_sums: &[f32]) -> Distribution {
    let weights: Vec<f64> = column(leaf_sums, PHOTON_VALUE).collect();
    Distribution::from_leaf_weights(topology.clone(), &weights)
}

/// Half path samples, half photons, each normalised; where one of them is missing, the other alone.
pub fn hybrid_distribution(topology: &Topology, leaf_sums: &[f32]) -> Distribution {
    let has = |channel| column(leaf_sums, channel).any(|v| v > 0.0 && v.is_finite());
    let path = path_distribution(topology, leaf_sums);
    if !has(PHOTON_VALUE) {
        return path;
    }
    let photons = photon_distribution(topology, leaf_sums);
    if has(PATH_VALUE) { Distribution::average(&path, &photons) } else { photons }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(path: [f32; 4], photons: [f32; 4]) -> Vec<f32> {
        let mut rows = vec![0.0; 4 * RAW_CHANNELS];
        for i in 0..4 {
            rows[i * RAW_CHANNELS + PATH_VALUE] = path[i];
            rows[i * RAW_CHANNELS + PHOTON_VALUE] = photons[i];
        }
        rows
    }

    #[test]
    fn weights_of_equal_density_add_up() {
        let parent = path_weight(3.0, 2);
        assert!((4.0 * path_weight(0.75, 3) - parent).abs() < 1e-12);
    }

    #[test]
    fn hybrid_averages_or_takes_what_there_is() {
        let four = Topology::from_split(&[true, false, false, false, false]).unwrap();
        let both = hybrid_distribution(&four, &rows([9., 1., 0., 0.], [0., 0., 0., 5.]));
        assert_eq!(both.leaf_mass(), [0.375, 0.125, 0.0, 0.5]);
        let photons = hybrid_distribution(&four, &rows([0.; 4], [0., 0., 0., 5.]));
        assert_eq!(photons.leaf_mass(), [0., 0., 0., 1.]);
        let none = hybrid_distribution(&four, &rows([0.; 4], [0.; 4]));
        assert_eq!(none, Distribution::uniform());
    }
}
