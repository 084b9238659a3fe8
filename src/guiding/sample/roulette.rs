//! Roulette: the probabilities of light sampling at a vertex of a path, and of going on from it.
//!
//! Adjoint-driven roulette (Vorba and Křivánek 2016 §5, without splitting): a path whose expected contribution, its throughput
//! times the radiance that the vertex is known to send back, is below a part of the pixel's value goes on in proportion to it.
//! Light sampling is judged in the same way: behind a wall it finds nothing and is mostly left out, which saves half of the rays
//! there. A place where light is rarely found is not taken for dark (see
//! [`Adjoint::add_scene`](crate::guiding::learn::adjoint::Adjoint::add_scene)).
//!
//! Efficiency-aware roulette and splitting (Rath et al. 2022), which goes by second moments and costs instead of means, was tried twice, with
//! and without pooled moments and splitting: see `docs/ablations.md`.

/// Lowest probability: means of few samples must not shut light out.
const LEAST: f32 = 0.1;
/// Part of the pixel's value below which contributions become rarer instead of smaller: the lower end of a weight window of size
/// 8, 2/(1 + 8) (Vorba and Křivánek 2016 §5, who take 5). A guide that is wrong everywhere costs 3.9 times the variance on `cornell`
/// with it, and 5.0 times with a window of size 5.
const WINDOW: f64 = 2.0 / 9.0;

/// Probabilities for a path of importance 1 at a vertex, before they are bounded. Importance: throughput over the pixel's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjointRoulette {
    /// Probability of light sampling, ≥ 0; infinite where it is not known.
    pub light: f32,
    /// Probability of going on, ≥ 0; infinite where it is not known.
    pub onward: f32,
}

impl AdjointRoulette {
    /// Neither probability is known.
    pub const UNKNOWN: Self = Self { light: f32::INFINITY, onward: f32::INFINITY };

    /// Probabilities at a vertex that sends back these mean radiances by light sampling and by going on, as far as these are known.
    pub fn expecting(means: [Option<f64>; 2]) -> Self {
        // Environments with negative pixels have negative means, which are worth no more than none.
        let known = |mean: Option<f64>| {
            mean.filter(|mean| mean.is_finite()).map_or(f32::INFINITY, |mean| (mean / WINDOW).max(0.0) as f32)
        };
        let [light, onward] = means.map(known);
        Self { light, onward }
    }

    /// Mean radiance that a vertex sends back, W·m⁻²·sr⁻¹; none where it is not known.
    pub fn expected(self) -> Option<f32> {
        Some((self.light + self.onward) * WINDOW as f32).filter(|expected| expected.is_finite())
    }

    /// Probability of light sampling, in (0, 1], for a path of this importance and throughput.
    pub fn light_probability(self, importance: f32, throughput: f32) -> f32 {
        probability(self.light, importance, throughput).unwrap_or(1.0)
    }

    /// Probability of going on, in (0, 1]; none where it is not known.
    pub fn survival(self, importance: f32, throughput: f32) -> Option<f32> {
        probability(self.onward, importance, throughput)
    }
}

/// Probability `of_one` times `importance`, bounded; none where it is not known. A path that is thought worthless at every vertex,
/// by mistake, must not become heavier from one to the next: its throughput divided by the probability stays at most 1/[`LEAST`],
/// or as it was.
fn probability(of_one: f32, importance: f32, throughput: f32) -> Option<f32> {
    let wanted = of_one * importance;
    let least = (LEAST * throughput.max(1.0)).min(1.0);
    // Infinite times zero is not a number either.
    (of_one.is_finite() && !wanted.is_nan()).then(|| wanted.clamp(least, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Whatever is expected of a path and however heavy it is: it goes on with a chance of at least a tenth, and if it
    /// does it weighs no more than ten, or no more than before. Without that, paths that are thought worthless by
    /// mistake would return as fireflies.
    #[test]
    fn a15_no_survivor_is_heavier_than_ten() {
        let mut random = Random::new(12, 0, 0);
        let mut any = || if random.below(8) == 0 { 0.0 } else { 10f32.powf(random.range(-37.0, 37.0)) };
        for _ in 0..100_000 {
            let (effort, importance, throughput) = (AdjointRoulette { light: any(), onward: any() }, any(), any());
            for p in [
                effort.survival(importance, throughput).expect("it is known"),
                effort.light_probability(importance, throughput),
            ] {
                assert!((LEAST..=1.0).contains(&p), "{effort:?} {importance} {throughput}: {p}");
                let most = throughput.max(1.0 / LEAST) * (1.0 + 1e-6);
                assert!(throughput / p <= most, "{effort:?} {importance}: {throughput} becomes {}", throughput / p);
            }
        }
    }

    #[test]
    fn work_goes_where_light_is_expected() {
        // Behind a wall: no light by light sampling, some by going on.
        let hidden = AdjointRoulette::expecting([0.0, 0.5].map(Some));
        assert_eq!((hidden.light_probability(1.0, 1.0), hidden.survival(1.0, 1.0)), (LEAST, Some(1.0)));
        assert_eq!(hidden.survival(0.25, 1.0), Some(0.5625), "a path worth an eighth of the pixel");
        assert_eq!(hidden.survival(0.25, 8.0), Some(8.0 * LEAST), "a path that is heavy already");
        assert_eq!(hidden.light_probability(0.25, 80.0), 1.0);
        let lit = AdjointRoulette::expecting([0.2, 0.01].map(Some));
        assert_eq!((lit.light_probability(1.0, 1.0), lit.survival(1.0, 1.0)), (0.9, Some(LEAST)));
    }

    #[test]
    fn what_is_not_known_decides_nothing() {
        let overflown = AdjointRoulette::expecting([Some(1e300); 2]);
        for effort in [AdjointRoulette::expecting([None; 2]), overflown, AdjointRoulette::UNKNOWN] {
            for importance in [0.0, 1.0, f32::INFINITY, f32::NAN] {
                assert_eq!((effort.light_probability(importance, 1.0), effort.survival(importance, 1.0)), (1.0, None));
            }
        }
        let dark = AdjointRoulette::expecting([Some(0.0); 2]);
        assert_eq!(dark.survival(f32::INFINITY, 1.0), None, "0·∞");
        assert_eq!(dark.survival(1.0, 1.0), Some(LEAST));
    }
}
