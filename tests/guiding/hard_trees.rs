//! Hard cases of arithmetic in what guides directions: the map of the sphere, quadtrees, voxels, and the mixture with a BSDF.
//!
//! Tests named a01 to a19 and s01 to s09 all over this project stand for the traps that renderers of this kind are known to
//! fall into: a for arithmetic, s for statistics. `tests/mutants/run` takes the remedy of each a case out of the program and
//! expects its test to fail. What needs whole scenes is in hard_scenes.rs and roulette.rs of `transport`.

use crate::support::records;

use std::f64::consts::PI;

use fanal::base::random::Random;
use fanal::geometry::Surface;
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::gmm::gaussian::Gaussian;
use fanal::guiding::gmm::mixture::GaussianMixture;
use fanal::guiding::learn::adam::Adam;
use fanal::guiding::learn::learner::{Learner, LearnerSettings, Use};
use fanal::guiding::record::PathRecord;
use fanal::guiding::sample::field::{GuideField, VoxelGuide};
use fanal::guiding::sample::lanes::GuideLanes;
use fanal::guiding::sample::roulette::AdjointRoulette;
use fanal::guiding::target::{DirectLight, Target};
use fanal::guiding::tree::TreeSettings;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::leaves::Layout;
use fanal::guiding::tree::quadtree::{Place, Placed, Quadtree};
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::{MAX_LEVEL, MAX_NODES, Topology};
use fanal::guiding::vmf::lobe::Lobe;
use fanal::guiding::vmf::mixture::VmfMixture;
use fanal::integrators::mixture::Mixture;
use fanal::materials::blend::Blend;
use fanal::materials::conductor::Conductor;
use fanal::materials::diffuse::Diffuse;
use fanal::materials::fresnel::Metal;
use fanal::materials::texture::Texture;
use fanal::materials::{Kind, Material, Transport};
use fanal::math::cylindrical;
use fanal::math::lanes::{self, Kernel, LANES, Vectors, Wide, vector};
use fanal::reconstruct::neural::inputs_of;
use fanal::reconstruct::{Neural, Reconstructor};
use glam::{Vec2, Vec3};
use records::{chain, path_at, photon_at};

fn direction(random: &mut Random) -> Vec3 {
    cylindrical::to_direction([random.next_f64(), random.next_f64()])
}

/// All nodes of `levels` levels below the root.
fn full(levels: u32) -> Topology {
    let inner = (4usize.pow(levels) - 1) / 3;
    let split: Vec<bool> = (0..inner + 4usize.pow(levels)).map(|node| node < inner).collect();
    Topology::from_split(&split).expect("a full tree")
}

/// Density integrated over the sphere, leaf by leaf.
fn mass(tree: &SamplingTree, topology: &Topology) -> f64 {
    let leaf = |level: usize, node: usize| {
        let side = 0.5f64.powi(level as i32);
        let centre = topology.cell[node].map(|c| (f64::from(c) + 0.5) * side);
        f64::from(tree.pdf_at(cylindrical::cell_of(centre))) * 4.0 * PI * side * side
    };
    let leaves = |level: usize| topology.level(level).filter(|&node| topology.is_leaf(node));
    (0..topology.levels()).flat_map(|level| leaves(level).map(move |node| leaf(level, node))).sum()
}

