//! What is found out of the lights before a render by paths that are in no picture: rooms see the sky through windows only, and of the lights
//! those that are in the same room.
//!
//! These paths have random numbers of their own and visit the whole picture, or all views that share a render, whatever window is rendered, so
//! every part of a picture and every replayed sample knows the same.

use rayon::prelude::*;

use super::camera::{CameraSample, camera_ray};
use super::settings::{RenderSettings, StopRule};
use crate::film::PixelFilter;
use crate::integrators::path::{CameraPath, PathScratch, PathTracer, RayCount, Wants};
use crate::lights::counted::SkyCounts;
use crate::lights::learned::{LearnedLights, LightSampling};
use crate::lights::places::LightPlaces;
use crate::lights::tried::{Trial, WORTH};
use crate::math::channel_mean;
use crate::scene::Scene;

/// Paths, unless the picture has fewer pixels or there is less time.
const PATHS: u64 = 1 << 16;
/// Paths for each second of a budget in seconds, about a hundredth of it.
const EACH_SECOND: f64 = 2048.0;
/// Samples of the picture for each path, where there is no sky: of lights with a place alone less is known soon enough.
const EACH_SAMPLE: u64 = 128;
/// Part of these paths that find out whether the others are worth it.
const FIRST: u64 = 8;
/// Second moment with what the first have found over that without, above which there are no others.
const PROMISING: f64 = 0.8;
/// Fewest paths that tell anything.
const LEAST: u64 = 1 << 12;
/// Paths that are traced together.
const BLOCK: u64 = 1 << 10;
/// Trials that are kept of a block, those of later vertices left out: they bring less.
const TRIALS: usize = 4 * BLOCK as usize;
/// Makes their random numbers differ from the picture's.
const SEED: u64 = 0x5EE0_0F5E_A5C1_1101;
/// The golden ratio's fraction, as one of 2⁶⁴.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
/// Paths in each of the squares of the picture whose values trials are judged by.
const IN_SQUARE: f64 = 64.0;
/// Part of the picture's mean that is added to the value of a square.
const LEAST_VALUE: f32 = 0.1;

/// What is known of the lights before a render: nothing where there are none to choose among, or nothing to gain.
pub(super) fn learned_lights(scene: &Scene, settings: &RenderSettings, filter: &PixelFilter) -> LearnedLights {
    let (map, places) = (scene.lights.only_map(), scene.lights.has_places());
    let [width, height] = scene.size;
    let pixels = u64::from(width) * u64::from(height);
    let affordable = match settings.stop {
        StopRule::Time(seconds) => (EACH_SECOND * seconds) as u64,
        StopRule::Spp(spp) if map.is_none() => pixels.saturating_mul(spp.into()) / EACH_SAMPLE,
        StopRule::Spp(_) | StopRule::TargetError(_) => PATHS,
    };
    let paths = PATHS.min(pixels).min(affordable);
    if paths < LEAST || !settings.transport.light_sampling || (map.is_none() && !places) {
        return LearnedLights::default();
    }
    let settings = &RenderSettings { seed: settings.seed ^ SEED, ..settings.clone() };
    let counts = SkyCounts::default();
    let lights = LightSampling::Counted(&counts);
    let tracer = PathTracer { scene, settings: settings.transport, field: None, lights };
    let mut probe = Probe { tracer, settings, filter, pixels, blocks: Vec::new() };
    if let Some(map) = map {
        probe.trace(paths);
        return LearnedLights { sky: counts.learned(map), places: if places { probe.places(WORTH) } else { None } };
    }
    probe.trace((paths / FIRST).max(LEAST));
    let places = probe.places(PROMISING).and_then(|_| {
        probe.trace(paths);
        probe.places(WORTH)
    });
    LearnedLights { sky: None, places }
}

/// Paths that find out what lights bring.
struct Probe<'a> {
    tracer: PathTracer<'a>,
    settings: &'a RenderSettings,
    filter: &'a PixelFilter,
    pixels: u64,
    blocks: Vec<Found>,
}

/// What a block of paths has found: the value of each, and what came of lights that were chosen.
struct Found {
    values: Vec<f32>,
    trials: Vec<Trial>,
}

impl Probe<'_> {
    /// Place of a path in the picture: evenly spread, however many there are, by steps of the golden ratio.
    fn place(&self, number: u64) -> [u32; 2] {
        let place = ((u128::from(number.wrapping_mul(GOLDEN)) * u128::from(self.pixels)) >> 64) as u64;
        let width = u64::from(self.tracer.scene.size[0]);
        [(place % width) as u32, (place / width) as u32]
    }

    fn begin(&self, number: u64) -> CameraPath {
        let sample = CameraSample { place: self.place(number), number, sequences_from: None };
        let (ray, random) = camera_ray(self.tracer.scene, self.settings, self.filter, sample);
        CameraPath { ray, random, pixel: None }
    }

    /// Traces further paths, until there are so many.
    fn trace(&mut self, paths: u64) {
        let block = |scratch: &mut PathScratch, block: u32| {
            let first = u64::from(block) * BLOCK;
            let numbers = first..(first + BLOCK).min(paths);
            let begun = numbers.clone().map(|number| self.begin(number));
            self.tracer.trace_all(begun, Wants::Radiance, scratch, &mut RayCount::default());
            let value = |number| channel_mean(self.tracer.radiance((number - first) as usize, scratch, None));
            let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
            let values = numbers.map(|number| finite(value(number))).collect();
            Found { values, trials: scratch.trials().iter().take(TRIALS).copied().collect() }
        };
        // A last block that was cut short stays so.
        let blocks = self.blocks.len() as u32..paths.div_ceil(BLOCK) as u32;
        let blocks = blocks.into_par_iter().with_max_len(1);
        let found: Vec<Found> = blocks.map_init(PathScratch::default, block).collect();
        self.blocks.extend(found);
    }

    /// What trials tell of lights with a place, relative to the light of the picture around; none where the second moment is not less than
    /// `worth` times that without.
    fn places(&self, worth: f64) -> Option<LightPlaces> {
        let traced = self.blocks.iter().map(|block| block.values.len()).sum::<usize>();
        let side = ((traced as f64 / IN_SQUARE).sqrt() as u64).max(1);
        let square = |number: u64| {
            let ([x, y], [width, height]) = (self.place(number).map(u64::from), self.tracer.scene.size.map(u64::from));
            (y * side / height * side + x * side / width) as usize
        };
        let blocks = || (0..).step_by(BLOCK as usize).zip(&self.blocks);
        let values = || blocks().flat_map(|(first, block)| (first..).zip(&block.values));
        let mean = values().map(|(_, value)| value).sum::<f32>() / traced.max(1) as f32;
        let mut squares = vec![[0.0f32; 2]; (side * side) as usize];
        for (number, value) in values() {
            let [sum, count] = &mut squares[square(number)];
            (*sum, *count) = (*sum + value, *count + 1.0);
        }
        let value = |number: u64| {
            let [sum, count] = squares[square(number)];
            sum / f32::max(count, 1.0) + LEAST_VALUE * mean
        };
        let relative = |(first, block): (u64, &Found)| -> Vec<Trial> {
            let relative = |trial: &Trial| {
                let brought = trial.brought / value(first + u64::from(trial.path));
                Trial { brought, ..*trial }
            };
            block.trials.iter().map(relative).collect()
        };
        let trials: Vec<Vec<Trial>> = blocks().map(relative).collect();
        self.tracer.scene.lights.places(&trials, worth)
    }
}
