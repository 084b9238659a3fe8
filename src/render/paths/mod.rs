//! Rendering guided by complete paths (Reibold 2018): learning, and the picture. The algorithm is in [`crate::guiding::paths`]. The rest of
//! the samples are the path tracer's, with a guide of directions where there is one, which the paper does not do.
//!
//! With W pixels, one path of the path tracer in each and r·W guided ones, the one-sample estimator of a pixel is f / (p_u + r·W·p_g / h), h the
//! density of the pixel's filter at the path's place. A guided path adds to every pixel in whose filter it lies. r = 1 is u = ½ of the paper's
//! eq. 6.

mod learn;
mod picture;

use super::camera::camera_film;
use super::control::Control;
use super::run::{Rendered, Run};
use super::settings::{GuideMode, RenderSettings, StopRule};
use crate::base::random::Random;
use crate::base::{Error, Result};
use crate::guiding::sample::field::GuideField;
use crate::integrators::guided::Expected;
use crate::integrators::path::CameraPath;
use crate::scene::Scene;

/// Makes the random numbers of guided paths differ from those of others, and those of learning from those of the picture.
const GUIDED_STREAM: u64 = 1 << 62;
const LEARNING_SEED: u64 = 0x9A7B_5EED_0C0D_E001;

/// Refuses learning that is kept: complete paths are not kept in files.
pub(super) fn refuse(settings: &RenderSettings) -> Result<()> {
    if settings.complete_paths > 0.0 {
        return Err(Error::Options("complete paths are no guide that could be saved, loaded or shared".into()));
    }
    Ok(())
}

/// Refuses what a picture by complete paths, if it is one, cannot be.
pub(super) fn check(scene: &Scene, settings: &RenderSettings, control: &Control) -> Result<()> {
    if settings.complete_paths == 0.0 {
        return Ok(());
    }
    if !(0.0..=1.0).contains(&settings.complete_paths) {
        return Err(Error::Options(format!(
            "{} complete paths for each path: expected 0 to 1",
            settings.complete_paths
        )));
    }
    let option = if settings.guide == GuideMode::Paths { "--guide paths" } else { "--complete-paths" };
    let refused = |what: &str| Err(Error::Options(format!("{option}: {what}")));
    if settings.guide == GuideMode::None {
        return refused("there are no samples to learn from under --guide none; give --guide paths");
    }
    if settings.transport.guided_distances {
        return refused(
            "distances that a guide chooses have no density that could be told; leave --guided-distances out",
        );
    }
    if control.checkpoint.is_some() {
        return refused("kept paths are in no checkpoint; leave --checkpoint and --resume out");
    }
    if settings.part.is_some() {
        return refused("parts do not learn, and there is no guide that they could load");
    }
    if matches!(settings.stop, StopRule::TargetError(_)) {
        return refused("there is no estimate of its error; give --spp or --time");
    }
    if scene.views() > 1 {
        return refused("it guides one view; render the views one by one");
    }
    if settings.adaptive && settings.guide == GuideMode::Paths {
        return refused("guided paths fall where they may, not where noise is; leave --adaptive out");
    }
    Ok(())
}

/// What paths are drawn by: kept ones, and the guide of the path tracer beside them.
#[derive(Clone, Copy)]
struct Guides<'a> {
    field: Option<&'a GuideField>,
    /// See [`GuidedTracer::expected`].
    expected: Option<Expected<'a>>,
}

/// A camera path with its place in the picture.
struct Placed {
    film: [f32; 2],
    path: CameraPath,
}

impl Placed {
    fn new(scene: &Scene, film: [f32; 2], random: Random, guides: Guides) -> Self {
        let ray = scene.camera_ray(0, film, scene.camera.lens(&random));
        // Of the pixel in which it lies, whichever it is for: then its density does not depend on that.
        let pixel = guides.field.and(guides.expected).map(|expected| expected.at(film));
        Self { film, path: CameraPath { ray, random, pixel } }
    }
}

impl Run<'_> {
    /// Renders what is left of the picture by complete paths and by the path tracer with `field`; none where no paths are kept.
    pub(super) fn by_paths(&mut self, field: Option<&GuideField>) -> Result<Option<Rendered>> {
        // One without voxels, of a guide that was given up or not begun, would only be looked up in vain.
        let field = field.filter(|field| !field.voxels().is_empty());
        let (values, window) = (self.pixel_values(), self.window);
        let guides = Guides { field, expected: values.as_deref().map(|values| Expected { values, window }) };
        let paths = self.learn_paths(guides);
        if paths.is_empty() {
            return Ok(None);
        }
        self.statistics.guide.paths = paths.len();
        self.statistics.guide.bytes += paths.bytes();
        self.guided_picture(&paths, guides).map(Some)
    }
}
