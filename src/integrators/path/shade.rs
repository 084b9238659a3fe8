//! Shading of paths that arrived at vertices: the light that is sampled there and the directions in which they go on, for sixteen
//! vertices of like materials at once, or for one.

use glam::Vec3;
use smallvec::SmallVec;

use super::vertices::{Shadows, Vertices};
use super::{Arrival, PathState, PathTracer};
use crate::base::random::{Dimension, Generators, Random};
use crate::geometry::{Ray, Surface};
use crate::guiding::sample::field::DirectionGuide;
use crate::integrators::mixture::{Proposal, cosine_normal, guided_point, one_draw};
use crate::integrators::site::{Draw, Lit, Onward, Site};
use crate::lights::seen::{ANYWHERE, LightView, facing, facings};
use crate::lights::{LightSamples, LightSet};
use crate::materials::{Bsdf, Plain, Transport, Variant};
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Vectors, Wide, vector};
use crate::scene::effects::Effects;

/// A number in each lane.
type Column = [f32; LANES];

/// What paths do at up to sixteen vertices, lane by lane, but for the densities of guides and for roulette.
#[derive(Default)]
pub(super) struct Shaded {
    /// Where a light was sampled from which something comes back, unless something is in the way, one bit each. What else is said of
    /// lights counts only there.
    lit: u32,
    /// Where no ray can hit the light.
    light_delta: u32,
    /// f·|cos θ|·L.
    light: Vectors,
    /// Density of light sampling w.r.t. solid angle.
    light_pdf: Column,
    /// The BSDF's density in the direction of the light.
    bsdf_pdf: Column,
    /// Unit direction to the light; not kept where there are no guides.
    to_light: Vectors,
    shadow_origin: Vectors,
    shadow_direction: Vectors,
    shadow_length: Column,
    /// See [`Onward`].
    any: u32,
    delta: u32,
    direction: Vectors,
    /// Not kept where there are no guides.
    value: Vectors,
    weight: Vectors,
    pdf: Column,
    /// Not kept where there are no guides.
    deltas: Column,
    /// Not kept where nothing refracts.
    squeeze: Column,
    origin: Vectors,
    /// Whether there are guides, and whether anything refracts.
    guided: bool,
    refracts: bool,
    /// Random numbers of roulette.
    roulette: Column,
    /// Which way the surfaces face, as the sky is sampled by it; [`ANYWHERE`] where that does not matter.
    pub facing: [u8; LANES],
    /// The guides' proposals that were to be taken.
    proposals: Proposals,
    /// See [`Shaded::guide`].
    guides: [Option<(f32, f32)>; LANES],
}

/// Proposals of guides that are to be taken.
type Proposals = [Option<Proposal>; LANES];

/// The guides of vertices that have one.
type Guides<'g> = [Option<DirectionGuide<'g>>; LANES];

/// Where numbers are kept, in all lanes or in the first alone.
trait Keep: Copy {
    type Real: Real;

    fn keep(self, numbers: Self::Real, column: &mut Column);

    #[inline(always)]
    fn keep_vectors(self, v: V3<Self::Real>, [x, y, z]: &mut Vectors) {
        self.keep(v.x, x);
        self.keep(v.y, y);
        self.keep(v.z, z);
    }
}

#[derive(Clone, Copy)]
struct All<W>(W);

impl<W: Wide> Keep for All<W> {
    type Real = W::Real;

    #[inline(always)]
    fn keep(self, numbers: W::Real, column: &mut Column) {
        *column = self.0.store(numbers);
    }
}

#[derive(Clone, Copy)]
struct First;

impl Keep for First {
    type Real = f32;

    #[inline(always)]
    fn keep(self, number: f32, column: &mut Column) {
        column[0] = number;
    }
}

impl Shaded {
    #[inline(always)]
    fn keep_light<K: Keep>(&mut self, to: K, light: &LightSamples<K::Real>, lit: &Lit<K::Real>) {
        self.lit = lit.any.answers();
        self.light_delta = light.delta.answers();
        to.keep_vectors(lit.radiance, &mut self.light);
        to.keep(light.pdf, &mut self.light_pdf);
        to.keep(lit.pdf, &mut self.bsdf_pdf);
        if self.guided {
            to.keep_vectors(light.wi, &mut self.to_light);
        }
        to.keep_vectors(lit.ray.0, &mut self.shadow_origin);
        to.keep_vectors(lit.ray.1, &mut self.shadow_direction);
        to.keep(lit.ray.2, &mut self.shadow_length);
    }

