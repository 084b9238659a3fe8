//! Reconstruction by smoothing: the baseline that the network has to beat.
//!
//! In the spirit of Nilsson's level-wise denoising of guiding quadtrees, with two changes that made it stronger: the kernel's
//! width shrinks with the number of samples like a kernel density estimate's (∝ N^(−1/6) in two dimensions, Silverman 1986
//! §4.3.1), and levels are not merged by maximum but each level decides how its nodes divide their parent's mass. Down to
//! [`BASE_LEVEL`] the shares come from one dense map blurred by an absolute width; below, where Q_h is sparse, from
//! Gaussian-weighted neighbours within the level.

use hashbrown::HashMap;

use crate::guiding::distribution::Distribution;
use crate::guiding::topology::Topology;

/// Level of the dense map: 32 × 32 cells.
pub const BASE_LEVEL: usize = 5;

const SIDE: usize = 1 << BASE_LEVEL;

/// Parameters, tuned by evaluation on training trees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Standard deviation at 64 samples, in cells of the dense map.
    pub sigma: f64,
    /// How fast it shrinks: σ · (N/64)^(−exponent).
    pub exponent: f64,
    /// Standard deviation below the dense map, in cells of each level; 0 drops the levels below it.
    pub fine_sigma: f64,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self { sigma: 3.0, exponent: 1.0 / 6.0, fine_sigma: 1.0 }
    }
}

impl Gaussian {
    /// Smooths `noisy`, which was made from `samples` samples. φ wraps; beyond a pole lies the cell across (φ + π).
    pub fn reconstruct(&self, noisy: &Distribution, samples: u64) -> Distribution {
        let sigma = self.sigma * (samples.max(1) as f64 / 64.0).powf(-self.exponent);
        let map = blurred(noisy, sigma.clamp(0.05, SIDE as f64 / 2.0));
        let mut split = Vec::new();
        let mut shares = Vec::new();
        let mut level = vec![([0u32, 0u32], 1.0f32)];
        for depth in 0..=crate::guiding::topology::MAX_LEVEL {
            let below = if depth < BASE_LEVEL { None } else { Some(self.fine_level(noisy, depth, split.len())) };
            let mut next = Vec::new();
            for (cell, share) in level {
                shares.push(share);
                let children: [[u32; 2]; 4] =
                    std::array::from_fn(|k| [2 * cell[0] + (k as u32 & 1), 2 * cell[1] + (k as u32 >> 1)]);
                let masses = match &below {
                    None => Some(children.map(|c| map.cell_mass(depth + 1, c))),
                    Some(fine) => fine.get(&cell).copied(),
                };
                split.push(masses.is_some());
                if let Some(masses) = masses {
                    next.extend(children.into_iter().zip(masses.map(|m| m as f32)));
                }
            }
            if next.is_empty() {
                break;
            }
            level = next;
        }
        match Topology::from_split(&split) {
            Ok(topology) => Distribution::from_shares(topology, &shares),
            // Cannot happen while Q_h itself is within the limits; smoothing is a luxury, the input still serves.
            Err(_) => noisy.clone(),
        }
    }

    /// For every cell that Q_h splits at `level`, the smoothed masses of its four children.
    fn fine_level(&self, noisy: &Distribution, level: usize, nodes_before: usize) -> HashMap<[u32; 2], [f64; 4]> {
        let tree = noisy.topology();
        let mut found = HashMap::new();
        let room = crate::guiding::topology::MAX_NODES.saturating_sub(nodes_before) / 4;
        if self.fine_sigma <= 0.0 || level >= tree.levels() {
            return found;
        }
        let radius = (2.0 * self.fine_sigma).ceil().min(4.0) as i64;
        let weight = |d: i64| (-0.5 * (d as f64 / self.fine_sigma).powi(2)).exp();
        for node in tree.level(level).filter(|&n| !tree.is_leaf(n)).take(room / 2) {
            let [x, y] = tree.cell[node];
            let smooth = |k: u32| {
                let centre = [i64::from(2 * x + (k & 1)), i64::from(2 * y + (k >> 1))];
                let mut sum = 0.0;
                for dx in -radius..=radius {
                    for dy in -radius..=radius {
                        let cell = wrapped(level + 1, [centre[0] + dx, centre[1] + dy]);
                        sum += weight(dx) * weight(dy) * noisy.cell_mass(level + 1, cell);
                    }
                }
                sum
            };
            found.insert([x, y], [0, 1, 2, 3].map(smooth));
        }
        found
    }
}

