//! From runs to summaries: geometric means over seeds, bootstrap intervals, time to reach an error.

use super::results::{
    DenoisedEntry, DenoisedSummary, Errors, Interval, Parts, Reach, RunEntry, SummaryEntry, TargetEntry,
};
use crate::base::random::Random;

/// Bootstrap resamples.
const RESAMPLES: usize = 4000;
/// Errors are taken as at least this, so that one that came out negative after subtracting the reference's variance still has
/// a logarithm.
const LEAST: f64 = 1e-9;

/// Geometric mean (that of logarithms) with its 95 % percentile bootstrap interval (Efron and Tibshirani 1993, §13.3), fixed seed.
pub fn geometric(values: &[f64]) -> Interval {
    let logs: Vec<f64> = values.iter().map(|v| v.max(LEAST).ln()).collect();
    let n = logs.len().max(1) as u32;
    let mut random = Random::new(1, 2, 3);
    let mut mean = || (0..n).map(|_| logs[random.below(n) as usize]).sum::<f64>() / f64::from(n);
    if logs.is_empty() {
        return Interval { mean: f64::NAN, low: f64::NAN, high: f64::NAN };
    }
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| mean()).collect();
    means.sort_by(f64::total_cmp);
    let center = logs.iter().sum::<f64>() / f64::from(n);
    let [low, high] = [RESAMPLES / 40, RESAMPLES - 1 - RESAMPLES / 40].map(|i| means[i].exp());
    Interval { mean: center.exp(), low, high }
}

/// The median; NaN of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

/// One entry per method and budget that has runs; the first method is what ratios refer to.
pub fn summarise(methods: &[String], budgets: usize, runs: &[RunEntry]) -> Vec<SummaryEntry> {
    let of = |method: &str, budget: usize| -> Vec<&RunEntry> {
        runs.iter().filter(|r| r.method == method && r.budget == budget).collect()
    };
    let mut entries = Vec::new();
    for budget in 0..budgets {
        let Some(first) = methods.first().map(|m| of(m, budget)) else { continue };
        for method in methods {
            let runs = of(method, budget);
            if runs.is_empty() {
                continue;
            }
            let error = |pick: fn(&Errors) -> f64| geometric(&runs.iter().map(|r| pick(&r.errors)).collect::<Vec<_>>());
            let part = |pick: fn(&Parts) -> f64| median(runs.iter().map(|r| pick(&r.parts)));
            let partner = |run: &RunEntry| first.iter().find(|f| f.seed == run.seed).map(|f| f.errors.relmse_trimmed);
            let ratios: Vec<f64> =
                runs.iter().filter_map(|r| Some(r.errors.relmse_trimmed.max(LEAST) / partner(r)?.max(LEAST))).collect();
            let cpu: Option<Vec<f64>> = runs.iter().map(|r| r.cpu_seconds).collect();
            entries.push(SummaryEntry {
                method: method.clone(),
                budget,
                spp: median(runs.iter().map(|r| f64::from(r.spp))),
                seconds: median(runs.iter().map(|r| r.seconds)),
                cpu_seconds: cpu.map(median),
                parts: Parts {
                    trace: part(|p| p.trace),
                    photons: part(|p| p.photons),
                    deposit: part(|p| p.deposit),
                    reconstruct: part(|p| p.reconstruct),
                    write: part(|p| p.write),
                },
                relmse: error(|e| e.relmse),
                relmse_trimmed: error(|e| e.relmse_trimmed),
                relmse_ldr: error(|e| e.relmse_ldr),
                ratio: (!ratios.is_empty()).then(|| geometric(&ratios)),
                denoised: denoised(&runs),
            });
        }
    }
    entries
}

/// Summary of the runs' denoised pictures; none unless all have one.
fn denoised(runs: &[&RunEntry]) -> Option<DenoisedSummary> {
    let entries: Vec<DenoisedEntry> = runs.iter().map(|run| run.denoised).collect::<Option<_>>()?;
    let error =
        |pick: fn(&Errors) -> f64| geometric(&entries.iter().map(|entry| pick(&entry.errors)).collect::<Vec<_>>());
    Some(DenoisedSummary {
        seconds: median(runs.iter().zip(&entries).map(|(run, entry)| run.seconds + entry.seconds)),
        relmse: error(|e| e.relmse),
        relmse_trimmed: error(|e| e.relmse_trimmed),
        relmse_ldr: error(|e| e.relmse_ldr),
    })
}

/// Time when a curve of (seconds, error) falls to `error` for good: interpolated between the points in logarithms.
pub fn reach(curve: &[(f64, f64)], error: f64) -> Reach {
    let mut curve = curve.to_vec();
    curve.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The last point above the error decides; a dip before it was luck.
    match curve.iter().rposition(|p| p.1 > error) {
        None => curve.first().map_or(Reach::Never, |p| Reach::Before(p.0)),
        Some(last) if last + 1 == curve.len() => Reach::Never,
        Some(i) => {
            let [(t0, e0), (t1, e1)] = [curve[i], curve[i + 1]];
            let [e0, e1, e] = [e0, e1, error].map(|e| e.max(LEAST).ln());
            let share = if e0 > e1 { (e0 - e) / (e0 - e1) } else { 1.0 };
            Reach::At((t0.max(LEAST).ln() * (1.0 - share) + t1.max(LEAST).ln() * share).exp())
        }
    }
}

/// Round errors (1, 2 and 5 times powers of ten) within what was measured, largest first, and when each method reaches them.
pub fn times_to_reach(methods: &[String], summary: &[SummaryEntry]) -> Vec<TargetEntry> {
    let errors = || summary.iter().map(|s| s.relmse_trimmed.mean).filter(|e| *e > 0.0);
    let (low, high) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) {
        return vec![];
    }
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let mut targets: Vec<f64> = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(d))).collect();
    targets.retain(|e| (low..=high).contains(e));
    targets.reverse();
    let curve = |method: &String| -> Vec<(f64, f64)> {
        summary.iter().filter(|s| s.method == *method).map(|s| (s.seconds, s.relmse_trimmed.mean)).collect()
    };
    let entry = |error| TargetEntry { error, methods: methods.iter().map(|m| reach(&curve(m), error)).collect() };
    targets.into_iter().map(entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_reached_where_the_curve_stays_below() {
        let curve = [(1.0, 1.0), (4.0, 0.25), (16.0, 0.0625)];
        assert_eq!(reach(&curve, 2.0), Reach::Before(1.0));
        assert_eq!(reach(&curve, 0.01), Reach::Never);
        let Reach::At(t) = reach(&curve, 0.125) else { panic!("between the last two") };
        assert!((t - 8.0).abs() < 1e-9, "1/t in logarithms: {t}");
        assert_eq!(reach(&[(1.0, 0.1), (2.0, 0.3)], 0.2), Reach::Never, "a lucky first run");
        assert_eq!(reach(&[], 0.2), Reach::Never);
    }

    #[test]
    fn intervals_hold_their_mean() {
        let i = geometric(&[1.0, 2.0, 4.0, 8.0]);
        assert!((i.mean - 8f64.sqrt()).abs() < 1e-12 && i.low < i.mean && i.mean < i.high);
        let same = geometric(&[3.0; 5]);
        assert!((same.low - 3.0).abs() < 1e-12 && (same.high - 3.0).abs() < 1e-12);
        assert!(geometric(&[-1.0, 1.0]).mean > 0.0);
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([1.0, 2.0]), 1.5);
    }
}
