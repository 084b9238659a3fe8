//! Lights as seen from sixteen points at once. Each kind of light that occurs is sampled in all lanes, by the formulas of one lane.

use super::area::{self, AreaLight};
use super::places::Odds;
use super::point::{self, Point, Spot};
use super::projector::{self, Projector};
use super::seen::LightView;
use super::{Light, LightSample, LightSet};
use crate::math::lanes::{Bits, LANES, Mask, Real, V3, Wide};

/// Directions towards lights in lanes, see [`LightSample`].
#[derive(Debug, Clone, Copy)]
pub struct LightSamples<R: Real> {
    /// Unit directions.
    pub wi: V3<R>,
    /// Distances.
    pub distance: R,
    /// Radiance from there.
    pub radiance: V3<R>,
    /// Densities w.r.t. solid angle.
    pub pdf: R,
    /// Which lights no ray can hit.
    pub delta: R::Mask,
    /// Where there is a direction; elsewhere the others mean nothing and may be NaN.
    pub found: R::Mask,
}

impl<R: Real> LightSamples<R> {
    /// Towards lights infinitely far away.
    #[inline(always)]
    pub(super) fn distant(wi: V3<R>, radiance: V3<R>, pdf: R) -> Self {
        let distance = pdf.all(f32::INFINITY);
        Self { wi, distance, radiance, pdf, delta: distance.lt(distance), found: distance.same(distance) }
    }

    /// None, in lanes of what is `like` that.
    #[inline(always)]
    pub(super) fn none(like: R) -> Self {
        let zero = like.all(0.0);
        let never = zero.lt(zero);
        Self { found: never, ..Self::distant(V3::splat(zero), V3::splat(zero), zero) }
    }

    #[inline(always)]
    fn choose(mask: R::Mask, yes: Self, no: Self) -> Self {
        Self {
            wi: V3::choose(mask, yes.wi, no.wi),
            distance: mask.choose(yes.distance, no.distance),
            radiance: V3::choose(mask, yes.radiance, no.radiance),
            pdf: mask.choose(yes.pdf, no.pdf),
            delta: mask & yes.delta | !mask & no.delta,
            found: mask & yes.found | !mask & no.found,
        }
    }
}

impl From<LightSample> for LightSamples<f32> {
    #[inline(always)]
    fn from(sample: LightSample) -> Self {
        let LightSample { wi, distance, radiance, pdf, delta } = sample;
        Self { wi: wi.into(), distance, radiance: radiance.into(), pdf, delta, found: true }
    }
}

impl LightSamples<f32> {
    /// The sample; none where nothing was found.
    #[inline(always)]
    pub(super) fn one(self) -> Option<LightSample> {
        let Self { wi, distance, radiance, pdf, delta, found } = self;
        found.then_some(LightSample { wi: wi.into(), distance, radiance: radiance.into(), pdf, delta })
    }
}

/// What differs in its sampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Nothing,
    Mesh,
    Sphere,
    Point,
    Spot,
    Distant,
    Projector,
}

impl Kind {
    #[inline(always)]
    fn of(light: &Light) -> Self {
        match light {
            Light::Area(light) if light.is_sphere() => Self::Sphere,
            Light::Area(_) => Self::Mesh,
            Light::Point(_) => Self::Point,
            Light::Spot(_) => Self::Spot,
            Light::Projector(_) => Self::Projector,
            Light::Directional(_) | Light::Sun(_) | Light::Constant(_) | Light::Envmap(_) => Self::Distant,
        }
    }
}

/// The lights that lanes have chosen.
struct Chosen<'a, R: Real> {
    lights: &'a [Light],
    indices: [u32; LANES],
    kinds: [Kind; LANES],
    /// The indices and the kinds' numbers in lanes.
    lanes: [R::Bits; 2],
}

impl<'a, R: Real> Chosen<'a, R> {
    #[inline(always)]
    fn new<W: Wide<Real = R>>(wide: W, lights: &'a [Light], indices: [u32; LANES]) -> Self {
        let mut kinds = [Kind::Nothing; LANES];
        let mut numbers = [[0; LANES]; 2];
        for lane in 0..LANES {
            kinds[lane] = lights.get(indices[lane] as usize).map_or(Kind::Nothing, Kind::of);
            [numbers[0][lane], numbers[1][lane]] = [indices[lane].cast_signed(), kinds[lane] as i32];
        }
        let [indices_in_lanes, kinds_in_lanes] = [wide.load_bits(&numbers[0]), wide.load_bits(&numbers[1])];
        Self { lights, indices, kinds, lanes: [indices_in_lanes, kinds_in_lanes] }
    }

    /// Where lights are of a kind.
    #[inline(always)]
    fn are(&self, kind: Kind) -> R::Mask {
        self.lanes[1].same(self.lanes[1].all(kind as i32))
    }

    /// Where the light is the one of an index.
    #[inline(always)]
    fn is(&self, index: u32) -> R::Mask {
        self.lanes[0].same(self.lanes[0].all(index.cast_signed()))
    }

    /// Where no ray meets the surfaces that shine.
    #[inline(always)]
    fn unseen<W: Wide<Real = R>>(&self, wide: W) -> R::Mask {
        let mut unseen = [0.0; LANES];
        for (unseen, index) in unseen.iter_mut().zip(self.indices) {
            *unseen = f32::from(self.lights.get(index as usize).is_some_and(Light::is_unseen));
        }
        wide.load(&unseen).above(0.0)
    }

