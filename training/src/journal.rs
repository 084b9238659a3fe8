//! The course of a training run: `losses.jsonl` and `losses.svg`.

use std::path::Path;

use anyhow::{Context, Result};
use fanal::base::files::{write_atomically, write_bytes};
use plotters::prelude::*;
use serde::{Deserialize, Serialize};

/// Name of the log in a model folder.
pub const LOG_FILE: &str = "losses.jsonl";
/// Name of the plot in a model folder.
pub const PLOT_FILE: &str = "losses.svg";
/// Most points of the loss in the plot; lines of the log are averaged to at most as many, since single ones are mostly noise.
const POINTS: usize = 200;

/// One line of the log: means over the steps since the line before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Steps done.
    pub step: u64,
    /// Passes over the data.
    pub epoch: f64,
    /// Seconds of training.
    pub seconds: f64,
    /// Value part of the loss.
    pub value: f64,
    /// Classification part, before β.
    pub class: f64,
    /// Weight of the classification.
    pub beta: f64,
    /// Learning rate.
    pub rate: f64,
    /// Norm of the gradient.
    pub norm: f64,
    /// Trees per second of training.
    pub trees_per_second: f64,
    /// KL on the validation trees in nats, when measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_kl: Option<f64>,
    /// Mean ln(1 + V) on the validation trees, when measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_moment: Option<f64>,
}

/// The log of a run.
#[derive(Debug, Clone, Default)]
pub struct Journal {
    /// The lines so far.
    pub entries: Vec<Entry>,
}

impl Journal {
    /// Reads the lines up to `step` of an earlier part of the run; empty if there is no log.
    pub fn read(folder: &Path, step: u64) -> Self {
        let text = std::fs::read_to_string(folder.join(LOG_FILE)).unwrap_or_default();
        let entries = text.lines().filter_map(|line| serde_json::from_str::<Entry>(line).ok());
        Self { entries: entries.filter(|e| e.step <= step).collect() }
    }

    /// Writes log and plot.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_atomically(&folder.join(LOG_FILE), |out| {
            for entry in &self.entries {
                serde_json::to_writer(&mut *out, entry)?;
                out.write_all(b"\n")?;
            }
            Ok(())
        })?;
        if self.entries.len() > 1 {
            write_bytes(&folder.join(PLOT_FILE), self.plot()?.as_bytes())?;
        }
        Ok(())
    }

    /// Loss, and ln(1 + V) on the validation trees, over epochs.
    fn plot(&self) -> Result<String> {
        let mean = |lines: &[Entry]| {
            let sum = |of: fn(&Entry) -> f64| lines.iter().map(of).sum::<f64>() / lines.len() as f64;
            (sum(|e| e.epoch), sum(|e| e.value))
        };
        let lines = self.entries.len().div_ceil(POINTS).max(1);
        let train: Vec<(f64, f64)> = self.entries.chunks(lines).map(mean).collect();
        let validation: Vec<(f64, f64)> =
            self.entries.iter().filter_map(|e| e.validation_moment.map(|moment| (e.epoch, moment))).collect();
        let all = || train.iter().chain(&validation).map(|p| p.1).filter(|y| y.is_finite());
        // Losses fall fast at first and little afterwards: the interesting range lies far above zero.
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
        let margin = (0.05 * (high - low)).max(1e-3);
        let (low, high) = if low <= high { (low - margin, high + margin) } else { (0.0, 1.0) };
        let end = self.entries.last().map_or(1.0, |e| e.epoch).max(1e-3);
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, (900, 500)).into_drawing_area();
            let fail = |e: &dyn std::fmt::Display| anyhow::anyhow!("drawing the losses: {e}");
            area.fill(&WHITE).map_err(|e| fail(&e))?;
            let mut chart = ChartBuilder::on(&area)
                .margin(12)
                .x_label_area_size(36)
                .y_label_area_size(52)
                .build_cartesian_2d(0.0..end, low..high)
                .map_err(|e| fail(&e))?;
            let mesh = chart.configure_mesh().x_desc("epoch").y_desc("loss (grey), validation ln(1 + V) (blue)").draw();
            mesh.map_err(|e| fail(&e))?;
            chart.draw_series(LineSeries::new(train, BLACK.mix(0.4))).map_err(|e| fail(&e))?;
            chart.draw_series(LineSeries::new(validation, BLUE.stroke_width(2))).map_err(|e| fail(&e))?;
            area.present().map_err(|e| fail(&e)).context("losses.svg")?;
        }
        Ok(svg)
    }
}
