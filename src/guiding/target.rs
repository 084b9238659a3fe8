//! Targets of learning: the value of a path record that models sum, and the quantity that distributions become proportional to.

use serde::{Deserialize, Serialize};

use super::record::{PathRecord, Radiance};

/// Quantity that is deposited, and that distributions become proportional to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Incident radiance (Müller 2017): V = L̂/p.
    Radiance,
    /// Root of the second moment of the integrand (Rath 2020's simpler form; Zhu 2021 eq. 7): V = (f·cos θ·L̂)²/p.
    Variance,
    /// Root of the second moment relative to the pixel (Rath 2020 §5): V is that of `Variance` times the squared ratio of the
    /// path's throughput so far and the pixel's value.
    VariancePixel,
}

impl Target {
    /// Target of this [name](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        [Self::Radiance, Self::Variance, Self::VariancePixel].into_iter().find(|target| target.name() == name)
    }

    /// Name on the command line, in shards and in models.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiance => "radiance",
            Self::Variance => "variance",
            Self::VariancePixel => "variance-pixel",
        }
    }

    /// Sampling weight of a cell of this solid angle in sr that holds ΣV. For radiance ΣV itself; for a second moment √(ΣV · A), A
    /// being the solid angle. Summed over cells of equal density it gives that of all of them.
    pub fn weight(self, sum: f64, solid_angle: f64) -> f64 {
        match self {
            Self::Radiance => sum.max(0.0),
            Self::Variance | Self::VariancePixel => (sum.max(0.0) * solid_angle).sqrt(),
        }
    }
}

/// Rule for the part that guides learn of light that light sampling finds too.
///
/// Learning nothing of it leaves the sky behind the slits of a blind to light sampling, which hardly ever finds it, and to
/// BSDF samples, of which a guide leaves few.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectLight {
    /// Nothing: light sampling handles it.
    Nothing,
    /// The part that is left for paths that hit the light, by the weights of multiple importance sampling.
    Weighted,
    /// All of it, as if there were no light sampling.
    All,
}

impl DirectLight {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Weighted => "weighted",
            Self::All => "all",
        }
    }

    /// Part of the light that arrived which is learned, where light sampling has `light_ratio` times the density of the mixture.
    fn part(self, arrived: Radiance, light_ratio: f32) -> f32 {
        match self {
            Self::Nothing => arrived.onward,
            Self::Weighted => arrived.sum(),
            // Without light sampling the weight is 1 instead of 1 / (1 + ratio).
            Self::All if arrived.emitted > 0.0 => arrived.onward + arrived.emitted * (1.0 + light_ratio),
            Self::All => arrived.onward,
        }
    }
}

/// Target that guides learn, and their rule for direct light: together they give the value of a path record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Learned {
    /// Quantity that distributions become proportional to.
    pub target: Target,
    /// Rule for light that light sampling finds too.
    pub direct: DirectLight,
}

impl Learned {
    /// Value of a path record for models to sum: V for the radiance target, √V for second moments (see [`Target`]): as a root, so
    /// that squares cannot overflow.
    pub fn value(&self, record: &PathRecord) -> f32 {
        let part = |of: Radiance| self.direct.part(of, record.light_ratio);
        let value = match self.target {
            Target::Radiance => part(record.radiance) / record.pdf,
            Target::Variance => part(record.brought) * record.pdf.sqrt(),
            Target::VariancePixel => part(record.brought) * record.pdf.sqrt() * record.importance,
        };
        if value.is_finite() { value } else { 0.0 }
    }
}
