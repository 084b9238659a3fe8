//! Roulette along paths, with and without a guide. What the names mean is said in ../guiding/hard_trees.rs.

use crate::support::scenes;

use fanal::base::random::Random;
use fanal::generate::build::{Builder, diffuse, glass};
use fanal::geometry::Ray;
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::sample::field::{GuideField, VoxelGuide};
use fanal::guiding::sample::roulette::AdjointRoulette;
use fanal::guiding::tree::distribution::Distribution as Directions;
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::Topology;
use fanal::integrators::path::{CameraPath, PathScratch, PathTracer, RayCount};
use fanal::integrators::{Roulette, TransportSettings};
use fanal::lights::learned::LightSampling;
use fanal::math::cylindrical;
use fanal::sampling::warp;
use fanal::scene::Scene;
use fanal::scene::file::{LightFile, MaterialFile, TextureFile};
use glam::Vec3;
use scenes::{box_furnace, built, floor};

/// One voxel for the whole scene, with two narrow peaks of directions, of whose vertices as much is expected as
/// `effort` says.
fn peaked_field(fraction: f32, roulette: AdjointRoulette) -> GuideField {
    let split: Vec<bool> = (0..85).map(|node| node < 21).collect();
    let topology = Topology::from_split(&split).expect("three full levels");
    // One of two opposite directions leads away from any wall.
    let peaks = [1.0, -1.0].map(|sign| topology.leaf_at(cylindrical::to_cell(sign * Vec3::new(0.6, 0.3, 0.74))));
    let weights: Vec<f64> = topology.leaves().map(|leaf| if peaks.contains(&leaf) { 1.0 } else { 0.0 }).collect();
    let tree = SamplingTree::new(&Directions::from_leaf_weights(topology, &weights), 0.1, usize::MAX);
    let mut cache = SpatialCache::new(Vec3::splat(-50.0), 100.0).without_facing();
    cache.find_or_insert(Vec3::ZERO, Vec3::Y);
    let guide =
        VoxelGuide { directions: Some(tree.into()), parallax: Parallax::NONE, bsdf_fraction: fraction, roulette };
    GuideField::new(cache, vec![guide])
}

/// `n` paths from the middle of a scene: rays per path, and the mean radiance with its standard error. Their pixel is
/// thought to have the value 1.
fn paths_in(scene: &Scene, n: u32, roulette: Roulette, field: Option<&GuideField>) -> [f64; 3] {
    let settings = TransportSettings { max_depth: 300, light_sampling: false, roulette, guided_distances: false };
    let tracer = PathTracer { scene, settings, field, lights: LightSampling::Plain };
    let (mut scratch, mut count) = (PathScratch::default(), RayCount::default());
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..n {
        let mut random = Random::new(4, 0, u64::from(i));
        let ray = Ray { origin: Vec3::ZERO, direction: warp::square_to_sphere(random.next_2d()) };
        let radiance =
            f64::from(tracer.trace(CameraPath { ray, random, pixel: Some(1.0) }, &mut scratch, None, &mut count).x);
        (sum, squares) = (sum + radiance, squares + radiance * radiance);
    }
    let (n, mean) = (f64::from(n), sum / f64::from(n));
    [count.rays as f64 / n, mean, ((squares / n - mean * mean) / n).sqrt()]
}

