//! Everything that a training run needs to go on: one safetensors file, written atomically.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use fanal::base::files::{read_bytes, write_bytes};
use fanal::network::config::Config;
use fanal::network::weights::{LayerWeights, Weights};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use crate::loss::Loss;
use crate::model::{Net, rows, to_vec};
use crate::optimise::{Moments, Optimiser};
use crate::view::View;

/// Name of the checkpoint in a model folder.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";

const LIMIT: u64 = 256 << 20;

/// What a checkpoint says about its run. Order and augmentation are functions of seed and step, so no generator is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// The model's configuration.
    pub config: Config,
    /// What is minimised.
    pub loss: Loss,
    /// What the network is shown.
    #[serde(default)]
    pub view: View,
    /// Seed of weights, order and augmentation.
    pub seed: u64,
    /// Pairs per step.
    pub batch: usize,
    /// Parts that a step is divided into; sums of gradients depend on it in their last bits.
    pub parts: usize,
    /// Pairs in the data.
    pub samples: usize,
    /// Steps done.
    pub step: u64,
    /// Seconds of training so far.
    pub seconds: f64,
    /// Best mean ln(1 + V) on validation trees so far.
    pub best: Option<f64>,
}

/// Writes weights, moments and state.
///
/// # Errors
/// When the file cannot be written.
pub fn save(path: &Path, state: &State, net: &Net, optimiser: &Optimiser) -> Result<()> {
    let mut tensors: BTreeMap<String, Vec<f32>> = BTreeMap::new();
    for (name, p) in net.parameters() {
        tensors.insert(format!("{name}.weight"), to_vec(p.weight.clone().inner()));
        tensors.insert(format!("{name}.bias"), to_vec(p.bias.clone().inner()));
    }
    let mut times = BTreeMap::new();
    for (name, m) in &optimiser.moments {
        times.insert(name.clone(), m.time);
        for (i, (weight, bias)) in m.weight.iter().zip(&m.bias).enumerate() {
            tensors.insert(format!("{name}.weight.moment{i}"), to_vec(weight.clone()));
            tensors.insert(format!("{name}.bias.moment{i}"), to_vec(bias.clone()));
        }
    }
    let bytes: Vec<(String, usize, Vec<u8>)> = tensors
        .into_iter()
        .map(|(name, values)| (name, values.len(), values.iter().flat_map(|x| x.to_le_bytes()).collect()))
        .collect();
    let views = bytes
        .iter()
        .map(|(name, len, data)| Ok((name, TensorView::new(Dtype::F32, vec![*len], data)?)))
        .collect::<Result<Vec<_>>>()?;
    let metadata = HashMap::from([
        ("state".to_owned(), serde_json::to_string(state)?),
        ("times".to_owned(), serde_json::to_string(&times)?),
    ]);
    write_bytes(path, &safetensors::serialize(views, Some(metadata))?)?;
    Ok(())
}

/// Reads what [`save`] wrote.
///
/// # Errors
/// When the file cannot be read, is damaged, or does not fit its own configuration.
pub fn load(path: &Path, device: &Device) -> Result<(State, Net, Optimiser)> {
    let bytes = read_bytes(path, LIMIT)?;
    let broken = || format!("{}: not a training checkpoint", path.display());
    let (_, header) = SafeTensors::read_metadata(&bytes).with_context(broken)?;
    let Some(metadata) = header.metadata() else { bail!(broken()) };
    let text = |key: &str| metadata.get(key).with_context(broken);
    let state: State = serde_json::from_str(text("state")?).with_context(broken)?;
    state.config.validate(path)?;
    let times: BTreeMap<String, usize> = serde_json::from_str(text("times")?).with_context(broken)?;
    let file = SafeTensors::deserialize(&bytes).with_context(broken)?;
    let read = |name: String, len: usize| -> Result<Vec<f32>> {
        let tensor = file.tensor(&name).with_context(|| format!("{}: {name} is missing", path.display()))?;
        let values: Vec<f32> = tensor.data().as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        ensure!(tensor.dtype() == Dtype::F32 && values.len() == len, "{}: {name} has a wrong size", path.display());
        ensure!(values.iter().all(|x| x.is_finite()), "{}: {name} is not finite", path.display());
        Ok(values)
    };
    let mut weights = Weights::default();
    let mut optimiser = Optimiser::default();
    let plain = device.clone().inner();
    for layer in fanal::network::program::all_layers(&state.config) {
        let (name, r, c) = (layer.name, layer.rows, layer.columns);
        let (weight, bias) = (read(format!("{name}.weight"), r * c)?, read(format!("{name}.bias"), c)?);
        weights.layers.insert(name.clone(), LayerWeights { rows: r, columns: c, weight, bias });
        let Some(&time) = times.get(&name) else { continue };
        let weight = |i| -> Result<Tensor<2>> { Ok(rows(read(format!("{name}.weight.moment{i}"), r * c)?, c, &plain)) };
        let bias = |i| -> Result<Tensor<1>> {
            Ok(Tensor::from_data(TensorData::new(read(format!("{name}.bias.moment{i}"), c)?, [c]), &plain))
        };
        let moments = Moments { time, weight: [weight(0)?, weight(1)?], bias: [bias(0)?, bias(1)?] };
        optimiser.moments.insert(name.clone(), moments);
    }
    let net = Net::new(&state.config, &weights, device)?;
    Ok((state, net, optimiser))
}
