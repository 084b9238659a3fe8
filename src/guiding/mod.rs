//! Path guiding: what is learned of where light comes from, voxel by voxel, and what is sampled from then on.
//!
//! Data flow, once per pass of a render:
//!
//! ```text
//! integrators ──► record ──► samples ──► learn ──► model ──► sample ──► integrators
//!                 PathRecord  by voxel   Learner   Trees or   GuideField
//!                 PhotonRecord (cache)   Voxel     Histograms VoxelGuide
//! ```
//!
//! - [`record`]: what happened at a vertex; [`target`]: what of that is learned; [`moments`]: how guides are judged by it.
//! - [`cache`]: voxels, and how directions are carried between their points; [`samples`]: records by voxel.
//! - [`tree`], [`jensen`]: models of directions; [`model`]: what they have in common.
//! - [`sample`]: the frozen field, its files, and the roulette that goes by it.
//! - [`learn`]: the learner, with all that it learns beside directions.
//!
//! Each uses what stands above it alone.

pub mod cache;
pub mod jensen;
pub mod learn;
pub mod model;
pub mod moments;
pub mod record;
pub mod sample;
pub mod samples;
pub mod target;
pub mod tree;