    #[inline(always)]
    fn keep_onward<K: Keep>(&mut self, to: K, onward: &Onward<K::Real>) {
        self.any = onward.any.answers();
        self.delta = onward.delta.answers();
        to.keep_vectors(onward.direction, &mut self.direction);
        to.keep_vectors(onward.weight, &mut self.weight);
        to.keep(onward.pdf, &mut self.pdf);
        to.keep_vectors(onward.origin, &mut self.origin);
        if self.guided {
            to.keep_vectors(onward.value, &mut self.value);
            to.keep(onward.deltas, &mut self.deltas);
        }
        self.refracts = onward.squeeze.is_some();
        if let Some(squeeze) = onward.squeeze {
            to.keep(squeeze, &mut self.squeeze);
        }
    }

    /// The light that was sampled at the vertex in a lane.
    #[inline(always)]
    pub fn light(&self, lane: usize) -> Option<Sampled> {
        (self.lit >> lane & 1 == 1).then(|| Sampled {
            light: vector(&self.light, lane),
            pdf: self.light_pdf[lane],
            bsdf_pdf: self.bsdf_pdf[lane],
            delta: self.light_delta >> lane & 1 == 1,
            shadow: (
                Ray { origin: vector(&self.shadow_origin, lane), direction: vector(&self.shadow_direction, lane) },
                self.shadow_length[lane],
            ),
        })
    }

    /// Unit direction to the light, where there are guides.
    #[inline(always)]
    pub fn to_light(&self, lane: usize) -> Vec3 {
        vector(&self.to_light, lane)
    }

    /// Probability of a delta lobe; 0 without guides, where it is not needed.
    #[inline(always)]
    pub fn deltas(&self, lane: usize) -> f32 {
        if self.guided { self.deltas[lane] } else { 0.0 }
    }

    /// How the path in a lane goes on.
    #[inline(always)]
    pub fn onward(&self, lane: usize) -> Onward<f32> {
        let delta = self.delta >> lane & 1 == 1;
        let (weight, pdf) = (vector(&self.weight, lane), self.pdf[lane]);
        let value = match self.guided {
            true => vector(&self.value, lane),
            false if delta => Vec3::ZERO,
            false => weight * pdf,
        };
        Onward {
            any: self.any >> lane & 1 == 1,
            direction: vector(&self.direction, lane).into(),
            value: value.into(),
            weight: weight.into(),
            pdf,
            delta,
            deltas: self.deltas(lane),
            squeeze: self.refracts.then(|| self.squeeze[lane]),
            origin: vector(&self.origin, lane).into(),
        }
    }

    /// Asks guides for their densities in the directions that the BSDFs have drawn.
    #[inline(always)]
    fn ask(&mut self, guides: &Guides) {
        if !self.guided {
            return;
        }
        let chooses = |lane: usize| guides[lane].filter(|_| self.delta >> lane & 1 == 0);
        let mut asked = [None; LANES];
        for (lane, asked) in asked.iter_mut().enumerate() {
            if self.any >> lane & 1 == 1 && self.proposals[lane].is_none() {
                *asked = chooses(lane).map(|guide| (guide, vector(&self.direction, lane)));
            }
        }
        let densities = DirectionGuide::pdf_lanes(&asked);
        let density = |lane: usize| self.proposals[lane].map_or(densities[lane], |proposal| proposal.pdf);
        let mut all = [None; LANES];
        for (lane, of) in all.iter_mut().enumerate() {
            *of = chooses(lane).map(|guide| (guide.bsdf_fraction, density(lane)));
        }
        self.guides = all;
    }

    /// Of the guide in a lane, unless a delta lobe was drawn: the probability of sampling the BSDF instead, and its density in the
    /// direction in which the path goes on.
    #[inline(always)]
    pub fn guide(&self, lane: usize) -> Option<(f32, f32)> {
        if self.guided { self.guides[lane] } else { None }
    }

    /// Random number of roulette.
    #[inline(always)]
    pub fn roulette(&self, lane: usize) -> f32 {
        self.roulette[lane]
    }
}

