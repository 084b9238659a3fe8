//! The path tracer: next event estimation with multiple importance sampling, guided directions, Russian roulette, and
//! records of what each vertex received.

use glam::Vec3;

use super::mixture::{Mixture, MixtureSample};
use super::{ROULETTE_MOST, ROULETTE_START, TransportSettings};
use crate::base::random::Random;
use crate::geometry::{Ray, Surface};
use crate::guiding::field::GuideField;
use crate::guiding::leaves::Target;
use crate::guiding::record::PathRecord;
use crate::lights::Light;
use crate::materials::Transport;
use crate::math::channel_mean;
use crate::math::error_bound::gamma;
use crate::sampling::mis;
use crate::scene::Scene;

/// Traces camera paths.
pub struct PathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// What guides the directions; none for plain path tracing.
    pub field: Option<&'a GuideField>,
    /// What records are to hold.
    pub target: Target,
}

/// One vertex of a camera path, kept until the light it received is known.
struct Vertex {
    surface: Surface,
    /// Shading normal on the side that the path arrived at.
    normal: Vec3,
    /// Throughput of the path up to here.
    throughput: Vec3,
    /// Emission towards the previous vertex, weighted against what light sampling does there.
    emission: Vec3,
    /// Whether `emission` was already sampled by next event estimation at the previous vertex.
    connected: bool,
    /// Light sampling at this vertex, times f.
    direct: Vec3,
    /// How the path went on; none where it ended.
    step: Option<Step>,
}

struct Step {
    sample: MixtureSample,
    /// Probability of surviving roulette before going on.
    survival: f32,
}

/// What has to be remembered of the previous vertex to weight emission that the path runs into.
#[derive(Clone, Copy)]
struct Previous {
    point: Vec3,
    pdf: f32,
    delta: bool,
}

/// Scratch space of a worker, reused from path to path.
#[derive(Default)]
pub struct PathScratch {
    vertices: Vec<Vertex>,
}

/// Totals of a worker.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCount {
    /// Nearest-hit and occlusion queries.
    pub rays: u64,
}

impl PathTracer<'_> {
    /// Radiance along `ray` (W·m⁻²·sr⁻¹). Where `records` is given, one record per vertex that is not a delta surface is
    /// added to it; `pixel` is then the value that the path's pixel will have, which only one of the targets asks for.
    pub fn trace(
        &self,
        ray: Ray,
        random: &mut Random,
        scratch: &mut PathScratch,
        records: Option<(&mut Vec<PathRecord>, f32)>,
        count: &mut RayCount,
    ) -> Vec3 {
        scratch.vertices.clear();
        let background = self.walk(ray, random, &mut scratch.vertices, count);
        self.gather(&scratch.vertices, background, records)
    }

    /// Extends the path until it ends; returns what the last segment brought from the background.
    fn walk(&self, mut ray: Ray, random: &mut Random, vertices: &mut Vec<Vertex>, count: &mut RayCount) -> Incoming {
        let mut previous: Option<Previous> = None;
        let mut throughput = Vec3::ONE;
        let mut reflected = Vec3::ONE;
        for depth in 1.. {
            if depth > self.settings.max_depth {
                break;
            }
            count.rays += 1;
            let Some(surface) = self.scene.intersect(&ray) else {
                return self.background(&ray, previous);
            };
            let (emission, connected) = self.emission(&surface, &ray, previous);
            let material = self.scene.material(&surface);
            let normal = surface.normal_towards(-ray.direction);
            let mut vertex =
                Vertex { surface, normal, throughput, emission, connected, direct: Vec3::ZERO, step: None };
            if depth == self.settings.max_depth {
                vertices.push(vertex);
                break;
            }
            let mixture = Mixture::new(&surface, material, -ray.direction, self.field);
            if self.settings.nee && !material.is_delta() {
                vertex.direct = self.connect(&surface, &mixture, random, count);
            }
            let Some(sample) = mixture.sample(random, Transport::Radiance) else {
                vertices.push(vertex);
                break;
            };
            throughput *= sample.weight;
            reflected *= sample.bsdf_weight;
            let survival = self.survival(depth, throughput.max(reflected));
            let survives = survival >= 1.0 || random.next_f32() < survival;
            vertex.step = (survives || !sample.delta).then_some(Step { sample, survival });
            vertices.push(vertex);
            if !survives || throughput == Vec3::ZERO {
                break;
            }
            throughput /= survival;
            reflected /= survival;
            previous = Some(Previous { point: surface.point, pdf: sample.pdf, delta: sample.delta });
            ray = surface.leave(sample.direction);
        }
        Incoming::default()
    }

    /// Probability that the path goes on. Where a guide chose the direction, f·cos/p is small because p is large, that is
    /// because much light is expected there: ending such paths early would undo what guiding gains. So what counts is the
    /// share that the surfaces reflect, as if their BSDFs had chosen the directions, or the throughput where that is larger.
    fn survival(&self, depth: u32, throughput: Vec3) -> f32 {
        if !self.settings.roulette || depth < ROULETTE_START {
            return 1.0;
        }
        throughput.max_element().clamp(0.05, ROULETTE_MOST)
    }

    /// Emission of a surface that the path ran into, and whether light sampling at the previous vertex covers it too.
    fn emission(&self, surface: &Surface, ray: &Ray, previous: Option<Previous>) -> (Vec3, bool) {
        let Some((index, Light::Area(light))) = self.scene.light_of(surface) else { return (Vec3::ZERO, false) };
        let emitted = light.emitted(surface, -ray.direction);
        match previous {
            Some(p) if !p.delta && self.settings.nee => {
                let choice = self.scene.lights.selection.probability(index) as f32;
                let weight = mis::balance(p.pdf, light.pdf(p.point, surface) * choice);
                (emitted * weight, true)
            }
            _ => (emitted, false),
        }
    }

    fn background(&self, ray: &Ray, previous: Option<Previous>) -> Incoming {
        let (radiance, light_pdf) = self.scene.lights.background(ray.direction);
        match previous {
            Some(p) if !p.delta && self.settings.nee => {
                Incoming { radiance: radiance * mis::balance(p.pdf, light_pdf), connected: true }
            }
            _ => Incoming { radiance, connected: false },
        }
    }

    /// Next event estimation: f·L·w / p for one sampled light.
    fn connect(&self, surface: &Surface, mixture: &Mixture, random: &mut Random, count: &mut RayCount) -> Vec3 {
        let (choice, u) = (random.next_f64(), random.next_2d());
        let Some(light) = self.scene.lights.sample(surface.point, choice, u) else { return Vec3::ZERO };
        let value = mixture.eval(light.wi);
        if value == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let (ray, t_max) = shadow_ray(surface, light.wi, light.distance);
        count.rays += 1;
        if t_max > 0.0 && self.scene.accel.occluded(&ray, t_max) {
            return Vec3::ZERO;
        }
        // The density is not asked for before it is needed: most lights are hidden where guiding helps most.
        let weight = if light.delta { 1.0 } else { mis::balance(light.pdf, mixture.pdf(light.wi)) };
        value * light.radiance * (weight / light.pdf)
    }
}

