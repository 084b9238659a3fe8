//! Learning of complete paths, in batches (Reibold 2018, §3.2): which samples stand alone is known by their density (Zirr 2018), and of
//! those the brightest are kept.

use std::cmp::Reverse;
use std::ops::Range;
use std::time::Instant;

use glam::{DVec3, Vec3};

use super::super::pass::{Pool, in_blocks};
use super::super::run::Run;
use super::super::settings::{GuideMode, StopRule};
use super::{GUIDED_STREAM, Guides, LEARNING_SEED, Placed};
use crate::base::random::{Dimension, Random};
use crate::film::{Cascade, Judge};
use crate::guiding::paths::cache::{Kept, MOST, MOST_SHARE, PathCache};
use crate::guiding::paths::guide::PathGuide;
use crate::guiding::paths::path::CompletePath;
use crate::integrators::guided::GuidedTracer;
use crate::integrators::path::{KernelShares, PathScratch, PathTracer, RayCount, Wants};
use crate::math::channel_mean;
use crate::scene::Scene;

/// Most camera paths of a batch.
const BATCH: u64 = 1 << 16;
/// Samples of like brightness that make a sample believed, see [`Judge`]: 1 + 2 κ in the nine cells around.
const KAPPA: f64 = 4.0;
/// A sample that is believed less stands alone.
const BELIEVED: f64 = 0.5;
/// Samples that are judged together.
const JUDGED: usize = 1 << 10;

/// A complete path of a batch.
struct Sample {
    /// Cell of the cascade.
    cell: u32,
    /// What it brings, as the radiance of its pixel.
    value: Vec3,
    /// The path, if it brings more than most.
    path: Option<Box<Kept>>,
}

/// Samples of some paths, in their order.
#[derive(Default)]
struct Found {
    samples: Vec<Sample>,
    rays: u64,
}

/// The samples of learning by brightness, of cells that have about one camera path in each batch.
struct Cells {
    cascade: Cascade,
    /// Pixels along a side of a cell, and cells.
    side: u32,
    size: [usize; 2],
    /// Sum of the light, and camera paths.
    light: f64,
    paths: u64,
}

impl Cells {
    fn new([width, height]: [u32; 2], count: u64) -> Self {
        let pixels = f64::from(width) * f64::from(height);
        let side = (pixels / count as f64).sqrt().ceil().max(1.0) as u32;
        let size = [width, height].map(|pixels| pixels.div_ceil(side) as usize);
        Self { cascade: Cascade::new(size[0] * size[1]), side, size, light: 0.0, paths: 0 }
    }

    /// The cell of a place in the window.
    fn of(&self, place: [f32; 2]) -> u32 {
        let at = |axis: usize| ((place[axis].max(0.0) as usize) / self.side as usize).min(self.size[axis] - 1);
        (at(1) * self.size[0] + at(0)) as u32
    }

    fn judge(&self) -> Judge<'_> {
        let cells = (self.size[0] * self.size[1]) as f64;
        let paths = self.paths.max(1) as f64;
        let mean = self.light / paths;
        Judge { cascade: &self.cascade, size: self.size, samples: paths / cells, kappa: KAPPA, mean }
    }
}

/// What a batch is drawn with.
struct Batch<'a> {
    tracer: PathTracer<'a>,
    guided: GuidedTracer<'a>,
    shares: &'a KernelShares,
    guides: Guides<'a>,
    cells: &'a Cells,
    /// Corner of the window, and its columns and rows.
    corner: [f32; 2],
    size: [f32; 2],
    pixels: f64,
    seed: u64,
    number: u64,
}

/// Width of a pixel at this place of the picture where the camera sees the path's first point.
fn footprint(scene: &Scene, path: &CompletePath) -> f32 {
    let Some(point) = path.points.first() else { return 0.0 };
    let [here, beside] = [0.0, 1.0].map(|step| scene.camera.ray([path.film[0] + step, path.film[1]], [0.5; 2]));
    let distance = point.distance(path.origin);
    here.at(distance).distance(beside.at(distance))
}

