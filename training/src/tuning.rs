//! Finding the Gaussian baseline's parameters: it has to be as strong as it can be.

use fanal::guiding::distribution::Distribution;
use fanal::guiding::targets::hybrid_distribution;
use fanal::reconstruct::gaussian::Gaussian;
use rayon::prelude::*;

use crate::cases::{Case, common, mean_kl, tune_uniform};

const SIGMAS: [f64; 9] = [0.5, 0.8, 1.2, 1.7, 2.4, 3.4, 4.8, 6.8, 9.6];
const EXPONENTS: [f64; 7] = [0.0, 1.0 / 12.0, 1.0 / 6.0, 0.25, 0.35, 0.45, 0.6];
const FINE_SIGMAS: [f64; 6] = [0.0, 0.5, 0.8, 1.2, 1.8, 2.7];

/// The parameters with the lowest mean KL on `cases`, each at its own best uniform part; one coordinate after the other,
/// twice.
pub fn tune_gaussian(cases: &[Case]) -> Gaussian {
    let hybrid: Vec<Distribution> = cases.par_iter().map(|c| hybrid_distribution(&c.topology, &c.sums)).collect();
    let score = |gaussian: Gaussian| {
        let samples = |c: &Case| u64::from(c.path_samples) + u64::from(c.photon_samples);
        let smooth =
            cases.par_iter().zip(&hybrid).map(|(c, h)| gaussian.reconstruct(h, samples(c))).collect::<Vec<_>>();
        let cells = common(cases, &smooth);
        mean_kl(&cells, tune_uniform(&cells))
    };
    let mut best = Gaussian::default();
    for _ in 0..2 {
        let sigma = |s| Gaussian { sigma: s, ..best };
        best = least(SIGMAS.map(sigma), score);
        let exponent = |e| Gaussian { exponent: e, ..best };
        best = least(EXPONENTS.map(exponent), score);
        let fine = |s| Gaussian { fine_sigma: s, ..best };
        best = least(FINE_SIGMAS.map(fine), score);
    }
    best
}

fn least<const N: usize>(options: [Gaussian; N], score: impl Fn(Gaussian) -> f64) -> Gaussian {
    let scored = options.map(|g| (score(g), g));
    scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(Gaussian::default, |(_, g)| g)
}
