//! Rendering guided by complete paths (Reibold 2018): learning, and the picture. The algorithm is in [`crate::guiding::paths`].
//!
//! As many paths are drawn from the kept ones as the path tracer draws, which is u = ½ of the paper's eq. 6: with W pixels, one path of the
//! path tracer in each and W guided ones, the one-sample estimator of a pixel is f / (p_u + W·p_g / h), h the density of the pixel's filter
//! at the path's place. A guided path adds to every pixel in whose filter it lies.

mod learn;
mod picture;

use super::Outcome;
use super::camera::camera_film;
use super::control::Control;
use super::run::Run;
use super::settings::{GuideMode, RenderSettings, StopRule};
use crate::base::random::Random;
use crate::base::{Error, Result};
use crate::guiding::paths::guide::PathGuide;
use crate::integrators::path::CameraPath;
use crate::scene::Scene;

/// Makes the random numbers of guided paths differ from those of others, and those of learning from those of the picture.
const GUIDED_STREAM: u64 = 1 << 62;
const LEARNING_SEED: u64 = 0x9A7B_5EED_0C0D_E001;

/// Refuses a render that is no picture by complete paths: these are not kept in files.
pub(super) fn refuse(settings: &RenderSettings) -> Result<()> {
    if settings.guide == GuideMode::Paths {
        return Err(Error::Options("--guide paths keeps no guide that could be saved, loaded or shared".into()));
    }
    Ok(())
}

/// Refuses what a picture by complete paths cannot be.
pub(super) fn check(scene: &Scene, settings: &RenderSettings, control: &Control) -> Result<()> {
    let refused = |what: &str| Err(Error::Options(format!("--guide paths: {what}")));
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
    if settings.adaptive {
        return refused("guided paths fall where they may, not where noise is; leave --adaptive out");
    }
    Ok(())
}

/// A camera path with its place in the picture.
struct Placed {
    film: [f32; 2],
    path: CameraPath,
}

impl Placed {
    fn new(scene: &Scene, film: [f32; 2], random: Random) -> Self {
        let ray = scene.camera.ray(film, scene.camera.lens(&random));
        Self { film, path: CameraPath { ray, random, pixel: None } }
    }
}

impl Run<'_> {
    /// Renders the picture, and ends the render.
    pub(super) fn by_paths(mut self) -> Result<Outcome> {
        let guide = if self.scene.has_grids() {
            // Delta and ratio tracking have no density that could be told of a path.
            self.statistics.decisions.push("off: paths through media that vary are not guided".into());
            PathGuide::default()
        } else {
            self.learn_paths()
        };
        if guide.is_empty() {
            return self.finish(None);
        }
        self.statistics.guide.nodes = guide.len();
        self.statistics.guide.bytes = guide.bytes();
        let rendered = self.guided_picture(&guide)?;
        Ok(self.end(rendered, None))
    }
}
