//! Scenes and settings at the edge: a defined picture or a typed error, never a panic or a value that is not finite.

#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::Error;
use fanal::base::progress::Silent;
use fanal::generate::build::{Builder, diffuse};
use fanal::materials::image::Image;
use fanal::reconstruct::Counted;
use fanal::render::{GuideMode, RenderSettings, StopRule, render};
use fanal::scene::Scene;
use fanal::scene::file::LightFile;
use glam::{Quat, Vec3};
use scenes::{GUIDES, built, mean, picture, settings};

/// A block on a floor under a square lamp of radiance `emission`.
fn room(size: [u32; 2], emission: f32) -> Builder {
    let mut b = Builder::new("room", size);
    let wall = b.add_material("wall", diffuse([0.6, 0.5, 0.4]));
    b.add_block("room", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.add_block("block", Vec3::new(-0.5, -0.99, -0.5), Vec3::new(0.0, 0.0, 0.0), &wall);
    b.add_quad("lamp", Vec3::new(0.3, 0.5, 0.3), [Vec3::X * 0.3, Vec3::Z * 0.3], &wall, Some([emission; 3]));
    b.look_at(Vec3::new(0.5, 0.4, 0.9), Vec3::new(-0.2, -0.5, 0.0), Vec3::Y, 70.0);
    b
}

/// All modes of all seeds must give pixels that are finite and not negative.
fn sane(scene: &Scene) -> Vec<f64> {
    GUIDES
        .into_iter()
        .flat_map(|guide| [true, false].map(|nee| (guide, nee)))
        .map(|(guide, nee)| {
            let mut settings = settings(guide, 16, 1);
            settings.transport.nee = nee;
            let image = picture(scene, &settings);
            assert_eq!(image.pixels.len(), (scene.size[0] * scene.size[1]) as usize);
            assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0), "{guide:?}, nee {nee}");
            mean(&image)
        })
        .collect()
}

#[test]
fn nothing_to_see_is_black() {
    let empty = Builder::new("empty", [8, 6]);
    assert!(sane(&built(empty.finish())).iter().all(|&m| m == 0.0));
    let mut dark = room([8, 6], 0.0);
    dark.render(20, 16);
    assert!(sane(&built(dark.finish())).iter().all(|&m| m == 0.0));
}

/// An empty scene under a sky shows the sky.
#[test]
fn a_sky_without_ground() {
    let mut b = Builder::new("sky", [8, 6]);
    b.add_light(LightFile::Constant { radiance: [0.25; 3] });
    assert!(sane(&built(b.finish())).iter().all(|m| (m - 0.25).abs() < 1e-6));
}

/// In the middle of a solid wall that lets no light in; and exactly on a surface, which may show either side.
#[test]
fn a_camera_inside_a_wall() {
    let mut b = room([8, 6], 10.0);
    b.look_at(Vec3::new(-0.25, -0.5, -0.25), Vec3::ZERO, Vec3::Y, 70.0);
    assert!(sane(&built(b.finish())).iter().all(|&m| m == 0.0));
    let mut b = room([8, 6], 10.0);
    b.look_at(Vec3::new(-0.25, 0.0, -0.25), Vec3::new(1.0, 0.0, 1.0), Vec3::Y, 70.0);
    sane(&built(b.finish()));
}

#[test]
fn one_pixel() {
    // Without light sampling, every other one, sixteen paths may all miss the lamp.
    assert!(sane(&built(room([1, 1], 10.0).finish())).iter().step_by(2).all(|&m| m > 0.0));
}

#[test]
fn budgets_without_samples_are_refused() {
    let scene = built(room([4, 4], 1.0).finish());
    let refused = |settings: &RenderSettings| {
        let outcome = render(&scene, settings, &Counted::default(), &Silent, &AtomicBool::new(false));
        matches!(outcome, Err(Error::Options(_)))
    };
    for stop in [StopRule::Spp(0), StopRule::Time(0.0), StopRule::Time(-1.0), StopRule::Time(f64::NAN)] {
        assert!(refused(&RenderSettings::new(GuideMode::Hybrid, stop)), "{stop:?}");
    }
    let mut settings = RenderSettings::new(GuideMode::None, StopRule::Spp(1));
    settings.transport.max_depth = 0;
    assert!(refused(&settings));
}

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

/// Radiance × 2^±66 (about 1e±20) gives the same picture, as much brighter, pixel by pixel: the factor is a power of two, so it
/// rounds nothing and no decision may change. Catches absolute thresholds in the trees, squares that overflow or vanish, and
/// roulette or pass weights that depend on the unit of radiance.
#[test]
fn a10_the_unit_of_radiance_does_not_matter() {
    for guide in GUIDES {
        let render =
            |factor: f32| -> Image { picture(&built(room([24, 18], 10.0 * factor).finish()), &settings(guide, 64, 1)) };
        let expected = render(1.0);
        for factor in [2f32.powi(66), 2f32.powi(-66)] {
            for (pixel, expected) in render(factor).pixels.iter().zip(&expected.pixels) {
                let difference = (*pixel / factor - *expected).abs().max_element();
                assert!(difference <= 1e-3 * expected.max_element(), "{guide:?} ×{factor}: {pixel} {expected}");
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
        let outcome = render(&scene, &settings, &Counted::default(), &Silent, &AtomicBool::new(false));
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
