//! Resolves arguments and the scene's defaults into one description of what to render.

use std::path::PathBuf;
use std::time::Duration;

use super::args::{Backend, Layer, LearningArgs, Outliers, PixelFilter, RenderArgs, Switch};
use super::views::{View, views};
use crate::base::{Error, Result};
use crate::film::check_sheet;
use crate::guiding::learn::learner::LearnerSettings;
use crate::guiding::model::ModelKind;
use crate::guiding::target::Target;
use crate::guiding::tree::TreeSettings;
use crate::integrators::TransportSettings;
use crate::picture::{self, Display, Placed};
use crate::render::{Aov, Fireflies, GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
use crate::scene::file::SceneFile;
use crate::scene::overrides::Override;

/// Least seconds between two checkpoints where nothing else is asked for.
const EVERY: f64 = 30.0;

/// Everything that a render depends on beside the scene. All values are in range.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderRequest {
    /// The scene as given by the user, for reports.
    pub scene: PathBuf,
    /// The views to render and the pictures to write, in the order of [`SceneFile::views`].
    pub views: Vec<View>,
    /// Columns and rows of each picture.
    pub size: [u32; 2],
    /// Render settings before the scene's plan is applied to them.
    pub settings: RenderSettings,
    /// Kinds of samples that guides learn from, if asked for against the plan.
    pub samples: Option<SampleKinds>,
    /// Effects switched on or off against the plan.
    pub effects: Vec<Override>,
    /// Layers beside the picture.
    pub aovs: Vec<Aov>,
    /// Whether the picture is denoised.
    pub denoise: bool,
    /// How a PNG file shows the picture.
    pub display: Display,
    /// File that the guiding field is written to.
    pub save_guide: Option<PathBuf>,
    /// File that the guiding field is read from.
    pub load_guide: Option<PathBuf>,
    /// The model's folder; `None` is the model inside the program.
    pub model: Option<PathBuf>,
    /// Backend that executes the network.
    pub backend: Backend,
    /// File that checkpoints are written to, and the least time between two.
    pub checkpoint: Option<(PathBuf, Duration)>,
    /// The checkpoint to go on from.
    pub resume: Option<PathBuf>,
    /// File that statistics are written to.
    pub stats: Option<PathBuf>,
    /// The picture that errors are measured against.
    pub reference: Option<PathBuf>,
}

impl RenderRequest {
    /// Says which option about the network has no effect, if one is given that has none.
    pub fn unused(&self) -> Option<String> {
        let given = [("--model", self.model.is_some()), ("--backend", self.backend != Backend::Embedded)];
        let learns = self.settings.guide != GuideMode::None && self.load_guide.is_none();
        let used = learns && self.settings.reconstruction == Reconstruction::Neural;
        let name = given.into_iter().find(|(_, given)| *given && !used)?.0;
        Some(format!("{name} has no effect: no network reconstructs trees here"))
    }

    /// Place of the rendered window in the whole picture; none where all of it is rendered.
    pub fn placed(&self) -> Placed {
        self.settings.crop.map(|window| (window, self.size))
    }
}

/// Combines arguments with the defaults of a scene that has the cameras asked for and no others.
///
/// # Errors
/// [`Error::Options`] naming the options that contradict one another or the value that is out of range.
pub fn resolve(args: &RenderArgs, scene: &SceneFile) -> Result<RenderRequest> {
    let size = args.of.size.unwrap_or([scene.film.width, scene.film.height]);
    let views = views(args, scene)?;
    check_sheet(size, views.len())?;
    if let Some(window) = args.of.crop {
        window.check_inside(size).map_err(|e| Error::Options(format!("--crop: {e}")))?;
    }
    check_guide(args)?;
    check_part(args)?;
    let aovs = aovs(args)?;
    Ok(RenderRequest {
        scene: args.of.scene.clone(),
        views,
        size,
        settings: settings(args, scene, &aovs)?,
        samples: args.learning.samples,
        effects: args.of.effects.clone(),
        aovs,
        denoise: args.denoise,
        display: display(args.exposure, args.view, is_png(args))?,
        save_guide: args.save_guide.clone(),
        load_guide: args.load_guide.clone(),
        model: args.of.model.clone(),
        backend: args.of.backend,
        checkpoint: checkpoint(args)?,
        resume: args.resume.clone(),
        stats: args.stats.clone(),
        reference: args.reference.clone(),
    })
}

