//! The photon tracer: light paths whose power is deposited in the voxels that camera paths have reached.

mod scatter;

use glam::Vec3;

use super::TransportSettings;
use super::path::RayCount;
use crate::base::random::Random;
use crate::geometry::{Hit, Ray, RayKind, Scratch, Surface};
use crate::guiding::learn::emission::{EmissionGuide, Start};
use crate::guiding::record::PhotonRecord;
use crate::lights::Emission;
use crate::materials::Variant;
use crate::materials::medium::MediumId;
use crate::materials::phase::HenyeyGreenstein;
use crate::math::channel_mean;
use crate::scene::Scene;
use crate::scene::effects::{Effects, With};
use crate::scene::media::{End, Passage, Segment};
use scatter::Groups;

/// Vertices that are made and then left: enough for lanes to be full, few enough to remain in the nearest caches.
const CHUNK: usize = 256;

/// Traces light paths.
pub struct PhotonTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Settings, the same as the path tracer's.
    pub settings: TransportSettings,
    /// Where light paths start.
    pub emission: &'a EmissionGuide,
}

/// A photon on its way.
struct Photon {
    power: Vec3,
    /// Whether it has been scattered by a surface that is not a delta surface.
    scattered: bool,
    /// Number of delta surfaces since it was emitted or last scattered.
    delta_chain: u32,
    /// Whether a ray can hit the light that emitted it.
    reachable: bool,
    at_infinity: bool,
}

impl Photon {
    /// A guided camera ray is rewarded for leaving in this photon's direction only if it can still reach the light by running into
    /// it, or by light sampling at a later vertex.
    ///
    /// Trees learn from paths what light sampling finds too, but photons straight from a light are left out: kept, they crowd out
    /// what only photons know, and equal samples leave 1.02 to 1.2 times the error (`lamp-room` 1.12, a room with a lamp in a shade
    /// 1.14, a classroom by daylight 1.2). So kinds of samples are compared by the other light alone, which is what
    /// [`DirectLight::Nothing`](crate::guiding::target::DirectLight) leaves.
    fn is_useful(&self, light_sampling: bool) -> bool {
        self.scattered || (self.reachable && (self.delta_chain > 0 || !light_sampling))
    }

    /// Whether its power is finite; a photon that ends because it is not is counted.
    fn is_finite(&self, count: &mut RayCount) -> bool {
        let finite = self.power.is_finite();
        count.dropped += u64::from(!finite);
        finite
    }
}

/// A light path on its way.
struct LightPath {
    /// Its number among those of its chunk.
    number: u32,
    random: Random,
    ray: Ray,
    medium: Option<MediumId>,
    photon: Photon,
    /// Channel mean of the power that it began with.
    begun: f32,
}

/// Light paths that were traced together.
#[derive(Default)]
pub struct PhotonBlock {
    /// Photons that arrived, in the order of their paths' numbers.
    pub photons: Vec<PhotonRecord>,
    /// How each path started; none where there is no light.
    pub starts: Vec<Option<Start>>,
    /// Rays of all paths, and paths that were dropped.
    pub rays: RayCount,
}

/// Where a light path scatters.
#[derive(Clone, Copy)]
struct Arrival {
    /// Index of its surface, or of the point of a medium.
    place: u32,
    /// Index of the path.
    path: u32,
    /// Of a medium.
    phase: Option<HenyeyGreenstein>,
    variant: Variant,
    /// Whether bumps turn the shading normal.
    bumped: bool,
}

/// Scratch space of a worker, reused from batch to batch.
#[derive(Default)]
pub struct PhotonScratch {
    paths: Vec<LightPath>,
    /// Indices of the paths that go on.
    alive: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    surfaces: Vec<Surface>,
    arrivals: Vec<Arrival>,
    groups: Groups,
    queries: Scratch,
}

