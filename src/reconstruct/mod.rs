//! From the quadtree that accumulated samples (Q_h) to the one that is sampled (Q_r).

pub mod gaussian;
pub mod neural;
#[cfg(feature = "onnx")]
pub mod onnx;

mod growth;

use crate::guiding::topology::Topology;

/// A tree to reconstruct.
#[derive(Debug, Clone, Copy)]
pub struct TreeInput<'a> {
    /// Its shape.
    pub topology: &'a Topology,
    /// [leaves, [`RAW_CHANNELS`](crate::guiding::features::RAW_CHANNELS)] in the order of [`Topology::leaves`].
    pub leaf_sums: &'a [f32],
}

/// A reconstructed distribution.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstructed {
    /// Its shape.
    pub topology: Topology,
    /// Per node its share of the parent, ≥ 0; four siblings' sum to 1 up to rounding, the root's is 1.
    pub node_share: Vec<f32>,
}
