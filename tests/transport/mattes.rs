//! Mattes by object and by material: what they show is what the picture shows.

use crate::support::scenes;

use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::generate::build::{Builder, diffuse};
use fanal::picture::Channel;
use fanal::picture::cryptomatte::{RANKS, id, names};
use fanal::render::{Aov, GuideMode, Outcome, RenderSettings, StopRule, aov, render};
use fanal::scene::Scene;
use fanal::scene::file::{FilterFile, MaterialFile, TextureFile};
use glam::Vec3;
use scenes::{built, reconstructor};

/// Columns and rows.
const SIZE: [u32; 2] = [8, 64];
const OBJECTS: &str = "crypto_object";
const MATERIALS: &str = "crypto_material";

/// A camera that sees the plane z = 0 so that column and row of a point in it are 4 + 4x and 32 − 4y.
fn begun() -> Builder {
    let mut b = Builder::new("mattes", SIZE);
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 2.0 * 0.25f32.atan().to_degrees());
    b
}

/// Adds a rectangle in the plane z = `z` by the columns and rows that it would cover at z = 0.
fn add(b: &mut Builder, name: &str, columns: [f32; 2], rows: [f32; 2], z: f32, material: &str, light: bool) {
    let away = (4.0 - z) / 4.0;
    let [x, y] = [columns.map(|c| away * (c - 4.0) / 4.0), rows.map(|r| away * (32.0 - r) / 4.0)];
    let center = Vec3::new(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), z);
    let half = [Vec3::X * (0.5 * (x[1] - x[0])), Vec3::Y * (0.5 * (y[0] - y[1]))];
    b.add_quad(name, center, half, material, light.then_some([1.0; 3]));
}

/// A lamp of radiance 1 left of column 4.32 and two black squares of one name to the right of it, above row 30.3 and below; all begin
/// in row 10.68.
fn lamp_and_squares() -> Scene {
    let mut b = begun();
    let shining = b.add_material("shining", diffuse([0.0; 3]));
    let black = b.add_material("black", diffuse([0.0; 3]));
    add(&mut b, "lamp", [-99.0, 4.32], [10.68, 99.0], 0.0, &shining, true);
    add(&mut b, "square", [4.32, 99.0], [10.68, 30.3], 0.0, &black, false);
    add(&mut b, "square", [4.32, 99.0], [30.3, 99.0], 0.0, &black, false);
    built(b.finish())
}

fn rendered(scene: &Scene, filter: FilterFile, spp: u32) -> (Outcome, Vec<Channel>) {
    let settings = RenderSettings { filter, ..RenderSettings::new(GuideMode::None, StopRule::Spp(spp)) };
    let reconstructor = reconstructor(GuideMode::None);
    let outcome = render(scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false));
    let outcome = outcome.expect("the settings are sound");
    let channels = aov::channels(scene, &settings, &outcome, &[Aov::CryptoObject, Aov::CryptoMaterial]);
    (outcome, channels.expect("the filter is sound"))
}

/// Ids and coverages of every pixel, by rank; those without a thing must be 0.
fn ranks(channels: &[Channel], matte: &str) -> Vec<Vec<(f32, f32)>> {
    let of: Vec<&Channel> =
        names(matte).iter().map(|name| channels.iter().find(|c| c.name == *name).expect("it is there")).collect();
    let pixel = |i: usize| -> Vec<(f32, f32)> {
        let all: Vec<(f32, f32)> = of.chunks(2).map(|pair| (pair[0].values[i], pair[1].values[i])).collect();
        assert!(all.iter().all(|&(id, part)| (id == 0.0) == (part == 0.0)), "{all:?}");
        assert!(all.is_sorted_by(|a, b| a.1 >= b.1), "{all:?}");
        all.into_iter().filter(|(_, part)| *part > 0.0).collect()
    };
    (0..(SIZE[0] * SIZE[1]) as usize).map(pixel).collect()
}

/// The part of a pixel that the thing of this name covers.
fn cover(ranks: &[(f32, f32)], name: &str) -> f32 {
    ranks.iter().find(|(thing, _)| *thing == id(name)).map_or(0.0, |(_, part)| *part)
}

