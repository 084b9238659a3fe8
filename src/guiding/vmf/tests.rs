//! What mixtures learn of samples whose truth is known. Seeds are fixed; tolerances are five standard errors and more, so that another
//! seed fails once in a million.

use glam::{DVec3, Vec3};

use super::component::Component;
use super::em::{Sample, refine};
use super::fit::{Arrived, LearnedMixture};
use super::lobe::{LEAST_KAPPA, MOST_KAPPA, around_pole, mean_cosine, peak};
use super::merge::merge;
use super::mixture::{Spot, VmfMixture};
use super::split::{measure, split};
use crate::base::random::Random;
use crate::math::{Frame, cylindrical};

/// Weight, mean direction and concentration of a lobe.
type Truth = (f64, Vec3, f64);

fn axis(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z).normalize()
}

fn drawn(truth: &[Truth], random: &mut Random) -> Vec3 {
    let mut left = random.next_f64();
    let chosen = truth.iter().find(|(weight, ..)| {
        left -= weight;
        left < 0.0
    });
    let (_, mean, kappa) = chosen.unwrap_or(&truth[0]);
    let local = around_pole(*kappa, [random.next_f64(), random.next_f64()]).as_vec3();
    Frame::new(*mean).to_world(local).normalize()
}

fn density(truth: &[Truth], direction: Vec3) -> f64 {
    let lobe = |&(weight, mean, kappa): &Truth| {
        weight * peak(kappa) * (-0.5 * kappa * f64::from((direction - mean).length_squared())).exp()
    };
    truth.iter().map(lobe).sum()
}

/// Samples that follow the truth, all of one weight.
fn samples(truth: &[Truth], number: usize, seed: u64) -> Vec<Sample> {
    let mut random = Random::new(seed, 0, 0);
    let sample = |_| {
        let direction = drawn(truth, &mut random);
        Sample { direction, weight: 1.0, pdf: density(truth, direction) as f32, nearness: 0.0 }
    };
    (0..number).map(sample).collect()
}

/// The same as they arrive from far away, all of the value 3: the mean radiance.
fn arrived(samples: &[Sample]) -> impl Iterator<Item = Arrived> + Clone {
    samples.iter().map(|&Sample { direction, pdf, .. }| Arrived {
        point: Vec3::ZERO,
        direction,
        distance: f32::INFINITY,
        value: 3.0,
        pdf,
    })
}

const THREE: fn() -> [Truth; 3] =
    || [(0.5, axis(0.2, 0.1, 1.0), 20.0), (0.3, axis(1.0, -0.3, 0.1), 200.0), (0.2, axis(-0.5, 0.8, -0.4), 2000.0)];

/// Weights, mean directions and concentrations are found from a start 20° off with the wrong width.
#[test]
fn a_known_mixture_is_recovered() {
    let (truth, number) = (THREE(), 20_000);
    let all = samples(&truth, number, 1);
    let start = |&(_, mean, _): &Truth| {
        let off = (mean.as_dvec3() + 0.36 * mean.any_orthonormal_vector().as_dvec3()).normalize();
        Component::new(1.0 / 3.0, off, mean_cosine(5.0))
    };
    let mut found: Vec<Component> = truth.iter().map(start).collect();
    // Steps end early by design.
    for _ in 0..3 {
        refine(&mut found, &all, 0.0, u32::MAX);
    }
    assert_eq!(found.len(), 3);
    for (found, (weight, mean, kappa)) in found.iter().zip(truth) {
        let own = weight * number as f64;
        let error = (weight * (1.0 - weight) / number as f64).sqrt();
        assert!((found.weight - weight).abs() < 5.0 * error + 1e-3, "weight {} of {weight}", found.weight);
        let off = found.mean.distance(mean.as_dvec3());
        assert!(off < 6.0 / (kappa * own).sqrt(), "{off} from the mean direction");
        assert!((found.kappa() / kappa - 1.0).abs() < 6.0 / own.sqrt() + 3e-3, "κ {} of {kappa}", found.kappa());
    }
}

/// The whole of learning, chunk by chunk from eight lobes all around, comes near to the truth: the KL divergence, and no lobe is lost.
#[test]
fn chunks_of_samples_make_the_mixture() {
    let truth = THREE();
    let mut learned = LearnedMixture::default();
    for chunk in 0..6 {
        learned.learn(arrived(&samples(&truth, 3000, 10 + chunk)), Vec3::ZERO, 0.0);
        learned.decay(0.5);
    }
    let found = learned.frozen(false).expect("light has arrived");
    let kl: f64 = samples(&truth, 20_000, 99)
        .iter()
        .map(|of| (f64::from(of.pdf) / f64::from(found.pdf(of.direction, &found.at_pivot()))).ln())
        .sum::<f64>()
        / 20_000.0;
    // −ln 0.95 = 0.051 is that of the uniform part.
    assert!(kl < 0.08, "{kl}: {:?}", found.lobes().collect::<Vec<_>>());
    assert!(learned.len() <= 12, "{} lobes for three", learned.len());
}

