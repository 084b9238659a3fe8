//! Shading of paths that arrived at vertices: the light that is sampled there and the directions in which they go on, for sixteen
//! vertices of like materials at once, or for one.

use glam::Vec3;

use super::{Arrival, PathState, PathTracer};
use crate::base::random::{Dimension, Draws, Random};
use crate::geometry::{Origins, Ray, Surface};
use crate::integrators::mixture::{Proposal, one_draw};
use crate::integrators::site::{Draw, Lit, Onward, Site};
use crate::lights::{LightSamples, LightSet};
use crate::materials::{Bsdf, Transport, Variant};
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Wide};
use crate::scene::effects::Effects;

/// What a path does at a vertex, but for the densities of guides and for roulette.
pub(super) struct Shaded {
    /// Whether a light was sampled from which something comes back, unless something is in the way; the next six say nothing elsewhere.
    pub lit: bool,
    /// f·|cos θ|·L.
    pub light: Vec3,
    /// Density of light sampling w.r.t. solid angle.
    pub light_pdf: f32,
    /// Whether no ray can hit the light.
    pub light_delta: bool,
    /// The BSDF's density in the direction of the light.
    pub bsdf_pdf: f32,
    /// Unit direction to the light.
    pub to_light: Vec3,
    /// The shadow ray with its length.
    pub shadow: (Ray, f32),
    /// How the path goes on.
    pub onward: Onward<f32>,
    /// Random number of roulette.
    pub roulette: f32,
    /// The guide's proposal, if the path goes on in its direction.
    pub proposal: Option<Proposal>,
}

/// Proposals that are to be taken.
type Proposals = [Option<Proposal>; LANES];

/// Vertices that are shaded together: of one variant of BSDF, all with bumps or none.
struct Group<'g> {
    vertices: [&'g Arrival; LANES],
    surfaces: [&'g Surface; LANES],
    bsdfs: &'g [Bsdf<'g, f32>; LANES],
    /// The rays on which the paths arrived.
    rays: [&'g Ray; LANES],
    randoms: [&'g Random; LANES],
    lights: &'g LightSet,
    /// Proposals of guides that are to be taken; none where no vertex has a guide.
    proposals: Option<&'g Proposals>,
}

/// Sixteen vertices after shading, lane by lane.
#[derive(Default)]
struct ShadedLanes {
    lit: u32,
    light_delta: u32,
    any: u32,
    delta: u32,
    light: [[f32; LANES]; 3],
    light_pdf: [f32; LANES],
    bsdf_pdf: [f32; LANES],
    to_light: [[f32; LANES]; 3],
    shadow_origin: [[f32; LANES]; 3],
    shadow_direction: [[f32; LANES]; 3],
    shadow_length: [f32; LANES],
    direction: [[f32; LANES]; 3],
    value: [[f32; LANES]; 3],
    weight: [[f32; LANES]; 3],
    origin: [[f32; LANES]; 3],
    pdf: [f32; LANES],
    deltas: [f32; LANES],
    squeeze: [f32; LANES],
    roulette: [f32; LANES],
}

#[inline(always)]
fn store<W: Wide>(wide: W, v: V3<W::Real>) -> [[f32; LANES]; 3] {
    [wide.store(v.x), wide.store(v.y), wide.store(v.z)]
}

#[inline(always)]
fn vectors<W: Wide>(wide: W, of: impl Fn(usize) -> Vec3) -> V3<W::Real> {
    let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        [x[lane], y[lane], z[lane]] = of(lane).to_array();
    }
    V3::new(wide.load(&x), wide.load(&y), wide.load(&z))
}

#[inline(always)]
fn pairs<W: Wide>(wide: W, points: &[[f32; 2]; LANES]) -> [W::Real; 2] {
    let mut lanes = [[0.0; LANES]; 2];
    for (lane, point) in points.iter().enumerate() {
        [lanes[0][lane], lanes[1][lane]] = *point;
    }
    [wide.load(&lanes[0]), wide.load(&lanes[1])]
}

impl Group<'_> {
    #[inline(always)]
    fn draws(&self, dimension: Dimension) -> Draws<LANES> {
        Draws::new(&self.randoms, dimension)
    }

    #[inline(always)]
    fn lights<W: Wide>(&self, wide: W, points: &V3<W::Real>) -> LightSamples<W::Real> {
        let choices = if self.lights.has_choice() { self.draws(Dimension::LIGHT).doubles() } else { [0.0; LANES] };
        self.lights.sample_lanes(wide, points, &choices, &self.draws(Dimension::LIGHT_POINT).points())
    }

    #[inline(always)]
    fn draw<W: Wide>(&self, wide: W) -> Draw<W::Real> {
        let chooses = self.bsdfs[0].chooses_lobe();
        let lobes = if chooses { self.draws(Dimension::LOBE).numbers() } else { [0.0; LANES] };
        let guided = self.proposals.map(|proposals| {
            let mut taken = [0.0; LANES];
            for (taken, proposal) in taken.iter_mut().zip(proposals) {
                *taken = f32::from(proposal.is_some());
            }
            (wide.load(&taken).above(0.0), vectors(wide, |lane| proposals[lane].map_or(Vec3::ZERO, |of| of.direction)))
        });
        let u = pairs(wide, &self.draws(Dimension::DIRECTION).points());
        Draw { lobe: wide.load(&lobes), u, guided, transport: Transport::Radiance }
    }
}

