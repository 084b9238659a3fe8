//! Running a comparison: methods × budgets × seeds, interleaved, each run kept so that an interrupted comparison goes on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::analysis::{summarise, times_to_reach};
use super::denoising::Denoising;
use super::guides::{self, Guides};
use super::results::{Budget, Errors, LIMIT, ORACLE, Parts, ReferenceEntry, Results, RunEntry, SceneEntry, VERSION};
use crate::base::files::{crc32, read_json, write_json};
use crate::base::process::cpu_seconds;
use crate::base::progress::Silent;
use crate::base::{Error, Progress, Result};
use crate::film::{Denoiser, mean_and_variance, measure_noisy, relative_variance};
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::guiding::sample::file;
use crate::integrators::TransportSettings;
use crate::picture::{Image, read_image, write};
use crate::reconstruct::buckets::Buckets;
use crate::reconstruct::{AsCounted, Neural};
use crate::render::{
    ALGORITHM, Control, GuideMode, Outcome, RenderSettings, StopRule, learn, render, render_with_field,
};
use crate::scene::Scene;
use crate::scene::plan::plan;
use crate::scene::readers::LoadedScene;

/// A method of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// As `fanal render --guide` does it.
    Guide(GuideMode),
    /// Guided by converged trees that were made beforehand: a bound for what reconstruction could reach at most.
    Oracle,
    /// One of the experiment's variants.
    Variant(usize),
}

/// A method with settings of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Its name on the page and in files, which no other method has.
    pub name: String,
    /// Its settings, which follow the scene's plan; depth, filter, budget and seed are those of the experiment.
    pub settings: RenderSettings,
    /// Whether noisy pixels get more samples; none for what the budget calls for.
    pub adaptive: Option<bool>,
}

/// A comparison to run.
pub struct Experiment<'a> {
    /// The scene as read.
    pub loaded: &'a LoadedScene,
    /// Path of the scene as given by the user.
    pub path: String,
    /// Seconds that reading took.
    pub load_seconds: f64,
    /// Settings that the modes share; mode, budget, seed and how samples are divided are set per run. Of these variants have depth and filter.
    pub settings: RenderSettings,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Methods; ratios refer to the first.
    pub methods: Vec<Method>,
    /// What [`Method::Variant`] counts.
    pub variants: &'a [Variant],
    /// Budgets.
    pub budgets: Vec<Budget>,
    /// Number of seeds.
    pub seeds: u64,
    /// A reference and its variance as files; without them one is rendered.
    pub reference: Option<(PathBuf, Option<PathBuf>)>,
    /// Samples per pixel of each part of a reference that is rendered.
    pub reference_spp: u32,
    /// Samples per pixel that the oracle learns from.
    pub oracle_spp: u32,
    /// Denoises every picture, to measure it so too; none where that is not asked for.
    pub denoiser: Option<&'a Denoiser>,
    /// Network that reconstructs for the neural method.
    pub neural: &'a Neural,
    /// The output folder.
    pub folder: &'a Path,
}

/// Number of independent parts of a reference that is rendered: their spread is its variance.
const REFERENCE_PARTS: u64 = 4;
/// First seed of the reference's parts, and of the runs. Apart, so that no run has the reference's noise.
const REFERENCE_SEED: u64 = 1 << 40;
const ORACLE_SEED: u64 = 1 << 41;
/// Guiding method by which the oracle learns: photons lead it to light that paths alone hardly find.
const ORACLE_GUIDE: GuideMode = GuideMode::Hybrid;
const FIRST_SEED: u64 = 1;

/// One render of a comparison.
#[derive(Clone, Copy)]
struct Task<'a> {
    method: Method,
    /// Name of the method on the command line and on the page.
    name: &'a str,
    /// Index into the budgets, and the budget itself.
    budget: usize,
    limit: Budget,
    seed: u64,
}

impl Task<'_> {
    /// Name of its files.
    fn stem(&self) -> String {
        format!("{}-{}-{}", self.name, self.limit.label(), self.seed)
    }

    /// Its picture, relative to the output folder.
    fn picture(&self) -> String {
        format!("runs/{}.exr", self.stem())
    }
}

const PROGRAM: &str = concat!("fanal ", env!("CARGO_PKG_VERSION"));