/// Inside of things the pixel is all theirs; across the edges at column 4.32 and row 10.68 the parts are those of the areas. The mean
/// over the 53 rows below the edge has a standard error of 0.0057 for 128 independent samples each, that over the eight pixels of the row
/// with the edge 0.015; both limits are more than five.
#[test]
fn parts_of_a_pixel_are_areas() {
    let scene = lamp_and_squares();
    let (_, channels) = rendered(&scene, FilterFile::default(), 128);
    let objects = ranks(&channels, OBJECTS);
    let row = |row: usize| &objects[row * 8..(row + 1) * 8];
    for above in 0..10 {
        assert!(row(above).iter().all(Vec::is_empty));
    }
    for below in 11..64 {
        let row = row(below);
        assert!(row[..4].iter().all(|pixel| *pixel == [(id("lamp"), 1.0)]));
        assert!(row[5..].iter().all(|pixel| *pixel == [(id("square"), 1.0)]), "both squares, also where they meet");
        assert_eq!(cover(&row[4], "lamp") + cover(&row[4], "square"), 1.0);
    }
    let lamp = (11..64).map(|below| cover(&row(below)[4], "lamp")).sum::<f32>() / 53.0;
    assert!((lamp - 0.32).abs() < 0.03, "{lamp}");
    let edge: Vec<f32> = row(10).iter().map(|pixel| pixel.iter().map(|(_, part)| part).sum()).collect();
    let covered = edge.iter().sum::<f32>() / 8.0;
    assert!((covered - 0.32).abs() < 0.08, "{edge:?}");
    let materials = ranks(&channels, MATERIALS);
    for (object, material) in objects.iter().zip(&materials) {
        assert_eq!(cover(object, "lamp"), cover(material, "shining"));
        assert_eq!(cover(object, "square"), cover(material, "black"));
    }
}

/// A pixel's value is the part of its samples that see the lamp, which is the lamp's part in the matte: edges are those of the picture,
/// whatever its filter.
#[test]
fn edges_are_those_of_the_picture() {
    let scene = lamp_and_squares();
    for filter in [FilterFile::default(), FilterFile::TENT, FilterFile::GAUSSIAN, FilterFile::BLACKMAN_HARRIS] {
        for spp in [1, 16, 100] {
            let (outcome, channels) = rendered(&scene, filter, spp);
            let objects = ranks(&channels, OBJECTS);
            let mut edges = 0;
            for (pixel, ranks) in outcome.image.pixels.iter().zip(&objects) {
                let lamp = cover(ranks, "lamp");
                // Where the first 32 samples see the same, the pixel is left to that.
                let same = if lamp == 0.0 || lamp == 1.0 { spp.saturating_sub(32) as f32 / spp as f32 } else { 0.0 };
                assert!((pixel.x - lamp).abs() <= 1e-6 + 0.2 * same, "{filter:?}, {spp}: {} and {lamp}", pixel.x);
                edges += usize::from(lamp > 0.0 && lamp < 1.0);
            }
            assert_eq!(edges > 50, spp > 1, "{filter:?}, {spp}: {edges}");
        }
    }
}

/// A veil that stops three samples of four: as many see it as the picture says.
#[test]
fn holes_are_looked_through() {
    let mut b = begun();
    let shining = b.add_material("shining", diffuse([0.0; 3]));
    let inner = Box::new(diffuse([0.0; 3]));
    let veil = b.add_material("gauze", MaterialFile::Mask { opacity: TextureFile::rgb([0.75; 3]), material: inner });
    add(&mut b, "lamp", [-99.0, 99.0], [-99.0, 199.0], 0.0, &shining, true);
    add(&mut b, "veil", [-99.0, 99.0], [-99.0, 199.0], 1.0, &veil, false);
    let scene = built(b.finish());
    let (outcome, channels) = rendered(&scene, FilterFile::default(), 16);
    let objects = ranks(&channels, OBJECTS);
    let mut mean = 0.0;
    for (pixel, ranks) in outcome.image.pixels.iter().zip(&objects) {
        let (lamp, veil) = (cover(ranks, "lamp"), cover(ranks, "veil"));
        assert!((pixel.x - lamp).abs() < 1e-6 && (lamp + veil - 1.0).abs() < 1e-6);
        mean += veil / 512.0;
    }
    // 512 pixels of 16 samples: the standard error is 0.0048.
    assert!((mean - 0.75).abs() < 0.026, "{mean}");
}

/// Nine stripes across every pixel: the six that cover most are kept.
#[test]
fn what_covers_least_is_left_out() {
    let mut b = begun();
    let grey = b.add_material("grey", diffuse([0.5; 3]));
    for column in 0..8 {
        let mut from = column as f32;
        for stripe in 0..9 {
            let to = from + (1.0 + stripe as f32) / 45.0;
            add(&mut b, &format!("stripe {stripe}"), [from, to], [-99.0, 199.0], 0.0, &grey, false);
            from = to;
        }
    }
    let scene = built(b.finish());
    let (_, channels) = rendered(&scene, FilterFile::default(), 128);
    let (mut widest, mut all) = (0.0, 0.0);
    for ranks in ranks(&channels, OBJECTS) {
        assert_eq!(ranks.len(), RANKS);
        widest += cover(&ranks, "stripe 8") / 512.0;
        all += ranks.iter().map(|(_, part)| part).sum::<f32>() / 512.0;
    }
    // The standard error of independent samples is below 0.002 for both. Which stripes are the six largest differs from pixel to pixel,
    // so that they hold a little more than the 39/45 of the six widest.
    assert!((widest - 0.2).abs() < 0.01, "{widest}");
    assert!(all > 0.86 && all < 0.9, "{all}");
    assert!(ranks(&channels, MATERIALS).iter().all(|ranks| *ranks == [(id("grey"), 1.0)]));
}
