//! Q_h: the quadtree that accumulates hybrid samples (Zhu 2021 §5).
//!
//! Precision: leaf sums are f32. They only steer sampling, and a voxel is divided long before its sums lose digits: 4e-5 after
//! 260,000 samples, 3e-2 after 8 million (`cargo bench --bench precision`). Sums over leaves, and over passes for training
//! targets, are f64.

use glam::Vec3;

use super::leaves::{BSDF, COUNTS, Layout, Leaves, SQUARES, VALUES};
use super::topology::{MAX_NODES, NO_CHILD, Topology};
use crate::base::random::Random;
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::target::{DirectLight, Learned, Target};
use crate::math::cylindrical;

/// Rules by which the samples of a voxel are deposited in its tree.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Sphere by which directions are carried to the voxel's centre.
    pub parallax: Parallax,
    /// Rule for light that light sampling finds too.
    pub direct: DirectLight,
    /// Whether directions are moved at random within the size of their leaf (Müller 2019 §10.2).
    pub filtered: bool,
}

/// Samples of a voxel as trees add them, path samples and photons in the order in which they came. They are placed once, and added
/// as often as the tree is given another shape.
#[derive(Debug, Default)]
pub struct Placed {
    paths: Vec<PlacedSample>,
    photons: Vec<PlacedSample>,
    filtered: bool,
    normals: Vec3,
}

/// A path sample or a photon.
#[derive(Debug)]
struct PlacedSample {
    /// Place of its direction as seen from the voxel's centre, in steps of 2⁻³².
    place: [i32; 2],
    /// Value of the path sample, see [`Learned::value`], or power of the photon.
    value: f32,
    /// dω/dω' of the [`Parallax`].
    density: f32,
    /// See [`PathRecord::bsdf_share`].
    bsdf_share: f32,
}

impl Placed {
    /// Places samples for trees of this target.
    pub fn new<'a>(
        place: &Place,
        target: Target,
        paths: impl Iterator<Item = &'a PathRecord>,
        photons: impl Iterator<Item = &'a PhotonRecord>,
    ) -> Self {
        let learned = Learned { target, direct: place.direct };
        let mut normals = Vec3::ZERO;
        let mut placed = |[point, direction, normal]: [Vec3; 3], value, bsdf_share| {
            normals += normal;
            let seen = place.parallax.to_centre(point, direction);
            let place = cylindrical::to_place::<f32>(seen.direction.into());
            PlacedSample { place, value, density: seen.density, bsdf_share }
        };
        let paths = paths.map(|r| placed([r.point, r.direction, r.normal], learned.value(r), r.bsdf_share)).collect();
        let photons = photons.map(|r| placed([r.point, r.direction, r.normal], r.power, 0.0)).collect();
        Self { paths, photons, filtered: place.filtered, normals }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.paths.is_empty() && self.photons.is_empty()
    }

    /// Sum of their normals.
    pub fn normals(&self) -> Vec3 {
        self.normals
    }
}

/// A quadtree with raw feature sums at its leaves.
///
/// Sample values are divided by a scale of the tree's own, the largest it has seen, so that their squares neither overflow
/// nor vanish; nothing that is learned depends on the scale.
#[derive(Debug, Clone)]
pub struct Quadtree {
    topology: Topology,
    /// Row of each node in `sums`; meaningful for leaves.
    row: Vec<u32>,
    layout: Layout,
    target: Target,
    /// A row of `layout` per leaf, breadth first.
    sums: Vec<f32>,
    /// Scales of path values and of photon powers.
    scales: [f32; 2],
    counts: [u32; 2],
}

impl Quadtree {
    /// An empty tree of the given shape.
    pub fn new(topology: Topology, layout: Layout, target: Target) -> Self {
        let mut row = vec![0; topology.len()];
        let mut leaves = 0;
        for leaf in topology.leaves() {
            row[leaf] = leaves;
            leaves += 1;
        }
        let sums = vec![0.0; leaves as usize * layout.channels()];
        Self { topology, row, layout, target, sums, scales: [0.0; 2], counts: [0; 2] }
    }

    /// A tree whose leaves hold `sums`, see [`Quadtree::leaves`].
    pub(super) fn with_sums(topology: Topology, layout: Layout, target: Target, sums: &[f32]) -> Self {
        let mut tree = Self::new(topology, layout, target);
        if tree.sums.len() == sums.len() {
            tree.sums.copy_from_slice(sums);
        }
        tree
    }

    /// Scales of path values and of photon powers.
    pub(super) fn scales(&self) -> [f32; 2] {
        self.scales
    }

    /// Sets [`Quadtree::scales`] and [`Quadtree::counts`].
    pub(super) fn set_samples(&mut self, scales: [f32; 2], counts: [u32; 2]) {
        (self.scales, self.counts) = (scales, counts);
    }

    /// The shape.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// Quantity that is deposited.
    pub fn target(&self) -> Target {
        self.target
    }

