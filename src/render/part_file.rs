//! Part files: what one process has rendered of a picture, for [`merge`](super::merge()).
//!
//! A safetensors file (see [`crate::base::tensors`]), written once the part is complete. It holds the part's blocks of samples in their
//! order, named `block0` and so on (see [`Block`]), of which each can be read by itself, and rows of each too; or, of the first parts of a
//! picture that were merged, their `sum` (see [`Sum`]), to which the parts after them can be added with the bits of all at once; and
//!
//! | name | type | |
//! |---|---|---|
//! | `part` | u8 | JSON, see [`PartHead`] |
//! | `layer0` and so on | f32 | channels of features and mattes, in the first part of a picture or window alone |
//! | `cascade` | | samples by brightness, where fireflies are taken out, see [`Cascade::arrays`] |

use std::collections::BTreeSet;
use std::ops::{Range, RangeInclusive};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::part::PartOf;
use super::settings::Fireflies;
use super::statistics::Statistics;
use crate::base::streamed::{Checked, Reader, Streamed};
use crate::base::tensors::{self, Arrays, Dtype, Tensor, borrowed};
use crate::base::{Error, Place, Result, Unfit};
use crate::film::{BLOCK, Block, Cascade, Sum, check_size};
use crate::integrators::path::Cause;
use crate::picture::{Attribute, Channel, Window, is_name};

/// The version of part files that this program reads and writes. 2: parts that were merged.
pub const VERSION: u32 = 2;
/// Name of the sum of parts that were merged.
const SUM: &str = "sum";
/// Name of the samples by brightness.
const CASCADE: &str = "cascade";
/// Name of the array that tells what the file is.
pub const HEAD: &str = "part";
/// Largest accepted head in bytes: mostly the names of what mattes show.
const HEAD_LIMIT: usize = 64 << 20;
/// Characters of a name that an error tells.
const LONGEST_TOLD: usize = 40;
/// Most layers of a part.
const MOST_LAYERS: usize = 256;

/// What a part is, and of which picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartHead {
    /// Which part of how many; the first of those that were merged.
    pub part: PartOf,
    /// Number of parts, from the first on, whose sum this is; 0 for a part as it was rendered.
    pub merged: u32,
    /// What all parts of the picture must have in common: contents of the scene and the guide, settings, version of the program; a line
    /// of text each.
    pub in_common: String,
    /// Columns and rows of the whole picture.
    pub size: [u32; 2],
    /// The part of it that was rendered: columns to the left, rows above, columns, rows.
    pub window: [u32; 4],
    /// Samples per pixel of all parts together, and those spent before the picture.
    pub samples: u32,
    /// Samples per pixel that the picture was asked for.
    pub spp: u32,
    /// Whether blocks have what variances are made of.
    pub detailed: bool,
    /// Whether there is a layer of sample counts, and one of variances.
    pub film_layers: [bool; 2],
    /// κ by which fireflies are taken out of the picture; none where they are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fireflies: Option<f64>,
    /// Names of the channels that all parts together have beside those, in the order of the picture's.
    pub channels: Vec<String>,
    /// Attributes of the picture that are known beforehand.
    pub attributes: Vec<Attribute>,
    /// Attributes of the layers, where the file has them.
    pub layer_attributes: Vec<Attribute>,
    /// Where samples and time went.
    pub totals: Totals,
}

/// Sums over the parts of a picture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Totals {
    /// Dropped camera samples.
    pub dropped_samples: u64,
    /// Those whose cause is known, by cause in the order of [`Cause::ALL`].
    pub dropped: Vec<u64>,
    /// Meshes and pictures of the scene that were not found.
    pub missing_files: usize,
    /// Wall time of rendering.
    pub seconds: f64,
    /// Threads.
    pub threads: usize,
}

impl Totals {
    /// Those of one process.
    pub fn of(statistics: &Statistics) -> Self {
        Self {
            dropped_samples: statistics.dropped_samples,
            dropped: statistics.dropped.causes.to_vec(),
            missing_files: statistics.missing_files.len(),
            seconds: statistics.seconds.total,
            threads: statistics.threads,
        }
    }

    /// Adds those of another process.
    pub fn add(&mut self, other: &Self) {
        self.dropped_samples = self.dropped_samples.saturating_add(other.dropped_samples);
        self.dropped.resize(Cause::ALL.len(), 0);
        self.dropped.iter_mut().zip(&other.dropped).for_each(|(sum, more)| *sum = sum.saturating_add(*more));
        // The same scene lacks the same files.
        self.missing_files = self.missing_files.max(other.missing_files);
        self.seconds += other.seconds;
        self.threads = self.threads.max(other.threads);
    }
}

impl PartHead {
    /// The part of the picture that was rendered.
    pub fn window(&self) -> Window {
        let [x, y, width, height] = self.window;
        Window { x, y, width, height }
    }

