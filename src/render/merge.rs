//! Putting the parts of a picture together.
//!
//! Blocks are added up in the order of the samples, whatever the order of the files, so that the picture has the bits that one process would
//! have given it. Of all parts only a stripe of pixels is in memory at a time, beside the picture.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

use rayon::prelude::*;

use super::checkpoint::difference;
use super::part::PartOf;
use super::part_file::{PartFile, PartHead, Totals};
use crate::base::streamed::Checked;
use crate::base::{Error, Progress, Result, Unfit};
use crate::film::{PixelSpread, Sum, Summed, check_size, spread_of_sum};
use crate::integrators::path::Cause;
use crate::picture::cryptomatte;
use crate::picture::{Attribute, Channel, Image, Placed, Window};

/// Pixels of a stripe: their sum and a block of them fit into the caches.
const STRIPE: usize = 1 << 15;
/// Most missing parts that are named one by one.
const NAMED: usize = 16;

/// A picture that was put together.
pub struct Merged {
    /// The picture.
    pub image: Image,
    /// Layers beside it.
    pub channels: Vec<Channel>,
    /// Text attributes for the file's header.
    pub attributes: Vec<Attribute>,
    /// Its place in the whole picture; none where it is that.
    pub placed: Placed,
    /// What is missing, in words; empty where nothing is.
    pub missing: Vec<String>,
}

/// The parts of a window, in the order of their samples.
struct OfWindow {
    window: Window,
    parts: Vec<PartFile>,
}

/// Puts the part files at `paths` together, in whatever order they come. With `allow_missing` a picture is made of what is there.
///
/// # Errors
/// [`Error::Parts`] where parts are missing, double, unfinished or of another picture, naming them; [`Error::Malformed`] and others of
/// reading for a damaged one.
pub fn merge(paths: &[PathBuf], allow_missing: bool, progress: &dyn Progress) -> Result<Merged> {
    let parts = paths.iter().map(|path| PartFile::open(path)).collect::<Result<Vec<_>>>()?;
    check_common(&parts)?;
    let Some(head) = parts.first().map(|part| part.head.clone()) else {
        return Err(Error::Options("give the parts of a picture".into()));
    };
    let mut windows = by_window(parts)?;
    let target = target(&windows, head.size);
    let missing = missing(&windows, target);
    if !missing.is_empty() && !allow_missing {
        let message =
            format!("parts are missing: {}; --allow-missing makes a picture of what is there", told(&missing));
        return Err(Error::Parts { fault: Unfit::Missing, files: Vec::new(), message });
    }
    check_size(target.width, target.height)?;
    let film = added(&mut windows, target, head.detailed, progress)?;
    let layers = layers(&mut windows, &head, target)?;
    let totals = totals(&windows);
    windows.iter_mut().flat_map(|window| &mut window.parts).try_for_each(PartFile::check)?;
    let samples = film.samples() as f64 / target.pixels() as f64;
    let width = target.width as usize;
    let image = film.image(width, 1);
    let spread = spread_of_sum(film, width)?;
    let spp = if missing.is_empty() { head.spp } else { samples as u32 };
    let mut attributes = [head.attributes.clone(), results(&totals, spp), layer_attributes(&windows)].concat();
    if !missing.is_empty() {
        attributes.push(("missingParts".into(), told(&missing)));
    }
    let placed = (target != Window::whole(head.size)).then_some((target, head.size));
    let channels = film_channels(spread, head.film_layers).into_iter().chain(layers).collect();
    Ok(Merged { image, channels, attributes, placed, missing })
}

/// Refuses parts that have not what those of one picture have in common.
fn check_common(parts: &[PartFile]) -> Result<()> {
    let same = |a: &PartHead, b: &PartHead| {
        (&a.in_common, a.size, a.samples, a.spp) == (&b.in_common, b.size, b.samples, b.spp)
            && (a.detailed, a.film_layers, &a.channels) == (b.detailed, b.film_layers, &b.channels)
    };
    let Some(first) = parts.first() else { return Ok(()) };
    let Some(other) = parts.iter().find(|part| !same(&part.head, &first.head)) else { return Ok(()) };
    let (found, wanted) = difference(&other.head.in_common, &first.head.in_common);
    let files = vec![other.path().to_owned(), first.path().to_owned()];
    let message = format!(
        "{} is no part of the picture that {} is a part of: it was made with \"{found}\", the other with \"{wanted}\"",
        files[0].display(),
        files[1].display()
    );
    Err(Error::Parts { fault: Unfit::Foreign, files, message })
}

/// Sorts parts by window and samples; refuses two of the same samples, of different divisions, and windows that overlap.
fn by_window(parts: Vec<PartFile>) -> Result<Vec<OfWindow>> {
    let mut sorted: BTreeMap<([u32; 4], PartOf), PartFile> = BTreeMap::new();
    for part in parts {
        let [x, y, width, height] = part.head.window;
        let key = ([y, x, height, width], part.head.part);
        if let Some(other) = sorted.get(&key) {
            return Err(double(&part, other, &format!("both are part {} of the same pixels", part.head.part)));
        }
        sorted.insert(key, part);
    }
    let mut windows: Vec<OfWindow> = Vec::new();
    for part in sorted.into_values() {
        let window = part.head.window();
        match windows.last_mut().filter(|last| last.window == window) {
            None => windows.push(OfWindow { window, parts: vec![part] }),
            Some(OfWindow { parts, .. }) => {
                if let Some(other) = parts.iter().find(|other| other.head.part.count() != part.head.part.count()) {
                    let why = format!("they are parts {} and {} of the same pixels", part.head.part, other.head.part);
                    return Err(double(&part, other, &why));
                }
                parts.push(part);
            }
        }
    }
    for (i, a) in windows.iter().enumerate() {
        if let Some(b) = windows[i + 1..].iter().find(|b| overlap(a.window, b.window)) {
            return Err(double(&b.parts[0], &a.parts[0], "their windows overlap"));
        }
    }
    Ok(windows)
}

