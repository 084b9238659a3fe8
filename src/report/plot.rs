//! Plots as SVG: errors on logarithmic axes with a band over seeds, and where the time goes as stacked bars.

use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::prelude::*;

use super::results::{DenoisedSummary, Interval, Results, SummaryEntry};
use crate::base::{Error, Result};

/// Pixels of a plot.
const SIZE: (u32, u32) = (640, 420);

/// Costs on the horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// Wall time.
    Seconds,
    /// Samples per pixel.
    Spp,
}

/// Errors on the vertical axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// relMSE.
    Relmse,
    /// relMSE without the worst pixels.
    Trimmed,
    /// relMSE of what a screen shows.
    Ldr,
}

impl Against {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Seconds, Self::Spp];

    /// Its name on axes and in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Seconds => "seconds",
            Self::Spp => "spp",
        }
    }

    fn of(self, entry: &SummaryEntry) -> f64 {
        match self {
            Self::Seconds => entry.seconds,
            Self::Spp => entry.spp,
        }
    }

    fn of_denoised(self, entry: &SummaryEntry, denoised: &DenoisedSummary) -> f64 {
        match self {
            Self::Seconds => denoised.seconds,
            Self::Spp => entry.spp,
        }
    }
}

impl Measure {
    /// All.
    pub const ALL: [Self; 3] = [Self::Trimmed, Self::Relmse, Self::Ldr];

    /// Its name on axes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relmse => "relMSE",
            Self::Trimmed => "trimmed relMSE",
            Self::Ldr => "LDR relMSE",
        }
    }

    /// Its name in file names.
    pub fn slug(self) -> &'static str {
        match self {
            Self::Relmse => "relmse",
            Self::Trimmed => "relmse-trimmed",
            Self::Ldr => "relmse-ldr",
        }
    }

    /// This error of an entry: mean and interval.
    pub fn of(self, entry: &SummaryEntry) -> Interval {
        match self {
            Self::Relmse => entry.relmse,
            Self::Trimmed => entry.relmse_trimmed,
            Self::Ldr => entry.relmse_ldr,
        }
    }

    fn of_denoised(self, denoised: &DenoisedSummary) -> Interval {
        match self {
            Self::Relmse => denoised.relmse,
            Self::Trimmed => denoised.relmse_trimmed,
            Self::Ldr => denoised.relmse_ldr,
        }
    }
}

/// A method's colour, the same in every plot: distinguishable with red-green blindness (Okabe and Ito 2008).
pub fn color(method: usize) -> RGBColor {
    const COLORS: [RGBColor; 8] = [
        RGBColor(80, 80, 80),
        RGBColor(230, 159, 0),
        RGBColor(0, 114, 178),
        RGBColor(0, 158, 115),
        RGBColor(204, 121, 167),
        RGBColor(213, 94, 0),
        RGBColor(86, 180, 233),
        RGBColor(240, 228, 66),
    ];
    COLORS[method % COLORS.len()]
}

/// Geometric means of a method's denoised pictures over cost.
fn denoised(results: &Results, method: &str, against: Against, measure: Measure) -> Vec<(f64, f64)> {
    let of = results.summary.iter().filter(|s| s.method == method);
    let point = |s: &SummaryEntry| {
        let denoised = s.denoised.as_ref()?;
        Some((against.of_denoised(s, denoised), measure.of_denoised(denoised).mean))
    };
    let mut points: Vec<_> = of.filter_map(point).filter(|p| p.1 > 0.0).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// A method in a plot over cost.
struct Line<'a> {
    method: &'a str,
    color: RGBColor,
    /// Mean and interval over cost.
    points: Vec<(f64, Interval)>,
    /// Another mean over cost, dashed.
    dashed: Vec<(f64, f64)>,
}

/// Values over cost of every method, where they are known and positive.
fn lines<'a>(
    results: &'a Results,
    against: Against,
    value: impl Fn(&SummaryEntry) -> Option<Interval>,
) -> impl Iterator<Item = Line<'a>> {
    results.methods.iter().enumerate().map(move |(i, method)| {
        let of = results.summary.iter().filter(|s| s.method == *method);
        let known = of.filter_map(|s| Some((against.of(s), value(s)?)));
        let mut points: Vec<_> = known.filter(|p| p.1.low > 0.0).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Line { method, color: color(i), points, dashed: Vec::new() }
    })
}

