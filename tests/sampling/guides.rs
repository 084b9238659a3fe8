//! Guides: quadtrees and their mixture with a material are sampled with the stated densities. False alarms: see sampling.rs.

use crate::support::{chart, records, statistics};

use std::sync::atomic::{AtomicU32, Ordering};

use std::f64::consts::PI;

use chart::Chart;
use fanal::base::random::Random;
use fanal::geometry::Surface;
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::gmm::gaussian::Gaussian as Normal;
use fanal::guiding::gmm::mixture::GaussianMixture;
use fanal::guiding::learn::learner::{Learner, LearnerSettings, Use};
use fanal::guiding::model::ModelKind;
use fanal::guiding::sample::field::{GuideField, VoxelGuide};
use fanal::guiding::sample::roulette::AdjointRoulette;
use fanal::guiding::tree::TreeSettings;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::leaves::Layout;
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::{MAX_LEVEL, Topology};
use fanal::guiding::vmf::lobe::Lobe;
use fanal::guiding::vmf::mixture::{Spot, VmfMixture};
use fanal::integrators::mixture::Mixture;
use fanal::materials::diffuse::Diffuse;
use fanal::materials::fresnel::Metal;
use fanal::materials::microfacet::{Microfacets, Shape};
use fanal::materials::phase::HenyeyGreenstein;
use fanal::materials::plastic::Plastic;
use fanal::materials::rough_conductor::RoughConductor;
use fanal::materials::rough_dielectric::RoughDielectric;
use fanal::materials::texture::Texture;
use fanal::materials::{Bsdf, Kind, Material, Transport};
use fanal::math::cylindrical;
use fanal::reconstruct::gaussian::Gaussian;
use fanal::reconstruct::{Neural, Reconstructor};
use glam::{Vec2, Vec3};
use records::{path_at, photon_at};
use statistics::assert_chi2;

/// A tree of at most `levels` levels below the root, each node split with probability `p`, a fifth of the leaves without energy, the
/// others over ten decades.
fn random_tree(seed: u64, levels: usize, p: f32) -> Distribution {
    let mut random = Random::new(seed, 0, 0);
    let (mut split, mut level) = (vec![], 1);
    for depth in 0..=levels {
        let flags: Vec<bool> = (0..level).map(|_| depth == 0 || depth < levels && random.next_f32() < p).collect();
        level = 4 * flags.iter().filter(|f| **f).count();
        split.extend(flags);
    }
    let topology = Topology::from_split(&split).expect("the flags are consistent");
    let mut energy = || if random.next_f32() < 0.2 { 0.0 } else { 10f64.powf(f64::from(random.range(-5.0, 5.0))) };
    let weights: Vec<f64> = topology.leaves().map(|_| energy()).collect();
    Distribution::from_leaf_weights(topology, &weights)
}

/// A chain of splits down to level 20 around the cell that contains `towards`, equal energy on every level.
fn chain(towards: Vec3) -> Distribution {
    let topology = records::chain(towards);
    let count = topology.leaves().count();
    Distribution::from_leaf_weights(topology, &vec![1.0; count])
}

/// The leaf of a direction (its node) and its level.
fn leaf(topology: &Topology, direction: Vec3) -> (usize, usize) {
    let [x, y] = cylindrical::to_cell(direction);
    let (mut node, mut level) = (0, 0);
    while !topology.is_leaf(node) {
        level += 1;
        let cell = [x >> (MAX_LEVEL - level), y >> (MAX_LEVEL - level)];
        let first = topology.first_child[node] as usize;
        node = (first..first + 4).find(|&child| topology.cell[child] == cell).expect("children cover their parent");
    }
    (node, level)
}

/// Mass of a leaf in the mixture with the uniform sphere.
fn mass(distribution: &Distribution, uniform: f64, node: usize, level: usize) -> f64 {
    (1.0 - uniform) * distribution.node_mass()[node] + uniform * 0.25f64.powi(level as i32)
}

