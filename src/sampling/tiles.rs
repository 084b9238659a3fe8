//! Tiles of a [`Grid`]: how often each is chosen may be learned, where in a tile a point lies remains as the grid has it.

use super::discrete::Discrete;
use super::grid::Grid;
use crate::math::lanes::{LANES, Real, by_lane};

/// Columns of tiles.
pub const COLUMNS: usize = 32;
/// Rows of tiles.
pub const ROWS: usize = 16;
/// Number of tiles.
pub const TILES: usize = COLUMNS * ROWS;

/// A grid's cells by tile.
#[derive(Debug, Clone)]
pub struct Tiling {
    /// Tile column of each column of cells, and tile row of each row.
    column_of: Vec<u8>,
    row_of: Vec<u8>,
    /// First column of cells of each tile column, first row of each tile row, and the ends of the last.
    left: [usize; COLUMNS + 1],
    top: [usize; ROWS + 1],
    /// Of each tile column, the weights of its rows of cells.
    strips: Vec<Discrete>,
    /// Probability with which the grid chooses each tile, row by row.
    shares: Vec<f32>,
}

/// Begins of `parts` equal parts of `len` cells, and the end.
fn begins<const N: usize>(len: usize) -> [usize; N] {
    std::array::from_fn(|part| (part * len).div_ceil(N - 1))
}

/// The part that each of `len` cells is in.
fn parts(len: usize, begins: &[usize]) -> Vec<u8> {
    (0..len).map(|cell| (begins.partition_point(|&begin| begin <= cell) - 1) as u8).collect()
}

impl Tiling {
    /// The tiles of a grid.
    pub fn new(grid: &Grid) -> Self {
        let [width, height] = grid.size();
        let (left, top) = (begins::<{ COLUMNS + 1 }>(width), begins::<{ ROWS + 1 }>(height));
        let mut shares = vec![0.0; TILES];
        let (column_of, row_of) = (parts(width, &left), parts(height, &top));
        let strips = (0..COLUMNS).map(|tile| {
            let weights: Vec<f64> = (0..height).map(|y| grid.mass(y, left[tile]..left[tile + 1])).collect();
            for (&row, &weight) in row_of.iter().zip(&weights) {
                shares[usize::from(row) * COLUMNS + tile] += weight as f32;
            }
            Discrete::new(weights)
        });
        let strips = strips.collect();
        Self { column_of, row_of, left, top, strips, shares }
    }

    /// The tile of a cell.
    #[inline(always)]
    pub fn tile(&self, [x, y]: [usize; 2]) -> usize {
        usize::from(self.row_of[y]) * COLUMNS + usize::from(self.column_of[x])
    }

    /// Probabilities with which the grid chooses tiles, row by row.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// Cells that points of the unit square select by the `weights` of each lane, and where in the cells they lie.
    #[inline(always)]
    pub fn choose<'w, R: Real>(
        &self,
        grid: &Grid,
        u: [R; 2],
        weights: impl Fn(usize) -> Option<&'w Weights>,
    ) -> ([R; 2], [R; 2]) {
        // In steps, so that lanes wait for memory together.
        let lanes = u[0];
        let [column, u, y, below] = by_lane!(u, |lane, u| {
            if let Some(weights) = weights(lane) {
                let (tile, [u, v]) = weights.choose(lanes, u);
                let (column, row) = (tile % COLUMNS, tile / COLUMNS);
                let (y, below) = self.strips[column].sample_within(self.top[row]..self.top[row + 1], v);
                grid.prefetch_row(y, self.left[column]..self.left[column + 1]);
                [column as f32, u as f32, y as f32, below as f32]
            } else {
                [0.0; 4]
            }
        });
        let [x, right] = by_lane!([column, u, y], |_, [column, u, y]| {
            let column = column as usize;
            let (x, right) = grid.sample_row(y as usize, self.left[column]..self.left[column + 1], u.into());
            [x as f32, right as f32]
        });
        ([x, y], [right, below])
    }
}

/// Probabilities of tiles.
#[derive(Debug, Clone)]
pub struct Weights {
    /// Cumulative probabilities of rows of tiles, and of the tiles of each row.
    rows: [f32; ROWS],
    columns: [[f32; COLUMNS]; ROWS],
    /// Probability of each tile over that of the grid.
    ratios: [f32; TILES],
}

/// Makes weights cumulative, ending with 1, and returns their sum.
fn accumulate<const N: usize>(weights: [f64; N]) -> ([f32; N], f64) {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut cumulative = weights.map(|weight| {
        sum += weight;
        if total > 0.0 { (sum / total) as f32 } else { 0.0 }
    });
    // Neither rounding nor the end may choose what has no weight.
    let last = weights.iter().rposition(|&weight| weight > 0.0).unwrap_or(0);
    cumulative[last..].fill(1.0);
    (cumulative, total)
}

/// The index that `u` selects, and `u` within it, at most 1 − 2⁻²⁴: so far is a single number from the next, the end of
/// the index, at least. It stays below 1 as a single number, and so never chooses cells without weight at the end of a
/// tile. `lanes` are any.
#[inline(always)]
fn select<R: Real, const N: usize>(lanes: R, cumulative: &[f32; N], u: f32) -> (usize, f64) {
    let mut below = 0;
    for ends in cumulative.as_chunks::<LANES>().0 {
        below += lanes.count_up_to(ends, u);
    }
    let index = (below as usize).min(N - 1);
    let begin = if index == 0 { 0.0 } else { f64::from(cumulative[index - 1]) };
    let width = f64::from(cumulative[index]) - begin;
    (index, if width > 0.0 { ((f64::from(u) - begin) / width).clamp(0.0, 1.0 - f64::EPSILON) } else { 0.5 })
}

