//! How long hierarchies take to be built.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use fanal::base::random::Random;
use fanal::geometry::{Accel, Shape};
use fanal::scene::{Scene, readers};
use glam::Affine3A;

use super::{LARGE, cpu_seconds, ground, median, process_seconds};

/// Rounds, of which the median counts.
const ROUNDS: usize = 7;

/// Seconds that pass, that all processors take, and of those the ones of the thread that asks: what other threads do not share.
/// One line of the table for a mesh of a million triangles, and for each scene two: its hierarchy alone, and all of it once its
/// files are read.
pub fn time(paths: &[PathBuf]) {
    println!("{:>34} {:>9} {:>9} {:>9}", "seconds", "passed", "used", "in series");
    let mesh = Arc::new(ground(LARGE, &mut Random::new(3, 0, 0)));
    let shapes = [Shape::mesh(mesh, Affine3A::IDENTITY, false)];
    row("a million triangles", || drop(Accel::new(&shapes)));
    for path in paths {
        time_scene(path);
    }
}

fn time_scene(path: &Path) {
    let loaded = readers::load(path).expect("the scene is sound");
    let film = &loaded.file.film;
    let build = || Scene::build(&loaded, [film.width, film.height]).expect("the scene is sound");
    let scene = build();
    let name = path.parent().and_then(Path::file_name).unwrap_or(path.as_os_str()).to_string_lossy();
    row(&format!("{name}: hierarchy"), || drop(Accel::new(&scene.shapes)));
    row(&format!("{name}: all"), || drop(build()));
}

fn row(name: &str, work: impl Fn()) {
    let rounds: Vec<[f64; 3]> = (0..ROUNDS)
        .map(|_| {
            let (start, used, own) = (Instant::now(), process_seconds(), cpu_seconds());
            work();
            [start.elapsed().as_secs_f64(), process_seconds() - used, cpu_seconds() - own]
        })
        .collect();
    let [passed, used, own] = [0, 1, 2].map(|i| median(rounds.iter().map(|round| round[i])));
    println!("{name:>34} {passed:>9.4} {used:>9.4} {own:>9.4}");
}
