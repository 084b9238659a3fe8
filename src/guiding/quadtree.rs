//! Q_h: the quadtree that accumulates hybrid samples (Zhu 2021 §5).
//!
//! Precision: leaf sums are f32. They only steer sampling, and a voxel is divided long before its sums lose digits: 4e-5 after
//! 260,000 samples, 3e-2 after 8 million (`cargo bench --bench precision`). Sums over leaves, and over passes for training
//! targets, are f64.

use glam::Vec3;

use super::cache::Bounds;
use super::features::PATH_CHANNELS;
use super::leaves::{Layout, Leaves, Target};
use super::record::{PathRecord, PhotonRecord};
use super::topology::{MAX_LEVEL, MAX_NODES, NO_CHILD, Topology};
use crate::math::cylindrical;

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
    path_scale: f32,
    photon_scale: f32,
    path_count: u32,
    photon_count: u32,
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
        let [path_scale, photon_scale] = [0.0; 2];
        Self { topology, row, layout, target, sums, path_scale, photon_scale, path_count: 0, photon_count: 0 }
    }

    /// The shape.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// What the leaves hold.
    pub fn leaves(&self) -> Leaves<'_> {
        Leaves { topology: &self.topology, sums: &self.sums, layout: self.layout, target: self.target }
    }

    /// ΣV of path samples per leaf, without the tree's own scale, so that trees can be added up.
    pub fn path_values(&self) -> Vec<f64> {
        let scale = f64::from(self.path_scale);
        let scale = if self.target == Target::Radiance { scale } else { scale * scale };
        self.leaves().values(0).map(|v| v * scale).collect()
    }

    /// Number of path samples and of photons since the last clearing.
    pub fn counts(&self) -> [u32; 2] {
        [self.path_count, self.photon_count]
    }

    /// Whether any sample had a value: otherwise there is nothing to learn from.
    pub fn has_energy(&self) -> bool {
        self.path_scale > 0.0 || self.photon_scale > 0.0
    }

    /// Forgets all samples, keeps the shape.
    pub fn clear(&mut self) {
        self.sums.fill(0.0);
        (self.path_scale, self.photon_scale) = (0.0, 0.0);
        (self.path_count, self.photon_count) = (0, 0);
    }

    fn leaf_sums_at(&mut self, direction: Vec3) -> &mut [f32] {
        let node = self.topology.leaf_at(cylindrical::to_cell(direction));
        let channels = self.layout.channels();
        &mut self.sums[self.row[node] as usize * channels..][..channels]
    }

    /// Adds path samples that fell into the voxel `bounds`, in the order given.
    pub fn deposit_paths<'a>(&mut self, bounds: &Bounds, records: impl Iterator<Item = &'a PathRecord> + Clone) {
        let squares = self.target != Target::Radiance;
        let largest = records.clone().fold(0.0f32, |m, r| m.max(r.value));
        if largest > self.path_scale {
            let factor = self.path_scale / largest;
            self.rescale(0, if squares { factor * factor } else { factor });
            self.path_scale = largest;
        }
        let inverse = if self.path_scale > 0.0 { 1.0 / self.path_scale } else { 0.0 };
        for record in records {
            self.path_count += 1;
            let value = record.value * inverse;
            let value = if !value.is_finite() {
                0.0
            } else if squares {
                value * value
            } else {
                value
            };
            if self.layout == Layout::Values {
                let sums = self.leaf_sums_at(record.direction);
                sums[0] += value;
                sums[1] += 1.0;
                continue;
            }
            let local = bounds.local(record.point);
            let distance = scaled_distance(record.distance, bounds);
            let sums = &mut self.leaf_sums_at(record.direction)[..PATH_CHANNELS];
            let normals = [record.normal, record.next_normal];
            add(sums, value, record.direction, local, distance, normals);
            sums[PATH_CHANNELS - 1] += record.bsdf;
        }
    }

    /// Adds photons that fell into the voxel `bounds`, in the order given.
    pub fn deposit_photons<'a>(&mut self, bounds: &Bounds, records: impl Iterator<Item = &'a PhotonRecord> + Clone) {
        let largest = records.clone().fold(0.0f32, |m, r| m.max(r.power));
        if largest > self.photon_scale {
            self.rescale(self.layout.values()[1], self.photon_scale / largest);
            self.photon_scale = largest;
        }
        let inverse = if self.photon_scale > 0.0 { 1.0 / self.photon_scale } else { 0.0 };
        for record in records {
            self.photon_count += 1;
            let value = record.power * inverse;
            let value = if value.is_finite() { value } else { 0.0 };
            if self.layout == Layout::Values {
                let sums = self.leaf_sums_at(record.direction);
                sums[2] += value;
                sums[3] += 1.0;
                continue;
            }
            let local = bounds.local(record.point);
            let distance = scaled_distance(record.distance, bounds);
            let sums = &mut self.leaf_sums_at(record.direction)[PATH_CHANNELS..];
            let normals = [record.normal, record.previous_normal];
            add(sums, value, record.direction, local, distance, normals);
        }
    }

    /// Multiplies the value sums of one kind of sample, which start at `channel`.
    fn rescale(&mut self, channel: usize, factor: f32) {
        for sums in self.sums.chunks_exact_mut(self.layout.channels()) {
            sums[channel] *= factor;
        }
    }

    /// An empty tree whose nodes are split while their share of the path weight or of the photon weight exceeds `share`,
    /// and joined where neither does (Müller 2017 §3.2). A leaf that has to be split is taken as uniform inside. Where the
    /// tree holds no energy, its shape is kept.
    pub fn refined(&self, share: f64) -> Self {
        let weights = self.leaves().weights();
        let [path, photon] = weights[0];
        if path <= 0.0 && photon <= 0.0 {
            return Self::new(self.topology.clone(), self.layout, self.target);
        }
        let relative =
            |[a, b]: [f64; 2]| [if path > 0.0 { a / path } else { 0.0 }, if photon > 0.0 { b / photon } else { 0.0 }];
        let mut queue = vec![(Some(0usize), relative(weights[0]), 0usize)];
        let mut flags = Vec::new();
        let mut next = 0;
        while next < queue.len() {
            let (node, shares, level) = queue[next];
            next += 1;
            let wanted = shares[0] > share || shares[1] > share;
            let split = wanted && level < MAX_LEVEL && queue.len() + 4 <= MAX_NODES;
            flags.push(split);
            if !split {
                continue;
            }
            let first = node.map(|n| self.topology.first_child[n]).filter(|&c| c != NO_CHILD);
            queue.extend((0..4).map(|k| match first {
                Some(first) => {
                    let child = first as usize + k;
                    (Some(child), relative(weights[child]), level + 1)
                }
                None => (None, shares.map(|s| 0.25 * s), level + 1),
            }));
        }
        // The flags were produced breadth first with every limit observed, which is all that from_split checks.
        Self::new(Topology::from_split(&flags).unwrap_or_else(|_| Topology::root()), self.layout, self.target)
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        self.topology.len() * 20 + self.sums.len() * 4
    }
}

fn add(sums: &mut [f32], value: f32, direction: Vec3, local: Vec3, distance: f32, normals: [Vec3; 2]) {
    sums[0] += value;
    let vectors = [direction, local];
    for (i, v) in vectors.iter().enumerate() {
        for axis in 0..3 {
            sums[1 + 3 * i + axis] += v[axis];
        }
    }
    sums[7] += distance;
    for (i, v) in normals.iter().enumerate() {
        for axis in 0..3 {
            sums[8 + 3 * i + axis] += v[axis];
        }
    }
    sums[14] += 1.0;
}

/// ln(1 + distance / voxel size), at most 16: finite for the background.
fn scaled_distance(distance: f32, bounds: &Bounds) -> f32 {
    (distance / bounds.size()).ln_1p().clamp(0.0, 16.0)
}
