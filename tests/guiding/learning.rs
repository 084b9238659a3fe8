//! What is learned comes closer to the truth as fast as statistics says. Everything has a fixed seed; the tolerances are five
//! standard errors and more of what is fitted, so that another seed fails once in a million.

use std::path::PathBuf;

use fanal::base::random::Random;
use fanal::base::tensors;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::learn::learner::{Learner, LearnerSettings, Use};
use fanal::guiding::model::ModelKind;
use fanal::guiding::record::{PathRecord, PhotonRecord};
use fanal::guiding::sample::field::{Evidence, GuideField};
use fanal::guiding::sample::file;
use fanal::guiding::target::{DirectLight, Target};
use fanal::guiding::tree::distribution::{Distribution, kl};
use fanal::guiding::tree::leaves::Layout;
use fanal::guiding::tree::proposal::Proposal;
use fanal::guiding::tree::quadtree::{Place, Placed, Quadtree};
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::Topology;
use fanal::guiding::tree::{TreeSettings, Trees};
use fanal::math::cylindrical;
use fanal::reconstruct::{AsCounted, Reconstructor};
use glam::Vec3;
use tempfile::TempDir;

use crate::support::records::{onward, path_at, photon_at};

/// Levels of the full tree that samples are counted in.
const LEVELS: usize = 3;
const LEAVES: usize = 64;

/// Incident radiance: a broad lobe over a floor.
fn radiance(direction: Vec3) -> f64 {
    let cos = f64::from(direction.dot(Vec3::new(0.6, -0.48, 0.64))).max(0.0);
    0.2 + 3.0 * cos.powi(4)
}

/// Chance that a path sample finds the light; it then brings 1/chance as much, as after a noisy rest of the path.
fn chance(direction: Vec3) -> f64 {
    if direction.x > 0.0 { 0.25 } else { 1.0 }
}

fn full() -> Topology {
    let inner = (4usize.pow(LEVELS as u32) - 1) / 3;
    let split: Vec<bool> = (0..inner + LEAVES).map(|n| n < inner).collect();
    Topology::from_split(&split).expect("a full tree")
}

/// Per leaf the weight that infinitely many samples give, from the mean over the leaf of `mean`, then `weight`.
fn truth(mean: impl Fn(Vec3) -> f64, weight: impl Fn(f64) -> f64) -> Distribution {
    let (tree, side, fine) = (full(), f64::from(1u32 << LEVELS), 48);
    let leaf = |node: usize| {
        let mut sum = 0.0;
        for i in 0..fine * fine {
            let offset = [i % fine, i / fine].map(|k| (f64::from(k) + 0.5) / f64::from(fine));
            let place = [0, 1].map(|axis| (f64::from(tree.cell[node][axis]) + offset[axis]) / side);
            sum += mean(cylindrical::to_direction(place));
        }
        weight(sum / f64::from(fine * fine))
    };
    let weights: Vec<f64> = tree.leaves().map(leaf).collect();
    Distribution::from_leaf_weights(full(), &weights)
}

/// A path sample in a uniform direction, of a white vertex: V = L̂²/p.
fn path(random: &mut Random) -> PathRecord {
    let direction = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
    let found = random.next_f64() < chance(direction);
    let estimate = if found { radiance(direction) / chance(direction) } else { 0.0 };
    let sphere = 4.0 * std::f64::consts::PI;
    PathRecord {
        pdf: (1.0 / sphere) as f32,
        brought: onward((estimate * sphere) as f32),
        bsdf_share: 1.0,
        ..path_at(Vec3::splat(0.5), direction, 0.0)
    }
}

/// A photon: its direction is distributed as the radiance.
fn photon(random: &mut Random) -> PhotonRecord {
    loop {
        let direction = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
        if random.next_f64() * 3.2 < radiance(direction) {
            return PhotonRecord {
                path: 0,
                point: Vec3::splat(0.5),
                direction,
                power: 1.0,
                distance: 1.0,
                normal: Vec3::Y,
                caustic: false,
            };
        }
    }
}

/// Mean KL to `truth` over 60 trees of `n` samples of each kind asked for.
fn mean_kl(truth: &Distribution, n: usize, kinds: [bool; 2]) -> f64 {
    let place = Place { parallax: Parallax::NONE, direct: DirectLight::All, filtered: false };
    let repeats = 60;
    let one = |seed: u64| {
        let mut random = Random::new(77, seed, n as u64);
        let mut tree = Quadtree::new(full(), Layout::Values, Target::Variance);
        let count = |kind: usize| if kinds[kind] { n } else { 0 };
        let paths: Vec<PathRecord> = (0..count(0)).map(|_| path(&mut random)).collect();
        let photons: Vec<PhotonRecord> = (0..count(1)).map(|_| photon(&mut random)).collect();
        tree.deposit(&Placed::new(&place, tree.target(), paths.iter(), photons.iter()));
        kl(truth, &tree.leaves().hybrid(0.5), 0.0)
    };
    (0..repeats).map(one).sum::<f64>() / repeats as f64
}

