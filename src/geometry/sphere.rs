//! Spheres in world coordinates: intersection, and sampling of the visible cap.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use crate::math::Frames;
use crate::math::lanes::{Mask, Real, V3};
use crate::sampling::warp::lanes::{square_to_cone, square_to_cone_pdf, square_to_sphere};
use crate::sampling::warp::square_to_sphere_pdf;

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, positive.
    pub radius: f32,
}

impl Sphere {
    /// Distance of the first hit in (0, `t_max`), from outside or inside.
    #[inline(always)]
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<f32> {
        let (distance, hit) = Spheres::from(*self).intersect(origin.into(), direction.into(), t_max);
        hit.then_some(distance)
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

    /// Density of [`Spheres::sample_direction`] for a direction that hits the sphere, w.r.t. solid angle.
    pub fn direction_pdf(&self, point: Vec3) -> f32 {
        Spheres::from(*self).direction_pdf(point.into())
    }
}

/// Spheres in lanes.
#[derive(Debug, Clone, Copy)]
pub struct Spheres<R> {
    /// Centres.
    pub center: V3<R>,
    /// Radii.
    pub radius: R,
}

impl From<Sphere> for Spheres<f32> {
    #[inline(always)]
    fn from(sphere: Sphere) -> Self {
        Self { center: sphere.center.into(), radius: sphere.radius }
    }
}

impl<R: Real> Spheres<R> {
    /// Distance of the first hit in (0, `t_max`), from outside or inside, and where there is one. The discriminant comes from the
    /// distance of the centre to the line, which stays accurate for small and distant spheres (Haines et al. 2019).
    #[inline(always)]
    pub fn intersect(&self, origin: V3<R>, direction: V3<R>, t_max: R) -> (R, R::Mask) {
        let a = direction.length_squared();
        let f = origin - self.center;
        let b = -f.dot(direction);
        let radius_squared = self.radius.squared();
        let discriminant = radius_squared - (f + direction * (b / a)).length_squared();
        let meets = discriminant.ge(b.all(0.0));
        if !meets.any() {
            return (discriminant, meets);
        }
        let c = f.length_squared() - radius_squared;
        let q = b + (a * discriminant).sqrt().with_sign(b);
        let (t0, t1) = (c / q, q / a);
        let first = t0.lt(t1);
        let (near, far) = (first.choose(t0, t1), first.choose(t1, t0));
        let near_counts = near.above(0.0) & near.lt(t_max);
        let far_counts = far.above(0.0) & far.lt(t_max);
        (near_counts.choose(near, far), meets & (near_counts | far_counts))
    }

    /// One minus the cosine of the half angle under which each sphere is seen from its point, and which points are outside.
    #[inline(always)]
    fn cone(&self, point: V3<R>) -> (R, R::Mask) {
        let squared = (self.center - point).length_squared();
        let sin2 = self.radius.squared() / squared;
        // sin²/(1 + cos) keeps the digits that 1 − cos loses for a distant sphere.
        (sin2 / (sin2.rest().sqrt() + 1.0), sin2.below(1.0))
    }

    /// Directions from points to the spheres and their densities w.r.t. solid angle: uniform in the visible cone from outside,
    /// uniform over all directions from inside.
    #[inline(always)]
    pub fn sample_direction(&self, point: V3<R>, u: [R; 2]) -> (V3<R>, R) {
        let (m, outside) = self.cone(point);
        let to_centre = Frames::new((self.center - point).normalize());
        let mut direction = to_centre.to_world(square_to_cone(u, m));
        if (!outside).any() {
            direction = V3::choose(outside, direction, square_to_sphere(u));
        }
        (direction, self.density(m, outside))
    }

    /// Density of [`Spheres::sample_direction`] for directions that hit the spheres, w.r.t. solid angle.
    #[inline(always)]
    pub fn direction_pdf(&self, point: V3<R>) -> R {
        let (m, outside) = self.cone(point);
        self.density(m, outside)
    }

    #[inline(always)]
    fn density(&self, m: R, outside: R::Mask) -> R {
        outside.choose(square_to_cone_pdf(m), m.all(square_to_sphere_pdf()))
    }
}
