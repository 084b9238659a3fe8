//! Small charts as SVG: bars and lines side by side in panels.

use std::path::Path;

use anyhow::{Context, Result};
use fanal::base::files::{write_bytes, write_json};
use fanal::report::plot::{color, draw, emptiest_corner};
use plotters::coord::Shift;
use plotters::prelude::*;
use serde::Serialize;

/// Pixels of one panel.
const PANEL: (u32, u32) = (460, 320);

/// One panel.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title of the panel.
    pub title: String,
    /// Labels below, one for each place.
    pub labels: Vec<String>,
    /// Names and values, one value for each label; values that are not numbers are left out.
    pub series: Vec<(String, Vec<f64>)>,
    /// Bars beside each other, or else lines.
    pub bars: bool,
}

/// Writes `table` as NAME.json and panels of it, two in a row, as NAME.svg into `folder`.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, name: &str, table: &impl Serialize, all: &[Panel]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    write_json(&folder.join(format!("{name}.json")), table)?;
    write_bytes(&folder.join(format!("{name}.svg")), panels(all, 2)?.as_bytes())?;
    Ok(())
}

/// Draws all panels in rows of `columns`, as an SVG.
///
/// # Errors
/// When drawing fails.
pub fn panels(panels: &[Panel], columns: usize) -> Result<String> {
    let columns = columns.clamp(1, panels.len().max(1));
    let lines = panels.len().div_ceil(columns).max(1);
    let size = (PANEL.0 * columns as u32, PANEL.1 * lines as u32);
    Ok(draw(size, |area| {
        let areas = area.split_evenly((lines, columns));
        panels.iter().zip(areas).try_for_each(|(panel, area)| draw_panel(panel, &area))
    })?)
}

fn draw_panel(panel: &Panel, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), Box<dyn std::error::Error>> {
    let values = || panel.series.iter().flat_map(|(_, values)| values).copied().filter(|v| v.is_finite());
    let high = values().fold(0.0, f64::max).max(1e-9);
    let low = values().fold(f64::INFINITY, f64::min);
    // Lines far above zero would be flat with a foot of 0; bars with another foot would mislead.
    let near = (0.5 * high..=high).contains(&low);
    let foot = if panel.bars || !near { 0.0 } else { low - 0.1 * (high - low).max(0.05 * high) };
    let top = high + 0.1 * (high - foot);
    let places = panel.labels.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .margin(10)
        .caption(&panel.title, ("sans-serif", 14))
        .x_label_area_size(28)
        .y_label_area_size(48)
        .build_cartesian_2d(-0.5..places - 0.5, foot..top)?;
    let label = |x: &f64| {
        let near = (x - x.round()).abs() < 1e-6 && *x >= 0.0;
        if near { panel.labels.get(*x as usize).cloned().unwrap_or_default() } else { String::new() }
    };
    let labels = panel.labels.len().min(24);
    chart.configure_mesh().disable_x_mesh().x_labels(labels).x_label_formatter(&label).draw()?;
    let count = panel.series.len().max(1) as f64;
    for (i, (name, values)) in panel.series.iter().enumerate() {
        let color = color(i + 1);
        let finite = || values.iter().enumerate().filter(|(_, v)| v.is_finite()).map(|(at, &v)| (at as f64, v));
        let legend = move |(x, y): (i32, i32)| Rectangle::new([(x, y - 4), (x + 10, y + 4)], color.filled());
        if panel.bars {
            let width = 0.8 / count;
            let bar = |(at, v): (f64, f64)| {
                let left = at - 0.4 + width * i as f64;
                Rectangle::new([(left, 0.0), (left + width, v)], color.filled())
            };
            chart.draw_series(finite().map(bar))?.label(name).legend(legend);
        } else {
            chart.draw_series(LineSeries::new(finite(), color.stroke_width(2)))?.label(name).legend(legend);
        }
    }
    if panel.series.len() > 1 {
        chart
            .configure_series_labels()
            .position(emptiest_corner(&shapes(panel, [foot, top])))
            .border_style(BLACK.mix(0.2))
            .background_style(WHITE.mix(0.8))
            .draw()?;
    }
    Ok(())
}

/// Points of the drawn lines or bars in the unit square up to `top`: a line for each series, or for each bar.
fn shapes(panel: &Panel, [foot, top]: [f64; 2]) -> Vec<Vec<[f64; 2]>> {
    let places = panel.labels.len() as f64;
    let point = |at: usize, v: f64| [(at as f64 + 0.5) / places, (v - foot) / (top - foot)];
    let of = |values: &Vec<f64>| -> Vec<Vec<[f64; 2]>> {
        let finite = values.iter().enumerate().filter(|(_, v)| v.is_finite());
        if panel.bars {
            finite.map(|(at, &v)| vec![point(at, foot), point(at, v)]).collect()
        } else {
            vec![finite.map(|(at, &v)| point(at, v)).collect()]
        }
    };
    panel.series.iter().flat_map(|(_, values)| of(values)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legends_keep_to_the_emptier_side() {
        let panel = |values: &[f64]| Panel {
            title: String::new(),
            labels: (0..values.len()).map(|i| i.to_string()).collect(),
            series: vec![("a".into(), values.to_vec()), ("b".into(), vec![0.1, f64::NAN])],
            bars: true,
        };
        let left = |values: &[f64]| {
            matches!(emptiest_corner(&shapes(&panel(values), [0.0, 1.1])), SeriesLabelPosition::UpperLeft)
        };
        assert!(left(&[0.0, 0.5, 0.9, 1.0]) && !left(&[1.0, 0.9, 0.5, 0.0]));
        assert!(!left(&[]));
    }
}