impl Batch<'_> {
    fn sample(&self, path: CompletePath, light: DVec3, [unguided, guided]: [f64; 2]) -> Option<Sample> {
        let place = [path.film[0] - self.corner[0], path.film[1] - self.corner[1]];
        let value = light / (unguided + self.pixels * guided);
        let inside = (0..2).all(|axis| place[axis] >= 0.0 && place[axis] < self.size[axis]);
        if !(inside && value.is_finite()) {
            return None;
        }
        let footprint = footprint(self.guided.scene, &path);
        let kept = Kept { path, value: light.element_sum() / 3.0, unguided, footprint };
        Some(Sample { cell: self.cells.of(place), value: value.as_vec3(), path: Some(Box::new(kept)) })
    }

    /// Complete paths of the path tracer.
    fn unguided(&self, numbers: Range<u64>, scratch: &mut PathScratch) -> Found {
        let mut found = Found::default();
        let placed: Vec<Placed> = numbers
            .map(|index| {
                let random = Random::new(self.seed, self.number, index);
                let [x, y] = random.at(Dimension::FILM).next_2d();
                let film = [self.corner[0] + x * self.size[0], self.corner[1] + y * self.size[1]];
                Placed::new(self.guided.scene, film, random, self.guides)
            })
            .collect();
        let mut count = RayCount::default();
        self.tracer.trace_all(
            placed.iter().map(|placed| placed.path.clone()),
            Wants::Contributions,
            scratch,
            &mut count,
        );
        for (index, Placed { film, path }) in placed.iter().enumerate() {
            let start = (*film, path.ray.origin, &path.random);
            self.tracer.contributions(index, scratch, start, self.shares, |contribution| {
                let Some(path) = contribution.path else { return };
                let (guided, unguided) = (self.guided.guide.density(&path), contribution.unguided);
                let light = contribution.value.as_dvec3() * unguided;
                found.samples.extend(self.sample(path, light, [unguided, guided]));
            });
        }
        found.rays = count.rays;
        found.without_most()
    }

    /// Guided paths.
    fn guided(&self, numbers: Range<u64>) -> Found {
        let mut found = Found::default();
        for index in numbers {
            let random = Random::new(self.seed, self.number | GUIDED_STREAM, index);
            let Some(path) = self.guided.sample(random) else { continue };
            found.rays += path.rays;
            found.samples.extend(self.sample(path.path, path.value, [path.unguided, path.guided]));
        }
        found.without_most()
    }
}

impl Found {
    /// The same, where paths that bring less than the mean are no longer known: they will not be kept.
    fn without_most(mut self) -> Self {
        let sum: f64 = self.samples.iter().map(|sample| f64::from(channel_mean(sample.value))).sum();
        let mean = sum / self.samples.len().max(1) as f64;
        for sample in &mut self.samples {
            sample.path.take_if(|_| f64::from(channel_mean(sample.value)) < mean);
        }
        self
    }
}

/// The brightest samples of a batch that stand alone, `most` at most.
fn outliers(cells: &Cells, mut samples: Vec<Sample>, most: usize) -> Vec<Kept> {
    use rayon::prelude::*;
    samples.retain(|sample| sample.path.is_some());
    // Positive numbers have the order of their bits; the sort is stable.
    samples.sort_by_key(|sample| Reverse(channel_mean(sample.value).max(0.0).to_bits()));
    let (judge, mut kept) = (cells.judge(), Vec::new());
    let mut left = samples.into_iter();
    while kept.len() < most {
        let some: Vec<Sample> = left.by_ref().take(JUDGED).collect();
        if some.is_empty() {
            break;
        }
        let believed = |sample: &Sample| judge.believed(sample.cell as usize, sample.value);
        let alone: Vec<bool> = some.par_iter().map(|sample| believed(sample) < BELIEVED).collect();
        let alone = some.into_iter().zip(alone).filter(|(_, alone)| *alone);
        kept.extend(alone.filter_map(|(sample, _)| sample.path).map(|path| *path));
    }
    kept.truncate(most);
    kept
}

