//! One pass over the picture: camera paths into the film, records into the learner, in chunks.
//!
//! A chunk is a range of linear sample indices (sample · places + place); blocks of it run in parallel and are merged in
//! order, so neither the picture nor what is learned depends on the number of threads, and memory not on the samples. Rows are
//! visited so that any part of a pass covers the whole picture evenly: the first chunk shows the learner all of the scene, and a
//! pass cut short by the clock leaves gaps that their neighbours can fill.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use super::camera::{CameraSample, camera_rays};
use super::learning::{Learning, Records};
use super::order::{Order, Places, Uneven};
use super::settings::RenderSettings;
use super::statistics::{Dropped, Statistics};
use crate::base::random::Random;
use crate::film::{Pass, PixelFilter};
use crate::guiding::learn::emission::EmissionGuide;
use crate::guiding::record::PathRecord;
use crate::guiding::sample::field::GuideField;
use crate::integrators::path::{CameraPath, PathScratch, PathTracer};
use crate::integrators::photon::{PhotonScratch, PhotonTracer};
use crate::lights::learned::LightSampling;
use crate::picture::Window;
use crate::scene::Scene;

/// Most paths per chunk of a pass that is learned from: with about four records of 84 bytes each, a chunk holds some 90 MB.
pub const CHUNK: u64 = 1 << 18;
/// Paths per unit of parallel work.
const BLOCK: u64 = 1 << 10;
/// Makes the random numbers of light paths differ from those of camera paths.
const PHOTON_STREAM: u64 = 1 << 63;

/// Traces a pass.
pub struct PassTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: &'a RenderSettings,
    /// The part of the picture that is traced; its pixels are those of the pass.
    pub window: Window,
    /// Where in the pixel's surroundings its samples lie.
    pub filter: &'a PixelFilter,
    /// The guiding field; none without guiding.
    pub field: Option<&'a GuideField>,
    /// How lights are sampled.
    pub lights: LightSampling<'a>,
    /// Values that pixels will about have, without a guide over what vertices are expected to send back; none where nothing is known of
    /// them.
    pub picture: Option<&'a [f32]>,
    /// Camera samples per pixel before, so that no random number is used twice.
    pub first_sample: u32,
    /// Those of them at which the sequences of the pass begin; none where its samples are to be independent.
    pub sequences_from: Option<u32>,
    /// Camera paths per pixel.
    pub spp: u32,
    /// How they are divided among the pixels; none where all get as many. Otherwise `first_sample` is the beginning of the pass, of which
    /// this is a later part.
    pub uneven: Option<Uneven<'a>>,
    /// Pixels that are visited, the first so many in the order of rows: all, or fewer that are spread evenly.
    pub places: u64,
    /// For so few that they would be in few rows: they are spread over columns too, and this many such pixels come before them.
    pub few: Option<u64>,
    /// Paths per chunk, at most [`CHUNK`], or where nothing is learned so many for every four threads. What is learned depends on it, the
    /// samples do not.
    pub chunk: u64,
}

/// Most paths per chunk of a pass that is learned from, or is not: then it has [`CHUNK`] for every four threads, which wait for one another
/// at its end. Without records a path takes some 20 bytes until then.
pub(super) fn most_paths(learns: bool) -> u64 {
    if learns { CHUNK } else { CHUNK * rayon::current_num_threads().div_ceil(4) as u64 }
}

/// A pass after a chunk.
pub struct Chunk<'a> {
    /// The pass so far.
    pub pass: &'a Pass,
    /// Camera and light paths of the chunk.
    pub samples: u64,
    /// Linear index of the next camera path.
    pub end: u64,
    /// State of learning; none where nothing is learned.
    pub learning: Option<&'a Learning>,
    /// Statistics so far.
    pub statistics: &'a Statistics,
}

impl<'a> PassTracer<'a> {
    /// A tracer of one independent sample in each pixel of `window`, without a guide.
    pub fn new(scene: &'a Scene, settings: &'a RenderSettings, window: Window, filter: &'a PixelFilter) -> Self {
        Self {
            scene,
            settings,
            window,
            filter,
            field: None,
            lights: LightSampling::Plain,
            picture: None,
            first_sample: 0,
            sequences_from: None,
            spp: 1,
            uneven: None,
            places: window.pixels(),
            few: None,
            chunk: CHUNK,
        }
    }
}

