//! The final pass in blocks of samples, which are added up one by one: what other processes render of a picture can be added up with
//! what this one does, and gives the bits of a picture that one process renders. See [`Block`].

use super::run::{Rendered, Run};
use super::settings::StopRule;
use super::state::{Blocks, Phase, Position};
use crate::base::Result;
use crate::film::{BLOCK, Block, Cascade, spread_of_sum, taken_from_sum};
use crate::guiding::sample::field::GuideField;

impl Run<'_> {
    /// Whether the final pass goes by blocks: where it alone makes the picture, and all of its pixels get as many samples.
    pub(super) fn goes_by_blocks(&self) -> bool {
        matches!(self.settings.stop, StopRule::Spp(_)) && !self.settings.adaptive && self.state.passes.is_empty()
    }

    /// Spends the rest of a budget of `spp`, or this part's share of it.
    pub(super) fn block_pass(&mut self, spp: u32, field: Option<&GuideField>) -> Result<Rendered> {
        let (pixels, detailed) = (self.pixels() as usize, self.settings.keeps_spread);
        let resumed = self.resume(Phase::Final);
        let mut goes_on = resumed.is_some();
        let mut part = resumed.unwrap_or_else(|| self.begin_pass(0));
        if !goes_on {
            let began = self.watcher.elapsed();
            self.state.position = Position { phase: Phase::Final, began, ..Position::default() };
            self.state.blocks = Some(Blocks::new(pixels, self.settings.part.is_some(), detailed));
            self.state.cascade = self.settings.fireflies.kappa().map(|_| Cascade::new(pixels));
            // The samples of the parts before count as rendered: theirs are the random numbers.
            self.state.rendered +=
                self.settings.part.map_or(Ok(0), |part| part.samples(self.left(spp)).map(|own| own.start))?;
        }
        let guide = field.filter(|field| !field.voxels().is_empty());
        let picture = guide.and_then(|_| self.pixel_values());
        loop {
            if !goes_on {
                part.spp = self.own(spp)?.min(BLOCK);
                if !self.begins(part.spp) {
                    break;
                }
            }
            goes_on = false;
            let complete = self.trace(&mut part, field, None, picture.as_deref());
            if let Some(blocks) = &mut self.state.blocks {
                blocks.push(Block::of(&part.pass, detailed));
            }
            if let (Some(cascade), Some(halves)) = (&mut self.state.cascade, part.pass.cascades()) {
                halves.iter().for_each(|half| cascade.absorb(half));
            }
            if !complete {
                break;
            }
            part.pass.clear();
        }
        drop(part);
        let summed = self.state.blocks.as_ref().map(|blocks| blocks.sum(pixels, detailed).finish());
        let width = self.window.width as usize;
        // A pass all of whose samples were dropped is black, but one that never began is none.
        let begun = self.state.position.batches > 0 && self.state.early.is_empty();
        match summed.filter(|summed| begun || summed.samples() > 0) {
            Some(summed) => {
                let views = self.scene.views();
                let plain = summed.image(width, views);
                // Of a part, who puts all together takes them out.
                let judged = self.settings.fireflies.kappa().filter(|_| self.settings.part.is_none());
                let of_all = judged.zip(self.state.cascade.as_ref());
                let fireflies = of_all.map(|(kappa, cascade)| taken_from_sum(&summed, cascade, views, &plain, kappa));
                Ok(Rendered { plain, spread: spread_of_sum(summed, width)?, fireflies })
            }
            None => self.of_passes(),
        }
    }

    /// Whole samples per pixel that are left of a budget of `spp`.
    pub(super) fn left(&self, spp: u32) -> u32 {
        (f64::from(spp) - self.state.spent).max(0.0) as u32
    }

    /// Those that are left to this part.
    fn own(&self, spp: u32) -> Result<u32> {
        let (left, done) = (self.left(spp), self.state.position.batches);
        let Some(part) = self.settings.part else { return Ok(left) };
        Ok((part.samples(left + done)?.len() as u32).saturating_sub(done))
    }
}