/// Most by which shares of sixteen bits can change a node's density relative to uniform.
fn rounding(distribution: &Distribution, node: usize) -> f64 {
    if node == 0 {
        return 0.0;
    }
    // Both ends of a share are rounded, and the last child keeps at least one step.
    let step = 2.0 / 65536.0;
    let topology = distribution.topology();
    let parent = topology.parent[node] as usize;
    let level = topology.level_start.partition_point(|&start| start <= parent) - 1;
    let mass = distribution.node_mass();
    let density = mass[parent] * 4f64.powi(level as i32);
    let share = if mass[parent] > 0.0 { mass[node] / mass[parent] } else { 0.25 };
    4.0 * (rounding(distribution, parent) * (share + step) + density * step)
}

/// χ² over leaves; those below `merge` are counted with the node above them at that level. The density of each sample is the
/// mass of its leaf over its solid angle to 1e-5 and the rounding of the shares. Catches a wrong order of children, float coordinates that fail at depth, a
/// forgotten uniform part, quadrants without energy that are drawn.
fn check(name: &str, distribution: &Distribution, uniform: f32, merge: usize) {
    let tree = SamplingTree::new(distribution, uniform, usize::MAX);
    let topology = distribution.topology();
    let mut random = Random::new(3, 0, 0);
    let n = 1_000_000;
    let mut counts = vec![0.0; topology.len()];
    for _ in 0..n {
        let (direction, _) = tree.sample(random.next_2d_f64());
        let (node, level) = leaf(topology, direction);
        let expected = mass(distribution, f64::from(uniform), node, level) * 4f64.powi(level as i32) / (4.0 * PI);
        let pdf = f64::from(tree.pdf(direction));
        let bound = 1e-5 * expected + f64::from(1.0 - uniform) * rounding(distribution, node) / (4.0 * PI);
        assert!((pdf - expected).abs() <= bound, "{name}: density {pdf} of {expected} at level {level}");
        counts[merged(topology, node, level, merge)] += 1.0;
    }
    let mut expected = vec![0.0; topology.len()];
    for level in 0..topology.levels() {
        for node in topology.level(level).filter(|&node| topology.is_leaf(node)) {
            let share = mass(distribution, f64::from(uniform), node, level);
            expected[merged(topology, node, level, merge)] += f64::from(n) * share;
        }
    }
    assert_chi2(name, &counts, &expected, chart::level());
}

fn merged(topology: &Topology, mut node: usize, level: usize, merge: usize) -> usize {
    for _ in merge..level {
        node = topology.parent[node] as usize;
    }
    node
}

#[test]
fn s01_quadtrees_follow_their_density() {
    for seed in 0..4 {
        check(&format!("tree {seed}"), &random_tree(seed, 6, 0.6), 0.1, MAX_LEVEL);
    }
    check("zero quadrants", &random_tree(7, 1, 0.0), 1e-4, MAX_LEVEL);
    let root = SamplingTree::new(&Distribution::uniform(), 0.1, usize::MAX);
    let sample = |random: &mut Random| Some(root.sample(random.next_2d_f64()).0);
    Chart::around(Vec3::X, 1.0).check("root alone", [16, 16], |wi| f64::from(root.pdf(wi)), sample);
    check("only uniform", &random_tree(8, 3, 0.6), 1.0, MAX_LEVEL);
    // At z = 0 and φ = 0 single precision resolves a cell of level 20.
    check("chain at the equator", &chain(Vec3::X), 0.1, MAX_LEVEL);
    // At the pole it has some 30 values per cell, and rounding carries 1 % of a cell's samples over its border; four levels up
    // that is below the noise. The density of each sample is still that of the cell it fell into.
    check("chain at the pole", &chain(Vec3::new(0.001, -0.001, 1.0).normalize()), 0.1, MAX_LEVEL - 4);
}

