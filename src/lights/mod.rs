//! Light sources: the light that arrives from them at a point, and the emission of photons.

pub mod area;
pub mod bounds;
pub mod counted;
mod cut;
pub mod distant;
pub mod envmap;
mod glow;
mod lanes;
pub mod learned;
pub mod places;
pub mod point;
pub mod projector;
pub mod seen;
pub mod sky;
pub mod sun;
#[cfg(test)]
mod tests;
pub mod tree;
pub mod tried;

use glam::Vec3;

use crate::base::random::{Dimension, Random};
use crate::geometry::Ray;
use crate::math::channel_mean;
use crate::math::lanes::{Bits, Mask, Real, V3};
use crate::sampling::discrete::Discrete;
use area::AreaLight;
use bounds::LightBounds;
use distant::{Constant, Directional};
use envmap::Envmap;
pub use lanes::LightSamples;
use places::Odds;
use point::{Point, Spot};
use projector::Projector;
use seen::LightView;
use sun::Sun;
use tree::LightTree;

/// A direction towards a light.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Unit direction from the receiver to the light.
    pub wi: Vec3,
    /// Distance; infinite for a light at infinity.
    pub distance: f32,
    /// Radiance from there, unoccluded (W·m⁻²·sr⁻¹); for a delta light radiance times solid angle (W·m⁻²).
    pub radiance: Vec3,
    /// Density w.r.t. solid angle; 1 for a delta light.
    pub pdf: f32,
    /// Whether no ray can hit this light.
    pub delta: bool,
}

/// The start of a light path.
#[derive(Debug, Clone, Copy)]
pub struct Emission {
    /// The first ray.
    pub ray: Ray,
    /// Emitted power over the density of this ray, W.
    pub power: Vec3,
    /// Unit normal of the emitting surface; the direction of the ray where there is none.
    pub normal: Vec3,
}

/// The sphere around a scene, which light from infinity has to cover.
#[derive(Debug, Clone, Copy)]
pub struct BoundingSphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, positive.
    pub radius: f32,
}

/// A light source.
#[derive(Debug, Clone)]
pub enum Light {
    /// An emitting surface.
    Area(AreaLight),
    /// A point that emits in all directions.
    Point(Point),
    /// A point that emits into a cone.
    Spot(Spot),
    /// A point that projects a picture.
    Projector(Box<Projector>),
    /// Parallel light.
    Directional(Directional),
    /// A disk of light infinitely far away.
    Sun(Sun),
    /// The same radiance from everywhere.
    Constant(Constant),
    /// A picture around the scene.
    Envmap(Envmap),
}

impl Light {
    /// Samples the light as seen from `point`.
    #[inline(always)]
    pub fn sample(&self, point: Vec3, u: [f32; 2], sky: &LightView) -> Option<LightSample> {
        match self {
            Self::Area(light) => light.sample(point, u),
            Self::Point(light) => point::sample_points(|_| light, point.into()).one(),
            Self::Spot(light) => point::sample_spots(|_| light, point.into()).one(),
            Self::Projector(light) => projector::sample_projectors(|_| light, point.into()).one(),
            _ => self.sample_distant(u, sky).one(),
        }
    }

    /// Samples a light that has no position, in lanes.
    #[inline(always)]
    fn sample_distant<R: Real>(&self, u: [R; 2], sky: &LightView) -> LightSamples<R> {
        match self {
            Self::Directional(light) => light.samples(u[0]),
            Self::Sun(light) => {
                let (radiance, pdf) = light.disk(u[0]);
                LightSamples::distant(light.directions(u), radiance, pdf)
            }
            Self::Constant(light) => {
                let wi = Constant::directions(u);
                let (radiance, pdf) = light.seen(wi);
                LightSamples::distant(wi, radiance, pdf)
            }
            Self::Envmap(light) => light.samples(u, sky),
            Self::Area(_) | Self::Point(_) | Self::Spot(_) | Self::Projector(_) => LightSamples::none(u[0]),
        }
    }

