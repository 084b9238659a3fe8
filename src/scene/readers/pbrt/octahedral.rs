//! pbrt-v4's environment maps: squares whose pixels are equally large on the sphere (Clarberg 2008), turned into our latitudes and
//! longitudes.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::picture::Image;

/// Samples along each side of a pixel.
const SAMPLES: usize = 2;
/// Most rows of what becomes of a square, but for the last.
const MOST_ROWS: usize = 4096;

/// The picture in latitudes and longitudes, z up: the column angle is atan2(y, x), the row angle is that from +z. Twice as wide as the
/// square, which keeps its resolution. The picture must be square and have pixels.
pub fn to_lat_long(square: &Image) -> Image {
    let rows = square.width.clamp(2, MOST_ROWS);
    let (width, height) = (2 * rows, rows + 1);
    let pixel = |index: usize| {
        let (x, y) = (index % width, index / width);
        let mut sum = Vec3::ZERO;
        for sample in 0..SAMPLES * SAMPLES {
            let offset = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
            // Rows lie on latitudes, the first and the last on the poles.
            let theta = PI * (y as f64 + offset(sample / SAMPLES) - 0.5).clamp(0.0, rows as f64) / rows as f64;
            let phi = TAU * (x as f64 + offset(sample % SAMPLES)) / width as f64;
            let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
            sum += lookup(square, position(DVec3::new(sin * cos_phi, sin * sin_phi, cos)));
        }
        sum / (SAMPLES * SAMPLES) as f32
    };
    let pixels = (0..width * height).into_par_iter().map(pixel).collect();
    Image { width, height, pixels }
}

/// Place in the unit square of a unit direction.
fn position(direction: DVec3) -> DVec2 {
    let (x, y) = (direction.x.abs(), direction.y.abs());
    let r = (1.0 - direction.z.abs()).max(0.0).sqrt();
    // The quadrant's angle becomes the place along the diagonal at distance r from the pole.
    let v = if x == 0.0 && y == 0.0 { 0.0 } else { r * y.atan2(x) / (2.0 * FRAC_PI_4) };
    let inner = DVec2::new(r - v, v);
    // The lower hemisphere is folded outwards over the diagonal.
    let folded = if direction.z < 0.0 { DVec2::new(1.0 - inner.y, 1.0 - inner.x) } else { inner };
    let signed = DVec2::new(folded.x.copysign(direction.x), folded.y.copysign(direction.y));
    (signed + 1.0) / 2.0
}

/// The picture at a place of the unit square, bilinearly.
fn lookup(image: &Image, at: DVec2) -> Vec3 {
    let scaled = at * DVec2::new(image.width as f64, image.height as f64) - 0.5;
    let corner = scaled.floor();
    let part = (scaled - corner).as_vec2();
    let (x, y) = (corner.x as i64, corner.y as i64);
    let read = |x: i64, y: i64| {
        let [x, y] = around([x, y], [image.width as i64, image.height as i64]);
        image.pixels[y * image.width + x]
    };
    let top = read(x, y).lerp(read(x + 1, y), part.x);
    let bottom = read(x, y + 1).lerp(read(x + 1, y + 1), part.x);
    top.lerp(bottom, part.y)
}

/// The pixel that is next to the picture's edge on the sphere: edges are folded onto themselves about their middles.
fn around([mut x, mut y]: [i64; 2], [width, height]: [i64; 2]) -> [usize; 2] {
    if !(0..width).contains(&x) {
        x = if x < 0 { -1 - x } else { 2 * width - 1 - x };
        y = height - 1 - y;
    }
    if !(0..height).contains(&y) {
        y = if y < 0 { -1 - y } else { 2 * height - 1 - y };
        x = width - 1 - x;
    }
    [x.clamp(0, width - 1) as usize, y.clamp(0, height - 1) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The inverse map of Clarberg 2008.
    fn direction(at: DVec2) -> DVec3 {
        let signed = at * 2.0 - 1.0;
        let (u, v) = (signed.x.abs(), signed.y.abs());
        let distance = 1.0 - u - v;
        let r = 1.0 - distance.abs();
        let phi = if r == 0.0 { 0.0 } else { ((v - u) / r + 1.0) * FRAC_PI_4 };
        let (sin, cos) = phi.sin_cos();
        let around = r * (2.0 - r * r).sqrt();
        let z = (1.0 - r * r).copysign(distance);
        DVec3::new((around * cos).copysign(signed.x), (around * sin).copysign(signed.y), z)
    }

    #[test]
    fn the_map_and_its_inverse() {
        for i in 0..40 {
            for j in 0..40 {
                let at = (DVec2::new(f64::from(i), f64::from(j)) + 0.5) / 40.0;
                let back = position(direction(at));
                assert!(back.distance(at) < 1e-9, "{at} {back}");
            }
        }
    }

    /// A smooth function of the direction stays the same where the square has seams, too.
    #[test]
    fn a_smooth_sky_stays_what_it_is() {
        const SIDE: usize = 64;
        let sky = |d: DVec3| (DVec3::splat(2.0) + d).as_vec3();
        let pixel = |i: usize| sky(direction((DVec2::new((i % SIDE) as f64, (i / SIDE) as f64) + 0.5) / SIDE as f64));
        let square = Image { width: SIDE, height: SIDE, pixels: (0..SIDE * SIDE).map(pixel).collect() };
        let image = to_lat_long(&square);
        assert_eq!([image.width, image.height], [128, 65]);
        for (i, pixel) in image.pixels.iter().enumerate() {
            let theta = PI * (i / image.width) as f64 / 64.0;
            let phi = TAU * ((i % image.width) as f64 + 0.5) / 128.0;
            let expected = sky(DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
            assert!(pixel.distance(expected) < 0.03, "{i}: {pixel} {expected}");
        }
    }
}
