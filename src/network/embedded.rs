//! The embedded backend: executes a [`Program`] on the CPU with no library beneath.
//!
//! A program is compiled once into fused steps: a layer with its concatenated or gathered inputs, a following residual sum
//! and a following rectifier are one pass over memory ([`super::kernels`]).

use std::collections::HashMap;

use super::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use super::batch::SLOTS;
use super::kernels::{Epilogue, Index, MAX_CHANNELS, Packed, Part, apply};
use super::program::{GEOMETRY, Op, Program, Value, decode_program, encode_program};
use super::weights::{Model, Weights};
use crate::base::{Error, Result};
use crate::guiding::topology::MAX_LEVEL;

/// Name of this backend in messages.
const NAME: &str = "embedded";

fn fail<T>(message: impl Into<String>) -> Result<T> {
    Err(Error::Backend { backend: NAME, message: message.into() })
}

/// Input of a fused layer: a value's rows, possibly selected by an index input.
#[derive(Debug, Clone)]
struct Source {
    value: Value,
    index: Option<&'static str>,
}

#[derive(Debug)]
enum Step {
    Layer { sources: Vec<Source>, gather: bool, layer: Packed, residual: Option<Value>, relu: bool, to: Value },
    Add { values: [Value; 2], to: Value },
    Relu { value: Value, to: Value },
    SoftmaxSiblings { value: Value, to: Value },
    Sigmoid { value: Value, to: Value },
}

/// A program with its weights, ready to run.
#[derive(Debug)]
pub struct Executable {
    steps: Vec<Step>,
    inputs: Vec<(&'static str, Value)>,
    columns: Vec<usize>,
    outputs: Vec<Value>,
}

/// Named inputs of one run. Floats are [rows, columns] row by row.
#[derive(Debug, Default)]
pub struct Inputs<'a> {
    /// Number of output rows, N.
    pub rows: usize,
    /// Float inputs by name.
    pub floats: Vec<(&'static str, &'a [f32])>,
    /// Index inputs by name.
    pub indices: Vec<(&'static str, &'a [u32])>,
}

impl Inputs<'_> {
    fn index(&self, name: &str) -> Result<&[u32]> {
        match self.indices.iter().find(|(n, _)| *n == name) {
            Some((_, index)) => Ok(index),
            None => fail(format!("input {name} is missing")),
        }
    }
}

impl Executable {
    /// Compiles a program.
    ///
    /// # Errors
    /// [`Error::Model`] for a layer that is missing or misshapen, [`Error::Backend`] for a program that is not of the form that
    /// this backend fuses (indices of indices, wider inputs than 128 channels).
    pub fn new(program: &Program, weights: &Weights) -> Result<Self> {
        let mut this = Self { steps: vec![], inputs: vec![], columns: program.columns.clone(), outputs: vec![] };
        let mut layers = program.layers.iter();
        let mut value = 0;
        while value < program.ops.len() {
            value = match &program.ops[value] {
                Op::Input(name) => {
                    this.inputs.push((name, value));
                    value + 1
                }
                // Read by the layer that uses them.
                Op::Concat(_) | Op::Select { .. } => value + 1,
                Op::Linear { x, .. } | Op::GatherLinear { x, .. } => {
                    let Some(layer) = layers.next() else { return fail("a program with fewer layers than operations") };
                    let sources = sources(program, *x)?;
                    let gather = matches!(program.ops[value], Op::GatherLinear { .. });
                    if gather && (sources.len() != 1 || sources[0].index.is_some()) {
                        return fail("a convolution of anything but a computed value");
                    }
                    if sources.iter().any(|s| program.columns[s.value] > MAX_CHANNELS) {
                        return fail(format!("a layer input of more than {MAX_CHANNELS} channels"));
                    }
                    let layer = Packed::new(weights.layer(layer)?);
                    let (residual, relu, to) = epilogue(program, value);
                    this.steps.push(Step::Layer { sources, gather, layer, residual, relu, to });
                    to + 1
                }
                op => {
                    this.steps.push(match *op {
                        Op::Add(a, b) => Step::Add { values: [a, b], to: value },
                        Op::Relu(x) => Step::Relu { value: x, to: value },
                        Op::SoftmaxSiblings(x) => Step::SoftmaxSiblings { value: x, to: value },
                        Op::Sigmoid(x) => Step::Sigmoid { value: x, to: value },
                        _ => return fail("an operation that this backend does not know"),
                    });
                    value + 1
                }
            };
        }
        this.outputs = program.outputs.iter().map(|&(_, value)| value).collect();
        Ok(this)
    }

