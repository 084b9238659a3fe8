//! What one of several processes has learned, and how that of all becomes a guide.
//!
//! A safetensors file (see [`crate::base::tensors`]) with the state of a learner (see [`Learner::arrays`]), of which all parts have the
//! same but for the samples of the last iteration, and
//!
//! | name | type | |
//! |---|---|---|
//! | `learned` | u8 | JSON, see [`LearnedHead`] |
//! | `pixel_values` | f32 | as in a guide file; missing where no light was found |
//!
//! What holds: voxels that all parts had before the last iteration get the sums of all their samples: counts, leaf by leaf, the moments that
//! judge guides, and the outliers among them. Trees and spheres have the shapes that the first chunk of the iteration gave them in all
//! parts. So the sums are those that one learner would have of all samples, up to rounding, but for places that no pass before has found:
//! those that the first part found are kept with its samples alone.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::checkpoint::difference;
use super::part::PartOf;
use super::settings::Reconstruction;
use super::statistics::Statistics;
use crate::base::files::read_bytes;
use crate::base::streamed::Streamed;
use crate::base::tensors::{Arrays, Dtype, Tensors, vector};
use crate::base::{Error, Place, Result, Unfit, named};
use crate::guiding::learn::learner::{Learner, LearnerSettings, Use};
use crate::guiding::sample::field::{Evidence, GuideField, PixelValues};
use crate::guiding::sample::file::{self, GUIDE_LIMIT, PART_HEAD, PART_VERSION, pixel_value_arrays, read_pixel_values};
use crate::network::config::Mode;
use crate::reconstruct::{Reconstructor, reconstruct_within};

/// Largest ceiling of a field in bytes: that of the command line.
const MOST_MEMORY: usize = 65536 * 1_000_000;
/// Largest accepted head in bytes.
const HEAD_LIMIT: u64 = 1 << 20;

/// What a part has learned.
pub struct PartLearned {
    /// The learner.
    pub learner: Learner,
    /// Voxels that all parts have in common, the first of the learner's.
    pub voxels: usize,
    /// Values that pixels are expected to have; none while no light was found.
    pub pixel_values: Option<Vec<f32>>,
    /// What reconstruction may cost, in rays.
    pub rays: f64,
    /// Statistics of time and samples spent.
    pub statistics: Statistics,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether the stop flag ended it early.
    pub interrupted: bool,
}

/// Which part of which learning a file holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedHead {
    /// Which part of how many.
    pub part: PartOf,
    /// What all parts must have in common, a line of text each.
    pub in_common: String,
    /// Voxels that all parts have in common.
    pub voxels: usize,
    /// What reconstruction may cost, in rays.
    pub rays: f64,
    /// Settings of the learner.
    pub settings: LearnerSettings,
    /// What is made of the trees as counted.
    pub reconstruction: Reconstruction,
    /// Mode that the trees were collected in.
    pub mode: Mode,
}

/// Writes what a part has learned, atomically.
///
/// # Errors
/// [`Error::Io`] naming `path`; [`Error::Options`] for a head that JSON cannot express; [`Error::Limit`] for more than can be read again.
pub fn write(path: &Path, head: &LearnedHead, learner: &Learner, values: Option<&PixelValues>) -> Result<()> {
    let text = serde_json::to_vec(head).map_err(|e| Error::Options(format!("{}: {e}", path.display())))?;
    let mut all = learner.arrays();
    all.push(vector(PART_HEAD, Dtype::U8, text.into_iter().map(|byte| [byte])));
    all.extend(values.iter().flat_map(|values| pixel_value_arrays(values)));
    file::write(path, PART_VERSION, &all)
}

/// A part that was read.
struct Read {
    path: PathBuf,
    head: LearnedHead,
    learner: Learner,
    values: Option<PixelValues>,
}

/// The head that a file's arrays have.
fn head(file: &impl Arrays) -> Result<LearnedHead> {
    let text = file.read(PART_HEAD, Dtype::U8, None, 1, |[byte]| byte)?;
    let fail = |message: String| Error::malformed(Place::part(file.path(), PART_HEAD), message);
    let head: LearnedHead = serde_json::from_slice(&text).map_err(|e| fail(e.to_string()))?;
    if head.settings.memory > MOST_MEMORY || head.rays.is_nan() || head.rays < 0.0 {
        return Err(fail("settings that no part has".into()));
    }
    Ok(head)
}

