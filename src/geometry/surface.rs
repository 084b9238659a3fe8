//! The point where a ray meets a surface.

use std::f32::consts::{PI, TAU};

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Vec2, Vec3};

use super::Ray;
use super::accel::Hit;
use super::corners::{self, Corners};
use super::shape::{Geometry, Shape};
use super::sphere::Sphere;
use crate::math::Frame;
use crate::math::error_bound::{gamma, offset_origins};
use crate::math::lanes::{LANES, Mask, Real, V3, Wide};

/// A point of a surface with its local geometry. The order of its numbers is one in which sixteen of them come and go four by four, see
/// [`Surface::shading_lanes`].
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Surface {
    /// World position.
    pub point: Vec3,
    /// Bound of the rounding error of each coordinate.
    pub error: Vec3,
    /// Unit geometric normal on the front side.
    pub normal: Vec3,
    /// Unit shading normal.
    pub shading: Vec3,
    /// The shading normal without bump map.
    pub smooth: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Distance from the ray's origin.
    pub distance: f32,
    /// Index of the shape.
    pub shape: u32,
    /// Angle from the x axis of [`Surface::frame`] to ∂p/∂u, radians, where materials ask for it; else 0.
    pub angle: f32,
}

impl Surface {
    /// The surface at `hit` on `shape`.
    #[inline(always)]
    pub fn new(ray: &Ray, hit: &Hit, shape: &Shape) -> Self {
        match &shape.geometry {
            Geometry::Mesh { .. } => Self::on_triangle(hit, shape),
            Geometry::Sphere(sphere) => Self::on_sphere(ray, hit, shape, sphere),
        }
    }

    /// Makes the surfaces at hits of rays, in their places; where there is no hit, what stands there then means nothing.
    #[inline(always)]
    pub fn all(rays: &[Ray], hits: &[Option<Hit>], shapes: &[Shape], surfaces: &mut [Self]) {
        for first in (0..hits.len()).step_by(LANES) {
            let places = first..hits.len().min(first + LANES);
            let hits = &hits[places.clone()];
            let made = corners::surfaces(hits, shapes, &mut surfaces[first..]);
            for (lane, place) in places.enumerate().filter(|(lane, _)| made >> lane & 1 == 0) {
                if let Some(hit) = &hits[lane] {
                    surfaces[place] = Self::new(&rays[place], hit, &shapes[hit.shape as usize]);
                }
            }
        }
    }

    /// Its numbers; the last but one is the index of the shape, of which only the bits mean something.
    #[inline(always)]
    fn numbers(&self) -> &[f32; NUMBERS] {
        bytemuck::cast_ref(self)
    }

    #[inline(always)]
    pub(super) fn numbers_mut(&mut self) -> &mut [f32; NUMBERS] {
        bytemuck::cast_mut(self)
    }

    /// Sixteen surfaces as they are shaded: points from which rays leave, and shading normals.
    #[inline(always)]
    pub fn shading_lanes<W: Wide>(wide: W, surfaces: &[&Self; LANES]) -> (Origins<W::Real>, V3<W::Real>) {
        let [x, y, z, ex] = wide.four_columns(|lane| four(surfaces[lane].numbers(), 0));
        let [ey, ez, nx, ny] = wide.four_columns(|lane| four(surfaces[lane].numbers(), 4));
        let [nz, sx, sy, sz] = wide.four_columns(|lane| four(surfaces[lane].numbers(), 8));
        let origins = Origins { point: V3::new(x, y, z), error: V3::new(ex, ey, ez), normal: V3::new(nx, ny, nz) };
        (origins, V3::new(sx, sy, sz))
    }

    /// [`Surface::point`] of sixteen surfaces.
    #[inline(always)]
    pub fn point_lanes<W: Wide>(wide: W, surfaces: &[&Self; LANES]) -> V3<W::Real> {
        let [x, y, z, _] = wide.four_columns(|lane| four(surfaces[lane].numbers(), 0));
        V3::new(x, y, z)
    }

    /// [`Surface::smooth`] of sixteen surfaces.
    #[inline(always)]
    pub fn smooth_lanes<W: Wide>(wide: W, surfaces: &[&Self; LANES]) -> V3<W::Real> {
        let [x, y, z, _] = wide.four_columns(|lane| four(surfaces[lane].numbers(), 12));
        V3::new(x, y, z)
    }