    /// Directions to the light, which is around the scene.
    #[inline(always)]
    fn directions<R: Real>(&self, u: [R; 2], sky: &LightView) -> V3<R> {
        match self {
            Self::Sun(light) => light.directions(u),
            Self::Envmap(light) => light.directions(u, sky),
            _ => Constant::directions(u),
        }
    }

    /// Whether a ray can reach the light, so that BSDF sampling or guiding can find it.
    pub fn is_reachable(&self) -> bool {
        self.is_around() || matches!(self, Self::Area(_)) && !self.is_unseen()
    }

    /// Whether the light is a surface that no ray meets.
    fn is_unseen(&self) -> bool {
        matches!(self, Self::Area(light) if light.is_unseen())
    }

    /// Whether the light has no position.
    pub fn is_at_infinity(&self) -> bool {
        matches!(self, Self::Directional(_) | Self::Sun(_) | Self::Constant(_) | Self::Envmap(_))
    }

    /// Whether rays that leave the scene may hit it.
    fn is_around(&self) -> bool {
        matches!(self, Self::Sun(_) | Self::Constant(_) | Self::Envmap(_))
    }

    /// Radiance from infinitely far away in direction `wi`, zero for lights that are not there.
    pub fn background(&self, wi: Vec3) -> Vec3 {
        self.seen(V3::from(wi), &LightView::PLAIN).0.into()
    }

    /// Density with which [`Light::sample`] chooses the background direction `wi`, w.r.t. solid angle.
    pub fn background_pdf(&self, wi: Vec3) -> f32 {
        self.seen(V3::from(wi), &LightView::PLAIN).1
    }

    /// [`Light::background`] and [`Light::background_pdf`] in lanes.
    #[inline(always)]
    fn seen<R: Real>(&self, wi: V3<R>, sky: &LightView) -> (V3<R>, R) {
        match self {
            Self::Constant(light) => light.seen(wi),
            Self::Envmap(light) => light.seen(wi, sky),
            Self::Sun(light) => light.seen(wi),
            _ => (V3::splat(wi.x.all(0.0)), wi.x.all(0.0)),
        }
    }

    /// Samples the start of a light path.
    pub fn emit(&self, bounds: &BoundingSphere, u: [f32; 2], v: [f32; 2]) -> Option<Emission> {
        match self {
            Self::Area(light) => light.emit(u, v),
            Self::Point(light) => Some(light.emit(u)),
            Self::Spot(light) => Some(light.emit(u)),
            Self::Projector(light) => light.emit(u),
            Self::Directional(light) => Some(light.emit(bounds, u)),
            Self::Sun(light) => Some(light.emit(bounds, u, v)),
            Self::Constant(light) => Some(light.emit(bounds, u, v)),
            Self::Envmap(light) => light.emit(bounds, u, v),
        }
    }

    /// Bounds of the light's position and directions; none for lights at infinity.
    fn bounds(&self) -> Option<LightBounds> {
        match self {
            Self::Area(light) => Some(light.bounds()),
            Self::Point(light) => Some(light.bounds()),
            Self::Spot(light) => Some(light.bounds()),
            Self::Projector(light) => Some(light.bounds()),
            Self::Directional(_) | Self::Sun(_) | Self::Constant(_) | Self::Envmap(_) => None,
        }
    }

    /// Emitted power per channel, W; for lights at infinity the power that enters the bounding sphere.
    pub fn power(&self, bounds: &BoundingSphere) -> Vec3 {
        match self {
            Self::Area(light) => light.power(),
            Self::Point(light) => light.power(),
            Self::Spot(light) => light.power(),
            Self::Projector(light) => light.power(),
            Self::Directional(light) => light.power(bounds),
            Self::Sun(light) => light.power(bounds),
            Self::Constant(light) => light.power(bounds),
            Self::Envmap(light) => light.power(bounds),
        }
    }
}

