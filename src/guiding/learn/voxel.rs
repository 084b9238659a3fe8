//! A voxel while it learns: its guide, and the statistics by which samples judge that, whatever model it is of.

use super::LEARNING_FRACTION;
use super::adam::Adam;
use super::adjoint::Adjoint;
use super::fraction::{Found, FractionRule};
use super::sphere::{self, Arrival};
use crate::guiding::cache::Bounds;
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::model::Directions;
use crate::guiding::moments::{FRACTIONS, Moments};
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::samples::Spheres;
use crate::guiding::target::Learned;

/// A voxel while it learns.
#[derive(Debug, Clone)]
pub(super) struct Voxel {
    /// Spheres that directions refer to.
    pub spheres: Spheres,
    /// Whether the current pass has brought samples to it.
    pub begun: bool,
    /// Path samples of this iteration in each eighth of the voxel, bit `axis` of its number being set in the upper half.
    pub eighths: [u32; 8],
    /// Number of photons of this iteration, their power, and whether any had some.
    pub photons: u32,
    pub power: f64,
    pub lit: bool,
    /// Distribution from the last iteration with energy.
    pub guide: Option<Directions>,
    /// Fraction of BSDF samples once learning is over, and whether path samples or photons have shown enough to judge the guide.
    pub bsdf_fraction: f32,
    pub told: bool,
    /// Fraction of BSDF samples with which this iteration draws.
    pub drawn_fraction: f32,
    /// Index of the fraction that this iteration has shown to be best, its surroundings included; none where that is not known.
    pub best: Option<usize>,
    /// Sum of the samples' weights in the picture, of their contributions to it, their squares, and the sum of the squares with
    /// light sampling.
    pub importance: f64,
    pub contribution: f64,
    pub squares: Moments<1>,
    pub all_squares: f64,
    /// Second moments under other fractions of BSDF samples.
    pub fractions: Moments<{ FRACTIONS.len() }>,
    pub adam: Adam,
    /// Light that both strategies have found in all iterations, where the fraction goes by it.
    pub found: Found,
    /// Radiance that its vertices sent back, and that of the last iteration with the surroundings as a prior.
    pub adjoint: Adjoint,
    pub known_adjoint: Adjoint,
    /// See [`Evidence`](crate::guiding::sample::field::Evidence).
    pub gain: f32,
}

impl Default for Voxel {
    fn default() -> Self {
        Self {
            spheres: Spheres::default(),
            begun: false,
            eighths: [0; 8],
            photons: 0,
            power: 0.0,
            lit: false,
            guide: None,
            bsdf_fraction: LEARNING_FRACTION as f32,
            told: false,
            drawn_fraction: LEARNING_FRACTION as f32,
            best: None,
            importance: 0.0,
            contribution: 0.0,
            squares: Moments::default(),
            all_squares: 0.0,
            fractions: Moments::default(),
            adam: Adam::default(),
            found: Found::default(),
            adjoint: Adjoint::default(),
            known_adjoint: Adjoint::default(),
            gain: f32::NAN,
        }
    }
}

impl Voxel {
    /// Adds a path sample to the statistics of the guide that drew it.
    pub fn judge(&mut self, record: &PathRecord, rule: FractionRule) {
        let brought = f64::from(record.importance) * f64::from(record.estimate());
        self.importance += f64::from(record.importance);
        self.contribution += brought;
        let [onward, all] = record.squares();
        self.squares.add([onward]);
        self.all_squares += all;
        self.adjoint.add([record.direct, record.estimate()].map(f64::from));
        if self.guide.is_some() {
            let drawn = f64::from(self.drawn_fraction);
            self.fractions.add_estimates(&record.estimates(), drawn);
            let (estimate, share) = (f64::from(record.estimate()), f64::from(record.bsdf_share));
            match rule {
                FractionRule::Adam if record.is_directed() => self.adam.step(estimate, share, drawn),
                FractionRule::Found if record.is_directed() => self.found.add(estimate, share, drawn),
                _ => {}
            }
        }
    }

