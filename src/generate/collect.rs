//! Collecting training pairs: a voxel's trees as a render has them after a few iterations, and the converged distribution.
//!
//! One long run of a scene makes the voxels, which are never halved, finds out where their light starts, and collects Q_gt for
//! all of them from camera paths. Then several short runs learn anew in the same voxels, as a render does, and leave inputs after
//! each iteration: inputs are cheap to make, targets are not. Directions of both refer to the same spheres (see
//! [`Parallax`](crate::guiding::cache::parallax::Parallax)).

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::dataset::{DatasetIndex, INDEX_FILE, ShardEntry};
use super::parts::{self, PartIndex};
use super::recipe::{Job, Recipe, SceneRecipe, Source};
use super::shard::{TreeSample, write_shard};
use crate::base::files::{crc32, read_json, write_json};
use crate::base::random::Random;
use crate::base::{Error, Place, Progress, Result};
use crate::film::{FinishedPass, Pass, PixelFilter, combine, expected_values};
use crate::guiding::cache::{Bounds, VoxelId};
use crate::guiding::learn::learner::Use;
use crate::guiding::target::Target as Quantity;
use crate::guiding::tree::distribution::{Distribution, kl};
use crate::guiding::tree::leaves::distribution_of_values;
use crate::guiding::tree::quadtree::Quadtree;
use crate::guiding::tree::topology::Topology;
use crate::guiding::tree::{CountedTree, Trees};
use crate::network::config::Mode;
use crate::picture::Window;
use crate::reconstruct::Reconstructor;
use crate::reconstruct::buckets::Buckets;
use crate::render::{Learning, PartOf, PassTracer, RenderSettings, SampleKinds, Statistics, StopRule};
use crate::scene::{Scene, readers};

/// ρ of the targets: finer than that of the inputs, since they have the samples for it.
const TARGET_SPLIT_SHARE: f64 = 0.008;
/// Path samples that a target needs.
const LEAST_TARGET_SAMPLES: u64 = 256;
/// Convergence floor above which a target teaches nothing, nats.
const WORST_FLOOR: f32 = 1.5;
/// Uniform part in the floor's second argument, which keeps it finite.
const FLOOR_UNIFORM: f64 = 0.02;
/// Kinds of samples that the inputs of a scene's short runs are made from, in turn, with [`TreeSample::kinds`].
const KINDS: [(SampleKinds, u32); 4] =
    [(SampleKinds::Both, 0), (SampleKinds::Both, 0), (SampleKinds::Path, 1), (SampleKinds::Photon, 2)];

/// Name of the file in which a data folder keeps the settings of its recipe.
const RECIPE_FILE: &str = "recipe.json";
/// Largest accepted file of that name, bytes.
const RECIPE_LIMIT: u64 = 1 << 20;

/// The shards that were made so far: of all scenes, or of those of a part.
enum Made {
    Whole(DatasetIndex),
    Part(PartIndex),
}

impl Made {
    fn read(recipe: &Recipe, jobs: u64, part: Option<PartOf>, folder: &Path) -> Result<Self> {
        let Some(part) = part else {
            let begun = folder.join(INDEX_FILE).exists();
            return Ok(Self::Whole(if begun { DatasetIndex::read(folder)? } else { DatasetIndex::default() }));
        };
        parts::check_unfinished(folder)?;
        // Known by their names, wherever the recipe was read from.
        let named =
            |scene: &SceneRecipe| SceneRecipe { file: Source::File(scene.file.clone()).name().into(), ..scene.clone() };
        let recipe = Recipe { scene: recipe.scene.iter().map(named).collect(), ..recipe.clone() };
        let text = serde_json::to_vec(&recipe).map_err(|e| Error::Options(format!("the recipe is no JSON: {e}")))?;
        let recipe = format!("{:08x}", crc32([text.as_slice()]));
        PartIndex::begun(folder, part, recipe, jobs).map(Self::Part)
    }

    fn shards(&mut self) -> &mut Vec<ShardEntry> {
        match self {
            Self::Whole(index) => &mut index.shards,
            Self::Part(index) => &mut index.shards,
        }
    }

