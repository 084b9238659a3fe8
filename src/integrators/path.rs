//! The path tracer: light sampling (next event estimation) with multiple importance sampling, guided directions, Russian roulette, and
//! records of what each vertex received.

mod background;
#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
mod batch;
mod complete;
mod explain;
mod going;
mod guides;
mod shade;
mod shaded;
mod sixteen;
mod vertices;

pub use batch::{PathScratch, Wants};
pub(super) use complete::sky_point;
pub use complete::{Contribution, KernelShares};
pub use explain::{Cause, ExplainedVertex, Explanation, Met, Onward};

use glam::Vec3;

use super::mixture::cosine_normal;
use super::{Roulette, TransportSettings};
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::guiding::record::{PathRecord, Radiance};
use crate::guiding::sample::field::{GuideField, VoxelGuide};
use crate::guiding::sample::roulette::AdjointRoulette;
use crate::lights::Light;
use crate::lights::learned::LightSampling;
use crate::lights::seen::ANYWHERE;
use crate::materials::medium::MediumId;
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::{Material, Variant};
use crate::math::channel_mean;
use crate::sampling::mis;
use crate::scene::Scene;
use crate::scene::effects::Effects;
use crate::scene::media::{End, Expected, Passage, Place, Segment};
use background::Left;
use going::Gone;
pub(super) use going::blind_survival;
use shaded::Shaded;
use vertices::{Connection, Flown, Shadows, Towards, Tried, Vertices};

/// Traces camera paths.
pub struct PathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings.
    pub settings: TransportSettings,
    /// The guiding field; none for plain path tracing.
    pub field: Option<&'a GuideField>,
    /// How lights are sampled.
    pub lights: LightSampling<'a>,
}

/// The beginning of a camera path.
#[derive(Clone)]
pub struct CameraPath {
    /// The camera's ray.
    pub ray: Ray,
    /// Random numbers of the path.
    pub random: Random,
    /// About the value of its pixel, by which what the path still carries is judged; none where nothing is known of it. Without a guide it
    /// is relative to the radiance that vertices are expected to send back.
    pub pixel: Option<f32>,
}

/// A path on its way: all that its next segment depends on. What is read or written together lies side by side.
#[repr(C)]
struct PathState {
    /// Π f·|cos θ| / p, roulette and media included.
    throughput: Vec3,
    /// See [`CameraPath::pixel`]; 1 where nothing is known.
    pixel: f32,
    /// The same as if BSDFs had chosen all directions; not kept without a guide, where both are the same.
    reflected: Vec3,
    /// Product of the squared indices that radiance was divided by on its way into glass, and will be multiplied by on its way out.
    squeezed: f32,
    ray: Ray,
    previous: Previous,
    random: Random,
    /// Index of its last vertex so far.
    last: u32,
    /// Index of the background that it ran into.
    background: u32,
    medium: Option<MediumId>,
    /// Whether something is known of its pixel.
    judged: bool,
}

impl PathState {
    #[inline(always)]
    fn new(CameraPath { ray, random, pixel }: CameraPath, medium: Option<MediumId>) -> Self {
        let previous = Previous { pdf: 0.0, light_probability: 0.0, point: ray.origin, facing: ANYWHERE };
        Self {
            throughput: Vec3::ONE,
            pixel: pixel.unwrap_or(1.0),
            reflected: Vec3::ONE,
            squeezed: 1.0,
            ray,
            previous,
            random,
            last: NO_VERTEX,
            background: NO_BACKGROUND,
            medium,
            judged: pixel.is_some(),
        }
    }
}

/// A path at a vertex from which it may go on.
struct Arrival {
    /// Place of the surface among those that were made with it.
    place: u32,
    /// Indices of the path and of the vertex.
    path: u32,
    vertex: u32,
    worth: Worth,
    /// Index of the voxel whose guide is sampled; none where the BSDF samples alone.
    voxel: Option<u32>,
    /// The phase function of a medium, if it is there that the vertex lies.
    phase: Option<HenyeyGreenstein>,
    variant: Variant,
    /// Whether the shading normal is turned by bumps.
    bumped: bool,
    /// Whether only delta lobes scatter here.
    smooth: bool,
    /// Whether a light is sampled.
    connects: bool,
}

