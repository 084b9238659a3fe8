//! What single and double precision cost, and where single precision alone is wrong: the film, long sums over samples, the
//! densities of deep quadtrees.
//!
//!     cargo bench --bench precision
//!
//! Errors are against double-double sums or products of logarithms, times are medians of seven runs on one core. The choices that
//! follow from the table are stated in `film/accumulator.rs` and `guiding/tree/`.

use std::hint::black_box;
use std::time::Instant;

use fanal::base::random::Random;
use fanal::film::Pixel;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::{MAX_LEVEL, Topology};
use fanal::math::cylindrical;
use glam::Vec3;

fn main() {
    film();
    sums();
    densities();
    cells();
}

/// Radiance of a path as a picture sees it: mostly small, sometimes very large (Pareto with exponent 1.5).
fn heavy_tail(random: &mut Random) -> f32 {
    (1.0 - random.next_f32()).powf(-1.0 / 1.5).min(1e6)
}

/// A sum whose rounding is beyond doubles' (Knuth 1969, two-sum).
#[derive(Default)]
struct Exact {
    high: f64,
    low: f64,
}

impl Exact {
    fn add(&mut self, x: f64) {
        let sum = self.high + x;
        let back = sum - self.high;
        self.low += (self.high - (sum - back)) + (x - back);
        self.high = sum;
    }

    fn value(&self) -> f64 {
        self.high + self.low
    }
}

/// Running mean and variance in single precision, otherwise as the film's.
#[derive(Default, Clone, Copy)]
struct Single {
    mean: [f32; 3],
    spread: [f32; 3],
    count: u32,
}

impl Single {
    fn add(&mut self, value: Vec3) {
        self.count += 1;
        let n = self.count as f32;
        for (channel, value) in value.to_array().into_iter().enumerate() {
            let before = value - self.mean[channel];
            self.mean[channel] += before / n;
            self.spread[channel] += before * (value - self.mean[channel]);
        }
    }
}

fn film() {
    println!("film: one pixel of heavy-tailed samples around a level; relative errors of mean and variance");
    println!(
        "{:>10} {:>8} {:>12} {:>12} {:>12} {:>12}",
        "samples", "level", "f32 mean", "f32 var", "f64 mean", "f64 var"
    );
    for level in [0.0f32, 1000.0] {
        for n in [1u32 << 10, 1 << 16, 1 << 22, 1 << 26] {
            let value = |random: &mut Random| level + heavy_tail(random).min(100.0);
            let (mut single, mut double) = (Single::default(), Pixel::default());
            let (mut sum, mut random) = (Exact::default(), Random::new(1, 0, u64::from(n)));
            for _ in 0..n {
                let x = value(&mut random);
                single.add(Vec3::splat(x));
                double.add(Vec3::splat(x));
                sum.add(f64::from(x));
            }
            let mean = sum.value() / f64::from(n);
            let (mut spread, mut random) = (Exact::default(), Random::new(1, 0, u64::from(n)));
            for _ in 0..n {
                spread.add((f64::from(value(&mut random)) - mean).powi(2));
            }
            let variance = spread.value() / f64::from(n - 1);
            let single_variance = f64::from(single.spread[0]) / f64::from(n - 1);
            let double_variance = double.sample_variance().map_or(f64::NAN, |v| v[0]);
            println!(
                "{n:>10} {level:>8} {:>12.1e} {:>12.1e} {:>12.1e} {:>12.1e}",
                relative(f64::from(single.mean[0]), mean),
                relative(single_variance, variance),
                relative(double.mean()[0], mean),
                relative(double_variance, variance)
            );
        }
    }
    // A picture's worth of pixels, so that memory traffic counts as it does in a render.
    let (pixels, rounds) = (1 << 18, 8);
    let values: Vec<Vec3> = (0..pixels).map(|i| Vec3::splat(i as f32 * 1e-3)).collect();
    let mut singles = vec![Single::default(); pixels];
    let mut doubles = vec![Pixel::default(); pixels];
    let per = 1e9 / (pixels * rounds) as f64;
    let single = median(|| {
        (0..rounds).for_each(|_| singles.iter_mut().zip(&values).for_each(|(p, &v)| p.add(v)));
        black_box(&singles);
    });
    let double = median(|| {
        (0..rounds).for_each(|_| doubles.iter_mut().zip(&values).for_each(|(p, &v)| p.add(v)));
        black_box(&doubles);
    });
    println!(
        "cost: f32 {:.2} ns and {} bytes a sample's pixel, f64 {:.2} ns and {} bytes; a path takes about 1000 ns\n",
        single * per,
        size_of::<Single>(),
        double * per,
        size_of::<Pixel>()
    );
}

fn sums() {
    println!("sums over samples (a leaf's, a picture's): relative error of the total, count of the last column");
    println!("{:>10} {:>12} {:>12} {:>14} {:>14}", "samples", "f32", "f64", "f32 of f32²", "f32 count");
    for n in [1u32 << 13, 1 << 18, 1 << 23, 1 << 26] {
        let mut random = Random::new(2, 0, u64::from(n));
        let (mut single, mut double, mut squares, mut count) = (0f32, 0f64, 0f32, 0f32);
        let (mut exact, mut exact_squares) = (Exact::default(), Exact::default());
        for _ in 0..n {
            let x = heavy_tail(&mut random);
            single += x;
            double += f64::from(x);
            squares += x * x;
            count += 1.0;
            exact.add(f64::from(x));
            exact_squares.add(f64::from(x).powi(2));
        }
        println!(
            "{n:>10} {:>12.1e} {:>12.1e} {:>14.1e} {:>14.1e}",
            relative(f64::from(single), exact.value()),
            relative(double, exact.value()),
            relative(f64::from(squares), exact_squares.value()),
            relative(f64::from(count), f64::from(n))
        );
    }
    let values: Vec<f32> = (0..1 << 20).map(|i| i as f32).collect();
    // Scattered as deposits are, so that neither sum can be vectorised away.
    let at: Vec<usize> = (0..values.len()).map(|i| (i * 7919) % 4096).collect();
    let (mut single, mut double) = (vec![0f32; 4096], vec![0f64; 4096]);
    let per = 1e9 / values.len() as f64;
    let singles = median(|| {
        values.iter().zip(&at).for_each(|(&v, &i)| single[i] += v);
        black_box(&single);
    });
    let doubles = median(|| {
        values.iter().zip(&at).for_each(|(&v, &i)| double[i] += f64::from(v));
        black_box(&double);
    });
    println!("cost: f32 {:.2} ns an addition, f64 {:.2} ns; twice the memory\n", singles * per, doubles * per);
}

