//! Recipes for training data: scenes, samples per pixel and resolution. Everything is counted, nothing timed, so the
//! same recipe gives the same data anywhere.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Family;
use crate::base::error::At;
use crate::base::files::read_bytes;
use crate::base::random::Random;
use crate::base::{Error, Place, Result};
use crate::guiding::target::Target;
use crate::render::{GuideMode, Reconstruction};
use crate::scene::readers::documents;

/// Largest accepted recipe file, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Largest accepted number of scenes in a recipe.
const MAX_SCENES: u32 = 100_000;

/// Content of a `RECIPE.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the data set.
    pub name: String,
    /// Seed of everything in it.
    pub seed: u64,
    /// Share of scenes that are never trained on, in [0, 1).
    #[serde(default = "default_held_out")]
    pub held_out: f64,
    /// Columns and rows of the pictures that trees are collected in.
    #[serde(default = "default_resolution")]
    pub resolution: [u32; 2],
    /// Iterations t after which inputs are taken; each counts 2^(t+1) − 1 samples per pixel.
    pub iterations: Vec<u32>,
    /// Cells of the spatial cache along the diagonal of the space that the camera sees; scenes of a family take them in turn.
    #[serde(default = "default_grids")]
    pub grids: Vec<u32>,
    /// Target of the trees and so of the network: `variance`, which rendering uses, or `radiance`.
    #[serde(default = "default_target")]
    pub target: Target,
    /// Reconstruction that guides the renders which trees are taken from: smoothing, or the network in the program.
    #[serde(default = "default_guide", skip_serializing_if = "is_default_guide")]
    pub guide: Reconstruction,
    /// Method whose voxels, trees and light sampling the renders have: the network's is trained for them.
    #[serde(default, skip_serializing_if = "is_default_method")]
    pub method: Trained,
    /// Camera paths per pixel that targets are collected from.
    pub target_spp: u32,
    /// At most so many trees are kept of a scene, drawn evenly, but one of each run and iteration.
    pub max_trees_per_scene: u32,
    /// Short runs that inputs are taken from; of each four two see path samples and photons, one path samples, one photons.
    #[serde(default = "default_runs")]
    pub runs: u32,
    /// The families of scenes.
    #[serde(default)]
    pub family: Vec<FamilyRecipe>,
    /// Scenes in files of any format that can be rendered, made after those of families.
    #[serde(default)]
    pub scene: Vec<SceneRecipe>,
}

/// Methods that networks are trained for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trained {
    /// `neural`.
    #[default]
    Neural,
    /// `zhu`.
    Zhu,
}

impl From<Trained> for GuideMode {
    fn from(trained: Trained) -> Self {
        match trained {
            Trained::Neural => Self::Neural,
            Trained::Zhu => Self::Zhu,
        }
    }
}

/// Number of scenes of one family.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FamilyRecipe {
    /// The family.
    pub name: Family,
    /// Number of scenes.
    pub scenes: u32,
}

/// A scene in a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRecipe {
    /// The file, relative to the recipe's folder.
    pub file: PathBuf,
    /// Whether its trees are kept from training.
    #[serde(default)]
    pub held_out: bool,
}

/// Origin of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// A random scene of a family.
    Family(Family),
    /// A file.
    File(PathBuf),
}

impl Source {
    /// Name of the family, or of the file without its folder and its extension; where that is `scene`, of the folder.
    pub fn name(&self) -> String {
        let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        match self {
            Self::Family(family) => family.name().into(),
            Self::File(path) => match text(path.file_stem()) {
                stem if stem == "scene" => text(path.parent().and_then(Path::file_name)),
                stem => stem,
            },
        }
    }

    /// Name of the family, `files` for a file.
    pub fn family(&self) -> &'static str {
        match self {
            Self::Family(family) => family.name(),
            Self::File(_) => "files",
        }
    }

    /// Stream of random numbers: the family's, 0 for files.
    pub fn id(&self) -> u64 {
        match self {
            Self::Family(family) => family.id(),
            Self::File(_) => 0,
        }
    }
}

/// One scene of a recipe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Origin of the scene.
    pub source: Source,
    /// 0-based number within the family, or among the files.
    pub index: u32,
    /// Seed of the scene.
    pub seed: u64,
    /// Whether it is kept from training.
    pub held_out: bool,
}

fn default_held_out() -> f64 {
    0.15
}

fn default_target() -> Target {
    Target::Variance
}

fn default_guide() -> Reconstruction {
    Reconstruction::Gaussian
}

