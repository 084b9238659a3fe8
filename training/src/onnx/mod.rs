//! Export to ONNX: each step of the network as one model file, written by a small protobuf writer of our own.

mod example;
mod graph;
mod protobuf;

use std::path::Path;

use fanal::base::Result;
use fanal::base::files::write_bytes;
use fanal::guiding::tree::topology::MAX_LEVEL;
use fanal::network::config::Config;
use fanal::network::program::{decode_program, encode_program};
use fanal::network::seal::sealed;
use fanal::network::weights::{DECODE_FILE, ENCODE_FILE, Model};

pub use example::example;
pub use graph::write_model;

/// Name of the file with one call of each step, with inputs and outputs.
pub const EXAMPLE_FILE: &str = "example.safetensors";

/// Writes `encode_step.onnx`, `decode_step.onnx` and `example.safetensors` into `folder`, which must exist, each atomically.
///
/// # Errors
/// [`Error::Io`](fanal::base::Error::Io); [`Error::Model`](fanal::base::Error::Model) for weights that do not fit the configuration.
pub fn export(model: &Model, folder: &Path) -> Result<()> {
    let (config, metadata) = (&model.config, metadata(model));
    // One graph for all levels, which has names without a level.
    let shared = Config { per_level: false, ..config.clone() };
    let levels = if config.per_level { 0..=MAX_LEVEL } else { 1..=1 };
    let encode: Vec<_> = levels.clone().map(|level| encode_program(config, level).layers).collect();
    // The decoder has no level 0: the entry only keeps the others in their places.
    let decode: Vec<_> = levels.map(|level| decode_program(config, level.max(1)).layers).collect();
    let encode = write_model(&encode_program(&shared, 1), &encode, &model.weights, &metadata, "encode_step")?;
    let decode = write_model(&decode_program(&shared, 1), &decode, &model.weights, &metadata, "decode_step")?;
    write_bytes(&folder.join(ENCODE_FILE), &sealed(encode))?;
    write_bytes(&folder.join(DECODE_FILE), &sealed(decode))?;
    write_bytes(&folder.join(EXAMPLE_FILE), &example(model)?)
}

/// Metadata that a reader needs beside the graph.
fn metadata(Model { config, weights }: &Model) -> Vec<(String, String)> {
    let entries = [
        ("version", config.version.to_string()),
        ("name", config.name.clone()),
        ("width", config.width.to_string()),
        ("convolutions", config.convolutions.to_string()),
        ("features", config.features.to_string()),
        ("per_level", config.per_level.to_string()),
        ("weights", format!("{:08x}", weights.checksum())),
        ("target", config.mode.target.clone()),
        ("nee", config.mode.light_sampling.to_string()),
        ("roulette", config.mode.roulette.to_string()),
        ("split_share", config.mode.split_share.to_string()),
    ];
    entries.map(|(key, value)| (key.to_owned(), value)).to_vec()
}
