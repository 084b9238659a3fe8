//! A Gaussian while it learns: its parameters, and the decaying means of its samples' moments.

use super::gaussian::{Gaussian, LEAST_DEVIATION, MOST_DEVIATION};

/// Prior of weights: samples that each Gaussian has beforehand.
const WEIGHT_PRIOR: f64 = 1.01;
/// Prior of covariances: samples beforehand, and their scatter along each axis.
const COVARIANCE_PRIOR: [f64; 2] = [2.01, 5e-4];
/// Variance of a Gaussian that no sample has shaped.
const FIRST_VARIANCE: f64 = 0.02;
/// Samples below which a Gaussian keeps its place and shape.
const LEAST_SAMPLES: f64 = 1e-3;

/// Numbers of a component in a file.
pub const NUMBERS: usize = 12;

/// A Gaussian while it learns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Weight π.
    pub weight: f64,
    /// Mean, its φ in [0, 1).
    pub mean: [f64; 2],
    /// Covariance: xx, xy, yy.
    pub covariance: [f64; 3],
    /// Means of γ·w times 1, x, y, x², xy, y² over samples of weight w, γ being the Gaussian's part of each; y is that of the image nearest to the
    /// Gaussian.
    sums: [f64; 6],
}

impl Component {
    /// A Gaussian around a place that no sample has shaped.
    pub fn at(weight: f64, mean: [f64; 2]) -> Self {
        Self { weight, mean, covariance: [FIRST_VARIANCE, 0.0, FIRST_VARIANCE], sums: [0.0; 6] }
    }

    /// The Gaussian as it is sampled.
    pub fn gaussian(&self) -> Gaussian {
        Gaussian::new(self.weight, self.mean, self.covariance)
    }

    /// Lets all samples so far count by a factor.
    pub fn fade(&mut self, factor: f64) {
        self.sums.iter_mut().for_each(|sum| *sum *= factor);
    }

    /// Adds a sample at a place with this weight.
    pub fn add(&mut self, [x, y]: [f64; 2], weight: f64) {
        let centre = self.mean[1] + self.covariance[1] / self.covariance[0] * (x - self.mean[0]);
        // The centre may have left [0, 1), and images of the place lie 1 apart.
        let y = y - (y - centre).round();
        for (sum, moment) in self.sums.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
            *sum += weight * moment;
        }
    }

    /// Moves it to a place, without samples.
    pub fn move_to(&mut self, place: [f64; 2]) {
        *self = Self::at(self.weight, place);
    }

    /// Sets its parameters to the most probable ones under conjugate priors (Vorba 2014): with n samples, of which it has n·W of mean weight 1,
    ///
    /// π ∝ v + n·W,    Σ = (b·I + n·S) / (a + n·W)
    ///
    /// where S is the scatter around its mean. `samples` is n, `unit` the mean weight.
    pub fn maximise(&mut self, samples: f64, unit: f64) {
        let [own, x, y, xx, xy, yy] = self.sums.map(|sum| sum * (samples / unit));
        self.weight = WEIGHT_PRIOR + own;
        if !(own > LEAST_SAMPLES && own.is_finite()) {
            return;
        }
        let mean = [x / own, y / own];
        let [count, scatter] = COVARIANCE_PRIOR;
        let scatter = [scatter + xx - x * mean[0], xy - x * mean[1], scatter + yy - y * mean[1]];
        let [xx, xy, yy] = scatter.map(|of| of / (count + own));
        let range = |variance: f64| variance.clamp(LEAST_DEVIATION.powi(2), MOST_DEVIATION.powi(2));
        let (xx, yy) = (range(xx), range(yy));
        // Rounding may take the determinant of a streak below 0.
        let most = 0.999_999 * (xx * yy).sqrt();
        self.mean = mean;
        self.covariance = [xx, xy.clamp(-most, most), yy];
        self.wrap();
    }

    /// Takes the mean back into the square.
    fn wrap(&mut self) {
        let turns = self.mean[1].floor();
        self.mean = [self.mean[0].clamp(0.0, 1.0), self.mean[1] - turns];
        let [own, x, y, _, xy, yy] = &mut self.sums;
        *yy += turns * (turns * *own - 2.0 * *y);
        *xy -= turns * *x;
        *y -= turns * *own;
    }

    /// Numbers for a file.
    pub fn numbers(&self) -> [f64; NUMBERS] {
        let ([x, y], [xx, xy, yy], [a, b, c, d, e, f]) = (self.mean, self.covariance, self.sums);
        [self.weight, x, y, xx, xy, yy, a, b, c, d, e, f]
    }

    /// The component of these numbers; none where they are out of range.
    pub fn from_numbers(numbers: &[f64; NUMBERS]) -> Option<Self> {
        let [weight, x, y, xx, xy, yy, a, b, c, d, e, f] = *numbers;
        let component = Self { weight, mean: [x, y], covariance: [xx, xy, yy], sums: [a, b, c, d, e, f] };
        let sound = numbers.iter().all(|number| number.abs() < 1e150)
            && (0.0..=1.0 + 1e-9).contains(&weight)
            && component.mean.iter().all(|of| (0.0..=1.0).contains(of))
            && [xx, yy].iter().all(|of| (1e-7..=1.0).contains(of))
            && xy * xy <= xx * yy
            && [a, d].iter().all(|of| *of >= 0.0);
        sound.then_some(component)
    }
}
