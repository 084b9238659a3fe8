//! Pictures for textures and environments, made from noise: wood, tiles, cloth, stains, normals; skies with clouds, towns at night,
//! studios. All are linear and repeat without a seam, environments around the vertical axis.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::draw::Draw;
use crate::picture::Image;

/// Columns and rows of a texture.
const SIDE: usize = 128;
/// Columns of an environment; half as many rows.
const AROUND: usize = 256;
/// Knots of the noise along each axis.
const KNOTS: usize = 64;

/// Noise on the unit square that goes on periodically.
struct Noise(Vec<f32>);

impl Noise {
    fn new(draw: &mut Draw) -> Self {
        Self((0..KNOTS * KNOTS).map(|_| draw.range(0.0, 1.0)).collect())
    }

    /// Octaves of value noise in [0, 1], the first with so many cells along each axis; each has half the amplitude and twice the
    /// frequency of the one before.
    fn at(&self, uv: Vec2, cells: [usize; 2], octaves: u32) -> f32 {
        let (mut sum, mut most) = (0.0, 0.0);
        for octave in 0..octaves {
            let cells = cells.map(|c| (c << octave).min(KNOTS));
            let amplitude = 0.5f32.powi(octave as i32);
            sum += amplitude * self.octave(uv, cells);
            most += amplitude;
        }
        sum / most
    }

    fn octave(&self, uv: Vec2, cells: [usize; 2]) -> f32 {
        let p = uv * Vec2::new(cells[0] as f32, cells[1] as f32);
        let (corner, f) = (p.floor(), p - p.floor());
        let f = f * f * (3.0 - 2.0 * f);
        let knot = |x: i64, y: i64| {
            let [x, y] = [(corner.x as i64 + x, cells[0]), (corner.y as i64 + y, cells[1])]
                .map(|(at, cells)| at.rem_euclid(cells as i64) as usize);
            self.0[y * KNOTS + x]
        };
        let along = |y: i64| knot(0, y) + (knot(1, y) - knot(0, y)) * f.x;
        along(0) + (along(1) - along(0)) * f.y
    }
}

fn painted(width: usize, height: usize, color: impl Fn(Vec2) -> Vec3) -> Image {
    let uv = |i: usize| Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
    let size = Vec2::new(width as f32, height as f32);
    Image { width, height, pixels: (0..width * height).map(|i| color(uv(i) / size)).collect() }
}

/// A pattern with values in [0, 1]: grain, tiles, stripes of cloth, or stains.
fn pattern(draw: &mut Draw) -> Box<dyn Fn(Vec2) -> f32> {
    let noise = Noise::new(draw);
    let cells = 1 << draw.integer(1, 3);
    let strength = draw.range(0.05, 0.5);
    let waves = draw.integer(2, 16) as f32;
    match draw.integer(0, 3) {
        0 => Box::new(move |uv| {
            let bent = uv.x * waves + 2.0 * strength * noise.at(uv, [cells, 1], 3);
            0.3 * noise.at(uv, [32, 2], 2) + 0.7 * (0.5 + 0.5 * (TAU * bent).sin())
        }),
        1 => Box::new(move |uv| {
            let (rows, wide) = (waves.max(3.0), 0.5 * waves.max(4.0));
            let row = (uv.y * rows).floor();
            let at = Vec2::new(uv.x * wide.floor() + 0.5 * (row % 2.0), uv.y * rows);
            let joint = (at - at.floor()).min(Vec2::ONE - (at - at.floor())).min_element() < 0.06;
            let tile = noise.at((at.floor() + 0.5) / 16.0, [16, 16], 1);
            if joint { 0.0 } else { 0.4 + 0.4 * tile + strength * 0.4 * noise.at(uv, [cells, cells], 3) }
        }),
        2 => Box::new(move |uv| {
            let thread = |x: f32| 0.5 + 0.5 * (TAU * 4.0 * waves * x).sin();
            let stripe = if (uv.x * waves).fract() < 0.4 { 0.5 } else { 0.0 };
            stripe + 0.25 * thread(uv.x) + 0.25 * thread(uv.y)
        }),
        _ => {
            Box::new(move |uv| ((noise.at(uv, [cells, cells], 4) - 0.5) * (1.0 + 6.0 * strength) + 0.5).clamp(0.0, 1.0))
        }
    }
}

