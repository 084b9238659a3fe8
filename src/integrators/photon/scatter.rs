//! Scattering of photons: the directions in which they go on, and what they carry on, for sixteen vertices of like materials at once, or
//! for one.

use glam::Vec3;
use smallvec::SmallVec;

use super::{Arrival, LightPath, PhotonTracer};
use crate::base::random::{Dimension, Generators};
use crate::geometry::{Ray, Surface};
use crate::integrators::ROULETTE_MOST;
use crate::integrators::alike::{self, Alike, Points, bsdf};
use crate::integrators::kept::{All, First, Keep};
use crate::integrators::mixture::one_draw;
use crate::integrators::path::RayCount;
use crate::integrators::site::{Draw, Onward, Site};
use crate::materials::{Bsdf, Transport, Variant};
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Vectors, Wide, vector};
use crate::scene::effects::Effects;

/// Photons at the vertices where they scatter, lane by lane.
struct Photons<R: Real> {
    power: V3<R>,
    /// Channel mean of the power that the path began with.
    begun: R,
    /// Unit direction that the photon came from.
    out: V3<R>,
    /// Geometric and shading normal; none in a medium.
    normals: Option<[V3<R>; 2]>,
    /// Random number of roulette; none where that is not played.
    roulette: Option<R>,
}

impl<R: Real> Photons<R> {
    /// Their power once they go on so, without roulette.
    #[inline(always)]
    fn scattered(&self, onward: &Onward<R>) -> V3<R> {
        let power = self.power * onward.weight;
        match self.normals {
            Some([normal, shading]) => power * shading_correction(normal, shading, self.out, onward.direction),
            None => power,
        }
    }

    /// Probability of surviving roulette with this power.
    #[inline(always)]
    fn survival(&self, power: V3<R>) -> R {
        (power.mean() / self.begun).between(0.0, ROULETTE_MOST)
    }
}

/// Adjoint correction for shading normals (Veach 1997, eq. 5.19): power is carried by the geometric cosine, the BSDF's
/// cosine is the shading one.
#[inline(always)]
fn shading_correction<R: Real>(normal: V3<R>, shading: V3<R>, arriving: V3<R>, leaving: V3<R>) -> R {
    let ratio = |w: V3<R>| shading.dot(w).abs() / normal.dot(w).abs();
    let correction = ratio(arriving) / ratio(leaving);
    // The ratio is unbounded at grazing angles; photons only steer sampling, so the tail is cut.
    correction.at_most(10.0).only(correction.finite())
}

/// What becomes of photons, lane by lane.
#[derive(Default)]
struct Scattered {
    /// Where a photon goes on, where a delta lobe sent it, and where its power is not finite, one bit each.
    goes_on: u32,
    delta: u32,
    lost: u32,
    /// These count only where photons go on.
    power: Vectors,
    origin: Vectors,
    direction: Vectors,
}

impl Scattered {
    #[inline(always)]
    fn keep<K: Keep>(&mut self, to: K, photons: &Photons<K::Real>, onward: &Onward<K::Real>) {
        let mut power = photons.scattered(onward);
        let finite = power.is_finite();
        let mut goes_on = onward.any & finite & !power.is_zero();
        if let Some(number) = photons.roulette {
            let survival = photons.survival(power);
            goes_on = goes_on & number.lt(survival);
            power = power / survival;
        }
        self.goes_on = goes_on.answers();
        self.delta = onward.delta.answers();
        self.lost = (onward.any & !finite).answers();
        to.keep_vectors(power, &mut self.power);
        to.keep_vectors(onward.origin, &mut self.origin);
        to.keep_vectors(onward.direction, &mut self.direction);
    }
}

/// Vertices that scatter together: of one variant, all with bumps or none. Lanes behind the last one repeat the first, and are not looked
/// at.
struct Together<'v> {
    count: usize,
    vertices: [&'v Arrival; LANES],
    surfaces: [&'v Surface; LANES],
    paths: [&'v LightPath; LANES],
    /// Whether roulette is played.
    plays: bool,
}

impl<'v> Together<'v> {
    /// Of up to sixteen vertices, at least one.
    #[inline(always)]
    fn new(
        indices: &[u32],
        arrivals: &'v [Arrival],
        surfaces: &'v [Surface],
        paths: &'v [LightPath],
        plays: bool,
    ) -> Self {
        let vertices: [&Arrival; LANES] =
            std::array::from_fn(|lane| &arrivals[indices[if lane < indices.len() { lane } else { 0 }] as usize]);
        Self {
            count: indices.len(),
            vertices,
            surfaces: vertices.map(|at| &surfaces[at.place as usize]),
            paths: vertices.map(|at| &paths[at.path as usize]),
            plays,
        }
    }
}

/// Scatters sixteen.
struct Scatter<'g, P> {
    points: P,
    together: &'g Together<'g>,
    scattered: &'g mut Scattered,
}

impl<'b, P: Points<'b>> Kernel for Scatter<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let Together { vertices, surfaces, paths, plays, .. } = self.together;
        let bumped = vertices[0].bumped;
        let (origins, shading) = Surface::shading_lanes(wide, surfaces);
        let smooth = if bumped { Surface::smooth_lanes(wide, surfaces) } else { shading };
        let out = -Ray::directions(wide, |lane| &paths[lane].ray);
        let generators = Generators::new(|lane| &paths[lane].random);
        let lobe = if self.points.chooses_lobe() { generators.draw(Dimension::LOBE).numbers() } else { [0.0; LANES] };
        let u = wide.points(&generators.draw(Dimension::DIRECTION).points());
        let draw = Draw { lobe: wide.load(&lobe), u, guided: None, transport: Transport::Importance };
        let [x, y, z, begun] = wide.four_columns(|lane| {
            let LightPath { photon, begun, .. } = paths[lane];
            [photon.power.x, photon.power.y, photon.power.z, *begun]
        });
        let photons = Photons {
            power: V3::new(x, y, z),
            begun,
            out,
            normals: vertices[0].phase.is_none().then_some([origins.normal, shading]),
            roulette: plays.then(|| wide.load(&generators.draw(Dimension::ROULETTE).numbers())),
        };
        let site = Site::new(origins, shading, smooth, out, self.points.gather(wide), bumped);
        self.scattered.keep(All(wide), &photons, &site.draw(&draw));
    }
}

