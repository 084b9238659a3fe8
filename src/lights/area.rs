//! Emitting surfaces.

use std::f32::consts::PI;

use glam::Vec3;

use super::bounds::{Cone, LightBounds};
pub use super::glow::MOST_PIECES;
use super::glow::{self, Glow};

use super::{Emission, LightSample, LightSamples};
use crate::geometry::sphere::{Sphere, Spheres};
use crate::geometry::{Geometry, Ray, Shape, Surface};
use crate::math::error_bound::{gamma, offset_origin};
use crate::math::lanes::{Mask, Real, V3, by_lane};
use crate::math::{Frame, channel_mean};
use crate::picture::texture::Texture;
use crate::sampling::discrete::Discrete;
use crate::sampling::warp;

/// A shape whose front emits the same radiance in every direction.
#[derive(Debug, Clone)]
pub struct AreaLight {
    shape: Shape,
    radiance: Vec3,
    /// Distribution over `placed`.
    triangles: Discrete,
    /// Of the whole shape; of an even light of the same power, where the radiance varies.
    area: f32,
    /// What of a mesh is drawn, in world coordinates: its triangles, or their pieces where the radiance varies; empty for a sphere.
    placed: Vec<Placed>,
    /// How the radiance varies.
    glow: Option<Box<Glow>>,
    /// Emitted power π·∫L dA, W.
    power: Vec3,
}

/// A triangle that emits: its corners, and the unit normal on the emitting side.
type Placed = [Vec3; 4];

impl AreaLight {
    /// The emitting `shape` with `radiance` in W·m⁻²·sr⁻¹.
    pub fn new(shape: Shape, radiance: Vec3) -> Self {
        let triangles = shape.area_distribution();
        let area = triangles.total() as f32;
        let power = radiance * (PI * area);
        let count = if let Geometry::Mesh { mesh, .. } = &shape.geometry { mesh.triangles.len() as u32 } else { 0 };
        let placed = (0..count).map(|index| {
            let [a, b, c] = shape.triangle(index);
            [a, b, c, normal(&shape, index)]
        });
        let placed = placed.collect();
        Self { shape, radiance, triangles, area, placed, glow: None, power }
    }

    /// The emitting `shape` with `radiance` times `texture`, W·m⁻²·sr⁻¹.
    pub fn textured(shape: Shape, radiance: Vec3, texture: Texture) -> Self {
        Self::textured_within(shape, radiance, texture, MOST_PIECES)
    }

    /// As [`AreaLight::textured`], with another number of pieces than [`MOST_PIECES`].
    pub fn textured_within(shape: Shape, radiance: Vec3, texture: Texture, pieces: usize) -> Self {
        if let Texture::Constant(color) = texture {
            return Self::new(shape, radiance * color);
        }
        let Geometry::Mesh { mesh, .. } = &shape.geometry else {
            let glow = Glow::of_sphere(texture);
            let even = Self::new(shape, radiance);
            let read = even.power * glow.mean_on_sphere();
            // Points may miss the few pixels that shine, and what has no power is never chosen.
            let power = if read == Vec3::ZERO { even.power * glow.mean_of_texture() } else { read };
            return Self { power, glow: Some(Box::new(glow)), ..even };
        };
        let (glow, cut) = Glow::of_mesh(texture, radiance, &shape, mesh.triangles.len() as u32, pieces);
        let placed =
            cut.corners.iter().zip(&cut.triangles).map(|([a, b, c], index)| [*a, *b, *c, normal(&shape, *index)]);
        let placed = placed.collect();
        let power = cut.integral * PI;
        let area = cut.pieces.total() as f32;
        Self { shape, radiance, triangles: cut.pieces, area, placed, glow: Some(Box::new(glow)), power }
    }

    /// Radiance that leaves the surface point towards the unit direction `out`.
    pub fn emitted(&self, surface: &Surface, out: Vec3) -> Vec3 {
        let is_front = surface.normal.dot(out) > 0.0;
        match &self.glow {
            _ if !is_front => Vec3::ZERO,
            None => self.radiance,
            Some(glow) => self.radiance * glow.at(surface.uv),
        }
    }

    /// Density with which [`AreaLight::sample`] from `point` chooses the direction of `surface`, w.r.t. solid angle.
    pub fn pdf(&self, point: Vec3, surface: &Surface) -> f32 {
        match &self.shape.geometry {
            // Zero where `sample` refuses: a point of the sphere itself may lie on its dark side by rounding.
            Geometry::Sphere(sphere) if self.faces(sphere, point) => sphere.direction_pdf(point),
            Geometry::Sphere(_) => 0.0,
            Geometry::Mesh { .. } => {
                let to = surface.point - point;
                let squared = to.length_squared();
                let cos = surface.normal.dot(to).abs() / squared.sqrt();
                let area = self.glow.as_ref().map_or(self.area, |glow| glow.area(surface.uv));
                squared / (cos * area)
            }
        }
    }