/// A picture of two colours in a pattern.
pub fn pigment(draw: &mut Draw) -> Image {
    let pattern = pattern(draw);
    let dark = Vec3::from_array(draw.albedo());
    // Mostly shades of one colour, as of wood and stone.
    let light = if draw.chance(0.7) {
        (dark * draw.range(1.2, 3.0)).min(Vec3::splat(0.9))
    } else {
        Vec3::from_array(draw.albedo())
    };
    painted(SIDE, SIDE, |uv| dark.lerp(light, pattern(uv).clamp(0.0, 1.0)))
}

/// A grey picture of numbers between two of [0.05, 1], such as roughness worn in places.
pub fn numbers(draw: &mut Draw) -> Image {
    let pattern = pattern(draw);
    let [low, high] = [draw.range(0.05, 0.5), draw.range(0.3, 1.0)];
    painted(SIDE, SIDE, |uv| Vec3::splat(low + (high - low) * pattern(uv).clamp(0.0, 1.0)))
}

/// Normals n of a relief, as (n + 1)/2.
pub fn normals(draw: &mut Draw) -> Image {
    let pattern = pattern(draw);
    let (deep, step) = (draw.log_range(0.003, 0.03), 1.0 / SIDE as f32);
    painted(SIDE, SIDE, |uv| {
        let slope = |by: Vec2| (pattern((uv + by).fract()) - pattern((uv - by + 1.0).fract())) * deep / (2.0 * step);
        let normal = Vec3::new(-slope(Vec2::X * step), -slope(Vec2::Y * step), 1.0);
        0.5 * (normal.normalize_or(Vec3::Z) + 1.0)
    })
}

/// The direction that an environment has at (u, v), +y up (Mitsuba's convention).
fn direction(uv: Vec2) -> Vec3 {
    let ((sin_phi, cos_phi), (sin, cos)) = ((TAU * uv.x).sin_cos(), (PI * uv.y).sin_cos());
    Vec3::new(sin * sin_phi, cos, -sin * cos_phi)
}

/// A surrounding: a sky in clouds of about the mean radiance 1 but for its sun, a dim town at night, or a studio. A sky has its sun in the
/// direction `sun`.
pub fn environment(draw: &mut Draw, sun: Vec3) -> Image {
    match draw.integer(0, 4) {
        0..=2 => sky(draw, sun),
        3 => town(draw),
        _ => studio(draw),
    }
}

/// A gradient from the horizon upwards, clouds, and a sun that is clear, veiled or hidden.
fn sky(draw: &mut Draw, sun: Vec3) -> Image {
    let noise = Noise::new(draw);
    let [horizon, zenith, ground] =
        [draw.range(0.6, 2.0), draw.range(0.2, 1.2), draw.range(0.05, 0.5)].map(|l| l * Vec3::from_array(draw.tint()));
    let (cover, cells) = (draw.range(0.0, 0.7), [4 << draw.integer(0, 2), 4]);
    let (width, glow) = (draw.log_range(0.014, 0.1), draw.log_range(0.1, 3.0));
    // Irradiance of the sun relative to that of the sky, which is about π.
    let disk = if draw.chance(0.7) { draw.log_range(1.0, 30.0) / (width * width) } else { 0.0 };
    painted(AROUND, AROUND / 2, |uv| {
        let towards = direction(uv);
        if towards.y < 0.0 {
            return ground;
        }
        let clear = horizon.lerp(zenith, towards.y.sqrt());
        let cloud = ((noise.at(uv, cells, 4) - 1.0 + cover) / 0.15 + 0.5).clamp(0.0, 1.0);
        let angle = towards.angle_between(sun);
        let near = glow * (-angle / 0.3).exp() + if angle < width { disk } else { 0.0 };
        (clear + near * (1.0 - 0.95 * cloud)).lerp(Vec3::splat(1.2 + near.min(3.0)), 0.7 * cloud)
    })
}

