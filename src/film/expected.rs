//! Estimated pixel values, from the noisy picture so far.

use rayon::prelude::*;

use crate::math::{channel_mean, trimmed_mean};
use crate::picture::Image;

/// Least expected value of a pixel, as a part of the whole picture's mean.
const FLOOR: f64 = 0.1;

/// Estimated channel mean of every pixel of `image`: a mean over 5 × 5 pixels, with a floor. The largest values are left out of
/// both, so that fireflies do not make everything else look worthless. None while no light was found.
pub fn expected_values(image: &Image) -> Option<Vec<f32>> {
    let found: Vec<f64> = image.pixels.iter().map(|&p| f64::from(channel_mean(p))).collect();
    let floor = FLOOR * trimmed_mean(&mut found.clone(), found.len() / 100)?;
    let reach = |at: usize, size: usize| at.saturating_sub(2)..(at + 3).min(size);
    let value = |i: usize| {
        let (x, y) = (i % image.width, i / image.width);
        let (columns, rows) = (reach(x, image.width), reach(y, image.height));
        let around = rows.flat_map(|row| columns.clone().map(move |column| row * image.width + column));
        let mut around: Vec<f64> = around.map(|at| found[at]).collect();
        // A corner has 9 pixels around it, and one of them may be a firefly.
        let fireflies = around.len() / 9;
        trimmed_mean(&mut around, fireflies).unwrap_or(0.0).hypot(floor) as f32
    };
    (floor.is_normal() && floor > 0.0).then(|| (0..found.len()).into_par_iter().map(value).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_firefly_changes_nothing() {
        let grey = Image { width: 20, height: 10, pixels: vec![Vec3::splat(2.0); 200] };
        let mut burnt = grey.clone();
        burnt.pixels[57] = Vec3::splat(1e9);
        let values = expected_values(&grey).expect("there is light");
        assert!(values.iter().all(|v| (v - 2f32.hypot(0.2)).abs() < 1e-5));
        assert_eq!(expected_values(&burnt), Some(values));
    }

    #[test]
    fn darkness_is_bounded_and_black_is_unknown() {
        let mut half = Image { width: 20, height: 10, pixels: vec![Vec3::ZERO; 200] };
        assert_eq!(expected_values(&half), None);
        half.pixels[100..].fill(Vec3::ONE);
        let values = expected_values(&half).expect("there is light");
        assert!((values[0] - 0.05).abs() < 1e-3, "{}", values[0]);
    }
}
