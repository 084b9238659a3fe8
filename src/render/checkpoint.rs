//! Checkpoints: an interrupted render on disk, from which another process goes on as if nothing had happened.
//!
//! A safetensors file (see [`crate::base::tensors`]), written between two chunks of a pass. It holds the passes so far (see
//! [`FinishedPass::arrays`]), named `pass0`, `early0` and so on; the pass that is being made, `now`; while learning the learner (see
//! [`Learner::arrays`](crate::guiding::learn::learner::Learner::arrays)) and where photons start (see [`emission::arrays`]), afterwards the
//! field as in a guide file; of a final pass that goes by blocks (see [`Block`]) their `sum`, or for a part of a render `block0` and so on, and
//! their `cascade` where fireflies are taken out (see [`Cascade::arrays`]); `half0`, `half1`, `done0`, `done1` of a render to a target error; and
//!
//! | name | type | |
//! |---|---|---|
//! | `made_for` | u8 | settings that the picture depends on, a line of text each, see [`made_for`] |
//! | `state` | f64 | numbers in the order of [`Moment::state_numbers`] |
//! | `variances` | f64 | of one sample in each iteration |
//! | `totals` | f64 | of the statistics, in the order of [`Statistics::numbers`] |
//! | `iterations`, `errors`, `dropped` | f64 | rows of the statistics |
//! | `decisions` | u8 | JSON |
//! | `densities` | f32 | [P] or [0]: how the rest of the final pass is divided among the pixels |
//! | `roulette` | f32 | [P] or [0]: pixel values that roulette goes by there |
//! | `learning` | f64 | see [`Learning::numbers`] |
//!
//! All numbers are stored in double precision, which holds each of them exactly.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::budget::{Tried, Verdict};
use super::learning::Learning;
use super::settings::RenderSettings;
use super::state::{Blocks, Division, Half, Part, Phase, Position, State, Trend};
use super::statistics::{Dropped, ErrorPoint, Iteration, Statistics};
use crate::base::files::read_bytes;
use crate::base::tensors::{self, Arrays, Dtype, Tensor, Tensors, borrowed, doubles, vector};
use crate::base::{Error, Place, Result};
use crate::film::{BLOCK, Block, Cascade, FinishedPass, Pass, Sum};
use crate::guiding::learn::emission;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::guiding::sample::file;
use crate::sampling::discrete::Discrete;

/// The version of checkpoints that this program reads and writes. 15: without whether guiding was given up.
pub const VERSION: u32 = 15;

/// Largest accepted checkpoint in bytes, apart from pixels, and bytes that each pixel adds to that limit.
const LIMIT: u64 = 1 << 32;
const PIXEL_LIMIT: u64 = 1 << 12;
/// Most samples of a pixel.
pub(super) const MOST_SAMPLES: u32 = 1 << 26;
/// Most samples of a pixel over the mean of all; more than any division gives one.
const MOST_DENSITY: f32 = 1e3;
/// Most passes that a render can have made.
const MOST_PASSES: usize = 64;

/// Checkpoints of a render: where they are written and read, and which settings they belong to.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpointing {
    /// Settings that the picture depends on, a line of text each: only a checkpoint with the same text is accepted. See
    /// [`made_for`].
    pub made_for: String,
    /// Where checkpoints go, and the least time between two; more where writing one takes more than a twentieth of it.
    pub write: Option<(PathBuf, Duration)>,
    /// The checkpoint to go on from.
    pub resume: Option<PathBuf>,
}

/// What is traced and learned, as a number: raised with every change by which the same settings give other samples, in other words other
/// bits in a picture. Then checkpoints, parts and guides of before are those of another program, and do not go together with those of
/// this one.
pub const ALGORITHM: u32 = 13;

/// Settings that a picture depends on, as text: `scene` and `guide` stand for the contents of files; the stop rule is that asked
/// for, before the time for loading is subtracted.
pub fn made_for(settings: &RenderSettings, size: [u32; 2], scene: &str, guide: &str) -> String {
    let program = env!("CARGO_PKG_VERSION");
    format!("program: {program}, algorithm {ALGORITHM}\nscene: {scene}\nguide: {guide}\nsize: {size:?}\n{settings:#?}")
}