/// What the network and smoothing make of counted trees is sampled with its density: shapes that no counting would give.
#[test]
fn s01_reconstructed_quadtrees_follow_their_density() {
    let network = Neural::built_in().expect("the model fits the program");
    let reconstructors: [&dyn Reconstructor; 2] = [&network, &Gaussian::default()];
    for seed in 0..2 {
        let mut random = Random::new(90 + seed, 0, 0);
        let tree = TreeSettings { layout: Layout::Network, ..TreeSettings::default() };
        let settings = LearnerSettings { tree, ..LearnerSettings::default() };
        for reconstructor in reconstructors {
            let mut learner = Learner::new(settings.clone());
            let (mut paths, mut photons) = (vec![], vec![]);
            for i in 0..3000 {
                let lobe = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
                let at = if i % 3 == 0 { lobe } else { (lobe + 4.0 * Vec3::new(0.3, 0.8, -0.5)).normalize() };
                paths.push(path_at(Vec3::splat(0.5), at, random.next_f32().powi(4)));
                photons.push(photon_at(Vec3::splat(0.5), lobe, random.next_f32()));
            }
            learner.absorb(&paths, &photons, true);
            let trees: Vec<_> = learner.counted().into_iter().flatten().collect();
            let (distribution, uniform) = reconstructor.reconstruct(&trees).expect("it runs").remove(0).first;
            assert!(distribution.topology().len() > 20);
            check(&format!("{} {seed}", reconstructor.name()), &distribution, uniform, MAX_LEVEL);
        }
    }
}

/// Histograms are sampled with their density, where photons came from everywhere, from one lobe, and path samples beside them.
#[test]
fn s01_histograms_follow_their_density() {
    let mut random = Random::new(17, 0, 0);
    for (lobe, paths) in [(0.0, 0), (1.0, 0), (1.0, 500)] {
        let mut towards = || {
            let any = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
            (any + 6.0 * lobe * Vec3::new(0.3, 0.8, -0.5)).normalize()
        };
        let photons: Vec<_> = (0..3000).map(|_| photon_at(Vec3::splat(0.5), towards(), 1.0)).collect();
        let paths: Vec<_> = (0..=paths).map(|_| path_at(Vec3::splat(0.5), towards(), 1.0)).collect();
        let model = ModelKind::Histograms;
        let mut learner = Learner::new(LearnerSettings { model, parallax: false, ..LearnerSettings::default() });
        learner.absorb(&paths, &photons, true);
        learner.fit(&mut |_| panic!("there are no trees")).expect("nothing here fails");
        let field = learner.field(Use::Learning);
        let directions = field.distributions().next().expect("photons arrived");
        let sample = |random: &mut Random| Some(directions.sample(random.next_2d_f64()).0);
        let pdf = |wi| f64::from(directions.pdf(wi));
        Chart::around(Vec3::X, 1.0).check(&format!("lobe {lobe}, {} paths", paths.len()), [32, 32], pdf, sample);
    }
}

