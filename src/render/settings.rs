//! What to render with, resolved once.

use crate::base::{Error, Result};
use crate::guiding::learner::LearnerSettings;
use crate::integrators::TransportSettings;
use crate::network::config::Mode;

/// What guides the paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuideMode {
    /// Nothing: BSDF sampling with next event estimation.
    None,
    /// Trees as counted.
    Hybrid,
    /// Trees reconstructed by the network.
    Neural,
}

impl GuideMode {
    /// Name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Hybrid => "hybrid",
            Self::Neural => "neural",
        }
    }
}

/// What is deposited while learning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKinds {
    /// Camera paths.
    Path,
    /// Light paths. Camera paths still make the voxels.
    Photon,
    /// Both.
    Both,
}

impl SampleKinds {
    /// Samples per pixel that an iteration costs for one camera path per pixel.
    pub fn per_iteration(self) -> u32 {
        if self.photons() { 2 } else { 1 }
    }

    /// Whether camera paths are deposited.
    pub fn paths(self) -> bool {
        self != Self::Photon
    }

    /// Whether light paths are traced.
    pub fn photons(self) -> bool {
        self != Self::Path
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopRule {
    /// Samples per pixel, camera and light paths together.
    Spp(u32),
    /// Seconds of wall time, learning included.
    Time(f64),
    /// Estimated relMSE of the picture.
    TargetError(f64),
}

/// Everything that decides a render but the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderSettings {
    /// Light transport.
    pub transport: TransportSettings,
    /// What guides.
    pub guide: GuideMode,
    /// What is learned from.
    pub samples: SampleKinds,
    /// How it is learned.
    pub learner: LearnerSettings,
    /// Most of the budget that may go into learning; within it learning ends when it no longer pays.
    pub learning_share: f64,
    /// When to stop.
    pub stop: StopRule,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl RenderSettings {
    /// Defaults for a mode and a budget.
    pub fn new(guide: GuideMode, stop: StopRule) -> Self {
        Self {
            transport: TransportSettings { max_depth: 20, nee: true, roulette: true },
            guide,
            samples: SampleKinds::Both,
            learner: LearnerSettings::default(),
            learning_share: 0.5,
            stop,
            seed: 0,
        }
    }

    /// The mode that trees are collected in, as models and shards record it.
    pub fn mode(&self) -> Mode {
        Mode {
            target: "variance".into(),
            nee: self.transport.nee,
            roulette: self.transport.roulette,
            split_share: self.learner.split_share as f32,
        }
    }

    /// Refuses settings that cannot produce a picture.
    pub(super) fn check(&self) -> Result<()> {
        let usable = match self.stop {
            StopRule::Spp(spp) => spp > 0,
            StopRule::Time(amount) | StopRule::TargetError(amount) => amount > 0.0 && amount.is_finite(),
        };
        if !usable {
            return Err(Error::Options(
                "the budget is zero: give at least 1 sample per pixel, a positive time or a positive error".into(),
            ));
        }
        if self.transport.max_depth == 0 {
            return Err(Error::Options("max_depth must be at least 1 (emission only)".into()));
        }
        Ok(())
    }
}
