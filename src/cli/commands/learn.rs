//! `fanal learn`.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::part::{beside, forget, there_already};
use super::render::{Prepared, report};
use super::{in_pool, load_scene};
use crate::base::{Error, Progress, Result};
use crate::cli::args::{LearnArgs, Outliers, RenderArgs};
use crate::cli::interrupt::Ended;
use crate::cli::resolve::{RenderRequest, resolve};
use crate::cli::{interrupt, print, progress, views};
use crate::guiding::sample::file;
use crate::picture::check_folder;
use crate::render::guide_part::{self, LearnedHead};
use crate::render::{GuideMode, PartOf, Statistics};
use crate::scene::readers::LoadedScene;

/// Learns and writes the guide. What was begun goes on; what is there already is left as it is.
///
/// # Errors
/// Errors of reading, rendering and writing.
pub fn run(args: &LearnArgs) -> Result<Ended> {
    if args.of.guide == GuideMode::None {
        return Err(Error::Options("--guide none learns nothing; choose another mode".into()));
    }
    if args.of.guide == GuideMode::Paths {
        let why = "--guide paths learns complete paths, which no guide file holds; choose another mode";
        return Err(Error::Options(why.into()));
    }
    [Some(&args.output), args.stats.as_ref()].into_iter().flatten().try_for_each(|file| check_folder(file))?;
    let (state, part) = (beside(&args.output), args.part);
    let args = as_render(args);
    in_pool(&args.common, || {
        let begun = Instant::now();
        let mut loaded = load_scene(&args.of.scene, &args.of.how(), &args.common)?;
        let load = begun.elapsed().as_secs_f64();
        views::select(&args.of, &mut loaded)?;
        let mut request = resolve(&args, &loaded.file)?;
        print::warnings(request.unused().as_slice(), args.common.quiet);
        request.settings.part = part;
        loaded.file.render.max_depth = request.settings.transport.max_depth;
        let mut prepared = Prepared::new(&request, &loaded)?;
        prepared.end_in_time(&request, begun, None, false)?;
        if prepared.settings.guide == GuideMode::None {
            return Err(Error::Options("guiding is off in the scene's plan: there is nothing to learn".into()));
        }
        let (stop, progress) = (interrupt::flag()?, progress::progress(args.common.quiet));
        let output = args.save_guide.as_deref().unwrap_or(&state);
        let work = Work { request: &request, loaded: &loaded, prepared: &prepared, output };
        if work.is_done(part) {
            let what = format!("{}: the guide", output.display());
            return there_already(&request, &loaded, &prepared, load, (&what, args.common.quiet));
        }
        let done = match part {
            None => work.whole(&*progress, &stop)?,
            Some(part) => work.part(part, &*progress, &stop)?,
        };
        let Done { mut statistics, unkept, interrupted } = done;
        statistics.seconds.load = load;
        report(&request, &statistics)?;
        let unkept = unkept.map(|why| format!("no checkpoint could be written: {why}"));
        let early = interrupted.then(|| "interrupted; the same command goes on".to_owned());
        print::warnings(&unkept.into_iter().chain(early).collect::<Vec<_>>(), args.common.quiet);
        if interrupted {
            return Ok(Ended::Early);
        }
        forget(&state);
        Ok(Ended::Whole)
    })
}

/// What is to be learned, and where it goes once it is.
struct Work<'a> {
    request: &'a RenderRequest,
    loaded: &'a LoadedScene,
    prepared: &'a Prepared,
    output: &'a Path,
}

/// What learning has come to.
struct Done {
    statistics: Statistics,
    /// Why the last checkpoint could not be written; none where it could.
    unkept: Option<String>,
    interrupted: bool,
}

impl Work<'_> {
    /// Whether the file to write is there already, whole and of the same learning.
    fn is_done(&self, part: Option<PartOf>) -> bool {
        match part {
            None => self.prepared.made_for().is_some_and(|made_for| file::is_done(self.output, made_for)),
            Some(part) => guide_part::is_done(self.output, part, &self.prepared.learned_in_common(self.request)),
        }
    }

    /// Learns the guide and writes it, unless a signal comes before.
    fn whole(&self, progress: &dyn Progress, stop: &AtomicBool) -> Result<Done> {
        let Self { request, loaded, prepared, output } = *self;
        let learned = prepared.learn(request, loaded, progress, stop)?;
        let done = Done { statistics: learned.statistics, unkept: learned.unkept, interrupted: learned.interrupted };
        if !done.interrupted {
            let values = prepared.pixel_values(request, learned.pixel_values);
            let field = learned.field.with_pixel_values(values);
            file::save_learned(output, &field, &learned.evidence, prepared.made_for().unwrap_or_default())?;
        }
        Ok(done)
    }

    /// The same for a part's share.
    fn part(&self, part: PartOf, progress: &dyn Progress, stop: &AtomicBool) -> Result<Done> {
        let Self { request, loaded, prepared, output } = *self;
        let learned = prepared.learn_part(request, loaded, progress, stop)?;
        if !learned.interrupted {
            let head = LearnedHead {
                part,
                in_common: prepared.learned_in_common(request),
                voxels: learned.voxels,
                rays: learned.rays,
                settings: prepared.settings.learner.clone(),
                reconstruction: prepared.settings.reconstruction,
                mode: prepared.settings.mode(),
            };
            let values = prepared.pixel_values(request, learned.pixel_values);
            guide_part::write(output, &head, &learned.learner, values.as_ref())?;
        }
        Ok(Done { statistics: learned.statistics, unkept: learned.unkept, interrupted: learned.interrupted })
    }
}

/// Learning as a render of which the guide alone is wanted.
fn as_render(args: &LearnArgs) -> RenderArgs {
    let state = beside(&args.output);
    RenderArgs {
        of: args.of.clone(),
        output: None,
        save_guide: Some(args.output.clone()),
        load_guide: None,
        spp: args.spp,
        time: args.time,
        target_error: None,
        adaptive: None,
        complete_paths: None,
        part: None,
        display: None,
        aov: Vec::new(),
        denoise: false,
        fireflies: Outliers::Keep,
        kappa: None,
        exposure: None,
        view: None,
        resume: state.exists().then(|| state.clone()),
        checkpoint: Some(state),
        every: Some(args.every),
        replay: None,
        stats: args.stats.clone(),
        reference: None,
        common: args.common.clone(),
        learning: args.learning.clone(),
    }
}
