//! Random damage to every kind of file that the program reads: a typed error that names the file, or success and then use of what
//! was read; never a panic, never memory beyond what a small file is worth, never no end.
//!
//! Every reader works in a process of its own, so that memory is its own and a stack that overflows is noticed too. A run starts
//! with the inputs of `tests/crashes/<reader>`, each of which failed once; then come as many mutants as [`Reader::inputs`] says,
//! always the same ones. For as long as there is time, with other ones:
//!
//!     FANAL_FUZZ_SECONDS=3600 FANAL_FUZZ_SEED=7 cargo test --release --test fuzz
//!
//! gives each reader that many seconds. An input that fails is written to `tests/crashes`. What gives an error that no input before
//! gave is damaged further, so that inputs get deeper into a format.

#[path = "support/containers.rs"]
mod containers;
#[path = "support/documents.rs"]
mod documents;
#[path = "support/files.rs"]
#[allow(dead_code, reason = "shared with tests of readers")]
mod files;
#[path = "support/gltf.rs"]
#[allow(dead_code, reason = "shared with tests of readers")]
mod gltf;
#[path = "support/memory.rs"]
#[allow(dead_code, reason = "shared with tests of faults")]
mod memory;
#[path = "support/mutate.rs"]
mod mutate;
#[path = "support/network.rs"]
#[allow(dead_code, reason = "shared with tests of the network")]
mod network;
#[path = "support/fuzzed.rs"]
mod fuzzed;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;
#[path = "support/seeds.rs"]
mod seeds;
#[path = "support/stop.rs"]
mod stop;

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use fanal::base::files::crc32;
use fanal::base::random::Random;
use fuzzed::Reader;
use memory::peak;

/// What a small file may take, however it is damaged: tables and buffers of picture formats, a small render.
const MOST_MEMORY: usize = 128 << 20;
/// And beyond that per byte of the file: what DEFLATE makes of one, as numbers of four channels.
const MOST_PER_BYTE: usize = 1032 * 16;
/// Inputs take milliseconds; one that takes this long has no end.
const LONGEST: Duration = Duration::from_secs(120);
/// Inputs that gave something new and are kept to be damaged further.
const MOST_KEPT: usize = 512;

const READER: &str = "FANAL_FUZZ_READER";
const FOLDER: &str = "FANAL_FUZZ_FOLDER";
/// Names the file that is being read.
const READING: &str = "reading";

fn crashes(reader: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/crashes").join(reader)
}

/// Writes an input that failed; its name says what is in it.
fn keep(reader: &str, bytes: &[u8]) -> PathBuf {
    let path = crashes(reader).join(format!("{:08x}", crc32([bytes])));
    std::fs::create_dir_all(crashes(reader)).unwrap();
    std::fs::write(&path, bytes).unwrap();
    path
}

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok()?.parse().ok()
}

/// Ends the child where one input takes too long.
fn wait(child: &mut Child, reading: &Path) -> Option<std::process::ExitStatus> {
    let mut alive = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return Some(status);
        }
        let written = std::fs::read_to_string(reading).and_then(|path| std::fs::metadata(path)?.modified());
        // A comparison takes its file away while it makes the run anew: that alone says nothing.
        if written.ok().and_then(|time| time.elapsed().ok()).is_some_and(|age| age < LONGEST) {
            alive = Instant::now();
        }
        if alive.elapsed() > LONGEST {
            child.kill().unwrap();
            child.wait().unwrap();
            return None;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Lets a process of its own read damaged files.
fn fuzz(reader: &str) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("output");
    let file = File::create(&output).unwrap();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "worker", "--ignored", "--nocapture"])
        .env(READER, reader)
        .env(FOLDER, folder.path())
        .env("RAYON_NUM_THREADS", "1")
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .spawn()
        .unwrap();
    let reading = folder.path().join(READING);
    let status = wait(&mut child, &reading);
    let said = String::from_utf8_lossy(&std::fs::read(&output).unwrap()).into_owned();
    println!("{said}");
    let kept = |what: &str| {
        let input = std::fs::read_to_string(&reading).and_then(std::fs::read).unwrap_or_default();
        format!("{reader}: {what}: {}\n{said}", keep(reader, &input).display())
    };
    match status {
        None => panic!("{}", kept("an input without end")),
        Some(status) if status.code().is_none() => panic!("{}", kept("an input that ends the process")),
        Some(status) => assert!(status.success(), "{reader}: {said}"),
    }
}

