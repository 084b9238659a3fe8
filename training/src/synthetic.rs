//! Training pairs whose truth is known in closed form: lobes on the sphere. For tests and for measuring speed without a
//! renderer; no model that is shipped is trained on them.

use std::f64::consts::{PI, TAU};

use fanal::base::random::Random;
use fanal::generate::shard::TreeSample;
use fanal::guiding::target::Target;
use fanal::guiding::tree::distribution::{Distribution, kl};
use fanal::guiding::tree::features::VoxelFeatures;
use fanal::guiding::tree::leaves::{BSDF, COUNTS, Layout, Leaves, NETWORK_CHANNELS, SQUARES, VALUES, solid_angle};
use fanal::guiding::tree::topology::{MAX_LEVEL, Topology};

/// Settings of the generator.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Range of the number of samples of each kind in Q_h, drawn log-uniformly.
    pub samples: [u32; 2],
    /// Number of path samples in the target.
    pub target_samples: u32,
    /// Share of the total above which a node is split, ρ.
    pub split_share: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: [8, 1000], target_samples: 20_000, split_share: 0.01 }
    }
}

/// A von Mises-Fisher lobe.
struct Lobe {
    weight: f64,
    axis: [f64; 3],
    kappa: f64,
}

/// A sample's value, and the cell of its direction.
struct Record {
    value: f64,
    cell: [u32; 2],
}

fn lobes(random: &mut Random) -> Vec<Lobe> {
    let count = 1 + random.below(4);
    (0..count)
        .map(|_| Lobe {
            weight: random.next_f64() + 0.1,
            axis: uniform_direction(random),
            kappa: 10f64.powf(0.3 + 2.5 * random.next_f64()),
        })
        .collect()
}

fn uniform_direction(random: &mut Random) -> [f64; 3] {
    let (z, phi) = (2.0 * random.next_f64() - 1.0, TAU * random.next_f64());
    let radius = (1.0 - z * z).max(0.0).sqrt();
    [radius * phi.cos(), radius * phi.sin(), z]
}

/// Radiance with unit integral, sr⁻¹: the densities of the lobes, and a twentieth of constant light.
fn radiance(lobes: &[Lobe], w: [f64; 3]) -> f64 {
    let total: f64 = lobes.iter().map(|l| l.weight).sum();
    let density = |l: &Lobe| {
        let cos: f64 = l.axis.iter().zip(w).map(|(a, b)| a * b).sum();
        // κ/(2π(1−e^−2κ)) e^κ(cos−1): the form that does not overflow.
        l.kappa / (TAU * (1.0 - (-2.0 * l.kappa).exp())) * (l.kappa * (cos - 1.0)).exp()
    };
    0.95 * lobes.iter().map(|l| l.weight / total * density(l)).sum::<f64>() + 0.05 / (4.0 * PI)
}

