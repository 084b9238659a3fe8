//! Slow twins in double precision, written from the formulas of the literature without a look at how the program arranges them,
//! against trees, mixtures and the network in single precision (`oracle_materials.rs` has those of materials): relative errors of at
//! most 1e-4 over 100,000 inputs and more of each, most of them at the edge of what can come up. Where a larger error is inherent,
//! its bound is stated beside the test.

use crate::support::network as support;
use crate::support::twins;

use std::f64::consts::PI;
use std::path::Path;

use fanal::base::random::Random;
use fanal::geometry::Surface;
use fanal::guiding::cache::SpatialCache;
use fanal::guiding::cache::parallax::Parallax;
use fanal::guiding::sample::field::{GuideField, VoxelGuide};
use fanal::guiding::sample::roulette::AdjointRoulette;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::features::{FEATURES, NodeInputs};
use fanal::guiding::tree::sampler::SamplingTree;
use fanal::guiding::tree::topology::{MAX_LEVEL, MAX_NODES, Topology};
use fanal::integrators::mixture::Mixture;
use fanal::materials::fresnel::Metal;
use fanal::materials::microfacet::{Microfacets, Shape};
use fanal::materials::phase::HenyeyGreenstein;
use fanal::materials::rough_conductor::RoughConductor;
use fanal::materials::texture::Texture;
use fanal::materials::{Bsdf, Kind, Material, Transport};
use fanal::math::{Frame, cylindrical};
use fanal::network::batch::{Batch, NONE};
use fanal::network::embedded::Embedded;
use fanal::network::growing::DecodeLevel;
use fanal::network::weights::Model;
use fanal::reconstruct::neural::inputs_of;
use glam::{DVec3, Vec2, Vec3};
use twins::{Facets, INPUTS, Worst, henyey_greenstein, in_front};

// ---- quadtrees ----

/// A tree down to level 20 with energies from 1e-38 to 1e38, and none.
fn tree(seed: u64) -> Distribution {
    let mut random = Random::new(seed, 1, 0);
    let (mut split, mut width) = (vec![], 1usize);
    for level in 0..=MAX_LEVEL {
        let keep = if level < 4 { 0.6 } else { 2.0 / width as f32 };
        let splits = |random: &mut Random, i: usize| {
            level < MAX_LEVEL && (level == 0 || (i == 0 && width > 1) || random.next_f32() < keep)
        };
        let flags: Vec<bool> = (0..width).map(|i| splits(&mut random, i)).collect();
        width = 4 * flags.iter().filter(|flag| **flag).count();
        split.extend(flags);
        if width == 0 || split.len() + width > MAX_NODES / 2 {
            split.extend(vec![false; width]);
            break;
        }
    }
    let topology = Topology::from_split(&split).expect("flags counted level by level");
    let weights: Vec<f64> = topology
        .leaves()
        .map(|_| if random.below(6) == 0 { 0.0 } else { 10f64.powf(random.next_f64() * 76.0 - 38.0) })
        .collect();
    Distribution::from_leaf_weights(topology, &weights)
}

/// The leaf around a point (z, φ) of the cylinder by halving intervals, with its level, its density relative to uniform, and how
/// near to its border the point is. Shares are those that the tree stores: where the children begin, rounded to 2⁻¹⁶.
fn leaf_density(distribution: &Distribution, direction: DVec3) -> (f64, f64) {
    let topology = distribution.topology();
    let turn = direction.y.atan2(direction.x);
    let phi = if turn < 0.0 { turn + 2.0 * PI } else { turn };
    let (mut z, mut turns, mut node, mut relative) = ([-1.0, 1.0], [0.0, 2.0 * PI], 0, 1.0);
    // Rounding moves directions by lengths: near the poles that is much in φ.
    let radius = direction.x.hypot(direction.y);
    let mut from_border = f64::INFINITY;
    while !topology.is_leaf(node) {
        let middle = [0.5 * (z[0] + z[1]), 0.5 * (turns[0] + turns[1])];
        let upper = [direction.z >= middle[0], phi >= middle[1]];
        from_border = from_border.min((direction.z - middle[0]).abs()).min((phi - middle[1]).abs() * radius);
        z[usize::from(!upper[0])] = middle[0];
        turns[usize::from(!upper[1])] = middle[1];
        let k = usize::from(upper[0]) + 2 * usize::from(upper[1]);
        let first = topology.first_child[node] as usize;
        let masses: Vec<f64> = (0..4).map(|k| distribution.node_mass()[first + k]).collect();
        let total: f64 = masses.iter().sum();
        let begin = |k: usize| {
            let before: f64 = masses[..k].iter().sum();
            let exact = if total > 0.0 { before / total } else { 0.25 * k as f64 };
            if k == 4 { 65536.0 } else { (exact * 65536.0).round().min(65535.0) }
        };
        relative *= 4.0 * (begin(k + 1) - begin(k)) / 65536.0;
        node = first + k;
    }
    (relative, from_border.min(phi * radius).min((2.0 * PI - phi) * radius))
}

