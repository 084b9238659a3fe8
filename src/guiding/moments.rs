//! Measured second moments of the estimator under several mixtures of two strategies, by which a voxel's best one is chosen.
//!
//! A sample f/p that was drawn from the mixture p also tells what any other mixture p' of the same two strategies would have cost:
//! the mean of (f/p)²·p/p' is the second moment ∫f²/p' of one sample under p'. All candidates are judged by the same samples, so
//! that fireflies hit all of them alike.

/// Fractions α of BSDF samples that are tried.
pub const FRACTIONS: [f64; 8] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0];
/// Weights of the tree of path samples that are tried, the rest being that of photons.
pub const PATH_SHARES: [f64; 6] = [0.1, 0.3, 0.5, 0.7, 0.9, 1.0];

/// Largest second moment of a candidate, relative to the simplest one (the last), with which it is chosen: guiding costs time.
const WORTH: f64 = 0.95;
/// Number of samples below which nothing is decided.
const LEAST_SAMPLES: f64 = 24.0;
/// Effective number of samples (Kish) below which nothing is decided: the few paths that found the light so far are no reason to
/// give up the guide that leads to it.
const LEAST_EFFECTIVE: f64 = 8.0;

/// Means of `N` quantities over samples. Mostly second moments under `N` candidates, the last of which is the simplest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments<const N: usize> {
    sums: [f64; N],
    /// Sum over the samples of their squared mean over the candidates.
    squares: f64,
    samples: f64,
}

/// Second moments of the contributions of vertices to the picture, summed over all vertices of the paths of an iteration.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PictureMoments {
    /// Second moment with the fraction of BSDF samples that was used while learning.
    pub learning: f64,
    /// Second moment with the fractions of BSDF samples found best.
    pub guided: f64,
    /// Second moment with BSDF samples alone.
    pub unguided: f64,
    /// Part of `learning` that guided directions bring, without light sampling.
    pub onward: f64,
    /// Effective number of samples behind `onward`, see [`Moments::effective`].
    pub effective: f64,
    /// Share of the light by photons, as far as it shows in the picture, that fell into voxels where no path has found any yet: the
    /// effect of guiding there is not known.
    pub unseen: f64,
}

impl<const N: usize> Default for Moments<N> {
    fn default() -> Self {
        Self { sums: [0.0; N], squares: 0.0, samples: 0.0 }
    }
}

impl<const N: usize> Moments<N> {
    /// Adds one sample of the `N` quantities.
    pub fn add(&mut self, moments: [f64; N]) {
        let squares = (moments.iter().sum::<f64>() / N as f64).powi(2);
        self.add_all(&Self { sums: moments, squares, samples: 1.0 }, 1.0);
    }

    /// Removes a sample that [`Moments::add`] added, as far as rounding allows.
    pub fn remove(&mut self, moments: [f64; N]) {
        let mut added = Self::default();
        added.add(moments);
        self.sums.iter_mut().zip(moments).for_each(|(sum, m)| *sum = (*sum - m).max(0.0));
        self.squares = (self.squares - added.squares).max(0.0);
        self.samples -= added.samples;
    }

    /// Adds the sums of another, weighted by `weight`, unless one is not finite.
    fn add_all(&mut self, other: &Self, weight: f64) {
        if other.sums.iter().all(|m| m.is_finite()) && other.squares.is_finite() {
            self.sums.iter_mut().zip(other.sums).for_each(|(sum, m)| *sum += weight * m);
            self.squares += weight * other.squares;
            self.samples += weight * other.samples;
        }
    }

    /// Kish's effective sample size: the number of equal samples that tell as much, small where most comes from a few fireflies.
    pub fn effective(&self) -> f64 {
        let mean = self.sums.iter().sum::<f64>() / N as f64;
        if self.squares > 0.0 { mean * mean / self.squares } else { 0.0 }
    }

    /// Adds the sums of other voxels, scaled down to the weight of at most `samples` samples.
    pub fn add_prior(&mut self, prior: &Self, samples: f64) {
        if prior.samples > 0.0 {
            self.add_all(prior, (samples / prior.samples).min(1.0));
        }
    }

