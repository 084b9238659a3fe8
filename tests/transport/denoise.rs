//! What a denoiser is told of a picture, and what it makes of it. The latter needs Open Image Denoise's shared library: without it
//! (`OIDN_DYLIB_PATH`, which `tests/fetch-oidn.sh` prints) those tests say so and check nothing.

use crate::support::scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::film::{Denoiser, Features, measure};
use fanal::generate::build::{Builder, diffuse, glass};
use fanal::picture::{Image, Window};
use fanal::render::{Aov, GuideMode, RenderSettings, StopRule, aov, features, render};
use fanal::scene::file::{MaterialFile, TextureFile};
use glam::Vec3;
use scenes::{built, committed, picture, reconstructor};

const RED: [f32; 3] = [0.8, 0.1, 0.1];
const BLUE: [f32; 3] = [0.1, 0.1, 0.8];

fn plain(spp: u32) -> RenderSettings {
    RenderSettings::new(GuideMode::None, StopRule::Spp(spp))
}

fn near(found: Vec3, expected: Vec3) {
    assert!(found.abs_diff_eq(expected, 1e-4), "{found} instead of {expected}");
}

/// A mirror that reflects half of the light.
fn mirror() -> MaterialFile {
    MaterialFile::Conductor { eta: [0.0; 3], k: [1.0; 3], specular_reflectance: TextureFile::rgb([0.5; 3]) }
}

/// A ball of glass before a wall whose halves have different colours turns them around.
#[test]
fn features_show_what_is_behind_glass() {
    let mut b = Builder::new("ball", [32, 32]);
    let [red, blue] = [RED, BLUE].map(|colour| b.add_material("wall", diffuse(colour)));
    let clear = b.add_material("glass", glass(1.5));
    for (side, wall) in [(-1.0, &red), (1.0, &blue)] {
        b.add_quad("wall", Vec3::new(20.0 * side, 0.0, -3.0), [Vec3::X * 20.0, Vec3::Y * 20.0], wall, None);
    }
    b.add_sphere("ball", Vec3::ZERO, 1.0, &clear, None);
    b.look_at(Vec3::Z * 6.0, Vec3::ZERO, Vec3::Y, 30.0);
    let scene = built(b.finish());
    let seen = features(&scene, &plain(1)).unwrap();
    let at = |column: usize| (seen.albedo[16 * 32 + column], seen.normal[16 * 32 + column]);
    let [left, right] = [at(1), at(30)];
    let is = |seen: Vec3, colour: [f32; 3]| seen.abs_diff_eq(colour.into(), 1e-4);
    let apart = is(left.0, RED) && is(right.0, BLUE) || is(left.0, BLUE) && is(right.0, RED);
    assert!(apart, "{left:?} {right:?}");
    // Four pixels beside the middle of the ball, whose radius is ten.
    for (inside, outside) in [(at(12), right), (at(19), left)] {
        near(inside.0, outside.0);
        near(inside.1, Vec3::Z);
    }
    // Layers for people show the glass itself.
    let outcome = render(&scene, &plain(1), reconstructor(GuideMode::None).as_ref(), &Silent, &AtomicBool::new(false));
    let first = aov::channels(&scene, &plain(1), &outcome.unwrap(), &[Aov::Albedo]).unwrap();
    assert_eq!(first[0].values[16 * 32 + 12], 1.0);
}

#[test]
fn features_show_what_mirrors_show() {
    let mut b = Builder::new("mirror", [8, 8]);
    let wall = b.add_material("wall", diffuse(BLUE));
    let half = b.add_material("mirror", mirror());
    b.add_quad("mirror", Vec3::ZERO, [Vec3::X * 5.0, Vec3::Y * 5.0], &half, None);
    b.add_quad("wall", Vec3::Z * 10.0, [Vec3::X * 50.0, Vec3::Y * 50.0], &wall, None);
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 20.0);
    let seen = features(&built(b.finish()), &plain(4)).unwrap();
    for (&albedo, &normal) in seen.albedo.iter().zip(&seen.normal) {
        near(albedo, 0.5 * Vec3::from(BLUE));
        near(normal, -Vec3::Z);
    }
}

/// Between two mirrors there is nothing but mirrors.
#[test]
fn mirrors_in_mirrors_come_to_an_end() {
    let mut b = Builder::new("mirrors", [4, 4]);
    let half = b.add_material("mirror", mirror());
    for (z, u) in [(-5.0, Vec3::X), (5.0, -Vec3::X)] {
        b.add_quad("mirror", Vec3::Z * z, [u * 500.0, Vec3::Y * 500.0], &half, None);
    }
    b.look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 20.0);
    let seen = features(&built(b.finish()), &plain(1)).unwrap();
    assert!(seen.albedo.iter().all(|albedo| albedo.min_element() > 0.0 && albedo.max_element() < 1e-3), "{seen:?}");
    assert!(seen.normal.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-4), "{seen:?}");
}

