//! Path guiding: directional quadtrees in a spatial cache, what is deposited into them, and the distributions they yield.

pub mod cache;
pub mod distribution;
pub mod features;
pub mod field;
pub mod learner;
pub mod quadtree;
pub mod record;
pub mod sampler;
pub mod targets;
pub mod topology;