impl Kernel for Group<'_> {
    type Output = ShadedLanes;

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> ShadedLanes {
        let (vertices, surfaces) = (&self.vertices, &self.surfaces);
        let origins = Origins {
            point: vectors(wide, |lane| surfaces[lane].point),
            error: vectors(wide, |lane| surfaces[lane].error),
            normal: vectors(wide, |lane| surfaces[lane].normal),
        };
        let normal = vectors(wide, |lane| surfaces[lane].shading);
        let (bumped, mut smooth) = (vertices[0].bumped, normal);
        if bumped {
            smooth = vectors(wide, |lane| surfaces[lane].smooth);
        }
        let out = -vectors(wide, |lane| self.rays[lane].direction);
        let mut points = [&self.bsdfs[0]; LANES];
        for (point, bsdf) in points.iter_mut().zip(self.bsdfs) {
            *point = bsdf;
        }
        let site = Site::new(origins, normal, smooth, out, Bsdf::gather(wide, points), bumped);
        let mut lanes = ShadedLanes::default();
        if vertices.iter().any(|vertex| vertex.connects) {
            let light = self.lights(wide, &origins.point);
            lanes.light(wide, &light, &site.light(&light));
        }
        lanes.onward(wide, &site.draw(&self.draw(wide)));
        lanes.roulette = self.draws(Dimension::ROULETTE).numbers();
        lanes
    }
}

impl ShadedLanes {
    #[inline(always)]
    fn light<W: Wide>(&mut self, wide: W, light: &LightSamples<W::Real>, lit: &Lit<W::Real>) {
        self.lit = lit.any.answers();
        self.light_delta = light.delta.answers();
        self.light = store(wide, lit.radiance);
        self.light_pdf = wide.store(light.pdf);
        self.bsdf_pdf = wide.store(lit.pdf);
        self.to_light = store(wide, light.wi);
        self.shadow_origin = store(wide, lit.ray.0);
        self.shadow_direction = store(wide, lit.ray.1);
        self.shadow_length = wide.store(lit.ray.2);
    }

    #[inline(always)]
    fn onward<W: Wide>(&mut self, wide: W, onward: &Onward<W::Real>) {
        self.any = onward.any.answers();
        self.delta = onward.delta.answers();
        self.direction = store(wide, onward.direction);
        self.value = store(wide, onward.value);
        self.weight = store(wide, onward.weight);
        self.origin = store(wide, onward.origin);
        self.pdf = wide.store(onward.pdf);
        self.deltas = wide.store(onward.deltas);
        self.squeeze = wide.store(onward.squeeze);
    }