/// Directions from all over the tree and from where it is densest, at level 20.
#[test]
fn quadtree_densities() {
    let mut worst = Worst::new("quadtree pdf");
    let mut random = Random::new(1, 0, 0);
    let trees: u64 = 400;
    for seed in 0..trees {
        let distribution = tree(seed);
        let uniform = [1e-4, 0.02, 0.5][seed as usize % 3];
        let guide = SamplingTree::new(&distribution, uniform, usize::MAX);
        for i in 0..2 * INPUTS / trees as usize {
            let direction = if i % 2 == 0 { guide.sample(random.next_2d_f64()).0 } else { any_direction(&mut random) };
            let (relative, from_border) = leaf_density(&distribution, direction.as_dvec3());
            // On a border the last bit of the angle decides.
            if from_border > 1e-14 {
                let u = f64::from(uniform);
                let expected = ((1.0 - u) * relative + u) / (4.0 * PI);
                worst.compare(guide.pdf(direction), expected, 0.0, || format!("tree {seed}, {direction}"));
            }
        }
    }
    worst.check(INPUTS);
}

fn any_direction(random: &mut Random) -> Vec3 {
    cylindrical::to_direction([random.next_f64(), random.next_f64()])
}

/// What sixteen bits for a share change: the bounds between children by half a step, that of the last one by a whole step, for each
/// level that a distribution has. That is what is sampled, so nothing is biased by it.
#[test]
fn stored_shares_are_near_the_given() {
    for seed in 0..50 {
        let distribution = tree(seed);
        let guide = SamplingTree::new(&distribution, 1e-4, usize::MAX);
        let topology = distribution.topology();
        let mut moved = 0.0;
        for level in 0..topology.levels() {
            let area = 0.25f64.powi(level as i32);
            for node in topology.level(level).filter(|&node| topology.is_leaf(node)) {
                let shift = MAX_LEVEL - level;
                let stored = f64::from(guide.pdf_at(topology.cell[node].map(|c| c << shift))) * 4.0 * PI * area;
                moved += (stored - (1.0 - 1e-4) * distribution.node_mass()[node] - 1e-4 * area).abs();
            }
        }
        let levels = (topology.levels() - 1) as f64;
        assert!(
            moved <= 2.0 * (0.5 + 0.5 + 1.0) / 65536.0 * levels + 1e-6,
            "tree {seed}: {moved} over {levels} levels"
        );
    }
}

// ---- mixture ----

/// A guide in the only voxel around a point.
struct Guided {
    distribution: Distribution,
    uniform: f32,
    parallax: Parallax,
    alpha: f32,
    point: Vec3,
}

impl Guided {
    fn new(seed: u64, point: Vec3, random: &mut Random) -> Self {
        let curvature = if seed.is_multiple_of(3) { 0.0 } else { random.range(0.1, 0.7) };
        Self {
            distribution: tree(1000 + seed),
            uniform: [0.01, 0.1][seed as usize % 2],
            parallax: Parallax { centre: Vec3::splat(0.5), curvature },
            alpha: random.range(0.05, 0.95),
            point,
        }
    }

    /// For what faces `normal` there; for a medium that is zero.
    fn field(&self, normal: Vec3) -> GuideField {
        let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
        cache.find_or_insert(self.point, normal);
        let directions = Some(SamplingTree::new(&self.distribution, self.uniform, usize::MAX).into());
        let (parallax, bsdf_fraction, roulette) = (self.parallax, self.alpha, AdjointRoulette::UNKNOWN);
        GuideField::new(cache, vec![VoxelGuide { directions, parallax, bsdf_fraction, roulette }])
    }