    /// Counts samples that are learned from.
    pub fn count<'a>(
        &mut self,
        bounds: &Bounds,
        paths: impl Iterator<Item = &'a PathRecord>,
        photons: impl Iterator<Item = &'a PhotonRecord>,
    ) {
        let middle = 0.5 * (bounds.low + bounds.high);
        for record in paths {
            self.eighths[record.point.cmpge(middle).bitmask() as usize] += 1;
        }
        for record in photons {
            self.photons += 1;
            self.power += f64::from(record.power);
            self.lit |= record.power > 0.0;
        }
    }

    /// Fits the sphere to the places where the light of these samples starts; path samples have the weight `path_share`, photons
    /// the rest. Where the last guide was dense, an error of direction costs most: its narrow peaks decide.
    pub fn fitted_sphere<'a>(
        &self,
        bounds: &Bounds,
        learned: Learned,
        path_share: f64,
        paths: impl Iterator<Item = &'a PathRecord>,
        photons: impl Iterator<Item = &'a PhotonRecord>,
    ) -> Parallax {
        // Most paths find nothing, and are read once.
        let mut arrivals: Vec<Arrival> = Vec::new();
        let paths = paths.map(|r| Arrival::of_path(r, learned.value(r)));
        arrivals.extend(paths.filter(Arrival::brings_light));
        let by_paths = arrivals.len();
        arrivals.extend(photons.map(|r| Arrival::of_photon(r, r.power)).filter(Arrival::brings_light));
        let (paths, photons) = arrivals.split_at_mut(by_paths);
        for (of, share) in [(paths, path_share as f32), (photons, 1.0 - path_share as f32)] {
            let total: f32 = of.iter().map(|arrival| arrival.weight).sum();
            of.iter_mut().for_each(|arrival| arrival.weight = share * arrival.weight / total);
        }
        sphere::fitted(bounds, &arrivals, |point, direction| {
            self.guide.as_ref().map_or(1.0, |guide| {
                let seen = self.spheres.guide.to_centre(point, direction);
                guide.pdf(seen.direction) * seen.density
            })
        })
    }

    /// The fraction of BSDF samples by `rule` and what was measured; none where that is too little.
    pub fn chosen_fraction(&self, rule: FractionRule) -> Option<f32> {
        let chosen = match rule {
            FractionRule::Half => Some(LEARNING_FRACTION),
            FractionRule::Moments => self.best.map(|best| FRACTIONS[best]),
            FractionRule::Adam => Some(self.adam.fraction()),
            FractionRule::Found => self.found.fraction(),
        };
        chosen.map(|fraction| fraction as f32)
    }

    /// Copy for one half of the voxel along `axis`, the lower (0) or the upper (1), with the path samples of that half.
    pub fn half(&self, axis: u32, half: usize) -> Self {
        let mut part = self.clone();
        let others = part.eighths.iter_mut().enumerate().filter(|(eighth, _)| (eighth >> axis) & 1 != half);
        others.for_each(|(_, samples)| *samples = 0);
        part
    }

    /// Takes the path samples to lie evenly in the voxel.
    pub fn spread(&mut self) {
        let all = self.paths();
        self.eighths = std::array::from_fn(|i| (all + i as u32) / 8);
    }

    /// What the photons bring to the picture, in a unit that all voxels share: irradiance times the weight of what is seen of it. A
    /// flat surface through a voxel within `bounds` has about the area of one of its faces.
    pub fn shown_by_photons(&self, bounds: &Bounds) -> f64 {
        let area = f64::from((bounds.high - bounds.low).element_product()).powf(2.0 / 3.0);
        let shown = self.power * self.importance / area;
        if shown.is_finite() { shown } else { 0.0 }
    }

    /// Number of path samples of this iteration.
    pub fn paths(&self) -> u32 {
        self.eighths.iter().sum()
    }

    /// Adds the samples of the same voxel of another learner.
    pub fn add(&mut self, other: &Self) {
        self.begun |= other.begun;
        self.lit |= other.lit;
        self.eighths.iter_mut().zip(other.eighths).for_each(|(own, more)| *own = own.saturating_add(more));
        self.photons = self.photons.saturating_add(other.photons);
        self.power += other.power;
        self.importance += other.importance;
        self.contribution += other.contribution;
        self.squares.merge(&other.squares);
        self.all_squares += other.all_squares;
        self.fractions.merge(&other.fractions);
        self.adjoint.merge(&other.adjoint);
    }

    /// Forgets the samples of the iteration.
    pub fn clear(&mut self) {
        (self.begun, self.eighths, self.photons, self.power, self.lit) = (false, [0; 8], 0, 0.0, false);
        (self.importance, self.contribution) = (0.0, 0.0);
        (self.squares, self.all_squares) = (Moments::default(), 0.0);
        (self.fractions, self.adjoint) = (Moments::default(), Adjoint::default());
    }
}
