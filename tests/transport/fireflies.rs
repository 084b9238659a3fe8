//! Fireflies are taken out of finished pictures: nothing else changes, what is left and what is taken out are the plain picture, and little is
//! taken out where nothing stands alone.

use crate::support::scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::picture::Image;
use fanal::render::{Fireflies, Outcome, RenderSettings, StopRule, render};
use fanal::scene::Scene;
use glam::Vec3;
use scenes::{GUIDES, box_furnace, built, coarse, committed, mean, outcome, reconstructor, room, settings};

const REWEIGHT: Fireflies = Fireflies::Reweight { kappa: Fireflies::KAPPA };

fn reweighted(settings: &RenderSettings) -> RenderSettings {
    RenderSettings { fireflies: REWEIGHT, ..settings.clone() }
}

fn taken(outcome: &Outcome) -> &Image {
    outcome.fireflies.as_ref().expect("they are taken out")
}

/// The part of the light that is taken out.
fn share(outcome: &Outcome) -> f64 {
    let taken = mean(taken(outcome));
    taken / (taken + mean(&outcome.image))
}

/// Holds both pictures together against the plain one, but for two roundings.
fn assert_whole(scene: &Scene, settings: &RenderSettings) -> f64 {
    let (plain, judged) = (outcome(scene, settings), outcome(scene, &reweighted(settings)));
    let what = (settings.guide, settings.stop);
    assert!(plain.fireflies.is_none() && plain.cascade.is_none() && judged.cascade.is_none(), "{what:?}");
    let both = judged.image.pixels.iter().zip(&taken(&judged).pixels);
    for ((&kept, &taken), &plain) in both.zip(&plain.image.pixels) {
        let off = (kept + taken - plain).abs();
        assert!(off.cmple(2.0 * f32::EPSILON * plain).all(), "{what:?}: {kept} and {taken} of {plain}");
        assert!(kept.cmpge(Vec3::ZERO).all() && taken.cmpge(Vec3::ZERO).all(), "{what:?}");
    }
    assert_eq!(plain.statistics.rays, judged.statistics.rays, "{what:?}");
    share(&judged)
}

/// In every mode, with passes that are combined, samples that follow noise, a target error, and without a single pixel sampled twice.
#[test]
fn s10_both_pictures_are_the_plain_one() {
    let scene = committed("door-ajar", [48, 36]);
    for guide in GUIDES {
        let share = assert_whole(&scene, &coarse(guide, 64, 1));
        assert!(share > 0.0 && share < 0.6, "{guide:?}: {share}");
    }
    let guided = coarse(GUIDES[5], 96, 2);
    assert_whole(&scene, &RenderSettings { adaptive: true, ..guided.clone() });
    assert_whole(&scene, &RenderSettings { keeps_spread: true, ..guided });
    assert_whole(&scene, &settings(GUIDES[0], 1, 3));
    assert_whole(&scene, &RenderSettings { stop: StopRule::TargetError(0.5), ..settings(GUIDES[0], 1, 2) });
}

/// Walls that all shine alike: samples lie within a factor of 10 of one another, and none of them is lone. No light is taken out of 16 samples per
/// pixel, and of a room's, lamp and all, a thousandth at most (measured: 2e-4).
#[test]
fn s10_what_has_company_stays() {
    let furnace = built(box_furnace(0.5));
    for guide in [GUIDES[0], GUIDES[1], GUIDES[5]] {
        let judged = outcome(&furnace, &reweighted(&settings(guide, 16, 1)));
        assert!(share(&judged) < 1e-5, "{guide:?}: {}", share(&judged));
    }
    let judged = outcome(&built(room([48, 36], 10.0).finish()), &reweighted(&settings(GUIDES[0], 64, 1)));
    assert!(share(&judged) < 1e-3, "{}", share(&judged));
}

/// With more samples, what was lone has company: 256 times the samples leave less than a quarter of what was taken out.
#[test]
fn s10_nothing_is_taken_out_of_many_samples() {
    let scene = committed("glass-caustic", [24, 18]);
    let [few, some, many] =
        [16, 256, 4096].map(|spp| share(&outcome(&scene, &reweighted(&settings(GUIDES[0], spp, 1)))));
    assert!(few > some && some > many && many < 0.25 * few, "{few}, {some}, {many}");
}

#[test]
fn s10_threads_take_out_the_same() {
    let scene = committed("glass-caustic", [32, 24]);
    for settings in [settings(GUIDES[0], 96, 1), settings(GUIDES[5], 64, 1)] {
        let bits = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
            let (settings, reconstructor) = (reweighted(&settings), reconstructor(settings.guide));
            let made =
                || render(&scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).expect("sound");
            let made = pool.install(made);
            let pixels = made.image.pixels.iter().chain(&taken(&made).pixels);
            pixels.map(|pixel| pixel.to_array().map(f32::to_bits)).collect::<Vec<_>>()
        };
        assert!(bits(1) == bits(3), "{:?}", settings.guide);
    }
}

/// A unit of radiance that is a power of 8 changes nothing but the unit.
#[test]
fn s10_the_unit_of_radiance_does_not_matter() {
    let made =
        |emission: f32| outcome(&built(room([24, 18], emission).finish()), &reweighted(&settings(GUIDES[0], 8, 1)));
    let scale = 2f32.powi(-30);
    let (one, other) = (made(10.0), made(10.0 * scale));
    assert!(share(&one) > 0.0);
    let pairs = [(&one.image, &other.image), (taken(&one), taken(&other))];
    for (a, b) in pairs.into_iter().flat_map(|(a, b)| a.pixels.iter().zip(&b.pixels)) {
        assert!((*a * scale - *b).abs().max_element() <= 1e-6 * scale * a.max_element(), "{a} and {b}");
    }
}