/// The message with its numbers, names and places left out.
fn shape(message: &str) -> String {
    let mut quoted = false;
    let mut keep = |c: char| {
        quoted ^= matches!(c, '"' | '\'' | '`');
        !quoted && (c.is_ascii_alphabetic() || c == ' ')
    };
    message.chars().filter(|&c| keep(c)).take(80).collect()
}

/// Over the file that is there: systems take their time with one that was emptied before.
fn write(path: &Path, bytes: &[u8]) {
    let mut file = File::options().write(true).create(true).truncate(false).open(path).unwrap();
    file.write_all(bytes).unwrap();
    file.set_len(bytes.len() as u64).unwrap();
}

static PANIC: Mutex<String> = Mutex::new(String::new());

/// A reader at work.
struct Worker {
    reader: Reader,
    folder: PathBuf,
    seen: HashSet<String>,
    failed: BTreeMap<String, String>,
    accepted: usize,
    slowest: Duration,
    most: usize,
}

impl Worker {
    /// Reads one input; what is wrong with how that went, and whether it went as none before.
    fn read(&mut self, bytes: &[u8]) -> (Option<String>, bool) {
        let path = self.folder.join(self.reader.file);
        write(&path, bytes);
        let start = Instant::now();
        let (result, peak) = peak(|| catch_unwind(AssertUnwindSafe(|| (self.reader.read)(&path))));
        self.slowest = self.slowest.max(start.elapsed());
        self.most = self.most.max(peak);
        let (fault, text) = match result {
            Err(_) => (Some(PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone()), "panic".into()),
            Ok(Ok(())) => {
                self.accepted += 1;
                (None, format!("read {}", bytes.len().max(1).ilog2()))
            }
            Ok(Err(error)) => {
                let text = error.to_string();
                let named = [self.folder.to_str().unwrap(), self.reader.file].iter().any(|name| text.contains(name));
                (if named { None } else { Some(format!("the error does not name the file: {text}")) }, text)
            }
        };
        let too_much = peak > MOST_MEMORY + MOST_PER_BYTE * bytes.len();
        let fault = fault.or_else(|| too_much.then(|| format!("{peak} bytes for {} bytes", bytes.len())));
        (fault, self.seen.insert(shape(&text.replace(self.folder.to_str().unwrap(), ""))))
    }

    /// Reads an input and keeps it where it fails as none before.
    fn attempt(&mut self, bytes: &[u8]) -> bool {
        let (fault, new) = self.read(bytes);
        if let Some(fault) = fault {
            let kept = || format!("{}: {fault}", keep(self.reader.name, bytes).display());
            self.failed.entry(shape(&fault)).or_insert_with(kept);
        }
        new
    }

    /// Reads what failed once.
    fn replay(&mut self) -> usize {
        let Ok(entries) = std::fs::read_dir(crashes(self.reader.name)) else { return 0 };
        let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in &paths {
            let bytes = std::fs::read(path).unwrap();
            if let (Some(fault), _) = self.read(&bytes) {
                self.failed.insert(shape(&fault), format!("{}: {fault}", path.display()));
            }
        }
        paths.len()
    }

