//! Fraction of BSDF samples learned by gradient descent, as Müller 2019 does, to compare with.

/// The logit of a fraction, learned by Adam (Kingma and Ba 2015) on the KL divergence of the mixture from the integrand (Müller
/// 2019 §10.5).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Adam {
    logit: f64,
    mean: f64,
    square: f64,
    steps: i32,
}

/// Step size and decay of both moments, as Müller has them.
const RATE: f64 = 0.01;
const DECAY: [f64; 2] = [0.9, 0.999];
/// Pull of the logit towards one half (Müller 2019 §10.5 regularises it by 0.01 in the unit of radiance), in units of the gradient's root mean
/// square, so that the brightness of a scene does not matter.
const PULL: f64 = 0.01;
/// Bound of the logit: fractions stay within [0.1, 0.9], so that no sample is worth more than ten times the better strategy's.
const LOGIT: f64 = 2.197_224_577_336_219_6;

impl Adam {
    /// State as numbers: logit, both moments, steps.
    pub(super) fn numbers(&self) -> [f64; 4] {
        [self.logit, self.mean, self.square, f64::from(self.steps)]
    }

    /// The state with these [`Adam::numbers`].
    pub(super) fn from_numbers([logit, mean, square, steps]: [f64; 4]) -> Self {
        Self { logit: logit.clamp(-LOGIT, LOGIT), mean, square, steps: steps.max(0.0) as i32 }
    }

    /// The fraction of BSDF samples, in [0.1, 0.9].
    pub fn fraction(&self) -> f64 {
        1.0 / (1.0 + (-self.logit).exp())
    }

    /// Root mean square of the gradients so far.
    fn spread(&self) -> f64 {
        if self.steps == 0 { 0.0 } else { (self.square / (1.0 - DECAY[1].powi(self.steps))).sqrt() }
    }

    /// One step by a sample with this estimate f·L/p, drawn with a fraction `alpha` of BSDF samples, where the BSDF had
    /// `bsdf_share` of the density. The unit of the estimate does not matter.
    pub fn step(&mut self, estimate: f64, bsdf_share: f64, alpha: f64) {
        let (bsdf, guide) = (bsdf_share / alpha, (1.0 - bsdf_share) / (1.0 - alpha));
        let fraction = self.fraction();
        let mixture = fraction * bsdf + (1.0 - fraction) * guide;
        let gradient =
            -estimate * (bsdf - guide) / mixture * fraction * (1.0 - fraction) + PULL * self.logit * self.spread();
        if !gradient.is_finite() {
            return;
        }
        self.steps = self.steps.saturating_add(1);
        self.mean += (1.0 - DECAY[0]) * (gradient - self.mean);
        self.square += (1.0 - DECAY[1]) * (gradient * gradient - self.square);
        let [mean, square] =
            [(self.mean, DECAY[0]), (self.square, DECAY[1])].map(|(m, d)| m / (1.0 - d.powi(self.steps)));
        if square > 0.0 {
            self.logit = (self.logit - RATE * mean / square.sqrt()).clamp(-LOGIT, LOGIT);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// An integrand over [0, 1), `bright` in the first tenth and 1 elsewhere; the BSDF is uniform, the guide has nine tenths there.
    fn learned(bright: f64, unit: f64) -> f64 {
        let mut random = Random::new(3, 0, 0);
        let mut adam = Adam::default();
        for _ in 0..20_000 {
            let tenth = random.next_f64() < 0.5 * 0.1 + 0.5 * 0.9;
            let guide = if tenth { 9.0 } else { 1.0 / 9.0 };
            let p = 0.5 + 0.5 * guide;
            adam.step(unit * if tenth { bright } else { 1.0 } / p, 0.5 / p, 0.5);
        }
        adam.fraction()
    }

    #[test]
    fn the_better_strategy_is_learned() {
        assert!(learned(1.0, 1.0) > 0.85, "the integrand is the BSDF's");
        assert!(learned(81.0, 1.0) < 0.15, "the integrand is the guide's");
        // Between them: 0.1·b/(0.1·b + 0.9) of the integrand is in the tenth, and the best mixture has as much there.
        let between = learned(9.0, 1.0);
        assert!((between - 0.5).abs() < 0.1, "{between}");
        for unit in [1e-20, 1e20] {
            assert!((learned(9.0, unit) - between).abs() < 1e-6, "{unit}");
        }
    }

    #[test]
    fn a14_bad_samples_change_nothing() {
        let mut adam = Adam::default();
        adam.step(f64::NAN, 0.5, 0.5);
        adam.step(f64::INFINITY, 1.0, 0.5);
        adam.step(0.0, 1.0, 0.5);
        assert_eq!(adam.fraction(), 0.5);
    }
}
