//! The frozen mixture of a voxel, which is sampled.

use std::f64::consts::PI;

use glam::Vec3;

use super::MOST;
use super::columns::Columns;
use super::gaussian::Gaussian;
use crate::math::cylindrical;

/// Part of the uniform sphere, which keeps every density positive.
pub const UNIFORM: f64 = 0.05;

/// Largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// A mixture of Gaussians, with a uniform part.
#[derive(Debug, Clone)]
pub struct GaussianMixture {
    gaussians: Box<[Gaussian]>,
    columns: Columns,
    /// Sum of the weights, which rounding takes off 1.
    total: f64,
}

impl PartialEq for GaussianMixture {
    fn eq(&self, other: &Self) -> bool {
        self.gaussians == other.gaussians
    }
}

impl GaussianMixture {
    /// A mixture of one to [`MOST`] Gaussians, whose weights have the sum 1 to a thousandth.
    ///
    /// # Errors
    /// A sentence saying what is no such Gaussian.
    pub fn new(gaussians: &[Gaussian]) -> Result<Self, String> {
        if gaussians.is_empty() || gaussians.len() > MOST {
            return Err(format!("{} Gaussians, expected 1 to {MOST}", gaussians.len()));
        }
        if let Some(bad) = gaussians.iter().position(|of| !of.is_sound()) {
            return Err(format!("Gaussian {bad} has numbers out of range: {:?}", gaussians[bad]));
        }
        let total: f64 = gaussians.iter().map(|of| f64::from(of.weight)).sum();
        if (total - 1.0).abs() > 1e-3 {
            return Err(format!("weights with the sum {total} instead of 1"));
        }
        Ok(Self { gaussians: gaussians.into(), columns: Columns::of(gaussians), total })
    }

    /// The Gaussians.
    pub fn gaussians(&self) -> &[Gaussian] {
        &self.gaussians
    }

    /// Direction that a point of the unit square maps to, and its density w.r.t. solid angle. Points that are evenly spread stay so within
    /// each Gaussian.
    pub fn sample(&self, [u, v]: [f64; 2]) -> (Vec3, f32) {
        let place = if u < UNIFORM {
            [u / UNIFORM, v]
        } else {
            self.drawn([((u - UNIFORM) / (1.0 - UNIFORM)).min(BELOW_ONE), v])
        };
        let direction = cylindrical::to_direction(place);
        (direction, self.pdf(direction))
    }

    /// Density of [`GaussianMixture::sample`] w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let (_, density) = self.columns.parts(cylindrical::to_square(direction));
        (UNIFORM as f32 + ((1.0 - UNIFORM) / self.total) as f32 * density) / (4.0 * PI) as f32
    }

    /// The place of a point of the unit square under the Gaussians alone.
    fn drawn(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (mut left, mut chosen) = (u * self.total, &self.gaussians[0]);
        for of in self.gaussians.iter().filter(|of| of.weight > 0.0) {
            chosen = of;
            if left < f64::from(of.weight) {
                break;
            }
            left -= f64::from(of.weight);
        }
        chosen.sample([(left / f64::from(chosen.weight)).clamp(0.0, BELOW_ONE), v])
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        Self::bytes_of(self.gaussians.len())
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.gaussians.len()
    }

    /// Whether there are none, which is never.
    pub fn is_empty(&self) -> bool {
        self.gaussians.is_empty()
    }

    /// Bytes of a mixture of so many Gaussians.
    pub(super) fn bytes_of(gaussians: usize) -> usize {
        size_of::<Self>() + gaussians * size_of::<Gaussian>()
    }
}