    /// Numbers of the parts that it holds.
    pub fn parts(&self) -> RangeInclusive<u32> {
        let first = self.part.index();
        first..=first.saturating_add(self.merged.saturating_sub(1))
    }

    /// Its number of blocks, which were not added up yet.
    fn blocks(&self) -> Result<u32> {
        let own = self.part.samples(self.samples)?;
        if self.merged > 0 {
            let first = self.part.index() == 1 && *self.parts().end() <= self.part.count();
            return first.then_some(0).ok_or_else(|| Error::Options("a sum of parts that are not the first".into()));
        }
        Ok(own.len().div_ceil(BLOCK as usize) as u32)
    }
}

/// A name of a channel or an attribute that no picture can have, or that two have.
fn bad_name(head: &PartHead) -> Option<String> {
    let attributes = head.attributes.iter().chain(&head.layer_attributes).map(|(name, _)| name);
    let mut taken: BTreeSet<&str> = ["R", "G", "B", "fireflies.R", "fireflies.G", "fireflies.B"].into();
    let bad_channel = head.channels.iter().find(|name| !is_name(name) || !name.is_ascii() || !taken.insert(name));
    let bad = bad_channel.or_else(|| attributes.into_iter().find(|name| !is_name(name)));
    bad.map(|name| name.chars().take(LONGEST_TOLD).collect())
}

/// Name of a block.
fn block_name(number: u32) -> String {
    format!("block{number}")
}

/// Writes a part atomically: its `blocks` in their order, the samples by brightness where the head tells of fireflies, and its `layers`.
///
/// # Errors
/// [`Error::Io`] naming `path`; [`Error::Options`] for a head that JSON cannot express.
pub fn write(
    path: &Path,
    head: &PartHead,
    blocks: &[Block],
    cascade: Option<&Cascade>,
    layers: &[Channel],
) -> Result<()> {
    let blocks = (0..).zip(blocks).flat_map(|(number, block)| block.arrays(&block_name(number)));
    write_arrays(path, head, blocks.chain(cascade_arrays(cascade)).collect(), layers)
}

/// The arrays of samples by brightness, where there are any.
fn cascade_arrays<'a>(cascade: Option<&Cascade>) -> Vec<Tensor<'a>> {
    cascade.map_or(Vec::new(), |cascade| cascade.arrays(CASCADE))
}

/// Writes the `sum` of the first parts of a picture, their samples by brightness, and its `layers`, atomically.
///
/// # Errors
/// As [`write`].
pub fn write_sum(path: &Path, head: &PartHead, sum: &Sum, cascade: Option<&Cascade>, layers: &[Channel]) -> Result<()> {
    write_arrays(path, head, [sum.arrays(SUM), cascade_arrays(cascade)].concat(), layers)
}

fn write_arrays<'a>(path: &Path, head: &PartHead, mut all: Vec<Tensor<'a>>, layers: &'a [Channel]) -> Result<()> {
    let text = serde_json::to_vec(head).map_err(|e| Error::Options(format!("{}: {e}", path.display())))?;
    all.push((HEAD.into(), Dtype::U8, vec![text.len()], text.into()));
    for (number, layer) in layers.iter().enumerate() {
        all.push(borrowed::<_, 4>(format!("layer{number}"), (Dtype::F32, 1), &layer.values));
    }
    tensors::write(path, VERSION, &all)
}

/// A part file whose head was read and held against its arrays.
pub struct PartFile {
    /// The head.
    pub head: PartHead,
    blocks: u32,
    file: Streamed,
    checked: Vec<Checked>,
}

/// A part file that is open, for any number of threads.
pub struct PartReader<'a> {
    part: &'a PartFile,
    reader: Reader<'a>,
}