/// State of a render between two chunks, as a checkpoint holds it.
pub(super) struct Moment<'a> {
    pub state: &'a State,
    pub pass: &'a Pass,
    pub spp: u32,
    pub start: u64,
    pub statistics: &'a Statistics,
    pub learning: Option<&'a Learning>,
    pub field: Option<(&'a GuideField, &'a Evidence)>,
    /// Seconds of rendering so far.
    pub elapsed: f64,
    pub errors: &'a [ErrorPoint],
}

/// A render read from a checkpoint.
pub(super) struct Resumed {
    pub state: State,
    pub part: Part,
    pub statistics: Statistics,
    pub learning: Option<Learning>,
    pub field: Option<(GuideField, Evidence)>,
    pub elapsed: f64,
    pub errors: Vec<ErrorPoint>,
}

impl Moment<'_> {
    /// Writes the checkpoint atomically.
    ///
    /// # Errors
    /// [`Error::Io`] naming `path`.
    pub fn write(&self, path: &Path, made_for: &str) -> Result<()> {
        tensors::write(path, VERSION, &self.arrays(made_for))
    }

    fn arrays<'b>(&'b self, made_for: &'b str) -> Vec<Tensor<'b>> {
        let state = self.state;
        let numbers = |name: &'static str, numbers: &[f64]| {
            vector(name, Dtype::F64, numbers.iter().map(|x| x.to_le_bytes()).collect::<Vec<_>>().into_iter())
        };
        let decisions = serde_json::to_vec(&self.statistics.decisions).unwrap_or_default();
        let mut all = vec![
            ("made_for".into(), Dtype::U8, vec![made_for.len()], made_for.as_bytes().into()),
            ("decisions".into(), Dtype::U8, vec![decisions.len()], decisions.into()),
            numbers("state", &self.state_numbers()),
            numbers("variances", &state.trend.variances),
            numbers("totals", &self.statistics.numbers()),
            doubles("iterations", self.statistics.iterations.iter().map(Iteration::numbers)),
            doubles("errors", self.errors.iter().map(ErrorPoint::numbers)),
            doubles("dropped", self.statistics.dropped.first.iter().map(Dropped::numbers)),
        ];
        let division = |of: fn(&Division) -> &[f32]| state.division.as_ref().map_or(&[][..], of);
        all.push(borrowed::<_, 4>("densities", (Dtype::F32, 1), division(|division| &division.densities)));
        all.push(borrowed::<_, 4>("roulette", (Dtype::F32, 1), division(|division| &division.values)));
        all.extend(self.pass.arrays("now"));
        let finished = |kind: &'static str, passes: &'b [FinishedPass]| {
            passes.iter().enumerate().flat_map(move |(i, pass)| pass.arrays(&format!("{kind}{i}")))
        };
        all.extend(finished("pass", &state.passes));
        all.extend(finished("early", &state.early));
        match &state.blocks {
            Some(Blocks::Summed(sum)) => all.extend(sum.arrays("sum")),
            Some(Blocks::Kept(blocks)) => {
                all.extend(blocks.iter().enumerate().flat_map(|(i, block)| block.arrays(&format!("block{i}"))));
            }
            None => {}
        }
        all.extend(state.cascade.iter().flat_map(|cascade| cascade.arrays(CASCADE)));
        for (i, half) in state.halves.iter().enumerate() {
            all.extend(half.done.iter().flat_map(|pass| pass.arrays(&format!("done{i}"))));
            if i != state.position.half {
                all.extend(half.pass.arrays(&format!("half{i}")));
            }
        }
        if let Some(learning) = self.learning {
            all.push(numbers("learning", &learning.numbers()));
            all.extend(learning.learner.arrays());
            all.extend(emission::arrays(&learning.emission, &learning.emission_learner));
        } else if let Some((field, evidence)) = self.field {
            all.extend(file::arrays(field, evidence));
        }
        all
    }

    fn state_numbers(&self) -> [f64; STATE] {
        let State {
            passes,
            early,
            spent,
            rendered,
            sequences_from,
            trend,
            position,
            halves,
            division,
            blocks,
            cascade: _,
        } = self.state;
        let blocks = blocks.as_ref().map_or(-1.0, |blocks| match blocks {
            Blocks::Summed(_) => 0.0,
            Blocks::Kept(blocks) => blocks.len() as f64,
        });
        let Trend { seconds, making, camera_part, verdict, doubted, tried, relative, guided_cost, caustics, .. } =
            *trend;
        let flag = |flag: bool| f64::from(u8::from(flag));
        let phase = Phase::ALL.iter().position(|phase| *phase == position.phase).unwrap_or(0);
        let done = |i: usize| flag(halves.get(i).is_some_and(|half| half.done.is_some()));
        let kind = if self.learning.is_some() { 1.0 } else { flag(self.field.is_some()) * 2.0 };
        [
            passes.len() as f64,
            early.len() as f64,
            *spent,
            f64::from(*rendered),
            sequences_from.map_or(-1.0, f64::from),
            seconds,
            camera_part,
            verdict.number(),
            relative,
            phase as f64,
            f64::from(position.iteration),
            position.voxels as f64,
            position.began,
            position.traced,
            f64::from(position.batches),
            f64::from(position.each),
            position.half as f64,
            halves.len() as f64,
            done(0),
            done(1),
            kind,
            f64::from(self.spp),
            self.start as f64,
            self.elapsed,
            guided_cost,
            flag(caustics),
            division.as_ref().map_or(0.0, |division| f64::from(division.even)),
            making,
            blocks,
            doubted.unwrap_or(f64::NAN),
            tried.number(),
        ]
    }
}