// Not written where they are the default: checksums and notes of recipes without them stay as they were.
fn is_default_method(method: &Trained) -> bool {
    *method == Trained::default()
}

fn is_default_guide(guide: &Reconstruction) -> bool {
    *guide == default_guide()
}

fn default_runs() -> u32 {
    4
}

fn default_resolution() -> [u32; 2] {
    [64, 64]
}

fn default_grids() -> Vec<u32> {
    vec![16]
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Malformed`] with the line or the key that is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_bytes(path, MAX_BYTES)?;
        let text = String::from_utf8(bytes).map_err(|e| {
            Error::malformed(Place::byte(path, e.utf8_error().valid_up_to() as u64), "this is not UTF-8")
        })?;
        Self::parse(&text, path)
    }

    /// The recipe for the scenes in the folder `scenes` (see [`documents`]) in place of its own; all of them are held out.
    ///
    /// # Errors
    /// Those of [`documents`]; [`Error::Malformed`] for more scenes than a recipe may have.
    pub fn with_scenes(self, scenes: &Path) -> Result<Self> {
        let scene = documents(scenes)?.into_iter().map(|file| SceneRecipe { file, held_out: true }).collect();
        Self { family: Vec::new(), scene, ..self }.checked(scenes)
    }

    /// Checks the text of a recipe; `path` is for messages.
    ///
    /// # Errors
    /// [`Error::Malformed`] with the line or the key that is wrong.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut recipe: Self = toml::from_str(text).map_err(|e| {
            let line =
                e.span().map(|span| At::Line(1 + text[..span.start.min(text.len())].matches('\n').count() as u32));
            Error::malformed(Place { path: path.to_owned(), at: line }, e.message())
        })?;
        let folder = path.parent().unwrap_or(Path::new("."));
        recipe.scene.iter_mut().for_each(|scene| scene.file = folder.join(&scene.file));
        recipe.checked(path)
    }

    fn checked(self, path: &Path) -> Result<Self> {
        match self.fault() {
            Some((key, message)) => Err(Error::malformed(Place::part(path, key), message)),
            None => Ok(self),
        }
    }

    /// The first key whose value is out of range, and why.
    fn fault(&self) -> Option<(&'static str, String)> {
        let scenes = self.family.iter().map(|f| u64::from(f.scenes)).sum::<u64>() + self.scene.len() as u64;
        let checks = [
            ("name", !self.name.is_empty(), "must not be empty"),
            ("held_out", (0.0..1.0).contains(&self.held_out), "must be at least 0 and below 1"),
            ("resolution", self.resolution.iter().all(|&n| (1..=1024).contains(&n)), "sides must be 1 to 1024 pixels"),
            (
                "iterations",
                !self.iterations.is_empty() && self.iterations.iter().all(|&t| t <= 16),
                "need one or more of 0 to 16",
            ),
            (
                "grids",
                !self.grids.is_empty() && self.grids.iter().all(|g| (1..=1024).contains(g)),
                "need one or more of 1 to 1024",
            ),
            ("target", self.target != Target::VariancePixel, "variance-pixel needs pictures, which data have none of"),
            ("target_spp", (1..=1 << 24).contains(&self.target_spp), "must be 1 to 16777216"),
            ("runs", (1..=64).contains(&self.runs), "must be 1 to 64"),
            ("max_trees_per_scene", self.max_trees_per_scene > 0, "must not be 0"),
            (
                "family",
                (1..=u64::from(MAX_SCENES)).contains(&scenes),
                "families and files together need 1 to 100000 scenes",
            ),
        ];
        checks.into_iter().find(|(_, good, _)| !good).map(|(key, _, message)| (key, message.to_owned()))
    }

    /// All scenes in the order in which they are made, the families in turn, so that an interrupted run has seen all of them.
    /// Held-out ones are spread evenly over each family.
    pub fn jobs(&self) -> Vec<Job> {
        let mut jobs = Vec::new();
        let most = self.family.iter().map(|part| part.scenes).max().unwrap_or(0);
        for index in 0..most {
            for part in self.family.iter().filter(|part| index < part.scenes) {
                let before = |i: u32| (f64::from(i) * self.held_out + 0.5).floor();
                let held_out = before(index + 1) > before(index);
                jobs.push(self.job(Source::Family(part.name), index, held_out));
            }
        }
        let file =
            |(index, scene): (u32, &SceneRecipe)| self.job(Source::File(scene.file.clone()), index, scene.held_out);
        jobs.extend((0..).zip(&self.scene).map(file));
        jobs
    }

    fn job(&self, source: Source, index: u32, held_out: bool) -> Job {
        let seed = Random::new(self.seed, source.id(), u64::from(index)).next_u64();
        Job { source, index, seed, held_out }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{GuideMode, RenderSettings, StopRule};

    const GOOD: &str = "name = \"a\"\nseed = 1\nheld_out = 0.25\niterations = [1, 2]\ntarget_spp = 64\n\
                        max_trees_per_scene = 8\n[[family]]\nname = \"rooms\"\nscenes = 10\n\
                        [[family]]\nname = \"caustics\"\nscenes = 4\n";

    fn parse(text: &str) -> Result<Recipe> {
        Recipe::parse(text, Path::new("r.toml"))
    }

    #[test]
    fn jobs_are_distinct_and_split_as_asked() {
        let jobs = parse(GOOD).unwrap().jobs();
        let seeds: std::collections::BTreeSet<u64> = jobs.iter().map(|j| j.seed).collect();
        assert_eq!(seeds.len(), 14);
        let held_out = |family| jobs.iter().filter(|j| j.source == Source::Family(family) && j.held_out).count();
        assert_eq!((held_out(Family::Rooms), held_out(Family::Caustics)), (3, 1));
        assert_eq!(jobs, parse(GOOD).unwrap().jobs());
    }

    #[test]
    fn what_is_learned_can_be_chosen() {
        assert_eq!(
            parse(GOOD).unwrap().target,
            RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).learner.target
        );
        let radiance = GOOD.replace("seed = 1", "seed = 1\ntarget = \"radiance\"");
        assert_eq!(parse(&radiance).unwrap().target, Target::Radiance);
        let guided = GOOD.replace("seed = 1", "seed = 1\nguide = \"neural\"");
        let guides = [GOOD, &guided].map(|text| parse(text).unwrap().guide);
        assert_eq!(guides, [Reconstruction::Gaussian, Reconstruction::Neural]);
    }

    #[test]
    fn scenes_in_files_follow_those_of_families() {
        let text =
            GOOD.to_owned() + "[[scene]]\nfile = \"../a/scene.json\"\nheld_out = true\n[[scene]]\nfile = \"b.xml\"\n";
        let jobs = Recipe::parse(&text, Path::new("data/r.toml")).unwrap().jobs();
        let [first, second] = &jobs[14..] else { panic!("{} jobs", jobs.len()) };
        assert_eq!(first.source, Source::File("data/../a/scene.json".into()));
        assert_eq!((first.source.name(), first.held_out, first.index), ("a".into(), true, 0));
        assert_eq!((second.source.name(), second.held_out, second.index), ("b".into(), false, 1));
    }

    /// A folder of scenes is measured on alone: those with a document, by name, whatever the recipe lists itself.
    #[test]
    fn scenes_of_a_folder_take_the_place_of_all_others() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b/scene.xml", "a/scene.json", "a/scene.xml", "c/notes.txt"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let of = |path: PathBuf| parse(GOOD).unwrap().with_scenes(&path);
        let jobs = of(folder.path().into()).unwrap().jobs();
        let names: Vec<(String, bool)> = jobs.iter().map(|job| (job.source.name(), job.held_out)).collect();
        assert_eq!(names, [("a".to_owned(), true), ("b".to_owned(), true)]);
        assert_eq!(jobs[0].source, Source::File(folder.path().join("a/scene.json")));
        assert_eq!(of(folder.path().join("b")).unwrap().jobs().len(), 1, "a folder that is a scene itself");
        assert!(matches!(of(folder.path().join("c")), Err(Error::Malformed { .. })));
        assert!(matches!(of(folder.path().join("d")), Err(Error::Io { .. })));
    }

    #[test]
    fn faults_name_their_place() {
        for (from, to, place) in [
            ("seed = 1", "seed = -1", "r.toml:2"),
            ("seed = 1", "seed = 1\nsede = 2", "r.toml:3"),
            ("seed = 1", "seed = 1\ntarget = \"energy\"", "r.toml:3"),
            ("seed = 1", "seed = 1\ntarget = \"variance-pixel\"", "r.toml (target)"),
            ("\"rooms\"", "\"halls\"", "r.toml:8"),
            ("0.25", "1.0", "r.toml (held_out)"),
            ("[1, 2]", "[]", "r.toml (iterations)"),
            ("scenes = 10", "scenes = 4000000000", "r.toml (family)"),
        ] {
            let message = parse(&GOOD.replace(from, to)).unwrap_err().to_string();
            assert!(message.starts_with(place), "{message} should start with {place}");
        }
    }
}