/// Rays per path inside a closed box whose walls reflect `albedo`.
fn rays_per_path(albedo: f32, roulette: Roulette, field: Option<&GuideField>) -> f64 {
    let mut b = Builder::new("box", [4, 4]);
    let wall = b.add_material("wall", diffuse([albedo; 3]));
    b.add_block("box", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.look_at(Vec3::ZERO, Vec3::X, Vec3::Y, 60.0);
    let [rays, radiance, _] = paths_in(&built(b.finish()), 4000, roulette, field);
    assert_eq!(radiance, 0.0);
    rays
}

/// A path that carries nothing ends, with roulette or without; one that carries next to nothing ends soon, but with a chance of at
/// least 1 in 20, so that no survivor ever weighs more than 20 times as much.
#[test]
fn a15_paths_that_carry_nothing_end() {
    assert!(rays_per_path(0.0, Roulette::Off, None) < 1.5, "black walls");
    let faint = rays_per_path(1e-6, Roulette::Throughput, None);
    // Four rays before roulette starts; of the survivors, one in 20 goes on.
    assert!((4.0..4.2).contains(&faint), "{faint}");
    assert!((faint - 4.0 - 0.05 / 0.95).abs() < 0.02, "{faint}: nothing divided by a vanishing probability");
}

/// What glass divides radiance by on the way in, it multiplies it by on the way out: a path inside of clear glass is worth as much as
/// outside, and roulette must not end more than it would there (pbrt-v4 §13.2.3 scales likewise). Of three nested balls of glass, seen
/// from the middle, one is entered and two are left or the other way round; nothing is absorbed anywhere.
#[test]
fn a15_glass_does_not_end_paths() {
    let mut b = Builder::new("balls", [4, 4]);
    let glass = b.add_material("glass", glass(1.5));
    (1..=3).for_each(|i| b.add_sphere(&format!("ball {i}"), Vec3::X * 3.0, 0.3 + 0.2 * i as f32, &glass, None));
    b.add_light(LightFile::Constant { radiance: [1.0; 3] });
    b.look_at(Vec3::ZERO, Vec3::X, Vec3::Y, 10.0);
    let scene = built(b.finish());
    let transport = TransportSettings {
        max_depth: 20,
        light_sampling: true,
        roulette: Roulette::Throughput,
        guided_distances: false,
    };
    let tracer = PathTracer { scene: &scene, settings: transport, field: None, lights: LightSampling::Plain };
    let mut inside = 0;
    for i in 0..200 {
        let ray = Ray { origin: Vec3::ZERO, direction: Vec3::new(1.0, 0.001 * i as f32, 0.0).normalize() };
        let path = tracer.explain(CameraPath { ray, random: Random::new(22, i, 0), pixel: None });
        for onward in path.vertices.iter().skip(3).filter_map(|vertex| vertex.onward.as_ref()) {
            assert!(onward.survival > 0.9, "{}", onward.survival);
            inside += 1;
        }
    }
    assert!(inside > 100, "{inside}");
}

/// Directions that bring nothing count in what is expected of a vertex: left out, a floor under a sky of radiance 1 would be expected to
/// send back more than its albedo, and roulette and light sampling would be tried too often. Five standard errors of 20,000 samples,
/// whose weights are at most 2, are 0.03. Half of the guide's directions lead below the floor.
#[test]
fn a15_what_finds_nothing_counts() {
    let mut b = floor([4, 4], 1.0);
    b.add_light(LightFile::Constant { radiance: [1.0; 3] });
    let scene = built(b.finish());
    let mut cache = SpatialCache::new(Vec3::splat(-50.0), 100.0).without_facing();
    cache.find_or_insert(Vec3::ZERO, Vec3::Y);
    let tree = Some(SamplingTree::new(&Directions::uniform(), 1.0, usize::MAX));
    let (directions, roulette) = (tree.map(Into::into), AdjointRoulette::UNKNOWN);
    let guide = VoxelGuide { directions, parallax: Parallax::NONE, bsdf_fraction: 0.5, roulette };
    let field = GuideField::new(cache, vec![guide]);
    let transport =
        TransportSettings { max_depth: 2, light_sampling: false, roulette: Roulette::Off, guided_distances: false };
    let tracer = PathTracer { scene: &scene, settings: transport, field: Some(&field), lights: LightSampling::Plain };
    let (mut scratch, mut count, mut records) = (PathScratch::default(), RayCount::default(), vec![]);
    for i in 0..20_000 {
        let ray = Ray { origin: Vec3::new(0.1, 1.0, 0.2), direction: Vec3::NEG_Y };
        let path = CameraPath { ray, random: Random::new(23, i, 0), pixel: Some(1.0) };
        tracer.trace(path, &mut scratch, Some(&mut records), &mut count);
    }
    assert_eq!(records.len(), 20_000, "every path met the floor once");
    let mean = records.iter().map(|record| f64::from(record.estimate())).sum::<f64>() / 20_000.0;
    assert!((mean - 0.5).abs() < 0.03, "{mean}");
    let absorbed = records.iter().filter(|record| !record.is_directed()).count() as f64 / 20_000.0;
    assert!((absorbed - 0.25).abs() < 0.02, "{absorbed}");
}

/// Where a guide drew the direction, f·cos/p is small because p is large, as much light is expected there. Roulette by that number
/// would end the guided paths, and with them what guiding gains: they must live about as long as without roulette. (Where the guide
/// points into a wall, paths end anyway, so hardly any is long.)
#[test]
fn a15_roulette_does_not_undo_guiding() {
    let field = peaked_field(0.3, AdjointRoulette::UNKNOWN);
    let [all, guided] =
        [Roulette::Off, Roulette::Throughput].map(|roulette| rays_per_path(0.8, roulette, Some(&field)));
    // Four rays are free of roulette: ending all paths there would leave 0.82.
    assert!(guided > 0.86 * all, "{guided} rays against {all}");
}

/// The default roulette goes by what is expected of a path, not by what its guide made of its throughput: where much is
/// expected every path lives as long as without roulette, ray by ray; where nothing is, by mistake, few go on, as heavy
/// as ten at most. The mean stays, to five standard errors (one false alarm in a million): in a furnace of albedo 1/2
/// it is 2.
#[test]
fn a15_the_window_keeps_what_is_expected() {
    let scene = built(box_furnace(0.5));
    let traced = |roulette, onward| {
        let expecting = AdjointRoulette { light: onward, onward };
        paths_in(&scene, 100_000, roulette, Some(&peaked_field(0.3, expecting)))
    };
    let all = traced(Roulette::Off, 0.0);
    assert_eq!(traced(Roulette::Window, 1e30), all, "much is expected");
    let few = traced(Roulette::Window, 0.0);
    for [_, mean, error] in [all, few] {
        assert!(error < 0.1 && (mean - 2.0).abs() < 5.0 * error, "{mean} ± {error}");
    }
    // Two paths in three go on from a vertex without roulette, one in fifteen from the first with it.
    assert!(few[0] < 0.5 * all[0], "{} rays against {}", few[0], all[0]);
}

/// Between mirrors no voxel tells what is sent back. A path goes on there by what it carries times what vertices usually send back, over its
/// pixel's value: by what it carries alone, the few paths that lead from a dark corner through a pane to the sun would return as fireflies.
#[test]
fn a15_mirrors_do_not_end_paths_of_dark_pixels() {
    let mut b = Builder::new("mirrors", [4, 4]);
    let silver =
        MaterialFile::Conductor { eta: [1.0; 3], k: [2.0; 3], specular_reflectance: TextureFile::rgb([1.0; 3]) };
    let mirror = b.add_material("mirror", MaterialFile::TwoSided { material: Box::new(silver) });
    b.add_block("box", Vec3::splat(-1.0), Vec3::ONE, &mirror);
    b.look_at(Vec3::ZERO, Vec3::X, Vec3::Y, 60.0);
    let scene = built(b.finish());
    let usual = 0.5;
    let field = peaked_field(0.3, AdjointRoulette::expecting([Some(0.0), Some(usual)]));
    let (mut by_pixel, mut between) = (Vec::new(), 0);
    let window = [Some(0.1), Some(0.5), Some(4.0), None].map(|pixel| (Roulette::Window, pixel));
    for (roulette, pixel) in window.into_iter().chain([(Roulette::Throughput, Some(0.1))]) {
        let settings = TransportSettings { max_depth: 12, light_sampling: false, roulette, guided_distances: false };
        let tracer = PathTracer { scene: &scene, settings, field: Some(&field), lights: LightSampling::Plain };
        let counts = pixel.filter(|_| roulette == Roulette::Window);
        let mut played = 0;
        for i in 0..200 {
            let random = Random::new(24, i, 0);
            let ray = Ray { origin: Vec3::ZERO, direction: Vec3::new(1.0, 0.3, 0.003 * i as f32).normalize() };
            let path = tracer.explain(CameraPath { ray, random, pixel });
            for vertex in path.vertices.iter().skip(3) {
                let Some(onward) = &vertex.onward else { continue };
                let carried = (vertex.throughput * onward.weight).max_element();
                let worth = counts.map_or(carried, |pixel| carried * usual as f32 / pixel);
                let expected = worth.clamp(0.05, 0.95);
                assert!((onward.survival - expected).abs() < 1e-3, "{pixel:?}: {} {expected}", onward.survival);
                between += u32::from((0.06..0.94).contains(&expected));
                played += 1;
            }
        }
        by_pixel.push(played);
    }
    assert!(between > 200, "{between}");
    assert!(by_pixel[0] > by_pixel[1] && by_pixel[1] > by_pixel[2] && by_pixel[1] == by_pixel[3], "{by_pixel:?}");
    assert_eq!(by_pixel[3], by_pixel[4]);
}
