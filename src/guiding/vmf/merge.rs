//! Lobes that are one: two lobes become one where the χ² between both and that one is small (Ruppert 2020 §5.4).

use glam::DVec3;

use super::component::{Component, Misfit, mean_cosine_limit};
use super::lobe::{concentration, log_integral, peak};

/// χ² below which two lobes are one.
const MERGE: f64 = 0.00625;

/// A lobe of a pair, or the one that they become.
#[derive(Clone, Copy)]
struct Plain {
    weight: f64,
    mean: DVec3,
    kappa: f64,
}

impl Plain {
    fn of(component: &Component) -> Self {
        Self { weight: component.weight, mean: component.mean, kappa: component.kappa() }
    }
}

/// Weight, mean direction and mean cosine of two lobes as one.
fn joined(a: &Component, b: &Component) -> (f64, DVec3, f64) {
    let weight = a.weight + b.weight;
    let mean = (a.mean * (a.weight * a.mean_cosine) + b.mean * (b.weight * b.mean_cosine)) / weight;
    (weight, mean.normalize_or(a.mean), mean.length().min(mean_cosine_limit()))
}

/// Natural logarithm of ∫ a·b/v dω.
fn log_ratio(a: Plain, b: Plain, v: Plain) -> f64 {
    let exponent = a.mean * a.kappa + b.mean * b.kappa - v.mean * v.kappa;
    (peak(a.kappa) * peak(b.kappa) / peak(v.kappa)).ln() - a.kappa - b.kappa + v.kappa + log_integral(exponent.length())
}

/// ∫ (π_a·a + π_b·b − π·v)²/(π·v) dω for the lobe v that a and b become.
fn cost(a: &Component, b: &Component) -> f64 {
    let (weight, mean, mean_cosine) = joined(a, b);
    let v = Plain { weight, mean, kappa: concentration(mean_cosine) };
    let (a, b) = (Plain::of(a), Plain::of(b));
    let part = |a: Plain, b: Plain| a.weight * b.weight / v.weight * log_ratio(a, b, v).exp();
    part(a, a) + part(b, b) + 2.0 * part(a, b) - v.weight
}

/// The pair of lobes of least cost below the limit, of those that samples have been measured for.
fn twins(all: &[Component]) -> Option<(usize, usize)> {
    let mut least = (MERGE, None);
    let measured = |k: usize| all[k].misfit.samples > 0.0;
    for a in (0..all.len()).filter(|&a| measured(a)) {
        for b in (a + 1..all.len()).filter(|&b| measured(b)) {
            let cost = cost(&all[a], &all[b]);
            if cost < least.0 {
                least = (cost, Some((a, b)));
            }
        }
    }
    least.1
}

/// Merges lobes as long as there are two that are one.
pub fn merge(all: &mut Vec<Component>) {
    while let Some((a, b)) = twins(all) {
        let other = all.remove(b);
        let one = &mut all[a];
        let (weight, mean, mean_cosine) = joined(one, &other);
        let past = one.past.with(other.past);
        let nearness = [0, 1].map(|i| one.nearness[i] + other.nearness[i]);
        *one = Component { weight, mean, mean_cosine, past, nearness, misfit: Misfit::default() };
    }
}
