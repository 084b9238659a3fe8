//! A picture is a function of its settings: the number of threads does not enter, the seed does.

use crate::support::scenes;

use std::ops::Range;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::guiding::learn::emission::EmissionGuide;
use fanal::integrators::path::{CameraPath, PathScratch, PathTracer};
use fanal::integrators::photon::{PhotonScratch, PhotonTracer};
use fanal::integrators::{Roulette, TransportSettings};
use fanal::lights::learned::LightSampling;
use fanal::render::{Iteration, Outcome, RenderSettings, render};
use fanal::scene::{Scene, readers};
use rayon::prelude::*;
use scenes::{GUIDES, Guide, NILSSON, OURS, ZHU, committed, reconstructor, settings};

/// The bits of a picture rendered by `threads` threads.
fn bits(scene: &Scene, guide: Guide, seed: u64, threads: usize) -> Vec<[u32; 3]> {
    bits_with(scene, settings(guide, 32, seed), threads)
}

fn bits_with(scene: &Scene, settings: RenderSettings, threads: usize) -> Vec<[u32; 3]> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
    let reconstructor = reconstructor(settings.guide);
    let outcome = pool.install(|| render(scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)));
    let image = outcome.expect("the settings are sound").image;
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

/// Catches sums whose order depends on scheduling, random numbers keyed by thread, and decisions taken by the clock; and a
/// seed that is ignored by a part.
#[test]
fn threads_change_nothing_and_seeds_all() {
    let scene = committed("door-ajar", [32, 24]);
    for guide in GUIDES.into_iter().chain([NILSSON]) {
        let one = bits(&scene, guide, 1, 1);
        for threads in [2, 3] {
            assert!(one == bits(&scene, guide, 1, threads), "{guide:?}: {threads} threads");
        }
        let other = bits(&scene, guide, 2, 2);
        let lit = one.iter().zip(&other).filter(|(a, b)| **a != [0; 3] || **b != [0; 3]);
        let (equal, all) = lit.fold((0, 0), |(equal, all), (a, b)| (equal + usize::from(a == b), all + 1));
        // Many pixels of this dark room are black by chance; of the others hardly one has the same bits twice.
        assert!(all > 50 && equal * 10 < all, "{guide:?}: {equal} of {all} pixels are equal under another seed");
    }
}

/// Nor where light is found by chance alone, and fractions of BSDF samples go by it.
#[test]
fn threads_change_nothing_without_light_sampling() {
    let scene = committed("cornell", [32, 24]);
    let [one, three] = [1, 3].map(|threads| bits(&scene, ZHU, 1, threads));
    assert!(one == three && one.iter().filter(|pixel| **pixel != [0; 3]).count() > 300);
    assert!(one != bits(&scene, ZHU, 2, 3));
}

/// Nor does what a pixel deserves depend on who traced its neighbours.
#[test]
fn threads_change_nothing_where_samples_follow_noise() {
    let scene = committed("glass-caustic", [32, 24]);
    for guide in [GUIDES[0], GUIDES[5]] {
        let adaptive = RenderSettings { adaptive: true, ..settings(guide, 32, 1) };
        let [one, two] = [1, 2].map(|threads| bits_with(&scene, adaptive.clone(), threads));
        assert!(one == two, "{guide:?}");
        assert!(one != bits(&scene, guide, 1, 1), "{guide:?}: nothing was divided");
    }
}

/// Nor where guides are tried: what they cost is counted in rays then. Samples that are compared are no part of the picture, but of the budget.
#[test]
fn threads_change_nothing_where_guides_are_tried() {
    let scene = committed("cornell", [64, 48]);
    let settings = RenderSettings { gives_up: true, keeps_spread: true, ..settings(GUIDES[5], 512, 1) };
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
        let reconstructor = reconstructor(settings.guide);
        let made = pool.install(|| render(&scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)));
        let Outcome { image, spread, statistics, .. } = made.expect("the settings are sound");
        let costs: Vec<f64> = statistics.iterations.iter().map(|iteration| iteration.cost).collect();
        let spent = |i: &Iteration| f64::from(i.spp) * (1.0 + i.photon_share);
        let learned: f64 = statistics.iterations.iter().map(spent).sum();
        let bits: Vec<_> = image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
        (bits, costs, learned, spread.expect("it was asked for").samples)
    };
    let (one, two) = (of(1), of(2));
    let (_, costs, learned, samples) = &one;
    assert!(costs.iter().any(|cost| *cost != costs[0]), "{costs:?}: no guide was tried");
    let learned_too = samples.iter().map(|&samples| f64::from(samples)).fold(0.0, f64::max) + learned;
    assert!(learned_too > 500.0 && samples.iter().all(|&samples| samples < 510), "{learned} {}", samples[0]);
    assert!(one == two);
}

