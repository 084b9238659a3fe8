//! The path tracer: light sampling (next event estimation) with multiple importance sampling, guided directions, Russian roulette, and
//! records of what each vertex received.

#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
mod batch;
mod explain;

pub use batch::PathScratch;
pub use explain::{Cause, ExplainedVertex, Explanation, Met, Onward};

use glam::Vec3;

use super::mixture::{Mixture, MixtureSample, Scattering};
use super::{ROULETTE_MOST, ROULETTE_START, Roulette, TransportSettings};
use crate::base::random::{Dimension, Random};
use crate::geometry::{Hit, Ray, Surface};
use crate::guiding::record::{PathRecord, Radiance};
use crate::guiding::sample::field::{GuideField, VoxelGuide};
use crate::guiding::sample::roulette::AdjointRoulette;
use crate::lights::Light;
use crate::materials::Transport;
use crate::materials::medium::MediumId;
use crate::math::channel_mean;
use crate::sampling::mis;
use crate::scene::Scene;
use crate::scene::effects::Effects;
use batch::{Connection, Shadows, Vertices};

/// Traces camera paths.
pub struct PathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// The guiding field; none for plain path tracing.
    pub field: Option<&'a GuideField>,
}

/// The beginning of a camera path.
pub struct CameraPath {
    /// The camera's ray.
    pub ray: Ray,
    /// Random numbers of the path.
    pub random: Random,
    /// About the value of its pixel, by which what the path still carries is judged; none where nothing is known of it.
    pub pixel: Option<f32>,
}

/// A path on its way: all that its next segment depends on.
struct PathState {
    ray: Ray,
    random: Random,
    /// See [`CameraPath::pixel`].
    pixel: Option<f32>,
    /// Segments so far.
    depth: u32,
    /// Π f·|cos θ| / p, roulette and media included.
    throughput: Vec3,
    /// The same as if BSDFs had chosen all directions; not kept without a guide, where both are the same.
    reflected: Vec3,
    /// Product of the squared indices that radiance was divided by on its way into glass, and will be multiplied by on its way out.
    squeezed: f32,
    medium: Option<MediumId>,
    previous: Option<Previous>,
    /// Index of its last vertex so far.
    last: u32,
    /// Emission that it ran into infinitely far away.
    background: Emission,
}

impl PathState {
    fn new(CameraPath { ray, random, pixel }: CameraPath, medium: Option<MediumId>) -> Self {
        Self {
            ray,
            random,
            pixel,
            depth: 0,
            throughput: Vec3::ONE,
            reflected: Vec3::ONE,
            squeezed: 1.0,
            medium,
            previous: None,
            last: NO_VERTEX,
            background: Emission::default(),
        }
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
    /// Index of the path's vertex before this one.
    previous: u32,
}

/// Index where there is no vertex.
const NO_VERTEX: u32 = u32::MAX;

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

/// Totals of a worker.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCount {
    /// Nearest-hit and occlusion queries.
    pub rays: u64,
    /// Light paths that ended because their power was not finite.
    pub dropped: u64,
}

