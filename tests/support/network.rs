//! Models, trees of every shape, and a forward pass over a fixed structure, for tests that compare backends.

use fanal::base::random::Random;
use fanal::guiding::target::Target;
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::context::Block;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::features::{FEATURES, NodeInputs, VoxelFeatures};
use fanal::guiding::tree::leaves::{BSDF, COUNTS, Layout, Leaves, NETWORK_CHANNELS, SQUARES, VALUES};
use fanal::guiding::tree::topology::{MAX_LEVEL, MAX_NODES, Topology};
use fanal::network::backend::{Backend, DecodeInputs, EncodeInputs};
use fanal::network::batch::{Batch, NONE};
use fanal::network::config::{Config, VERSION};
use fanal::network::growing::DecodeLevel;
use fanal::network::weights::{Model, Weights};
use fanal::reconstruct::neural::inputs_of;
use fanal::render::{GuideMode, RenderSettings, StopRule};

/// A valid configuration.
pub fn config(width: usize, convolutions: usize, per_level: bool) -> Config {
    let mode = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode();
    Config {
        version: VERSION,
        name: "test".into(),
        width,
        convolutions,
        features: FEATURES,
        per_level,
        image: None,
        leaf_threshold: 0.5,
        min_split_share: 1e-3,
        uniform: 0.1,
        mode,
    }
}

/// A model with random weights, the convolutions' scaled down so that activations stay of unit size over twenty levels, as
/// a trained model's do.
pub fn model(config: Config, seed: u64) -> Model {
    let mut weights = Weights::random(&config, seed);
    for (_, layer) in weights.layers.iter_mut().filter(|(name, _)| !name.ends_with(".leaf")) {
        layer.weight.iter_mut().for_each(|w| *w *= 0.3);
    }
    Model { config, weights }
}

/// A counted tree and the own samples that it was made from.
#[derive(Debug, Clone)]
pub struct Tree {
    pub counted: Distribution,
    pub own: Topology,
    pub sums: Vec<f32>,
    pub block: Block,
    pub voxel_features: VoxelFeatures,
}

impl Tree {
    /// What a reconstructor is given.
    pub fn input(&self) -> CountedTree<'_> {
        let own = Leaves { topology: &self.own, sums: &self.sums, layout: Layout::Network, target: Target::Variance };
        CountedTree {
            counted: &self.counted,
            own,
            block: &self.block,
            voxel_features: self.voxel_features,
            contribution: 1.0,
        }
    }
}

/// The tree with these own sums; where they hold nothing, equal shares.
fn with_sums(topology: Topology, sums: Vec<f32>) -> Tree {
    let leaves = Leaves { topology: &topology, sums: &sums, layout: Layout::Network, target: Target::Variance };
    let counted = if leaves.has(0) || leaves.has(1) {
        leaves.hybrid(0.5)
    } else {
        Distribution::from_shares(topology.clone(), &vec![0.25; topology.len()])
    };
    // Around it are twenty times the samples, of a coarser tree.
    let block = Block { distribution: counted.on_grid(counted.topology().levels().min(3)), samples: [1400.0, 9000.0] };
    Tree {
        counted,
        own: topology,
        sums,
        block,
        voxel_features: VoxelFeatures { samples: [50, 20], ..VoxelFeatures::default() },
    }
}

/// Sums as a few random samples per leaf would give, some leaves without photons or without anything.
pub fn filled(topology: Topology, seed: u64) -> Tree {
    let mut random = Random::new(seed, 1, 0);
    let mut sums = vec![];
    for _ in topology.leaves() {
        let mut row = [0.0; NETWORK_CHANNELS];
        for kind in [0, 1] {
            let count = random.below(5 - kind as u32) as f32;
            let value = (-8.0 * random.next_f32()).exp();
            (row[VALUES[kind]], row[COUNTS[kind]]) = (count * value, count);
            row[SQUARES[kind]] = count * value * value;
        }
        row[BSDF] = row[COUNTS[0]] * random.next_f32();
        sums.extend(row);
    }
    with_sums(topology, sums)
}

/// A tree of at most `nodes` nodes and `depth` levels below the root, each node split with `probability`.
pub fn random_topology(seed: u64, nodes: usize, depth: usize, probability: f32) -> Topology {
    let mut random = Random::new(seed, 2, 0);
    let (mut flags, mut width, mut total) = (vec![], 1, 1);
    for level in 0..=depth {
        let mut below = 0;
        for _ in 0..width {
            let split = level < depth && total + 4 <= nodes && (level == 0 || random.next_f32() < probability);
            flags.push(split);
            below += 4 * usize::from(split);
            total += 4 * usize::from(split);
        }
        width = below;
    }
    Topology::from_split(&flags).expect("the flags were counted level by level")
}