/// Error over cost for every method: the geometric mean as a line, its 95 % interval over seeds as a band. That of denoised pictures,
/// where there are any, is a dashed line of the same colour.
///
/// # Errors
/// [`Error::Options`] where the plot cannot be drawn.
pub fn errors(results: &Results, against: Against, measure: Measure) -> Result<String> {
    let lines = lines(results, against, |entry| Some(measure.of(entry)));
    let lines: Vec<Line> =
        lines.map(|line| Line { dashed: denoised(results, line.method, against, measure), ..line }).collect();
    over_cost(&lines, against, measure.name(), None)
}

/// Trimmed error over that of the first method for every other one, paired by seed: where its line falls below 1, a method is better than
/// the first. Nothing where there is no other.
///
/// # Errors
/// As [`errors`].
pub fn ratios(results: &Results, against: Against) -> Result<Option<String>> {
    let Some(first) = results.methods.first() else { return Ok(None) };
    let lines: Vec<Line> =
        lines(results, against, |entry| entry.ratio).skip(1).filter(|line| !line.points.is_empty()).collect();
    if lines.is_empty() {
        return Ok(None);
    }
    over_cost(&lines, against, &format!("trimmed relMSE over {first}"), Some(1.0)).map(Some)
}

/// Lines over cost on logarithmic axes, with a rule at the height `mark`.
fn over_cost(lines: &[Line], against: Against, what: &str, mark: Option<f64>) -> Result<String> {
    let solid = || lines.iter().flat_map(|line| &line.points);
    let dashed = || lines.iter().flat_map(|line| &line.dashed);
    let x = bounds(solid().map(|p| p.0).chain(dashed().map(|p| p.0)));
    let y = bounds(solid().flat_map(|p| [p.1.low, p.1.high]).chain(dashed().map(|p| p.1)).chain(mark));
    draw(SIZE, |area| {
        let mut chart =
            ChartBuilder::on(area).margin(14).x_label_area_size(40).y_label_area_size(70).build_cartesian_2d(
                (x.0..x.1).log_scale().with_key_points(ticks(x)),
                (y.0..y.1).log_scale().with_key_points(ticks(y)),
            )?;
        chart
            .configure_mesh()
            .x_desc(if against == Against::Seconds { "seconds" } else { "samples per pixel" })
            .y_desc(what)
            .x_label_formatter(&|v| short(*v))
            .y_label_formatter(&|v| short(*v))
            .light_line_style(BLACK.mix(0.05))
            .bold_line_style(BLACK.mix(0.15))
            .draw()?;
        if let Some(mark) = mark {
            chart.draw_series(LineSeries::new([(x.0, mark), (x.1, mark)], BLACK.stroke_width(1)))?;
        }
        for &Line { method, color, ref points, ref dashed } in lines {
            let low = points.iter().map(|p| (p.0, p.1.low));
            let band: Vec<(f64, f64)> = low.chain(points.iter().rev().map(|p| (p.0, p.1.high))).collect();
            chart.draw_series([Polygon::new(band, color.mix(0.18))])?;
            let line = points.iter().map(|p| (p.0, p.1.mean));
            chart
                .draw_series(LineSeries::new(line.clone(), color.stroke_width(2)))?
                .label(method)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], color.filled()));
            chart.draw_series(line.map(|p| Circle::new(p, 3, color.filled())))?;
            let line = dashed.iter().copied();
            chart.draw_series(DashedLineSeries::new(line.clone(), 6, 4, color.stroke_width(2)))?;
            chart.draw_series(line.map(|p| Circle::new(p, 3, color.stroke_width(1))))?;
        }
        let log = |v: f64, (low, high): (f64, f64)| (v / low).ln() / (high / low).ln();
        let unit = |p: (f64, f64)| [log(p.0, x), log(p.1, y)];
        let solid = lines.iter().map(|line| line.points.iter().map(|p| unit((p.0, p.1.mean))).collect());
        let dashed = lines.iter().map(|line| line.dashed.iter().map(|&p| unit(p)).collect());
        let drawn: Vec<Vec<[f64; 2]>> = solid.chain(dashed).collect();
        chart
            .configure_series_labels()
            .position(emptiest_corner(&drawn))
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK.mix(0.3))
            .draw()?;
        Ok(())
    })
}

