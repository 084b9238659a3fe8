//! The path tracer that remains when every effect is cut out: diffuse surfaces, area lights, next event estimation, roulette.
//!
//! It decides what `integrators::path` decides, from the same random numbers and with the same roundings, but keeps and computes
//! nothing that a guide, a medium, another material, a hole or a record would ask for. Rays, points of surfaces, lights and textures
//! are the library's.

use glam::Vec3;

#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx2;
use crate::base::random::{Dimension, Generators, Random};
use crate::geometry::{Hit, Ray, RayKind, Scratch as Queries, Surface};
use crate::integrators::path::CameraPath;
use crate::lights::Light;
use crate::lights::area::AreaLight;
use crate::lights::seen::LightView;
use crate::materials::diffuse::{self, Diffuse};
use crate::materials::{Kind, Scatter, Transport};
use crate::math::Frames;
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Vectors, Wide, vector};
use crate::sampling::mis;
use crate::scene::Scene;

/// Vertices that are made and then shaded, as many as in ours.
const CHUNK: usize = 256;

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
    pdf: f32,
    bsdf_pdf: f32,
}

/// A path at a vertex.
struct Arrival {
    place: u32,
    path: u32,
    vertex: u32,
}

/// Scratch space, reused from batch to batch.
#[derive(Default)]
pub struct Scratch {
    paths: Vec<Path>,
    alive: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    surfaces: Vec<Surface>,
    arrivals: Vec<Arrival>,
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
        let Scratch { paths, alive, rays, hits, surfaces, arrivals, queries, shadows, connections, occluded, vertices } =
            scratch;
        surfaces.resize(CHUNK, Surface::in_medium(Vec3::ZERO, 0.0, Vec3::Z));
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
            for first in (0..hits.len()).step_by(CHUNK) {
                let places = first..hits.len().min(first + CHUNK);
                self.scene.surfaces(rays, hits, places.clone(), surfaces);
                arrivals.clear();
                for (place, surface) in places.zip(&*surfaces) {
                    let path = alive[place];
                    if self.arrive(&mut paths[path as usize], hits[place].is_some(), surface, vertices) {
                        arrivals.push(Arrival {
                            place: (place - first) as u32,
                            path,
                            vertex: vertices.len() as u32 - 1,
                        });
                    }
                }
                for sixteen in arrivals.chunks(LANES) {
                    let lanes = self.shade(sixteen, surfaces, paths);
                    for (lane, at) in sixteen.iter().enumerate() {
                        let path = &mut paths[at.path as usize];
                        let point = surfaces[at.place as usize].point;
                        if go_on(path, point, &lanes, lane, &mut vertices[at.vertex as usize]) {
                            alive[kept] = at.path;
                            kept += 1;
                        }
                        if lanes.lit >> lane & 1 == 1 {
                            shadows.push(lanes.shadow(lane));
                            connections.push(lanes.connection(lane, at.vertex));
                        }
                    }
                }
            }
            alive.truncate(kept);
            occluded.resize(shadows.len(), false);
            let answer = |way| accel.occluded_all(shadows, way, queries, occluded);
            accel.pace.measure(RayKind::Shadow(depth), shadows.len(), answer);
            for (connection, occluded) in connections.iter().zip(&*occluded) {
                if !occluded {
                    let factor = mis::balance(connection.pdf, connection.bsdf_pdf) / connection.pdf;
                    vertices[connection.vertex as usize].direct = connection.value * factor;
                }
            }
            shadows.clear();
            connections.clear();
        }
    }

    #[inline(always)]
    fn material(&self, surface: &Surface) -> &Plain {
        &self.materials[self.shape_material[surface.shape as usize] as usize]
    }

    /// Takes a path to its next vertex; returns whether it scatters there.
    #[inline(always)]
    fn arrive(&self, path: &mut Path, meets: bool, surface: &Surface, vertices: &mut Vec<Vertex>) -> bool {
        path.depth += 1;
        path.random.begin_vertex(path.depth);
        if !meets {
            return false;
        }
        let emitted = self.emission(surface, &path.ray, path.previous.as_ref());
        let (direct, weight, previous) = (Vec3::ZERO, Vec3::ZERO, path.last);
        path.last = vertices.len() as u32;
        vertices.push(Vertex { emitted, direct, weight, survival: 1.0, previous });
        path.depth < self.max_depth
    }

    /// Emission of a surface that the path ran into, weighted against light sampling at the vertex before.
    #[inline(always)]
    fn emission(&self, surface: &Surface, ray: &Ray, previous: Option<&Previous>) -> Vec3 {
        let Some(index) = self.shape_light[surface.shape as usize] else { return Vec3::ZERO };
        let light = &self.lights[index as usize];
        let radiance = light.emitted(surface, -ray.direction);
        let Some(&Previous { point, pdf }) = previous else { return radiance };
        let choice = self.scene.lights.probability(point, index as usize, None);
        radiance * mis::balance(pdf, light.pdf(point, surface) * choice)
    }

    #[inline(always)]
    fn shade(&self, sixteen: &[Arrival], surfaces: &[Surface], paths: &[Path]) -> Shaded {
        let at = |lane: usize| &sixteen[if lane < sixteen.len() { lane } else { 0 }];
        let surface = std::array::from_fn(|lane| &surfaces[at(lane).place as usize]);
        let path = |lane: usize| &paths[at(lane).path as usize];
        let first = self.material(surface[0]);
        let (mut points, mut two_sided) = ([first.diffuse.at(surface[0].uv); LANES], [first.two_sided; LANES]);
        for lane in 1..sixteen.len() {
            let material = self.material(surface[lane]);
            (points[lane], two_sided[lane]) = (material.diffuse.at(surface[lane].uv), material.two_sided);
        }
        let kernel = Sixteen {
            scene: self.scene,
            surfaces: surface,
            points: &points,
            two_sided: &two_sided,
            rays: std::array::from_fn(|lane| &path(lane).ray),
            randoms: std::array::from_fn(|lane| &path(lane).random),
        };
        lanes::run(kernel).unwrap_or_else(|_| unreachable!("the bench asks for AVX2"))
    }
}