/// Everything that pictures and times of runs depend on.
struct Identity {
    scene_crc32: u32,
    /// Program and settings of a run, written out: equal texts mean equal runs.
    settings: String,
}

impl Identity {
    /// Text of everything that a picture under a budget of samples depends on.
    fn of_pictures(&self) -> String {
        format!("{:08x} {}", self.scene_crc32, self.settings)
    }

    /// The same with the number of threads, on which a run's time depends too.
    fn of_runs(&self) -> String {
        format!("{} {} threads", self.of_pictures(), rayon::current_num_threads())
    }
}

/// A run as it is kept beside its picture, with the identity it was made for, so that a run of other settings is not taken for it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    made_for: String,
    run: RunEntry,
}

/// Results of a comparison, complete or interrupted.
pub struct Comparison {
    /// Everything measured.
    pub results: Results,
    /// The reference.
    pub reference: Image,
    /// Fields of the guided methods at the largest budget.
    pub guides: Vec<(String, Guides)>,
    /// Number of runs that are missing because it was stopped.
    pub missing: usize,
}

impl Comparison {
    /// Message that tells of missing runs; none where there are none.
    pub fn interruption(&self) -> Option<String> {
        let n = self.missing;
        let missing = if n == 1 { "one run is missing".into() } else { format!("{n} runs are missing") };
        (n > 0).then(|| format!("Interrupted, {missing}; the same command goes on."))
    }
}

