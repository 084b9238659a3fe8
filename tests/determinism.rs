//! A picture is a function of its settings: the number of threads does not enter, the seed does.

#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;
#[path = "support/network.rs"]
#[allow(dead_code, reason = "shared with the tests of the backends")]
mod support;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::network::embedded::Embedded;
use fanal::reconstruct::{Counted, Neural, Reconstructor};
use fanal::render::{GuideMode, SampleKinds, render};
use fanal::scene::Scene;
use scenes::{committed, settings};

/// The bits of a picture rendered by `threads` threads.
fn bits(
    scene: &Scene,
    guide: GuideMode,
    seed: u64,
    reconstructor: &dyn Reconstructor,
    threads: usize,
) -> Vec<[u32; 3]> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
    let settings = settings((guide, SampleKinds::Both), 32, seed);
    let outcome = pool.install(|| render(scene, &settings, reconstructor, &Silent, &AtomicBool::new(false)));
    let image = outcome.expect("the settings are sound").image;
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

/// Catches sums whose order depends on scheduling, random numbers keyed by thread, and decisions taken by the clock; and a
/// seed that is ignored by a part.
fn check(guide: GuideMode, reconstructor: &dyn Reconstructor) {
    let scene = committed("door-ajar", [32, 24]);
    let one = bits(&scene, guide, 1, reconstructor, 1);
    for threads in [2, 3] {
        assert!(one == bits(&scene, guide, 1, reconstructor, threads), "{guide:?}: {threads} threads");
    }
    let other = bits(&scene, guide, 2, reconstructor, 2);
    let lit = one.iter().zip(&other).filter(|(a, b)| **a != [0; 3] || **b != [0; 3]);
    let (equal, all) = lit.fold((0, 0), |(equal, all), (a, b)| (equal + usize::from(a == b), all + 1));
    // Many pixels of this dark room are black by chance; of the others hardly one has the same bits twice.
    assert!(all > 50 && equal * 10 < all, "{guide:?}: {equal} of {all} pixels are equal under another seed");
}

#[test]
fn unguided() {
    check(GuideMode::None, &Counted::default());
}

#[test]
fn hybrid() {
    check(GuideMode::Hybrid, &Counted::default());
}

#[test]
fn neural() {
    let model = support::model(support::config(8, 1, false), 1);
    let backend = Box::new(Embedded::new(&model).expect("the model is sound"));
    check(GuideMode::Neural, &Neural { model, backend });
}
