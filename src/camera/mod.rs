//! Cameras: perspective with an optional thin lens, and orthographic.

use glam::{Affine3A, Mat3A, Vec3};

use crate::base::random::{Dimension, Random};
use crate::geometry::Ray;
use crate::math::lanes::{Real, V3};
use crate::sampling::warp;

/// A camera at the origin of `to_world`, looking along +z, +x to the left of the picture, +y up.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    to_world: Affine3A,
    /// Half of the picture's sides: at distance 1, or of an orthographic camera at any.
    half: [f32; 2],
    orthographic: bool,
    size: [f32; 2],
    aperture_radius: f32,
    focus_distance: f32,
    /// Offset that is added to pixel coordinates.
    shift: [f32; 2],
    /// Distance along the viewing axis at which rays start.
    near: f32,
}

impl Camera {
    /// A camera with a horizontal field of view of `fov` degrees for a picture of `width` × `height` pixels; radius 0 is a pinhole.
    pub fn new(to_world: Affine3A, fov: f32, [width, height]: [u32; 2], aperture_radius: f32, focus: f32) -> Self {
        let tan = (0.5 * fov.to_radians()).tan();
        let size = [width as f32, height as f32];
        let half = [tan, tan * size[1] / size[0]];
        Self {
            to_world,
            half,
            orthographic: false,
            size,
            aperture_radius,
            focus_distance: focus,
            shift: [0.0; 2],
            near: 0.0,
        }
    }

    /// A camera whose rays are parallel, for a picture of `columns` × `rows` pixels that shows so much `width` of its own space.
    pub fn orthographic(to_world: Affine3A, width: f32, [columns, rows]: [u32; 2]) -> Self {
        let half = [0.5 * width, 0.5 * width * rows as f32 / columns as f32];
        Self { half, orthographic: true, ..Self::new(to_world, 90.0, [columns, rows], 0.0, 1.0) }
    }

    /// The camera with the picture's middle moved off the viewing axis, by parts of its width (to the right) and height (down).
    pub fn shifted(self, [x, y]: [f32; 2]) -> Self {
        Self { shift: [x * self.size[0], y * self.size[1]], ..self }
    }

    /// The camera with rays that start at this distance along the viewing axis: nothing nearer is seen.
    pub fn clipped(self, near: f32) -> Self {
        Self { near, ..self }
    }

    /// World position of the camera.
    pub fn position(&self) -> Vec3 {
        self.to_world.translation.into()
    }

    /// Random numbers for the lens; a pinhole needs none and gets its centre.
    #[inline]
    pub fn lens(&self, random: &Random) -> [f32; 2] {
        if self.has_lens() { random.at(Dimension::LENS).next_2d() } else { [0.5; 2] }
    }

    /// Whether rays start in different places of a lens.
    #[inline]
    pub fn has_lens(&self) -> bool {
        self.aperture_radius > 0.0
    }

    /// The ray through pixel coordinates `film` (columns from the left, rows from the top), and `lens` in [0, 1)².
    pub fn ray(&self, film: [f32; 2], lens: [f32; 2]) -> Ray {
        let (origin, direction) = self.rays(film, lens);
        Ray { origin: origin.into(), direction: direction.into() }
    }

    /// [`Camera::ray`] in lanes: origins, and unit directions.
    #[inline(always)]
    pub(crate) fn rays<R: Real>(&self, film: [R; 2], lens: [R; 2]) -> (V3<R>, V3<R>) {
        let x = ((film[0] + self.shift[0]) * 2.0 / film[0].all(self.size[0])).rest() * self.half[0];
        let y = ((film[1] + self.shift[1]) * 2.0 / film[1].all(self.size[1])).rest() * self.half[1];
        let (zero, one) = (x.all(0.0), x.all(1.0));
        let through = V3::new(x, y, one);
        let (origin, direction) = if self.orthographic {
            (V3::new(x, y, zero), V3::new(zero, zero, one))
        } else if self.has_lens() {
            let ([u, v], radius) = (warp::lanes::square_to_disk(lens), x.all(self.aperture_radius));
            let origin = V3::new(u * radius, v * radius, zero);
            (origin, through * x.all(self.focus_distance) - origin)
        } else {
            (V3::splat(zero), through)
        };
        let origin = if self.near > 0.0 { origin + direction * (x.all(self.near) / direction.z) } else { origin };
        let at = through.all(self.to_world.translation.into());
        (turned(&self.to_world.matrix3, origin) + at, turned(&self.to_world.matrix3, direction).normalize())
    }
}

/// A matrix times a vector.
#[inline(always)]
fn turned<R: Real>(&Mat3A { x_axis, y_axis, z_axis }: &Mat3A, v: V3<R>) -> V3<R> {
    v.all(x_axis.into()) * v.x + v.all(y_axis.into()) * v.y + v.all(z_axis.into()) * v.z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_of_the_picture_is_plus_x() {
        let camera = Camera::new(Affine3A::IDENTITY, 90.0, [200, 100], 0.0, 1.0);
        let ray = camera.ray([0.0, 50.0], [0.5; 2]);
        assert!((ray.direction - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6);
        // A picture moved by half its width begins at the axis.
        let shifted = camera.shifted([0.5, 0.0]).ray([0.0, 50.0], [0.5; 2]);
        assert!((shifted.direction - Vec3::Z).length() < 1e-6);
        let top = camera.ray([100.0, 0.0], [0.5; 2]);
        assert!((top.direction - Vec3::new(0.0, 0.5, 1.0).normalize()).length() < 1e-6);
    }

    #[test]
    fn parallel_rays_are_as_far_apart_as_pixels() {
        let camera = Camera::orthographic(Affine3A::from_scale(Vec3::splat(2.0)), 3.0, [300, 100]);
        let [left, right] = [0.0, 300.0].map(|x| camera.ray([x, 50.0], [0.5; 2]));
        assert!((left.origin - Vec3::X * 3.0).length() < 1e-5 && (right.origin + Vec3::X * 3.0).length() < 1e-5);
        assert!((camera.ray([150.0, 0.0], [0.5; 2]).origin - Vec3::Y).length() < 1e-5);
        assert_eq!([left.direction, right.direction], [Vec3::Z; 2]);
    }

    #[test]
    fn rays_start_at_the_near_plane() {
        for camera in [
            Camera::new(Affine3A::IDENTITY, 60.0, [100, 100], 0.0, 1.0),
            Camera::new(Affine3A::IDENTITY, 60.0, [100, 100], 0.3, 5.0),
            Camera::orthographic(Affine3A::IDENTITY, 3.0, [100, 100]),
        ] {
            let [whole, clipped] = [camera, camera.clipped(2.0)].map(|camera| camera.ray([20.0, 70.0], [0.1, 0.7]));
            assert_eq!(clipped.direction, whole.direction);
            assert!((clipped.origin.z - 2.0).abs() < 1e-6);
            let along = whole.at((clipped.origin - whole.origin).length());
            assert!((clipped.origin - along).length() < 1e-5, "{along} {}", clipped.origin);
        }
    }

    #[test]
    fn a_lens_keeps_the_plane_in_focus() {
        let camera = Camera::new(Affine3A::IDENTITY, 60.0, [100, 100], 0.3, 5.0);
        let at = |lens| {
            let ray = camera.ray([20.0, 70.0], lens);
            ray.at((5.0 - ray.origin.z) / ray.direction.z)
        };
        assert!((at([0.1, 0.2]) - at([0.9, 0.7])).length() < 1e-4);
    }
}
