//! Shading of paths that arrived at vertices: the light that is sampled there and the directions in which they go on, for sixteen
//! vertices of like materials at once, or for one.

use std::marker::PhantomData;

use smallvec::SmallVec;

use super::going::{Going, Gone};
use super::guides::Guides;
use super::shaded::Shaded;
use super::sixteen::Sixteen;
use super::vertices::{Shadows, Vertices};
use super::{Arrival, PathState, PathTracer};
use crate::base::random::{Dimension, Generators};
use crate::geometry::{Ray, Surface};
use crate::guiding::sample::lanes::GuideLanes;
use crate::integrators::alike::{self, Alike, Points, bsdf};
use crate::integrators::kept::{All, First};
use crate::integrators::mixture::one_draw;
use crate::integrators::site::{Draw, Site};
use crate::lights::seen::{ANYWHERE, LightView, facing, facings};
use crate::lights::{LightSamples, LightSet};
use crate::materials::{Bsdf, Plain, Transport, Variant};
use crate::math::lanes::{self, Kernel, LANES, Real, V3, Wide};
use crate::scene::effects::Effects;

/// Vertices with all that their shading depends on.
struct Group<'g, P> {
    points: P,
    sixteen: &'g Sixteen<'g, 'g>,
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
        let guided = self.shaded.proposals(All(wide));
        let u = wide.points(&of.draw(Dimension::DIRECTION).points());
        Draw { lobe: wide.load(&lobes), u, guided, transport: Transport::Radiance }
    }
}

impl<'b, P: Points<'b>> Kernel for Group<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(mut self, wide: W) {
        let Sixteen { connects, vertices, surfaces, paths, .. } = self.sixteen;
        let bumped = vertices[0].bumped;
        let (origins, normal) = Surface::shading_lanes(wide, surfaces);
        let mut smooth = normal;
        let out = -Ray::directions(wide, |lane| &paths[lane].ray);
        if bumped || self.asks_facing {
            smooth = Surface::smooth_lanes(wide, surfaces);
        }
        if self.asks_facing {
            let towards = V3::choose(smooth.dot(out).below(0.0), -smooth, smooth);
            self.view.facing = wide.store(facings(towards)).map(|number| number as u8);
        }
        self.shaded.facing = self.view.facing;
        let site = Site::new(origins, normal, smooth, out, self.points.gather(wide), bumped);
        let generators = Generators::new(|lane| &paths[lane].random);
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
    alike: Alike,
    shaded: Shaded,
    gone: Gone,
}

/// What shading reads and writes.
struct Room<'r, 's> {
    surfaces: &'s [Surface],
    paths: &'r mut [PathState],
    /// Whether roulette is played by what paths carry.
    plays: bool,
    /// Fewest vertices that are shaded in lanes.
    fewest: usize,
    shaded: &'r mut Shaded,
    gone: &'r mut Gone,
    vertices: &'r mut Vertices,
    shadows: &'r mut Shadows,
}

