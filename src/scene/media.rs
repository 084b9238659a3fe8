//! Rays through participating media and over their borders.

use glam::Vec3;

use super::effects::Effects;
use super::{MOST_HOLES, Scene};
use crate::base::random::{Dimension, Random};
use crate::geometry::{Met, Ray, Scratch, Surface, Way};
use crate::materials::grid_medium::{Flown, GridMedium};
use crate::materials::medium::{Flight, Medium, MediumId};
use crate::materials::phase::HenyeyGreenstein;

/// The end of a segment.
#[derive(Debug, Clone, Copy)]
pub enum End {
    /// Infinitely far away.
    Background,
    /// At a surface.
    Surface,
    /// At a point of a medium, which has no normal and no texture coordinates; it scatters by this phase function.
    Medium(HenyeyGreenstein),
}

/// A segment of a path, from a ray's origin to where it ends.
#[derive(Debug, Clone, Copy)]
pub struct Passage {
    /// The end.
    pub end: End,
    /// Factor on what the path carries.
    pub weight: Vec3,
    /// Radiance that media on the way send back to the origin by themselves.
    pub glow: Vec3,
    /// Where it is [wanted](Segment::wants_density): probability of getting to the end unscattered, or density of being scattered there, 1 / scene
    /// unit; otherwise 1.
    pub density: f32,
}

/// Where a path was taken to.
#[derive(Debug, Clone, Copy)]
pub struct Reached {
    /// The surface, or the point of a medium; none infinitely far away.
    pub surface: Option<Surface>,
    /// The phase function at a point of a medium.
    pub phase: Option<HenyeyGreenstein>,
    /// As [`Passage::weight`] and [`Passage::density`] of a path that got there by itself. Their product is the transmittance, times the scattering
    /// coefficient σ_s at a point of a medium.
    pub weight: Vec3,
    /// See [`Reached::weight`].
    pub density: f32,
}

/// A place that a ray may end at.
#[derive(Clone, Copy)]
pub enum Place<'a> {
    /// A point of a medium.
    Medium(Vec3),
    /// A surface.
    Surface(&'a Surface),
    /// Infinitely far away.
    Background,
}

/// Mean radiance that is expected from a place towards the ray's origin, W·m⁻²·sr⁻¹; none where it is not known.
pub type Expected<'a> = &'a dyn Fn(Place) -> Option<f32>;

/// The beginning of a segment of a path.
#[derive(Clone, Copy)]
pub struct Segment<'a> {
    /// Where it starts, and its direction.
    pub ray: &'a Ray,
    /// What the path carries, per channel.
    pub carried: Vec3,
    /// Random numbers of the vertex that it leads to.
    pub random: &'a Random,
    /// By which distances in media are drawn; none where transmittance alone decides.
    pub expected: Option<Expected<'a>>,
    /// Whether [`Passage::density`] is wanted.
    pub wants_density: bool,
}

/// What fills space.
#[derive(Debug, Clone)]
pub(super) enum Filling {
    /// The same everywhere.
    Even(Medium),
    /// By a grid.
    Grid(Box<GridMedium>),
}

impl Filling {
    /// Samples the flight of a ray that carries `carried` up to where it meets `end`, of which it is known how much light comes from there
    /// where `expected` is given; otherwise its density is told if that is wanted.
    fn fly(
        &self,
        ray: &Ray,
        end: Option<&Surface>,
        carried: Vec3,
        random: &mut Random,
        (expected, wants_density): (Option<Expected>, bool),
    ) -> Flown {
        let limit = limit(end);
        let worth = |expected: Expected, distance: Option<f32>| match (distance, end) {
            (Some(distance), _) => expected(Place::Medium(ray.at(distance))),
            (None, Some(surface)) => expected(Place::Surface(surface)),
            (None, None) => expected(Place::Background),
        };
        match (self, expected) {
            (Self::Even(medium), None) => {
                let [distance, channel] = random.next_2d();
                let end = medium.sample(carried, limit, channel, distance);
                let density = match end {
                    _ if !wants_density => 1.0,
                    Flight::Collision { distance, .. } => medium.collision_at(carried, distance).1,
                    Flight::Through { .. } => medium.passed(carried, limit).1,
                };
                Flown { density, ..end.into() }
            }
            (Self::Even(medium), Some(expected)) => {
                let [distance, channel] = random.next_2d();
                medium.sample_expecting(carried, limit, [channel, distance], |at| worth(expected, at)).into()
            }
            (Self::Grid(medium), Some(expected)) => {
                medium.fly_expecting(ray, limit, carried, random, |at| worth(expected, at))
            }
            (Self::Grid(medium), None) if wants_density => medium.fly_known(ray, limit, carried, random),
            (Self::Grid(medium), None) => medium.fly(ray, limit, carried, random),
        }
    }

