//! A latitude-longitude picture around the scene.
//!
//! Mitsuba's convention: with the direction in the light's frame, u = atan2(x, −z)/2π and v = acos(y)/π. Texel centres lie
//! at u = (i + ½)/W, wrapping around, and at v = j/(H − 1); between them radiance is bilinear.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::distant::{cross_section, ray_through};
use super::seen::LightView;
use super::{BoundingSphere, Emission, LightSample, LightSamples};
use crate::math::lanes::functions::{atan2, sin_cos};
use crate::math::lanes::{Bits, Mask, Real, V3, by_lane};
use crate::math::{Frames, channel_mean};
use crate::picture::{Image, Texels};
use crate::sampling::grid::Grid;
use crate::sampling::tiles::Tiling;

/// An environment map.
#[derive(Debug, Clone)]
pub struct Envmap {
    image: Texels,
    /// Columns and rows of the picture.
    texels: [usize; 2],
    /// Whether there is nothing below the last row.
    ends: bool,
    /// Columns and rows of the grid.
    size: [f32; 2],
    /// Radians from column to column and from row to row.
    steps: [f32; 2],
    /// Columns and rows per radian.
    per_radian: [f32; 2],
    /// Area of the grid in radians.
    area: f32,
    scale: f32,
    to_world: Mat3,
    to_local: Mat3,
    grid: Arc<Grid>,
    tiling: Arc<Tiling>,
    mean: Vec3,
}

/// Positions of directions in the picture, in lanes.
struct Position<R: Real> {
    /// Column and row of the grid's cell, whole numbers: cells lie between texel centres.
    cell: [R; 2],
    /// Where in the cell the direction is, from 0 to 1.
    inside: [R; 2],
    /// Sine of the angle to the poles.
    sin: R,
    /// Where the picture covers the direction.
    covered: R::Mask,
}

impl Envmap {
    /// An environment of the picture times `scale`, turned by the rotation `to_world`. The picture has at least 1×1 pixels. Ten to
    /// twelve bytes per pixel are kept beside it.
    pub fn new(image: impl Into<Texels>, scale: f32, to_world: Mat3) -> Self {
        Self::spanning(1.0, image.into(), scale, to_world)
    }

    /// An environment of `size` (columns, rows), at least 2×2, sampled from `radiance`: from the zenith, +y of the rotation
    /// `to_world`, to an angle of `lowest` in (0, π] away from it, and black below. `radiance` is asked for world directions.
    pub fn dome(
        [width, height]: [usize; 2],
        lowest: f64,
        scale: f32,
        to_world: Mat3,
        radiance: impl Fn(DVec3) -> Vec3 + Sync,
    ) -> Self {
        let turn = DMat3::from_cols(to_world.x_axis.into(), to_world.y_axis.into(), to_world.z_axis.into());
        let pixel = |index: usize| {
            // The last row stays above the edge by less than single precision resolves.
            let theta = lowest * ((index / width) as f64 / (height - 1) as f64).min(1.0 - 1e-9);
            let phi = std::f64::consts::TAU * ((index % width) as f64 + 0.5) / width as f64;
            let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
            radiance(turn * DVec3::new(sin * sin_phi, cos, -sin * cos_phi))
        };
        let pixels = (0..width * height).into_par_iter().map(pixel).collect();
        let image = Arc::new(Image { width, height, pixels });
        Self::spanning(lowest / std::f64::consts::PI, image.into(), scale, to_world)
    }