impl PartFile {
    /// Opens a part file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Malformed`], [`Error::Unsupported`], [`Error::Limit`], naming file and place; [`Error::Parts`] for the
    /// checkpoint of a part that is not finished.
    pub fn open(path: &Path) -> Result<Self> {
        let file = Streamed::open(path)?;
        if file.has("made_for") && file.has("state") {
            let message = format!(
                "{}: this is a checkpoint of a part that is not finished; the command that began it goes on from there",
                path.display()
            );
            return Err(Error::Parts { fault: Unfit::Unfinished, files: vec![path.to_owned()], message });
        }
        if !file.has(HEAD) {
            return Err(Error::malformed(Place::file(path), "this is no part of a picture"));
        }
        file.check_version("part", VERSION)?;
        if file.bytes(HEAD) > HEAD_LIMIT {
            let (place, what) = (Place::part(path, HEAD), "size in bytes".into());
            return Err(Error::Limit { place, what, value: file.bytes(HEAD) as u64, limit: HEAD_LIMIT as u64 });
        }
        let (text, checked) = {
            let reader = file.reader()?;
            let rows = reader.rows(None);
            (rows.read(HEAD, Dtype::U8, None, 1, |[byte]: [u8; 1]| byte)?, rows.checked())
        };
        let fail = |message: String| Error::malformed(Place::part(path, HEAD), message);
        let head: PartHead = serde_json::from_slice(&text).map_err(|e| fail(e.to_string()))?;
        let sound = || -> Result<u32> {
            check_size(head.size[0], head.size[1])?;
            head.window().check_inside(head.size)?;
            head.blocks()
        };
        let blocks = sound().map_err(|e| fail(e.to_string()))?;
        if head.channels.len() > MOST_LAYERS || head.detailed != head.film_layers.contains(&true) {
            return Err(fail(format!("{} layers, or others than the blocks are made for", head.channels.len())));
        }
        if head.fireflies.is_some_and(|kappa| !(Fireflies::RANGE[0]..=Fireflies::RANGE[1]).contains(&kappa)) {
            return Err(fail(format!("kappa of fireflies: {:?}", head.fireflies)));
        }
        if let Some(name) = bad_name(&head) {
            return Err(fail(format!("a channel or attribute of the name {name:?}")));
        }
        let pixels = head.window().pixels() as usize;
        (0..blocks).try_for_each(|number| Block::expect(&file, &block_name(number), pixels, head.detailed))?;
        if head.merged > 0 {
            Sum::expect(&file, SUM, pixels, head.detailed)?;
        }
        let part = Self { head, blocks, file, checked };
        (0..part.layers()).try_for_each(|number| part.file.expect(&format!("layer{number}"), Dtype::F32, pixels, 1))?;
        Ok(part)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Number of layers that this file has: the first part has those of all.
    pub fn layers(&self) -> usize {
        if self.head.part.index() == 1 { self.head.channels.len() } else { 0 }
    }

    /// Opens the file again, to read what it holds.
    ///
    /// # Errors
    /// [`Error::Io`] where it is gone.
    pub fn reader(&self) -> Result<PartReader<'_>> {
        Ok(PartReader { part: self, reader: self.file.reader()? })
    }

    /// Takes the checksums of what was read.
    pub fn read(&mut self, checked: Vec<Checked>) {
        self.checked.extend(checked);
    }

    /// Holds all that was read against the file's checksum.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is damaged, or was not read as a whole.
    pub fn check(&mut self) -> Result<()> {
        self.file.check(std::mem::take(&mut self.checked))
    }
}

impl PartReader<'_> {
    /// Adds these pixels of the part to the `sum` of those of the parts before; `block` is memory for one. Returns the checksums of what was
    /// read.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Malformed`].
    pub fn add(&self, pixels: Range<usize>, sum: &mut Sum, block: &mut Block) -> Result<Vec<Checked>> {
        let (count, detailed) = (pixels.len(), self.part.head.detailed);
        let rows = self.reader.rows(Some(pixels));
        if self.part.head.merged > 0 {
            *sum = Sum::read(&rows, SUM, count, detailed)?;
        }
        for number in 0..self.part.blocks {
            block.fill(&rows, &block_name(number), count, detailed)?;
            sum.add(block);
        }
        Ok(rows.checked())
    }

    /// All samples of the part by brightness, if it has them, and the checksums of what was read.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Malformed`].
    pub fn cascade(&self) -> Result<(Option<Cascade>, Vec<Checked>)> {
        let rows = self.reader.rows(None);
        let pixels = self.part.head.window().pixels() as usize;
        let cascade = self.part.head.fireflies.map(|_| Cascade::read(&rows, CASCADE, pixels)).transpose()?;
        Ok((cascade, rows.checked()))
    }

    /// These pixels of a layer, and the checksums of what was read.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Malformed`].
    pub fn layer(&self, number: usize, pixels: Range<usize>) -> Result<(Vec<f32>, Vec<Checked>)> {
        let (rows, mut values) = (self.reader.rows(Some(pixels)), Vec::new());
        rows.fill(&format!("layer{number}"), Dtype::F32, None, 1, &mut values)?;
        Ok((values, rows.checked()))
    }
}

/// Whether the file at `path` is a whole part with this head, whatever its totals and attributes.
pub fn is_done(path: &Path, head: &PartHead) -> bool {
    let same = |found: &PartHead| {
        (&found.in_common, found.part, found.merged, found.window, found.samples)
            == (&head.in_common, head.part, head.merged, head.window, head.samples)
    };
    let whole = || -> Result<bool> {
        let mut file = PartFile::open(path)?;
        if !same(&file.head) {
            return Ok(false);
        }
        let pixels = file.head.window().pixels() as usize;
        let reader = file.reader()?;
        let mut checked = reader.add(0..pixels, &mut Sum::new(pixels, file.head.detailed), &mut Block::default())?;
        checked.extend(reader.cascade()?.1);
        for number in 0..file.layers() {
            checked.extend(reader.layer(number, 0..pixels)?.1);
        }
        file.read(checked);
        file.check().map(|()| true)
    };
    whole().unwrap_or(false)
}