/// Mixtures of lobes as they are asked: at their pivot, off it where they are aimed, and with the cosine of a surface.
fn mixtures() -> impl Iterator<Item = (String, VmfMixture, Spot, Vec3, f64)> {
    let lobe =
        |mean: Vec3, kappa: f32, weight: f32, nearness: f32| Lobe { mean: mean.normalize(), kappa, weight, nearness };
    let axis = Vec3::new(0.3, -0.5, 0.8).normalize();
    // The chart spreads a lobe out to its tails: the power is that of 1 − cos θ by which half of a lobe is in half of the rows.
    let power = |kappa: f32| (f64::from(kappa).ln() / 2f64.ln()).max(1.0);
    let single = [5.0f32, 80.0, 1000.0, 32_000.0].into_iter().map(move |kappa| {
        let mixture = VmfMixture::new(&[lobe(axis, kappa, 1.0, 0.0)], Vec3::ZERO, true).expect("it is a lobe");
        let spot = mixture.at_pivot();
        (format!("lobe of κ {kappa}"), mixture, spot, axis, power(kappa))
    });
    let several = [
        lobe(Vec3::new(0.2, 0.3, 1.0), 40.0, 0.4, 0.7),
        lobe(Vec3::new(-1.0, 0.2, -0.3), 6.0, 0.3, 0.0),
        lobe(Vec3::new(0.5, -0.9, 0.1), 0.001, 0.2, 0.2),
        lobe(Vec3::new(0.6, 0.3, 0.8), 300.0, 0.1, 1.0),
    ];
    let normal = Vec3::new(0.4, 0.6, 0.3).normalize();
    let places =
        [(Vec3::ZERO, Vec3::ZERO), (Vec3::splat(0.4), Vec3::ZERO), (Vec3::splat(0.4), normal), (Vec3::ZERO, -normal)];
    let placed = places.into_iter().map(move |(point, normal)| {
        let mixture = VmfMixture::new(&several, Vec3::ZERO, true).expect("these are lobes");
        (format!("lobes at {point} with {normal}"), mixture, Spot { point, normal }, Vec3::X, 1.0)
    });
    // Narrower than the cosine and turned away from it, where the product is all in the difference of large numbers.
    let away = [5.0f32, 32_000.0].into_iter().map(move |kappa| {
        let mixture = VmfMixture::new(&[lobe(axis, kappa, 1.0, 0.0)], Vec3::ZERO, true).expect("it is a lobe");
        (format!("κ {kappa} behind a surface"), mixture, Spot { point: Vec3::ZERO, normal: -axis }, axis, power(kappa))
    });
    single.chain(placed).chain(away)
}

/// Lobes are drawn with their density, which has the mass 1, for all concentrations, aimed or not, and as a product with the cosine.
#[test]
fn s01_mixtures_of_lobes_follow_their_density() {
    for (name, mixture, spot, axis, power) in mixtures() {
        let pdf = |wi| f64::from(mixture.pdf(wi, &spot));
        let sample = |random: &mut Random| {
            let (direction, pdf) = mixture.sample(random.next_2d_f64(), &spot);
            assert_eq!(pdf, mixture.pdf(direction, &spot), "{name}");
            Some(direction)
        };
        let mass = Chart::around(axis, power).check(&name, [48, 32], pdf, sample);
        assert!((mass - 1.0).abs() < 1e-3, "{name}: mass {mass}");
    }
}

/// Gaussians are drawn with their density, which has the mass 1: where φ begins anew, at the poles, slanted over more than a turn, and of all widths.
#[test]
fn s01_mixtures_of_gaussians_follow_their_density() {
    let normal = |weight: f32, mean: [f32; 2], deviation: f32, slope: f32, residual: f32| Normal {
        weight,
        mean,
        deviation,
        slope,
        residual,
    };
    let cases = [
        ("narrow", vec![normal(1.0, [0.5, 0.25], 0.004, 0.0, 0.004)], Vec3::Y, 6.0),
        ("over the edge", vec![normal(1.0, [0.4, 0.999], 0.05, 0.5, 0.02)], Vec3::X, 3.0),
        ("at a pole", vec![normal(1.0, [0.999, 0.3], 0.02, 0.0, 0.1)], Vec3::Z, 3.0),
        ("slanted", vec![normal(1.0, [0.5, 0.5], 0.2, 8.0, 0.1)], Vec3::Z, 1.0),
        ("wide", vec![normal(1.0, [0.1, 0.8], 0.5, 0.3, 0.5)], Vec3::Z, 1.0),
        (
            "several",
            vec![
                normal(0.4, [0.2, 0.1], 0.03, 1.0, 0.05),
                normal(0.3, [0.7, 0.6], 0.1, -2.0, 0.16),
                normal(0.2, [0.5, 0.95], 0.3, 0.0, 0.3),
                normal(0.1, [0.0, 0.0], 0.05, 0.0, 0.02),
            ],
            Vec3::Z,
            1.0,
        ),
    ];
    for (name, all, axis, power) in cases {
        let mixture = GaussianMixture::new(&all).expect("these are Gaussians");
        let pdf = |wi| f64::from(mixture.pdf(wi));
        let sample = |random: &mut Random| {
            let (direction, pdf) = mixture.sample(random.next_2d_f64());
            assert_eq!(pdf, mixture.pdf(direction), "{name}");
            Some(direction)
        };
        let mass = Chart::around(axis, power).check(name, [48, 32], pdf, sample);
        assert!((mass - 1.0).abs() < 1e-3, "{name}: mass {mass}");
    }
}

