//! `fanal render`.

use std::sync::atomic::AtomicBool;

use super::{in_pool, load_scene, not_built_yet};
use crate::base::{Error, Progress, Result};
use crate::cli::args::RenderArgs;
use crate::cli::resolve::{RenderRequest, resolve};
use crate::cli::{interrupt, progress};
use crate::film::{check_folder, check_writable};
use crate::materials::image::Image;
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

/// SEAM: here `request` goes to `crate::render`; then the picture is written with `film::write_or_rescue`, and the statistics.
fn render(
    _request: &RenderRequest,
    _scene: &LoadedScene,
    _reference: Option<&Image>,
    _progress: &dyn Progress,
    _stop: &AtomicBool,
) -> Result<()> {
    Err(not_built_yet("rendering"))
}
