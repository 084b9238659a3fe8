//! Settings of a render, resolved once.

use serde::{Deserialize, Serialize};

use super::part::PartOf;
use crate::base::{Error, Result};
use crate::guiding::learn::fraction::FractionRule;
use crate::guiding::learn::learner::LearnerSettings;
use crate::guiding::model::ModelKind;
use crate::guiding::target::{DirectLight, Target};
use crate::guiding::tree::TreeSettings;
use crate::guiding::tree::leaves::Layout;
use crate::integrators::{Roulette, TransportSettings};
use crate::network::config::Mode;
use crate::picture::Window;
use crate::reconstruct::gaussian::Gaussian;
use crate::reconstruct::nilsson::Nilsson;
use crate::reconstruct::{AsCounted, Reconstructor};
use crate::scene::file::FilterFile;
use crate::scene::plan::{EffectKind, EffectPlan};

/// Guiding methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuideMode {
    /// No guiding: BSDF sampling with light sampling.
    None,
    /// Jensen 1995: photons in histograms of fixed cells.
    Jensen,
    /// Müller 2017: path samples of radiance, one spatial tree, no context.
    Ppg,
    /// Müller 2019: the same with filtered deposits and a learned fraction of BSDF samples.
    Ppg2,
    /// Ruppert 2020: path samples of radiance in mixtures of von Mises-Fisher lobes.
    Vmf,
    /// Vorba 2014: photons and path samples of radiance in mixtures of Gaussians.
    Gmm,
    /// Reibold 2018: complete paths that the path tracer finds too rarely.
    Paths,
    /// Path samples of the variance-aware target (Rath 2020), trees as counted.
    Variance,
    /// Nilsson 2022: the trees of Müller 2017 denoised on matrices, with the targets of Rath 2020.
    Nilsson,
    /// Path samples and photons, trees as counted.
    Hybrid,
    /// The same, smoothed level by level.
    Gaussian,
    /// The same, reconstructed by the network.
    Neural,
    /// Zhu 2021: the same without light sampling, filtered, with a fraction of BSDF samples by the light that was found.
    Zhu,
}

impl GuideMode {
    /// All modes.
    pub const ALL: [Self; 13] = [
        Self::None,
        Self::Jensen,
        Self::Ppg,
        Self::Ppg2,
        Self::Vmf,
        Self::Gmm,
        Self::Paths,
        Self::Variance,
        Self::Nilsson,
        Self::Hybrid,
        Self::Gaussian,
        Self::Neural,
        Self::Zhu,
    ];

    /// Name on the command line and in statistics, and its line of help.
    fn words(self) -> [&'static str; 2] {
        match self {
            Self::None => ["none", "Path tracing with light sampling and multiple importance sampling"],
            Self::Jensen => ["jensen", "Jensen 1995: photons in histograms of fixed directions"],
            Self::Ppg => ["ppg", "Müller 2017: path samples of radiance in a spatial and directional tree"],
            Self::Ppg2 => ["ppg2", "Müller 2019: the same, filtered, with a learned fraction of BSDF samples"],
            Self::Vmf => ["vmf", "Ruppert 2020: path samples of radiance in mixtures of von Mises-Fisher lobes"],
            Self::Gmm => ["gmm", "Vorba 2014: photons and path samples of radiance in mixtures of Gaussians"],
            Self::Paths => ["paths", "Reibold 2018: complete paths that the path tracer finds too rarely"],
            Self::Variance => {
                ["variance", "Path samples of the variance-aware target (Rath 2020) in per-voxel quadtrees"]
            }
            Self::Nilsson => ["nilsson", "Nilsson 2022: trees of paths denoised on matrices, their target switched"],
            Self::Hybrid => ["hybrid", "Path and photon samples in per-voxel quadtrees"],
            Self::Gaussian => ["gaussian", "The same, smoothed level by level"],
            Self::Neural => ["neural", "The same, reconstructed by the network"],
            Self::Zhu => ["zhu", "Zhu 2021: the same, filtered, without light sampling, and never given up"],
        }
    }

