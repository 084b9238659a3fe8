//! Evaluation of how far each method's distributions are from the converged ones, on trees of held-out scenes.

use std::time::Instant;

use anyhow::{Result, bail};
use fanal::generate::dataset::Dataset;
use fanal::guiding::tree::distribution::{Distribution, kl_of_cells, relative_moment};
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use fanal::reconstruct::gaussian::Gaussian;
use rayon::prelude::*;
use serde::Serialize;

use crate::ablation::Ablation;
use crate::cases::{Case, common, levels, mean_kl, mean_log_moment, reconstruct, spread, tune_uniform};
use crate::tuning::tune_gaussian;

/// Lower bounds of the buckets by number of path samples.
pub const BUCKETS: [u32; 5] = [0, 16, 64, 256, 1000];

/// Training trees that parameters are tuned on.
pub const TUNING_TREES: usize = 400;
/// Training trees in the mean tree, and its deepest level.
const MEAN_TREES: usize = 1000;
const MEAN_LEVEL: usize = 5;

/// Measurements of one method; KL in nats.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The method.
    pub name: String,
    /// Uniform part at which V is least on training trees.
    pub uniform: f64,
    /// Mean KL over held-out trees, at the uniform part at which it is least on training trees.
    pub kl: f64,
    /// Median KL.
    pub median_kl: f64,
    /// Mean KL less that between two halves of the target, which the truth itself would have below 0.
    pub kl_above_floor: f64,
    /// Median of V, the relative variance of the one-sample estimator (see [`relative_moment`]).
    pub median_variance: f64,
    /// Mean of V.
    pub mean_variance: f64,
    /// Geometric mean of 1 + V.
    pub moment: f64,
    /// Geometric mean of 1 + V per bucket of path samples.
    pub bucket_moments: [Option<f64>; 5],
    /// Mean KL per bucket of path samples; none where it is empty.
    pub buckets: [Option<f64>; 5],
    /// Mean KL that each level adds.
    pub levels: Vec<f64>,
    /// Mean number of nodes.
    pub nodes: f64,
    /// Mean number of nodes that Q_h does not have.
    pub nodes_added: f64,
    /// Mean number of nodes of Q_h that are gone.
    pub nodes_removed: f64,
    /// Microseconds per tree, all threads together.
    pub microseconds: f64,
}

/// The whole evaluation.
#[derive(Debug, Clone, Serialize)]
pub struct Evaluation {
    /// Held-out trees.
    pub trees: usize,
    /// Trees per bucket.
    pub bucket_trees: [usize; 5],
    /// Mean number of nodes of the counted trees.
    pub input_nodes: f64,
    /// Mean number of nodes of Q_gt.
    pub target_nodes: f64,
    /// Mean KL between two halves of the target: about four times that of the target beside the truth.
    pub floor: f64,
    /// The Gaussian's tuned parameters: σ in cells, samples that near, far and equal shares count as.
    pub gaussian: [f64; 4],
    /// The methods.
    pub rows: Vec<Row>,
}

/// Compares all methods; `limit` held-out trees at most.
///
/// # Errors
/// When there are no held-out or training trees, or the network cannot be run.
pub fn evaluate(data: &Dataset, model: &Model, ablations: &[Ablation], limit: usize) -> Result<Evaluation> {
    if data.train.is_empty() || data.held_out.is_empty() {
        bail!("evaluation needs trees to tune on and held-out trees");
    }
    let (tuning, cases) = (spread(&data.train, TUNING_TREES)?, spread(&data.held_out, limit)?);
    let gaussian = tune_gaussian(&tuning);
    let mean = mean_tree(&spread(&data.train, MEAN_TREES)?);
    let backend = Embedded::new(model)?;
    let bench = Bench::new(&tuning, &cases);
    let each = |f: &(dyn Fn(&Case) -> Distribution + Sync), cases: &[Case]| -> Result<Vec<Distribution>> {
        Ok(cases.par_iter().map(f).collect())
    };
    let hybrid = |c: &Case| c.leaves().hybrid(f64::from(c.voxel_features.path_share));
    let shipped = Gaussian::default();
    let mut rows = vec![
        bench.row("uniform", |cases| each(&|_| Distribution::uniform(), cases))?,
        bench.row("path only", |cases| each(&|c| c.leaves().distribution(0), cases))?,
        bench.row("photons only", |cases| each(&|c| c.leaves().distribution(1), cases))?,
        bench.row("hybrid", |cases| each(&hybrid, cases))?,
        bench.row("hybrid, context and past", |cases| each(&|c| c.counted.clone(), cases))?,
        bench.row("mean tree", |cases| each(&|_| mean.clone(), cases))?,
        bench.row("Gaussian", |cases| each(&|c| gaussian.smooth(&hybrid(c), c.samples()), cases))?,
        bench.row("Gaussian, context and past", |cases| each(&|c| gaussian.smooth_tree(&c.input()), cases))?,
        bench.row("as the program ships it", |cases| each(&|c| shipped.smooth_tree(&c.input()), cases))?,
        bench.row("the targets themselves", |cases| each(&|c| c.target.clone(), cases))?,
        bench.row("network", |cases| reconstruct(model, &backend, cases))?,
    ];
    for &ablation in ablations {
        rows.push(bench.row(ablation.name(), |cases| ablation.reconstruct(model, &backend, cases))?);
    }
    let mean_of = |f: &dyn Fn(&Case) -> f64| cases.iter().map(f).sum::<f64>() / cases.len() as f64;
    Ok(Evaluation {
        trees: cases.len(),
        bucket_trees: std::array::from_fn(|b| cases.iter().filter(|c| bucket(c) == b).count()),
        input_nodes: mean_of(&|c| c.counted.topology().len() as f64),
        target_nodes: mean_of(&|c| c.target.topology().len() as f64),
        floor: mean_of(&|c| c.floor),
        gaussian: [gaussian.sigma, gaussian.near, gaussian.far, gaussian.flat],
        rows,
    })
}

