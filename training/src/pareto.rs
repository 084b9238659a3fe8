//! Accuracy against time: several models in every backend, on the same held-out trees.

use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use fanal::base::files::{write_bytes, write_json};
use fanal::generate::dataset::Dataset;
use fanal::network::backend::Backend;
use fanal::network::embedded::Embedded;
use fanal::network::weights::{ENCODE_FILE, Model};
use fanal::reconstruct::gaussian::Gaussian;
use fanal::reconstruct::onnx::OnnxBackend;
use fanal::report::plot::{color, draw};
use plotters::prelude::*;
use rayon::prelude::*;
use serde::Serialize;

use crate::cases::{Case, reconstruct, spread};
use crate::evaluate::{BUCKETS, Bench, Row, TUNING_TREES};
use crate::tuning::tune_gaussian;

/// Rounds of timing; all variants take turns in each.
const ROUNDS: usize = 5;
/// Number of trees that are timed.
const TIMED_TREES: usize = 600;

/// Name of the backend that has its own threads.
const ONNX: &str = "onnx";

/// Names of the files that are written.
const PLOT_FILE: &str = "pareto.svg";
const TABLE_FILE: &str = "pareto.json";

/// One model in one backend.
#[derive(Debug, Clone, Serialize)]
pub struct Variant {
    /// Name of the model's folder, or of a baseline.
    pub model: String,
    /// Name of the backend; - for baselines.
    pub backend: String,
    /// Number of weights; 0 for baselines.
    pub weights: usize,
    /// Microseconds per tree, all threads together: the median of the rounds.
    pub microseconds: f64,
    /// Mean KL above the convergence floor, in nats.
    pub kl_above_floor: f64,
    /// Geometric mean of 1 + V.
    pub moment: f64,
    /// Geometric mean of 1 + V per bucket of path samples.
    pub bucket_moments: [Option<f64>; 5],
}

/// All variants, baselines first.
#[derive(Debug, Clone, Serialize)]
pub struct Pareto {
    /// Held-out trees that accuracy was measured on.
    pub trees: usize,
    /// Number of threads that the times were measured with.
    pub threads: usize,
    /// The variants.
    pub variants: Vec<Variant>,
}

/// A method of reconstruction.
enum Method {
    Gaussian(Gaussian),
    Network { model: Box<Model>, backend: Box<dyn Backend + Send> },
}

impl Method {
    fn run(&self, cases: &[Case]) -> Result<Vec<fanal::guiding::tree::distribution::Distribution>> {
        match self {
            Self::Gaussian(gaussian) => Ok(cases.par_iter().map(|c| gaussian.smooth_tree(&c.input())).collect()),
            Self::Network { model, backend } => reconstruct(model, backend.as_ref(), cases),
        }
    }
}

/// Measures the models in `folders` on at most `limit` held-out trees. A model without ONNX files, or a machine without
/// onnxruntime, is left out of that backend, and said so on stderr.
///
/// # Errors
/// When a model cannot be read or run, or was trained for another mode than the data.
pub fn pareto(data: &Dataset, folders: &[PathBuf], limit: usize) -> Result<Pareto> {
    ensure!(
        !data.train.is_empty() && !data.held_out.is_empty(),
        "evaluation needs trees to tune on and held-out trees"
    );
    let (tuning, cases) = (spread(&data.train, TUNING_TREES)?, spread(&data.held_out, limit)?);
    let mut methods = vec![("Gaussian".to_owned(), "-".to_owned(), 0, Method::Gaussian(tune_gaussian(&tuning)))];
    for folder in folders {
        let name = folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into());
        let model = Model::load(folder)?;
        ensure!(model.config.mode == data.mode, "{name} was trained for another mode than the data: {:?}", data.mode);
        let weights = model.weights.layers.values().map(|layer| layer.weight.len() + layer.bias.len()).sum();
        for backend in backends(folder, &model)? {
            let label = backend.name().to_owned();
            methods.push((name.clone(), label, weights, Method::Network { model: Box::new(model.clone()), backend }));
        }
    }
    let bench = Bench::new(&tuning, &cases);
    let timed = &cases[..cases.len().min(TIMED_TREES)];
    let mut times = vec![Vec::with_capacity(ROUNDS); methods.len()];
    // Backends with threads of their own come last: those wait for more work for a while, and would take time from the others.
    for (last, _) in [false, true].into_iter().flat_map(|last| (0..ROUNDS).map(move |round| (last, round))) {
        let with_threads = |backend: &str| backend == ONNX;
        for (times, (.., method)) in times.iter_mut().zip(&methods).filter(|(_, m)| with_threads(&m.1) == last) {
            let start = Instant::now();
            method.run(timed)?;
            times.push(1e6 * start.elapsed().as_secs_f64() / timed.len() as f64);
        }
    }
    let variant = |((model, backend, weights, method), mut times): ((_, _, _, Method), Vec<f64>)| {
        let Row { kl_above_floor, moment, bucket_moments, .. } = bench.row("", |cases| method.run(cases))?;
        times.sort_by(f64::total_cmp);
        Ok(Variant { model, backend, weights, microseconds: times[ROUNDS / 2], kl_above_floor, moment, bucket_moments })
    };
    let variants = methods.into_iter().zip(times).map(variant).collect::<Result<_>>()?;
    Ok(Pareto { trees: cases.len(), threads: rayon::current_num_threads(), variants })
}