    fn write(&self, folder: &Path) -> Result<()> {
        match self {
            Self::Whole(index) => index.write(folder),
            Self::Part(index) => index.write(folder),
        }
    }
}

/// Follows `recipe` into `folder`, see [`generate_part`].
///
/// # Errors
/// As [`generate_part`].
pub fn generate(recipe: &Recipe, folder: &Path, progress: &dyn Progress, stop: &AtomicBool) -> Result<usize> {
    generate_part(recipe, folder, None, progress, stop)
}

/// Follows `recipe` into `folder`: one shard per scene and an index; of a `part`, if there is one, the scenes that are dealt to it (see
/// [`parts`]). Shards that the index already lists are kept, so an interrupted run goes on where it stopped, and a recipe may get more
/// scenes. A folder that is refused stays as it was. Returns the number of scenes that are missing because it was stopped.
///
/// # Errors
/// Errors of building a scene, rendering it and writing; [`Error::Malformed`] for a folder that another recipe made; [`Error::Parts`] for a
/// part of data that are whole, or of others.
pub fn generate_part(
    recipe: &Recipe,
    folder: &Path,
    part: Option<PartOf>,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<usize> {
    let (jobs, mode) = (recipe.jobs(), render_settings(recipe).mode());
    let guide = recipe.guide.reconstructor(|| Ok(Box::new(Buckets::built_in(&mode)?)))?;
    let mut made = Made::read(recipe, jobs.len() as u64, part, folder)?;
    check_folder(recipe, &jobs, &mode, made.shards(), folder)?;
    if !folder.join(RECIPE_FILE).exists() {
        write_json(&folder.join(RECIPE_FILE), &of_scenes(recipe))?;
    }
    let own: Vec<(u32, &Job)> =
        (0u32..).zip(&jobs).filter(|(number, _)| part.is_none_or(|part| part.takes((*number).into()))).collect();
    progress.start(own.len() as u64, "scenes");
    // A part without scenes is done too.
    if own.is_empty() {
        made.write(folder)?;
    }
    let mut missing = 0;
    for (number, job) in own {
        let file = shard_name(number, job);
        let known = made.shards().iter().position(|shard| shard.file == file);
        if known.is_none() || !folder.join(&file).is_file() {
            if stop.load(std::sync::atomic::Ordering::Relaxed) {
                missing += 1;
                continue;
            }
            progress.message(&file);
            let samples = collect(recipe, job, number, &*guide)?;
            write_shard(&folder.join(&file), &samples)?;
            let entry = ShardEntry {
                version: super::shard::VERSION,
                file,
                scene: format!("{}-{:016x}", job.source.name(), job.seed),
                family: job.source.family().into(),
                seed: job.seed,
                held_out: job.held_out,
                samples: samples.len() as u64,
                mode: mode.clone(),
            };
            match known {
                Some(at) => made.shards()[at] = entry,
                None => made.shards().push(entry),
            }
            made.write(folder)?;
        }
        progress.advance(1);
    }
    progress.finish();
    Ok(missing)
}

fn shard_name(number: u32, job: &Job) -> String {
    format!("{number:05}-{}.safetensors", job.source.name())
}

/// Settings of a recipe that all scenes share; seeds and what is held out are in the index.
fn of_scenes(recipe: &Recipe) -> Recipe {
    Recipe { name: String::new(), held_out: 0.0, family: vec![], scene: vec![], ..recipe.clone() }
}

/// Refuses a folder whose data were made with other settings than `recipe` has, or of other scenes than its `jobs`.
fn check_folder(recipe: &Recipe, jobs: &[Job], mode: &Mode, shards: &[ShardEntry], folder: &Path) -> Result<()> {
    let note = folder.join(RECIPE_FILE);
    if note.exists() && read_json::<Recipe>(&note, RECIPE_LIMIT)? != of_scenes(recipe) {
        let message = "the data were made by a recipe that says other things of its scenes; choose another folder";
        return Err(Error::malformed(Place::file(note), message));
    }
    let refuse = |message: String| Err(Error::malformed(Place::file(folder.join(INDEX_FILE)), message));
    if shards.first().is_some_and(|first| first.mode != *mode) {
        return refuse(format!("was made in another mode than {mode:?}; choose another folder"));
    }
    let names: BTreeSet<String> = (0..).zip(jobs).map(|(number, job)| shard_name(number, job)).collect();
    if let Some(other) = shards.iter().find(|shard| !names.contains(&shard.file)) {
        return refuse(format!("{} is of no scene of this recipe: more families change what is which", other.file));
    }
    for (number, job) in (0..).zip(jobs) {
        let file = shard_name(number, job);
        let mut known = shards.iter().filter(|shard| shard.file == file);
        if let Some(other) = known.find(|shard| (shard.seed, shard.held_out) != (job.seed, job.held_out)) {
            return refuse(format!("{file} was made by another recipe: it has the seed {}", other.seed));
        }
    }
    Ok(())
}

/// Render settings of all scenes of a recipe.
fn render_settings(recipe: &Recipe) -> RenderSettings {
    let mut settings = RenderSettings::new(recipe.method.into(), StopRule::Spp(1));
    settings.learner.target = recipe.target;
    settings.learner.voxel_samples = u32::MAX;
    settings.learner.memory = 1 << 30;
    settings
}

/// Collects the training pairs of one scene, in renders guided by what `guide` reconstructs.
///
/// # Errors
/// Errors of building the scene and rendering it.
pub fn collect(recipe: &Recipe, job: &Job, number: u32, guide: &dyn Reconstructor) -> Result<Vec<TreeSample>> {
    let loaded = match &job.source {
        Source::Family(family) => super::load(*family, job.seed, recipe.resolution)?,
        Source::File(path) => readers::load(path)?,
    };
    let mut settings = render_settings(recipe);
    settings.transport.max_depth = loaded.file.render.max_depth;
    settings.seed = job.seed;
    settings.learner.resolution = recipe.grids[job.index as usize % recipe.grids.len()] as f32;
    let scene = Scene::build(&loaded, recipe.resolution)?;
    let learning = Learning::new(&settings, &scene.lights.emission);
    let mut long = Run { scene: &scene, guide, learning, settings: settings.clone(), first_sample: 0, passes: vec![] };
    let targets = long.targets(recipe.target_spp)?;
    let mut samples = Vec::new();
    for turn in 0..recipe.runs {
        let mut settings = settings.clone();
        settings.samples = KINDS[turn as usize % KINDS.len()].0;
        let mut learning = Learning::new(&settings, &scene.lights.emission);
        learning.learner = long.learning.learner.restarted(settings.learner.clone());
        let mut run = Run { scene: &scene, guide, learning, settings, first_sample: long.first_sample, passes: vec![] };
        samples.extend(run.pairs(recipe, job, number, turn, &targets)?);
        long.first_sample = run.first_sample;
    }
    Ok(samples)
}

/// Passes over one scene and what is learned from them.
struct Run<'a> {
    scene: &'a Scene,
    /// Makes the guides that its samples are drawn by.
    guide: &'a dyn Reconstructor,
    settings: RenderSettings,
    learning: Learning,
    first_sample: u32,
    /// The passes so far: as in a render, roulette and light sampling depend on the pixel values estimated from them.
    passes: Vec<FinishedPass>,
}

