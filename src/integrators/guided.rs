//! Complete paths drawn from kept ones (Reibold 2018, §3.3): a kept path is chosen, and the new one follows it from the camera to the light,
//! vertex by vertex, by its kernels or by BSDFs. A path on which something else happens than on the kept one ends.

use glam::{DVec3, Vec3};
use smallvec::SmallVec;

use super::alike::bsdf;
use super::mixture::{Mixture, MixtureSample};
use super::path::{KernelShares, Worth, blind_survival, sky_point};
use super::{Roulette, TransportSettings};
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::guiding::paths::guide::{Chosen, PathGuide};
use crate::guiding::paths::path::{CompletePath, End, Event, Step};
use crate::guiding::paths::spatial::Reach;
use crate::guiding::sample::field::GuideField;
use crate::lights::Light;
use crate::lights::learned::LightSampling;
use crate::lights::seen::{ANYWHERE, facing};
use crate::materials::medium::MediumId;
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::{Material, Transport};
use crate::math::{Frame, channel_mean};
use crate::picture::Window;
use crate::scene::Scene;
use crate::scene::media::Reached;

/// Draws complete paths.
pub struct GuidedTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// The guiding field of the path tracer beside it; none for plain path tracing.
    pub field: Option<&'a GuideField>,
    /// What pixels are expected to be, by which its paths are judged; none where that is not known.
    pub expected: Option<Expected<'a>>,
    /// How lights are sampled.
    pub lights: LightSampling<'a>,
    /// What is drawn from.
    pub guide: &'a PathGuide,
    /// How often kernels choose.
    pub shares: &'a KernelShares,
}

/// Values (channel means) that pixels are expected to have.
#[derive(Debug, Clone, Copy)]
pub struct Expected<'a> {
    /// Of each pixel of the window, row by row, above 0.
    pub values: &'a [f32],
    /// The window.
    pub window: Window,
}

impl Expected<'_> {
    /// The value of the pixel in which a place of the film lies, or of the nearest.
    pub fn at(&self, film: [f32; 2]) -> f32 {
        let Window { x, y, width, height } = self.window;
        let inside = |place: f32, first: u32, count: u32| (place.max(0.0) as u32).saturating_sub(first).min(count - 1);
        let (column, row) = (inside(film[0], x, width), inside(film[1], y, height));
        self.values[row as usize * width as usize + column as usize]
    }
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
    /// What the path tracer's path would carry, and what it would if BSDFs had chosen all directions, see [`blind_survival`].
    throughput: Vec3,
    reflected: Vec3,
    squeezed: f32,
    /// Density of its steps but the last, roulette included, of the last, and the probability of surviving roulette behind that.
    before: f64,
    last: f64,
    survival: f64,
    /// Density of the distance to the point that it arrives at in a medium, or probability of getting to a surface there through media.
    flight: f64,
    /// Probability with which light sampling is tried at its last point.
    tried: f32,
    /// Value of its pixel, if that is known.
    pixel: Option<f32>,
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

/// What the path tracer does at a vertex: how it chooses directions, and the probabilities of light sampling and of going on.
struct At<'a> {
    mixture: Mixture<'a, 'a>,
    worth: Worth,
}

