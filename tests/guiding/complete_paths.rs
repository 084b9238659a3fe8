//! Tests of kernels, neighbours and mixtures of kept paths.

use fanal::base::random::Random;
use fanal::guiding::paths::cache::{Kept, PathCache};
use fanal::guiding::paths::guide::{Part, PathGuide};
use fanal::guiding::paths::kernel::{CUT, Kernel, truncated_density, truncated_normal};
use fanal::guiding::paths::neighbours::{NEIGHBOURS, nearest};
use fanal::guiding::paths::path::{CompletePath, End, Event, Step};
use fanal::guiding::paths::spatial::{InMedium, Reach, SpatialKernel};
use fanal::guiding::paths::tiles::Tiles;
use glam::{Vec2, Vec3};

/// Camera, middle point, last point of a kept path: planes z = 1 and x = 0, whose coordinates are easily known.
const THREE: [Vec3; 3] = [Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.0, 0.0, 2.0), Vec3::new(0.0, 0.0, 2.0)];

fn normal(random: &mut Random) -> f32 {
    let [u, v] = random.next_2d_f64();
    ((-2.0 * (-u).ln_1p()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32
}

/// Pairs of a last and a middle point: y' = 0.5·x + 0.2·n₁ + 0.3, z' = −0.3·y + 0.1·n₂ for the middle point (3 + x, y, 2), with
/// standard deviations 0.4 and 0.2 of x and y.
fn pair(random: &mut Random) -> [Vec3; 2] {
    let (x, y) = (0.4 * normal(random), 0.2 * normal(random));
    [last_of(x, y) + Vec3::new(0.0, 0.2 * normal(random), 0.1 * normal(random)), Vec3::new(3.0 + x, y, 2.0)]
}

fn last_of(x: f32, y: f32) -> Vec3 {
    Vec3::new(0.0, 0.5 * x + 0.3, 2.0 - 0.3 * y)
}

/// Of 20,000 neighbours the kernel has the means and the deviations of the Gaussian that they are drawn from, given the point before. Of N
/// numbers with deviation σ the mean deviates by σ/√N, of which 6 are allowed, and the deviation by 0.7 of that; cut at 3.33 σ it is 0.979 of
/// the whole (1 − c²·exp(−c²/2) / (2 (1 − exp(−c²/2))) of the variance).
#[test]
fn kernels_recover_a_gaussian() {
    let mut random = Random::new(1, 2, 3);
    let pairs: Vec<[Vec3; 2]> = (0..20_000).map(|_| pair(&mut random)).collect();
    let kernel = Kernel::fit(THREE, pairs.into_iter(), 1e-4);
    let square = f64::from(CUT * CUT);
    let kept = (1.0 - 0.5 * square * (-0.5 * square).exp() / (1.0 - (-0.5 * square).exp())).sqrt() as f32;
    for (x, y) in [(0.0, 0.0), (0.5, -0.2), (-0.8, 0.3)] {
        let from = Vec3::new(3.0 + x, y, 2.0);
        let n = 20_000;
        let drawn: Vec<Vec2> = (0..n)
            .map(|_| {
                let direction = kernel.sample(from, random.next_2d_f64()).unwrap();
                let at = from - direction * (from.x / direction.x);
                Vec2::new(at.y, at.z)
            })
            .collect();
        let mean = drawn.iter().sum::<Vec2>() / n as f32;
        let deviation = (drawn.iter().map(|at| (*at - mean).powf(2.0)).sum::<Vec2>() / n as f32).map(f32::sqrt);
        let expected = last_of(x, y);
        // Slopes are known up to 0.2/(0.4·√N) and 0.1/(0.2·√N) for each unit of x and y.
        let error = (Vec2::new(expected.y, expected.z) - mean).abs();
        assert!(error.x < 6.0 * 0.2 / 141.0 * (2.0 + 2.5 * x.abs()), "{x} {y}: {error}");
        assert!(error.y < 6.0 * 0.1 / 141.0 * (2.0 + 5.0 * y.abs()), "{x} {y}: {error}");
        let ratio = deviation / (Vec2::new(0.2, 0.1) * kept);
        assert!((ratio - Vec2::ONE).abs().max_element() < 6.0 * 1.4 / 141.0, "{ratio}");
    }
}

/// Densities of kernels and of places in the picture integrate to 1 (midpoint rule; the edge of the cut is left to 1 %).
#[test]
fn densities_integrate_to_one() {
    let mut random = Random::new(5, 0, 0);
    let pairs: Vec<[Vec3; 2]> = (0..11).map(|_| pair(&mut random)).collect();
    for pairs in [&pairs[..], &pairs[..3]] {
        let kernel = Kernel::fit(THREE, pairs.iter().copied(), 0.01);
        for from in [THREE[1], Vec3::new(3.4, 0.3, 2.0), Vec3::new(2.0, -0.5, 1.5)] {
            let (mut sum, steps, half) = (0.0, 1200, 3.0f32);
            for i in 0..steps * steps {
                let at = |i: usize| (i as f32 + 0.5) / steps as f32 * 2.0 * half - half;
                let to = Vec3::new(0.0, at(i % steps), 2.0 + at(i / steps)) - from;
                let (distance, direction) = (to.length(), to.normalize());
                sum += f64::from(kernel.density(from, direction) * direction.x.abs() / (distance * distance));
            }
            let mass = sum * f64::from(2.0 * half / steps as f32).powi(2);
            assert!((mass - 1.0).abs() < 0.01, "{mass}");
        }
    }
    let n = 2000;
    let at = |i: usize| (i as f32 + 0.5) / n as f32 * 8.0 - 4.0;
    let mass: f64 = (0..n * n).map(|i| f64::from(truncated_density(Vec2::new(at(i % n), at(i / n))))).sum();
    assert!((mass * (8.0 / n as f64).powi(2) - 1.0).abs() < 1e-3, "{mass}");
    assert!([[0.0, 0.3], [1.0 - f64::EPSILON, 0.9]].into_iter().all(|u| truncated_density(truncated_normal(u)) > 0.0));
}

/// Kernels to and from media: the masses of the eight parts of space around a point, of directions and points, are those of what is drawn, of
/// 40,000 draws 5σ, and 1 % of all for the quadrature; all parts together have 1. The same of distances in a direction that is given, of parts
/// before and behind a place. 3 pairs of media, two numbers of neighbours and two points before: false alarm 3e-5 in all.
#[test]
fn kernels_in_media_have_their_densities() {
    let mut random = Random::new(6, 0, 0);
    let deep = |random: &mut Random| {
        let ([last, middle], depth) = (pair(random), normal(random));
        [last + Vec3::X * (0.4 * depth + 0.2 * normal(random)), middle + Vec3::Z * 0.3 * depth]
    };
    let pairs: Vec<[Vec3; 2]> = (0..11).map(|_| deep(&mut random)).collect();
    let all = [[false, true], [true, true], [true, false]];
    for ([before, at], count) in all.into_iter().flat_map(|within| [11, 3].map(|count| (within, count))) {
        let within = InMedium { before, at };
        let kernel = SpatialKernel::fit(THREE, within, pairs[..count].iter().copied(), 0.01);
        for from in [THREE[1], Vec3::new(3.2, 0.3, 2.2)] {
            let n = 40_000;
            let drawn: Vec<Vec3> = (0..n)
                .map(|_| {
                    let [across, along] = [random.next_2d_f64(), random.next_2d_f64()];
                    let Reach { direction, distance } = kernel.sample(from, across, along).unwrap();
                    assert_eq!(distance.is_some(), at);
                    from + direction * distance.unwrap_or(-from.x / direction.x)
                })
                .collect();
            let middle = drawn.iter().sum::<Vec3>() / n as f32 + Vec3::new(0.0, 0.05, -0.03);
            let part = |p: Vec3| {
                usize::from(p.x > middle.x) | usize::from(p.y > middle.y) << 1 | usize::from(p.z > middle.z) << 2
            };
            let mut shares = [0.0; 8];
            drawn.iter().for_each(|&p| shares[part(p)] += 1.0 / f64::from(n));
            let spread = (drawn.iter().map(|p| (*p - middle).powf(2.0)).sum::<Vec3>() / n as f32).map(f32::sqrt);
            // Points of a grid over the spread; those of a plane alone lie in it.
            let (steps, half) = (if at { 160 } else { 1200 }, 5.0 * spread);
            let place = |i: i32, half: f32| ((i as f32 + 0.5) / steps as f32 * 2.0 - 1.0) * half;
            let cell = |half: f32| f64::from(2.0 * half / steps as f32);
            let mut masses = [0.0; 8];
            let mut add = |p: Vec3, volume: f64| {
                let (direction, squared) = ((p - from).normalize(), p.distance_squared(from));
                let cos = if at { 1.0 } else { direction.x.abs() };
                masses[part(p)] += f64::from(kernel.density(from, direction, p) * cos / squared) * volume;
            };
            for (y, z) in (0..steps).flat_map(|y| (0..steps).map(move |z| (y, z))) {
                let [y, z] = [middle.y + place(y, half.y), middle.z + place(z, half.z)];
                let area = cell(half.y) * cell(half.z);
                if at {
                    (0..steps).for_each(|x| add(Vec3::new(middle.x + place(x, half.x), y, z), area * cell(half.x)));
                } else {
                    add(Vec3::new(0.0, y, z), area);
                }
            }
            let all: f64 = masses.iter().sum();
            assert!((all - 1.0).abs() < 0.01, "{within:?}, {count}: {all}");
            for (share, mass) in shares.into_iter().zip(masses) {
                // A plane has parts on one side of it.
                assert!((share - mass).abs() < 0.01 + 5.0 * (mass / f64::from(n)).sqrt() || !at, "{share} {mass}");
            }
            if at {
                distances_have_their_density(&kernel, from, (middle + Vec3::Y * 0.1 - from).normalize(), &mut random);
            }
        }
    }
}

/// See [`kernels_in_media_have_their_densities`].
fn distances_have_their_density(kernel: &SpatialKernel, from: Vec3, direction: Vec3, random: &mut Random) {
    let n = 40_000;
    let drawn: Vec<f32> = (0..n).filter_map(|_| kernel.distance(from, direction, random.next_2d_f64())).collect();
    let place = drawn.iter().sum::<f32>() / drawn.len() as f32 + 0.02;
    let (steps, length) = (20_000, 12.0);
    let mut masses = [0.0; 2];
    for i in 0..steps {
        let distance = (i as f32 + 0.5) / steps as f32 * length;
        let density = f64::from(kernel.distance_density(from, direction, from + direction * distance));
        masses[usize::from(distance > place)] += density * f64::from(length) / f64::from(steps);
    }
    for (behind, mass) in masses.into_iter().enumerate() {
        let share =
            drawn.iter().filter(|&&distance| usize::from(distance > place) == behind).count() as f64 / f64::from(n);
        assert!((share - mass).abs() < 1e-3 + 5.0 * (mass * (1.0 - mass) / f64::from(n)).sqrt(), "{share} {mass}");
    }
}

/// A path of three points around `points`, by its own kernels.
fn path(film: [f32; 2], points: [Vec3; 3]) -> CompletePath {
    let step = |from: Vec3, to: Vec3| Step {
        direction: (to - from).normalize_or(Vec3::Z),
        pdf: 0.3,
        by_kernel: 1.0,
        event: Event { transmits: false, delta: false, medium: false },
    };
    CompletePath {
        film,
        origin: Vec3::ZERO,
        points: points.into_iter().collect(),
        steps: points.windows(2).map(|pair| step(pair[0], pair[1])).collect(),
        end: End::Surface,
    }
}

fn random_paths(count: u64, spread: f32) -> Vec<CompletePath> {
    let mut random = Random::new(9, 0, count);
    let mut near = |base: Vec3| base + spread * Vec3::from_array(std::array::from_fn(|_| random.next_f32() - 0.5));
    let bases = [Vec3::new(0.0, 0.0, 3.0), Vec3::new(2.0, 1.0, 4.0), Vec3::new(-1.0, 4.0, 3.0)];
    (0..count).map(|i| path([(i % 60) as f32, (i * 7 % 40) as f32], bases.map(&mut near))).collect()
}

#[test]
fn the_nearest_are_those_of_all_pairs() {
    let mut paths = random_paths(300, 1.0);
    // Some coincide.
    let copies = paths[..20].to_vec();
    paths.extend(copies);
    let all: Vec<&CompletePath> = paths.iter().collect();
    for (index, found) in nearest(&all).into_iter().enumerate() {
        let mut others: Vec<(f32, u32)> = (0..all.len() as u32)
            .filter(|&other| other as usize != index)
            .map(|other| (all[index].squared_distance(all[other as usize], f32::INFINITY), other))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let expected: Vec<u32> = others.iter().take(NEIGHBOURS).map(|(_, other)| *other).collect();
        assert_eq!(found, expected, "{index}");
    }
    assert!(nearest(&[]).is_empty() && nearest(&all[..1]) == [Vec::<u32>::new()]);
    assert_eq!(nearest(&all[..4]).iter().map(Vec::len).collect::<Vec<_>>(), [3; 4]);
}

#[test]
fn tiles_hold_all_that_reach_them() {
    let mut random = Random::new(3, 1, 4);
    let places: Vec<([f32; 2], u32)> =
        (0..500).map(|i| ([100.0 * random.next_f32(), 70.0 * random.next_f32()], i % 3)).collect();
    for radius in [3.0, 10.0, 300.0] {
        let tiles = Tiles::new([100, 70], &places, radius);
        for _ in 0..500 {
            let film = [100.0 * random.next_f32(), 70.0 * random.next_f32()];
            let kind = random.below(3);
            let listed: Vec<u32> = tiles.of_kind(film, kind).iter().map(|entry| entry.1).collect();
            assert!(listed.is_sorted());
            for (index, (place, of)) in (0..).zip(&places) {
                let reaches = *of == kind && Vec2::from(*place).distance(Vec2::from(film)) < radius;
                assert!(!reaches || listed.contains(&index));
                assert!(*of == kind || !listed.contains(&index));
            }
        }
        // The last tile ends behind the picture.
        let outside = [[-1.0, 5.0], [5.0, 70.5], [100.0, 5.0], [5.0, 1000.0], [f32::NAN, 1.0]];
        assert!(outside.into_iter().all(|film| tiles.at(film).is_empty()));
    }
}

/// A new path as a guide draws it.
fn drawn(guide: &PathGuide, random: &mut Random) -> CompletePath {
    let chosen = guide.choose(random.next_f64()).unwrap();
    let film = chosen.film(random.next_2d_f64());
    let mut points = [chosen.path().points[0]; 3];
    for step in 0..2 {
        let direction =
            chosen.kernel(step).unwrap().sample(points[step], random.next_2d_f64(), || [0.5; 2]).unwrap().direction;
        points[step + 1] = points[step] + direction * 2.0;
    }
    path(film, points)
}

/// Guides of hardly any paths, of the same path many times, of paths whose points coincide, of coordinates beyond all measure: what they
/// draw has a density, and it is a number.
#[test]
fn degenerate_paths_make_guides() {
    let one = random_paths(1, 1.0);
    let same: Vec<CompletePath> = std::iter::repeat_n(one[0].clone(), 40).collect();
    let line: Vec<CompletePath> =
        (0..20).map(|i| path([9.0; 2], [0.0, 1.0, 2.0].map(|x| Vec3::new(x, i as f32, 3.0)))).collect();
    let point: Vec<CompletePath> = (0..7).map(|_| path([1.0; 2], [Vec3::ONE; 3])).collect();
    let large: Vec<CompletePath> =
        (0..7).map(|i| path([1.0; 2], [1.0, 2.0, 3.0].map(|x| x * 1e18 * Vec3::new(1.0, i as f32, 2.0)))).collect();
    let mut random = Random::new(8, 8, 8);
    for (paths, footprint) in
        [(one, 0.01), (same.clone(), 0.01), (same, 0.0), (line, 1e-3), (point, 1e-3), (large, f32::INFINITY)]
    {
        let parts: Vec<Part> = paths.iter().map(|path| Part { path, weight: 1.0, footprint }).collect();
        let guide = PathGuide::new(&parts, [64, 48], 5.0);
        for _ in 0..200 {
            let Some(chosen) = guide.choose(random.next_f64()) else { panic!("there is one") };
            let (film, from) = (chosen.film(random.next_2d_f64()), chosen.path().points[0]);
            assert!(film.iter().all(|x| x.is_finite()));
            if let Some(reach) = chosen.kernel(0).unwrap().sample(from, random.next_2d_f64(), || [0.5; 2]) {
                let direction = reach.direction;
                assert!(direction.is_finite());
                let density = chosen.kernel(0).unwrap().density(from, direction, from + direction);
                assert!(density >= 0.0, "{density}");
            }
            let density = guide.density(&path(film, [from, Vec3::ZERO, Vec3::X]));
            assert!(density >= 0.0, "{density}");
        }
    }
    // None: nothing is drawn, and nothing has a density.
    let none = PathGuide::new(&[], [64, 48], 5.0);
    assert!(none.is_empty() && none.choose(0.5).is_none() && !none.covers([1.0; 2]));
    assert_eq!(none.density(&path([1.0; 2], THREE)), 0.0);
}

/// What a guide draws in the picture has a density there, and is in a place that it covers; another kind of path has none, nor has what is
/// drawn outside, also where tiles end there.
#[test]
fn drawn_paths_have_a_density() {
    let paths = random_paths(400, 0.5);
    let weight = |i: usize| 1.0 + (i % 5) as f64;
    let parts: Vec<Part> =
        paths.iter().enumerate().map(|(i, path)| Part { path, weight: weight(i), footprint: 1e-3 }).collect();
    let mut random = Random::new(6, 6, 6);
    for size in [[64, 48], [33, 25]] {
        let guide = PathGuide::new(&parts, size, 6.0);
        for _ in 0..2000 {
            let new = drawn(&guide, &mut random);
            let inside = (0..2).all(|axis| (0.0..size[axis] as f32).contains(&new.film[axis]));
            assert!((guide.density(&new) > 0.0) == inside && guide.covers(new.film) == inside, "{:?}", new.film);
            let mut other = new.clone();
            other.steps[1].event.transmits = true;
            assert_eq!(guide.density(&other), 0.0);
            assert_eq!(guide.density(&CompletePath { end: End::Sky, ..new }), 0.0);
        }
    }
}

/// Paths weigh what they bring: one that is drawn often already weighs less in the next batch, a new one its whole part, and no more paths
/// are kept than there is room for.
#[test]
fn weights_follow_what_paths_bring() {
    let kept = |path: &CompletePath, value: f64| Kept { path: path.clone(), value, unguided: 1.0, footprint: 1e-3 };
    let paths = random_paths(60, 0.2);
    let mut cache = PathCache::default();
    let first: Vec<Kept> = paths[..50].iter().map(|path| kept(path, 1.0)).collect();
    let guide = cache.learn(first, &PathGuide::default(), 1000.0, [64, 48]);
    let share = |guide: &PathGuide, path: &CompletePath| {
        let n = 4000;
        let of = |i| guide.choose((f64::from(i) + 0.5) / f64::from(n)).unwrap().path() == path;
        f64::from((0..n).filter(|&i| of(i)).count() as u32) / f64::from(n)
    };
    assert!(paths[..50].iter().all(|path| (share(&guide, path) - 0.02).abs() < 1e-3));
    // A dark one, and one that is as bright as all others were together.
    let next = vec![kept(&paths[50], 0.0), kept(&paths[51], 50.0)];
    let guide = cache.learn(next, &guide, 1000.0, [64, 48]);
    assert_eq!((cache.len(), guide.len()), (52, 52));
    assert_eq!(share(&guide, &paths[50]), 0.0);
    // The old ones bring next to nothing now, and have half of what they weighed.
    let bright = share(&guide, &paths[51]);
    assert!((0.6..0.7).contains(&bright), "{bright}");
    let guide = cache.learn(Vec::new(), &guide, 1000.0, [64, 48]);
    assert_eq!(guide.len(), 52);
}
