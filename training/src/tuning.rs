//! Tuning of the Gaussian baseline's parameters: it has to be as strong as it can be.

use fanal::guiding::tree::distribution::Distribution;
use fanal::reconstruct::gaussian::Gaussian;
use rayon::prelude::*;

use crate::cases::{Case, common, mean_log_moment, tune_uniform};

const SIGMAS: [f64; 5] = [0.5, 0.7, 1.0, 1.5, 3.0];
const SAMPLES: [f64; 8] = [0.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0];

/// The parameters with the lowest mean log moment on `cases`, each at its own best uniform part; one coordinate after the other,
/// twice.
pub fn tune_gaussian(cases: &[Case]) -> Gaussian {
    let score = |gaussian: Gaussian| {
        let smooth: Vec<Distribution> = cases.par_iter().map(|c| gaussian.smooth_tree(&c.input())).collect();
        let cells = common(cases, &smooth);
        mean_log_moment(&cells, tune_uniform(&cells, mean_log_moment))
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