/// Nor where flights and shadow rays take as many random numbers as they need.
#[test]
fn threads_change_nothing_in_smoke() {
    let scene = committed("smoke", [32, 24]);
    for guide in [GUIDES[0], GUIDES[6]] {
        let [one, three] = [1, 3].map(|threads| bits(&scene, guide, 1, threads));
        assert!(one == three && one.iter().any(|pixel| *pixel != [0; 3]), "{guide:?}");
    }
}

/// The easy box is rendered as by `none` after learning has shown that, and the door is not.
#[test]
fn guiding_is_left_out_where_it_does_not_pay() {
    for (name, guided) in [("cornell", false), ("door-ajar", true)] {
        let scene = committed(name, [64, 48]);
        let settings = RenderSettings { gives_up: true, ..settings(GUIDES[5], 96, 1) };
        let outcome = render(&scene, &settings, reconstructor(GUIDES[5].0).as_ref(), &Silent, &AtomicBool::new(false));
        let statistics = outcome.expect("the settings are sound").statistics;
        assert_eq!(statistics.guide.trees > 0, guided, "{name}: {:?}", statistics.iterations);
    }
}

/// All that paths and light paths tell, traced in batches of `size`.
fn told(scene: &Scene, paths: u64, size: u64) -> [Vec<String>; 3] {
    let transport = TransportSettings {
        max_depth: 12,
        light_sampling: true,
        roulette: Roulette::Throughput,
        guided_distances: false,
    };
    let emission = EmissionGuide::new(&scene.lights.emission);
    let tracer = PathTracer { scene, settings: transport, field: None, lights: LightSampling::Plain };
    let photon_tracer = PhotonTracer { scene, settings: transport, emission: &emission };
    let begin = |number: u64| {
        let random = Random::new(7, number, 0);
        let film = [(number % 32) as f32 + 0.5, (number / 32 % 24) as f32 + 0.5];
        CameraPath { ray: scene.camera.ray(film, scene.camera.lens(&random)), random, pixel: None }
    };
    let (mut scratch, mut photon_scratch) = (PathScratch::default(), PhotonScratch::default());
    let (mut radiance, mut records, mut photons, mut rays) = (vec![], vec![], vec![], 0);
    for first in (0..paths).step_by(size as usize) {
        let range = first..(first + size).min(paths);
        let all = |numbers: Range<u64>, paths: &mut Vec<CameraPath>| paths.extend(numbers.map(begin));
        let block = tracer.trace_block(range.clone(), all, true, &mut scratch);
        radiance.extend(block.radiance.iter().map(|radiance| format!("{radiance:?}")));
        records.extend(block.records.iter().map(|record| format!("{record:?}")));
        let random = |number| Random::new(8, 0, number);
        let light = photon_tracer.trace_block(range, (0, paths), random, &mut photon_scratch);
        photons.extend(light.photons.iter().map(|photon| format!("{photon:?}")));
        rays += block.rays.rays + light.rays.rays;
    }
    radiance.push(format!("{rays} rays"));
    [radiance, records, photons]
}

/// No path knows which others it is traced with: every size of batches gives the same radiance, records and photons, to the last bit,
/// on a plain scene, one with glass, one in a medium that varies, and one with every material, holes, bumps and media.
#[test]
fn batches_change_nothing() {
    let museum = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/museum");
    let museum =
        Scene::build(&readers::load(&museum).expect("the museum is sound"), [32, 24]).expect("so is what it says");
    // Of the light outside little gets through the window.
    let scenes = [("cornell", 500), ("glass-caustic", 500), ("smoke", 50)];
    let scenes = scenes.map(|(name, least)| (committed(name, [32, 24]), least));
    for (scene, least) in scenes.into_iter().chain([(museum, 500)]) {
        let alone = told(&scene, 700, 1);
        assert!(alone.iter().all(|told| told.len() > least), "{:?}", alone.map(|told| told.len()));
        for size in [3, 16, 17, 700] {
            assert!(told(&scene, 700, size) == alone, "{}: batches of {size}", scene.name);
        }
    }
}

/// Nor do small and large batches differ on any other scene of ours.
#[test]
fn batches_of_sixteen_and_of_thousands_are_the_same() {
    const LARGE: u64 = 16_384;
    OURS.into_par_iter().for_each(|name| {
        let scene = committed(name, [32, 24]);
        let [small, large] = [16, LARGE].map(|size| told(&scene, LARGE + 10, size));
        assert!(small[0].len() as u64 > LARGE && small[0] == large[0], "{name}: radiance");
        assert!(!small[1].is_empty() && small[1] == large[1], "{name}: records");
        assert!(small[2] == large[2], "{name}: photons");
    });
}