fn double(one: &PartFile, other: &PartFile, why: &str) -> Error {
    let files = vec![other.path().to_owned(), one.path().to_owned()];
    let message = format!("{} and {} do not go together: {why}", files[0].display(), files[1].display());
    Error::Parts { fault: Unfit::Double, files, message }
}

fn overlap(a: Window, b: Window) -> bool {
    // Sides end inside of a picture, and so do not overflow.
    a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height
}

/// The window that is put together: the one that all parts are of, or else the whole picture.
fn target(windows: &[OfWindow], size: [u32; 2]) -> Window {
    match windows {
        [one] => one.window,
        _ => Window::whole(size),
    }
}

fn missing(windows: &[OfWindow], target: Window) -> Vec<String> {
    let mut missing = Vec::new();
    for OfWindow { window: Window { x, y, width, height }, parts } in windows {
        let count = parts.first().map_or(0, |part| part.head.part.count());
        let mut there = parts.iter().map(|part| part.head.part.index()).peekable();
        for index in (1..=count).filter(|&index| there.next_if_eq(&index).is_none()) {
            let of = if windows.len() > 1 { format!(" of the window {x},{y},{width},{height}") } else { String::new() };
            missing.push(format!("{index}/{count}{of}"));
        }
    }
    let pixels: u64 = windows.iter().map(|of| of.window.pixels()).sum();
    if pixels < target.pixels() {
        let whole = target.pixels();
        missing.push(format!("windows with {} of the picture's {whole} pixels", whole - pixels));
    }
    missing
}

/// The missing parts in words.
fn told(missing: &[String]) -> String {
    let more = missing.len().saturating_sub(NAMED);
    let named = missing[..missing.len() - more].join(", ");
    if more > 0 { format!("{named} and {more} more") } else { named }
}

/// A stripe: the number of its window, and the pixels of that.
type Stripe = (usize, Range<usize>);

/// What was read for a stripe: its sum, and checksums for each part.
type Read = (Summed, Vec<Vec<Checked>>);

/// Adds all blocks up.
fn added(windows: &mut [OfWindow], target: Window, detailed: bool, progress: &dyn Progress) -> Result<Summed> {
    let stripes: Vec<Stripe> = (0..).zip(windows.iter()).flat_map(|(number, of)| stripes(number, of.window)).collect();
    let mut film = Summed::empty(target.pixels() as usize, detailed);
    progress.start(stripes.len() as u64, "stripes");
    for group in stripes.chunks(4 * rayon::current_num_threads()) {
        let sum = |stripe: &Stripe| sum_of(&windows[stripe.0], stripe.1.clone(), detailed);
        let read: Vec<Read> = group.par_iter().map(sum).collect::<Result<_>>()?;
        for ((number, pixels), (summed, checked)) in group.iter().zip(read) {
            let OfWindow { window, parts } = &mut windows[*number];
            let place = |i: usize| within(target, window.place((pixels.start + i) as u64));
            film.place(&summed, place);
            parts.iter_mut().zip(checked).for_each(|(part, checked)| part.read(checked));
            progress.advance(1);
        }
    }
    progress.finish();
    Ok(film)
}

fn stripes(number: usize, window: Window) -> impl Iterator<Item = Stripe> {
    let pixels = window.pixels() as usize;
    (0..pixels).step_by(STRIPE).map(move |begin| (number, begin..(begin + STRIPE).min(pixels)))
}

/// Index of a place of the whole picture among the pixels of a window.
fn within(window: Window, [x, y]: [u32; 2]) -> usize {
    (y - window.y) as usize * window.width as usize + (x - window.x) as usize
}

fn sum_of(of: &OfWindow, pixels: Range<usize>, detailed: bool) -> Result<Read> {
    let mut sum = Sum::new(pixels.len(), detailed);
    let add = |part: &PartFile| part.blocks_within(pixels.clone(), |block| sum.add(block));
    let checked = of.parts.iter().map(add).collect::<Result<_>>()?;
    Ok((sum.finish(), checked))
}

/// The layers of features and mattes; those of windows whose first part is missing are 0.
fn layers(windows: &mut [OfWindow], head: &PartHead, target: Window) -> Result<Vec<Channel>> {
    let none = || vec![0.0f32; target.pixels() as usize];
    let mut channels: Vec<Channel> =
        head.channels.iter().map(|name| Channel { name: name.clone(), values: none() }).collect();
    for OfWindow { window, parts } in windows {
        for part in parts {
            for (number, channel) in (0..part.layers()).zip(&mut channels) {
                for (i, value) in part.layer(number)?.into_iter().enumerate() {
                    channel.values[within(target, window.place(i as u64))] = value;
                }
            }
        }
    }
    Ok(channels)
}

/// The layers that are made of the film, which are `wanted` or not.
fn film_channels(spread: Option<PixelSpread>, [samples, variance]: [bool; 2]) -> Vec<Channel> {
    let Some(spread) = spread else { return Vec::new() };
    let channel = |name: &str, values: Vec<f32>| Channel { name: name.into(), values };
    let mut channels = Vec::new();
    if samples {
        channels.push(channel("samples.Y", spread.samples.iter().map(|&n| n as f32).collect()));
    }
    if variance {
        let part = |part: usize| spread.variance.iter().map(|v| v[part]).collect();
        let parts = ["R", "G", "B"].into_iter().enumerate();
        channels.extend(parts.map(|(i, name)| channel(&format!("variance.{name}"), part(i))));
    }
    channels
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
