//! Lights without extent that project a picture: through a perspective, as a camera would take it, or within the cone of a spot.

use std::f32::consts::FRAC_PI_2;

use glam::{Affine3A, Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::bounds::{Cone, LightBounds};
use super::point::{Way, part};

use super::{Emission, LightSamples};
use crate::geometry::Ray;
use crate::math::channel_mean;
use crate::math::lanes::{Real, V3, by_lane};
use crate::picture::texture::Texture;
use crate::sampling::grid::Grid;

/// Least and most cells along each side of the picture, in proportion to whose light photons start.
const LEAST_CELLS: usize = 64;
const MOST_CELLS: usize = 512;
/// Points along each side of a cell at which its light is read.
const POINTS: usize = 2;
/// Light that every cell counts for at least, as a part of the mean: no place that shines may have no density.
const LEAST: f32 = 0.02;

/// How the intensity depends on the angle θ to the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// Not at all.
    Even,
    /// By 1/cos³ θ: a plane across the axis has the same irradiance everywhere.
    Plane,
    /// Full up to the half angle `beam`, then a linear fall-off to `cutoff`, both in radians.
    Cone {
        /// Where there is no light any more.
        cutoff: f32,
        /// Where it is full.
        beam: f32,
    },
}

/// What a projector is made of.
#[derive(Debug, Clone)]
pub struct Lens {
    /// Light to world: it shines from the origin along +z, the picture's left is towards +x and its top towards +y. The length of
    /// the z-axis says nothing.
    pub to_world: Affine3A,
    /// Half of the picture's width and height at a distance of 1 along the axis.
    pub half: Vec2,
    /// Dependence of the intensity on the direction.
    pub profile: Profile,
}

/// A light that projects a picture.
#[derive(Debug, Clone)]
pub struct Projector {
    position: Vec3,
    to_world: Mat3,
    to_local: Mat3,
    half: Vec2,
    profile: Profile,
    /// Factor on the picture, W·sr⁻¹.
    intensity: Vec3,
    picture: Texture,
    /// Distribution of photons over the picture.
    cells: Grid,
    power: Vec3,
    /// Solid angle of the picture.
    solid_angle: f32,
}

/// A place on the picture: the direction in which it is seen, its intensity, and the solid angle of the picture if all of it were there.
struct Place {
    direction: Vec3,
    intensity: Vec3,
    solid_angle: f32,
}

impl Projector {
    /// A light of `intensity` times `picture`, W·sr⁻¹.
    pub fn new(lens: &Lens, intensity: Vec3, picture: Texture) -> Self {
        let matrix = Mat3::from(lens.to_world.matrix3);
        let to_world = matrix * matrix.z_axis.length().recip();
        let mut light = Self {
            position: lens.to_world.translation.into(),
            to_world,
            to_local: to_world.inverse(),
            half: lens.half,
            profile: lens.profile,
            intensity,
            picture,
            cells: Grid::new(1, 1, |_, row| row[0] = 1.0),
            power: Vec3::ZERO,
            solid_angle: 0.0,
        };
        light.distribute();
        light
    }

    /// Integrates over the picture.
    fn distribute(&mut self) {
        let size = if let Texture::Bitmap { image, .. } = &self.picture { image.size() } else { [1, 1] };
        let [width, height] = size.map(cells_along);
        let step = Vec2::new(width as f32, height as f32).recip() / POINTS as f32;
        let cell = |index: usize| {
            let (mut power, mut solid_angle) = (Vec3::ZERO, 0.0);
            for point in 0..POINTS * POINTS {
                let column = index % width * POINTS + point % POINTS;
                let row = index / width * POINTS + point / POINTS;
                let place = self.place(Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * step);
                power += finite(place.intensity * place.solid_angle);
                solid_angle += place.solid_angle;
            }
            (power / (POINTS * POINTS) as f32, solid_angle / (POINTS * POINTS) as f32)
        };
        let count = width * height;
        let cells: Vec<(Vec3, f32)> = (0..count).into_par_iter().map(cell).collect();
        let sum = |of: fn(&(Vec3, f32)) -> f64| (cells.iter().map(of).sum::<f64>() / count as f64) as f32;
        self.power = Vec3::new(sum(|c| c.0.x.into()), sum(|c| c.0.y.into()), sum(|c| c.0.z.into()));
        self.solid_angle = sum(|c| c.1.into());
        let mean = channel_mean(self.power);
        // What is black, or too bright to be added up, is drawn evenly.
        let usable = mean > 0.0 && mean.is_finite();
        let weight = |(power, _): &(Vec3, f32)| if usable { channel_mean(*power) / mean + LEAST } else { 1.0 };
        self.cells = Grid::new(width, height, |row, out| {
            let cells = &cells[row * width..];
            out.iter_mut().zip(cells).for_each(|(out, cell)| *out = weight(cell).into());
        });
    }

