//! `fanal render`.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::denoised::{self, Denoised};
use super::{in_pool, load_scene};
use crate::base::files::{crc32, read_bytes, write_json};
use crate::base::{Error, Progress, Result};
use crate::cli::args::{Backend, RenderArgs};
use crate::cli::interrupt::Ended;
use crate::cli::resolve::{RenderRequest, resolve};
use crate::cli::views::View;
use crate::cli::{interrupt, print, progress, views};
use crate::film::{Denoiser, measure};
use crate::guiding::sample::field::{GuideField, PixelValues};
use crate::guiding::sample::file;
use crate::network::config::Mode;
use crate::picture::{
    Attribute, Canvas, Channel, Display, Image, Picture, Viewer, Window, check_folder, check_writable, matched,
    read_image, window_of, write_or_rescue, write_picture,
};
use crate::reconstruct::buckets::Buckets;
use crate::reconstruct::{Neural, Reconstructor};
use crate::render::guide_part::PartLearned;
use crate::render::part_file::Totals;
use crate::render::{
    self, Aov, Checkpointing, Control, ErrorPoint, Fireflies, GuideMode, Learned, Outcome, Refresh, RenderSettings,
    Snapshot, Statistics, StopRule, aov, checkpoint, merge,
};
use crate::scene::Scene;
use crate::scene::overrides::decide;
use crate::scene::plan::{EffectKind, EffectPlan, plan};
use crate::scene::readers::LoadedScene;

/// Least time between two pictures that are written while rendering.
const REFRESH: Duration = Duration::from_secs(2);
/// Least time between two pictures in a viewer.
const LIVE: Duration = Duration::from_millis(500);
/// Time that a viewer has for taking the last picture, once that is written.
const PATIENCE: Duration = Duration::from_secs(5);

/// Loads, checks everything that can be known beforehand, renders.
///
/// # Errors
/// Errors of reading, rendering and writing.
pub fn run(args: &RenderArgs) -> Result<Ended> {
    args.output.as_deref().map_or(Ok(()), check_writable)?;
    check_files(args)?;
    let viewer = args.display.as_ref().map(Viewer::connect).transpose()?;
    in_pool(&args.common, || {
        let begun = Instant::now();
        // First of all: who waits for a picture should not learn at its end that this is missing.
        let denoiser = args.denoise.then(Denoiser::new).transpose()?;
        let mut loaded = load_scene(&args.of.scene, &args.of.how(), &args.common)?;
        let load = begun.elapsed().as_secs_f64();
        views::select(&args.of, &mut loaded)?;
        let request = resolve(args, &loaded.file)?;
        print::warnings(request.unused().as_slice(), args.common.quiet);
        request.views.iter().try_for_each(|view| check_writable(&view.output))?;
        loaded.file.render.max_depth = request.settings.transport.max_depth;
        let reference = reference(&request)?;
        let stop = interrupt::flag()?;
        let progress = progress::progress(args.common.quiet);
        let beside = Beside { denoiser: denoiser.as_ref(), reference: reference.as_ref(), viewer };
        let made = render(&request, &loaded, begun, beside, &*progress, &stop)?;
        let Made { mut statistics, written, unkept, unshown, interrupted } = made;
        let unkept = unkept.map(|why| format!("no checkpoint could be written: {why}"));
        let early = interrupted.then(|| format!("interrupted after {} samples per pixel", statistics.spp));
        let empty = request.save_guide.as_ref().filter(|_| statistics.guide.voxels == 0);
        let empty = empty.map(|path| format!("{}: the guide is empty: guiding was given up or off", path.display()));
        let unused = request.load_guide.as_ref().filter(|_| statistics.method == GuideMode::None.name());
        let unused = unused.map(|path| format!("{}: the guide is not used: guiding is off", path.display()));
        let warnings: Vec<String> = unkept.into_iter().chain(unshown).chain(early).chain(empty).chain(unused).collect();
        print::warnings(&warnings, args.common.quiet);
        statistics.seconds.load = load;
        // A picture that had to be saved elsewhere has statistics all the same.
        let reported = report(&request, &statistics);
        // Where both fail, the message that says where the picture is matters more.
        written.and(reported)?;
        tell(&request, &statistics, begun.elapsed(), args.common.quiet)?;
        Ok(if interrupted { Ended::Early } else { Ended::Whole })
    })
}

