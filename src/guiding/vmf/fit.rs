//! The mixture of a voxel while it learns. Each chunk of samples improves the mixture that earlier ones have left, whose statistics
//! count beside it and decay from iteration to iteration.

use glam::Vec3;

use super::MOST;
use super::columns::Block;
use super::component::{Component, NUMBERS, lobes};
use super::em::{Sample, divided, refine};
use super::merge::merge;
use super::mixture::VmfMixture;
use super::split::{measure, split};

/// Samples with light after which lobes may be split or merged again.
const SETTLED: f64 = 1024.0;
/// Largest number of rounds in which the lobes of the first samples are split.
const ROUNDS: usize = 4;

/// Light that arrived at a point of a voxel.
#[derive(Debug, Clone, Copy)]
pub struct Arrived {
    /// World position of the point.
    pub point: Vec3,
    /// Unit direction that the light came from.
    pub direction: Vec3,
    /// Distance to where it started; infinite for the background.
    pub distance: f32,
    /// Value over density, on any scale.
    pub value: f64,
    /// Density that the direction was drawn with, w.r.t. solid angle.
    pub pdf: f32,
}

/// The mixture of a voxel while it learns.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedMixture {
    pivot: Vec3,
    components: Vec<Component>,
    /// Number of samples with light behind the statistics.
    count: f64,
    /// Number of samples, and the sum of their values.
    all: [f64; 2],
    /// Samples with light since lobes were last split, and merged.
    since: [f64; 2],
}

impl Default for LearnedMixture {
    fn default() -> Self {
        Self { pivot: Vec3::ZERO, components: Vec::new(), count: 0.0, all: [0.0; 2], since: [0.0; 2] }
    }
}

/// Numbers of a mixture in a file, beside those of its components.
pub const VOXEL_NUMBERS: usize = 8;

impl LearnedMixture {
    /// Number of lobes.
    pub fn len(&self) -> usize {
        self.components.len()
    }

    /// Whether no light has arrived.
    pub fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// Learns from a chunk of samples, those without light too, as seen from `pivot`; light that starts nearer than `least` to it is
    /// taken to start there.
    pub fn learn(&mut self, arrived: impl Iterator<Item = Arrived> + Clone, pivot: Vec3, least: f32) {
        self.move_to(pivot);
        let lit = |of: &Arrived| of.value > 0.0 && of.value.is_finite() && of.pdf > 0.0 && of.pdf.is_finite();
        let (mut number, mut count, mut sum) = (0usize, 0usize, 0.0);
        for of in arrived.clone() {
            number += 1;
            if lit(&of) {
                count += 1;
                sum += of.value;
            }
        }
        let unit = sum / count as f64;
        self.all[0] += number as f64;
        if count == 0 || !unit.is_finite() {
            return;
        }
        self.all[1] += sum;
        let samples: Vec<Sample> = arrived.filter(lit).map(|of| seen(&of, pivot, least, unit)).collect();
        self.improve(&samples, unit, number);
        self.count += count as f64;
    }

    fn improve(&mut self, samples: &[Sample], unit: f64, number: usize) {
        let mean = self.all[1] / self.all[0];
        let (first, count) = (self.components.is_empty(), self.count);
        if first {
            self.components = Component::even();
        }
        let all = &mut self.components;
        let mut current = refine(all, samples, count, u32::MAX);
        measure(all, samples, unit, number);
        self.since = self.since.map(|since| since + samples.len() as f64);
        let mut rounds = match first {
            true => ROUNDS,
            false => usize::from(self.since[0] >= SETTLED),
        };
        if rounds > 0 {
            self.since[0] = 0.0;
        }
        while rounds > 0 {
            let changed = split(all, mean);
            if changed == 0 {
                break;
            }
            current = refine(all, samples, count, changed);
            rounds -= 1;
            if first {
                all.iter_mut().for_each(|of| of.misfit = <_>::default());
                measure(all, samples, unit, number);
            }
        }
        for (component, sums) in all.iter_mut().zip(current) {
            component.past = component.past.with(sums);
        }
        if first || self.since[1] >= SETTLED {
            self.since[1] = 0.0;
            merge(all);
        }
        add_distances(all, samples);
    }

