//! A picture is a function of its settings: the number of threads does not enter, the seed does.

#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::render::render;
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
