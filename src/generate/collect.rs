//! Collecting training trees: the noisy Q_h that rendering would have, and the converged Q_gt of the same voxel.
//!
//! Voxels are those of the first iteration and are never halved, so that one long run serves every iteration's input (see
//! SEMANTICS, targets for training). Inputs see camera paths and photons; targets see camera paths only.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::dataset::{DatasetIndex, INDEX_FILE, ShardEntry};
use super::recipe::{Job, Recipe};
use super::shard::{TreeSample, write_shard};
use crate::base::random::Random;
use crate::base::{Error, Place, Progress, Result};
use crate::film::{Pass, PixelFilter, Window};
use crate::guiding::cache::VoxelId;
use crate::guiding::distribution::{Distribution, kl};
use crate::guiding::leaves::distribution_of_values;
use crate::guiding::quadtree::Quadtree;
use crate::reconstruct::Counted;
use crate::render::{CHUNK, GuideMode, Learning, PassTracer, RenderSettings, SampleKinds, Statistics, StopRule};
use crate::scene::{Scene, readers};

/// ρ of the targets: finer than that of the inputs, since they have the samples for it.
const TARGET_SPLIT_SHARE: f64 = 0.008;
/// Path samples that a target needs.
const LEAST_TARGET_SAMPLES: u64 = 256;
/// Convergence floor above which a target teaches nothing, nats.
const WORST_FLOOR: f32 = 2.0;
/// Uniform part in the floor's second argument, which keeps it finite.
const FLOOR_UNIFORM: f64 = 0.02;

/// Follows `recipe` into `folder`: one shard per scene and an index. Shards that the index already lists are kept, so an
/// interrupted run goes on where it stopped.
///
/// # Errors
/// Whatever building a scene, rendering it or writing says.
pub fn generate(recipe: &Recipe, folder: &Path, progress: &dyn Progress, stop: &AtomicBool) -> Result<()> {
    let mut index =
        if folder.join(INDEX_FILE).exists() { DatasetIndex::read(folder)? } else { DatasetIndex::default() };
    let jobs = recipe.jobs();
    progress.start(jobs.len() as u64, "scenes");
    for (number, job) in (0u32..).zip(&jobs) {
        if stop.load(std::sync::atomic::Ordering::Relaxed) {
            break;
        }
        let file = format!("{number:05}-{}.safetensors", job.family.name());
        let known = index.shards.iter().find(|shard| shard.file == file);
        if let Some(other) = known.filter(|shard| (shard.seed, shard.held_out) != (job.seed, job.held_out)) {
            let message = format!("{} was made by another recipe: it has the seed {}", other.file, other.seed);
            return Err(Error::malformed(Place::file(folder.join(INDEX_FILE)), message));
        }
        if known.is_none() {
            progress.message(&file);
            let (samples, mode) = collect(recipe, job, number)?;
            write_shard(&folder.join(&file), &samples)?;
            index.shards.push(ShardEntry {
                version: super::shard::VERSION,
                file,
                scene: format!("{}-{:016x}", job.family.name(), job.seed),
                family: job.family.name().into(),
                seed: job.seed,
                held_out: job.held_out,
                samples: samples.len() as u64,
                mode,
            });
            index.write(folder)?;
        }
        progress.advance(1);
    }
    progress.finish();
    Ok(())
}

/// The trees of one scene, and the mode that they were collected in.
///
/// # Errors
/// Whatever building the scene or rendering it says.
pub fn collect(recipe: &Recipe, job: &Job, number: u32) -> Result<(Vec<TreeSample>, crate::network::config::Mode)> {
    let file = super::scene(job.family, job.seed, recipe.resolution);
    let mut settings = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1));
    settings.transport.max_depth = file.render.max_depth;
    settings.seed = job.seed;
    settings.learner.resolution = recipe.grids[job.index as usize % recipe.grids.len()] as f32;
    settings.learner.voxel_samples = u32::MAX;
    settings.learner.context = 0.0;
    settings.learner.memory = 1 << 30;
    let loaded = readers::resolve(file, Path::new("."), Path::new(job.family.name()))?;
    let scene = Scene::build(&loaded, recipe.resolution)?;
    let mode = settings.mode();
    let mut collector = Collector {
        scene: &scene,
        learning: Learning::new(&settings, &scene.lights.emission),
        settings,
        first_sample: 0,
    };
    let inputs = collector.inputs(recipe, job, number)?;
    Ok((collector.with_targets(inputs, recipe.target_spp)?, mode))
}

struct Collector<'a> {
    scene: &'a Scene,
    settings: RenderSettings,
    learning: Learning,
    first_sample: u32,
}

/// An input tree and the voxel that it came from.
struct Input {
    voxel: VoxelId,
    sample: TreeSample,
}