    /// Runs the program; returns its outputs in their order, each [rows, columns].
    ///
    /// # Errors
    /// [`Error::Backend`] for a missing input, a size that does not fit, or an index out of range.
    pub fn run(&self, inputs: &Inputs) -> Result<Vec<Vec<f32>>> {
        self.check(inputs)?;
        let mut computed: HashMap<Value, Vec<f32>> = HashMap::new();
        for step in &self.steps {
            let (to, result) = self.step(step, inputs, &computed)?;
            computed.insert(to, result);
        }
        let take = |value: &Value| match computed.get(value) {
            Some(result) => Ok(result.clone()),
            None => fail("an output that is not computed"),
        };
        self.outputs.iter().map(take).collect()
    }

    fn step(&self, step: &Step, inputs: &Inputs, computed: &HashMap<Value, Vec<f32>>) -> Result<(Value, Vec<f32>)> {
        let get = |value: Value| self.value(value, inputs, computed);
        Ok(match step {
            Step::Layer { sources, gather, layer, residual, relu, to } => {
                let residual = residual.map(get).transpose()?;
                let mut parts = Vec::with_capacity(SLOTS);
                for source in sources {
                    let (x, channels) = (get(source.value)?, self.columns[source.value]);
                    let part = |index| Part { x, channels, index };
                    if *gather {
                        let index = inputs.index("neighbours")?;
                        parts.extend((0..SLOTS).map(|offset| part(Index::Gather { index, stride: SLOTS, offset })));
                    } else if let Some(name) = source.index {
                        parts.push(part(Index::Gather { index: inputs.index(name)?, stride: 1, offset: 0 }));
                    } else {
                        parts.push(part(Index::Same));
                    }
                }
                (*to, apply(layer, &parts, Epilogue { residual, relu: *relu }, inputs.rows))
            }
            Step::Add { values: [a, b], to } => (*to, get(*a)?.iter().zip(get(*b)?).map(|(a, b)| a + b).collect()),
            Step::Relu { value, to } => (*to, get(*value)?.iter().map(|x| x.max(0.0)).collect()),
            Step::SoftmaxSiblings { value, to } => (*to, softmax_siblings(get(*value)?)),
            Step::Sigmoid { value, to } => (*to, get(*value)?.iter().map(|&x| sigmoid(x)).collect()),
        })
    }

    fn value<'a>(&self, v: Value, inputs: &Inputs<'a>, computed: &'a HashMap<Value, Vec<f32>>) -> Result<&'a [f32]> {
        if let Some(result) = computed.get(&v) {
            return Ok(result);
        }
        let name = self.inputs.iter().find(|(_, value)| *value == v).map(|(name, _)| *name);
        match inputs.floats.iter().find(|(n, _)| Some(*n) == name) {
            Some((_, x)) => Ok(x),
            None => fail(format!("value {v} is not there")),
        }
    }

    /// Sizes and indices, so that nothing is read out of place later.
    fn check(&self, inputs: &Inputs) -> Result<()> {
        let selected = |v| self.steps.iter().any(|step| selects(step, v));
        let mut selectable = usize::MAX;
        for &(name, value) in &self.inputs {
            let Some((_, x)) = inputs.floats.iter().find(|(n, _)| *n == name) else {
                return fail(format!("input {name} is missing"));
            };
            let columns = self.columns[value];
            if selected(value) {
                selectable = x.len() / columns;
            } else if x.len() != inputs.rows * columns {
                return fail(format!("input {name} has {} values for {} rows of {columns}", x.len(), inputs.rows));
            }
        }
        for (name, index) in &inputs.indices {
            let (width, limit) = if *name == "neighbours" { (SLOTS, inputs.rows + 1) } else { (1, selectable) };
            if index.len() != inputs.rows * width {
                return fail(format!("input {name} has {} values for {} rows of {width}", index.len(), inputs.rows));
            }
            if let Some(row) = index.iter().find(|&&row| row as usize >= limit) {
                return fail(format!("input {name} holds row {row}, there are {limit}"));
            }
        }
        Ok(())
    }
}

fn selects(step: &Step, v: Value) -> bool {
    matches!(step, Step::Layer { sources, .. } if sources.iter().any(|s| s.value == v && s.index.is_some()))
}

/// What a layer reads when it reads `value`: concatenations and selections are not materialised.
fn sources(program: &Program, value: Value) -> Result<Vec<Source>> {
    match &program.ops[value] {
        Op::Concat(values) => {
            let parts = values.iter().map(|&v| sources(program, v)).collect::<Result<Vec<_>>>()?;
            Ok(parts.concat())
        }
        Op::Select { x, index } => {
            let mut parts = sources(program, *x)?;
            for part in &mut parts {
                if part.index.replace(index).is_some() {
                    return fail("a selection of a selection");
                }
            }
            Ok(parts)
        }
        _ => Ok(vec![Source { value, index: None }]),
    }
}