/// Converged distribution of a voxel, Q_gt, with that of BSDF samples.
struct Target {
    distribution: Distribution,
    bsdf: Vec<f32>,
    samples: u64,
    floor_kl: f32,
}

impl Run<'_> {
    fn pass(&mut self, spp: u32) -> Statistics {
        let field = self.learning.learner.field(Use::Learning);
        let picture = combine(&self.passes).ok().and_then(|picture| expected_values(&picture));
        let filter = PixelFilter::default();
        let tracer = PassTracer {
            field: Some(&field),
            picture: picture.as_deref(),
            first_sample: self.first_sample,
            spp,
            ..PassTracer::new(self.scene, &self.settings, Window::whole(self.scene.size), &filter)
        };
        let mut film = Pass::new(self.scene.size[0] as usize, self.scene.size[1] as usize);
        let mut statistics = Statistics::default();
        tracer.run(&mut film, 0, Some(&mut self.learning), &mut statistics, &mut |_| true);
        self.first_sample += spp;
        self.passes.push(film.finish());
        statistics
    }

    fn quadtrees(&self) -> impl Iterator<Item = &Quadtree> {
        self.learning.learner.model().trees().into_iter().flat_map(Trees::quadtrees)
    }

    fn end_iteration(&mut self) -> Result<()> {
        self.learning.end_iteration(1, f64::INFINITY, self.guide, &mut Default::default()).map(drop)
    }

    /// Refines the trees with some of `spp` samples per pixel, at most a quarter, freezes their shapes, and fills them with two independent
    /// halves of the rest, from camera paths alone. One target per voxel; none where it has not converged.
    fn targets(&mut self, spp: u32) -> Result<Vec<Option<Target>>> {
        if let Some(trees) = self.learning.learner.model_mut().trees_mut() {
            trees.set_split_share(TARGET_SPLIT_SHARE);
        }
        let mut spent = 0;
        let mut next = (spp / 16).max(1);
        while spent + next <= (spp / 4).max(1) {
            self.pass(next);
            self.end_iteration()?;
            spent += next;
            next = (next * 2).min((spp / 4).saturating_sub(spent).max(next));
        }
        self.settings.samples = SampleKinds::Path;
        self.learning.photon_share = 0.0;
        self.learning.learner.freeze_spheres();
        if let Some(trees) = self.learning.learner.model_mut().trees_mut() {
            trees.freeze_shapes();
        }
        let half = (spp.saturating_sub(spent) / 2).max(1);
        self.learning.learner.clear();
        self.pass(half);
        let first: Vec<Quadtree> = self.quadtrees().cloned().collect();
        self.learning.learner.clear();
        self.pass(half);
        // In place: on fine grids a copy takes gigabytes.
        let second = self.quadtrees();
        let quantity = self.settings.learner.target;
        Ok(first.iter().zip(second).map(|(first, second)| Target::of(first, second, quantity)).collect())
    }

    /// Runs the iterations, and takes the trees of evenly drawn voxels after each that the recipe lists.
    fn pairs(
        &mut self,
        recipe: &Recipe,
        job: &Job,
        number: u32,
        turn: u32,
        targets: &[Option<Target>],
    ) -> Result<Vec<TreeSample>> {
        let last = recipe.iterations.iter().copied().max().unwrap_or(0);
        let most = (recipe.max_trees_per_scene / (recipe.runs * recipe.iterations.len() as u32).max(1)).max(1);
        let mut random = Random::new(job.seed, u64::MAX, u64::from(turn));
        let mut pairs = Vec::new();
        for t in 0..=last {
            self.pass(1 << t);
            if recipe.iterations.contains(&t) {
                let bounds = self.learning.learner.cache().cloned();
                let counted = self.learning.learner.counted();
                let usable = |&v: &VoxelId| {
                    counted[v as usize].is_some() && targets.get(v as usize).is_some_and(Option::is_some)
                };
                let voxels = (0..counted.len() as VoxelId).filter(usable).collect();
                for voxel in draw(voxels, most, &mut random) {
                    let pair = (&counted[voxel as usize], targets.get(voxel as usize), &bounds);
                    if let (Some(tree), Some(Some(target)), Some(cache)) = pair {
                        let Bounds { low, high, .. } = cache.bounds(voxel);
                        pairs.push(TreeSample {
                            scene: number,
                            family: job.source.id() as u32,
                            iteration: t,
                            kinds: KINDS[turn as usize % KINDS.len()].1,
                            bounds: [low.x, low.y, low.z, high.x, high.y, high.z],
                            ..pair_of(tree, target)
                        });
                    }
                }
            }
            if t < last {
                self.end_iteration()?;
            }
        }
        Ok(pairs)
    }
}

