//! Kept paths while they are learned (Reibold 2018, §3.2 and §3.4).

use rayon::prelude::*;

use super::guide::{Part, PathGuide};
use super::path::CompletePath;

/// Most paths that are kept: about 30 MB with their kernels and tiles.
pub const MOST: usize = 1 << 15;
/// Part of the samples of a batch that may be kept.
pub const MOST_SHARE: f64 = 2e-3;
/// Weight of what a path brings now, beside what it weighed before (eq. 14).
const FRESH: f64 = 0.5;
/// How far a place in the picture is drawn from that of a kept path: at first and at last, in pixels of a picture of so many columns or
/// rows, the more of both.
const RADIUS: [f32; 2] = [50.0, 10.0];
const OF: f32 = 1024.0;
/// Smallest radius in pixels of any picture.
const LEAST_RADIUS: f32 = 3.0;

/// A path that is kept, or may be.
#[derive(Debug, Clone)]
pub struct Kept {
    /// The path.
    pub path: CompletePath,
    /// f: its part of the picture's light over no density; channel mean.
    pub value: f64,
    /// Density p_u with which the path tracer draws it, by BSDFs or by light sampling, given the pixel.
    pub unguided: f64,
    /// Width of a pixel where the camera sees its first point.
    pub footprint: f32,
}

/// Kept paths with their weights.
#[derive(Debug, Default)]
pub struct PathCache {
    kept: Vec<Kept>,
    /// See eq. 14.
    weights: Vec<f64>,
    batches: u32,
}

impl PathCache {
    /// Number of paths.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Adds the paths of a batch, as far as there is room, and makes the guide of all for a picture of `size` pixels. `last` is that which
    /// the batch was drawn with, of `pixels` pixels. Nothing is changed by a batch of which nothing is kept but the kernels' width in the
    /// picture.
    pub fn learn(&mut self, batch: Vec<Kept>, last: &PathGuide, pixels: f64, size: [u32; 2]) -> PathGuide {
        let before = self.kept.len();
        self.kept.extend(batch.into_iter().take(MOST.saturating_sub(before)));
        self.weigh(before, last, pixels);
        self.batches += 1;
        self.guide(size)
    }

    /// Updates the weights; paths from index `before` on are new.
    fn weigh(&mut self, before: usize, last: &PathGuide, pixels: f64) {
        // What each would bring if the last guide drew it now.
        let brought = |kept: &Kept| kept.value / (kept.unguided + pixels * last.density(&kept.path));
        let now: Vec<f64> = self.kept.par_iter().map(brought).map(|x| if x.is_finite() { x } else { 0.0 }).collect();
        let sum = now.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        self.weights.resize(now.len(), 0.0);
        for (index, (weight, now)) in self.weights.iter_mut().zip(now).enumerate() {
            let fresh = if index < before { FRESH } else { 1.0 };
            *weight = fresh * now / sum + (1.0 - fresh) * *weight;
        }
    }

    /// The guide of what is kept.
    fn guide(&self, size: [u32; 2]) -> PathGuide {
        let parts = self.kept.iter().zip(&self.weights);
        let parts = parts.map(|(kept, &weight)| Part { path: &kept.path, weight, footprint: kept.footprint });
        let parts: Vec<Part> = parts.collect();
        PathGuide::new(&parts, size, radius(self.batches, size))
    }
}

/// The radius after so many batches: it shrinks as the root of their number, as that of progressive photon mapping does at first.
fn radius(batches: u32, size: [u32; 2]) -> f32 {
    let scale = size[0].max(size[1]) as f32 / OF;
    let [first, last] = RADIUS.map(|radius| (radius * scale).max(LEAST_RADIUS));
    (first / (batches.max(1) as f32).sqrt()).max(last)
}