/// A light that was sampled at a vertex, from which something comes back unless something is in the way.
pub(super) struct Sampled {
    /// f·|cos θ|·L.
    pub light: Vec3,
    /// Density of light sampling w.r.t. solid angle.
    pub pdf: f32,
    /// The BSDF's density in its direction.
    pub bsdf_pdf: f32,
    /// Whether no ray can hit it.
    pub delta: bool,
    /// The shadow ray with its length.
    pub shadow: (Ray, f32),
}

/// How sixteen vertices scatter, which are of one variant.
trait Points<'b>: Copy {
    /// See [`Bsdf::chooses_lobe`].
    fn chooses_lobe(self) -> bool;

    /// Lane by lane.
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real>;
}

/// Of any variant: of the vertices that are looked at, at least one.
impl<'b> Points<'b> for &[Bsdf<'b, f32>] {
    #[inline(always)]
    fn chooses_lobe(self) -> bool {
        self[0].chooses_lobe()
    }

    #[inline(always)]
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real> {
        let mut points = [&self[0]; LANES];
        for (point, bsdf) in points.iter_mut().zip(self) {
            *point = bsdf;
        }
        Bsdf::gather(wide, points)
    }
}

impl<'b> Points<'b> for &[Plain; LANES] {
    #[inline(always)]
    fn chooses_lobe(self) -> bool {
        false
    }

    #[inline(always)]
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real> {
        Plain::gather(wide, self)
    }
}

/// Vertices that are shaded together: all with bumps or none. Lanes behind the last one repeat the first.
struct Sixteen<'g> {
    /// Whether lights are sampled at some of them.
    connects: bool,
    bumped: bool,
    surfaces: [&'g Surface; LANES],
    /// The rays on which the paths arrived.
    rays: [&'g Ray; LANES],
    randoms: [&'g Random; LANES],
}

/// Vertices with all that their shading depends on.
struct Group<'g, P> {
    points: P,
    sixteen: Sixteen<'g>,
    lights: &'g LightSet,
    /// How the vertices see the lights, but for their facings, and whether these matter.
    view: LightView<'g>,
    asks_facing: bool,
    shaded: &'g mut Shaded,
}

impl<'b, P: Points<'b>> Group<'_, P> {
    #[inline(always)]
    fn lights<W: Wide>(&self, wide: W, points: &V3<W::Real>, of: &Generators<LANES>) -> LightSamples<W::Real> {
        let choices = if self.lights.has_choice() { of.draw(Dimension::LIGHT).doubles() } else { [0.0; LANES] };
        self.lights.sample_lanes(wide, points, &choices, &of.draw(Dimension::LIGHT_POINT).points(), &self.view)
    }

    #[inline(always)]
    fn draw<W: Wide>(&self, wide: W, of: &Generators<LANES>) -> Draw<W::Real> {
        let chooses = self.points.chooses_lobe();
        let lobes = if chooses { of.draw(Dimension::LOBE).numbers() } else { [0.0; LANES] };
        let guided = self.shaded.guided.then(|| {
            let (proposals, mut taken) = (&self.shaded.proposals, [0.0; LANES]);
            for (taken, proposal) in taken.iter_mut().zip(proposals) {
                *taken = f32::from(proposal.is_some());
            }
            let directions = wide.vectors(|lane| proposals[lane].map_or(Vec3::ZERO, |of| of.direction));
            (wide.load(&taken).above(0.0), directions)
        });
        let u = wide.points(&of.draw(Dimension::DIRECTION).points());
        Draw { lobe: wide.load(&lobes), u, guided, transport: Transport::Radiance }
    }
}

impl<'b, P: Points<'b>> Kernel for Group<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(mut self, wide: W) {
        let Sixteen { connects, bumped, surfaces, rays, randoms } = &self.sixteen;
        let (origins, normal) = Surface::shading_lanes(wide, surfaces);
        let mut smooth = normal;
        let out = -Ray::directions(wide, rays);
        if *bumped || self.asks_facing {
            smooth = Surface::smooth_lanes(wide, surfaces);
        }
        if self.asks_facing {
            let towards = V3::choose(smooth.dot(out).below(0.0), -smooth, smooth);
            self.view.facing = wide.store(facings(towards)).map(|number| number as u8);
        }
        self.shaded.facing = self.view.facing;
        let site = Site::new(origins, normal, smooth, out, self.points.gather(wide), *bumped);
        let generators = Generators::new(randoms);
        if *connects {
            let light = self.lights(wide, &origins.point, &generators);
            self.shaded.keep_light(All(wide), &light, &site.light(&light));
        }
        let draw = self.draw(wide, &generators);
        self.shaded.roulette = generators.draw(Dimension::ROULETTE).numbers();
        self.shaded.keep_onward(All(wide), &site.draw(&draw));
    }
}

