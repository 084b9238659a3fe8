//! A lobe while it learns: its parameters, and the statistics of all samples so far that new ones are added to.

use glam::DVec3;

use super::MOST;
use super::lobe::{Lobe, MOST_KAPPA, concentration, mean_cosine};

/// Weighted samples that count as a lobe's, whose mean is its mean direction times its mean cosine.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sums {
    /// Sum of weights, which have the mean 1.
    pub count: f64,
    /// Sum of weighted directions.
    pub direction: DVec3,
}

impl Sums {
    /// Adds a sample.
    #[inline]
    pub fn add(&mut self, weight: f64, direction: DVec3) {
        self.count += weight;
        self.direction += weight * direction;
    }

    /// Both together.
    pub fn with(self, other: Self) -> Self {
        Self { count: self.count + other.count, direction: self.direction + other.direction }
    }

    /// A part of the samples.
    pub fn scaled(self, part: f64) -> Self {
        Self { count: part * self.count, direction: part * self.direction }
    }
}

/// How badly a lobe fits its samples, and along which axis.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Misfit {
    /// Number of samples of the mixture, those without light too.
    pub samples: f64,
    /// Number of samples with light that are the lobe's.
    pub assigned: f64,
    /// Sum of γ·V²·p/q over samples of value V and density p, where q is the mixture's and γ the lobe's part of that.
    pub squares: f64,
    /// Sum of γ·V.
    pub values: f64,
    /// Sums of γ·V times x², y² and xy, coordinates in the plane that touches the sphere at the mean direction.
    pub spread: [f64; 3],
}

/// A lobe while it learns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Weight π.
    pub weight: f64,
    /// Mean direction, a unit vector.
    pub mean: DVec3,
    /// Mean cosine around it, in [0, 1).
    pub mean_cosine: f64,
    /// Samples of earlier chunks.
    pub past: Sums,
    /// Weights of inverse distances times these, and their sum.
    pub nearness: [f64; 2],
    /// See [`Misfit`].
    pub misfit: Misfit,
}

/// Numbers of a component in a file.
pub const NUMBERS: usize = 18;

impl Component {
    /// A lobe that no sample has been added to.
    pub fn new(weight: f64, mean: DVec3, mean_cosine: f64) -> Self {
        let (past, nearness, misfit) = (Sums::default(), [0.0; 2], Misfit::default());
        Self { weight, mean, mean_cosine, past, nearness, misfit }
    }

    /// Eight lobes of concentration 5 that cover the sphere evenly (Ruppert 2020 §5.1), along a spherical Fibonacci spiral (Keinert 2015).
    pub fn even() -> Vec<Self> {
        const COUNT: usize = 8;
        let golden = 0.5 * (1.0 + 5f64.sqrt());
        let mean = |i: usize| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / COUNT as f64;
            let (sin, cos) = (std::f64::consts::TAU * (i as f64 / golden)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cos, r * sin, z)
        };
        (0..COUNT).map(|i| Self::new(1.0 / COUNT as f64, mean(i), mean_cosine(5.0))).collect()
    }

    /// Concentration κ.
    pub fn kappa(&self) -> f64 {
        concentration(self.mean_cosine)
    }

    /// The lobe as it is sampled.
    pub fn lobe(&self) -> Lobe {
        let [near, weight] = self.nearness;
        let nearness = if weight > 0.0 { (near / weight) as f32 } else { 0.0 };
        Lobe { mean: self.mean.as_vec3(), kappa: self.kappa() as f32, weight: self.weight as f32, nearness }
    }

    /// The same as seen from another pivot, from which the old one lies at `offset`.
    pub fn moved(&mut self, offset: DVec3) {
        let to = self.mean + offset * f64::from(self.lobe().nearness);
        let length = to.length();
        if length > 0.1 {
            self.mean = to / length;
            self.past.direction = self.mean * self.past.direction.length();
            self.nearness[0] /= length;
        }
    }

    /// Lets samples so far count as a part of their number.
    pub fn decay(&mut self, part: f64) {
        self.past = self.past.scaled(part);
        self.nearness = self.nearness.map(|sum| part * sum);
        let Misfit { samples, assigned, squares, values, spread } = &mut self.misfit;
        for sum in [samples, assigned, squares, values].into_iter().chain(spread) {
            *sum *= part;
        }
    }

    /// Numbers for a file.
    pub fn numbers(&self) -> [f64; NUMBERS] {
        let ([x, y, z], [a, b, c]) = (self.mean.to_array(), self.past.direction.to_array());
        let Misfit { samples, assigned, squares, values, spread: [xx, yy, xy] } = self.misfit;
        let [near, sum] = self.nearness;
        let (weight, cosine, count) = (self.weight, self.mean_cosine, self.past.count);
        [weight, x, y, z, cosine, count, a, b, c, near, sum, samples, assigned, squares, values, xx, yy, xy]
    }

    /// The component of these numbers; none where they are out of range.
    pub fn from_numbers(numbers: &[f64; NUMBERS]) -> Option<Self> {
        let [weight, x, y, z, mean_cosine, count, a, b, c, near, sum, samples, assigned, squares, values, xx, yy, xy] =
            *numbers;
        let component = Self {
            weight,
            mean: DVec3::new(x, y, z),
            mean_cosine,
            past: Sums { count, direction: DVec3::new(a, b, c) },
            nearness: [near, sum],
            misfit: Misfit { samples, assigned, squares, values, spread: [xx, yy, xy] },
        };
        let sums = [weight, count, near, sum, samples, assigned, squares, values, xx, yy];
        let sound = numbers.iter().all(|number| number.abs() < 1e150)
            && sums.iter().all(|sum| *sum >= 0.0)
            && weight <= 1.0 + 1e-9
            && (component.mean.length() - 1.0).abs() < 1e-6
            && (0.0..=mean_cosine_limit()).contains(&mean_cosine);
        sound.then_some(component)
    }
}

/// The mean cosine of the largest concentration.
pub fn mean_cosine_limit() -> f64 {
    mean_cosine(MOST_KAPPA)
}

/// The lobes as they are sampled, their weights with the sum 1.
pub fn lobes(all: &[Component]) -> Vec<Lobe> {
    let total: f64 = all.iter().map(|component| component.weight).sum();
    let lobe = |component: &Component| Lobe { weight: (component.weight / total) as f32, ..component.lobe() };
    all.iter().take(MOST).map(lobe).collect()
}
