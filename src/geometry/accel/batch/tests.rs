//! Batches answer as single queries do.

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};

use super::super::tests::{closed_sphere, fewer, kernels, point, random_ray, soup};
#[cfg(target_arch = "x86_64")]
use super::super::traverse::Kernel;
use super::super::{Accel, Hit};
#[cfg(target_arch = "x86_64")]
use super::lanes::farthest;
use super::sixteen::{Lanes, RAYS};
#[cfg(target_arch = "x86_64")]
use super::wide::Wide;
use super::{Scratch, Way};
use crate::base::random::Random;
use crate::geometry::mesh::Mesh;
use crate::geometry::{Met, Ray, Shape};

/// Sizes of batches, around and far from those of groups of rays.
const SIZES: &[usize] = if cfg!(miri) { &[0, 1, 15, 17, 33] } else { &[0, 1, 15, 16, 17, 31, 33, 1000, 5000] };

fn in_world(mesh: Mesh) -> Shape {
    Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)
}

/// All that `Accel` can hold: loose triangles, a closed mesh, twice the same surface, a mesh that is placed twice, and spheres.
fn everything() -> Vec<Shape> {
    let mut random = Random::new(71, 0, 0);
    let shared = Arc::new(soup(&mut random, fewer(300), 0.1));
    let placed = |x: f32| Affine3A::from_rotation_translation(Quat::from_rotation_y(x), Vec3::splat(0.3 * x));
    let twice = soup(&mut random, 100, 0.2);
    let mut shapes = vec![
        in_world(twice.clone()),
        Shape::mesh(shared.clone(), placed(0.0), false),
        in_world(soup(&mut random, fewer(3000), 0.04)),
        in_world(closed_sphere(40, 40, 0.2, Vec3::splat(0.5))),
        Shape::mesh(shared, placed(1.0), false),
        in_world(twice),
    ];
    shapes.extend((0..20).map(|_| Shape::sphere(point(&mut random), 0.05, false)));
    shapes
}

/// Rays of every kind, each with a maximum distance: random ones, some along planes of the axes, through corners of `mesh` and of
/// boxes, along axes, parallel ones close together, and some that hit nothing since they are no rays.
fn rays(mesh: &Mesh, count: usize, seed: u64) -> Vec<(Ray, f32)> {
    let mut random = Random::new(seed, 0, 0);
    let pick = |random: &mut Random| mesh.positions[random.below(mesh.positions.len() as u32) as usize];
    let ray = |i: usize| {
        let mut ray = random_ray(&mut random, i);
        match i / 16 % 6 {
            0 => ray.direction = (pick(&mut random) - ray.origin).normalize_or(Vec3::X),
            1 => ray.origin = pick(&mut random),
            2 => ray.direction = [Vec3::X, Vec3::NEG_Y, Vec3::Z][i % 3],
            3 => {
                let shift = 0.02 * point(&mut random);
                ray = Ray {
                    origin: Vec3::new(-1.0, 0.4, 0.4) + shift,
                    direction: Vec3::new(0.9, 0.1, -0.05).normalize(),
                };
            }
            4 if i.is_multiple_of(5) => {
                let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0][i / 5 % 4];
                ray.direction = if i.is_multiple_of(2) { Vec3::splat(bad) } else { Vec3::new(bad, 0.6, 0.8) };
            }
            4 if i.is_multiple_of(7) => ray.origin.y = [f32::NAN, f32::INFINITY][i % 2],
            _ => {}
        }
        let t_max = match i % 11 {
            0 => f32::INFINITY,
            1 => [0.0, -1.0, f32::NAN, f32::MAX][i / 11 % 4],
            _ => random.range(0.5, 3.0),
        };
        (ray, t_max)
    };
    (0..fewer(count)).map(ray).collect()
}

/// More shapes than any scene here has.
const SHAPES: usize = 64;

fn bits(hit: &Hit) -> [u32; 5] {
    let [b1, b2] = hit.barycentric.map(f32::to_bits);
    [hit.distance.to_bits(), hit.shape, hit.triangle, b1, b2]
}