/// The cell at signed coordinates: φ wraps, and crossing a pole continues at φ + π.
fn wrapped(level: usize, [mut x, mut y]: [i64; 2]) -> [u32; 2] {
    let side = 1i64 << level;
    if x < 0 {
        (x, y) = (-1 - x, y + side / 2);
    } else if x >= side {
        (x, y) = (2 * side - 1 - x, y + side / 2);
    }
    [x.clamp(0, side - 1) as u32, y.rem_euclid(side) as u32]
}

/// The mass in each cell of the dense map, blurred by a Gaussian of `sigma` cells, as a distribution.
fn blurred(noisy: &Distribution, sigma: f64) -> Distribution {
    let mut map = vec![0.0; SIDE * SIDE];
    for x in 0..SIDE {
        for y in 0..SIDE {
            map[x * SIDE + y] = noisy.cell_mass(BASE_LEVEL, [x as u32, y as u32]);
        }
    }
    let radius = ((3.0 * sigma).ceil() as i64).min(SIDE as i64);
    let kernel: Vec<f64> = (-radius..=radius).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
    for axis in 0..2 {
        map = convolve(&map, &kernel, radius, axis);
    }
    // All flags but the last level's are set.
    let inner = (4usize.pow(BASE_LEVEL as u32) - 1) / 3;
    let split: Vec<bool> = (0..inner + SIDE * SIDE).map(|n| n < inner).collect();
    let Ok(topology) = Topology::from_split(&split) else { return noisy.clone() };
    let weights: Vec<f64> =
        topology.leaves().map(|n| topology.cell[n]).map(|[x, y]| map[x as usize * SIDE + y as usize]).collect();
    Distribution::from_leaf_weights(topology, &weights)
}

fn convolve(map: &[f64], kernel: &[f64], radius: i64, axis: usize) -> Vec<f64> {
    let mut out = vec![0.0; map.len()];
    for (i, to) in out.iter_mut().enumerate() {
        for (d, weight) in (-radius..=radius).zip(kernel) {
            let mut at = [(i / SIDE) as i64, (i % SIDE) as i64];
            at[axis] += d;
            let [x, y] = wrapped(BASE_LEVEL, at);
            *to += weight * map[x as usize * SIDE + y as usize];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guiding::distribution::kl;

    /// All mass in one cell at `depth`, at the corner z = −1, φ = 0.
    fn spike(depth: usize) -> Distribution {
        let split: Vec<bool> =
            std::iter::once(true).chain((0..4 * depth).map(|i| i < 4 * (depth - 1) && i % 4 == 0)).collect();
        let tree = Topology::from_split(&split).unwrap();
        let deepest = tree.len() - 4;
        let weights: Vec<f64> = tree.leaves().map(|n| if n == deepest { 1.0 } else { 0.0 }).collect();
        Distribution::from_leaf_weights(tree, &weights)
    }

    #[test]
    fn uniform_stays_uniform() {
        let smooth = Gaussian::default().reconstruct(&Distribution::uniform(), 10);
        assert!(kl(&Distribution::uniform(), &smooth, 0.0) < 1e-9);
    }

    #[test]
    fn a_spike_spreads_over_the_seam_and_the_pole() {
        let smooth = Gaussian { sigma: 1.0, exponent: 0.0, fine_sigma: 0.0 }.reconstruct(&spike(5), 64);
        let mass = |x, y| smooth.cell_mass(5, [x, y]);
        assert!((mass(0, 1) - mass(0, 31)).abs() < 1e-6, "φ wraps");
        assert!(
            mass(0, 16) > 0.0 && (mass(0, 16) - mass(1, 0)).abs() < 1e-3,
            "the cell across the pole is a neighbour"
        );
        assert!((smooth.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn fine_levels_are_kept_and_bounded() {
        let smooth = Gaussian::default().reconstruct(&spike(12), 1000);
        assert_eq!(smooth.topology().levels(), 13);
        assert!(smooth.node_mass().iter().all(|m| m.is_finite()));
        let none = Gaussian { fine_sigma: 0.0, ..Gaussian::default() }.reconstruct(&spike(12), 1000);
        assert_eq!(none.topology().levels(), BASE_LEVEL + 1);
    }
}
