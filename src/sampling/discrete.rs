//! Sampling of finite sets in proportion to weights.

use std::ops::Range;

use super::cutpoints;

/// A probability distribution over the indices 0..n.
#[derive(Debug, Clone, Default)]
pub struct Discrete {
    /// Cumulative weights, normalised; `cdf[i]` is the probability of an index ≤ i.
    cdf: Vec<f64>,
    /// Table of [`cutpoints`] for `cdf`.
    table: Vec<u32>,
    total: f64,
}

/// Makes non-negative weights cumulative and normalised, and returns their sum. Weights that are not finite count as 0; where all
/// are zero, the distribution is uniform.
pub fn accumulate(weights: &mut [f64]) -> f64 {
    for w in weights.iter_mut() {
        *w = if w.is_finite() { w.max(0.0) } else { 0.0 };
    }
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        weights.fill(1.0);
    }
    let mut sum = 0.0;
    for w in weights.iter_mut() {
        sum += *w;
        *w = sum;
    }
    for w in weights.iter_mut() {
        *w /= sum;
    }
    total
}

/// Cumulative weights before index `i`: 0 before the first, without a branch that no processor could predict.
#[inline(always)]
fn before(cdf: &[f64], i: usize) -> f64 {
    cdf[i.saturating_sub(1)] * f64::from(u8::from(i > 0))
}

/// Probability of index `i` under cumulative weights.
#[inline(always)]
pub fn probability(cdf: &[f64], i: usize) -> f64 {
    cdf[i] - before(cdf, i)
}

/// The index that `u` in [0, 1) selects among cumulative weights with their table of [`cutpoints`], and `u` rescaled to [0, 1)
/// within it. Needs at least one index.
#[inline(always)]
pub fn sample(cdf: &[f64], table: &[u32], u: f64) -> (usize, f64) {
    let i = cutpoints::find(cdf, table, u);
    let low = before(cdf, i);
    let width = cdf[i] - low;
    let inside = if width > 0.0 { (u - low) / width } else { 0.5 };
    (i, inside.clamp(0.0, 1.0 - f64::EPSILON))
}

/// Longest range that is searched by counting, without branches.
const COUNTED: usize = 64;

/// [`sample`] of the indices of a range alone, which is not empty: found without a table, as ranges are short.
#[inline(always)]
pub fn sample_within(cdf: &[f64], range: Range<usize>, u: f64) -> (usize, f64) {
    let (begin, last) = (before(cdf, range.start), range.end - 1);
    let u = begin + u * (cdf[last] - begin);
    let within = last - range.start;
    let below = match within {
        0..=COUNTED => count(&cdf[range.start..], within, u),
        _ => cdf[range.start..last].partition_point(|&c| c <= u),
    };
    let i = range.start + below;
    let low = before(cdf, i);
    let width = cdf[i] - low;
    let inside = if width > 0.0 { (u - low) / width } else { 0.5 };
    (i, inside.clamp(0.0, 1.0 - f64::EPSILON))
}

/// How many of the first `among` cumulative weights are at most `u`, in whole vectors: those behind are no smaller than the last that
/// counts.
#[inline(always)]
fn count(cdf: &[f64], among: usize, u: f64) -> usize {
    const TOGETHER: usize = 8;
    let (whole, rest) = cdf.as_chunks::<TOGETHER>();
    let mut counts = [0u64; TOGETHER];
    for eight in whole.iter().take(among.div_ceil(TOGETHER)) {
        for (count, c) in counts.iter_mut().zip(eight) {
            *count += u64::from(*c <= u);
        }
    }
    let found: u64 = counts.iter().sum();
    let behind = if among > TOGETHER * whole.len() { rest } else { &[] };
    (found as usize + behind.iter().filter(|&&c| c <= u).count()).min(among)
}

impl Discrete {
    /// A distribution from non-negative weights; uniform where all are zero.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut cdf: Vec<f64> = weights.into_iter().collect();
        let total = accumulate(&mut cdf);
        let mut table = vec![0; cutpoints::table_len(cdf.len())];
        cutpoints::fill(&cdf, &mut table);
        Self { cdf, table, total }
    }

    /// Number of indices.
    pub fn len(&self) -> usize {
        self.cdf.len()
    }

    /// Whether there is nothing to sample.
    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// Sum of the weights given.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Probability of index `i`.
    #[inline(always)]
    pub fn probability(&self, i: usize) -> f64 {
        probability(&self.cdf, i)
    }

    /// [`Discrete::sample`] of the indices of a range alone, which is not empty.
    #[inline(always)]
    pub fn sample_within(&self, range: Range<usize>, u: f64) -> (usize, f64) {
        sample_within(&self.cdf, range, u)
    }

    /// The index that `u` in [0, 1) selects, and `u` rescaled to [0, 1) within it. Needs at least one index.
    #[inline(always)]
    pub fn sample(&self, u: f64) -> (usize, f64) {
        sample(&self.cdf, &self.table, u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_weights_are_never_chosen() {
        let d = Discrete::new([0.0, 1.0, 0.0, 3.0, 0.0]);
        for i in 0..1000 {
            let (index, inside) = d.sample(i as f64 / 1000.0);
            assert!(index == 1 || index == 3);
            assert!((0.0..1.0).contains(&inside));
        }
        assert_eq!(d.probability(1), 0.25);
        assert_eq!(d.sample(0.25).0, 3);
    }

    #[test]
    fn all_zero_is_uniform() {
        let d = Discrete::new([0.0; 4]);
        assert_eq!(d.probability(2), 0.25);
        assert_eq!(d.total(), 0.0);
    }
}
