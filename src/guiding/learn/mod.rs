//! Learning: statistics of samples in voxels, and the guides, fractions, roulette and photon emission that follow from them.

pub mod adam;
pub mod adjoint;
pub mod emission;
pub mod fraction;
pub mod learner;

mod outliers;
mod sphere;
mod stored;
mod voxel;

/// Fraction of BSDF samples while learning.
const LEARNING_FRACTION: f64 = 0.5;
