//! How fast rays are answered, how much memory a triangle takes, and how long a large mesh takes to load.
//!
//!     cargo bench --bench rays                           all of it
//!     cargo bench --bench rays -- queries [--raw DIR]    one round of queries; writes the scene, the rays and the hits
//!     cargo bench --bench rays -- shadows SCENE...       shadow rays of scenes, before and after an order is learned
//!     cargo bench --bench rays -- batches SCENE... [--raw DIR]
//!                                                        rays of a render's paths, one at a time and in batches
//!     cargo bench --bench rays -- raw DIR                these rays one at a time; older versions can be given `rays/raw.rs`
//!     cargo bench --bench rays -- build SCENE...         building hierarchies: seconds that pass, and of all processors
//!
//! The scene is procedural: displaced ground, closed lumps and loose triangles, about 300,000 triangles in all. Rays start
//! anywhere in its box in any direction, one after the other on one thread; any-hit queries end at a random point of the box.
//! Times are the thread's own seconds on the processor. `rays_embree.py` asks Embree the same.

#[path = "rays/batches.rs"]
mod batches;
#[path = "rays/build.rs"]
mod build;
#[path = "rays/raw.rs"]
mod raw;
#[path = "rays/shadows.rs"]
mod shadows;

use std::f32::consts::PI;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::{Parser, Subcommand};
use fanal::base::pages::LargePages;
use fanal::base::random::Random;
use fanal::geometry::mesh::Mesh;
use fanal::geometry::{Accel, Hit, Ray, Shape, Surface};
use fanal::scene::readers;
use glam::{Affine3A, Vec2, Vec3};

/// As in the program: where memory lies in small pages, rays wait for their table.
#[global_allocator]
static MEMORY: LargePages = LargePages;

/// Rays per round.
const RAYS: usize = 1_000_000;
/// Rounds, of which the median counts.
const ROUNDS: usize = 5;
/// Vertices along each side of the ground of the mesh that is loaded: a million triangles.
const LARGE: u32 = 708;

#[derive(Parser)]
struct Options {
    #[command(subcommand)]
    what: Option<What>,
    /// Given by cargo.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

#[derive(Subcommand)]
enum What {
    /// One round of queries.
    Queries {
        /// Folder for `vertices`, `triangles`, `rays` and `hits` (raw, little-endian).
        #[arg(long)]
        raw: Option<PathBuf>,
    },
    /// Rays per second (millions) of paths by depth and towards lights: one at a time, as single rays in flight, and as coherent
    /// ones.
    Batches {
        /// Scenes.
        scenes: Vec<PathBuf>,
        /// Folder for the last scene's triangles and rays, and for what these meet (raw, little-endian).
        #[arg(long)]
        raw: Option<PathBuf>,
    },
    /// Rays per second (millions) of what `batches --raw` has written, one at a time.
    Raw {
        /// Folder.
        folder: PathBuf,
    },
    /// Seconds to build the hierarchies of a million triangles and of scenes.
    Build {
        /// Scenes.
        scenes: Vec<PathBuf>,
    },
    /// Shadow rays per second (millions) of scenes, before and after the hierarchy has learned an order from others, whose making
    /// and learning take the processors the milliseconds in the last column.
    Shadows {
        /// Scenes.
        scenes: Vec<PathBuf>,
    },
}

fn main() {
    let what = Options::parse().what;
    match &what {
        Some(What::Shadows { scenes }) => return shadows::compare(scenes),
        Some(What::Batches { scenes, raw }) => return batches::compare(scenes, raw.as_deref()),
        Some(What::Build { scenes }) => return build::time(scenes),
        Some(What::Raw { folder }) => return raw::time(folder),
        Some(What::Queries { .. }) | None => {}
    }
    let mesh = scene();
    let rays = rays();
    let shapes = [Shape::mesh(Arc::new(mesh.clone()), Affine3A::IDENTITY, false)];
    let accel = Accel::new(&shapes);
    match what {
        Some(What::Queries { raw }) => {
            // A first round fills the caches, as those of a peer are that answers again and again.
            queries(&accel, &rays);
            let [closest, any] = queries(&accel, &rays);
            println!("closest {closest:.6} any {any:.6}");
            if let Some(folder) = raw {
                write_raw(&folder, &mesh, &rays, &accel).expect("the folder can be written");
            }
        }
        _ => {
            let rounds: Vec<[f64; 2]> = (0..ROUNDS).map(|_| queries(&accel, &rays)).collect();
            let speed = |kind: usize| RAYS as f64 * 1e-6 / median(rounds.iter().map(|round| round[kind]));
            println!("{} triangles, {RAYS} incoherent rays, one thread, median of {ROUNDS}", mesh.triangles.len());
            println!("closest hit   {:7.3} Mrays/s", speed(0));
            println!("any hit       {:7.3} Mrays/s", speed(1));
            println!("surface       {:7.1} ns per hit", surfaces(&accel, &shapes, &rays));
            let (of_mesh, of_accel) = (mesh_bytes(&mesh), accel.bytes());
            let per_triangle = |bytes: usize| bytes as f64 / mesh.triangles.len() as f64;
            println!(
                "memory        {:7.1} bytes per triangle: mesh {:.1}, hierarchy {:.1}",
                per_triangle(of_mesh + of_accel),
                per_triangle(of_mesh),
                per_triangle(of_accel)
            );
            large_mesh();
        }
    }
}

/// Displaced ground of `n` × `n` vertices over the unit square.
fn ground(n: u32, random: &mut Random) -> Mesh {
    let waves: Vec<[f32; 4]> = (0..12)
        .map(|i| {
            let frequency = 1.6f32.powi(i);
            let turn = random.range(0.0, 2.0 * PI);
            [frequency * turn.cos(), frequency * turn.sin(), random.range(0.0, 2.0 * PI), 0.12 / frequency]
        })
        .collect();
    let mut mesh = Mesh::default();
    for i in 0..n * n {
        let uv = Vec2::new((i % n) as f32, (i / n) as f32) / (n - 1) as f32;
        let (mut height, mut slope) = (0.0, Vec2::ZERO);
        for [fx, fy, phase, size] in &waves {
            let angle = 2.0 * PI * (fx * uv.x + fy * uv.y) + phase;
            height += size * angle.sin();
            slope += 2.0 * PI * Vec2::new(*fx, *fy) * size * angle.cos();
        }
        mesh.positions.push(Vec3::new(uv.x, uv.y, height));
        mesh.normals.push(Vec3::new(-slope.x, -slope.y, 1.0).normalize());
        mesh.uvs.push(uv);
    }
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            let a = y * n + x;
            mesh.triangles.extend([[a, a + 1, a + n], [a + 1, a + n + 1, a + n]]);
        }
    }
    mesh
}

