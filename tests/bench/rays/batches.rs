//! The rays of a render's paths, one at a time and in batches.

use std::path::{Path, PathBuf};

use fanal::base::random::{Dimension, Random};
use fanal::geometry::{Accel, Geometry, Hit, Ray, Scratch, Surface, Way};
use fanal::lights::seen::LightView;
use fanal::materials::Transport;
use fanal::scene::{Scene, readers};
use glam::Vec3;

use super::{cpu_seconds, median, write_floats, write_rays, write_words};

/// Rounds, of which the median counts.
const ROUNDS: usize = 7;
/// Pixels along the side of a tile, whose rays of one depth are a batch.
const TILE: u32 = 16;
/// Paths of a pixel.
const SAMPLES: u64 = 16;
/// Tiles along each side of the picture that are looked at.
const TILES: u32 = 4;
/// Least number of rays that are asked about in a round, some again and again, so that it lasts long enough to be timed.
const LEAST: usize = 1 << 20;
/// Segments of a path.
const DEPTH: u32 = 7;
/// Kinds of rays: those of paths by depth, and those towards lights by the depth of the surface they leave.
const KINDS: [&str; 7] = ["camera", "bounce 1", "bounce 2", "bounce 3-6", "shadow 1", "shadow 2", "shadow 3-6"];
/// The first kind of rays towards lights.
const SHADOWS: usize = 4;
/// Ways to answer, the first without the batches' interface.
const WAYS: [Way; 3] = [Way::Single, Way::InFlight, Way::Bundles];

type Batch = Vec<(Ray, f32)>;

/// One line of the table for each kind of rays of each scene. Into the folder `raw` go the last scene's triangles, and the rays of each kind with
/// what they meet.
pub fn compare(paths: &[PathBuf], raw: Option<&Path>) {
    println!("Mrays/s, one thread, median of {ROUNDS}");
    println!(
        "{:>16} {:>12} {:>8} {:>8} {:>9} {:>9} {:>6}",
        "scene", "rays", "number", "single", "in flight", "bundles", "ratio"
    );
    for path in paths {
        let loaded = readers::load(path).expect("the scene is sound");
        let film = &loaded.file.film;
        let scene = Scene::build(&loaded, [film.width, film.height]).expect("the scene is sound");
        let name = path.parent().and_then(Path::file_name).unwrap_or(path.as_os_str()).to_string_lossy();
        let kinds = batches(&scene);
        if let Some(folder) = raw {
            write_raw(folder, &scene, &kinds).expect("the folder can be written, and all shapes are triangles");
        }
        for (kind, batches) in kinds.iter().enumerate() {
            let count: usize = batches.iter().map(Vec::len).sum();
            if count > 0 {
                let speeds = measure(&scene.accel, batches, kind >= SHADOWS).map(|time| count as f64 * 1e-6 / time);
                let [single, flight, coherent] = speeds;
                let ratio = flight.max(coherent) / single;
                println!(
                    "{name:>16} {:>12} {count:>8} {single:>8.2} {flight:>9.2} {coherent:>9.2} {ratio:>6.2}",
                    KINDS[kind]
                );
            }
        }
    }
}

/// Writes `vertices`, `triangles`, and of each kind of rays by its number `rays0`, the numbers of rays in its batches `batches0`, and the
/// distances of their hits, or whether they are in shadow, `met0`.
fn write_raw(folder: &Path, scene: &Scene, kinds: &[Vec<Batch>]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mesh = triangles(scene)?;
    write_floats(folder, "vertices", mesh.iter().flatten().flat_map(|p| p.to_array()))?;
    write_words(folder, "triangles", 0..3 * mesh.len() as u32)?;
    for (kind, batches) in kinds.iter().enumerate() {
        let rays = || batches.iter().flatten();
        write_words(folder, &format!("batches{kind}"), batches.iter().map(|batch| batch.len() as u32))?;
        write_rays(folder, &format!("rays{kind}"), rays())?;
        let met = rays().map(|(ray, t_max)| match kind < SHADOWS {
            true => scene.accel.intersect(ray).map_or(-1.0, |hit| hit.distance),
            false => f32::from(scene.accel.occluded(ray, *t_max)),
        });
        write_floats(folder, &format!("met{kind}"), met)?;
    }
    Ok(())
}

/// The corners of all triangles that rays meet.
fn triangles(scene: &Scene) -> std::io::Result<Vec<[Vec3; 3]>> {
    let mut all = Vec::new();
    for shape in scene.shapes.iter().filter(|shape| !shape.unseen) {
        match &shape.geometry {
            Geometry::Mesh { mesh, .. } => all.extend((0..mesh.triangles.len() as u32).map(|i| shape.triangle(i))),
            Geometry::Sphere(_) => return Err(std::io::Error::other("a sphere")),
        }
    }
    Ok(all)
}

