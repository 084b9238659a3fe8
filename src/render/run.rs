//! A running render: its passes, the state that one leaves for the next, and its checkpoints.

use super::budget::iteration_size;
use super::checkpoint::{Checkpointing, Moment, Resumed};
use super::control::{Control, Watcher};
use super::learning::Learning;
use super::lights::learned_lights;
use super::order::Uneven;
use super::pass::{Chunk, PassTracer, most_paths};
use super::settings::{RenderSettings, StopRule};
use super::state::{Part, Phase, Position, State};
use super::statistics::{ErrorPoint, Statistics};
use crate::base::{Error, Result};
use crate::film::{
    Block, FinishedPass, Pass, PixelFilter, PixelSpread, check_sheet, combine_sheet, expected_values, over_mean,
    pixel_spread, taken_from_passes,
};
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::lights::learned::LearnedLights;
use crate::picture::{Image, Window};
use crate::scene::Scene;

/// A picture of all samples.
pub(super) struct Rendered {
    /// Their mean.
    pub plain: Image,
    /// The sample counts and variances of its pixels, where they are wanted.
    pub spread: Option<PixelSpread>,
    /// The light of fireflies in it, where that is wanted.
    pub fireflies: Option<Image>,
}

/// Fewest paths in a chunk: enough to keep a few threads busy.
const LEAST_CHUNK: u64 = 1 << 14;
/// Part of the time that is left that a chunk takes against a clock, and bounds of it in seconds: threads wait for one another at its end,
/// and no sooner does a render know that its time is up.
const CHUNK_SHARE: f64 = 0.025;
const CHUNK_SECONDS: [f64; 2] = [0.05, 0.25];
/// A chunk has at least a sample for one in so many pixels, so that one chunk alone leaves only narrow gaps.
const EVERY_ROW: u64 = 12;

/// Estimates pixel values from a noisy picture; none where that shows no light.
type Estimate = fn(&Image) -> Option<Vec<f32>>;

/// A running render.
pub(super) struct Run<'a> {
    pub scene: &'a Scene,
    pub settings: &'a RenderSettings,
    /// Window of the picture that is rendered.
    pub window: Window,
    pub filter: PixelFilter,
    /// What is known of the lights.
    pub lights: LearnedLights,
    pub watcher: Watcher<'a>,
    pub statistics: Statistics,
    /// Whether no picture is wanted, so that the whole budget may go into learning.
    pub learn_only: bool,
    pub evidence: Evidence,
    /// Pixel values that the guide knows of the window; none where they are estimated.
    pub known: Option<Vec<f32>>,
    pub state: State,
    /// Checkpoint of an earlier process, until its unfinished pass is taken up.
    pub resumed: Option<Resumed>,
    /// Whether samples were left out because the stop flag was set.
    pub interrupted: bool,
}

impl<'a> Run<'a> {
    pub fn begin(scene: &'a Scene, settings: &'a RenderSettings, control: &'a Control<'a>) -> Result<Self> {
        check_sheet(scene.view_size(), scene.views())?;
        settings.check()?;
        if settings.crop.is_some() && scene.views() > 1 {
            return Err(Error::Options("a window is one of one picture: render the views one by one".into()));
        }
        let window = settings.window(scene.size);
        window.check_inside(scene.size)?;
        let filter = PixelFilter::new(settings.filter)?;
        // The clock runs from here on.
        let watcher = Watcher::new(control);
        let lights = learned_lights(scene, settings, &filter);
        let mut run = Self {
            scene,
            settings,
            window,
            filter,
            lights,
            watcher,
            statistics: Statistics::default(),
            learn_only: false,
            evidence: Evidence::default(),
            known: None,
            state: State::default(),
            resumed: None,
            interrupted: false,
        };
        if let StopRule::Time(seconds) = settings.stop {
            run.watcher.budget = Some(seconds);
        }
        Ok(run)
    }

    /// Starts the progress, of so many samples per pixel (0 where that is not known), and takes up a checkpoint.
    pub fn start(&mut self, spp: u32) -> Result<()> {
        self.watcher.control.progress.start(u64::from(spp) * self.pixels(), "samples");
        self.read_checkpoint()
    }

