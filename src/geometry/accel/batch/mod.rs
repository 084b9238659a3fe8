//! Queries in batches, which answer every ray as [`Accel::intersect`] and [`Accel::occluded`] do, to the last bit.
//!
//! What slows a single ray down are branches that cannot be predicted, and waiting for memory. Many rays at a time need neither.

#[cfg(target_arch = "x86_64")]
mod bundle;
#[cfg(target_arch = "x86_64")]
mod flight;
#[cfg(target_arch = "x86_64")]
mod lanes;
mod pace;
#[cfg(target_arch = "x86_64")]
mod run;
#[cfg(target_arch = "x86_64")]
mod sixteen;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod triangles;
#[cfg(target_arch = "x86_64")]
mod vectors;
#[cfg(target_arch = "x86_64")]
mod walls;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
mod wide;

#[cfg(target_arch = "x86_64")]
use super::traverse::Kernel;
use super::{Accel, Hit, Met};
use crate::geometry::Ray;
#[cfg(target_arch = "x86_64")]
use bundle::Bundle;
#[cfg(target_arch = "x86_64")]
use flight::Flight;

pub use pace::{Pace, RayKind};

/// Ways to answer a batch. Answers do not depend on it, only the time they take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Bundles of sixteen rays of the same octant and main axis, which go from node to node together as long as enough of them do. For
    /// rays that lie close together, like those of a camera. Needs AVX2, and is as the last without it.
    Bundles,
    /// Many rays at a time, each of which takes a step in turn. Needs AVX2, and is as the next without it.
    InFlight,
    /// One ray after the other.
    Single,
}

impl Way {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Bundles, Self::InFlight, Self::Single];
}

/// Memory of batches, to be used again.
#[derive(Default)]
pub struct Scratch {
    #[cfg(target_arch = "x86_64")]
    flight: Flight,
    #[cfg(target_arch = "x86_64")]
    bundle: Bundle,
    /// Classes of rays, and numbers of rays sorted by class.
    #[cfg(target_arch = "x86_64")]
    classes: Vec<u8>,
    #[cfg(target_arch = "x86_64")]
    sorted: Vec<u32>,
}

impl Accel {
    /// Sets `hits` to the nearest hit of each ray, as [`Accel::intersect`] finds it.
    ///
    /// # Panics
    /// Panics where there are not as many hits as rays.
    pub fn intersect_all(&self, rays: &[Ray], way: Way, scratch: &mut Scratch, hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len());
        #[cfg(target_arch = "x86_64")]
        if way != Way::Single && !matches!(self.hierarchy.kernel, Kernel::Portable) {
            return self.intersect_wide(rays, way, scratch, hits);
        }
        // Of these two plain Rust needs neither.
        let _ = (way, scratch);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.intersect(ray);
        }
    }

    /// Sets `occluded` to whether anything lies on each ray before its maximum distance, as [`Accel::occluded`] finds it.
    ///
    /// # Panics
    /// Panics where there are not as many answers as rays.
    pub fn occluded_all(&self, rays: &[(Ray, f32)], way: Way, scratch: &mut Scratch, occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len());
        #[cfg(target_arch = "x86_64")]
        if way != Way::Single && !matches!(self.hierarchy.kernel, Kernel::Portable) {
            return self.occluded_wide(rays, way, scratch, occluded);
        }
        // Of these two plain Rust needs neither.
        let _ = (way, scratch);
        for ((ray, t_max), occluded) in rays.iter().zip(occluded) {
            *occluded = self.occluded(ray, *t_max);
        }
    }

    /// Sets `met` to what each ray meets before its maximum distance, as [`Accel::meets`] finds it.
    ///
    /// # Panics
    /// Panics where there are not as many answers as rays.
    pub fn meets_all(&self, rays: &[(Ray, f32)], solid: &[bool], way: Way, scratch: &mut Scratch, met: &mut [Met]) {
        assert_eq!(rays.len(), met.len());
        #[cfg(target_arch = "x86_64")]
        if way != Way::Single && !matches!(self.hierarchy.kernel, Kernel::Portable) {
            return self.meets_wide(rays, solid, way, scratch, met);
        }
        // Of these two plain Rust needs neither.
        let _ = (way, scratch);
        for ((ray, t_max), met) in rays.iter().zip(met) {
            *met = self.meets(ray, *t_max, solid);
        }
    }
}
