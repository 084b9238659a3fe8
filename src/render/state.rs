//! What a render has to remember between two chunks, beside what it learns.

use super::budget::Verdict;
use crate::film::{FinishedPass, Pass};

/// Everything that the rest of a render follows from.
#[derive(Default)]
pub(super) struct State {
    pub passes: Vec<FinishedPass>,
    /// Passes that do not enter the picture, but tell about what it will be.
    pub early: Vec<FinishedPass>,
    /// Whether guiding turned out not to pay.
    pub gave_up: bool,
    /// Samples per pixel so far, camera and light paths together.
    pub spent: f64,
    /// Camera samples per pixel so far.
    pub rendered: u32,
    /// Those before the pass that is being made, where its samples follow sequences.
    pub sequences_from: Option<u32>,
    pub trend: Trend,
    pub position: Position,
    /// Of a render to a target error; without the pass of the half that is being traced.
    pub halves: Vec<Half>,
}

/// What the iterations so far say about the next.
#[derive(Default)]
pub(super) struct Trend {
    /// Variance of one sample in each iteration.
    pub variances: Vec<f64>,
    /// Seconds of the last iteration, and the part of them in which camera paths were traced.
    pub seconds: f64,
    pub camera_part: f64,
    /// On the guide that the last iteration made.
    pub verdict: Verdict,
    /// relMSE of a picture with one sample per pixel, by the last iteration; only kept where a target error asks for it.
    pub relative: f64,
}

/// The kinds of passes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Phase {
    /// An iteration of learning.
    #[default]
    Learning,
    /// The first pass with a field that is there already.
    Look,
    /// The final pass.
    Final,
    /// The halves of a render to a target error.
    Target,
}

impl Phase {
    pub const ALL: [Self; 4] = [Self::Learning, Self::Look, Self::Final, Self::Target];
}

/// Where a render is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Position {
    pub phase: Phase,
    /// Learning: the iteration, and the voxels that there were when it began.
    pub iteration: u32,
    pub voxels: usize,
    /// Seconds when it began, and those spent on camera paths until then.
    pub began: f64,
    pub traced: f64,
    /// Final pass: samples per pixel in the batches that have begun.
    pub batches: u32,
    /// Target: samples per pixel of each half at the last look, and the half that is being traced.
    pub each: u32,
    pub half: usize,
}

/// One half of a render to a target error.
pub(super) struct Half {
    pub pass: Pass,
    /// The pass when the other half found it good enough.
    pub done: Option<FinishedPass>,
}

/// A pass that is being made.
pub(super) struct Part {
    pub pass: Pass,
    /// Samples per pixel.
    pub spp: u32,
    /// Number of the next sample, counted as [`PassTracer`](super::PassTracer) does.
    pub start: u64,
}