/// Name of the samples by brightness of finished blocks.
const CASCADE: &str = "cascade";
/// Length of the array `state`.
const STATE: usize = 31;

/// A number as a count. Conversion saturates, and NaN is 0.
fn count(number: f64) -> u32 {
    number as u32
}

impl Resumed {
    /// Reads the checkpoint at `path` for a render of `size` pixels with these settings, in a scene whose lights have the powers
    /// `emitted`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Unsupported`] for another version, [`Error::Options`] for the checkpoint of another
    /// render, saying what differs, [`Error::Malformed`] for everything else.
    pub fn read(
        path: &Path,
        made_for: &str,
        settings: &RenderSettings,
        size: [u32; 2],
        emitted: &Discrete,
    ) -> Result<Self> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let bytes = read_bytes(path, LIMIT.saturating_add(pixels.saturating_mul(PIXEL_LIMIT)))?;
        let file = Tensors::open(path, &bytes, "checkpoint", VERSION)?;
        check_same(path, &text(&file, "made_for")?, made_for)?;
        let size = size.map(|n| n as usize);
        let numbers = file.read("state", Dtype::F64, Some(STATE), 1, f64::from_le_bytes)?;
        let mut state = read_state(&file, &numbers, size)?;
        let [.., kind, spp, start, elapsed, guided_cost, caustics, even, making, blocks, doubted, tried] = numbers[..]
        else {
            return file.fail("state", "numbers are missing");
        };
        if !(guided_cost > 0.0 && guided_cost.is_finite()) {
            return file.fail("state", format!("a guided sample that costs {guided_cost} times another"));
        }
        (state.trend.guided_cost, state.trend.caustics, state.trend.making) = (guided_cost, caustics == 1.0, making);
        state.trend.doubted = Some(doubted).filter(|gain| *gain >= 0.0);
        state.trend.tried = Tried::from_number(tried);
        state.division = read_division(&file, [even, spp], &state.position, size)?;
        state.blocks = read_blocks(&file, blocks, settings, &state.position, size)?;
        if state.blocks.is_some() && settings.fireflies.kappa().is_some() {
            state.cascade = Some(Cascade::read(&file, CASCADE, size[0] * size[1])?);
        }
        let part = Part { pass: Pass::from_arrays(size, &file, "now")?, spp: count(spp), start: start as u64 };
        // Iterations that visit some of the pixels, and shares of learning, are samples beyond those of the budget.
        let before = state.rendered.checked_sub(part.spp).filter(|_| state.rendered <= MOST_SAMPLES);
        let follows = before.is_some_and(|before| state.sequences_from.is_none_or(|from| from <= before));
        // Uneven samples are as many on the whole.
        let at_most = u64::from(part.spp) + u64::from(state.division.is_some());
        if !follows || part.start == 0 || part.start > pixels * at_most {
            return file.fail("state", format!("sample {} of {} per pixel", part.start, part.spp));
        }
        let learns = matches!(state.position.phase, Phase::Learning | Phase::Share);
        let learning = if kind == 1.0 { Some(Learning::from_arrays(settings, emitted, &file)?) } else { None };
        let field = if kind == 2.0 { Some(file::from_arrays(&file)?) } else { None };
        if learns != learning.is_some() {
            return file.fail("state", "what was learned does not belong to this part of a render");
        }
        Ok(Self {
            statistics: read_statistics(&file)?,
            errors: rows(&file, "errors")?.iter().map(ErrorPoint::from_numbers).collect(),
            elapsed: if elapsed.is_finite() { elapsed.max(0.0) } else { 0.0 },
            state,
            part,
            learning,
            field,
        })
    }
}

