//! How much work a vertex of a path is worth: whether light sampling pays there, and whether the path should go on.
//!
//! Adjoint-driven roulette (Vorba and Křivánek 2016 §5, without splitting): a path whose expected contribution, what it carries times
//! what the vertex is known to send back, is below a part of the pixel's value goes on in proportion to it. Light sampling is
//! judged in the same way: behind a wall it finds nothing and is mostly left out, which saves half of the rays there.
//!
//! Efficiency-aware roulette (Rath et al. 2022), which goes by second moments and costs instead of means, was tried: as fast on
//! some seeds, but the moments of few samples are so noisy that others had several times the error.

use super::moments::Moments;

/// Lowest probability: what was learned from few samples must not shut light out.
const LEAST: f32 = 0.1;
/// Part of the pixel's value below which contributions become rarer instead of smaller: the lower end of a weight window of size
/// 5, 2/(1 + 5) (Vorba and Křivánek 2016 §5).
const WINDOW: f64 = 1.0 / 3.0;

/// How roulette decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Roulette {
    /// Paths end only where nothing is left of them.
    Off,
    /// By the path's throughput.
    Throughput,
    /// By what is expected of the path, light sampling too; by throughput where nothing is known.
    Window,
}

impl Roulette {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Throughput => "throughput",
            Self::Window => "window",
        }
    }
}

/// What a voxel's vertices send back along their paths: mean radiance by light sampling, and by going on.
pub type Returns = Moments<2>;

/// What a path of importance 1 does at a vertex: probabilities before they are bounded. Importance is throughput over the value
/// of the pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Of light sampling; infinite where it is not known.
    pub light: f32,
    /// Of going on; infinite where it is not known.
    pub onward: f32,
}

impl Effort {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { light: f32::INFINITY, onward: f32::INFINITY };

    /// What a voxel with such `returns` is worth.
    pub fn new(returns: &Returns) -> Self {
        // Environments with negative pixels have negative means, which are worth no more than none.
        let known = |mean: f64| if mean.is_finite() { (mean / WINDOW).max(0.0) as f32 } else { f32::INFINITY };
        returns.means().map_or(Self::UNKNOWN, |[light, onward]| Self { light: known(light), onward: known(onward) })
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

/// A path that is thought worthless at every vertex, by mistake, must not become heavier from one to the next: whatever is
/// divided by the probability stays below 1/[`LEAST`].
fn probability(of_one: f32, importance: f32, throughput: f32) -> Option<f32> {
    let wanted = of_one * importance;
    let least = (LEAST * throughput.max(1.0)).min(1.0);
    // Infinite times zero is not a number either.
    (of_one.is_finite() && !wanted.is_nan()).then(|| wanted.clamp(least, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn returns(of_one: [f64; 2]) -> Returns {
        let mut returns = Returns::default();
        (0..100).for_each(|_| returns.add(of_one));
        returns
    }

    #[test]
    fn work_goes_where_light_is_expected() {
        // Behind a wall: no light by light sampling, some by going on.
        let hidden = Effort::new(&returns([0.0, 0.5]));
        assert_eq!((hidden.light_probability(1.0, 1.0), hidden.survival(1.0, 1.0)), (LEAST, Some(1.0)));
        assert_eq!(hidden.survival(0.25, 1.0), Some(0.375), "a path worth an eighth of the pixel");
        assert_eq!(hidden.survival(0.25, 8.0), Some(8.0 * LEAST), "a path that is heavy already");
        assert_eq!(hidden.light_probability(0.25, 80.0), 1.0);
        let lit = Effort::new(&returns([0.2, 0.01]));
        assert_eq!((lit.light_probability(1.0, 1.0), lit.survival(1.0, 1.0)), (0.6, Some(LEAST)));
    }

    #[test]
    fn what_is_not_known_decides_nothing() {
        let mut few = Returns::default();
        few.add([1.0; 2]);
        for effort in [Effort::new(&few), Effort::new(&returns([1e300; 2])), Effort::UNKNOWN] {
            for importance in [0.0, 1.0, f32::INFINITY, f32::NAN] {
                assert_eq!((effort.light_probability(importance, 1.0), effort.survival(importance, 1.0)), (1.0, None));
            }
        }
        let dark = Effort::new(&returns([0.0; 2]));
        assert_eq!(dark.survival(f32::INFINITY, 1.0), None, "0·∞");
        assert_eq!(dark.survival(1.0, 1.0), Some(LEAST));
    }
}