/// Takes a path on from `point`; returns whether it goes on.
#[inline(always)]
fn go_on(path: &mut Path, point: Vec3, lanes: &Shaded, lane: usize, vertex: &mut Vertex) -> bool {
    if lanes.any >> lane & 1 == 0 {
        return false;
    }
    vertex.weight = vector(&lanes.weight, lane);
    path.throughput *= vertex.weight;
    if path.depth >= ROULETTE_START {
        vertex.survival = path.throughput.max_element().clamp(0.05, 0.95);
    }
    let survives = vertex.survival >= 1.0 || lanes.roulette[lane] < vertex.survival;
    let goes_on = survives && path.throughput != Vec3::ZERO;
    if goes_on {
        path.throughput /= vertex.survival;
        path.previous = Some(Previous { point, pdf: lanes.pdf[lane] });
        path.ray = Ray { origin: vector(&lanes.origin, lane), direction: vector(&lanes.direction, lane) };
    }
    goes_on
}

/// Vertices that are shaded together.
struct Sixteen<'g> {
    scene: &'g Scene,
    surfaces: [&'g Surface; LANES],
    points: &'g [diffuse::At<f32>; LANES],
    two_sided: &'g [bool; LANES],
    rays: [&'g Ray; LANES],
    randoms: [&'g Random; LANES],
}

type Column = [f32; LANES];

/// What becomes of them, lane by lane.
#[derive(Default)]
struct Shaded {
    lit: u32,
    any: u32,
    light: Vectors,
    light_pdf: Column,
    bsdf_pdf: Column,
    shadow_origin: Vectors,
    shadow_direction: Vectors,
    shadow_length: Column,
    direction: Vectors,
    weight: Vectors,
    origin: Vectors,
    pdf: Column,
    roulette: Column,
}

impl Shaded {
    #[inline(always)]
    fn shadow(&self, lane: usize) -> (Ray, f32) {
        let (origin, direction) = (vector(&self.shadow_origin, lane), vector(&self.shadow_direction, lane));
        (Ray { origin, direction }, self.shadow_length[lane])
    }

    #[inline(always)]
    fn connection(&self, lane: usize, vertex: u32) -> Connection {
        let (value, pdf) = (vector(&self.light, lane), self.light_pdf[lane]);
        Connection { vertex, value, pdf, bsdf_pdf: self.bsdf_pdf[lane] }
    }
}

impl Kernel for Sixteen<'_> {
    type Output = Shaded;

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Shaded {
        let (origins, normal) = Surface::shading_lanes(wide, &self.surfaces);
        let frames = Frames::new(normal);
        let wo = frames.to_local(-Ray::directions(wide, |lane| self.rays[lane]));
        let [r, g, b, two_sided] = wide.four_columns(|lane| {
            let V3 { x, y, z } = self.points[lane].albedo();
            [x, y, z, if self.two_sided[lane] { 1.0 } else { 0.0 }]
        });
        let (bsdf, two_sided) = (diffuse::At::new(V3::new(r, g, b)), two_sided.above(0.0));
        let turned = two_sided & wo.z.below(0.0);
        let wo = V3::choose(turned, -wo, wo);
        let generators = Generators::new(|lane| self.randoms[lane]);
        let draws = |dimension| generators.draw(dimension);
        let lights = &self.scene.lights;
        let choices = if lights.has_choice() { draws(Dimension::LIGHT).doubles() } else { [0.0; LANES] };
        let light = lights.sample_lanes(
            wide,
            &origins.point,
            &choices,
            &draws(Dimension::LIGHT_POINT).points(),
            &LightView::PLAIN,
        );
        let wi = frames.to_local(light.wi);
        let (value, bsdf_pdf) = bsdf.eval_and_pdf(wo, V3::choose(turned, -wi, wi));
        let shadow = origins.towards(light.wi, light.distance);
        let u = wide.points(&draws(Dimension::DIRECTION).points());
        let drawn = bsdf.sample(wo, u[0], u, Transport::Radiance);
        let direction = frames.to_world(V3::choose(turned, -drawn.wi, drawn.wi));
        Shaded {
            lit: (light.found & !value.is_zero()).answers(),
            any: drawn.found.answers(),
            light: wide.store_vectors(value * light.radiance),
            light_pdf: wide.store(light.pdf),
            bsdf_pdf: wide.store(bsdf_pdf),
            shadow_origin: wide.store_vectors(shadow.0),
            shadow_direction: wide.store_vectors(shadow.1),
            shadow_length: wide.store(shadow.2),
            direction: wide.store_vectors(direction),
            weight: wide.store_vectors(drawn.weight),
            origin: wide.store_vectors(origins.leave(direction)),
            pdf: wide.store(drawn.pdf),
            roulette: draws(Dimension::ROULETTE).numbers(),
        }
    }
}
