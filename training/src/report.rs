//! Report on a finished run: its error on each level, and the calibration of its leaf classifier.

use std::path::Path;

use anyhow::{Result, anyhow};
use burn::tensor::Device;
use fanal::base::files::{write_bytes, write_json};
use fanal::base::random::Random;
use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::distribution::Distribution;
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use fanal::reconstruct::gaussian::Gaussian;
use serde::Serialize;

use crate::batch::HostBatch;
use crate::cases::{Case, levels, reconstruct};
use crate::forward::{decode, encode};
use crate::model::{Net, to_vec};
use crate::plot::{Panel, panels};

const PLOT_FILE: &str = "report.svg";
const TABLE_FILE: &str = "report.json";

/// Bins of the probability of being a leaf.
const BINS: usize = 10;
/// Trees in one forward pass.
const BATCH: usize = 16;
/// Uniform part in the KL of each level.
const UNIFORM: f64 = 0.03;

/// Rows whose probability of being a leaf lies in one bin.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Bin {
    /// Mean predicted probability.
    pub predicted: f64,
    /// Share of the rows that are leaves of the target.
    pub observed: f64,
    /// Number of rows.
    pub rows: u64,
}

/// Measurements on the validation trees.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Validation trees.
    pub trees: usize,
    /// KL that each level adds (entry 0 is level 1), nats, of the counted trees, the smoothed ones and the network's.
    pub levels: [Vec<f64>; 3],
    /// The leaf classifier's calibration: ten bins of equal width.
    pub calibration: [Bin; BINS],
    /// Mean of |predicted − observed| over rows (Guo et al. 2017, expected calibration error).
    pub calibration_error: f64,
}

impl Report {
    /// Measures the network on `samples`.
    ///
    /// # Errors
    /// When a pair is not valid or the network cannot be run.
    pub fn new(model: &Model, samples: &[&TreeSample]) -> Result<Self> {
        let cases: Vec<Case> = samples.iter().map(|sample| Case::new(sample)).collect::<Result<_>>()?;
        let network = reconstruct(model, &Embedded::new(model)?, &cases)?;
        let smooth = |c: &Case| Gaussian::default().smooth_tree(&c.input());
        let guides = [cases.iter().map(|c| c.counted.clone()).collect(), cases.iter().map(smooth).collect(), network];
        let calibration = calibration(model, samples)?;
        let rows: u64 = calibration.iter().map(|bin| bin.rows).sum();
        let off = |bin: &Bin| bin.rows as f64 * (bin.predicted - bin.observed).abs();
        Ok(Self {
            trees: cases.len(),
            levels: guides.map(|guides: Vec<Distribution>| levels(&cases, &guides, UNIFORM)),
            calibration_error: calibration.iter().map(off).sum::<f64>() / rows.max(1) as f64,
            calibration,
        })
    }

    /// Writes `report.json` and `report.svg` into the model folder.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(TABLE_FILE), self)?;
        write_bytes(&folder.join(PLOT_FILE), panels(&self.panels(), 2)?.as_bytes())?;
        Ok(())
    }

    fn panels(&self) -> [Panel; 2] {
        let deepest = self.levels.iter().map(Vec::len).max().unwrap_or(0);
        let names = ["counted", "smoothed", "network"].map(str::to_owned);
        let of = |value: fn(&Bin) -> f64| {
            let value = |bin: &Bin| if bin.rows > 0 { value(bin) } else { f64::NAN };
            self.calibration.iter().map(value).collect::<Vec<_>>()
        };
        [
            Panel {
                title: "KL that each level adds, nats".into(),
                labels: (1..=deepest).map(|level| level.to_string()).collect(),
                series: names.into_iter().zip(self.levels.clone()).collect(),
                bars: false,
            },
            Panel {
                title: format!("probability of a leaf; error {:.3}", self.calibration_error),
                labels: (0..BINS).map(|k| format!("{:.2}", (k as f64 + 0.5) / BINS as f64)).collect(),
                series: vec![("predicted".into(), of(|b| b.predicted)), ("observed".into(), of(|b| b.observed))],
                bars: true,
            },
        ]
    }
}

/// Calibration of the leaf classifier over all rows that a training pass decodes.
fn calibration(model: &Model, samples: &[&TreeSample]) -> Result<[Bin; BINS]> {
    let net = Net::new(&model.config, &model.weights, &Device::flex())?;
    let mut bins = [Bin::default(); BINS];
    for (i, part) in samples.chunks(BATCH).enumerate() {
        let part: Vec<TreeSample> = part.iter().map(|&sample| sample.clone()).collect();
        let batch = HostBatch::new(&part, &model.config).map_err(|e| anyhow!(e))?;
        let encoded = encode(&net, &model.config, &batch);
        let decoded = decode(&net, &model.config, &batch, &encoded, &mut Random::new(1, 0, i as u64));
        for (logit, &leaf) in to_vec(decoded.leaf_logit).into_iter().zip(&decoded.is_leaf) {
            let predicted = 1.0 / (1.0 + (-f64::from(logit)).exp());
            let bin = &mut bins[((predicted * BINS as f64) as usize).min(BINS - 1)];
            bin.rows += 1;
            bin.predicted += predicted;
            bin.observed += f64::from(u8::from(leaf));
        }
    }
    for bin in bins.iter_mut().filter(|bin| bin.rows > 0) {
        bin.predicted /= bin.rows as f64;
        bin.observed /= bin.rows as f64;
    }
    Ok(bins)
}