/// The product is the product: densities at a surface are those without it times the lobe of the cosine, on one scale for all directions.
#[test]
fn mixtures_are_multiplied_with_the_cosine() {
    let (name, mixture, spot, ..) = mixtures().nth(6).expect("it has a normal");
    let plain = Spot { normal: Vec3::ZERO, ..spot };
    let mut random = Random::new(2, 0, 0);
    let uniform = 0.05 / (4.0 * PI);
    let ratios: Vec<f64> = (0..200)
        .map(|_| {
            let wi = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
            let [with, without] = [&spot, &plain].map(|spot| f64::from(mixture.pdf(wi, spot)) - uniform);
            with / without / (2.634 * f64::from(wi.dot(spot.normal))).exp()
        })
        .collect();
    assert!(ratios.iter().all(|ratio| (ratio / ratios[0] - 1.0).abs() < 1e-2), "{name}: {ratios:?}");
    let of_contributions = VmfMixture::new(&mixture.lobes().collect::<Vec<_>>(), Vec3::ZERO, false).expect("the same");
    let at = |spot: &Spot| of_contributions.pdf(Vec3::Y, spot);
    assert_eq!(at(&spot), at(&plain), "what was learned with the cosine is not multiplied again");
}

/// Σ pdf · solid angle over all leaves is 1 to 1e-5, with the density looked up at each leaf's centre.
#[test]
fn s02_tree_densities_sum_to_one() {
    let trees = (0..6).map(|seed| random_tree(seed, 6, 0.6)).chain([chain(Vec3::X), chain(Vec3::new(-1.0, 1e-3, 0.0))]);
    for (i, distribution) in trees.enumerate() {
        let (tree, topology) = (SamplingTree::new(&distribution, 0.1, usize::MAX), distribution.topology());
        let mut sum = 0.0;
        for level in 0..topology.levels() {
            let side = 0.5f64.powi(level as i32);
            for node in topology.level(level).filter(|&node| topology.is_leaf(node)) {
                let center = topology.cell[node].map(|c| (f64::from(c) + 0.5) * side);
                sum += f64::from(tree.pdf(cylindrical::to_direction(center))) * 4.0 * PI * side * side;
            }
        }
        assert!((sum - 1.0).abs() < 1e-5, "tree {i}: {sum}");
    }
}

