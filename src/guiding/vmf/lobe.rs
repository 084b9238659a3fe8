//! A von Mises-Fisher lobe on the sphere: v(ω) = C(κ)·exp(κ(μ·ω − 1)) with C(κ) = κ / (2π(1 − exp(−2κ))), which stays finite for all κ
//! (Jakob 2012, *Numerically stable sampling of the von Mises Fisher distribution on S²*).

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

/// Smallest concentration: uniform to a thousandth.
pub const LEAST_KAPPA: f64 = 1e-3;
/// Largest concentration, a lobe a third of a degree wide (Open PGL).
pub const MOST_KAPPA: f64 = 32_000.0;
/// Concentration of the lobe that stands for the clamped cosine: the one of which importance sampling of the cosine has the least
/// second moment, 1.129. (Least squares would have 2.29.)
pub const COSINE_KAPPA: f64 = 2.634;

/// A lobe of a mixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobe {
    /// Mean direction μ as seen from the pivot, a unit vector.
    pub mean: Vec3,
    /// Concentration κ, from [`LEAST_KAPPA`] to [`MOST_KAPPA`].
    pub kappa: f32,
    /// Weight π in the mixture, in [0, 1].
    pub weight: f32,
    /// Inverse of the distance from the pivot at which its light starts; 0 where that is far away.
    pub nearness: f32,
}

/// The density at the mean direction, C(κ), 1/sr.
pub fn peak(kappa: f64) -> f64 {
    kappa / (-TAU * (-2.0 * kappa).exp_m1())
}

/// The mean of μ·ω: coth κ − 1/κ.
pub fn mean_cosine(kappa: f64) -> f64 {
    if kappa < 0.05 { kappa / 3.0 - kappa.powi(3) / 45.0 } else { 1.0 / kappa.tanh() - 1.0 / kappa }
}

/// The concentration of this mean cosine in [0, 1], within the bounds of [`Lobe::kappa`]: the approximation of Banerjee et al. 2005
/// (*Clustering on the Unit Hypersphere using von Mises-Fisher Distributions*, eq. 4.4), which is up to 5 % off, and a step of Newton's
/// method (Sra 2012), with which it is 0.3 % at most.
pub fn concentration(mean_cosine: f64) -> f64 {
    let r = mean_cosine.clamp(0.0, self::mean_cosine(MOST_KAPPA));
    let first = (r * (3.0 - r * r) / (1.0 - r * r)).clamp(LEAST_KAPPA, MOST_KAPPA);
    let found = self::mean_cosine(first);
    let slope = if first < 0.05 { 1.0 / 3.0 } else { 1.0 - found * found - 2.0 * found / first };
    (first - (found - r) / slope).clamp(LEAST_KAPPA, MOST_KAPPA)
}

/// The direction around +z that a point of the unit square maps to under a lobe of this concentration.
pub fn around_pole(kappa: f64, [u, v]: [f64; 2]) -> DVec3 {
    // 1 − cos θ, which is tiny for narrow lobes.
    let below = (-(u * (-2.0 * kappa).exp_m1()).ln_1p() / kappa).clamp(0.0, 2.0);
    let sine = (below * (2.0 - below)).sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    DVec3::new(sine * cos, sine * sin, 1.0 - below)
}

/// Natural logarithm of ∫ exp(m·ω) dω over the sphere for a vector of this length: 4π sinh(m)/m.
pub fn log_integral(length: f64) -> f64 {
    if length < 1e-4 { (4.0 * PI).ln() } else { length + (-TAU * (-2.0 * length).exp_m1() / length).ln() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concentrations_have_their_mean_cosine() {
        for i in 0..=400 {
            let kappa = LEAST_KAPPA * (MOST_KAPPA / LEAST_KAPPA).powf(f64::from(i) / 400.0);
            let found = concentration(mean_cosine(kappa));
            assert!((found / kappa - 1.0).abs() < 3e-3, "{kappa} became {found}");
        }
        assert_eq!((concentration(0.0), concentration(1.0)), (LEAST_KAPPA, MOST_KAPPA));
        assert!((concentration(-1.0), concentration(f64::NAN).is_nan()) == (LEAST_KAPPA, true));
    }

    /// ∫ v dω = 2π·C·∫ exp(−κt) dt over t = 1 − cos θ, and the integral of exp(κμ·ω).
    #[test]
    fn lobes_integrate_to_one() {
        for kappa in [LEAST_KAPPA, 0.05, 1.0, 5.0, 300.0, MOST_KAPPA] {
            let (end, steps) = ((40.0 / kappa).min(2.0), 200_000);
            let step = end / f64::from(steps);
            let sum: f64 = (0..steps).map(|i| (-kappa * (f64::from(i) + 0.5) * step).exp() * step).sum();
            assert!((TAU * peak(kappa) * sum - 1.0).abs() < 1e-6, "{kappa}");
            assert!((log_integral(kappa) - (kappa - peak(kappa).ln())).abs() < 1e-6, "{kappa}");
        }
        assert!((log_integral(0.0) - (4.0 * PI).ln()).abs() < 1e-12);
    }

    /// No lobe a little narrower or wider is better for the cosine: ∫ (cos θ/π)²/v dω is least.
    #[test]
    fn the_cosine_has_its_lobe() {
        let moment = |kappa: f64| -> f64 {
            let term = |i: i32| {
                let cos = (f64::from(i) + 0.5) / 10_000.0;
                (cos / PI).powi(2) / (peak(kappa) * (kappa * (cos - 1.0)).exp()) * TAU / 10_000.0
            };
            (0..10_000).map(term).sum()
        };
        let best = moment(COSINE_KAPPA);
        assert!(best < moment(COSINE_KAPPA - 0.05) && best < moment(COSINE_KAPPA + 0.05), "{best}");
        assert!((best - 1.1287).abs() < 1e-3, "{best}");
    }
}