/// Reads the head alone, which is held against the file's checksum where the whole is read.
fn read_head(path: &Path) -> Result<LearnedHead> {
    let file = Streamed::open(path)?;
    file.check_version("part of a guide", PART_VERSION)?;
    let (bytes, limit) = (file.bytes(PART_HEAD) as u64, HEAD_LIMIT);
    if bytes > limit {
        let (place, what) = (Place::part(path, PART_HEAD), "size in bytes".into());
        return Err(Error::Limit { place, what, value: bytes, limit });
    }
    head(&file.reader()?.rows(None))
}

fn read(path: &Path) -> Result<Read> {
    let bytes = read_bytes(path, GUIDE_LIMIT)?;
    let file = Tensors::open(path, &bytes, "part of a guide", PART_VERSION)?;
    let head = head(&file)?;
    let learner = Learner::from_arrays(head.settings.clone(), &file)?;
    if head.voxels > learner.voxels() {
        let message = format!("{} of {} voxels", head.voxels, learner.voxels());
        return Err(Error::malformed(Place::part(path, PART_HEAD), message));
    }
    Ok(Read { path: path.to_owned(), head, learner, values: read_pixel_values(&file)? })
}

/// Whether the file at `path` is this part, whole and of this learning.
pub fn is_done(path: &Path, part: PartOf, in_common: &str) -> bool {
    let same = read_head(path).is_ok_and(|head| head.part == part && head.in_common == in_common);
    same && read(path).is_ok()
}

/// Adds up what the parts at `paths` have learned, whatever their order; `reconstructor` makes what the parts were to make of their
/// trees.
///
/// # Errors
/// [`Error::Parts`] where parts are missing, double or of another learning, naming them; those of reading and of `reconstructor`.
pub fn merge_guides<'n>(
    paths: &[PathBuf],
    reconstructor: impl FnOnce(Reconstruction, &Mode) -> Result<Box<dyn Reconstructor + 'n>>,
) -> Result<(GuideField, Evidence)> {
    let Some((first, others)) = in_order(paths)?.split_first().map(|(first, others)| (first.clone(), others.to_vec()))
    else {
        return Err(Error::Options("give the parts of a guide".into()));
    };
    let Read { head, mut learner, values, path: first } = read(&first)?;
    let mut rays = head.rays;
    for path in &others {
        let other = read(path)?;
        if other.head.voxels != head.voxels || !learner.add(&other.learner, head.voxels) {
            let files = vec![path.clone(), first];
            let message = format!("{}: has other voxels or trees than {}", files[0].display(), files[1].display());
            return Err(Error::Parts { fault: Unfit::Foreign, files, message });
        }
        rays += other.head.rays;
    }
    let reconstructor = reconstructor(head.reconstruction, &head.mode)?;
    learner
        .fit(&mut |trees| reconstruct_within(rays, trees, reconstructor.as_ref()).map(|(proposals, _)| proposals))?;
    let evidence = learner.evidence();
    Ok((learner.field(Use::Rendering).with_pixel_values(values), evidence))
}

/// The parts in their order, held against one another by their heads.
fn in_order(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut heads: Vec<(PathBuf, LearnedHead)> = Vec::new();
    for path in paths {
        let (path, head) = (path.clone(), read_head(path)?);
        if let Some((first, wanted)) = heads.first() {
            let same = (head.part.count(), &head.in_common, &head.settings, head.reconstruction, &head.mode)
                == (wanted.part.count(), &wanted.in_common, &wanted.settings, wanted.reconstruction, &wanted.mode);
            if !same {
                let (found, wanted) = difference(&head.in_common, &wanted.in_common);
                let message = format!(
                    "{} learned something else than {}: it has \"{found}\", the other \"{wanted}\"",
                    path.display(),
                    first.display()
                );
                return Err(Error::Parts { fault: Unfit::Foreign, files: vec![path, first.clone()], message });
            }
        }
        if let Some((other, _)) = heads.iter().find(|(_, other)| other.part == head.part) {
            let message = format!("{} and {} are both part {}", other.display(), path.display(), head.part);
            return Err(Error::Parts { fault: Unfit::Double, files: vec![other.clone(), path], message });
        }
        heads.push((path, head));
    }
    heads.sort_by_key(|(_, head)| head.part);
    let count = heads.first().map_or(0, |(_, head)| head.part.count());
    let absent = PartOf::absent(count, heads.iter().map(|(_, head)| head.part.index()));
    if !absent.is_empty() {
        let message = format!("parts are missing: {}", named(absent));
        return Err(Error::Parts { fault: Unfit::Missing, files: Vec::new(), message });
    }
    Ok(heads.into_iter().map(|(path, _)| path).collect())
}
