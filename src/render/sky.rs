//! How the sky is seen from where paths get to, found out before a render by paths that are in no picture: rooms see it through windows only.
//!
//! These paths have random numbers of their own and visit the whole picture, or all views that share a render, whatever window is rendered, so
//! every part of a picture and every replayed sample knows the same.

use rayon::prelude::*;

use super::pass::{CameraSample, camera_ray};
use super::settings::{RenderSettings, StopRule};
use crate::film::PixelFilter;
use crate::integrators::path::{CameraPath, PathScratch, PathTracer, RayCount};
use crate::lights::counted::{SkyCounts, SkySampling};
use crate::lights::seen::LearnedSky;
use crate::scene::Scene;

/// Paths, unless the picture has fewer pixels or there is less time.
const PATHS: u64 = 1 << 16;
/// Paths for each second of a budget in seconds, about a hundredth of it. A number and not the clock: who replays a sample, or goes on from
/// a checkpoint, has to find the same.
const EACH_SECOND: f64 = 2048.0;
/// Fewest paths that tell anything.
const LEAST: u64 = 1 << 12;
/// Paths that are traced together.
const BLOCK: u64 = 1 << 10;
/// Makes their random numbers differ from the picture's.
const SEED: u64 = 0x5EE0_0F5E_A5C1_1101;
/// The golden ratio's fraction, as one of 2⁶⁴.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// What is known of the sky before a render; none where there is none, or nothing to gain.
pub(super) fn learned_sky(scene: &Scene, settings: &RenderSettings, filter: &PixelFilter) -> Option<LearnedSky> {
    let map = scene.lights.only_map().filter(|_| settings.transport.light_sampling)?;
    let [width, height] = scene.size;
    let pixels = u64::from(width) * u64::from(height);
    let affordable = match settings.stop {
        StopRule::Time(seconds) => (EACH_SECOND * seconds) as u64,
        StopRule::Spp(_) | StopRule::TargetError(_) => PATHS,
    };
    let paths = PATHS.min(pixels).min(affordable);
    if paths < LEAST {
        return None;
    }
    let settings = &RenderSettings { seed: settings.seed ^ SEED, ..settings.clone() };
    let counts = SkyCounts::default();
    let tracer = PathTracer { scene, settings: settings.transport, field: None, sky: SkySampling::Counted(&counts) };
    let begin = |index: u64| {
        // Evenly spread over the picture, however many there are: steps of the golden ratio.
        let place = ((u128::from(index.wrapping_mul(GOLDEN)) * u128::from(pixels)) >> 64) as u64;
        let sample = CameraSample {
            place: [(place % u64::from(width)) as u32, (place / u64::from(width)) as u32],
            number: index,
            sequences_from: None,
        };
        let (ray, random) = camera_ray(scene, settings, filter, sample);
        CameraPath { ray, random, pixel: None }
    };
    let block = |scratch: &mut PathScratch, block: u32| {
        let first = u64::from(block) * BLOCK;
        let numbers = first..(first + BLOCK).min(paths);
        tracer.trace_all(numbers.map(begin), false, scratch, &mut RayCount::default());
    };
    let blocks = (0..paths.div_ceil(BLOCK) as u32).into_par_iter().with_max_len(1);
    blocks.for_each_init(PathScratch::default, block);
    counts.learned(map)
}
