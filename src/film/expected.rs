//! Estimated pixel values, from the noisy picture so far.

use rayon::prelude::*;
use smallvec::SmallVec;

use crate::math::{channel_mean, trimmed_mean};
use crate::picture::Image;

/// Least expected value of a pixel, as a part of the whole picture's mean.
const FLOOR: f64 = 0.1;

/// Estimated channel mean of every pixel of `image`: a mean over 5 × 5 pixels, with a floor. The largest values are left out of
/// both, so that fireflies do not make everything else look worthless. None while no light was found.
pub fn expected_values(image: &Image) -> Option<Vec<f32>> {
    let (found, floor) = found_in(image)?;
    let reach = |at: usize, size: usize| at.saturating_sub(2)..(at + 3).min(size);
    let value = |i: usize| {
        let (x, y) = (i % image.width, i / image.width);
        let (columns, rows) = (reach(x, image.width), reach(y, image.height));
        let around = rows.flat_map(|row| columns.clone().map(move |column| row * image.width + column));
        let mut around: SmallVec<[f64; 25]> = around.map(|at| found[at]).collect();
        // A corner has 9 pixels around it, and one of them may be a firefly.
        let fireflies = around.len() / 9;
        trimmed_mean(&mut around, fireflies).unwrap_or(0.0).hypot(floor) as f32
    };
    Some((0..found.len()).into_par_iter().map(value).collect())
}

/// The same for judging noise by, where few paths have found light: means over squares of 5 × 5 pixels, or the next of twice the reach, and
/// so on, whose light is not that of a few bright pixels alone. With less a pixel in which nothing was found would count a hundred times
/// as much as others. None while no light was found.
pub fn steady_values(image: &Image) -> Option<Vec<f32>> {
    let (width, height) = (image.width, image.height);
    let (found, floor) = found_in(image)?;
    // Sums of values, and of capped values and their squares, over all that lies above and to the left.
    let stride = width + 1;
    let most = MOST * floor;
    let mut sums = vec![[0.0; 3]; stride * (height + 1)];
    for (y, row) in found.chunks(width.max(1)).enumerate() {
        let mut along = [0.0; 3];
        for (x, &value) in row.iter().enumerate() {
            let capped = value.min(most);
            along = [along[0] + value, along[1] + capped, along[2] + capped * capped];
            let above = sums[y * stride + x + 1];
            sums[(y + 1) * stride + x + 1] = [above[0] + along[0], above[1] + along[1], above[2] + along[2]];
        }
    }
    let value = |i: usize| {
        let (x, y) = (i % width, i / width);
        let mut reach = 2;
        loop {
            let near = |at: usize, size: usize| [at.saturating_sub(reach), (at + reach + 1).min(size)];
            let ([left, right], [top, bottom]) = (near(x, width), near(y, height));
            let [sum, capped, squares] = [0, 1, 2].map(|k| {
                let corner = |x: usize, y: usize| sums[y * stride + x][k];
                corner(right, bottom) - corner(left, bottom) - corner(right, top) + corner(left, top)
            });
            let pixels = ((right - left) * (bottom - top)) as f64;
            let told = squares > 0.0 && capped * capped >= STEADY.min(0.5 * pixels) * squares;
            if told || reach >= width.max(height).min(WIDEST) {
                break (sum / pixels).hypot(floor) as f32;
            }
            reach *= 2;
        }
    };
    Some((0..found.len()).into_par_iter().map(value).collect())
}

/// Effective number (Kish) of pixels whose mean is steady, and the largest reach in which they are looked for.
const STEADY: f64 = 8.0;
const WIDEST: usize = 64;

/// Largest value by which steadiness is judged, over the least that one is expected to have: 10⁴ times the mean. The square
/// of a firefly would leave more of rounding in all sums below it and to its right than other pixels are.
const MOST: f64 = 1e5;

