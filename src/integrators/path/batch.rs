//! Many paths at once: at each depth first all rays, then all vertices, then all shadow rays. Rays of different paths do not wait for
//! one another's memory, which a path alone would.

use glam::Vec3;

use super::background::Left;
use super::guides::Lights;
use super::shade::Groups;
use super::vertices::{Connection, Shadows, Tried, Vertices};
use super::{
    Arrival, Background, CameraPath, Direct, NO_VERTEX, PathState, PathTracer, RayCount, ToLight, Vertex, record,
};
#[cfg(target_arch = "x86_64")]
use crate::base::processor::Avx2;
use crate::base::random::Random;
use crate::geometry::{Hit, Met, Ray, RayKind, Scratch, Surface};
use crate::guiding::record::PathRecord;
use crate::integrators::mixture::MixtureDensity;
use crate::lights::learned::LightSampling;
use crate::lights::tried::Trial;
use crate::math::channel_mean;
use crate::math::lanes::LANES;
use crate::sampling::mis;
use crate::scene::effects::{Effects, Everything, With};

/// Vertices that are made and then shaded: enough for lanes to be full, few enough to remain in the nearest caches.
const CHUNK: usize = 256;

/// What is asked of paths once they are traced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wants {
    /// [`PathTracer::radiance`] alone.
    Radiance,
    /// That, and records.
    Records,
    /// That, records, and [`PathTracer::contributions`].
    Contributions,
}

/// Scratch space of a worker, reused from batch to batch.
#[derive(Default)]
pub struct PathScratch {
    /// Paths before they are traced.
    pub(in crate::integrators) begun: Vec<CameraPath>,
    pub(super) paths: Vec<PathState>,
    /// Indices of the paths that go on.
    alive: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    shadows: Shadows,
    surfaces: Vec<Surface>,
    arrivals: Vec<Arrival>,
    /// Paths that have met nothing at this depth.
    left: Vec<Left>,
    groups: Groups,
    queries: Scratch,
    pub(super) vertices: Vertices,
}

impl PathScratch {
    /// What came of the lights with a place that were chosen, where [that is counted](LightSampling::Counted).
    pub fn trials(&self) -> &[Trial] {
        &self.vertices.trials
    }

    /// Number of paths that were traced last.
    pub fn paths(&self) -> usize {
        self.paths.len()
    }

    /// What the only path ran into behind all surfaces.
    pub(super) fn background(&self) -> Background {
        self.vertices.background(&self.paths[0])
    }
}

