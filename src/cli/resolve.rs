//! From arguments and scene to the one description of what to render.

use std::path::PathBuf;
use std::time::Duration;

use super::args::{Backend, Layer, PixelFilter, RenderArgs};
use crate::base::{Error, Result};
use crate::film::{Placed, Window, check_size};
use crate::guiding::learn::fraction::FractionRule;
use crate::guiding::target::{DirectLight, Target};
use crate::guiding::tree::leaves::Layout;
use crate::integrators::Roulette;
use crate::render::{Aov, GuideMode, Reconstruction, RenderSettings, SampleKinds, StopRule};
use crate::scene::file::{FilterFile, SceneFile};
use crate::scene::overrides::Override;

/// Everything that a render depends on beside the scene. All values are in range.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderRequest {
    /// The scene as given by the user, for reports.
    pub scene: PathBuf,
    /// The picture to write.
    pub output: PathBuf,
    /// Columns and rows.
    pub size: [u32; 2],
    /// What of the picture is rendered; none for all of it.
    pub crop: Option<Window>,
    /// What of the light around it a pixel shows.
    pub filter: FilterFile,
    /// 1 = emission only, n = n−1 bounces.
    pub max_depth: u32,
    /// Layers beside the picture.
    pub aovs: Vec<Aov>,
    /// Stops by which a PNG file is brightened.
    pub exposure: f32,
    /// When to stop.
    pub stop: StopRule,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Effects switched on or off against the plan.
    pub effects: Vec<Override>,
    /// Next event estimation.
    pub nee: bool,
    /// How paths end; `None` is as the guide has it.
    pub roulette: Option<Roulette>,
    /// How camera rays find light.
    pub guide: GuideMode,
    /// Where guiding samples come from.
    pub samples: Option<SampleKinds>,
    /// What distributions are proportional to.
    pub target: Option<Target>,
    /// What is made of trees as counted.
    pub reconstruct: Option<Reconstruction>,
    /// Where the guiding field goes.
    pub save_guide: Option<PathBuf>,
    /// Where it comes from.
    pub load_guide: Option<PathBuf>,
    /// Ceiling of the sampling field, bytes.
    pub guide_memory: u64,
    /// What trees learn of light that light sampling finds too; `None` is as the guide has it.
    pub direct: Option<DirectLight>,
    /// How often the BSDF is sampled; `None` is as the guide has it.
    pub fraction: Option<FractionRule>,
    /// Whether samples are moved at random.
    pub filtered: bool,
    /// Iterations in which [`Target::Variance`] is learned before [`Target::VariancePixel`].
    pub simple_iterations: u32,
    /// As what part of their number samples of earlier iterations count, if not the mode's own.
    pub past: Option<f64>,
    /// The model's folder; `None` is the model inside the program.
    pub model: Option<PathBuf>,
    /// Who executes the network.
    pub backend: Backend,
    /// Where checkpoints go, and the least time between two.
    pub checkpoint: Option<(PathBuf, Duration)>,
    /// The checkpoint to go on from.
    pub resume: Option<PathBuf>,
    /// Where statistics go.
    pub stats: Option<PathBuf>,
    /// The picture that errors are measured against.
    pub reference: Option<PathBuf>,
}

impl RenderRequest {
    /// Where in a larger picture the rendered one is.
    pub fn placed(&self) -> Placed {
        self.crop.map(|window| (window, self.size))
    }

    /// The renderer's settings.
    pub fn settings(&self) -> RenderSettings {
        let mut settings = RenderSettings::new(self.guide, self.stop);
        settings.filter = self.filter;
        settings.crop = self.crop;
        settings.keeps_spread = self.aovs.iter().any(|aov| aov.is_of_film());
        settings.transport.max_depth = self.max_depth;
        settings.transport.nee = self.nee;
        settings.transport.roulette = self.roulette.unwrap_or(settings.transport.roulette);
        settings.learner.memory = usize::try_from(self.guide_memory).unwrap_or(usize::MAX);
        settings.learner.keeps_evidence = self.save_guide.is_some();
        settings.seed = self.seed;
        settings.samples = self.samples.unwrap_or(settings.samples);
        settings.learner.target = self.target.unwrap_or(settings.learner.target);
        settings.learner.direct = self.direct.unwrap_or(settings.learner.direct);
        settings.learner.fraction = self.fraction.unwrap_or(settings.learner.fraction);
        settings.learner.tree.filtered = self.filtered;
        settings.learner.simple_iterations = self.simple_iterations;
        settings.learner.tree.past = self.past.unwrap_or(settings.learner.tree.past);
        settings.reconstruction = self.reconstruct.unwrap_or(settings.reconstruction);
        if self.load_guide.is_some() {
            // A field that is loaded is sampled as it is.
            settings.reconstruction = Reconstruction::None;
        }
        settings.learner.tree.layout =
            if settings.reconstruction == Reconstruction::Neural { Layout::Network } else { Layout::Values };
        settings
    }
}

