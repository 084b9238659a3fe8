//! Distribution that a voxel keeps of earlier iterations.
//!
//! Samples of the last iteration are usually the only ones that a guide is made from: those before are fewer, and were drawn by a
//! poorer guide. They still are half of all there have been. So a voxel keeps the distribution that an iteration left it with, and in
//! the next one it counts as a part of the samples that it was made from; what is older fades geometrically. Distributions are mixed
//! and not sums, because a single bright sample of an early iteration would outweigh everything since. Directions stay those that
//! were seen from the centre at the time, also where the sphere that they refer to changes or the voxel is divided.

use super::context::{Counted, joined_with};
use super::distribution::Distribution;
use super::topology::Topology;

/// Mass below which nodes are not split further.
const LEAST_MASS: f64 = 0.002;
/// Largest accepted number of samples, more than any render has.
const MOST_SAMPLES: f64 = 1e15;

/// A distribution and the number of samples behind it, small: there is one for every voxel.
#[derive(Debug, Clone, PartialEq)]
pub struct Past {
    split: Vec<bool>,
    mass: Vec<f32>,
    samples: f64,
}

impl Past {
    /// Stores a distribution that stands for `samples` samples.
    pub fn new(distribution: &Distribution, samples: f64) -> Self {
        let mass = distribution.leaf_mass().into_iter().map(|m| m as f32).collect();
        Self { split: distribution.topology().split_flags(), mass, samples }
    }

    /// Builds a past from its [`Past::split`], [`Past::mass`] and [`Past::samples`]; none if they do not fit each other.
    pub fn from_parts(split: &[bool], mass: &[f32], samples: f64) -> Option<Self> {
        let leaves = Topology::from_split(split).ok()?.leaves().count();
        let valid = leaves == mass.len() && mass.iter().all(|m| m.is_finite() && *m >= 0.0);
        (valid && (0.0..=MOST_SAMPLES).contains(&samples)).then(|| Self {
            split: split.to_vec(),
            mass: mass.to_vec(),
            samples,
        })
    }

    /// Split flag of each node, as for [`Topology::from_split`].
    pub fn split(&self) -> &[bool] {
        &self.split
    }

    /// Mass per leaf.
    pub fn mass(&self) -> &[f32] {
        &self.mass
    }

    /// Number of samples behind it.
    pub fn samples(&self) -> f64 {
        self.samples
    }

    /// Past of a part of a divided voxel in which this share of the samples lay.
    pub fn of_part(&self, share: f64) -> Self {
        Self { samples: share * self.samples, ..self.clone() }
    }

    fn distribution(&self) -> Distribution {
        let topology = Topology::from_split(&self.split).unwrap_or_else(|_| Topology::root());
        let weights: Vec<f64> = self.mass.iter().map(|&m| f64::from(m)).collect();
        Distribution::from_leaf_weights(topology, &weights)
    }
}

/// Mixture of a voxel's counted distribution and its past, whose samples count as `part` of their number.
pub fn joined(own: Counted, past: Option<&Past>, part: f64) -> Counted {
    let Some(past) = past.filter(|past| part * past.samples > 0.0) else { return own };
    joined_with(own, &past.distribution(), part * past.samples, LEAST_MASS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::tree::distribution::quarters;

    #[test]
    fn what_is_older_fades() {
        let own = |k: usize| {
            let mut weights = [0.0; 4];
            weights[k] = 1.0;
            Some((quarters(weights), [100.0, 200.0, 400.0][k]))
        };
        let mut past = None;
        for k in 0..3 {
            let (distribution, samples) = joined(own(k), past.as_ref(), 0.5).unwrap();
            past = Some(Past::new(&distribution, samples));
        }
        let past = past.unwrap();
        // 400 samples of the last iteration, 200 / 2 and 100 / 4 of those before.
        assert_eq!(past.samples(), 525.0);
        for (mass, samples) in past.mass().iter().zip([25.0, 100.0, 400.0, 0.0]) {
            assert!((mass - samples / 525.0).abs() < 1e-6);
        }
        assert_eq!(past.of_part(0.5).samples(), 262.5);
        let (alone, samples) = joined(None, Some(&past), 0.5).unwrap();
        assert_eq!((alone.topology().len(), samples), (5, 262.5));
        assert_eq!(joined(own(0), Some(&past), 0.0), own(0));
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let past = Past::new(&quarters([1.0, 2.0, 3.0, 4.0]), 10.0);
        assert_eq!(Past::from_parts(past.split(), past.mass(), 10.0).as_ref(), Some(&past));
        assert_eq!(Past::from_parts(past.split(), &past.mass()[1..], 10.0), None);
        assert_eq!(Past::from_parts(&[true, false], past.mass(), 10.0), None);
        for samples in [f64::NAN, -1.0, 1e300] {
            assert_eq!(Past::from_parts(past.split(), past.mass(), samples), None);
        }
        assert_eq!(Past::from_parts(past.split(), &[0.1, f32::NAN, 0.2, 0.3], 10.0), None);
    }
}