    /// The picture covers a part of the polar angle from zenith to nadir; there is no light below.
    fn spanning(span: f64, image: Texels, scale: f32, to_world: Mat3) -> Self {
        let texels @ [width, height] = image.size();
        let rows = (height - 1).max(1);
        // ∫ sin θ over a row of cells; the mean of the corners is zero only where the whole cell is black.
        let row_area = |y: usize| {
            let angle = |row: usize| std::f64::consts::PI * span * row as f64 / rows as f64;
            angle(y).cos() - angle(y + 1).cos()
        };
        let grid = Grid::new(width, rows, |y, weights| {
            let area = row_area(y);
            let cells = weights.iter_mut().zip(cells(&image, y));
            cells.for_each(|(weight, cell)| *weight = f64::from(channel_mean(cell)) * area);
        });
        let mut mean = glam::DVec3::ZERO;
        for y in 0..rows {
            let part = row_area(y) / (2.0 * width as f64);
            cells(&image, y).for_each(|cell| mean += cell.as_dvec3() * part);
        }
        let spanned = [std::f64::consts::TAU, std::f64::consts::PI * span];
        let steps = [spanned[0] / width as f64, spanned[1] / rows as f64];
        Self {
            mean: mean.as_vec3() * scale,
            image,
            texels,
            ends: span < 1.0,
            size: [width as f32, rows as f32],
            steps: steps.map(|step| step as f32),
            per_radian: steps.map(|step| step.recip() as f32),
            area: (spanned[0] * spanned[1]) as f32,
            scale,
            to_world,
            to_local: to_world.transpose(),
            tiling: Arc::new(Tiling::new(&grid)),
            grid: Arc::new(grid),
        }
    }

    /// Positions of the directions `wi`. Both angles come from quotients, which keep their digits everywhere, at the poles too.
    #[inline(always)]
    fn position<R: Real>(&self, wi: V3<R>) -> Position<R> {
        let d = axes(wi.x, &self.to_local).to_world(wi);
        let ([width, rows], [across, down]) = (self.size, self.per_radian);
        let x = atan2(d.x, -d.z) * across - 0.5;
        let x = x.below(0.0).choose(x + width, x);
        let sin = (d.x.squared() + d.z.squared()).sqrt();
        let y = atan2(sin, d.y) * down;
        // A direction that is not a number is covered: its radiance is not one either, and so is noticed.
        let covered = !y.above(if self.ends { rows } else { f32::INFINITY });
        let (x0, y0) = (x.whole().real().at_most(width - 1.0), y.whole().real().at_most(rows - 1.0));
        let below = if self.texels[1] > 1 { (y - y0).at_most(1.0) } else { y.all(0.0) };
        Position { cell: [x0, y0], inside: [x - x0, below], sin, covered }
    }

    #[inline(always)]
    fn prefetch_texels(&self, [x, y]: [usize; 2]) {
        for first in [y, y + 1].map(|y| self.first_of_row(y)) {
            self.image.prefetch(first + x);
            self.image.prefetch(first + x + 1);
        }
    }

    /// Index of the first texel of row `y`, or of the last row.
    #[inline(always)]
    fn first_of_row(&self, y: usize) -> usize {
        let [width, height] = self.texels;
        y.min(height - 1) * width
    }

    /// The four texels around a cell, channel by channel in the order of rows, and the density of the cell.
    #[inline(always)]
    fn read(&self, [x, y]: [usize; 2], lane: usize, sky: &LightView) -> [f32; 13] {
        let next = if x + 1 < self.texels[0] { x + 1 } else { 0 };
        let (top, bottom) = (self.first_of_row(y), self.first_of_row(y + 1));
        let [a, b, c, d] = self.image.pixels([top + x, top + next, bottom + x, bottom + next]);
        let mut density = self.grid.density([x, y]) as f32;
        if let Some(weights) = sky.weights(lane) {
            density *= weights.ratio(self.tiling.tile([x, y]));
        }
        [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z, d.x, d.y, d.z, density]
    }

    /// Radiance from the directions `wi`, and densities of [`Envmap::sample`] w.r.t. solid angle.
    #[inline(always)]
    pub(super) fn seen<R: Real>(&self, wi: V3<R>, sky: &LightView) -> (V3<R>, R) {
        let position = self.position(wi);
        // Lanes wait for memory together; one alone would wait twice.
        if size_of::<R>() > size_of::<f32>() {
            let [] = by_lane!(position.cell, |_, [x, y]| {
                let cell = [x as usize, y as usize];
                self.prefetch_texels(cell);
                self.grid.prefetch(cell);
                []
            });
        }
        self.seen_at(position, sky)
    }

