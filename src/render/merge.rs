//! Putting the parts of a picture together.
//!
//! Blocks are added up in the order of the samples, whatever the order of the files, so that the picture has the bits that one process would
//! have given it. Of all parts only a stripe of pixels is in memory at a time, beside the picture and the sum of a band of it. The sum of the
//! first parts can be written as a part in their place: then most is merged while the rest is rendered.

mod layers;
mod sums;
mod windows;

pub use layers::MergedLayers;

use std::path::{Path, PathBuf};

use self::windows::{OfWindow, missing, target, within};
use super::aov::fireflies_channels;
use super::part::PartOf;
use super::part_file::{PartFile, PartHead, Totals, write_sum};
use crate::base::{Error, Progress, Result, Unfit, named};
use crate::film::{Sum, Summed, check_size, spread_of_sum, taken_from_sum, without};
use crate::integrators::path::Cause;
use crate::picture::cryptomatte;
use crate::picture::{Attribute, Channel, Image, Layers, Placed, Window};

/// A picture that was put together.
pub struct Merged {
    /// The picture.
    pub image: Image,
    /// Layers beside it, of which most are read while they are written.
    pub layers: MergedLayers,
    /// Text attributes for the file's header.
    pub attributes: Vec<Attribute>,
    /// Its place in the whole picture; none where it is that.
    pub placed: Placed,
    /// What is missing, in words; empty where nothing is.
    pub missing: Vec<String>,
}

/// Puts the part files at `paths` together, in whatever order they come. With `allow_missing` a picture is made of what is there.
///
/// # Errors
/// [`Error::Parts`] where parts are missing, double, unfinished or of another picture, naming them; [`Error::Malformed`] and others of
/// reading for a damaged one.
pub fn merge(paths: &[PathBuf], allow_missing: bool, progress: &dyn Progress) -> Result<Merged> {
    let (head, mut windows) = windows::open(paths)?;
    let target = target(&windows, head.size);
    let missing = missing(&windows, target);
    if !allow_missing {
        refuse(&missing, "; --allow-missing makes a picture of what is there")?;
    }
    check_size(target.width, target.height)?;
    let mut film = Summed::empty(target.pixels() as usize, head.detailed);
    sums::add_up(&mut windows, head.detailed, progress, |of, begin, sum| {
        film.place(&sum.finish(), |i| within(target, of.window.place((begin + i) as u64)));
    })?;
    let cascade = sums::by_brightness(&mut windows, target)?;
    check(&mut windows)?;
    let samples = film.samples() as f64 / target.pixels() as f64;
    let width = target.width as usize;
    let plain = film.image(width, 1);
    let judged = head.fireflies.zip(cascade);
    let fireflies = judged.map(|(kappa, cascade)| taken_from_sum(&film, &cascade, 1, &plain, kappa));
    let image = fireflies.as_ref().map(|taken| without(&plain, taken)).unwrap_or(plain);
    let spread = spread_of_sum(film, width)?;
    let spp = if missing.is_empty() { head.spp } else { samples as u32 };
    let totals = totals(&windows);
    let mut attributes = [head.attributes, results(&totals, spp), layer_attributes(&windows)].concat();
    if !missing.is_empty() {
        attributes.push(("missingParts".into(), named(&missing)));
    }
    let placed = (target != Window::whole(head.size)).then_some((target, head.size));
    let mut film = layers::film_channels(spread, head.film_layers);
    film.extend(fireflies.iter().flat_map(fireflies_channels));
    let layers = MergedLayers::new(film, head.channels, windows, target);
    Ok(Merged { image, layers, attributes, placed, missing })
}

