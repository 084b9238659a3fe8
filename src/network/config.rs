//! What a model is: architecture, features, and the mode that its training data was made in.

use serde::{Deserialize, Serialize};

/// The only version of model folders so far.
pub const VERSION: u32 = 1;

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
    /// Input channels per node, F; must equal what this version of the renderer computes.
    pub features: usize,
    /// Separate weights for every level (Zhu 2021) instead of shared ones with a level channel.
    pub per_level: bool,
    /// Probability above which a decoded node becomes a leaf.
    pub leaf_threshold: f32,
    /// A decoded node is split only while it holds more than this share of its tree.
    pub min_split_share: f32,
    /// Uniform part mixed into every reconstructed distribution, tuned by `eval`.
    pub uniform: f32,
    /// What the training data was made with.
    pub mode: Mode,
}

/// The sampling mode that trees were collected in; a model serves only the mode that it was trained for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// `radiance` or `variance`.
    pub target: String,
    /// Whether next event estimation was on, and so left out of the trees.
    pub nee: bool,
    /// Whether Russian roulette was on.
    pub roulette: bool,
    /// Share of a tree's total above which a node is split, ρ.
    pub split_share: f32,
}