    /// Restores the state from the checkpoint to resume from, if there is one.
    fn read_checkpoint(&mut self) -> Result<()> {
        let control = self.watcher.control;
        let from = control.checkpoint.and_then(|c| Some((c.resume.as_ref()?, &c.made_for)));
        let Some((path, made_for)) = from else { return Ok(()) };
        let size = [self.window.width, self.window.height];
        let mut resumed = Resumed::read(path, made_for, self.settings, size, &self.scene.lights.emission)?;
        self.state = std::mem::take(&mut resumed.state);
        self.statistics = std::mem::take(&mut resumed.statistics);
        (self.watcher.before, self.watcher.errors) = (resumed.elapsed, std::mem::take(&mut resumed.errors));
        control.progress.advance(self.statistics.samples);
        self.resumed = Some(resumed);
        Ok(())
    }

    /// The unfinished pass of the checkpoint, where it is of this phase.
    pub fn resume(&mut self, phase: Phase) -> Option<Part> {
        self.resumed.take_if(|_| self.state.position.phase == phase).map(|resumed| resumed.part)
    }

    pub fn pixels(&self) -> u64 {
        self.window.pixels()
    }

    /// Begins the next pass, of `spp` samples per pixel.
    pub fn begin_pass(&mut self, spp: u32) -> Part {
        self.state.sequences_from = Some(self.state.rendered);
        Part { pass: self.empty_pass(), spp, start: 0 }
    }

    pub fn empty_pass(&self) -> Pass {
        // Who only learns makes no picture.
        self.pass(self.settings.fireflies.kappa().is_some() && !self.learn_only)
    }

    /// A pass without samples, which are kept by their brightness too where that is wanted.
    pub fn pass(&self, by_brightness: bool) -> Pass {
        let [width, height] = [self.window.width, self.window.height].map(|side| side as usize);
        if by_brightness { Pass::with_cascades(width, height) } else { Pass::new(width, height) }
    }

