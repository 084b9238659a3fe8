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
use crate::lights::Light;
use crate::lights::learned::LightSampling;
use crate::lights::seen::{ANYWHERE, facing};
use crate::materials::{Material, Transport};
use crate::math::Frame;
use crate::scene::Scene;

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
    /// Whether light sampling is tried at its last point.
    connects: bool,
    /// Which way the surface there faces.
    facing: u8,
    rays: u64,
}

/// A step that was drawn at a vertex.
struct Drawn {
    direction: Vec3,
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
        let walk = Walk {
            chosen,
            random,
            ray,
            points: SmallVec::new(),
            steps: SmallVec::new(),
            value: DVec3::ONE,
            throughput: Vec3::ONE,
            squeezed: 1.0,
            before: 1.0,
            last: 1.0,
            survival: 1.0,
            connects: false,
            facing: ANYWHERE,
            rays: 0,
        };
        self.follow(walk, film, ray.origin)
    }

    fn follow(&self, mut walk: Walk, film: [f32; 2], origin: Vec3) -> Option<GuidedPath> {
        let kept = walk.chosen.path();
        for number in 0..kept.points.len() {
            walk.random.begin_vertex(number as u32 + 1);
            let ray = walk.ray;
            let surface = self.scene.trace(&ray, &mut walk.random.at(Dimension::SEGMENT));
            walk.rays += 1;
            let ends = number + 1 == kept.points.len();
            match (kept.end, surface) {
                (End::Surface, Some(surface)) if ends => self.hit(&mut walk, &surface)?,
                (End::Sky, None) if ends => self.leave(&mut walk)?,
                (End::Surface | End::Sky, _) if ends => return None,
                (End::Light(light), Some(surface)) if ends => self.connect(&mut walk, &surface, light as usize)?,
                (_, surface) => self.scatter(&mut walk, &surface?)?,
            }
        }
        let Walk { points, steps, value, before, last, rays, .. } = walk;
        let path = CompletePath { film, origin, points, steps, end: kept.end };
        let guided = self.guide.density(&path);
        let (usable, unguided) = (path.is_finite() && value.is_finite() && value != DVec3::ZERO, before * last);
        (usable && guided > 0.0).then_some(GuidedPath { path, value, unguided, guided, rays })
    }

    /// The scatterer where a ray meets a surface.
    fn site<'a>(ray: &Ray, surface: &Surface, material: &'a Material) -> SiteAt<'a> {
        let bsdf = material.at(surface.uv);
        let bumped = material.bump.is_some() && surface.smooth != surface.shading;
        let chooses = bsdf.chooses_lobe();
        let (normal, smooth) = (surface.shading.into(), surface.smooth.into());
        let site = Site::new(surface.origin(), normal, smooth, (-ray.direction).into(), bsdf, bumped);
        SiteAt { site, chooses }
    }

    /// Takes the path on from a vertex as the kept one goes on from there.
    fn scatter(&self, walk: &mut Walk, surface: &Surface) -> Option<()> {
        let number = walk.points.len();
        let wanted = walk.chosen.path().steps.get(number)?.event;
        let material = self.scene.material(surface);
        let SiteAt { site, chooses } = Self::site(&walk.ray, surface, material);
        let by_kernel = if wanted.delta { 0.0 } else { self.shares.at(self.scene, surface.shape) };
        let mut guide = walk.random.at(Dimension::GUIDE);
        let draw = || {
            let onward = site.draw(&one_draw(&walk.random, chooses, None, Transport::Radiance));
            let (weight, pdf): (Vec3, f32) = (onward.weight.into(), onward.pdf);
            (onward.any && onward.delta == wanted.delta).then(|| Drawn {
                direction: onward.direction.into(),
                origin: onward.origin.into(),
                value: weight * pdf,
                pdf,
            })
        };
        let drawn = if by_kernel > 0.0 && guide.next_f32() < by_kernel {
            let direction = walk.chosen.kernel(number)?.sample(surface.point, guide.next_2d_f64())?;
            let (value, pdf) = site.eval_and_pdf(direction.into());
            let origin = surface.origin().leave(direction.into()).into();
            Drawn { direction, origin, value: value.into(), pdf }
        } else {
            draw()?
        };
        let normal = surface.normal_towards(-walk.ray.direction);
        let event = Event { transmits: normal.dot(drawn.direction) < 0.0, delta: wanted.delta };
        if event != wanted || drawn.value == Vec3::ZERO {
            return None;
        }
        let frame = Frame::new(surface.shading);
        let eta = material.eta(frame.to_local(-walk.ray.direction), frame.to_local(drawn.direction));
        walk.go_on(self.settings.roulette, &drawn, eta);
        walk.connects = self.settings.light_sampling && !event.delta;
        walk.facing = if self.lights.asks_facing() { facing(normal) } else { ANYWHERE };
        let Drawn { direction, origin, pdf, .. } = drawn;
        walk.points.push(surface.point);
        walk.steps.push(Step { direction, pdf, by_kernel, event });
        walk.ray = Ray { origin, direction };
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
    fn connect(&self, walk: &mut Walk, surface: &Surface, index: usize) -> Option<()> {
        let number = walk.points.len();
        let kept = walk.chosen.path().steps.get(number)?;
        let SiteAt { site, .. } = Self::site(&walk.ray, surface, self.scene.material(surface));
        let normal = surface.normal_towards(-walk.ray.direction);
        let u = walk.random.at(Dimension::LIGHT_POINT).next_2d();
        let light = self.scene.lights.lights[index].sample(
            surface.point,
            u,
            &self.lights.view(surface.point, facing(normal)),
        )?;
        let event = Event { transmits: normal.dot(light.wi) < 0.0, delta: false };
        let value: Vec3 = site.eval_and_pdf(light.wi.into()).0.into();
        if event != kept.event || value == Vec3::ZERO {
            return None;
        }
        let (ray, length) = surface.towards(light.wi, light.distance);
        walk.rays += 1;
        let passed = self.scene.transmittance(&ray, length, None, &walk.random.at(Dimension::CONNECTION));
        walk.value *= (value * light.radiance * passed / light.pdf).as_dvec3();
        walk.before *= walk.last * walk.survival;
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
        self.before *= self.last * self.survival;
        self.last = f64::from(drawn.pdf);
        let survival = unguided_survival(roulette, self.points.len() as u32 + 1, self.throughput, self.squeezed);
        self.throughput /= survival;
        self.survival = f64::from(survival);
    }
}
