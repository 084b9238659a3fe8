//! How a path gets from one vertex to the next: by kernels of either kind.

use glam::Vec3;

use super::kernel::Kernel;
use super::spatial::{InMedium, Reach, SpatialKernel};

/// The distribution of a vertex given the one before.
#[derive(Debug, Clone)]
pub enum Transition {
    /// From surface to surface.
    Planar(Kernel),
    /// From a medium, or to one.
    Spatial(Box<SpatialKernel>),
}

impl Transition {
    /// See [`Kernel::fit`].
    pub fn fit(three: [Vec3; 3], within: InMedium, pairs: impl Iterator<Item = [Vec3; 2]>, footprint: f32) -> Self {
        if within.before || within.at {
            Self::Spatial(Box::new(SpatialKernel::fit(three, within, pairs, footprint)))
        } else {
            Self::Planar(Kernel::fit(three, pairs, footprint))
        }
    }

    /// What uniform numbers in [0, 1) draw from the point before; `along` is asked for a point in a medium.
    #[inline]
    pub fn sample(&self, from: Vec3, across: [f64; 2], along: impl FnOnce() -> [f64; 2]) -> Option<Reach> {
        match self {
            Self::Planar(kernel) => Some(Reach { direction: kernel.sample(from, across)?, distance: None }),
            Self::Spatial(kernel) => kernel.sample(from, across, along()),
        }
    }

    /// Density of [`Transition::sample`], w.r.t. solid angle and, in a medium, distance.
    #[inline]
    pub fn density(&self, from: Vec3, direction: Vec3, to: Vec3) -> f32 {
        match self {
            Self::Planar(kernel) => kernel.density(from, direction),
            Self::Spatial(kernel) => kernel.density(from, direction, to),
        }
    }

    /// Density of the distance in a direction that was chosen otherwise; 1 on a surface.
    #[inline]
    pub fn distance_density(&self, from: Vec3, direction: Vec3, to: Vec3) -> f32 {
        match self {
            Self::Planar(_) => 1.0,
            Self::Spatial(kernel) => kernel.distance_density(from, direction, to),
        }
    }

    /// The distance in a direction that was chosen otherwise, where the vertex lies in a medium; none where it leads nowhere.
    pub fn distance(&self, from: Vec3, direction: Vec3, u: [f64; 2]) -> Option<f32> {
        match self {
            Self::Planar(_) => None,
            Self::Spatial(kernel) => kernel.distance(from, direction, u),
        }
    }
}