/// Asserts that all batches of the rays answer as single queries do. Returns the numbers of hits and of occluded rays.
fn compare(accel: &Accel, rays: &[(Ray, f32)], scratch: &mut Scratch) -> [usize; 2] {
    let alone: Vec<Ray> = rays.iter().map(|(ray, _)| *ray).collect();
    let single: Vec<Option<Hit>> = alone.iter().map(|ray| accel.intersect(ray)).collect();
    let hidden: Vec<bool> = rays.iter().map(|(ray, t_max)| accel.occluded(ray, *t_max)).collect();
    let solid: Vec<bool> = (0..SHAPES).map(|shape| shape % 3 == 1).collect();
    let met: Vec<Met> = rays.iter().map(|(ray, t_max)| accel.meets(ray, *t_max, &solid)).collect();
    for way in Way::ALL {
        // Values that no query answers.
        let mut hits = vec![Some(Hit { shape: 1 << 20, ..Hit::NONE }); rays.len()];
        accel.intersect_all(&alone, way, scratch, &mut hits);
        let mut occluded: Vec<bool> = hidden.iter().map(|hidden| !hidden).collect();
        accel.occluded_all(rays, way, scratch, &mut occluded);
        let mut all_met = vec![Met::Veils; rays.len()];
        accel.meets_all(rays, &solid, way, scratch, &mut all_met);
        for (i, ray) in rays.iter().enumerate() {
            let context = format!("ray {i} of {}: {ray:?}, {way:?}, {:?}", rays.len(), accel.hierarchy.kernel);
            assert_eq!(hits[i].as_ref().map(bits), single[i].as_ref().map(bits), "{context}");
            assert_eq!(occluded[i], hidden[i], "{context}");
            assert_eq!(all_met[i], met[i], "{context}");
        }
    }
    [single.iter().flatten().count(), hidden.iter().filter(|hidden| **hidden).count()]
}

/// Spheres alone, met by bundles of rays without end, of rays that end far away, and of those that end where they meet them.
#[test]
fn bundles_meet_spheres() {
    let mut random = Random::new(31, 0, 0);
    let shapes: Vec<Shape> = (0..30).map(|_| Shape::sphere(point(&mut random), 0.1, false)).collect();
    for kernel in kernels() {
        let (accel, mut scratch) = (Accel::with_kernel(&shapes, kernel), Scratch::default());
        let mut rays = Vec::new();
        for _ in 0..40 {
            let (origin, to) = (point(&mut random) - 2.0 * Vec3::X, point(&mut random));
            for i in 0..16 {
                let origin = origin + 0.02 * point(&mut random);
                let ray = Ray { origin, direction: (to - origin).normalize() };
                let distance = accel.intersect(&ray).map_or(1.0, |hit| hit.distance);
                rays.push((ray, [f32::INFINITY, f32::MAX, distance, distance.next_up()][i % 4]));
            }
        }
        let [hits, hidden] = compare(&accel, &rays, &mut scratch);
        assert!(hits > 100 && hidden > 100 && hidden < hits, "{hits} {hidden}");
    }
}

/// docs/stability.md, S7: answers depend neither on the batch nor on the way that it is answered.
#[test]
fn s07_batches_answer_as_single_queries() {
    let shapes = everything();
    let mesh = closed_sphere(40, 40, 0.2, Vec3::splat(0.5));
    for kernel in kernels() {
        let mut accel = Accel::with_kernel(&shapes, kernel);
        let mut scratch = Scratch::default();
        for learned in [false, true] {
            let mut found = [0; 2];
            for (&size, seed) in SIZES.iter().zip(1..) {
                for (sum, count) in found.iter_mut().zip(compare(&accel, &rays(&mesh, size, seed), &mut scratch)) {
                    *sum += count;
                }
            }
            assert!(found.iter().all(|found| (2000..5000).contains(found)) || cfg!(miri), "{found:?} {learned}");
            accel.learn_order(&rays(&mesh, 2000, 99));
        }
    }
}

