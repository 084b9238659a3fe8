//! Backends that run the network's steps: plain slices in, plain vectors out, so that the embedded path and onnxruntime are
//! interchangeable.

use crate::base::Result;

/// Inputs of the encoder's step; row-major, N = `rows`, possibly 0.
#[derive(Debug, Clone, Copy)]
pub struct EncodeInputs<'a> {
    /// Number of rows, N.
    pub rows: usize,
    /// [N, F] input features of the nodes.
    pub features: &'a [f32],
    /// [N, C] mean of the four children's outputs; zero rows where there are none.
    pub pooled: &'a [f32],
    /// [N, 9] rows of the 3 × 3 cells around each node; N marks a missing neighbour.
    pub neighbours: &'a [u32],
}

/// Inputs of the decoder's step; row-major, N = `rows` is a multiple of four, possibly 0.
#[derive(Debug, Clone, Copy)]
pub struct DecodeInputs<'a> {
    /// Number of rows, N.
    pub rows: usize,
    /// [P, C] features of the level above; those of the encoder's root for level 1.
    pub parents: &'a [f32],
    /// [N] rows of `parents`.
    pub parent_index: &'a [u32],
    /// [N, C] output of the encoder where Q_h has the node, else zero.
    pub skip: &'a [f32],
    /// [N, [`GEOMETRY`](super::program::GEOMETRY)] place and densities of the nodes.
    pub geometry: &'a [f32],
    /// [N] logarithm of the share that the logit corrects.
    pub base: &'a [f32],
    /// [N, 9] rows of the 3 × 3 cells around each node; N marks a missing neighbour.
    pub neighbours: &'a [u32],
}

/// Outputs of the decoder's step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DecodeOutput {
    /// [N, C] features of the nodes, `parents` of the level below.
    pub decoded: Vec<f32>,
    /// [N] logit of the share among the four siblings.
    pub share_logit: Vec<f32>,
    /// [N] share of the parent; the four siblings' sum to 1.
    pub share: Vec<f32>,
    /// [N] logit of being a leaf.
    pub leaf_logit: Vec<f32>,
    /// [N] probability of being a leaf.
    pub leaf: Vec<f32>,
}

/// Runs the steps of one model.
pub trait Backend: Sync {
    /// Name in messages and statistics.
    fn name(&self) -> &'static str;

    /// The encoder's output [N, C] at `level`.
    ///
    /// # Errors
    /// [`Error::Backend`](crate::base::Error::Backend) for inputs whose sizes or indices do not fit, or a failed run.
    fn encode(&self, level: usize, inputs: &EncodeInputs) -> Result<Vec<f32>>;

    /// The decoder's outputs at `level` ≥ 1.
    ///
    /// # Errors
    /// As [`Backend::encode`].
    fn decode(&self, level: usize, inputs: &DecodeInputs) -> Result<DecodeOutput>;
}
