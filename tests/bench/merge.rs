//! Time and memory of putting a picture together: `cargo bench --bench merge -- [COLUMNSxROWS] [PARTS] [FOLDER] [variance] [layers]`, by
//! default 3840x2160 and 64 parts of a block each in a folder for temporary files, where they take 7 GB (21 GB with variances). With `layers`
//! the first part has as many channels as `--aov all` gives. The parts are made once and removed at the end; each merge is a process of its
//! own, so that its memory is known. `RAYON_NUM_THREADS` sets the threads.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use fanal::base::process::{cpu_seconds, peak_rss};
use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::film::{Block, Pass};
use fanal::picture::{Channel, Display, Picture, write_picture};
use fanal::render::PartOf;
use fanal::render::merge::merge;
use fanal::render::part_file::{self, PartHead, Totals};
use glam::Vec3;

/// Merges that are timed; the first also reads what is not in memory yet.
const RUNS: usize = 3;
/// Channels of features and mattes that `--aov all` gives.
const LAYERS: usize = 60;
/// Names the output and what follows it as parts: this process merges them.
const WORKER: &str = "--merge";

fn parts(folder: &Path, count: u32) -> Vec<PathBuf> {
    (1..=count).map(|index| folder.join(format!("{index}.part"))).collect()
}

fn make(folder: &Path, [width, height]: [u32; 2], count: u32, detailed: bool, layers: usize) {
    let mut pass = Pass::new(width as usize, height as usize);
    let mut random = Random::new(1, 0, 0);
    for sample in 0..4 {
        (0..(width * height) as usize).for_each(|pixel| pass.add(pixel, sample, Vec3::splat(random.next_f32())));
    }
    let block = [Block::of(&pass, detailed)];
    drop(pass);
    // Features are smooth here and there, and everywhere else noise.
    let values: Vec<f32> = (0..width * height).map(|i| if i % 512 < 256 { 0.5 } else { random.next_f32() }).collect();
    let names: Vec<String> = (0..layers).map(|number| format!("layer.{number}")).collect();
    let channels: Vec<Channel> =
        names.iter().map(|name| Channel { name: name.clone(), values: values.clone() }).collect();
    for (index, path) in (1..).zip(parts(folder, count)) {
        let head = PartHead {
            part: PartOf::new(index, count).expect("it is one of them"),
            merged: 0,
            in_common: "a picture".into(),
            size: [width, height],
            window: [0, 0, width, height],
            samples: 64 * count,
            spp: 64 * count,
            detailed,
            film_layers: [detailed; 2],
            fireflies: None,
            channels: names.clone(),
            attributes: Vec::new(),
            layer_attributes: Vec::new(),
            totals: Totals::default(),
        };
        let own = if index == 1 { &channels[..] } else { &[] };
        part_file::write(&path, &head, &block, None, own).expect("there is room");
    }
}

/// Merges and writes the picture; prints seconds and bytes.
fn work(output: &str, parts: &[PathBuf]) {
    let begun = Instant::now();
    let merged = merge(parts, false, &Silent).expect("they belong together");
    let added = begun.elapsed().as_secs_f64();
    let picture = Picture {
        image: &merged.image,
        channels: &merged.layers,
        window: merged.placed,
        attributes: &merged.attributes,
    };
    write_picture(Path::new(output), &picture, Display::default()).expect("there is room");
    let (all, peak) = (begun.elapsed().as_secs_f64(), peak_rss().unwrap_or(0) >> 20);
    let cpu = cpu_seconds().unwrap_or(f64::NAN);
    println!("added up in {added:.2} s, written after {all:.2} s, {cpu:.2} processor seconds, at most {peak} MiB");
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    if let [flag, output, parts @ ..] = &words[..]
        && flag == WORKER
    {
        work(output, &parts.iter().map(PathBuf::from).collect::<Vec<_>>());
        return ExitCode::SUCCESS;
    }
    let size = words.first().and_then(|word| word.split_once('x'));
    let size = size.and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?])).unwrap_or([3840, 2160]);
    let count = words.get(1).and_then(|word| word.parse().ok()).unwrap_or(64);
    let folder = words.get(2).map_or_else(std::env::temp_dir, PathBuf::from);
    let given = |name: &str| words.iter().any(|word| word == name);
    let folder = tempfile::tempdir_in(folder).expect("the folder takes files");
    make(folder.path(), size, count, given("variance"), if given("layers") { LAYERS } else { 0 });
    println!("{}x{} pixels, {count} parts, {} threads", size[0], size[1], rayon::current_num_threads());
    for _ in 0..RUNS {
        let program = std::env::current_exe().expect("this program has a name");
        let output = folder.path().join("out.exr");
        let status = Command::new(program).arg(WORKER).arg(output).args(parts(folder.path(), count)).status();
        if !status.expect("it can be started").success() {
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