/// Probabilities of light sampling and of going on at a vertex, by the light that is expected there; for the latter none where nothing
/// is known.
#[derive(Clone, Copy)]
pub(super) struct Worth {
    pub light: f32,
    pub onward: Option<f32>,
}

impl Worth {
    /// Where light is sampled at all if it `connects`, for a path that carries `carried` (channel mean) to a vertex in `voxel`, if that is
    /// known, for a pixel of this value; without one nothing is known by which a path could be judged.
    #[inline(always)]
    pub fn new(
        roulette: Roulette,
        connects: bool,
        voxel: Option<&VoxelGuide>,
        carried: f32,
        pixel: Option<f32>,
    ) -> Self {
        let importance = pixel.map(|value| carried / value);
        let known = voxel.filter(|_| roulette == Roulette::Window);
        let adjoint = known.map_or(AdjointRoulette::UNKNOWN, |voxel| voxel.roulette);
        let light = importance.map_or(1.0, |importance| adjoint.light_probability(importance, carried));
        Self {
            light: if connects { light } else { 0.0 },
            onward: importance.and_then(|importance| adjoint.survival(importance, carried)),
        }
    }
}

/// Light that a vertex adds, and the part that it lets through of the light that arrives, kept until that light is known.
#[repr(C)]
struct Vertex {
    /// f·|cos θ| / p of the direction in which the path went on; zero where it ended.
    weight: Vec3,
    /// Probability of surviving roulette before going on.
    survival: f32,
    /// Emission towards the previous vertex as it enters the picture.
    emitted: Vec3,
    /// Index of the path's vertex before this one.
    previous: u32,
    /// Light sampling: f·L·w / p.
    direct: Vec3,
}

/// Index where there is no vertex.
const NO_VERTEX: u32 = u32::MAX;

/// What a path that has left the scene ran into.
#[derive(Clone, Copy, Default)]
struct Background {
    /// Emission infinitely far away.
    emission: Emission,
    /// Light of media on the way there.
    glow: Vec3,
}

/// Index of the background of a path that has not left the scene.
const NO_BACKGROUND: u32 = u32::MAX;

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
    /// Probability with which light sampling is tried at this vertex, and what came of it.
    tried: f32,
    direct: Direct,
    /// How the path went on; none where it ended.
    step: Option<Step>,
    /// Whether it ended because the direction that was drawn brings nothing: below the horizon, or absorbed.
    absorbed: bool,
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
    /// Towards the light.
    towards: Option<ToLight>,
}

/// The connection to a light that was sampled.
#[derive(Clone, Copy)]
struct ToLight {
    /// The shadow ray with its length, which is infinite for a light that is infinitely far away.
    ray: (Ray, f32),
    /// Densities of light sampling, and of what chooses directions at the vertex; the latter is 0 where no ray can hit the light.
    pdf: f32,
    onward: f32,
}

/// How a path went on, see [`MixtureSample`](super::mixture::MixtureSample).
struct Step {
    direction: Vec3,
    weight: Vec3,
    value: Vec3,
    pdf: f32,
    bsdf_share: f32,
    delta: bool,
    /// Probability of surviving roulette before going on.
    survival: f32,
}

/// The previous vertex, as far as the weight of emission that the path runs into depends on it.
#[derive(Clone, Copy)]
#[repr(C)]
struct Previous {
    /// Density of the direction that was drawn there.
    pdf: f32,
    /// Probability with which light sampling was tried there; 0 where it never is, and before the first vertex.
    light_probability: f32,
    point: Vec3,
    /// Which way the surface faces.
    facing: u8,
}