    /// One lane, for which a guide proposed `proposal`.
    #[inline(always)]
    fn at(&self, lane: usize, proposal: Option<Proposal>) -> Shaded {
        let is = |answers: u32| answers >> lane & 1 == 1;
        let v = |of: &[[f32; LANES]; 3]| Vec3::new(of[0][lane], of[1][lane], of[2][lane]);
        let delta = is(self.delta);
        Shaded {
            lit: is(self.lit),
            light: v(&self.light),
            light_pdf: self.light_pdf[lane],
            light_delta: is(self.light_delta),
            bsdf_pdf: self.bsdf_pdf[lane],
            to_light: v(&self.to_light),
            shadow: (
                Ray { origin: v(&self.shadow_origin), direction: v(&self.shadow_direction) },
                self.shadow_length[lane],
            ),
            onward: Onward {
                any: is(self.any),
                direction: v(&self.direction).into(),
                value: v(&self.value).into(),
                weight: v(&self.weight).into(),
                pdf: self.pdf[lane],
                delta,
                deltas: self.deltas[lane],
                squeeze: self.squeeze[lane],
                origin: v(&self.origin).into(),
            },
            roulette: self.roulette[lane],
            proposal: proposal.filter(|_| !delta),
        }
    }
}

/// Vertices by what may be shaded together, reused from chunk to chunk.
#[derive(Default)]
pub(super) struct Groups {
    /// Indices of vertices, for each variant with and without bumps.
    alike: Vec<Vec<u32>>,
    /// Those that are shaded one by one.
    single: Vec<u32>,
}

