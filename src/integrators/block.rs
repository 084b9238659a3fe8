//! Blocks of paths: a range of numbers in, radiance, records and photons of their paths out, in the order of the numbers. A pass knows
//! this interface alone.

use std::ops::Range;

use glam::Vec3;

use super::path::{CameraPath, Cause, PathScratch, PathTracer, RayCount, Wants};
use super::photon::{PhotonBlock, PhotonScratch, PhotonTracer};
use crate::base::random::Random;
use crate::guiding::record::PathRecord;

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

impl PathTracer<'_> {
    /// Traces camera paths; `begin` adds how those of these numbers begin, always the same.
    pub fn trace_block(
        &self,
        numbers: Range<u64>,
        begin: impl Fn(Range<u64>, &mut Vec<CameraPath>),
        wants_records: bool,
        scratch: &mut PathScratch,
    ) -> PathBlock {
        let mut block = PathBlock::default();
        block.radiance.reserve((numbers.end - numbers.start) as usize);
        let mut begun = std::mem::take(&mut scratch.begun);
        begin(numbers.clone(), &mut begun);
        let wants = if wants_records { Wants::Records } else { Wants::Radiance };
        self.trace_all(begun.drain(..), wants, scratch, &mut block.rays);
        for (index, number) in numbers.enumerate() {
            let before = block.records.len();
            let radiance = self.radiance(index, scratch, wants_records.then_some(&mut block.records));
            if !radiance.is_finite() {
                // Nothing is learned from it either.
                block.records.truncate(before);
                begin(number..number + 1, &mut begun);
                let cause = begun.pop().and_then(|path| self.explain(path).cause);
                block.lost.push((number, cause.unwrap_or(Cause::Overflow)));
            }
            block.radiance.push(radiance);
        }
        scratch.begun = begun;
        block
    }
}

impl PhotonTracer<'_> {
    /// Traces light paths, of `paths` in the pass, which are counted from `first`; `random` tells the random numbers of each.
    pub fn trace_block(
        &self,
        numbers: Range<u64>,
        (first, paths): (u64, u64),
        random: impl Fn(u64) -> Random,
        scratch: &mut PhotonScratch,
    ) -> PhotonBlock {
        let mut block = PhotonBlock::default();
        self.trace_all(numbers.map(|number| ((number - first) as u32, random(number))), paths, scratch, &mut block);
        block
    }
}