    /// A direction towards the emitting side, uniform over the area of a mesh (where its radiance varies, in proportion to about that)
    /// or the visible cap of a sphere.
    #[inline(always)]
    pub fn sample(&self, point: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let point = V3::from(point);
        let samples =
            if self.is_sphere() { sample_spheres(|_| self, point, u) } else { sample_meshes(|_| self, point, u) };
        LightSamples { delta: self.shape.unseen, ..samples }.one()
    }

    /// Whether no ray meets the surface.
    pub(super) fn is_unseen(&self) -> bool {
        self.shape.unseen
    }

    /// Whether the surface is a sphere, otherwise a mesh.
    #[inline(always)]
    pub(super) fn is_sphere(&self) -> bool {
        matches!(self.shape.geometry, Geometry::Sphere(_))
    }

    /// Whether the emitting side of a sphere is towards `point`.
    fn faces(&self, sphere: &Sphere, point: Vec3) -> bool {
        inside(&(*sphere).into(), point.into()) == self.shape.flip_normals
    }

    /// Samples a point; returns it with its front normal and error bound, and with π times its radiance over the density per area.
    #[inline(always)]
    fn sample_point(&self, u: [f32; 2]) -> (Vec3, Vec3, Vec3, Vec3) {
        match &self.shape.geometry {
            Geometry::Sphere(sphere) => {
                let sign = if self.shape.flip_normals { -1.0 } else { 1.0 };
                let normal = warp::square_to_sphere(u);
                let error = gamma(6) * (sphere.center.abs() + Vec3::splat(sphere.radius));
                let radiance =
                    glow::on_sphere(self.glow.as_deref(), &self.shape, normal.to_array(), self.radiance.into());
                let power = Vec3::from_array(radiance) * (PI * self.area);
                (sphere.center + normal * sphere.radius, normal * sign, error, power)
            }
            Geometry::Mesh { .. } => {
                let (triangle, inside) = self.triangles.sample(f64::from(u[0]));
                let [a, b, c, normal] = self.placed[triangle];
                let parts = parts([a, b, c].map(V3::from), [inside as f32, u[1]]).map(Vec3::from);
                let error = self.shape.error(parts[0].abs() + parts[1].abs() + parts[2].abs());
                let power = match &self.glow {
                    None => self.power,
                    Some(glow) => {
                        let (factor, area) = glow.drawn(triangle, [inside as f32, u[1]]);
                        self.radiance * factor * (PI * area)
                    }
                };
                (parts[0] + parts[1] + parts[2], normal, error, power)
            }
        }
    }

    /// Samples a photon: over the area as [`AreaLight::sample`] does, cosine-distributed.
    pub fn emit(&self, u: [f32; 2], v: [f32; 2]) -> Option<Emission> {
        let (point, normal, error, power) = self.sample_point(u);
        let direction = Frame::new(normal).to_world(warp::square_to_cosine_hemisphere(v));
        let origin = offset_origin(point, error, normal, direction);
        Some(Emission { ray: Ray { origin, direction }, power, normal })
    }

    /// Box around the light, cone of the normals of its emitting side, and intensity.
    pub(super) fn bounds(&self) -> LightBounds {
        let Geometry::Mesh { mesh, winding, .. } = &self.shape.geometry else {
            let Geometry::Sphere(sphere) = &self.shape.geometry else { unreachable!("a shape is a mesh or a sphere") };
            let radius = Vec3::splat(sphere.radius);
            let intensity = channel_mean(self.power()) / (4.0 * PI);
            return LightBounds {
                low: sphere.center - radius,
                high: sphere.center + radius,
                cone: Cone::ALL,
                intensity,
            };
        };
        let sign = if self.shape.flip_normals { -1.0 } else { 1.0 } * winding;
        let (mut low, mut high, mut cone) = (Vec3::INFINITY, Vec3::NEG_INFINITY, None::<Cone>);
        for index in 0..mesh.triangles.len() as u32 {
            let [a, b, c] = self.shape.triangle(index);
            (low, high) = (low.min(a).min(b).min(c), high.max(a).max(b).max(c));
            if let Some(normal) = (b - a).cross(c - a).try_normalize() {
                let own = Cone::new(normal * sign, 0.0);
                cone = Some(cone.map_or(own, |cone| cone.union(own)));
            }
        }
        LightBounds { low, high, cone: cone.unwrap_or(Cone::ALL), intensity: channel_mean(self.power()) / PI }
    }

    /// Emitted power π·∫L dA, W.
    pub fn power(&self) -> Vec3 {
        self.power
    }
}

