//! The picture by complete paths, round by round: a path of the path tracer in every pixel, and as many guided ones wherever they fall. What
//! both bring to a pixel in a round is one sample of it, which is left out where it is not finite.

use std::ops::Range;
use std::time::Instant;

use glam::Vec3;
use hashbrown::HashMap;

use super::super::camera::CameraSample;
use super::super::pass::{Pool, in_blocks};
use super::super::run::{Rendered, Run};
use super::super::settings::{RenderSettings, StopRule};
use super::super::state::{Phase, Position};
use super::super::statistics::Dropped;
use super::{GUIDED_STREAM, Guides, Placed, camera_film};
use crate::base::Result;
use crate::base::random::Random;
use crate::film::{Pass, PixelFilter, combine_sheet};
use crate::guiding::paths::guide::PathGuide;
use crate::integrators::guided::GuidedTracer;
use crate::integrators::path::{Cause, KernelShares, PathScratch, PathTracer, RayCount, Wants};
use crate::picture::Window;
use crate::scene::Scene;

/// Pixels of a round that are traced before the clock is looked at.
const PIECE: u64 = 1 << 15;

/// What a round is drawn with.
struct Round<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    window: Window,
    filter: &'a PixelFilter,
    tracer: PathTracer<'a>,
    guided: GuidedTracer<'a>,
    shares: &'a KernelShares,
    guides: Guides<'a>,
    /// Guided paths for each of the path tracer.
    ratio: f64,
    /// Its number among the samples of each pixel, and that of the first round: learning has taken those before.
    number: u64,
    first: u32,
}

/// Light of pixels.
#[derive(Default)]
struct Light {
    /// Pixels and what is added to them.
    values: Vec<(u32, Vec3)>,
    rays: u64,
    /// Pixels whose paths are not finite, and why.
    lost: Vec<(u32, Cause)>,
}

impl Round<'_> {
    /// Paths of the path tracer in these pixels.
    fn unguided(&self, pixels: Range<u64>, scratch: &mut PathScratch) -> Light {
        let place = |pixel: u64| {
            let place = self.window.place(pixel);
            let sample = CameraSample { place, number: self.number, sequences_from: Some(self.first) };
            let (_, film, random) = camera_film(self.scene, self.settings, self.filter, sample);
            (pixel, Placed::new(self.scene, film, random, self.guides))
        };
        // Where no guided path may come from, nothing has to be known of paths but their sum.
        let (covered, plain): (Vec<_>, Vec<_>) =
            pixels.map(place).partition(|(_, placed)| self.guided.guide.covers(placed.film));
        let (mut light, mut count) = (Light::default(), RayCount::default());
        let paths = |of: &[(u64, Placed)]| of.iter().map(|(_, placed)| placed.path.clone()).collect::<Vec<_>>();
        self.tracer.trace_all(paths(&plain), Wants::Radiance, scratch, &mut count);
        for (index, (pixel, placed)) in plain.iter().enumerate() {
            self.add(&mut light, *pixel, placed, self.tracer.radiance(index, scratch, None));
        }
        self.tracer.trace_all(paths(&covered), Wants::Contributions, scratch, &mut count);
        for (index, (pixel, placed)) in covered.iter().enumerate() {
            self.add(&mut light, *pixel, placed, self.balanced(index, *pixel, placed, scratch));
        }
        light.rays = count.rays;
        light
    }

    /// Adds what a path of the path tracer brings to its pixel.
    fn add(&self, light: &mut Light, pixel: u64, placed: &Placed, radiance: Vec3) {
        if !radiance.is_finite() {
            let cause = self.tracer.explain(placed.path.clone()).cause;
            light.lost.push((pixel as u32, cause.unwrap_or(Cause::Overflow)));
        }
        light.values.push((pixel as u32, radiance));
    }

    /// Density of a place of the film around a pixel.
    fn filtered(&self, pixel: u64, film: [f32; 2]) -> f64 {
        let [x, y] = self.window.place(pixel);
        f64::from(self.filter.pdf([film[0] - x as f32, film[1] - y as f32]))
    }

    /// Radiance of path `index` as far as guided ones do not bring it.
    fn balanced(&self, index: usize, pixel: u64, Placed { film, path }: &Placed, scratch: &PathScratch) -> Vec3 {
        let (mut sum, start) = (self.tracer.glow(index, scratch), (*film, path.ray.origin, &path.random));
        let guided_per_pixel = self.ratio * self.window.pixels() as f64 / self.filtered(pixel, *film);
        self.tracer.contributions(index, scratch, start, self.shares, |contribution| {
            let guided = contribution.path.as_ref().map_or(0.0, |path| self.guided.guide.density(path));
            let share = if guided > 0.0 {
                contribution.unguided / (contribution.unguided + guided_per_pixel * guided)
            } else {
                1.0
            };
            sum += contribution.value * share as f32;
        });
        sum
    }

    /// Guided paths of these numbers.
    fn guided(&self, numbers: Range<u64>) -> Light {
        let (mut light, all) = (Light::default(), self.ratio * self.window.pixels() as f64);
        for index in numbers {
            let random = Random::new(self.settings.seed, self.number | GUIDED_STREAM, index);
            let Some(path) = self.guided.sample(random) else { continue };
            light.rays += path.rays;
            for (place, density) in self.filter.around(path.path.film, self.scene.size) {
                let Some(pixel) = self.window.index(place) else { continue };
                let density = f64::from(density);
                let value = path.value * density / (density * path.unguided + all * path.guided);
                light.values.push((pixel as u32, value.as_vec3()));
            }
        }
        light
    }
}

