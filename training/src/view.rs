//! Choice of the inputs and pairs that a network is shown: to see how much the context, the photons or the path samples contribute,
//! and whether networks for a range of sample counts are better than one for all.

use std::str::FromStr;

use anyhow::{Result, anyhow};
use fanal::generate::dataset::Dataset;
use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::features::VoxelFeatures;
use fanal::guiding::tree::leaves::{BSDF, COUNTS, NETWORK_CHANNELS, SQUARES, VALUES};
use serde::{Deserialize, Serialize};

use crate::cases::Case;

/// What inputs are made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Inputs {
    /// The voxel's own samples and its surroundings: what the renderer gives.
    #[default]
    All,
    /// The same, but of the surroundings only what is mixed into the counted tree. For measuring: the renderer always gives all.
    Mixed,
    /// The voxel's own path samples and photons.
    Own,
    /// The voxel's own path samples.
    Paths,
    /// The voxel's own photons.
    Photons,
}

/// A range of numbers of samples, written `16..64`; either end may be missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Samples {
    /// The least number.
    pub least: u32,
    /// The first number that is too many; none if there is no limit.
    pub end: Option<u32>,
}

impl Samples {
    /// Whether a number lies in the range.
    fn hold(self, number: u32) -> bool {
        number >= self.least && self.end.is_none_or(|end| number < end)
    }
}

impl FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (least, end) = text.split_once("..").ok_or("a range is written 16..64, 1000.. or ..16")?;
        let number = |text: &str| text.parse::<u32>().map_err(|e| format!("'{text}': {e}"));
        let least = if least.is_empty() { 0 } else { number(least)? };
        let end = if end.is_empty() { None } else { Some(number(end)?) };
        if end.is_some_and(|end| end <= least) {
            return Err("the range is empty".into());
        }
        Ok(Self { least, end })
    }
}

/// A choice of inputs and pairs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct View {
    /// Source of the inputs.
    pub inputs: Inputs,
    /// Range of the own path samples of the pairs that are used.
    pub samples: Samples,
    /// Range of these and photons together.
    #[serde(default)]
    pub both_samples: Samples,
    /// Largest KL between two halves of a target, in nats; none if there is no limit.
    pub floor: Option<f64>,
}

impl View {
    /// Removes from `data` what is not shown. A network that was not shown the context is of another mode.
    ///
    /// # Errors
    /// When a pair is not valid.
    pub fn apply(&self, mut data: Dataset) -> Result<Dataset> {
        for pairs in [&mut data.train, &mut data.held_out] {
            pairs.retain(|pair| {
                let [paths, photons] = pair.voxel_features.samples;
                let converged = self.floor.is_none_or(|most| f64::from(pair.floor_kl) <= most);
                converged && self.samples.hold(paths) && self.both_samples.hold(paths.saturating_add(photons))
            });
            if self.inputs != Inputs::All {
                pairs.iter_mut().try_for_each(|pair| restrict(pair, self.inputs))?;
            }
        }
        if !matches!(self.inputs, Inputs::All | Inputs::Mixed) {
            (data.mode.context, data.mode.past) = (0.0, 0.0);
        }
        Ok(data)
    }
}

/// Makes the pair's input anew from what `inputs` names.
fn restrict(pair: &mut TreeSample, inputs: Inputs) -> Result<()> {
    let alone = TreeSample::default();
    (pair.block_split, pair.block, pair.block_samples) = (alone.block_split, alone.block, alone.block_samples);
    if inputs == Inputs::Mixed {
        return Ok(());
    }
    let kept = [inputs != Inputs::Photons, inputs != Inputs::Paths];
    for row in pair.own_sums.chunks_exact_mut(NETWORK_CHANNELS) {
        for kind in (0..2).filter(|&kind| !kept[kind]) {
            [VALUES, COUNTS, SQUARES].iter().for_each(|channels| row[channels[kind]] = 0.0);
        }
        if !kept[0] {
            row[BSDF] = 0.0;
        }
    }
    let VoxelFeatures { samples, past, path_share, .. } = &mut pair.voxel_features;
    *past = 0.0;
    if kept != [true; 2] {
        // As in renders that have one kind alone.
        *path_share = 0.5;
    }
    for kind in (0..2).filter(|&kind| !kept[kind]) {
        samples[kind] = 0;
    }
    let case = Case::new(pair)?;
    let counted = case.leaves().hybrid(f64::from(pair.voxel_features.path_share));
    pair.counted_split = counted.topology().split_flags();
    pair.counted = counted.leaf_mass().iter().map(|&mass| mass as f32).collect();
    pair.validate().map_err(|e| anyhow!("a pair without its context: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Settings, tree_sample};

    #[test]
    fn ranges_are_read() {
        let range = |text: &str| text.parse::<Samples>();
        assert_eq!(range("16..64"), Ok(Samples { least: 16, end: Some(64) }));
        assert_eq!(range("..16"), Ok(Samples { least: 0, end: Some(16) }));
        assert_eq!(range("1000.."), Ok(Samples { least: 1000, end: None }));
        assert!(range("16").is_err() && range("9..9").is_err() && range("a..b").is_err());
    }

    #[test]
    fn what_is_left_out_leaves_no_trace() {
        let whole = tree_sample(&Settings::default(), 3, 0);
        for inputs in [Inputs::Own, Inputs::Paths, Inputs::Photons] {
            let mut pair = whole.clone();
            restrict(&mut pair, inputs).unwrap();
            let mut other = whole.clone();
            // Data that are not shown may have any value.
            other.counted_split = vec![false];
            other.counted = vec![1.0];
            (other.block_split, other.block) = (vec![true, false, false, false, false], vec![0.25; 4]);
            other.block_samples = [7.0; 2];
            other.voxel_features.past = 7.0;
            for row in other.own_sums.chunks_exact_mut(NETWORK_CHANNELS) {
                match inputs {
                    Inputs::Paths => [VALUES[1], COUNTS[1], SQUARES[1]].iter().for_each(|&c| row[c] = 7.0),
                    Inputs::Photons => [VALUES[0], COUNTS[0], SQUARES[0], BSDF].iter().for_each(|&c| row[c] = 7.0),
                    _ => {}
                }
            }
            restrict(&mut other, inputs).unwrap();
            assert_eq!(pair, other, "{inputs:?}");
            assert_eq!(pair.target, whole.target);
        }
    }
}
