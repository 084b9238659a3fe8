//! The embedded backend: runs the network's programs on the CPU with no library beneath.
//!
//! [`super::fusion`] compiles a program to few steps, [`super::executable`] runs them, [`super::kernels`] is the hot loop.

use super::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use super::executable::{Executable, Inputs};
use super::fusion::{NAME, fail};
use super::program::{Program, decode_program, encode_program};
use super::weights::Model;
use crate::base::Result;
use crate::guiding::tree::topology::MAX_LEVEL;

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
    /// [`Error::Model`](crate::base::Error::Model) for a layer that is missing or misshapen,
    /// [`Error::Backend`](crate::base::Error::Backend) for a program that is not of the form that this backend fuses
    /// (selections of selections, inputs wider than [`MAX_CHANNELS`](super::kernels::MAX_CHANNELS)).
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
            floats: vec![
                ("parents", inputs.parents),
                ("skip", inputs.skip),
                ("geometry", inputs.geometry),
                ("base", inputs.base),
            ],
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