/// A sample's density looked up again must be the one that it came with, at the poles and where φ begins anew too: light sampling
/// and guiding are weighted by it. Rounding to three singles may carry a direction over the edge of its cell, by less than 1e-7
/// of the square; anywhere else the two must agree to 1e-4.
#[test]
fn a01_density_of_a_sample_is_the_one_returned() {
    let mut random = Random::new(1, 0, 0);
    let topology = full(6);
    let weights: Vec<f64> = topology
        .leaves()
        .map(|_| 10f64.powf(f64::from(random.range(-3.0, 3.0))) * f64::from(random.below(5)))
        .collect();
    let tree = SamplingTree::new(&Distribution::from_leaf_weights(topology, &weights), 0.05, usize::MAX);
    let n = 1_000_000;
    let mut over_an_edge = 0;
    for _ in 0..n {
        let (direction, pdf) = tree.sample(random.next_2d_f64());
        let again = tree.pdf(direction);
        assert!((direction.length() - 1.0).abs() < 1e-6 && pdf > 0.0 && pdf.is_finite());
        if (again - pdf).abs() > 1e-4 * pdf {
            over_an_edge += 1;
            let from_edge = cylindrical::to_square(direction).map(|c| (64.0 * c - (64.0 * c).round()).abs() / 64.0);
            assert!(from_edge[0].min(from_edge[1]) < 1e-7, "{direction}: {pdf} {again}, {from_edge:?} from an edge");
        }
    }
    assert!(over_an_edge < n / 20_000, "{over_an_edge} of {n}");
}

/// A guide with four fifths of its mass in the deepest leaves around a direction.
fn peaked(towards: Vec3, uniform: f32) -> SamplingTree {
    let topology = chain(towards);
    let weights: Vec<f64> = (0..topology.leaves().count()).map(|leaf| 3f64.powi(leaf as i32 / 3)).collect();
    SamplingTree::new(&Distribution::from_leaf_weights(topology, &weights), uniform, usize::MAX)
}

/// A mixture of up to twenty lobes.
fn lobes(random: &mut Random) -> VmfMixture {
    let count = 1 + (20.0 * random.next_f32()) as usize;
    let lobe = |_| Lobe {
        mean: direction(random),
        kappa: 10f32.powf(random.range(-2.0, 4.0)),
        weight: 1.0 / count as f32,
        nearness: 0.8 * random.next_f32(),
    };
    VmfMixture::new(&(0..count).map(lobe).collect::<Vec<_>>(), Vec3::ZERO, true).expect("these are lobes")
}

/// A mixture of up to eight Gaussians.
fn gaussians(random: &mut Random) -> GaussianMixture {
    let count = 1 + random.below(8);
    let gaussian = |_| Gaussian {
        weight: 1.0 / count as f32,
        mean: random.next_2d(),
        deviation: random.range(0.01, 0.4),
        slope: random.range(-4.0, 4.0),
        residual: random.range(0.01, 0.4),
    };
    GaussianMixture::new(&(0..count).map(gaussian).collect::<Vec<_>>()).expect("these are Gaussians")
}

/// What guides draw together, and say of directions.
struct Together<'a> {
    guides: GuideLanes<'a>,
    points: [Vec3; LANES],
    normals: [Vec3; LANES],
    u: [[f64; 2]; LANES],
    towards: [Vec3; LANES],
    /// Lanes that are asked.
    asked: u32,
}

impl Kernel for Together<'_> {
    type Output = (Vectors, [f32; LANES], [f32; LANES]);

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Self::Output {
        let Self { guides, points, normals, u, towards, asked } = self;
        let (points, normal) = (wide.vectors(|lane| points[lane]), |lane: usize| normals[lane]);
        let (drawn, pdf) = guides.sample(wide, points, (asked, &u), normal);
        let densities = guides.pdf(wide, points, (asked, wide.vectors(|lane| towards[lane])), normal);
        (wide.store_vectors(drawn), wide.store(pdf), wide.store(densities))
    }
}