/// One scratch serves hierarchies of any depth, one after the other.
#[test]
fn scratch_fits_every_hierarchy() {
    let mut chain = Mesh::default();
    for i in 0..fewer(2000) as u32 {
        let size = 1.1f32.powi((i % 700) as i32 - 350);
        chain.positions.extend([Vec3::ZERO, size * Vec3::X, size * Vec3::new(0.0, 1.0, 0.1)]);
        chain.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let one = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let mut scratch = Scratch::default();
    for kernel in kernels() {
        let mut hits = 0;
        for shapes in [vec![], vec![in_world(one.clone())], vec![in_world(chain.clone())], everything()] {
            let accel = Accel::with_kernel(&shapes, kernel);
            hits += compare(&accel, &rays(&chain, 600, 5), &mut scratch)[0];
        }
        assert!(hits > 300 || cfg!(miri), "{hits}");
    }
}

/// Rays through edges and corners of a closed mesh, where single precision cannot tell which side they pass.
#[test]
fn edges_are_decided_alike() {
    let mesh = closed_sphere(60, 60, 0.5, Vec3::splat(0.5));
    let corners = mesh.positions.clone();
    let mut random = Random::new(72, 0, 0);
    let rays: Vec<(Ray, f32)> = (0..fewer(30_000))
        .map(|i| {
            let pick = |random: &mut Random| corners[random.below(corners.len() as u32) as usize];
            let origin = if i % 2 == 0 { Vec3::splat(0.5) } else { pick(&mut random) };
            let corner = 2 + i % (corners.len() - 3).min(3000);
            let between = 0.5 * (corners[corner] + corners[corner + 1]);
            let target = if i % 3 == 0 { between } else { pick(&mut random) };
            (Ray { origin, direction: (target - origin).normalize_or(Vec3::X) }, random.range(0.3, 1.2))
        })
        .collect();
    for kernel in kernels() {
        let accel = Accel::with_kernel(&[in_world(mesh.clone())], kernel);
        let [hits, occluded] = compare(&accel, &rays, &mut Scratch::default());
        assert!(hits > 28_000 && (5000..29_000).contains(&occluded) || cfg!(miri), "{hits} {occluded}");
    }
}

/// One ray that starts nowhere, wherever it stands among others of its octant, takes no hit from them.
#[test]
fn rays_from_nowhere_spoil_no_others() {
    let mesh = closed_sphere(40, 40, 0.5, Vec3::splat(0.5));
    let mut random = Random::new(73, 0, 0);
    for kernel in kernels() {
        let accel = Accel::with_kernel(&[in_world(mesh.clone())], kernel);
        let mut hits = 0;
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for place in (0..16 * 3).step_by(if cfg!(miri) { 13 } else { 1 }) {
                let ray = |i: usize| {
                    let mut origin = Vec3::new(-1.0, 0.0, 0.0) + point(&mut random);
                    if i == place / 3 {
                        origin[place % 3] = bad;
                    }
                    (Ray { origin, direction: Vec3::new(0.9, 0.2, 0.1).normalize() }, 3.0)
                };
                let rays: Vec<(Ray, f32)> = (0..16).map(ray).collect();
                hits += compare(&accel, &rays, &mut Scratch::default())[0];
            }
        }
        assert!(hits > 1000 || cfg!(miri), "{hits}");
    }
}

/// The least and the largest number are found in whatever lanes they are, and a ray that looks as far as no number looks nowhere.
#[cfg(target_arch = "x86_64")]
#[test]
fn ranges_are_of_all_lanes() {
    fn check(tests: impl Wide) {
        let mut lanes = Lanes::EMPTY;
        assert!(farthest(tests, &lanes) < 0.0);
        for lane in 0..RAYS {
            let mut values = [1.0; RAYS];
            (values[lane], values[(lane + 5) % RAYS]) = (3.0, -2.0);
            assert_eq!(tests.range(&values), [-2.0, 3.0]);
            values[(lane + 9) % RAYS] = f32::NAN;
            lanes.t_max = values;
            assert_eq!(farthest(tests, &lanes), 3.0);
        }
    }
    for kernel in kernels() {
        match kernel {
            Kernel::Portable => {}
            Kernel::Avx2(tests) => check(tests),
            Kernel::Avx512(tests) => check(tests),
        }
    }
}
