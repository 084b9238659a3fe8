//! A piecewise-constant distribution of directions over a quadtree, and divergences between two of them.

use super::topology::{NO_CHILD, Topology};

/// Mass whose inverse would overflow.
pub const NOTHING: f64 = 1e-290;

/// Probability mass per node; constant in solid angle within a leaf, because the cylindrical map preserves area.
#[derive(Debug, Clone, PartialEq)]
pub struct Distribution {
    topology: Topology,
    node_mass: Vec<f64>,
}

/// A cell on which distributions are constant: the mass that each has there, and the uniform distribution's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonCell {
    /// Mass of the target.
    pub target: f64,
    /// Mass of the distribution that BSDF sampling draws from.
    pub bsdf: f64,
    /// Mass of the guide.
    pub guide: f64,
    /// Share of the sphere that the cell covers, 4^(−level).
    pub area: f64,
}

impl Distribution {
    /// The uniform distribution: a root alone.
    pub fn uniform() -> Self {
        Self { topology: Topology::root(), node_mass: vec![1.0] }
    }

    /// The distribution proportional to `weights`, one per leaf in the order of [`Topology::leaves`]. Weights that are
    /// negative or not finite count as 0; without any positive weight the result is [`Distribution::uniform`].
    pub fn from_leaf_weights(topology: Topology, weights: &[f64]) -> Self {
        let usable = |w: f64| if w.is_finite() && w > 0.0 { w } else { 0.0 };
        // Scaled by the largest first, so that neither the sum overflows nor tiny weights vanish.
        let largest = weights.iter().copied().map(usable).fold(0.0, f64::max);
        if largest == 0.0 {
            return Self::uniform();
        }
        let mut node_mass = vec![0.0; topology.len()];
        for (leaf, &weight) in topology.leaves().zip(weights) {
            node_mass[leaf] = usable(weight) / largest;
        }
        for node in (1..topology.len()).rev() {
            node_mass[topology.parent[node] as usize] += node_mass[node];
        }
        let total = node_mass[0];
        node_mass.iter_mut().for_each(|m| *m /= total);
        Self { topology, node_mass }
    }

    /// The distribution whose node masses are products of `shares` from the root down (Zhu 2021 §6.4); one share of its
    /// parent per node, the root's is ignored. Four siblings are normalised; if none is positive each gets ¼.
    pub fn from_shares(topology: Topology, shares: &[f32]) -> Self {
        let mut node_mass = vec![1.0; topology.len()];
        for parent in 0..topology.len() {
            let first = topology.first_child[parent];
            if first == NO_CHILD {
                continue;
            }
            let first = first as usize;
            let mut four = [0.0; 4];
            for (four, share) in four.iter_mut().zip(shares.get(first..).unwrap_or(&[])) {
                *four = if share.is_finite() { f64::from(share.max(0.0)) } else { 0.0 };
            }
            let sum: f64 = four.iter().sum();
            let (four, scale) =
                if sum > 0.0 { (four, node_mass[parent] / sum) } else { ([0.25; 4], node_mass[parent]) };
            for (mass, share) in node_mass[first..first + 4].iter_mut().zip(four) {
                *mass = share * scale;
            }
        }
        Self { topology, node_mass }
    }

    /// The quadtree.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// Mass per node, breadth first: the root's is 1, an inner node's is the sum of its children's.
    pub fn node_mass(&self) -> &[f64] {
        &self.node_mass
    }

    /// Mass per leaf in the order of [`Topology::leaves`].
    pub fn leaf_mass(&self) -> Vec<f64> {
        self.topology.leaves().map(|n| self.node_mass[n]).collect()
    }

    /// Mass of the cell (x, y) at `level`: a node's mass, or its part of the leaf that contains it.
    pub fn cell_mass(&self, level: usize, [x, y]: [u32; 2]) -> f64 {
        let mut node = 0;
        for l in 0..level {
            let first = self.topology.first_child[node];
            if first == NO_CHILD {
                return self.node_mass[node] * 0.25f64.powi((level - l) as i32);
            }
            let shift = level - l - 1;
            node = first as usize + ((x >> shift) & 1) as usize + 2 * ((y >> shift) & 1) as usize;
        }
        self.node_mass[node]
    }

    /// The mean of several distributions on the union of their trees down to `max_level` (the 'mean tree' baseline). Empty
    /// input gives the uniform distribution.
    pub fn mean(all: &[&Self], max_level: usize) -> Self {
        Self::weighted(&all.iter().map(|&d| (d, 1.0)).collect::<Vec<_>>(), max_level, 0.0)
    }

