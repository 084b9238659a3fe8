//! Lobes that hide two: where the samples of a lobe are spread unlike it, by their part of Pearson's χ², it becomes two along the axis of
//! their largest spread (Ruppert 2020 §5.3).

use super::MOST;
use super::columns::Block;
use super::component::{Component, Misfit, lobes, mean_cosine_limit};
use super::em::{Sample, divided};
use super::lobe::MOST_KAPPA;
use crate::math::Frame;

/// χ² of a lobe above which it is two.
const SPLIT: f64 = 0.75;
/// Fewest samples with light that such a lobe must have.
const LEAST: f64 = 8.0;

/// Adds samples of a chunk to the misfit of each lobe: those with light, whose weights times `unit` are their values, and the number of
/// all.
pub fn measure(all: &mut [Component], samples: &[Sample], unit: f64, number: usize) {
    let blocks = Block::of(&lobes(all));
    let frames: Vec<Frame> = all.iter().map(|of| Frame::new(of.mean.as_vec3())).collect();
    let mut parts: Vec<(usize, f64)> = Vec::with_capacity(MOST);
    all.iter_mut().for_each(|of| of.misfit.samples += number as f64);
    for sample in samples {
        parts.clear();
        let density = divided(&blocks, sample.direction, |k, part| parts.push((k, part)));
        let Some(density) = density else { continue };
        let value = sample.weight * unit;
        for &(k, part) in &parts {
            let Misfit { assigned, squares, values, spread, .. } = &mut all[k].misfit;
            *assigned += part;
            *squares += part * value * (value * f64::from(sample.pdf) / density);
            *values += part * value;
            // By the angle (the logarithmic map), so that what lies behind the lobe counts as far away.
            let local = frames[k].to_local(sample.direction).as_dvec3();
            let sine = local.x.hypot(local.y);
            let longer = if sine > 1e-6 { sine.atan2(local.z) / sine } else { 1.0 };
            let (x, y) = (local.x * longer, local.y * longer);
            for (sum, product) in spread.iter_mut().zip([x * x, y * y, x * y]) {
                *sum += part * value * product;
            }
        }
    }
}

/// Part of a lobe in ∫ (f − q)²/q dω for the light f that has the mean value `mean`, and the mixture q: as E[γ·(V/mean)²·p/q] − 2
/// E[γ·V/mean] + π.
fn misfit(of: &Component, mean: f64) -> f64 {
    let Misfit { samples, squares, values, .. } = of.misfit;
    if samples > 0.0 && mean > 0.0 {
        squares / (samples * mean * mean) - 2.0 * values / (samples * mean) + of.weight
    } else {
        0.0
    }
}

/// Splits lobes that fit badly, the worst first, as long as there is room. Returns the lobes that changed, a bit each.
pub fn split(all: &mut Vec<Component>, mean: f64) -> u32 {
    let mut bad: Vec<(f64, usize)> = all.iter().enumerate().map(|(k, of)| (misfit(of, mean), k)).collect();
    bad.retain(|(misfit, _)| *misfit > SPLIT);
    bad.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut changed = 0;
    for (_, k) in bad {
        if all.len() == MOST {
            break;
        }
        if let Some([one, other]) = halves(&all[k]) {
            changed |= 1 << k | 1 << all.len();
            all[k] = one;
            all.push(other);
        }
    }
    changed
}

/// The two lobes that a lobe becomes: half a standard deviation off, and as much narrower as keeps their mean; none where it is as narrow as
/// lobes may be, or has too few samples.
fn halves(of: &Component) -> Option<[Component; 2]> {
    let Misfit { assigned, values, spread, .. } = of.misfit;
    if assigned < LEAST || values <= 0.0 || of.kappa() >= 0.9 * MOST_KAPPA {
        return None;
    }
    let [xx, yy, xy] = spread.map(|sum| sum / values);
    let root = (0.5 * (xx - yy)).hypot(xy);
    let largest = 0.5 * (xx + yy) + root;
    // Of the two forms of the eigenvector the one without cancellation.
    let axis = if xx >= yy { [largest - yy, xy] } else { [xy, largest - xx] };
    let length = axis[0].hypot(axis[1]);
    let [x, y] = if length > 1e-12 { axis.map(|along| along / length) } else { [1.0, 0.0] };
    let (sin, cos) = (0.5 * largest.sqrt()).min(1.0).sin_cos();
    if sin.is_nan() || sin <= 1e-6 {
        return None;
    }
    let frame = Frame::new(of.mean.as_vec3());
    let [s, t] = [frame.s, frame.t].map(|along| along.as_dvec3());
    let half = |sign: f64| {
        let mean = (of.mean * cos + (s * x + t * y) * (sign * sin)).normalize_or(of.mean);
        let mean_cosine = (of.mean_cosine / cos).min(mean_cosine_limit());
        let mut half = Component { weight: 0.5 * of.weight, mean, mean_cosine, misfit: Misfit::default(), ..*of };
        half.past = of.past.scaled(0.5);
        half.past.direction = mean * (mean_cosine * half.past.count);
        half.nearness = of.nearness.map(|sum| 0.5 * sum);
        half
    };
    Some([half(1.0), half(-1.0)])
}