/// Up to `most` of the voxels, drawn without replacement, in their order.
fn draw(mut voxels: Vec<VoxelId>, most: u32, random: &mut Random) -> Vec<VoxelId> {
    let count = voxels.len().min(most as usize);
    for i in 0..count {
        let j = i + random.below((voxels.len() - i) as u32) as usize;
        voxels.swap(i, j);
    }
    voxels.truncate(count);
    voxels.sort_unstable();
    voxels
}

fn pair_of(tree: &CountedTree, target: &Target) -> TreeSample {
    let narrow = |masses: Vec<f64>| masses.into_iter().map(|m| m as f32).collect();
    TreeSample {
        own_split: tree.own.topology.split_flags(),
        own_sums: tree.own.sums.to_vec(),
        counted_split: tree.counted.topology().split_flags(),
        counted: narrow(tree.counted.leaf_mass()),
        block_split: tree.block.distribution.topology().split_flags(),
        block: narrow(tree.block.distribution.leaf_mass()),
        block_samples: tree.block.samples,
        voxel_features: tree.voxel_features,
        target_split: target.distribution.topology().split_flags(),
        target: narrow(target.distribution.leaf_mass()),
        target_bsdf: target.bsdf.clone(),
        target_samples: target.samples,
        floor_kl: target.floor_kl,
        ..TreeSample::default()
    }
}