    /// The flight of a ray that carries `carried` to a collision at a distance, or where none is given to where it meets `end`, as
    /// [`Filling::fly`] ends so where nothing is expected.
    fn reach(&self, ray: &Ray, distance: Option<f32>, end: Option<&Surface>, carried: Vec3) -> Flown {
        let told = |(end, density): (Flight, f32)| Flown { density, ..end.into() };
        match (self, distance) {
            (Self::Even(medium), Some(distance)) => told(medium.collision_at(carried, distance)),
            (Self::Even(medium), None) => told(medium.passed(carried, limit(end))),
            (Self::Grid(medium), Some(distance)) => medium.collision_at(ray, carried, distance),
            (Self::Grid(medium), None) => medium.passed(ray, carried, limit(end)),
        }
    }

    /// Transmittance along the first `length` of a ray, or an estimate of it.
    fn transmittance(&self, ray: &Ray, length: f32, random: &mut Random) -> Vec3 {
        match self {
            Self::Even(medium) => medium.transmittance(length),
            Self::Grid(medium) => medium.transmittance(ray, length, random),
        }
    }

    fn phase(&self) -> HenyeyGreenstein {
        match self {
            Self::Even(medium) => medium.phase,
            Self::Grid(medium) => medium.phase(),
        }
    }
}

/// How far a ray goes at most.
fn limit(end: Option<&Surface>) -> f32 {
    end.map_or(f32::INFINITY, |surface| surface.distance)
}

/// The media on the two sides of a shape, behind and in front of it; none is empty space.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Border {
    pub(super) interior: Option<MediumId>,
    pub(super) exterior: Option<MediumId>,
}

impl Scene {
    fn medium(&self, id: MediumId) -> &Filling {
        &self.media[id as usize]
    }

    /// Whether transmittance is estimated with random numbers.
    #[inline(always)]
    pub fn has_grids(&self) -> bool {
        self.has_grids
    }

