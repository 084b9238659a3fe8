//! A [`Program`] as an ONNX graph. Field numbers are those of `onnx.proto`, ONNX 1.16.

use std::collections::BTreeMap;

use fanal::base::Result;
use fanal::network::batch::SLOTS;
use fanal::network::program::{Layer, Op, Program, Value};
use fanal::network::weights::{LayerWeights, Weights};

use super::protobuf::Message;

/// The operator set that the graph uses; 17 is enough for all of its operators.
const OPSET: i64 = 17;
/// The file format's version that came with that operator set.
const IR_VERSION: i64 = 8;
const FLOAT: i64 = 1;
const INT64: i64 = 7;
/// Name of the neighbours input, [N, 9].
const NEIGHBOURS: &str = "neighbours";

/// Name of the input that picks a level's weights, a scalar.
const LEVEL: &str = "level";

/// Writes a step with its weights as an ONNX model; returns its bytes. `levels` has for each level the layers that are the
/// program's there: one entry where all levels share their weights, otherwise one for every level from 0 on; then they are stacked,
/// and the int64 scalar input `level` picks.
///
/// Float inputs are [N, columns] (the one that is selected from: [P, columns]), `neighbours` is int64 [N, 9], other index
/// inputs are int64 [N]. Inputs and outputs have the program's names; N and P are symbolic. A row index of N means a
/// missing neighbour, as everywhere: the graph appends a zero row before it gathers.
///
/// # Errors
/// [`fanal::base::Error::Model`] for a layer that is missing or misshapen.
pub fn write_model(
    program: &Program,
    levels: &[Vec<Layer>],
    weights: &Weights,
    metadata: &[(String, String)],
    name: &str,
) -> Result<Vec<u8>> {
    let values = (0..program.ops.len()).map(|v| value_name(program, v)).collect();
    let mut graph = Graph { values, levels: (levels.len() > 1).then_some(levels.len()), ..Graph::default() };
    for (i, layer) in program.layers.iter().enumerate() {
        let levels = levels.iter().map(|layers| weights.layer(&layers[i])).collect::<Result<Vec<_>>>()?;
        let shape = |of: &[usize]| graph.levels.into_iter().chain(of.iter().copied()).collect::<Vec<_>>();
        let (weight_shape, bias_shape) = (shape(&[layer.rows, layer.columns]), shape(&[layer.columns]));
        let stacked = |of: fn(&LayerWeights) -> &[f32]| levels.iter().flat_map(|w| of(w)).copied().collect::<Vec<_>>();
        graph.floats(&format!("{}.weight", layer.name), &weight_shape, &stacked(|w| &w.weight));
        graph.floats(&format!("{}.bias", layer.name), &bias_shape, &stacked(|w| &w.bias));
    }
    for v in 0..program.ops.len() {
        graph.operation(program, v);
    }
    let outputs = program.outputs.iter().map(|&(name, v)| value_info(name, FLOAT, &["N"], Some(program.columns[v])));
    let message = Message::new()
        .messages(1, graph.nodes)
        .string(2, name)
        .messages(5, graph.constants.into_values())
        .messages(11, graph.inputs.into_values())
        .messages(12, outputs);
    let entries = metadata.iter().map(|(key, value)| Message::new().string(1, key).string(2, value));
    Ok(Message::new()
        .int(1, IR_VERSION)
        .string(2, "fanal")
        .string(3, env!("CARGO_PKG_VERSION"))
        .int(5, 1)
        .message(7, message)
        .messages(8, [Message::new().string(1, "").int(2, OPSET)])
        .messages(14, entries)
        .into_bytes())
}

/// Name of a value: that of the input or output it is, or its number.
fn value_name(program: &Program, v: Value) -> String {
    match &program.ops[v] {
        Op::Input(name) => (*name).to_owned(),
        _ => match program.outputs.iter().find(|&&(_, out)| out == v) {
            Some((name, _)) => (*name).to_owned(),
            None => format!("value{v}"),
        },
    }
}

#[derive(Default)]
struct Graph {
    values: Vec<String>,
    /// Number of levels whose weights are stacked, if they are.
    levels: Option<usize>,
    nodes: Vec<Message>,
    constants: BTreeMap<String, Message>,
    inputs: BTreeMap<String, Message>,
}

impl Graph {
    fn floats(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.constant(name, FLOAT, shape, &bytes);
    }

    /// A constant shape for Reshape; returns its name.
    fn shape(&mut self, shape: [i64; 2]) -> String {
        let name = format!("shape_{}_{}", shape[0].unsigned_abs(), shape[1]);
        let bytes: Vec<u8> = shape.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.constant(&name, INT64, &[2], &bytes);
        name
    }

    fn constant(&mut self, name: &str, kind: i64, shape: &[usize], bytes: &[u8]) {
        let dims = shape.iter().fold(Message::new(), |m, &d| m.int(1, d as i64));
        self.constants.insert(name.to_owned(), dims.int(2, kind).string(8, name).bytes(9, bytes));
    }