/// Batches of rays by kind.
fn batches(scene: &Scene) -> [Vec<Batch>; KINDS.len()] {
    let mut batches: [Vec<Batch>; KINDS.len()] = Default::default();
    let [columns, rows] = scene.size;
    for tile in 0..TILES * TILES {
        let place =
            |i: u32, size: u32| (2 * i + 1) * size / (2 * TILES) - (TILE / 2).min((2 * i + 1) * size / (2 * TILES));
        let corner = [place(tile % TILES, columns), place(tile / TILES, rows)];
        for (depth, [path, shadow]) in rays_of_tile(scene, corner, tile).into_iter().enumerate() {
            batches[depth.min(3)].push(path);
            batches[SHADOWS + depth.min(2)].push(shadow);
        }
    }
    batches
}

/// The rays of a tile's paths and from their ends towards lights, by depth.
fn rays_of_tile(scene: &Scene, [left, top]: [u32; 2], tile: u32) -> Vec<[Batch; 2]> {
    let mut rays = vec![[Batch::new(), Batch::new()]; DEPTH as usize];
    for pixel in 0..TILE * TILE {
        for sample in 0..SAMPLES {
            let random = Random::new(1, u64::from(tile), u64::from(pixel) * SAMPLES + sample);
            let [x, y] = random.at(Dimension::FILM).next_2d();
            let film = [(left + pixel % TILE) as f32 + x, (top + pixel / TILE) as f32 + y];
            let ray = scene.camera.ray(film, scene.camera.lens(&random));
            rays_of_path(scene, ray, random, &mut rays);
        }
    }
    rays
}

fn rays_of_path(scene: &Scene, mut ray: Ray, mut random: Random, rays: &mut [[Batch; 2]]) {
    let mut throughput = 1.0;
    for (depth, [paths, shadows]) in (1..).zip(rays) {
        random.begin_vertex(depth);
        paths.push((ray, f32::INFINITY));
        let Some(surface) = scene.trace(&ray, &mut random.at(Dimension::SEGMENT)) else { return };
        let material = scene.material(&surface);
        let wo = surface.frame().to_local(-ray.direction);
        if !material.is_delta() {
            shadows.extend(shadow(scene, &surface, wo, &random));
        }
        let lobe = random.at(Dimension::LOBE).next_f32();
        let u = random.at(Dimension::DIRECTION).next_2d();
        let Some(sample) = material.sample(surface.uv, wo, lobe, u, Transport::Radiance) else { return };
        throughput *= sample.weight.max_element();
        let survival = if depth < 4 { 1.0 } else { throughput.clamp(0.05, 1.0) };
        if random.at(Dimension::ROULETTE).next_f32() >= survival {
            return;
        }
        throughput /= survival;
        ray = surface.leave(surface.frame().to_world(sample.wi));
    }
}

/// The ray towards a light that is chosen and sampled as the path tracer does.
fn shadow(scene: &Scene, surface: &Surface, wo: Vec3, random: &Random) -> Option<(Ray, f32)> {
    let (choice, u) = (scene.lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
    let light = scene.lights.sample(surface.point, choice, u, &LightView::PLAIN)?;
    let value = scene.material(surface).eval(surface.uv, wo, surface.frame().to_local(light.wi));
    let (ray, t_max) = surface.towards(light.wi, light.distance);
    (value != Vec3::ZERO && t_max > 0.0).then_some((ray, t_max))
}

/// Median seconds for all batches, each way, whose answers are the same.
fn measure(accel: &Accel, batches: &[Batch], shadows: bool) -> [f64; WAYS.len()] {
    let alone: Vec<Vec<Ray>> = batches.iter().map(|batch| batch.iter().map(|(ray, _)| *ray).collect()).collect();
    let repeats = LEAST.div_ceil(batches.iter().map(Vec::len).sum());
    let mut scratch = Scratch::default();
    let mut ask = |way: Way| {
        let (mut hits, mut occluded): (Vec<Vec<Option<Hit>>>, Vec<Vec<bool>>) = (Vec::new(), Vec::new());
        match shadows {
            false => hits.extend(alone.iter().map(|rays| vec![None; rays.len()])),
            true => occluded.extend(batches.iter().map(|rays| vec![false; rays.len()])),
        }
        let start = cpu_seconds();
        for _ in 0..repeats {
            for (rays, hits) in alone.iter().zip(&mut hits) {
                match way {
                    Way::Single => rays.iter().zip(hits).for_each(|(ray, hit)| *hit = accel.intersect(ray)),
                    way => accel.intersect_all(rays, way, &mut scratch, hits),
                }
            }
            for (rays, occluded) in batches.iter().zip(&mut occluded) {
                match way {
                    Way::Single => (rays.iter().zip(occluded))
                        .for_each(|((ray, t_max), hidden)| *hidden = accel.occluded(ray, *t_max)),
                    way => accel.occluded_all(rays, way, &mut scratch, occluded),
                }
            }
        }
        ((cpu_seconds() - start) / repeats as f64, hits, occluded)
    };
    let (_, hits, occluded) = ask(Way::Single);
    let rounds: Vec<[f64; WAYS.len()]> = (0..ROUNDS)
        .map(|_| {
            WAYS.map(|way| {
                let (time, these_hits, these_occluded) = ask(way);
                assert!(these_hits == hits && these_occluded == occluded, "no answer depends on the way");
                time
            })
        })
        .collect();
    std::array::from_fn(|way| median(rounds.iter().map(|round| round[way])))
}
