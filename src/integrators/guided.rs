//! Complete paths drawn from kept ones (Reibold 2018, §3.3): a kept path is chosen, and the new one follows it from the camera to the light,
//! vertex by vertex, by its kernels or by BSDFs. A path on which something else happens than on the kept one ends.

use glam::{DVec3, Vec3};
use smallvec::SmallVec;

use super::mixture::one_draw;
use super::path::{KernelShares, sky_point, unguided_survival};
use super::site::Site;
use super::{Roulette, TransportSettings};
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::guiding::paths::guide::{Chosen, PathGuide};
use crate::guiding::paths::path::{CompletePath, End, Event, Step};
use crate::guiding::paths::spatial::Reach;
use crate::lights::Light;
use crate::lights::learned::LightSampling;
use crate::lights::seen::{ANYWHERE, facing};
use crate::materials::medium::MediumId;
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::{Bsdf, Transport};
use crate::math::Frame;
use crate::scene::Scene;
use crate::scene::media::Reached;

/// Draws complete paths.
pub struct GuidedTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// How lights are sampled.
    pub lights: LightSampling<'a>,
    /// What is drawn from.
    pub guide: &'a PathGuide,
    /// How often kernels choose.
    pub shares: &'a KernelShares,
}

/// A complete path that was drawn.
#[derive(Debug, Clone)]
pub struct GuidedPath {
    /// The path.
    pub path: CompletePath,
    /// f: radiance times the cosines and BSDFs on the way, for densities of [this measure](crate::guiding::paths).
    pub value: DVec3,
    /// See [`Contribution::unguided`](super::path::Contribution::unguided).
    pub unguided: f64,
    /// Density p_g with which the guide draws it.
    pub guided: f64,
    /// Rays that it took.
    pub rays: u64,
}

/// A path on its way.
struct Walk<'g> {
    chosen: Chosen<'g>,
    random: Random,
    ray: Ray,
    medium: Option<MediumId>,
    /// Distance on the ray to the next point, if that lies in a medium.
    distance: Option<f32>,
    points: SmallVec<[Vec3; 6]>,
    steps: SmallVec<[Step; 6]>,
    /// Π f·|cos θ|; of delta lobes their factor times their probability.
    value: DVec3,
    /// What the path tracer's path would carry, see [`unguided_survival`].
    throughput: Vec3,
    squeezed: f32,
    /// Density of its steps but the last, roulette included, of the last, and the probability of surviving roulette behind that.
    before: f64,
    last: f64,
    survival: f64,
    /// Density of the distance to the point that it arrives at in a medium, or probability of getting to a surface there through media.
    flight: f64,
    /// Whether light sampling is tried at its last point.
    connects: bool,
    /// Which way the surface there faces.
    facing: u8,
    rays: u64,
}

/// Where a path meets something.
struct Vertex {
    surface: Surface,
    /// The phase function of a medium, if it is there.
    phase: Option<HenyeyGreenstein>,
}

/// A step that was drawn at a vertex.
struct Drawn {
    direction: Vec3,
    /// Distance to the next point, if that lies in a medium.
    distance: Option<f32>,
    origin: Vec3,
    value: Vec3,
    pdf: f32,
}

