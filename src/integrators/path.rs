//! The path tracer: light sampling (next event estimation) with multiple importance sampling, guided directions, Russian roulette, and
//! records of what each vertex received.

mod explain;

pub use explain::{Cause, ExplainedVertex, Explanation, Met, Onward};

use glam::Vec3;

use super::mixture::{Mixture, MixtureSample, Scattering};
use super::{ROULETTE_MOST, ROULETTE_START, Roulette, TransportSettings};
#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx2;
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::guiding::record::{PathRecord, Radiance};
use crate::guiding::sample::field::{GuideField, VoxelGuide};
use crate::guiding::sample::roulette::AdjointRoulette;
use crate::lights::Light;
use crate::materials::Transport;
use crate::materials::medium::MediumId;
use crate::math::channel_mean;
use crate::sampling::mis;
use crate::scene::Scene;
use crate::scene::effects::{Effects, Everything, With};

/// Traces camera paths.
pub struct PathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// The guiding field; none for plain path tracing.
    pub field: Option<&'a GuideField>,
}

/// A path on its way: all that its next segment depends on.
struct PathState {
    ray: Ray,
    /// Segments so far.
    depth: u32,
    /// Π f·|cos θ| / p, roulette and media included.
    throughput: Vec3,
    /// The same as if BSDFs had chosen all directions.
    reflected: Vec3,
    /// Product of the squared indices that radiance was divided by on its way into glass, and will be multiplied by on its way out.
    squeezed: f32,
    medium: Option<MediumId>,
    previous: Option<Previous>,
}

impl PathState {
    fn new(ray: Ray, medium: Option<MediumId>) -> Self {
        let (throughput, reflected) = (Vec3::ONE, Vec3::ONE);
        Self { ray, depth: 0, throughput, reflected, squeezed: 1.0, medium, previous: None }
    }
}

/// Where a segment ended.
struct Arrival<'a> {
    surface: &'a Surface,
    scattering: Scattering<'a>,
    /// Transmittance of the media on the way, over the density of getting here.
    passed: Vec3,
    on_surface: bool,
    /// Emission towards the vertex before.
    emission: Emission,
    /// Shading normal on the side that the path arrived at; zero in a medium.
    normal: Vec3,
    /// Whether only delta lobes scatter here.
    smooth: bool,
    guide: Option<&'a VoxelGuide>,
}

/// Probabilities of light sampling and of going on at a vertex, by the light that is expected there; for the latter none where nothing
/// is known.
struct Worth {
    light: f32,
    onward: Option<f32>,
}

/// Light that a vertex adds, and the part that it lets through of the light that arrives, kept until that light is known.
struct Vertex {
    /// Emission towards the previous vertex as it enters the picture.
    emitted: Vec3,
    /// Light sampling: f·L·w / p.
    direct: Vec3,
    /// f·|cos θ| / p of the direction in which the path went on; zero where it ended.
    weight: Vec3,
    /// Probability of surviving roulette before going on.
    survival: f32,
}

impl Vertex {
    /// Nothing, and the path ends.
    const END: Self = Self { emitted: Vec3::ZERO, direct: Vec3::ZERO, weight: Vec3::ZERO, survival: 1.0 };
}

/// Further data of a vertex for its record; kept only where records are wanted.
struct Details {
    point: Vec3,
    shape: u32,
    /// From the vertex before.
    distance: f32,
    /// Shading normal on the side that the path arrived at; zero in a medium.
    normal: Vec3,
    /// Throughput of the path up to here.
    throughput: Vec3,
    /// Emission towards the previous vertex.
    emission: Emission,
    /// Light sampling at this vertex.
    direct: Direct,
    /// How the path went on; none where it ended.
    step: Option<Step>,
    /// Whether it ended because the direction that was drawn brings nothing: below the horizon, or absorbed.
    absorbed: bool,
}

impl Details {
    /// Of a vertex where the path ends, unless more is said.
    #[inline(always)]
    fn new(at: &Arrival, path: &PathState) -> Self {
        Self {
            point: at.surface.point,
            shape: at.surface.shape,
            distance: at.surface.distance,
            normal: at.normal,
            throughput: path.throughput,
            emission: at.emission,
            direct: Direct::default(),
            step: None,
            absorbed: false,
        }
    }
}

/// Result of light sampling at a vertex.
#[derive(Clone, Copy, Default)]
struct Direct {
    /// f·L·w / p.
    value: Vec3,
    /// The BSDF's part of the density with which the path could have gone there.
    bsdf_share: f32,
    /// Density of light sampling over that one.
    ratio: f32,
}

