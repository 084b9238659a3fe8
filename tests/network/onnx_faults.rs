//! Damaged ONNX files, and models that fail inside of onnxruntime: typed errors, and the embedded backend goes on working. Without
//! the library (`ORT_DYLIB_PATH`, which `tests/fetch-onnxruntime.sh` prints) these tests say so and check nothing.
#![cfg(feature = "onnx")]

use crate::support::{network, scenes};

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::{Error, Result};
use fanal::network::seal::sealed;
use fanal::network::weights::{DECODE_FILE, ENCODE_FILE, Model};
use fanal::picture::read_image;
use fanal::reconstruct::Neural;
use fanal::reconstruct::neural::reconstruct_batch;
use fanal::reconstruct::onnx::OnnxBackend;
use fanal::render::render;
use network::Tree;
use scenes::{GUIDES, committed, settings};
use tempfile::TempDir;

/// Bytes of the checksum's entry, all but the last eight of which say what it is.
const ENTRY: usize = 19;

fn library() -> Option<PathBuf> {
    let path = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    if path.is_none() {
        eprintln!("skipped: ORT_DYLIB_PATH is not set; tests/fetch-onnxruntime.sh prints its value");
    }
    path
}

/// The file without its checksum.
fn unsealed(path: &Path) -> Vec<u8> {
    let mut bytes = std::fs::read(path).unwrap();
    if bytes[bytes.len() - ENTRY..].windows(5).any(|part| part == b"crc32") {
        bytes.truncate(bytes.len() - ENTRY);
    }
    bytes
}

/// A folder with the model that the program carries, and its ONNX files.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/default");
    for name in ["config.json", "weights.safetensors"] {
        std::fs::copy(source.join(name), folder.path().join(name)).unwrap();
    }
    for name in [ENCODE_FILE, DECODE_FILE] {
        std::fs::write(folder.path().join(name), sealed(unsealed(&source.join(name)))).unwrap();
    }
    folder
}

/// Loads the files and reconstructs trees with them: an error, or distributions.
fn used(folder: &Path, library: &Path, model: &Model, trees: &[Tree]) -> Result<()> {
    let backend = OnnxBackend::load_with(folder, library)?;
    let inputs: Vec<_> = trees.iter().map(Tree::input).collect();
    for tree in reconstruct_batch(model, &backend, &inputs)? {
        for siblings in tree.node_share[1..].chunks(4) {
            let sum: f32 = siblings.iter().sum();
            assert!(siblings.iter().all(|&s| s >= 0.0) && (sum - 1.0).abs() < 1e-3, "{siblings:?}");
        }
    }
    Ok(())
}

/// Most memory that the process ever had, bytes.
fn most_resident() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|line| line.starts_with("VmHWM"))?;
    line.split_whitespace().nth(1)?.parse::<usize>().ok().map(|kib| kib << 10)
}

/// Cut at a hundred lengths, and one byte in 150 places damaged in three ways, both files: the checksum tells. With a checksum
/// that is right, onnxruntime judges; what it accepts must still give distributions.
#[test]
fn f03_damaged_onnx_files() {
    let Some(library) = library() else { return };
    let folder = folder();
    let model = Model::load(folder.path()).unwrap();
    let trees = [network::filled(network::random_topology(3, 60, 4, 0.6), 3)];
    used(folder.path(), &library, &model, &trees).unwrap();
    let (mut accepted, mut refused, mut failed) = (0, 0, 0);
    for name in [ENCODE_FILE, DECODE_FILE] {
        let path = folder.path().join(name);
        let (good, content) = (std::fs::read(&path).unwrap(), unsealed(&path));
        let mut attempt = |bytes: &[u8], may_pass: bool, what: String| {
            std::fs::write(&path, bytes).unwrap();
            match used(folder.path(), &library, &model, &trees) {
                Ok(()) => {
                    assert!(may_pass, "{what} was accepted");
                    accepted += 1;
                }
                Err(Error::Model { path: named, .. }) => {
                    assert_eq!(named, path, "{what}");
                    refused += 1;
                }
                Err(Error::Malformed { place, .. }) => assert!(place.path == path && !may_pass, "{what}"),
                // It was loaded, and did not run.
                Err(Error::Backend { backend: "onnx", .. }) => failed += 1,
                Err(other) => panic!("{what}: {other:?}"),
            }
        };
        for end in (0..content.len()).step_by(content.len().div_ceil(100)) {
            attempt(&good[..end], false, format!("{name} cut at {end}"));
            attempt(&sealed(good[..end].to_vec()), true, format!("{name} forged, cut at {end}"));
        }
        for at in (0..content.len()).step_by(content.len().div_ceil(150)) {
            for flip in [0xFF, 0x01, 0x80] {
                let mut bytes = good.clone();
                bytes[at] ^= flip;
                attempt(&bytes, false, format!("{name} damaged at {at} by {flip:#x}"));
                bytes.truncate(content.len());
                attempt(&sealed(bytes), true, format!("{name} forged at {at} by {flip:#x}"));
            }
        }
        std::fs::write(&path, good).unwrap();
    }
    used(folder.path(), &library, &model, &trees).unwrap();
    println!("forged: {accepted} accepted, {refused} refused, {failed} failed running; {:?} bytes", most_resident());
    assert!(most_resident().is_none_or(|bytes| bytes < 1 << 30));
}