/// Slope of ln KL over ln N from N = 2¹¹ to 2¹⁶.
fn slope(truth: &Distribution, kinds: [bool; 2]) -> f64 {
    let points: Vec<(f64, f64)> =
        (11..=16).map(|bits| (f64::from(bits) * 2f64.ln(), mean_kl(truth, 1 << bits, kinds).ln())).collect();
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let product: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    product / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

/// Leaf weights are means of independent samples, so KL, quadratic in their errors, falls as 1/N: for path samples, whose weights
/// are roots of second moments, for photons, and for both together. Catches weights that do not add up, a sample in the wrong
/// leaf, a scale that drifts.
#[test]
fn kl_falls_with_the_number_of_samples() {
    let roots = truth(|w| radiance(w).powi(2) / chance(w), f64::sqrt);
    let flux = truth(radiance, |m| m);
    let both = Distribution::blend(&roots, &flux, 0.5);
    for (name, truth, kinds) in
        [("paths", &roots, [true, false]), ("photons", &flux, [false, true]), ("both", &both, [true, true])]
    {
        let slope = slope(truth, kinds);
        assert!((slope + 1.0).abs() < 0.06, "{name}: {slope}");
    }
    // For counts of K leaves the mean of KL is (K − 1)/2N and its spread over 60 trees 2.3 % (a χ² of 63 degrees).
    let n = 1 << 14;
    let expected = (LEAVES - 1) as f64 / (2.0 * n as f64);
    let found = mean_kl(&flux, n, [false, true]);
    assert!((found / expected - 1.0).abs() < 0.12, "{found} instead of {expected}");
    // Where paths are noisy their root mean square is larger than the radiance.
    assert!(mean_kl(&flux, n, [true, false]) > 3.0 * mean_kl(&roots, n, [true, false]));
}

/// An iteration knows that of the one before as half of its samples, also in a voxel that was divided; without a past it knows
/// nothing of it.
#[test]
fn earlier_iterations_are_remembered() {
    let light = cylindrical::to_direction([0.9, 0.1]);
    let samples = |count: u32, direction| {
        let record = |_| PathRecord { bsdf_share: 1.0, ..path_at(Vec3::splat(0.5), direction, 1.0) };
        (0..count).map(record).collect::<Vec<_>>()
    };
    for (past, expected, counts) in [(0.5, 1.0 / 2.0, 100.0), (0.0, 0.0, 0.0)] {
        let tree = TreeSettings { context: 0.0, past, ..TreeSettings::default() };
        let settings = LearnerSettings { tree, parallax: false, voxel_samples: 150, ..LearnerSettings::default() };
        let mut learner = Learner::new(settings);
        learner.absorb(&samples(200, light), &[], true);
        assert_eq!(learner.counted()[0].as_ref().map(|tree| tree.voxel_features.past), Some(0.0));
        learner.refine(1);
        assert_eq!(learner.voxels(), 4, "200 samples are more than a voxel may have, and so are those of their eighth");
        learner.absorb(&samples(100, -light), &[], true);
        let counted = learner.counted();
        let tree = counted.iter().flatten().find(|tree| tree.voxel_features.samples[0] > 0).expect("100 samples");
        let leaf = tree.counted.topology().leaf_at(cylindrical::to_cell(light));
        let mass = tree.counted.node_mass()[leaf];
        assert!((mass - expected).abs() < 1e-6, "{mass}, expected {expected}");
        assert_eq!(
            tree.voxel_features.past, counts,
            "half of the first samples, which all lay in this part of the voxel"
        );
    }
}

/// A cell with many more samples than a voxel may have is divided at once (Müller 2017 §3.2, Zhu 2021 §7), and only where they are:
/// pictures of many pixels would else stay too coarse for ten iterations.
#[test]
fn voxels_are_divided_until_none_has_too_many_samples() {
    let mut random = Random::new(9, 0, 0);
    let tree = TreeSettings { context: 0.0, ..TreeSettings::default() };
    let spread = LearnerSettings { resolution: 1.0, voxel_samples: 1000, tree, ..LearnerSettings::default() };
    let mut learner = Learner::new(spread);
    // All but a few lie in an eighth of the cell.
    let mut point = |side: f32| Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) * side;
    let dense: Vec<Vec3> = (0..6600).map(|i| point(if i < 6400 { 0.5 } else { 1.0 })).collect();
    let samples = |points: &[Vec3]| {
        points.iter().map(|&point| PathRecord { point, ..path(&mut Random::new(10, 0, 0)) }).collect::<Vec<_>>()
    };
    let most = |learner: &Learner| quadtrees(learner).map(|tree| tree.counts()[0]).max();
    for _ in 0..3 {
        learner.absorb(&samples(&dense), &[], true);
        learner.refine(1);
    }
    let voxels = learner.voxels();
    learner.absorb(&samples(&dense), &[], true);
    assert!(most(&learner) <= Some(1000), "{:?}", most(&learner));
    learner.refine(1);
    assert_eq!(learner.voxels(), voxels, "there is nothing left to divide");
}