impl Target {
    /// Target from two independent halves together; none where they have too few samples or too little in common.
    fn of(first: &Quadtree, second: &Quadtree, quantity: Quantity) -> Option<Self> {
        let topology = first.topology();
        if topology != second.topology() {
            return None;
        }
        let sum = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(&b).map(|(x, y)| x + y).collect::<Vec<f64>>();
        let (a, b) = (first.path_values(), second.path_values());
        let distribution = |values: &[f64]| distribution_of_values(topology, values, quantity);
        let floor_kl = kl(&distribution(&a), &distribution(&b), FLOOR_UNIFORM) as f32;
        let samples = u64::from(first.counts()[0]) + u64::from(second.counts()[0]);
        let both = sum(a, b);
        // A root alone was refined without light, and says nothing of where the light is that was found later.
        let lit = topology.len() > 1 && both.iter().any(|&v| v > 0.0);
        let usable = lit && samples >= LEAST_TARGET_SAMPLES && floor_kl < WORST_FLOOR;
        let bsdf = Distribution::from_leaf_weights(topology.clone(), &sum(first.bsdf_values(), second.bsdf_values()));
        // Without any BSDF sample (everything was drawn by guides) the uniform sphere stands for it.
        let bsdf = mass_on(topology, &bsdf);
        usable.then(|| Self { distribution: distribution(&both), bsdf, samples, floor_kl })
    }
}

/// Mass of a distribution in the leaves of another tree.
fn mass_on(topology: &Topology, of: &Distribution) -> Vec<f32> {
    topology.leaves().map(|leaf| of.cell_mass(topology.level_of(leaf), topology.cell[leaf]) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Family, load};
    use super::*;
    use crate::reconstruct::gaussian::Gaussian;
    use crate::render::GuideMode;

    /// As in a render, a pass estimates pixel values from those before, and leaves out work that brings little: at least a
    /// twentieth of the rays, with the same guides. Data of paths that are never judged would not be what renders have.
    #[test]
    fn data_are_collected_with_the_roulette_of_renders() {
        let loaded = load(Family::ALL[0], 3, [32, 32]).expect("a generated scene is sound");
        let scene = Scene::build(&loaded, [32, 32]).expect("a generated scene builds");
        let settings = RenderSettings::new(GuideMode::Gaussian, StopRule::Spp(1));
        let learning = Learning::new(&settings, &scene.lights.emission);
        let guide = &Gaussian::default();
        let mut run = Run { scene: &scene, guide, learning, settings, first_sample: 0, passes: vec![] };
        for _ in 0..3 {
            run.pass(4);
            run.end_iteration().expect("smoothing does not fail");
        }
        let judged = run.pass(16).camera_rays as f64;
        run.passes.clear();
        let all = run.pass(16).camera_rays as f64;
        assert!(judged < 0.95 * all, "{judged} rays against {all}");
    }
}
