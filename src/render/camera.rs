//! Camera samples: where in the picture each lies, its ray, and the random numbers that its path goes on with; for sixteen at once, or
//! for one.

use super::settings::RenderSettings;
use crate::base::random::{Dimension, Generators, Random, keys};
use crate::film::PixelFilter;
use crate::geometry::{Ray, Surface};
use crate::math::lanes::{self, Kernel, LANES, Vectors, Wide, vector};
use crate::scene::Scene;

/// Makes the sequences of camera paths differ from their independent numbers.
const SEQUENCE_SEED: u64 = 0x5EED_0F5E_7B0B_0105;

/// One camera sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct CameraSample {
    /// Column and row in the whole picture, or the sheet of several.
    pub place: [u32; 2],
    /// Its number among all of the pixel's.
    pub number: u64,
    /// The number at which the sequences of its pass begin; none where its random numbers are independent.
    pub sequences_from: Option<u32>,
}

/// Camera samples of one pass: the view of each, the corner of its pixel in the picture of that, and its random numbers. They go by the
/// place in that picture: on a sheet as alone. The even and the odd samples of a pass follow sequences of their own, since each half
/// judges the other and must know nothing of it.
#[inline(always)]
fn placed<const N: usize>(
    scene: &Scene,
    seed: u64,
    samples: &[CameraSample; N],
) -> ([usize; N], [[f32; 2]; N], [Random; N]) {
    let (mut views, mut corners) = ([0; N], [[0.0; 2]; N]);
    let (mut pixels, mut numbers) = ([0; N], [0; N]);
    for (lane, sample) in samples.iter().enumerate() {
        let [column, row] = sample.place;
        let (view, within) = scene.view_of(row);
        views[lane] = view;
        corners[lane] = [column as f32, within as f32];
        pixels[lane] = u64::from(within) * u64::from(scene.size[0]) + u64::from(column);
        numbers[lane] = sample.number;
    }
    let mut randoms = Random::many(seed, &pixels, &numbers);
    if let Some(start) = samples[0].sequences_from.map(u64::from) {
        let (mut halves, mut points) = ([0; N], [0; N]);
        for lane in 0..N {
            let point = numbers[lane] - start;
            halves[lane] = 2 * start + point % 2;
            points[lane] = (point / 2) as u32;
        }
        randoms = Random::all_in_sequences(randoms, &keys(seed ^ SEQUENCE_SEED, &pixels, &halves), &points);
    }
    (views, corners, randoms)
}

/// A corner of a pixel, and where in its surroundings a sample lies.
#[inline(always)]
fn on_film([column, row]: [f32; 2], filter: &PixelFilter, u: [f32; 2]) -> [f32; 2] {
    let [dx, dy] = filter.sample(u);
    [column + dx, row + dy]
}

/// The ray of a camera sample, and the random numbers that its path goes on with.
pub(super) fn camera_ray(
    scene: &Scene,
    settings: &RenderSettings,
    filter: &PixelFilter,
    sample: CameraSample,
) -> (Ray, Random) {
    let (view, film, random) = camera_film(scene, settings, filter, sample);
    (scene.camera_ray(view, film, scene.camera_of(view).lens(&random)), random)
}

/// The view of a camera sample, its place in the picture of that, and its random numbers.
pub(super) fn camera_film(
    scene: &Scene,
    settings: &RenderSettings,
    filter: &PixelFilter,
    sample: CameraSample,
) -> (usize, [f32; 2], Random) {
    let ([view], [corner], [random]) = placed(scene, settings.seed, &[sample]);
    let film = on_film(corner, filter, random.at(Dimension::FILM).next_2d());
    (view, film, random)
}

/// The first surface on the ray of a camera sample, whatever it is made of, at its distance from where rays of the camera start, with the ray; none where it
/// hits nothing.
pub(super) fn first_surface(
    scene: &Scene,
    settings: &RenderSettings,
    filter: &PixelFilter,
    sample: CameraSample,
) -> Option<(Ray, Surface)> {
    let (view, film, mut random) = camera_film(scene, settings, filter, sample);
    let (camera, lens) = (scene.camera_of(view), scene.camera_of(view).lens(&random));
    let ray = scene.camera_ray(view, film, lens);
    random.begin_vertex(1);
    let mut surface = scene.trace(&ray, &mut random.at(Dimension::SEGMENT))?;
    if scene.hides_emitters {
        surface.distance += camera.ray(film, lens).origin.distance(ray.origin);
    }
    Some((ray, surface))
}

/// Gives the [`camera_ray`] of each of these samples, which are of one pass, to `take`, with what else is said of it.
pub(super) fn camera_rays<T: Copy>(
    scene: &Scene,
    settings: &RenderSettings,
    filter: &PixelFilter,
    samples: impl Iterator<Item = (CameraSample, T)>,
    mut take: impl FnMut(Ray, Random, T),
) {
    let mut samples = samples.peekable();
    while let Some(&first) = samples.peek() {
        // Lanes behind the last sample repeat the first, and are not looked at.
        let (mut group, mut said, mut count) = ([first.0; LANES], [first.1; LANES], 0);
        for (sample, of) in samples.by_ref().take(LANES) {
            (group[count], said[count]) = (sample, of);
            count += 1;
        }
        let begin = Begin { scene, seed: settings.seed, filter, samples: &group };
        let together = if count < FEWEST { None } else { lanes::run(begin).ok().flatten() };
        if let Some(Begun { origins, directions, randoms }) = together {
            for (lane, (random, of)) in randoms.into_iter().zip(said).enumerate().take(count) {
                let ray = Ray { origin: vector(&origins, lane), direction: vector(&directions, lane) };
                take(scene.past_hidden(ray), random, of);
            }
        } else {
            for (sample, of) in group.into_iter().zip(said).take(count) {
                let (ray, random) = camera_ray(scene, settings, filter, sample);
                take(ray, random, of);
            }
        }
    }
}

/// Fewest samples that are worth lanes.
const FEWEST: usize = 3;

/// Camera samples that begin.
struct Begin<'c> {
    scene: &'c Scene,
    seed: u64,
    filter: &'c PixelFilter,
    samples: &'c [CameraSample; LANES],
}

/// Their rays and random numbers.
struct Begun {
    origins: Vectors,
    directions: Vectors,
    randoms: [Random; LANES],
}

impl Kernel for Begin<'_> {
    /// None for samples of several views.
    type Output = Option<Begun>;

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Option<Begun> {
        let (views, corners, randoms) = placed(self.scene, self.seed, self.samples);
        if views != [views[0]; LANES] {
            return None;
        }
        let camera = self.scene.camera_of(views[0]);
        let generators = Generators::<LANES>::new(|lane| &randoms[lane]);
        let mut film = generators.draw(Dimension::FILM).points();
        for (place, corner) in film.iter_mut().zip(corners) {
            *place = on_film(corner, self.filter, *place);
        }
        let lens = if camera.has_lens() { generators.draw(Dimension::LENS).points() } else { [[0.5; 2]; LANES] };
        let (origins, directions) = camera.rays(wide.points(&film), wide.points(&lens));
        let (origins, directions) = (wide.store_vectors(origins), wide.store_vectors(directions));
        Some(Begun { origins, directions, randoms })
    }
}
