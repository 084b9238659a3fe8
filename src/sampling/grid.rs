//! Sampling of a piecewise-constant density on a grid over the unit square: rows by their sums, then columns.

use std::ops::Range;

use rayon::prelude::*;

use super::cutpoints;
use super::discrete::{self, Discrete};
use crate::base::processor::prefetch;
use crate::math::lanes::{Real, by_lane};

/// A piecewise-constant density over [0, 1)².
#[derive(Debug, Clone)]
pub struct Grid {
    rows: Discrete,
    width: usize,
    /// Cumulative weights of each row, one after the other.
    cdfs: Vec<f64>,
    /// Tables of [`cutpoints`] of the rows, [`cutpoints::table_len`] entries each.
    tables: Vec<u32>,
}

impl Grid {
    /// A density from `height` rows of `width` non-negative weights, both at least 1; `weigh` fills in the weights of a row. Takes
    /// ten bytes per weight where the width is a power of two, at most twelve elsewhere.
    pub fn new(width: usize, height: usize, weigh: impl Fn(usize, &mut [f64]) + Sync) -> Self {
        let entries = cutpoints::table_len(width);
        let mut cdfs = vec![0.0; width * height];
        let make_row = |(y, cdf): (usize, &mut [f64])| {
            weigh(y, cdf);
            discrete::accumulate(cdf)
        };
        let totals: Vec<f64> = cdfs.par_chunks_mut(width).enumerate().map(make_row).collect();
        let mut tables = vec![0; entries * height];
        if entries > 0 {
            let rows = tables.par_chunks_mut(entries).zip(cdfs.par_chunks(width));
            rows.for_each(|(table, cdf)| cutpoints::fill(cdf, table));
        }
        Self { rows: Discrete::new(totals), width, cdfs, tables }
    }

    /// Cumulative weights of row `y`.
    #[inline(always)]
    fn row(&self, y: usize) -> &[f64] {
        &self.cdfs[y * self.width..][..self.width]
    }

