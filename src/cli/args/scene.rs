//! What every command that traces paths is told of them.

use std::path::PathBuf;

use clap::Args;
use glam::Vec3;

use super::{Backend, PixelFilter, Switch, point, size, window};
use crate::integrators::Roulette;
use crate::picture::Window;
use crate::render::GuideMode;
use crate::scene::orbit;
use crate::scene::overrides::Override;
use crate::scene::readers::{Definition, How, Missing};

/// A scene, its picture, and how light is found in it.
#[derive(Debug, Clone, Args)]
pub struct SceneArgs {
    /// Scene: our JSON, Mitsuba XML, pbrt, glTF, or a folder that holds one of them called scene
    pub scene: PathBuf,
    /// How camera rays find light
    #[arg(long, value_enum, default_value = "neural")]
    pub guide: GuideMode,
    /// Ceiling of the sampling field in MB
    #[arg(long, value_name = "MB", default_value = "24", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub guide_memory: u32,
    /// How paths end that are not worth going on with [default: window; throughput for --guide zhu]
    #[arg(long, value_enum)]
    pub roulette: Option<Roulette>,
    /// Effects to switch on (+) or off (-) against `fanal plan`, whose names they have
    #[arg(long, value_name = "+NAME,-NAME,…", value_delimiter = ',', allow_hyphen_values = true)]
    pub effects: Vec<Override>,
    /// Value for $NAME in a Mitsuba scene, in place of the scene's default; may be given several times
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE")]
    pub definitions: Vec<Definition>,
    /// What to do about meshes and pictures that the scene names and that are not there
    #[arg(long, value_enum, default_value = "refuse")]
    pub missing: Missing,
    /// Light sampling (next event estimation) [default: on; off for --guide zhu]
    #[arg(long, alias = "nee", value_enum)]
    pub light_sampling: Option<Switch>,
    /// Whether paths collide with media where the guide expects light: less noise where lamps stand in fog, for a third more time, in clouds
    /// for two and a half times as much
    #[arg(long, value_enum, default_value = "off")]
    pub guided_distances: Switch,
    /// 1 = emission only, 2 = direct light, n = n-1 bounces [default: the scene's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    pub max_depth: Option<u32>,
    /// Size of the picture in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<[u32; 2]>,
    /// Camera to render, by its name [default: the first]; or several with commas between them, or `all`: each view has a file
    /// then, out.NAME.exr beside out.exr, and one guide learns from what all of them see. `fanal plan` lists them
    #[arg(long, value_name = "NAME|all", allow_hyphen_values = true)]
    pub camera: Option<String>,
    /// A turntable: so many views from all around, out.000.exr and so on, which share one guide. The camera goes around the point of
    /// its viewing axis that is nearest to the middle of the scene, anticlockwise about the vertical axis; the first view is its own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(orbit::MOST)))]
    pub orbit: Option<u32>,
    /// Another point for --orbit to go around
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "orbit")]
    pub around: Option<Vec3>,
    /// Render only this part of the picture: columns to the left of it, rows above it, its columns and rows. Its pixels get the
    /// samples that they get in the whole picture; an EXR file says where in it they are, a PNG file holds them alone
    #[arg(long, value_name = "X,Y,W,H", value_parser = window)]
    pub crop: Option<Window>,
    /// What of the light around it a pixel shows [default: the scene's]
    #[arg(long, value_enum, value_name = "FILTER")]
    pub pixel_filter: Option<PixelFilter>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value = "0")]
    pub seed: u64,
    /// Folder of the network's model, for --guide neural [default: the model inside this program]
    #[arg(long, value_name = "DIR")]
    pub model: Option<PathBuf>,
    /// Who executes the network, for --guide neural
    #[arg(long, value_enum, default_value = "embedded")]
    pub backend: Backend,
}

impl SceneArgs {
    /// How to load the scene.
    pub fn how(&self) -> How<'_> {
        How { overrides: &self.effects, definitions: &self.definitions, missing: self.missing }
    }
}