impl PhotonTracer<'_> {
    /// Traces light paths with these numbers and random numbers, of `paths` in the pass, all at once, and adds a record per useful
    /// arrival, in the order of `begun`, in which numbers must ascend. Powers are those of a pass whose light paths together carry the
    /// power of the scene. To `starts` it adds how each started; none where there is no light.
    pub fn trace_all(
        &self,
        begun: impl IntoIterator<Item = (u32, Random)>,
        paths: u64,
        scratch: &mut PhotonScratch,
        block: &mut PhotonBlock,
    ) {
        let PhotonBlock { photons, starts, rays } = block;
        scratch.paths.clear();
        for (number, mut random) in begun {
            let start = self.emission.sample(&mut random);
            scratch.paths.extend(start.as_ref().and_then(|start| self.begin(start, number, random, paths, rays)));
            starts.push(start);
        }
        let before = photons.len();
        let needs = self.scene.needs();
        match (needs.media, needs.materials) {
            (true, _) => self.extend::<With<false, true, true>>(scratch, photons, rays),
            (_, true) => self.extend::<With<false, true, false>>(scratch, photons, rays),
            (_, false) => self.extend::<With<false, false, false>>(scratch, photons, rays),
        }
        // All arrivals of one depth came before those of the next.
        photons[before..].sort_by_key(|photon| photon.path);
    }

    /// The light path that starts so; none where it carries nothing.
    fn begin(&self, start: &Start, number: u32, random: Random, paths: u64, count: &mut RayCount) -> Option<LightPath> {
        let (emission, mut photon) = self.emit(start)?;
        if !photon.is_finite(count) {
            return None;
        }
        photon.power /= paths as f32;
        let medium = self.scene.light_medium(start.light);
        Some(LightPath { number, random, ray: emission.ray, medium, begun: channel_mean(photon.power), photon })
    }

    /// Extends all paths until they end.
    fn extend<E: Effects>(&self, scratch: &mut PhotonScratch, records: &mut Vec<PhotonRecord>, count: &mut RayCount) {
        let PhotonScratch { paths, alive, rays, hits, surfaces, arrivals, groups, queries } = scratch;
        surfaces.resize(CHUNK, Surface::in_medium(Vec3::ZERO, 0.0, Vec3::Z));
        alive.clear();
        alive.extend(0..paths.len() as u32);
        rays.clear();
        rays.extend(paths.iter().map(|path| path.ray));
        // A light path of n segments continues to the camera with at least one more: n + 1 vertices after the light.
        for depth in 1..self.settings.max_depth {
            if alive.is_empty() {
                break;
            }
            hits.resize(rays.len(), None);
            let accel = &self.scene.accel;
            accel.pace.measure(RayKind::Photon, rays.len(), |way| accel.intersect_all(rays, way, queries, hits));
            count.rays += rays.len() as u64;
            let mut kept = 0;
            for first in (0..hits.len()).step_by(CHUNK) {
                let places = first..hits.len().min(first + CHUNK);
                self.scene.surfaces(rays, hits, places.clone(), surfaces);
                arrivals.clear();
                for (place, surface) in places.zip(&mut *surfaces) {
                    let (number, meets) = (alive[place], hits[place].is_some());
                    let (path, place) = (&mut paths[number as usize], (place - first) as u32);
                    let arrival = self.arrive::<E>([depth, number, place], path, meets, surface, records, count);
                    arrivals.extend(arrival);
                }
                self.scatter::<E>((depth, arrivals, surfaces), paths, groups, count, |path, ray| {
                    // In the place of a path that has been at its vertex.
                    (alive[kept], rays[kept]) = (path, *ray);
                    kept += 1;
                });
            }
            alive.truncate(kept);
            rays.truncate(kept);
        }
    }

    /// Takes a path to its vertex number `depth`, where it `meets` the `surface` or behind that; there the surface, or the point of a
    /// medium, takes its place. `number` and `place` are the indices of path and surface. Returns where it scatters; none where it ends.
    #[inline(always)]
    fn arrive<E: Effects>(
        &self,
        [depth, number, place]: [u32; 3],
        path: &mut LightPath,
        meets: bool,
        surface: &mut Surface,
        records: &mut Vec<PhotonRecord>,
        count: &mut RayCount,
    ) -> Option<Arrival> {
        let LightPath { random, ray, medium, photon, .. } = path;
        random.begin_vertex(depth);
        let segment = Segment { ray, carried: photon.power, random, expected: None, wants_density: false };
        let Passage { end, weight, .. } = self.scene.advance::<E>(segment, meets, surface, medium);
        photon.power *= weight;
        if !photon.is_finite(count) {
            return None;
        }
        let phase = match end {
            End::Background => return None,
            End::Surface => None,
            End::Medium(phase) => Some(phase),
        };
        let material = if phase.is_none() { Some(self.scene.material(surface)) } else { None };
        // What scatters nothing brings no light to the picture, however much arrives: photons that paths need not find.
        let learns = material.is_none_or(|material| !material.is_delta() && !material.is_black());
        if learns && photon.is_useful(self.settings.light_sampling) {
            self.deposit(path.number, surface, phase.is_none(), -path.ray.direction, &path.photon, records);
        }
        let bumped = material.is_some_and(|material| material.bump.is_some() && surface.smooth != surface.shading);
        let variant = if phase.is_some() { Variant::PHASE } else { self.scene.variant(surface) };
        Some(Arrival { place, path: number, phase, variant, bumped: E::MATERIALS && bumped })
    }

    fn emit(&self, start: &Start) -> Option<(Emission, Photon)> {
        let light = &self.scene.lights.lights[start.light];
        let [u, v] = start.squares.map(|square| square.map(|x| (x as f32).min(1.0 - f32::EPSILON / 2.0)));
        let emission = light.emit(&self.scene.bounds, u, v)?;
        let photon = Photon {
            power: emission.power / start.probability as f32,
            scattered: false,
            delta_chain: 0,
            reachable: light.is_reachable(),
            at_infinity: light.is_at_infinity(),
        };
        (photon.power != Vec3::ZERO).then_some((emission, photon))
    }

    fn deposit(
        &self,
        path: u32,
        surface: &Surface,
        on_surface: bool,
        direction: Vec3,
        photon: &Photon,
        records: &mut Vec<PhotonRecord>,
    ) {
        let power = channel_mean(photon.power);
        if !(power.is_finite() && power > 0.0) {
            return;
        }
        records.push(PhotonRecord {
            path,
            point: surface.point,
            direction,
            power,
            distance: if photon.at_infinity { f32::INFINITY } else { surface.distance },
            normal: side(surface, on_surface, direction),
            caustic: photon.delta_chain > 0,
        });
    }
}

/// The shading normal on the side that `direction` points to; zero in a medium.
fn side(surface: &Surface, on_surface: bool, direction: Vec3) -> Vec3 {
    if on_surface { surface.normal_towards(direction) } else { Vec3::ZERO }
}