    /// The weighted mean of several distributions on the union of their trees, down to `max_level`; nodes below the root with
    /// at most `min_mass` of the result are not split further. Weights are ≥ 0; where none is positive, or nothing is given,
    /// the result is uniform. The union is kept within the limits of [`Topology`]: levels past them end.
    pub fn weighted(all: &[(&Self, f64)], max_level: usize, min_mass: f64) -> Self {
        let total: f64 = all.iter().map(|p| p.1).sum();
        if !(total > 0.0 && total.is_finite()) {
            return Self::uniform();
        }
        let max_level = max_level.min(super::topology::MAX_LEVEL);
        let nodes = all.iter().map(|(of, _)| of.topology.len()).max().unwrap_or(1);
        let mut union = Union {
            parts: Vec::with_capacity(nodes),
            split: Vec::with_capacity(nodes),
            mass: Vec::with_capacity(nodes),
        };
        let mut level = vec![union.cell(0.0, all.iter().map(|&(of, weight)| (of, 0, weight / total)))];
        let mut next = Vec::new();
        for depth in 0.. {
            let before = union.split.len() + level.len();
            for cell in level.drain(..) {
                let room = before + next.len() + 4 <= super::topology::MAX_NODES;
                let mass = union.mass_of(&cell);
                let splits = depth < max_level && room && !cell.parts.is_empty() && (depth == 0 || mass > min_mass);
                union.mass.push(mass);
                union.split.push(splits);
                if splits {
                    next.extend((0..4).map(|k| union.child(&cell, k)));
                }
            }
            if next.is_empty() {
                break;
            }
            std::mem::swap(&mut level, &mut next);
        }
        // The flags were made level by level from whole groups of four within the limits, so they are consistent.
        match Topology::from_split(&union.split) {
            Ok(topology) => Self { topology, node_mass: union.mass },
            Err(_) => Self::uniform(),
        }
    }

    /// `share` of the first distribution and the rest of the second, on the union of their trees.
    pub fn blend(a: &Self, b: &Self, share: f64) -> Self {
        if a.topology == b.topology {
            let node_mass = a.node_mass.iter().zip(&b.node_mass).map(|(x, y)| share * x + (1.0 - share) * y).collect();
            return Self { topology: a.topology.clone(), node_mass };
        }
        Self::weighted(&[(a, share), (b, 1.0 - share)], usize::MAX, 0.0)
    }

    /// The shape whose nodes are split while they hold more than `share`, with at most `most` nodes; a leaf that has to be split
    /// is taken as uniform inside.
    pub fn refined(&self, share: f64, most: usize) -> Topology {
        let root = Part { of: self, node: Some(0), mass: 1.0 };
        Topology::grown(root, most, |part| part.mass > share, |part| [0, 1, 2, 3].map(|k| part.child(k)))
    }

    /// This distribution on the tree that has all cells of `level`; finer nodes are averaged.
    pub fn on_grid(&self, level: usize) -> Self {
        let topology = Topology::complete(level);
        let masses = topology.level(level).map(|node| self.cell_mass(level, topology.cell[node])).collect::<Vec<_>>();
        Self::from_leaf_weights(topology, &masses)
    }

    /// The cells of the union of all trees' leaves, without those where `target` has no mass.
    pub fn common_cells(target: &Self, bsdf: &Self, guide: &Self) -> Vec<CommonCell> {
        let mut cells = Vec::with_capacity(target.topology.len().max(guide.topology.len()));
        let start = |of| Part { of, node: Some(0), mass: 1.0 };
        let mut open = vec![([target, bsdf, guide].map(start), 1.0)];
        while let Some((parts, area)) = open.pop() {
            let [target, bsdf, guide] = parts.each_ref().map(|part| part.mass);
            if target <= 0.0 {
                continue;
            }
            if parts.iter().any(Part::has_children) {
                open.extend((0..4).map(|k| (parts.each_ref().map(|part| part.child(k)), 0.25 * area)));
            } else {
                cells.push(CommonCell { target, bsdf, guide, area });
            }
        }
        cells
    }
}

/// The union of weighted trees while it is made, breadth first.
struct Union<'a> {
    /// Nodes with children in any open cell: tree, node, the tree's weight.
    parts: Vec<(&'a Distribution, usize, f64)>,
    split: Vec<bool>,
    mass: Vec<f64>,
}

/// One cell of a union: the mass that is constant over it, and the range of parts that are not.
struct UnionCell {
    flat: f64,
    parts: std::ops::Range<usize>,
}

