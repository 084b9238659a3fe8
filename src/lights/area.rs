//! Emitting surfaces.

use std::f32::consts::PI;

use glam::Vec3;

use super::tree::{Cone, LightBounds};
use super::{Emission, LightSample};
use crate::geometry::sphere::Sphere;
use crate::geometry::{Geometry, Ray, Shape, Surface};
use crate::math::error_bound::{gamma, offset_origin};
use crate::math::{Frame, channel_mean};
use crate::sampling::discrete::Discrete;
use crate::sampling::warp;

/// A shape whose front emits the same radiance everywhere and in every direction.
#[derive(Debug, Clone)]
pub struct AreaLight {
    shape: Shape,
    radiance: Vec3,
    triangles: Discrete,
    /// The triangles in world coordinates; empty for a sphere.
    placed: Vec<Placed>,
}

/// A triangle that emits.
#[derive(Debug, Clone, Copy)]
struct Placed {
    corners: [Vec3; 3],
    /// Unit normal on the emitting side.
    normal: Vec3,
}

impl AreaLight {
    /// The emitting `shape` with `radiance` in W·m⁻²·sr⁻¹.
    pub fn new(shape: Shape, radiance: Vec3) -> Self {
        let triangles = shape.area_distribution();
        let Geometry::Mesh { mesh, winding, .. } = &shape.geometry else {
            return Self { shape, radiance, triangles, placed: Vec::new() };
        };
        let sign = if shape.flip_normals { -1.0 } else { 1.0 } * winding;
        let placed = (0..mesh.triangles.len() as u32).map(|index| {
            let corners = shape.triangle(index);
            let [a, b, c] = corners;
            Placed { corners, normal: (b - a).cross(c - a).normalize_or(Vec3::Z) * sign }
        });
        let placed = placed.collect();
        Self { shape, radiance, triangles, placed }
    }

    /// Radiance that leaves the surface point towards the unit direction `out`.
    pub fn emitted(&self, surface: &Surface, out: Vec3) -> Vec3 {
        if surface.normal.dot(out) > 0.0 { self.radiance } else { Vec3::ZERO }
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
                squared / (cos * self.triangles.total() as f32)
            }
        }
    }

    /// A direction towards the emitting side, uniform over the area of a mesh or the visible cap of a sphere.
    #[inline(always)]
    pub fn sample(&self, point: Vec3, u: [f32; 2]) -> Option<LightSample> {
        match &self.shape.geometry {
            Geometry::Sphere(sphere) => {
                let (wi, pdf) = sphere.sample_direction(point, u);
                // A direction on the rim may miss by rounding: then the nearest point of the line to the centre serves.
                let distance =
                    sphere.intersect(point, wi, f32::INFINITY).unwrap_or_else(|| (sphere.center - point).dot(wi));
                (self.faces(sphere, point) && distance > 0.0).then_some(LightSample {
                    wi,
                    distance,
                    radiance: self.radiance,
                    pdf,
                    delta: false,
                })
            }
            Geometry::Mesh { .. } => {
                let (target, normal, _) = self.sample_point(u);
                let to = target - point;
                let squared = to.length_squared();
                let distance = squared.sqrt();
                let wi = to / distance;
                let cos = -normal.dot(wi);
                if cos <= 0.0 || !wi.is_finite() {
                    return None;
                }
                let pdf = squared / (cos * self.triangles.total() as f32);
                Some(LightSample { wi, distance, radiance: self.radiance, pdf, delta: false })
            }
        }
    }

    /// Whether the emitting side of a sphere is towards `point`.
    fn faces(&self, sphere: &Sphere, point: Vec3) -> bool {
        let inside = (point - sphere.center).length_squared() < sphere.radius * sphere.radius;
        inside == self.shape.flip_normals
    }

    /// Samples a point uniformly; returns it with its front normal and error bound.
    #[inline(always)]
    fn sample_point(&self, u: [f32; 2]) -> (Vec3, Vec3, Vec3) {
        match &self.shape.geometry {
            Geometry::Sphere(sphere) => {
                let sign = if self.shape.flip_normals { -1.0 } else { 1.0 };
                let normal = warp::square_to_sphere(u);
                let error = gamma(6) * (sphere.center.abs() + Vec3::splat(sphere.radius));
                (sphere.center + normal * sphere.radius, normal * sign, error)
            }
            Geometry::Mesh { .. } => {
                let (triangle, inside) = self.triangles.sample(f64::from(u[0]));
                let Placed { corners: [a, b, c], normal } = self.placed[triangle];
                let [b1, b2] = warp::square_to_triangle([inside as f32, u[1]]);
                let b0 = 1.0 - b1 - b2;
                let error = self.shape.error((a * b0).abs() + (b * b1).abs() + (c * b2).abs());
                (a * b0 + b * b1 + c * b2, normal, error)
            }
        }
    }

    /// Samples a photon: uniform over the area, cosine-distributed.
    pub fn emit(&self, u: [f32; 2], v: [f32; 2]) -> Option<Emission> {
        let (point, normal, error) = self.sample_point(u);
        let direction = Frame::new(normal).to_world(warp::square_to_cosine_hemisphere(v));
        let origin = offset_origin(point, error, normal, direction);
        Some(Emission { ray: Ray { origin, direction }, power: self.power(), normal })
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

    /// Emitted power π·A·L, W.
    pub fn power(&self) -> Vec3 {
        self.radiance * (PI * self.triangles.total() as f32)
    }
}