/// Drawn with another density, weighted samples tell the same mixture.
#[test]
fn weights_make_up_for_densities() {
    let truth = [(0.6, Vec3::Z, 30.0), (0.4, Vec3::X, 30.0)];
    let mut random = Random::new(3, 0, 0);
    let uniform = 1.0 / (4.0 * std::f64::consts::PI);
    let weighted = |_| {
        let direction = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
        let value = density(&truth, direction) / uniform;
        Arrived { point: Vec3::ZERO, direction, distance: f32::INFINITY, value, pdf: uniform as f32 }
    };
    let all: Vec<Arrived> = (0..40_000).map(weighted).collect();
    let mut learned = LearnedMixture::default();
    learned.learn(all.iter().copied(), Vec3::ZERO, 0.0);
    let found = learned.frozen(false).expect("light has arrived");
    for (weight, mean, kappa) in truth {
        let (own, expected) = (found.pdf(mean, &found.at_pivot()), weight * peak(kappa));
        assert!((f64::from(own) / (0.95 * expected) - 1.0).abs() < 0.25, "{own} of {expected}");
    }
}

/// One lobe over two is split and becomes both; one over one is left alone.
#[test]
fn a_lobe_that_hides_two_is_split() {
    let apart = [(0.5, axis(0.25, 0.0, 1.0), 300.0), (0.5, axis(-0.25, 0.0, 1.0), 300.0)];
    let single = [(1.0, axis(0.3, 0.1, 1.0), 300.0)];
    let fitted = |truth: &[Truth]| {
        let all = samples(truth, 8000, 4);
        let mut lobes = vec![Component::new(1.0, DVec3::Z, mean_cosine(5.0))];
        refine(&mut lobes, &all, 0.0, u32::MAX);
        measure(&mut lobes, &all, 2.0, all.len());
        let changed = split(&mut lobes, 2.0);
        for _ in 0..3 {
            refine(&mut lobes, &all, 0.0, changed);
        }
        (lobes, changed)
    };
    let (lobes, changed) = fitted(&single);
    assert_eq!((lobes.len(), changed), (1, 0));
    let (lobes, changed) = fitted(&apart);
    assert_eq!((lobes.len(), changed), (2, 3));
    for (weight, mean, kappa) in apart {
        let near = |a: &&Component| a.mean.distance(mean.as_dvec3());
        let own = lobes.iter().min_by(|a, b| near(a).total_cmp(&near(b))).expect("there are two");
        assert!(near(&own) < 0.02 && (own.weight - weight).abs() < 0.05, "{own:?}");
        assert!((own.kappa() / kappa - 1.0).abs() < 0.15, "κ {}", own.kappa());
    }
}

/// Twins become one with the samples of both; what differs by more than noise stays two.
#[test]
fn twins_are_merged() {
    let lobe = |weight: f64, mean: Vec3, kappa: f64| {
        let mut lobe = Component::new(weight, mean.as_dvec3(), mean_cosine(kappa));
        lobe.past.add(100.0 * weight, mean.as_dvec3() * mean_cosine(kappa));
        lobe.misfit.samples = 1.0;
        lobe
    };
    let mut all = vec![lobe(0.3, axis(0.01, 0.0, 1.0), 50.0), lobe(0.3, Vec3::X, 50.0), lobe(0.4, Vec3::Z, 52.0)];
    let [a, b] = [all[0].past, all[2].past];
    merge(&mut all);
    assert_eq!(all.len(), 2);
    assert!((all[0].weight - 0.7).abs() < 1e-12 && (all[0].kappa() / 51.0 - 1.0).abs() < 0.02, "{:?}", all[0]);
    assert_eq!(all[0].past, a.with(b));
    for other in [lobe(0.5, Vec3::Z, 200.0), lobe(0.5, axis(0.4, 0.0, 1.0), 50.0)] {
        let mut all = vec![lobe(0.5, Vec3::Z, 50.0), other];
        merge(&mut all);
        assert_eq!(all.len(), 2, "{other:?}");
    }
    // Lobes that were split just now have no samples yet, and wait.
    let mut fresh = vec![lobe(0.5, Vec3::Z, 50.0); 2];
    fresh[1].misfit.samples = 0.0;
    merge(&mut fresh);
    assert_eq!(fresh.len(), 2);
}

