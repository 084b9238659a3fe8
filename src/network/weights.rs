//! The network's weights: in memory, in safetensors, and together with their configuration as a model folder.
//!
//! A layer `<layer>` is two f32 tensors: `<layer>.weight` [rows, columns], row by row, and `<layer>.bias` [columns].
//! The header's metadata hold `crc32`, over all tensors' bytes in the order of their names.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use super::config::Config;
use super::program::{Layer, all_layers};
use crate::base::files::{crc32, read_bytes, write_bytes};
use crate::base::random::Random;
use crate::base::{Error, Place, Result};

/// Name of the configuration in a model folder.
pub const CONFIG_FILE: &str = "config.json";
/// Name of the weights in a model folder.
pub const WEIGHTS_FILE: &str = "weights.safetensors";
/// Name of the exported encoder in a model folder.
pub const ENCODE_FILE: &str = "encode_step.onnx";
/// Name of the exported decoder in a model folder.
pub const DECODE_FILE: &str = "decode_step.onnx";
/// Largest accepted weights file in bytes; the largest valid one (width 64, 4 convolutions, per level) has about 28 MB.
const WEIGHTS_LIMIT: u64 = 64 << 20;
/// Largest accepted configuration in bytes.
const CONFIG_LIMIT: u64 = 1 << 20;

/// The parameters of one layer.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerWeights {
    /// Input channels (times nine for a convolution).
    pub rows: usize,
    /// Output channels.
    pub columns: usize,
    /// Matrix [rows, columns], row by row.
    pub weight: Vec<f32>,
    /// Bias [columns].
    pub bias: Vec<f32>,
}

/// All parameters of a network, by layer name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Weights {
    /// The layers.
    pub layers: BTreeMap<String, LayerWeights>,
}

impl Weights {
    /// Random weights for `config` as before training (He 2015: variance 2 / inputs), with biases of the size of 0.1.
    pub fn random(config: &Config, seed: u64) -> Self {
        let mut weights = Self::default();
        for (stream, Layer { name, rows, columns }) in (0..).zip(all_layers(config)) {
            let mut random = Random::new(seed, stream, 0);
            // Uniform on [-a, a] has variance a²/3.
            let limit = (6.0 / rows as f32).sqrt();
            let weight = (0..rows * columns).map(|_| random.range(-limit, limit)).collect();
            let bias = (0..columns).map(|_| random.range(-0.1, 0.1)).collect();
            weights.layers.insert(name, LayerWeights { rows, columns, weight, bias });
        }
        weights
    }

    /// The parameters of a layer.
    ///
    /// # Errors
    /// [`Error::Model`] if there is no such layer or its shape is not that of `layer`.
    pub fn layer(&self, layer: &Layer) -> Result<&LayerWeights> {
        let fail = |message| Err(Error::Model { path: WEIGHTS_FILE.into(), message });
        match self.layers.get(&layer.name) {
            None => fail(format!("layer {} is missing", layer.name)),
            Some(w) if w.weight.len() != layer.rows * layer.columns || w.bias.len() != layer.columns => {
                fail(format!("layer {} is not [{}, {}]", layer.name, layer.rows, layer.columns))
            }
            Some(w) => Ok(w),
        }
    }

    /// Reads safetensors; `path` is named in errors.
    ///
    /// # Errors
    /// [`Error::Malformed`] naming the tensor: a broken file, a layer of `config` that is missing or has another shape or
    /// type, a tensor that `config` does not know, a value that is not finite.
    pub fn from_bytes(config: &Config, bytes: &[u8], path: &Path) -> Result<Self> {
        let fail = |part: &str, message: String| Error::malformed(Place::part(path, part), message);
        let file = SafeTensors::deserialize(bytes)
            .map_err(|e| Error::malformed(Place::file(path), format!("not a safetensors file: {e}")))?;
        check_crc(&file, bytes, path)?;
        let expected = all_layers(config);
        let known = |name: &str| {
            let layer = name.strip_suffix(".weight").or_else(|| name.strip_suffix(".bias"));
            expected.iter().any(|l| Some(l.name.as_str()) == layer)
        };
        if let Some(unknown) = file.names().into_iter().find(|name| !known(name)) {
            return Err(fail(unknown, "a tensor that the configuration does not have".into()));
        }
        let read = |name: String, shape: &[usize]| -> Result<Vec<f32>> {
            let tensor = file.tensor(&name).map_err(|_| fail(&name, "the tensor is missing".into()))?;
            if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
                let found = format!("{:?} {:?}", tensor.dtype(), tensor.shape());
                return Err(fail(&name, format!("the tensor is {found}, expected F32 {shape:?}")));
            }
            let (bytes, _) = tensor.data().as_chunks::<4>();
            let values: Vec<f32> = bytes.iter().map(|&b| f32::from_le_bytes(b)).collect();
            match values.iter().position(|x| !x.is_finite()) {
                Some(at) => Err(fail(&name, format!("value {at} is {}, not finite", values[at]))),
                None => Ok(values),
            }
        };
        let mut weights = Self::default();
        for Layer { name, rows, columns } in &expected {
            let (rows, columns) = (*rows, *columns);
            let weight = read(format!("{name}.weight"), &[rows, columns])?;
            let bias = read(format!("{name}.bias"), &[columns])?;
            weights.layers.insert(name.clone(), LayerWeights { rows, columns, weight, bias });
        }
        Ok(weights)
    }

    /// The weights as a safetensors file.
    ///
    /// # Errors
    /// [`Error::Model`] if a layer's vectors do not have its shape.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let little_endian = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let tensors: Vec<_> = (self.layers.iter())
            .flat_map(|(name, l)| {
                let weight = (format!("{name}.weight"), vec![l.rows, l.columns], little_endian(&l.weight));
                [weight, (format!("{name}.bias"), vec![l.columns], little_endian(&l.bias))]
            })
            .collect();
        let fail = |e| Error::Model { path: WEIGHTS_FILE.into(), message: format!("weights cannot be stored: {e}") };
        let views = tensors.iter().map(|(name, shape, data)| {
            TensorView::new(Dtype::F32, shape.clone(), data).map(|view| (name, view)).map_err(fail)
        });
        let views = views.collect::<Result<Vec<_>>>()?;
        let metadata =
            HashMap::from([(CRC.to_owned(), crc(views.iter().map(|(name, view)| (*name, view))).to_string())]);
        safetensors::serialize(views, Some(metadata)).map_err(fail)
    }

    /// CRC-32 of all values in the order of the layers' names: by it an exported file is told from one of other weights.
    pub fn checksum(&self) -> u32 {
        let parts: Vec<&[u8]> = self
            .layers
            .values()
            .flat_map(|l| [&l.weight, &l.bias])
            .map(|values| bytemuck::cast_slice(values))
            .collect();
        crc32(parts)
    }
}

