//! The path tracer that remains when every effect is cut out: diffuse surfaces, area lights, next event estimation, roulette.
//!
//! It decides what `integrators::path` decides, from the same random numbers and with the same roundings, but keeps and computes
//! nothing that a guide, a medium, another material, a hole or a record would ask for. Rays, points of surfaces, lights and textures
//! are the library's.

use glam::Vec3;

#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx2;
use crate::base::random::{Dimension, Random};
use crate::geometry::{Hit, Ray, RayKind, Scratch as Queries, Surface};
use crate::integrators::path::CameraPath;
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
struct Vertex {
    emitted: Vec3,
    direct: Vec3,
    weight: Vec3,
    survival: f32,
    previous: u32,
}

struct Previous {
    point: Vec3,
    pdf: f32,
}

/// A path on its way.
struct Path {
    ray: Ray,
    random: Random,
    depth: u32,
    throughput: Vec3,
    previous: Option<Previous>,
    last: u32,
}

/// Light of a vertex that a shadow ray decides about.
struct Connection {
    vertex: u32,
    value: Vec3,
}

/// Scratch space, reused from batch to batch.
#[derive(Default)]
pub struct Scratch {
    paths: Vec<Path>,
    alive: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    queries: Queries,
    shadows: Vec<(Ray, f32)>,
    connections: Vec<Connection>,
    occluded: Vec<bool>,
    vertices: Vec<Vertex>,
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

    /// Radiance of each path. Compiled for newer processors too, as ours is.
    pub fn trace(&self, begun: impl Iterator<Item = CameraPath>, scratch: &mut Scratch, radiance: &mut Vec<Vec3>) {
        scratch.vertices.clear();
        scratch.paths.clear();
        scratch.paths.extend(begun.map(|CameraPath { ray, random, .. }| Path {
            ray,
            random,
            depth: 0,
            throughput: Vec3::ONE,
            previous: None,
            last: u32::MAX,
        }));
        scratch.alive.clear();
        scratch.alive.extend(0..scratch.paths.len() as u32);
        self.walk(scratch);
        radiance.extend(scratch.paths.iter().map(|path| {
            let (mut incoming, mut at) = (Vec3::ZERO, path.last);
            while let Some(vertex) = scratch.vertices.get(at as usize) {
                incoming = vertex.emitted + (vertex.direct + vertex.weight * incoming / vertex.survival);
                at = vertex.previous;
            }
            incoming
        }));
    }

    fn walk(&self, scratch: &mut Scratch) {
        #[cfg(target_arch = "x86_64")]
        if Avx2::detect().is_some() {
            // SAFETY: the processor has the features.
            return unsafe { self.walk_avx2(scratch) };
        }
        self.extend(scratch);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn walk_avx2(&self, scratch: &mut Scratch) {
        self.extend(scratch);
    }

    #[inline(always)]
    fn extend(&self, scratch: &mut Scratch) {
        let Scratch { paths, alive, rays, hits, queries, shadows, connections, occluded, vertices } = scratch;
        for depth in 1..=self.max_depth {
            if alive.is_empty() {
                break;
            }
            rays.clear();
            rays.extend(alive.iter().map(|&path| paths[path as usize].ray));
            let accel = &self.scene.accel;
            hits.resize(rays.len(), None);
            accel.pace.measure(RayKind::Path(depth), rays.len(), |way| accel.intersect_all(rays, way, queries, hits));
            let mut kept = 0;
            for (place, hit) in hits.iter().enumerate() {
                self.scene.prefetch(rays, hits, place);
                let path = alive[place];
                if self.visit(&mut paths[path as usize], *hit, vertices, shadows, connections) {
                    alive[kept] = path;
                    kept += 1;
                }
            }
            alive.truncate(kept);
            occluded.resize(shadows.len(), false);
            let answer = |way| accel.occluded_all(shadows, way, queries, occluded);
            accel.pace.measure(RayKind::Shadow(depth), shadows.len(), answer);
            for (connection, occluded) in connections.iter().zip(&*occluded) {
                if !occluded {
                    vertices[connection.vertex as usize].direct = connection.value;
                }
            }
            shadows.clear();
            connections.clear();
        }
    }

    /// Takes a path to its next vertex; returns whether it goes on.
    #[inline(always)]
    fn visit(
        &self,
        path: &mut Path,
        hit: Option<Hit>,
        vertices: &mut Vec<Vertex>,
        shadows: &mut Vec<(Ray, f32)>,
        connections: &mut Vec<Connection>,
    ) -> bool {
        path.depth += 1;
        path.random.begin_vertex(path.depth);
        let Some(hit) = hit else { return false };
        let surface = Surface::new(&path.ray, &hit, &self.scene.shapes[hit.shape as usize]);
        let emitted = self.emission(&surface, &path.ray, path.previous.as_ref());
        let mut vertex = Vertex { emitted, direct: Vec3::ZERO, weight: Vec3::ZERO, survival: 1.0, previous: path.last };
        let mut goes_on = false;
        if path.depth < self.max_depth {
            let material = &self.materials[self.shape_material[surface.shape as usize] as usize];
            let wo = surface.frame.to_local(-path.ray.direction);
            if let Some((ray, value)) = self.direct(&surface, material, wo, &path.random) {
                shadows.push(ray);
                connections.push(Connection { vertex: vertices.len() as u32, value });
            }
            if let Some(sample) = material.sample(&surface, wo, &path.random) {
                path.throughput *= sample.weight;
                vertex.weight = sample.weight;
                if path.depth >= ROULETTE_START {
                    vertex.survival = path.throughput.max_element().clamp(0.05, 0.95);
                }
                let survives =
                    vertex.survival >= 1.0 || path.random.at(Dimension::ROULETTE).next_f32() < vertex.survival;
                goes_on = survives && path.throughput != Vec3::ZERO;
                if goes_on {
                    path.throughput /= vertex.survival;
                    path.previous = Some(Previous { point: surface.point, pdf: sample.pdf });
                    path.ray = surface.leave(surface.frame.to_world(sample.wi));
                }
            }
        }
        path.last = vertices.len() as u32;
        vertices.push(vertex);
        goes_on
    }

    /// Emission of a surface that the path ran into, weighted against light sampling at the vertex before.
    #[inline(always)]
    fn emission(&self, surface: &Surface, ray: &Ray, previous: Option<&Previous>) -> Vec3 {
        let Some(index) = self.shape_light[surface.shape as usize] else { return Vec3::ZERO };
        let light = &self.lights[index as usize];
        let radiance = light.emitted(surface, -ray.direction);
        let Some(&Previous { point, pdf }) = previous else { return radiance };
        let choice = self.scene.lights.probability(point, index as usize);
        radiance * mis::balance(pdf, light.pdf(point, surface) * choice)
    }

    /// Light sampling: the shadow ray to one sampled light, and f·L·w / p.
    #[inline(always)]
    fn direct(&self, surface: &Surface, material: &Plain, wo: Vec3, random: &Random) -> Option<((Ray, f32), Vec3)> {
        let (choice, u) = (self.scene.lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
        let (index, probability) = self.scene.lights.choose(surface.point, choice)?;
        let light = self.lights[index].sample(surface.point, u)?;
        let (wo, wi) = material.to_front(wo, surface.frame.to_local(light.wi));
        let value = material.diffuse.eval(surface.uv, wo, wi);
        if value == Vec3::ZERO {
            return None;
        }
        let pdf = light.pdf * probability;
        let value = value * light.radiance * (mis::balance(pdf, Diffuse::pdf(wo, wi)) / pdf);
        Some((shadow_ray(surface, light.wi, light.distance), value))
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