/// A lamp of 0.06 across, 0.6 away from a voxel of side 0.2: wherever in the voxel it is looked for, it is found, and at its distance.
#[test]
fn a_near_lamp_is_found_from_all_points_of_the_voxel() {
    let mut random = Random::new(6, 0, 0);
    let (lamp, half) = (Vec3::new(0.3, 0.5, 0.1), 0.1f32);
    let mut within = |radius: f32| radius * Vec3::from([0; 3].map(|_| random.range(-1.0, 1.0)));
    let mut sample = |_| {
        let (point, to) = (within(half), lamp + within(0.03));
        let distance = point.distance(to);
        Arrived { point, direction: (to - point) / distance, distance, value: 1.0, pdf: 1.0 }
    };
    let all: Vec<Arrived> = (0..4000).map(&mut sample).collect();
    let mut learned = LearnedMixture::default();
    learned.learn(all.iter().copied(), Vec3::ZERO, 1.5 * half * 3f32.sqrt());
    let found = learned.frozen(false).expect("light has arrived");
    let strongest = found.lobes().max_by(|a, b| a.weight.total_cmp(&b.weight)).expect("there are lobes");
    assert!((strongest.nearness * lamp.length() - 1.0).abs() < 0.05, "{strongest:?}");
    let mut random = Random::new(7, 0, 0);
    for corner in [Vec3::splat(half), Vec3::new(half, -half, half), Vec3::new(-half, half, -half), Vec3::ZERO] {
        let spot = Spot { point: corner, normal: Vec3::ZERO };
        let to = (lamp - corner).normalize();
        // 0.06 from the lamp's middle at the least distance.
        let hits = (0..2000).filter(|_| found.sample(random.next_2d_f64(), &spot).0.distance(to) < 0.13).count();
        assert!(hits > 1700, "{hits} of 2000 hit from {corner}");
        let far = Spot { point: Vec3::ZERO, normal: Vec3::ZERO };
        let aimed = found.pdf(to, &spot) / found.pdf(to, &far);
        assert!(corner == Vec3::ZERO || aimed > 3.0, "{aimed} times as dense as without aiming from {corner}");
    }
}

/// What few samples, or one that outweighs all, tell is bounded, and all that is learned is finite.
#[test]
fn few_samples_make_no_spike() {
    let at = |direction: Vec3, distance: f32, value: f64, pdf: f32| Arrived {
        point: Vec3::splat(0.1),
        direction,
        distance,
        value,
        pdf,
    };
    let cases: [(&str, Vec<Arrived>, f64); 7] = [
        ("one", vec![at(Vec3::X, 1.0, 1.0, 1.0)], 50.0),
        ("two alike", vec![at(Vec3::X, 1.0, 1.0, 1.0); 2], 60.0),
        ("huge", vec![at(Vec3::X, 1.0, 1e38, 1e-30), at(Vec3::Y, 1e-30, 1e-38, 1e30)], 60.0),
        ("opposite", vec![at(Vec3::X, 1.0, 1.0, 1.0), at(Vec3::NEG_X, f32::INFINITY, 1.0, 1.0)], 50.0),
        ("dark", vec![at(Vec3::X, 1.0, 0.0, 1.0), at(Vec3::X, 1.0, f64::NAN, 1.0)], 0.0),
        ("no number", vec![at(Vec3::X, f32::NAN, 1.0, 1.0), at(Vec3::X, 1.0, 1.0, f32::NAN)], 50.0),
        ("a thousand in one point", vec![at(Vec3::X, 1.0, 1.0, 1.0); 1000], MOST_KAPPA),
    ];
    for (name, arrived, most) in cases {
        let mut learned = LearnedMixture::default();
        for _ in 0..3 {
            learned.decay(0.0);
            learned.learn(arrived.iter().copied(), Vec3::ZERO, 0.2);
        }
        let Some(found) = learned.frozen(true) else {
            assert!(most == 0.0, "{name}: nothing was learned");
            continue;
        };
        for lobe in found.lobes() {
            let kappa = f64::from(lobe.kappa);
            assert!((0.9 * LEAST_KAPPA..=1.001 * most).contains(&kappa), "{name}: {lobe:?}");
        }
        let mut random = Random::new(8, 0, 0);
        for _ in 0..100 {
            let point = Vec3::from([0; 3].map(|_| random.range(-0.2, 0.2)));
            for normal in [Vec3::ZERO, Vec3::NEG_X, Vec3::Y] {
                let spot = Spot { point, normal };
                let (direction, pdf) = found.sample(random.next_2d_f64(), &spot);
                assert!(direction.is_normalized() && pdf.is_finite() && pdf > 0.0, "{name}: {direction} {pdf}");
                assert_eq!(found.pdf(direction, &spot), pdf, "{name}");
            }
        }
    }
}