/// With matt and rough surfaces, one that lets light through, one with a delta lobe, and a point of a medium. Catches a density
/// that leaves out the other strategy, world and local directions mixed up, a frame that a medium has not, and a weight that is not
/// f·cos θ over the whole mixture's density. Directions in which f is zero and delta lobes are lost.
#[test]
fn s01_mixture_follows_its_density() {
    let n = Vec3::new(0.3, 0.5, -0.8).normalize();
    let surface = Surface {
        point: Vec3::splat(0.5),
        error: Vec3::ZERO,
        normal: n,
        shading: n,
        smooth: n,
        uv: Vec2::ZERO,
        distance: 1.0,
        shape: 0,
        angle: 0.0,
    };
    let out = surface.frame().to_world(Vec3::new(0.6, 0.0, 0.8));
    let inside = Surface::in_medium(surface.point, 1.0, out);
    let constant = |value: f32| Texture::Constant(Vec3::splat(value));
    let metal = Metal { eta: Vec3::splat(0.2), k: Vec3::splat(3.9), reflectance: constant(1.0) };
    let facets = Microfacets::even(Shape::Ggx, 0.3);
    let chalk = Material { two_sided: true, ..Kind::Diffuse(Diffuse { reflectance: constant(1.0) }).into() };
    let [metal, glass, plastic]: [Material; 3] = [
        Kind::RoughConductor(RoughConductor { metal, facets }).into(),
        Kind::RoughDielectric(RoughDielectric { eta: 1.5, facets }).into(),
        Kind::Plastic(Plastic::new(constant(0.6), constant(1.0), 1.5, true, None)).into(),
    ];
    // And whether it reflects or scatters everything.
    let cases = [
        ("chalk", &surface, chalk.at(surface.uv), true),
        ("metal", &surface, metal.at(surface.uv), false),
        ("glass", &surface, glass.at(surface.uv), false),
        ("plastic", &surface, plastic.at(surface.uv), false),
        ("fog", &inside, Bsdf::phase(HenyeyGreenstein::new(0.8)), true),
    ];
    for (name, surface, bsdf, white) in cases {
        let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
        cache.find_or_insert(surface.point, surface.normal_towards(out));
        let directions = Some(SamplingTree::new(&random_tree(11, 5, 0.7), 0.1, usize::MAX).into());
        // Seen from off the centre of the voxel.
        let parallax = Parallax { centre: Vec3::new(0.2, 0.6, 0.4), curvature: 1.2 };
        let roulette = AdjointRoulette::UNKNOWN;
        let field = GuideField::new(cache, vec![VoxelGuide { directions, parallax, bsdf_fraction: 0.3, roulette }]);
        let guide = field.at(surface.point, surface.normal_towards(out));
        assert!(guide.is_some(), "{name}: nothing guides");
        let mixture = Mixture::new(surface, bsdf, false, out, guide);
        let density = |wi| {
            let (value, pdf) = (mixture.eval(wi), mixture.pdf(wi).0);
            if value == Vec3::ZERO { 0.0 } else { f64::from(pdf) }
        };
        // In fog all of the tree counts, whose narrow leaves coarser cells would miss parts of.
        let cells = if name == "fog" { [96, 96] } else { [32, 32] };
        // Rounded to singles a direction may fall into the next leaf of the guide's tree.
        let moved = AtomicU32::new(0);
        Chart::around(Vec3::Z, 1.0).check(&format!("mixture with {name}"), cells, density, |random| {
            let numbers = Random::new(random.next_u64(), 0, 0);
            let (sample, _) = mixture.sample(&numbers, Transport::Radiance).filter(|(sample, _)| !sample.delta)?;
            let (value, pdf) = (mixture.eval(sample.direction), mixture.pdf(sample.direction).0);
            if (pdf - sample.pdf).abs() > 1e-3 * pdf {
                moved.fetch_add(1, Ordering::Relaxed);
                return Some(sample.direction);
            }
            // Near the horizon the cosine, and with it f·cos θ, is known to 1e-7 absolutely after a turn to the world and back.
            let difference = (sample.weight * pdf - value).abs().max_element();
            assert!(difference <= 1e-3 * value.max_element() + 1e-6, "{value}");
            assert!((0.0..=1.0).contains(&sample.bsdf_share));
            // What roulette goes by: chalk reflects all, wherever the guide wants to go.
            let reflected = sample.bsdf_weight.max_element();
            assert!(!white || (reflected - 1.0).abs() < 1e-3, "{name}: {reflected}");
            Some(sample.direction)
        });
        let moved = moved.into_inner();
        assert!(moved < 50, "{name}: {moved} of a million densities are not those looked up");
    }
}