impl Previous {
    /// Weight of what the path ran into, and whether light sampling could have found it; `pdf` is the density with which it does where it
    /// is tried with the given probability.
    #[inline(always)]
    fn weight(&self, pdf: impl FnOnce(f32) -> f32) -> (f32, bool) {
        let connected = self.light_probability > 0.0;
        (if connected { mis::balance(self.pdf, pdf(self.light_probability)) } else { 1.0 }, connected)
    }
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
    /// Takes a path to its next vertex, where it `meets` the `surface`, or behind that; there the surface, or the point of a medium,
    /// takes its place. `depth` is the number of segments with this one, `number` and `place` are the indices of path and surface.
    /// Returns where it scatters; none where it ends. Those that meet nothing are added to `left` where it matters what they see.
    #[inline(always)]
    fn arrive<E: Effects, const RECORDS: bool>(
        &self,
        [depth, number, place]: [u32; 3],
        path: &mut PathState,
        meets: bool,
        surface: &mut Surface,
        vertices: &mut Vertices,
        left: &mut Vec<Left>,
    ) -> Option<Arrival> {
        path.random.begin_vertex(depth);
        let mut medium = path.medium;
        let knows = E::MEDIA && E::GUIDING && self.settings.guided_distances && self.field.is_some();
        let expected = |place: Place| self.expected(path, place);
        let expected: Option<Expected> = if knows { Some(&expected) } else { None };
        let wants_density = E::MEDIA && RECORDS && vertices.tells_flights;
        let (ray, carried, random) = (&path.ray, path.throughput, &path.random);
        let segment = Segment { ray, carried, random, expected, wants_density };
        let Passage { end, weight: passed, glow, density } =
            self.scene.advance::<E>(segment, meets, surface, &mut medium);
        path.medium = medium;
        let phase = match end {
            End::Background => {
                if E::MEDIA || RECORDS || self.scene.lights.has_background() {
                    left.push(Left { path: number, passed, glow });
                }
                return None;
            }
            End::Surface => None,
            End::Medium(phase) => Some(phase),
        };
        if E::MEDIA {
            path.throughput *= passed;
            path.reflected *= passed;
        }
        let emission = if phase.is_none() { self.emission(surface, path).dimmed(passed) } else { Emission::default() };
        let known = (E::GUIDING || RECORDS) && phase.is_none();
        let normal = if known { surface.normal_towards(-path.ray.direction) } else { Vec3::ZERO };
        if wants_density {
            vertices.flights.push(Flown { density, phase });
        }
        let vertex = self.begin_vertex::<E, RECORDS>(path, surface, normal, emission, [passed, glow], vertices);
        if depth >= self.settings.max_depth {
            return None;
        }
        let material = if phase.is_none() && E::MATERIALS { Some(self.scene.material(surface)) } else { None };
        let smooth = material.is_some_and(Material::is_delta);
        let bumped = material.is_some_and(|material| material.bump.is_some() && surface.smooth != surface.shading);
        let field = if E::GUIDING { self.field.filter(|_| !smooth) } else { None };
        // No closures: they would be functions for any processor.
        let (mut found, mut guide) = (None, None);
        if let Some(field) = field
            && let Some(voxel) = field.find(surface.point, normal)
        {
            let here = &field.voxels()[voxel as usize];
            found = Some(here);
            if let Some(directions) = &here.directions {
                directions.prefetch();
                guide = Some(voxel);
            }
        }
        let worth = self.worth::<E>(path, smooth, found);
        if RECORDS {
            vertices.details[vertex as usize].tried = worth.light;
        }
        Some(Arrival {
            place,
            path: number,
            vertex,
            worth,
            voxel: guide,
            phase,
            variant: self.variant::<E>(surface, phase),
            bumped,
            smooth,
            connects: self.connects::<E>(path, worth.light),
        })
    }

    /// How a surface scatters, or a medium of this phase function.
    #[inline(always)]
    fn variant<E: Effects>(&self, surface: &Surface, phase: Option<HenyeyGreenstein>) -> Variant {
        match phase {
            Some(_) => Variant::PHASE,
            None if E::MATERIALS => self.scene.variant(surface),
            None => Variant::PLAIN,
        }
    }

