//! The embedded backend against a plain interpreter in f64, and its answers to hostile weights and inputs.

use crate::support::network as support;

use std::collections::HashMap;

use fanal::base::{Error, Result};
use fanal::network::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use fanal::network::embedded::Embedded;
use fanal::network::program::{GEOMETRY, Op, Program, decode_program, encode_program};
use fanal::network::weights::Model;
use fanal::reconstruct::buckets::Buckets;
use fanal::reconstruct::neural::reconstruct_batch;
use fanal::reconstruct::{Neural, Reconstructed, Reconstructor};
use support::{Tree, assert_close, config, forward, model, trees};

/// Executes programs operation by operation in f64, as their documentation reads.
struct Reference(Model);

type Rows = Vec<Vec<f64>>;

impl Reference {
    fn layer(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let layer = &self.0.weights.layers[name];
        let column = |c: usize| {
            let product = |(row, x): (usize, &f64)| x * f64::from(layer.weight[row * layer.columns + c]);
            f64::from(layer.bias[c]) + x.iter().enumerate().map(product).sum::<f64>()
        };
        (0..layer.columns).map(column).collect()
    }

    fn run(&self, p: &Program, floats: &[(&str, &[f32])], indices: &[(&str, &[u32])]) -> Vec<Vec<f32>> {
        let floats: HashMap<_, _> = floats.iter().copied().collect();
        let indices: HashMap<_, _> = indices.iter().copied().collect();
        let mut values: Vec<Rows> = vec![];
        for (op, &columns) in p.ops.iter().zip(&p.columns) {
            let rows = self.operation(op, columns, &values, &floats, &indices);
            values.push(rows);
        }
        let flat = |v: usize| values[v].iter().flatten().map(|&x| x as f32).collect();
        p.outputs.iter().map(|&(_, v)| flat(v)).collect()
    }

    fn operation(
        &self,
        op: &Op,
        columns: usize,
        values: &[Rows],
        floats: &HashMap<&str, &[f32]>,
        indices: &HashMap<&str, &[u32]>,
    ) -> Rows {
        let map = |v: usize, f: &dyn Fn(f64) -> f64| -> Rows {
            values[v].iter().map(|row| row.iter().map(|&x| f(x)).collect()).collect()
        };
        match op {
            Op::Input(name) => {
                floats[name].chunks(columns).map(|row| row.iter().map(|&x| f64::from(x)).collect()).collect()
            }
            Op::Concat(parts) => (0..values[parts[0]].len())
                .map(|row| parts.iter().flat_map(|&v| values[v][row].iter().copied()).collect())
                .collect(),
            Op::Select { x, index } => indices[index].iter().map(|&row| values[*x][row as usize].clone()).collect(),
            Op::Linear { x, layer } => values[*x].iter().map(|row| self.layer(layer, row)).collect(),
            Op::GatherLinear { x, layer } => {
                let zero = vec![0.0; columns];
                let row = |&r: &u32| values[*x].get(r as usize).unwrap_or(&zero).clone();
                let nine = |slots: &[u32]| slots.iter().flat_map(row).collect::<Vec<f64>>();
                indices["neighbours"].chunks(9).map(|slots| self.layer(layer, &nine(slots))).collect()
            }
            Op::Add(a, b) => {
                let sum = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a + b).collect();
                values[*a].iter().zip(&values[*b]).map(sum).collect()
            }
            Op::Relu(x) => map(*x, &|x| x.max(0.0)),
            Op::Sigmoid(x) => map(*x, &|x| 1.0 / (1.0 + (-x).exp())),
            Op::SoftmaxSiblings(x) => (values[*x].chunks(4))
                .flat_map(|group| {
                    let max = group.iter().map(|row| row[0]).fold(f64::NEG_INFINITY, f64::max);
                    let sum: f64 = group.iter().map(|row| (row[0] - max).exp()).sum();
                    group.iter().map(move |row| vec![(row[0] - max).exp() / sum])
                })
                .collect(),
        }
    }
}

