//! The point where a ray meets a surface.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec2, Vec3};

use super::Ray;
use super::accel::Hit;
use super::shape::{Geometry, Shape};
use crate::math::Frame;
use crate::math::error_bound::{gamma, offset_origin};

/// A point of a surface with its local geometry.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// World position.
    pub point: Vec3,
    /// Bound of the rounding error of each coordinate.
    pub error: Vec3,
    /// Unit geometric normal on the front side.
    pub normal: Vec3,
    /// Shading frame around the shading normal.
    pub frame: Frame,
    /// The shading normal without bump map.
    pub smooth: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Distance from the ray's origin.
    pub distance: f32,
    /// Index of the shape.
    pub shape: u32,
}

impl Surface {
    /// The surface at `hit` on `shape`.
    #[inline(always)]
    pub fn new(ray: &Ray, hit: &Hit, shape: &Shape) -> Self {
        let sign = if shape.flip_normals { -1.0 } else { 1.0 };
        match &shape.geometry {
            Geometry::Mesh { winding, .. } => Self::on_triangle(hit, shape, sign, *winding),
            Geometry::Sphere(sphere) => {
                // Projecting back onto the sphere removes the error that grows with the distance of the ray's origin.
                let outward = (ray.at(hit.distance) - sphere.center).normalize_or(Vec3::Z);
                let point = sphere.center + outward * sphere.radius;
                let error = gamma(6) * (sphere.center.abs() + Vec3::splat(sphere.radius));
                let normal = outward * sign;
                let uv = super::sphere::Sphere::uv(shape.turn.map_or(outward, |turn| turn * outward));
                let frame = Frame::new(normal);
                Self { point, error, normal, frame, smooth: normal, uv, distance: hit.distance, shape: hit.shape }
            }
        }
    }

    /// A point inside a medium that was reached after `distance` and sends light towards `out`. There is no surface: the normal
    /// is zero, so that a ray leaves from the point itself, and +z of the frame is `out`.
    pub fn in_medium(point: Vec3, distance: f32, out: Vec3) -> Self {
        let (error, normal, uv) = (Vec3::ZERO, Vec3::ZERO, Vec2::ZERO);
        Self { point, error, normal, smooth: normal, frame: Frame::new(out), uv, distance, shape: u32::MAX }
    }

    #[inline(always)]
    fn on_triangle(hit: &Hit, shape: &Shape, sign: f32, winding: f32) -> Self {
        let [a, b, c] = shape.triangle(hit.triangle);
        let [b1, b2] = hit.barycentric;
        let b0 = 1.0 - b1 - b2;
        let point = a * b0 + b * b1 + c * b2;
        let error = shape.error((a * b0).abs() + (b * b1).abs() + (c * b2).abs());
        let normal = winding * sign * (b - a).cross(c - a).normalize_or(Vec3::Z);
        let [ta, tb, tc] = shape.triangle_uvs(hit.triangle);
        let shading = shading_normal(shape, hit, [b0, b1, b2]).map_or(normal, |n| n * sign);
        Self {
            point,
            error,
            normal,
            frame: Frame::new(shading),
            smooth: shading,
            uv: ta * b0 + tb * b1 + tc * b2,
            distance: hit.distance,
            shape: hit.shape,
        }
    }

    /// The shading normal on the side of the unit direction `out`, without bumps, which would spread a surface over all facings of
    /// a guide.
    pub fn normal_towards(&self, out: Vec3) -> Vec3 {
        if self.smooth.dot(out) < 0.0 { -self.smooth } else { self.smooth }
    }

    /// The ray that leaves this point along the unit vector `direction` without hitting the surface again.
    #[inline(always)]
    pub fn leave(&self, direction: Vec3) -> Ray {
        Ray { origin: offset_origin(self.point, self.error, self.normal, direction), direction }
    }

    /// The ray from this point to the one at `distance` in the unit direction `wi`, and its maximum distance. It is aimed from its
    /// offset origin, since at grazing angles the offset would otherwise carry it past the end, and stops short of that by the
    /// rounding of both ends.
    #[inline(always)]
    pub fn towards(&self, wi: Vec3, distance: f32) -> (Ray, f32) {
        let ray = self.leave(wi);
        if distance.is_infinite() {
            return (ray, distance);
        }
        let target = self.point + wi * distance;
        let to = target - ray.origin;
        let length = to.length();
        let rounding = gamma(16) * (self.point.abs() + target.abs()).max_element();
        (Ray { origin: ray.origin, direction: to / length }, length * (1.0 - gamma(256)) - rounding)
    }
}

/// ∂p/∂u and ∂p/∂v in world units at `surface`, the point of `hit` on `shape`; none where the texture coordinates do not span the
/// surface.
pub fn partials(surface: &Surface, hit: &Hit, shape: &Shape) -> Option<[Vec3; 2]> {
    if let Geometry::Sphere(sphere) = &shape.geometry {
        // Derivatives of Sphere::uv's inverse.
        let turn = shape.turn.unwrap_or(Mat3::IDENTITY);
        let out = turn * (surface.point - sphere.center);
        let around = out.truncate().length();
        let meridian = out.truncate().try_normalize()?;
        let down = (meridian * out.z).extend(-around);
        return Some([Vec3::new(-out.y, out.x, 0.0) * TAU, down * PI].map(|partial| turn.transpose() * partial));
    }
    let [a, b, c] = shape.triangle(hit.triangle);
    let [ta, tb, tc] = shape.triangle_uvs(hit.triangle);
    let [(p1, t1), (p2, t2)] = [(b - a, tb - ta), (c - a, tc - ta)];
    let det = t1.perp_dot(t2);
    let partials = [(p1 * t2.y - p2 * t1.y) / det, (p2 * t1.x - p1 * t2.x) / det];
    partials.iter().all(|partial| partial.is_finite()).then_some(partials)
}

fn shading_normal(shape: &Shape, hit: &Hit, weights: [f32; 3]) -> Option<Vec3> {
    let Geometry::Mesh { mesh, normal_to_world, rounding, .. } = &shape.geometry else { return None };
    if mesh.normals.is_empty() {
        return None;
    }
    let vertices = mesh.triangles[hit.triangle as usize];
    let sum: Vec3 = vertices.iter().zip(weights).map(|(&v, w)| mesh.normals[v as usize] * w).sum();
    if rounding.is_none() { sum.try_normalize() } else { (*normal_to_world * sum).try_normalize() }
}
