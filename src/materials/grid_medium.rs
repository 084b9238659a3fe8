//! Participating media that vary in space: free flights by delta tracking, transmittance by residual ratio tracking.

use std::sync::Arc;

use glam::{Affine3A, Vec3};

use super::grid::Grid;
use super::majorants::{Majorants, Span, Tentative};
use super::medium::{Flight, shares};
use super::phase::HenyeyGreenstein;
use crate::base::random::Random;
use crate::geometry::Ray;
use crate::math::lanes::functions::exp;

/// Tentative collisions of a flight or a shadow ray before it is given up as dark: media of a million mean free paths need no more, and
/// damaged ones must end.
const MOST_COLLISIONS: u32 = 1 << 16;
/// What is left of light below which roulette decides about the rest.
const FAINT: f32 = 0.1;
/// Optical depth beyond which nothing is left in single precision.
const OPAQUE: f32 = 104.0;

/// A quantity on a grid of its own, or the same everywhere.
#[derive(Debug, Clone)]
pub struct Varying {
    /// Factor on what the grid says.
    pub factor: Vec3,
    /// The grid, and the transform from the world to its unit cube; beyond it goes on with what is at its sides.
    pub grid: Option<(Affine3A, Arc<Grid>)>,
}

impl Varying {
    /// The value at a point of the world.
    pub(super) fn at(&self, point: Vec3) -> Vec3 {
        match &self.grid {
            None => self.factor,
            Some((to_grid, grid)) => self.factor * grid.at(to_grid.transform_point3(point)),
        }
    }
}

/// A medium whose density is on a grid. Beyond the grid there is nothing.
#[derive(Debug, Clone)]
pub struct GridMedium {
    pub(super) to_grid: Affine3A,
    pub(super) density: Arc<Grid>,
    /// Extinction coefficient σ_t per channel where the density is 1, 1 / scene unit.
    pub(super) extinction: Vec3,
    pub(super) albedo: Varying,
    /// Radiance L_e; what a length emits is σ_a·L_e.
    pub(super) emission: Option<Varying>,
    phase: HenyeyGreenstein,
    majorants: Majorants,
    /// Whether no channel scatters anywhere.
    pub(super) is_black: bool,
}

/// The end of a flight, and what it brings of the medium's own light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// Where it ends.
    pub end: Flight,
    /// Estimate of ∫ T·σ_a·L_e along the way, radiance.
    pub glow: Vec3,
    /// Density of that end, 1 / scene unit, or its probability, where it is told; otherwise 1.
    pub density: f32,
}

impl From<Flight> for Flown {
    /// Without light, and without a density that is told.
    fn from(end: Flight) -> Self {
        Self { end, glow: Vec3::ZERO, density: 1.0 }
    }
}

impl Flown {
    /// The same with `factor` times the weights.
    pub(super) fn times(self, factor: f32) -> Self {
        Self { end: self.end.times(factor), glow: self.glow * factor, ..self }
    }
}

impl GridMedium {
    /// A medium with the extinction `extinction` times the density, which `to_grid` takes from the world to its unit cube.
    pub fn new(
        (to_grid, density): (Affine3A, Arc<Grid>),
        extinction: Vec3,
        albedo: Varying,
        emission: Option<Varying>,
        phase: HenyeyGreenstein,
    ) -> Self {
        let majorants = Majorants::new(&density, extinction);
        let is_black = albedo.factor == Vec3::ZERO;
        Self { to_grid, density, extinction, albedo, emission, phase, majorants, is_black }
    }

    /// Phase function: the directions of scattered light.
    pub fn phase(&self) -> HenyeyGreenstein {
        self.phase
    }

    /// Whether it has light of its own.
    pub fn glows(&self) -> bool {
        self.emission.is_some()
    }

    /// Density at a point of the world, per channel.
    pub(super) fn density(&self, point: Vec3) -> Vec3 {
        self.density.at(self.to_grid.transform_point3(point))
    }

