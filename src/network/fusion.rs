//! Compiling a [`Program`] to fewer passes over memory: a layer with its concatenated, selected or gathered inputs, a
//! following residual sum and a following rectifier become one step.

use super::batch::SLOTS;
use super::kernels::{MAX_CHANNELS, Packed};
use super::program::{GEOMETRY, Layer, Op, Program, Value};
use super::weights::Weights;
use crate::base::{Error, Result};

/// Name of the embedded backend.
pub(super) const NAME: &str = "embedded";

pub(super) fn fail<T>(message: impl Into<String>) -> Result<T> {
    Err(Error::Backend { backend: NAME, message: message.into() })
}

/// Input of a fused layer: a value's rows, possibly selected by an index input.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub value: Value,
    pub index: Option<&'static str>,
}

/// One pass over memory. `to` is the value that it computes.
#[derive(Debug)]
pub(super) enum Step {
    Layer { sources: Vec<Source>, gather: bool, matrix: Packed, residual: Option<Value>, relu: bool, to: Value },
    Add { values: [Value; 2], to: Value },
    Relu { value: Value, to: Value },
    SoftmaxSiblings { value: Value, to: Value },
    Sigmoid { value: Value, to: Value },
}

/// The steps of a program, in order.
///
/// # Errors
/// [`Error::Model`](crate::base::Error::Model) for a layer that is missing or misshapen,
/// [`Error::Backend`](crate::base::Error::Backend) for a program that is not of the form that can be fused.
pub(super) fn fuse(program: &Program, weights: &Weights) -> Result<Vec<Step>> {
    let mut steps = vec![];
    let mut layers = program.layers.iter();
    let mut value = 0;
    while let Some(op) = program.ops.get(value) {
        let mut to = value;
        match *op {
            // Read by the layers that use them.
            Op::Input(_) | Op::Concat(_) | Op::Select { .. } => {}
            Op::Linear { .. } | Op::GatherLinear { .. } => {
                let Some(layer) = layers.next() else { return fail("a program with fewer layers than operations") };
                let step;
                (step, to) = fuse_layer(program, weights, layer, value)?;
                steps.push(step);
            }
            Op::Add(a, b) => steps.push(Step::Add { values: [a, b], to }),
            Op::Relu(value) => steps.push(Step::Relu { value, to }),
            Op::SoftmaxSiblings(value) => steps.push(Step::SoftmaxSiblings { value, to }),
            Op::Sigmoid(value) => steps.push(Step::Sigmoid { value, to }),
        }
        value = to + 1;
    }
    Ok(steps)
}

/// The layer at `value` with the operations that can be fused around it, and the value that the step ends in.
fn fuse_layer(program: &Program, weights: &Weights, layer: &Layer, value: Value) -> Result<(Step, Value)> {
    let (x, gather) = match program.ops[value] {
        Op::GatherLinear { x, .. } => (x, true),
        Op::Linear { x, .. } => (x, false),
        _ => return fail("a layer that is none"),
    };
    let sources = sources(program, x)?;
    if gather && (sources.len() != 1 || sources[0].index.is_some()) {
        return fail("a convolution of anything but a computed value");
    }
    let channels: Vec<usize> = sources.iter().map(|s| program.columns[s.value]).collect();
    if channels.iter().any(|&c| c == 0 || c > MAX_CHANNELS) {
        return fail(format!("a layer input of {channels:?} channels, the limit is {MAX_CHANNELS}"));
    }
    if channels.iter().sum::<usize>() * if gather { SLOTS } else { 1 } != layer.rows {
        return fail(format!("layer {} has {} rows for inputs of {channels:?}", layer.name, layer.rows));
    }
    let matrix = Packed::new(weights.layer(layer)?);
    let (residual, relu, to) = epilogue(program, value);
    Ok((Step::Layer { sources, gather, matrix, residual, relu, to }, to))
}

/// Sources that a layer reads for its input `value`: concatenations and selections are not materialised.
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

const _: () = assert!(GEOMETRY <= MAX_CHANNELS);