    /// Name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        self.words()[0]
    }

    /// Line of help.
    pub fn help(self) -> &'static str {
        self.words()[1]
    }

    /// Whether what is around its model is as in its paper (Müller 2017, 2019; Zhu 2021; Nilsson 2022): the fraction of BSDF samples, and that it is
    /// never given up.
    pub fn has_own_surroundings(self) -> bool {
        self.has_one_tree() || self == Self::Zhu
    }

    /// Whether its voxels are those of one tree from voxel to quadtree (Müller 2017).
    pub fn has_one_tree(self) -> bool {
        matches!(self, Self::Ppg | Self::Ppg2 | Self::Nilsson)
    }

    /// Model of directions that learns.
    pub fn model(self) -> ModelKind {
        match self {
            Self::Jensen => ModelKind::Histograms,
            Self::Vmf => ModelKind::Vmf,
            Self::Gmm => ModelKind::Gmm,
            _ => ModelKind::Trees,
        }
    }
}

/// Kinds of samples that are deposited while learning.
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
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Path => "path",
            Self::Photon => "photon",
            Self::Both => "both",
        }
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

/// Reconstructions: how distributions are made of counted trees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reconstruction {
    /// No reconstruction: trees as counted.
    None,
    /// Level-wise smoothing.
    Gaussian,
    /// Denoising on matrices.
    Nilsson,
    /// The network.
    Neural,
}

impl Reconstruction {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Gaussian => "gaussian",
            Self::Nilsson => "nilsson",
            Self::Neural => "neural",
        }
    }

    /// Reconstructor of this kind; `neural` gives the network where that is asked for.
    ///
    /// # Errors
    /// Those of `neural`.
    pub fn reconstructor<'n>(
        self,
        neural: impl FnOnce() -> Result<Box<dyn Reconstructor + 'n>>,
    ) -> Result<Box<dyn Reconstructor + 'n>> {
        match self {
            Self::None => Ok(Box::new(AsCounted::default())),
            Self::Gaussian => Ok(Box::new(Gaussian::default())),
            Self::Nilsson => Ok(Box::new(Nilsson)),
            Self::Neural => neural(),
        }
    }
}

/// What is done about samples so bright and so rare that they stand alone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Fireflies {
    /// Nothing: the picture is the mean of its samples.
    #[default]
    Keep,
    /// Their light is taken out of the finished picture, see [`fireflies`](crate::film::fireflies).
    Reweight {
        /// Samples of like brightness that are asked for: in the 3 × 3 pixels around, 1 + 2 κ always keep their light.
        kappa: f64,
    },
}

impl Fireflies {
    /// κ where nothing else is asked for: a sample in each of the 3 × 3 pixels is enough, so that pictures of one sample per pixel keep what all
    /// pixels see.
    pub const KAPPA: f64 = 4.0;
    /// Least and largest κ. The number of samples of a level of brightness is known up to twice the latter.
    pub const RANGE: [f64; 2] = [1e-3, 1e3];

    /// κ, where something is done.
    pub fn kappa(self) -> Option<f64> {
        match self {
            Self::Keep => None,
            Self::Reweight { kappa } => Some(kappa),
        }
    }

    /// What the header of a picture says of it; nothing where nothing is done.
    pub fn told(self) -> Option<String> {
        self.kappa().map(|kappa| format!("reweight, kappa {kappa}"))
    }
}