/// Guides of different depths, of lobes or of Gaussians, some of them absent, draw and judge directions together as
/// alone.
#[test]
fn guides_in_lanes_have_the_bits_of_guides_alone() {
    let mut random = Random::new(31, 0, 0);
    let voxel = |random: &mut Random, k: usize| VoxelGuide {
        directions: (k % 5 != 4).then(|| match k % 4 {
            3 if k % 8 == 3 => gaussians(random).into(),
            3 => lobes(random).into(),
            0 => peaked(direction(random), 0.2).into(),
            1 => SamplingTree::new(&Distribution::uniform(), 1.0, usize::MAX).into(),
            _ => {
                let weights: Vec<f64> = (0..64).map(|_| random.next_f64().powi(4)).collect();
                SamplingTree::new(&Distribution::from_leaf_weights(full(3), &weights), 0.01, usize::MAX).into()
            }
        }),
        parallax: Parallax { centre: Vec3::ZERO, curvature: [0.0, 0.7][k % 2] },
        bsdf_fraction: 0.5,
        roulette: AdjointRoulette::UNKNOWN,
    };
    let voxels: [VoxelGuide; LANES] = std::array::from_fn(|k| voxel(&mut random, k));
    for _ in 0..500 {
        let [points, normals, towards] =
            [0, 1, 2].map(|_| std::array::from_fn::<_, LANES, _>(|_| direction(&mut random)));
        let points = points.map(|point| 0.9 * random.next_f32() * point);
        let u = std::array::from_fn(|_| random.next_2d_f64());
        let guides = GuideLanes::new(|lane| Some(&voxels[lane]));
        let asked = random.next_u64() as u32 & guides.any;
        let together = Together { guides, points, normals, u, towards, asked };
        let Ok((directions, densities, found)) = lanes::run(together) else { return };
        for lane in (0..LANES).filter(|lane| asked >> lane & 1 == 1) {
            let alone = voxels[lane].at(points[lane]).expect("it has a guide").facing(normals[lane]);
            assert_eq!((vector(&directions, lane), densities[lane]), alone.sample(u[lane]), "{lane}");
            assert_eq!(found[lane], alone.pdf(towards[lane]), "{lane}");
        }
        assert_eq!(guides.any, (0..LANES).fold(0, |any, k| any | u32::from(voxels[k].directions.is_some()) << k));
        let fractions = guides.bsdf_fractions;
        assert!((0..LANES).all(|k| fractions[k] == if voxels[k].directions.is_some() { 0.5 } else { 1.0 }));
    }
}

/// The same at level 20, at the poles, where φ begins anew, at the equator and elsewhere. There a cell is 2⁻²⁰ wide. A
/// direction in singles has a z that is off by up to 2⁻²⁵, which takes 1 in 64 over an edge of their cells, and a φ
/// that takes at most 1 in 300; so less than 2 % lie in a neighbour, and all of these closer to its edge than they are
/// off. (Bounded at 2.5 %: eight standard errors of 50,000 samples more.)
#[test]
fn a01_density_of_a_sample_in_the_deepest_leaves() {
    let mut random = Random::new(8, 0, 0);
    let mut places = [
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [1e-3, -2e-4, 1.0],
        [1.0, 0.0, 0.0],
        [1.0, -1e-7, 0.0],
        [0.8, -1e-7, 0.6],
        [0.8, 0.0, -0.6],
        [-1.0, -1e-9, 0.3],
        [0.0, 1.0, 0.0],
    ]
    .map(|place| Vec3::from_array(place).normalize())
    .to_vec();
    places.extend((0..11).map(|_| direction(&mut random)));
    let cells = f64::from(cylindrical::CELLS);
    for towards in places {
        let tree = peaked(towards, 1e-3);
        let n = 50_000;
        let (mut deep, mut over_an_edge) = (0, 0);
        for _ in 0..n {
            let (direction, pdf) = tree.sample(random.next_2d_f64());
            let again = tree.pdf(direction);
            // Leaves above the deepest level have less.
            deep += usize::from(pdf > 5e9);
            if (again - pdf).abs() > 1e-4 * pdf {
                over_an_edge += 1;
                let from_edge =
                    cylindrical::to_square(direction).map(|c| (cells * c - (cells * c).round()).abs() / cells);
                assert!(
                    from_edge[0].min(from_edge[1]) < 3e-8,
                    "{direction}: {pdf} {again}, {from_edge:?} from an edge"
                );
            }
        }
        assert!(deep > n * 3 / 4, "{towards}: {deep} of {n} in the deepest leaves");
        assert!(over_an_edge < n / 40, "{towards}: {over_an_edge} of {n}");
    }
}

