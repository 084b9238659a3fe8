//! Adding up the blocks of parts, stripe by stripe.
//!
//! The sums of a band of stripes are in memory while one part after the other is read, each of them once for a band: files that lie on other
//! machines are opened seldom and read from begin to end. Stripes are added by several threads, and each stays in the caches while a few parts
//! are added to it.

use std::ops::Range;

use rayon::prelude::*;

use super::super::part_file::PartReader;
use super::windows::{OfWindow, within};
use crate::base::streamed::Checked;
use crate::base::{Progress, Result};
use crate::film::{Block, Cascade, Sum};
use crate::picture::Window;

/// Pixels of a stripe: a block of them fits into the caches beside their sum.
pub const STRIPE: usize = 1 << 13;
/// Bytes of the sums that are held at a time.
const BAND: usize = 1 << 28;
/// Parts that are open at a time.
const OPEN: usize = 64;

/// Consecutive stripes of a window: its number, and their pixels.
struct Band {
    window: usize,
    stripes: Vec<Range<usize>>,
}

/// What was read for a band: its sums, and checksums of each part.
type Read = (Vec<Sum>, Vec<Vec<Checked>>);

/// Adds the blocks of all parts up, and gives the sum of each stripe to `take`, with the number of its window and its first pixel there: those of a
/// window in their order.
///
/// # Errors
/// Those of reading.
pub fn add_up(
    windows: &mut [OfWindow],
    detailed: bool,
    progress: &dyn Progress,
    mut take: impl FnMut(&OfWindow, usize, Sum),
) -> Result<()> {
    let all = windows.iter().map(|of| (stripes(of).count() * of.parts.len()) as u64).sum();
    progress.start(all, "stripes");
    for group in groups(bands(windows, BAND / Sum::bytes_per_pixel(detailed))) {
        let sum = |band: &Band| sums_of(&windows[band.window], &band.stripes, detailed, progress);
        let read: Vec<Read> = group.par_iter().map(sum).collect::<Result<_>>()?;
        for (band, (sums, checked)) in group.iter().zip(read) {
            let of = &mut windows[band.window];
            of.parts.iter_mut().zip(checked).for_each(|(part, checked)| part.read(checked));
            band.stripes.iter().zip(sums).for_each(|(pixels, sum)| take(of, pixels.start, sum));
        }
    }
    progress.finish();
    Ok(())
}

/// The samples of all parts by brightness, in the pixels of `target`; none where parts have none. Those of one part and of the whole are in memory
/// at a time.
///
/// # Errors
/// Those of reading.
pub fn by_brightness(windows: &mut [OfWindow], target: Window) -> Result<Option<Cascade>> {
    let mut all: Option<Cascade> = None;
    for OfWindow { window, parts } in windows {
        for part in parts {
            let (cascade, checked) = part.reader()?.cascade()?;
            part.read(checked);
            if let Some(cascade) = cascade {
                let all = all.get_or_insert_with(|| Cascade::new(target.pixels() as usize));
                all.place(&cascade, |i| within(target, window.place(i as u64)));
            }
        }
    }
    Ok(all)
}

/// The stripes of a window.
pub fn stripes(of: &OfWindow) -> impl Iterator<Item = Range<usize>> + use<> {
    let pixels = of.window.pixels() as usize;
    (0..pixels).step_by(STRIPE).map(move |begin| begin..(begin + STRIPE).min(pixels))
}

/// All stripes in bands of so many pixels at most, or of one stripe.
fn bands(windows: &[OfWindow], pixels: usize) -> Vec<Band> {
    let of_window = |(window, of): (usize, &OfWindow)| {
        let stripes: Vec<_> = stripes(of).collect();
        let bands = stripes.chunks((pixels / STRIPE).max(1)).map(<[_]>::to_vec);
        bands.map(|stripes| Band { window, stripes }).collect::<Vec<_>>()
    };
    windows.iter().enumerate().flat_map(of_window).collect()
}

/// Bands of several stripes, each of which keeps all threads busy, one by one; those of one stripe several at a time.
fn groups(bands: Vec<Band>) -> Vec<Vec<Band>> {
    let most = 4 * rayon::current_num_threads();
    let mut groups: Vec<Vec<Band>> = Vec::new();
    for band in bands {
        match groups.last_mut() {
            Some(last) if last.len() < most && last.iter().chain([&band]).all(|band| band.stripes.len() == 1) => {
                last.push(band);
            }
            _ => groups.push(vec![band]),
        }
    }
    groups
}

fn sums_of(of: &OfWindow, stripes: &[Range<usize>], detailed: bool, progress: &dyn Progress) -> Result<Read> {
    let mut sums: Vec<Sum> = stripes.iter().map(|pixels| Sum::new(pixels.len(), detailed)).collect();
    let mut checked = Vec::with_capacity(of.parts.len());
    // Of single stripes every thread has one.
    for parts in of.parts.chunks(if stripes.len() == 1 { 1 } else { OPEN }) {
        let open = parts.iter().map(|part| part.reader()).collect::<Result<Vec<_>>>()?;
        let add = |block: &mut Block, (sum, pixels): (&mut Sum, &Range<usize>)| {
            let read = open.iter().map(|part: &PartReader| part.add(pixels.clone(), sum, block)).collect();
            progress.advance(open.len() as u64);
            read
        };
        let read: Result<Vec<Vec<Vec<Checked>>>> =
            sums.par_iter_mut().zip(stripes).map_init(Block::default, add).collect();
        let mut read = read?;
        let of_part = |part| Checked::joined(read.iter_mut().flat_map(|of| std::mem::take(&mut of[part])).collect());
        checked.extend((0..open.len()).map(of_part));
    }
    Ok((sums, checked))
}
