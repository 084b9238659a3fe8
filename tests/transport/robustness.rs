//! Size, place, brightness and memory must not matter.

use crate::support::scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::picture::Image;
use fanal::reconstruct::AsCounted;
use fanal::render::render;
use glam::{Quat, Vec3};
use scenes::{GUIDES, built, coarse, mean, picture, room, settings};

/// Mean of the room scaled and moved, over the mean where it was made. Bound of 2 %: the mean of 24×18 pixels at 64 spp has a
/// standard error of about 0.4 %, and where random numbers fall on the same surfaces the two differ by far less.
fn moved(scale: f32, shift: f32) {
    for guide in [GUIDES[0], GUIDES[1]] {
        let at = |scale: f32, shift: f32| {
            let mut b = room([24, 18], 10.0);
            b.transform(scale, Quat::IDENTITY, Vec3::new(shift, -shift, shift));
            mean(&picture(&built(b.finish()), &settings(guide, 64, 1)))
        };
        let (found, expected) = (at(scale, shift), at(1.0, 0.0));
        assert!((found / expected - 1.0).abs() < 0.02, "{guide:?}, ×{scale} at {shift}: {found} {expected}");
    }
}

/// Catches ray offsets, shadow rays, box tests and voxels with absolute sizes.
#[test]
fn a06_scale_does_not_matter() {
    moved(1e-4, 0.0);
    moved(1e4, 0.0);
}

/// A scene of unit size at 1e6 units would be below the resolution of single precision (1/16 there), so it is made 1000 times
/// larger first.
#[test]
fn a06_place_does_not_matter() {
    moved(1e3, 1e6);
}

/// Radiance × 2^±66 (about 1e±20) gives the same bits, but for the factor: it is a power of two, so it rounds nothing
/// and no decision may change. Catches absolute thresholds in the trees, squares that overflow or vanish, and roulette
/// or pass weights that depend on the unit of radiance.
#[test]
fn a10_the_unit_of_radiance_does_not_matter() {
    for guide in GUIDES {
        let render =
            |factor: f32| -> Image { picture(&built(room([24, 18], 10.0 * factor).finish()), &coarse(guide, 64, 1)) };
        let expected = render(1.0);
        for factor in [2f32.powi(66), 2f32.powi(-66)] {
            for (pixel, expected) in render(factor).pixels.iter().zip(&expected.pixels) {
                assert_eq!(*pixel / factor, *expected, "{guide:?} ×{factor}");
            }
        }
    }
}

/// The ceiling of the field is kept, also one far below what the scene would like, and guiding goes on.
#[test]
fn a05_the_field_stays_below_its_ceiling() {
    let scene = built(room([64, 48], 10.0).finish());
    let size = |memory: usize| {
        let mut settings = settings(GUIDES[1], 128, 1);
        settings.learner.memory = memory;
        let outcome = render(&scene, &settings, &AsCounted::default(), &Silent, &AtomicBool::new(false));
        outcome.expect("the settings are sound").statistics.guide
    };
    let free = size(24 << 20);
    assert!(free.bytes > 1 << 19 && free.bytes <= 24 << 20, "{free:?}: too little to cut something off");
    for memory in [free.bytes * 3 / 4, free.bytes * 3 / 8] {
        let guide = size(memory);
        assert!(guide.bytes <= memory && guide.trees > 0 && guide.nodes > guide.trees, "{memory}: {guide:?}");
    }
    // Too little for all voxels, then for any.
    for memory in [64 << 10, 1 << 10, 0] {
        let guide = size(memory);
        assert!(guide.bytes <= memory, "{memory}: {guide:?}");
    }
}
