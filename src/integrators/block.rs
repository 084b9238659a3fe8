//! Blocks of paths: a range of numbers in, radiance, records and photons of their paths out, in the order of the numbers. A pass knows
//! this interface alone, so that a tracer of many paths at once can stand beside the one that traces them one by one.

use std::ops::Range;

use glam::Vec3;

use super::path::{Cause, PathScratch, PathTracer, RayCount};
use super::photon::PhotonTracer;
use crate::base::random::Random;
use crate::geometry::Ray;
use crate::guiding::learn::emission::Start;
use crate::guiding::record::{PathRecord, PhotonRecord};

/// The beginning of a camera path.
pub struct CameraPath {
    /// The camera's ray.
    pub ray: Ray,
    /// Random numbers of the path.
    pub random: Random,
    /// About the value of its pixel; none where nothing is known of it. See [`PathTracer::trace`].
    pub pixel: Option<f32>,
}

/// Camera paths of consecutive numbers.
#[derive(Default)]
pub struct PathBlock {
    /// Radiance of each path, W·m⁻²·sr⁻¹; not finite for those that are lost.
    pub radiance: Vec<Vec3>,
    /// Records of all paths but the lost ones, in the order of their numbers; empty where none are wanted.
    pub records: Vec<PathRecord>,
    /// Numbers of the paths whose radiance is not finite, and why.
    pub lost: Vec<(u64, Cause)>,
    /// Rays of all paths.
    pub rays: RayCount,
}

/// Light paths of consecutive numbers.
#[derive(Default)]
pub struct PhotonBlock {
    /// Photons that arrived, in the order of their paths' numbers.
    pub photons: Vec<PhotonRecord>,
    /// How each path started; none where there is no light.
    pub starts: Vec<Option<Start>>,
    /// Rays of all paths, and paths that were dropped.
    pub rays: RayCount,
}

impl PathTracer<'_> {
    /// Traces camera paths one by one; `begin` tells how each begins, always the same.
    pub fn trace_block(
        &self,
        numbers: Range<u64>,
        begin: impl Fn(u64) -> CameraPath,
        wants_records: bool,
        scratch: &mut PathScratch,
    ) -> PathBlock {
        let mut block = PathBlock::default();
        block.radiance.reserve((numbers.end - numbers.start) as usize);
        for number in numbers {
            let CameraPath { ray, mut random, pixel } = begin(number);
            let before = block.records.len();
            let records = wants_records.then_some(&mut block.records);
            let radiance = self.trace(ray, &mut random, scratch, pixel, records, &mut block.rays);
            if !radiance.is_finite() {
                // Nothing is learned from it either.
                block.records.truncate(before);
                let CameraPath { ray, mut random, pixel } = begin(number);
                let cause = self.explain(ray, &mut random, pixel).cause.unwrap_or(Cause::Overflow);
                block.lost.push((number, cause));
            }
            block.radiance.push(radiance);
        }
        block
    }
}

impl PhotonTracer<'_> {
    /// Traces light paths one by one, of `paths` in the pass, which are counted from `first`; `random` tells the random numbers of each.
    pub fn trace_block(
        &self,
        numbers: Range<u64>,
        (first, paths): (u64, u64),
        random: impl Fn(u64) -> Random,
    ) -> PhotonBlock {
        let mut block = PhotonBlock::default();
        for number in numbers {
            let path = ((number - first) as u32, paths);
            block.starts.push(self.trace(&mut random(number), path, &mut block.photons, &mut block.rays));
        }
        block
    }
}