impl GuidedTracer<'_> {
    /// Draws a path, by these random numbers, for the picture's first view; none where it leaves the picture, or the kept path.
    pub fn sample(&self, random: Random) -> Option<GuidedPath> {
        let mut start = random.at(Dimension::GUIDE);
        let (choice, place) = (start.next_f64(), start.next_2d_f64());
        let chosen = self.guide.choose(choice)?;
        let film = chosen.film(place);
        let size = self.scene.size.map(|side| side as f32);
        if !(film[0] >= 0.0 && film[1] >= 0.0 && film[0] < size[0] && film[1] < size[1]) {
            return None;
        }
        let camera = &self.scene.camera;
        let ray = camera.ray(film, camera.lens(&random));
        let distance = match chosen.first() {
            Some(kernel) => Some(kernel.distance(ray.origin, ray.direction, start.next_2d_f64())?),
            None => None,
        };
        let walk = Walk {
            chosen,
            random,
            ray,
            medium: self.scene.camera_medium,
            distance,
            points: SmallVec::new(),
            steps: SmallVec::new(),
            value: DVec3::ONE,
            throughput: Vec3::ONE,
            squeezed: 1.0,
            before: 1.0,
            last: 1.0,
            survival: 1.0,
            flight: 1.0,
            connects: false,
            facing: ANYWHERE,
            rays: 0,
        };
        // Each for itself, so that media cost nothing where there are none.
        let follow = if self.scene.needs().media { Self::follow::<true> } else { Self::follow::<false> };
        follow(self, walk, film, ray.origin)
    }

    fn follow<const MEDIA: bool>(&self, mut walk: Walk, film: [f32; 2], origin: Vec3) -> Option<GuidedPath> {
        let kept = walk.chosen.path();
        for number in 0..kept.points.len() {
            walk.random.begin_vertex(number as u32 + 1);
            let vertex = self.arrive::<MEDIA>(&mut walk)?;
            let ends = number + 1 == kept.points.len();
            match (kept.end, vertex) {
                (End::Surface, Some(vertex)) if ends => self.hit(&mut walk, &vertex.surface)?,
                (End::Sky, None) if ends => self.leave(&mut walk)?,
                (End::Surface | End::Sky, _) if ends => return None,
                (End::Light(light), Some(vertex)) if ends => {
                    self.connect::<MEDIA>(&mut walk, &vertex, light as usize)?
                }
                (_, vertex) => self.scatter::<MEDIA>(&mut walk, &vertex?)?,
            }
        }
        let Walk { points, steps, value, before, last, rays, .. } = walk;
        let path = CompletePath { film, origin, points, steps, end: kept.end };
        let guided = self.guide.density(&path);
        let (usable, unguided) = (path.is_finite() && value.is_finite() && value != DVec3::ZERO, before * last);
        (usable && guided > 0.0).then_some(GuidedPath { path, value, unguided, guided, rays })
    }

    /// Takes the path along its ray to the point that was drawn in a medium, or else to the surface that stops it, infinitely far away where
    /// there is none. None where it does not get to the point.
    #[inline(always)]
    fn arrive<const MEDIA: bool>(&self, walk: &mut Walk) -> Option<Option<Vertex>> {
        walk.rays += 1;
        let mut random = walk.random.at(Dimension::SEGMENT);
        if !MEDIA {
            return Some(self.scene.trace(&walk.ray, &mut random).map(|surface| Vertex { surface, phase: None }));
        }
        let (ray, carried, distance) = (walk.ray, walk.throughput, walk.distance);
        let Reached { surface, phase, weight, density } =
            self.scene.reach(&ray, distance, carried, &mut walk.medium, &mut random)?;
        walk.flight = f64::from(density);
        walk.value *= weight.as_dvec3() * walk.flight;
        walk.throughput *= weight;
        Some(surface.map(|surface| Vertex { surface, phase }))
    }

    /// The scatterer where a ray meets something.
    #[inline(always)]
    fn site(&self, ray: &Ray, surface: &Surface, phase: Option<HenyeyGreenstein>) -> SiteAt<'_> {
        let (bsdf, bumps) = match phase {
            Some(phase) => (Bsdf::phase(phase), false),
            None => {
                let material = self.scene.material(surface);
                (material.at(surface.uv), material.bump.is_some())
            }
        };
        let bumped = bumps && surface.smooth != surface.shading;
        let chooses = bsdf.chooses_lobe();
        let (normal, smooth) = (surface.shading.into(), surface.smooth.into());
        let site = Site::new(surface.origin(), normal, smooth, (-ray.direction).into(), bsdf, bumped);
        SiteAt { site, chooses }
    }

    /// Normal on the side that a ray arrived at; zero in a medium.
    #[inline(always)]
    fn normal(ray: &Ray, surface: &Surface, phase: Option<HenyeyGreenstein>) -> Vec3 {
        if phase.is_none() { surface.normal_towards(-ray.direction) } else { Vec3::ZERO }
    }

    /// Product of the ratios of indices of a step.
    #[inline(always)]
    fn eta(&self, ray: &Ray, surface: &Surface, phase: Option<HenyeyGreenstein>, direction: Vec3) -> f32 {
        if phase.is_some() {
            return 1.0;
        }
        let frame = Frame::new(surface.shading);
        self.scene.material(surface).eta(frame.to_local(-ray.direction), frame.to_local(direction))
    }

    /// Takes the path on from a vertex as the kept one goes on from there.
    #[inline(always)]
    fn scatter<const MEDIA: bool>(&self, walk: &mut Walk, vertex: &Vertex) -> Option<()> {
        let (number, surface) = (walk.points.len(), &vertex.surface);
        let phase = vertex.phase.filter(|_| MEDIA);
        let wanted = walk.chosen.path().steps.get(number)?.event;
        let SiteAt { site, chooses } = self.site(&walk.ray, surface, phase);
        let by_kernel = match phase {
            _ if wanted.delta => 0.0,
            Some(phase) => KernelShares::in_medium(phase),
            None => self.shares.at(self.scene, surface.shape),
        };
        let mut guide = walk.random.at(Dimension::GUIDE);
        let draw = || {
            let onward = site.draw(&one_draw(&walk.random, chooses, None, Transport::Radiance));
            let (weight, pdf): (Vec3, f32) = (onward.weight.into(), onward.pdf);
            (onward.any && onward.delta == wanted.delta).then(|| Drawn {
                direction: onward.direction.into(),
                distance: None,
                origin: onward.origin.into(),
                value: weight * pdf,
                pdf,
            })
        };
        let mut drawn = if by_kernel > 0.0 && guide.next_f32() < by_kernel {
            let across = guide.next_2d_f64();
            let reach = walk.chosen.kernel(number)?.sample(surface.point, across, || guide.next_2d_f64())?;
            let Reach { direction, distance } = reach;
            let (value, pdf) = site.eval_and_pdf(direction.into());
            let origin = surface.origin().leave(direction.into()).into();
            Drawn { direction, distance, origin, value: value.into(), pdf }
        } else {
            draw()?
        };
        if MEDIA && walk.chosen.path().in_medium(number + 1) && drawn.distance.is_none() {
            let kernel = walk.chosen.kernel(number)?;
            drawn.distance = Some(kernel.distance(surface.point, drawn.direction, guide.next_2d_f64())?);
        }
        let (normal, medium) = (Self::normal(&walk.ray, surface, phase), phase.is_some());
        let event = Event { transmits: normal.dot(drawn.direction) < 0.0, delta: wanted.delta, medium };
        if event != wanted || drawn.value == Vec3::ZERO {
            return None;
        }
        let eta = self.eta(&walk.ray, surface, phase, drawn.direction);
        walk.go_on(self.settings.roulette, &drawn, eta);
        walk.connects = self.settings.light_sampling && !event.delta;
        walk.facing = if self.lights.asks_facing() { facing(normal) } else { ANYWHERE };
        let Drawn { direction, distance, origin, pdf, .. } = drawn;
        walk.points.push(surface.point);
        walk.steps.push(Step { direction, pdf, by_kernel, event });
        (walk.ray, walk.distance) = (Ray { origin, direction }, distance);
        if MEDIA {
            walk.medium = self.scene.medium_beyond(surface, direction, walk.medium);
        }
        Some(())
    }

    /// Ends the path on a surface that emits.
    fn hit(&self, walk: &mut Walk, surface: &Surface) -> Option<()> {
        let (index, Light::Area(light)) = self.scene.light_of(surface)? else { return None };
        walk.value *= light.emitted(surface, -walk.ray.direction).as_dvec3();
        if walk.connects {
            let from = *walk.points.last()?;
            walk.last += f64::from(
                light.pdf(from, surface) * self.scene.lights.probability(from, index, self.lights.odds(from)),
            );
        }
        walk.points.push(surface.point);
        Some(())
    }

    /// Ends the path at the sky.
    fn leave(&self, walk: &mut Walk) -> Option<()> {
        let sky = self.lights.view(*walk.points.last()?, walk.facing);
        let (radiance, pdf) = self.scene.lights.background(walk.ray.direction, &sky);
        walk.value *= radiance.as_dvec3();
        if walk.connects {
            walk.last += f64::from(pdf);
        }
        walk.points.push(sky_point(self.scene, *walk.points.last()?, walk.ray.direction));
        Some(())
    }

    /// Ends the path at a light that no ray can hit.
    fn connect<const MEDIA: bool>(&self, walk: &mut Walk, vertex: &Vertex, index: usize) -> Option<()> {
        let (number, surface) = (walk.points.len(), &vertex.surface);
        let phase = vertex.phase.filter(|_| MEDIA);
        let kept = walk.chosen.path().steps.get(number)?;
        let SiteAt { site, .. } = self.site(&walk.ray, surface, phase);
        let normal = Self::normal(&walk.ray, surface, phase);
        let u = walk.random.at(Dimension::LIGHT_POINT).next_2d();
        let light = self.scene.lights.lights[index].sample(
            surface.point,
            u,
            &self.lights.view(surface.point, facing(normal)),
        )?;
        let event = Event { transmits: normal.dot(light.wi) < 0.0, delta: false, medium: phase.is_some() };
        let value: Vec3 = site.eval_and_pdf(light.wi.into()).0.into();
        if event != kept.event || value == Vec3::ZERO {
            return None;
        }
        let (ray, length) = surface.towards(light.wi, light.distance);
        walk.rays += 1;
        let medium = if MEDIA { self.scene.medium_beyond(surface, ray.direction, walk.medium) } else { None };
        let passed = self.scene.transmittance(&ray, length, medium, &walk.random.at(Dimension::CONNECTION));
        walk.value *= (value * light.radiance * passed / light.pdf).as_dvec3();
        walk.before *= walk.last * walk.survival * walk.flight;
        // As for complete paths of the path tracer, without the density of the place on the light.
        walk.last = f64::from(self.scene.lights.probability(surface.point, index, self.lights.odds(surface.point)));
        walk.points.push(surface.point);
        walk.steps.push(Step { direction: light.wi, pdf: 0.0, by_kernel: 0.0, event });
        Some(())
    }
}

/// A scatterer, and whether its BSDF reads the number that chooses a lobe.
struct SiteAt<'a> {
    site: Site<'a, f32>,
    chooses: bool,
}

impl Walk<'_> {
    /// Counts a step that crosses indices of ratio `eta`.
    fn go_on(&mut self, roulette: Roulette, drawn: &Drawn, eta: f32) {
        self.value *= drawn.value.as_dvec3();
        self.throughput *= drawn.value / drawn.pdf;
        self.squeezed *= eta * eta;
        // Roulette at the last point before the light does not count, so it is multiplied with the next step only.
        self.before *= self.last * self.survival * self.flight;
        self.last = f64::from(drawn.pdf);
        let survival = unguided_survival(roulette, self.points.len() as u32 + 1, self.throughput, self.squeezed);
        self.throughput /= survival;
        self.survival = f64::from(survival);
    }
}