    /// Traces the rest of a pass, with `picture` for the roulette of a guide that has voxels, or half of one on trial; returns whether all camera paths were
    /// made.
    pub fn trace(
        &mut self,
        part: &mut Part,
        field: Option<&GuideField>,
        learning: Option<&mut Learning>,
        picture: Option<&[f32]>,
    ) -> bool {
        let on_trial = learning.as_ref().is_some_and(|learning| learning.is_on_trial());
        let halfway = on_trial && part.start == 0;
        let chunk = match (&learning, self.watcher.deadline) {
            (None, Some(deadline)) => {
                let left = deadline - self.watcher.elapsed();
                let seconds = (CHUNK_SHARE * left).clamp(CHUNK_SECONDS[0], CHUNK_SECONDS[1]);
                (seconds * self.statistics.rate()) as u64
            }
            _ => most_paths(learning.is_some()),
        };
        let Part { pass, spp, start } = part;
        let (pixels, places) = (self.pixels(), self.places());
        let half = (places * u64::from(*spp)).div_ceil(2);
        if *start == 0 {
            self.state.rendered += *spp;
            let paths = f64::from(*spp) * (places as f64 / pixels as f64);
            self.state.spent += paths * (1.0 + learning.as_ref().map_or(0.0, |l| l.photon_share));
        }
        let uneven = self.state.division.as_ref().map(|division| Uneven {
            densities: &division.densities,
            even: division.even,
            before: self.state.position.batches - *spp - division.even,
        });
        let begun = self.state.sequences_from.filter(|_| uneven.is_some());
        let told =
            self.state.division.as_ref().map(|division| &division.values[..]).filter(|values| !values.is_empty());
        // One without voxels, of a guide that was given up or not begun, would only be looked up in vain.
        let guide = field.filter(|field| !field.voxels().is_empty());
        let tracer = PassTracer {
            field: guide,
            lights: (&self.lights).into(),
            // Values mean another thing to paths without a guide.
            picture: picture.filter(|_| guide.is_some()).or(told),
            first_sample: begun.unwrap_or(self.state.rendered - *spp),
            uneven,
            sequences_from: self.state.sequences_from,
            spp: *spp,
            places,
            chunk: if on_trial { half } else { chunk.max(LEAST_CHUNK).max(pixels.div_ceil(EVERY_ROW)) },
            ..PassTracer::new(self.scene, self.settings, self.window, &self.filter)
        };
        let (watcher, state, evidence) = (&mut self.watcher, &self.state, &self.evidence);
        let field = field.map(|field| (field, evidence));
        watcher.begin_chunk();
        let views = self.scene.views();
        let (width, detailed) = (self.window.width as usize, self.settings.keeps_spread);
        let so_far = |pass: &Pass| match &state.blocks {
            None => {
                let own = pass.finish_plain();
                combine_sheet(&state.passes.iter().chain([&own]).collect::<Vec<_>>(), views).ok()
            }
            Some(blocks) => {
                let mut sum = blocks.sum(pixels as usize, detailed);
                sum.add(&Block::of(pass, detailed));
                Some(sum.finish().image(width, views))
            }
        };
        let mut reached = 0;
        let mut go_on = |chunk: &Chunk| {
            let Chunk { pass, samples, end: start, learning, statistics } = *chunk;
            if on_trial {
                // A checkpoint would have to hold what is on trial; the next chunk is not far.
                watcher.control.progress.advance(samples);
                reached = start;
                return !halfway;
            }
            let reached = statistics.samples.div_ceil(pixels) as u32;
            let keep = |checkpoint: &Checkpointing, elapsed: f64, errors: &[ErrorPoint]| {
                let Some((path, _)) = &checkpoint.write else { return Ok(()) };
                let moment = Moment { state, pass, spp: *spp, start, statistics, learning, field, elapsed, errors };
                moment.write(path, &checkpoint.made_for)
            };
            watcher.end_chunk(samples, reached, || so_far(pass), keep)
        };
        let complete = tracer.run(pass, *start, learning, &mut self.statistics, &mut go_on);
        *start = if complete { 0 } else { reached };
        self.interrupted |= !complete && !on_trial && self.watcher.stopped();
        complete
    }

    /// See [`iteration_size`].
    pub fn iteration_size(&self, t: u32) -> (u64, u32) {
        iteration_size(t, self.pixels(), self.state.trend.caustics)
    }

    /// Pixels that the pass at hand visits.
    pub fn places(&self) -> u64 {
        let Position { phase, iteration, .. } = self.state.position;
        if phase == Phase::Learning { self.iteration_size(iteration).0 } else { self.pixels() }
    }

    /// Value (channel mean) that each pixel is expected to have: as the guide knows it, or else by the passes so far; none while no light
    /// was found.
    pub fn pixel_values(&self) -> Option<Vec<f32>> {
        self.known.clone().or_else(|| self.values_so_far(expected_values))
    }

    /// Value of each pixel by the passes so far.
    pub fn values_so_far(&self, estimate: Estimate) -> Option<Vec<f32>> {
        let State { passes, early, .. } = &self.state;
        let picture = combine_sheet(if passes.is_empty() { early } else { passes }, self.scene.views()).ok()?;
        self.values_of(&picture, estimate)
    }

    /// Value of each pixel by a noisy picture; none where that shows no light.
    pub fn values_of(&self, image: &Image, estimate: Estimate) -> Option<Vec<f32>> {
        let mut values = estimate(image)?;
        if self.scene.views() > 1 {
            // A pixel is worth what it is in its own picture; where light was found in others only, nothing better is known.
            let pixels = values.len() / self.scene.views();
            for (own, view) in values.chunks_mut(pixels).zip(image.parts(self.scene.views())) {
                estimate(&view).into_iter().for_each(|found| own.copy_from_slice(&found));
            }
        }
        Some(values)
    }