    /// What is left of sums over several voxels without those of one of them.
    pub fn without(&self, part: &Self) -> Self {
        let rest = |all: f64, part: f64| (all - part).max(0.0);
        Self {
            sums: std::array::from_fn(|i| rest(self.sums[i], part.sums[i])),
            squares: rest(self.squares, part.squares),
            samples: rest(self.samples, part.samples),
        }
    }

    /// Adds the sums of another.
    pub fn merge(&mut self, other: &Self) {
        self.add_all(other, 1.0);
    }

    /// Appends its numbers, for [`Moments::pull_from`].
    pub(super) fn push_to(&self, numbers: &mut Vec<f64>) {
        numbers.extend(self.sums);
        numbers.extend([self.squares, self.samples]);
    }

    /// Reads the moments whose numbers come next.
    pub(super) fn pull_from(next: &mut impl FnMut() -> f64) -> Self {
        Self { sums: [0; N].map(|_| next()), squares: next(), samples: next() }
    }

    /// Number of samples.
    pub fn samples(&self) -> f64 {
        self.samples
    }

    /// Sums over the samples.
    pub fn sums(&self) -> [f64; N] {
        self.sums
    }

    /// Means over the samples; none where these are too few.
    pub fn means(&self) -> Option<[f64; N]> {
        (self.samples >= LEAST_SAMPLES).then(|| self.sums.map(|sum| sum / self.samples))
    }

    /// The candidate with the least moment; none where too few samples tell, see [`Moments::effective`].
    pub fn least(&self, effective: f64) -> Option<usize> {
        let least = (0..N).min_by(|&a, &b| self.sums[a].total_cmp(&self.sums[b]))?;
        (self.samples >= LEAST_SAMPLES && self.effective() >= effective && self.sums[least] > 0.0).then_some(least)
    }

    /// The best candidate, the simplest where no other is much better; none where too little is known.
    pub fn best(&self) -> Option<usize> {
        let least = self.least(LEAST_EFFECTIVE)?;
        Some(if self.sums[least] > WORTH * self.sums[N - 1] { N - 1 } else { least })
    }

    /// Second moment of the best candidate relative to the simplest, in (0, 1]; 1 where too little is known.
    pub fn gain(&self) -> f64 {
        self.best().map_or(1.0, |best| self.sums[best] / self.sums[N - 1])
    }
}

impl Moments<{ FRACTIONS.len() }> {
    /// Second moments under a fraction `used`, under `chosen` and under BSDF samples alone, relative to that under `used`; none where
    /// too little is known. Between the [`FRACTIONS`] they are interpolated.
    pub fn relative(&self, used: f64, chosen: f64) -> Option<[f64; 3]> {
        let under = self.at(used);
        (under > 0.0 && self.samples >= LEAST_SAMPLES).then(|| [used, chosen, 1.0].map(|of| self.at(of) / under))
    }

    /// Sum under any fraction.
    fn at(&self, fraction: f64) -> f64 {
        let above = FRACTIONS.partition_point(|&of| of < fraction).clamp(1, FRACTIONS.len() - 1);
        let [low, high] = [FRACTIONS[above - 1], FRACTIONS[above]];
        let part = ((fraction - low) / (high - low)).clamp(0.0, 1.0);
        (1.0 - part) * self.sums[above - 1] + part * self.sums[above]
    }

    /// Adds a vertex whose direction was drawn with a fraction `alpha` in (0, 1) of BSDF samples.
    pub fn add_estimates(&mut self, estimates: &[Estimate], alpha: f64) {
        self.add(candidates(estimates, alpha));
    }

    /// Removes a vertex that [`Moments::add_estimates`] added.
    pub fn remove_estimates(&mut self, estimates: &[Estimate], alpha: f64) {
        self.remove(candidates(estimates, alpha));
    }
}

/// A vertex's estimate of the second moment under each of the [`FRACTIONS`].
fn candidates(estimates: &[Estimate], alpha: f64) -> [f64; FRACTIONS.len()] {
    FRACTIONS.map(|a| estimates.iter().map(|estimate| estimate.under(a, alpha)).sum())
}

/// A sample of light sampling, or of the mixture of BSDF and guide, weighted by the balance heuristic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Square of the weighted f/p.
    pub square: f64,
    /// Part of the mixture density that is the BSDF's, in [0, 1].
    pub bsdf_share: f32,
    /// Density of light sampling over that of the mixture; 0 for light that it cannot find, ∞ for light that only it finds.
    pub light_ratio: f32,
}

