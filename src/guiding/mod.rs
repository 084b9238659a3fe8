//! Path guiding: directional quadtrees in a spatial cache, what is deposited into them, and the distributions they yield.

mod arrays;
pub mod cache;
pub mod context;
pub mod distribution;
pub mod effort;
pub mod emission;
pub mod features;
pub mod field;
pub mod file;
pub mod fraction;
pub mod leaves;
pub mod learner;
pub mod moments;
pub mod parallax;
pub mod past;
pub mod proposal;
pub mod quadtree;
pub mod record;
pub mod sampler;
pub mod topology;