/// Says what was made: to who watches, and the error against a reference where no statistics hold it.
fn tell(request: &RenderRequest, statistics: &Statistics, took: Duration, quiet: bool) -> Result<()> {
    let [first, more @ ..] = &request.views[..] else { return Ok(()) };
    let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
    let (picture, spp, seconds) = (first.output.display(), statistics.spp, took.as_secs_f64());
    print::to_who_watches(&format!("{picture}{more}: {spp} samples per pixel in {seconds:.1} s"), quiet);
    let written = statistics.denoised_error.as_ref().or(statistics.errors.last());
    let error = written.filter(|_| request.reference.is_some() && request.stats.is_none());
    error.map_or(Ok(()), |e| print::line(&format!("relMSE {:.3e}, trimmed {:.3e}", e.relmse, e.relmse_trimmed)))
}

/// Refuses to begin a render whose files beside the picture could not be written, or whose checkpoints would replace what
/// there is of an earlier one.
///
/// # Errors
/// [`Error::Io`] naming the file or its folder; [`Error::Options`] naming the checkpoint, or a file that two options name.
pub fn check_files(args: &RenderArgs) -> Result<()> {
    // The checkpoint to resume from is kept up to date unless another one is written.
    let checkpoint = args.checkpoint.as_ref().or(args.resume.as_ref());
    let others = [args.stats.as_ref(), args.save_guide.as_ref(), checkpoint].into_iter().flatten();
    others.clone().map(PathBuf::as_path).try_for_each(check_folder)?;
    let files: Vec<&PathBuf> = args.output.iter().chain(others).collect();
    if let Some((_, file)) = files.iter().enumerate().find(|(i, file)| files[..*i].contains(file)) {
        return Err(Error::Options(format!("{}: two options name this file to be written", file.display())));
    }
    check_not_there(args)
}

/// Refuses checkpoints that would replace what there is of an earlier render.
fn check_not_there(args: &RenderArgs) -> Result<()> {
    let replaced = args.checkpoint.as_ref().filter(|path| args.resume.as_ref() != Some(path) && path.is_file());
    replaced.map_or(Ok(()), |path| {
        let path = path.display();
        Err(Error::Options(format!(
            "{path}: there is a checkpoint already: go on from it with --resume {path}, or remove it"
        )))
    })
}

/// The reference, if there is one and it fits.
fn reference(request: &RenderRequest) -> Result<Option<Image>> {
    let Some(path) = &request.reference else { return Ok(None) };
    let image = matched(read_image(path, false)?, window_of(path), request.placed())?;
    let Window { width, height, .. } = request.settings.window(request.size);
    if (image.width, image.height) != (width as usize, height as usize) {
        return Err(Error::Options(format!(
            "{}: the reference is {}x{} pixels, the picture {width}x{height}; give --size",
            path.display(),
            image.width,
            image.height
        )));
    }
    Ok(Some(image))
}

/// Time to write a picture, in seconds per pixel: measured for EXR files, PNG files take less.
const WRITING: f64 = 4e-7;
/// Time to write each further channel, in seconds per pixel.
const LAYER_WRITING: f64 = 1.5e-7;
/// Time to find features, in seconds per pixel on one thread.
const FEATURES: f64 = 16e-7;
/// Time to find what mattes show, in seconds per pixel on one thread.
const MATTES: f64 = 40e-7;

/// Time to take fireflies out, in seconds per pixel on one thread.
const REWEIGHTING: f64 = 30e-7;
/// Channels of the layer that holds them.
const COLOURS: usize = 3;

/// Time needed after rendering to find features and mattes, to take fireflies out, to denoise and, where it `writes`, to write the picture, in
/// seconds per pixel.
fn afterwards(aovs: &[Aov], fireflies: Fireflies, denoiser: Option<&Denoiser>, writes: bool) -> Result<f64> {
    let noisy = if denoiser.is_some() { denoised::NOISY.len() } else { 0 };
    let reweights = fireflies.kappa().is_some();
    let taken = if reweights { COLOURS } else { 0 };
    let channels: usize = noisy + taken + aovs.iter().map(|aov| aov.channels().len()).sum::<usize>();
    // The denoiser's are others than those of layers.
    let kinds = u8::from(denoiser.is_some()) + u8::from(aovs.iter().any(|aov| aov.is_feature()));
    let mattes = if aovs.iter().any(|aov| aov.is_matte()) { MATTES } else { 0.0 };
    let weighed = if reweights { REWEIGHTING } else { 0.0 };
    let seen = (f64::from(kinds) * FEATURES + mattes + weighed) / rayon::current_num_threads() as f64;
    let denoising = denoiser.map_or(Ok(0.0), Denoiser::seconds_per_pixel)?;
    let writing = if writes { WRITING + LAYER_WRITING * channels as f64 } else { 0.0 };
    Ok(writing + seen + denoising)
}