    fn on_sphere(ray: &Ray, hit: &Hit, shape: &Shape, sphere: &Sphere) -> Self {
        // Projecting back onto the sphere removes the error that grows with the distance of the ray's origin.
        let outward = (ray.at(hit.distance) - sphere.center).normalize_or(Vec3::Z);
        let point = sphere.center + outward * sphere.radius;
        let error = gamma(6) * (sphere.center.abs() + Vec3::splat(sphere.radius));
        let normal = outward * shape.front();
        let uv = Sphere::uv(shape.turn.map_or(outward, |turn| turn * outward));
        let (distance, shape) = (hit.distance, hit.shape);
        Self { point, error, normal, shading: normal, smooth: normal, uv, distance, shape, angle: 0.0 }
    }

    /// A point inside a medium that was reached after `distance` and sends light towards `out`. There is no surface: the normal
    /// is zero, so that a ray leaves from the point itself, and the shading normal is `out`.
    pub fn in_medium(point: Vec3, distance: f32, out: Vec3) -> Self {
        let (error, normal, uv) = (Vec3::ZERO, Vec3::ZERO, Vec2::ZERO);
        Self { point, error, normal, smooth: normal, shading: out, uv, distance, shape: u32::MAX, angle: 0.0 }
    }

    #[inline(always)]
    fn on_triangle(hit: &Hit, shape: &Shape) -> Self {
        let corners = Corners::<f32>::new(shape, hit.triangle);
        let at = corners.at(hit.barycentric);
        Self {
            point: at.point.into(),
            error: shape.error(at.magnitudes.into()),
            normal: at.normal.into(),
            shading: at.smooth.into(),
            smooth: at.smooth.into(),
            uv: Vec2::from_array(at.uv),
            distance: hit.distance,
            shape: hit.shape,
            angle: 0.0,
        }
    }

    /// Shading frame: around the shading normal.
    #[inline(always)]
    pub fn frame(&self) -> Frame {
        Frame::new(self.shading)
    }

    /// The shading normal on the side of the unit direction `out`, without bumps, which would spread a surface over all facings of
    /// a guide.
    pub fn normal_towards(&self, out: Vec3) -> Vec3 {
        if self.smooth.dot(out) < 0.0 { -self.smooth } else { self.smooth }
    }

    /// The point as rays leave from it.
    #[inline(always)]
    pub fn origin(&self) -> Origins<f32> {
        Origins { point: self.point.into(), error: self.error.into(), normal: self.normal.into() }
    }

    /// The ray that leaves this point along the unit vector `direction` without hitting the surface again.
    #[inline(always)]
    pub fn leave(&self, direction: Vec3) -> Ray {
        Ray { origin: self.origin().leave(direction.into()).into(), direction }
    }

    /// The ray from this point to the one at `distance` in the unit direction `wi`, and its maximum distance; see [`Origins::towards`].
    #[inline(always)]
    pub fn towards(&self, wi: Vec3, distance: f32) -> (Ray, f32) {
        let (origin, direction, length) = self.origin().towards(wi.into(), distance);
        (Ray { origin: origin.into(), direction: direction.into() }, length)
    }
}

/// As many numbers as a surface has.
const NUMBERS: usize = size_of::<Surface>() / size_of::<f32>();

/// Four numbers in a row, from the `first` on.
#[inline(always)]
fn four<const N: usize>(numbers: &[f32; N], first: usize) -> [f32; 4] {
    [numbers[first], numbers[first + 1], numbers[first + 2], numbers[first + 3]]
}

/// Points of surfaces from which rays leave, one per lane.
#[derive(Debug, Clone, Copy)]
pub struct Origins<R> {
    /// World position.
    pub point: V3<R>,
    /// Bound of the rounding error of each coordinate.
    pub error: V3<R>,
    /// Unit geometric normal.
    pub normal: V3<R>,
}

impl<R: Real> Origins<R> {
    /// Where the ray along the unit vector `direction` starts, so that it does not hit the surface again.
    #[inline(always)]
    pub fn leave(&self, direction: V3<R>) -> V3<R> {
        offset_origins(self.point, self.error, self.normal, direction)
    }

    /// Origin, unit direction and maximum distance of the ray to the point at `distance` in the unit direction `wi`. It is aimed from
    /// its offset origin, since at grazing angles the offset would otherwise carry it past the end, and stops short of that by the
    /// rounding of both ends.
    #[inline(always)]
    pub fn towards(&self, wi: V3<R>, distance: R) -> (V3<R>, V3<R>, R) {
        let origin = self.leave(wi);
        let target = self.point + wi * distance;
        let to = target - origin;
        let length = to.length();
        let rounding = (self.point.abs() + target.abs()).max_element() * length.all(gamma(16));
        let infinite = distance.same(distance.all(f32::INFINITY));
        let end = length * length.all(1.0 - gamma(256)) - rounding;
        (origin, V3::choose(infinite, wi, to / length), infinite.choose(distance, end))
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
