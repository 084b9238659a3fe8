//! Trees that are decoded, grown level by level beside the trees that were encoded.

use super::batch::Batch;
use super::program::GEOMETRY;
use super::rows::{NONE, Rows};
use crate::guiding::tree::features::LOG_SHARES;
use crate::guiding::tree::topology::MAX_LEVEL;
use crate::math::cylindrical::cell_centre;

/// One level of the trees that are decoded (Q_r), grown level by level from the roots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DecodeLevel {
    /// The level, 0 for the roots.
    pub level: usize,
    /// Cells and indices; `rows.parent` is the step's `parent_index`.
    pub rows: Rows,
    /// [N] row of the same cell in the same level of the encoded batch, or [`NONE`].
    pub skip: Vec<u32>,
    /// [N] the same node or, where the encoded tree ends above, its nearest ancestor, in the concatenation of all nodes.
    pub ancestor: Vec<u32>,
}

impl DecodeLevel {
    /// The roots of all trees of `batch`.
    pub fn roots(batch: &Batch) -> Self {
        let trees = batch.trees();
        let ancestor = batch.tree_start[..trees].iter().map(|&start| start as u32).collect();
        Self { level: 0, rows: Rows::roots(trees), skip: (0..trees as u32).collect(), ancestor }
    }

    /// The children of the rows whose flag in `split` [N] is set, siblings adjacent; sets `rows.first_child` of this level.
    /// `batch` is the one that [`DecodeLevel::roots`] took. At [`MAX_LEVEL`] there are no children.
    pub fn grow(&mut self, batch: &Batch, split: &[bool]) -> Self {
        let may_split = self.level < MAX_LEVEL;
        let rows = self.rows.split(self.level, split.iter().map(|&s| s && may_split));
        let mut below = Self { level: self.level + 1, rows, skip: vec![], ancestor: vec![] };
        for (row, &parent) in below.rows.parent.iter().enumerate() {
            let parent = parent as usize;
            let first = match self.skip[parent] {
                NONE => NONE,
                skip => batch.levels[self.level].rows.first_child[skip as usize],
            };
            if first == NONE {
                below.skip.push(NONE);
                below.ancestor.push(self.ancestor[parent]);
            } else {
                let skip = first + row as u32 % 4;
                below.skip.push(skip);
                below.ancestor.push(batch.levels[below.level].node[skip as usize]);
            }
        }
        below
    }

    /// The step's `skip` input [N, channels] out of the encoder's output at the same level: zero where there is no such node.
    pub fn skip_rows(&self, encoded: &[f32], channels: usize) -> Vec<f32> {
        let mut rows = vec![0.0; self.rows.len() * channels];
        for (to, &skip) in rows.chunks_exact_mut(channels).zip(&self.skip).filter(|(_, skip)| **skip != NONE) {
            to.copy_from_slice(&encoded[skip as usize * channels..][..channels]);
        }
        rows
    }

    /// The step's `base` input [N]: the logarithm of the share that the network corrects. `base` is that of all encoded nodes, as
    /// [`NodeInputs`](crate::guiding::tree::features::NodeInputs) has them; equal shares where the encoded tree has no such node.
    pub fn base(&self, base: &[f32]) -> Vec<f32> {
        let of = |(&skip, &ancestor): (&u32, &u32)| if skip == NONE { 0.25f32.ln() } else { base[ancestor as usize] };
        self.skip.iter().zip(&self.ancestor).map(of).collect()
    }

    /// The step's `geometry` input [N, [`GEOMETRY`]]; `log_shares` are those of
    /// [`NodeInputs`](crate::guiding::tree::features::NodeInputs), all trees' concatenated.
    pub fn geometry(&self, log_shares: &[[f32; LOG_SHARES]]) -> Vec<f32> {
        let mut geometry = Vec::with_capacity(self.rows.len() * GEOMETRY);
        for (row, &cell) in self.rows.cell.iter().enumerate() {
            let mut of_row = [0.0; GEOMETRY];
            of_row[0] = f32::from(self.skip[row] != NONE);
            of_row[1] = self.level as f32 / MAX_LEVEL as f32;
            of_row[2 + ((cell[0] & 1) + 2 * (cell[1] & 1)) as usize] = 1.0;
            of_row[6..9].copy_from_slice(&cell_centre(self.level, cell));
            of_row[9..].copy_from_slice(&log_shares[self.ancestor[row] as usize]);
            geometry.extend_from_slice(&of_row);
        }
        geometry
    }
}