/// Where nothing mirrors they are the layers of the same names, in windows too.
#[test]
fn features_of_rough_surfaces_are_the_layers() {
    let (scene, settings) = (committed("cornell", [24, 20]), plain(16));
    let outcome = render(&scene, &settings, reconstructor(GuideMode::None).as_ref(), &Silent, &AtomicBool::new(false));
    let layers = aov::channels(&scene, &settings, &outcome.unwrap(), &[Aov::Albedo, Aov::Normal]).unwrap();
    let whole = features(&scene, &settings).unwrap();
    for (i, layer) in layers.iter().enumerate() {
        let own = if i < 3 { &whole.albedo } else { &whole.normal };
        assert!(layer.values.iter().zip(own).all(|(value, v)| (value - v[i % 3]).abs() < 1e-5), "{}", layer.name);
    }
    let window = Window { x: 5, y: 3, width: 7, height: 6 };
    let part = features(&scene, &RenderSettings { crop: Some(window), ..settings }).unwrap();
    let cut = |pixels: &[Vec3]| window.cut(&Image { width: 24, height: 20, pixels: pixels.to_vec() }).unwrap().pixels;
    assert_eq!((part.albedo, part.normal), (cut(&whole.albedo), cut(&whole.normal)));
}

/// The denoiser, if its library is there.
fn denoiser() -> Option<Denoiser> {
    if std::env::var_os("OIDN_DYLIB_PATH").is_none_or(|path| path.is_empty()) {
        eprintln!("skipped: OIDN_DYLIB_PATH is not set; tests/fetch-oidn.sh prints its value");
        return None;
    }
    Some(Denoiser::new().expect("the library that OIDN_DYLIB_PATH names loads"))
}

/// Measured: the error falls to a fifteenth.
#[test]
fn denoising_halves_the_error() {
    let Some(denoiser) = denoiser() else { return };
    let scene = committed("cornell", [64, 64]);
    let truth = picture(&scene, &RenderSettings { seed: 2, ..plain(1024) });
    let settings = RenderSettings { seed: 1, ..plain(8) };
    let noisy = picture(&scene, &settings);
    let denoised = denoiser.denoise(&noisy, &features(&scene, &settings).unwrap()).unwrap();
    let [before, after] = [&noisy, &denoised].map(|image| measure(image, &truth).unwrap());
    println!("relMSE {} before, {} after; mean ratio {}", before.relmse, after.relmse, after.mean_ratio);
    assert!(after.relmse < 0.5 * before.relmse, "{} after {}", after.relmse, before.relmse);
    assert!((after.mean_ratio - 1.0).abs() < 0.03, "{}", after.mean_ratio);
    assert_eq!(denoiser.denoise(&noisy, &features(&scene, &settings).unwrap()).unwrap(), denoised);
}

fn even(size: [usize; 2], colour: Vec3) -> (Image, Features) {
    let [width, height] = size;
    let all = |v: Vec3| vec![v; width * height];
    let features = Features { albedo: all(Vec3::new(0.5, 0.4, 0.3)), normal: all(Vec3::Z) };
    (Image { width, height, pixels: all(colour) }, features)
}

#[test]
fn an_even_picture_stays_even() {
    let Some(denoiser) = denoiser() else { return };
    for scale in [1e-3, 1.0, 1e4] {
        let colour = Vec3::new(0.7, 0.4, 0.2) * scale;
        for size in [[48, 40], [7, 90], [1, 1]] {
            let (image, features) = even(size, colour);
            let denoised = denoiser.denoise(&image, &features).unwrap();
            assert_eq!((denoised.width, denoised.height, denoised.pixels.len()), (size[0], size[1], size[0] * size[1]));
            for pixel in denoised.pixels {
                let off = (pixel / colour - 1.0).abs().max_element();
                assert!(off < 0.01, "{size:?}, {scale}: off by {off}");
            }
        }
    }
    let black = even([20, 20], Vec3::ZERO);
    let denoised = denoiser.denoise(&black.0, &black.1).unwrap();
    assert!(denoised.pixels.iter().all(|pixel| pixel.max_element() < 1e-6), "black stays black");
}

#[test]
fn what_is_not_finite_is_left_out() {
    let Some(denoiser) = denoiser() else { return };
    let (clean, clean_features) = even([32, 32], Vec3::splat(0.5));
    let with = |values: [f32; 3]| {
        let (mut image, mut features) = (clean.clone(), clean_features.clone());
        image.pixels[300] = Vec3::new(values[0], 0.5, values[1]);
        features.albedo[500].y = values[2];
        features.normal[700].x = values[0];
        denoiser.denoise(&image, &features).unwrap()
    };
    let spoiled = with([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
    assert!(spoiled.pixels.iter().all(|pixel| pixel.is_finite()));
    assert_eq!(spoiled, with([0.0; 3]));
    let small = Features { albedo: vec![Vec3::ONE; 3], normal: vec![Vec3::Z; 3] };
    assert!(denoiser.denoise(&clean, &small).is_err() && denoiser.denoise(&Image::default(), &small).is_err());
}