impl PassTracer<'_> {
    fn pixels(&self) -> u64 {
        self.window.pixels()
    }

    /// Adds the pass's samples to `pass`, from the linear index `start` on, which is 0 or where an earlier chunk ended, and where
    /// there is one gives its records to `learning`. After every chunk `go_on` is called; it ends the pass by saying no. Returns
    /// whether the pass was completed.
    pub fn run(
        &self,
        pass: &mut Pass,
        mut start: u64,
        mut learning: Option<&mut Learning>,
        statistics: &mut Statistics,
        go_on: &mut dyn FnMut(&Chunk) -> bool,
    ) -> bool {
        let order = self.order(learning.as_deref().is_some_and(Learning::is_on_trial));
        let total = order.total();
        let (paths, light_paths) = (Pool::default(), Pool::default());
        let chunk = self.chunk.clamp(1, most_paths(learning.is_some()));
        while start < total {
            let end = (start + chunk).min(total);
            let mut samples = end - start;
            let mut records = Records::default();
            let kinds = self.settings.samples;
            let wants_paths = learning.is_some();
            let places = order.places(start..end);
            let kept = wants_paths.then_some(&mut records.paths);
            self.camera_chunk(start..end, &places, &paths, pass, kept, statistics);
            if let Some(learning) = learning.as_deref_mut().filter(|learning| learning.is_on_trial()) {
                learning.judge(std::mem::take(&mut records.paths), &mut statistics.seconds);
            } else if let Some(learning) = learning.as_deref_mut() {
                let photons = |index: u64| (index as f64 * learning.photon_share) as u64;
                let range = photons(start)..photons(end);
                if !range.is_empty() {
                    samples += range.end - range.start;
                    let of = (range, photons(total));
                    self.photon_chunk(of, &light_paths, &learning.emission, &mut records, statistics);
                }
                learning.absorb(&records, kinds, &mut statistics.seconds);
            }
            start = end;
            let learning = learning.as_deref();
            if !go_on(&Chunk { pass, samples, end: start, learning, statistics }) {
                return start == total;
            }
        }
        true
    }

    /// The order of the pass's samples.
    fn order(&self, on_trial: bool) -> Order<'_> {
        if let Some(skipped) = self.few {
            return Order::of_few(self.window, skipped, self.places, self.spp);
        }
        let order = Order::new(self.window, self.places, self.spp, self.uneven);
        // Half of a pass on trial is judged by variances, which take two samples of a pixel.
        if on_trial { order.by_pixel() } else { order }
    }

    /// Learns from a pass that was on trial, whose camera paths left these records: traces its light paths, and tells `learning` of both
    /// kinds. Returns the number of light paths.
    pub(super) fn settle(&self, paths: Vec<PathRecord>, learning: &mut Learning, statistics: &mut Statistics) -> u64 {
        let mut records = Records { paths, ..Records::default() };
        let total = self.order(true).total();
        let photons = (total as f64 * learning.photon_share) as u64;
        if photons > 0 {
            self.photon_chunk((0..photons, photons), &Pool::default(), &learning.emission, &mut records, statistics);
        }
        learning.deposit(&records, self.settings.samples, &mut statistics.seconds);
        photons
    }

    fn camera_chunk(
        &self,
        range: Range<u64>,
        places: &Places,
        pool: &Pool<PathScratch>,
        pass: &mut Pass,
        records: Option<&mut Vec<PathRecord>>,
        statistics: &mut Statistics,
    ) {
        let begun = Instant::now();
        let start = range.start;
        let tracer =
            PathTracer { scene: self.scene, settings: self.settings.transport, field: self.field, lights: self.lights };
        let begin = |numbers: Range<u64>, paths: &mut Vec<CameraPath>| {
            let samples = numbers.map(|index| {
                let (pixel, sample) = self.camera_sample(index, places);
                (sample, self.picture.map(|picture| picture[pixel as usize]))
            });
            camera_rays(self.scene, self.settings, self.filter, samples, |ray, random, pixel| {
                paths.push(CameraPath { ray, random, pixel });
            });
        };
        let keep = records.is_some();
        let mut index = start;
        // Counted from where the pass began, so that the film's halves are those of the sequences.
        let behind = u64::from(self.first_sample - self.sequences_from.unwrap_or(self.first_sample));
        let (mut records, blocks) = (records, (range.end - start).div_ceil(BLOCK) as usize);
        let trace = |scratch: &mut PathScratch, numbers| tracer.trace_block(numbers, begin, keep, scratch);
        in_blocks(range, pool, trace, |block| {
            let mut lost = block.lost.iter().peekable();
            statistics.rays += block.rays.rays;
            statistics.camera_rays += block.rays.rays;
            for &radiance in &block.radiance {
                if radiance.is_finite() {
                    let (pixel, sample) = places.at(index);
                    pass.add(pixel as usize, behind + sample, radiance);
                } else {
                    statistics.dropped_samples += 1;
                    let (_, CameraSample { place: pixel, number: sample, sequences_from: pass_from }) =
                        self.camera_sample(index, places);
                    let cause = lost.next_if(|(number, _)| *number == index).map(|(_, cause)| *cause);
                    let dropped = cause.map(|cause| Dropped { pixel, sample, pass_from, cause, view: None });
                    dropped.into_iter().for_each(|sample| statistics.dropped.add(sample));
                }
                index += 1;
            }
            if let Some(records) = &mut records {
                // Blocks leave about as many: memory is asked for once.
                if records.is_empty() {
                    records.reserve(block.records.len() * (blocks + blocks / 8));
                }
                records.extend(block.records);
            }
        });
        statistics.samples += index - start;
        statistics.seconds.trace += begun.elapsed().as_secs_f64();
    }

    fn photon_chunk(
        &self,
        (range, total): (Range<u64>, u64),
        pool: &Pool<PhotonScratch>,
        emission: &EmissionGuide,
        records: &mut Records,
        statistics: &mut Statistics,
    ) {
        let begun = Instant::now();
        statistics.samples += range.end - range.start;
        let tracer = PhotonTracer { scene: self.scene, settings: self.settings.transport, emission };
        let start = range.start;
        let first = u64::from(self.first_sample) * self.pixels();
        let random = |index| Random::new(self.settings.seed, PHOTON_STREAM, first + index);
        let trace = |scratch: &mut PhotonScratch, numbers| tracer.trace_block(numbers, (start, total), random, scratch);
        in_blocks(range, pool, trace, |block| {
            statistics.rays += block.rays.rays;
            statistics.dropped.photons += block.rays.dropped;
            records.photons.extend(block.photons);
            records.starts.extend(block.starts);
        });
        statistics.seconds.photons += begun.elapsed().as_secs_f64();
    }

    /// The pixel of a linear index, and its camera sample.
    fn camera_sample(&self, index: u64, places: &Places) -> (u64, CameraSample) {
        let (pixel, sample) = places.at(index);
        let number = u64::from(self.first_sample) + sample;
        (pixel, CameraSample { place: self.window.place(pixel), number, sequences_from: self.sequences_from })
    }
}

