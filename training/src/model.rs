//! The network in burn: the renderer's own list of operations, on tensors.
//!
//! Rows are nodes. No kernel is ever given an empty tensor, which burn's ndarray backend does not survive.

use std::collections::BTreeMap;

use burn::tensor::activation::{relu, sigmoid, softmax};
use burn::tensor::{Device, Int, Tensor, TensorData};
use fanal::guiding::tree::topology::MAX_LEVEL;
use fanal::network::config::Config;
use fanal::network::program::{Op, Program, all_layers, decode_program, encode_program};
use fanal::network::weights::{LayerWeights, Weights};

/// The parameters of one layer.
#[derive(Debug, Clone)]
pub struct Parameter {
    /// [rows, columns].
    pub weight: Tensor<2>,
    /// [columns].
    pub bias: Tensor<1>,
}

/// A network whose parameters are leaves of burn's autodiff graph, if its device is one with autodiff.
#[derive(Debug, Clone)]
pub struct Net {
    device: Device,
    parameters: BTreeMap<String, Parameter>,
    encode: Vec<Program>,
    decode: Vec<Program>,
}

/// Outputs of a decoding step.
#[derive(Debug, Clone)]
pub struct Decoded {
    /// [N, C].
    pub features: Tensor<2>,
    /// [N, 1] logit of the share among four siblings.
    pub share_logit: Tensor<2>,
    /// [N, 1] share of the parent.
    pub share: Tensor<2>,
    /// [N, 1] logit of being a leaf.
    pub leaf_logit: Tensor<2>,
    /// [N, 1] probability of being a leaf.
    pub leaf: Tensor<2>,
}

/// A named input of a step: rows of floats, or indices.
enum Input {
    Rows(Tensor<2>),
    Index(Tensor<1, Int>),
}

impl Net {
    /// The network with the given weights, which must have every layer of `config`.
    pub fn new(config: &Config, weights: &Weights, device: &Device) -> Result<Self, fanal::base::Error> {
        let mut parameters = BTreeMap::new();
        for layer in all_layers(config) {
            let w = weights.layer(&layer)?;
            let weight = rows(w.weight.clone(), layer.columns, device);
            let bias = Tensor::from_data(TensorData::new(w.bias.clone(), [layer.columns]), device);
            parameters.insert(layer.name, Parameter { weight, bias }.tracked(device));
        }
        let encode = (0..=MAX_LEVEL).map(|level| encode_program(config, level)).collect();
        let decode = (0..=MAX_LEVEL).map(|level| decode_program(config, level)).collect();
        Ok(Self { device: device.clone(), parameters, encode, decode })
    }

    /// The device of the parameters.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The same weights as leaves of a graph of its own, so that two threads can go backward at once.
    pub fn replica(&self) -> Self {
        let own = |p: &Parameter| Parameter { weight: p.weight.clone().inner(), bias: p.bias.clone().inner() };
        let parameters = self.parameters.iter().map(|(name, p)| (name.clone(), own(p).tracked(&self.device))).collect();
        Self { parameters, ..self.clone() }
    }

    /// Every layer's parameters, by name.
    pub fn parameters(&self) -> &BTreeMap<String, Parameter> {
        &self.parameters
    }

    /// Replaces a layer's parameters after an optimiser's step.
    pub fn set(&mut self, layer: &str, parameter: Parameter) {
        self.parameters.insert(layer.to_owned(), parameter.tracked(&self.device));
    }

    /// The weights as the renderer stores them.
    pub fn weights(&self) -> Weights {
        let layers = self.parameters.iter().map(|(name, p)| {
            let [rows, columns] = p.weight.dims();
            let weights =
                LayerWeights { rows, columns, weight: to_vec(p.weight.clone()), bias: to_vec(p.bias.clone()) };
            (name.clone(), weights)
        });
        Weights { layers: layers.collect() }
    }

    /// The encoder's step at `level`: features [N, F], pooled [N, C], neighbours [9N] → [N, C].
    pub fn encode(
        &self,
        level: usize,
        features: Tensor<2>,
        pooled: Tensor<2>,
        neighbours: Tensor<1, Int>,
    ) -> Tensor<2> {
        let inputs = [
            ("features", Input::Rows(features)),
            ("pooled", Input::Rows(pooled)),
            (NEIGHBOURS, Input::Index(neighbours)),
        ];
        let [encoded] = self.run(&self.encode[level], inputs.into(), ["encoded"]);
        encoded
    }

    /// The decoder's step at `level` ≥ 1: parents [P, C], parent index [N], skip [N, C], geometry [N, G], base [N, 1],
    /// neighbours [9N].
    pub fn decode(
        &self,
        level: usize,
        parents: Tensor<2>,
        parent_index: Tensor<1, Int>,
        skip: Tensor<2>,
        [geometry, base]: [Tensor<2>; 2],
        neighbours: Tensor<1, Int>,
    ) -> Decoded {
        let inputs = [
            ("parents", Input::Rows(parents)),
            ("parent_index", Input::Index(parent_index)),
            ("skip", Input::Rows(skip)),
            ("geometry", Input::Rows(geometry)),
            ("base", Input::Rows(base)),
            (NEIGHBOURS, Input::Index(neighbours)),
        ];
        let outputs = ["decoded", "share_logit", "share", "leaf_logit", "leaf"];
        let [features, share_logit, share, leaf_logit, leaf] = self.run(&self.decode[level], inputs.into(), outputs);
        Decoded { features, share_logit, share, leaf_logit, leaf }
    }

