//! Path guiding: directional quadtrees in a spatial cache, what is deposited into them, and the distributions they yield.

pub mod distribution;
pub mod features;
pub mod targets;
pub mod topology;