/// Stop rule of a render that starts `elapsed` seconds after the command and ends `afterwards` seconds before it: `--time` is
/// that of the whole command.
fn stop_rule(stop: StopRule, elapsed: f64, afterwards: f64) -> StopRule {
    match stop {
        StopRule::Time(seconds) => StopRule::Time((seconds - elapsed - afterwards).max(0.1 * seconds)),
        stop => stop,
    }
}

/// Effect plan of the scene, and the settings that follow from it and from the command line.
pub fn settled(request: &RenderRequest, loaded: &LoadedScene) -> (EffectPlan, RenderSettings) {
    let mut plan = plan(&loaded.file);
    if let Some(samples) = request.samples {
        plan.decide(EffectKind::Photons, samples.photons(), "asked for with --samples");
    }
    decide(&mut plan, &request.effects);
    let settings = request.settings.clone().following(&plan);
    settings.note(&mut plan);
    (plan, settings)
}

/// A request with everything that it names read and built.
pub struct Prepared {
    /// Settings that follow from the request and from the scene's plan.
    pub settings: RenderSettings,
    plan: EffectPlan,
    guide: Option<GuideField>,
    reconstructor: Box<dyn Reconstructor>,
    checkpoint: Option<Checkpointing>,
    identity: Identity,
    scene: Scene,
    /// Seconds that it took to build the scene.
    build: f64,
}

/// Texts that stand for the contents of the files that a picture depends on.
struct Identity {
    scene: String,
    guide: String,
}

impl Prepared {
    /// Reads and builds what a request needs. The scene has the request's depth already.
    ///
    /// # Errors
    /// Errors of reading the guide and the network, and of building the scene.
    pub fn new(request: &RenderRequest, loaded: &LoadedScene) -> Result<Self> {
        let (plan, settings) = settled(request, loaded);
        let scene_crc = scene_crc(loaded);
        let guide = loaded_guide(request, &settings, &scene_crc)?;
        let (reconstructor, model) = reconstructor(request, &settings)?;
        let (guide, guide_identity) = guide.map_or((None, model), |(field, crc)| (Some(field), crc));
        let identity = Identity { scene: scene_crc, guide: guide_identity };
        let checkpoint = request.checkpoint.clone().map(|write| Checkpointing {
            made_for: checkpoint::made_for(&settings, request.size, &identity.scene, &identity.guide),
            write: Some(write),
            resume: request.resume.clone(),
        });
        let begun = Instant::now();
        let scene = Scene::build_views(loaded, request.size)?;
        let build = begun.elapsed().as_secs_f64();
        Ok(Self { settings, plan, guide, reconstructor, checkpoint, identity, scene, build })
    }

    /// What the parts of a picture must have in common, as text.
    pub fn in_common(&self, request: &RenderRequest) -> String {
        let settings = RenderSettings { part: None, crop: None, ..self.settings.clone() };
        let all = checkpoint::made_for(&settings, request.size, &self.identity.scene, &self.identity.guide);
        format!("{all}\nlayers: {:?}", request.aovs)
    }

    /// What the parts of a guide must have in common, as text.
    pub fn learned_in_common(&self, request: &RenderRequest) -> String {
        let settings = RenderSettings { part: None, ..self.settings.clone() };
        checkpoint::made_for(&settings, request.size, &self.identity.scene, &self.identity.guide)
    }

    /// Learns a part's share.
    ///
    /// # Errors
    /// Errors of rendering.
    pub fn learn_part(
        &self,
        request: &RenderRequest,
        loaded: &LoadedScene,
        progress: &dyn Progress,
        stop: &AtomicBool,
    ) -> Result<PartLearned> {
        let control = Control { checkpoint: self.checkpoint.as_ref(), ..Control::new(progress, stop) };
        let mut learned = render::learn_part(&self.scene, &self.settings, self.reconstructor.as_ref(), &control)?;
        self.describe(&mut learned.statistics, request, loaded);
        Ok(learned)
    }

    /// `values` that pixels are expected to have, for a guide file.
    pub fn pixel_values(&self, request: &RenderRequest, values: Option<Vec<f32>>) -> Option<PixelValues> {
        let of = picture_of(&self.identity.scene, request.size);
        // Those of all views lie on one sheet.
        let window = self.settings.window(self.scene.size);
        values.map(|values| PixelValues { of, window, values })
    }