/// Places of directions, found together.
struct Places([Vec3; LANES]);

impl Kernel for Places {
    type Output = [[i32; LANES]; 2];

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Self::Output {
        cylindrical::to_place(wide.vectors(|lane| self.0[lane])).map(|steps| wide.store_bits(steps))
    }
}

/// The corners of the square: no NaN from the root of a negative number, no cell outside, and the same cell there and back.
#[test]
fn a01_poles_and_seam_have_their_cells() {
    let last = f64::from(cylindrical::CELLS);
    let ends = [0.0, 0.5 / last, 0.25, 0.5, 1.0 - 0.5 / last, 1.0 - f64::EPSILON / 2.0, 1.0, 1.0 + 1e-15, -1e-15];
    for (x, y) in ends.into_iter().flat_map(|x| ends.map(|y| (x, y))) {
        let direction = cylindrical::to_direction([x, y]);
        assert!((direction.length() - 1.0).abs() < 1e-6, "{x} {y}: {direction}");
        let cell = cylindrical::to_cell(direction);
        assert!(cell.iter().all(|&c| c < cylindrical::CELLS), "{x} {y}: {cell:?}");
    }
    for z in [1.000_000_1f32, -1.000_000_1] {
        let [x, _] = cylindrical::to_cell(Vec3::new(1e-20, -1e-20, z));
        assert_eq!(x, if z > 0.0 { cylindrical::CELLS - 1 } else { 0 });
    }
    // In lanes as alone: what is too large for an integer is not the same number for all processors.
    let towards = |lane: usize| Vec3::new(lane as f32 - 7.5, 1.5 - lane as f32, 0.0) * 1e-3;
    let poles = |up: f32| std::array::from_fn(|lane| (towards(lane) + up * Vec3::Z).normalize().with_z(up));
    for directions in [1.0, -1.0, 1.000_000_1, -1.000_000_1, 0.999_999_94].map(poles) {
        let alone = directions.map(|direction| cylindrical::to_place::<f32>(direction.into()));
        let Ok([x, y]) = lanes::run(Places(directions)) else { break };
        assert_eq!(std::array::from_fn(|lane| [x[lane], y[lane]]), alone);
    }
    // A hair below the positive x axis a turn is nearly full, and must not be full.
    assert_eq!(cylindrical::to_cell(Vec3::new(1.0, -1e-30, 0.0))[1], cylindrical::CELLS - 1);
    assert_eq!(cylindrical::to_cell(Vec3::new(1.0, 0.0, 0.0))[1], 0);
}

/// A leaf at level 20 covers 2⁻⁴⁰ of the sphere. With shares that have no rounding its density has a closed form, which must be met
/// to 1e-5; and places drawn in such cells must lie in them, which coordinates in single precision would not.
#[test]
fn a02_deepest_leaves_are_exact() {
    let mut random = Random::new(2, 0, 0);
    for share in [13.0f64 / 16.0, 0.25, 1.0 / 16.0] {
        for _ in 0..20 {
            let towards = direction(&mut random);
            let topology = chain(towards);
            let others = (1.0 - share) / 3.0;
            // Half and two quarters of the rest: multiples of 2⁻¹⁶, which the tree stores without rounding.
            let rest = [1.5 * others, 0.75 * others, 0.75 * others];
            let mut shares = vec![1.0f32; topology.len()];
            for parent in (0..topology.len()).filter(|&node| !topology.is_leaf(node)) {
                let first = topology.first_child[parent] as usize;
                let mut rest = rest.iter();
                let on = (first..first + 4).find(|&child| !topology.is_leaf(child)).unwrap_or(first);
                for (child, own) in (first..).zip(&mut shares[first..first + 4]) {
                    *own = if child == on { share } else { *rest.next().expect("three others") } as f32;
                }
            }
            let deepest = topology.level(MAX_LEVEL).start;
            let cell = topology.cell[deepest];
            let tree = SamplingTree::new(&Distribution::from_shares(topology.clone(), &shares), 0.1, usize::MAX);
            let expected = (0.9 * (4.0 * share).powi(20) + 0.1) / (4.0 * PI);
            let found = f64::from(tree.pdf_at(cell));
            assert!((found / expected - 1.0).abs() < 1e-5, "{share}: {found} instead of {expected}");
            assert!((mass(&tree, &topology) - 1.0).abs() < 1e-5);
            for _ in 0..50_000 {
                let (place, relative) = tree.sample_square(random.next_2d_f64());
                let again = f64::from(tree.pdf_at(cylindrical::cell_of(place))) * 4.0 * PI;
                assert!((again / relative - 1.0).abs() < 1e-5, "{share}: {place:?} has {again}, not {relative}");
            }
        }
    }
}