    /// Sums at the leaves.
    pub fn leaves(&self) -> Leaves<'_> {
        Leaves { topology: &self.topology, sums: &self.sums, layout: self.layout, target: self.target }
    }

    /// ΣV of path samples per leaf, without the tree's own scale, so that trees can be added up.
    pub fn path_values(&self) -> Vec<f64> {
        let scale = f64::from(self.scales[0]);
        let scale = if self.target == Target::Radiance { scale } else { scale * scale };
        self.leaves().values(0).map(|v| v * scale).collect()
    }

    /// Mass of the BSDF per leaf, estimated by [`PathRecord::bsdf_share`] of the path samples; on no particular scale.
    pub fn bsdf_values(&self) -> Vec<f64> {
        if self.layout == Layout::Network { self.leaves().channel(BSDF).collect() } else { Vec::new() }
    }

    /// Number of path samples and of photons since the last clearing.
    pub fn counts(&self) -> [u32; 2] {
        self.counts
    }

    /// Whether any sample had a value above 0: otherwise there is nothing to learn from.
    pub fn has_energy(&self) -> bool {
        self.scales.iter().any(|&s| s > 0.0)
    }

    /// Forgets all samples, keeps the shape.
    pub fn clear(&mut self) {
        self.sums.fill(0.0);
        (self.scales, self.counts) = ([0.0; 2], [0; 2]);
    }

    /// Adds samples that fell into the voxel.
    pub fn deposit(&mut self, samples: &Placed) {
        let squares = self.target != Target::Radiance;
        let inverse = self.grow_scale(0, samples.paths.iter().map(|sample| sample.value));
        for sample in &samples.paths {
            let value = sample.value * inverse;
            // A density g over ω' is g·dω'/dω over ω: (g·dω'/dω)²·dω = g²·dω'/dω·dω'.
            let value = if squares { value * value / sample.density } else { value };
            let sums = self.add(0, value, self.cell(sample, samples.filtered));
            if let Some(bsdf) = sums.get_mut(BSDF) {
                *bsdf += sample.bsdf_share;
            }
        }
        let inverse = self.grow_scale(1, samples.photons.iter().map(|photon| photon.value));
        for photon in &samples.photons {
            self.add(1, photon.value * inverse, self.cell(photon, samples.filtered));
        }
    }

    /// The cell of level 20 that a sample is added to.
    fn cell(&self, sample: &PlacedSample, filtered: bool) -> [u32; 2] {
        if filtered { cylindrical::to_cell(self.moved(sample.place)) } else { sample.place.map(cylindrical::cell_at) }
    }

    /// The direction of a place moved at random by up to half of its leaf's size (Müller 2019 §10.2, the stochastic filter). φ wraps;
    /// beyond a pole lies the cell across (φ + π).
    fn moved(&self, place: [i32; 2]) -> Vec3 {
        let cell = place.map(cylindrical::cell_at);
        let side = 0.5f64.powi(self.topology.level_of(self.topology.leaf_at(cell)) as i32);
        let mut random = Random::new(u64::from(self.counts[0]), u64::from(self.counts[1]), self.topology.len() as u64);
        let [x, y] = cylindrical::square_of(place).map(|c| c + side * (random.next_f64() - 0.5));
        let across = if (0.0..=1.0).contains(&x) { 0.0 } else { 0.5 };
        cylindrical::to_direction([
            if x < 0.0 {
                -x
            } else if x > 1.0 {
                2.0 - x
            } else {
                x
            },
            y + across,
        ])
    }

    /// Adds the samples of a tree of the same shape and kind; returns whether it is of that. Sums are those of both, up to the rounding of
    /// singles.
    pub(super) fn add_samples_of(&mut self, other: &Self) -> bool {
        if self.topology != other.topology || self.layout != other.layout || self.target != other.target {
            return false;
        }
        let mut other = other.clone();
        for kind in 0..2 {
            let scale = self.scales[kind].max(other.scales[kind]);
            self.grow_scale(kind, std::iter::once(scale));
            other.grow_scale(kind, std::iter::once(scale));
            self.counts[kind] = self.counts[kind].saturating_add(other.counts[kind]);
        }
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, more)| *sum += more);
        true
    }

    /// An empty tree of the same shape for another target.
    pub fn emptied_for(&self, target: Target) -> Self {
        Self::new(self.topology.clone(), self.layout, target)
    }

    /// Adds a sample to its leaf, whose sums it returns.
    fn add(&mut self, kind: usize, value: f32, cell: [u32; 2]) -> &mut [f32] {
        self.counts[kind] += 1;
        let leaf = self.topology.leaf_at(cell);
        let channels = self.layout.channels();
        let sums = &mut self.sums[self.row[leaf] as usize * channels..][..channels];
        let value = if value.is_finite() { value } else { 0.0 };
        sums[VALUES[kind]] += value;
        sums[COUNTS[kind]] += 1.0;
        if let Some(square) = sums.get_mut(SQUARES[kind]) {
            *square += value * value;
        }
        sums
    }

    /// Raises the scale of one kind of sample to the largest of `values`; returns the factor for values.
    fn grow_scale(&mut self, kind: usize, values: impl Iterator<Item = f32>) -> f32 {
        let largest = values.fold(0.0, f32::max);
        if largest > self.scales[kind] {
            let factor = self.scales[kind] / largest;
            let squares = kind == 0 && self.target != Target::Radiance;
            self.rescale(kind, if squares { factor * factor } else { factor });
            self.scales[kind] = largest;
        }
        if self.scales[kind] > 0.0 { 1.0 / self.scales[kind] } else { 0.0 }
    }

    /// Multiplies the values of one kind of sample by `factor`.
    fn rescale(&mut self, kind: usize, factor: f32) {
        for sums in self.sums.chunks_exact_mut(self.layout.channels()) {
            sums[VALUES[kind]] *= factor;
            if let Some(square) = sums.get_mut(SQUARES[kind]) {
                *square *= factor * factor;
            }
        }
    }

    /// An empty tree whose nodes are split while their share of the path weight or of the photon weight exceeds `share` and more than
    /// `least` samples of that kind are in them, and joined where neither holds (Müller 2017 §3.2). A leaf that has to be split is
    /// taken as uniform inside. Where the tree holds no energy, its shape is kept.
    pub fn refined(&self, share: f64, least: u32) -> Self {
        let weights = self.leaves().weights();
        let [path, photon] = weights[0];
        if path <= 0.0 && photon <= 0.0 {
            return Self::new(self.topology.clone(), self.layout, self.target);
        }
        let relative =
            |[a, b]: [f64; 2]| [if path > 0.0 { a / path } else { 0.0 }, if photon > 0.0 { b / photon } else { 0.0 }];
        let channels = self.layout.channels();
        let counts: Vec<f32> = self.sums.chunks_exact(channels).flat_map(|row| COUNTS.map(|c| row[c])).collect();
        let counts = self.topology.sum_to_root(&counts, 2);
        let at = |node: usize| Refined {
            node: Some(node),
            shares: relative(weights[node]),
            counts: [counts[2 * node], counts[2 * node + 1]],
        };
        let wanted =
            |of: &Refined| of.shares.iter().zip(of.counts).any(|(&s, count)| s > share && count > f64::from(least));
        let children = |of: &Refined| {
            let first = of.node.map(|node| self.topology.first_child[node]).filter(|&first| first != NO_CHILD);
            [0, 1, 2, 3].map(|k| first.map_or_else(|| of.quarter(), |first| at(first as usize + k)))
        };
        let topology = Topology::grown(at(0), MAX_NODES, wanted, children);
        Self::new(topology, self.layout, self.target)
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        self.topology.len() * 20 + self.sums.len() * 4
    }
}