struct Step {
    sample: MixtureSample,
    /// Probability of surviving roulette before going on.
    survival: f32,
}

/// The previous vertex, as far as the weight of emission that the path runs into depends on it.
#[derive(Clone, Copy)]
struct Previous {
    point: Vec3,
    pdf: f32,
    /// Probability with which light sampling was tried there; 0 where it never is.
    light_probability: f32,
}

/// Scratch space of a worker, reused from path to path.
#[derive(Default)]
pub struct PathScratch {
    vertices: Vec<Vertex>,
    /// Transmittance of the media before each vertex, over the density of getting there; empty where there are no media.
    passed: Vec<Vec3>,
    /// Of each vertex where records are wanted, otherwise none.
    details: Vec<Details>,
}

impl PathScratch {
    #[inline(always)]
    fn push<const RECORDS: bool>(&mut self, vertex: Vertex, details: Details) {
        self.vertices.push(vertex);
        if RECORDS {
            self.details.push(details);
        }
    }
}

/// Beginning of a path, with the scratch space and the counters that it uses on its way.
struct Beginning<'p> {
    ray: Ray,
    random: &'p mut Random,
    /// See [`PathTracer::trace`].
    pixel: Option<f32>,
    scratch: &'p mut PathScratch,
    count: &'p mut RayCount,
}

/// Totals of a worker.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCount {
    /// Nearest-hit and occlusion queries.
    pub rays: u64,
    /// Light paths that ended because their power was not finite.
    pub dropped: u64,
}