/// The lights of a scene with the probabilities of choosing each.
#[derive(Debug, Clone, Default)]
pub struct LightSet {
    /// All lights.
    pub lights: Vec<Light>,
    /// Probabilities for connections: half uniform, half by power. Lights with a place have 0: the tree divides their sum.
    selection: Discrete,
    /// Total probability of the lights with a place.
    placed: f32,
    tree: LightTree,
    /// Whether there are surfaces that shine and that no ray meets.
    has_unseen: bool,
    /// Indices of the lights at infinity that rays can hit, and the probabilities of choosing each among those without a place.
    around: Vec<(u32, f32)>,
    /// Probabilities for photons: half evenly over all lights that shine, half by power, since a sky over a large ground has a
    /// million times the power of the lamp in the room that is looked at.
    pub emission: Discrete,
}

impl LightSet {
    /// Chooses probabilities for `lights` in a scene within `bounds`.
    pub fn new(lights: Vec<Light>, bounds: &BoundingSphere) -> Self {
        let power: Vec<f64> = lights.iter().map(|l| f64::from(channel_mean(l.power(bounds)))).collect();
        // A power that overflows single precision counts as 0: the light keeps the uniform part.
        let finite = |p: &f64| if p.is_finite() { *p } else { 0.0 };
        let power: Vec<f64> = power.iter().map(finite).collect();
        let total: f64 = power.iter().sum();
        let uniform = 1.0 / lights.len().max(1) as f64;
        let weight = |p: f64| 0.5 * uniform + if total > 0.0 { 0.5 * p / total } else { 0.0 };
        let bounds: Vec<Option<LightBounds>> = lights.iter().map(Light::bounds).collect();
        // Lights with a place come before the others in [0, 1), whatever their order in the scene.
        let mut distant = power.clone();
        let mut placed = 0.0;
        for (weighted, bounds) in distant.iter_mut().zip(&bounds) {
            *weighted = weight(*weighted);
            if bounds.is_some() {
                placed += std::mem::take(weighted);
            }
        }
        let placed = if distant.iter().all(|weight| *weight == 0.0) { 1.0 } else { placed as f32 };
        let selection = Discrete::new(distant);
        let around = lights.iter().enumerate().filter(|(_, light)| light.is_around());
        Self {
            placed,
            around: around.map(|(index, _)| (index as u32, selection.probability(index) as f32)).collect(),
            selection,
            tree: LightTree::new(&bounds),
            has_unseen: lights.iter().any(Light::is_unseen),
            emission: Discrete::new(power.iter().map(|&p| if p > 0.0 { weight(p) } else { 0.0 })),
            lights,
        }
    }

    /// Whether there is a light to choose among others.
    pub fn has_choice(&self) -> bool {
        self.lights.len() > 1
    }

    /// Random number for [`LightSet::choose`]; 0 where there is nothing to choose.
    #[inline(always)]
    pub fn choice(&self, random: &Random) -> f64 {
        if self.has_choice() { random.at(Dimension::LIGHT).next_f64() } else { 0.0 }
    }

    /// Whether there are lights with a place to choose among.
    pub fn has_places(&self) -> bool {
        self.tree.has_choice()
    }

    /// Chooses a light for `point`, with learned `odds` where there are any; returns its index and the probability of the choice.
    pub fn choose(&self, point: Vec3, choice: f64, odds: Option<&Odds>) -> Option<(usize, f32)> {
        let placed = f64::from(self.placed);
        if choice < placed {
            let (index, probability) = self.tree.sample(point, choice / placed, odds)?;
            return Some((index, self.placed * probability));
        }
        let (index, _) = self.selection.sample((choice - placed) / (1.0 - placed));
        Some((index, (1.0 - self.placed) * self.selection.probability(index) as f32))
    }

    /// The probability with which [`LightSet::choose`] chooses light `index` for `point`.
    pub fn probability(&self, point: Vec3, index: usize, odds: Option<&Odds>) -> f32 {
        if self.lights[index].is_at_infinity() {
            (1.0 - self.placed) * self.selection.probability(index) as f32
        } else {
            self.placed * self.tree.probability(point, index, odds)
        }
    }