    /// α·p + (1 − α)·p_guide, the guide's directions carried from the centre of its voxel (dω = dω'·r²/(R²·cos)). None for a
    /// direction that singles may carry to another leaf.
    fn mixed(&self, wi: Vec3, scattered: f64) -> Option<f64> {
        // Along the ray from the point to the sphere of radius R around the centre.
        let (seen, carried) = carried(self.parallax, self.point, wi);
        let (relative, from_border) = leaf_density(&self.distribution, seen);
        let (u, a) = (f64::from(self.uniform), f64::from(self.alpha));
        let guided = ((1.0 - u) * relative + u) / (4.0 * PI) * carried;
        (from_border >= 1e-6).then_some(a * scattered + (1.0 - a) * guided)
    }
}

fn any_point(random: &mut Random) -> Vec3 {
    Vec3::new(random.next_f32(), random.next_f32(), random.next_f32())
}

/// Half of the directions drawn from the mixture, half anywhere; none where that absorbs.
fn drawn_or_any(mixture: &Mixture, random: &mut Random) -> Option<Vec3> {
    if random.below(2) == 0 {
        return Some(any_direction(random));
    }
    mixture.sample(&Random::new(random.next_u64(), 0, 0), Transport::Radiance).map(|(sample, _)| sample.direction)
}

/// Roughness is above 0.05, since a turn between world and surface moves a direction by 1e-7, which narrower lobes would show as
/// more than 1e-4.
#[test]
fn mixture_densities() {
    let mut worst = Worst::new("mixture pdf");
    let mut random = Random::new(11, 0, 0);
    for seed in 0..200 {
        let n = any_direction(&mut random);
        let point = any_point(&mut random);
        let frame = Frame::new(n);
        let (error, uv) = (Vec3::ZERO, Vec2::ZERO);
        let surface =
            Surface { point, error, normal: n, shading: n, smooth: n, uv, distance: 1.0, shape: 0, angle: 0.0 };
        let guided = Guided::new(seed, point, &mut random);
        let (shape, roughness) = (Shape::Ggx, random.range(0.05, 1.0));
        let metal = Metal { eta: Vec3::splat(0.2), k: Vec3::splat(3.9), reflectance: Texture::Constant(Vec3::ONE) };
        let facets = Microfacets::even(shape, roughness);
        let material: Material = Kind::RoughConductor(RoughConductor { metal, facets }).into();
        let wo = in_front(&mut random);
        let out = frame.to_world(wo);
        let field = guided.field(surface.normal_towards(out));
        let guide = field.at(point, surface.normal_towards(out));
        let mixture = Mixture::new(&surface, material.at(surface.uv), false, out, guide);
        let twin = Facets::even(shape, f64::from(roughness));
        let axes = [frame.s, frame.t, frame.n].map(Vec3::as_dvec3);
        let local = |w: Vec3| DVec3::from_array(axes.map(|axis| axis.dot(w.as_dvec3())));
        for _ in 0..1000 {
            let Some(wi) = drawn_or_any(&mixture, &mut random) else { continue };
            let (o, i) = (local(out), local(wi));
            let h = (o + i).normalize();
            let bsdf = if i.z > 0.0 && o.z > 0.0 { twin.visible_density(o, h) / (4.0 * o.dot(h)) } else { 0.0 };
            let Some(expected) = guided.mixed(wi, bsdf) else { continue };
            if i.z.abs() < 1e-6 || o.z.abs() < 1e-6 {
                continue;
            }
            let at = || format!("seed {seed}, roughness {roughness}, {o} {i}, {bsdf}");
            worst.compare(mixture.pdf(wi).0, expected, 0.0, at);
        }
    }
    worst.check(INPUTS);
}