/// Samples a direction in proportion to [`radiance`].
fn sample_radiance(lobes: &[Lobe], random: &mut Random) -> [f64; 3] {
    if random.next_f64() < 0.05 {
        return uniform_direction(random);
    }
    let mut u = random.next_f64() * lobes.iter().map(|l| l.weight).sum::<f64>();
    let lobe = lobes
        .iter()
        .find(|l| {
            u -= l.weight;
            u <= 0.0
        })
        .unwrap_or(&lobes[0]);
    let [u, v] = [random.next_f64(), random.next_f64()];
    let cos = 1.0 + (u + (1.0 - u) * (-2.0 * lobe.kappa).exp()).ln() / lobe.kappa;
    let (sin, phi) = ((1.0 - cos * cos).max(0.0).sqrt(), TAU * v);
    let a = lobe.axis;
    let helper = if a[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let t = normalised(cross(a, helper));
    let b = cross(a, t);
    normalised(std::array::from_fn(|i| cos * a[i] + sin * (phi.cos() * t[i] + phi.sin() * b[i])))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalised(a: [f64; 3]) -> [f64; 3] {
    let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
    a.map(|x| x / length)
}

fn record(value: f64, direction: [f64; 3]) -> Record {
    let side = f64::from(1u32 << MAX_LEVEL);
    let unit = [(direction[2] + 1.0) / 2.0, direction[1].atan2(direction[0]).rem_euclid(TAU) / TAU];
    Record { value, cell: unit.map(|u| (u * side).clamp(0.0, side - 1.0) as u32) }
}

/// Splits nodes while the share of either kind exceeds `split_share`; returns the flags and every record's leaf rank.
fn build(kinds: [&[Record]; 2], split_share: f64) -> (Vec<bool>, [Vec<usize>; 2]) {
    let totals = kinds.map(|records| records.iter().map(|r| r.value).sum::<f64>());
    let mut ranks = kinds.map(|records| vec![0; records.len()]);
    let mut level: Vec<[Vec<usize>; 2]> = vec![kinds.map(|records| (0..records.len()).collect())];
    let (mut split, mut leaves) = (vec![], 0);
    for depth in 0..=MAX_LEVEL.min(10) {
        let mut below = vec![];
        for node in level {
            let exceeds = |k: usize| {
                let sum: f64 = node[k].iter().map(|&i| kinds[k][i].value).sum();
                totals[k] > 0.0 && sum > split_share * totals[k]
            };
            // With a single sample, nodes would be split down to the deepest level.
            let splits = depth < MAX_LEVEL.min(10) && (0..2).any(|k| node[k].len() > 1 && exceeds(k));
            split.push(splits);
            if !splits {
                (0..2).for_each(|k| node[k].iter().for_each(|&i| ranks[k][i] = leaves));
                leaves += 1;
                continue;
            }
            let shift = MAX_LEVEL - depth - 1;
            for child in 0..4u32 {
                let inside = |r: &Record| r.cell[0] >> shift & 1 == child & 1 && r.cell[1] >> shift & 1 == child >> 1;
                below.push([0, 1].map(|k| node[k].iter().copied().filter(|&i| inside(&kinds[k][i])).collect()));
            }
        }
        level = below;
    }
    (split, ranks)
}

/// The pair number `index` under `seed`; `scene` is index / 50.
pub fn tree_sample(settings: &Settings, seed: u64, index: u32) -> TreeSample {
    let mut random = Random::new(seed, 0, u64::from(index));
    let truth = lobes(&mut random);
    let [low, high] = settings.samples.map(|n| f64::from(n.max(1)).ln());
    let count = (low + (high - low) * random.next_f64()).exp() as u32;
    let photon_count = if random.next_f32() < 0.2 { 0 } else { 1 + random.below(count.max(1)) };
    // Path samples come from uniform directions and carry the noise of the rest of the path; half of them find no light.
    let path: Vec<Record> = (0..count)
        .map(|_| {
            let w = uniform_direction(&mut random);
            let noise = if random.next_f32() < 0.5 { 0.0 } else { -2.0 * random.next_f64().max(1e-9).ln() };
            record((radiance(&truth, w) * noise).powi(2) * 4.0 * PI, w)
        })
        .collect();
    let photons: Vec<Record> =
        (0..photon_count).map(|_| record(0.5 + random.next_f64(), sample_radiance(&truth, &mut random))).collect();
    let (input_split, ranks) = build([&path, &photons], settings.split_share);
    let leaves = input_split.iter().filter(|s| !**s).count();
    let mut own_sums = vec![0.0; leaves * NETWORK_CHANNELS];
    for (kind, records) in [&path, &photons].into_iter().enumerate() {
        for (r, &rank) in records.iter().zip(&ranks[kind]) {
            let row = &mut own_sums[rank * NETWORK_CHANNELS..][..NETWORK_CHANNELS];
            row[VALUES[kind]] += r.value as f32;
            row[COUNTS[kind]] += 1.0;
            row[SQUARES[kind]] += (r.value * r.value) as f32;
            row[BSDF] += if kind == 0 { 1.0 } else { 0.0 };
        }
    }
    let (target_split, target, target_bsdf, floor_kl) = converged(settings, &truth, &mut random);
    // Without a scene there is no context: the counted tree is the own one.
    let own = Topology::from_split(&input_split).unwrap_or_else(|_| Topology::root());
    let leaves = Leaves { topology: &own, sums: &own_sums, layout: Layout::Network, target: Target::Variance };
    let counted = leaves.hybrid(0.5);
    TreeSample {
        scene: index / 50,
        family: index % 4,
        bounds: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
        counted_split: counted.topology().split_flags(),
        counted: counted.leaf_mass().into_iter().map(|m| m as f32).collect(),
        own_split: input_split,
        own_sums,
        voxel_features: VoxelFeatures { samples: [count, photon_count], ..VoxelFeatures::default() },
        target_split,
        target,
        target_bsdf,
        target_samples: u64::from(settings.target_samples),
        floor_kl,
        ..TreeSample::default()
    }
}

/// The target tree from many samples: flags, leaf masses, masses of a uniform BSDF, and the KL between its two halves.
fn converged(settings: &Settings, truth: &[Lobe], random: &mut Random) -> (Vec<bool>, Vec<f32>, Vec<f32>, f32) {
    let records: Vec<Record> = (0..settings.target_samples)
        .map(|_| {
            let w = sample_radiance(truth, random);
            record(radiance(truth, w), w)
        })
        .collect();
    let (split, [ranks, _]) = build([&records, &[]], settings.split_share);
    // The flags come from `build`, whose trees are complete and far below the limits; a root alone is the safe fallback.
    let tree = Topology::from_split(&split).unwrap_or_else(|_| Topology::root());
    let level: Vec<usize> =
        (0..tree.levels()).flat_map(|l| tree.level(l).filter(|&n| tree.is_leaf(n)).map(move |_| l)).collect();
    let half = |keep: &dyn Fn(usize) -> bool| {
        let mut sums = vec![0.0; level.len()];
        records.iter().enumerate().filter(|(i, _)| keep(*i)).for_each(|(i, r)| sums[ranks[i]] += r.value);
        let weights: Vec<f64> =
            sums.iter().zip(&level).map(|(&s, &l)| Target::Variance.weight(s, solid_angle(l))).collect();
        Distribution::from_leaf_weights(tree.clone(), &weights)
    };
    let floor = kl(&half(&|i| i % 2 == 0), &half(&|i| i % 2 == 1), 1e-3);
    let target = half(&|_| true).leaf_mass().into_iter().map(|m| m as f32).collect();
    let uniform = level.iter().map(|&l| 0.25f32.powi(l as i32)).collect();
    (tree.split_flags(), target, uniform, floor as f32)
}

/// `count` pairs from `first` on.
pub fn tree_samples(settings: &Settings, seed: u64, first: u32, count: u32) -> Vec<TreeSample> {
    use rayon::prelude::*;
    (first..first + count).into_par_iter().map(|i| tree_sample(settings, seed, i)).collect()
}