impl Experiment<'_> {
    /// Renders the runs that are not kept yet and measures all. Setting `stop` ends it within the run at hand, which
    /// is then missing.
    ///
    /// # Errors
    /// Errors of reading, rendering and writing; [`Error::Interrupted`] where no run was finished.
    pub fn run(&self, progress: &dyn Progress, stop: &AtomicBool) -> Result<Comparison> {
        for folder in ["runs", "data", "plots"].map(|f| self.folder.join(f)) {
            std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
        }
        let begun = Instant::now();
        let scene = Scene::build(self.loaded, self.size)?;
        let build_seconds = begun.elapsed().as_secs_f64();
        let control = Control::new(&Silent, stop);
        let identity = self.identity();
        let total = self.budgets.len() as u64 * self.seeds * self.methods.len() as u64;
        progress.start(total, "runs");
        let (entry, reference, variance) = self.reference(&scene, &identity, progress, &control)?;
        let denoising = self.denoiser.map(|d| Denoising::new(d, &scene, &self.settings)).transpose()?;
        let mut oracle: Option<GuideField> = None;
        let mut runs = Vec::new();
        for (budget, &limit) in self.budgets.iter().enumerate() {
            for seed in FIRST_SEED..FIRST_SEED + self.seeds {
                for i in 0..self.methods.len() {
                    // The order turns with the seed: what comes first or last must not always be the same method.
                    let method = self.methods[(i + seed as usize) % self.methods.len()];
                    let task = Task { method, name: self.name(method), budget, limit, seed };
                    progress.message(&task.stem());
                    let (run, picture) = match self.kept(task, &identity) {
                        Some(kept) => kept,
                        // Kept runs of later budgets and seeds still count.
                        None if stop.load(Ordering::Relaxed) => continue,
                        None => {
                            if method == Method::Oracle && oracle.is_none() {
                                oracle = Some(self.converged(&scene, &identity, &control)?);
                            }
                            let Some(made) = self.one(&scene, task, oracle.as_ref(), &control)? else { continue };
                            let kept = Kept { made_for: self.made_for(task, &identity), run: made.clone() };
                            write_json(&self.record(task), &kept)?;
                            let picture = read_image(&self.folder.join(&made.file), false)?;
                            (made, picture)
                        }
                    };
                    let measures = measure_noisy(&picture, &reference, variance.as_ref())?;
                    let mean_ratio = Some(measures.mean_ratio).filter(|ratio| ratio.is_finite());
                    let denoised = |d: &Denoising| d.measured(&picture, &reference, variance.as_ref());
                    let denoised = denoising.as_ref().map(denoised).transpose()?;
                    runs.push(RunEntry { budget, errors: (&measures).into(), mean_ratio, denoised, ..run });
                    progress.advance(1);
                }
            }
        }
        progress.finish();
        if runs.is_empty() {
            return Err(Error::Interrupted("the comparison was stopped before its first run".into()));
        }
        let methods: Vec<String> = self.methods.iter().map(|&m| self.name(m).to_owned()).collect();
        let summary = summarise(&methods, self.budgets.len(), &runs);
        let seeds: BTreeSet<u64> = runs.iter().map(|run| run.seed).collect();
        let results = Results {
            version: VERSION,
            program: PROGRAM.into(),
            scene: SceneEntry {
                name: scene.name.clone(),
                path: self.path.clone(),
                crc32: identity.scene_crc32,
                width: self.size[0],
                height: self.size[1],
                max_depth: self.settings.transport.max_depth,
                load_seconds: self.load_seconds,
                build_seconds,
            },
            threads: rayon::current_num_threads(),
            reference: entry,
            time_to_reach: times_to_reach(&methods, &summary),
            methods,
            budgets: self.budgets.clone(),
            seeds: seeds.into_iter().collect(),
            oracle_spp: self.methods.contains(&Method::Oracle).then_some(self.oracle_spp),
            denoiser: self.denoiser.map(Denoiser::name),
            runs,
            summary,
        };
        let missing = total as usize - results.runs.len();
        Ok(Comparison { guides: self.guides(&results), results, reference, missing })
    }

    fn identity(&self) -> Identity {
        let model = &self.neural.model;
        let weights = model.weights.checksum();
        let (size, settings, oracle) = (self.size, &self.settings, self.oracle_spp);
        let settings = format!(
            "{PROGRAM} algorithm {ALGORITHM} {size:?} {settings:?} oracle {oracle} {ORACLE_GUIDE:?} model {:?} {weights:08x}",
            model.config
        );
        Identity { scene_crc32: self.loaded.crc32(), settings }
    }

    /// Name of a method on the command line and on the page.
    fn name(&self, method: Method) -> &str {
        match method {
            Method::Guide(guide) => guide.name(),
            Method::Oracle => ORACLE,
            Method::Variant(index) => &self.variants[index].name,
        }
    }

    /// Settings of a run; the oracle's are those that its guide is sampled with.
    fn settings_of(&self, method: Method, stop: StopRule, seed: u64) -> RenderSettings {
        // As `fanal render` divides samples.
        let adaptive = matches!(stop, StopRule::Time(_));
        match method {
            Method::Guide(guide) => {
                let settings = RenderSettings {
                    stop,
                    seed,
                    adaptive: adaptive && guide != GuideMode::Paths,
                    ..self.settings.with_guide(guide)
                };
                settings.following(&plan(&self.loaded.file))
            }
            Method::Oracle => RenderSettings { stop, seed, adaptive, ..self.settings.with_guide(ORACLE_GUIDE) },
            Method::Variant(index) => {
                let Variant { settings, adaptive: given, .. } = &self.variants[index];
                let transport =
                    TransportSettings { max_depth: self.settings.transport.max_depth, ..settings.transport };
                let adaptive = given.unwrap_or(adaptive && settings.adapts());
                RenderSettings { transport, filter: self.settings.filter, stop, seed, adaptive, ..settings.clone() }
            }
        }
    }

    /// Everything that a run depends on, written out.
    fn made_for(&self, task: Task, identity: &Identity) -> String {
        format!("{} {:?}", identity.of_runs(), self.settings_of(task.method, rule(task.limit), task.seed))
    }

    fn record(&self, task: Task) -> PathBuf {
        self.folder.join("runs").join(format!("{}.json", task.stem()))
    }

    /// A run of an earlier call and its picture, if both are whole, of this task, this scene and these settings; what is not is
    /// made again.
    fn kept(&self, task: Task, identity: &Identity) -> Option<(RunEntry, Image)> {
        let Kept { made_for, run } = read_json(&self.record(task), LIMIT).ok()?;
        let own = (run.method.as_str(), run.seed, &run.file) == (task.name, task.seed, &task.picture());
        if made_for != self.made_for(task, identity) || !own || !run.is_possible() {
            return None;
        }
        let path = self.folder.join(&run.file);
        let picture = read_image(&path, false).and_then(|picture| self.sized(picture, &path)).ok()?;
        Some((run, picture))
    }

    fn render(&self, scene: &Scene, settings: RenderSettings, control: &Control) -> Result<Outcome> {
        let reconstructor =
            settings.reconstruction.reconstructor(|| Buckets::fitting(self.neural, &settings.mode()))?;
        render(scene, &settings, reconstructor.as_ref(), control.progress, control.stop)
    }

    /// Renders a run; none where it was stopped before it had spent its budget.
    fn one(
        &self,
        scene: &Scene,
        task: Task,
        oracle: Option<&GuideField>,
        control: &Control,
    ) -> Result<Option<RunEntry>> {
        let Task { method, name, budget, limit, seed } = task;
        // An older record must not be taken for that of the new picture, should that be all that gets written.
        remove(&self.record(task))?;
        let settings = self.settings_of(method, rule(limit), seed);
        let cpu = cpu_seconds();
        let outcome = match (method, oracle) {
            (Method::Guide(_) | Method::Variant(_), _) => self.render(scene, settings, control),
            (Method::Oracle, Some(field)) => render_with_field(scene, &settings, field.clone(), control),
            (Method::Oracle, None) => Err(Error::Options("the oracle has learned nothing".into())),
        };
        // The runs before it are worth a page all the same.
        let outcome = match outcome {
            Err(Error::Interrupted(_)) => return Ok(None),
            outcome => outcome?,
        };
        let cpu_seconds = cpu.and_then(|before| Some(cpu_seconds()? - before));
        if control.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let file = task.picture();
        let begun = Instant::now();
        write(&self.folder.join(&file), &outcome.image, &[("method".into(), name.into())])?;
        let write = begun.elapsed().as_secs_f64();
        if method != Method::Guide(GuideMode::None) && seed == FIRST_SEED {
            write_json(&self.guide_file(name, limit), &guides::sample(scene, &outcome.field))?;
        }
        let seconds = outcome.statistics.seconds;
        Ok(Some(RunEntry {
            method: name.into(),
            budget,
            seed,
            file,
            spp: outcome.statistics.spp,
            seconds: seconds.total,
            cpu_seconds,
            parts: Parts {
                trace: seconds.trace,
                photons: seconds.photons,
                deposit: seconds.splat,
                reconstruct: seconds.reconstruct,
                write,
            },
            // Measured once the picture is read back, so that a run kept from before is measured alike.
            errors: Errors { relmse: 0.0, relmse_trimmed: 0.0, relmse_ldr: 0.0 },
            mean_ratio: None,
            denoised: None,
            dropped_samples: outcome.statistics.dropped_samples,
        }))
    }

    fn guide_file(&self, method: &str, budget: Budget) -> PathBuf {
        self.folder.join("runs").join(format!("{method}-{}-guide.json", budget.label()))
    }

    /// Maps of the fields at the last budget, by method, without a method whose run is missing, since a file of that name would be
    /// of other settings.
    fn guides(&self, results: &Results) -> Vec<(String, Guides)> {
        let Some((last, &budget)) = self.budgets.iter().enumerate().next_back() else { return vec![] };
        let there =
            |m: &&String| results.runs.iter().any(|run| (run.budget, run.seed, &run.method) == (last, FIRST_SEED, m));
        let read = |m: &String| Some((m.clone(), read_json(&self.guide_file(m, budget), LIMIT).ok()?));
        results.methods.iter().filter(there).filter_map(read).collect()
    }

    /// The oracle's field: learned from many samples, as counted, and kept in a file.
    fn converged(&self, scene: &Scene, identity: &Identity, control: &Control) -> Result<GuideField> {
        // The name tells what it was made for; a file that cannot be read any more is made again.
        let made_for = crc32([identity.of_pictures().as_bytes()]);
        let path = self.folder.join("runs").join(format!("oracle-{made_for:08x}.guide"));
        if let Ok((field, _)) = file::load(&path) {
            return Ok(field);
        }
        let settings = RenderSettings {
            stop: StopRule::Spp(self.oracle_spp),
            seed: ORACLE_SEED,
            ..self.settings.with_guide(ORACLE_GUIDE)
        };
        let field = learn(scene, &settings, &AsCounted::default(), control)?;
        if !control.stop.load(Ordering::Relaxed) {
            file::save(&path, &field, &Evidence::default())?;
        }
        Ok(field)
    }

    /// The reference and the variance of its pixels: read, kept from an earlier call, or rendered.
    fn reference(
        &self,
        scene: &Scene,
        identity: &Identity,
        progress: &dyn Progress,
        control: &Control,
    ) -> Result<(ReferenceEntry, Image, Option<Image>)> {
        if let Some((path, variance)) = &self.reference {
            let image = self.sized(read_image(path, false)?, path)?;
            let noise = variance.as_ref().map(|path| self.sized(read_image(path, true)?, path)).transpose()?;
            let entry = ReferenceEntry {
                file: absolute(path),
                variance_file: variance.as_deref().map(absolute),
                origin: "given".into(),
                relative_variance: noise.as_ref().map(|noise| relative_variance(&image, noise)).transpose()?,
            };
            return Ok((entry, image, noise));
        }
        let [file, variance_file] = ["reference.exr", "reference-variance.exr"].map(|f| self.folder.join(f));
        let note = self.folder.join("runs").join("reference.json");
        let origin = format!("neural, {REFERENCE_PARTS} parts of {} spp", self.reference_spp);
        let expected = format!("{} {origin}", identity.of_pictures());
        let read = |path, signed| self.sized(read_image(path, signed)?, path);
        let both = || Ok::<_, Error>((read(&file, false)?, read(&variance_file, true)?));
        let noted = read_json::<String>(&note, LIMIT).is_ok_and(|made_for| made_for == expected);
        let (image, noise) = match noted.then(both) {
            Some(Ok(kept)) => kept,
            _ => {
                // An older note must not be taken for that of new pictures, should only one of them get written.
                remove(&note)?;
                // The names of parts tell what they were made for.
                let made_for = crc32([expected.as_bytes()]);
                let part = |part| self.folder.join("runs").join(format!("reference-{made_for:08x}-{part}.exr"));
                let (mean, variance) = self.render_reference(scene, &part, progress, control)?;
                write(&file, &mean, &[])?;
                write(&variance_file, &variance, &[])?;
                write_json(&note, &expected)?;
                (0..REFERENCE_PARTS).try_for_each(|number| remove(&part(number)))?;
                both()?
            }
        };
        let entry = ReferenceEntry {
            file: "reference.exr".into(),
            variance_file: Some("reference-variance.exr".into()),
            origin,
            relative_variance: Some(relative_variance(&image, &noise)?),
        };
        Ok((entry, image, Some(noise)))
    }

    /// Mean and variance of the mean of independent parts, each of which is kept in its `file` until the reference is there.
    fn render_reference(
        &self,
        scene: &Scene,
        file: &dyn Fn(u64) -> PathBuf,
        progress: &dyn Progress,
        control: &Control,
    ) -> Result<(Image, Image)> {
        let mut parts = Vec::new();
        for part in 0..REFERENCE_PARTS {
            progress.message(&format!("reference, part {} of {REFERENCE_PARTS}", part + 1));
            let path = file(part);
            let kept = read_image(&path, false).and_then(|image| self.sized(image, &path));
            if let Ok(image) = kept {
                parts.push(image);
                continue;
            }
            let stop = StopRule::Spp(self.reference_spp);
            let settings = self.settings_of(Method::Guide(GuideMode::Neural), stop, REFERENCE_SEED + part);
            let image = self.render(scene, settings, control)?.image;
            if control.stop.load(Ordering::Relaxed) {
                return Err(Error::Interrupted("the comparison was stopped while its reference was made".into()));
            }
            write(&path, &image, &[])?;
            parts.push(image);
        }
        mean_and_variance(&parts)
    }

    fn sized(&self, image: Image, path: &Path) -> Result<Image> {
        let [width, height] = self.size.map(|n| n as usize);
        if (image.width, image.height) == (width, height) {
            return Ok(image);
        }
        Err(Error::Options(format!(
            "{}: {}x{} pixels, the pictures have {width}x{height}; give --size",
            path.display(),
            image.width,
            image.height
        )))
    }
}

/// The rule by which a render with this budget ends.
fn rule(budget: Budget) -> StopRule {
    match budget {
        Budget::Spp(spp) => StopRule::Spp(spp),
        Budget::Seconds(seconds) => StopRule::Time(seconds),
    }
}

/// Removes a file, if there is one.
fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path, e)),
        _ => Ok(()),
    }
}

fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}
