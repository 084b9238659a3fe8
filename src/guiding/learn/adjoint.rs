//! Mean radiance that vertices send back to the camera, by which adjoint-driven roulette decides (Vorba and Křivánek 2016 §5), see
//! [`AdjointRoulette`](crate::guiding::sample::roulette::AdjointRoulette).

use crate::guiding::moments::Moments;

/// Number of effective samples that the whole scene counts as in a block. Without (0) scenes whose light is hard to find have two
/// to three times the noise in the first seconds; with 0.5 those have a tenth less noise than with 0.1, and rooms that are dark for
/// good reasons a seventh more.
const HITS: f64 = 0.2;

/// Mean radiance that a voxel's vertices send back along their paths: by light sampling, and by going on.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Adjoint([Moments<1>; 2]);

impl Adjoint {
    /// Adds the radiances that one vertex sends back.
    pub fn add(&mut self, sent: [f64; 2]) {
        self.0.iter_mut().zip(sent).for_each(|(sum, sent)| sum.add([sent]));
    }

    /// Adds the sums of another.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, other)| sum.merge(other));
    }

    /// Adds the sums of the block around, scaled down to the weight of at most `samples` samples.
    pub fn add_prior(&mut self, prior: &Self, samples: f64) {
        self.0.iter_mut().zip(&prior.0).for_each(|(sum, prior)| sum.add_prior(prior, samples));
    }

    /// Adds the sums of the whole scene as a prior. Where light is found once in a thousand samples (the sky between the slats of a
    /// blind), a thousand that found none say little: the scene counts as many samples as have found light [`HITS`] times.
    pub fn add_scene(&mut self, scene: &Self) {
        for (sum, scene) in self.0.iter_mut().zip(&scene.0) {
            let samples = HITS * scene.samples() / scene.effective();
            if samples.is_finite() {
                sum.add_prior(scene, samples);
            }
        }
    }

    /// Means over the vertices; none where these are too few.
    pub fn means(&self) -> [Option<f64>; 2] {
        self.0.map(|sum| sum.means().map(|[mean]| mean))
    }

    /// Appends its numbers, for [`Adjoint::pull_from`].
    pub(super) fn push_to(&self, numbers: &mut Vec<f64>) {
        self.0.iter().for_each(|sum| sum.push_to(numbers));
    }

    /// Reads the means whose numbers come next.
    pub(super) fn pull_from(next: &mut impl FnMut() -> f64) -> Self {
        Self([(); 2].map(|()| Moments::pull_from(next)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adjoint(of_one: [f64; 2]) -> Adjoint {
        let mut adjoint = Adjoint::default();
        (0..100).for_each(|_| adjoint.add(of_one));
        adjoint
    }

    #[test]
    fn where_light_is_rare_a_block_without_any_is_not_dark() {
        let found = |every: u32, samples: u32| {
            let mut adjoint = Adjoint::default();
            (0..samples).for_each(|i| adjoint.add([if i % every == 0 { f64::from(every) } else { 0.0 }; 2]));
            adjoint
        };
        let mean_with = |every| {
            let mut dark = Adjoint::default();
            (0..1000).for_each(|_| dark.add([0.0; 2]));
            dark.add_scene(&found(every, 100_000));
            dark.means()[0].expect("a thousand samples")
        };
        // The mean of the scene is 1. It counts as 2000 samples beside the block's 1000, or as less than one.
        assert!((mean_with(10_000) - 2.0 / 3.0).abs() < 1e-3, "{}", mean_with(10_000));
        assert!(mean_with(2) < 1e-3);
        let mut black = adjoint([0.2, 0.1]);
        black.add_scene(&adjoint([0.0; 2]));
        assert_eq!(black, adjoint([0.2, 0.1]), "a scene where nothing was found says nothing");
    }

    #[test]
    fn one_sample_tells_nothing() {
        let mut few = Adjoint::default();
        few.add([1.0; 2]);
        assert_eq!(few.means(), [None; 2]);
    }
}