    /// Adds a node; its name is that of its output, which is returned.
    fn node(&mut self, kind: &str, inputs: &[&str], output: &str, attributes: &[(&str, i64)]) -> String {
        let message = inputs.iter().fold(Message::new(), |m, input| m.string(1, input));
        // 20 is the attribute's type, 2 an integer.
        let attributes = attributes.iter().map(|&(name, i)| Message::new().string(1, name).int(3, i).int(20, 2));
        let message = message.string(2, output).string(3, output).string(4, kind).messages(5, attributes);
        self.nodes.push(message);
        output.to_owned()
    }

    fn operation(&mut self, program: &Program, v: Value) {
        let out = self.values[v].clone();
        let name = |v: Value| self.values[v].clone();
        match &program.ops[v] {
            Op::Input(input) => {
                let selected = |op: &Op| matches!(op, Op::Select { x, .. } if *x == v);
                let rows = if program.ops.iter().any(selected) { "P" } else { "N" };
                let info = value_info(input, FLOAT, &[rows], Some(program.columns[v]));
                self.inputs.insert((*input).to_owned(), info);
            }
            Op::Concat(values) => {
                let inputs: Vec<String> = values.iter().map(|&v| name(v)).collect();
                let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
                self.node("Concat", &inputs, &out, &[("axis", 1)]);
            }
            Op::Select { x, index } => {
                let x = name(*x);
                self.inputs.insert((*index).to_owned(), value_info(index, INT64, &["N"], None));
                self.node("Gather", &[&x, index], &out, &[("axis", 0)]);
            }
            Op::Linear { x, layer } => {
                let x = name(*x);
                self.linear(&x, layer, &out);
            }
            Op::GatherLinear { x, layer } => {
                let x_name = name(*x);
                let gathered = self.gather(&x_name, program.columns[*x], &out);
                self.linear(&gathered, layer, &out);
            }
            Op::Add(a, b) => {
                let (a, b) = (name(*a), name(*b));
                self.node("Add", &[&a, &b], &out, &[]);
            }
            Op::Relu(x) => {
                let x = name(*x);
                self.node("Relu", &[&x], &out, &[]);
            }
            Op::Sigmoid(x) => {
                let x = name(*x);
                self.node("Sigmoid", &[&x], &out, &[]);
            }
            Op::SoftmaxSiblings(x) => {
                let x = name(*x);
                let (fours, ones) = (self.shape([-1, 4]), self.shape([-1, 1]));
                let groups = self.node("Reshape", &[&x, &fours], &format!("{out}_groups"), &[]);
                let shares = self.node("Softmax", &[&groups], &format!("{out}_shares"), &[("axis", 1)]);
                self.node("Reshape", &[&shares, &ones], &out, &[]);
            }
        }
    }

    /// x · W + b.
    fn linear(&mut self, x: &str, layer: &str, out: &str) {
        let (weight, bias) = (self.of_level(&format!("{layer}.weight")), self.of_level(&format!("{layer}.bias")));
        let product = self.node("MatMul", &[x, &weight], &format!("{out}_product"), &[]);
        self.node("Add", &[&product, &bias], out, &[]);
    }

    /// Name of a constant, or of its part for the level where levels have their own.
    fn of_level(&mut self, constant: &str) -> String {
        if self.levels.is_none() {
            return constant.to_owned();
        }
        self.inputs.insert(LEVEL.to_owned(), value_info(LEVEL, INT64, &[], None));
        self.node("Gather", &[constant, LEVEL], &format!("{constant}_here"), &[("axis", 0)])
    }

    /// The nine neighbours' rows side by side: [N, 9 · columns].
    fn gather(&mut self, x: &str, columns: usize, out: &str) -> String {
        self.inputs.insert(NEIGHBOURS.to_owned(), value_info(NEIGHBOURS, INT64, &["N"], Some(SLOTS)));
        let zero = format!("zero_row_{columns}");
        self.floats(&zero, &[1, columns], &vec![0.0; columns]);
        let wide = self.shape([-1, (SLOTS * columns) as i64]);
        let padded = self.node("Concat", &[x, &zero], &format!("{out}_padded"), &[("axis", 0)]);
        let rows = self.node("Gather", &[&padded, NEIGHBOURS], &format!("{out}_neighbours"), &[("axis", 0)]);
        self.node("Reshape", &[&rows, &wide], &format!("{out}_gathered"), &[])
    }
}

/// Name, element type and shape: symbolic dimensions first, then a fixed one, if any.
fn value_info(name: &str, kind: i64, symbols: &[&str], columns: Option<usize>) -> Message {
    let symbols = symbols.iter().map(|symbol| Message::new().string(2, symbol));
    let columns = columns.map(|columns| Message::new().int(1, columns as i64));
    let shape = Message::new().messages(1, symbols.chain(columns));
    let tensor = Message::new().int(1, kind).message(2, shape);
    Message::new().string(1, name).message(2, Message::new().message(1, tensor))
}