/// At points of a medium, which have no normal: the phase function in the place of the BSDF, from isotropic to mean cosines of
/// ±0.95. Sharper peaks would show the rounding of directions as more than 1e-4.
#[test]
fn mixture_densities_in_media() {
    let mut worst = Worst::new("mixture pdf in media");
    let mut random = Random::new(12, 0, 0);
    for seed in 0..200 {
        let (point, out) = (any_point(&mut random), any_direction(&mut random));
        let surface = Surface::in_medium(point, 1.0, out);
        let guided = Guided::new(seed, point, &mut random);
        let g = if seed % 5 == 0 { 0.0 } else { random.range(-0.95, 0.95) };
        let field = guided.field(Vec3::ZERO);
        let guide = field.at(point, Vec3::ZERO);
        assert!(guide.is_some(), "nothing guides");
        let phase = Bsdf::phase(HenyeyGreenstein::new(g));
        let mixture = Mixture::new(&surface, phase, false, out, guide);
        for _ in 0..1000 {
            let Some(wi) = drawn_or_any(&mixture, &mut random) else { continue };
            let phase = henyey_greenstein(g, wi.as_dvec3().normalize(), out.as_dvec3().normalize());
            let Some(expected) = guided.mixed(wi, phase) else { continue };
            worst.compare(mixture.pdf(wi).0, expected, 0.0, || format!("seed {seed}, g {g}, {out} {wi}, {phase}"));
        }
    }
    worst.check(INPUTS);
}

/// The direction as seen from the centre and dω/dω'.
fn carried(parallax: Parallax, point: Vec3, away: Vec3) -> (DVec3, f64) {
    let (curvature, away) = (f64::from(parallax.curvature), away.as_dvec3());
    let offset = (point - parallax.centre).as_dvec3() * curvature;
    if curvature == 0.0 || offset.length_squared() >= 0.9 {
        return (away, 1.0);
    }
    // |offset + t·away| = 1.
    let (a, b, c) = (away.length_squared(), offset.dot(away), offset.length_squared() - 1.0);
    let t = ((b * b - a * c).sqrt() - b) / a;
    let seen = (offset + t * away).normalize();
    (seen, t * t / seen.dot(away.normalize()))
}

// ---- network ----

type Rows = Vec<Vec<f64>>;

/// Zhu 2021, eq. 12 to 14, from the weights file.
struct Oracle<'a>(&'a Model);

