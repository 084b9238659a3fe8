//! The exported ONNX files in onnxruntime against the embedded backend. Without the library (`ORT_DYLIB_PATH`, which
//! `tests/fetch-onnxruntime.sh` prints) these tests say so and check nothing.

#[path = "../../tests/support/network.rs"]
mod support;

use std::path::{Path, PathBuf};

use fanal::base::Error;
use fanal::network::backend::{Backend, EncodeInputs};
use fanal::network::config::Config;
use fanal::network::embedded::Embedded;
use fanal::network::weights::{ENCODE_FILE, Model};
use fanal::reconstruct::Reconstructed;
use fanal::reconstruct::neural::reconstruct_batch;
use fanal::reconstruct::onnx::OnnxBackend;
use fanal_training::onnx::{EXAMPLE_FILE, export};
use safetensors::SafeTensors;
use support::{Tree, assert_close, config, forward, model, trees};

fn library() -> Option<PathBuf> {
    let path = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    if path.is_none() {
        eprintln!("skipped: ORT_DYLIB_PATH is not set; tests/fetch-onnxruntime.sh prints its value");
    }
    path
}

fn exported(folder: &Path, width: usize, convolutions: usize) -> Model {
    exported_of(folder, config(width, convolutions, false))
}

fn exported_of(folder: &Path, config: Config) -> Model {
    let model = model(config, 11);
    model.save(folder).unwrap();
    export(&model, folder).unwrap();
    model
}

#[test]
fn onnx_agrees_with_embedded() {
    let Some(library) = library() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (width, convolutions, per_level) in [(16, 2, false), (8, 1, true), (24, 3, false)] {
        let model = exported_of(folder.path(), config(width, convolutions, per_level));
        let onnx = OnnxBackend::load_with(folder.path(), &library).unwrap();
        let embedded = Embedded::new(&model).unwrap();
        let trees = trees();
        assert_close(&forward(&model, &onnx, &trees), &forward(&model, &embedded, &trees), 1e-4);
        for tree in trees.chunks(1).take(4) {
            assert_close(&forward(&model, &onnx, tree), &forward(&model, &embedded, tree), 1e-4);
        }
    }
}

/// Ties at the thresholds may fall either way; the first level has none.
fn assert_alike(found: &[Reconstructed], expected: &[Reconstructed]) {
    let same = found.iter().zip(expected).filter(|(a, b)| a.topology == b.topology).count();
    assert!(same * 10 >= found.len() * 8, "{same} of {}", found.len());
    for (a, b) in found.iter().zip(expected) {
        (1..5).for_each(|node| assert!((a.node_share[node] - b.node_share[node]).abs() < 1e-4));
    }
}

/// Networks on images too (Zhu et al. 2020), whose trees have all cells of a level.
#[test]
fn every_kind_of_model_reconstructs_alike() {
    let Some(library) = library() else { return };
    let folder = tempfile::tempdir().unwrap();
    let trees = trees();
    let inputs: Vec<_> = trees.iter().map(Tree::input).collect();
    for config in [Config { image: Some(4), ..config(16, 1, false) }, config(8, 2, true)] {
        let model = exported_of(folder.path(), config);
        let onnx = OnnxBackend::load_with(folder.path(), &library).unwrap();
        let embedded = Embedded::new(&model).unwrap();
        let [found, expected] =
            [&onnx as &dyn Backend, &embedded].map(|backend| reconstruct_batch(&model, backend, &inputs).unwrap());
        assert_alike(&found, &expected);
    }
}

#[test]
fn reconstruction_runs_from_several_threads() {
    let Some(library) = library() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = exported(folder.path(), 16, 1);
    let onnx = OnnxBackend::load_with(folder.path(), &library).unwrap();
    let trees: Vec<Tree> = (0..15).flat_map(|_| trees()).collect();
    let inputs: Vec<_> = trees.iter().map(Tree::input).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let found = pool.install(|| reconstruct_batch(&model, &onnx, &inputs)).unwrap();
    assert_alike(&found, &reconstruct_batch(&model, &Embedded::new(&model).unwrap(), &inputs).unwrap());
    assert!(onnx.encode(0, &EncodeInputs { rows: 0, features: &[], pooled: &[], neighbours: &[] }).unwrap().is_empty());
}

#[test]
fn damaged_and_stale_exports_are_refused() {
    let Some(library) = library() else { return };
    let folder = tempfile::tempdir().unwrap();
    exported(folder.path(), 8, 1);
    let path = folder.path().join(ENCODE_FILE);
    let bytes = std::fs::read(&path).unwrap();
    for damaged in [&bytes[..bytes.len() / 2], &bytes[..10], b"text", b""] {
        std::fs::write(&path, damaged).unwrap();
        let error = OnnxBackend::load_with(folder.path(), &library).err();
        assert!(matches!(&error, Some(Error::Model { path: p, .. }) if *p == path), "{error:?}");
    }
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(OnnxBackend::load_with(folder.path(), &library), Err(Error::Model { .. })));
    std::fs::write(&path, &bytes).unwrap();
    assert!(OnnxBackend::load_with(folder.path(), &library).is_ok());
    for (other, key) in
        [(model(config(16, 1, false), 11), "its width"), (model(config(8, 1, false), 12), "its weights")]
    {
        other.save(folder.path()).unwrap();
        let error = OnnxBackend::load_with(folder.path(), &library).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(key), "{error}");
    }
}

/// The example has a step's call each, with finite outputs; `tests/check-onnx.py` runs it elsewhere.
#[test]
fn the_example_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    exported(folder.path(), 16, 2);
    let bytes = std::fs::read(folder.path().join(EXAMPLE_FILE)).unwrap();
    let example = SafeTensors::deserialize(&bytes).unwrap();
    let names =
        ["encode.features", "encode.encoded", "decode.parents", "decode.parent_index", "decode.share", "decode.leaf"];
    for name in names {
        let tensor = example.tensor(name).unwrap();
        assert!(tensor.shape()[0] >= 4, "{name}");
    }
}