/// Defaults of the mode with the options that were given.
fn settings(args: &RenderArgs, scene: &SceneFile, aovs: &[Aov]) -> Result<RenderSettings> {
    let defaults = RenderSettings::new(args.of.guide, stop(args, scene)?);
    let transport = TransportSettings {
        max_depth: args.of.max_depth.unwrap_or(scene.render.max_depth),
        light_sampling: args.of.light_sampling.map_or(defaults.transport.light_sampling, Switch::is_on),
        roulette: args.of.roulette.unwrap_or(defaults.transport.roulette),
        guided_distances: args.of.guided_distances.is_on(),
    };
    if transport.max_depth == 0 {
        return Err(Error::Options("the scene asks for depth 0; give --max-depth".into()));
    }
    let LearningArgs { samples, target, direct, fraction, filter, simple_iterations, past, reconstruct } =
        args.learning;
    let learner = LearnerSettings {
        memory: usize::try_from(u64::from(args.of.guide_memory) * 1_000_000).unwrap_or(usize::MAX),
        keeps_evidence: args.save_guide.is_some(),
        target: target.unwrap_or(defaults.learner.target),
        direct: direct.unwrap_or(defaults.learner.direct),
        fraction: fraction.unwrap_or(defaults.learner.fraction),
        simple_iterations: simple_iterations.unwrap_or(defaults.learner.simple_iterations),
        tree: TreeSettings {
            filtered: filter || defaults.learner.tree.filtered,
            past: past.unwrap_or(defaults.learner.tree.past),
            ..defaults.learner.tree
        },
        ..defaults.learner
    };
    let settings = RenderSettings {
        transport,
        learner,
        filter: args.of.pixel_filter.map_or(scene.film.filter, PixelFilter::file),
        crop: args.of.crop,
        part: args.part,
        adaptive: adaptive(args, &defaults)?,
        complete_paths: args.complete_paths.unwrap_or(defaults.complete_paths),
        keeps_spread: aovs.iter().any(|aov| aov.is_of_film()),
        fireflies: fireflies(args)?,
        seed: args.of.seed,
        samples: samples.unwrap_or(defaults.samples),
        ..defaults
    };
    // A field that is loaded is sampled as it is.
    let loaded = args.load_guide.as_ref().map(|_| Reconstruction::None);
    Ok(match loaded.or(reconstruct) {
        Some(reconstruction) => settings.with_reconstruction(reconstruction),
        None => settings,
    })
}

/// Rule by which the render ends.
fn stop(args: &RenderArgs, scene: &SceneFile) -> Result<StopRule> {
    match (args.spp, args.time, args.target_error) {
        (None, None, None) if scene.render.spp == 0 => {
            Err(Error::Options("the scene asks for 0 samples per pixel; give --spp".into()))
        }
        (None, None, None) => Ok(StopRule::Spp(scene.render.spp)),
        (Some(spp), None, None) => Ok(StopRule::Spp(spp)),
        (None, Some(seconds), None) => Ok(StopRule::Time(seconds)),
        (None, None, Some(error)) => Ok(StopRule::TargetError(error)),
        _ => Err(Error::Options("give one of --spp, --time and --target-error; only one can end the render".into())),
    }
}

