//! Replay of one camera sample, vertex by vertex.

use super::camera::{CameraSample, camera_ray};
use super::control::Control;
use super::final_pass::own_samples;
use super::run::Run;
use super::settings::RenderSettings;
use crate::base::{Error, Result};
use crate::film::PixelFilter;
use crate::guiding::sample::field::GuideField;
use crate::integrators::path::{CameraPath, Explanation, PathTracer};
use crate::picture::Window;
use crate::scene::Scene;

/// A camera sample, as [`Dropped`](super::Dropped) names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Column and row in the whole picture.
    pub pixel: [u32; 2],
    /// Number of the sample among all of its pixel's.
    pub number: u64,
    /// The number at which its pass began; none where its random numbers are independent.
    pub pass_from: Option<u32>,
}

/// Traces one sample of a render again. The render is unguided, or guided by a given `field`: then pixel values are estimated as
/// that render did it, since roulette depends on them. Samples of its first pass, which makes that estimate, are traced without.
///
/// # Errors
/// [`Error::Options`] for a pixel outside of the picture, or a sample before its pass; [`Error::Interrupted`]; errors of rendering.
pub fn replay(
    scene: &Scene,
    settings: &RenderSettings,
    field: Option<GuideField>,
    sample: Sample,
    control: &Control,
) -> Result<Explanation> {
    let [x, y] = sample.pixel;
    Window { x, y, width: 1, height: 1 }.check_inside(scene.size)?;
    if sample.pass_from.is_some_and(|from| u64::from(from) > sample.number) || sample.number >= 1 << 32 {
        return Err(Error::Options(format!("sample {} comes before the pass that it is said to be of", sample.number)));
    }
    let mut run = Run::begin(scene, settings, control)?;
    run.start(own_samples(settings, scene.size, field.as_ref())?)?;
    let mut picture = None;
    if let Some(field) = &field {
        run.known = field.pixel_values().and_then(|known| known.within(run.window));
        run.look(field, None);
        if run.interrupted {
            return Err(Error::Interrupted("the replay was stopped before it knew what the render knew".into()));
        }
        picture = run.pixel_values().filter(|_| sample.number >= u64::from(run.state.rendered));
    }
    let window = settings.window(scene.size);
    let inside = (x.wrapping_sub(window.x) < window.width) && (y.wrapping_sub(window.y) < window.height);
    let index = (y.wrapping_sub(window.y) as usize).wrapping_mul(window.width as usize);
    let value = picture.filter(|_| inside).map(|picture| picture[index + (x - window.x) as usize]);
    let camera = CameraSample { place: sample.pixel, number: sample.number, sequences_from: sample.pass_from };
    let (ray, random) = camera_ray(scene, settings, &PixelFilter::new(settings.filter)?, camera);
    let tracer =
        PathTracer { scene, settings: settings.transport, field: field.as_ref(), lights: (&run.lights).into() };
    Ok(tracer.explain(CameraPath { ray, random, pixel: value }))
}