impl PathTracer<'_> {
    /// Radiance of one path; see [`PathTracer::radiance`].
    pub fn trace(
        &self,
        path: CameraPath,
        scratch: &mut PathScratch,
        records: Option<&mut Vec<PathRecord>>,
        count: &mut RayCount,
    ) -> Vec3 {
        self.trace_all([path], if records.is_some() { Wants::Records } else { Wants::Radiance }, scratch, count);
        self.radiance(0, scratch, records)
    }

    /// Traces camera paths; [`PathTracer::radiance`] then tells what each brought.
    pub fn trace_all(
        &self,
        begun: impl IntoIterator<Item = CameraPath>,
        wants: Wants,
        scratch: &mut PathScratch,
        count: &mut RayCount,
    ) {
        let wants_records = wants != Wants::Radiance;
        scratch.vertices.clear();
        scratch.vertices.tells_flights = wants == Wants::Contributions;
        scratch.paths.clear();
        scratch.paths.extend(begun.into_iter().map(|path| PathState::new(path, self.scene.camera_medium)));
        scratch.alive.clear();
        scratch.alive.extend(0..scratch.paths.len() as u32);
        let needs = self.scene.needs();
        match (needs.media, needs.materials, self.field.is_some()) {
            (true, _, true) => self.walk::<Everything>(wants_records, scratch, count),
            (true, _, false) => self.walk::<With<false, true, true>>(wants_records, scratch, count),
            (_, true, true) => self.walk::<With<true, true, false>>(wants_records, scratch, count),
            (_, true, false) => self.walk::<With<false, true, false>>(wants_records, scratch, count),
            (_, _, true) => self.walk::<With<true, false, false>>(wants_records, scratch, count),
            (_, _, false) => self.walk::<With<false, false, false>>(wants_records, scratch, count),
        }
    }

    fn walk<E: Effects>(&self, wants_records: bool, scratch: &mut PathScratch, count: &mut RayCount) {
        if wants_records {
            self.walk_with::<E, true>(scratch, count)
        } else {
            self.walk_with::<E, false>(scratch, count)
        }
    }

    #[inline(always)]
    fn walk_with<E: Effects, const RECORDS: bool>(&self, scratch: &mut PathScratch, count: &mut RayCount) {
        #[cfg(target_arch = "x86_64")]
        if Avx2::detect().is_some() {
            // SAFETY: the processor has the features.
            return unsafe { self.walk_avx2::<E, RECORDS>(scratch, count) };
        }
        self.walk_portable::<E, RECORDS>(scratch, count);
    }

    // Ten loops in one function would spill each other's registers, so each remains a function.
    #[inline(never)]
    fn walk_portable<E: Effects, const RECORDS: bool>(&self, scratch: &mut PathScratch, count: &mut RayCount) {
        self.extend::<E, RECORDS>(scratch, count);
    }

    /// The same compiled for newer processors. Nothing is rounded otherwise: products and sums are not fused unless code asks for it.
    #[cfg(target_arch = "x86_64")]
    #[inline(never)]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn walk_avx2<E: Effects, const RECORDS: bool>(&self, scratch: &mut PathScratch, count: &mut RayCount) {
        self.extend::<E, RECORDS>(scratch, count);
    }

    /// Extends all paths until they end.
    #[inline(always)]
    fn extend<E: Effects, const RECORDS: bool>(&self, scratch: &mut PathScratch, count: &mut RayCount) {
        let PathScratch {
            paths, alive, rays, hits, shadows, surfaces, arrivals, left, groups, queries, vertices, ..
        } = scratch;
        surfaces.resize(CHUNK, Surface::in_medium(Vec3::ZERO, 0.0, Vec3::Z));
        rays.clear();
        rays.extend(paths.iter().map(|path| path.ray));
        for depth in 1..=self.settings.max_depth {
            if alive.is_empty() {
                break;
            }
            hits.resize(rays.len(), None);
            let accel = &self.scene.accel;
            accel.pace.measure(RayKind::Path(depth), rays.len(), |way| accel.intersect_all(rays, way, queries, hits));
            let mut kept = 0;
            for first in (0..hits.len()).step_by(CHUNK) {
                let places = first..hits.len().min(first + CHUNK);
                self.scene.surfaces(rays, hits, places.clone(), surfaces);
                arrivals.clear();
                for (place, surface) in places.zip(&mut *surfaces) {
                    let (path, meets) = (alive[place], hits[place].is_some());
                    let numbers = [depth, path, (place - first) as u32];
                    let state = &mut paths[path as usize];
                    // Not by `extend`, which would write it twice.
                    if let Some(at) = self.arrive::<E, RECORDS>(numbers, state, meets, surface, vertices, left) {
                        arrivals.push(at);
                    }
                }
                self.shade::<E, RECORDS>((depth, arrivals, surfaces), paths, groups, vertices, shadows, |path, ray| {
                    // In the place of a path that has been at its vertex.
                    (alive[kept], rays[kept]) = (path, *ray);
                    kept += 1;
                });
            }
            self.look_out(left, paths, vertices);
            left.clear();
            count.rays += (rays.len() + shadows.connections.len()) as u64;
            alive.truncate(kept);
            rays.truncate(kept);
            self.resolve::<E, RECORDS>(depth, shadows, queries, vertices);
        }
    }

    /// Gives the vertices what their connections bring.
    #[inline(always)]
    fn resolve<E: Effects, const RECORDS: bool>(
        &self,
        depth: u32,
        shadows: &mut Shadows,
        queries: &mut Scratch,
        vertices: &mut Vertices,
    ) {
        let Shadows { rays, occluded, met, .. } = shadows;
        let (count, veiled, accel) = (rays.len(), self.scene.has_veils::<E>(), &self.scene.accel);
        accel.pace.measure(RayKind::Shadow(depth), count, |way| {
            if veiled {
                met.resize(count, Met::Nothing);
                self.scene.meets_all(rays, way, queries, met);
            } else {
                occluded.resize(count, false);
                accel.occluded_all(rays, way, queries, occluded);
            }
        });
        let Shadows { rays, media, random, occluded, met, .. } = &*shadows;
        let unused = Random::new(0, 0, 0);
        self.bring_all::<E, RECORDS>(shadows, vertices, |number| {
            if !self.scene.has_veils::<E>() {
                return if occluded[number] { Vec3::ZERO } else { Vec3::ONE };
            }
            let ((ray, length), medium) = (&rays[number], media.get(number).copied().flatten());
            let random = random.get(number).unwrap_or(&unused);
            self.scene.transmittance_past(met[number], ray, *length, medium, random)
        });
        vertices.trials.extend(shadows.tried.iter().map(|&Tried { path, vertex, point, light, carried }| {
            let brought = channel_mean(carried * vertices.all[vertex as usize].direct);
            Trial { path, point, light, brought }
        }));
        shadows.clear();
    }

    /// Gives vertices what connections bring, of which rays let through what `visible` says.
    #[inline(always)]
    fn bring_all<E: Effects, const RECORDS: bool>(
        &self,
        shadows: &Shadows,
        vertices: &mut Vertices,
        visible: impl Fn(usize) -> Vec3,
    ) {
        let Shadows { connections, rays, .. } = shadows;
        if !E::GUIDING {
            for (number, (connection, ray)) in connections.iter().zip(rays).enumerate() {
                self.bring::<E, RECORDS>((connection, ray), visible(number), None, vertices);
            }
            return;
        }
        let count = connections.len();
        for first in (0..count).step_by(LANES) {
            let numbers = first..count.min(first + LANES);
            let mut passed = [Vec3::ZERO; LANES];
            for (passed, number) in passed.iter_mut().zip(numbers.clone()) {
                *passed = visible(number);
            }
            let lights = Lights::new(&shadows.guided[numbers.clone()], self.field, |lane| passed[lane] != Vec3::ZERO);
            let (guides, fractions) = (lights.guides.any, lights.guides.bsdf_fractions);
            let densities = lights.densities();
            for (lane, number) in numbers.enumerate() {
                let guide = (guides >> lane & 1 == 1).then(|| MixtureDensity {
                    bsdf_fraction: fractions[lane],
                    deltas: shadows.guided[number].deltas,
                    guide_pdf: densities[lane],
                });
                self.bring::<E, RECORDS>((&connections[number], &rays[number]), passed[lane], guide, vertices);
            }
        }
    }

    /// Gives a vertex what a connection brings of which `passed` gets through; `guide` is what chooses directions there beside the BSDF.
    #[inline(always)]
    fn bring<E: Effects, const RECORDS: bool>(
        &self,
        (connection, ray): (&Connection, &(Ray, f32)),
        passed: Vec3,
        guide: Option<MixtureDensity<f32>>,
        vertices: &mut Vertices,
    ) {
        if passed == Vec3::ZERO {
            return;
        }
        let &Connection { vertex, value, pdf, bsdf_pdf, factor, .. } = connection;
        self.count_sky(connection, ray);
        let (onward, bsdf_share) = guide.map_or((bsdf_pdf, 1.0), |guide| guide.pdf(bsdf_pdf));
        let factor = if E::GUIDING { mis::balance(pdf, onward) / pdf } else { factor };
        let value = value * passed * factor;
        vertices.all[vertex as usize].direct = value;
        if RECORDS {
            let towards = Some(ToLight { ray: *ray, pdf, onward });
            vertices.details[vertex as usize].direct = Direct { value, bsdf_share, ratio: pdf / onward, towards };
        }
    }

    /// Counts a connection to the sky that nothing is in the way of, where that is wanted.
    #[inline(always)]
    fn count_sky(&self, connection: &Connection, (ray, length): &(Ray, f32)) {
        if let LightSampling::Counted(counts) = self.lights
            && length.is_infinite()
            && connection.bsdf_pdf > 0.0
            && let Some(map) = self.scene.lights.map()
        {
            let share = self.scene.lights.map_share(ray.direction);
            counts.add(map, connection.facing, ray.direction, share);
        }
    }

    /// Radiance of path `index` of those traced last, W·m⁻²·sr⁻¹. Where `records` is given, one record per vertex that is not a delta
    /// surface is added to it.
    #[inline]
    pub fn radiance(&self, index: usize, scratch: &PathScratch, records: Option<&mut Vec<PathRecord>>) -> Vec3 {
        let PathScratch { paths, vertices, .. } = scratch;
        let path = &paths[index];
        let Some(records) = records else { return gather(path, vertices, |_, _, _| ()) };
        let pixel = path.pixel;
        gather(path, vertices, |vertex, next, onward| {
            let next = next.map(|next| &vertices.details[next]);
            let met = next.map_or_else(|| vertices.background(path).emission, |next| next.emission);
            records.extend(record(&vertices.details[vertex], next, met, onward, pixel));
        })
    }

    /// Radiance of path `index` of those traced last that is light of media themselves: the part of it that none of its
    /// [complete paths](PathTracer::contributions) brings.
    pub fn glow(&self, index: usize, PathScratch { paths, vertices, .. }: &PathScratch) -> Vec3 {
        let path = &paths[index];
        let (mut incoming, mut at) = (vertices.background(path).glow, path.last);
        // Empty where no medium has light.
        while let Some(glow) = vertices.glow.get(at as usize) {
            let Vertex { weight, survival, previous, .. } = vertices.all[at as usize];
            incoming = *glow + vertices.passed[at as usize] * weight * incoming / survival;
            at = previous;
        }
        incoming
    }
}

/// Sums a path from its end: radiance leaving each vertex towards the one before. `step` is told of each vertex: its index, that of the
/// next, and what arrived from there beside the emission that was met.
#[inline(always)]
fn gather(path: &PathState, vertices: &Vertices, mut step: impl FnMut(usize, Option<usize>, Vec3)) -> Vec3 {
    let media = !vertices.passed.is_empty();
    let behind = vertices.backgrounds.get(path.background as usize);
    let (mut incoming, mut onward) =
        behind.map_or((Vec3::ZERO, Vec3::ZERO), |&Background { emission, glow }| (emission.weighted() + glow, glow));
    let (mut at, mut next) = (path.last, None);
    while at != NO_VERTEX {
        let index = at as usize;
        let vertex = &vertices.all[index];
        step(index, next, onward);
        // Nothing arrives where the path has ended.
        onward = vertex.direct + vertex.weight * incoming / vertex.survival;
        if media {
            onward *= vertices.passed[index];
            if let Some(glow) = vertices.glow.get(index) {
                onward += *glow;
            }
        }
        incoming = vertex.emitted + onward;
        (at, next) = (vertex.previous, Some(index));
    }
    incoming
}