/// A step that was drawn at a vertex.
struct Drawn {
    sample: MixtureSample,
    /// Distance to the next point, if that lies in a medium.
    distance: Option<f32>,
    origin: Vec3,
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
        let ray = self.scene.camera_ray(0, film, self.scene.camera.lens(&random));
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
            reflected: Vec3::ONE,
            squeezed: 1.0,
            before: 1.0,
            last: 1.0,
            survival: 1.0,
            flight: 1.0,
            tried: 0.0,
            pixel: self.field.and(self.expected).map(|expected| expected.at(film)),
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
        walk.reflected *= weight;
        Some(surface.map(|surface| Vertex { surface, phase }))
    }

    /// What the path tracer does where the walk has arrived.
    #[inline(always)]
    fn at(&self, walk: &Walk, surface: &Surface, phase: Option<HenyeyGreenstein>) -> At<'_> {
        let material = if phase.is_none() { Some(self.scene.material(surface)) } else { None };
        let smooth = material.is_some_and(Material::is_delta);
        let bumped = material.is_some_and(|material| material.bump.is_some() && surface.smooth != surface.shading);
        let field = self.field.filter(|_| !smooth);
        let voxel = field.and_then(|field| field.at(surface.point, Self::normal(&walk.ray, surface, phase)));
        let TransportSettings { light_sampling, roulette, .. } = self.settings;
        At {
            mixture: Mixture::new(surface, bsdf(self.scene, phase, surface), bumped, -walk.ray.direction, voxel),
            worth: Worth::new(roulette, light_sampling && !smooth, voxel, channel_mean(walk.throughput), walk.pixel),
        }
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
        let At { mixture, worth } = self.at(walk, surface, phase);
        let by_kernel = match phase {
            _ if wanted.delta => 0.0,
            Some(phase) => KernelShares::in_medium(phase),
            None => self.shares.at(self.scene, surface.shape),
        };
        // Roulette is not played here, so its numbers are free; those of guides are the mixture's.
        let mut guide = walk.random.at(Dimension::ROULETTE);
        let mut drawn = if by_kernel > 0.0 && guide.next_f32() < by_kernel {
            let across = guide.next_2d_f64();
            let reach = walk.chosen.kernel(number)?.sample(surface.point, across, || guide.next_2d_f64())?;
            let Reach { direction, distance } = reach;
            let origin = surface.origin().leave(direction.into()).into();
            Drawn { sample: mixture.towards(direction), distance, origin }
        } else {
            let (sample, origin) = mixture.sample(&walk.random, Transport::Radiance)?;
            Drawn { sample, distance: None, origin }
        };
        let MixtureSample { direction, pdf, delta, .. } = drawn.sample;
        if MEDIA && walk.chosen.path().in_medium(number + 1) && drawn.distance.is_none() {
            let kernel = walk.chosen.kernel(number)?;
            drawn.distance = Some(kernel.distance(surface.point, direction, guide.next_2d_f64())?);
        }
        let (normal, medium) = (Self::normal(&walk.ray, surface, phase), phase.is_some());
        let event = Event { transmits: normal.dot(direction) < 0.0, delta, medium };
        if event != wanted || drawn.sample.weight == Vec3::ZERO {
            return None;
        }
        let eta = self.eta(&walk.ray, surface, phase, direction);
        let roulette = self.settings.roulette;
        walk.go_on(roulette, &drawn.sample, eta, [worth.onward, roulette.usual(self.field)]);
        walk.tried = if event.delta { 0.0 } else { worth.light };
        walk.facing = if self.lights.asks_facing() { facing(normal) } else { ANYWHERE };
        let Drawn { distance, origin, .. } = drawn;
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
        if walk.tried > 0.0 {
            let from = *walk.points.last()?;
            let choice = self.scene.lights.probability(from, index, self.lights.odds(from)) * walk.tried;
            walk.last += f64::from(light.pdf(from, surface) * choice);
        }
        walk.points.push(surface.point);
        Some(())
    }

    /// Ends the path at the sky.
    fn leave(&self, walk: &mut Walk) -> Option<()> {
        let sky = self.lights.view(*walk.points.last()?, walk.facing);
        let (radiance, pdf) = self.scene.lights.background(walk.ray.direction, &sky);
        walk.value *= radiance.as_dvec3();
        walk.last += f64::from(pdf * walk.tried);
        walk.points.push(sky_point(self.scene, *walk.points.last()?, walk.ray.direction));
        Some(())
    }

    /// Ends the path at a light that no ray can hit.
    fn connect<const MEDIA: bool>(&self, walk: &mut Walk, vertex: &Vertex, index: usize) -> Option<()> {
        let (number, surface) = (walk.points.len(), &vertex.surface);
        let phase = vertex.phase.filter(|_| MEDIA);
        let kept = walk.chosen.path().steps.get(number)?;
        let At { mixture, worth } = self.at(walk, surface, phase);
        let normal = Self::normal(&walk.ray, surface, phase);
        let u = walk.random.at(Dimension::LIGHT_POINT).next_2d();
        let light = self.scene.lights.lights[index].sample(
            surface.point,
            u,
            &self.lights.view(surface.point, facing(normal)),
        )?;
        let event = Event { transmits: normal.dot(light.wi) < 0.0, delta: false, medium: phase.is_some() };
        let value = mixture.eval(light.wi);
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
        let choice = self.scene.lights.probability(surface.point, index, self.lights.odds(surface.point));
        walk.last = f64::from(choice * worth.light);
        walk.points.push(surface.point);
        walk.steps.push(Step { direction: light.wi, pdf: 0.0, by_kernel: 0.0, event });
        Some(())
    }
}

impl Walk<'_> {
    /// Counts a step that crosses indices of ratio `eta`; `survival` is the probability of going on by the light that is expected, and `usual`
    /// the radiance that vertices usually send back, if these are known.
    fn go_on(&mut self, roulette: Roulette, drawn: &MixtureSample, eta: f32, [survival, usual]: [Option<f32>; 2]) {
        // Of a delta lobe its factor times its probability; what is never drawn may still be seen of a light that is sampled.
        let value = if drawn.pdf > 0.0 { drawn.weight * drawn.pdf } else { drawn.value };
        self.value *= value.as_dvec3();
        self.throughput *= drawn.weight;
        self.reflected *= drawn.bsdf_weight;
        self.squeezed *= eta * eta;
        // Roulette at the last point before the light does not count, so it is multiplied with the next step only.
        self.before *= self.last * self.survival * self.flight;
        self.last = f64::from(drawn.pdf);
        let judged = self.throughput.max(self.reflected);
        let depth = self.points.len() as u32 + 1;
        let blind = || blind_survival(roulette, depth, judged * self.squeezed, [usual, self.pixel]);
        // What a mirror shows has nothing to do with what the voxel's other directions send back.
        let survival = survival.filter(|_| !drawn.delta).unwrap_or_else(blind);
        self.throughput /= survival;
        self.reflected /= survival;
        self.survival = f64::from(survival);
    }
}