impl Backend for Reference {
    fn name(&self) -> &'static str {
        "reference"
    }

    fn encode(&self, level: usize, i: &EncodeInputs) -> Result<Vec<f32>> {
        let floats = [("features", i.features), ("pooled", i.pooled)];
        Ok(self.run(&encode_program(&self.0.config, level), &floats, &[("neighbours", i.neighbours)]).remove(0))
    }

    fn decode(&self, level: usize, i: &DecodeInputs) -> Result<DecodeOutput> {
        let floats = [("parents", i.parents), ("skip", i.skip), ("geometry", i.geometry), ("base", i.base)];
        let indices = [("parent_index", i.parent_index), ("neighbours", i.neighbours)];
        let outputs = self.run(&decode_program(&self.0.config, level), &floats, &indices);
        let [decoded, share_logit, share, leaf_logit, leaf] = outputs.try_into().expect("five outputs");
        Ok(DecodeOutput { decoded, share_logit, share, leaf_logit, leaf })
    }
}

#[test]
fn embedded_agrees_with_the_reference() {
    for (width, convolutions, per_level) in
        [(16, 2, false), (8, 1, true), (24, 1, false), (32, 1, false), (48, 4, false), (64, 1, false)]
    {
        let model = model(config(width, convolutions, per_level), 5);
        let trees = if width == 16 {
            trees()
        } else {
            trees().into_iter().skip(1).filter(|t| t.counted.topology().len() < 500).take(6).collect()
        };
        let found = forward(&model, &Embedded::new(&model).unwrap(), &trees);
        assert!(found.iter().any(|(name, values)| name == "share 20" && values.len() >= 4));
        assert_close(&found, &forward(&model, &Reference(model.clone()), &trees), 1e-4);
    }
}

/// Each tree alone gives what it gives among others: nothing leaks between trees.
#[test]
fn trees_of_a_batch_are_independent() {
    let model = model(config(16, 2, false), 6);
    let backend = Embedded::new(&model).unwrap();
    let trees = trees();
    let together = reconstruct(&model, &backend, &trees);
    for (tree, expected) in trees.iter().zip(together) {
        assert_eq!(reconstruct(&model, &backend, std::slice::from_ref(tree)), [expected]);
    }
}

/// Of several networks every tree gets the one for its number of samples, paths and photons together, and what that gives alone.
#[test]
fn trees_get_the_network_of_their_samples() {
    let folder = tempfile::tempdir().unwrap();
    let list = r#"{"version": 1, "networks": [{"folder": "few", "end": 100}, {"folder": "more", "end": 500}, {"folder": "many"}]}"#;
    std::fs::write(folder.path().join("networks.json"), list).unwrap();
    let names = ["few", "more", "many"];
    for (seed, name) in (1..).zip(names) {
        model(config(8, 1, false), seed).save(&folder.path().join(name)).unwrap();
    }
    let all = Buckets::load(folder.path(), Neural::embedded).unwrap();
    let alone = names.map(|name| Neural::embedded(&folder.path().join(name)).unwrap());
    let mut trees = trees();
    let counts = [[0, 0], [99, 0], [60, 40], [499, 0], [0, 500], [u32::MAX, 7]];
    let of = [0, 0, 1, 1, 2, 2];
    for (tree, samples) in trees.iter_mut().zip(counts.into_iter().cycle()) {
        tree.voxel_features.samples = samples;
    }
    let inputs: Vec<_> = trees.iter().map(Tree::input).collect();
    let made = all.reconstruct(&inputs).unwrap();
    assert_eq!(made.len(), inputs.len());
    let mut differ = 0;
    for ((input, made), network) in inputs.iter().zip(&made).zip(of.into_iter().cycle()) {
        let mut by = alone.each_ref().map(|one| one.reconstruct(std::slice::from_ref(input)).unwrap().remove(0));
        assert_eq!(made.first, by[network].first);
        by.rotate_left(network);
        differ += usize::from(by[0].first != by[1].first);
    }
    assert!(differ > 10, "the networks do not differ");
    // A folder of one model is one for all.
    let one = Buckets::load(&folder.path().join("few"), Neural::embedded).unwrap();
    assert_eq!(one.networks().count(), 1);
}

