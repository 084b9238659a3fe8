//! Rules for the fraction of BSDF samples, the rest being drawn from the guide.

use serde::{Deserialize, Serialize};

/// Rule for the fraction of BSDF samples once learning is over; while learning it is one half, but for [`FractionRule::Adam`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FractionRule {
    /// One half (Müller 2017 §3.3).
    Half,
    /// The fraction that is best by measured second moments, see [`Moments`](crate::guiding::moments::Moments).
    Moments,
    /// Stochastic gradient descent (Müller 2019 §10.5), also while learning.
    Adam,
}

impl FractionRule {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::Moments => "moments",
            Self::Adam => "adam",
        }
    }
}