/// Refuses a checkpoint of another render and names the first setting that differs.
fn check_same(path: &Path, found: &str, wanted: &str) -> Result<()> {
    if found == wanted {
        return Ok(());
    }
    let (found, wanted) = difference(found, wanted);
    Err(Error::Options(format!(
        "{}: the checkpoint is of another render: it was made with \"{found}\", this one has \"{wanted}\"; give the same scene and \
         options, or do without it (remove it, or leave --resume out)",
        path.display(),
    )))
}

/// The first line in which two texts of [`made_for`] differ.
pub(super) fn difference(found: &str, wanted: &str) -> (String, String) {
    let mut pairs = found.lines().zip(wanted.lines());
    let (found, wanted) = pairs.find(|(a, b)| a != b).unwrap_or(("other settings", "others"));
    let tidy = |line: &str| line.trim().trim_end_matches(',').to_owned();
    (tidy(found), tidy(wanted))
}

fn text(file: &Tensors, name: &str) -> Result<String> {
    let bytes = file.read(name, Dtype::U8, None, 1, |[b]| b)?;
    String::from_utf8(bytes).or_else(|_| file.fail(name, "this is not text"))
}

fn rows<const N: usize>(file: &Tensors, name: &str) -> Result<Vec<[f64; N]>> {
    Ok(file.read(name, Dtype::F64, None, N, f64::from_le_bytes)?.as_chunks::<N>().0.to_vec())
}

fn read_state(file: &Tensors, numbers: &[f64], size: [usize; 2]) -> Result<State> {
    let &[passes, early, spent, rendered, sequences, seconds, camera_part, verdict, relative, ref position @ ..] =
        numbers
    else {
        return file.fail("state", "numbers are missing");
    };
    let &[phase, iteration, voxels, began, traced, batches, each, half, halves, first, second, ..] = position else {
        return file.fail("state", "numbers are missing");
    };
    let done = [first, second];
    let Some(&phase) = Phase::ALL.get(phase as usize) else { return file.fail("state", "an unknown part of a render") };
    let position = Position {
        phase,
        iteration: count(iteration).min(31),
        voxels: voxels as usize,
        began,
        traced,
        batches: count(batches),
        each: count(each),
        half: usize::from(half == 1.0),
    };
    let finished = |kind: &str, number: f64| -> Result<Vec<FinishedPass>> {
        if number > MOST_PASSES as f64 {
            return file.fail("state", format!("{number} passes"));
        }
        (0..count(number)).map(|i| FinishedPass::from_arrays(size, file, &format!("{kind}{i}"))).collect()
    };
    let read_half = |i: usize| -> Result<Half> {
        let done =
            if done[i] == 1.0 { Some(FinishedPass::from_arrays(size, file, &format!("done{i}"))?) } else { None };
        let traced = i == position.half;
        let pass = if traced { Pass::new(0, 0) } else { Pass::from_arrays(size, file, &format!("half{i}"))? };
        Ok(Half { pass, done })
    };
    let both = phase == Phase::Target;
    if both != (halves == 2.0) || !(spent >= 0.0 && spent.is_finite() && rendered >= 0.0) {
        return file.fail("state", "numbers that no render has");
    }
    let trend = Trend {
        variances: file.read("variances", Dtype::F64, None, 1, f64::from_le_bytes)?,
        seconds,
        camera_part,
        verdict: Verdict::from_number(verdict),
        relative,
        ..Trend::default()
    };
    let rendered = count(rendered);
    // Batches count as rendered when they begin.
    if position.batches > rendered {
        return file.fail("state", format!("batches of {} of {rendered} samples per pixel", position.batches));
    }
    Ok(State {
        passes: finished("pass", passes)?,
        early: finished("early", early)?,
        spent,
        rendered,
        sequences_from: (sequences >= 0.0).then(|| count(sequences).min(rendered)),
        trend,
        position,
        division: None,
        blocks: None,
        cascade: None,
        halves: if both { vec![read_half(0)?, read_half(1)?] } else { Vec::new() },
    })
}