    /// Runs a program. Its inputs and outputs are those that the renderer's `program` module documents; a name that is missing here
    /// means that only one of the two was changed, which the agreement test catches.
    fn run<const O: usize>(
        &self,
        program: &Program,
        inputs: BTreeMap<&str, Input>,
        outputs: [&str; O],
    ) -> [Tensor<2>; O] {
        let input = |name: &str| match inputs.get(name) {
            Some(Input::Rows(rows)) => rows.clone(),
            _ => panic!("the program reads an input {name} that this step does not have"),
        };
        let index = |name: &str| match inputs.get(name) {
            Some(Input::Index(index)) => index.clone(),
            _ => panic!("the program reads indices {name} that this step does not have"),
        };
        let mut values: Vec<Tensor<2>> = Vec::with_capacity(program.ops.len());
        for op in &program.ops {
            let at = |v: usize| values[v].clone();
            let value = match op {
                Op::Input(name) => input(name),
                Op::Concat(parts) => Tensor::cat(parts.iter().map(|&p| at(p)).collect(), 1),
                Op::Select { x, index: name } => at(*x).select(0, index(name)),
                Op::Linear { x, layer } => self.linear(at(*x), layer),
                Op::GatherLinear { x, layer } => self.linear(gather(at(*x), index(NEIGHBOURS)), layer),
                Op::Add(a, b) => at(*a) + at(*b),
                Op::Relu(x) => relu(at(*x)),
                Op::SoftmaxSiblings(x) => siblings(at(*x), |four| softmax(four, 1)),
                Op::Sigmoid(x) => sigmoid(at(*x)),
            };
            values.push(value);
        }
        outputs.map(|name| {
            let found = program.outputs.iter().find(|(output, _)| *output == name);
            let (_, value) = found.unwrap_or_else(|| panic!("the program has no output {name}"));
            values[*value].clone()
        })
    }

    fn linear(&self, x: Tensor<2>, layer: &str) -> Tensor<2> {
        // Built from the same configuration as the programs, so every layer exists.
        let p = &self.parameters[layer];
        x.matmul(p.weight.clone()) + p.bias.clone().unsqueeze::<2>()
    }
}

const NEIGHBOURS: &str = "neighbours";

impl Parameter {
    fn tracked(self, device: &Device) -> Self {
        if !device.is_autodiff() {
            return self;
        }
        Self { weight: self.weight.autodiff().require_grad(), bias: self.bias.autodiff().require_grad() }
    }
}

/// Weights to start training from: [`Weights::random`], but the last convolution of each residual stack at a fifth, so that
/// activations do not grow over twenty levels, and the two heads at a tenth, so that the first trees are nearly the smoothed ones.
pub fn initial_weights(config: &Config, seed: u64) -> Weights {
    let mut weights = Weights::random(config, seed);
    let last = format!(".conv{}", config.convolutions.saturating_sub(1));
    for (name, layer) in &mut weights.layers {
        let scale = match name {
            n if n.ends_with(&last) => 0.2,
            n if n.ends_with(".share") || n.ends_with(".leaf") => 0.1,
            _ => 1.0,
        };
        layer.weight.iter_mut().for_each(|w| *w *= scale);
    }
    weights
}

/// The nine neighbours' rows side by side, [N, 9C]; index N is a row of zeros.
fn gather(x: Tensor<2>, neighbours: Tensor<1, Int>) -> Tensor<2> {
    let [n, c] = x.dims();
    with_zero_row(x).select(0, neighbours).reshape([n, 9 * c])
}

/// `x` [N, C] with a row of zeros at index N.
pub fn with_zero_row(x: Tensor<2>) -> Tensor<2> {
    let [_, c] = x.dims();
    let zero = Tensor::zeros([1, c], &x.device());
    Tensor::cat(vec![x, zero], 0)
}

/// Applies `f` to a column [N, 1] seen as groups of four siblings, [N/4, 4].
pub fn siblings(column: Tensor<2>, f: impl Fn(Tensor<2>) -> Tensor<2>) -> Tensor<2> {
    let [n, _] = column.dims();
    f(column.reshape([n / 4, 4])).reshape([n, 1])
}

/// A tensor [len / columns, columns].
pub fn rows(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let n = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [n, columns]), device)
}

/// An index tensor.
pub fn index(values: &[u32], device: &Device) -> Tensor<1, Int> {
    let values: Vec<i32> = values.iter().map(|&v| v as i32).collect();
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

/// The values of a tensor, row by row; NaN where a device could not be read, so that the optimiser takes no step.
pub fn to_vec<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    let size = tensor.dims().iter().product();
    tensor.try_into_vec_as::<f32>().unwrap_or_else(|_| vec![f32::NAN; size])
}