fn densities() {
    println!("density of a leaf as the product of the shares above it; 100,000 random trees of one branch");
    println!(
        "{:>6} {:>16} {:>16} {:>16} {:>16}",
        "level", "f32 median", "f32 worst", "f64 worst", "f32 over/underflow"
    );
    let mut random = Random::new(3, 0, 0);
    for level in [4usize, 8, 12, 16, 20] {
        let (mut single, mut double, mut lost) = (vec![], 0f64, 0u32);
        for _ in 0..100_000 {
            // From a needle (shares near 1) to a valley (shares of 1e-4).
            let steep = random.next_f32();
            let shares: Vec<f32> =
                (0..level)
                    .map(|_| {
                        if random.next_f32() < steep { random.range(0.5, 1.0) } else { 1e-4f32.powf(random.next_f32()) }
                    })
                    .collect();
            let truth: f64 = shares.iter().map(|&s| (4.0 * f64::from(s)).ln()).sum();
            let product = shares.iter().fold(1f32, |p, s| p * 4.0 * s);
            let doubled = shares.iter().fold(1f64, |p, &s| p * 4.0 * f64::from(s));
            lost += u32::from(!product.is_normal());
            if product.is_normal() {
                single.push((f64::from(product).ln() - truth).abs());
            }
            double = double.max((doubled.ln() - truth).abs());
        }
        single.sort_by(f64::total_cmp);
        println!(
            "{level:>6} {:>16.1e} {:>16.1e} {:>16.1e} {:>16}",
            single[single.len() / 2],
            single[single.len() - 1],
            double,
            lost
        );
    }
    let tree = SamplingTree::new(&branch(MAX_LEVEL), 0.1, usize::MAX);
    let mut random = Random::new(4, 0, 0);
    let directions: Vec<Vec3> = (0..1 << 16).map(|_| tree.sample(random.next_2d_f64()).0).collect();
    let per = 1e9 / directions.len() as f64;
    let ours = median(|| {
        black_box(directions.iter().map(|&d| tree.pdf(d)).sum::<f32>());
    });
    let map = median(|| {
        black_box(directions.iter().map(|&d| cylindrical::to_cell(d).into_iter().max()).max());
    });
    let single = median(|| {
        black_box(directions.iter().map(|&d| cell_single(d).into_iter().max()).max());
    });
    println!(
        "cost: density at level 20 {:.0} ns, of which the map in steps of 2⁻³² {:.0} ns; the map in f32 {:.0} ns\n",
        ours * per,
        map * per,
        single * per
    );
}

/// A tree with one branch of the given depth, somewhere on the sphere, that holds almost everything.
fn branch(depth: usize) -> Distribution {
    // Of the four nodes of each level the second goes on.
    let split: Vec<bool> =
        std::iter::once(true).chain((0..4 * depth).map(|i| i < 4 * (depth - 1) && i % 4 == (i / 4) % 4)).collect();
    let tree = Topology::from_split(&split).expect("one branch is a tree");
    let deepest = tree.len() - 4;
    let weights: Vec<f64> = tree.leaves().map(|n| if n >= deepest { 1.0 } else { 1e-3 }).collect();
    Distribution::from_leaf_weights(tree, &weights)
}

/// The cell at level 20 by single precision alone.
fn cell_single(d: Vec3) -> [u32; 2] {
    let turn = d.y.atan2(d.x) / std::f32::consts::TAU;
    let y = if turn < 0.0 { turn + 1.0 } else { turn };
    [(d.z + 1.0) * 0.5, y].map(|c| ((c * cylindrical::CELLS as f32) as u32).min(cylindrical::CELLS - 1))
}

fn cells() {
    println!("directions (three f32) drawn in a cell whose density is then looked up in another: part of the samples");
    println!("{:>6} {:>16} {:>16}", "level", "looked up in steps", "looked up in f32");
    let mut random = Random::new(5, 0, 0);
    for level in [8u32, 12, 16, 18, 20] {
        let side = 1u32 << level;
        let (mut double, mut single, n) = (0u32, 0u32, 1_000_000u32);
        for _ in 0..n {
            let cell = [random.below(side), random.below(side)];
            let place = cell.map(|c| (f64::from(c) + random.next_f64()) / f64::from(side));
            let direction = cylindrical::to_direction(place);
            double += u32::from(cylindrical::to_cell(direction).map(|c| c >> (20 - level)) != cell);
            single += u32::from(cell_single(direction).map(|c| c >> (20 - level)) != cell);
        }
        println!("{level:>6} {:>16.2e} {:>16.2e}", f64::from(double) / f64::from(n), f64::from(single) / f64::from(n));
    }
}

fn relative(x: f64, truth: f64) -> f64 {
    (x / truth - 1.0).abs()
}

/// Median seconds of seven runs.
fn median(mut run: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..7)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[3]
}