    /// Where lights are of a kind, and these lights; in other lanes the first of them. None where there are none.
    #[inline(always)]
    fn of<T>(&self, kind: Kind, pick: impl Fn(&'a Light) -> Option<&'a T>) -> Option<(R::Mask, [&'a T; LANES])> {
        let mask = self.are(kind);
        if !mask.any() {
            return None;
        }
        let light = |lane: usize| pick(&self.lights[self.indices[lane] as usize]);
        let first = light(mask.answers().trailing_zeros() as usize)?;
        let mut lights = [first; LANES];
        for (lane, chosen) in lights.iter_mut().enumerate() {
            if self.kinds[lane] == kind {
                *chosen = light(lane).unwrap_or(first);
            }
        }
        Some((mask, lights))
    }
}

impl Light {
    fn area(&self) -> Option<&AreaLight> {
        if let Self::Area(light) = self { Some(light) } else { None }
    }

    fn point(&self) -> Option<&Point> {
        if let Self::Point(light) = self { Some(light) } else { None }
    }

    fn spot(&self) -> Option<&Spot> {
        if let Self::Spot(light) = self { Some(light) } else { None }
    }

    fn projector(&self) -> Option<&Projector> {
        if let Self::Projector(light) = self { Some(light) } else { None }
    }
}

impl LightSet {
    /// [`LightSet::sample`] for sixteen points at once: the same bits in each lane where something is found.
    #[inline(always)]
    pub fn sample_lanes<W: Wide>(
        &self,
        wide: W,
        points: &V3<W::Real>,
        choices: &[f64; LANES],
        u: &[[f32; 2]; LANES],
        sky: &LightView,
    ) -> LightSamples<W::Real> {
        let u = wide.points(u);
        let (indices, probability) = self.choose_lanes(wide, points, choices, sky.odds.as_ref());
        let chosen = Chosen::new(wide, &self.lights, indices);
        let mut samples = LightSamples::none(points.x);
        if let Some((mask, lights)) = chosen.of(Kind::Mesh, Light::area) {
            let found = area::sample_meshes(|lane| lights[lane], *points, u);
            samples = LightSamples::choose(mask, found, samples);
        }
        if let Some((mask, lights)) = chosen.of(Kind::Sphere, Light::area) {
            let found = area::sample_spheres(|lane| lights[lane], *points, u);
            samples = LightSamples::choose(mask, found, samples);
        }
        if self.has_unseen {
            samples.delta = samples.delta | chosen.unseen(wide);
        }
        if let Some((mask, lights)) = chosen.of(Kind::Point, Light::point) {
            let found = point::sample_points(|lane| lights[lane], *points);
            samples = LightSamples::choose(mask, found, samples);
        }
        if let Some((mask, lights)) = chosen.of(Kind::Spot, Light::spot) {
            let found = point::sample_spots(|lane| lights[lane], *points);
            samples = LightSamples::choose(mask, found, samples);
        }
        if let Some((mask, lights)) = chosen.of(Kind::Projector, Light::projector) {
            let found = projector::sample_projectors(|lane| lights[lane], *points);
            samples = LightSamples::choose(mask, found, samples);
        }
        samples.pdf = samples.pdf * probability;
        self.add_distant(&chosen, probability, u, samples, sky)
    }

    /// Adds the samples of lights without a place.
    #[inline(always)]
    fn add_distant<R: Real>(
        &self,
        chosen: &Chosen<R>,
        probability: R,
        u: [R; 2],
        mut samples: LightSamples<R>,
        sky: &LightView,
    ) -> LightSamples<R> {
        let mut together = probability.lt(probability);
        // These lights are few: one after the other, in all lanes that have chosen it.
        let mut left = chosen.are(Kind::Distant).answers();
        while left != 0 {
            let index = chosen.indices[left.trailing_zeros() as usize];
            let (mask, light) = (chosen.is(index), &self.lights[index as usize]);
            left &= !mask.answers();
            if self.together(light) {
                samples.wi = V3::choose(mask, light.directions(u, sky), samples.wi);
                together = together | mask;
            } else {
                let mut found = light.sample_distant(u, sky);
                found.pdf = found.pdf * probability;
                samples = LightSamples::choose(mask, found, samples);
            }
        }
        if !together.any() {
            return samples;
        }
        LightSamples::choose(together, self.sample_around(samples.wi, chosen.lanes[0], sky), samples)
    }

    /// [`LightSet::choose`] for sixteen points: indices, of none where there is no light, and probabilities.
    #[inline(always)]
    fn choose_lanes<W: Wide>(
        &self,
        wide: W,
        points: &V3<W::Real>,
        choices: &[f64; LANES],
        odds: Option<&[&Odds; LANES]>,
    ) -> ([u32; LANES], W::Real) {
        let placed = f64::from(self.placed);
        let mut among_placed = [-1.0; LANES];
        for lane in 0..LANES {
            among_placed[lane] = if choices[lane] < placed { choices[lane] / placed } else { -1.0 };
        }
        let (mut indices, probability) = self.tree.sample_lanes(wide, points, among_placed, odds);
        let probability = probability * self.placed;
        if placed >= 1.0 {
            return (indices, probability);
        }
        let mut probabilities = wide.store(probability);
        for lane in 0..LANES {
            if choices[lane] >= placed && !self.lights.is_empty() {
                let (index, _) = self.selection.sample((choices[lane] - placed) / (1.0 - placed));
                indices[lane] = index as u32;
                probabilities[lane] = (1.0 - self.placed) * self.selection.probability(index) as f32;
            }
        }
        (indices, wide.load(&probabilities))
    }
}
