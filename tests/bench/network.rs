//! Speed of the embedded backend's convolution and of a whole reconstruction, on one core.

use std::hint::black_box;
use std::time::Instant;

use fanal::base::random::Random;
use fanal::guiding::tree::topology::Topology;
use fanal::network::batch::{Batch, SLOTS};
use fanal::network::kernels::{Epilogue, Index, Instructions, Packed, Part, apply_with};
use fanal::network::weights::LayerWeights;

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is built once");
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
