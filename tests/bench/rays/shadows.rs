//! Shadow rays of real scenes, before and after the hierarchy has learned where to look for occluders first.

use std::path::{Path, PathBuf};

use fanal::geometry::{Accel, Ray};
use fanal::scene::{Scene, readers};

use super::{cpu_seconds, median, process_seconds};

/// Rounds, of which the median counts.
const ROUNDS: usize = 7;
/// Seeds of the shadow rays that are asked about.
const SEEDS: std::ops::Range<u64> = 1..81;
/// How often each is asked about in a round.
const REPEATS: usize = 8;
/// Shadow rays that are learned from.
const LEARNED: usize = 2500;

/// One line of the table for each scene.
pub fn compare(paths: &[PathBuf]) {
    println!("{:>24} {:>9} {:>7} {:>7} {:>7} {:>6} {:>8}", "scene", "rays", "hidden", "before", "after", "ratio", "ms");
    for path in paths {
        compare_scene(path);
    }
}

fn compare_scene(path: &Path) {
    let loaded = readers::load(path).expect("the scene is sound");
    let film = &loaded.file.film;
    let scene = Scene::build(&loaded, [film.width, film.height]).expect("the scene is sound");
    let depth = loaded.file.render.max_depth;
    let before = Accel::new(&scene.shapes);
    let mut after = Accel::new(&scene.shapes);
    let start = process_seconds();
    let samples = scene.shadow_rays(LEARNED, depth, 0);
    let between = process_seconds();
    after.learn_order(&samples);
    let end = process_seconds();
    let rays: Vec<(Ray, f32)> = SEEDS.flat_map(|seed| scene.shadow_rays(LEARNED, depth, seed)).collect();
    let rounds: Vec<[(f64, usize); 2]> =
        (0..ROUNDS).map(|_| [&before, &after].map(|accel| ask(accel, &rays))).collect();
    assert!(rounds.iter().all(|[(_, before), (_, after)]| before == after), "the order must not change an answer");
    let asked = (rays.len() * REPEATS) as f64;
    let speed = |kind: usize| median(rounds.iter().map(|round| asked * 1e-6 / round[kind].0));
    let ratio = median(rounds.iter().map(|[(before, _), (after, _)]| before / after));
    let name = path.parent().and_then(Path::file_name).unwrap_or(path.as_os_str()).to_string_lossy();
    println!(
        "{name:>24} {:>9} {:>6.0}% {:>7.2} {:>7.2} {ratio:>6.2} {:>4.1}+{:.1}",
        rays.len(),
        100.0 * rounds[0][0].1 as f64 / asked,
        speed(0),
        speed(1),
        1e3 * (between - start),
        1e3 * (end - between),
    );
}

/// Seconds, and how many of all queries find something.
fn ask(accel: &Accel, rays: &[(Ray, f32)]) -> (f64, usize) {
    let start = cpu_seconds();
    let hidden = || rays.iter().filter(|(ray, t_max)| accel.occluded(ray, *t_max)).count();
    let hidden = (0..REPEATS).map(|_| hidden()).sum();
    (cpu_seconds() - start, hidden)
}