    /// Spends the budget on learning alone.
    ///
    /// # Errors
    /// Errors of rendering.
    pub fn learn(
        &self,
        request: &RenderRequest,
        loaded: &LoadedScene,
        progress: &dyn Progress,
        stop: &AtomicBool,
    ) -> Result<Learned> {
        let control = Control { checkpoint: self.checkpoint.as_ref(), ..Control::new(progress, stop) };
        let mut learned = render::learn_whole(&self.scene, &self.settings, self.reconstructor.as_ref(), &control)?;
        self.describe(&mut learned.statistics, request, loaded);
        Ok(learned)
    }

    /// What a checkpoint has to be made for to be one of this work: the settings that were asked for, as text.
    pub fn made_for(&self) -> Option<&str> {
        self.checkpoint.as_ref().map(|checkpoint| checkpoint.made_for.as_str())
    }

    /// Statistics of work that was done before: of nothing but reading and building.
    pub fn no_work(&self, request: &RenderRequest, loaded: &LoadedScene) -> Statistics {
        let mut statistics = Statistics::of_nothing(&self.scene, &self.settings);
        self.describe(&mut statistics, request, loaded);
        statistics
    }

    /// Tells the statistics of what a render does not know.
    fn describe(&self, statistics: &mut Statistics, request: &RenderRequest, loaded: &LoadedScene) {
        statistics.scene = request.scene.display().to_string();
        statistics.views = request.views.iter().filter_map(|view| view.camera.clone()).collect();
        statistics.seconds.build = self.build;
        statistics.effects.clone_from(&self.plan.effects);
        statistics.skipped_triangles = loaded.skipped_triangles;
        statistics.missing_files.clone_from(&loaded.missing);
    }

    /// The guide that was loaded; none where nothing is guided.
    pub fn guide(&self) -> Option<&GuideField> {
        self.guide.as_ref()
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Makes `--time` that of the whole command, which began at `started` and ends with denoising the picture, where there is a
    /// `denoiser`, and with writing it, where it `writes`.
    ///
    /// # Errors
    /// Those of measuring how long denoising takes.
    pub fn end_in_time(
        &mut self,
        request: &RenderRequest,
        started: Instant,
        denoiser: Option<&Denoiser>,
        writes: bool,
    ) -> Result<()> {
        if let StopRule::Time(_) = self.settings.stop {
            let pixels = (self.settings.window(request.size).pixels() * self.scene.views() as u64) as f64;
            let left = pixels * afterwards(&request.aovs, self.settings.fireflies, denoiser, writes)?;
            self.settings.stop = stop_rule(self.settings.stop, started.elapsed().as_secs_f64(), left);
        }
        Ok(())
    }

    /// Renders the picture, and finds the layers beside it.
    ///
    /// # Errors
    /// Errors of rendering.
    pub fn render(
        &self,
        request: &RenderRequest,
        loaded: &LoadedScene,
        progress: &dyn Progress,
        stop: &AtomicBool,
        refresh: Option<Refresh>,
    ) -> Result<(Outcome, Vec<Channel>)> {
        let Self { settings, guide, reconstructor, checkpoint, scene, .. } = self;
        let control = Control { progress, stop, refresh, checkpoint: checkpoint.as_ref() };
        let mut outcome = match guide {
            Some(field) => render::render_with_field(scene, settings, field.clone(), &control)?,
            None => render::render_watched(scene, settings, reconstructor.as_ref(), &control)?,
        };
        let mut channels = aov::channels(scene, settings, &outcome, &request.aovs)?;
        channels.extend(outcome.fireflies.iter().flat_map(aov::fireflies_channels));
        self.describe(&mut outcome.statistics, request, loaded);
        let values = self.pixel_values(request, outcome.pixel_values.take());
        if values.is_some() {
            outcome.field = outcome.field.with_pixel_values(values);
        }
        Ok((outcome, channels))
    }
}

/// Result of a render.
struct Made {
    statistics: Statistics,
    /// Whether the picture and the guide could be written where they should be.
    written: Result<()>,
    /// Why the last checkpoint could not be written; none where it could.
    unkept: Option<String>,
    /// Why the viewer does not show the picture; none where it does, or where there is none.
    unshown: Option<String>,
    /// Whether it was ended before it was done.
    interrupted: bool,
}

/// What else is done with the picture, where it is wanted.
struct Beside<'a> {
    /// Denoises it.
    denoiser: Option<&'a Denoiser>,
    /// It is measured against this.
    reference: Option<&'a Image>,
    /// Shows it while it is rendered.
    viewer: Option<Viewer>,
}