/// Müller 2017 §3.4: after an iteration of 2ᵏ samples per pixel a leaf has at most c·√2ᵏ of them, however many there were in its parent, of
/// which either half is taken to have half. Other modes divide a voxel into eighths at most, which is all that was counted.
#[test]
fn leaves_of_mueller_have_as_many_samples_as_the_root_of_the_samples_per_pixel() {
    let voxels = |growing: bool, spp: u32| {
        let mut random = Random::new(13, 0, 0);
        let tree = TreeSettings { context: 0.0, past: 0.0, ..TreeSettings::default() };
        let settings = LearnerSettings {
            resolution: 1.0,
            facing: false,
            voxel_samples: 400,
            growing,
            tree,
            ..LearnerSettings::default()
        };
        let mut learner = Learner::new(settings);
        let mut point = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
        let points: Vec<Vec3> = (0..20_000).map(|_| point()).collect();
        let samples: Vec<PathRecord> =
            points.into_iter().map(|point| PathRecord { point, ..path(&mut Random::new(14, 0, 0)) }).collect();
        learner.absorb(&samples, &[], true);
        let before = learner.voxels();
        learner.refine(spp);
        let after = learner.voxels();
        learner.absorb(&samples, &[], true);
        let most = quadtrees(&learner).map(|tree| tree.counts()[0]).max();
        [before, after, most.unwrap_or(0) as usize]
    };
    let ([first, small, most], [_, large, more], [_, eighths, _]) =
        (voxels(true, 1), voxels(true, 16), voxels(false, 1));
    assert!(eighths <= 8 * first && small > eighths, "{first}, {eighths}, {small}");
    // Samples lie evenly but for the rim of the cell, which they do not fill: half as many more in the worst place.
    assert!(most <= 600 && more <= 4 * 600, "{most}, {more}");
    let ratio = small as f64 / large as f64;
    assert!((2.5..6.5).contains(&ratio), "{small} leaves, {large} where four times as many samples are allowed");
}

/// A file of the field in a folder of its own, which loads as the same.
fn saved(field: &GuideField) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.guide");
    file::save(&path, field, &Evidence::default()).expect("it can be written");
    let (loaded, _) = file::load(&path).expect("it was written just now");
    assert_eq!(loaded.voxels(), field.voxels());
    assert_eq!((loaded.bytes(), loaded.nodes()), (field.bytes(), field.nodes()));
    (folder, path)
}

/// Histograms in guide files sample as before; what is no mass is refused.
#[test]
fn histograms_are_loaded_as_they_were_saved() {
    let mut random = Random::new(12, 0, 0);
    let mut learner = Learner::new(LearnerSettings { model: ModelKind::Histograms, ..LearnerSettings::default() });
    let mut point = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
    let paths: Vec<PathRecord> = (0..2000).map(|_| path_at(point(), point().normalize(), 1.0)).collect();
    learner.absorb(&paths, &[], true);
    learner.fit(&mut |_| panic!("there are no trees")).expect("nothing here fails");
    let field = learner.field(Use::Rendering);
    assert!(field.distributions().count() > 100);
    let (_folder, path) = saved(&field);
    let arrays = || file::arrays(&field, &Evidence::default());
    for bad in [f32::NAN, -1.0, f32::INFINITY, f32::MIN_POSITIVE / 2.0] {
        let mut arrays = arrays();
        let bins = arrays.iter_mut().find(|(name, ..)| name == "guide_bins").expect("there are histograms");
        bins.3.to_mut()[..4].copy_from_slice(&bad.to_le_bytes());
        tensors::write(&path, file::VERSION, &arrays).expect("it can be written");
        let error = file::load(&path).expect_err("a mass that is none").to_string();
        assert!(error.contains("guide_bins"), "{error}");
    }
}