impl<'a> Union<'a> {
    fn cell(&mut self, flat: f64, parts: impl Iterator<Item = (&'a Distribution, usize, f64)>) -> UnionCell {
        let (start, mut flat) = (self.parts.len(), flat);
        for part in parts {
            self.add(part, &mut flat);
        }
        UnionCell { flat, parts: start..self.parts.len() }
    }

    /// Adds a node to the cell that is made: its mass to what is `flat` if it is a leaf.
    fn add(&mut self, part: (&'a Distribution, usize, f64), flat: &mut f64) {
        let (of, node, weight) = part;
        let mass = weight * of.node_mass[node];
        if of.topology.is_leaf(node) {
            *flat += mass;
        } else if mass > 0.0 {
            self.parts.push(part);
        }
    }

    fn mass_of(&self, cell: &UnionCell) -> f64 {
        let mass = |(of, node, weight): &(&Distribution, usize, f64)| weight * of.node_mass[*node];
        cell.flat + self.parts[cell.parts.clone()].iter().map(mass).sum::<f64>()
    }

    fn child(&mut self, cell: &UnionCell, k: usize) -> UnionCell {
        let start = self.parts.len();
        let mut flat = 0.25 * cell.flat;
        for i in cell.parts.clone() {
            let (of, node, weight) = self.parts[i];
            self.add((of, of.topology.first_child[node] as usize + k, weight), &mut flat);
        }
        UnionCell { flat, parts: start..self.parts.len() }
    }
}

/// A distribution seen at one cell, which may lie inside a leaf.
#[derive(Clone, Copy)]
struct Part<'a> {
    of: &'a Distribution,
    node: Option<usize>,
    mass: f64,
}

impl Part<'_> {
    fn has_children(&self) -> bool {
        self.node.is_some_and(|n| !self.of.topology.is_leaf(n))
    }

    fn child(&self, k: usize) -> Self {
        match self.node {
            Some(node) if self.has_children() => {
                let child = self.of.topology.first_child[node] as usize + k;
                // Rescaled so that a weight given at the root carries over to every node.
                let of_parent = self.of.node_mass[node];
                let mass = if of_parent > 0.0 { self.mass * self.of.node_mass[child] / of_parent } else { 0.0 };
                Self { of: self.of, node: Some(child), mass }
            }
            _ => Self { of: self.of, node: None, mass: 0.25 * self.mass },
        }
    }
}

/// KL(target ‖ (1−u)·guide + u·uniform) in nats, exact; infinite only where the mixture is 0 and the target is not.
pub fn kl(target: &Distribution, guide: &Distribution, uniform: f64) -> f64 {
    kl_of_cells(&Distribution::common_cells(target, guide, guide), uniform)
}

/// Terms of [`kl`] by level, each of the shares in which it divides its parents' mass (the chain rule); entry 0 is level 1.
pub fn kl_by_level(target: &Distribution, guide: &Distribution, uniform: f64) -> Vec<f64> {
    let mut levels = vec![];
    let start = |of| Part { of, node: Some(0), mass: 1.0 };
    let mixed = |g: &Part, area: f64| (1.0 - uniform) * g.mass + uniform * area;
    let mut open = vec![(start(target), start(guide), 0usize)];
    while let Some((t, g, level)) = open.pop() {
        if t.mass <= 0.0 || !(t.has_children() || g.has_children()) {
            continue;
        }
        if levels.len() == level {
            levels.push(0.0);
        }
        let area = 0.25f64.powi(level as i32);
        for k in 0..4 {
            let (child, guess) = (t.child(k), g.child(k));
            if child.mass > 0.0 {
                let ratio = child.mass / t.mass * mixed(&g, area) / mixed(&guess, 0.25 * area);
                levels[level] += child.mass * ratio.ln();
                open.push((child, guess, level + 1));
            }
        }
    }
    levels
}

/// [`kl`] from cells that are already at hand, for trying many values of the uniform part.
pub fn kl_of_cells(cells: &[CommonCell], uniform: f64) -> f64 {
    let term = |c: &CommonCell| c.target * (c.target / ((1.0 - uniform) * c.guide + uniform * c.area)).ln();
    cells.iter().map(term).sum::<f64>().max(0.0)
}

/// Effect of a guide on the picture: the second moment of the one-sample estimator that draws half from the BSDF and half from the
/// guide q, relative to that of the best single distribution, ∫ t² / (½·p_bsdf + ½·q), with t the root of the integrand's second
/// moment, normalised. A uniform part is mixed into the guide. The relative variance is this minus one.
pub fn relative_moment(cells: &[CommonCell], uniform: f64) -> f64 {
    let term = |c: &CommonCell| {
        let guide = (1.0 - uniform) * c.guide + uniform * c.area;
        c.target * c.target / (0.5 * c.bsdf + 0.5 * guide)
    };
    cells.iter().map(term).sum()
}

