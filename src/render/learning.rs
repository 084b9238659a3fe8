//! The learner at work inside a render: records in, distributions out, with the time that each takes.

use std::time::Instant;

use super::settings::{RenderSettings, SampleKinds};
use super::statistics::{Iteration, Seconds};
use crate::base::Result;
use crate::base::tensors::{Dtype, Tensors};
use crate::guiding::cache::VoxelId;
use crate::guiding::learn::emission::{self, EmissionGuide, EmissionLearner, Start};
use crate::guiding::learn::learner::{Learner, Use};
use crate::guiding::moments::PictureMoments;
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::sample::field::GuideField;
use crate::reconstruct::{Reconstructor, reconstruct_within};
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
    /// Second moments of contributions to the picture, measured by the last iteration.
    pub moments: PictureMoments,
    /// Cost of reconstruction so far, in rays traced.
    reconstruction_rays: f64,
}

/// Iterations in which photons are never given up: path samples that have not found the light cannot judge them.
const PATIENCE: u32 = 4;
/// Fewest light paths for each camera path in these iterations.
const LEAST_PHOTONS: f64 = 0.25;

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
            moments: PictureMoments::default(),
            reconstruction_rays: 0.0,
            photon_share: if settings.samples.photons() { 1.0 } else { 0.0 },
        }
    }

    /// State for checkpoints apart from the learner's and the photons' own. Moments are measured anew by each iteration.
    pub(super) fn numbers(&self) -> [f64; 3] {
        [self.photon_share, f64::from(self.iterations), self.reconstruction_rays]
    }

    /// Reads from a checkpoint what was learned of a scene whose lights have the powers `emitted`.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn from_arrays(settings: &RenderSettings, emitted: &Discrete, file: &Tensors) -> Result<Self> {
        let numbers = file.read("learning", Dtype::F64, Some(3), 1, f64::from_le_bytes)?;
        let [photon_share, iterations, reconstruction_rays] = [numbers[0], numbers[1], numbers[2]];
        if !(0.0..=1.0).contains(&photon_share) {
            return file.fail("learning", format!("{photon_share} light paths for each camera path"));
        }
        let learner = Learner::from_arrays(settings.learner.clone(), file)?;
        let (emission, emission_learner) = emission::from_arrays(emitted, file)?;
        let (iterations, moments) = (iterations as u32, PictureMoments::default());
        Ok(Self { learner, emission, emission_learner, photon_share, iterations, moments, reconstruction_rays })
    }

    /// Deposits the records of one chunk.
    pub fn absorb(&mut self, records: &Records, kinds: SampleKinds, seconds: &mut Seconds) {
        let begun = Instant::now();
        let voxels = self.learner.absorb(&records.paths, &records.photons, kinds.paths());
        let mut power = vec![0.0f64; records.starts.len()];
        for (photon, _) in records.photons.iter().zip(voxels).filter(|(_, voxel)| *voxel != VoxelId::MAX) {
            power[photon.path as usize] += f64::from(photon.power);
        }
        let useful = records.starts.iter().zip(power).filter(|(_, power)| *power > 0.0);
        let useful: Vec<(Start, f64)> = useful.filter_map(|(start, power)| Some(((*start)?, power))).collect();
        self.emission_learner.absorb(&useful);
        seconds.splat += begun.elapsed().as_secs_f64();
    }

    /// Reconstructs the trees of a pass with `spp` camera paths per pixel, publishes the results, refines the voxels. All
    /// reconstruction of the render so far, this one included, may cost as much as tracing `rays` rays. The `worst` samples are
    /// left out of the moments that tell whether guiding pays.
    ///
    /// # Errors
    /// Those of the reconstructor.
    pub fn end_iteration(
        &mut self,
        spp: u32,
        worst: usize,
        rays: f64,
        reconstructor: &dyn Reconstructor,
        seconds: &mut Seconds,
    ) -> Result<Iteration> {
        let begun = Instant::now();
        let left = rays - self.reconstruction_rays;
        let mut spent = 0.0;
        self.learner.fit(&mut |trees| {
            let (proposals, cost) = reconstruct_within(left, trees, reconstructor)?;
            spent = cost;
            Ok(proposals)
        })?;
        self.reconstruction_rays += spent;
        self.moments = self.learner.picture_moments(worst);
        let reconstruct_seconds = begun.elapsed().as_secs_f64();
        seconds.reconstruct += reconstruct_seconds;
        let nodes = self.learner.model().nodes();
        if self.photon_share > 0.0 {
            let least = if self.iterations < PATIENCE { LEAST_PHOTONS } else { 0.0 };
            let unknown = if self.learner.has_photons() { self.photon_share } else { 0.0 };
            self.photon_share = self.learner.photon_gain().map_or(unknown, photon_share).max(least);
        }
        self.iterations += 1;
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
