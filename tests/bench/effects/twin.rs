//! The path tracer that remains when every effect is cut out: diffuse surfaces, area lights, next event estimation, roulette.
//!
//! It decides what `integrators::path` decides, from the same random numbers and with the same roundings, but keeps and computes
//! nothing that a guide, a medium, another material, a hole or a record would ask for. Rays, points of surfaces, lights and textures
//! are the library's.

use glam::Vec3;

#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx2;
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::lights::Light;
use crate::lights::area::AreaLight;
use crate::materials::diffuse::Diffuse;
use crate::materials::{BsdfSample, Kind};
use crate::math::error_bound::gamma;
use crate::sampling::mis;
use crate::scene::Scene;

/// Bounces before roulette may end a path.
const ROULETTE_START: u32 = 4;

struct Plain {
    two_sided: bool,
    diffuse: Diffuse,
}

/// Traces camera paths.
pub struct Twin<'a> {
    scene: &'a Scene,
    max_depth: u32,
    materials: Vec<Plain>,
    shape_material: Vec<u32>,
    lights: Vec<AreaLight>,
    shape_light: Vec<Option<u32>>,
}

/// What a vertex adds to what arrives at it, and what it lets through.
pub struct Vertex {
    emitted: Vec3,
    direct: Vec3,
    weight: Vec3,
    survival: f32,
}

struct Previous {
    point: Vec3,
    pdf: f32,
}

impl<'a> Twin<'a> {
    /// None where the scene has more than diffuse surfaces and area lights.
    pub fn new(scene: &'a Scene, max_depth: u32) -> Option<Self> {
        let surface = |shape: u32| Surface { shape, ..Surface::in_medium(Vec3::ZERO, 0.0, Vec3::Z) };
        let plain = |shape: u32| {
            let material = scene.material(&surface(shape));
            let Kind::Diffuse(diffuse) = &material.kind else { return None };
            let more = material.opacity.is_some() || material.bump.is_some() || material.tint.is_some();
            (!more).then(|| Plain { two_sided: material.two_sided, diffuse: diffuse.clone() })
        };
        let area = |light: &Light| if let Light::Area(light) = light { Some(light.clone()) } else { None };
        let shapes = 0..scene.shapes.len() as u32;
        Some(Self {
            scene,
            max_depth,
            materials: shapes.clone().map(plain).collect::<Option<_>>()?,
            shape_material: shapes.clone().collect(),
            lights: scene.lights.lights.iter().map(area).collect::<Option<_>>()?,
            shape_light: shapes.map(|shape| scene.light_of(&surface(shape)).map(|(index, _)| index as u32)).collect(),
        })
    }

