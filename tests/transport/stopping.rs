//! Renders that end by what they have seen: the picture must not know.

use crate::support::{scenes, statistics};

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::film::measure;
use fanal::reconstruct::AsCounted;
use fanal::render::{Control, Outcome, RenderSettings, StopRule, learn, learn_whole, render, render_with_field};
use fanal::scene::Scene;
use scenes::{GUIDES, Guide, committed, mean, picture, settings};
use statistics::Summary;

fn stopped(scene: &Scene, guide: Guide, error: f64, seed: u64) -> Outcome {
    let settings = RenderSettings { stop: StopRule::TargetError(error), ..settings(guide, 1, seed) };
    render(scene, &settings, &AsCounted::default(), &Silent, &AtomicBool::new(false)).expect("the settings are sound")
}

/// The mean over 600 renders that stopped at an error of 0.7 is that of renders of a fixed length: Welch's test at 0.01. The
/// scene is dark with rare bright paths, where a rule that looks at the picture's own samples stops early on dark pictures: it
/// loses 7 % of the light, five standard errors.
#[test]
fn stopping_at_an_error_does_not_darken() {
    let scene = committed("door-ajar", [8, 6]);
    let fixed: Vec<f64> =
        (0..100).map(|seed| mean(&picture(&scene, &settings(GUIDES[0], 1024, 9000 + seed)))).collect();
    let truth = Summary::new(&fixed);
    let outcomes: Vec<Outcome> = (0..600).map(|seed| stopped(&scene, GUIDES[0], 0.7, seed)).collect();
    let spp: std::collections::BTreeSet<u32> = outcomes.iter().map(|o| o.statistics.spp).collect();
    assert!(spp.len() > 3, "the rule must have had something to decide: {spp:?}");
    let found = Summary::new(&outcomes.iter().map(|o| mean(&o.image)).collect::<Vec<_>>());
    assert!(found.error() < 0.03 * truth.mean, "the test could not see a bias: {found:?}");
    assert!(found.welch(&truth, 0.01) < 1.0, "stopped {found:?}, fixed {truth:?}");
}

/// The error reached is the one asked for, within a factor that covers a picture of 768 pixels: not a promise of the estimate's
/// quality, which the bench measures, but of the rule's arithmetic (halves, means, variances per sample).
#[test]
fn the_error_asked_for_is_reached() {
    let scene = committed("cornell", [32, 24]);
    let reference = picture(&scene, &settings(GUIDES[0], 8192, 77));
    for guide in [GUIDES[0], GUIDES[1]] {
        for target in [0.004, 0.0015] {
            let outcome = stopped(&scene, guide, target, 5);
            let error = measure(&outcome.image, &reference).expect("same size").relmse;
            let estimate = outcome.statistics.estimated_relmse.expect("it ran to a target");
            assert!((0.6..1.4).contains(&(error / target)), "{guide:?}: {error} instead of {target}");
            assert!((0.7..1.1).contains(&(estimate / target)), "{guide:?}: estimated {estimate} instead of {target}");
        }
    }
}

/// A picture that is still black has no noise at all: that no path has found the light of a spot of 3.5 mm so far is no reason to end.
#[test]
fn a_black_beginning_is_not_the_end() {
    let scene = committed("spot", [4, 3]);
    for seed in 0..8 {
        let outcome = stopped(&scene, GUIDES[0], 3.0, seed);
        let spp = outcome.statistics.spp;
        assert!(mean(&outcome.image) > 0.0 || spp >= 512, "seed {seed}: black after {spp} samples per pixel");
    }
}

/// However short the time, there is a picture: one sample in every pixel, even where learning took all of it.
#[test]
fn no_time_at_all_still_gives_a_picture() {
    let scene = committed("cornell", [64, 48]);
    for guide in GUIDES {
        let settings = RenderSettings { stop: StopRule::Time(1e-3), ..settings(guide, 1, 5) };
        let image = picture(&scene, &settings);
        assert!(mean(&image) > 0.0 && image.pixels.iter().all(|p| p.is_finite()), "{guide:?}");
    }
}

/// One sample per pixel has no room for learning in a large picture: iterations visit some of the pixels, and none must be left out.
#[test]
fn one_sample_is_one_in_every_pixel() {
    let scene = committed("cornell", [512, 384]);
    for guide in GUIDES {
        let settings = settings(guide, 1, 5);
        let image = picture(&scene, &settings);
        let rows = image.pixels.chunks(image.width).collect::<Vec<_>>();
        let copies = rows.windows(2).filter(|pair| pair[0] == pair[1]).count();
        assert_eq!(copies, 0, "{guide:?}: rows that are copies of others");
    }
}

/// Who only learns does so until the time is up: every iteration but the last has all of its paths.
#[test]
fn learning_alone_takes_all_of_its_time() {
    let scene = committed("cornell", [64, 48]);
    let stop = AtomicBool::new(false);
    let control = Control::new(&Silent, &stop);
    let settings = RenderSettings { stop: StopRule::Time(2.0), ..settings(GUIDES[1], 1, 3) };
    let learned = learn_whole(&scene, &settings, &AsCounted::default(), &control).unwrap();
    let [before @ .., _] = &learned.statistics.iterations[..] else { panic!("nothing was learned") };
    let paths: u64 = before.iter().map(|iteration| u64::from(iteration.spp) * 64 * 48).sum();
    assert!(learned.statistics.samples >= paths, "{} of {paths}", learned.statistics.samples);
}

/// A field learned once guides other renders: the whole budget goes into the picture, which stays what it is.
#[test]
fn a_learned_field_can_be_used_again() {
    let scene = committed("cornell", [32, 24]);
    let stop = AtomicBool::new(false);
    let control = Control::new(&Silent, &stop);
    let settings = settings(GUIDES[1], 64, 3);
    let field = learn(&scene, &settings, &AsCounted::default(), &control).expect("the settings are sound");
    assert!(field.voxels().iter().any(|v| v.directions.is_some()));
    let means: Vec<f64> = (0..12)
        .map(|seed| {
            let settings = RenderSettings { seed: 100 + seed, stop: StopRule::Spp(16), ..settings.clone() };
            let outcome =
                render_with_field(&scene, &settings, field.clone(), &control).expect("the settings are sound");
            assert_eq!((outcome.statistics.spp, outcome.statistics.iterations.len()), (16, 0));
            mean(&outcome.image)
        })
        .collect();
    let plain: Vec<f64> = (0..12).map(|seed| mean(&picture(&scene, &scenes::settings(GUIDES[0], 64, seed)))).collect();
    assert!(Summary::new(&means).welch(&Summary::new(&plain), 0.001) < 1.0);
}