/// The division of samples among pixels after `even` samples per pixel, by which `spp` are being taken; none where it is even.
fn read_division(
    file: &Tensors,
    [even, spp]: [f64; 2],
    position: &Position,
    [width, height]: [usize; 2],
) -> Result<Option<Division>> {
    let densities = file.read("densities", Dtype::F32, None, 1, f32::from_le_bytes)?;
    if densities.is_empty() {
        return Ok(None);
    }
    let even = count(even);
    let known =
        densities.len() == width * height && densities.iter().all(|density| (0.0..=MOST_DENSITY).contains(density));
    let follows = even > 0 && position.phase == Phase::Final && even.saturating_add(count(spp)) <= position.batches;
    if !known || !follows {
        return file.fail("densities", "a division of samples that no render has");
    }
    let values = file.read("roulette", Dtype::F32, None, 1, f32::from_le_bytes)?;
    let known = values.is_empty() || values.len() == width * height && values.iter().all(|value| *value > 0.0);
    if !known {
        return file.fail("roulette", "pixel values that no render has");
    }
    Ok(Some(Division { densities, values, even }))
}

/// The blocks of a final pass: none for a `number` below 0, else their sum, or of a part so many of them.
fn read_blocks(
    file: &Tensors,
    number: f64,
    settings: &RenderSettings,
    position: &Position,
    [width, height]: [usize; 2],
) -> Result<Option<Blocks>> {
    let (pixels, detailed) = (width * height, settings.keeps_spread);
    if position.phase != Phase::Final || number.is_nan() || number < 0.0 {
        return Ok(None);
    }
    if settings.part.is_none() {
        return Sum::read(file, "sum", pixels, detailed).map(|sum| Some(Blocks::Summed(sum)));
    }
    if number > f64::from(position.batches.div_ceil(BLOCK)) {
        return file.fail("state", format!("{number} blocks of {} samples", position.batches));
    }
    let blocks = (0..count(number)).map(|i| Block::read(file, &format!("block{i}"), pixels, detailed));
    Ok(Some(Blocks::Kept(blocks.collect::<Result<_>>()?)))
}

fn read_statistics(file: &Tensors) -> Result<Statistics> {
    let totals = file.read("totals", Dtype::F64, None, 1, f64::from_le_bytes)?;
    let Some(mut statistics) = Statistics::from_numbers(&totals) else {
        return file.fail("totals", format!("{} numbers", totals.len()));
    };
    statistics.iterations = rows(file, "iterations")?.iter().map(Iteration::from_numbers).collect();
    statistics.dropped.first = rows(file, "dropped")?.iter().filter_map(Dropped::from_numbers).collect();
    let decisions = text(file, "decisions")?;
    statistics.decisions = serde_json::from_str(&decisions)
        .map_err(|e| Error::malformed(Place::part(file.path(), "decisions"), e.to_string()))?;
    Ok(statistics)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of others no render could go on: they would be counted on beyond the largest number.
    #[test]
    fn batches_are_among_the_samples() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        tensors::write(&path, VERSION, &[vector("variances", Dtype::F64, std::iter::empty::<[u8; 8]>())]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let file = Tensors::open(&path, &bytes, "checkpoint", VERSION).unwrap();
        let batches = |rendered: u32, batches: u32| {
            let mut numbers = [0.0; STATE];
            let phase = Phase::ALL.iter().position(|phase| *phase == Phase::Final).unwrap();
            [numbers[3], numbers[9], numbers[14]] = [f64::from(rendered), phase as f64, f64::from(batches)];
            read_state(&file, &numbers, [1, 1]).map(|state| state.position.batches)
        };
        assert_eq!(batches(16, 16).unwrap(), 16);
        assert!(batches(15, 16).is_err() && batches(1 << 26, u32::MAX).is_err());
    }
}