fn reconstruct(model: &Model, backend: &dyn Backend, trees: &[Tree]) -> Vec<Reconstructed> {
    let inputs: Vec<_> = trees.iter().map(Tree::input).collect();
    let reconstructed = reconstruct_batch(model, backend, &inputs).unwrap();
    for tree in &reconstructed {
        assert_eq!(tree.node_share.len(), tree.topology.len());
        assert_eq!(tree.node_share[0], 1.0);
        for siblings in tree.node_share[1..].chunks(4) {
            assert!(siblings.iter().all(|&s| s >= 0.0), "{siblings:?}");
            assert!((siblings.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{siblings:?}");
        }
    }
    reconstructed
}

#[test]
fn bits_do_not_depend_on_threads() {
    let model = model(config(16, 2, false), 7);
    let backend = Embedded::new(&model).unwrap();
    let trees: Vec<Tree> = (0..20).flat_map(|_| trees()).collect();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reconstruct(&model, &backend, &trees))
    };
    let one = with(1);
    assert!(one.iter().any(|tree| tree.topology.len() > 100));
    assert!(one == with(2) && one == with(7));
}

#[test]
fn a17_extreme_weights_still_give_distributions() {
    let trees = trees();
    for scale in [0.0, 1e4, 1e38] {
        let mut model = model(config(16, 1, false), 8);
        for layer in ["decode.share", "decode.leaf"] {
            let layer = model.weights.layers.get_mut(layer).unwrap();
            layer.weight.iter_mut().for_each(|w| *w *= scale);
        }
        let backend = Embedded::new(&model).unwrap();
        reconstruct(&model, &backend, &trees);
        if scale < 1e30 {
            let outputs = forward(&model, &backend, &trees);
            assert!(outputs.iter().all(|(_, values)| values.iter().all(|x| x.is_finite())));
        }
    }
}

#[test]
fn a17_empty_inputs_are_fine_and_wrong_ones_are_refused() {
    let model = model(config(16, 1, false), 9);
    let backend = Embedded::new(&model).unwrap();
    assert!(reconstruct_batch(&model, &backend, &[]).unwrap().is_empty());
    let none = EncodeInputs { rows: 0, features: &[], pooled: &[], neighbours: &[] };
    assert!(backend.encode(3, &none).unwrap().is_empty());
    // A level where nothing was split, below parents or below none.
    let parents = [0.5; 2 * 16];
    let nothing =
        DecodeInputs { rows: 0, parents: &[], parent_index: &[], skip: &[], geometry: &[], base: &[], neighbours: &[] };
    for parents in [&parents[..], &[]] {
        assert_eq!(backend.decode(3, &DecodeInputs { parents, ..nothing }).unwrap(), DecodeOutput::default());
    }
    let two = DecodeInputs {
        rows: 2,
        parents: &parents,
        parent_index: &[0, 1],
        skip: &[0.0; 2 * 16],
        geometry: &[0.0; 2 * GEOMETRY],
        base: &[0.0; 2],
        neighbours: &[2; 2 * 9],
    };
    assert!(matches!(backend.decode(3, &two), Err(Error::Backend { .. })), "no group of four siblings");
    let features = vec![0.0; model.config.features];
    let good = EncodeInputs { rows: 1, features: &features, pooled: &[0.0; 16], neighbours: &[1; 9] };
    assert!(backend.encode(0, &good).is_ok());
    let wrong = [
        EncodeInputs { rows: 2, ..good },
        EncodeInputs { neighbours: &[2; 9], ..good },
        EncodeInputs { neighbours: &[0; 8], ..good },
        EncodeInputs { pooled: &[0.0; 15], ..good },
    ];
    for inputs in wrong {
        assert!(matches!(backend.encode(0, &inputs), Err(Error::Backend { .. })), "{inputs:?}");
    }
    assert!(backend.encode(21, &good).is_err());
    // Sums that are missing count as none.
    let tree = &trees()[1];
    let short = Tree { sums: tree.sums[1..].to_vec(), ..tree.clone() };
    assert!(reconstruct_batch(&model, &backend, &[short.input()]).is_ok());
}