    /// Whether a medium has light of its own.
    #[inline(always)]
    pub fn glows(&self) -> bool {
        self.glows
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

    /// The medium into which light `index` emits.
    pub fn light_medium(&self, index: usize) -> Option<MediumId> {
        self.light_medium[index]
    }

    /// Takes a path's next segment, which starts in `medium`, on from the nearest surface, where it `meets` one, to its end. `surface`
    /// becomes the surface or the point of a medium there.
    #[inline(always)]
    pub fn advance<E: Effects>(
        &self,
        segment: Segment,
        meets: bool,
        surface: &mut Surface,
        medium: &mut Option<MediumId>,
    ) -> Passage {
        let end = if meets { End::Surface } else { End::Background };
        let mut passage = Passage { end, weight: Vec3::ONE, glow: Vec3::ZERO, density: 1.0 };
        let more = E::MEDIA || E::MATERIALS && self.has_masks;
        // Most of it ends at a wall, without a medium on the way.
        if more && (medium.is_some() || meets && !self.shape_stops[surface.shape as usize]) {
            let (mut nearest, random) = (meets.then_some(*surface), &mut segment.random.at(Dimension::SEGMENT));
            if E::MEDIA {
                passage = self.travel(segment, random, &mut nearest, medium);
            } else {
                self.pass_holes(segment.ray, &mut nearest, random);
                passage.end = if nearest.is_some() { End::Surface } else { End::Background };
            }
            nearest.into_iter().for_each(|last| *surface = last);
        }
        passage
    }

    /// Whether something may lie on a shadow ray that lets light through: then [`Scene::transmittance`] is asked instead of whether
    /// anything lies there.
    #[inline(always)]
    pub fn has_veils<E: Effects>(&self) -> bool {
        E::MEDIA || E::MATERIALS && self.has_masks
    }

    /// Follows a segment to where it meets a surface or is scattered by a medium. `medium`, in which it starts, becomes the one in which
    /// it arrives.
    fn travel(
        &self,
        Segment { ray, carried, expected, wants_density, .. }: Segment,
        random: &mut Random,
        end: &mut Option<Surface>,
        medium: &mut Option<MediumId>,
    ) -> Passage {
        let (mut ray, mut weight, mut glow, mut behind, mut density) = (*ray, Vec3::ONE, Vec3::ZERO, 0.0, 1.0);
        for _ in 0..MOST_HOLES {
            if let Some(surface) = end {
                *medium = self.medium_before(surface, ray.direction, *medium);
            }
            if let Some(id) = *medium {
                let wanted = (expected, wants_density);
                let flown = self.medium(id).fly(&ray, end.as_ref(), carried * weight, random, wanted);
                glow += weight * flown.glow;
                density *= flown.density;
                match flown.end {
                    Flight::Collision { distance, weight: factor } => {
                        *end = Some(Surface::in_medium(ray.at(distance), behind + distance, -ray.direction));
                        let end = End::Medium(self.medium(id).phase());
                        return Passage { end, weight: weight * factor, glow, density };
                    }
                    Flight::Through { weight: factor } => weight *= factor,
                }
            }
            let Some(surface) = end else { return Passage { end: End::Background, weight, glow, density } };
            let opacity = self.opacity(surface);
            if opacity >= 1.0 || opacity > 0.0 && random.next_f32() < opacity {
                surface.distance += behind;
                return Passage { end: End::Surface, weight, glow, density };
            }
            *medium = self.medium_beyond(surface, ray.direction, *medium);
            behind += surface.distance;
            ray = surface.leave(ray.direction);
            *end = self.intersect(&ray);
        }
        *end = None;
        Passage { end: End::Background, weight: Vec3::ZERO, glow, density }
    }

    /// Takes a path that carries `carried` along a ray, which starts in `medium`, to the point of a medium at `distance`, or where none is
    /// given to the surface that stops it, and through all media on the way. `medium` becomes the one in which it arrives. None where it does
    /// not get there: there is another surface before it, or no medium.
    pub fn reach(
        &self,
        ray: &Ray,
        distance: Option<f32>,
        carried: Vec3,
        medium: &mut Option<MediumId>,
        random: &mut Random,
    ) -> Option<Reached> {
        let (mut ray, mut weight, mut density, mut behind) = (*ray, Vec3::ONE, 1.0, 0.0);
        for _ in 0..MOST_HOLES {
            let mut end = self.intersect(&ray);
            if let Some(surface) = &end {
                *medium = self.medium_before(surface, ray.direction, *medium);
            }
            let filling = medium.map(|id| self.medium(id));
            // Rounding at a border may lead back before it.
            let left = distance.map(|distance| (distance - behind).max(0.0));
            let left = left.filter(|left| *left < limit(end.as_ref()));
            let flown = match (filling, left) {
                (Some(filling), left) => filling.reach(&ray, left, end.as_ref(), carried * weight),
                (None, None) => Flight::Through { weight: Vec3::ONE }.into(),
                (None, Some(_)) => return None,
            };
            density *= flown.density;
            match flown.end {
                Flight::Collision { distance, weight: factor } => {
                    let point = Surface::in_medium(ray.at(distance), behind + distance, -ray.direction);
                    let (surface, phase) = (Some(point), filling.map(Filling::phase));
                    return Some(Reached { surface, phase, weight: weight * factor, density });
                }
                Flight::Through { weight: factor } => weight *= factor,
            }
            let reached = |surface| Reached { surface, phase: None, weight, density };
            let Some(surface) = &mut end else { return distance.is_none().then(|| reached(None)) };
            let opacity = self.opacity(surface);
            if opacity >= 1.0 || opacity > 0.0 && random.next_f32() < opacity {
                surface.distance += behind;
                return distance.is_none().then(|| reached(Some(*surface)));
            }
            *medium = self.medium_beyond(surface, ray.direction, *medium);
            behind += surface.distance;
            ray = surface.leave(ray.direction);
        }
        None
    }

    /// Transmittance along the first `length` of a ray that starts in `medium`, per channel; with media that vary an estimate of it.
    pub fn transmittance(&self, ray: &Ray, length: f32, medium: Option<MediumId>, random: &Random) -> Vec3 {
        self.transmittance_past(self.accel.meets(ray, length, &self.shape_solid), ray, length, medium, random)
    }

    /// Sets `met` to what each shadow ray meets before its length.
    pub fn meets_all(&self, rays: &[(Ray, f32)], way: Way, queries: &mut Scratch, met: &mut [Met]) {
        self.accel.meets_all(rays, &self.shape_solid, way, queries, met);
    }

    /// As [`Scene::transmittance`], once it is known what the ray meets: most meet a wall or nothing, which is found sooner than the first
    /// surface.
    pub fn transmittance_past(
        &self,
        met: Met,
        ray: &Ray,
        length: f32,
        medium: Option<MediumId>,
        random: &Random,
    ) -> Vec3 {
        match (met, medium) {
            _ if length <= 0.0 => Vec3::ONE,
            (Met::Wall, _) => Vec3::ZERO,
            (Met::Veils, _) => self.transmittance_of_surfaces(ray, length, medium, random.clone()),
            (Met::Nothing, Some(id)) => self.medium(id).transmittance(ray, length, &mut random.clone()),
            (Met::Nothing, None) => Vec3::ONE,
        }
    }

    /// As [`Scene::transmittance`], surface by surface.
    fn transmittance_of_surfaces(
        &self,
        ray: &Ray,
        length: f32,
        mut medium: Option<MediumId>,
        mut random: Random,
    ) -> Vec3 {
        let (mut through, mut ray, mut left) = (Vec3::ONE, *ray, length);
        for _ in 0..MOST_HOLES {
            let surface = self.intersect(&ray).filter(|surface| surface.distance < left);
            if let Some(surface) = &surface {
                medium = self.medium_before(surface, ray.direction, medium);
            }
            if let Some(id) = medium {
                let length = surface.map_or(left, |surface| surface.distance);
                through *= self.medium(id).transmittance(&ray, length, &mut random);
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

    /// The medium in which a ray in `direction` arrives at `surface`, where it is thought to be in `medium`. A point near a border
    /// may be on either side of it by rounding; the next border tells.
    fn medium_before(&self, surface: &Surface, direction: Vec3, medium: Option<MediumId>) -> Option<MediumId> {
        let [before, beyond] = [-direction, direction].map(|side| self.medium_beyond(surface, side, medium));
        if medium == beyond { before } else { medium }
    }
}

/// The ray that goes on behind `surface` to the end of its remaining length `left`, and its new length. It is aimed anew: the
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::warp;
    use crate::scene::readers;

    /// Panes with holes, a cloud within a border, and walls.
    const SCENE: &str = r#"<scene version="3.0.0">
        <sensor type="perspective"/>
        <bsdf type="mask" id="half"><float name="opacity" value="0.5"/><bsdf type="diffuse"/></bsdf>
        <bsdf type="mask" id="squares"><texture name="opacity" type="checkerboard">
            <rgb name="color0" value="0"/><rgb name="color1" value="1"/></texture><bsdf type="diffuse"/></bsdf>
        <shape type="rectangle"><ref id="half"/>
            <transform name="to_world"><translate z="0.3"/></transform></shape>
        <shape type="disk"><ref id="squares"/>
            <transform name="to_world"><rotate y="1" angle="70"/><translate x="0.2"/></transform></shape>
        <shape type="sphere"><bsdf type="null"/><float name="radius" value="0.4"/>
            <medium type="homogeneous" name="interior"><rgb name="sigma_t" value="1 2 3"/></medium></shape>
        <shape type="sphere"><point name="center" x="-0.7" y="0.4" z="0"/><float name="radius" value="0.3"/></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="0.6" y="-0.4"/></transform></shape>
    </scene>"#;

    /// Looking for opaque surfaces first gives the same transmittance as going from surface to surface.
    #[test]
    fn walls_first_or_surface_by_surface_lets_the_same_light_through() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.xml");
        std::fs::write(&path, SCENE).unwrap();
        let scene = Scene::build(&readers::load(&path).unwrap(), [4, 4]).unwrap();
        let mut random = Random::new(41, 0, 0);
        let (mut dark, mut dimmed, mut clear) = (0, 0, 0);
        for _ in 0..50_000 {
            let mut point = || Vec3::from_array(std::array::from_fn(|_| random.range(-1.0, 1.0)));
            let (origin, to) = (point(), point());
            let direction = if random.next_f32() < 0.1 {
                warp::square_to_sphere(random.next_2d())
            } else {
                (to - origin).normalize_or(Vec3::X)
            };
            let ray = Ray { origin, direction };
            let length = if random.next_f32() < 0.2 { f32::INFINITY } else { origin.distance(to) };
            let medium = (origin.length() < 0.4).then_some(0);
            let fresh = || Random::new(42, 0, 0);
            let through = scene.transmittance(&ray, length, medium, &fresh());
            assert_eq!(through, scene.transmittance_of_surfaces(&ray, length, medium, fresh()), "{ray:?} {length}");
            match through {
                Vec3::ZERO => dark += 1,
                Vec3::ONE => clear += 1,
                _ => dimmed += 1,
            }
        }
        assert!(dark.min(dimmed).min(clear) > 5000, "{dark} {dimmed} {clear}");
    }
}
