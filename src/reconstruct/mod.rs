//! From a noisy quadtree to the distribution that is sampled.

pub mod gaussian;