impl PathTracer<'_> {
    /// Takes a path to its next vertex, at `hit` or behind it, and chooses how it goes on from there. Returns whether it does.
    #[inline(always)]
    fn visit<E: Effects, const RECORDS: bool>(
        &self,
        path: &mut PathState,
        hit: Option<Hit>,
        vertices: &mut Vertices,
        shadows: &mut Shadows,
    ) -> bool {
        path.depth += 1;
        path.random.begin_vertex(path.depth);
        let (surface, scattering, passed);
        if E::MEDIA || E::MATERIALS {
            let random = &mut path.random.at(Dimension::SEGMENT);
            let (end, factor) = self.scene.advance::<E>(&path.ray, hit, &mut path.medium, path.throughput, random);
            let Some(found) = Scattering::at(self.scene, end) else {
                path.background = self.background(path).dimmed(factor);
                return false;
            };
            ((surface, scattering), passed) = (found, factor);
        } else {
            // On plain scenes the surface goes through no enum and is made where it stays: it is long, and every copy shows.
            let Some(hit) = hit else {
                path.background = self.background(path);
                return false;
            };
            surface = Surface::new(&path.ray, &hit, &self.scene.shapes[hit.shape as usize]);
            (scattering, passed) = (Scattering::Material(self.scene.material(&surface)), Vec3::ONE);
        }
        let arrival = self.arrive::<E>(path, &surface, scattering, passed);
        let mut details = Details::new(&arrival, path);
        let mut vertex = Vertex {
            emitted: arrival.emission.weighted(),
            direct: Vec3::ZERO,
            weight: Vec3::ZERO,
            survival: 1.0,
            previous: path.last,
        };
        path.last = vertices.next();
        let goes_on =
            path.depth < self.settings.max_depth && self.go_on::<E>(path, &arrival, &mut vertex, &mut details, shadows);
        vertices.push::<E, RECORDS>(vertex, arrival.passed, details);
        goes_on
    }

    /// Connects a path at its last vertex to a light and chooses its next direction; returns whether it goes on.
    #[inline(always)]
    fn go_on<E: Effects>(
        &self,
        path: &mut PathState,
        arrival: &Arrival,
        vertex: &mut Vertex,
        details: &mut Details,
        shadows: &mut Shadows,
    ) -> bool {
        let mixture = Mixture::<E>::new(arrival.surface, arrival.scattering, -path.ray.direction, arrival.guide);
        let worth = self.worth::<E>(path, arrival);
        details.direct = self.connect(path, arrival, &mixture, worth.light, shadows);
        let Some(sample) = mixture.sample(&path.random, Transport::Radiance) else {
            details.absorbed = !arrival.smooth;
            return false;
        };
        vertex.weight = sample.weight;
        vertex.survival = self.survival::<E>(path, &mixture, &sample, &worth);
        let survives = vertex.survival >= 1.0 || path.random.at(Dimension::ROULETTE).next_f32() < vertex.survival;
        details.step = (survives || !sample.delta).then_some(Step { sample, survival: vertex.survival });
        let goes_on = survives && path.throughput != Vec3::ZERO;
        if goes_on {
            self.scatter::<E>(path, arrival, &sample, vertex.survival, worth.light);
        }
        goes_on
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
    fn worth<E: Effects>(&self, path: &PathState, at: &Arrival) -> Worth {
        // Without a guide nothing is known by which a path could be judged.
        let pixel = if E::GUIDING { path.pixel } else { None };
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
        if E::GUIDING {
            path.reflected /= survival;
        }
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
        if E::GUIDING {
            path.reflected *= sample.bsdf_weight;
        }
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

    /// Light sampling, tried with `probability`: a connection to one sampled light, unless it would bring nothing. Returns what it tells
    /// of the densities; whether it brings light is known later.
    #[inline(always)]
    fn connect<E: Effects>(
        &self,
        path: &PathState,
        at: &Arrival,
        mixture: &Mixture<E>,
        probability: f32,
        shadows: &mut Shadows,
    ) -> Direct {
        let (nothing, surface, random) = (Direct::default(), at.surface, &path.random);
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
        let shadow = surface.towards(light.wi, light.distance);
        if E::MEDIA {
            shadows.media.push(self.scene.medium_beyond(surface, shadow.0.direction, path.medium));
        }
        let pdf = light.pdf * probability;
        let (onward, bsdf_share) = if light.delta { (0.0, 1.0) } else { mixture.pdf(light.wi) };
        let weight = if light.delta { 1.0 } else { mis::balance(pdf, onward) };
        shadows.rays.push(shadow);
        let (vertex, value) = (path.last, value * light.radiance);
        shadows.connections.push(Connection { vertex, value, factor: weight / pdf });
        Direct { value: Vec3::ZERO, bsdf_share, ratio: pdf / onward }
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
