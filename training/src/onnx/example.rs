//! A stored example: one call of each step with inputs and outputs, against which any other runtime can be checked.

use std::collections::BTreeMap;

use fanal::base::{Error, Result};
use fanal::guiding::tree::features::FEATURES;
use fanal::guiding::tree::topology::Topology;
use fanal::network::backend::{Backend, DecodeInputs, EncodeInputs};
use fanal::network::batch::{Batch, SLOTS};
use fanal::network::embedded::Embedded;
use fanal::network::growing::DecodeLevel;
use fanal::network::program::GEOMETRY;
use fanal::network::weights::Model;
use safetensors::Dtype;
use safetensors::tensor::TensorView;

/// Tensors by name: type, shape, little-endian bytes.
type Tensors = BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>;

/// The example as a safetensors file: `encode.<input or output>` and `decode.<…>`, indices as int64.
///
/// # Errors
/// [`Error::Backend`] or [`Error::Model`] if the model cannot be run.
pub fn example(model: &Model) -> Result<Vec<u8>> {
    // Twenty rows with parents, and neighbours that are there, missing, and across the seam.
    let flags: Vec<bool> = [true; 5].into_iter().chain([true, false, false, true]).chain([false; 20]).collect();
    let tree = Topology::from_split(&flags).map_err(Error::Options)?;
    let batch = Batch::new(&[&tree]);
    let backend = Embedded::new(model)?;
    let mut tensors = Tensors::new();
    encode(model, &backend, &batch, &mut tensors)?;
    decode(model, &backend, &batch, &mut tensors)?;
    let fail = |e| Error::Model { path: "example".into(), message: format!("the example cannot be stored: {e}") };
    let view = |(name, (kind, shape, data))| match TensorView::new(kind, shape, data) {
        Ok(view) => Ok((name, view)),
        Err(e) => Err(fail(e)),
    };
    let views = tensors.iter().map(|(name, (kind, shape, data))| view((name, (*kind, shape.clone(), data))));
    safetensors::serialize(views.collect::<Result<Vec<_>>>()?, None).map_err(fail)
}

/// Smooth values in [-1, 1].
fn wave(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i as f32 * 0.7).sin()).collect()
}

fn encode(model: &Model, backend: &Embedded, batch: &Batch, tensors: &mut Tensors) -> Result<()> {
    let (n, width, level) = (batch.len(2), model.config.width, 2);
    let (features, pooled, neighbours) = (wave(n * FEATURES), wave(n * width), &batch.levels[level].rows.neighbours);
    let inputs = EncodeInputs { rows: n, features: &features, pooled: &pooled, neighbours };
    let encoded = backend.encode(level, &inputs)?;
    floats(tensors, "encode.features", &[n, FEATURES], &features);
    floats(tensors, "encode.pooled", &[n, width], &pooled);
    integers(tensors, "encode.neighbours", &[n, SLOTS], neighbours);
    picked_level(model, "encode.level", level, tensors);
    floats(tensors, "encode.encoded", &[n, width], &encoded);
    Ok(())
}

fn decode(model: &Model, backend: &Embedded, batch: &Batch, tensors: &mut Tensors) -> Result<()> {
    let width = model.config.width;
    let mut above = DecodeLevel::roots(batch).grow(batch, &[true]);
    let level = above.grow(batch, &[true, false, true, true]);
    let (n, p) = (level.rows.len(), above.rows.len());
    let (parents, skip) = (wave(p * width), wave(n * width));
    let shares = vec![[0.25, -0.5, 0.0, 1.0, 0.5]; batch.tree_start[1]];
    let (geometry, base) = (level.geometry(&shares), wave(n));
    let inputs = DecodeInputs {
        rows: n,
        parents: &parents,
        parent_index: &level.rows.parent,
        skip: &skip,
        geometry: &geometry,
        base: &base,
        neighbours: &level.rows.neighbours,
    };
    let output = backend.decode(level.level, &inputs)?;
    floats(tensors, "decode.parents", &[p, width], &parents);
    integers(tensors, "decode.parent_index", &[n], &level.rows.parent);
    floats(tensors, "decode.skip", &[n, width], &skip);
    floats(tensors, "decode.geometry", &[n, GEOMETRY], &geometry);
    floats(tensors, "decode.base", &[n, 1], &base);
    integers(tensors, "decode.neighbours", &[n, SLOTS], &level.rows.neighbours);
    picked_level(model, "decode.level", level.level, tensors);
    floats(tensors, "decode.decoded", &[n, width], &output.decoded);
    let columns = [
        ("decode.share_logit", &output.share_logit),
        ("decode.share", &output.share),
        ("decode.leaf_logit", &output.leaf_logit),
        ("decode.leaf", &output.leaf),
    ];
    columns.into_iter().for_each(|(name, values)| floats(tensors, name, &[n, 1], values));
    Ok(())
}

/// Adds the `level` input, which only networks with separate weights for every level have.
fn picked_level(model: &Model, name: &str, level: usize, tensors: &mut Tensors) {
    if model.config.per_level {
        integers(tensors, name, &[], &[level as u32]);
    }
}

fn floats(tensors: &mut Tensors, name: &str, shape: &[usize], values: &[f32]) {
    let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    tensors.insert(name.to_owned(), (Dtype::F32, shape.to_vec(), bytes));
}

fn integers(tensors: &mut Tensors, name: &str, shape: &[usize], values: &[u32]) {
    let bytes = values.iter().flat_map(|&x| i64::from(x).to_le_bytes()).collect();
    tensors.insert(name.to_owned(), (Dtype::I64, shape.to_vec(), bytes));
}