/// A closed lump of `2 · turns · rings` triangles.
fn lump(center: Vec3, radius: f32, rings: u32, turns: u32, random: &mut Random, mesh: &mut Mesh) {
    let first = mesh.positions.len() as u32;
    let bumps: [f32; 3] = std::array::from_fn(|_| random.range(2.0, 9.0).floor());
    for ring in 0..=rings {
        for turn in 0..turns {
            let (theta, phi) = (PI * ring as f32 / rings as f32, 2.0 * PI * turn as f32 / turns as f32);
            let normal = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let bump = 1.0 + 0.2 * theta.sin() * (bumps[0] * phi).sin() * (bumps[1] * theta + bumps[2]).sin();
            mesh.positions.push(center + radius * bump * normal);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(phi, theta));
        }
    }
    for ring in 0..rings {
        for turn in 0..turns {
            let at = |ring: u32, turn: u32| first + ring * turns + turn % turns;
            let [a, b, c, d] = [at(ring, turn), at(ring + 1, turn), at(ring + 1, turn + 1), at(ring, turn + 1)];
            if ring + 1 < rings {
                mesh.triangles.push([a, b, c]);
            }
            if ring > 0 {
                mesh.triangles.push([a, c, d]);
            }
        }
    }
}

fn scene() -> Mesh {
    let mut random = Random::new(1, 0, 0);
    let mut mesh = ground(280, &mut random);
    for _ in 0..60 {
        let center = Vec3::new(random.next_f32(), random.next_f32(), random.range(0.0, 0.5));
        let radius = random.range(0.01, 0.06);
        lump(center, radius, 30, 34, &mut random, &mut mesh);
    }
    for _ in 0..26_000 {
        let center = Vec3::new(random.next_f32(), random.next_f32(), random.range(-0.1, 0.6));
        let first = mesh.positions.len() as u32;
        let size = 0.002 * 8f32.powf(random.next_f32());
        for _ in 0..3 {
            mesh.positions.push(center + size * direction(&mut random));
            mesh.normals.push(Vec3::Z);
            mesh.uvs.push(Vec2::ZERO);
        }
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

fn direction(random: &mut Random) -> Vec3 {
    let (z, phi) = (random.range(-1.0, 1.0), random.range(0.0, 2.0 * PI));
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * phi.cos(), r * phi.sin(), z).normalize()
}

/// Rays, and where their any-hit queries end.
fn rays() -> Vec<(Ray, f32)> {
    let mut random = Random::new(2, 0, 0);
    let point = |random: &mut Random| Vec3::new(random.next_f32(), random.next_f32(), random.range(-0.1, 0.6));
    (0..RAYS)
        .map(|_| {
            let origin = point(&mut random);
            let ray = Ray { origin, direction: direction(&mut random) };
            (ray, origin.distance(point(&mut random)))
        })
        .collect()
}

/// Seconds of closest-hit and of any-hit queries.
fn queries(accel: &Accel, rays: &[(Ray, f32)]) -> [f64; 2] {
    let start = cpu_seconds();
    let hits = rays.iter().filter(|(ray, _)| std::hint::black_box(accel.intersect(ray)).is_some()).count();
    let between = cpu_seconds();
    let shadows = rays.iter().filter(|(ray, t_max)| accel.occluded(ray, *t_max)).count();
    let end = cpu_seconds();
    assert!(hits > RAYS / 10 && shadows > RAYS / 10, "{hits} {shadows}");
    [between - start, end - between]
}

/// Nanoseconds from a hit to the point of the surface.
fn surfaces(accel: &Accel, shapes: &[Shape], rays: &[(Ray, f32)]) -> f64 {
    let hits: Vec<(Ray, Hit)> = rays.iter().filter_map(|(ray, _)| Some((*ray, accel.intersect(ray)?))).collect();
    median((0..ROUNDS).map(|_| {
        let start = cpu_seconds();
        for (ray, hit) in &hits {
            std::hint::black_box(Surface::new(ray, hit, &shapes[hit.shape as usize]));
        }
        (cpu_seconds() - start) * 1e9 / hits.len() as f64
    }))
}

/// Seconds that this thread spent on the processor; where the system does not tell, seconds that passed.
fn cpu_seconds() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    // What is told is as of the last time that the system looked, some milliseconds ago: it looks now.
    std::thread::yield_now();
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Seconds that all threads spent on processors; not a number where the system does not tell.
fn process_seconds() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let told = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<f64>().ok()
    });
    told.reduce(|a, b| a + b).map_or(f64::NAN, |ns| ns * 1e-9)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn mesh_bytes(mesh: &Mesh) -> usize {
    size_of_val(mesh.positions.as_slice())
        + size_of_val(mesh.normals.as_slice())
        + size_of_val(mesh.uvs.as_slice())
        + size_of_val(mesh.triangles.as_slice())
}

