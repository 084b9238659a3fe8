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
use crate::materials::image::Image;
use crate::math::channel_mean;
use crate::sampling::grid::Grid;

/// An environment map.
#[derive(Debug, Clone)]
pub struct Envmap {
    image: Arc<Image>,
    /// Part of the way from the zenith to the nadir that the rows cover; there is no light below.
    span: f64,
    scale: f32,
    to_world: Mat3,
    to_local: Mat3,
    grid: Arc<Grid>,
    mean: Vec3,
}

impl Envmap {
    /// The picture times `scale`, turned by the rotation `to_world`. The picture has at least 1×1 pixels.
    pub fn new(image: Arc<Image>, scale: f32, to_world: Mat3) -> Self {
        Self::spanning(1.0, image, scale, to_world)
    }

    /// A picture of `radiance` with `size` (columns, rows), at least 2×2, from the zenith, +y of the rotation `to_world`, to an angle
    /// of `lowest` in (0, π] away from it, and black below. `radiance` is asked for world directions.
    pub fn dome(
        [width, height]: [usize; 2],
        lowest: f64,
        scale: f32,
        to_world: Mat3,
        radiance: impl Fn(DVec3) -> Vec3 + Sync,
    ) -> Self {
        let turn = DMat3::from_cols(to_world.x_axis.into(), to_world.y_axis.into(), to_world.z_axis.into());
        let pixel = |index: usize| {
            // The last row stays above the edge by less than what singles can tell.
            let theta = lowest * ((index / width) as f64 / (height - 1) as f64).min(1.0 - 1e-9);
            let phi = std::f64::consts::TAU * ((index % width) as f64 + 0.5) / width as f64;
            let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
            radiance(turn * DVec3::new(sin * sin_phi, cos, -sin * cos_phi))
        };
        let pixels = (0..width * height).into_par_iter().map(pixel).collect();
        Self::spanning(lowest / std::f64::consts::PI, Arc::new(Image { width, height, pixels }), scale, to_world)
    }

    fn spanning(span: f64, image: Arc<Image>, scale: f32, to_world: Mat3) -> Self {
        let (width, height) = (image.width, image.height);
        let rows = (height - 1).max(1);
        let texel = |x: usize, y: usize| image.pixels[y.min(height - 1) * width + x % width];
        let corners =
            |x: usize, y: usize| (texel(x, y) + texel(x + 1, y) + texel(x, y + 1) + texel(x + 1, y + 1)) / 4.0;
        // ∫ sin θ over a row of cells; the mean of the corners is zero only where the whole cell is black.
        let row_area = |y: usize| {
            let angle = |row: usize| std::f64::consts::PI * span * row as f64 / rows as f64;
            angle(y).cos() - angle(y + 1).cos()
        };
        let grid = Grid::new(width, rows, |x, y| f64::from(channel_mean(corners(x, y))) * row_area(y));
        let mut mean = glam::DVec3::ZERO;
        for y in 0..rows {
            for x in 0..width {
                mean += corners(x, y).as_dvec3() * (row_area(y) / (2.0 * width as f64));
            }
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

    /// Grid coordinates in [0, 1)²: u shifted by half a texel, so that grid cells lie between texel centres. None below the picture.
    fn to_grid(&self, wi: Vec3) -> Option<[f64; 2]> {
        let d = self.to_local * wi;
        let u = f64::from(d.x.atan2(-d.z) / TAU) - 0.5 / self.image.width as f64;
        let v = f64::from(d.y.clamp(-1.0, 1.0).acos() / PI) / self.span;
        if v > 1.0 && self.span < 1.0 {
            return None;
        }
        Some([(u - u.floor()).min(1.0 - f64::EPSILON), v.clamp(0.0, 1.0 - f64::EPSILON)])
    }

    /// Radiance from direction `wi`.
    pub fn radiance(&self, wi: Vec3) -> Vec3 {
        let (width, height) = (self.image.width, self.image.height);
        let Some([u, v]) = self.to_grid(wi) else { return Vec3::ZERO };
        let (x, y) = (u * width as f64, v * (height - 1) as f64);
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let texel = |x: usize, y: usize| self.image.pixels[y.min(height - 1) * width + x % width];
        let top = texel(x0, y0).lerp(texel(x0 + 1, y0), fx);
        let bottom = texel(x0, y0 + 1).lerp(texel(x0 + 1, y0 + 1), fx);
        top.lerp(bottom, fy) * self.scale
    }

    /// Density of [`Envmap::sample`] w.r.t. solid angle.
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let sin = (1.0 - (self.to_local * wi).y.powi(2)).max(0.0).sqrt();
        if sin <= 0.0 {
            return 0.0;
        }
        let Some(place) = self.to_grid(wi) else { return 0.0 };
        (self.grid.pdf(place) / (2.0 * std::f64::consts::PI.powi(2) * self.span * f64::from(sin))) as f32
    }

    fn sample_direction(&self, u: [f32; 2]) -> Option<(Vec3, f32)> {
        let ([x, y], _) = self.grid.sample(u.map(f64::from));
        let phi = std::f64::consts::TAU * (x + 0.5 / self.image.width as f64);
        let theta = std::f64::consts::PI * self.span * y;
        let (sin, cos) = theta.sin_cos();
        let local = Vec3::new((sin * phi.sin()) as f32, cos as f32, (-sin * phi.cos()) as f32);
        let wi = self.to_world * local;
        // Looking the density up again keeps it equal to what `pdf` says for the rounded direction.
        let pdf = self.pdf(wi);
        (pdf > 0.0).then_some((wi, pdf))
    }

    /// A direction by radiance.
    pub fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let (wi, pdf) = self.sample_direction(u)?;
        Some(LightSample { wi, distance: f32::INFINITY, radiance: self.radiance(wi), pdf, delta: false })
    }

    /// A photon through the scene.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Option<Emission> {
        let (wi, pdf) = self.sample_direction(u)?;
        let power = self.radiance(wi) * (cross_section(bounds) / pdf);
        Some(Emission { ray: ray_through(bounds, -wi, v), power, normal: -wi })
    }

    /// 4π²r² times the mean radiance.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        self.mean * (4.0 * PI * cross_section(bounds))
    }
}
