//! Checks of single values, with the key that a message names.

use glam::{DMat3, DVec3};

use crate::base::{Error, Place, Result};
use crate::scene::file::Matrix;

use super::super::places::Places;

/// Turns a failed check into an error at the key's place.
pub struct Checker<'a> {
    places: &'a Places,
}

impl<'a> Checker<'a> {
    /// A checker that finds places in `places`.
    pub fn new(places: &'a Places) -> Self {
        Self { places }
    }

    /// Place of `key`.
    pub fn place(&self, key: &str) -> Place {
        self.places.at(key)
    }

    /// An error at `key`.
    pub fn fail<T>(&self, key: &str, message: impl Into<String>) -> Result<T> {
        Err(Error::malformed(self.place(key), message))
    }

    /// Checks that `value` is at most `limit`.
    pub fn limit(&self, key: &str, value: u64, limit: u64) -> Result<()> {
        if value > limit { Err(super::beyond(self, key, value, limit)) } else { Ok(()) }
    }

    /// Checks that there is no NaN and no infinity.
    pub fn finite(&self, key: &str, values: &[f32]) -> Result<()> {
        match values.iter().find(|value| !value.is_finite()) {
            Some(value) => self.fail(key, format!("{} is {value}, expected a finite number", last(key))),
            None => Ok(()),
        }
    }

    /// Checks that a value is finite and at least `least`.
    pub fn at_least(&self, key: &str, value: f32, least: f32) -> Result<()> {
        if value.is_finite() && value >= least {
            return Ok(());
        }
        self.fail(key, format!("{} is {value}, expected a finite number of at least {least}", last(key)))
    }

    /// Checks that a value is finite and above 0.
    pub fn positive(&self, key: &str, value: f32) -> Result<()> {
        if value.is_finite() && value > 0.0 {
            return Ok(());
        }
        self.fail(key, format!("{} is {value}, expected a finite number above 0", last(key)))
    }

    /// Checks that channels are finite and none is negative.
    pub fn color(&self, key: &str, color: &[f32; 3]) -> Result<()> {
        color.iter().try_for_each(|&channel| self.at_least(key, channel, 0.0))
    }

    /// Checks that channels are in [0, 1].
    pub fn albedo(&self, key: &str, color: &[f32; 3]) -> Result<()> {
        match color.iter().find(|channel| !(0.0..=1.0).contains(*channel)) {
            Some(channel) => self.fail(key, format!("{} is {channel}, expected a number from 0 to 1", last(key))),
            None => Ok(()),
        }
    }

    /// Checks for a finite affine matrix with an inverse.
    pub fn transform(&self, key: &str, matrix: &Matrix) -> Result<()> {
        self.affine(key, matrix)?;
        if has_inverse(matrix) { Ok(()) } else { self.fail(key, FLATTENS) }
    }

    /// Checks for a finite affine matrix.
    pub fn affine(&self, key: &str, matrix: &Matrix) -> Result<()> {
        self.finite(key, matrix)?;
        if matrix[12..] != [0.0, 0.0, 0.0, 1.0] {
            return self.fail(key, "the last row of a transform must be 0 0 0 1");
        }
        Ok(())
    }
}

/// Message about a transform without inverse.
pub const FLATTENS: &str = "the transform has no inverse: it flattens space";

/// Whether an affine matrix has an inverse.
pub fn has_inverse(matrix: &Matrix) -> bool {
    let m = linear(matrix);
    let size = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    // Relative to the axes' lengths, so that a small but sound scale passes.
    m.determinant().abs() > 1e-9 * size
}

/// The part of a transform that acts on vectors.
pub fn linear(matrix: &Matrix) -> DMat3 {
    let column = |i: usize| DVec3::new(f64::from(matrix[i]), f64::from(matrix[4 + i]), f64::from(matrix[8 + i]));
    DMat3::from_cols(column(0), column(1), column(2))
}

/// The last part of a key path: the user's name for the value.
fn last(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}