impl PathTracer<'_> {
    /// Radiance along `ray` (W·m⁻²·sr⁻¹). `pixel` is about the value that the path's pixel will have, by which what the path still
    /// carries is judged; none where nothing is known of it. Where `records` is given, one record per vertex that is not a delta
    /// surface is added to it.
    pub fn trace(
        &self,
        ray: Ray,
        random: &mut Random,
        scratch: &mut PathScratch,
        pixel: Option<f32>,
        records: Option<&mut Vec<PathRecord>>,
        count: &mut RayCount,
    ) -> Vec3 {
        let needs = self.scene.needs();
        match (needs.media, needs.materials, self.field.is_some()) {
            (true, ..) => self.trace_with::<Everything>(ray, random, scratch, pixel, records, count),
            (_, true, true) => self.trace_with::<With<true, true, false>>(ray, random, scratch, pixel, records, count),
            (_, true, false) => {
                self.trace_with::<With<false, true, false>>(ray, random, scratch, pixel, records, count)
            }
            (_, _, true) => self.trace_with::<With<true, false, false>>(ray, random, scratch, pixel, records, count),
            (_, _, false) => self.trace_with::<With<false, false, false>>(ray, random, scratch, pixel, records, count),
        }
    }

    #[inline]
    fn trace_with<E: Effects>(
        &self,
        ray: Ray,
        random: &mut Random,
        scratch: &mut PathScratch,
        pixel: Option<f32>,
        records: Option<&mut Vec<PathRecord>>,
        count: &mut RayCount,
    ) -> Vec3 {
        scratch.vertices.clear();
        if E::MEDIA {
            scratch.passed.clear();
        }
        let Some(records) = records else {
            let background = self.walk::<E, false>(Beginning { ray, random, pixel, scratch, count });
            return self.gather::<E, false>(scratch, background, |_, _| ());
        };
        scratch.details.clear();
        let background = self.walk::<E, true>(Beginning { ray, random, pixel, scratch, count });
        let record = |i: usize, onward: Vec3| {
            let next = scratch.details.get(i + 1);
            let met = next.map_or(background, |next| next.emission);
            records.extend(record(&scratch.details[i], next, met, onward, pixel.unwrap_or(1.0)));
        };
        self.gather::<E, true>(scratch, background, record)
    }

    /// Extends the path until it ends; returns what the last segment brought from the background.
    #[inline(always)]
    fn walk<E: Effects, const RECORDS: bool>(&self, beginning: Beginning) -> Emission {
        #[cfg(target_arch = "x86_64")]
        if Avx2::detect().is_some() {
            // SAFETY: the processor has the features.
            return unsafe { self.walk_avx2::<E, RECORDS>(beginning) };
        }
        self.walk_portable::<E, RECORDS>(beginning)
    }

    // Ten loops in one function would spill each other's registers, so each remains a function.
    #[inline(never)]
    fn walk_portable<E: Effects, const RECORDS: bool>(&self, beginning: Beginning) -> Emission {
        self.extend::<E, RECORDS>(beginning)
    }

    /// The same compiled for newer processors. Nothing is rounded otherwise: products and sums are not fused unless code asks for it.
    #[cfg(target_arch = "x86_64")]
    #[inline(never)]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn walk_avx2<E: Effects, const RECORDS: bool>(&self, beginning: Beginning) -> Emission {
        self.extend::<E, RECORDS>(beginning)
    }

    #[inline(always)]
    fn extend<E: Effects, const RECORDS: bool>(&self, beginning: Beginning) -> Emission {
        let Beginning { ray, random, pixel, scratch, count } = beginning;
        let mut path = PathState::new(ray, self.scene.camera_medium);
        while path.depth < self.settings.max_depth {
            path.depth += 1;
            random.begin_vertex(path.depth);
            count.rays += 1;
            let (surface, scattering, passed);
            if E::MEDIA || E::MATERIALS {
                let random = &mut random.at(Dimension::SEGMENT);
                let (end, factor) = self.scene.advance::<E>(&path.ray, &mut path.medium, path.throughput, random);
                let Some(found) = Scattering::at(self.scene, end) else { return self.background(&path).dimmed(factor) };
                ((surface, scattering), passed) = (found, factor);
            } else {
                // On plain scenes the surface goes through no enum and is made where it stays: it is long, and every copy shows.
                let Some(hit) = self.scene.accel.intersect(&path.ray) else { return self.background(&path) };
                surface = Surface::new(&path.ray, &hit, &self.scene.shapes[hit.shape as usize]);
                (scattering, passed) = (Scattering::Material(self.scene.material(&surface)), Vec3::ONE);
            }
            let arrival = self.arrive::<E>(&mut path, &surface, scattering, passed);
            if E::MEDIA {
                scratch.passed.push(arrival.passed);
            }
            let mut vertex = Vertex { emitted: arrival.emission.weighted(), ..Vertex::END };
            let mut details = Details::new(&arrival, &path);
            if path.depth == self.settings.max_depth {
                scratch.push::<RECORDS>(vertex, details);
                break;
            }
            let mixture = Mixture::<E>::new(arrival.surface, arrival.scattering, -path.ray.direction, arrival.guide);
            let worth = self.worth::<E>(&path, &arrival, pixel);
            details.direct = self.connect(&path, &arrival, &mixture, worth.light, random, count);
            vertex.direct = details.direct.value;
            let Some(sample) = mixture.sample(random, Transport::Radiance) else {
                details.absorbed = !arrival.smooth;
                scratch.push::<RECORDS>(vertex, details);
                break;
            };
            (vertex.weight, vertex.survival) =
                (sample.weight, self.survival::<E>(&mut path, &mixture, &sample, &worth));
            let survives = vertex.survival >= 1.0 || random.at(Dimension::ROULETTE).next_f32() < vertex.survival;
            details.step = (survives || !sample.delta).then_some(Step { sample, survival: vertex.survival });
            let survival = vertex.survival;
            scratch.push::<RECORDS>(vertex, details);
            if !survives || path.throughput == Vec3::ZERO {
                break;
            }
            self.scatter::<E>(&mut path, &arrival, &sample, survival, worth.light);
        }
        Emission::default()
    }

    /// Takes the path to `surface`, or to a point of a medium, through media that let `passed` through.
    #[inline(always)]
    fn arrive<'s, E: Effects>(
        &'s self,
        path: &mut PathState,
        surface: &'s Surface,
        scattering: Scattering<'s>,
        passed: Vec3,
    ) -> Arrival<'s> {
        if E::MEDIA {
            path.throughput *= passed;
            path.reflected *= passed;
        }
        let on_surface = !E::MEDIA || scattering.is_material();
        let emission = if on_surface { self.emission(surface, path) } else { Emission::default() };
        let normal = if on_surface { surface.normal_towards(-path.ray.direction) } else { Vec3::ZERO };
        let smooth = E::MATERIALS && scattering.is_delta();
        let field = if E::GUIDING { self.field } else { None };
        let guide = field.filter(|_| !smooth).and_then(|field| field.at(surface.point, normal));
        Arrival { surface, scattering, passed, on_surface, emission: emission.dimmed(passed), normal, smooth, guide }
    }

    /// Probabilities of light sampling and of going on at a vertex.
    #[inline(always)]
    fn worth<E: Effects>(&self, path: &PathState, at: &Arrival, pixel: Option<f32>) -> Worth {
        // Without a guide nothing is known by which a path could be judged.
        let pixel = if E::GUIDING { pixel } else { None };
        let carried = channel_mean(path.throughput);
        let importance = pixel.map(|value| carried / value);
        let knows = self.settings.roulette == Roulette::Window;
        let adjoint = at.guide.filter(|_| knows).map_or(AdjointRoulette::UNKNOWN, |guide| guide.roulette);
        let tries = self.settings.light_sampling && !at.smooth;
        let light = importance.map_or(1.0, |importance| adjoint.light_probability(importance, carried));
        Worth {
            light: if tries { light } else { 0.0 },
            onward: importance.and_then(|importance| adjoint.survival(importance, carried)),
        }
    }

    /// Takes the path along the direction that was drawn, to which it survived with probability `survival`.
    #[inline(always)]
    fn scatter<E: Effects>(
        &self,
        path: &mut PathState,
        at: &Arrival,
        sample: &MixtureSample,
        survival: f32,
        light_probability: f32,
    ) {
        path.throughput /= survival;
        path.reflected /= survival;
        let light_probability = if sample.delta { 0.0 } else { light_probability };
        path.previous = Some(Previous { point: at.surface.point, pdf: sample.pdf, light_probability });
        if E::MEDIA && at.on_surface {
            path.medium = self.scene.medium_beyond(at.surface, sample.direction, path.medium);
        }
        path.ray = at.surface.leave(sample.direction);
    }

    /// Probability that the path goes on in the direction that was drawn, by which its throughput is multiplied. Where a guide chose
    /// the direction, f·cos/p is small because p is large, that is because much light is expected there: ending such paths early
    /// would undo what guiding gains. So what counts is the share that the surfaces reflect, as if their BSDFs had chosen the
    /// directions, or the throughput where that is larger. And what glass divides by η² on the way in it multiplies on the way out:
    /// inside of it paths are worth as much as outside.
    #[inline(always)]
    fn survival<E: Effects>(
        &self,
        path: &mut PathState,
        mixture: &Mixture<E>,
        sample: &MixtureSample,
        worth: &Worth,
    ) -> f32 {
        path.throughput *= sample.weight;
        // Without a guide both are the same.
        path.reflected = if E::GUIDING { path.reflected * sample.bsdf_weight } else { path.throughput };
        if E::MATERIALS {
            path.squeezed *= mixture.eta(sample.direction).powi(2);
        }
        // What a mirror shows has nothing to do with what the voxel's other directions send back.
        if let Some(expected) = worth.onward.filter(|_| !sample.delta) {
            return expected;
        }
        if self.settings.roulette == Roulette::Off || path.depth < ROULETTE_START {
            return 1.0;
        }
        let judged = if E::GUIDING { path.throughput.max(path.reflected) } else { path.throughput };
        (judged * path.squeezed).max_element().clamp(0.05, ROULETTE_MOST)
    }

    /// Emission of a surface that the path ran into.
    #[inline(always)]
    fn emission(&self, surface: &Surface, path: &PathState) -> Emission {
        let Some((index, Light::Area(light))) = self.scene.light_of(surface) else { return Emission::default() };
        let radiance = light.emitted(surface, -path.ray.direction);
        match path.previous {
            Some(p) if p.light_probability > 0.0 => {
                let choice = self.scene.lights.probability(p.point, index) * p.light_probability;
                let weight = mis::balance(p.pdf, light.pdf(p.point, surface) * choice);
                Emission { radiance, weight, connected: true }
            }
            _ => Emission { radiance, weight: 1.0, connected: false },
        }
    }

    #[inline(always)]
    fn background(&self, path: &PathState) -> Emission {
        let (radiance, light_pdf) = self.scene.lights.background(path.ray.direction);
        match path.previous {
            Some(p) if p.light_probability > 0.0 => {
                let weight = mis::balance(p.pdf, light_pdf * p.light_probability);
                Emission { radiance, weight, connected: true }
            }
            _ => Emission { radiance, weight: 1.0, connected: false },
        }
    }

    /// Light sampling: f·L·w / p for one sampled light, tried with `probability`.
    #[inline(always)]
    fn connect<E: Effects>(
        &self,
        path: &PathState,
        at: &Arrival,
        mixture: &Mixture<E>,
        probability: f32,
        random: &Random,
        count: &mut RayCount,
    ) -> Direct {
        let (nothing, surface) = (Direct::default(), at.surface);
        if probability <= 0.0 {
            return nothing;
        }
        if E::GUIDING && probability < 1.0 && random.at(Dimension::CONNECTION).next_f32() >= probability {
            return nothing;
        }
        let lights = &self.scene.lights;
        let (choice, u) = (lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
        let Some(light) = lights.sample(surface.point, choice, u) else { return nothing };
        let value = mixture.eval(light.wi);
        if value == Vec3::ZERO {
            return nothing;
        }
        let (ray, t_max) = surface.towards(light.wi, light.distance);
        count.rays += 1;
        let visible = self.scene.passes::<E>(surface, &ray, t_max, path.medium);
        if visible == Vec3::ZERO {
            return nothing;
        }
        // The density is not asked for before it is needed: most lights are hidden where guiding helps most.
        let pdf = light.pdf * probability;
        let (onward, bsdf_share) = if light.delta { (0.0, 1.0) } else { mixture.pdf(light.wi) };
        let weight = if light.delta { 1.0 } else { mis::balance(pdf, onward) };
        Direct { value: value * light.radiance * visible * (weight / pdf), bsdf_share, ratio: pdf / onward }
    }
}