    /// The environment map, where there is one: its tables are in no cache, so those who sample it many times ask for them first.
    pub fn map(&self) -> Option<&Envmap> {
        self.around.iter().find_map(|&(index, _)| match &self.lights[index as usize] {
            Light::Envmap(map) => Some(map),
            _ => None,
        })
    }

    /// The environment map of a scene that has one alone.
    pub fn only_map(&self) -> Option<&Envmap> {
        let is_map = |light: &&Light| matches!(light, Light::Envmap(_));
        self.map().filter(|_| self.lights.iter().filter(is_map).count() == 1)
    }

    /// Probability that a direction which was chosen for a light around the scene was chosen for the environment map, by its power.
    pub fn map_share(&self, wi: Vec3) -> f32 {
        let density = |map: bool| -> f32 {
            let lights = self.around.iter().map(|&(index, probability)| (&self.lights[index as usize], probability));
            let wanted = lights.filter(|(light, _)| !map || matches!(light, Light::Envmap(_)));
            wanted.map(|(light, probability)| light.seen::<f32>(wi.into(), &LightView::PLAIN).1 * probability).sum()
        };
        let all = density(false);
        if all > 0.0 { density(true) / all } else { 0.0 }
    }

    /// Samples a chosen light; the density includes the choice. Lights at infinity that rays can hit are sampled together.
    pub fn sample(&self, point: Vec3, choice: f64, u: [f32; 2], sky: &LightView) -> Option<LightSample> {
        if self.lights.is_empty() {
            return None;
        }
        let (index, probability) = self.choose(point, choice, sky.odds.map(|odds| odds[0]))?;
        let light = &self.lights[index];
        if self.together(light) {
            return self.sample_around(light.directions(u, sky), index as i32, sky).one();
        }
        let sample = light.sample(point, u, sky)?;
        Some(LightSample { pdf: sample.pdf * probability, ..sample })
    }

    /// Whether the light is sampled together with others.
    #[inline(always)]
    fn together(&self, light: &Light) -> bool {
        self.around.len() > 1 && light.is_around()
    }

    /// Samples of all lights around the scene, in directions that were chosen for one of them. A ray that leaves the scene meets all of
    /// them at once, so a sample of one is one of their sum.
    #[inline(always)]
    fn sample_around<R: Real>(&self, wi: V3<R>, chosen: R::Bits, sky: &LightView) -> LightSamples<R> {
        let (radiance, pdf, own) = self.background_and_own(wi, chosen, sky);
        LightSamples { found: pdf.above(0.0) & own.above(0.0), ..LightSamples::distant(wi, radiance, pdf) }
    }

    /// Radiance of all background lights in direction `wi`, and the density with which [`LightSet::sample`] chooses it.
    #[inline]
    pub fn background(&self, wi: Vec3, sky: &LightView) -> (Vec3, f32) {
        let (radiance, pdf) = self.background_lanes(V3::from(wi), sky);
        (radiance.into(), pdf)
    }

    /// Whether anything shines there.
    #[inline(always)]
    pub fn has_background(&self) -> bool {
        !self.around.is_empty()
    }

    /// [`LightSet::background`] in lanes.
    #[inline(always)]
    pub fn background_lanes<R: Real>(&self, wi: V3<R>, sky: &LightView) -> (V3<R>, R) {
        let none = wi.x.bits();
        let (radiance, pdf, _) = self.background_and_own(wi, none.all(-1), sky);
        (radiance, pdf)
    }

    /// [`LightSet::background`], and the density with which each lane's `chosen` light alone has its direction.
    #[inline(always)]
    fn background_and_own<R: Real>(&self, wi: V3<R>, chosen: R::Bits, sky: &LightView) -> (V3<R>, R, R) {
        let zero = wi.x.all(0.0);
        let (mut sum, mut density, mut own) = (V3::splat(zero), zero, zero);
        for &(index, probability) in &self.around {
            let (radiance, pdf) = self.lights[index as usize].seen(wi, sky);
            sum = sum + radiance;
            density = density + pdf * (1.0 - self.placed) * probability;
            own = chosen.same(chosen.all(index as i32)).choose(pdf, own);
        }
        (sum, density, own)
    }
}
