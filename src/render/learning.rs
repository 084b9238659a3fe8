//! The learner at work inside a render: records in, distributions out, with the time that each takes.

use std::time::Instant;

use super::settings::{RenderSettings, SampleKinds};
use super::statistics::{Iteration, Seconds};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensors};
use crate::guiding::cache::VoxelId;
use crate::guiding::learn::emission::{self, EmissionGuide, EmissionLearner, Start};
use crate::guiding::learn::learner::{Learner, Use};
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::sample::field::GuideField;
use crate::reconstruct::{AsCounted, Reconstructor, reconstruct_within};
use crate::sampling::discrete::Discrete;

/// Records of one chunk.
#[derive(Default)]
pub struct Records {
    /// Of camera paths.
    pub paths: Vec<PathRecord>,
    /// Of light paths.
    pub photons: Vec<PhotonRecord>,
    /// Start of each light path, in the order of the paths.
    pub starts: Vec<Option<Start>>,
}

/// Learns the guiding field of a render.
pub struct Learning {
    /// Learner of the voxels and their distributions.
    pub learner: Learner,
    /// Density from which the starts of light paths are drawn.
    pub emission: EmissionGuide,
    pub(super) emission_learner: EmissionLearner,
    /// Light paths for each camera path of the next iteration, in [0, 1]. Once it is 0, it stays 0.
    pub photon_share: f64,
    iterations: u32,
    /// Cost of reconstruction so far, in rays traced.
    reconstruction_rays: f64,
    /// Power of the photons of this iteration in voxels, and that of caustics among it.
    arrived: [f64; 2],
    /// Path samples of a pass on trial, see [`Learning::begin_trial`]; none in others.
    on_trial: Option<Vec<PathRecord>>,
    /// Share of the light by photons that paths had not found in the iteration before; none where no photons have told.
    pub(super) unseen: Option<f64>,
}

/// What a checkpoint has for [`Learning::unseen`] where there is none.
const UNTOLD: f64 = -1.0;

/// Iterations in which photons are never given up: path samples that have not found the light cannot judge them.
const PATIENCE: u32 = 4;
/// Fewest light paths for each camera path in these iterations.
const LEAST_PHOTONS: f64 = 0.25;
/// The same where caustics are much of the light.
const LEAST_CAUSTICS: f64 = 0.75;
/// Part of the light on what the camera sees above which caustics are much of it. Scenes whose caustics are most of their noise have 0.24
/// (`glass-caustic`) and 0.97 (a torus in glass); rooms with glasses, panes and polished metal at most 0.07.
pub(super) const MUCH: f64 = 0.125;

/// Light paths for each camera path, given the second moment of guided samples with photons over that without: lowered by a
/// third or more it is worth as many as camera paths, by a twentieth or less none. In eighths, so that it does not flicker.
fn photon_share(gain: f64) -> f64 {
    ((((1.0 - gain) - 0.05) / 0.28 * 8.0).ceil() / 8.0).clamp(0.0, 1.0)
}

impl Learning {
    /// A start without data for a scene whose lights have the powers `emitted`.
    pub fn new(settings: &RenderSettings, emitted: &Discrete) -> Self {
        Self {
            emission: EmissionGuide::new(emitted),
            emission_learner: EmissionLearner::new(emitted),
            learner: Learner::new(settings.learner.clone()),
            iterations: 0,
            reconstruction_rays: 0.0,
            arrived: [0.0; 2],
            on_trial: None,
            unseen: None,
            photon_share: if settings.samples.photons() { 1.0 } else { 0.0 },
        }
    }

    /// State for checkpoints apart from the learner's and the photons' own.
    pub(super) fn numbers(&self) -> [f64; 6] {
        let [arrived, caustic] = self.arrived;
        let unseen = self.unseen.unwrap_or(UNTOLD);
        [self.photon_share, f64::from(self.iterations), self.reconstruction_rays, arrived, caustic, unseen]
    }