/// Vertices by what may be shaded together, and room for what becomes of them, reused from chunk to chunk.
#[derive(Default)]
pub(super) struct Groups {
    /// Indices of vertices, for each variant with and without bumps.
    alike: Vec<Vec<u32>>,
    shaded: Shaded,
}

impl Groups {
    /// Sorts vertices; without `materials` other than plain ones all are alike.
    #[inline(always)]
    fn sort(&mut self, vertices: &[Arrival], materials: bool) {
        self.alike.resize_with(2 * Variant::COUNT, Vec::new);
        if !materials {
            self.alike[0].clear();
            return self.alike[0].extend(0..vertices.len() as u32);
        }
        self.alike.iter_mut().for_each(Vec::clear);
        for (index, vertex) in (0..).zip(vertices) {
            self.alike[2 * vertex.variant.index() + usize::from(vertex.bumped)].push(index);
        }
    }
}

/// Fewest vertices that are shaded in lanes: fewer take less time one by one.
const FEWEST: usize = 3;

impl PathTracer<'_> {
    /// How a vertex scatters.
    #[inline(always)]
    fn bsdf(&self, at: &Arrival, surface: &Surface) -> Bsdf<'_, f32> {
        match at.phase {
            Some(phase) => Bsdf::phase(phase),
            None => self.scene.material(surface).at(surface.uv),
        }
    }

    /// Shades the vertices at which paths arrived and takes these on, in any order; `goes_on` is told of each that does.
    #[inline(always)]
    pub(super) fn shade<E: Effects, const RECORDS: bool>(
        &self,
        (arrivals, surfaces): (&[Arrival], &[Surface]),
        paths: &mut [PathState],
        groups: &mut Groups,
        vertices: &mut Vertices,
        shadows: &mut Shadows,
        mut goes_on: impl FnMut(u32),
    ) {
        groups.sort(arrivals, E::MATERIALS);
        let fewest = if lanes::available() { FEWEST } else { usize::MAX };
        let Groups { alike, shaded } = groups;
        let alike = if E::MATERIALS { &alike[..] } else { &alike[..1] };
        for indices in alike.iter().flat_map(|alike| alike.chunks(LANES)) {
            let together = if indices.len() < fewest { 1 } else { LANES };
            for indices in indices.chunks(together) {
                // Lanes behind the last vertex repeat the first, and are not looked at.
                let mut group = [&arrivals[indices[0] as usize]; LANES];
                for (lane, index) in group.iter_mut().zip(indices) {
                    *lane = &arrivals[*index as usize];
                }
                let guides = self.propose::<E>(&group[..indices.len()], surfaces, paths, shaded);
                if together == 1 {
                    self.shade_one(group[0], surfaces, paths, shaded);
                } else {
                    self.shade_lanes::<E>(group, indices.len(), surfaces, paths, shaded);
                }
                if E::GUIDING {
                    shaded.ask(&guides);
                }
                for (lane, at) in group.into_iter().enumerate().take(indices.len()) {
                    let (path, surface) = (&mut paths[at.path as usize], &surfaces[at.place as usize]);
                    if self.go_on::<E, RECORDS>(path, at, surface, (shaded, lane), vertices, shadows) {
                        goes_on(at.path);
                    }
                }
            }
        }
    }

    /// Lets the guides at vertices propose directions, and returns them.
    #[inline(always)]
    fn propose<E: Effects>(
        &self,
        vertices: &[&Arrival],
        surfaces: &[Surface],
        paths: &[PathState],
        shaded: &mut Shaded,
    ) -> Guides<'_> {
        let mut guides = [None; LANES];
        shaded.lit = 0;
        shaded.guided = E::GUIDING && vertices.iter().any(|at| at.voxel.is_some());
        if shaded.guided {
            let mut draws = [None; LANES];
            for (lane, at) in vertices.iter().enumerate() {
                let (path, surface) = (&paths[at.path as usize], &surfaces[at.place as usize]);
                let normal = cosine_normal(at.variant, surface, -path.ray.direction);
                guides[lane] = self.guide(at.voxel, surface.point, normal);
                let random = &path.random;
                draws[lane] = guides[lane].and_then(|guide| Some((guide, guided_point(guide.bsdf_fraction, random)?)));
            }
            let drawn = DirectionGuide::sample_lanes(&draws);
            for (proposal, drawn) in shaded.proposals.iter_mut().zip(drawn) {
                *proposal = drawn.map(Proposal::from);
            }
        }
        guides
    }

    /// Shades vertices together, of which the first `count` are looked at.
    #[inline(always)]
    fn shade_lanes<E: Effects>(
        &self,
        vertices: [&Arrival; LANES],
        count: usize,
        surfaces: &[Surface],
        paths: &[PathState],
        shaded: &mut Shaded,
    ) {
        let first = vertices[0];
        let (path, surface) = (&paths[first.path as usize], &surfaces[first.place as usize]);
        let mut sixteen = Sixteen {
            connects: false,
            bumped: first.bumped,
            surfaces: [surface; LANES],
            rays: [&path.ray; LANES],
            randoms: [&path.random; LANES],
        };
        for (lane, at) in vertices.iter().enumerate().take(count) {
            let path = &paths[at.path as usize];
            sixteen.connects |= at.connects;
            sixteen.surfaces[lane] = &surfaces[at.place as usize];
            (sixteen.rays[lane], sixteen.randoms[lane]) = (&path.ray, &path.random);
        }
        if first.variant == Variant::PLAIN && !first.bumped {
            let mut points = [Plain::default(); LANES];
            for (point, surface) in points.iter_mut().zip(sixteen.surfaces) {
                *point = self.scene.material(surface).plain_at(surface.uv).unwrap_or_default();
            }
            self.shade_points(&points, sixteen, shaded);
        } else if E::MATERIALS {
            // Not an array: they are large, and would be written twice.
            let looked_at = vertices.iter().take(count).zip(sixteen.surfaces);
            let bsdfs: SmallVec<[Bsdf<f32>; LANES]> = looked_at.map(|(at, surface)| self.bsdf(at, surface)).collect();
            self.shade_points(&bsdfs[..], sixteen, shaded);
        }
    }

    /// Shades vertices that scatter so.
    #[inline(always)]
    fn shade_points<'p>(&'p self, points: impl Points<'p>, sixteen: Sixteen, shaded: &mut Shaded) {
        let view = LightView {
            learned: self.lights.sky(),
            facing: [ANYWHERE; LANES],
            odds: self.lights.odds_lanes(|lane| sixteen.surfaces[lane].point),
        };
        // There are lanes, or these would have been shaded one by one.
        let _ = lanes::run(Group {
            points,
            sixteen,
            lights: &self.scene.lights,
            view,
            asks_facing: self.lights.asks_facing(),
            shaded,
        });
    }

    /// Shades a vertex alone, in the first lane.
    fn shade_one(&self, at: &Arrival, surfaces: &[Surface], paths: &[PathState], shaded: &mut Shaded) {
        let (path, surface) = (&paths[at.path as usize], &surfaces[at.place as usize]);
        let (lights, random, bsdf) = (&self.scene.lights, &path.random, self.bsdf(at, surface));
        let (normal, smooth, out) = (surface.shading.into(), surface.smooth.into(), -path.ray.direction);
        shaded.facing[0] = if self.lights.asks_facing() { facing(surface.normal_towards(out)) } else { ANYWHERE };
        let site = Site::<f32>::new(surface.origin(), normal, smooth, out.into(), bsdf, at.bumped);
        if at.connects {
            let u = random.at(Dimension::LIGHT_POINT).next_2d();
            let view = self.lights.view(surface.point, shaded.facing[0]);
            if let Some(light) = lights.sample(surface.point, lights.choice(random), u, &view) {
                let light = light.into();
                shaded.keep_light(First, &light, &site.light(&light));
            }
        }
        let guided = shaded.guided.then_some(shaded.proposals[0]);
        let draw = one_draw(random, bsdf.chooses_lobe(), guided, Transport::Radiance);
        shaded.roulette[0] = random.at(Dimension::ROULETTE).next_f32();
        shaded.keep_onward(First, &site.draw(&draw));
    }
}