impl Run<'_> {
    /// The picture that the rest of the budget allows.
    pub(super) fn guided_picture(&mut self, paths: &PathGuide, guides: Guides) -> Result<Rendered> {
        self.watcher.control.progress.message("rendering");
        self.state.position = Position { phase: Phase::Final, began: self.watcher.elapsed(), ..Position::default() };
        let rounds = match self.settings.stop {
            StopRule::Spp(spp) => {
                ((f64::from(spp) - self.state.spent) / (1.0 + self.settings.complete_paths)).max(1.0) as u64
            }
            _ => u64::MAX,
        };
        if let StopRule::Time(seconds) = self.settings.stop {
            self.watcher.deadline = Some(seconds);
        }
        let (mut pass, shares) = (self.empty_pass(), KernelShares::new(self.scene));
        let pool = Pool::default();
        self.watcher.begin_chunk();
        for number in 0..rounds {
            let Some((sum, goes_on)) = self.round((paths, guides), &shares, &pool, &pass, number) else { break };
            let finite = sum.into_iter().enumerate().filter(|(_, value)| value.is_finite());
            finite.for_each(|(pixel, value)| pass.add(pixel, number, value));
            self.state.spent += 1.0 + self.settings.complete_paths;
            if !goes_on {
                self.interrupted |= self.watcher.stopped() && number + 1 < rounds;
                break;
            }
        }
        // The first round is always whole. If all of its samples were left out it is black.
        let finished = self.finished(&pass);
        self.state.passes.push(finished);
        self.of_passes()
    }

    /// What a round adds to each pixel, not finite where that is to be left out, and whether there is time for another; none where there is
    /// none for all of it, unless it is the first.
    fn round(
        &mut self,
        (guide, guides): (&PathGuide, Guides),
        shares: &KernelShares,
        pool: &Pool<PathScratch>,
        pass: &Pass,
        number: u64,
    ) -> Option<(Vec<Vec3>, bool)> {
        let (scene, settings, pixels) = (self.scene, self.settings, self.pixels());
        let (mut sum, mut causes) = (vec![Vec3::ZERO; pixels as usize], HashMap::<u32, Cause>::new());
        let Guides { field, expected } = guides;
        let (mut start, mut goes_on) = (0, true);
        let drawn = |pixels: u64| (pixels as f64 * settings.complete_paths) as u64;
        // Weights go by the whole paths that are drawn.
        let ratio = drawn(pixels) as f64 / pixels as f64;
        while start < pixels {
            let (began, end) = (Instant::now(), (start + PIECE).min(pixels));
            let lights = (&self.lights).into();
            let round = Round {
                scene,
                settings,
                window: self.window,
                filter: &self.filter,
                tracer: PathTracer { scene, settings: settings.transport, field, lights },
                guided: GuidedTracer { scene, settings: settings.transport, field, expected, lights, guide, shares },
                shares,
                guides,
                ratio,
                number: u64::from(self.state.rendered) + number,
                first: self.state.rendered,
            };
            let statistics = &mut self.statistics;
            let mut add = |Light { values, rays, lost }| {
                values.into_iter().for_each(|(pixel, value)| sum[pixel as usize] += value);
                causes.extend(lost);
                statistics.rays += rays;
                statistics.camera_rays += rays;
            };
            in_blocks(start..end, pool, |scratch, pixels| round.unguided(pixels, scratch), &mut add);
            in_blocks(drawn(start)..drawn(end), pool, |_, numbers| round.guided(numbers), add);
            let samples = end - start + drawn(end) - drawn(start);
            self.statistics.samples += samples;
            self.statistics.seconds.trace += began.elapsed().as_secs_f64();
            start = end;
            let (views, passes) = (scene.views(), &self.state.passes);
            let so_far = || {
                let own = pass.finish_plain();
                combine_sheet(&passes.iter().chain([&own]).collect::<Vec<_>>(), views).ok()
            };
            let reached = (self.statistics.samples / pixels) as u32;
            goes_on = self.watcher.end_chunk(samples, reached, so_far, |_, _, _| Ok(()));
            if !goes_on && start < pixels && number > 0 {
                self.interrupted |= self.watcher.stopped();
                return None;
            }
        }
        let first = self.state.rendered;
        for (pixel, _) in (0u32..).zip(&sum).filter(|(_, value)| !value.is_finite()) {
            let (place, sample) = (self.window.place(pixel.into()), u64::from(first) + number);
            // A sum may be larger than any number even if its parts are not.
            let cause = causes.get(&pixel).copied().unwrap_or(Cause::Overflow);
            self.statistics.dropped_samples += 1;
            self.statistics.dropped.add(Dropped { pixel: place, sample, pass_from: Some(first), cause, view: None });
        }
        Some((sum, goes_on))
    }
}
