//! Parallax-aware mixtures of von Mises-Fisher lobes as a model of directions (Ruppert, Herholz and Lensch 2020, *Robust Fitting of
//! Parallax-Aware Mixtures for Path Guiding*), the model of Open PGL.
//!
//! A voxel has a pivot, its centre, and up to [`MOST`] lobes. Each has a weight, a mean direction as seen from the pivot, a
//! concentration κ and the distance at which its light starts; at another point of the voxel it is aimed at the same place, and
//! multiplied with the cosine of the surface there.
//!
//! - [`lobe`]: one lobe: κ and mean cosine, sampling, products.
//! - [`mixture`]: the frozen mixture of a voxel, which is sampled; `columns`: its lobes in columns, for formulas in lanes.
//! - `component`: a lobe while it learns; `em`: expectation maximisation; `split` and `merge` change the number of lobes.
//! - [`fit`]: the mixture of a voxel while it learns, by all of these.
//! - [`learn`]: the mixtures of all voxels; `stored`: both kinds as arrays of a file.

mod columns;
mod component;
mod em;
pub mod fit;
pub mod learn;
pub mod lobe;
mod merge;
pub mod mixture;
mod split;
pub(in crate::guiding) mod stored;
#[cfg(test)]
mod tests;

/// Largest number of lobes of a mixture (Ruppert 2020 §5.1).
pub const MOST: usize = 32;
