//! Spheres in world coordinates: intersection, and sampling of the visible cap.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use crate::math::Frame;
use crate::sampling::warp;

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, positive.
    pub radius: f32,
}

impl Sphere {
    /// Distance of the first hit in (0, `t_max`), from outside or inside. The discriminant comes from the distance of the
    /// centre to the line, which stays accurate for small and distant spheres (Haines et al. 2019).
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<f32> {
        let a = direction.length_squared();
        let f = origin - self.center;
        let b = -f.dot(direction);
        let discriminant = self.radius * self.radius - (f + direction * (b / a)).length_squared();
        if discriminant < 0.0 {
            return None;
        }
        let c = f.length_squared() - self.radius * self.radius;
        let q = b + (a * discriminant).sqrt().copysign(b);
        let (t0, t1) = (c / q, q / a);
        let (near, far) = if t0 < t1 { (t0, t1) } else { (t1, t0) };
        [near, far].into_iter().find(|&t| t > 0.0 && t < t_max)
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        4.0 * PI * self.radius * self.radius
    }

    /// Texture coordinates (φ/2π, θ/π) of the outward unit normal `n`.
    pub fn uv(n: Vec3) -> Vec2 {
        let turn = n.y.atan2(n.x) / (2.0 * PI);
        Vec2::new(if turn < 0.0 { turn + 1.0 } else { turn }, n.z.clamp(-1.0, 1.0).acos() / PI)
    }

    /// One minus the cosine of the half angle under which the sphere is seen from `point`; none from inside.
    fn cone(&self, point: Vec3) -> Option<f32> {
        let squared = (self.center - point).length_squared();
        let sin2 = self.radius * self.radius / squared;
        // sin²/(1 + cos) keeps the digits that 1 − cos loses for a distant sphere.
        (sin2 < 1.0).then(|| sin2 / (1.0 + (1.0 - sin2).sqrt()))
    }

    /// A direction from `point` to the sphere and its density w.r.t. solid angle: uniform in the visible cone from outside,
    /// uniform over all directions from inside.
    pub fn sample_direction(&self, point: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        match self.cone(point) {
            Some(m) => {
                let frame = Frame::new((self.center - point).normalize());
                (frame.to_world(warp::square_to_cone(u, m)), warp::square_to_cone_pdf(m))
            }
            None => (warp::square_to_sphere(u), warp::square_to_sphere_pdf()),
        }
    }

    /// Density of [`Sphere::sample_direction`] for a direction that hits the sphere, w.r.t. solid angle.
    pub fn direction_pdf(&self, point: Vec3) -> f32 {
        self.cone(point).map_or_else(warp::square_to_sphere_pdf, warp::square_to_cone_pdf)
    }
}