/// A root whose four children are leaves of these weights, for tests of this module.
#[cfg(test)]
pub(super) fn quarters(weights: [f64; 4]) -> Distribution {
    Distribution::from_leaf_weights(Topology::complete(1), &weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEEP: [bool; 9] = [true, false, true, false, false, false, false, false, false];

    fn deep(weights: [f64; 7]) -> Distribution {
        Distribution::from_leaf_weights(Topology::from_split(&DEEP).unwrap(), &weights)
    }

    #[test]
    fn a03_masses_sum_to_one_whatever_the_scale() {
        for scale in [1e-300, 1.0, 1e300] {
            let d = deep([1., 2., 3., 4., 5., 6., 7.].map(|w| w * scale));
            assert!((d.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((d.node_mass()[2] - 22.0 / 28.0).abs() < 1e-12);
        }
        assert_eq!(deep([0.0; 7]), Distribution::uniform());
        assert_eq!(deep([f64::NAN; 7]), Distribution::uniform());
    }

    #[test]
    fn kl_is_zero_for_equal_functions_and_exact_otherwise() {
        let flat = deep([4., 4., 4., 1., 1., 1., 1.]);
        assert!(kl(&flat, &Distribution::uniform(), 0.0) < 1e-12, "different trees, the same function");
        let d = deep([0., 0., 0., 1., 0., 0., 0.]);
        assert!((kl(&d, &Distribution::uniform(), 0.0) - 16f64.ln()).abs() < 1e-12);
        assert!((kl(&Distribution::uniform(), &d, 0.5) - expected_half()).abs() < 1e-12);
        assert!(kl(&Distribution::uniform(), &d, 0.0).is_infinite());
    }

    /// 15/16 of the sphere at density ½, 1/16 at ½ + 8.
    fn expected_half() -> f64 {
        15.0 / 16.0 * 2f64.ln() - 1.0 / 16.0 * 8.5f64.ln()
    }

    #[test]
    fn levels_add_up() {
        let (a, b) = (deep([1., 2., 3., 4., 5., 6., 7.]), deep([3., 1., 1., 9., 5., 1., 2.]));
        for guide in [&b, &Distribution::uniform()] {
            let levels = kl_by_level(&a, guide, 0.1);
            assert_eq!(levels.len(), 2);
            assert!((levels.iter().sum::<f64>() - kl(&a, guide, 0.1)).abs() < 1e-12);
        }
    }

    #[test]
    fn shares_multiply_and_bad_ones_become_quarters() {
        let t = Topology::from_split(&DEEP).unwrap();
        let d = Distribution::from_shares(t, &[9., 0.1, 0.7, 0.1, 0.1, f32::NAN, 0., 0., 0.]);
        assert!((d.node_mass()[5] - 0.7 / 4.0).abs() < 1e-6);
        assert!((d.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!((d.cell_mass(3, [7, 7]) - 0.1 / 16.0).abs() < 1e-7);
    }

    #[test]
    fn mean_is_on_the_union() {
        let a = deep([0., 0., 0., 1., 0., 0., 0.]);
        let m = Distribution::mean(&[&a, &Distribution::uniform()], 20);
        assert_eq!(m.topology(), a.topology());
        assert!((m.node_mass()[5] - (0.5 + 0.5 / 16.0)).abs() < 1e-12);
        assert_eq!(Distribution::mean(&[&a], 1).topology().levels(), 2);
        let third = Distribution::weighted(&[(&a, 1.0), (&Distribution::uniform(), 2.0)], 20, 0.0);
        assert!((third.node_mass()[5] - (1.0 / 3.0 + 2.0 / 48.0)).abs() < 1e-12);
        assert!((third.leaf_mass().iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(Distribution::weighted(&[(&deep([1.0; 7]), 1.0)], 20, 0.6).topology().levels(), 2, "cut by mass");
        assert_eq!(Distribution::weighted(&[], 20, 0.0), Distribution::uniform());
    }

    #[test]
    fn second_moments_match_their_integral() {
        let u = Distribution::uniform();
        assert!((relative_moment(&Distribution::common_cells(&u, &u, &u), 0.1) - 1.0).abs() < 1e-12);
        // All of the light in a sixteenth of the sphere, which the BSDF finds with a quarter of its samples, the guide with half.
        let t = deep([0., 0., 0., 1., 0., 0., 0.]);
        let b = deep([0., 0., 0.75, 0.25, 0., 0., 0.]);
        let q = deep([0.5, 0., 0., 0.5, 0., 0., 0.]);
        let cells = Distribution::common_cells(&t, &b, &q);
        assert!((relative_moment(&cells, 0.0) - 1.0 / 0.375).abs() < 1e-12);
        assert!((relative_moment(&cells, 0.5) - 1.0 / (0.125 + 0.25 * (0.5 + 1.0 / 16.0))).abs() < 1e-12);
    }
}