impl Collector<'_> {
    fn pass(&mut self, spp: u32) {
        let field = self.learning.field(true);
        let tracer = PassTracer {
            scene: self.scene,
            settings: &self.settings,
            window: Window::whole(self.scene.size),
            filter: &PixelFilter::default(),
            field: Some(&field),
            target: self.learning.learner.target(),
            picture: None,
            first_sample: self.first_sample,
            sequences_from: None,
            spp,
            chunk: CHUNK,
        };
        let mut film = Pass::new(self.scene.size[0] as usize, self.scene.size[1] as usize);
        tracer.run(&mut film, 0, Some(&mut self.learning), &mut Statistics::default(), &mut |_| true);
        self.first_sample += spp;
    }

    fn end_iteration(&mut self) -> Result<()> {
        self.learning.end_iteration(1, 0, 0.0, &Counted::default(), &mut Default::default()).map(drop)
    }

    /// Runs the iterations and takes the trees of evenly drawn voxels after each that the recipe lists.
    fn inputs(&mut self, recipe: &Recipe, job: &Job, number: u32) -> Result<Vec<Input>> {
        let last = recipe.iterations.iter().copied().max().unwrap_or(0);
        let mut chosen: Option<Vec<VoxelId>> = None;
        let mut inputs = Vec::new();
        for t in 0..=last {
            self.pass(1 << t);
            if recipe.iterations.contains(&t) {
                let trees = self.learning.learner.trees();
                let voxels = chosen.get_or_insert_with(|| draw(&trees, recipe.max_trees_per_scene, job.seed));
                let usable = voxels.iter().filter(|&&v| trees[v as usize].has_energy());
                let cache = self.learning.learner.cache();
                inputs.extend(usable.map(|&voxel| {
                    let bounds = cache.map(|c| c.bounds(voxel));
                    let corners = bounds.map_or([0.0; 6], |b| {
                        let (l, h) = (b.low, b.high);
                        [l.x, l.y, l.z, h.x, h.y, h.z]
                    });
                    let sample = input(trees[voxel as usize], job, number, t, corners);
                    Input { voxel, sample }
                }));
            }
            self.end_iteration()?;
        }
        Ok(inputs)
    }

    /// Refines the trees with a quarter of `spp` camera paths per pixel, freezes their shapes, and fills them with two
    /// independent halves of the rest.
    fn with_targets(mut self, inputs: Vec<Input>, spp: u32) -> Result<Vec<TreeSample>> {
        self.settings.samples = SampleKinds::Path;
        self.learning.learner.set_split_share(TARGET_SPLIT_SHARE);
        let mut spent = 0;
        let mut next = (spp / 16).max(1);
        while spent + next <= (spp / 4).max(1) {
            self.pass(next);
            self.end_iteration()?;
            spent += next;
            next = (next * 2).min((spp / 4).saturating_sub(spent).max(next));
        }
        self.learning.learner.freeze_shapes();
        let mut halves = Vec::new();
        for _ in 0..2 {
            self.learning.learner.clear();
            self.pass(((spp.saturating_sub(spent)) / 2).max(1));
            halves.push(self.learning.learner.trees().into_iter().cloned().collect::<Vec<Quadtree>>());
        }
        let target = |input: Input| {
            let voxel = input.voxel as usize;
            complete(input.sample, &halves[0][voxel], &halves[1][voxel])
        };
        Ok(inputs.into_iter().filter_map(target).collect())
    }
}

/// Up to `most` voxels whose trees hold energy, drawn without replacement.
fn draw(trees: &[&Quadtree], most: u32, seed: u64) -> Vec<VoxelId> {
    let mut voxels: Vec<VoxelId> = (0..trees.len() as VoxelId).filter(|&v| trees[v as usize].has_energy()).collect();
    let mut random = Random::new(seed, u64::MAX, 0);
    let count = voxels.len().min(most as usize);
    for i in 0..count {
        let j = i + random.below((voxels.len() - i) as u32) as usize;
        voxels.swap(i, j);
    }
    voxels.truncate(count);
    voxels.sort_unstable();
    voxels
}

fn input(tree: &Quadtree, job: &Job, number: u32, iteration: u32, bounds: [f32; 6]) -> TreeSample {
    let [path_samples, photon_samples] = tree.counts();
    TreeSample {
        scene: number,
        family: job.family.id() as u32,
        iteration,
        bounds,
        input_split: tree.leaves().topology.split_flags(),
        input_sums: tree.leaves().sums.to_vec(),
        path_samples,
        photon_samples,
        ..TreeSample::default()
    }
}

/// Adds the target made of two halves; none where it has too few samples or too little in common with itself.
fn complete(sample: TreeSample, first: &Quadtree, second: &Quadtree) -> Option<TreeSample> {
    let topology = first.topology();
    if topology != second.topology() {
        return None;
    }
    let (a, b) = (first.path_values(), second.path_values());
    let both: Vec<f64> = a.iter().zip(&b).map(|(x, y)| x + y).collect();
    let distribution = |values: &[f64]| distribution_of_values(topology, values);
    let floor_kl = kl(&distribution(&a), &distribution(&b), FLOOR_UNIFORM) as f32;
    let target_samples = u64::from(first.counts()[0]) + u64::from(second.counts()[0]);
    let usable = both.iter().any(|&v| v > 0.0) && target_samples >= LEAST_TARGET_SAMPLES && floor_kl < WORST_FLOOR;
    let target: Distribution = distribution(&both);
    usable.then(|| TreeSample {
        target_split: target.topology().split_flags(),
        target: target.leaf_mass().into_iter().map(|m| m as f32).collect(),
        target_samples,
        floor_kl,
        ..sample
    })
}
