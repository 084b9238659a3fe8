//! What a sum of samples is reduced to for the picture.

use glam::Vec3;
use rayon::prelude::*;

use super::{FinishedPass, Half, Spread, filled};
use crate::picture::Image;

/// A sum that gets no more samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Summed {
    pub(super) all: Half,
    /// The samples with even numbers, and the variance of one sample of each pixel.
    pub(super) detail: Option<(Half, Vec<Vec3>)>,
}

impl Summed {
    /// No samples of so many pixels.
    pub fn empty(pixels: usize, detailed: bool) -> Self {
        let none = || Half { means: vec![Vec3::ZERO; pixels], counts: vec![0; pixels], tiles: Vec::new() };
        Self { all: none(), detail: detailed.then(|| (none(), vec![Vec3::NAN; pixels])) }
    }

    /// Puts the pixels of `other` to the places that `place` names by their numbers.
    pub fn place(&mut self, other: &Self, mut place: impl FnMut(usize) -> usize) {
        for i in 0..other.all.counts.len() {
            let at = place(i);
            self.all.put(at, &other.all, i);
            if let (Some((even, variance)), Some((other, of))) = (&mut self.detail, &other.detail) {
                even.put(at, other, i);
                variance[at] = of[i];
            }
        }
    }

    /// Samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.all.samples()
    }

    /// Samples of each pixel.
    pub fn counts(&self) -> &[u32] {
        &self.all.counts
    }

    /// The picture of so many columns, on a sheet of several `views`. A pixel without samples has the value of the nearest one above or
    /// below that has some, see [`combine`](super::combine).
    pub fn image(&self, width: usize, views: usize) -> Image {
        let Half { means, counts, .. } = &self.all;
        let pixels = means.len();
        if counts.iter().all(|&count| count > 0) {
            return Image { width, height: pixels.checked_div(width).unwrap_or(0), pixels: means.clone() };
        }
        let sampled: Vec<Option<Vec3>> =
            means.iter().zip(counts).map(|(&mean, &count)| (count > 0).then_some(mean)).collect();
        let views = sampled.chunks((pixels / views.max(1)).max(1)).flat_map(|view| filled(view, width));
        Image { width, height: pixels.checked_div(width).unwrap_or(0), pixels: views.collect() }
    }

    /// The samples as those of a pass of so many columns, without tiles; none where no variances are wanted.
    pub(in crate::film) fn into_pass(self, width: usize) -> Option<FinishedPass> {
        let (even, variance) = self.detail?;
        let odd = even.rest_of(&self.all);
        Some(FinishedPass { width, halves: [even, odd], spread: Spread::default(), variance, cascades: None })
    }
}

impl Half {
    fn put(&mut self, at: usize, other: &Self, i: usize) {
        (self.means[at], self.counts[at]) = (other.means[i], other.counts[i]);
    }

    /// The samples of `all` without those of this half.
    fn rest_of(&self, all: &Self) -> Self {
        let rest = |i: usize| {
            let [all_count, own] = [all.counts[i], self.counts[i]].map(f64::from);
            let sum = all.means[i].as_dvec3() * all_count - self.means[i].as_dvec3() * own;
            if all_count > own { (sum / (all_count - own)).as_vec3() } else { Vec3::ZERO }
        };
        let counts = all.counts.iter().zip(&self.counts).map(|(all, own)| all - own).collect();
        Self { means: (0..all.means.len()).into_par_iter().map(rest).collect(), counts, tiles: Vec::new() }
    }
}
