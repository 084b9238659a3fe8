//! Sampling of a piecewise-constant density on a grid over the unit square: rows by their sums, then columns.

use super::discrete::Discrete;

/// A piecewise-constant density over [0, 1)².
#[derive(Debug, Clone)]
pub struct Grid {
    rows: Discrete,
    columns: Vec<Discrete>,
}

impl Grid {
    /// From `height` rows of `width` non-negative weights.
    pub fn new(width: usize, height: usize, weight: impl Fn(usize, usize) -> f64) -> Self {
        let columns: Vec<Discrete> = (0..height).map(|y| Discrete::new((0..width).map(|x| weight(x, y)))).collect();
        Self { rows: Discrete::new(columns.iter().map(Discrete::total)), columns }
    }

    /// A point of the square and its density w.r.t. area.
    pub fn sample(&self, [u, v]: [f64; 2]) -> ([f64; 2], f64) {
        let (y, v) = self.rows.sample(v);
        let (x, u) = self.columns[y].sample(u);
        let (width, height) = (self.columns[y].len() as f64, self.rows.len() as f64);
        let pdf = self.rows.probability(y) * self.columns[y].probability(x) * width * height;
        ([(x as f64 + u) / width, (y as f64 + v) / height], pdf)
    }

    /// Density of [`Grid::sample`] at a point, w.r.t. area.
    pub fn pdf(&self, [u, v]: [f64; 2]) -> f64 {
        let height = self.rows.len();
        let y = ((v * height as f64) as usize).min(height - 1);
        let width = self.columns[y].len();
        let x = ((u * width as f64) as usize).min(width - 1);
        self.rows.probability(y) * self.columns[y].probability(x) * (width * height) as f64
    }
}