/// The unit of radiance changes nothing: what decides is relative to the mean.
#[test]
fn the_unit_of_light_changes_nothing() {
    let all = samples(&THREE(), 3000, 12);
    let learned = |factor: f64| {
        let mut learned = LearnedMixture::default();
        for _ in 0..3 {
            learned.learn(arrived(&all).map(|of| Arrived { value: of.value * factor, ..of }), Vec3::ZERO, 0.0);
        }
        learned.frozen(false)
    };
    assert_eq!(learned(1.0), learned(2f64.powi(66)));
    assert_eq!(learned(1.0), learned(2f64.powi(-66)));
}

/// Light from where no lobe looks becomes a lobe.
#[test]
fn lost_samples_become_a_lobe() {
    let mut learned = vec![Component::new(1.0, DVec3::Z, mean_cosine(30_000.0))];
    learned[0].past.add(1000.0, DVec3::Z * mean_cosine(30_000.0));
    let all = samples(&[(1.0, Vec3::X, 400.0)], 500, 9);
    refine(&mut learned, &all, 1000.0, u32::MAX);
    assert_eq!(learned.len(), 2);
    assert!(learned[1].mean.distance(DVec3::X) < 0.02 && (learned[1].weight - 1.0 / 3.0).abs() < 0.01, "{learned:?}");
    assert!((learned[1].kappa() / 400.0 - 1.0).abs() < 0.3, "κ {}", learned[1].kappa());
}

/// A mixture goes on from its numbers as it would have, also after its voxel was halved; numbers that are none are refused.
#[test]
fn numbers_of_a_file_are_the_mixture() {
    let mut learned = LearnedMixture::default();
    let near = |seed: u64| -> Vec<Arrived> {
        let all = samples(&THREE(), 1500, seed);
        all.iter().zip(arrived(&all)).map(|(_, of)| Arrived { distance: 2.0, ..of }).collect()
    };
    learned.learn(near(1).into_iter(), Vec3::ZERO, 0.1);
    learned.decay(0.5);
    let (own, components) = learned.numbers();
    let mut again = LearnedMixture::from_numbers(&own, &components).expect("they were written just now");
    assert_eq!(again, learned);
    for of in [&mut learned, &mut again] {
        of.decay(0.5);
        of.learn(near(2).into_iter(), Vec3::new(0.1, 0.0, 0.2), 0.05);
    }
    assert_eq!(again, learned);
    for (place, bad) in [(0, f64::NAN), (0, -0.1), (1, 3.0), (4, 1.0), (5, -1.0), (6, f64::INFINITY), (13, -1e-9)] {
        let mut hostile = components.clone();
        hostile[2][place] = bad;
        assert_eq!(LearnedMixture::from_numbers(&own, &hostile), None, "{bad} in place {place}");
    }
    assert_eq!(LearnedMixture::from_numbers(&[f64::NAN; 8], &components), None);
    assert_eq!(LearnedMixture::from_numbers(&own, &[components[0]; 33]), None);
}

/// A voxel that is halved has a new centre: lobes of near light are aimed from there, those of far light stay.
#[test]
fn a_new_pivot_sees_the_same_places() {
    let mut random = Random::new(13, 0, 0);
    let lamp = Vec3::new(0.0, 1.0, 0.0);
    let mut sample = |_| {
        let point = 0.2 * Vec3::from([0; 3].map(|_| random.range(-1.0, 1.0)));
        let to = lamp - point;
        Arrived { point, direction: to.normalize(), distance: to.length(), value: 1.0, pdf: 1.0 }
    };
    let all: Vec<Arrived> = (0..1000).map(&mut sample).collect();
    let mut learned = LearnedMixture::default();
    learned.learn(all.iter().copied(), Vec3::ZERO, 0.3);
    let pivot = Vec3::new(0.2, 0.0, 0.0);
    learned.learn(std::iter::empty(), pivot, 0.3);
    let found: VmfMixture = learned.frozen(false).expect("light has arrived");
    let strongest = found.lobes().max_by(|a, b| a.weight.total_cmp(&b.weight)).expect("there are lobes");
    assert!(strongest.mean.distance((lamp - pivot).normalize()) < 0.02, "{strongest:?}");
    assert!((strongest.nearness * lamp.distance(pivot) - 1.0).abs() < 0.05, "{strongest:?}");
}
