//! χ² of samplers of directions: the sphere cut into cells, the density integrated over each, samples counted.

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::math::Frame;
use glam::Vec3;
use rayon::prelude::*;

use super::statistics::{assert_chi2, sidak};

/// How many χ² tests the files tests/sampling*.rs make together, rounded up; their joint false alarm rate is then ≤ 0.01.
const CHI2_TESTS: usize = 136;

/// Level of one of them.
pub fn level() -> f64 {
    sidak(0.01, CHI2_TESTS)
}

/// Directions as points of the unit square: [`Chart::Polar`] puts its frame's z axis at x = 0, and x = ((1 − cos θ)/2)^(1/p),
/// so that a large power p spreads out a narrow lobe; [`Chart::Rows`] has θ/π and φ/2π.
#[derive(Clone, Copy)]
pub enum Chart {
    Polar { frame: Frame, power: f64 },
    Rows { frame: Frame },
}

impl Chart {
    pub fn around(axis: Vec3, power: f64) -> Self {
        Self::Polar { frame: Frame::new(axis), power }
    }

    fn to_square(self, direction: Vec3) -> [f64; 2] {
        let (Self::Polar { frame, .. } | Self::Rows { frame }) = self;
        let d = [frame.s, frame.t, frame.n].map(|axis| axis.as_dvec3().dot(direction.as_dvec3()));
        let turn = d[1].atan2(d[0]) / (2.0 * PI);
        // atan2 keeps the digits of small angles, which 1 − cos θ loses.
        let theta = d[0].hypot(d[1]).atan2(d[2]);
        let x = match self {
            Self::Polar { power, .. } => (0.5 * theta).sin().powi(2).powf(1.0 / power),
            Self::Rows { .. } => theta / PI,
        };
        [x, if turn < 0.0 { turn + 1.0 } else { turn }].map(|c| c.min(1.0 - f64::EPSILON))
    }

    /// The direction at a point and the solid angle per unit area there.
    fn to_direction(self, [x, y]: [f64; 2]) -> (Vec3, f64) {
        let (theta, jacobian, frame) = match self {
            Self::Polar { frame, power } => {
                (2.0 * x.powf(power).sqrt().min(1.0).asin(), 4.0 * PI * power * x.powf(power - 1.0), frame)
            }
            Self::Rows { frame } => (PI * x, 2.0 * PI * PI * (PI * x).sin(), frame),
        };
        let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), (2.0 * PI * y).sin_cos());
        let parts = [(frame.s, sin * cos_phi), (frame.t, sin * sin_phi), (frame.n, cos)];
        (parts.iter().map(|(axis, c)| axis.as_dvec3() * *c).sum::<glam::DVec3>().normalize().as_vec3(), jacobian)
    }

    /// ∫ of `pdf` over a cell by Gauss-Legendre with 3×3 points, halved where that differs from four quarters'.
    fn integrate(
        self,
        pdf: &(impl Fn(Vec3) -> f64 + Sync),
        corner: [f64; 2],
        size: [f64; 2],
        coarse: f64,
        depth: u32,
    ) -> f64 {
        let half = size.map(|s| 0.5 * s);
        let quarter = |k: usize| [corner[0] + half[0] * (k & 1) as f64, corner[1] + half[1] * (k >> 1) as f64];
        let fine: [f64; 4] = std::array::from_fn(|k| self.gauss(pdf, quarter(k), half));
        let sum: f64 = fine.iter().sum();
        // Half of a count among 1e6 in one of a thousand cells is far below its Poisson noise.
        if depth == 0 || (depth < 8 && (sum - coarse).abs() < 1e-8 + 1e-5 * sum) {
            return sum;
        }
        (0..4).map(|k| self.integrate(pdf, quarter(k), half, fine[k], depth - 1)).sum()
    }

    fn gauss(self, pdf: &(impl Fn(Vec3) -> f64 + Sync), corner: [f64; 2], size: [f64; 2]) -> f64 {
        let (nodes, weights) =
            ([0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7], [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0]);
        let mut sum = 0.0;
        for i in 0..9 {
            let at = [corner[0] + size[0] * nodes[i / 3], corner[1] + size[1] * nodes[i % 3]];
            let (direction, jacobian) = self.to_direction(at);
            sum += weights[i / 3] * weights[i % 3] * jacobian * pdf(direction);
        }
        sum * size[0] * size[1]
    }

    /// ∫ of `pdf` over each of the cells into which the square is cut, row by row.
    pub fn shares(self, cells: [usize; 2], pdf: &(impl Fn(Vec3) -> f64 + Sync)) -> Vec<f64> {
        let size = cells.map(|n| 1.0 / n as f64);
        let corner = |i: usize| [(i / cells[1]) as f64 * size[0], (i % cells[1]) as f64 * size[1]];
        let integral = |i| self.integrate(pdf, corner(i), size, self.gauss(pdf, corner(i), size), 9);
        (0..cells[0] * cells[1]).into_par_iter().map(integral).collect()
    }

    /// ∫ of `pdf` over the sphere.
    pub fn mass(self, pdf: impl Fn(Vec3) -> f64 + Sync) -> f64 {
        self.shares([32, 16], &pdf).iter().sum()
    }

    /// Draws 1e6 samples and holds their cells against the integrals of `pdf`; samples that were lost (none) are a cell of
    /// their own, of probability one minus the density's mass. Returns that mass.
    pub fn check(
        self,
        name: &str,
        cells: [usize; 2],
        pdf: impl Fn(Vec3) -> f64 + Sync,
        sample: impl Fn(&mut Random) -> Option<Vec3> + Sync,
    ) -> f64 {
        const PARTS: u64 = 16;
        const N: u64 = PARTS * 62_500;
        let shares = self.shares(cells, &pdf);
        let mass: f64 = shares.iter().sum();
        assert!(mass < 1.0 + 1e-3, "{name}: the density integrates to {mass}");
        let counted = |part: u64| {
            let mut counts = vec![0.0; shares.len() + 1];
            let mut random = Random::new(8, part, 0);
            for _ in 0..N / PARTS {
                let cell = sample(&mut random).map_or(shares.len(), |direction| {
                    let [x, y] = self.to_square(direction);
                    (x * cells[0] as f64) as usize * cells[1] + (y * cells[1] as f64) as usize
                });
                counts[cell] += 1.0;
            }
            counts
        };
        let add = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(b).map(|(a, b)| a + b).collect();
        // Sums of whole numbers: their order does not matter.
        let counts = (0..PARTS).into_par_iter().map(counted).reduce(|| vec![0.0; shares.len() + 1], add);
        let lost = (1.0 - mass).max(0.0);
        let expected: Vec<f64> = shares.iter().chain([&lost]).map(|s| s * N as f64).collect();
        assert_chi2(name, &counts, &expected, level());
        mass
    }
}
