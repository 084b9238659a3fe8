//! What pixels show: the light around them by the filter, the window that is asked for, the layers beside the picture.

#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with tests of light transport")]
mod scenes;

use std::f64::consts::PI;

use fanal::generate::build::{Builder, diffuse};
use fanal::render::{GuideMode, RenderSettings, StopRule};
use fanal::scene::Scene;
use fanal::scene::file::FilterFile;
use glam::Vec3;
use scenes::{built, picture};

/// Where the lit part of [`edge`] ends, in columns.
const EDGE: f64 = 4.32;

/// A wall across the view that shines with radiance 1 to the left of [`EDGE`], in 8 columns and 64 rows.
fn edge() -> Scene {
    let mut b = Builder::new("edge", [8, 64]);
    let wall = b.add_material("wall", diffuse([0.0; 3]));
    let right = (EDGE - 4.0) / 4.0;
    b.add_quad("lamp", Vec3::X * (right as f32 - 50.0), [Vec3::X * 50.0, Vec3::Y * 50.0], &wall, Some([1.0; 3]));
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 2.0 * 0.25f32.atan().to_degrees());
    built(b.finish())
}

/// The filters as defined, up to a factor, within their radius.
fn profile(file: FilterFile, x: f64) -> f64 {
    let t = x.abs() / f64::from(file.radius());
    match file {
        FilterFile::Box { .. } => 1.0,
        FilterFile::Tent { .. } => 1.0 - t,
        FilterFile::Gaussian { .. } => (-0.5 * (x / 0.5).powi(2)).exp() - (-8f64).exp(),
        FilterFile::BlackmanHarris { .. } => {
            let terms = [0.35875, 0.48829, 0.14128, 0.01168];
            terms.iter().enumerate().map(|(k, a)| a * (PI * t * k as f64).cos()).sum()
        }
    }
}

/// A column's value is the part of its filter that is lit. 512 samples per pixel and 64 rows make 32,768 yes or no: |z| above 5.5
/// in any of 32 columns has probability 1e-6.
#[test]
fn an_edge_is_blurred_by_the_filter() {
    let scene = edge();
    let spp = 512;
    for file in [FilterFile::default(), FilterFile::TENT, FilterFile::GAUSSIAN, FilterFile::BLACKMAN_HARRIS] {
        let settings = RenderSettings { filter: file, ..RenderSettings::new(GuideMode::None, StopRule::Spp(spp)) };
        let image = picture(&scene, &settings);
        let radius = f64::from(file.radius());
        let steps = 20_000;
        let at = |i: i32| radius * (2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0);
        let total: f64 = (0..steps).map(|i| profile(file, at(i))).sum();
        for column in 0..8 {
            let centre = column as f64 + 0.5;
            let lit: f64 =
                (0..steps).map(at).filter(|x| centre + x < EDGE).map(|x| profile(file, x)).sum::<f64>() / total;
            let n = f64::from(spp) * 64.0;
            let mean = (0..64).map(|row| f64::from(image.pixels[row * 8 + column].x)).sum::<f64>() / 64.0;
            // The sum above is exact to 1e-4.
            let limit = 5.5 * (lit * (1.0 - lit) / n).sqrt() + 1e-4;
            assert!((mean - lit).abs() < limit, "{file:?}, column {column}: {mean} instead of {lit}");
        }
    }
}