/// The unit normal of a triangle on the emitting side.
fn normal(shape: &Shape, triangle: u32) -> Vec3 {
    let Geometry::Mesh { winding, .. } = &shape.geometry else { return Vec3::Z };
    let sign = if shape.flip_normals { -1.0 } else { 1.0 } * winding;
    let [a, b, c] = shape.triangle(triangle);
    (b - a).cross(c - a).normalize_or(Vec3::Z) * sign
}

/// The parts of the corners of a uniform point of each triangle; it is their sum.
#[inline(always)]
fn parts<R: Real>([a, b, c]: [V3<R>; 3], u: [R; 2]) -> [V3<R>; 3] {
    let [b1, b2] = warp::lanes::square_to_triangle(u);
    [a * (b1.rest() - b2), b * b1, c * b2]
}

/// Which points are inside of spheres.
#[inline(always)]
fn inside<R: Real>(sphere: &Spheres<R>, point: V3<R>) -> R::Mask {
    (point - sphere.center).length_squared().lt(sphere.radius.squared())
}

/// Samples the meshes `light` of each lane, see [`AreaLight::sample`].
#[inline(always)]
pub(super) fn sample_meshes<'a, R: Real>(
    light: impl Fn(usize) -> &'a AreaLight,
    point: V3<R>,
    u: [R; 2],
) -> LightSamples<R> {
    let [ax, ay, az, bx, by, bz, cx, cy, cz, nx, ny, nz, r, g, b, area, inside] = by_lane!(u, |lane, u| {
        let AreaLight { triangles, area, placed, radiance, glow, .. } = light(lane);
        let (triangle, inside) = triangles.sample(f64::from(u[0]));
        let inside = inside as f32;
        let (radiance, area) = match glow {
            None => (*radiance, *area),
            Some(glow) => {
                let (factor, area) = glow.drawn(triangle, [inside, u[1]]);
                (*radiance * factor, area)
            }
        };
        let mut row = [0.0; 17];
        row[..12].copy_from_slice(bytemuck::cast_slice(&placed[triangle]));
        row[12..].copy_from_slice(&[radiance.x, radiance.y, radiance.z, area, inside]);
        row
    });
    let [a_part, b_part, c_part] =
        parts([V3::new(ax, ay, az), V3::new(bx, by, bz), V3::new(cx, cy, cz)], [inside, u[1]]);
    let to = a_part + b_part + c_part - point;
    let squared = to.length_squared();
    let distance = squared.sqrt();
    let wi = to / distance;
    let cos = -V3::new(nx, ny, nz).dot(wi);
    LightSamples {
        wi,
        distance,
        radiance: V3::new(r, g, b),
        pdf: squared / (cos * area),
        delta: cos.lt(cos),
        found: cos.above(0.0) & wi.is_finite(),
    }
}

/// Samples the spheres `light` of each lane, see [`AreaLight::sample`].
#[inline(always)]
pub(super) fn sample_spheres<'a, R: Real>(
    light: impl Fn(usize) -> &'a AreaLight,
    point: V3<R>,
    u: [R; 2],
) -> LightSamples<R> {
    let [x, y, z, radius, flipped, r, g, b, glows] = by_lane!([u[0]], |lane, _| {
        let AreaLight { shape, radiance, glow, .. } = light(lane);
        match shape.geometry {
            Geometry::Sphere(Sphere { center, radius }) => {
                let [flipped, glows] = [f32::from(u8::from(shape.flip_normals)), f32::from(u8::from(glow.is_some()))];
                [center.x, center.y, center.z, radius, flipped, radiance.x, radiance.y, radiance.z, glows]
            }
            _ => [0.0; 9],
        }
    });
    let sphere = Spheres { center: V3::new(x, y, z), radius };
    let (wi, pdf) = sphere.sample_direction(point, u);
    let (distance, hit) = sphere.intersect(point, wi, wi.x.all(f32::INFINITY));
    // A direction on the rim may miss by rounding: then the nearest point of the line to the centre serves.
    let distance = hit.choose(distance, (sphere.center - point).dot(wi));
    let (inside, flipped) = (inside(&sphere, point), flipped.above(0.0));
    let mut radiance = V3::new(r, g, b);
    if glows.above(0.0).any() {
        let outward = point + wi * distance - sphere.center;
        let [r, g, b] = by_lane!([outward.x, outward.y, outward.z, r, g, b], |lane, [x, y, z, r, g, b]| {
            let AreaLight { shape, glow, .. } = light(lane);
            glow::on_sphere(glow.as_deref(), shape, [x, y, z], V3::new(r, g, b))
        });
        radiance = V3::new(r, g, b);
    }
    LightSamples {
        wi,
        distance,
        radiance,
        pdf,
        delta: pdf.lt(pdf),
        found: (inside & flipped | !inside & !flipped) & distance.above(0.0),
    }
}