/// Combines arguments with the scene's defaults.
///
/// # Errors
/// [`Error::Options`] naming the options that contradict one another or the value that is out of range.
pub fn resolve(args: &RenderArgs, scene: &SceneFile) -> Result<RenderRequest> {
    let size = args.size.unwrap_or([scene.film.width, scene.film.height]);
    check_size(size[0], size[1])?;
    if let Some(window) = args.crop {
        window.check_inside(size).map_err(|e| Error::Options(format!("--crop: {e}")))?;
    }
    let max_depth = args.max_depth.unwrap_or(scene.render.max_depth);
    let stop = match (args.spp, args.time, args.target_error) {
        (None, None, None) => StopRule::Spp(scene.render.spp),
        (Some(spp), None, None) => StopRule::Spp(spp),
        (None, Some(seconds), None) => StopRule::Time(seconds),
        (None, None, Some(error)) => StopRule::TargetError(error),
        _ => {
            return Err(Error::Options(
                "give one of --spp, --time and --target-error; only one can end the render".into(),
            ));
        }
    };
    if stop == StopRule::Spp(0) || max_depth == 0 {
        return Err(Error::Options(
            "the scene asks for 0 samples per pixel or depth 0; give --spp and --max-depth".into(),
        ));
    }
    let iterations = args.simple_iterations.is_some() || args.past.is_some();
    let how = args.direct.is_some() || args.fraction.is_some() || args.filter || iterations;
    let what = args.samples.is_some() || args.target.is_some() || args.reconstruct.is_some();
    if args.guide == GuideMode::None && (what || how) {
        return Err(Error::Options(
            "--guide none learns nothing; leave --samples, --target, --reconstruct, --direct, --fraction, --filter, \
             --simple-iterations and --past out"
                .into(),
        ));
    }
    if args.simple_iterations.is_some() && args.target != Some(Target::VariancePixel) {
        return Err(Error::Options(
            "--simple-iterations are those before --target variance-pixel; give that too".into(),
        ));
    }
    if args.guide == GuideMode::None && (args.save_guide.is_some() || args.load_guide.is_some()) {
        return Err(Error::Options("--guide none has no guide to save or load".into()));
    }
    let every = Duration::try_from_secs_f64(args.every).unwrap_or(Duration::MAX);
    Ok(RenderRequest {
        scene: args.scene.clone(),
        output: args.output.clone().unwrap_or_default(),
        size,
        crop: args.crop,
        filter: args.pixel_filter.map_or(scene.film.filter, PixelFilter::file),
        max_depth,
        aovs: aovs(args)?,
        exposure: exposure(args)?,
        stop,
        seed: args.seed,
        effects: args.effects.clone(),
        nee: args.nee.is_on(),
        roulette: args.roulette,
        guide: args.guide,
        samples: args.samples,
        target: args.target,
        reconstruct: args.reconstruct,
        direct: args.direct,
        fraction: args.fraction,
        filtered: args.filter,
        simple_iterations: args.simple_iterations.unwrap_or(0),
        past: args.past,
        save_guide: args.save_guide.clone(),
        load_guide: args.load_guide.clone(),
        guide_memory: u64::from(args.guide_memory) * 1_000_000,
        model: args.model.clone(),
        backend: args.backend,
        checkpoint: args.checkpoint.as_ref().or(args.resume.as_ref()).map(|path| (path.clone(), every)),
        resume: args.resume.clone(),
        stats: args.stats.clone(),
        reference: args.reference.clone(),
    })
}

fn is_png(args: &RenderArgs) -> bool {
    args.output.as_ref().and_then(|output| output.extension()).is_some_and(|e| e.eq_ignore_ascii_case("png"))
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

/// The exposure, refused where it would do nothing.
fn exposure(args: &RenderArgs) -> Result<f32> {
    match args.exposure {
        Some(_) if !is_png(args) => Err(Error::Options(
            "--exposure is for PNG files; an EXR file holds linear radiance, brighten it in the viewer".into(),
        )),
        given => Ok(given.unwrap_or(0.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::{Cli, Command};
    use crate::generate::{Family, scene};
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
        assert_eq!((plain.size, plain.stop), ([40, 30], StopRule::Spp(64)));
        assert_eq!(plain.settings().samples, SampleKinds::Both);
        let given = request(&["--guide", "variance", "--target", "radiance", "--reconstruct", "neural"]).unwrap();
        let settings = given.settings();
        assert_eq!((settings.samples, settings.learner.target), (SampleKinds::Path, Target::Radiance));
        assert_eq!((settings.reconstruction, settings.learner.tree.layout), (Reconstruction::Neural, Layout::Network));
        let given = request(&["--size", "8x4", "--time", "2.5", "--guide", "none", "--max-depth", "3"]).unwrap();
        assert_eq!((given.size, given.stop), ([8, 4], StopRule::Time(2.5)));
        assert_eq!(given.max_depth, 3);
        assert_eq!((plain.filter, plain.settings().filter), (FilterFile::default(), FilterFile::default()));
        assert_eq!(
            (plain.settings().learner.tree.past, request(&["--past", "1"]).unwrap().settings().learner.tree.past),
            (0.5, 1.0)
        );
        assert_eq!(request(&["--guide", "ppg"]).unwrap().settings().learner.tree.past, 0.0);
        assert_eq!(request(&["--pixel-filter", "tent"]).unwrap().settings().filter, FilterFile::TENT);
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
    }
}
