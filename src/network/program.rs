//! The network as one list of operations per step, which the embedded path executes, burn builds and ONNX emits.
//!
//! Zhu 2021 (eq. 12-14) runs an encoder from the deepest level of Q_h to the root and a decoder from the root down. Each is a
//! step that the host calls level by level for a whole batch of trees, so the lists are short and have no loops.
//!
//! `encode_step`, at level m of Q_h with N nodes:
//! inputs `features` [N, F], `pooled` [N, C] (mean of the four children's outputs; zero rows where there are none),
//! `neighbours` [N, 9] (row of each of the 3×3 cells around a node; N where the tree has no node there);
//! output `encoded` [N, C].
//!
//! `decode_step`, at level n ≥ 1 of Q_r with N nodes, siblings adjacent in fours (so N is a multiple of 4):
//! inputs `parents` [P, C] (the features of the level above; the encoder's root for n = 1), `parent_index` [N] (rows of
//! `parents`), `skip` [N, C] (the encoder's output where Q_h has the node, else zero), `geometry` [N, [`GEOMETRY`]],
//! `neighbours` [N, 9], `base` [N, 1] (logarithm of the smoothed share, which the network corrects);
//! outputs `decoded` [N, C], `share_logit` [N, 1], `share` [N, 1] (softmax over the four siblings), `leaf_logit` [N, 1],
//! `leaf` [N, 1].
//!
//! A node of the tree has `leaf`·¼ + (1 − `leaf`)·`share` of its parent's mass, `leaf` being the parent's, 0 for a root (eq. 15).

use super::config::Config;
use crate::guiding::tree::features::LOG_SHARES;
use crate::guiding::tree::topology::MAX_LEVEL;

/// Channels of the decoder's `geometry` input: presence flag in Q_h; level / 20; one-hot position among the four siblings;
/// the direction of the cell's centre (x, y, z); the log-densities of the nearest ancestor (or the node itself), see
/// [`NodeInputs`](crate::guiding::tree::features::NodeInputs).
pub const GEOMETRY: usize = 9 + LOG_SHARES;

/// Index of a value in a [`Program`].
pub type Value = usize;

/// One operation; rows are nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Op {
    /// The input of this name.
    Input(&'static str),
    /// Columns side by side.
    Concat(Vec<Value>),
    /// Rows of `x` by index (up-sampling: each child takes its parent's row).
    Select {
        /// [P, C].
        x: Value,
        /// Name of the index input, [N].
        index: &'static str,
    },
    /// `x · W + b`; W is [in, out], b is [out].
    Linear {
        /// [N, in].
        x: Value,
        /// Name of the layer: tensors `<layer>.weight` and `<layer>.bias`.
        layer: String,
    },
    /// Convolution over the 3×3 neighbourhood (Zhu 2021 eq. 12): the nine neighbours' rows side by side, in the order of the
    /// `neighbours` input, times W [9·in, out], plus b. A missing neighbour is a zero row.
    GatherLinear {
        /// [N, in].
        x: Value,
        /// Name of the layer.
        layer: String,
    },
    /// Elementwise sum.
    Add(Value, Value),
    /// max(x, 0).
    Relu(Value),
    /// Softmax over each group of four consecutive rows of a single column.
    SoftmaxSiblings(Value),
    /// Logistic function.
    Sigmoid(Value),
}

/// The size of a layer's weights: `weight` is [rows, columns] row by row, `bias` is [columns].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// Name without the suffix.
    pub name: String,
    /// Input channels (times nine for a convolution).
    pub rows: usize,
    /// Output channels.
    pub columns: usize,
}

/// A list of operations; operation i produces value i and uses only values before it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Program {
    /// The operations in order.
    pub ops: Vec<Op>,
    /// Columns of each value.
    pub columns: Vec<usize>,
    /// Names of the values that the step returns.
    pub outputs: Vec<(&'static str, Value)>,
    /// Every layer in order of use.
    pub layers: Vec<Layer>,
}