    /// Table of [`cutpoints`] of row `y`.
    #[inline(always)]
    fn table(&self, y: usize) -> &[u32] {
        let entries = cutpoints::table_len(self.width);
        &self.tables[y * entries..][..entries]
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.rows.len()]
    }

    /// Probability of the cells of row `y` in a range of columns.
    pub fn mass(&self, y: usize, columns: Range<usize>) -> f64 {
        self.rows.probability(y) * columns.map(|x| discrete::probability(self.row(y), x)).sum::<f64>()
    }

    /// Samples a column of row `y` in a range of them, and where in the cell the point lies.
    #[inline(always)]
    pub fn sample_row(&self, y: usize, columns: Range<usize>, u: f64) -> (usize, f64) {
        discrete::sample_within(self.row(y), columns, u)
    }

    /// Brings near what [`Grid::sample_row`] reads.
    #[inline(always)]
    pub fn prefetch_row(&self, y: usize, columns: Range<usize>) {
        const LINE: usize = 8;
        let first = columns.start.saturating_sub(1);
        self.row(y)[first..columns.end].iter().step_by(LINE).take(LINE).for_each(prefetch);
    }

    /// Brings near what [`Grid::density`] reads for a cell.
    #[inline(always)]
    pub fn prefetch(&self, [x, y]: [usize; 2]) {
        self.row(y).get(x).into_iter().for_each(prefetch);
    }

    /// Samples cells in lanes: columns and rows, and where in the cells the points lie, from 0 to 1.
    #[inline(always)]
    pub fn choose<R: Real>(&self, [u, v]: [R; 2]) -> ([R; 2], [R; 2]) {
        // In steps, so that lanes wait for memory together: for their part of the row's table, of the row, and for what is there.
        let [y, below] = by_lane!([u, v], |_, [u, v]| {
            let (y, below) = self.rows.sample(v.into());
            cutpoints::entry(self.table(y), u.into()).into_iter().for_each(prefetch);
            [y as f32, below as f32]
        });
        let [] = by_lane!([u, y], |_, [u, y]| {
            let first = cutpoints::entry(self.table(y as usize), u.into()).map_or(0, |&first| first as usize);
            self.row(y as usize).get(first).into_iter().for_each(prefetch);
            []
        });
        let [x, right] = by_lane!([u, y], |_, [u, y]| {
            let (x, right) = discrete::sample(self.row(y as usize), self.table(y as usize), u.into());
            [x as f32, right as f32]
        });
        ([x, y], [right, below])
    }

    /// Samples a point of the square; returns it with its density w.r.t. area.
    #[inline]
    pub fn sample(&self, [u, v]: [f64; 2]) -> ([f64; 2], f64) {
        let (y, v) = self.rows.sample(v);
        let (x, u) = discrete::sample(self.row(y), self.table(y), u);
        let (width, height) = (self.width as f64, self.rows.len() as f64);
        ([(x as f64 + u) / width, (y as f64 + v) / height], self.density([x, y]))
    }

    /// Density of [`Grid::sample`] at a point, w.r.t. area.
    #[inline]
    pub fn pdf(&self, point: [f64; 2]) -> f64 {
        self.density(self.cell(point))
    }

    /// Column and row of the cell that holds a point.
    #[inline]
    fn cell(&self, [u, v]: [f64; 2]) -> [usize; 2] {
        let height = self.rows.len();
        let y = ((v * height as f64) as usize).min(height - 1);
        let x = ((u * self.width as f64) as usize).min(self.width - 1);
        [x, y]
    }

    /// Density of [`Grid::sample`] in the cell of a column and a row, w.r.t. area.
    #[inline(always)]
    pub fn density(&self, [x, y]: [usize; 2]) -> f64 {
        self.rows.probability(y) * discrete::probability(self.row(y), x) * (self.width * self.rows.len()) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The cell that `u` falls in and where in it, by halving.
    fn halved(weights: &[f64], u: f64) -> (usize, f64) {
        let mut cdf = weights.to_vec();
        discrete::accumulate(&mut cdf);
        let i = cdf.partition_point(|&c| c <= u).min(cdf.len() - 1);
        let low = if i == 0 { 0.0 } else { cdf[i - 1] };
        let inside = if cdf[i] > low { (u - low) / (cdf[i] - low) } else { 0.5 };
        (i, inside.clamp(0.0, 1.0 - f64::EPSILON))
    }

    /// Points equal those of two binary searches to the last bit, and their density that of the look-up: also where rows are zero
    /// or all is, and where there is one row, one column or one cell.
    #[test]
    fn same_points_as_by_halving() {
        let mut random = Random::new(41, 0, 0);
        for (width, height) in [(1, 1), (1, 40), (40, 1), (2, 2), (64, 33), (100, 7)] {
            for kind in 0..3 {
                let mut cell = |i: usize| match kind {
                    0 => random.next_f64().powi(8),
                    1 if i / width % 3 == 1 => random.next_f64(),
                    _ => 0.0,
                };
                let weights: Vec<f64> = (0..width * height).map(&mut cell).collect();
                let rows: Vec<&[f64]> = weights.chunks(width).collect();
                let grid = Grid::new(width, height, |y, row| row.copy_from_slice(rows[y]));
                let sums: Vec<f64> = rows.iter().map(|row| row.iter().sum()).collect();
                for i in 0..2000 {
                    let last = 1.0 - f64::EPSILON;
                    let [u, v] = match i {
                        0..4 => [[0.0, last][i % 2], [0.0, last][i / 2]],
                        _ => [random.next_f64(), random.next_f64()],
                    };
                    let ([x, y], density) = grid.sample([u, v]);
                    let (row, below) = halved(&sums, v);
                    let (column, right) = halved(rows[row], u);
                    let single = [u, v].map(|x| x as f32);
                    let [below_u, below_v] = single.map(f64::from);
                    let chosen_row = halved(&sums, below_v).0;
                    let chosen = [halved(rows[chosen_row], below_u).0, chosen_row];
                    assert_eq!(grid.choose(single).0.map(|place| place as usize), chosen);
                    let expected = [(column as f64 + right) / width as f64, (row as f64 + below) / height as f64];
                    assert_eq!([x, y], expected, "{width}×{height}, kind {kind}, {u} {v}");
                    assert_eq!(density, grid.density([column, row]));
                    assert!(density > 0.0, "{width}×{height}, kind {kind}, {u} {v}");
                }
            }
        }
    }
}