impl Run<'_> {
    /// Learns paths while a part of the budget that is left lasts, of the path tracer with these guides.
    pub(super) fn learn_paths(&mut self, guides: Guides) -> PathGuide {
        let Guides { field, expected } = guides;
        let (scene, settings, window) = (self.scene, self.settings, self.window);
        let pixels = window.pixels();
        let count = pixels.min(BATCH);
        let (mut cells, mut cache) = (Cells::new([window.width, window.height], count), PathCache::default());
        let (mut guide, shares) = (PathGuide::default(), KernelShares::new(scene));
        let pool = Pool::<PathScratch>::default();
        let (until, mut took) = (self.paths_until(), 0.0);
        for number in 0u32.. {
            let kinds = if guide.is_empty() { 1 } else { 2 };
            if !self.learns_paths(kinds * count, took, until) || cache.len() >= MOST {
                break;
            }
            self.watcher.control.progress.message(&format!("learning, batch {number}"));
            let began = Instant::now();
            let lights = (&self.lights).into();
            let guided = GuidedTracer {
                scene,
                settings: settings.transport,
                field,
                expected,
                lights,
                guide: &guide,
                shares: &shares,
            };
            let batch = Batch {
                tracer: PathTracer { scene, settings: settings.transport, field, lights },
                guided,
                shares: &shares,
                guides,
                cells: &cells,
                corner: [window.x as f32, window.y as f32],
                size: [window.width as f32, window.height as f32],
                pixels: pixels as f64,
                seed: settings.seed ^ LEARNING_SEED,
                number: number.into(),
            };
            let mut blocks = Vec::new();
            in_blocks(0..count, &pool, |scratch, numbers| batch.unguided(numbers, scratch), |block| blocks.push(block));
            if !guide.is_empty() {
                in_blocks(0..count, &pool, |_, numbers| batch.guided(numbers), |block| blocks.push(block));
            }
            self.statistics.seconds.trace += began.elapsed().as_secs_f64();
            let rays: u64 = blocks.iter().map(|block| block.rays).sum();
            self.statistics.rays += rays;
            self.statistics.camera_rays += rays;
            self.statistics.samples += kinds * count;
            self.state.spent += (kinds * count) as f64 / pixels as f64;
            self.watcher.control.progress.advance(kinds * count);
            let samples: Vec<Sample> = blocks.into_iter().flat_map(|block| block.samples).collect();
            cells.paths += count;
            for sample in &samples {
                cells.light += f64::from(channel_mean(sample.value));
                cells.cascade.add(sample.cell as usize, sample.value);
            }
            let most = ((MOST_SHARE * (kinds * count) as f64) as usize).max(1);
            let made = Instant::now();
            guide = cache.learn(outliers(&cells, samples, most), &guide, pixels as f64, scene.size);
            self.statistics.seconds.reconstruct += made.elapsed().as_secs_f64();
            took = began.elapsed().as_secs_f64();
        }
        self.statistics.decisions.push(match guide.len() {
            0 if cells.paths == 0 => "complete paths off: the budget is too small to look for any".into(),
            0 => "complete paths off: no sample stood alone".into(),
            kept => format!("complete paths on: {kept} are kept"),
        });
        guide
    }

    /// What may be spent until the last batch, in seconds or in samples per pixel.
    fn paths_until(&self) -> f64 {
        let of = |spent: f64, budget: f64| spent + self.settings.paths_share * (budget - spent);
        match self.settings.stop {
            // Without other guides the clock has only begun.
            StopRule::Time(seconds) if self.settings.guide == GuideMode::Paths => of(0.0, seconds),
            StopRule::Time(seconds) => of(self.watcher.elapsed(), seconds),
            StopRule::Spp(spp) => of(self.state.spent, f64::from(spp)),
            StopRule::TargetError(_) => 0.0,
        }
    }

    /// Whether there is room for another batch of so many paths, where the last took so many seconds.
    fn learns_paths(&self, paths: u64, took: f64, until: f64) -> bool {
        !self.watcher.stopped()
            && match self.settings.stop {
                StopRule::Time(_) => self.watcher.elapsed() + 0.5 * took < until,
                StopRule::Spp(_) => self.state.spent + paths as f64 / self.pixels() as f64 <= until,
                StopRule::TargetError(_) => false,
            }
    }
}