    /// Samples the flight of a ray of length `limit` that carries `carried`, by delta tracking with the majorants of coarse cells: a
    /// tentative collision is one with the medium with the probability of its extinction over the majorant. Channels of which less is
    /// left are less asked (Wilkie et al. 2014, Kutz et al. 2017, "history-aware"): the mean of what is carried never grows. Of a medium
    /// that scatters nothing every collision dims. Its own light is added at every tentative collision, whichever it becomes.
    pub fn fly(&self, ray: &Ray, limit: f32, carried: Vec3, random: &mut Random) -> Flown {
        let (mut weight, mut glow) = (Vec3::ONE, Vec3::ZERO);
        let (mut left, [mut choice, u]) = (MOST_COLLISIONS, random.next_2d());
        let mut tentative = Tentative::new(u);
        for Span { from, to, bound } in self.majorants.along(ray, &self.to_grid, limit) {
            let mut at = from;
            while let Some(distance) = tentative.next(at, to, bound.most) {
                at = distance;
                let point = ray.at(at);
                let hit = (self.extinction * self.density(point) / bound.most).min(Vec3::ONE);
                // Nothing else needs the albedo, so that it is not looked up at other tentative collisions.
                let albedo = || self.albedo.at(point);
                if let Some(emission) = &self.emission {
                    glow += weight * hit * (Vec3::ONE - albedo()) * emission.at(point);
                }
                let real = if self.is_black { 0.0 } else { (shares(carried * weight) * hit).element_sum() };
                if choice < real {
                    let end = Flight::Collision { distance, weight: weight * hit * albedo() / real };
                    return Flown { end, glow, density: 1.0 };
                }
                weight *= (Vec3::ONE - hit) / (1.0 - real);
                if !survives(&mut weight, random) || left == 0 {
                    return Flown { end: Flight::Through { weight: Vec3::ZERO }, glow, density: 1.0 };
                }
                left -= 1;
                let [next, u] = random.next_2d();
                (choice, tentative) = (next, Tentative::new(u));
            }
        }
        Flown { end: Flight::Through { weight }, glow, density: 1.0 }
    }

    /// Estimate of the transmittance along the first `length` of a ray, per channel, by residual ratio tracking (Novák et al. 2014, §4):
    /// the density that is everywhere in a coarse cell dims by Beer and Lambert's law, and each tentative collision with the rest by
    /// what it leaves.
    pub fn transmittance(&self, ray: &Ray, length: f32, random: &mut Random) -> Vec3 {
        let (mut through, mut thickness, mut left) = (Vec3::ONE, 0.0, MOST_COLLISIONS);
        let least = self.extinction.min_element();
        let mut tentative = Tentative::new(random.next_f32());
        for Span { from, to, bound } in self.majorants.along(ray, &self.to_grid, length) {
            thickness += bound.least * (to - from);
            if least * thickness > OPAQUE {
                return Vec3::ZERO;
            }
            let mut at = from;
            while let Some(distance) = tentative.next(at, to, bound.rest) {
                at = distance;
                let rest = self.extinction * (self.density(ray.at(at)) - bound.least) / bound.rest;
                through *= Vec3::ONE - rest.clamp(Vec3::ZERO, Vec3::ONE);
                if !survives(&mut through, random) || left == 0 {
                    return Vec3::ZERO;
                }
                left -= 1;
                tentative = Tentative::new(random.next_f32());
            }
        }
        through * (-self.extinction * thickness).map(exp)
    }
}

/// Roulette about light of which little is left; what survives makes up for what does not.
fn survives(weight: &mut Vec3, random: &mut Random) -> bool {
    let most = weight.max_element();
    if most >= FAINT {
        return true;
    }
    let survival = most / FAINT;
    if random.next_f32() < survival {
        *weight /= survival;
        return true;
    }
    false
}
