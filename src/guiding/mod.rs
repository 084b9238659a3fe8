//! Path guiding: distributions of the directions that light comes from, learned voxel by voxel and sampled from then on.
//!
//! Data flow, once per pass of a render:
//!
//! ```text
//! integrators ──► record ──► samples ──► learn ──► model ──► sample ──► integrators
//!                 PathRecord  by voxel   Learner   Trees,      GuideField
//!                 PhotonRecord (cache)   Voxel     Histograms, VoxelGuide
//!                                                  VmfMixtures,
//!                                                  GaussianMixtures
//! ```
//!
//! - [`record`]: records of path vertices; [`target`]: the value that is learned of a record; [`moments`]: measures of guides.
//! - [`cache`]: voxels, and the map of directions between their points; [`samples`]: records by voxel.
//! - [`tree`], [`jensen`], [`vmf`], [`gmm`]: models of directions; [`mixtures`]: what the last two have in common; [`model`]: the common
//!   interface of all.
//! - [`paths`]: complete paths that are kept and followed, which need none of these.
//! - [`sample`]: the frozen field, its files, and the roulette that goes by it.
//! - [`learn`]: the learner, with all that it learns beside directions.
//!
//! Each uses only those above it.

pub mod cache;
pub mod gmm;
pub mod jensen;
pub mod learn;
pub mod mixtures;
pub mod model;
pub mod moments;
pub mod paths;
pub mod record;
pub mod sample;
pub mod samples;
pub mod target;
pub mod tree;
pub mod vmf;