    /// What the place `uv` of the picture sends.
    fn place(&self, uv: Vec2) -> Place {
        let local = ((1.0 - 2.0 * uv) * self.half).extend(1.0);
        let way = self.to_world * local;
        let length = way.length();
        let area = 4.0 * self.half.x * self.half.y * self.to_world.determinant().abs();
        let direction = way / length;
        let intensity = self.sent(direction, local / length, uv);
        Place { direction, intensity, solid_angle: area / (length * length * length) }
    }

    /// The intensity through the place `uv` of the picture in a unit direction, which is `local` for the light.
    fn sent(&self, direction: Vec3, local: Vec3, uv: Vec2) -> Vec3 {
        let factor = match self.profile {
            Profile::Even => 1.0,
            Profile::Plane => (local.z * local.z * self.to_world.z_axis.dot(direction)).recip(),
            Profile::Cone { cutoff, beam } => part(local.into(), cutoff, beam),
        };
        finite(self.intensity * self.picture.eval(uv).max(Vec3::ZERO) * factor.max(0.0))
    }

    /// Radiant intensity in a unit direction, W·sr⁻¹; none for what is no direction.
    #[inline(never)]
    fn towards(&self, direction: Vec3) -> Vec3 {
        let local = self.to_local * direction;
        let place = local.truncate() / (self.half * local.z);
        if !(local.z > 0.0 && place.abs().max_element() <= 1.0) {
            return Vec3::ZERO;
        }
        self.sent(direction, local, 0.5 - 0.5 * place)
    }

    /// Samples a photon in proportion to the light of the picture's cells.
    pub fn emit(&self, u: [f32; 2]) -> Option<Emission> {
        let ([u, v], density) = self.cells.sample(u.map(f64::from));
        let Place { direction, intensity, solid_angle } = self.place(Vec2::new(u as f32, v as f32));
        let power = intensity * (solid_angle / density as f32);
        let starts = direction.is_finite() && power.is_finite() && power != Vec3::ZERO;
        starts.then_some(Emission { ray: Ray { origin: self.position, direction }, power, normal: direction })
    }

    /// Position, mean intensity (the greatest may be that of a single pixel), and the cone around the picture.
    pub(super) fn bounds(&self) -> LightBounds {
        let axis = self.to_world.z_axis;
        // The picture is flat, so its corners are the farthest from the axis, as long as all are in front of the light.
        let corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let angles = corners.map(|corner| axis.angle_between(self.place(corner).direction));
        let in_front = angles.iter().all(|angle| *angle < FRAC_PI_2);
        let cone = if in_front { Cone::beam(axis, angles.into_iter().fold(0.0, f32::max)) } else { Cone::ALL };
        // Between the points that were read may be pixels that shine, and what has no intensity is never chosen.
        let read = channel_mean(self.power) / self.solid_angle.max(f32::MIN_POSITIVE);
        let intensity = read.max(LEAST * channel_mean(self.intensity * self.picture.mean().max(Vec3::ZERO)));
        LightBounds { low: self.position, high: self.position, cone, intensity }
    }

    /// Emitted power ∫ I dω.
    pub fn power(&self) -> Vec3 {
        self.power
    }
}

/// Cells along a side with so many pixels: parts of them, or several together where there are too many.
fn cells_along(pixels: usize) -> usize {
    let pixels = pixels.max(1);
    if pixels < LEAST_CELLS { pixels * LEAST_CELLS.div_ceil(pixels) } else { pixels.min(MOST_CELLS) }
}

/// The light, where it can be added up.
fn finite(light: Vec3) -> Vec3 {
    if light.is_finite() { light } else { Vec3::ZERO }
}

/// Samples the projectors `light` of each lane: the only directions towards them.
#[inline(always)]
pub(super) fn sample_projectors<'a, R: Real>(light: impl Fn(usize) -> &'a Projector, point: V3<R>) -> LightSamples<R> {
    let [x, y, z] = by_lane!([point.x], |lane, _| light(lane).position.to_array());
    let way = Way::new(point, V3::new(x, y, z));
    let [r, g, b] =
        by_lane!([way.wi.x, way.wi.y, way.wi.z], |lane, wi| light(lane).towards(-Vec3::from_array(wi)).to_array());
    way.samples(V3::new(r, g, b))
}
