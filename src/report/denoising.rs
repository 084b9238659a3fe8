//! Pictures of a comparison measured again without their noise.

use std::time::Instant;

use super::results::DenoisedEntry;
use crate::base::Result;
use crate::film::{Denoiser, Features, measure_noisy};
use crate::picture::Image;
use crate::render::{RenderSettings, features};
use crate::scene::Scene;

/// A denoiser and what it is told of the scene, which is the same for every run.
pub struct Denoising<'a> {
    denoiser: &'a Denoiser,
    features: Features,
    /// Seconds to find the features.
    seconds: f64,
}

impl<'a> Denoising<'a> {
    /// Finds the features of `scene` as `settings` render it.
    ///
    /// # Errors
    /// Errors of [`features`].
    pub fn new(denoiser: &'a Denoiser, scene: &Scene, settings: &RenderSettings) -> Result<Self> {
        let begun = Instant::now();
        let features = features(scene, settings)?;
        Ok(Self { denoiser, features, seconds: begun.elapsed().as_secs_f64() })
    }

    /// Errors of a picture without its noise, and the time that this takes.
    ///
    /// # Errors
    /// Errors of denoising and of measuring.
    pub fn measured(&self, picture: &Image, reference: &Image, variance: Option<&Image>) -> Result<DenoisedEntry> {
        let begun = Instant::now();
        let denoised = self.denoiser.denoise(picture, &self.features)?;
        let seconds = self.seconds + begun.elapsed().as_secs_f64();
        Ok(DenoisedEntry { seconds, errors: (&measure_noisy(&denoised, reference, variance)?).into() })
    }
}