/// Loading a million triangles, from the file to a hierarchy that answers.
fn large_mesh() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mesh = ground(LARGE, &mut Random::new(3, 0, 0));
    write_ply(&folder.path().join("mesh.ply"), &mesh).expect("the folder can be written");
    let scene = r#"{"version": 1, "camera": {"to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "fov": 40},
        "film": {"width": 4, "height": 4}, "materials": {"m": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.5, 0.5]}}},
        "meshes": {"m": {"type": "ply", "file": "mesh.ply"}},
        "shapes": [{"geometry": {"type": "mesh", "mesh": "m"}, "material": "m"}], "lights": []}"#;
    let path = folder.path().join("scene.json");
    std::fs::write(&path, scene).expect("the folder can be written");
    let rounds: Vec<[f64; 2]> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            let loaded = readers::load(&path).expect("the scene is sound");
            let between = start.elapsed().as_secs_f64();
            let mesh = loaded.meshes["m"].clone();
            let accel = Accel::new(&[Shape::mesh(mesh, Affine3A::IDENTITY, false)]);
            let end = start.elapsed().as_secs_f64();
            assert!(accel.bounds()[0].is_finite());
            [between, end - between]
        })
        .collect();
    let [load, build] = [0, 1].map(|i| median(rounds.iter().map(|round| round[i])));
    let triangles = mesh.triangles.len();
    println!("{triangles} triangles from PLY: {:.3} s = load {load:.3} + build {build:.3}", load + build);
}

fn write_ply(path: &Path, mesh: &Mesh) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", mesh.positions.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz", "u", "v"] {
        writeln!(out, "property float {name}")?;
    }
    write!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.triangles.len())?;
    for ((p, n), uv) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.uvs) {
        for value in [p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y] {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for index in triangle {
            out.write_all(&index.to_le_bytes())?;
        }
    }
    out.flush()
}

/// The scene and the rays (origin, direction, end) for a peer, and our hits: distance, negative without one, and triangle.
fn write_raw(folder: &Path, mesh: &Mesh, rays: &[(Ray, f32)], accel: &Accel) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    write_floats(folder, "vertices", mesh.positions.iter().flat_map(|p| p.to_array()))?;
    write_words(folder, "triangles", mesh.triangles.iter().flatten().copied())?;
    write_rays(folder, "rays", rays.iter())?;
    let hits = rays.iter().map(|(ray, _)| accel.intersect(ray).map_or(-1.0, |hit| hit.distance));
    write_floats(folder, "hits", hits)
}

/// Origins, directions and lengths.
fn write_rays<'a>(folder: &Path, name: &str, rays: impl Iterator<Item = &'a (Ray, f32)>) -> std::io::Result<()> {
    let numbers = rays.flat_map(|(ray, t_max)| {
        let ([a, b, c], [d, e, f]) = (ray.origin.to_array(), ray.direction.to_array());
        [a, b, c, d, e, f, *t_max]
    });
    write_floats(folder, name, numbers)
}

fn write_floats(folder: &Path, name: &str, numbers: impl Iterator<Item = f32>) -> std::io::Result<()> {
    std::fs::write(folder.join(name), numbers.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
}

fn write_words(folder: &Path, name: &str, numbers: impl Iterator<Item = u32>) -> std::io::Result<()> {
    std::fs::write(folder.join(name), numbers.flat_map(u32::to_le_bytes).collect::<Vec<u8>>())
}