/// A quadtree of 64 leaves with one sample per entry: a direction and a value.
fn deposited(target: Target, layout: Layout, samples: &[(Vec3, f32)]) -> Quadtree {
    let place = Place { parallax: Parallax::NONE, direct: DirectLight::All, filtered: false };
    let mut tree = Quadtree::new(full(3), layout, target);
    let records: Vec<PathRecord> =
        samples.iter().map(|&(direction, value)| path_at(Vec3::splat(0.5), direction, value)).collect();
    tree.deposit(&Placed::new(&place, target, records.iter(), std::iter::empty()));
    tree
}

/// Without energy every direction must be as likely as any other, not 0/0.
#[test]
fn a03_no_energy_is_uniform() {
    let mut random = Random::new(3, 0, 0);
    for samples in [&[][..], &[(Vec3::X, 0.0), (Vec3::Z, 0.0)]] {
        let tree = deposited(Target::Variance, Layout::Values, samples);
        assert!(!tree.has_energy());
        let counted = tree.leaves().hybrid(0.5);
        assert_eq!(counted, Distribution::uniform());
        let guide = SamplingTree::new(&counted, 0.0, usize::MAX);
        for _ in 0..1000 {
            let (drawn, pdf) = guide.sample(random.next_2d_f64());
            for pdf in [pdf, guide.pdf(drawn)] {
                assert!((f64::from(pdf) * 4.0 * PI - 1.0).abs() < 1e-6, "{pdf}");
            }
        }
    }
}

/// Energies of 1e-38 and 1e38, and none at all, in one tree: sums and squares must neither overflow nor vanish, the bright leaf must
/// get the mass, and no direction may have density 0, or light from there would be lost for good.
#[test]
fn a03_energies_of_all_sizes_in_one_tree() {
    let mut random = Random::new(4, 0, 0);
    for target in [Target::Radiance, Target::Variance] {
        for scale in [1e-38f32, 1.0, 1e38] {
            let samples = [(Vec3::X, scale), (Vec3::X, scale), (Vec3::Z, 1e-38), (Vec3::NEG_Z, 1e-30)];
            let tree = deposited(target, Layout::Values, &samples);
            let topology = tree.topology().clone();
            // Even where no uniform part is asked for.
            for uniform in [0.0, 0.1] {
                let guide = SamplingTree::new(&tree.leaves().hybrid(1.0), uniform, usize::MAX);
                assert!((mass(&guide, &topology) - 1.0).abs() < 1e-5);
                for _ in 0..1000 {
                    let pdf = guide.pdf(direction(&mut random));
                    assert!(pdf > 0.0 && pdf.is_finite(), "{pdf}");
                }
                let brightest = if scale > 1e-37 { guide.pdf(Vec3::X) } else { guide.pdf(Vec3::NEG_Z) };
                let share = f64::from(brightest) * 4.0 * PI / 64.0;
                assert!(share > 0.85 * f64::from(1.0 - uniform), "{target:?} {scale}: {share}");
            }
        }
    }
}

fn with_tree(tree: TreeSettings) -> LearnerSettings {
    LearnerSettings { tree, ..LearnerSettings::default() }
}