    /// Mean radiance that comes to a path from a place on its ray; none where the guide does not know it.
    fn expected(&self, path: &PathState, place: Place) -> Option<f32> {
        let (point, normal, emitted) = match place {
            Place::Background => return Some(channel_mean(self.background(path).weighted())),
            Place::Medium(point) => (point, Vec3::ZERO, 0.0),
            // What lies behind a veil is not known.
            Place::Surface(surface) if self.scene.opacity(surface) < 1.0 => return None,
            Place::Surface(surface) => {
                let emitted = channel_mean(self.emission(surface, path).weighted());
                (surface.point, surface.normal_towards(-path.ray.direction), emitted)
            }
        };
        let field = self.field?;
        let reflected = field.voxels()[field.find(point, normal)? as usize].roulette.expected()?;
        Some(emitted + reflected)
    }

    /// Adds a vertex to a path and returns its index.
    #[inline(always)]
    fn begin_vertex<E: Effects, const RECORDS: bool>(
        &self,
        path: &mut PathState,
        surface: &Surface,
        normal: Vec3,
        emission: Emission,
        [passed, glow]: [Vec3; 2],
        vertices: &mut Vertices,
    ) -> u32 {
        let (index, emitted) = (vertices.next(), emission.weighted());
        let vertex = Vertex { emitted, direct: Vec3::ZERO, weight: Vec3::ZERO, survival: 1.0, previous: path.last };
        path.last = index;
        if E::MEDIA && self.scene.glows() {
            vertices.glow.push(glow);
        }
        vertices.push::<E, RECORDS>(vertex, passed, || Details {
            point: surface.point,
            shape: surface.shape,
            distance: surface.distance,
            normal,
            throughput: path.throughput,
            emission,
            tried: 0.0,
            direct: Direct::default(),
            step: None,
            absorbed: false,
        });
        index
    }

    /// Probabilities of light sampling and of going on at a vertex in a voxel.
    #[inline(always)]
    fn worth<E: Effects>(&self, path: &PathState, smooth: bool, voxel: Option<&VoxelGuide>) -> Worth {
        // Without a guide the value means something else.
        let pixel = (E::GUIDING && path.judged).then_some(path.pixel);
        let connects = self.settings.light_sampling && !smooth;
        Worth::new(self.settings.roulette, connects, voxel, channel_mean(path.throughput), pixel)
    }

    /// Whether a light is sampled, which is tried with `probability`.
    #[inline(always)]
    fn connects<E: Effects>(&self, path: &PathState, probability: f32) -> bool {
        if E::GUIDING && probability < 1.0 {
            return probability > 0.0 && path.random.at(Dimension::CONNECTION).next_f32() < probability;
        }
        probability > 0.0
    }

    /// Connects a path at a vertex to the light that was sampled there, if something may come back; whether light does is known later.
    #[inline(always)]
    fn connect<E: Effects>(
        &self,
        path: &PathState,
        at: &Arrival,
        surface: &Surface,
        (shaded, lane): (&Shaded, usize),
        shadows: &mut Shadows,
    ) {
        if matches!(self.lights, LightSampling::Counted(_)) {
            self.count_trial(path, at, surface, shadows);
        }
        let Some(sampled) = shaded.light(lane) else { return };
        shadows.rays.push(sampled.shadow);
        if E::MEDIA {
            shadows.media.push(self.scene.medium_beyond(surface, sampled.shadow.0.direction, path.medium));
            if self.scene.has_grids() {
                shadows.random.push(path.random.behind(Dimension::CONNECTION));
            }
        }
        if E::GUIDING {
            let voxel = at.voxel.filter(|_| !sampled.delta);
            let (direction, deltas) = (shaded.to_light(lane), shaded.deltas(lane));
            let normal = cosine_normal(at.variant, surface, -path.ray.direction);
            shadows.guided.push(Towards { voxel, point: surface.point, normal, direction, deltas });
        }
        shadows.connections.push(Connection {
            vertex: at.vertex,
            facing: shaded.facing[lane],
            value: sampled.light,
            // Without a guide it is always tried.
            pdf: if E::GUIDING { sampled.pdf * at.worth.light } else { sampled.pdf },
            bsdf_pdf: sampled.bsdf_pdf,
            factor: sampled.factor,
        });
    }

