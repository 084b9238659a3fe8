//! How often the BSDF is sampled instead of the guide.

/// What decides it once learning is over; while learning it is one half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FractionRule {
    /// One half (Müller 2017 §3.3).
    Half,
    /// The best of several by measured second moments, see [`Moments`](crate::guiding::moments::Moments).
    Moments,
    /// Stochastic gradient descent (Müller 2019 §10.5).
    Adam,
}

impl FractionRule {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::Moments => "moments",
            Self::Adam => "adam",
        }
    }
}