/// The corner of the unit square with the least of `lines` in it, for a legend. Upper right where several are as empty.
pub fn emptiest_corner(lines: &[Vec<[f64; 2]>]) -> SeriesLabelPosition {
    use SeriesLabelPosition::{LowerLeft, LowerRight, UpperLeft, UpperRight};
    // Share of the plot that a legend of six methods covers, about.
    const PART: [f64; 2] = [0.25, 0.4];
    const STEPS: u32 = 16;
    let between = |pair: &[[f64; 2]]| {
        let (a, b) = (pair[0], pair[pair.len() - 1]);
        (0..=STEPS).map(move |i| f64::from(i) / f64::from(STEPS)).map(move |t| [0, 1].map(|k| a[k] + t * (b[k] - a[k])))
    };
    let points: Vec<[f64; 2]> = lines.iter().flat_map(|l| l.chunks(1).chain(l.windows(2))).flat_map(between).collect();
    let inside = |right: bool, upper: bool| {
        let within = |v: f64, part: f64, far: bool| if far { v > 1.0 - part } else { v < part };
        points.iter().filter(|p| within(p[0], PART[0], right) && within(p[1], PART[1], upper)).count()
    };
    let corners = [
        (UpperRight, inside(true, true)),
        (LowerLeft, inside(false, false)),
        (UpperLeft, inside(false, true)),
        (LowerRight, inside(true, false)),
    ];
    corners.into_iter().min_by_key(|corner| corner.1).map_or(UpperRight, |corner| corner.0)
}

/// Kinds of work in the order of their bars, with colours.
pub const KINDS: [(&str, RGBColor); 8] = [
    ("load", RGBColor(150, 150, 150)),
    ("build", RGBColor(100, 100, 100)),
    ("trace", RGBColor(0, 114, 178)),
    ("photons", RGBColor(230, 159, 0)),
    ("deposit", RGBColor(0, 158, 115)),
    ("reconstruct", RGBColor(204, 121, 167)),
    ("write", RGBColor(240, 228, 66)),
    ("other", RGBColor(220, 220, 220)),
];

/// Seconds of a run by [`KINDS`]; loading and building are the comparison's own, shared by its runs.
pub fn parts(results: &Results, entry: &SummaryEntry) -> [f64; 8] {
    let p = &entry.parts;
    let known = p.trace + p.photons + p.deposit + p.reconstruct;
    let (load, build) = (results.scene.load_seconds, results.scene.build_seconds);
    [load, build, p.trace, p.photons, p.deposit, p.reconstruct, p.write, (entry.seconds - known).max(0.0)]
}

/// Where the time of every method and budget goes, a bar each.
///
/// # Errors
/// As [`errors`].
pub fn times(results: &Results) -> Result<String> {
    let bars: Vec<(String, [f64; 8])> = results
        .summary
        .iter()
        .map(|s| (format!("{} {}", s.method, results.budgets[s.budget].label()), parts(results, s)))
        .collect();
    let longest = bars.iter().map(|b| b.1.iter().sum::<f64>()).fold(1e-3, f64::max);
    let rows = bars.len().max(1);
    // High enough for the legend, however few bars there are.
    draw((SIZE.0 * 3 / 2, (90 + 22 * rows as u32).max(230)), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(14)
            .x_label_area_size(40)
            .y_label_area_size(120)
            .build_cartesian_2d(0.0..longest * 1.25, 0.0..rows as f64)?;
        let label = |y: &f64| bars.get(rows.wrapping_sub(1 + *y as usize)).map_or(String::new(), |b| b.0.clone());
        chart.configure_mesh().disable_y_mesh().disable_y_axis().y_labels(0).x_desc("seconds").draw()?;
        for (kind, (name, color)) in KINDS.iter().enumerate() {
            let color = *color;
            let rectangles = bars.iter().enumerate().map(|(i, (_, parts))| {
                let start: f64 = parts[..kind].iter().sum();
                let y = (rows - 1 - i) as f64;
                Rectangle::new([(start, y + 0.15), (start + parts[kind], y + 0.85)], color.filled())
            });
            chart
                .draw_series(rectangles)?
                .label(*name)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], color.filled()));
        }
        for row in 0..rows {
            let y = row as f64 + 0.5;
            let style = ("sans-serif", 13).into_font().color(&BLACK);
            let at = chart.backend_coord(&(0.0, y));
            area.draw(&Text::new(label(&(row as f64)), (at.0 - 116, at.1 - 7), style))?;
        }
        chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