/// Whether samples are divided among pixels by noise.
fn adaptive(args: &RenderArgs, defaults: &RenderSettings) -> Result<bool> {
    // Paths that are drawn from kept ones fall where they may.
    let complete = args.complete_paths.unwrap_or(defaults.complete_paths) > 0.0;
    let adaptive = args.adaptive.map_or(defaults.adaptive && !complete, Switch::is_on);
    if adaptive && !defaults.adapts() {
        let guide = defaults.guide.name();
        return Err(Error::Options(format!("--adaptive on: --guide {guide} samples all pixels evenly; leave it out")));
    }
    if adaptive && complete {
        return Err(Error::Options(
            "--adaptive on: with --complete-paths samples are not divided by noise; leave one of them out".into(),
        ));
    }
    if adaptive && matches!(defaults.stop, StopRule::TargetError(_)) {
        return Err(Error::Options(
            "--adaptive on: --target-error judges pictures that are sampled evenly; leave it out, or give --time"
                .into(),
        ));
    }
    Ok(adaptive)
}

/// File that checkpoints are written to, and the least time between two.
fn checkpoint(args: &RenderArgs) -> Result<Option<(PathBuf, Duration)>> {
    // The checkpoint to resume from is kept up to date unless another one is written.
    match (args.checkpoint.as_ref().or(args.resume.as_ref()), args.every) {
        (None, None) => Ok(None),
        (Some(path), every) => {
            let every = Duration::try_from_secs_f64(every.unwrap_or(EVERY)).unwrap_or(Duration::MAX);
            Ok(Some((path.clone(), every)))
        }
        (None, Some(_)) => Err(Error::Options(
            "--every is the time between checkpoints: give --checkpoint or --resume too, or leave --every out".into(),
        )),
    }
}

/// What is done about fireflies.
fn fireflies(args: &RenderArgs) -> Result<Fireflies> {
    match (args.fireflies, args.kappa) {
        (Outliers::Keep, None) => Ok(Fireflies::Keep),
        (Outliers::Reweight, kappa) => Ok(Fireflies::Reweight { kappa: kappa.unwrap_or(Fireflies::KAPPA) }),
        (Outliers::Keep, Some(_)) => {
            Err(Error::Options("--kappa is for --fireflies reweight: give that too, or leave --kappa out".into()))
        }
    }
}

/// Refuses options that the chosen guiding method does not have.
fn check_guide(args: &RenderArgs) -> Result<()> {
    let LearningArgs { samples, target, direct, fraction, filter, simple_iterations, past, reconstruct } =
        args.learning;
    let given = [
        ("--samples", samples.is_some()),
        ("--target", target.is_some()),
        ("--direct", direct.is_some()),
        ("--fraction", fraction.is_some()),
        ("--filter", filter),
        ("--simple-iterations", simple_iterations.is_some()),
        ("--past", past.is_some()),
        ("--reconstruct", reconstruct.is_some()),
        ("--save-guide", args.save_guide.is_some()),
        ("--load-guide", args.load_guide.is_some()),
        ("--guided-distances", args.of.guided_distances.is_on()),
    ];
    let refused = |why: &str, options: &[&str]| {
        let found: Vec<&str> =
            given.iter().filter(|(name, given)| *given && options.contains(name)).map(|(name, _)| *name).collect();
        if found.is_empty() {
            return Ok(());
        }
        Err(Error::Options(format!("{why}; leave {} out", found.join(", "))))
    };
    if args.of.guide == GuideMode::None {
        refused("--guide none learns nothing", &given.map(|(name, _)| name))?;
    }
    if args.of.guide == GuideMode::Paths {
        refused("--guide paths learns no directions", &given.map(|(name, _)| name))?;
        for (name, given) in [("--checkpoint", args.checkpoint.is_some()), ("--resume", args.resume.is_some())] {
            if given {
                return Err(Error::Options(format!("--guide paths is in no checkpoint; leave {name} out")));
            }
        }
    }
    if args.of.guide.model() != ModelKind::Trees {
        let why = format!("--guide {} has no trees", args.of.guide.name());
        refused(&why, &["--filter", "--past", "--reconstruct"])?;
    }
    if args.of.guide == GuideMode::Vmf && samples.is_some_and(SampleKinds::photons) {
        refused("--guide vmf learns from camera paths alone", &["--samples"])?;
    }
    let learned = target.or((args.of.guide == GuideMode::Nilsson).then_some(Target::VariancePixel));
    if simple_iterations.is_some() && learned != Some(Target::VariancePixel) {
        return Err(Error::Options(
            "--simple-iterations are those before --target variance-pixel; give that too".into(),
        ));
    }
    Ok(())
}