    /// [`Envmap::seen`] at positions.
    #[inline(always)]
    fn seen_at<R: Real>(&self, position: Position<R>, sky: &LightView) -> (V3<R>, R) {
        let Position { cell, inside: [right, below], sin, covered } = position;
        let texels = by_lane!(cell, |lane, [x, y]| self.read([x as usize, y as usize], lane, sky));
        let [ar, ag, ab, br, bg, bb, cr, cg, cb, dr, dg, db, density] = texels;
        let top = mix(V3::new(ar, ag, ab), V3::new(br, bg, bb), right);
        let bottom = mix(V3::new(cr, cg, cb), V3::new(dr, dg, db), right);
        let radiance = mix(top, bottom, below) * V3::splat(right.all(self.scale));
        (radiance.only(covered), (density / (sin * self.area)).only(covered & sin.above(0.0)))
    }

    /// Radiance from direction `wi`.
    pub fn radiance(&self, wi: Vec3) -> Vec3 {
        self.radiance_and_pdf(wi).0
    }

    /// Density of [`Envmap::sample`] w.r.t. solid angle.
    pub fn pdf(&self, wi: Vec3) -> f32 {
        self.radiance_and_pdf(wi).1
    }

    /// [`Envmap::radiance`] and [`Envmap::pdf`], in less time than both take.
    pub fn radiance_and_pdf(&self, wi: Vec3) -> (Vec3, f32) {
        let (radiance, pdf) = self.seen(V3::from(wi), &LightView::PLAIN);
        (radiance.into(), pdf)
    }

    /// The tile that a direction is in.
    pub fn tile(&self, wi: Vec3) -> usize {
        self.tiling.tile(self.position(V3::from(wi)).cell.map(|place| place as usize))
    }

    /// Probabilities with which tiles are chosen where nothing is learned.
    pub fn shares(&self) -> &[f32] {
        self.tiling.shares()
    }

    /// Directions chosen in proportion to radiance.
    #[inline(always)]
    pub(super) fn directions<R: Real>(&self, u: [R; 2], sky: &LightView) -> V3<R> {
        let (cell, [right, below]) = match sky.learned {
            Some(_) => self.tiling.choose(&self.grid, u, |lane| sky.weights(lane)),
            None => self.grid.choose(u),
        };
        let [] = by_lane!(cell, |_, [x, y]| {
            self.prefetch_texels([x as usize, y as usize]);
            []
        });
        let [across, down] = self.steps;
        let (sin_phi, cos_phi) = sin_cos((cell[0] + (right + 0.5)) * across);
        let (sin, cos) = sin_cos((cell[1] + below) * down);
        axes(cos, &self.to_world).to_world(V3::new(sin * sin_phi, cos, -sin * cos_phi))
    }

    /// Samples directions in proportion to radiance.
    #[inline(always)]
    pub(super) fn samples<R: Real>(&self, u: [R; 2], sky: &LightView) -> LightSamples<R> {
        let wi = self.directions(u, sky);
        // Looking the density up again keeps it equal to that of `seen` for the rounded direction.
        let (radiance, pdf) = self.seen_at(self.position(wi), sky);
        LightSamples { found: pdf.above(0.0), ..LightSamples::distant(wi, radiance, pdf) }
    }

    /// Samples a direction in proportion to radiance.
    pub fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        self.samples(u, &LightView::PLAIN).one()
    }

    /// Samples a photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Option<Emission> {
        let LightSample { wi, radiance, pdf, .. } = self.sample(u)?;
        let power = radiance * (cross_section(bounds) / pdf);
        Some(Emission { ray: ray_through(bounds, -wi, v), power, normal: -wi })
    }

    /// Power into the bounding sphere, 4π²r² times the mean radiance.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.mean * (4.0 * PI * cross_section(bounds))
    }
}

/// The columns of a rotation.
#[inline(always)]
fn axes<R: Real>(like: R, rotation: &Mat3) -> Frames<R> {
    Frames::all(like, [rotation.x_axis, rotation.y_axis, rotation.z_axis])
}

/// Between `a` and `b`, by the part `s` of the way.
#[inline(always)]
fn mix<R: Real>(a: V3<R>, b: V3<R>, s: R) -> V3<R> {
    a * s.rest() + b * s
}