fn learner() -> Learner {
    Learner::new(LearnerSettings { voxel_samples: 100, ..LearnerSettings::default() })
}

/// The learner's own distributions become the next guides, and voxels are halved.
fn iterate(learner: &mut Learner) {
    learner
        .fit(&mut |trees| Ok(trees.iter().map(|tree| (tree.counted.clone(), 0.1).into()).collect()))
        .expect("nothing here fails");
    learner.refine(1);
}

/// Nothing known must mean BSDF sampling, whoever asks: before the first sample, in a voxel whose only sample found nothing, where
/// no voxel is. A count of zero is nowhere divided by. An iteration without samples must not forget the guide.
#[test]
fn a04_nothing_known_leaves_the_bsdf_alone() {
    let mut empty = learner();
    empty.absorb(&[], &[photon_at(Vec3::ONE, Vec3::Z, 1.0)], true);
    iterate(&mut empty);
    assert!(empty.field(Use::Learning).at(Vec3::ONE, Vec3::Y).is_none());

    let here = Vec3::splat(0.5);
    let mut dark = learner();
    dark.absorb(&[path_at(here, Vec3::Z, 0.0)], &[], true);
    assert!(dark.counted()[0].is_none(), "a sample without value says nothing of where light is");
    iterate(&mut dark);
    let field = dark.field(Use::Learning);
    let voxel = field.at(here, Vec3::Y).expect("the sample made a voxel");
    assert!(voxel.directions.is_none() && voxel.at(here).is_none());
    assert!(field.at(Vec3::splat(1e9), Vec3::Y).is_none() && field.at(here, Vec3::NEG_X).is_none());

    let mut one = learner();
    one.absorb(&[path_at(here, Vec3::Z, 1.0)], &[], true);
    iterate(&mut one);
    for _ in 0..3 {
        let field = one.field(Use::Learning);
        let guide = field.at(here, Vec3::Y).and_then(|voxel| voxel.at(here)).expect("one sample is something");
        assert!(guide.pdf(Vec3::Z) > guide.pdf(Vec3::NEG_Z) && guide.pdf(Vec3::NEG_Z) > 0.0);
        // No samples at all.
        iterate(&mut one);
    }
}

/// Samples that all lie in one point: halving their voxel separates nothing, and must end where its sides have no middle left; the
/// tree of their one direction ends at its depth limit. What is kept must not grow any more.
#[test]
fn a05_one_point_does_not_fill_the_memory() {
    for (at, towards) in [(Vec3::splat(1e6), Vec3::new(0.3, 0.5, 0.8).normalize()), (Vec3::splat(-3e5), Vec3::Z)] {
        let mut learner = learner();
        let (paths, photons) = (vec![path_at(at, towards, 1.0); 5000], vec![photon_at(at, towards, 1.0); 5000]);
        let mut voxels = vec![];
        for _ in 0..30 {
            learner.absorb(&paths, &photons, true);
            iterate(&mut learner);
            voxels.push(learner.voxels());
        }
        assert!(voxels[20] < 25 && voxels[20..].iter().all(|&v| v == voxels[20]), "{voxels:?}");
        let trees = learner.model().trees().expect("the model is trees");
        let nodes = trees.quadtrees().map(|tree| tree.topology().len()).max();
        let deepest = trees.quadtrees().map(|tree| tree.topology().levels()).max();
        assert!(nodes <= Some(MAX_NODES) && deepest <= Some(MAX_LEVEL + 1));
        assert!(learner.field(Use::Learning).bytes() < 1 << 20);
    }
}

