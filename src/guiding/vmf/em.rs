//! Weighted expectation maximisation with priors, so that few samples do not make a lobe a spike or a weight nothing (Ruppert 2020 §5.2,
//! after Vorba 2014).

use glam::{DVec3, Vec3};

use super::MOST;
use super::columns::{Block, parts};
use super::component::{Component, Sums, lobes, mean_cosine_limit};
use crate::math::lanes::LANES;

/// Largest number of steps.
const STEPS: usize = 100;
/// Relative change of the likelihood below which they end.
const CONVERGED: f64 = 0.0025;
/// Samples that each lobe has beforehand, of weight alone.
const WEIGHT_PRIOR: f64 = 0.1;
/// Samples that each lobe has beforehand whose mean cosine is 0.
const COSINE_PRIOR: f64 = 0.1;
/// Density below which a sample is no lobe's, 1/sr.
const LOST: f32 = 1e-7;
/// Part of a sample below which it is not counted for a lobe.
const LEAST_PART: f32 = 1e-6;

/// A sample of light as seen from the pivot.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Unit direction.
    pub direction: Vec3,
    /// Value over the mean value of the samples of its chunk that have light.
    pub weight: f64,
    /// Density that it was drawn with, w.r.t. solid angle.
    pub pdf: f32,
    /// Inverse distance to where its light starts.
    pub nearness: f32,
}

/// Divides a sample among lobes: calls `take` with the number of each and its part γ of the density, and returns the density of all; none
/// where that is next to nothing and the sample is no lobe's.
#[inline]
pub fn divided(blocks: &[Block], direction: Vec3, mut take: impl FnMut(usize, f64)) -> Option<f64> {
    let (parts, total) = parts(blocks, direction);
    if total.is_nan() || total <= LOST {
        return None;
    }
    for k in 0..blocks.len() * LANES {
        let part = parts[k / LANES][k % LANES];
        if part > LEAST_PART * total {
            take(k, f64::from(part / total));
        }
    }
    Some(f64::from(total))
}

/// What lobes make of samples.
struct Expected {
    sums: [Sums; MOST],
    /// Sum of weight times logarithm of density.
    likelihood: f64,
    /// Samples that are no lobe's.
    lost: Sums,
}

fn expect(all: &[Component], samples: &[Sample]) -> Expected {
    let blocks = Block::of(&lobes(all));
    let mut expected = Expected { sums: [Sums::default(); MOST], likelihood: 0.0, lost: Sums::default() };
    for sample in samples {
        let direction = sample.direction.as_dvec3();
        let sums = &mut expected.sums;
        match divided(&blocks, sample.direction, |k, part| sums[k].add(part * sample.weight, direction)) {
            Some(density) => expected.likelihood += sample.weight * density.ln(),
            None => expected.lost.add(sample.weight, direction),
        }
    }
    expected
}

/// Sets the parameters of the lobes in `chosen` to the most probable ones: `current` are their samples beside earlier ones, `count`
/// all samples together. The others keep theirs.
fn maximise(all: &mut [Component], current: &[Sums; MOST], count: f64, chosen: u32) {
    let number = all.len() as f64;
    let is_chosen = |k: usize| chosen >> k & 1 == 1;
    let kept: f64 = all.iter().enumerate().filter(|(k, _)| !is_chosen(*k)).map(|(_, of)| of.weight).sum();
    let sums = |k: usize, of: &Component| of.past.with(current[k]);
    let weight = |sums: Sums| (WEIGHT_PRIOR + sums.count) / (WEIGHT_PRIOR * number + count);
    let total: f64 = all.iter().enumerate().filter(|(k, _)| is_chosen(*k)).map(|(k, of)| weight(sums(k, of))).sum();
    for (k, component) in all.iter_mut().enumerate().filter(|(k, _)| is_chosen(*k)) {
        let own = sums(k, component);
        component.weight = weight(own) * (1.0 - kept).max(0.0) / total;
        let mean = if own.count > 0.0 { own.direction / own.count } else { DVec3::ZERO };
        let length = mean.length();
        if length > 1e-9 {
            component.mean = mean / length;
        }
        let samples = component.weight * count;
        component.mean_cosine = (length * samples / (COSINE_PRIOR + samples)).clamp(0.0, mean_cosine_limit());
    }
}

/// Fits the lobes in `chosen` to samples and those before, which count as `past` samples; samples that are no lobe's make one of their own.
/// Returns each lobe's samples.
pub fn refine(all: &mut Vec<Component>, samples: &[Sample], past: f64, mut chosen: u32) -> [Sums; MOST] {
    let count = past + samples.len() as f64;
    let mut last = None;
    for _ in 0..STEPS {
        let Expected { mut sums, likelihood, lost } = expect(all, samples);
        if lost.count > 0.0 && all.len() < MOST {
            sums[all.len()] = lost;
            chosen |= 1 << all.len();
            all.push(Component::new(0.0, lost.direction.normalize_or(DVec3::Z), 0.0));
        }
        maximise(all, &sums, count, chosen);
        let converged = last.is_some_and(|last: f64| (likelihood - last).abs() <= CONVERGED * last.abs());
        if converged {
            return sums;
        }
        last = Some(likelihood);
    }
    expect(all, samples).sums
}
