//! Checkpoints, from which a training run goes on: one safetensors file with a checksum, written atomically.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use fanal::base::files::read_bytes;
use fanal::base::tensors::{self, Arrays, Dtype, Tensors, vector};
use fanal::network::config::Config;
use fanal::network::weights::{LayerWeights, Weights};
use serde::{Deserialize, Serialize};

use crate::loss::Loss;
use crate::model::{Net, rows, to_vec};
use crate::optimise::{Moments, Optimiser};
use crate::view::View;

/// Name of the checkpoint in a model folder.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";

const LIMIT: u64 = 256 << 20;

/// The version of checkpoints that this program reads. 2: with a checksum. 3: detects other data of the same size.
/// 4: with the learning rate.
const VERSION: u32 = 4;

/// The pairs of a run: the order in which they are shown is a permutation of their numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    /// Number of pairs.
    pub pairs: usize,
    /// CRC-32 of the indices of the data folders, in their order.
    pub crc32: u32,
}

/// The state of a run in a checkpoint. Order and augmentation are functions of seed and step, so no generator is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// The model's configuration.
    pub config: Config,
    /// The loss that is minimised.
    pub loss: Loss,
    /// The choice of inputs and pairs that the network is shown.
    #[serde(default)]
    pub view: View,
    /// Seed of weights, order and augmentation.
    pub seed: u64,
    /// Checksum of the weights that a run from another model began with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<u32>,
    /// Pairs per step.
    pub batch: usize,
    /// Peak learning rate.
    pub rate: f64,
    /// Parts that a step is divided into; sums of gradients depend on it in their last bits.
    pub parts: usize,
    /// The training data.
    pub data: Data,
    /// Steps done.
    pub step: u64,
    /// Seconds of training so far.
    pub seconds: f64,
    /// Best mean ln(1 + V) on validation trees so far.
    pub best: Option<f64>,
    /// Number of validations since the best one.
    pub unimproved: u32,
}

/// Writes weights, moments and state.
///
/// # Errors
/// When the file cannot be written.
pub fn save(path: &Path, state: &State, net: &Net, optimiser: &Optimiser) -> Result<()> {
    let mut tensors = Vec::new();
    let mut add = |name: String, values: Vec<f32>| {
        tensors.push(vector(name, Dtype::F32, values.into_iter().map(f32::to_le_bytes)));
    };
    for (name, p) in net.parameters() {
        add(format!("{name}.weight"), to_vec(p.weight.clone().inner()));
        add(format!("{name}.bias"), to_vec(p.bias.clone().inner()));
    }
    let mut times = BTreeMap::new();
    for (name, m) in &optimiser.moments {
        times.insert(name.clone(), m.time);
        for (i, (weight, bias)) in m.weight.iter().zip(&m.bias).enumerate() {
            add(format!("{name}.weight.moment{i}"), to_vec(weight.clone()));
            add(format!("{name}.bias.moment{i}"), to_vec(bias.clone()));
        }
    }
    for (name, text) in [("state", serde_json::to_vec(state)?), ("times", serde_json::to_vec(&times)?)] {
        tensors.push(vector(name, Dtype::U8, text.into_iter().map(|byte| [byte])));
    }
    tensors::write(path, VERSION, &tensors)?;
    Ok(())
}

/// Reads a checkpoint that [`save`] wrote.
///
/// # Errors
/// When the file cannot be read, is damaged, of another version, or does not fit its own configuration.
pub fn load(path: &Path, device: &Device) -> Result<(State, Net, Optimiser)> {
    let bytes = read_bytes(path, LIMIT)?;
    let file = Tensors::open(path, &bytes, "training checkpoint", VERSION)?;
    let text = |name: &str| file.read(name, Dtype::U8, None, 1, |[byte]| byte);
    let broken = |what: &str| format!("{} ({what}): not that of a training checkpoint", path.display());
    let state: State = serde_json::from_slice(&text("state")?).with_context(|| broken("state"))?;
    state.config.validate(path)?;
    let times: BTreeMap<String, usize> = serde_json::from_slice(&text("times")?).with_context(|| broken("times"))?;
    let read = |name: String, len: usize| -> Result<Vec<f32>> {
        let values = file.read(&name, Dtype::F32, Some(len), 1, f32::from_le_bytes)?;
        ensure!(values.iter().all(|x| x.is_finite()), "{} ({name}): not finite", path.display());
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
        ensure!(time as u64 <= state.step, "{} (times): {name} has {time} of {} steps", path.display(), state.step);
        let moment = |part: &str, i: usize, len: usize| -> Result<Vec<f32>> {
            let name = format!("{name}.{part}.moment{i}");
            let values = read(name.clone(), len)?;
            // The second moment is a mean of squares, whose root is divided by.
            ensure!(i == 0 || values.iter().all(|&x| x >= 0.0), "{} ({name}): negative", path.display());
            Ok(values)
        };
        let weight = |i| -> Result<Tensor<2>> { Ok(rows(moment("weight", i, r * c)?, c, &plain)) };
        let bias =
            |i| -> Result<Tensor<1>> { Ok(Tensor::from_data(TensorData::new(moment("bias", i, c)?, [c]), &plain)) };
        let moments = Moments { time, weight: [weight(0)?, weight(1)?], bias: [bias(0)?, bias(1)?] };
        optimiser.moments.insert(name.clone(), moments);
    }
    let net = Net::new(&state.config, &weights, device)?;
    Ok((state, net, optimiser))
}