impl PathTracer<'_> {
    /// Shades the vertices at which paths arrived and takes these on, in any order; `goes_on` is told the index and the ray of each that does.
    #[inline(always)]
    pub(super) fn shade<E: Effects, const RECORDS: bool>(
        &self,
        (depth, arrivals, surfaces): (u32, &[Arrival], &[Surface]),
        paths: &mut [PathState],
        groups: &mut Groups,
        vertices: &mut Vertices,
        shadows: &mut Shadows,
        mut goes_on: impl FnMut(u32, &Ray),
    ) {
        let plays = self.settings.roulette.plays(depth);
        if E::MATERIALS {
            groups.alike.sort(arrivals.iter().map(|vertex| (vertex.variant, vertex.bumped)));
        }
        let Groups { alike, shaded, gone } = groups;
        let fewest = alike::fewest();
        let mut room = Room { surfaces, paths, plays, fewest, shaded, gone, vertices, shadows };
        if E::MATERIALS {
            for alike in alike.all() {
                let vertex = |index: &u32| &arrivals[*index as usize];
                self.shade_alike::<E, RECORDS, _>(alike, vertex, &mut room, &mut goes_on);
            }
        } else {
            self.shade_alike::<E, RECORDS, _>(arrivals, |vertex| vertex, &mut room, &mut goes_on);
        }
    }

    /// Shades vertices of one variant, all with bumps or none, which `vertex` tells of `all`.
    #[inline(always)]
    fn shade_alike<'a, E: Effects, const RECORDS: bool, V>(
        &self,
        all: &'a [V],
        vertex: impl Fn(&'a V) -> &'a Arrival + Copy,
        room: &mut Room<'_, 'a>,
        goes_on: &mut impl FnMut(u32, &Ray),
    ) {
        for together in all.chunks(LANES) {
            let most = if together.len() < room.fewest { 1 } else { LANES };
            for together in together.chunks(most) {
                let Room { surfaces, paths, plays, shaded, gone, vertices, shadows, .. } = room;
                let sixteen = Sixteen::new(vertex(&together[0]), together.iter().map(vertex), surfaces, paths);
                let guides = self.guides::<E>(&sixteen);
                (shaded.lit, shaded.guided) = (0, guides.is_some());
                if let Some(guides) = &guides {
                    guides.propose(most > 1, shaded);
                }
                if most == 1 {
                    self.shade_one(&sixteen, shaded);
                } else {
                    self.shade_lanes::<E>(&sixteen, shaded);
                }
                if let Some(guides) = &guides {
                    guides.ask(most > 1, shaded);
                }
                let (plays, effects) = (*plays, PhantomData::<E>);
                let usual = self.settings.roulette.usual(self.field);
                let Sixteen { vertices: arrivals, surfaces, paths: before, .. } = sixteen;
                Going { shaded, vertices: &arrivals, paths: &before, plays, usual, gone, effects }.take(most > 1);
                for (lane, at) in together.iter().map(vertex).enumerate() {
                    let (path, surface) = (&mut paths[at.path as usize], surfaces[lane]);
                    if at.connects {
                        self.connect::<E>(path, at, surface, (shaded, lane), shadows);
                    }
                    if self.go_on::<E, RECORDS>(path, at, surface, (shaded, gone, lane), vertices) {
                        goes_on(at.path, &path.ray);
                    }
                }
            }
        }
    }

    /// The guides at vertices; none where none of them has one.
    #[inline(always)]
    fn guides<'s, E: Effects>(&'s self, sixteen: &'s Sixteen) -> Option<Guides<'s, 's>> {
        if !E::GUIDING {
            return None;
        }
        let field = self.field?;
        let guides = GuideLanes::new(|lane| {
            let voxel = sixteen.vertices[lane].voxel.filter(|_| lane < sixteen.count)?;
            Some(&field.voxels()[voxel as usize])
        });
        (guides.any != 0).then_some(Guides { guides, sixteen })
    }

    /// Shades vertices together.
    #[inline(always)]
    fn shade_lanes<E: Effects>(&self, sixteen: &Sixteen, shaded: &mut Shaded) {
        let Sixteen { count, vertices, surfaces, .. } = sixteen;
        if !E::MATERIALS || vertices[0].variant == Variant::PLAIN && !vertices[0].bumped {
            let mut points = [Plain::default(); LANES];
            for (point, surface) in points.iter_mut().zip(surfaces) {
                *point = self.scene.plain_at(surface).unwrap_or_default();
            }
            self.shade_points(&points, sixteen, shaded);
        } else {
            // Not an array: they are large, and would be written twice.
            let looked_at = vertices.iter().zip(surfaces).take(*count);
            let bsdfs: SmallVec<[Bsdf<f32>; LANES]> =
                looked_at.map(|(at, surface)| bsdf(self.scene, at.phase, surface)).collect();
            self.shade_points(&bsdfs[..], sixteen, shaded);
        }
    }

    /// Shades vertices that scatter so.
    #[inline(always)]
    fn shade_points<'p>(&'p self, points: impl Points<'p>, sixteen: &Sixteen, shaded: &mut Shaded) {
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
    fn shade_one(&self, sixteen: &Sixteen, shaded: &mut Shaded) {
        let (at, path, surface) = (sixteen.vertices[0], sixteen.paths[0], sixteen.surfaces[0]);
        let (lights, random, bsdf) = (&self.scene.lights, &path.random, bsdf(self.scene, at.phase, surface));
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
        let draw = one_draw(random, bsdf.chooses_lobe(), shaded.proposals(First), Transport::Radiance);
        shaded.roulette[0] = random.at(Dimension::ROULETTE).next_f32();
        shaded.keep_onward(First, &site.draw(&draw));
    }
}