/// Vertices by what may scatter together, and room for what becomes of photons there, reused from chunk to chunk.
#[derive(Default)]
pub(super) struct Groups {
    alike: Alike,
    scattered: Scattered,
}

impl PhotonTracer<'_> {
    /// Takes paths on from the vertices at which they arrived, in any order; `goes_on` is told the index and the ray of each that does.
    #[inline(always)]
    pub(super) fn scatter<E: Effects>(
        &self,
        (depth, arrivals, surfaces): (u32, &[Arrival], &[Surface]),
        paths: &mut [LightPath],
        groups: &mut Groups,
        count: &mut RayCount,
        mut goes_on: impl FnMut(u32, &Ray),
    ) {
        let (plays, fewest) = (self.settings.roulette.plays(depth), alike::fewest());
        let Groups { alike, scattered } = groups;
        alike.sort(arrivals.iter().map(|at| (at.variant, at.bumped)));
        for together in alike.all().iter().flat_map(|indices| indices.chunks(LANES)) {
            let most = if together.len() < fewest { 1 } else { LANES };
            for indices in together.chunks(most) {
                let together = Together::new(indices, arrivals, surfaces, paths, plays);
                if most == 1 {
                    self.scatter_one(&together, scattered);
                } else {
                    self.scatter_lanes(&together, scattered);
                }
                count.dropped += u64::from((scattered.lost & lanes_below(indices.len())).count_ones());
                for (lane, &index) in indices.iter().enumerate() {
                    let at = &arrivals[index as usize];
                    let path = &mut paths[at.path as usize];
                    if scattered.goes_on >> lane & 1 == 1 {
                        self.go_on::<E>(path, at, &surfaces[at.place as usize], (scattered, lane));
                        goes_on(at.path, &path.ray);
                    }
                }
            }
        }
    }

    /// Scatters vertices together.
    #[inline(always)]
    fn scatter_lanes(&self, together: &Together, scattered: &mut Scattered) {
        let Together { count, vertices, surfaces, .. } = together;
        // There are lanes, or these would have been scattered one by one.
        if vertices[0].variant == Variant::PLAIN && !vertices[0].bumped {
            let points = surfaces.map(|surface| self.scene.plain_at(surface).unwrap_or_default());
            let _ = lanes::run(Scatter { points: &points, together, scattered });
        } else {
            // Not an array: they are large, and would be written twice.
            let looked_at = vertices.iter().zip(surfaces).take(*count);
            let bsdfs: SmallVec<[Bsdf<f32>; LANES]> =
                looked_at.map(|(at, surface)| bsdf(self.scene, at.phase, surface)).collect();
            let _ = lanes::run(Scatter { points: &bsdfs[..], together, scattered });
        }
    }

    /// Scatters a vertex alone, in the first lane.
    fn scatter_one(&self, together: &Together, scattered: &mut Scattered) {
        let (at, path, surface) = (together.vertices[0], together.paths[0], together.surfaces[0]);
        let (bsdf, random, out) = (bsdf(self.scene, at.phase, surface), &path.random, -path.ray.direction);
        let (shading, smooth, normal) = (surface.shading.into(), surface.smooth.into(), surface.normal.into());
        let photons = Photons {
            power: path.photon.power.into(),
            begun: path.begun,
            out: out.into(),
            normals: at.phase.is_none().then_some([normal, shading]),
            roulette: together.plays.then(|| random.at(Dimension::ROULETTE).next_f32()),
        };
        let site = Site::<f32>::new(surface.origin(), shading, smooth, out.into(), bsdf, at.bumped);
        let draw = one_draw(random, bsdf.chooses_lobe(), None, Transport::Importance);
        scattered.keep(First, &photons, &site.draw(&draw));
    }

    /// Takes a path on from its vertex.
    #[inline(always)]
    fn go_on<E: Effects>(
        &self,
        path: &mut LightPath,
        at: &Arrival,
        surface: &Surface,
        (scattered, lane): (&Scattered, usize),
    ) {
        let delta = scattered.delta >> lane & 1 == 1;
        let (origin, direction): (Vec3, Vec3) = (vector(&scattered.origin, lane), vector(&scattered.direction, lane));
        let photon = &mut path.photon;
        photon.power = vector(&scattered.power, lane);
        photon.at_infinity = false;
        photon.delta_chain = if delta { photon.delta_chain + 1 } else { 0 };
        photon.scattered |= !delta;
        if E::MEDIA && at.phase.is_none() {
            path.medium = self.scene.medium_beyond(surface, direction, path.medium);
        }
        path.ray = Ray { origin, direction };
    }
}

/// Bits of the first so many lanes.
#[inline(always)]
fn lanes_below(count: usize) -> u32 {
    (1 << count) - 1
}
