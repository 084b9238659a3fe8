//! The rays that `batches` has written to a folder, one at a time: so that a version without batches, whose `rays` this file is put into, can be
//! asked the same. Hence it stands alone, with kinds of rays and rounds of its own.

use std::path::Path;
use std::sync::Arc;

use fanal::geometry::mesh::Mesh;
use fanal::geometry::{Accel, Ray, Shape};
use glam::{Affine3A, Vec3};

use super::{cpu_seconds, median};

/// Rounds, of which the median counts.
const ROUNDS: usize = 7;
/// Least number of rays that are asked about in a round, some again and again, so that it lasts long enough to be timed.
const LEAST: usize = 1 << 20;
/// Shadow rays that an order is learned from, at most.
const LEARNED: usize = 2500;
/// Kinds of rays, and the first of those towards lights.
const KINDS: [&str; 7] = ["camera", "bounce 1", "bounce 2", "bounce 3-6", "shadow 1", "shadow 2", "shadow 3-6"];
const SHADOWS: usize = 4;

/// One line for each kind of rays that is there.
pub fn time(folder: &Path) {
    let numbers = |name: String| -> Vec<[u8; 4]> {
        let bytes = std::fs::read(folder.join(name)).expect("batches has written all of its files there");
        bytes.chunks_exact(4).map(|four| four.try_into().expect("there are four")).collect()
    };
    let floats = |name: String| -> Vec<f32> { numbers(name).into_iter().map(f32::from_le_bytes).collect() };
    let vector = |at: &[f32]| Vec3::new(at[0], at[1], at[2]);
    let corners: Vec<u32> = numbers("triangles".into()).into_iter().map(u32::from_le_bytes).collect();
    let mesh = Mesh {
        positions: floats("vertices".into()).chunks_exact(3).map(vector).collect(),
        triangles: corners.chunks_exact(3).map(|corner| [corner[0], corner[1], corner[2]]).collect(),
        ..Mesh::default()
    };
    let mut accel = Accel::new(&[Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)]);
    let kinds: Vec<Vec<(Ray, f32)>> = (0..KINDS.len())
        .map(|kind| {
            let rays = floats(format!("rays{kind}"));
            rays.chunks_exact(7).map(|r| (Ray { origin: vector(r), direction: vector(&r[3..]) }, r[6])).collect()
        })
        .collect();
    let shadows: Vec<(Ray, f32)> = kinds[SHADOWS..].concat();
    let every = shadows.len().div_ceil(LEARNED).max(1);
    accel.learn_order(&shadows.into_iter().step_by(every).collect::<Vec<_>>());
    for (kind, rays) in kinds.iter().enumerate().filter(|(_, rays)| !rays.is_empty()) {
        let met = floats(format!("met{kind}"));
        let repeats = LEAST.div_ceil(rays.len());
        let seconds = median((0..ROUNDS).map(|_| {
            let start = cpu_seconds();
            for _ in 0..repeats {
                for (ray, t_max) in rays {
                    std::hint::black_box(match kind < SHADOWS {
                        true => accel.intersect(ray).is_some(),
                        false => accel.occluded(ray, *t_max),
                    });
                }
            }
            (cpu_seconds() - start) / repeats as f64
        }));
        let differ = (rays.iter().zip(&met))
            .filter(|((ray, t_max), met)| match kind < SHADOWS {
                true => accel.intersect(ray).map_or(-1.0, |hit| hit.distance) != **met,
                false => f32::from(accel.occluded(ray, *t_max)) != **met,
            })
            .count();
        let speed = rays.len() as f64 * 1e-6 / seconds;
        println!("{:>12} {speed:>8.2} Mrays/s, {differ} of {} answers differ", KINDS[kind], rays.len());
    }
}
