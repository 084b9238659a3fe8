//! The mixture of a voxel while it learns, by weighted stepwise expectation maximisation (Vorba 2014; Liang and Klein 2009): the i-th sample
//! changes the means of all moments by i^−α of their difference from its own, so that what was learned fades as more arrives, and a stream of samples
//! without end takes no memory.

use super::MOST;
use super::columns::Columns;
use super::component::{Component, NUMBERS};
use super::gaussian::Gaussian;
use super::mixture::GaussianMixture;

/// Exponent α of the step, in (½, 1].
const STEP: f64 = 0.7;
/// Samples after which parameters follow the moments.
const BATCH: usize = 16;
/// Largest number of times that the first samples are gone through, and the relative change of the likelihood that ends it.
const ROUNDS: usize = 10;
const CONVERGED: f64 = 1e-3;
/// Density over the square below which a sample is no Gaussian's.
const LOST: f32 = 1e-6;
/// How far apart Gaussians begin that begin at one sample.
const APART: f64 = 0.02;

/// Light from a direction.
#[derive(Debug, Clone, Copy)]
pub struct Arrived {
    /// Place of the direction on the unit square.
    pub place: [f64; 2],
    /// Value over density of a path sample, or power of a photon, on any scale of its kind.
    pub value: f64,
}

/// Numbers of a mixture in a file, beside those of its components.
pub const VOXEL_NUMBERS: usize = 7;

/// The mixture of a voxel while it learns.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LearnedMixture {
    components: Vec<Component>,
    /// Number of samples so far.
    samples: f64,
    /// Decaying means of weights and of their squares.
    weights: [f64; 2],
    /// Number and sum of the values of path samples, and of photons.
    kinds: [[f64; 2]; 2],
}

impl LearnedMixture {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.components.len()
    }

    /// Whether no light has arrived.
    pub fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// Learns from a chunk of path samples and photons, alternately. Where there are both, either kind counts by half.
    pub fn learn(&mut self, kinds: [&[Arrived]; 2]) {
        for (sums, all) in self.kinds.iter_mut().zip(kinds) {
            for of in all.iter().filter(|of| is_lit(of)) {
                *sums = [sums[0] + 1.0, sums[1] + of.value];
            }
        }
        let [[paths, light], [photons, power]] = self.kinds;
        let all = paths + photons;
        let half = if paths > 0.0 && photons > 0.0 { 0.5 } else { 1.0 };
        // So that the weights of each kind have the sum half·all.
        let factors = [half * all / light, half * all / power];
        let samples = in_turns(kinds, factors);
        if samples.is_empty() || !self.kinds.as_flattened().iter().all(|sum| sum.is_finite()) {
            return;
        }
        if !self.components.is_empty() {
            self.go_through(&samples);
            return;
        }
        self.components = first(&samples);
        let mut last = None;
        for _ in 0..ROUNDS {
            let likelihood = self.go_through(&samples);
            // Gone through again, samples are no others.
            self.samples = samples.len() as f64;
            let converged = last.is_some_and(|last: f64| (likelihood - last).abs() <= CONVERGED * last.abs());
            if converged {
                break;
            }
            last = Some(likelihood);
        }
    }

    /// One step for each sample. Returns the sum of weight times logarithm of density, as it was when each arrived.
    fn go_through(&mut self, samples: &[Arrived]) -> f64 {
        let mut likelihood = 0.0;
        for batch in samples.chunks(BATCH) {
            let columns = Columns::of(&self.gaussians());
            // A Gaussian that was moved to where none looked.
            let mut moved = None;
            for sample in batch {
                self.samples += 1.0;
                let step = self.samples.powf(-STEP);
                let (parts, density) = columns.parts(sample.place);
                self.weights = self.weights.map(|mean| (1.0 - step) * mean);
                self.weights[0] += step * sample.value;
                self.weights[1] += step * sample.value * sample.value;
                self.components.iter_mut().for_each(|of| of.fade(1.0 - step));
                if density > LOST {
                    likelihood += sample.value * f64::from(density).ln();
                    for (of, part) in self.components.iter_mut().zip(parts).filter(|(_, part)| *part > 0.0) {
                        of.add(sample.place, step * sample.value * f64::from(part / density));
                    }
                    continue;
                }
                likelihood += sample.value * f64::from(LOST).ln();
                let lightest = |of: &[Component]| (0..of.len()).min_by(|&a, &b| of[a].weight.total_cmp(&of[b].weight));
                let Some(k) = moved.or_else(|| lightest(&self.components)) else { continue };
                if moved.is_none() {
                    self.components[k].move_to(sample.place);
                    moved = Some(k);
                }
                self.components[k].add(sample.place, step * sample.value);
            }
            self.maximise();
        }
        likelihood
    }

    /// Lets parameters follow the moments. Samples count as so many of one weight as tell as much (Kish): a firefly is one sample.
    fn maximise(&mut self) {
        let [mean, square] = self.weights;
        let effective = self.samples * (mean * mean / square).min(1.0);
        if !(mean > 0.0 && effective > 0.0) {
            return;
        }
        self.components.iter_mut().for_each(|of| of.maximise(effective, mean));
        let total: f64 = self.components.iter().map(|of| of.weight).sum();
        self.components.iter_mut().for_each(|of| of.weight /= total);
    }

    /// Lets the samples so far count as a part of their number.
    pub fn decay(&mut self, part: f64) {
        self.samples *= part;
        self.kinds = self.kinds.map(|sums| sums.map(|sum| part * sum));
    }

    fn gaussians(&self) -> Vec<Gaussian> {
        self.components.iter().map(Component::gaussian).collect()
    }

    /// The mixture as it is sampled; none where no light has arrived.
    pub fn frozen(&self) -> Option<GaussianMixture> {
        GaussianMixture::new(&self.gaussians()).ok()
    }

    /// Numbers for a file: those beside the components, and each component's.
    pub fn numbers(&self) -> ([f64; VOXEL_NUMBERS], Vec<[f64; NUMBERS]>) {
        let ([mean, square], [[paths, light], [photons, power]]) = (self.weights, self.kinds);
        let own = [self.samples, mean, square, paths, light, photons, power];
        (own, self.components.iter().map(Component::numbers).collect())
    }

    /// The mixture of these numbers; none where they are out of range.
    pub fn from_numbers(own: &[f64; VOXEL_NUMBERS], components: &[[f64; NUMBERS]]) -> Option<Self> {
        let [samples, mean, square, paths, light, photons, power] = *own;
        if components.len() > MOST {
            return None;
        }
        let components: Vec<_> = components.iter().map(Component::from_numbers).collect::<Option<_>>()?;
        let total: f64 = components.iter().map(|of| of.weight).sum();
        let sound =
            own.iter().all(|of| (0.0..1e150).contains(of)) && (components.is_empty() || (total - 1.0).abs() < 1e-3);
        let kinds = [[paths, light], [photons, power]];
        sound.then_some(Self { components, samples, weights: [mean, square], kinds })
    }
}