    /// Reads mutants for some time, or else a fixed number of them.
    fn mutants(&mut self) -> usize {
        let time = number("FANAL_FUZZ_SECONDS").map(Duration::from_secs);
        let mut random = Random::new(number("FANAL_FUZZ_SEED").unwrap_or(1), 0, 0);
        let good = self.reader.seeds.clone();
        let mut kept: Vec<Vec<u8>> = vec![];
        let start = Instant::now();
        let mut count = 0;
        while time.map_or(count < self.reader.inputs, |time| start.elapsed() < time) && self.failed.len() < 20 {
            let any = |random: &mut Random, from: &[Vec<u8>]| from[random.below(from.len() as u32) as usize].clone();
            let other = any(&mut random, &good);
            let from = if kept.is_empty() || random.below(2) == 0 { &good } else { &kept };
            let mut bytes = any(&mut random, from);
            self.mutate(&mut random, &mut bytes, &other);
            count += 1;
            if self.attempt(&bytes) && kept.len() < MOST_KEPT {
                kept.push(bytes);
            }
        }
        count
    }

    /// As it lies on disk, or, three times of four where there is an inside, within its lengths and checksums.
    fn mutate(&self, random: &mut Random, bytes: &mut Vec<u8>, other: &[u8]) {
        let container = self.reader.container;
        let parts = if random.below(4) == 0 { None } else { container.open(bytes) };
        let Some(mut parts) = parts.filter(|parts| !parts.is_empty()) else {
            return mutate::mutate(random, bytes, &self.reader.tokens, other);
        };
        let part = random.below(parts.len() as u32) as usize;
        let inside = container.open(other).unwrap_or_default();
        let other = inside.get(part).map_or(other, Vec::as_slice);
        mutate::mutate(random, &mut parts[part], &self.reader.tokens, other);
        *bytes = container.close(&parts);
    }
}

/// What [`fuzz`] starts.
#[test]
#[ignore = "works for the other tests of this file, in a process of its own"]
fn worker() {
    let (Ok(name), Ok(folder)) = (std::env::var(READER), std::env::var(FOLDER)) else { return };
    let folder = PathBuf::from(folder);
    let reader = fuzzed::reader(&name, &folder);
    std::panic::set_hook(Box::new(|info| {
        println!("{info}");
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = format!("panic: {info}");
    }));
    let (seen, failed) = (HashSet::new(), BTreeMap::new());
    let mut worker = Worker { reader, folder, seen, failed, accepted: 0, slowest: Duration::ZERO, most: 0 };
    let good = worker.reader.seeds.clone();
    std::fs::write(worker.folder.join(READING), worker.folder.join(worker.reader.file).to_str().unwrap()).unwrap();
    for (i, seed) in good.iter().enumerate() {
        let (fault, _) = worker.read(seed);
        let mut refused =
            fault.or((worker.accepted <= i).then(|| format!("good file {i} is refused: {:?}", worker.seen)));
        if let Some(parts) = worker.reader.container.open(seed).filter(|_| refused.is_none()) {
            worker.read(&worker.reader.container.close(&parts));
            refused = (worker.accepted <= i + 1).then(|| format!("good file {i} cannot be packed"));
            worker.accepted = i + 1;
        }
        if let Some(refused) = refused {
            println!("{refused}");
            std::process::exit(1);
        }
    }
    (worker.accepted, worker.seen) = (0, HashSet::new());
    let replayed = worker.replay();
    let count = worker.mutants();
    println!(
        "{name}: {count} mutants of {} files, {replayed} replayed, {} read, {} kinds of outcome, at most {} KiB and {:.3} s",
        good.len(),
        worker.accepted,
        worker.seen.len(),
        worker.most >> 10,
        worker.slowest.as_secs_f64()
    );
    worker.failed.values().for_each(|failure| println!("{failure}"));
    std::process::exit(i32::from(!worker.failed.is_empty()));
}

macro_rules! readers {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            fuzz(stringify!($name));
        })*
    };
}

readers! {
    scene_json scene_xml scene_pbrt scene_gltf scene_glb mesh_obj mesh_ply mesh_serialized mesh_curves volume image_exr image_png image_other shard index recipe
    model_config model_weights checkpoint guide part part_index guide_part comparison_run results
}
