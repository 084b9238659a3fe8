//! What mixtures of Gaussians learn of samples whose truth is known. Seeds are fixed; tolerances are five standard errors and more, so that
//! another seed fails once in a million.

use super::MOST;
use super::fit::{Arrived, LearnedMixture};
use super::gaussian::{Gaussian, LEAST_DEVIATION, MOST_DEVIATION, MOST_SLOPE};
use super::mixture::GaussianMixture;
use crate::base::random::Random;
use crate::guiding::model::Directions;
use crate::math::cylindrical;

fn gaussian(weight: f32, mean: [f32; 2], deviation: f32, slope: f32, residual: f32) -> Gaussian {
    Gaussian { weight, mean, deviation, slope, residual }
}

/// One of them slanted, one over the edge at which φ begins anew, one cut at a pole.
fn three() -> [Gaussian; 3] {
    [
        gaussian(0.5, [0.4, 0.5], 0.05, 1.5, 0.02),
        gaussian(0.3, [0.7, 0.99], 0.02, 0.0, 0.06),
        gaussian(0.2, [0.98, 0.3], 0.03, 0.0, 0.1),
    ]
}

fn drawn(truth: &[Gaussian], random: &mut Random) -> [f64; 2] {
    let mut left = random.next_f32();
    let chosen = truth.iter().find(|of| {
        left -= of.weight;
        left < 0.0
    });
    chosen.unwrap_or(&truth[0]).sample(random.next_2d_f64())
}

fn samples(truth: &[Gaussian], number: usize, seed: u64) -> Vec<Arrived> {
    let mut random = Random::new(seed, 0, 0);
    (0..number).map(|_| Arrived { place: drawn(truth, &mut random), value: 3.0 }).collect()
}

/// Kullback-Leibler divergence of `found` from the truth, by samples.
fn divergence(truth: &[Gaussian], found: &GaussianMixture) -> f64 {
    let right = GaussianMixture::new(truth).expect("these are Gaussians");
    let all = samples(truth, 20_000, 99);
    let pdf = |of: &GaussianMixture, place| f64::from(of.pdf(cylindrical::to_direction(place)));
    all.iter().map(|of| (pdf(&right, of.place) / pdf(found, of.place)).ln()).sum::<f64>() / all.len() as f64
}

fn learned(chunks: &[Vec<Arrived>]) -> GaussianMixture {
    let mut learned = LearnedMixture::default();
    chunks.iter().for_each(|chunk| learned.learn([chunk, &[]]));
    learned.frozen().expect("light has arrived")
}

/// A density of mixtures of all widths has the mass 1, cells of the square being integrated by their centres.
#[test]
fn densities_have_the_mass_one() {
    let mut random = Random::new(1, 0, 0);
    for round in 0..40 {
        let count = 1 + round % MOST;
        let gaussian = |_| Gaussian {
            weight: 1.0 / count as f32,
            mean: random.next_2d(),
            deviation: random.range(0.01, 0.5),
            slope: random.range(-3.0, 3.0),
            residual: random.range(0.01, 0.5),
        };
        let mixture = GaussianMixture::new(&(0..count).map(gaussian).collect::<Vec<_>>()).expect("these are Gaussians");
        let mass = Directions::from(mixture).map(512).iter().sum::<f64>() / 512.0 / 512.0;
        assert!((mass - 1.0).abs() < 2e-4, "round {round}: {mass}");
    }
}

/// Weights, means and covariances are found of samples that arrive chunk by chunk: at the truth the divergence is 0.
#[test]
fn a_known_mixture_is_recovered() {
    let truth = three();
    let chunks: Vec<_> = (0..8).map(|chunk| samples(&truth, 4000, 10 + chunk)).collect();
    let found = learned(&chunks);
    let off = divergence(&truth, &found);
    assert!(off < 0.03, "{off}: {:?}", found.gaussians());
    // Less of them tell less.
    let few = divergence(&truth, &learned(&[samples(&truth, 100, 10)]));
    assert!(few > 2.0 * off && few < 0.6, "{few}");
}

/// Drawn with another density, weighted samples tell the same mixture.
#[test]
fn weights_make_up_for_densities() {
    let truth = three();
    let right = GaussianMixture::new(&truth).expect("these are Gaussians");
    let mut random = Random::new(3, 0, 0);
    let mut weighted = |_| {
        let place = random.next_2d_f64();
        Arrived { place, value: f64::from(right.pdf(cylindrical::to_direction(place))) }
    };
    let all: Vec<Arrived> = (0..40_000).map(&mut weighted).collect();
    let off = divergence(&truth, &learned(&[all]));
    assert!(off < 0.08, "{off}");
}

/// Path samples and photons count by half each, whatever their numbers and units.
#[test]
fn either_kind_of_samples_counts_by_half() {
    let [a, b] = [gaussian(1.0, [0.3, 0.2], 0.03, 0.0, 0.03), gaussian(1.0, [0.7, 0.6], 0.03, 0.0, 0.03)];
    let photons: Vec<Arrived> =
        samples(&[b], 500, 5).iter().map(|of| Arrived { value: 1e-6 * of.value, ..*of }).collect();
    let mut learned = LearnedMixture::default();
    learned.learn([&samples(&[a], 4000, 4), &photons]);
    let found = learned.frozen().expect("light has arrived");
    let near: f32 = found.gaussians().iter().filter(|of| of.mean[0] < 0.5).map(|of| of.weight).sum();
    assert!((near - 0.5).abs() < 0.03, "{near} of the weight: {:?}", found.gaussians());
}

