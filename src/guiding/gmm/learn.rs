//! The mixtures of all voxels while they learn.

use rayon::prelude::*;

use super::fit::{Arrived, LearnedMixture};
use super::mixture::GaussianMixture;
use crate::guiding::mixtures::{Learning, Mixtures, some, value};
use crate::guiding::samples::Told;
use crate::guiding::target::Target;
use crate::math::cylindrical;

/// The mixtures of all voxels while they learn.
pub type GaussianMixtures = Mixtures<LearnedMixture>;

impl Learning for LearnedMixture {
    type Frozen = GaussianMixture;
    const NAME: &'static str = "gmm";

    fn len(&self) -> usize {
        self.len()
    }

    fn decay(&mut self, part: f64) {
        self.decay(part);
    }

    fn bytes(&self) -> usize {
        GaussianMixture::bytes_of(self.len())
    }

    fn frozen(&self, _: Target) -> Option<GaussianMixture> {
        self.frozen()
    }
}

impl GaussianMixtures {
    /// Learns from the samples of a chunk, as seen from the voxels' centres.
    pub(in crate::guiding) fn observe(&mut self, told: &Told) {
        self.voxels.par_iter_mut().enumerate().for_each(|(v, voxel)| {
            let sphere = &told.spheres[v].learned;
            let at = |point, direction| cylindrical::to_square(sphere.to_centre(point, direction).direction);
            let paths = some(told.samples.directed(v).filter(|_| told.paths))
                .map(|of| Arrived { place: at(of.point, of.direction), value: value(of, told.learned) });
            let photons = some(told.samples.photons(v))
                .map(|of| Arrived { place: at(of.point, of.direction), value: f64::from(of.power) });
            let [paths, photons]: [Vec<Arrived>; 2] = [paths.collect(), photons.collect()];
            if !(paths.is_empty() && photons.is_empty()) {
                voxel.learn([&paths, &photons]);
            }
        });
    }
}
