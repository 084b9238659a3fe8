//! State of a render between two chunks, apart from what is learned: a checkpoint holds both.

use super::budget::{GUIDED_COST, Tried, Verdict};
use crate::film::{Block, Cascade, FinishedPass, Pass, Sum};

/// State of a render from which the rest of it follows.
#[derive(Default)]
pub(super) struct State {
    pub passes: Vec<FinishedPass>,
    /// Finished passes left out of the picture, such as the first iterations; pixel values are estimated from them too.
    pub early: Vec<FinishedPass>,
    /// Samples per pixel so far, camera and light paths together.
    pub spent: f64,
    /// Camera samples per pixel so far.
    pub rendered: u32,
    /// Camera samples per pixel before the current pass, where its samples follow sequences; none where they are independent.
    pub sequences_from: Option<u32>,
    pub trend: Trend,
    pub position: Position,
    /// How the rest of the final pass is divided among pixels; none while all get as many samples.
    pub division: Option<Division>,
    /// The finished blocks of a final pass that goes by blocks.
    pub blocks: Option<Blocks>,
    /// Their samples by brightness, where fireflies are taken out.
    pub cascade: Option<Cascade>,
    /// The halves of a render to a target error, otherwise empty. The half that is being traced has an empty pass here.
    pub halves: Vec<Half>,
}

/// Finished blocks of samples.
pub(super) enum Blocks {
    /// Added up.
    Summed(Sum),
    /// One by one, for those who add them to the blocks of other parts.
    Kept(Vec<Block>),
}

impl Blocks {
    /// None yet, of so many pixels, `kept` one by one or added up, with what variances are made of where they are `detailed`.
    pub fn new(pixels: usize, kept: bool, detailed: bool) -> Self {
        if kept { Self::Kept(Vec::new()) } else { Self::Summed(Sum::new(pixels, detailed)) }
    }

    /// Takes the next block.
    pub fn push(&mut self, block: Block) {
        match self {
            Self::Summed(sum) => sum.add(&block),
            Self::Kept(blocks) => blocks.push(block),
        }
    }

    /// All of so many pixels added up.
    pub fn sum(&self, pixels: usize, detailed: bool) -> Sum {
        match self {
            Self::Summed(sum) => sum.clone(),
            Self::Kept(blocks) => {
                let mut sum = Sum::new(pixels, detailed);
                blocks.iter().for_each(|block| sum.add(block));
                sum
            }
        }
    }
}

/// An uneven division of samples among pixels.
pub(super) struct Division {
    /// See [`densities`](crate::film::densities).
    pub densities: Vec<f32>,
    /// See [`Run::roulette_values`](super::run::Run::roulette_values); empty where guides judge paths.
    pub values: Vec<f32>,
    /// Samples per pixel of the final pass before.
    pub even: u32,
}

impl Division {
    /// Samples of the mean pixel with which none has more than `most`.
    pub fn mean_within(&self, most: u32) -> u32 {
        let densest = self.densities.iter().copied().fold(1.0, f32::max);
        (f64::from(most) / f64::from(densest)) as u32
    }
}

/// Measurements of the iterations so far, by which the next one is decided on.
pub(super) struct Trend {
    /// Variance of one sample in each iteration.
    pub variances: Vec<f64>,
    /// Seconds of the last iteration, those of them in which guides were made, and the part of them in which camera paths were traced.
    pub seconds: f64,
    pub making: f64,
    pub camera_part: f64,
    /// Verdict on the guide that the last iteration was made with.
    pub verdict: Verdict,
    /// The first gain that was too small to pay and was waited on all the same: later ones have to be clearly better.
    pub doubted: Option<f64>,
    /// Estimated relMSE of a picture with one sample per pixel, by the last iteration; only kept for a target error.
    pub relative: f64,
    /// What comparing samples with and without the guides at hand has told.
    pub tried: Tried,
    /// Cost of a sample with the guide over that without.
    pub guided_cost: f64,
    /// Whether much of the light comes through glass or from mirrors, as far as is known.
    pub caustics: bool,
}

impl Trend {
    /// Whether a comparison has shown that guides pay so clearly that better ones need none.
    pub fn clearly_pays(&self) -> bool {
        self.tried
            .gain()
            .and_then(|gain| Verdict::Gain(gain).price(self.guided_cost))
            .is_some_and(|price| price < CLEAR)
    }

    /// Whether the guide that the last iteration made is worth its cost.
    pub fn pays(&self) -> bool {
        self.verdict.pays(self.guided_cost, self.doubted)
    }
}

/// Price below which there is no doubt that a guide pays.
const CLEAR: f64 = 0.8;

impl Default for Trend {
    fn default() -> Self {
        Self {
            variances: Vec::new(),
            seconds: 0.0,
            making: 0.0,
            camera_part: 0.0,
            verdict: Verdict::default(),
            doubted: None,
            tried: Tried::default(),
            relative: 0.0,
            guided_cost: GUIDED_COST,
            caustics: false,
        }
    }
}

/// The kinds of passes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Phase {
    /// An iteration of learning.
    #[default]
    Learning,
    /// The first pass guided by a given field.
    Look,
    /// The final pass.
    Final,
    /// The halves of a render to a target error.
    Target,
    /// The share of a part in the samples of the last iteration of learning.
    Share,
}

impl Phase {
    pub const ALL: [Self; 5] = [Self::Learning, Self::Look, Self::Final, Self::Target, Self::Share];
}

/// Position of a render: its phase, and how far that has come.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Position {
    pub phase: Phase,
    /// Learning: index of the iteration, and number of voxels when it began.
    pub iteration: u32,
    pub voxels: usize,
    /// Seconds of the render when the iteration or the final pass began, and seconds spent on camera paths until then.
    pub began: f64,
    pub traced: f64,
    /// Final pass: samples per pixel in the batches that have begun.
    pub batches: u32,
    /// Target: samples per pixel of each half at the last look, and index (0 or 1) of the half that is being traced.
    pub each: u32,
    pub half: usize,
}

/// One half of a render to a target error.
pub(super) struct Half {
    pub pass: Pass,
    /// The pass as it was when the other half judged it good enough; none before.
    pub done: Option<FinishedPass>,
}

/// A pass that is being made.
pub(super) struct Part {
    pub pass: Pass,
    /// Samples per pixel.
    pub spp: u32,
    /// Linear index of the next camera sample, as in [`PassTracer`](super::PassTracer).
    pub start: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pixel_has_more_samples_than_are_allowed() {
        let of = |densities: &[f32]| Division { densities: densities.into(), values: Vec::new(), even: 4 };
        assert_eq!(of(&[0.1, 8.0, 0.5]).mean_within(1 << 26), 1 << 23);
        assert_eq!(of(&[0.1, 12.5, 0.5]).mean_within(100), 8);
        assert_eq!(of(&[1.0; 3]).mean_within(100), 100);
    }
}