impl Estimate {
    /// Estimate of the second moment under a fraction `other` of BSDF samples, from this sample, which was drawn with `alpha`.
    fn under(&self, other: f64, alpha: f64) -> f64 {
        let share = f64::from(self.bsdf_share);
        self.with_mixture(other * share / alpha + (1.0 - other) * (1.0 - share) / (1.0 - alpha))
    }

    /// Estimate of the second moment under a guide with `ratio` times the density of the guide that was sampled.
    pub fn with_guide(&self, ratio: f64) -> f64 {
        let share = f64::from(self.bsdf_share);
        self.with_mixture(share + (1.0 - share) * ratio)
    }

    /// Estimate of the second moment under a mixture with `mixture` times the density of the sampled one. Both strategies together
    /// have the second moment ∫f²/(p + p_l), p_l being the density of light sampling, and their samples the density p + p_l.
    fn with_mixture(&self, mixture: f64) -> f64 {
        // Most samples brought nothing by most of the ways.
        if self.square == 0.0 {
            return 0.0;
        }
        let (mixture, light) = (mixture.max(1e-6), f64::from(self.light_ratio));
        if light.is_finite() { self.square * ((1.0 + light) / (mixture + light)) } else { self.square }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// An integrand over [0, 1): `bright` in the first tenth, 1 elsewhere; the BSDF is uniform, the guide knows the tenth.
    fn measured(bright: f32, alpha: f64) -> Moments<8> {
        let mut random = Random::new(9, 0, 0);
        let mut moments = Moments::default();
        for _ in 0..20_000 {
            let tenth = f64::from(random.next_f32()) < alpha * 0.1 + (1.0 - alpha) * 0.9;
            let guide = if tenth { 9.0 } else { 1.0 / 9.0 };
            let p = alpha + (1.0 - alpha) * guide;
            let f = if tenth { bright } else { 1.0 };
            let estimate =
                Estimate { square: (f64::from(f) / p).powi(2), bsdf_share: (alpha / p) as f32, light_ratio: 0.0 };
            moments.add_estimates(&[estimate], alpha);
        }
        moments
    }

    fn exact(bright: f64, a: f64) -> f64 {
        0.1 * bright * bright / (a + (1.0 - a) * 9.0) + 0.9 / (a + (1.0 - a) / 9.0)
    }

    #[test]
    fn measured_moments_are_the_true_ones_whatever_drew_the_samples() {
        for alpha in [0.3, 0.5, 0.7] {
            for bright in [1.0f32, 9.0, 81.0] {
                let moments = measured(bright, alpha);
                for (sum, &a) in moments.sums.iter().zip(&FRACTIONS) {
                    let expected = exact(f64::from(bright), a);
                    let found = sum / moments.samples;
                    // Five standard errors and more of 20,000 samples.
                    assert!((found / expected - 1.0).abs() < 0.06, "{alpha} {bright} {a}: {found} {expected}");
                }
            }
        }
    }

    /// The same with light sampling, which always draws from the tenth.
    #[test]
    fn light_sampling_is_part_of_the_estimator() {
        let (bright, alpha, light) = (81.0, 0.5, 10.0);
        let densities = |tenth: bool| (if tenth { 9.0 } else { 1.0 / 9.0 }, if tenth { light } else { 0.0 });
        let mut random = Random::new(10, 0, 0);
        let mut moments = Moments::default();
        for _ in 0..20_000 {
            let estimate = |tenth: bool| {
                let (guide, light) = densities(tenth);
                let p = alpha + (1.0 - alpha) * guide;
                let f = if tenth { bright } else { 1.0 };
                let (bsdf_share, light_ratio) = ((alpha / p) as f32, (light / p) as f32);
                Estimate { square: f64::powi(f / (p + light), 2), bsdf_share, light_ratio }
            };
            let tenth = f64::from(random.next_f32()) < alpha * 0.1 + (1.0 - alpha) * 0.9;
            moments.add_estimates(&[estimate(tenth), estimate(true)], alpha);
        }
        for (sum, a) in moments.sums.iter().zip(FRACTIONS) {
            let second = |tenth| a + (1.0 - a) * densities(tenth).0 + densities(tenth).1;
            let expected = 0.1 * bright * bright / second(true) + 0.9 / second(false);
            // Five standard errors and more.
            assert!((sum / moments.samples / expected - 1.0).abs() < 0.02, "{a}: {sum} {expected}");
        }
        assert!(moments.gain() > 2.0 * measured(81.0, alpha).gain(), "a light that is sampled needs less of a guide");
    }

    #[test]
    fn what_was_added_can_be_taken_away() {
        let estimate = Estimate { square: 1e6, bsdf_share: 0.3, light_ratio: f32::INFINITY };
        let mut moments = measured(9.0, 0.5);
        let before = moments;
        moments.add_estimates(&[estimate], 0.5);
        moments.remove_estimates(&[estimate], 0.5);
        assert!(moments.sums.iter().zip(before.sums).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
        assert!((moments.effective() / before.effective() - 1.0).abs() < 1e-3);
        assert_eq!(moments.samples, before.samples);
    }

    /// Fractions that a descent has learned lie between those that are tried.
    #[test]
    fn any_fraction_has_a_moment() {
        for drawn in [0.1, 0.37, 0.5, 0.9] {
            let moments = measured(9.0, drawn);
            let [used, chosen, bsdf] = moments.relative(drawn, 0.2).expect("enough samples");
            let [_, at_chosen, ..] = moments.sums;
            assert!((used - 1.0).abs() < 1e-9 && (bsdf / chosen - moments.sums[7] / at_chosen).abs() < 1e-9);
            let between = moments.relative(0.725, 0.725).map(|[_, _, bsdf]| moments.sums[7] / bsdf);
            let middle = 0.5 * (moments.sums[5] + moments.sums[6]);
            assert!(between.is_some_and(|found| (found / middle - 1.0).abs() < 1e-9), "{drawn}: {between:?} {middle}");
        }
        assert_eq!(Moments::<8>::default().relative(0.5, 0.5), None);
    }

    /// Estimates of nothing, of next to nothing, as large as numbers are and none at all, 100,000 of them: what
    /// overflows is left out, and what is decided keeps a tenth of BSDF samples. (What a fraction of 1 means is tested
    /// in hard_trees.rs.)
    #[test]
    fn a14_extreme_estimates_decide_nothing_extreme() {
        let squares = [0.0, 5e-324, 1e-30, 1.0, 1e30, 1e140, f64::MAX, f64::INFINITY, f64::NAN];
        let shares = [0.0, f32::MIN_POSITIVE, 0.5, 1.0, f32::NAN];
        let ratios = [0.0, 1e-30, 1.0, f32::MAX, f32::INFINITY];
        let mut random = Random::new(11, 0, 0);
        let mut moments = Moments::<8>::default();
        let mut decided = 0;
        for _ in 0..100_000 {
            let mut any = |count: usize| random.below(count as u32) as usize;
            let (square, bsdf_share) = (squares[any(squares.len())], shares[any(shares.len())]);
            let light_ratio = ratios[any(ratios.len())];
            moments.add_estimates(&[Estimate { square, bsdf_share, light_ratio }], 0.5);
            let sums = moments.sums();
            assert!(sums.iter().all(|sum| *sum >= 0.0 && sum.is_finite()), "{square} {bsdf_share} {light_ratio}");
            let fraction = moments.best().map_or(0.5, |best| FRACTIONS[best]);
            assert!((0.1..=1.0).contains(&fraction) && moments.gain() > 0.0 && moments.gain() <= 1.0, "{moments:?}");
            assert!(moments.relative(0.5, fraction).iter().flatten().all(|m| *m > 0.0 && m.is_finite()), "{moments:?}");
            decided += usize::from(moments.best().is_some());
        }
        assert!(decided > 50_000, "{decided} decisions");
    }

    #[test]
    fn a_guide_is_used_where_it_helps() {
        assert_eq!(measured(1.0, 0.5).best(), Some(7), "nothing to guide towards");
        assert_eq!(measured(81.0, 0.5).best(), Some(0));
        assert!(measured(81.0, 0.5).gain() < 0.3);
        assert_eq!(Moments::<8>::default().best(), None);
        let mut pooled = Moments::default();
        pooled.add_prior(&measured(81.0, 0.5), 100.0);
        assert_eq!(pooled.best(), Some(0));
        assert!((pooled.samples - 100.0).abs() < 1e-6);
    }
}