/// The ray from `surface` to the light point at `distance` in direction `wi`, and where it stops. It is aimed from its offset
/// origin, since at grazing angles the offset would otherwise carry it past the light, and ends short of the light by the
/// rounding of both ends.
fn shadow_ray(surface: &Surface, wi: Vec3, distance: f32) -> (Ray, f32) {
    let ray = surface.leave(wi);
    if distance.is_infinite() {
        return (ray, distance);
    }
    let target = surface.point + wi * distance;
    let to = target - ray.origin;
    let length = to.length();
    let rounding = gamma(16) * (surface.point.abs() + target.abs()).max_element();
    (Ray { origin: ray.origin, direction: to / length }, length * (1.0 - gamma(256)) - rounding)
}

/// Radiance that arrives along a segment.
#[derive(Clone, Copy, Default)]
struct Incoming {
    radiance: Vec3,
    connected: bool,
}

impl PathTracer<'_> {
    /// Sums the path from its end: radiance leaving each vertex towards the one before, and a record for each direction.
    fn gather(
        &self,
        vertices: &[Vertex],
        background: Incoming,
        mut records: Option<(&mut Vec<PathRecord>, f32)>,
    ) -> Vec3 {
        let nee = self.settings.nee;
        let mut incoming = background.radiance;
        // What light sampling at the receiver also finds is left out of what is learned (see SEMANTICS: NEE on).
        let mut learned = if background.connected && nee { Vec3::ZERO } else { background.radiance };
        for (i, vertex) in vertices.iter().enumerate().rev() {
            let mut reflected = vertex.direct;
            if let Some(step) = &vertex.step {
                reflected += step.sample.weight * incoming / step.survival;
                if let Some((records, pixel)) = records.as_mut().filter(|_| !step.sample.delta) {
                    records.push(self.record(vertex, step, vertices.get(i + 1), [incoming, learned], *pixel));
                }
            }
            incoming = vertex.emission + reflected;
            learned = if vertex.connected && nee { reflected } else { incoming };
        }
        incoming
    }

    /// The record of the direction sampled at `vertex`, along which `incoming` radiance arrived, weighted against light
    /// sampling; `learned` is what of it trees are to learn.
    fn record(
        &self,
        vertex: &Vertex,
        step: &Step,
        next: Option<&Vertex>,
        [incoming, learned]: [Vec3; 2],
        pixel: f32,
    ) -> PathRecord {
        let sample = &step.sample;
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let brought = |radiance: Vec3| finite(channel_mean(sample.weight * radiance) / step.survival);
        let estimate = brought(learned);
        let pdf = sample.pdf * step.survival;
        let importance = finite(channel_mean(vertex.throughput) / pixel);
        let value = match self.target {
            Target::Radiance => channel_mean(learned) / pdf,
            Target::Variance => estimate * pdf.sqrt(),
            Target::VariancePixel => estimate * pdf.sqrt() * importance,
        };
        PathRecord {
            point: vertex.surface.point,
            direction: sample.direction,
            estimate: brought(incoming),
            importance,
            value: finite(value),
            bsdf_share: sample.bsdf_share,
            bsdf: if sample.cos > 0.0 { (channel_mean(sample.value) / sample.cos).min(1e6) } else { 0.0 },
            distance: next.map_or(f32::INFINITY, |n| n.surface.distance),
            normal: vertex.normal,
            next_normal: next.map_or(Vec3::ZERO, |n| n.normal),
        }
    }
}