impl Oracle<'_> {
    /// x·W + b.
    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let layer = &self.0.weights.layers[name];
        assert_eq!(layer.rows, x.len());
        (0..layer.columns)
            .map(|c| {
                let products = x.iter().enumerate().map(|(r, x)| x * f64::from(layer.weight[r * layer.columns + c]));
                f64::from(layer.bias[c]) + products.sum::<f64>()
            })
            .collect()
    }

    /// relu(x·W + b), then convolutions over nine neighbours with one residual around them all.
    fn step(&self, prefix: &str, inputs: Rows, neighbours: &[u32]) -> Rows {
        let relu = |row: Vec<f64>| row.into_iter().map(|x| x.max(0.0)).collect::<Vec<f64>>();
        let start: Rows = inputs.iter().map(|row| relu(self.linear(&format!("{prefix}.in"), row))).collect();
        let mut rows = start.clone();
        let zero = vec![0.0; self.0.config.width];
        for i in 0..self.0.config.convolutions {
            let nine = |row: usize| -> Vec<f64> {
                let around = neighbours[9 * row..][..9].iter();
                around.flat_map(|&r| rows.get(r as usize).unwrap_or(&zero).clone()).collect()
            };
            let mut next: Rows =
                (0..rows.len()).map(|row| self.linear(&format!("{prefix}.conv{i}"), &nine(row))).collect();
            if i + 1 == self.0.config.convolutions {
                next.iter_mut()
                    .zip(&start)
                    .for_each(|(row, start)| row.iter_mut().zip(start).for_each(|(x, s)| *x += s));
            }
            rows = next.into_iter().map(relu).collect();
        }
        rows
    }

    /// All outputs, named and ordered as by `support::forward`.
    fn forward(&self, trees: &[support::Tree]) -> Vec<(String, Vec<f32>)> {
        let topologies: Vec<&Topology> = trees.iter().map(|tree| tree.counted.topology()).collect();
        let batch = Batch::new(&topologies);
        let wide = |values: &[f32], columns: usize| -> Rows {
            values.chunks(columns).map(|row| row.iter().map(|&x| f64::from(x)).collect()).collect()
        };
        let nodes: Vec<NodeInputs> = trees.iter().map(|tree| inputs_of(&tree.input())).collect();
        let features: Vec<f32> = nodes.iter().flat_map(|n| &n.features).copied().collect();
        let log_shares: Vec<_> = nodes.iter().flat_map(|n| &n.log_shares).copied().collect();
        let base: Vec<f32> = nodes.iter().flat_map(|n| &n.base).copied().collect();
        let width = self.0.config.width;
        let mut encoded: Vec<Rows> = vec![vec![]; batch.levels.len() + 1];
        for level in (0..batch.levels.len()).rev() {
            let own = wide(&batch.gather(level, &features, FEATURES), FEATURES);
            let pooled = batch.levels[level].rows.first_child.iter().map(|&first| match first {
                NONE => vec![0.0; width],
                first => {
                    let four = &encoded[level + 1][first as usize..][..4];
                    (0..width).map(|c| four.iter().map(|row| row[c]).sum::<f64>() / 4.0).collect()
                }
            });
            let inputs = own.into_iter().zip(pooled).map(|(own, pooled)| [own, pooled].concat()).collect();
            encoded[level] = self.step("encode", inputs, &batch.levels[level].rows.neighbours);
        }
        let flat = |rows: &Rows| rows.iter().flatten().map(|&x| x as f32).collect::<Vec<f32>>();
        let mut outputs: Vec<_> =
            encoded.iter().enumerate().map(|(level, rows)| (format!("encoded {level}"), flat(rows))).collect();
        let (mut above, mut parents) = (DecodeLevel::roots(&batch), encoded[0].clone());
        loop {
            let splits = |(row, &skip): (usize, &u32)| {
                skip != NONE && (batch.levels[above.level].rows.first_child[skip as usize] != NONE || row % 7 == 0)
            };
            let split: Vec<bool> = above.skip.iter().enumerate().map(splits).collect();
            let level = above.grow(&batch, &split);
            if level.rows.is_empty() {
                return outputs;
            }
            let geometry = level.geometry(&log_shares);
            let inputs = (0..level.rows.len()).map(|row| {
                let skip = match level.skip[row] {
                    NONE => vec![0.0; width],
                    skip => encoded[level.level][skip as usize].clone(),
                };
                let columns = geometry.len() / level.rows.len();
                let geometry = geometry[row * columns..][..columns].iter().map(|&x| f64::from(x)).collect();
                [parents[level.rows.parent[row] as usize].clone(), skip, geometry].concat()
            });
            let decoded = self.step("decode", inputs.collect(), &level.rows.neighbours);
            let head = |name: &str| decoded.iter().map(|row| self.linear(name, row)[0]).collect::<Vec<f64>>();
            let base = level.base(&base);
            let share: Vec<f64> = head("decode.share").iter().zip(&base).map(|(x, &b)| x + f64::from(b)).collect();
            let leaf = head("decode.leaf");
            let softmax = share.chunks(4).flat_map(|four| {
                let most = four.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let sum: f64 = four.iter().map(|x| (x - most).exp()).sum();
                four.iter().map(move |x| (x - most).exp() / sum)
            });
            let softmax: Vec<f64> = softmax.collect();
            let sigmoid: Vec<f64> = leaf.iter().map(|x| 1.0 / (1.0 + (-x).exp())).collect();
            let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
            let named = [
                ("share_logit", single(&share)),
                ("share", single(&softmax)),
                ("leaf_logit", single(&leaf)),
                ("leaf", single(&sigmoid)),
                ("decoded", flat(&decoded)),
            ];
            outputs.extend(named.map(|(name, values)| (format!("{name} {}", level.level), values)));
            (parents, above) = (decoded, level);
        }
    }
}

/// The model that the program carries, over trees of all shapes, twenty levels up and twenty down without a rounding in between.
/// Inherent: a sum of terms of both signs is right to the rounding of the terms, so errors are relative to the value plus the
/// root mean square of its tensor.
#[test]
fn network_forward_pass() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/default");
    let model = Model::load(&folder).expect("the model is part of the project");
    let trees = support::trees();
    let found = support::forward(&model, &Embedded::new(&model).expect("it runs"), &trees);
    let expected = Oracle(&model).forward(&trees);
    let values: usize = found.iter().map(|(_, values)| values.len()).sum();
    assert!(values > INPUTS, "{values}");
    support::assert_close(&found, &expected, 1e-4);
}