/// The residual and the rectifier that directly follow the layer at `value` and alone use it, and the value they end in.
fn epilogue(program: &Program, value: Value) -> (Option<Value>, bool, Value) {
    let only_use = |v: Value| {
        let uses = |op: &Op| match op {
            Op::Concat(values) => values.contains(&v),
            Op::Add(a, b) => *a == v || *b == v,
            Op::Input(_) => false,
            Op::Select { x, .. } | Op::Linear { x, .. } | Op::GatherLinear { x, .. } => *x == v,
            Op::Relu(x) | Op::SoftmaxSiblings(x) | Op::Sigmoid(x) => *x == v,
        };
        program.ops.iter().filter(|op| uses(op)).count() == 1 && program.outputs.iter().all(|&(_, out)| out != v)
    };
    let (mut residual, mut relu, mut to) = (None, false, value);
    if let Some(&Op::Add(a, b)) = program.ops.get(to + 1)
        && a != b
        && (a == to || b == to)
        && only_use(to)
    {
        residual = Some(if a == to { b } else { a });
        to += 1;
    }
    if program.ops.get(to + 1) == Some(&Op::Relu(to)) && only_use(to) {
        relu = true;
        to += 1;
    }
    (residual, relu, to)
}

/// Softmax over each four consecutive values; subtracting the largest keeps every exponential in (0, 1].
fn softmax_siblings(logits: &[f32]) -> Vec<f32> {
    let mut shares = Vec::with_capacity(logits.len());
    for group in logits.chunks(4) {
        let max = group.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let exponentials = group.iter().map(|x| (x - max).exp());
        let inverse = 1.0 / exponentials.clone().sum::<f32>();
        shares.extend(exponentials.map(|e| e * inverse));
    }
    shares
}

/// 1 / (1 + e⁻ˣ); e⁻ˣ may be infinite, which gives 0.
fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// A model ready to run without any library.
#[derive(Debug)]
pub struct Embedded {
    encode: Vec<Executable>,
    decode: Vec<Executable>,
    per_level: bool,
}

impl Embedded {
    /// Prepares `model`.
    ///
    /// # Errors
    /// As [`Executable::new`].
    pub fn new(model: &Model) -> Result<Self> {
        let Model { config, weights } = model;
        let levels = if config.per_level { 0..=MAX_LEVEL } else { 1..=1 };
        let compile = |program: &dyn Fn(usize) -> Program| -> Result<Vec<_>> {
            levels.clone().map(|level| Executable::new(&program(level), weights)).collect()
        };
        Ok(Self {
            encode: compile(&|level| encode_program(config, level))?,
            // The decoder has no level 0: that entry is never used.
            decode: compile(&|level| decode_program(config, level.max(1)))?,
            per_level: config.per_level,
        })
    }

    fn at_level<'a>(&self, steps: &'a [Executable], level: usize) -> Result<&'a Executable> {
        match steps.get(if self.per_level { level } else { 0 }) {
            Some(step) if level <= MAX_LEVEL => Ok(step),
            _ => fail(format!("there is no level {level}")),
        }
    }
}

impl Backend for Embedded {
    fn name(&self) -> &'static str {
        NAME
    }

    fn encode(&self, level: usize, inputs: &EncodeInputs) -> Result<Vec<f32>> {
        let step = self.at_level(&self.encode, level)?;
        let outputs = step.run(&Inputs {
            rows: inputs.rows,
            floats: vec![("features", inputs.features), ("pooled", inputs.pooled)],
            indices: vec![("neighbours", inputs.neighbours)],
        })?;
        match <[_; 1]>::try_from(outputs) {
            Ok([encoded]) => Ok(encoded),
            Err(_) => fail("the encoder does not have one output"),
        }
    }

    fn decode(&self, level: usize, inputs: &DecodeInputs) -> Result<DecodeOutput> {
        let step = self.at_level(&self.decode, level)?;
        if !inputs.rows.is_multiple_of(4) {
            return fail(format!("{} rows to decode, not groups of four siblings", inputs.rows));
        }
        let outputs = step.run(&Inputs {
            rows: inputs.rows,
            floats: vec![("parents", inputs.parents), ("skip", inputs.skip), ("geometry", inputs.geometry)],
            indices: vec![("parent_index", inputs.parent_index), ("neighbours", inputs.neighbours)],
        })?;
        match <[_; 5]>::try_from(outputs) {
            Ok([decoded, share_logit, share, leaf_logit, leaf]) => {
                Ok(DecodeOutput { decoded, share_logit, share, leaf_logit, leaf })
            }
            Err(_) => fail("the decoder does not have five outputs"),
        }
    }
}

const _: () = assert!(GEOMETRY <= MAX_CHANNELS);