/// A pass may be judged in parts and learned from later as a whole: guides and moments are the same, bit for bit.
#[test]
fn what_is_judged_first_is_learned_as_ever() {
    let mut random = Random::new(21, 0, 0);
    let mut point = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
    let paths: Vec<PathRecord> =
        (0..20_000).map(|i| path_at(point(), (point() - 0.3).normalize(), (i % 7) as f32)).collect();
    let photons: Vec<_> = (0..10_000).map(|_| photon_at(point(), (point() - 0.3).normalize(), 1.0)).collect();
    let [mut whole, mut tried] = [0; 2].map(|_| Learner::new(LearnerSettings::default()));
    // The first chunk of all decides how large cells are, so only later passes are judged in parts.
    for parts in [1, 2] {
        let reached = whole.absorb(&paths, &photons, true);
        paths.chunks(paths.len() / parts).for_each(|part| {
            tried.judge(part);
            let halfway = tried.moments_so_far(100);
            assert!(halfway.learning.is_finite() && halfway.unseen == 0.0, "photons come later");
        });
        assert!(tried.deposit(&paths, &photons, true) == reached, "photons fall into the same voxels");
        for learner in [&mut whole, &mut tried] {
            learner.fit(&mut |trees| AsCounted::default().reconstruct(trees)).expect("nothing here fails");
        }
        assert_eq!(whole.picture_moments(100), tried.picture_moments(100));
        for learner in [&mut whole, &mut tried] {
            learner.refine(1);
        }
        let [whole, tried] = [&whole, &tried].map(|learner| learner.field(Use::Rendering));
        assert!(whole.voxels() == tried.voxels() && whole.distributions().count() > 100);
    }
}

/// Guide files of mixtures sample as before. `bad` numbers in places of the first component's are refused, naming its array `guide_{part}…`,
/// and so are `too_many` components of a voxel.
fn mixtures_are_loaded_as_they_were_saved(
    settings: LearnerSettings,
    [paths, photons]: [usize; 2],
    part: &str,
    bad: &[(usize, f32)],
    too_many: u64,
) {
    let mut random = Random::new(14, 0, 0);
    let mut learner = Learner::new(settings);
    let mut point = || Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
    let paths: Vec<PathRecord> = (0..paths).map(|_| path_at(point(), (point() - 0.3).normalize(), 1.0)).collect();
    let photons: Vec<_> = (0..photons).map(|_| photon_at(point(), (point() - 0.3).normalize(), 1.0)).collect();
    for _ in 0..2 {
        learner.absorb(&paths, &photons, true);
        learner.fit(&mut |_| panic!("there are no trees")).expect("nothing here fails");
        learner.refine(1);
    }
    let field = learner.field(Use::Learning);
    assert!(field.distributions().count() > 100 && learner.model().nodes() > 800);
    let (_folder, path) = saved(&field);
    let refused = |array: &str, place: usize, bad: &[u8]| {
        let mut arrays = file::arrays(&field, &Evidence::default());
        let found = arrays.iter_mut().find(|(name, ..)| name == array).expect("there are components");
        found.3.to_mut()[place..place + bad.len()].copy_from_slice(bad);
        tensors::write(&path, file::VERSION, &arrays).expect("it can be written");
        let error = file::load(&path).expect_err("this is no component").to_string();
        assert!(error.contains(&format!("guide_{part}")), "{error}");
    };
    for (place, bad) in bad {
        refused(&format!("guide_{part}s"), 4 * place, &bad.to_le_bytes());
    }
    for count in [u64::MAX, too_many] {
        refused(&format!("guide_{part}_offset"), 8, &count.to_le_bytes());
    }
}

#[test]
fn lobes_are_loaded_as_they_were_saved() {
    let settings = LearnerSettings {
        model: ModelKind::Vmf,
        target: Target::Radiance,
        parallax: false,
        ..LearnerSettings::default()
    };
    // Mean direction, concentration, weight, inverse distance.
    let bad = [(0, 2.0), (2, f32::NAN), (3, 0.0), (3, 1e6), (4, -0.1), (4, 2.0), (5, -1.0), (5, f32::INFINITY)];
    mixtures_are_loaded_as_they_were_saved(settings, [2000, 0], "lobe", &bad, 33);
}

