//! A latitude-longitude picture around the scene.
//!
//! Mitsuba's convention: with the direction in the light's frame, u = atan2(x, −z)/2π and v = acos(y)/π. Texel centres lie
//! at u = (i + ½)/W, wrapping around, and at v = j/(H − 1); between them radiance is bilinear.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::distant::{cross_section, ray_through};
use super::{BoundingSphere, Emission, LightSample};
use crate::base::processor::prefetch;
use crate::math::channel_mean;
use crate::picture::Image;
use crate::sampling::grid::Grid;

/// An environment map.
#[derive(Debug, Clone)]
pub struct Envmap {
    image: Arc<Image>,
    /// Part of the polar angle from zenith to nadir that the rows cover; there is no light below.
    span: f64,
    scale: f32,
    to_world: Mat3,
    to_local: Mat3,
    grid: Arc<Grid>,
    mean: Vec3,
}

/// Position of a direction in the picture.
struct Position {
    /// Grid coordinates in [0, 1)²: u shifted by half a texel, so that grid cells lie between texel centres.
    grid: [f64; 2],
    /// Sine of the angle to the poles.
    sin: f32,
}

impl Envmap {
    /// An environment of the picture times `scale`, turned by the rotation `to_world`. The picture has at least 1×1 pixels. Ten to
    /// twelve bytes per pixel are kept beside it.
    pub fn new(image: Arc<Image>, scale: f32, to_world: Mat3) -> Self {
        Self::spanning(1.0, image, scale, to_world)
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
        Self::spanning(lowest / std::f64::consts::PI, Arc::new(Image { width, height, pixels }), scale, to_world)
    }

    fn spanning(span: f64, image: Arc<Image>, scale: f32, to_world: Mat3) -> Self {
        let (width, rows) = (image.width, (image.height - 1).max(1));
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
        Self {
            mean: mean.as_vec3() * scale,
            image,
            span,
            scale,
            to_world,
            to_local: to_world.transpose(),
            grid: Arc::new(grid),
        }
    }

    /// Position of the direction `wi` in the picture; none below it.
    fn position(&self, wi: Vec3) -> Option<Position> {
        let d = self.to_local * wi;
        let u = f64::from(d.x.atan2(-d.z) / TAU) - 0.5 / self.image.width as f64;
        let v = f64::from(d.y.clamp(-1.0, 1.0).acos() / PI) / self.span;
        if v > 1.0 && self.span < 1.0 {
            return None;
        }
        Some(Position {
            grid: [(u - u.floor()).min(1.0 - f64::EPSILON), v.clamp(0.0, 1.0 - f64::EPSILON)],
            sin: (1.0 - d.y.powi(2)).max(0.0).sqrt(),
        })
    }

    /// Brings near what [`Envmap::sample`] reads for points.
    pub fn prefetch_samples<const N: usize>(&self, points: &[[f32; 2]; N]) {
        self.grid.cells(&points.map(|u| u.map(f64::from))).iter().for_each(|&cell| self.prefetch_texels(cell));
    }

    /// Brings near what [`Envmap::radiance_and_pdf`] reads for the direction `wi`.
    pub fn prefetch(&self, wi: Vec3) {
        let Some(position) = self.position(wi) else { return };
        let ([x, y], _) = self.texel(&position);
        self.prefetch_texels([x, y]);
        self.grid.prefetch(position.grid);
    }

    fn prefetch_texels(&self, [x, y]: [usize; 2]) {
        for row in [y, y + 1].map(|y| row(&self.image, y)) {
            row.get(x).into_iter().for_each(prefetch);
        }
    }

    /// The upper left one of the four texels around a position, and where between them it lies.
    #[inline(always)]
    fn texel(&self, position: &Position) -> ([usize; 2], [f32; 2]) {
        let (width, height) = (self.image.width, self.image.height);
        let [u, v] = position.grid;
        let (x, y) = (u * width as f64, v * (height - 1) as f64);
        let (x0, y0) = ((x as usize).min(width - 1), y as usize);
        ([x0, y0], [(x - x0 as f64) as f32, (y - y0 as f64) as f32])
    }

    fn radiance_at(&self, position: &Position) -> Vec3 {
        let width = self.image.width;
        let ([x0, y0], [fx, fy]) = self.texel(position);
        let x1 = if x0 + 1 < width { x0 + 1 } else { 0 };
        let [top, bottom] = [y0, y0 + 1].map(|y| {
            let row = row(&self.image, y);
            row[x0].lerp(row[x1], fx)
        });
        top.lerp(bottom, fy) * self.scale
    }

    fn pdf_at(&self, position: &Position) -> f32 {
        if position.sin <= 0.0 {
            return 0.0;
        }
        let area = 2.0 * std::f64::consts::PI.powi(2) * self.span * f64::from(position.sin);
        (self.grid.pdf(position.grid) / area) as f32
    }

    /// Radiance from direction `wi`.
    pub fn radiance(&self, wi: Vec3) -> Vec3 {
        self.position(wi).map_or(Vec3::ZERO, |position| self.radiance_at(&position))
    }

    /// Density of [`Envmap::sample`] w.r.t. solid angle.
    pub fn pdf(&self, wi: Vec3) -> f32 {
        self.position(wi).map_or(0.0, |position| self.pdf_at(&position))
    }

    /// [`Envmap::radiance`] and [`Envmap::pdf`], in less time than both take.
    pub fn radiance_and_pdf(&self, wi: Vec3) -> (Vec3, f32) {
        let Some(position) = self.position(wi) else { return (Vec3::ZERO, 0.0) };
        (self.radiance_at(&position), self.pdf_at(&position))
    }

    /// Samples a direction in proportion to radiance.
    pub fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let ([x, y], _) = self.grid.sample(u.map(f64::from));
        let phi = std::f64::consts::TAU * (x + 0.5 / self.image.width as f64);
        let theta = std::f64::consts::PI * self.span * y;
        let (sin, cos) = theta.sin_cos();
        let local = Vec3::new((sin * phi.sin()) as f32, cos as f32, (-sin * phi.cos()) as f32);
        let wi = self.to_world * local;
        // Looking the density up again keeps it equal to that of `pdf` for the rounded direction.
        let (radiance, pdf) = self.radiance_and_pdf(wi);
        (pdf > 0.0).then_some(LightSample { wi, distance: f32::INFINITY, radiance, pdf, delta: false })
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

/// Texels of row `y`, or of the last row.
fn row(image: &Image, y: usize) -> &[Vec3] {
    &image.pixels[y.min(image.height - 1) * image.width..][..image.width]
}

/// Means of the corners of the grid cells of row `y`.
fn cells(image: &Image, y: usize) -> impl Iterator<Item = Vec3> {
    let (top, bottom) = (row(image, y), row(image, y + 1));
    (0..image.width).map(move |x| {
        let next = if x + 1 < image.width { x + 1 } else { 0 };
        (top[x] + top[next] + bottom[x] + bottom[next]) / 4.0
    })
}