/// Key of the checksum in the header.
const CRC: &str = "crc32";

/// The checksum of all tensors' bytes in the order of their names.
fn crc<'a>(tensors: impl Iterator<Item = (&'a String, &'a TensorView<'a>)>) -> u32 {
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_by_key(|(name, _)| *name);
    crc32(tensors.iter().map(|(_, tensor)| tensor.data()))
}

/// Refuses weights whose checksum is not that of their bytes. Weights without one pass: other programs write none.
fn check_crc(file: &SafeTensors, bytes: &[u8], path: &Path) -> Result<()> {
    let header = SafeTensors::read_metadata(bytes).ok().and_then(|(_, header)| header.metadata().clone());
    let Some(expected) = header.and_then(|mut entries| entries.remove(CRC)) else { return Ok(()) };
    let tensors = file.tensors();
    let found = crc(tensors.iter().map(|(name, tensor)| (name, tensor))).to_string();
    if found == expected {
        return Ok(());
    }
    let message = format!("the content's checksum is {found}, the header says {expected}: the file is damaged");
    Err(Error::malformed(Place::part(path, CRC), message))
}

/// A network that can be run: its configuration and its weights, which fit each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The validated configuration.
    pub config: Config,
    /// The weights.
    pub weights: Weights,
}

impl Model {
    /// Reads a model folder.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Limit`] for the files, [`Error::Malformed`] for broken content, [`Error::Model`] for a model
    /// that this version cannot run.
    pub fn load(folder: &Path) -> Result<Self> {
        let (config, weights) = (folder.join(CONFIG_FILE), folder.join(WEIGHTS_FILE));
        let config_bytes = read_bytes(&config, CONFIG_LIMIT)?;
        let weights_bytes = read_bytes(&weights, WEIGHTS_LIMIT)?;
        Self::parse([&config_bytes, &weights_bytes], [config, weights])
    }

    /// The model whose two files are given, as [`Model::load`] would read them; for a model compiled into the program.
    ///
    /// # Errors
    /// As [`Model::load`].
    pub fn from_bytes(config_json: &[u8], safetensors: &[u8]) -> Result<Self> {
        let label = |name| Path::new("built-in").join(name);
        Self::parse([config_json, safetensors], [label(CONFIG_FILE), label(WEIGHTS_FILE)])
    }

    fn parse([config, weights]: [&[u8]; 2], [config_path, weights_path]: [PathBuf; 2]) -> Result<Self> {
        check_version(config, &config_path)?;
        let config: Config = serde_json::from_slice(config)
            .map_err(|e| Error::malformed(Place::line(&config_path, e.line() as u32), e.to_string()))?;
        config.validate(&config_path)?;
        let weights = Weights::from_bytes(&config, weights, &weights_path)?;
        Ok(Self { config, weights })
    }

    /// Writes the folder's `config.json` and `weights.safetensors`, each atomically; creates the folder.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Model`] if configuration and weights are not valid together, or a weight is not finite.
    pub fn save(&self, folder: &Path) -> Result<()> {
        self.config.validate(folder)?;
        all_layers(&self.config).iter().try_for_each(|layer| self.weights.layer(layer).map(drop))?;
        let mut values = self.weights.layers.values().flat_map(|layer| layer.weight.iter().chain(&layer.bias));
        if values.any(|value| !value.is_finite()) {
            return Err(Error::Model { path: folder.to_owned(), message: "a weight is not finite".into() });
        }
        let weights = self.weights.to_bytes()?;
        let config = serde_json::to_vec_pretty(&self.config)
            .map_err(|e| Error::Model { path: folder.to_owned(), message: e.to_string() })?;
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        write_bytes(&folder.join(WEIGHTS_FILE), &weights)?;
        write_bytes(&folder.join(CONFIG_FILE), &config)
    }
}

/// Reads the version alone first: another version may have fields that this one cannot parse.
fn check_version(config: &[u8], path: &Path) -> Result<()> {
    #[derive(serde::Deserialize)]
    struct Versioned {
        version: u32,
    }
    match serde_json::from_slice::<Versioned>(config) {
        Ok(Versioned { version }) if version != super::config::VERSION => {
            let message = format!("format version {version}, this renderer reads version {}", super::config::VERSION);
            Err(Error::Model { path: path.to_owned(), message })
        }
        _ => Ok(()),
    }
}
