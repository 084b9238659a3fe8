//! Finding the Gaussian baseline's parameters: it has to be as strong as it can be.

use fanal::guiding::distribution::Distribution;
use fanal::guiding::leaves::Leaves;
use fanal::reconstruct::gaussian::Gaussian;
use rayon::prelude::*;

use crate::cases::{Case, common, mean_kl, tune_uniform};

const SIGMAS: [f64; 5] = [0.5, 0.7, 1.0, 1.5, 3.0];
const SAMPLES: [f64; 8] = [0.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0];

/// The parameters with the lowest mean KL on `cases`, each at its own best uniform part; one coordinate after the other,
/// twice.
pub fn tune_gaussian(cases: &[Case]) -> Gaussian {
    let hybrid: Vec<Distribution> = cases.par_iter().map(|c| Leaves::full(&c.topology, &c.sums).hybrid(0.5)).collect();
    let score = |gaussian: Gaussian| {
        let samples = |c: &Case| f64::from(c.path_samples) + f64::from(c.photon_samples);
        let smooth = cases.par_iter().zip(&hybrid).map(|(c, h)| gaussian.smooth(h, samples(c))).collect::<Vec<_>>();
        let cells = common(cases, &smooth);
        mean_kl(&cells, tune_uniform(&cells))
    };
    let mut best = Gaussian::default();
    for _ in 0..2 {
        let sigma = |s| Gaussian { sigma: s, ..best };
        best = least(SIGMAS.map(sigma), score);
        let near = |near| Gaussian { near, ..best };
        best = least(SAMPLES.map(near), score);
        let far = |far| Gaussian { far, ..best };
        best = least(SAMPLES.map(far), score);
        let flat = |flat| Gaussian { flat, ..best };
        best = least(SAMPLES.map(flat), score);
    }
    best
}

fn least<const N: usize>(options: [Gaussian; N], score: impl Fn(Gaussian) -> f64) -> Gaussian {
    let scored = options.map(|g| (score(g), g));
    scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(Gaussian::default, |(_, g)| g)
}
