//! Running one [`Program`] on named inputs.

use std::collections::HashMap;

use super::batch::SLOTS;
use super::fusion::{Source, Step, fail, fuse};
use super::kernels::{Epilogue, Index, Part, apply};
use super::program::{Op, Program, Value};
use super::weights::Weights;
use crate::base::Result;
use crate::math::lanes::slices;

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
    /// [`Error::Model`](crate::base::Error::Model) for a layer that is missing or misshapen,
    /// [`Error::Backend`](crate::base::Error::Backend) for a program that is not of the form that this backend fuses
    /// (selections of selections, inputs wider than [`MAX_CHANNELS`](super::kernels::MAX_CHANNELS)).
    pub fn new(program: &Program, weights: &Weights) -> Result<Self> {
        let input = |(value, op): (Value, &Op)| match op {
            Op::Input(name) => Some((*name, value)),
            _ => None,
        };
        Ok(Self {
            steps: fuse(program, weights)?,
            inputs: program.ops.iter().enumerate().filter_map(input).collect(),
            columns: program.columns.clone(),
            outputs: program.outputs.iter().map(|&(_, value)| value).collect(),
        })
    }

    /// Runs the program; returns its outputs in their order, each [rows, columns].
    ///
    /// # Errors
    /// [`Error::Backend`](crate::base::Error::Backend) for a missing input, a size that does not fit, or an index out of range.
    pub fn run(&self, inputs: &Inputs) -> Result<Vec<Vec<f32>>> {
        self.check(inputs)?;
        let mut computed: HashMap<Value, Vec<f32>> = HashMap::new();
        for step in &self.steps {
            let (to, result) = self.step(step, inputs, &computed)?;
            computed.insert(to, result);
        }
        let take = |value: &Value| match computed.remove(value) {
            Some(result) => Ok(result),
            None => fail("an output that is not computed, or wanted twice"),
        };
        self.outputs.iter().map(take).collect()
    }

    fn step(&self, step: &Step, inputs: &Inputs, computed: &HashMap<Value, Vec<f32>>) -> Result<(Value, Vec<f32>)> {
        let get = |value: Value| self.value(value, inputs, computed);
        Ok(match step {
            Step::Layer { sources, gather, matrix, residual, relu, to } => {
                let epilogue = Epilogue { residual: residual.map(get).transpose()?, relu: *relu };
                let channels = |source: &Source| self.columns[source.value];
                let read = sources.iter().map(|s| Ok((get(s.value)?, channels(s)))).collect::<Result<Vec<_>>>()?;
                (*to, apply(matrix, &parts(sources, &read, *gather, inputs)?, epilogue, inputs.rows))
            }
            Step::Add { values: [a, b], to } => (*to, get(*a)?.iter().zip(get(*b)?).map(|(a, b)| a + b).collect()),
            Step::Relu { value, to } => (*to, get(*value)?.iter().map(|x| x.max(0.0)).collect()),
            Step::SoftmaxSiblings { value, to } => (*to, softmax_siblings(get(*value)?)),
            Step::Sigmoid { value, to } => (*to, sigmoid(get(*value)?)),
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

    /// Checks sizes and indices, so that nothing is read out of place later.
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

/// Inputs of a layer: the rows of each source, `read` with their columns, under its index; nine times for a convolution.
fn parts<'a>(
    sources: &[Source],
    read: &[(&'a [f32], usize)],
    gather: bool,
    inputs: &'a Inputs,
) -> Result<Vec<Part<'a>>> {
    let mut parts = Vec::with_capacity(SLOTS);
    for (source, &(x, channels)) in sources.iter().zip(read) {
        let part = |index| Part { x, channels, index };
        if gather {
            let index = inputs.index("neighbours")?;
            parts.extend((0..SLOTS).map(|offset| part(Index::Gather { index, stride: SLOTS, offset })));
        } else if let Some(name) = source.index {
            parts.push(part(Index::Gather { index: inputs.index(name)?, stride: 1, offset: 0 }));
        } else {
            parts.push(part(Index::Same));
        }
    }
    Ok(parts)
}

fn selects(step: &Step, v: Value) -> bool {
    matches!(step, Step::Layer { sources, .. } if sources.iter().any(|s| s.value == v && s.index.is_some()))
}

/// Softmax over each four consecutive values; subtracting the largest keeps every exponential in (0, 1].
fn softmax_siblings(logits: &[f32]) -> Vec<f32> {
    let mut shares = logits.to_vec();
    for group in shares.chunks_mut(4) {
        let max = group.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        group.iter_mut().for_each(|x| *x -= max);
    }
    slices::exp(&mut shares);
    for group in shares.chunks_mut(4) {
        let inverse = 1.0 / group.iter().sum::<f32>();
        group.iter_mut().for_each(|x| *x *= inverse);
    }
    shares
}

/// 1 / (1 + e⁻ˣ) of each; e⁻ˣ may be infinite, which gives 0.
fn sigmoid(logits: &[f32]) -> Vec<f32> {
    let mut values: Vec<f32> = logits.iter().map(|x| -x).collect();
    slices::exp(&mut values);
    values.iter_mut().for_each(|x| *x = 1.0 / (1.0 + *x));
    values
}