/// Channel means of the pixels of `image`, and the least value that one is expected to have; none where there is no light.
fn found_in(image: &Image) -> Option<(Vec<f64>, f64)> {
    let found: Vec<f64> = image.pixels.iter().map(|&p| f64::from(channel_mean(p))).collect();
    let floor = FLOOR * trimmed_mean(&mut found.clone(), found.len() / 100)?;
    (floor.is_normal() && floor > 0.0).then_some((found, floor))
}

/// Pixel values over their mean.
pub fn over_mean(values: &[f32]) -> Vec<f32> {
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64;
    values.iter().map(|&value| (f64::from(value) / mean) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use glam::Vec3;

    #[test]
    fn dark_pixels_count_more() {
        let pixels = (0..32 * 16).map(|pixel| Vec3::splat(if pixel % 32 < 16 { 1.0 } else { 3.0 })).collect();
        let values = expected_values(&Image { width: 32, height: 16, pixels }).expect("there is light");
        let values = over_mean(&values);
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!((mean - 1.0).abs() < 1e-4, "{mean}");
        // The floor, a tenth of the mean without the brightest hundredth, adds 2 % to the darker half.
        assert!((values[28] / values[3] / (3f32.hypot(0.198) / 1f32.hypot(0.198)) - 1.0).abs() < 1e-3);
        assert_eq!(expected_values(&Image { width: 4, height: 4, pixels: vec![Vec3::ZERO; 16] }), None);
    }

    /// Where one path in forty finds light, 5 × 5 pixels mostly have found none. Where all do, a step stays one.
    #[test]
    fn rare_light_is_looked_for_farther_away() {
        let mut random = Random::new(3, 0, 0);
        let mut rare = || if random.below(40) == 0 { Vec3::splat(40.0) } else { Vec3::ZERO };
        let image = Image { width: 120, height: 100, pixels: (0..12_000).map(|_| rare()).collect() };
        let spread = |values: Vec<f32>| {
            let off = values.iter().filter(|value| !(0.5..2.0).contains(*value)).count();
            off as f64 / values.len() as f64
        };
        let (steady, plain) = (steady_values(&image).expect("there is light"), expected_values(&image));
        // Squares with at least eight of about Poisson's law: off by more than a half with a probability of a tenth and less.
        assert!(spread(steady) < 0.1);
        assert!(plain.is_none_or(|plain| spread(plain) > 0.9));
        let step = |i: usize| Vec3::splat(if i % 120 < 60 { 1.0 } else { 5.0 });
        let values =
            steady_values(&Image { pixels: (0..12_000).map(step).collect(), ..image }).expect("there is light");
        // The floor is a tenth of the mean without the brightest hundredth.
        let floor = 0.1 * (3.0 * 12_000.0 - 5.0 * 120.0) / 11_880.0;
        for (value, lit) in [(values[57], 1f32), (values[62], 5.0)] {
            assert!((value - lit.hypot(floor)).abs() < 1e-4, "{value} {lit}");
        }
        assert_eq!(steady_values(&Image { width: 20, height: 10, pixels: vec![Vec3::ZERO; 200] }), None);
    }

    /// Its square would round those of all others away, in every window below it and to its right.
    #[test]
    fn a_firefly_changes_no_steady_value_far_from_it() {
        let step = |i: usize| Vec3::splat(if i % 120 < 60 { 1.0 } else { 5.0 });
        let mut image = Image { width: 120, height: 100, pixels: (0..12_000).map(step).collect() };
        let plain = steady_values(&image).expect("there is light");
        image.pixels[0] = Vec3::splat(1e9);
        let burnt = steady_values(&image).expect("there is light");
        // That the firefly is among the brightest hundredth changes the floor, by a tenth of 4 over 11,880.
        let (near, far): (Vec<usize>, Vec<usize>) = (0..12_000).partition(|i| i % 120 < 3 && i / 120 < 3);
        assert!(far.iter().all(|&i| (burnt[i] - plain[i]).abs() < 1e-4));
        assert!(near.iter().all(|&i| burnt[i] > 1e4));
    }

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