impl Groups {
    /// Sorts vertices.
    fn sort(&mut self, vertices: &[Arrival]) {
        self.alike.resize_with(2 * Variant::COUNT, Vec::new);
        self.alike.iter_mut().for_each(Vec::clear);
        self.single.clear();
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

    /// Shades the vertices and gives the result for each to `take`, in any order.
    #[inline(always)]
    pub(super) fn shade<E: Effects>(
        &self,
        vertices: &[Arrival],
        surfaces: &[Surface],
        paths: &mut [PathState],
        groups: &mut Groups,
        mut take: impl FnMut(&mut PathState, &Arrival, &Surface, &Shaded),
    ) {
        groups.sort(vertices);
        let Groups { alike, single } = groups;
        let fewest = if lanes::available() { FEWEST } else { usize::MAX };
        for indices in alike.iter().flat_map(|alike| alike.chunks(LANES)) {
            if indices.len() < fewest {
                single.extend(indices);
                continue;
            }
            // Lanes behind the last vertex repeat the first, and are not looked at.
            let mut group = [&vertices[indices[0] as usize]; LANES];
            for (lane, index) in group.iter_mut().zip(indices) {
                *lane = &vertices[*index as usize];
            }
            let group_surfaces = group.map(|at| &surfaces[at.place as usize]);
            let Some((lanes, proposals)) = self.shade_lanes::<E>(group, group_surfaces, indices.len(), paths) else {
                single.extend(indices);
                continue;
            };
            for lane in 0..indices.len() {
                let (at, surface) = (group[lane], group_surfaces[lane]);
                let shaded = lanes.at(lane, proposals.as_ref().and_then(|proposals| proposals[lane]));
                take(&mut paths[at.path as usize], at, surface, &shaded);
            }
        }
        for index in &*single {
            let at = &vertices[*index as usize];
            let (path, surface) = (&mut paths[at.path as usize], &surfaces[at.place as usize]);
            let shaded = self.shade_one::<E>(at, surface, path);
            take(path, at, surface, &shaded);
        }
    }

    /// Shades vertices together, of which the first `count` are looked at; none where the processor has no lanes.
    #[inline(always)]
    fn shade_lanes<E: Effects>(
        &self,
        vertices: [&Arrival; LANES],
        surfaces: [&Surface; LANES],
        count: usize,
        paths: &[PathState],
    ) -> Option<(ShadedLanes, Option<Proposals>)> {
        let mut bsdfs = [self.bsdf(vertices[0], surfaces[0]); LANES];
        for lane in 1..count {
            bsdfs[lane] = self.bsdf(vertices[lane], surfaces[lane]);
        }
        let path = |lane: usize| &paths[vertices[lane].path as usize];
        let proposals = self.proposals::<E>(vertices, surfaces, count, paths);
        let group = Group {
            vertices,
            surfaces,
            bsdfs: &bsdfs,
            rays: std::array::from_fn(|lane| &path(lane).ray),
            randoms: std::array::from_fn(|lane| &path(lane).random),
            lights: &self.scene.lights,
            proposals: proposals.as_ref(),
        };
        let shaded = lanes::run(group).ok()?;
        Some((shaded, proposals))
    }

    /// Proposals of the guides at the first `count` vertices; none where there are no guides.
    #[inline(always)]
    fn proposals<E: Effects>(
        &self,
        vertices: [&Arrival; LANES],
        surfaces: [&Surface; LANES],
        count: usize,
        paths: &[PathState],
    ) -> Option<Proposals> {
        if !E::GUIDING || vertices.iter().all(|vertex| vertex.voxel.is_none()) {
            return None;
        }
        let mut proposals = [None; LANES];
        for lane in 0..count {
            let random = &paths[vertices[lane].path as usize].random;
            proposals[lane] = self.proposal(vertices[lane], surfaces[lane], random);
        }
        Some(proposals)
    }

    /// What the guide at a vertex proposes; none without a guide, or where the BSDF is chosen.
    #[inline(always)]
    fn proposal(&self, at: &Arrival, surface: &Surface, random: &Random) -> Option<Proposal> {
        Proposal::new(&self.guide(at.voxel, surface.point)?, random)
    }

    /// Shades a vertex alone: the same in one lane.
    fn shade_one<E: Effects>(&self, at: &Arrival, surface: &Surface, path: &PathState) -> Shaded {
        let (lights, random, bsdf) = (&self.scene.lights, &path.random, self.bsdf(at, surface));
        let (normal, smooth, out) = (surface.shading.into(), surface.smooth.into(), -path.ray.direction);
        let site = Site::<f32>::new(surface.origin(), normal, smooth, out.into(), bsdf, at.bumped);
        let sampled =
            || lights.sample(surface.point, lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
        let light = if at.connects { sampled() } else { None };
        let lit = light.map(|light| site.light(&light.into()));
        let proposal = if E::GUIDING { self.proposal(at, surface, random) } else { None };
        // The probability of a delta lobe is needed wherever there is a guide, whoever chooses.
        let guided = at.voxel.filter(|_| E::GUIDING).map(|_| proposal);
        let onward = site.draw(&one_draw(random, bsdf.chooses_lobe(), guided, Transport::Radiance));
        let zero = V3::from(Vec3::ZERO);
        let Lit { any, radiance, pdf, ray: (origin, direction, length) } =
            lit.unwrap_or(Lit { any: false, radiance: zero, pdf: 0.0, ray: (zero, zero, 0.0) });
        Shaded {
            lit: any,
            light: radiance.into(),
            light_pdf: light.map_or(0.0, |light| light.pdf),
            light_delta: light.is_some_and(|light| light.delta),
            bsdf_pdf: pdf,
            to_light: light.map_or(Vec3::ZERO, |light| light.wi),
            shadow: (Ray { origin: origin.into(), direction: direction.into() }, length),
            proposal: proposal.filter(|_| !onward.delta),
            onward,
            roulette: random.at(Dimension::ROULETTE).next_f32(),
        }
    }
}