/// Light from where no Gaussian looks moves one there.
#[test]
fn lost_samples_move_a_gaussian() {
    let narrow = [gaussian(1.0, [0.2, 0.2], 0.004, 0.0, 0.004)];
    let other = [gaussian(1.0, [0.8, 0.7], 0.004, 0.0, 0.004)];
    let chunks = [samples(&narrow, 4000, 6), samples(&other, 4000, 7)];
    let found = learned(&chunks);
    let there: f32 = found.gaussians().iter().filter(|of| of.mean[0] > 0.5).map(|of| of.weight).sum();
    // Of 8000 samples the last 4000 count by ∏ (1 − i^−0.7) more: all but e^−(Σ i^−0.7) of the weight.
    assert!(there > 0.95, "{there}: {:?}", found.gaussians());
}

/// What few samples, or one that outweighs all, tell is bounded, and all that is learned is finite.
#[test]
fn few_samples_make_no_spike() {
    let at = |place: [f64; 2], value: f64| Arrived { place, value };
    let cases: [(&str, Vec<Arrived>, f64); 7] = [
        ("one", vec![at([0.5, 0.5], 1.0)], 0.01),
        ("two alike", vec![at([0.5, 0.5], 1.0); 2], 0.01),
        ("huge among many", [vec![at([0.5, 0.5], 1e38)], samples(&three(), 500, 8)].concat(), 0.01),
        ("smallest numbers", vec![at([0.5, 0.5], 5e-324), at([0.0, 1.0 - 1e-16], 1e300)], 0.0),
        ("dark", vec![at([0.5, 0.5], 0.0), at([0.5, 0.5], f64::NAN), at([0.5, 0.5], -1.0)], -1.0),
        ("at an edge", vec![at([0.0, 0.0], 1.0), at([0.0, 1.0 - 1e-16], 1.0)], 0.01),
        ("a thousand in one point", vec![at([0.5, 0.5], 1.0); 1000], 0.0),
    ];
    for (name, all, least) in cases {
        let mut learned = LearnedMixture::default();
        for _ in 0..3 {
            learned.learn([&all, &all]);
            learned.decay(0.5);
        }
        let Some(found) = learned.frozen() else {
            assert!(least < 0.0, "{name}: nothing was learned");
            continue;
        };
        for of in found.gaussians() {
            let least = least.max(0.999 * LEAST_DEVIATION) as f32;
            assert!(of.is_sound() && of.deviation >= least && of.residual >= least, "{name}: {of:?}");
        }
        let mut random = Random::new(8, 0, 0);
        for _ in 0..100 {
            let (direction, pdf) = found.sample(random.next_2d_f64());
            assert!(direction.is_normalized() && pdf.is_finite() && pdf > 0.0, "{name}: {direction} {pdf}");
            assert_eq!(found.pdf(direction), pdf, "{name}");
        }
    }
}

/// The unit of radiance changes nothing: what decides is relative to the mean.
#[test]
fn the_unit_of_light_changes_nothing() {
    let all = samples(&three(), 3000, 12);
    let scaled =
        |factor: f64| -> Vec<Arrived> { all.iter().map(|of| Arrived { value: factor * of.value, ..*of }).collect() };
    let [one, large, small] = [0, 66, -66].map(|power| learned(&[scaled(2f64.powi(power))]));
    assert!(one == large && one == small);
}

/// A mixture goes on from its numbers as it would have; numbers that are none are refused.
#[test]
fn numbers_of_a_file_are_the_mixture() {
    let mut learned = LearnedMixture::default();
    learned.learn([&samples(&three(), 1500, 1), &samples(&three(), 700, 2)]);
    learned.decay(0.5);
    let (own, components) = learned.numbers();
    let mut again = LearnedMixture::from_numbers(&own, &components).expect("they were written just now");
    assert_eq!(again, learned);
    for of in [&mut learned, &mut again] {
        of.decay(0.3);
        of.learn([&samples(&three(), 900, 3), &[]]);
    }
    assert_eq!(again, learned);
    let places = [(0, f64::NAN), (0, -0.1), (0, 0.9), (1, 1.5), (2, -1.0), (3, 0.0), (3, 2.0), (4, 1.0), (5, -1.0)];
    for (place, bad) in [places.as_slice(), &[(6, -1.0), (9, f64::INFINITY)]].concat() {
        let mut hostile = components.clone();
        hostile[2][place] = bad;
        assert_eq!(LearnedMixture::from_numbers(&own, &hostile), None, "{bad} in place {place}");
    }
    assert_eq!(LearnedMixture::from_numbers(&[f64::NAN; 7], &components), None);
    assert_eq!(LearnedMixture::from_numbers(&own, &[components[0]; MOST + 1]), None);
}

/// Covariances are those of the Gaussian that is sampled, up to its range.
#[test]
fn covariances_become_deviations_and_slopes() {
    let of = Gaussian::new(1.0, [0.3, 1.2], [0.01, 0.006, 0.01]);
    let expected = gaussian(1.0, [0.3, 0.2], 0.1, 0.6, 0.08);
    let numbers = |of: &Gaussian| [of.weight, of.mean[0], of.mean[1], of.deviation, of.slope, of.residual];
    assert!(numbers(&of).iter().zip(numbers(&expected)).all(|(a, b)| (a - b).abs() < 1e-6), "{of:?}");
    for covariance in [[0.0, 1.0, 0.0], [1e-12, 1e-7, 1.0], [1e9; 3], [-1.0, -1.0, f64::NAN]] {
        let of = Gaussian::new(1.0, [-3.0, 7.5], covariance);
        let within = |of: f32| (0.999 * LEAST_DEVIATION..=1.001 * MOST_DEVIATION).contains(&f64::from(of));
        assert!(
            within(of.deviation) && of.is_sound() && f64::from(of.slope.abs()) <= MOST_SLOPE,
            "{covariance:?} {of:?}"
        );
    }
}