/// Refuses what parts cannot hold.
fn check_part(args: &RenderArgs) -> Result<()> {
    if args.part.is_none() {
        return Ok(());
    }
    if args.of.guide != GuideMode::None && args.load_guide.is_none() {
        return Err(Error::Options(
            "--part: parts do not learn, or each would be guided by another guide; give --load-guide with a guide of `fanal learn`, or \
             --guide none"
                .into(),
        ));
    }
    if args.adaptive.is_some_and(Switch::is_on) {
        return Err(Error::Options(
            "--adaptive on: where noise is depends on samples of other parts; leave it out, or leave --part out".into(),
        ));
    }
    Ok(())
}

fn is_png(args: &RenderArgs) -> bool {
    args.output.as_ref().is_some_and(|output| args.part.is_none() && picture::is_png(output))
}

/// The layers, refused where they could not be written.
fn aovs(args: &RenderArgs) -> Result<Vec<Aov>> {
    if is_png(args) && !args.aov.is_empty() {
        return Err(Error::Options(
            "--aov needs an .exr file: a PNG file has no room for layers, nor for numbers beyond 0 to 1".into(),
        ));
    }
    Ok(Layer::aovs(&args.aov))
}

/// How a PNG file shows the picture, with the options that were given; refused where that would do nothing.
///
/// # Errors
/// [`Error::Options`] where the picture is no PNG file.
pub fn display(exposure: Option<f32>, view: Option<picture::View>, png: bool) -> Result<Display> {
    let refused = |option: &str, instead: &str| {
        Error::Options(format!("{option} is for PNG files; an EXR file holds linear radiance, {instead} in the viewer"))
    };
    match (exposure, view) {
        (Some(_), _) if !png => Err(refused("--exposure", "brighten it")),
        (_, Some(_)) if !png => Err(refused("--view", "choose how it is shown")),
        (exposure, view) => Ok(Display { exposure: exposure.unwrap_or(0.0), view: view.unwrap_or_default() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::{Cli, Command};
    use crate::generate::{Family, scene};
    use crate::guiding::learn::fraction::FractionRule;
    use crate::guiding::tree::leaves::Layout;
    use crate::reconstruct::buckets::Buckets;
    use crate::scene::file::FilterFile;
    use clap::Parser;

    fn request(options: &[&str]) -> Result<RenderRequest> {
        let Command::Render(args) =
            Cli::parse_from(["fanal", "render", "s.json", "-o", "o.exr"].iter().chain(options)).command
        else {
            unreachable!("the words above are a render command")
        };
        resolve(&args, &scene(Family::Rooms, 1, [40, 30]))
    }

    #[test]
    fn the_scene_is_the_default() {
        let plain = request(&[]).unwrap();
        assert_eq!((plain.size, plain.settings.stop), ([40, 30], StopRule::Spp(64)));
        assert_eq!(plain.settings.samples, SampleKinds::Both);
        let given = request(&["--guide", "variance", "--target", "radiance", "--reconstruct", "neural"]).unwrap();
        let settings = given.settings;
        assert_eq!((settings.samples, settings.learner.target), (SampleKinds::Path, Target::Radiance));
        assert_eq!((settings.reconstruction, settings.learner.tree.layout), (Reconstruction::Neural, Layout::Network));
        let given = request(&["--size", "8x4", "--time", "2.5", "--guide", "none", "--max-depth", "3"]).unwrap();
        assert_eq!((given.size, given.settings.stop), ([8, 4], StopRule::Time(2.5)));
        assert_eq!(given.settings.transport.max_depth, 3);
        assert_eq!((plain.settings.filter, plain.settings.filter), (FilterFile::default(), FilterFile::default()));
        assert_eq!(
            (plain.settings.learner.tree.past, request(&["--past", "1"]).unwrap().settings.learner.tree.past),
            (0.5, 1.0)
        );
        assert_eq!(request(&["--guide", "ppg"]).unwrap().settings.learner.tree.past, 0.0);
        assert_eq!(request(&["--pixel-filter", "tent"]).unwrap().settings.filter, FilterFile::TENT);
    }

    /// What papers have around their models is kept, unless something else is asked for.
    #[test]
    fn modes_have_their_surroundings() {
        let settings = |options: &[&str]| request(options).unwrap().settings;
        assert!(
            settings(&["--guide", "ppg2"]).learner.tree.filtered
                && !settings(&["--guide", "ppg"]).learner.tree.filtered
        );
        let zhu = settings(&["--guide", "zhu"]);
        assert!(!zhu.transport.light_sampling && zhu.learner.tree.filtered && !zhu.gives_up);
        assert_eq!((zhu.learner.fraction, zhu.reconstruction), (FractionRule::Found, Reconstruction::Neural));
        assert_eq!(Buckets::built_in(&zhu.mode()).expect("they were trained in it").networks().count(), 5);
        assert!(settings(&["--guide", "zhu", "--light-sampling", "on"]).transport.light_sampling);
        assert!(settings(&[]).transport.light_sampling);
        let nilsson = settings(&["--guide", "nilsson"]);
        assert_eq!((nilsson.learner.target, nilsson.learner.simple_iterations), (Target::VariancePixel, 3));
        assert_eq!((nilsson.reconstruction, nilsson.learner.tree.first_least), (Reconstruction::Nilsson, 0));
        assert_eq!(settings(&["--guide", "nilsson", "--simple-iterations", "1"]).learner.simple_iterations, 1);
        assert!(request(&["--guide", "nilsson", "--target", "radiance", "--simple-iterations", "1"]).is_err());
        assert_eq!(settings(&["--guide", "variance"]).learner.simple_iterations, 0);
    }

    #[test]
    fn contradictions_are_errors() {
        assert!(request(&["--size", "0x4"]).is_err());
        assert!(request(&["--size", "4000000000x4000000000"]).is_err());
        assert!(request(&["--guide", "none", "--samples", "photon"]).is_err());
        assert!(request(&["--guide", "none", "--reconstruct", "neural"]).is_err());
        assert!(request(&["--guide", "none", "--direct", "all"]).is_err());
        assert!(request(&["--guide", "none", "--past", "0"]).is_err());
        let refused = |part| Cli::try_parse_from(["fanal", "render", "s.json", "--past", part]).is_err();
        assert!(["1.5", "-0.5", "nan"].into_iter().all(refused));
        assert!(request(&["--guide", "none", "--save-guide", "a.guide"]).is_err());
        assert!(request(&["--exposure", "1"]).is_err());
        assert!(request(&["--view", "agx"]).is_err());
        assert!(request(&["--every", "5"]).is_err());
        let kept = |options: &[&str]| request(options).unwrap().checkpoint;
        assert_eq!(kept(&["--checkpoint", "a.part"]), Some((PathBuf::from("a.part"), Duration::from_secs(30))));
        assert_eq!(
            kept(&["--resume", "b.part", "--every", "5"]),
            Some((PathBuf::from("b.part"), Duration::from_secs(5)))
        );
        assert_eq!(kept(&[]), None);
        assert!(request(&["--complete-paths", "0.5", "--adaptive", "on"]).is_err());
        let adapts = |options: &[&str]| request(options).unwrap().settings.adaptive;
        assert!(adapts(&["--complete-paths", "0", "--adaptive", "on"]) && adapts(&["--time", "2"]));
        assert!(!adapts(&["--complete-paths", "0.5", "--time", "2"]));
        assert!(request(&["--kappa", "2"]).is_err());
        let given = request(&["--kappa", "2", "--fireflies", "reweight"]).unwrap();
        assert_eq!(given.settings.fireflies, Fireflies::Reweight { kappa: 2.0 });
    }
}
