//! `fanal render --part`: a part of a picture, for `fanal merge`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::render::{Prepared, attributes, report};
use super::{in_pool, load_scene};
use crate::base::{Error, Result};
use crate::cli::args::RenderArgs;
use crate::cli::interrupt::Ended;
use crate::cli::resolve::{RenderRequest, resolve};
use crate::cli::views::View;
use crate::cli::{interrupt, print, progress, views};
use crate::guiding::sample::field::GuideField;
use crate::picture::{Window, check_folder};
use crate::render::part_file::{self, PartHead, Totals, is_done};
use crate::render::{Aov, PartOf, StopRule, aov, samples_of_parts};
use crate::scene::readers::LoadedScene;

/// Renders the part and writes its file. A part that is there already is left as it is; one that was begun goes on.
///
/// # Errors
/// Errors of reading, rendering and writing; [`Error::Options`] for a guide that does not know what a window of the picture needs.
pub fn run(args: &RenderArgs, part: PartOf) -> Result<Ended> {
    let output = args.output.clone().unwrap_or_default();
    [Some(&output), args.stats.as_ref()].into_iter().flatten().try_for_each(|file| check_folder(file))?;
    let state = beside(&output);
    let args =
        RenderArgs { checkpoint: Some(state.clone()), resume: state.exists().then(|| state.clone()), ..args.clone() };
    in_pool(&args.common, || {
        let begun = Instant::now();
        let mut loaded = load_scene(&args.of.scene, &args.of.how(), &args.common)?;
        let load = begun.elapsed().as_secs_f64();
        views::select(&args.of, &mut loaded)?;
        let mut request = resolve(&args, &loaded.file)?;
        print::warnings(request.unused().as_slice(), args.common.quiet);
        loaded.file.render.max_depth = request.settings.transport.max_depth;
        let prepared = Prepared::new(&request, &loaded)?;
        let head = head(&request, &prepared, part)?;
        if is_done(&output, &head) {
            let work = format!("{}: part {part}", output.display());
            return there_already(&request, &loaded, &prepared, load, (&work, args.common.quiet));
        }
        // Layers of the film are made of all parts, the others by the first.
        request.aovs.retain(|aov| part.index() == 1 && !aov.is_of_film());
        let (stop, progress) = (interrupt::flag()?, progress::progress(args.common.quiet));
        let (mut outcome, channels) = prepared.render(&request, &loaded, &*progress, &stop, None)?;
        outcome.statistics.seconds.load = load;
        report(&request, &outcome.statistics)?;
        let unkept = outcome.unkept.map(|why| format!("no checkpoint could be written: {why}"));
        let early = outcome.interrupted.then(|| format!("interrupted; the same command goes on with part {part}"));
        print::warnings(&unkept.into_iter().chain(early).collect::<Vec<_>>(), args.common.quiet);
        if outcome.interrupted {
            return Ok(Ended::Early);
        }
        let layer_attributes = aov::header(prepared.scene(), &request.aovs, &channels);
        let head = PartHead { totals: Totals::of(&outcome.statistics), layer_attributes, ..head };
        part_file::write(&output, &head, &outcome.blocks, outcome.cascade.as_ref(), &channels)?;
        forget(&state);
        Ok(Ended::Whole)
    })
}

/// Ends a command whose `work` was done before, and says so unless it is to be `quiet`.
///
/// # Errors
/// Those of writing statistics and of printing.
pub fn there_already(
    request: &RenderRequest,
    loaded: &LoadedScene,
    prepared: &Prepared,
    load: f64,
    (work, quiet): (&str, bool),
) -> Result<Ended> {
    let mut statistics = prepared.no_work(request, loaded);
    statistics.seconds.load = load;
    report(request, &statistics)?;
    if !quiet {
        print::line(&format!("{work} is there already"))?;
    }
    Ok(Ended::Whole)
}

/// The file beside `output` that keeps the state of unfinished work.
pub fn beside(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".checkpoint");
    output.with_file_name(name)
}

/// Removes the state of finished work. One that stays is of no harm: it goes on where the work ends.
pub fn forget(state: &Path) {
    let _ = std::fs::remove_file(state);
}

fn head(request: &RenderRequest, prepared: &Prepared, part: PartOf) -> Result<PartHead> {
    let StopRule::Spp(spp) = prepared.settings.stop else {
        return Err(Error::Options("--part: parts are ranges of samples; give --spp".into()));
    };
    let guide = prepared.guide();
    let samples = samples_of_parts(&prepared.settings, spp, request.size, guide);
    part.samples(samples)?;
    check_window(request, guide)?;
    let Window { x, y, width, height } = prepared.settings.window(request.size);
    let camera = request.views.first().and_then(View::attribute);
    let film_layers = [Aov::Samples, Aov::Variance].map(|aov| request.aovs.contains(&aov));
    let others = request.aovs.iter().filter(|aov| !aov.is_of_film());
    Ok(PartHead {
        part,
        merged: 0,
        in_common: prepared.in_common(request),
        size: request.size,
        window: [x, y, width, height],
        samples,
        spp,
        detailed: prepared.settings.keeps_spread,
        film_layers,
        fireflies: prepared.settings.fireflies.kappa(),
        channels: others.flat_map(|aov| aov.channels()).collect(),
        attributes: attributes(request, &prepared.settings).into_iter().chain(camera).collect(),
        layer_attributes: Vec::new(),
        totals: Totals::default(),
    })
}

/// Refuses a window that would be judged by what it shows itself: the whole picture is judged by more.
fn check_window(request: &RenderRequest, guide: Option<&GuideField>) -> Result<()> {
    let knows =
        |guide: &GuideField| guide.pixel_values().is_some_and(|known| known.window == Window::whole(request.size));
    if request.settings.crop.is_none() || guide.is_none_or(knows) {
        return Ok(());
    }
    Err(Error::Options(
        "--crop: the guide was learned for another picture than this is a window of; learn one with the same scene, camera, depth and \
         size, without --crop"
            .into(),
    ))
}
