//! The photon tracer: light paths whose power is deposited in the voxels that camera paths have reached.

use glam::Vec3;

use super::mixture::{Mixture, Scattering};
use super::{ROULETTE_MOST, ROULETTE_START, Roulette, TransportSettings};
use crate::base::random::{Dimension, Random};
use crate::geometry::Surface;
use crate::guiding::learn::emission::{EmissionGuide, Start};
use crate::guiding::record::PhotonRecord;
use crate::integrators::path::RayCount;
use crate::lights::Emission;
use crate::materials::Transport;
use crate::math::channel_mean;
use crate::scene::Scene;
use crate::scene::effects::{Effects, With};

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

impl PhotonTracer<'_> {
    /// Traces one light path of `paths` in the pass and adds a record per useful arrival, which says that it belongs to light
    /// path `path`. Powers are those of a pass whose light paths together carry the power of the scene. Returns how it started.
    pub fn trace(
        &self,
        random: &mut Random,
        (path, paths): (u32, u64),
        records: &mut Vec<PhotonRecord>,
        count: &mut RayCount,
    ) -> Option<Start> {
        let start = self.emission.sample(random)?;
        let needs = self.scene.needs();
        match (needs.media, needs.materials) {
            (true, _) => self.walk::<With<false, true, true>>(&start, random, (path, paths), records, count),
            (_, true) => self.walk::<With<false, true, false>>(&start, random, (path, paths), records, count),
            (_, false) => self.walk::<With<false, false, false>>(&start, random, (path, paths), records, count),
        }
        Some(start)
    }

    fn walk<E: Effects>(
        &self,
        start: &Start,
        random: &mut Random,
        (path, paths): (u32, u64),
        records: &mut Vec<PhotonRecord>,
        count: &mut RayCount,
    ) {
        let Some((emission, mut photon)) = self.emit(start) else { return };
        if !photon.is_finite(count) {
            return;
        }
        photon.power /= paths as f32;
        let begun = channel_mean(photon.power);
        let mut ray = emission.ray;
        let mut medium = self.scene.light_medium(start.light);
        // A light path of n segments continues to the camera with at least one more: n + 1 vertices after the light.
        for depth in 1..self.settings.max_depth {
            count.rays += 1;
            random.begin_vertex(depth);
            let (arrival, passed) =
                self.scene.advance::<E>(&ray, &mut medium, photon.power, &mut random.at(Dimension::SEGMENT));
            photon.power *= passed;
            if !photon.is_finite(count) {
                return;
            }
            let Some((surface, scattering)) = Scattering::at(self.scene, arrival) else { return };
            let on_surface = scattering.is_material();
            if !scattering.is_delta() && photon.is_useful(self.settings.light_sampling) {
                self.deposit(path, &surface, on_surface, -ray.direction, &photon, records);
            }
            let mixture = Mixture::<E>::new(&surface, scattering, -ray.direction, None);
            let Some(sample) = mixture.sample(random, Transport::Importance) else { return };
            photon.power *= sample.weight;
            if on_surface {
                photon.power *= shading_correction(&surface, -ray.direction, sample.direction);
            }
            if !photon.is_finite(count) {
                return;
            }
            let survival = self.survival(depth, channel_mean(photon.power) / begun);
            if !(survival > 0.0 && random.at(Dimension::ROULETTE).next_f32() < survival) {
                return;
            }
            photon.power /= survival;
            photon.at_infinity = false;
            photon.delta_chain = if sample.delta { photon.delta_chain + 1 } else { 0 };
            photon.scattered |= !sample.delta;
            if E::MEDIA {
                medium = self.scene.medium_beyond(&surface, sample.direction, medium);
            }
            ray = surface.leave(sample.direction);
        }
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

    fn survival(&self, depth: u32, relative: f32) -> f32 {
        if self.settings.roulette == Roulette::Off || depth < ROULETTE_START {
            1.0
        } else {
            relative.clamp(0.0, ROULETTE_MOST)
        }
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
        });
    }
}

/// The shading normal on the side that `direction` points to; zero in a medium.
fn side(surface: &Surface, on_surface: bool, direction: Vec3) -> Vec3 {
    if on_surface { surface.normal_towards(direction) } else { Vec3::ZERO }
}

/// Adjoint correction for shading normals (Veach 1997, eq. 5.19): power is carried by the geometric cosine, the BSDF's
/// cosine is the shading one.
fn shading_correction(surface: &Surface, arriving: Vec3, leaving: Vec3) -> f32 {
    let ratio = |w: Vec3| surface.frame.n.dot(w).abs() / surface.normal.dot(w).abs();
    let correction = ratio(arriving) / ratio(leaving);
    // The ratio is unbounded at grazing angles; photons only steer sampling, so the tail is cut.
    if correction.is_finite() { correction.min(10.0) } else { 0.0 }
}