/// Models whose inputs or outputs have other names than the program gives: onnxruntime loads them and fails when they run. The render
/// ends with what it says, none is made by other means unasked, and the embedded backend still works in the same process.
#[test]
fn f05_models_that_fail_inside_onnxruntime() {
    let Some(library) = library() else { return };
    let scene = committed("cornell", [16, 12]);
    let settings = settings(GUIDES[6], 32, 1);
    let stop = AtomicBool::new(false);
    for (file, name, other) in [
        (ENCODE_FILE, "pooled", "poolex"),
        (ENCODE_FILE, "encoded", "encodex"),
        (DECODE_FILE, "parent_index", "parent_indez"),
        (DECODE_FILE, "leaf_logit", "leaf_logix"),
    ] {
        let folder = folder();
        let path = folder.path().join(file);
        std::fs::write(&path, renamed(&unsealed(&path), name.as_bytes(), other.as_bytes())).unwrap();
        let backend = match OnnxBackend::load_with(folder.path(), &library) {
            Ok(backend) => backend,
            Err(error) => panic!("{name}: it should load: {error}"),
        };
        let model = Model::load(folder.path()).unwrap();
        let neural = Neural { model, backend: Box::new(backend) };
        match render(&scene, &settings, &neural, &Silent, &stop) {
            Err(Error::Backend { backend: "onnx", message }) => assert!(!message.is_empty(), "{name}"),
            other => panic!("{name}: {:?}", other.map(|outcome| outcome.statistics)),
        }
        assert!(render(&scene, &settings, &Neural::embedded(folder.path()).unwrap(), &Silent, &stop).is_ok());
    }
}

/// Runs the program, copied away from the repository, with the library at `library`.
fn far_away(folder: &Path, library: &Path, arguments: &[&str]) -> Output {
    let program = folder.join("fanal");
    if !program.exists() {
        std::fs::copy(env!("CARGO_BIN_EXE_fanal"), &program).unwrap();
    }
    let mut command = Command::new(program);
    command.args(arguments).current_dir(folder).env("ORT_DYLIB_PATH", library).output().unwrap()
}

/// The ONNX files of the program's model are in the program: with the library alone it makes the picture that it makes with those of
/// the repository, and without, it is the library that it asks for.
#[test]
fn f05_the_program_carries_its_onnx_files() {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let [scene, model] = ["scenes/door-ajar", "models/default"].map(|path| root.join(path).display().to_string());
    let base = ["render", &scene, "--backend", "onnx", "--size", "32x24", "--spp", "64", "--quiet", "-o"];
    let missing = far_away(folder.path(), Path::new("/missing.so"), &[&base[..], &["a.exr"]].concat());
    let told = String::from_utf8_lossy(&missing.stderr);
    assert!(missing.status.code() == Some(1) && told.contains("ORT_DYLIB_PATH"), "{told}");
    let Some(library) = library() else { return };
    let library = std::path::absolute(library).unwrap();
    let picture = |file: &str, more: &[&str]| {
        let output = far_away(folder.path(), &library, &[&base[..], &[file], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        read_image(&folder.path().join(file), false).unwrap()
    };
    let (carried, named) = (picture("a.exr", &[]), picture("b.exr", &["--model", &model]));
    assert!(carried.pixels == named.pixels);
    assert!(carried.pixels.iter().any(|pixel| pixel.max_element() > 0.0));
}

/// The file with every occurrence of a name replaced by one of the same length.
fn renamed(bytes: &[u8], name: &[u8], other: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for at in 0..=out.len() - name.len() {
        if out[at..].starts_with(name) {
            out[at..at + name.len()].copy_from_slice(other);
        }
    }
    assert_ne!(out, bytes, "the name does not occur");
    out
}