/// Light that a path ran into.
#[derive(Clone, Copy, Default)]
struct Emission {
    radiance: Vec3,
    /// Against light sampling at the previous vertex: p / (p + p_l).
    weight: f32,
    /// Whether that could have found it.
    connected: bool,
}

impl Emission {
    /// The same seen through a medium that lets `passed` through.
    fn dimmed(self, passed: Vec3) -> Self {
        Self { radiance: self.radiance * passed, ..self }
    }

    /// As it enters the picture.
    fn weighted(self) -> Vec3 {
        self.radiance * self.weight
    }
}

impl PathTracer<'_> {
    /// Sums the path from its end: radiance leaving each vertex towards the one before. Where records are wanted, `record` is told
    /// of each step: the number of its vertex, and what arrived along it beside the emission that it met.
    #[inline(always)]
    fn gather<E: Effects, const RECORDS: bool>(
        &self,
        scratch: &PathScratch,
        background: Emission,
        mut record: impl FnMut(usize, Vec3),
    ) -> Vec3 {
        let (mut incoming, mut onward) = (background.weighted(), Vec3::ZERO);
        for (i, vertex) in scratch.vertices.iter().enumerate().rev() {
            if RECORDS {
                record(i, onward);
            }
            // Nothing arrives where the path has ended.
            onward = vertex.direct + vertex.weight * incoming / vertex.survival;
            if E::MEDIA {
                onward *= scratch.passed[i];
            }
            incoming = vertex.emitted + onward;
        }
        incoming
    }
}