impl Weights {
    /// Tiles chosen in proportion to `weights`, all of which are positive where the grid's `shares` are.
    pub fn new(weights: &[f64], shares: &[f32]) -> Self {
        let mut columns = [[0.0; COLUMNS]; ROWS];
        let totals: [f64; ROWS] = std::array::from_fn(|row| {
            let (cumulative, total) = accumulate(std::array::from_fn::<_, COLUMNS, _>(|c| weights[row * COLUMNS + c]));
            columns[row] = cumulative;
            total
        });
        let rows = accumulate(totals).0;
        let part = |cumulative: &[f32], i: usize| {
            f64::from(cumulative[i]) - if i == 0 { 0.0 } else { f64::from(cumulative[i - 1]) }
        };
        let ratios = std::array::from_fn(|tile| {
            let (row, column) = (tile / COLUMNS, tile % COLUMNS);
            let share = f64::from(shares[tile]);
            if share > 0.0 { (part(&rows, row) * part(&columns[row], column) / share) as f32 } else { 0.0 }
        });
        Self { rows, columns, ratios }
    }

    /// The tile that a point of the unit square selects, and its place in it; `lanes` are any.
    #[inline(always)]
    pub fn choose<R: Real>(&self, lanes: R, [u, v]: [f32; 2]) -> (usize, [f64; 2]) {
        let (row, v) = select(lanes, &self.rows, v);
        let (column, u) = select(lanes, &self.columns[row], u);
        (row * COLUMNS + column, [u, v])
    }

    /// Probability of a tile over that of the grid.
    #[inline(always)]
    pub fn ratio(&self, tile: usize) -> f32 {
        self.ratios[tile]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Cells are chosen as often as their density says. Maps that are narrower than the tiles, dark rows and dark tiles are among them. Of
    /// 500,000 points a cell gets as many as it should within six standard deviations and six more: a false alarm in 10⁵ seeds.
    #[test]
    fn cells_are_chosen_with_their_density() {
        let mut random = Random::new(17, 0, 0);
        for (width, height, kind) in [(64, 33, 0), (40, 17, 1), (5, 3, 0), (1, 1, 0), (33, 64, 2), (200, 20, 1)] {
            let weights: Vec<f64> = (0..width * height)
                .map(|i| match kind {
                    0 => random.next_f64().powi(6),
                    1 if i / width % 3 == 1 => random.next_f64(),
                    2 if i % width < width / 2 => 1.0,
                    _ => 0.0,
                })
                .collect();
            let grid = Grid::new(width, height, |y, row| row.copy_from_slice(&weights[y * width..][..width]));
            let tiling = Tiling::new(&grid);
            let share: f32 = tiling.shares().iter().sum();
            assert!((share - 1.0).abs() < 1e-5, "{share}");
            let wanted: Vec<f64> =
                tiling.shares().iter().map(|&share| if share > 0.0 { 0.1 + random.next_f64() } else { 0.0 }).collect();
            let learned = Weights::new(&wanted, tiling.shares());
            let points = 500_000;
            let mut counts = vec![0u32; width * height];
            for _ in 0..points {
                let ([x, y], inside) = tiling.choose::<f32>(&grid, random.next_2d(), |_| Some(&learned));
                assert!(inside.iter().all(|place| (0.0..=1.0).contains(place)));
                counts[y as usize * width + x as usize] += 1;
            }
            let mut sum = 0.0;
            for (cell, &count) in counts.iter().enumerate() {
                let place = [cell % width, cell / width];
                let tile = tiling.tile(place);
                let probability = grid.density(place) / (width * height) as f64 * f64::from(learned.ratio(tile));
                sum += probability;
                let expected = probability * f64::from(points);
                let bound = 6.0 * expected.sqrt() + 6.0;
                assert!((f64::from(count) - expected).abs() < bound, "{width}×{height} {place:?}: {count} {expected}");
            }
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
    }

    #[test]
    fn what_has_no_weight_is_never_chosen() {
        let mut weights = vec![0.0; TILES];
        (weights[5], weights[3 * COLUMNS + 7]) = (1.0, 3.0);
        let learned = Weights::new(&weights, &vec![1.0 / TILES as f32; TILES]);
        for u in [0.0, 0.3, 0.5, 1.0 - f32::EPSILON / 2.0] {
            for v in [0.0, 0.2, 0.25f32.next_down(), 0.7, 1.0 - f32::EPSILON / 2.0] {
                let (tile, inside) = learned.choose(0.0, [u, v]);
                assert!(weights[tile] > 0.0, "{u} {v}: {tile}");
                assert!(inside.iter().all(|&place| (place as f32) < 1.0), "{u} {v}: {inside:?}");
            }
        }
        assert_eq!(learned.ratio(0), 0.0);
        assert!((learned.ratio(5) - 0.25 * TILES as f32).abs() < 1e-3);
    }
}