/// Dark houses before a dim sky with a few lit windows. The chance of one is the mean of four numbers of the noise, which is seldom as low as
/// `lit`: about every second town is dark. The models were trained on these; who changes it makes other data.
fn town(draw: &mut Draw) -> Image {
    let noise = Noise::new(draw);
    let (dim, bright) = (draw.log_range(0.01, 0.2), draw.log_range(3.0, 60.0));
    let lit = draw.range(0.02, 0.3);
    let tints = [0; 4].map(|_| Vec3::from_array(draw.tint()));
    painted(AROUND, AROUND / 2, |uv| {
        let height = direction(uv).y;
        let skyline = 0.4 * noise.at(Vec2::new(uv.x, 0.5), [32, 1], 1);
        if height > skyline {
            return tints[0] * dim * (1.0 + 2.0 * (1.0 - height));
        }
        if height < -0.1 {
            return Vec3::splat(0.5 * dim);
        }
        let cell = (uv * Vec2::new(64.0, 32.0)).floor();
        let within = (uv * Vec2::new(64.0, 32.0)).fract();
        let chance = noise.at((cell + 0.5) / 64.0, [64, 64], 1);
        let in_window = within.x > 0.3 && within.y > 0.4;
        let tint = tints[(chance * 4000.0) as usize % 4];
        if chance < lit && in_window { tint * bright } else { Vec3::splat(0.3 * dim) }
    })
}

/// Bright rectangles in a grey room.
fn studio(draw: &mut Draw) -> Image {
    let grey = draw.log_range(0.02, 0.4);
    let boxes: Vec<(Vec3, f32, Vec3)> = (0..draw.integer(1, 5))
        .map(|_| {
            (draw.direction(), draw.log_range(0.08, 0.5), draw.log_range(2.0, 40.0) * Vec3::from_array(draw.tint()))
        })
        .collect();
    painted(AROUND, AROUND / 2, |uv| {
        let towards = direction(uv);
        let inside = |(center, half, _): &&(Vec3, f32, Vec3)| {
            let (across, up) = center.any_orthonormal_pair();
            towards.dot(*center) > 0.0 && towards.dot(across).abs() < *half && towards.dot(up).abs() < *half
        };
        boxes.iter().filter(inside).map(|b| b.2).sum::<Vec3>() + grey * (1.5 + towards.y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_sound_values_and_no_seams() {
        for seed in 0..20 {
            let mut draw = Draw::new(99, seed);
            let [colors, greys, relief] = [pigment(&mut draw), numbers(&mut draw), normals(&mut draw)];
            assert!(
                colors.pixels.iter().chain(&greys.pixels).all(|p| p.min_element() >= 0.0 && p.max_element() <= 1.0)
            );
            for pixel in &relief.pixels {
                let normal = 2.0 * *pixel - 1.0;
                assert!(normal.z > 0.0 && (normal.length() - 1.0).abs() < 1e-4);
            }
            let around = environment(&mut draw, Vec3::new(0.6, 0.8, 0.0));
            assert_eq!((around.width, around.height), (AROUND, AROUND / 2));
            assert!(around.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
            assert!(around.pixels.iter().any(|p| p.max_element() > 0.0));
        }
        let noise = Noise::new(&mut Draw::new(99, 0));
        for (cells, v) in [([4, 4], 0.3), ([32, 2], 0.9)] {
            let [first, last] = [0.0, 1.0 - 1e-6].map(|u| noise.at(Vec2::new(u, v), cells, 3));
            assert!((first - last).abs() < 1e-3);
        }
    }
}
