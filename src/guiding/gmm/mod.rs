//! Mixtures of Gaussians as a model of directions, learned by stepwise expectation maximisation (Vorba, Karlík, Šik, Ritschel and Křivánek
//! 2014, *On-line Learning of Parametric Mixture Models for Light Transport Simulation*).
//!
//! A voxel has up to [`MOST`] Gaussians with full covariances on the unit square of [`cylindrical`](crate::math::cylindrical). There φ
//! wraps, and so do they; at the poles they are cut, and normalised within. Both are exact: along z they are a truncated normal
//! distribution, and across it, given z, a wrapped one.
//!
//! - [`gaussian`]: one Gaussian; `columns`: all of a mixture in columns, for formulas in lanes; [`mixture`]: what is sampled.
//! - `component`: a Gaussian while it learns; [`fit`]: the mixture of a voxel while it learns.
//! - [`learn`]: the mixtures of all voxels; `stored`: both kinds as arrays of a file.

mod columns;
mod component;
pub mod fit;
pub mod gaussian;
pub mod learn;
pub mod mixture;
pub(in crate::guiding) mod stored;
#[cfg(test)]
mod tests;

/// Largest number of Gaussians of a mixture.
pub const MOST: usize = 8;
