//! `fanal render`.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::{in_pool, load_scene};
use crate::base::files::write_bytes;
use crate::base::{Error, Progress, Result};
use crate::cli::args::{Backend, RenderArgs};
use crate::cli::resolve::{RenderRequest, resolve};
use crate::cli::{interrupt, progress};
use crate::film::{check_folder, check_writable, measure, write_or_rescue};
use crate::materials::image::Image;
use crate::reconstruct::{Counted, Neural, Reconstructor};
use crate::render::{self, ErrorPoint, GuideMode, RenderSettings, Statistics};
use crate::scene::Scene;
use crate::scene::plan::plan;
use crate::scene::readers::{LoadedScene, read_image};

/// Loads, checks everything that can be known beforehand, renders.
///
/// # Errors
/// Everything that reading, rendering and writing can say.
pub fn run(args: &RenderArgs) -> Result<()> {
    check_writable(&args.output)?;
    args.stats.as_deref().map_or(Ok(()), check_folder)?;
    in_pool(&args.common, || {
        let loaded = load_scene(&args.scene, &args.common)?;
        let request = resolve(args, &loaded.file)?;
        let reference = reference(&request)?;
        let stop = interrupt::flag()?;
        render(&request, &loaded, reference.as_ref(), &*progress::progress(args.common.quiet), &stop)
    })
}

/// The reference, if there is one and it fits.
fn reference(request: &RenderRequest) -> Result<Option<Image>> {
    let Some(path) = &request.reference else { return Ok(None) };
    let image = read_image(path, false)?;
    let [width, height] = request.size.map(|n| n as usize);
    if (image.width, image.height) != (width, height) {
        return Err(Error::Options(format!(
            "{}: the reference is {}x{} pixels, the picture {width}x{height}; give --size",
            path.display(),
            image.width,
            image.height
        )));
    }
    Ok(Some(image))
}

/// Renders, writes the picture and the statistics.
fn render(
    request: &RenderRequest,
    loaded: &LoadedScene,
    reference: Option<&Image>,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<()> {
    let settings = request.settings();
    let reconstructor = reconstructor(request, &settings)?;
    let begun = Instant::now();
    let scene = Scene::build(loaded, request.size)?;
    let build = begun.elapsed().as_secs_f64();
    let outcome = render::render(&scene, &settings, reconstructor.as_ref(), progress, stop)?;
    let mut statistics = outcome.statistics;
    statistics.scene = request.scene.display().to_string();
    statistics.seconds.build = build;
    statistics.effects = plan(&loaded.file).effects;
    if let Some(reference) = reference {
        let measures = measure(&outcome.image, reference)?;
        statistics.errors.push(ErrorPoint {
            seconds: statistics.seconds.total,
            spp: statistics.spp,
            relmse: measures.relmse,
            relmse_trimmed: measures.relmse_trimmed,
        });
    }
    let begun = Instant::now();
    let written = write_or_rescue(&request.output, &outcome.image, &attributes(&statistics));
    statistics.seconds.write = begun.elapsed().as_secs_f64();
    if let Some(path) = &request.stats {
        let text = serde_json::to_vec_pretty(&statistics)
            .map_err(|e| Error::Options(format!("the statistics are no JSON: {e}")))?;
        write_bytes(path, &text)?;
    }
    written
}

/// What makes distributions in the mode asked for.
fn reconstructor(request: &RenderRequest, settings: &RenderSettings) -> Result<Box<dyn Reconstructor>> {
    if settings.guide != GuideMode::Neural {
        return Ok(Box::new(Counted::default()));
    }
    let neural = match (&request.model, request.backend) {
        (None, Backend::Embedded) => Neural::built_in()?,
        (Some(folder), Backend::Embedded) => Neural::embedded(folder)?,
        #[cfg(feature = "onnx")]
        (Some(folder), Backend::Onnx) => Neural::onnx(folder)?,
        #[cfg(feature = "onnx")]
        (None, Backend::Onnx) => {
            return Err(Error::Options("--backend onnx needs --model DIR, the folder with the ONNX files".into()));
        }
        #[cfg(not(feature = "onnx"))]
        (_, Backend::Onnx) => {
            return Err(Error::Options("this program was built without the onnx feature".into()));
        }
    };
    neural.check_mode(&settings.mode())?;
    Ok(Box::new(neural))
}

/// What the header of an EXR file says about its making.
fn attributes(statistics: &Statistics) -> Vec<(String, String)> {
    [
        ("software", format!("fanal {}", env!("CARGO_PKG_VERSION"))),
        ("scene", statistics.scene.clone()),
        ("method", statistics.method.clone()),
        ("seed", statistics.seed.to_string()),
        ("spp", statistics.spp.to_string()),
        ("droppedSamples", statistics.dropped_samples.to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .to_vec()
}
