//! What a query of a mixture of von Mises-Fisher lobes costs, in nanoseconds.
//!
//!     cargo bench --bench mixtures
//!
//! The mixtures are those of four kinds of light that Open PGL was given too (`tests/support/open_pgl/make.py` prints its times: to aim a
//! mixture at a place, then for a density or a sample there). Ours are aimed within each query.

use std::hint::black_box;
use std::time::Instant;

use fanal::guiding::vmf::mixture::Spot;
use glam::Vec3;

#[path = "../support/open_pgl.rs"]
#[allow(dead_code, reason = "the truth and what Open PGL found are not compared here")]
mod known;

/// Queries of each measurement, and measurements in turn, of which the median counts.
const QUERIES: usize = 400_000;
const TURNS: usize = 7;

fn main() {
    println!("{:>5} {:>6} {:>12} {:>12}", "kind", "lobes", "density ns", "sample ns");
    for (number, kind) in known::kinds().iter().enumerate() {
        let directions = &kind.places[0].directions;
        let spot = |query: usize| Spot { point: 0.1 * directions[query % directions.len()], normal: Vec3::ZERO };
        let time = |query: &dyn Fn(usize)| {
            let mut turns: Vec<f64> = (0..TURNS)
                .map(|_| {
                    let begun = Instant::now();
                    (0..QUERIES).for_each(query);
                    begun.elapsed().as_secs_f64() * 1e9 / QUERIES as f64
                })
                .collect();
            turns.sort_by(f64::total_cmp);
            turns[TURNS / 2]
        };
        let density = time(&|query| {
            black_box(kind.mixture.pdf(directions[query % directions.len()], &spot(query)));
        });
        let sample = time(&|query| {
            let u = [query as f64 / QUERIES as f64, (query * 7 % QUERIES) as f64 / QUERIES as f64];
            black_box(kind.mixture.sample(u, &spot(query)));
        });
        println!("{number:>5} {:>6} {density:>12.0} {sample:>12.0}", kind.mixture.len());
    }
}
