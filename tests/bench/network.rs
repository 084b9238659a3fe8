//! Speed of the embedded backend's convolution, and of a whole reconstruction with what comes before and after it, on one core.
//!
//!     cargo bench --bench network [-- reconstruction]

#[path = "../support/network.rs"]
#[allow(dead_code, reason = "trees alone are needed")]
mod network;

use std::hint::black_box;
use std::time::Instant;

use fanal::base::random::Random;
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::proposal::{Judged, UNTOLD};
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::{MAX_NODES, Topology};
use fanal::network::batch::{Batch, SLOTS};
use fanal::network::kernels::{Epilogue, Index, Instructions, Packed, Part, apply_with};
use fanal::network::weights::LayerWeights;
use fanal::reconstruct::gaussian::Gaussian;
use fanal::reconstruct::neural::inputs_of;
use fanal::reconstruct::{Neural, Reconstructor};

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is built once");
    if std::env::args().any(|argument| argument == "reconstruction") {
        return reconstruction();
    }
    for width in [8, 16, 24, 32, 48, 64] {
        for instructions in [Instructions::Portable, Instructions::Avx2, Instructions::Avx512] {
            let (seconds, flops) = convolution(width, instructions.min(Instructions::best()));
            println!(
                "convolution, width {width:2}, {instructions:?}: {:6.2} ms, {:6.1} GFLOP/s",
                seconds * 1e3,
                flops / seconds * 1e-9
            );
        }
    }
    layout();
    reconstruction();
}

/// Microseconds per tree of each part of making a guide by the network that ships, over trees of about 400 nodes.
fn reconstruction() {
    let filled = |seed| network::filled(network::random_topology(seed, 450, 8, 0.6), seed);
    let trees: Vec<network::Tree> = (0..).map(filled).filter(|tree| tree.own.len() > 350).take(200).collect();
    let inputs: Vec<CountedTree> = trees.iter().map(network::Tree::input).collect();
    let nodes = inputs.iter().map(|input| input.counted.topology().len()).sum::<usize>();
    let per_tree = |run: &mut dyn FnMut()| best(run) * 1e6 / inputs.len() as f64;
    let neural = Neural::built_in().expect("the model is of this version");
    let made = neural.reconstruct(&inputs).expect("the trees have all features");
    let smoothed = per_tree(&mut || drop(black_box(Gaussian::default().reconstruct(&inputs))));
    let features = per_tree(&mut || inputs.iter().for_each(|input| drop(black_box(inputs_of(input)))));
    let whole = per_tree(&mut || drop(black_box(neural.reconstruct(&inputs))));
    let mixed = per_tree(&mut || made.iter().for_each(|proposal| drop(black_box(proposal.mixed(UNTOLD)))));
    let judged = per_tree(&mut || {
        made.iter().for_each(|proposal| drop(black_box(Judged::new(proposal, UNTOLD, MAX_NODES))));
    });
    let guides: Vec<_> = made.iter().map(|proposal| proposal.mixed(UNTOLD)).collect();
    let packed = per_tree(&mut || {
        guides.iter().for_each(|(of, uniform)| drop(black_box(SamplingTree::new(of, *uniform, MAX_NODES))));
    });
    println!("{} trees of {} nodes, microseconds each:", inputs.len(), nodes / inputs.len());
    println!(
        "  smoothed {smoothed:.1}, smoothed and made features {features:.1}, reconstructed by the network {whole:.1}"
    );
    println!("  both mixed {mixed:.1}, both packed to be judged {judged:.1}, the mixture packed {packed:.1}");
}

/// Best time of several runs over 100 trees of 1,024 nodes at one level, all neighbours present, and its operations.
fn convolution(width: usize, instructions: Instructions) -> (f64, f64) {
    let rows = 102_400;
    let mut random = Random::new(1, 0, 0);
    let mut uniform = |n: usize| (0..n).map(|_| random.range(-1.0, 1.0)).collect::<Vec<f32>>();
    let x = uniform(rows * width);
    let weight = uniform(9 * width * width);
    let layer = LayerWeights { rows: 9 * width, columns: width, weight, bias: uniform(width) };
    let packed = Packed::new(&layer);
    // Near rows, as in a tree: neighbours are mostly within the same tree's few hundred rows.
    let index: Vec<u32> =
        (0..rows * SLOTS).map(|i| ((i / SLOTS + (i % SLOTS) * 37) % 1024 + i / SLOTS / 1024 * 1024) as u32).collect();
    let parts: Vec<Part> = (0..SLOTS)
        .map(|offset| Part { x: &x, channels: width, index: Index::Gather { index: &index, stride: SLOTS, offset } })
        .collect();
    let epilogue = Epilogue { residual: Some(&x), relu: true };
    let seconds = best(|| drop(black_box(apply_with(instructions, &packed, &parts, epilogue, rows))));
    (seconds, 2.0 * (rows * 9 * width * width) as f64)
}

fn layout() {
    let mut flags = vec![true; 341];
    flags.extend(vec![false; 1024]);
    let tree = Topology::from_split(&flags).expect("the flags describe a full tree");
    let trees = vec![&tree; 100];
    let seconds = best(|| drop(black_box(Batch::new(&trees))));
    println!("layout of 100 trees of 1,365 nodes: {:.2} ms", seconds * 1e3);
}

fn best(mut run: impl FnMut()) -> f64 {
    let time = |run: &mut dyn FnMut()| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..20).map(|_| time(&mut run)).fold(f64::INFINITY, f64::min)
}