/// A sample of 1e30 among thousands of usual ones: the network's inputs and the distribution that it makes stay finite, and no
/// direction is shut out.
#[test]
fn a10_a_firefly_in_training_is_survived() {
    let mut random = Random::new(5, 0, 0);
    let network = Neural::built_in().expect("the model fits the program");
    for firefly in [1e10, 1e19, 1e30, f32::MAX] {
        let mut learner = Learner::new(with_tree(TreeSettings { layout: Layout::Network, ..TreeSettings::default() }));
        let mut paths: Vec<PathRecord> =
            (0..5000).map(|_| path_at(Vec3::splat(0.5), direction(&mut random), 1.0)).collect();
        paths.push(path_at(Vec3::splat(0.5), Vec3::X, firefly));
        learner.absorb(&paths, &[], true);
        let trees: Vec<_> = learner.counted().into_iter().flatten().collect();
        let features = inputs_of(&trees[0]).features;
        assert!(features.iter().all(|x| x.is_finite() && x.abs() < 100.0), "{firefly}");
        let counted = trees[0].counted.clone();
        let (reconstructed, uniform) = network.reconstruct(&trees).expect("the network runs").remove(0).first;
        for distribution in [counted, reconstructed] {
            let tree = SamplingTree::new(&distribution, uniform, usize::MAX);
            assert!((mass(&tree, distribution.topology()) - 1.0).abs() < 1e-5, "{firefly}");
            assert!((0..1000).all(|_| tree.pdf(direction(&mut random)) > 0.0));
        }
    }
}

/// However long one strategy alone is rewarded, and by however much: the other must keep a tenth, or its density would count
/// for nothing where it is the only one that finds light.
#[test]
fn a14_no_strategy_is_given_up() {
    for (share, estimate) in [(0.0, 1.0), (1.0, 1.0), (0.0, 1e30), (1.0, 1e-30), (0.0, f64::MAX), (1.0, 5e-324)] {
        let mut adam = Adam::default();
        for _ in 0..100_000 {
            adam.step(estimate, share, 0.5);
        }
        let fraction = adam.fraction();
        assert!((0.1 - 1e-12..=0.9 + 1e-12).contains(&fraction), "{share} {estimate}: {fraction}");
    }
}

/// By default measured moments decide how much the BSDF is sampled once learning is over. Where every sample says that
/// it alone is best, that is always, and the voxel has no tree that could be sampled; where every sample says that it
/// never finds the light, it keeps a tenth. While learning both have a half.
#[test]
fn a14_a_guide_that_does_not_help_is_not_sampled() {
    let mut random = Random::new(9, 0, 0);
    let here = Vec3::splat(0.5);
    for (bsdf_share, expected) in [(1.0f32, 1.0f32), (0.0, 0.1)] {
        let mut learner = learner();
        // The guide of the first iteration is judged in the second.
        for _ in 0..2 {
            let record = |random: &mut Random| PathRecord { bsdf_share, ..path_at(here, direction(random), 1.0) };
            let paths: Vec<PathRecord> = (0..1000).map(|_| record(&mut random)).collect();
            learner.absorb(&paths, &[], true);
            iterate(&mut learner);
        }
        let [learning, after] = [Use::Learning, Use::Rendering].map(|of| {
            let field = learner.field(of);
            field.at(here, Vec3::Y).map(|voxel| (voxel.bsdf_fraction, voxel.directions.is_some()))
        });
        assert_eq!(learning, Some((0.5, true)), "{bsdf_share}");
        assert_eq!(after, Some((expected, expected < 1.0)), "{bsdf_share}");
    }
}

fn wall() -> Surface {
    let n = Vec3::new(0.3, 0.5, -0.8).normalize();
    let (point, error) = (Vec3::splat(0.5), Vec3::ZERO);
    Surface { point, error, normal: n, shading: n, smooth: n, uv: Vec2::ZERO, distance: 1.0, shape: 0, angle: 0.0 }
}

/// One voxel around the wall with the given guide.
fn field(surface: &Surface, out: Vec3, tree: Option<SamplingTree>, bsdf_fraction: f32) -> GuideField {
    let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
    cache.find_or_insert(surface.point, surface.normal_towards(out));
    let (directions, parallax, roulette) = (tree.map(Into::into), Parallax::NONE, AdjointRoulette::UNKNOWN);
    let guide = VoxelGuide { directions, parallax, bsdf_fraction, roulette };
    GuideField::new(cache, vec![guide])
}