fn is_lit(of: &Arrived) -> bool {
    of.value > 0.0 && of.value.is_finite()
}

/// The samples of both kinds that have light, their values times the factor of their kind: as evenly mixed as their numbers allow, each kind in its order.
fn in_turns(kinds: [&[Arrived]; 2], factors: [f64; 2]) -> Vec<Arrived> {
    let lit = |kind: usize| -> Vec<Arrived> {
        let scaled = |of: &Arrived| Arrived { value: of.value * factors[kind], ..*of };
        kinds[kind].iter().filter(|of| is_lit(of)).map(scaled).filter(is_lit).collect()
    };
    let [a, b] = [lit(0), lit(1)];
    let (mut all, mut taken) = (Vec::with_capacity(a.len() + b.len()), [0, 0]);
    while all.len() < a.len() + b.len() {
        let is_first = taken[0] < a.len() && (taken[1] == b.len() || taken[0] * b.len() <= taken[1] * a.len());
        all.push(if is_first { a[taken[0]] } else { b[taken[1]] });
        taken[usize::from(!is_first)] += 1;
    }
    all
}

/// Gaussians at samples that lie at equal distances along the sum of weights.
fn first(samples: &[Arrived]) -> Vec<Component> {
    let total: f64 = samples.iter().map(|of| of.value).sum();
    let (mut sum, mut next) = (0.0, samples.iter());
    let mut place = [0.5; 2];
    let at = |k: usize| {
        while sum <= (k as f64 + 0.5) / MOST as f64 * total {
            let Some(of) = next.next() else { break };
            (sum, place) = (sum + of.value, of.place);
        }
        // Two that begin alike would stay so.
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / MOST as f64).sin_cos();
        let [x, y] = [place[0] + APART * cos, place[1] + APART * sin];
        Component::at(1.0 / MOST as f64, [x.clamp(0.0, 1.0), y.rem_euclid(1.0)])
    };
    (0..MOST).map(at).collect()
}
