//! Rays through participating media and over their borders.

use glam::Vec3;

use super::effects::Effects;
use super::{MOST_HOLES, Scene};
use crate::base::random::Random;
use crate::geometry::{Ray, Surface};
use crate::materials::medium::{Flight, Medium, MediumId};
use crate::materials::phase::HenyeyGreenstein;

/// Where a ray ends.
#[derive(Debug, Clone, Copy)]
pub enum Arrival {
    /// Infinitely far away.
    Background,
    /// At a surface.
    Surface(Surface),
    /// At a point of a medium, which has no normal and no texture coordinates; it scatters by this phase function.
    Medium(Surface, HenyeyGreenstein),
}

/// The media on the two sides of a shape, behind and in front of it; none is empty space.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Border {
    pub(super) interior: Option<MediumId>,
    pub(super) exterior: Option<MediumId>,
}

impl Scene {
    /// A medium of the scene.
    pub fn medium(&self, id: MediumId) -> &Medium {
        &self.media[id as usize]
    }

    /// The medium that a ray is in after it left `surface` in `direction`, having been in `medium` before.
    pub fn medium_beyond(&self, surface: &Surface, direction: Vec3, medium: Option<MediumId>) -> Option<MediumId> {
        // A point of a medium belongs to no shape.
        match self.shape_border.get(surface.shape as usize).copied().flatten() {
            Some(border) if direction.dot(surface.normal) > 0.0 => border.exterior,
            Some(border) => border.interior,
            None => medium,
        }
    }

    /// The medium that light leaves into from light `index`.
    pub fn light_medium(&self, index: usize) -> Option<MediumId> {
        self.light_medium[index]
    }

    /// Where a path's next segment ends, which starts in `medium` and carries `carried`, and the factor on what it carries.
    #[inline]
    pub fn advance<E: Effects>(
        &self,
        ray: &Ray,
        medium: &mut Option<MediumId>,
        carried: Vec3,
        random: &mut Random,
    ) -> (Arrival, Vec3) {
        if E::MEDIA {
            return self.travel(ray, medium, carried, random);
        }
        let surface = if E::MATERIALS { self.trace(ray, random) } else { self.intersect(ray) };
        (surface.map_or(Arrival::Background, Arrival::Surface), Vec3::ONE)
    }

    /// Part of the light that comes through along the first `length` of a shadow ray that leaves `from`, which a path reached
    /// through `medium`.
    #[inline(always)]
    pub fn passes<E: Effects>(&self, from: &Surface, ray: &Ray, length: f32, medium: Option<MediumId>) -> Vec3 {
        if length <= 0.0 {
            return Vec3::ONE;
        }
        if E::MEDIA {
            return self.transmittance(ray, length, self.medium_beyond(from, ray.direction, medium));
        }
        if E::MATERIALS && self.has_masks {
            return self.transmittance(ray, length, None);
        }
        if self.accel.occluded(ray, length) { Vec3::ZERO } else { Vec3::ONE }
    }

    /// Follows a ray that carries `carried` per channel to where it meets a surface or is scattered by a medium. Returns that
    /// with the factor on what it carries; `medium`, in which it starts, becomes the one in which it arrives.
    fn travel(&self, ray: &Ray, medium: &mut Option<MediumId>, carried: Vec3, random: &mut Random) -> (Arrival, Vec3) {
        let (mut ray, mut weight, mut behind) = (*ray, Vec3::ONE, 0.0);
        for _ in 0..MOST_HOLES {
            let surface = self.intersect(&ray);
            if let Some(surface) = &surface {
                *medium = self.medium_before(surface, ray.direction, *medium);
            }
            if let Some(id) = *medium {
                let limit = surface.map_or(f32::INFINITY, |surface| surface.distance);
                match self.medium(id).sample(carried * weight, limit, random.next_f32(), random.next_f32()) {
                    Flight::Collision { distance, weight: factor } => {
                        let point = Surface::in_medium(ray.at(distance), behind + distance, -ray.direction);
                        return (Arrival::Medium(point, self.medium(id).phase), weight * factor);
                    }
                    Flight::Through { weight: factor } => weight *= factor,
                }
            }
            let Some(surface) = surface else { return (Arrival::Background, weight) };
            let opacity = self.opacity(&surface);
            if opacity >= 1.0 || opacity > 0.0 && random.next_f32() < opacity {
                let distance = behind + surface.distance;
                return (Arrival::Surface(Surface { distance, ..surface }), weight);
            }
            *medium = self.medium_beyond(&surface, ray.direction, *medium);
            behind += surface.distance;
            ray = surface.leave(ray.direction);
        }
        (Arrival::Background, Vec3::ZERO)
    }

    /// Part of the light that comes through along the first `length` of a ray that starts in `medium`, per channel.
    fn transmittance(&self, ray: &Ray, length: f32, mut medium: Option<MediumId>) -> Vec3 {
        let (mut through, mut ray, mut left) = (Vec3::ONE, *ray, length);
        for _ in 0..MOST_HOLES {
            let surface = self.intersect(&ray).filter(|surface| surface.distance < left);
            if let Some(surface) = &surface {
                medium = self.medium_before(surface, ray.direction, medium);
            }
            if let Some(id) = medium {
                through *= self.medium(id).transmittance(surface.map_or(left, |surface| surface.distance));
            }
            let Some(surface) = surface else { return through };
            through *= 1.0 - self.opacity(&surface);
            if through == Vec3::ZERO {
                break;
            }
            medium = self.medium_beyond(&surface, ray.direction, medium);
            (ray, left) = go_on(&surface, &ray, left);
        }
        Vec3::ZERO
    }

    /// The medium that a ray arrives in at `surface`, going in `direction`, where it is thought to be in `medium`. A point near a
    /// border may be on either side of it by rounding; the next border tells.
    fn medium_before(&self, surface: &Surface, direction: Vec3, medium: Option<MediumId>) -> Option<MediumId> {
        let [before, beyond] = [-direction, direction].map(|side| self.medium_beyond(surface, side, medium));
        if medium == beyond { before } else { medium }
    }
}

/// A ray that goes on behind `surface` to the end of the length `left` that it had, and its new length. It is aimed anew: the
/// offsets from many surfaces would otherwise carry it past that end, to a light's own surface.
fn go_on(surface: &Surface, ray: &Ray, left: f32) -> (Ray, f32) {
    let next = surface.leave(ray.direction);
    if left.is_infinite() {
        return (next, left);
    }
    let to = ray.at(left) - next.origin;
    let length = to.length();
    (Ray { direction: to / length, ..next }, if to.dot(ray.direction) > 0.0 { length } else { 0.0 })
}