fn backends(folder: &Path, model: &Model) -> Result<Vec<Box<dyn Backend + Send>>> {
    let mut backends: Vec<Box<dyn Backend + Send>> = vec![Box::new(Embedded::new(model)?)];
    if !folder.join(ENCODE_FILE).exists() {
        eprintln!("{}: no ONNX files, `export` writes them", folder.display());
        return Ok(backends);
    }
    match OnnxBackend::load(folder) {
        Ok(onnx) => backends.push(Box::new(onnx)),
        Err(e) => eprintln!("{}: not measured in onnxruntime: {e}", folder.display()),
    }
    Ok(backends)
}

impl Display for Pareto {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{} held-out trees, times with {} threads", self.trees, self.threads)?;
        write!(
            f,
            "{:<20}{:<14}{:>9}{:>10}{:>10}{:>9} |",
            "model", "backend", "weights", "us/tree", "KL-floor", "1 + V"
        )?;
        BUCKETS.iter().try_for_each(|low| write!(f, "{:>9}", format!("N>={low}")))?;
        writeln!(f)?;
        for v in &self.variants {
            write!(f, "{:<20}{:<14}{:>9}{:>10.1}", v.model, v.backend, v.weights, v.microseconds)?;
            write!(f, "{:>10.4}{:>9.3} |", v.kl_above_floor, v.moment)?;
            let cell = |value: &Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
            v.bucket_moments.iter().try_for_each(|value| write!(f, "{:>9}", cell(value)))?;
            writeln!(f)?;
        }
        Ok(())
    }
}

impl Pareto {
    /// Writes `pareto.json` and `pareto.svg` into `folder`.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        write_json(&folder.join(TABLE_FILE), self)?;
        write_bytes(&folder.join(PLOT_FILE), self.plot()?.as_bytes())?;
        Ok(())
    }

    /// Draws two panels over time: KL above the floor, and 1 + V. Models have colours, backends shapes: a circle is the embedded
    /// one, a cross onnxruntime. The grey line joins the variants that no other beats in both.
    fn plot(&self) -> fanal::base::Result<String> {
        draw((1100, 480), |area| {
            let panels = area.split_evenly((1, 2));
            self.panel(&panels[0], "KL above the floor, nats", |v| v.kl_above_floor)?;
            self.panel(&panels[1], "1 + V", |v| v.moment)
        })
    }

    fn panel(
        &self,
        area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
        what: &str,
        value: impl Fn(&Variant) -> f64,
    ) -> Result<(), Box<dyn std::error::Error>> {
        let points: Vec<(f64, f64, &Variant)> =
            self.variants.iter().map(|v| (v.microseconds.max(0.1), value(v), v)).filter(|p| p.1.is_finite()).collect();
        let range = |of: &dyn Fn(&(f64, f64, &Variant)) -> f64| {
            points.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        let ((left, right), (low, high)) = (range(&|p| p.0), range(&|p| p.1));
        let margin = 0.08 * (high - low).max(1e-3);
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d((0.7 * left..2.5 * right).log_scale(), low - margin..high + margin)?;
        chart.configure_mesh().x_desc("microseconds per tree").y_desc(what).draw()?;
        let mut front: Vec<_> = points.iter().map(|p| (p.0, p.1)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best = f64::INFINITY;
        front.retain(|p| {
            let better = p.1 < best;
            best = best.min(p.1);
            better
        });
        chart.draw_series(LineSeries::new(front, BLACK.mix(0.3)))?;
        let mut models: Vec<&str> = self.variants.iter().map(|v| v.model.as_str()).collect();
        models.dedup();
        for (i, model) in models.iter().enumerate() {
            let color = color(i);
            let of_model = || points.iter().filter(|p| p.2.model == *model);
            let along = LineSeries::new(of_model().map(|p| (p.0, p.1)), color.mix(0.5));
            let legend = move |(x, y): (i32, i32)| Circle::new((x + 6, y), 4, color.filled());
            chart.draw_series(along)?.label(*model).legend(legend);
            for &(x, y, variant) in of_model() {
                match variant.backend.as_str() {
                    ONNX => chart.draw_series([Cross::new((x, y), 4, color.stroke_width(2))])?,
                    _ => chart.draw_series([Circle::new((x, y), 4, color.filled())])?,
                };
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .border_style(BLACK.mix(0.2))
            .background_style(WHITE.mix(0.8))
            .draw()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_variant_is_told_and_drawn() {
        let variant = |model: &str, backend: &str, microseconds: f64, moment: f64| Variant {
            model: model.into(),
            backend: backend.into(),
            weights: 100,
            microseconds,
            kl_above_floor: 0.1 * moment,
            moment,
            bucket_moments: [Some(moment), None, None, Some(2.0), None],
        };
        let variants = vec![
            variant("Gaussian", "-", 10.0, 9.0),
            variant("a", "embedded", 80.0, 7.0),
            variant("a", ONNX, 200.0, 7.0),
        ];
        let pareto = Pareto { trees: 3, threads: 2, variants };
        let text = pareto.to_string();
        assert!(text.lines().count() == 5 && text.contains("embedded"), "{text}");
        let folder = tempfile::tempdir().unwrap();
        pareto.write(&folder.path().join("new")).unwrap();
        let svg = std::fs::read_to_string(folder.path().join("new").join(PLOT_FILE)).unwrap();
        assert!(svg.contains("Gaussian") && svg.ends_with("</svg>\n"), "{svg}");
    }
}
