//! Proposals: the distribution that reconstruction offers for a voxel, and a plainer one for where that is wrong.
//!
//! A network knows what light usually looks like, and is worth little where a scene has something else. So it never decides alone:
//! samples drawn from the last mixture also tell the second moment under any other mixture of both proposals, and the mixture that
//! measured best is sampled next.

use glam::Vec3;

use super::distribution::Distribution;
use super::sampler::SamplingTree;
use crate::guiding::moments::Moments;

/// A distribution and the part of the uniform one, in (0, 1], that has to be mixed into it.
pub type Guess = (Distribution, f32);

/// Distributions that reconstruction proposes for a voxel.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Distribution that has most of the samples until they tell which is better.
    pub first: Guess,
    /// Plainer distribution; none where there is nothing plainer.
    pub plain: Option<Guess>,
}

impl From<Guess> for Proposal {
    fn from(first: Guess) -> Self {
        Self { first, plain: None }
    }
}

impl Proposal {
    /// Mixture of `share` of the first proposal and the rest of the plain one.
    pub fn mixed(&self, share: f64) -> Guess {
        match &self.plain {
            Some(plain) if share <= 0.0 => plain.clone(),
            Some(plain) if share < 1.0 => {
                let [first, other] = [self.first.1, plain.1].map(f64::from);
                let uniform = share * first + (1.0 - share) * other;
                // Of what is not uniform.
                let blended = if uniform < 1.0 { share * (1.0 - first) / (1.0 - uniform) } else { share };
                (Distribution::blend(&self.first.0, &plain.0, blended), uniform as f32)
            }
            _ => self.first.clone(),
        }
    }
}

/// Shares of the first proposal that are tried.
pub const SHARES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Share of the first proposal before anything was measured: a quarter of the other keeps the worst case at four times its
/// variance.
pub const UNTOLD: f64 = 0.75;
/// Effective number of samples (Kish) from which on a share is chosen by measurement: few, because a guide that misses a light
/// shows in few bright samples.
pub const LEAST_EFFECTIVE: f64 = 2.0;

/// Second moments under each of the [`SHARES`].
pub type ShareMoments = Moments<{ SHARES.len() }>;

/// The last proposals of a voxel, to be judged by samples, and the share of the first in the mixture that was sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// The plain proposal and the first.
    pub trees: [SamplingTree; 2],
    /// Share of the first proposal, in [0, 1].
    pub share: f32,
}

impl Judged {
    /// Packs both proposals, each with at most `most_inner` inner nodes; none where there is only one.
    pub fn new(proposal: &Proposal, share: f64, most_inner: usize) -> Option<Self> {
        let plain = proposal.plain.as_ref()?;
        let trees = [plain, &proposal.first].map(|(of, uniform)| SamplingTree::new(of, *uniform, most_inner));
        Some(Self { trees, share: share as f32 })
    }

    /// Density of each mixture over that of the sampled one, in a direction as seen from the centre.
    pub fn ratios(&self, direction: Vec3) -> [f64; SHARES.len()] {
        let [plain, first] = SamplingTree::pdfs(&self.trees, direction).map(f64::from);
        let at = |share: f64| share * first + (1.0 - share) * plain;
        let sampled = at(f64::from(self.share));
        SHARES.map(|share| at(share) / sampled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::tree::distribution::quarters;
    use crate::math::cylindrical;

    fn proposal() -> Proposal {
        Proposal { first: (quarters([1.0, 0.0, 0.0, 0.0]), 0.1), plain: Some((quarters([0.0, 1.0, 1.0, 2.0]), 0.3)) }
    }

    #[test]
    fn shares_mix_both_and_their_uniform_parts() {
        let proposal = proposal();
        assert_eq!(proposal.mixed(1.0), proposal.first);
        assert_eq!(Some(proposal.mixed(0.0)), proposal.plain);
        let (half, uniform) = proposal.mixed(0.5);
        assert!((uniform - 0.2).abs() < 1e-6);
        // Uniform parts and all, half of each.
        let all = half.leaf_mass().into_iter().map(|mass| 0.8 * mass + 0.2 * 0.25);
        let expected = [0.0, 0.25, 0.25, 0.5].map(|plain| 0.7 * plain + 0.3 * 0.25);
        for ((mass, plain), first) in all.zip(expected).zip([0.9 + 0.1 * 0.25, 0.025, 0.025, 0.025]) {
            assert!((mass - 0.5 * (plain + first)).abs() < 1e-6, "{mass} {plain} {first}");
        }
        let alone = Proposal::from(proposal.first.clone());
        assert_eq!(alone.mixed(0.0), proposal.first, "there is nothing else");
        assert_eq!(Judged::new(&alone, 1.0, 100), None);
    }

    /// Densities in the first quarter are those of the mixtures, uniform parts and all.
    #[test]
    fn a19_ratios_are_those_of_the_mixtures() {
        let judged = Judged::new(&proposal(), 0.25, 100).unwrap();
        let (first, plain) = (0.1 + 0.9 * 4.0, 0.3);
        let sampled = 0.25 * first + 0.75 * plain;
        for (ratio, share) in judged.ratios(cylindrical::to_direction([0.1, 0.1])).into_iter().zip(SHARES) {
            let expected = (share * first + (1.0 - share) * plain) / sampled;
            assert!((ratio / expected - 1.0).abs() < 1e-3, "{share}: {ratio} {expected}");
        }
    }
}