fn mean_tree(cases: &[Case]) -> Distribution {
    Distribution::mean(&cases.iter().map(|c| &c.target).collect::<Vec<_>>(), MEAN_LEVEL)
}

fn bucket(case: &Case) -> usize {
    BUCKETS.iter().rposition(|&low| case.voxel_features.samples[0] >= low).unwrap_or(0)
}

/// Trees to tune on and trees to measure on.
pub struct Bench<'a> {
    tuning: &'a [Case],
    cases: &'a [Case],
}

impl<'a> Bench<'a> {
    /// A bench for methods that are tuned on `tuning` and measured on `cases`.
    pub fn new(tuning: &'a [Case], cases: &'a [Case]) -> Self {
        Self { tuning, cases }
    }

    /// Measures one method.
    ///
    /// # Errors
    /// Those of the method.
    pub fn row(&self, name: &str, method: impl Fn(&[Case]) -> Result<Vec<Distribution>>) -> Result<Row> {
        let tuning = common(self.tuning, &method(self.tuning)?);
        let uniform = tune_uniform(&tuning, mean_log_moment);
        let kl_uniform = tune_uniform(&tuning, mean_kl);
        let start = Instant::now();
        let guides = method(self.cases)?;
        let microseconds = 1e6 * start.elapsed().as_secs_f64() / self.cases.len() as f64;
        let cells = common(self.cases, &guides);
        let kl: Vec<f64> = cells.iter().map(|c| kl_of_cells(c, kl_uniform)).collect();
        let variance: Vec<f64> = cells.iter().map(|c| relative_moment(c, uniform) - 1.0).collect();
        let in_bucket = |b: usize, values: &[f64]| -> Option<f64> {
            let chosen = self.cases.iter().zip(values).filter(|(c, _)| bucket(c) == b).map(|(_, &value)| value);
            let (count, sum) = chosen.fold((0.0, 0.0), |(n, sum), value| (n + 1.0, sum + value));
            (count > 0.0).then(|| sum / count)
        };
        let logs: Vec<f64> = variance.iter().map(|v| v.ln_1p()).collect();
        let n = self.cases.len() as f64;
        let floor = self.cases.iter().map(|c| c.floor).sum::<f64>() / n;
        let changes = self.cases.iter().zip(&guides).map(|(c, g)| changed_nodes(c, g));
        let [added, removed] = changes.fold([0.0, 0.0], |sum, c| [sum[0] + c[0], sum[1] + c[1]]);
        let mean = kl.iter().sum::<f64>() / n;
        Ok(Row {
            name: name.to_owned(),
            uniform,
            kl: mean,
            median_kl: median(kl.clone()),
            kl_above_floor: mean - floor,
            mean_variance: variance.iter().sum::<f64>() / n,
            median_variance: median(variance),
            moment: (logs.iter().sum::<f64>() / n).exp(),
            buckets: std::array::from_fn(|b| in_bucket(b, &kl)),
            bucket_moments: std::array::from_fn(|b| in_bucket(b, &logs).map(f64::exp)),
            levels: levels(self.cases, &guides, kl_uniform),
            nodes: guides.iter().map(|g| g.topology().len() as f64).sum::<f64>() / n,
            nodes_added: added / n,
            nodes_removed: removed / n,
            microseconds,
        })
    }
}

/// Number of nodes of the guide that the counted tree does not have, and the other way round.
fn changed_nodes(case: &Case, guide: &Distribution) -> [f64; 2] {
    let (before, after) = (case.counted.topology(), guide.topology());
    let mut common = 1;
    let mut open = vec![(0usize, 0usize)];
    while let Some((a, b)) = open.pop() {
        if !before.is_leaf(a) && !after.is_leaf(b) {
            common += 4;
            let (a, b) = (before.first_child[a] as usize, after.first_child[b] as usize);
            open.extend((0..4).map(|k| (a + k, b + k)));
        }
    }
    [after.len(), before.len()].map(|n| (n - common) as f64)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
