//! Means of blocks of a picture, whose distribution is near enough to normal to be tested where single pixels' are not.

use fanal::math::channel_mean;
use fanal::picture::Image;

use super::statistics::Summary;

/// Side of a block in pixels.
pub const BLOCK: usize = 16;

/// Per block, over independent pictures.
pub fn summaries(pictures: &[Image]) -> Vec<Summary> {
    let all: Vec<Vec<f64>> = pictures.iter().map(|p| block_means(p, &channel_means(p))).collect();
    (0..all[0].len()).map(|b| Summary::new(&all.iter().map(|p| p[b]).collect::<Vec<_>>())).collect()
}

/// Mean of the channels of each pixel.
pub fn channel_means(image: &Image) -> Vec<f64> {
    image.pixels.iter().map(|p| f64::from(channel_mean(*p))).collect()
}

/// Means of whole blocks and of the narrower ones at the right and the lower edge.
pub fn block_means(image: &Image, values: &[f64]) -> Vec<f64> {
    let (width, height) = (image.width, image.height);
    let mut means = Vec::new();
    for y in (0..height).step_by(BLOCK) {
        for x in (0..width).step_by(BLOCK) {
            let rows = y..(y + BLOCK).min(height);
            let (right, count) = ((x + BLOCK).min(width), (rows.len() * ((x + BLOCK).min(width) - x)) as f64);
            means.push(rows.map(|r| values[r * width + x..r * width + right].iter().sum::<f64>()).sum::<f64>() / count);
        }
    }
    means
}