/// A cell of a tree that is being refined: a node, or a part of a leaf.
struct Refined {
    node: Option<usize>,
    /// Shares of the path weight and of the photon weight.
    shares: [f64; 2],
    /// Numbers of path samples and of photons.
    counts: [f64; 2],
}

impl Refined {
    /// A quarter of a leaf, which is uniform inside.
    fn quarter(&self) -> Self {
        Self { node: None, shares: self.shares.map(|s| 0.25 * s), counts: self.counts.map(|n| 0.25 * n) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A filtered direction stays within half a leaf's size, also across φ = 0 and a pole.
    #[test]
    fn directions_move_within_their_leaf_size() {
        let split: Vec<bool> = (0..85).map(|node| node < 21).collect();
        let tree = Topology::from_split(&split).expect("three full levels");
        let mut tree = Quadtree::new(tree, Layout::Values, Target::Variance);
        for square in [[0.5, 0.001], [0.001, 0.3], [0.999, 0.8], [0.3, 0.999]] {
            let direction = cylindrical::to_direction(square);
            let mut moved = [0.0f64; 2];
            for count in 0..200 {
                tree.counts[0] = count;
                let [x, y] = cylindrical::to_square(tree.moved(cylindrical::to_place::<f32>(direction.into())));
                let across = (y - square[1]).rem_euclid(1.0);
                let turn = across.min(1.0 - across);
                // Beyond a pole: mirrored, half a turn away.
                let (dx, dy) = if turn > 0.25 {
                    (x.min(1.0 - x) + square[0].min(1.0 - square[0]), 0.5 - turn)
                } else {
                    ((x - square[0]).abs(), turn)
                };
                assert!(dx <= 0.0626 && dy <= 0.0626, "{square:?} to {x} {y}");
                moved = [moved[0].max(dx), moved[1].max(dy)];
            }
            assert!(moved.iter().all(|&m| m > 0.05), "{square:?}: {moved:?}");
        }
    }
}
