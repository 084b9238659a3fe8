//! Layers of a picture that was put together: those of the film are in memory, those of features and mattes stay in the files of the first parts.

use std::borrow::Cow;
use std::ops::Range;

use super::sums::stripes;
use super::windows::OfWindow;
use crate::base::Result;
use crate::base::streamed::Checked;
use crate::film::PixelSpread;
use crate::picture::{Channel, Layers, Window};

/// Layers of a picture that was put together.
pub struct MergedLayers {
    /// Those of the film.
    film: Vec<Channel>,
    /// The channels of the others.
    names: Vec<String>,
    windows: Vec<OfWindow>,
    target: Window,
}

impl MergedLayers {
    /// The layers of the `film`, and those with these names of the windows of a target.
    pub fn new(film: Vec<Channel>, names: Vec<String>, windows: Vec<OfWindow>, target: Window) -> Self {
        Self { film, names, windows, target }
    }

    /// The values of the channel of this name; none where there is no such channel.
    ///
    /// # Errors
    /// Those of reading.
    pub fn channel(&self, name: &str) -> Result<Option<Vec<f32>>> {
        let number = self.names().iter().position(|known| known == name);
        let all = 0..self.target.pixels() as usize;
        number.map(|number| Ok(self.values(number, all)?.into_owned())).transpose()
    }
}

impl Layers for MergedLayers {
    fn names(&self) -> Vec<String> {
        self.film.iter().map(|channel| &channel.name).chain(&self.names).cloned().collect()
    }

    /// Those of windows whose first part is missing are 0.
    fn values(&self, channel: usize, pixels: Range<usize>) -> Result<Cow<'_, [f32]>> {
        let Some(number) = channel.checked_sub(self.film.len()) else {
            return Ok(Cow::Borrowed(&self.film[channel].values[pixels]));
        };
        let mut values = vec![0.0; pixels.len()];
        let width = self.target.width as usize;
        for OfWindow { window, parts } in &self.windows {
            let Some(part) = parts.first().filter(|part| part.layers() > number) else { continue };
            // Rows of the window among these pixels, of which the first and the last may be there in part.
            let [left, top] = [window.x - self.target.x, window.y - self.target.y].map(|place| place as usize);
            let [columns, rows] = [window.width, window.height].map(|side| side as usize);
            let within = |row: usize| row.clamp(top, top + rows) - top;
            let (first, last) = (within(pixels.start / width), within(pixels.end.div_ceil(width)));
            if first >= last {
                continue;
            }
            let (read, _) = part.reader()?.layer(number, first * columns..last * columns)?;
            for (row, own) in (first..last).zip(read.chunks(columns)) {
                let begin = (top + row) * width + left;
                let there = begin.max(pixels.start)..(begin + columns).min(pixels.end);
                if !there.is_empty() {
                    values[there.start - pixels.start..there.end - pixels.start]
                        .copy_from_slice(&own[there.start - begin..there.end - begin]);
                }
            }
        }
        Ok(values.into())
    }
}

/// Reads all layers once, for the checksums.
///
/// # Errors
/// Those of reading.
pub fn check(windows: &mut [OfWindow]) -> Result<()> {
    for of in windows {
        let stripes: Vec<_> = stripes(of).collect();
        for part in of.parts.iter_mut().filter(|part| part.layers() > 0) {
            let mut checked: Vec<Checked> = Vec::new();
            {
                let reader = part.reader()?;
                for number in 0..part.layers() {
                    for pixels in &stripes {
                        checked.extend(reader.layer(number, pixels.clone())?.1);
                    }
                    checked = Checked::joined(checked);
                }
            }
            part.read(checked);
        }
    }
    Ok(())
}

/// The layers that are made of the film, which are `wanted` or not.
pub fn film_channels(spread: Option<PixelSpread>, [samples, variance]: [bool; 2]) -> Vec<Channel> {
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