/// Rule by which a render ends.
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
    /// Guiding method.
    pub guide: GuideMode,
    /// Kinds of samples that are learned from.
    pub samples: SampleKinds,
    /// Reconstruction of the counted trees.
    pub reconstruction: Reconstruction,
    /// Settings of the learner.
    pub learner: LearnerSettings,
    /// Paths that are drawn from kept ones for each path of the path tracer (Reibold 2018), in [0, 1]. Where it is not 0, these are learned once
    /// other guides are.
    pub complete_paths: f64,
    /// Part of the budget that guides have left in which they are learned.
    pub paths_share: f64,
    /// Largest share of the budget that may go into learning; within it learning ends when it no longer pays.
    pub learning_share: f64,
    /// Whether guiding is left out where it turns out not to pay.
    pub gives_up: bool,
    /// Largest share of the render's cost that may go into reconstruction, relative to that of tracing. Counted in rays, so that a
    /// budget in samples gives the same picture on every machine.
    pub reconstruction_share: f64,
    /// Pixel filter: the weight of the light around a pixel in its value.
    pub filter: FilterFile,
    /// Window of the picture that is rendered; none for all of it. Every pixel gets the samples that it gets in the whole picture,
    /// but guides learn from what the window shows.
    pub crop: Option<Window>,
    /// The part of the samples that is rendered, for a picture of which other processes render the rest; none for all. Only under
    /// [`StopRule::Spp`] with samples divided evenly, unguided or by a given field.
    pub part: Option<PartOf>,
    /// Whether the outcome has the sample count and variance of each pixel.
    pub keeps_spread: bool,
    /// Whether noisy pixels get more samples than others in the final pass; not for a target error.
    pub adaptive: bool,
    /// What is done about fireflies. The samples are the same.
    pub fireflies: Fireflies,
    /// Rule by which the render ends.
    pub stop: StopRule,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl RenderSettings {
    /// Whether noisy pixels can get more samples than others: paths that are drawn from kept ones fall where they may.
    pub fn adapts(&self) -> bool {
        self.guide != GuideMode::Paths
    }

    /// Defaults for a mode and a budget.
    pub fn new(guide: GuideMode, stop: StopRule) -> Self {
        let learner = match guide {
            GuideMode::Ppg => mueller_2017(),
            GuideMode::Ppg2 => mueller_2019(),
            GuideMode::Nilsson => nilsson_2022(),
            GuideMode::Zhu => zhu_2021(),
            GuideMode::Jensen | GuideMode::Gmm => {
                LearnerSettings { target: Target::Radiance, ..LearnerSettings::default() }
            }
            // Each lobe is aimed by its own distance.
            GuideMode::Vmf => {
                LearnerSettings { target: Target::Radiance, parallax: false, ..LearnerSettings::default() }
            }
            _ => LearnerSettings::default(),
        };
        let samples = match guide {
            GuideMode::Jensen => SampleKinds::Photon,
            GuideMode::Gmm | GuideMode::Hybrid | GuideMode::Gaussian | GuideMode::Neural | GuideMode::Zhu => {
                SampleKinds::Both
            }
            _ => SampleKinds::Path,
        };
        // Müller 2017, §2, has adjoint-driven roulette; by throughput it kills what the guide has found. Zhu 2021 leaves it to later work in its conclusions.
        let roulette = if guide == GuideMode::Zhu { Roulette::Throughput } else { Roulette::Window };
        let reconstruction = match guide {
            GuideMode::Gaussian => Reconstruction::Gaussian,
            GuideMode::Nilsson => Reconstruction::Nilsson,
            GuideMode::Neural | GuideMode::Zhu => Reconstruction::Neural,
            _ => Reconstruction::None,
        };
        let settings = Self {
            transport: TransportSettings {
                max_depth: 20,
                light_sampling: guide != GuideMode::Zhu,
                roulette,
                guided_distances: false,
            },
            guide,
            samples,
            reconstruction,
            learner: LearnerSettings { model: guide.model(), ..learner },
            complete_paths: if guide == GuideMode::Paths { 1.0 } else { 0.0 },
            // Reibold 2018, §4.3.
            paths_share: 0.1,
            learning_share: 0.5,
            gives_up: !guide.has_own_surroundings(),
            reconstruction_share: 0.15,
            filter: FilterFile::default(),
            crop: None,
            part: None,
            keeps_spread: false,
            // Samples that are asked for by their number are those of each pixel.
            adaptive: matches!(stop, StopRule::Time(_)) && guide != GuideMode::Paths,
            fireflies: Fireflies::Keep,
            stop,
            seed: 0,
        };
        settings.with_reconstruction(reconstruction)
    }

    /// These settings with another reconstruction, which decides what leaves have to count, and whether trees follow single samples: one that
    /// is sampled as it was counted has nothing else to follow, and Nilsson's are those of Müller.
    pub fn with_reconstruction(mut self, reconstruction: Reconstruction) -> Self {
        self.reconstruction = reconstruction;
        let follows = matches!(reconstruction, Reconstruction::None | Reconstruction::Nilsson);
        self.learner.tree.first_least = u32::from(!follows);
        self.learner.tree.layout =
            if reconstruction == Reconstruction::Neural { Layout::Network } else { Layout::Values };
        self
    }

    /// Defaults of another mode with the budget, depth, seed, filter, window, memory and judgement of fireflies of these settings.
    pub fn with_guide(&self, guide: GuideMode) -> Self {
        let defaults = Self::new(guide, self.stop);
        let learner = LearnerSettings { memory: self.learner.memory, ..defaults.learner };
        let TransportSettings { roulette, light_sampling, .. } = defaults.transport;
        let light_sampling = light_sampling && self.transport.light_sampling;
        let transport = TransportSettings { roulette, light_sampling, ..self.transport };
        let Self { seed, filter, crop, fireflies, .. } = *self;
        let adaptive = self.adaptive && guide != GuideMode::Paths;
        Self { transport, seed, filter, crop, adaptive, fireflies, learner, ..defaults }
    }

    /// Window that is rendered of a picture of `size` (columns, rows).
    pub fn window(&self, size: [u32; 2]) -> Window {
        self.crop.unwrap_or(Window::whole(size))
    }

    /// These settings without the effects that are off in the scene's plan.
    pub fn following(mut self, plan: &EffectPlan) -> Self {
        if !plan.is_on(EffectKind::Guiding) {
            (self.guide, self.complete_paths) = (GuideMode::None, 0.0);
        }
        if !plan.is_on(EffectKind::Photons) {
            self.samples = SampleKinds::Path;
        }
        if !plan.is_on(EffectKind::Reconstruction) || self.guide == GuideMode::None {
            self = self.with_reconstruction(Reconstruction::None);
        }
        self.transport.light_sampling &= plan.is_on(EffectKind::DirectLight);
        self
    }

    /// Switches off in the plan the effects that these settings leave out, with the reason.
    pub fn note(&self, plan: &mut EffectPlan) {
        let mut off = |kind, why: &str| {
            if plan.is_on(kind) {
                plan.decide(kind, false, why);
            }
        };
        if !self.transport.light_sampling {
            off(EffectKind::DirectLight, "light sampling is off");
        }
        if self.guide == GuideMode::None {
            let why = "the method is none: nothing is guided";
            for kind in [EffectKind::Guiding, EffectKind::Photons, EffectKind::Reconstruction] {
                off(kind, why);
            }
        }
        if !self.samples.photons() {
            off(EffectKind::Photons, "guides learn from camera paths alone");
        }
        if self.reconstruction == Reconstruction::None {
            off(EffectKind::Reconstruction, "the guide is sampled as it was counted");
        }
    }

    /// The mode that trees are collected in, as models and shards record it.
    pub fn mode(&self) -> Mode {
        Mode {
            target: self.learner.target.name().into(),
            light_sampling: self.transport.light_sampling,
            roulette: self.transport.roulette != Roulette::Off,
            split_share: self.learner.tree.split_share as f32,
            direct: self.learner.direct.name().into(),
            context: self.learner.tree.context as f32,
            past: self.learner.tree.past as f32,
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
        if self.part.is_some() && (self.adaptive || !matches!(self.stop, StopRule::Spp(_))) {
            return Err(Error::Options(
                "parts are ranges of samples that are counted and divided evenly: give --spp, and leave --adaptive out"
                    .into(),
            ));
        }
        let [least, most] = Fireflies::RANGE;
        if self.fireflies.kappa().is_some_and(|kappa| !(least..=most).contains(&kappa)) {
            return Err(Error::Options(format!("kappa of fireflies must lie between {least} and {most}")));
        }
        if self.transport.max_depth == 0 {
            return Err(Error::Options("max_depth must be at least 1 (emission only)".into()));
        }
        Ok(())
    }
}

/// The settings of Müller, Gross and Novák 2017, *Practical Path Guiding*.
fn mueller_2017() -> LearnerSettings {
    LearnerSettings {
        resolution: 1.0,
        facing: false,
        voxel_samples: 12_000,
        growing: true,
        target: Target::Radiance,
        fraction: FractionRule::Half,
        direct: DirectLight::Nothing,
        tree: TreeSettings { split_share: 0.01, context: 0.0, past: 0.0, ..TreeSettings::default() },
        parallax: false,
        ..LearnerSettings::default()
    }
}

/// Those of Müller 2019, *Practical Path Guiding in Production* (§10.4): filters let voxels be smaller.
fn mueller_2019() -> LearnerSettings {
    let before = mueller_2017();
    let tree = TreeSettings { filtered: true, ..before.tree };
    LearnerSettings { voxel_samples: 4000, fraction: FractionRule::Adam, tree, ..before }
}

/// Those of Nilsson 2022 (§4.4): the trees of Müller 2017 learn the target of Rath 2020, the simple form of it in the first three iterations.
fn nilsson_2022() -> LearnerSettings {
    LearnerSettings { target: Target::VariancePixel, simple_iterations: 3, ..mueller_2017() }
}

/// Those of Zhu 2021 (§5, §7): a tree knows what its own voxel has seen in this iteration.
fn zhu_2021() -> LearnerSettings {
    LearnerSettings {
        facing: false,
        fraction: FractionRule::Found,
        tree: TreeSettings { filtered: true, context: 0.0, past: 0.0, ..TreeSettings::default() },
        parallax: false,
        ..LearnerSettings::default()
    }
}