/// Scratch space that is not in use at the moment.
pub(super) type Pool<S> = Mutex<Vec<S>>;

/// Traces a range of numbers in parallel blocks. Each is handed to `take` in order, by a thread that has just traced one and while the
/// others go on, so that nobody waits for what is done one by one. Each takes scratch space from the pool and leaves it there, so that no
/// memory is asked for from chunk to chunk.
pub(super) fn in_blocks<S: Default + Send, B: Send>(
    range: Range<u64>,
    pool: &Pool<S>,
    trace: impl Fn(&mut S, Range<u64>) -> B + Sync + Send,
    take: impl FnMut(B) + Send,
) {
    let count = (range.end - range.start).div_ceil(BLOCK);
    let (next, traced) = (AtomicU64::new(0), Mutex::new(BTreeMap::new()));
    // The number of the next block to be taken, and what takes it.
    let taking = Mutex::new((0, take));
    let hand_over = || {
        // Who finds another at it leaves: that one, or the next that is traced, takes the block with it.
        let Ok(mut taking) = taking.try_lock() else { return };
        let (wanted, take) = &mut *taking;
        loop {
            let block = lock(&traced).remove(wanted);
            let Some(block) = block else { return };
            take(block);
            *wanted += 1;
        }
    };
    // Numbers are drawn, since workers divide an iterator into parts that are far from one another.
    let block = |_| {
        let number = next.fetch_add(1, Ordering::Relaxed);
        let first = range.start + number * BLOCK;
        let mut scratch = lock(pool).pop().unwrap_or_default();
        let block = trace(&mut scratch, first..(first + BLOCK).min(range.end));
        lock(pool).push(scratch);
        lock(&traced).insert(number, block);
        hand_over();
    };
    // One by one: workers that took several at once would keep the others waiting at the end.
    (0..count as usize).into_par_iter().with_max_len(1).for_each(block);
    hand_over();
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks are handed over once and in order, whichever ends first: every third takes a hundred times as long as the others.
    #[test]
    fn blocks_are_taken_in_order() {
        for threads in [1, 2, 7] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            for end in [0, 1, BLOCK, 100 * BLOCK + 5] {
                let trace = |_: &mut u64, numbers: Range<u64>| {
                    let work = if (numbers.start / BLOCK).is_multiple_of(3) { 100_000 } else { 1000 };
                    std::hint::black_box((0..work).fold(0.0f64, |sum, i| sum + f64::from(i).sqrt()));
                    numbers
                };
                let mut taken = Vec::new();
                workers.install(|| in_blocks(5..5 + end, &Pool::default(), trace, |numbers| taken.push(numbers)));
                assert_eq!(taken.len() as u64, end.div_ceil(BLOCK));
                assert!(taken.into_iter().flatten().eq(5..5 + end), "{threads} threads, {end}");
            }
        }
    }
}