impl Program {
    fn push(&mut self, op: Op, columns: usize) -> Value {
        self.ops.push(op);
        self.columns.push(columns);
        self.ops.len() - 1
    }

    fn input(&mut self, name: &'static str, columns: usize) -> Value {
        self.push(Op::Input(name), columns)
    }

    fn concat(&mut self, values: &[Value]) -> Value {
        let columns = values.iter().map(|&v| self.columns[v]).sum();
        self.push(Op::Concat(values.to_vec()), columns)
    }

    fn linear(&mut self, x: Value, layer: String, columns: usize) -> Value {
        self.layers.push(Layer { name: layer.clone(), rows: self.columns[x], columns });
        self.push(Op::Linear { x, layer }, columns)
    }

    fn relu(&mut self, x: Value) -> Value {
        self.push(Op::Relu(x), self.columns[x])
    }

    /// A residual stack: relu(conv(relu(conv(… x)))) + x, rectified.
    fn convolutions(&mut self, x: Value, prefix: &str, count: usize) -> Value {
        let columns = self.columns[x];
        let mut y = x;
        for i in 0..count {
            let layer = format!("{prefix}.conv{i}");
            self.layers.push(Layer { name: layer.clone(), rows: 9 * columns, columns });
            y = self.push(Op::GatherLinear { x: y, layer }, columns);
            if i + 1 == count {
                y = self.push(Op::Add(y, x), columns);
            }
            y = self.relu(y);
        }
        y
    }
}

/// Name of the weights' prefix at a level: shared over levels, or one per level.
pub fn prefix(config: &Config, step: &str, level: usize) -> String {
    if config.per_level { format!("{step}.level{level}") } else { step.to_owned() }
}

/// The encoder's operations at `level` of Q_h.
pub fn encode_program(config: &Config, level: usize) -> Program {
    let prefix = prefix(config, "encode", level);
    let mut p = Program::default();
    let features = p.input("features", config.features);
    let pooled = p.input("pooled", config.width);
    let x = p.concat(&[features, pooled]);
    let x = p.linear(x, format!("{prefix}.in"), config.width);
    let x = p.relu(x);
    let x = p.convolutions(x, &prefix, config.convolutions);
    p.outputs = vec![("encoded", x)];
    p
}

/// The decoder's operations at `level` ≥ 1 of Q_r.
pub fn decode_program(config: &Config, level: usize) -> Program {
    let prefix = prefix(config, "decode", level);
    let mut p = Program::default();
    let parents = p.input("parents", config.width);
    let up = p.push(Op::Select { x: parents, index: "parent_index" }, config.width);
    let skip = p.input("skip", config.width);
    let geometry = p.input("geometry", GEOMETRY);
    let x = p.concat(&[up, skip, geometry]);
    let x = p.linear(x, format!("{prefix}.in"), config.width);
    let x = p.relu(x);
    let x = p.convolutions(x, &prefix, config.convolutions);
    let correction = p.linear(x, format!("{prefix}.share"), 1);
    let base = p.input("base", 1);
    let share_logit = p.push(Op::Add(correction, base), 1);
    let share = p.push(Op::SoftmaxSiblings(share_logit), 1);
    let leaf_logit = p.linear(x, format!("{prefix}.leaf"), 1);
    let leaf = p.push(Op::Sigmoid(leaf_logit), 1);
    p.outputs = vec![
        ("decoded", x),
        ("share_logit", share_logit),
        ("share", share),
        ("leaf_logit", leaf_logit),
        ("leaf", leaf),
    ];
    p
}

/// Every layer that a model of this configuration has, each once, in order of first use.
pub fn all_layers(config: &Config) -> Vec<Layer> {
    let levels = if config.per_level { 0..=MAX_LEVEL } else { 1..=1 };
    let encode = levels.clone().map(|level| encode_program(config, level));
    let decode = levels.filter(|&level| level > 0).map(|level| decode_program(config, level));
    encode.chain(decode).flat_map(|program| program.layers).collect()
}
