//! Training data: procedural scenes, and the shards in which pairs of noisy and converged quadtrees are stored.

pub mod dataset;
pub mod shard;
