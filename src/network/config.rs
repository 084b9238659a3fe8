//! Configuration of a model: architecture, features, and the mode that its training data was made in.

use std::borrow::Cow;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::{Error, Result};
use crate::guiding::tree::distribution::Distribution;
use crate::guiding::tree::features::FEATURES;
use crate::guiding::tree::topology::MAX_LEVEL;

/// The version of model folders that this program reads. 4: the network sees the block around a voxel, and earlier
/// iterations in counted trees.
pub const VERSION: u32 = 4;

/// Content of a model's `config.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Format version, [`VERSION`].
    pub version: u32,
    /// A name for reports.
    pub name: String,
    /// Feature channels of the hidden layers, C.
    pub width: usize,
    /// Convolutions per level in the encoder and in the decoder each.
    pub convolutions: usize,
    /// Input channels per node, F; must equal [`FEATURES`] of this version of the renderer.
    pub features: usize,
    /// Separate weights for every level (Zhu 2021) instead of shared ones with a level channel.
    pub per_level: bool,
    /// Level of an image network: it reads and writes all cells of that level, an image of 2^level squared pixels (Zhu et al.
    /// 2020, which is what Zhu 2021 compares with), instead of trees that are as deep as their samples. Absent for trees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<usize>,
    /// Probability above which a decoded node becomes a leaf.
    pub leaf_threshold: f32,
    /// A decoded node is split only while it holds more than this share of its tree.
    pub min_split_share: f32,
    /// Uniform part mixed into every reconstructed distribution, tuned in training.
    pub uniform: f32,
    /// Mode that the training data was made in.
    pub mode: Mode,
}

/// The sampling mode that trees were collected in; a model serves only the mode that it was trained for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// `radiance`, `variance` or `variance-pixel`.
    pub target: String,
    /// Whether there was light sampling; `direct` says what trees learned of its light.
    #[serde(rename = "nee")]
    pub light_sampling: bool,
    /// Whether Russian roulette was on.
    pub roulette: bool,
    /// Share of a tree's total above which a node is split, ρ.
    pub split_share: f32,
    /// Part that trees learn of light that light sampling finds too: `nothing`, `weighted` or `all`.
    pub direct: String,
    /// Number of samples that a voxel's surroundings count as.
    pub context: f32,
    /// Part of their number that samples of earlier iterations count as.
    pub past: f32,
}

/// Widths that the embedded path has kernels for.
pub const WIDTHS: [usize; 6] = [8, 16, 24, 32, 48, 64];

/// Deepest level of an image network: 64 × 64 pixels.
pub const IMAGE_LEVELS: usize = 6;

impl Config {
    /// Whether a decoded node at `level` ≥ 1 is split, given its probability of being a leaf and its share of the tree.
    pub fn splits(&self, level: usize, leaf: f32, mass: f32) -> bool {
        match self.image {
            Some(deepest) => level < deepest,
            None => leaf < self.leaf_threshold && mass > self.min_split_share && level < MAX_LEVEL,
        }
    }

    /// The distribution that is encoded: the counted one, on all cells of its level for an image network.
    pub fn encoded<'a>(&self, counted: &'a Distribution) -> Cow<'a, Distribution> {
        match self.image {
            Some(level) => Cow::Owned(counted.on_grid(level)),
            None => Cow::Borrowed(counted),
        }
    }

    /// Checks that this version of the renderer can run the model; `path` is named in the error.
    ///
    /// # Errors
    /// [`Error::Model`] saying which field does not fit and what would.
    pub fn validate(&self, path: &Path) -> Result<()> {
        let unit = |x: f32| (0.0..=1.0).contains(&x);
        let message = if self.version != VERSION {
            format!("format version {}, this renderer reads version {VERSION}", self.version)
        } else if self.features != FEATURES {
            format!("it takes {} features per node, this renderer computes {FEATURES}", self.features)
        } else if !WIDTHS.contains(&self.width) {
            format!("width {} is not one of {WIDTHS:?}", self.width)
        } else if !(1..=4).contains(&self.convolutions) {
            format!("{} convolutions per level, supported are 1 to 4", self.convolutions)
        } else if self.image.is_some_and(|level| !(1..=IMAGE_LEVELS).contains(&level)) {
            format!("image must be a level from 1 to {IMAGE_LEVELS}")
        } else if !unit(self.leaf_threshold) || !unit(self.min_split_share) || !unit(self.uniform) {
            "leaf_threshold, min_split_share and uniform must be between 0 and 1".into()
        } else if !unit(self.mode.split_share) {
            "mode.split_share must be between 0 and 1".into()
        } else {
            return Ok(());
        };
        Err(Error::Model { path: path.to_owned(), message })
    }
}
