//! Rules for the fraction of BSDF samples, the rest being drawn from the guide.

use serde::{Deserialize, Serialize};

/// Rule for the fraction of BSDF samples once learning is over; while learning it is one half, but for [`FractionRule::Adam`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FractionRule {
    /// One half (Müller 2017 §3.3).
    Half,
    /// The fraction that is best by measured second moments, see [`Moments`](crate::guiding::moments::Moments).
    Moments,
    /// Stochastic gradient descent (Müller 2019 §10.5), also while learning.
    Adam,
    /// In proportion to the light that samples of either strategy have found (Zhu 2021 §7).
    Found,
}

impl FractionRule {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::Moments => "moments",
            Self::Adam => "adam",
            Self::Found => "found",
        }
    }
}

/// Light that samples of both strategies have sent back on average, on one scale.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Found {
    /// That of samples of the BSDF, and of the guide.
    pub light: [f64; 2],
}

/// Bounds of the fraction: no sample is worth more than ten times what it would be under one strategy alone.
const BOUNDS: [f64; 2] = [0.1, 0.9];

impl Found {
    /// Adds a sample f·L/p of the mixture that had a fraction `alpha` of BSDF samples, the BSDF having `bsdf_share` of its density: a sample is the
    /// BSDF's with that probability, whichever drew it.
    pub fn add(&mut self, estimate: f64, bsdf_share: f64, alpha: f64) {
        let parts = [estimate * bsdf_share / alpha, estimate * (1.0 - bsdf_share) / (1.0 - alpha)];
        if parts.iter().all(|part| *part >= 0.0 && part.is_finite()) {
            self.light.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        }
    }

    /// α = E_bsdf / (E_bsdf + E_guide), in [0.1, 0.9]; none where no light was found.
    pub fn fraction(&self) -> Option<f64> {
        let [bsdf, guide] = self.light;
        let fraction = bsdf / (bsdf + guide);
        fraction.is_finite().then(|| fraction.clamp(BOUNDS[0], BOUNDS[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// An integrand over [0, 1) of 81 in the first tenth and 1 elsewhere; the BSDF is uniform, and the guide draws nine tenths from that tenth. Samples of
    /// the mixture tell what either strategy's samples bring: five standard errors of 40,000 samples are 6 %.
    #[test]
    fn samples_of_the_mixture_tell_what_either_strategy_finds() {
        for alpha in [0.3, 0.5, 0.8] {
            let (mut random, mut found, mut drawn) = (Random::new(4, 0, 0), Found::default(), [[0.0; 2]; 2]);
            for _ in 0..40_000 {
                let is_bsdf = random.next_f64() < alpha;
                let tenth = random.next_f64() < if is_bsdf { 0.1 } else { 0.9 };
                let guide = if tenth { 9.0 } else { 1.0 / 9.0 };
                let mixture = alpha + (1.0 - alpha) * guide;
                let estimate = if tenth { 81.0 } else { 1.0 } / mixture;
                found.add(estimate, alpha / mixture, alpha);
                let [sum, count] = &mut drawn[usize::from(!is_bsdf)];
                (*sum, *count) = (*sum + estimate, *count + 1.0);
            }
            let [bsdf, guide] = drawn.map(|[sum, count]| sum / count);
            let fraction = found.fraction().expect("light was found");
            assert!((fraction / (bsdf / (bsdf + guide)) - 1.0).abs() < 0.06, "{alpha}: {fraction} {bsdf} {guide}");
            // Most of the light is where the guide looks.
            assert!(fraction < 0.4);
        }
    }

    #[test]
    fn fractions_are_bounded_and_need_light() {
        assert_eq!(Found::default().fraction(), None);
        let mut found = Found::default();
        found.add(f64::INFINITY, 0.5, 0.5);
        found.add(f64::NAN, 0.5, 0.5);
        assert_eq!(found.fraction(), None);
        found.add(1.0, 1.0, 0.5);
        assert_eq!(found.fraction(), Some(0.9));
        found.add(1e30, 0.0, 0.5);
        assert_eq!(found.fraction(), Some(0.1));
    }
}
