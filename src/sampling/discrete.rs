//! Sampling of finite sets by weight.

/// A probability distribution over the indices 0..n.
#[derive(Debug, Clone, Default)]
pub struct Discrete {
    /// Cumulative weights, normalised; `cdf[i]` is the probability of an index ≤ i.
    cdf: Vec<f64>,
    total: f64,
}

impl Discrete {
    /// From non-negative weights. Where all are zero, the distribution is uniform.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut cdf: Vec<f64> = weights.into_iter().map(|w| if w.is_finite() { w.max(0.0) } else { 0.0 }).collect();
        let total: f64 = cdf.iter().sum();
        if total <= 0.0 {
            cdf.fill(1.0);
        }
        let mut sum = 0.0;
        for w in &mut cdf {
            sum += *w;
            *w = sum;
        }
        for w in &mut cdf {
            *w /= sum;
        }
        Self { cdf, total }
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
    pub fn probability(&self, i: usize) -> f64 {
        self.cdf[i] - if i == 0 { 0.0 } else { self.cdf[i - 1] }
    }

    /// The index that `u` in [0, 1) selects, and `u` stretched to [0, 1) inside it. Needs at least one index.
    #[inline]
    pub fn sample(&self, u: f64) -> (usize, f64) {
        // A few are counted faster than searched: no branch depends on `u`.
        let below = match self.cdf.len() {
            0..=8 => self.cdf.iter().filter(|&&c| c <= u).count(),
            _ => self.cdf.partition_point(|&c| c <= u),
        };
        let i = below.min(self.cdf.len() - 1);
        let low = if i == 0 { 0.0 } else { self.cdf[i - 1] };
        let width = self.cdf[i] - low;
        let inside = if width > 0.0 { (u - low) / width } else { 0.5 };
        (i, inside.clamp(0.0, 1.0 - f64::EPSILON))
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