/// The record of the direction sampled at `vertex`, which met the emission `met` and along which `onward` radiance arrived beside it.
/// None for a delta lobe. A direction that brings nothing is recorded too, without itself: left out, what is expected of a vertex
/// would be too much.
fn record(vertex: &Details, next: Option<&Details>, met: Emission, onward: Vec3, pixel: f32) -> Option<PathRecord> {
    let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
    let absorbed = PathRecord {
        importance: finite(channel_mean(vertex.throughput) / pixel),
        direct: finite(channel_mean(vertex.direct.value)),
        direct_share: vertex.direct.bsdf_share,
        direct_ratio: vertex.direct.ratio,
        ..PathRecord::absorbed(vertex.point, vertex.normal)
    };
    if vertex.absorbed {
        return Some(absorbed);
    }
    let Step { sample, survival } = vertex.step.as_ref().filter(|step| !step.sample.delta)?;
    let arrived = if met.connected { [met.weighted(), onward] } else { [Vec3::ZERO, onward + met.weighted()] };
    let kinds = |[emitted, onward]: [f32; 2]| Radiance { emitted: finite(emitted), onward: finite(onward) };
    Some(PathRecord {
        direction: sample.direction,
        distance: next.map_or(f32::INFINITY, |n| n.distance),
        pdf: sample.pdf * survival,
        bsdf_share: sample.bsdf_share,
        radiance: kinds(arrived.map(channel_mean)),
        brought: kinds(arrived.map(|radiance| channel_mean(sample.weight * radiance) / survival)),
        light_ratio: 1.0 / met.weight - 1.0,
        ..absorbed
    })
}