    /// Takes a path on from its vertex in the direction that was drawn; returns whether it goes on.
    #[inline(always)]
    fn go_on<E: Effects, const RECORDS: bool>(
        &self,
        path: &mut PathState,
        at: &Arrival,
        surface: &Surface,
        (shaded, gone, lane): (&Shaded, &Gone, usize),
        vertices: &mut Vertices,
    ) -> bool {
        let (index, says) = (at.vertex as usize, |answers: u32| answers >> lane & 1 == 1);
        if !says(gone.brings) {
            if RECORDS {
                vertices.details[index].absorbed = !at.smooth;
            }
            return false;
        }
        let [wx, wy, wz, survival] = gone.weights[lane];
        let ([ox, oy, oz, x], [y, z, pdf, bsdf_share]) = (gone.begun[lane], gone.towards[lane]);
        let (weight, direction, delta) = (Vec3::new(wx, wy, wz), Vec3::new(x, y, z), shaded.delta(lane));
        let vertex = &mut vertices.all[index];
        (vertex.weight, vertex.survival) = (weight, survival);
        if RECORDS {
            let value = shaded.value(lane, weight, pdf);
            let step = Step { direction, weight, value, pdf, bsdf_share, delta, survival };
            vertices.details[index].step = (says(gone.survives) || !delta).then_some(step);
        }
        if !says(gone.goes_on) {
            return false;
        }
        let [r, g, b, pixel] = gone.throughput[lane];
        (path.throughput, path.pixel) = (Vec3::new(r, g, b), pixel);
        if E::GUIDING || E::MATERIALS {
            let [r, g, b, squeezed] = gone.reflected[lane];
            (path.reflected, path.squeezed) = (Vec3::new(r, g, b), squeezed);
        }
        if E::MEDIA && at.phase.is_none() {
            path.medium = self.scene.medium_beyond(surface, direction, path.medium);
        }
        path.ray = Ray { origin: Vec3::new(ox, oy, oz), direction };
        let light_probability = if delta { 0.0 } else { at.worth.light };
        path.previous = Previous { pdf, light_probability, point: surface.point, facing: shaded.facing[lane] };
        true
    }

    /// Keeps in mind which light was chosen, if it has a place.
    fn count_trial(&self, path: &PathState, at: &Arrival, surface: &Surface, shadows: &mut Shadows) {
        let lights = &self.scene.lights;
        let chosen = lights.choose(surface.point, lights.choice(&path.random), None);
        if let Some((light, _)) = chosen.filter(|(light, _)| !lights.lights[*light].is_at_infinity()) {
            let (point, light) = (surface.point, light as u32);
            shadows.tried.push(Tried { path: at.path, vertex: at.vertex, point, light, carried: path.throughput });
        }
    }

    /// Emission of a surface that the path ran into.
    #[inline(always)]
    fn emission(&self, surface: &Surface, path: &PathState) -> Emission {
        let Some((index, Light::Area(light))) = self.scene.light_of(surface) else { return Emission::default() };
        let radiance = light.emitted(surface, -path.ray.direction);
        let (weight, connected) = path.previous.weight(|tried| {
            let from = path.previous.point;
            let choice = self.scene.lights.probability(from, index, self.lights.odds(from)) * tried;
            light.pdf(from, surface) * choice
        });
        Emission { radiance, weight, connected }
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
    let step = vertex.step.as_ref().filter(|step| !step.delta)?;
    let arrived = if met.connected { [met.weighted(), onward] } else { [Vec3::ZERO, onward + met.weighted()] };
    let kinds = |[emitted, onward]: [f32; 2]| Radiance { emitted: finite(emitted), onward: finite(onward) };
    Some(PathRecord {
        direction: step.direction,
        distance: next.map_or(f32::INFINITY, |n| n.distance),
        pdf: step.pdf * step.survival,
        bsdf_share: step.bsdf_share,
        radiance: kinds(arrived.map(channel_mean)),
        brought: kinds(arrived.map(|radiance| channel_mean(step.weight * radiance) / step.survival)),
        light_ratio: 1.0 / met.weight - 1.0,
        ..absorbed
    })
}