#[test]
fn gaussians_are_loaded_as_they_were_saved() {
    let settings = LearnerSettings { model: ModelKind::Gmm, target: Target::Radiance, ..LearnerSettings::default() };
    // Weight, mean, standard deviation, slope, residual deviation.
    let bad = [
        (0, -0.1),
        (0, 1.5),
        (0, f32::NAN),
        (1, -0.5),
        (2, 1.5),
        (3, 0.0),
        (3, 0.6),
        (4, 1e3),
        (5, -0.1),
        (5, f32::INFINITY),
    ];
    mixtures_are_loaded_as_they_were_saved(settings, [2000; 2], "gaussian", &bad, 9);
}

fn quadtrees(learner: &Learner) -> impl Iterator<Item = &Quadtree> {
    learner.model().trees().into_iter().flat_map(Trees::quadtrees)
}

/// Few samples do not tell the values of pixels: the second moment comes first, then that relative to the pixel (Nilsson 2022 §4.4).
#[test]
fn the_simple_target_comes_first() {
    let mut learner = Learner::new(LearnerSettings {
        target: Target::VariancePixel,
        simple_iterations: 3,
        ..LearnerSettings::default()
    });
    let targets: Vec<Target> = (0..5)
        .map(|_| {
            learner.absorb(&[path(&mut Random::new(11, 0, 0))], &[], true);
            let target = learner.target();
            assert_eq!(quadtrees(&learner).next().map(Quadtree::target), Some(target));
            learner.refine(1);
            target
        })
        .collect();
    assert_eq!(targets, [[Target::Variance; 3].as_slice(), &[Target::VariancePixel; 2]].concat());
}

/// Whichever of two proposals was sampled: what the samples bring back decides for the one that is right.
#[test]
fn a19_the_better_proposal_is_sampled() {
    let [light, dark] = [[0.9, 0.1], [0.1, 0.6]].map(cylindrical::to_direction);
    let bright = |direction: Vec3| if direction.dot(light) > 0.95 { 40.0 } else { 0.1 };
    let at = |direction: Vec3| {
        let mut learner = Learner::new(LearnerSettings { parallax: false, ..LearnerSettings::default() });
        let mut random = Random::new(7, 0, 0);
        let mut near = || (direction + 0.3 * path(&mut random).direction).normalize();
        let lobe = (0..3000).map(|_| path_at(Vec3::splat(0.5), near(), 1.0));
        learner.absorb(&lobe.collect::<Vec<_>>(), &[], true);
        let mut counted = learner.counted();
        counted.remove(0).expect("3000 samples").counted.clone()
    };
    let [right, wrong] = [light, dark].map(at);
    let alone = SamplingTree::new(&right, 0.1, usize::MAX).pdf(light);
    for (first, plain) in [(&wrong, &right), (&right, &wrong)] {
        let mut learner = Learner::new(LearnerSettings { parallax: false, ..LearnerSettings::default() });
        let mut random = Random::new(8, 0, 0);
        let proposal = Proposal { first: (first.clone(), 0.1), plain: Some((plain.clone(), 0.1)) };
        for iteration in 0..2 {
            let field = learner.field(Use::Learning);
            let point = Vec3::splat(0.5);
            let mut sample = || {
                let uniform = path(&mut random);
                let guide = field.at(point, Vec3::Y).and_then(|voxel| voxel.at(point));
                let Some(guide) = guide else { return uniform };
                let drawn =
                    if random.next_f64() < 0.5 { uniform.direction } else { guide.sample(random.next_2d_f64()).0 };
                let [bsdf, guided] = [0.25 / std::f32::consts::PI, guide.pdf(drawn)];
                let estimate = bright(drawn) / (0.5 * (bsdf + guided));
                PathRecord {
                    direction: drawn,
                    brought: onward(estimate),
                    bsdf_share: bsdf / (bsdf + guided),
                    ..uniform
                }
            };
            let samples: Vec<PathRecord> = (0..4000).map(|_| sample()).collect();
            learner.absorb(&samples, &[], true);
            learner.fit(&mut |trees| Ok(vec![proposal.clone(); trees.len()])).expect("nothing here fails");
            learner.refine(1);
            let voxels = learner.field(Use::Learning);
            let guide = voxels.at(point, Vec3::Y).and_then(|voxel| voxel.at(point)).expect("it was published");
            let right_is_most = iteration > 0 || first == &right;
            let found = guide.pdf(light);
            assert_eq!(found > 0.7 * alone, right_is_most, "iteration {iteration}: {found} of {alone}");
        }
    }
}