    /// Moves the pivot, and aims lobes from there.
    fn move_to(&mut self, pivot: Vec3) {
        if pivot != self.pivot {
            let offset = (self.pivot - pivot).as_dvec3();
            self.components.iter_mut().for_each(|component| component.moved(offset));
            self.pivot = pivot;
        }
    }

    /// Lets all samples so far count as a part of their number.
    pub fn decay(&mut self, part: f64) {
        self.components.iter_mut().for_each(|component| component.decay(part));
        self.count *= part;
        self.all = self.all.map(|sum| part * sum);
    }

    /// The mixture as it is sampled; none where no light has arrived.
    pub fn frozen(&self, of_radiance: bool) -> Option<VmfMixture> {
        VmfMixture::new(&lobes(&self.components), self.pivot, of_radiance).ok()
    }

    /// Numbers for a file: those beside the components, and each component's.
    pub fn numbers(&self) -> ([f64; VOXEL_NUMBERS], Vec<[f64; NUMBERS]>) {
        let [x, y, z] = self.pivot.to_array().map(f64::from);
        let ([number, sum], [split, merged]) = (self.all, self.since);
        ([x, y, z, self.count, number, sum, split, merged], self.components.iter().map(Component::numbers).collect())
    }

    /// The mixture of these numbers; none where they are out of range.
    pub fn from_numbers(own: &[f64; VOXEL_NUMBERS], components: &[[f64; NUMBERS]]) -> Option<Self> {
        let [x, y, z, count, number, sum, split, merged] = *own;
        let components: Option<Vec<_>> = components.iter().map(Component::from_numbers).collect();
        let components = components.filter(|all| all.len() <= MOST)?;
        let total: f64 = components.iter().map(|component| component.weight).sum();
        let sums = [count, number, sum, split, merged];
        let sound = own.iter().all(|number| number.abs() < 1e150)
            && [x, y, z].iter().all(|x| x.abs() < 1e30)
            && sums.iter().all(|sum| *sum >= 0.0)
            && (components.is_empty() || (total - 1.0).abs() < 1e-3);
        let pivot = Vec3::new(x as f32, y as f32, z as f32);
        sound.then_some(Self { pivot, components, count, all: [number, sum], since: [split, merged] })
    }
}

/// A sample as seen from the pivot (Ruppert 2020 §4.2).
fn seen(of: &Arrived, pivot: Vec3, least: f32, unit: f64) -> Sample {
    let (weight, pdf) = (of.value / unit, of.pdf);
    let to = of.point + of.direction * of.distance.max(least) - pivot;
    let distance = to.length();
    if distance.is_finite() && distance > 0.0 {
        let nearness = 1.0 / distance.max(least);
        return Sample {
            direction: to / distance,
            weight,
            pdf,
            nearness: if nearness.is_finite() { nearness } else { 0.0 },
        };
    }
    Sample { direction: of.direction, weight, pdf, nearness: 0.0 }
}

/// Adds the inverse distances of samples to those of the lobes, weighted by how likely they are the lobe's: their mean is the inverse of
/// the harmonic mean of distances (Ruppert 2020 eq. 13).
fn add_distances(all: &mut [Component], samples: &[Sample]) {
    let blocks = Block::of(&lobes(all));
    let mut parts: Vec<(usize, f64)> = Vec::with_capacity(MOST);
    for sample in samples {
        parts.clear();
        let Some(density) = divided(&blocks, sample.direction, |k, part| parts.push((k, part))) else { continue };
        for &(k, part) in &parts {
            let weight = sample.weight * part * (part * density / all[k].weight.max(1e-12));
            let [near, sum] = &mut all[k].nearness;
            *near += weight * f64::from(sample.nearness);
            *sum += weight;
        }
    }
}