    /// Value of each pixel by what `pass` has made so far, over the mean of its view: the radiance that a vertex is taken to send back where
    /// nothing more is known of it. What a path carries, over its pixel's number, is about the share of the pixel that it still stands for:
    /// unguided roulette goes by that (after Vorba and Křivánek 2016 §5). None while no light was found.
    pub fn roulette_values(&self, pass: &Pass) -> Option<Vec<f32>> {
        let picture = combine_sheet(&[pass.finish_plain()], self.scene.views()).ok()?;
        Some(self.over_views(&self.values_of(&picture, expected_values)?))
    }

    /// Pixel values over the mean of their view.
    pub fn over_views(&self, values: &[f32]) -> Vec<f32> {
        values.chunks((values.len() / self.scene.views()).max(1)).flat_map(over_mean).collect()
    }

    /// Finishes a pass, with the variances of its pixels where they are wanted.
    pub fn finished(&self, pass: &Pass) -> FinishedPass {
        if self.settings.keeps_spread { pass.finish_with_variance() } else { pass.finish() }
    }

    /// The picture `plain` that was combined of passes, with fixed weights if these are given, and what else is wanted of them.
    pub fn rendered(&self, plain: Image, passes: &[FinishedPass], weights: Option<&[f64]>) -> Result<Rendered> {
        let spread = self.settings.keeps_spread.then(|| pixel_spread(passes, weights)).transpose()?;
        let taken = |kappa| taken_from_passes(passes, weights, self.scene.views(), &plain, kappa);
        let fireflies = self.settings.fireflies.kappa().map(taken);
        Ok(Rendered { plain, spread, fireflies })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    use glam::Vec3;

    use super::super::settings::GuideMode;
    use super::*;
    use crate::base::progress::Silent;
    use crate::scene::file::{CameraFile, FilmFile, FilterFile, IDENTITY, SceneFile};
    use crate::scene::readers::resolve;

    /// What pixels are worth to a guide is not asked where it was given up: paths would end by the unit of radiance.
    #[test]
    fn without_voxels_no_values_are_asked() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
        let scene = Scene::build(&crate::scene::readers::load(&folder).unwrap(), [16, 16]).unwrap();
        let (settings, stop) = (RenderSettings::new(GuideMode::None, StopRule::Spp(16)), AtomicBool::new(false));
        let control = Control::new(&Silent, &stop);
        let passes = [None, Some(&GuideField::empty())].map(|field| {
            let mut run = Run::begin(&scene, &settings, &control).unwrap();
            run.state.position.phase = Phase::Final;
            let mut part = run.begin_pass(16);
            assert!(run.trace(&mut part, field, None, field.map(|_| &[1e-4; 256][..])));
            (part.pass, run.statistics.rays)
        });
        assert!(passes[0] == passes[1], "{} rays, {} with values", passes[0].1, passes[1].1);
    }

    /// Beside a view a hundred times as bright a pixel is worth to roulette what it is where its view is rendered alone.
    #[test]
    fn unguided_roulette_goes_by_views() {
        let camera = CameraFile::pinhole(IDENTITY, 40.0);
        let values = |views: &[f32]| {
            let film = FilmFile { width: 20, height: 10, filter: FilterFile::default() };
            let mut file = SceneFile::empty("views".into(), camera.clone(), film);
            file.cameras = (1..views.len()).map(|view| (view.to_string(), camera.clone())).collect();
            let loaded = resolve(file, Path::new(""), Path::new("test")).unwrap();
            let scene = Scene::build_views(&loaded, [20, 10]).unwrap();
            let (settings, stop) = (RenderSettings::new(GuideMode::None, StopRule::Spp(16)), AtomicBool::new(false));
            let control = Control::new(&Silent, &stop);
            let run = Run::begin(&scene, &settings, &control).unwrap();
            let mut pass = run.empty_pass();
            for (view, brightness) in views.iter().enumerate() {
                let value = |i: usize| if i % 20 < 10 { *brightness } else { 3.0 * brightness };
                (0..200).for_each(|i| pass.add(200 * view + i, 0, Vec3::splat(value(i))));
            }
            run.roulette_values(&pass).unwrap()
        };
        assert_eq!(values(&[1.0, 100.0]), [values(&[1.0]), values(&[100.0])].concat());
    }
}