/// Writes the sum of the first parts of a picture, or of one of its windows, to `output`: a part in their place, to which the parts after them
/// can be added later, with the bits of all at once.
///
/// # Errors
/// As [`merge`]; [`Error::Options`] for parts of several windows.
pub fn merge_first(paths: &[PathBuf], output: &Path, progress: &dyn Progress) -> Result<()> {
    let (head, mut windows) = windows::open(paths)?;
    let [of] = &mut windows[..] else {
        return Err(Error::Options("parts of several windows are merged to a picture, not to a part".into()));
    };
    let last = of.parts.last().map_or(0, |part| *part.head.parts().end());
    let held: Vec<u32> = of.parts.iter().flat_map(|part| part.head.parts()).collect();
    let count = head.part.count();
    let absent: Vec<String> =
        (1..=last).filter(|index| held.binary_search(index).is_err()).map(|index| format!("{index}/{count}")).collect();
    refuse(&absent, ": a part is merged of the first ones")?;
    let mut whole = Sum::new(0, head.detailed);
    sums::add_up(&mut windows, head.detailed, progress, |_, _, sum| whole.append(sum))?;
    let cascade = sums::by_brightness(&mut windows, head.window())?;
    check(&mut windows)?;
    let head = PartHead {
        part: PartOf::new(1, count)?,
        merged: last,
        layer_attributes: layer_attributes(&windows),
        totals: totals(&windows),
        ..head
    };
    let target = head.window();
    let layers = MergedLayers::new(Vec::new(), head.channels.clone(), windows, target);
    let all = 0..target.pixels() as usize;
    let channel = |(number, name)| Ok(Channel { name, values: layers.values(number, all.clone())?.into_owned() });
    let channels = layers.names().into_iter().enumerate().map(channel).collect::<Result<Vec<_>>>()?;
    write_sum(output, &head, &whole, cascade.as_ref(), &channels)
}

/// Refuses a picture of which something is missing.
fn refuse(missing: &[String], hint: &str) -> Result<()> {
    if missing.is_empty() {
        return Ok(());
    }
    let message = format!("parts are missing: {}{hint}", named(missing));
    Err(Error::Parts { fault: Unfit::Missing, files: Vec::new(), message })
}

/// Holds what was read, and the layers, which are read here, against the checksums of the files.
fn check(windows: &mut [OfWindow]) -> Result<()> {
    layers::check(windows)?;
    windows.iter_mut().flat_map(|window| &mut window.parts).try_for_each(PartFile::check)
}

fn totals(windows: &[OfWindow]) -> Totals {
    let mut totals = Totals::default();
    windows.iter().flat_map(|of| &of.parts).for_each(|part| totals.add(&part.head.totals));
    totals
}

/// Attributes that are known after rendering. `seconds` are those of all parts together.
pub fn results(totals: &Totals, spp: u32) -> Vec<Attribute> {
    let causes = totals.dropped.iter().zip(Cause::ALL).filter(|(count, _)| **count > 0);
    let causes: Vec<String> = causes.map(|(count, cause)| format!("{} {count}", cause.name())).collect();
    let missing = (totals.missing_files > 0).then(|| ("missingFiles", totals.missing_files.to_string()));
    [
        ("spp", spp.to_string()),
        ("droppedSamples", totals.dropped_samples.to_string()),
        ("droppedCauses", if causes.is_empty() { "none".into() } else { causes.join(", ") }),
        ("seconds", format!("{:.3}", totals.seconds)),
        ("threads", totals.threads.to_string()),
    ]
    .into_iter()
    .chain(missing)
    .map(|(key, value)| (key.to_owned(), value))
    .collect()
}

/// The attributes of all windows' layers: one picture shows what one of its windows shows.
fn layer_attributes(windows: &[OfWindow]) -> Vec<Attribute> {
    let mut all: Vec<Attribute> = Vec::new();
    let attributes = windows.iter().flat_map(|of| &of.parts).flat_map(|part| &part.head.layer_attributes);
    for (name, value) in attributes {
        match all.iter_mut().find(|(known, _)| known == name) {
            Some((_, known)) if known != value => *known = cryptomatte::united(known, value),
            Some(_) => {}
            None => all.push((name.clone(), value.clone())),
        }
    }
    all
}
