//! The parts of a picture in their order: what belongs together, what is missing.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::super::checkpoint::difference;
use super::super::part::PartOf;
use super::super::part_file::{PartFile, PartHead};
use crate::base::{Error, Result, Unfit};
use crate::picture::Window;

/// The parts of a window, in the order of their samples.
pub struct OfWindow {
    pub window: Window,
    pub parts: Vec<PartFile>,
}

/// Opens the parts at `paths`, which have to be of one picture.
///
/// # Errors
/// [`Error::Parts`] where they are double, unfinished or of another picture, naming them; those of reading.
pub fn open(paths: &[PathBuf]) -> Result<(PartHead, Vec<OfWindow>)> {
    let parts = paths.iter().map(|path| PartFile::open(path)).collect::<Result<Vec<_>>>()?;
    check_common(&parts)?;
    let Some(head) = parts.first().map(|part| part.head.clone()) else {
        return Err(Error::Options("give the parts of a picture".into()));
    };
    Ok((head, by_window(parts)?))
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
                if let Some(other) = parts.iter().find(|other| !go_together(&other.head, &part.head)) {
                    let why =
                        format!("they are parts {} and {} of the same pixels", named(&part.head), named(&other.head));
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

/// Whether two parts of the same pixels are of the same division, and hold no part both.
fn go_together(first: &PartHead, second: &PartHead) -> bool {
    first.part.count() == second.part.count() && first.parts().end() < second.parts().start()
}

/// The part, or parts, in words.
fn named(head: &PartHead) -> String {
    let (first, last) = (head.parts(), head.part.count());
    if head.merged > 1 { format!("{} to {}/{last}", first.start(), first.end()) } else { head.part.to_string() }
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
pub fn target(windows: &[OfWindow], size: [u32; 2]) -> Window {
    match windows {
        [one] => one.window,
        _ => Window::whole(size),
    }
}

/// Index of a place of the whole picture among the pixels of a window.
pub fn within(window: Window, [x, y]: [u32; 2]) -> usize {
    (y - window.y) as usize * window.width as usize + (x - window.x) as usize
}

/// What is missing of the target, in words.
pub fn missing(windows: &[OfWindow], target: Window) -> Vec<String> {
    let mut missing = Vec::new();
    for OfWindow { window: Window { x, y, width, height }, parts } in windows {
        let count = parts.first().map_or(0, |part| part.head.part.count());
        let mut there = parts.iter().flat_map(|part| part.head.parts()).peekable();
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