/// A tree that is split at one node per level, down to the deepest.
pub fn chain() -> Topology {
    let flags = (0..=4 * MAX_LEVEL).map(|i| i == 0 || (i % 4 == 2 && i < 4 * MAX_LEVEL - 3)).collect::<Vec<_>>();
    Topology::from_split(&flags).expect("one split per level")
}

/// One node; twenty levels; as many nodes as allowed; no samples; some usual ones.
pub fn trees() -> Vec<Tree> {
    let empty = random_topology(9, 200, 6, 0.6);
    let no_samples = vec![0.0; empty.leaves().count() * NETWORK_CHANNELS];
    let mut trees = vec![
        filled(Topology::root(), 1),
        filled(chain(), 2),
        filled(random_topology(3, MAX_NODES, MAX_LEVEL, 0.55), 3),
        with_sums(empty, no_samples),
    ];
    trees.extend((10..30).map(|seed| filled(random_topology(seed, 400, 9, 0.6), seed)));
    trees
}

/// Every output of every step over `trees` together, on a fixed structure: the trees' own, and a little beyond.
pub fn forward(model: &Model, backend: &dyn Backend, trees: &[Tree]) -> Vec<(String, Vec<f32>)> {
    let width = model.config.width;
    let topologies: Vec<&Topology> = trees.iter().map(|tree| tree.counted.topology()).collect();
    let batch = Batch::new(&topologies);
    let nodes: Vec<NodeInputs> = trees.iter().map(|tree| inputs_of(&tree.input())).collect();
    let features: Vec<f32> = nodes.iter().flat_map(|n| &n.features).copied().collect();
    let log_shares: Vec<_> = nodes.iter().flat_map(|n| &n.log_shares).copied().collect();
    let base: Vec<f32> = nodes.iter().flat_map(|n| &n.base).copied().collect();
    let mut encoded = vec![vec![]; batch.levels.len() + 1];
    for level in (0..batch.levels.len()).rev() {
        let inputs = EncodeInputs {
            rows: batch.len(level),
            features: &batch.gather(level, &features, FEATURES),
            pooled: &batch.pool(level, &encoded[level + 1], width),
            neighbours: &batch.levels[level].rows.neighbours,
        };
        encoded[level] = backend.encode(level, &inputs).expect("the inputs fit");
    }
    let mut outputs: Vec<_> = (encoded.iter().enumerate()).map(|(l, e)| (format!("encoded {l}"), e.clone())).collect();
    let mut above = DecodeLevel::roots(&batch);
    let mut parents = encoded[0].clone();
    loop {
        let split: Vec<bool> = (above.skip.iter().enumerate())
            .map(|(row, &skip)| match skip {
                NONE => false,
                skip => batch.levels[above.level].rows.first_child[skip as usize] != NONE || row % 7 == 0,
            })
            .collect();
        let level = above.grow(&batch, &split);
        if level.rows.is_empty() {
            return outputs;
        }
        let none = vec![];
        let inputs = DecodeInputs {
            rows: level.rows.len(),
            parents: &parents,
            parent_index: &level.rows.parent,
            skip: &level.skip_rows(encoded.get(level.level).unwrap_or(&none), width),
            geometry: &level.geometry(&log_shares),
            base: &level.base(&base),
            neighbours: &level.rows.neighbours,
        };
        let output = backend.decode(level.level, &inputs).expect("the inputs fit");
        let named = [
            ("share_logit", output.share_logit),
            ("share", output.share),
            ("leaf_logit", output.leaf_logit),
            ("leaf", output.leaf),
            ("decoded", output.decoded.clone()),
        ];
        outputs.extend(named.map(|(name, values)| (format!("{name} {}", level.level), values)));
        parents = output.decoded;
        above = level;
    }
}

/// Fails unless every value of `found` is within `tolerance` of `expected`, relative to itself plus its tensor's size.
pub fn assert_close(found: &[(String, Vec<f32>)], expected: &[(String, Vec<f32>)], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for ((name, found), (other, expected)) in found.iter().zip(expected) {
        assert_eq!((name, found.len()), (other, expected.len()));
        let squares: f64 = expected.iter().map(|&x| f64::from(x).powi(2)).sum();
        let size = (squares / expected.len().max(1) as f64).sqrt();
        for (i, (&a, &b)) in found.iter().zip(expected).enumerate() {
            let (a, b) = (f64::from(a), f64::from(b));
            assert!((a - b).abs() <= tolerance * (b.abs() + size), "{name}, value {i}: {a} instead of {b}");
        }
    }
}