    /// Radiance along `ray`. Compiled for newer processors too, as ours is.
    pub fn trace(&self, ray: Ray, random: &mut Random, vertices: &mut Vec<Vertex>) -> Vec3 {
        #[cfg(target_arch = "x86_64")]
        if Avx2::detect().is_some() {
            // SAFETY: the processor has the features.
            return unsafe { self.trace_avx2(ray, random, vertices) };
        }
        self.walk(ray, random, vertices)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_avx2(&self, ray: Ray, random: &mut Random, vertices: &mut Vec<Vertex>) -> Vec3 {
        self.walk(ray, random, vertices)
    }

    #[inline(always)]
    fn walk(&self, mut ray: Ray, random: &mut Random, vertices: &mut Vec<Vertex>) -> Vec3 {
        vertices.clear();
        let mut previous: Option<Previous> = None;
        let mut throughput = Vec3::ONE;
        let mut incoming = Vec3::ZERO;
        for depth in 1..=self.max_depth {
            random.begin_vertex(depth);
            let Some(hit) = self.scene.accel.intersect(&ray) else { break };
            let surface = Surface::new(&ray, &hit, &self.scene.shapes[hit.shape as usize]);
            let emitted = self.emission(&surface, &ray, previous);
            if depth == self.max_depth {
                incoming = emitted;
                break;
            }
            let material = &self.materials[self.shape_material[surface.shape as usize] as usize];
            let wo = surface.frame.to_local(-ray.direction);
            let direct = self.direct(&surface, material, wo, random);
            let Some(sample) = material.sample(&surface, wo, random) else {
                incoming = emitted + direct;
                break;
            };
            throughput *= sample.weight;
            let survival = if depth < ROULETTE_START { 1.0 } else { throughput.max_element().clamp(0.05, 0.95) };
            let survives = survival >= 1.0 || random.at(Dimension::ROULETTE).next_f32() < survival;
            if !survives || throughput == Vec3::ZERO {
                incoming = emitted + direct;
                break;
            }
            throughput /= survival;
            vertices.push(Vertex { emitted, direct, weight: sample.weight, survival });
            previous = Some(Previous { point: surface.point, pdf: sample.pdf });
            ray = surface.leave(surface.frame.to_world(sample.wi));
        }
        for vertex in vertices.iter().rev() {
            incoming = vertex.emitted + (vertex.direct + vertex.weight * incoming / vertex.survival);
        }
        incoming
    }

    /// Emission of a surface that the path ran into, weighted against light sampling at the vertex before.
    #[inline(always)]
    fn emission(&self, surface: &Surface, ray: &Ray, previous: Option<Previous>) -> Vec3 {
        let Some(index) = self.shape_light[surface.shape as usize] else { return Vec3::ZERO };
        let light = &self.lights[index as usize];
        let radiance = light.emitted(surface, -ray.direction);
        let Some(Previous { point, pdf }) = previous else { return radiance };
        let choice = self.scene.lights.probability(point, index as usize);
        radiance * mis::balance(pdf, light.pdf(point, surface) * choice)
    }

    /// Light sampling: f·L·w / p for one sampled light.
    #[inline(always)]
    fn direct(&self, surface: &Surface, material: &Plain, wo: Vec3, random: &Random) -> Vec3 {
        let (choice, u) = (self.scene.lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
        let Some((index, probability)) = self.scene.lights.choose(surface.point, choice) else { return Vec3::ZERO };
        let Some(light) = self.lights[index].sample(surface.point, u) else { return Vec3::ZERO };
        let (wo, wi) = material.to_front(wo, surface.frame.to_local(light.wi));
        let value = material.diffuse.eval(surface.uv, wo, wi);
        if value == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let (ray, t_max) = shadow_ray(surface, light.wi, light.distance);
        if t_max > 0.0 && self.scene.accel.occluded(&ray, t_max) {
            return Vec3::ZERO;
        }
        let pdf = light.pdf * probability;
        value * light.radiance * (mis::balance(pdf, Diffuse::pdf(wo, wi)) / pdf)
    }
}

impl Plain {
    #[inline(always)]
    fn to_front(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
        if self.two_sided && wo.z < 0.0 { (-wo, -wi) } else { (wo, wi) }
    }

    #[inline(always)]
    fn sample(&self, surface: &Surface, wo: Vec3, random: &Random) -> Option<BsdfSample> {
        let u = random.at(Dimension::DIRECTION).next_2d();
        let flip = self.two_sided && wo.z < 0.0;
        let sample = self.diffuse.sample(surface.uv, if flip { -wo } else { wo }, u)?;
        Some(if flip { BsdfSample { wi: -sample.wi, ..sample } } else { sample })
    }
}

/// The ray from `surface` to the light point at the finite `distance` in direction `wi`, and where it stops.
#[inline(always)]
fn shadow_ray(surface: &Surface, wi: Vec3, distance: f32) -> (Ray, f32) {
    let ray = surface.leave(wi);
    let target = surface.point + wi * distance;
    let to = target - ray.origin;
    let length = to.length();
    let rounding = gamma(16) * (surface.point.abs() + target.abs()).max_element();
    (Ray { origin: ray.origin, direction: to / length }, length * (1.0 - gamma(256)) - rounding)
}