/// Draws onto white and returns the SVG text.
pub fn draw<F>(size: (u32, u32), content: F) -> Result<String>
where
    F: FnOnce(
        &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    ) -> std::result::Result<(), Box<dyn std::error::Error>>,
{
    let fail = |e: Box<dyn std::error::Error>| Error::Options(format!("a plot could not be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        area.fill(&WHITE).map_err(|e| fail(e.into()))?;
        content(&area).map_err(fail)?;
        area.present().map_err(|e| fail(e.into()))?;
    }
    Ok(svg)
}

/// A range around positive values with room on both sides.
fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) =
        values.filter(|v| *v > 0.0 && v.is_finite()).fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
    if low <= high { (low / 1.3, high * 1.3) } else { (0.1, 10.0) }
}

/// Round values on a logarithmic axis, few enough to read: powers of ten, and where those are few also 2 and 5 times them, or
/// all digits within less than an octave or so.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let between = |digits: &[f64]| -> Vec<f64> {
        let decades = low.log10().floor() as i32..=high.log10().floor() as i32;
        let all = decades.flat_map(|d| digits.iter().map(move |x| x * 10f64.powi(d)));
        all.filter(|v| (low..=high).contains(v)).collect()
    };
    let halves: Vec<f64> = (2..20).map(|i| 0.5 * f64::from(i)).collect();
    let tenths: Vec<f64> = (10..100).map(|i| 0.1 * f64::from(i)).collect();
    let choices = [&[1.0][..], &[1.0, 2.0, 5.0], &halves, &tenths].map(between);
    choices.iter().find(|t| t.len() >= 3).unwrap_or(&choices[3]).clone()
}

/// A number with as many digits as an axis needs.
fn short(value: f64) -> String {
    if (0.01..1e4).contains(&value) {
        return format!("{}", (value * 1e4).round() / 1e4);
    }
    format!("{value:.1e}").replace(".0e", "e")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_differ_where_ticks_do() {
        assert_eq!([2.1e5, 2e5, 1e-5, 0.05, 1.2e-3].map(short), ["2.1e5", "2e5", "1e-5", "0.05", "1.2e-3"]);
        for range in [(1.7e5, 2.4e5), (3.1e-4, 3.9e-4), (0.9, 1.3), (2e4, 9e6)] {
            let labels: Vec<String> = ticks(range).into_iter().map(short).collect();
            let distinct: std::collections::BTreeSet<&String> = labels.iter().collect();
            assert_eq!(distinct.len(), labels.len(), "{labels:?}");
        }
    }

    #[test]
    fn legends_keep_off_the_lines() {
        // Errors that fall with the seconds; a method that has more samples and more error than the others; one that does not fall.
        let falling = vec![[0.1, 0.9], [0.9, 0.1]];
        assert!(matches!(emptiest_corner(std::slice::from_ref(&falling)), SeriesLabelPosition::UpperRight));
        let plain = vec![[0.5, 1.0], [1.0, 0.8]];
        assert!(matches!(emptiest_corner(&[falling.clone(), plain]), SeriesLabelPosition::LowerLeft));
        assert!(matches!(
            emptiest_corner(&[falling, vec![[0.0, 0.0], [1.0, 0.9]]]),
            SeriesLabelPosition::UpperLeft | SeriesLabelPosition::LowerRight
        ));
        assert!(matches!(emptiest_corner(&[]), SeriesLabelPosition::UpperRight));
    }

    #[test]
    fn an_axis_of_any_length_has_labels() {
        assert_eq!(ticks((0.5, 2e3)), [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(ticks((3.0, 30.0)), [5.0, 10.0, 20.0]);
        for range in [(0.9, 1.3), (2.9, 4.1), (0.061, 0.12), (7e-5, 9e3)] {
            let ticks = ticks(range);
            assert!((3..20).contains(&ticks.len()), "{range:?}: {ticks:?}");
        }
    }
}