    /// Reads from a checkpoint what was learned of a scene whose lights have the powers `emitted`.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn from_arrays(settings: &RenderSettings, emitted: &Discrete, file: &Tensors) -> Result<Self> {
        let numbers = file.read("learning", Dtype::F64, Some(6), 1, f64::from_le_bytes)?;
        let [photon_share, iterations, reconstruction_rays, arrived, caustic, unseen] = numbers[..] else {
            return file.fail("learning", format!("{} numbers", numbers.len()));
        };
        if !(0.0..=1.0).contains(&photon_share) {
            return file.fail("learning", format!("{photon_share} light paths for each camera path"));
        }
        let learner = Learner::from_arrays(settings.learner.clone(), file)?;
        let (emission, emission_learner) = emission::from_arrays(emitted, file)?;
        let iterations = iterations as u32;
        let arrived = [arrived, caustic];
        let learning = Self { learner, emission, emission_learner, photon_share, ..Self::new(settings, emitted) };
        let unseen = (unseen != UNTOLD).then_some(unseen);
        Ok(Self { iterations, reconstruction_rays, arrived, unseen, ..learning })
    }

    /// Lets the paths of the next pass only judge the guides: light paths and all that is learned wait for
    /// [`PassTracer::settle`](super::PassTracer::settle), which is not needed where the guides are given up.
    pub(super) fn begin_trial(&mut self) {
        self.on_trial = Some(Vec::new());
    }

    /// Whether a pass is on trial.
    pub(super) fn is_on_trial(&self) -> bool {
        self.on_trial.is_some()
    }

    /// Ends the trial of a pass and returns its path samples.
    pub(super) fn end_trial(&mut self) -> Vec<PathRecord> {
        self.on_trial.take().unwrap_or_default()
    }

    /// Judges guides by the path samples of a chunk of a pass on trial.
    pub(super) fn judge(&mut self, mut paths: Vec<PathRecord>, seconds: &mut Seconds) {
        let begun = Instant::now();
        self.learner.judge(&paths);
        if let Some(kept) = &mut self.on_trial {
            kept.append(&mut paths);
        }
        seconds.splat += begun.elapsed().as_secs_f64();
    }

    /// Learns from the records of a pass whose paths have judged guides.
    pub(super) fn deposit(&mut self, records: &Records, kinds: SampleKinds, seconds: &mut Seconds) {
        let begun = Instant::now();
        let voxels = self.learner.deposit(&records.paths, &records.photons, kinds.paths());
        self.count_arrivals(records, voxels);
        seconds.splat += begun.elapsed().as_secs_f64();
    }

    /// Deposits the records of one chunk.
    pub fn absorb(&mut self, records: &Records, kinds: SampleKinds, seconds: &mut Seconds) {
        let begun = Instant::now();
        let voxels = self.learner.absorb(&records.paths, &records.photons, kinds.paths());
        self.count_arrivals(records, voxels);
        seconds.splat += begun.elapsed().as_secs_f64();
    }

    /// Counts the power of photons that fell into voxels, and learns from where they started.
    fn count_arrivals(&mut self, records: &Records, voxels: Vec<VoxelId>) {
        let mut power = vec![0.0f64; records.starts.len()];
        for (photon, _) in records.photons.iter().zip(voxels).filter(|(_, voxel)| *voxel != VoxelId::MAX) {
            power[photon.path as usize] += f64::from(photon.power);
            self.arrived[0] += f64::from(photon.power);
            self.arrived[1] += if photon.caustic { f64::from(photon.power) } else { 0.0 };
        }
        let useful = records.starts.iter().zip(power).filter(|(_, power)| *power > 0.0);
        let useful: Vec<(Start, f64)> = useful.filter_map(|(start, power)| Some(((*start)?, power))).collect();
        self.emission_learner.absorb(&useful);
    }

    /// Part of the light on what the camera sees that delta lobes sent there, by photons, beside direct light; none without photons.
    pub fn caustics(&self) -> Option<f64> {
        let [all, caustic] = self.arrived;
        (all > 0.0).then(|| caustic / all)
    }

    /// Reconstructs the trees of a pass with `spp` camera paths per pixel, publishes the results, refines the voxels. All
    /// reconstruction of the render so far, this one included, may cost as much as tracing `rays` rays.
    ///
    /// # Errors
    /// Those of the reconstructor.
    pub fn end_iteration(
        &mut self,
        spp: u32,
        rays: f64,
        reconstructor: &dyn Reconstructor,
        seconds: &mut Seconds,
    ) -> Result<Iteration> {
        let begun = Instant::now();
        let left = rays - self.reconstruction_rays;
        let mut spent = 0.0;
        let iteration = self.iterations;
        self.learner.fit(&mut |trees| {
            if !reconstructor.admits(trees, iteration) {
                return AsCounted::default().reconstruct(trees);
            }
            let (proposals, cost) = reconstruct_within(left, trees, reconstructor)?;
            spent = cost;
            Ok(proposals)
        })?;
        self.reconstruction_rays += spent;
        let reconstruct_seconds = begun.elapsed().as_secs_f64();
        seconds.reconstruct += reconstruct_seconds;
        let nodes = self.learner.model().nodes();
        if self.photon_share > 0.0 {
            let least = match self.caustics() {
                _ if self.iterations >= PATIENCE => 0.0,
                Some(part) if part > MUCH => LEAST_CAUSTICS,
                _ => LEAST_PHOTONS,
            };
            let unknown = if self.learner.has_photons() { self.photon_share } else { 0.0 };
            self.photon_share = self.learner.photon_gain().map_or(unknown, photon_share).max(least);
        }
        self.iterations += 1;
        self.arrived = [0.0; 2];
        let begun = Instant::now();
        self.emission = self.emission_learner.publish();
        self.learner.refine(spp);
        seconds.splat += begun.elapsed().as_secs_f64();
        Ok(Iteration { voxels: self.learner.voxels(), nodes, reconstruct_seconds, ..Iteration::default() })
    }

    /// The field that guides an iteration which began with `voxels` voxels.
    pub fn field_of(&self, voxels: usize) -> GuideField {
        self.learner.field_of(voxels, Use::Learning)
    }
}