/// Means of the corners of the grid cells of row `y`; below the last row it is again.
fn cells(image: &Texels, y: usize) -> impl Iterator<Item = Vec3> {
    let [width, height] = image.size();
    let row = |y: usize| -> Vec<Vec3> {
        let first = y.min(height - 1) * width;
        (first..first + width).map(|index| image.pixels([index])[0]).collect()
    };
    let (top, bottom) = (row(y), row(y + 1));
    (0..width).map(move |x| {
        let next = if x + 1 < width { x + 1 } else { 0 };
        (top[x] + top[next] + bottom[x] + bottom[next]) / 4.0
    })
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::base::random::Random;

    /// Black but for one texel.
    fn sun([width, height]: [usize; 2], [x, y]: [usize; 2], to_world: Mat3) -> Envmap {
        let mut pixels = vec![Vec3::ZERO; width * height];
        pixels[y * width + x] = Vec3::ONE;
        Envmap::new(Arc::new(Image { width, height, pixels }), 1.0, to_world)
    }

    /// A picture of halves lights as the same one of singles does.
    #[test]
    fn halves_light_as_singles_do() {
        let mut random = Random::new(62, 0, 0);
        let pixels = (0..12 * 7).map(|_| {
            let mut number = || half::f16::from_f32(random.range(0.0, 9.0)).to_f32();
            Vec3::new(number(), number(), number())
        });
        let singles = Texels::from(Arc::new(Image { width: 12, height: 7, pixels: pixels.collect() }));
        let halves = singles.clone().compact();
        assert!(matches!(halves, Texels::Half(_)));
        let [singles, halves] = [singles, halves].map(|image| Envmap::new(image, 1.5, Mat3::IDENTITY));
        for _ in 0..1000 {
            let u = random.next_2d();
            let [one, other] = [&singles, &halves].map(|map| map.sample(u).map(|s| (s.wi, s.radiance, s.pdf)));
            assert!(one.is_some() && one == other, "{one:?} {other:?}");
        }
        assert_eq!(singles.mean, halves.mean);
    }

    /// Directions of a sun of one texel, wherever it is in a picture as large as they come, are found where they were chosen, within
    /// 1.5e-6 rad: 0.002 of the width of a texel at the equator of 8192×4096.
    #[test]
    fn directions_are_found_where_they_were_chosen() {
        let mut random = Random::new(61, 0, 0);
        let mut worst = 0.0f64;
        for [width, height] in [[8192, 33], [64, 4097], [8192, 4]] {
            for place in 0..40 {
                let any = [random.below(width as u32) as usize, random.below(height as u32) as usize];
                let [x, y] = match place {
                    0 => [0, 1],
                    1 => [width - 1, height - 2],
                    2 => [any[0], 0],
                    3 => [any[0], height - 1],
                    4 => [0, any[1]],
                    _ => any,
                };
                let axis = Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
                let turn = Quat::from_axis_angle(axis.normalize_or(Vec3::Z), random.range(0.0, 6.0));
                let map = sun([width, height], [x, y], Mat3::from_quat(turn));
                let mut lost = 0;
                for _ in 0..200 {
                    let u = random.next_2d();
                    let (cell, inside) = map.grid.choose(u);
                    let wi = map.directions::<f32>(u, &LightView::PLAIN);
                    let found = map.position(wi);
                    let [across, down] = [0, 1].map(|i| {
                        f64::from(found.cell[i]) + f64::from(found.inside[i])
                            - f64::from(cell[i])
                            - f64::from(inside[i])
                    });
                    // Columns are around.
                    let around = (across + width as f64 / 2.0).rem_euclid(width as f64) - width as f64 / 2.0;
                    let [step, row] = map.steps.map(f64::from);
                    let error = (around * step * f64::from(found.sin)).hypot(down * row);
                    worst = worst.max(error);
                    lost += u32::from(map.sample(u).is_none());
                }
                assert!(lost <= 1, "{lost} of 200 are lost at {x} {y} of {width}×{height}");
            }
        }
        println!("{worst:e}");
        assert!(worst < 1.5e-6, "{worst:e}");
    }
}
