//! A picture is a function of its settings: the number of threads does not enter, the seed does.

use crate::support::scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::render::{RenderSettings, render};
use fanal::scene::Scene;
use scenes::{GUIDES, Guide, committed, reconstructor, settings};

/// The bits of a picture rendered by `threads` threads.
fn bits(scene: &Scene, guide: Guide, seed: u64, threads: usize) -> Vec<[u32; 3]> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads can be had");
    let (settings, reconstructor) = (settings(guide, 32, seed), reconstructor(guide.0));
    let outcome = pool.install(|| render(scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)));
    let image = outcome.expect("the settings are sound").image;
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

/// Catches sums whose order depends on scheduling, random numbers keyed by thread, and decisions taken by the clock; and a
/// seed that is ignored by a part.
#[test]
fn threads_change_nothing_and_seeds_all() {
    let scene = committed("door-ajar", [32, 24]);
    for guide in GUIDES {
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