/// Renders and writes the picture; the command began at `started`.
fn render(
    request: &RenderRequest,
    loaded: &LoadedScene,
    started: Instant,
    Beside { denoiser, reference, viewer }: Beside,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Made> {
    let mut prepared = Prepared::new(request, loaded)?;
    let header = attributes(request, &prepared.settings);
    prepared.end_in_time(request, started, denoiser, true)?;
    let name = request.views.first().map_or(String::new(), |view| view.output.display().to_string());
    let canvas = Canvas { name, size: prepared.scene.size, window: request.placed() };
    let live = viewer.map(|viewer| viewer.open(canvas)).transpose()?;
    let written = Cell::new(Instant::now());
    let show = |Snapshot { image, spp, seconds }: Snapshot| {
        let due = live.is_none() || written.get().elapsed() >= REFRESH;
        let error = due.then(|| {
            // A failed write is no reason to stop: a later one may succeed, and the last one is reported.
            let _ = write_views(request, &image, &[], &header, write_picture);
            written.set(Instant::now());
            Some(ErrorPoint::new(seconds, spp, &measure(&image, reference?).ok()?))
        });
        if let Some(live) = &live {
            live.show(image);
        }
        error.flatten()
    };
    let refresh = Some(Refresh { every: if live.is_some() { LIVE } else { REFRESH }, show: &show });
    let (outcome, mut channels) = prepared.render(request, loaded, progress, stop, refresh)?;
    let Prepared { scene, settings, .. } = &prepared;
    let mut statistics = outcome.statistics;
    if let Some(reference) = reference {
        let measures = measure(&outcome.image, reference)?;
        statistics.errors.push(ErrorPoint::new(statistics.seconds.total, statistics.spp, &measures));
    }
    let Denoised { image, noisy, attribute, failure, seconds } =
        denoised::finish(denoiser, scene, settings, outcome.image);
    statistics.seconds.denoise = seconds;
    if let Some(reference) = reference.filter(|_| attribute.is_some()) {
        let measures = measure(&image, reference)?;
        statistics.denoised_error =
            Some(ErrorPoint::new(statistics.seconds.total + seconds, statistics.spp, &measures));
    }
    live.iter().for_each(|live| live.show(image.clone()));
    channels.extend(noisy);
    let begun = Instant::now();
    let mattes = aov::header(scene, &request.aovs, &channels);
    let header: Vec<Attribute> =
        header.into_iter().chain(results(&statistics)).chain(attribute).chain(mattes).collect();
    let written = write_views(request, &image, &channels, &header, write_or_rescue);
    let interrupted = outcome.interrupted;
    let saved = request.save_guide.as_deref().map(|path| file::save(path, &outcome.field, &outcome.evidence));
    statistics.seconds.write = begun.elapsed().as_secs_f64();
    let written = written.and(saved.unwrap_or(Ok(()))).and(failure);
    let unshown = live.and_then(|live| live.finish(PATIENCE));
    Ok(Made { statistics, written, unkept: outcome.unkept, unshown, interrupted })
}

/// Writes the pictures of all views, which lie on the sheet `image` with its `channels`, each with `write`.
///
/// # Errors
/// The first error, after all have been tried.
fn write_views(
    request: &RenderRequest,
    image: &Image,
    channels: &[Channel],
    header: &[Attribute],
    write: fn(&Path, &Picture, Display) -> Result<()>,
) -> Result<()> {
    let parts = image.parts(request.views.len());
    let write = |(index, (view, image)): (usize, (&View, &Image))| {
        let part =
            |values: &[f32]| values.chunks_exact(image.pixels.len().max(1)).nth(index).unwrap_or_default().to_vec();
        let channel = |channel: &Channel| Channel { name: channel.name.clone(), values: part(&channel.values) };
        let channels: Vec<Channel> = channels.iter().map(channel).collect();
        let attributes: Vec<Attribute> = header.iter().cloned().chain(view.attribute()).collect();
        let picture = Picture { image, channels: &channels, window: request.placed(), attributes: &attributes };
        write(&view.output, &picture, request.display)
    };
    request.views.iter().zip(&parts).enumerate().map(write).fold(Ok(()), Result::and)
}

/// Writes the statistics where they are wanted.
pub(super) fn report(request: &RenderRequest, statistics: &Statistics) -> Result<()> {
    let Some(path) = &request.stats else { return Ok(()) };
    write_json(path, statistics)
}

/// Text that stands for a scene.
pub(super) fn scene_crc(loaded: &LoadedScene) -> String {
    format!("{:08x}", loaded.crc32())
}

/// Text that stands for a picture of `size` of a scene, whose camera is a part of it.
fn picture_of(scene: &str, [width, height]: [u32; 2]) -> String {
    format!("scene {scene}, {width}x{height}")
}

/// The guide to load for a picture of the scene for which `scene` stands, and a text that stands for its file. None is loaded where
/// nothing is guided.
pub(super) fn loaded_guide(
    request: &RenderRequest,
    settings: &RenderSettings,
    scene: &str,
) -> Result<Option<(GuideField, String)>> {
    let path = request.load_guide.as_deref().filter(|_| settings.guide != GuideMode::None);
    path.map(|path| load_guide(path, &picture_of(scene, request.size))).transpose()
}

/// The guide at `path`, and a text that stands for the file. What it knows of another picture than `picture` is left out.
fn load_guide(path: &Path, picture: &str) -> Result<(GuideField, String)> {
    let crc = crc32([read_bytes(path, file::GUIDE_LIMIT)?.as_slice()]);
    let (field, _) = file::load(path)?;
    let known = field.pixel_values().filter(|known| known.of == picture).cloned();
    Ok((field.with_pixel_values(known), format!("file {crc:08x}")))
}

/// Reconstructor for the mode asked for, and a text that identifies it.
fn reconstructor(request: &RenderRequest, settings: &RenderSettings) -> Result<(Box<dyn Reconstructor>, String)> {
    let mut identity = settings.reconstruction.name().to_owned();
    let reconstructor = settings.reconstruction.reconstructor(|| {
        let networks = networks(request.model.as_deref(), request.backend, &settings.mode())?;
        let each = networks
            .networks()
            .map(|neural| format!("{:08x} {:?}", neural.model.weights.checksum(), neural.model.config));
        identity = format!("model {}, {:?} backend", each.collect::<Vec<_>>().join(", "), request.backend);
        Ok(Box::new(networks))
    })?;
    Ok((reconstructor, identity))
}

/// The network or networks that were asked for, with their backend; those of the program for `mode` where no folder is given.
///
/// # Errors
/// Those of reading the models, of starting the backend, and of [`Buckets::check_mode`].
pub fn networks(model: Option<&Path>, backend: Backend, mode: &Mode) -> Result<Buckets> {
    let networks = match (model, backend) {
        (None, Backend::Embedded) => Buckets::built_in(mode)?,
        (Some(folder), Backend::Embedded) => Buckets::load(folder, Neural::embedded)?,
        #[cfg(feature = "onnx")]
        (Some(folder), Backend::Onnx) => Buckets::load(folder, Neural::onnx)?,
        #[cfg(feature = "onnx")]
        (None, Backend::Onnx) => Neural::built_in_onnx()?.into(),
        #[cfg(not(feature = "onnx"))]
        (_, Backend::Onnx) => return Err(Error::Options("this program was built without the onnx feature".into())),
    };
    networks.check_mode(mode)?;
    Ok(networks)
}

/// Attributes of an EXR file's header that are known before rendering. No name may be one that EXR reserves for other types,
/// such as `version`.
pub(super) fn attributes(request: &RenderRequest, settings: &RenderSettings) -> Vec<Attribute> {
    let [width, height] = request.size;
    let stop = match settings.stop {
        StopRule::Spp(spp) => format!("spp {spp}"),
        StopRule::Time(seconds) => format!("time {seconds}"),
        StopRule::TargetError(error) => format!("target-error {error}"),
    };
    [
        ("software", format!("fanal {}", env!("CARGO_PKG_VERSION"))),
        ("scene", request.scene.display().to_string()),
        ("method", settings.guide.name().to_owned()),
        ("seed", settings.seed.to_string()),
        ("size", format!("{width}x{height}")),
        ("filter", serde_json::to_string(&settings.filter).unwrap_or_default()),
        ("maxDepth", settings.transport.max_depth.to_string()),
        ("stop", stop),
    ]
    .into_iter()
    .chain(settings.fireflies.told().map(|told| ("fireflies", told)))
    .map(|(key, value)| (key.to_owned(), value))
    .collect()
}

/// Attributes that are known after rendering. Of all attributes only `seconds` and `threads` differ between two renders of the
/// same picture.
fn results(statistics: &Statistics) -> Vec<Attribute> {
    merge::results(&Totals::of(statistics), statistics.spp)
}