fn white() -> Texture {
    Texture::Constant(Vec3::ONE)
}

/// Half a mirror, half chalk, beside a guide, which cannot choose the mirror's direction: that is drawn as often and
/// weighs as much as without a guide, and the guide's density counts for the rest of the samples only. Forgotten, one
/// of both would be too dark.
#[test]
fn a11_delta_lobes_are_not_guided() {
    let surface = wall();
    let out = surface.frame().to_world(Vec3::new(0.6, 0.0, 0.8));
    let metal = Metal { eta: Vec3::ZERO, k: Vec3::ONE, reflectance: white() };
    let parts = [Kind::Conductor(Conductor { metal }).into(), Kind::Diffuse(Diffuse { reflectance: white() }).into()];
    let weight = Texture::Constant(Vec3::splat(0.5));
    let material: Material = Kind::Blend(Box::new(Blend { weight, parts })).into();
    let mirrored = surface.frame().to_world(Vec3::new(-0.6, 0.0, 0.8));
    for alpha in [0.1, 0.5, 0.9] {
        let tree = SamplingTree::new(&Distribution::from_leaf_weights(full(1), &[1.0, 3.0, 0.0, 2.0]), 0.1, usize::MAX);
        let field = field(&surface, out, Some(tree), alpha);
        let guide = field.at(surface.point, surface.normal_towards(out));
        let mixture = Mixture::new(&surface, material.at(surface.uv), false, out, guide);
        let n = 200_000;
        let (mut mirror, mut all) = (0.0, 0.0);
        for i in 0..n {
            let Some((sample, _)) = mixture.sample(&Random::new(6, 0, i), Transport::Radiance) else { continue };
            all += f64::from(sample.weight.x) / n as f64;
            if sample.delta {
                assert!(sample.direction.distance(mirrored) < 1e-5 && sample.value == Vec3::ZERO);
                mirror += f64::from(sample.weight.x) / n as f64;
            }
        }
        // Five standard errors and more at α = 0.1, where the chalk may weigh 10.
        assert!((mirror - 0.5).abs() < 0.025 && (all - 1.0).abs() < 0.05, "α {alpha}: {mirror} {all}");
    }
}

/// A guide that points into the wall, away from all light, or evenly somewhere wrong, costs at most the part of the samples that it
/// takes: the second moment of f/p stays below 1/α times that of BSDF sampling, whatever the tree says, and the mean stays.
#[test]
fn a19_a_wrong_guide_costs_little() {
    let surface = wall();
    let out = surface.frame().to_world(Vec3::new(0.6, 0.0, 0.8));
    let material: Material = Kind::Diffuse(Diffuse { reflectance: white() }).into();
    let wrong = [-surface.shading, surface.frame().s, surface.shading];
    for (towards, alpha) in wrong.into_iter().flat_map(|towards| [0.1f32, 0.3, 0.5].map(|alpha| (towards, alpha))) {
        let field = field(&surface, out, Some(peaked(towards, 1e-3)), alpha);
        let guide = field.at(surface.point, surface.normal_towards(out));
        let mixture = Mixture::new(&surface, material.at(surface.uv), false, out, guide);
        let n = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..n {
            // Light that a diffuse wall reflects best: radiance 1 everywhere, for which BSDF sampling has no variance.
            let weight =
                mixture.sample(&Random::new(7, 0, i), Transport::Radiance).map_or(0.0, |(s, _)| f64::from(s.weight.x));
            sum += weight / n as f64;
            squares += weight * weight / n as f64;
        }
        let limit = 1.0 / f64::from(alpha);
        assert!(squares < 1.02 * limit, "{towards} α {alpha}: {squares} against {limit}");
        let error = ((squares - sum * sum) / n as f64).sqrt();
        assert!((sum - 1.0).abs() < 5.0 * error + 1e-4, "{towards} α {alpha}: {sum} ± {error}");
    }
}
