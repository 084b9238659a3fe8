//! What an environment map costs: a sample of its light, and what a ray that leaves the scene finds.
//!
//!     cargo bench --bench sky
//!
//! Procedural skies with a sun, from one that the caches hold to one that they do not. Random numbers and directions are made before;
//! printed are medians of the CPU time per call, on one thread.

use std::hint::black_box;
use std::sync::Arc;

use fanal::base::process::cpu_seconds;
use fanal::base::random::Random;
use fanal::lights::envmap::Envmap;
use fanal::picture::Image;
use fanal::sampling::warp::square_to_sphere;
use glam::{Mat3, Vec2, Vec3};

/// Calls per round.
const CALLS: usize = 2_000_000;
/// Rounds, of which the median counts.
const ROUNDS: usize = 5;

fn main() {
    println!("{:>12} {:>10} {:>10} {:>10}", "pixels", "make ms", "sample ns", "look up ns");
    for width in [512, 1024, 4096] {
        let image = Arc::new(sky(width));
        let begun = seconds();
        let map = Envmap::new(image, 1.0, Mat3::from_rotation_x(0.3));
        let made = seconds() - begun;
        let mut random = Random::new(1, 0, 0);
        let numbers: Vec<[f32; 2]> = (0..CALLS).map(|_| random.next_2d()).collect();
        let directions: Vec<Vec3> = numbers.iter().map(|&u| square_to_sphere(u)).collect();
        let sample = median(&numbers, |u| map.sample(u));
        let look_up = median(&directions, |wi| map.radiance_and_pdf(wi));
        let name = format!("{width}×{}", width / 2);
        println!("{name:>12} {:10.1} {sample:10.1} {look_up:10.1}", made * 1e3);
    }
}

/// Grainy light, brighter above, and a sun of some ten texels' width in 1024.
fn sky(width: usize) -> Image {
    let height = width / 2;
    let mut random = Random::new(2, 0, 0);
    let pixel = |i: usize| {
        let at = Vec2::new((i % width) as f32, (i / width) as f32) / width as f32;
        let sun = if at.distance(Vec2::new(0.6, 0.15)) < 0.005 { 2e4 } else { 0.0 };
        Vec3::splat(1.0 - at.y + random.next_f32() + sun)
    };
    Image { width, height, pixels: (0..width * height).map(pixel).collect() }
}

fn seconds() -> f64 {
    cpu_seconds().unwrap_or(f64::NAN)
}

/// Nanoseconds per call.
fn median<I: Copy, O>(inputs: &[I], call: impl Fn(I) -> O) -> f64 {
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let begun = seconds();
            for &input in inputs {
                black_box(call(input));
            }
            (seconds() - begun) * 1e9 / inputs.len() as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}
