//! Guided emission of photons: most of the light of a sun, or of a lamp outside, never reaches a surface that camera paths reach.
//!
//! Lights are chosen, and the two squares of random numbers from which a light makes the start of a photon are filled, in
//! proportion to the power that earlier photons brought into voxels of the guiding field, each from a piecewise-constant
//! density on a quadtree. (Photon emission guided by visible contribution: after Vorba et al. 2014 §5, with a factored density
//! instead of Gaussian mixtures.) A uniform part keeps every photon possible.

use crate::base::Result;
use crate::base::random::Random;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, offsets, vector};
use crate::guiding::tree::arrays::{read_trees, tree_arrays};
use crate::guiding::tree::distribution::Distribution;
use crate::guiding::tree::sampler::SamplingTree;
use crate::guiding::tree::topology::{MAX_LEVEL, MAX_NODES, Topology};
use crate::sampling::discrete::Discrete;

/// Share of the photons that start as if nothing had been learned; the same for the choice of a light.
const UNIFORM: f32 = 0.2;
/// Share of a square's power above which a node is split.
const SPLIT_SHARE: f64 = 0.02;
/// Lights beyond this number have no squares of their own, only their choice is learned.
const MOST_LIGHTS: usize = 256;

/// Start of a photon: its light and the random numbers that the light made it from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Index of the light.
    pub light: usize,
    /// Points of the two unit squares, of which the light makes the start.
    pub squares: [[f64; 2]; 2],
    /// Probability of the light, times the density of both points relative to uniform ones.
    pub probability: f64,
}

/// A frozen density of photon starts.
#[derive(Debug, Clone)]
pub struct EmissionGuide {
    choice: Discrete,
    /// Power by which lights are chosen; empty where nothing was learned.
    power: Vec<f64>,
    squares: Vec<[SamplingTree; 2]>,
}

impl EmissionGuide {
    /// Guide that chooses lights by their powers alone.
    pub fn new(power: &Discrete) -> Self {
        Self { choice: power.clone(), power: Vec::new(), squares: Vec::new() }
    }

    /// Guide that chooses lights by the `power` that their photons brought, with a part that chooses by the `emitted` powers alone.
    fn learned(emitted: &Discrete, power: Vec<f64>, squares: Vec<[SamplingTree; 2]>) -> Self {
        let (total, uniform): (f64, f64) = (power.iter().sum(), UNIFORM.into());
        let part = |i: usize| uniform * emitted.probability(i) + (1.0 - uniform) * power[i] / total;
        Self { choice: Discrete::new((0..power.len()).map(part)), power, squares }
    }

    /// Draws a start; none where there is no light.
    pub fn sample(&self, random: &mut Random) -> Option<Start> {
        if self.choice.is_empty() || self.choice.total() <= 0.0 {
            return None;
        }
        let (light, _) = self.choice.sample(random.next_f64());
        let mut probability = self.choice.probability(light);
        let mut square = |which: usize| {
            let Some(trees) = self.squares.get(light) else { return [random.next_f64(), random.next_f64()] };
            let (place, relative) = trees[which].sample_square([random.next_f64(), random.next_f64()]);
            probability *= relative;
            place
        };
        let squares = [square(0), square(1)];
        Some(Start { light, squares, probability })
    }
}

/// Power of photons over one unit square, while it is learned.
#[derive(Debug, Clone)]
struct Square {
    topology: Topology,
    /// Power per node; kept up for leaves only.
    power: Vec<f64>,
}

impl Square {
    fn new(topology: Topology) -> Self {
        Self { power: vec![0.0; topology.len()], topology }
    }

    fn add(&mut self, [x, y]: [f64; 2], power: f64) {
        let side = f64::from(1u32 << MAX_LEVEL);
        let leaf = self.topology.leaf_at([(x * side) as u32, (y * side) as u32]);
        self.power[leaf] += power;
    }

    fn distribution(&self) -> Distribution {
        let weights: Vec<f64> = self.topology.leaves().map(|leaf| self.power[leaf]).collect();
        Distribution::from_leaf_weights(self.topology.clone(), &weights)
    }

    /// An empty square split where the power was.
    fn refined(&self) -> Self {
        let distribution = self.distribution();
        Self::new(distribution.refined(SPLIT_SHARE, MAX_NODES / 8))
    }
}

/// Learns an [`EmissionGuide`] from the power that photons brought.
#[derive(Debug, Clone)]
pub struct EmissionLearner {
    emitted: Discrete,
    lights: Vec<[Square; 2]>,
    power: Vec<f64>,
}

impl EmissionLearner {
    /// Learner that has no photons yet; `emitted` are the lights' powers.
    pub fn new(emitted: &Discrete) -> Self {
        let squares = || [0, 1].map(|_| Square::new(Topology::root()));
        let lights =
            if emitted.len() <= MOST_LIGHTS { (0..emitted.len()).map(|_| squares()).collect() } else { vec![] };
        Self { emitted: emitted.clone(), lights, power: vec![0.0; emitted.len()] }
    }

    /// Adds photons with the power that each brought into voxels of the guiding field, in the order given. Squares that are not
    /// divided yet get their shape from these.
    pub fn absorb(&mut self, photons: &[(Start, f64)]) {
        if photons.is_empty() {
            return;
        }
        for (start, power) in photons {
            self.power[start.light] += power;
        }
        let whole = self.lights.iter().any(|squares| squares.iter().any(|s| s.topology.len() == 1));
        for round in 0..4 {
            if round > 0 && !whole {
                break;
            }
            for (start, power) in photons {
                if let Some(squares) = self.lights.get_mut(start.light) {
                    squares.iter_mut().zip(start.squares).for_each(|(square, place)| square.add(place, *power));
                }
            }
            // While the first photons shape the tree, a leaf that is split is uniform inside, so they are added again and again.
            if whole && round < 3 {
                self.lights.iter_mut().flatten().for_each(|square| *square = square.refined());
            }
        }
    }

    /// Guide learned from the photons since the last call; squares are then split where the power was, and forget it.
    pub fn publish(&mut self) -> EmissionGuide {
        let total: f64 = self.power.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return EmissionGuide::new(&self.emitted);
        }
        let tree = |square: &Square| SamplingTree::new(&square.distribution(), UNIFORM, usize::MAX);
        let squares = self.lights.iter().map(|[a, b]| [tree(a), tree(b)]).collect();
        self.lights.iter_mut().flatten().for_each(|square| *square = square.refined());
        let power = std::mem::replace(&mut self.power, vec![0.0; self.emitted.len()]);
        EmissionGuide::learned(&self.emitted, power, squares)
    }
}

/// Guide and learner as arrays of a file: `emission` trees, two for each light, `emission_power` [L] or empty, `square_offset`
/// [2 L + 1], `square_split`, `square_power` of every node, `light_power` [L].
pub fn arrays<'a>(guide: &EmissionGuide, learner: &EmissionLearner) -> Vec<Tensor<'a>> {
    let trees: Vec<_> = guide.squares.iter().flatten().map(Some).collect();
    let squares = || learner.lights.iter().flatten();
    let flags = squares().flat_map(|square| square.topology.split_flags());
    let bytes = |values: &[f64]| values.iter().map(|x| x.to_le_bytes()).collect::<Vec<_>>().into_iter();
    let power: Vec<f64> = squares().flat_map(|square| &square.power).copied().collect();
    let mut all = tree_arrays("emission", &trees).to_vec();
    all.extend([
        vector("emission_power", Dtype::F64, bytes(&guide.power)),
        vector("light_power", Dtype::F64, bytes(&learner.power)),
        offsets("square_offset", squares().map(|square| square.topology.len())),
        vector("square_power", Dtype::F64, bytes(&power)),
        vector("square_split", Dtype::U8, flags.map(|split| [u8::from(split)])),
    ]);
    all
}

/// Reads the guide and the learner that [`arrays`] wrote, for lights of the powers `emitted`.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub fn from_arrays(emitted: &Discrete, file: &Tensors) -> Result<(EmissionGuide, EmissionLearner)> {
    let floats = |name: &str, rows| file.read(name, Dtype::F64, rows, 1, f64::from_le_bytes);
    let sound = |powers: &[f64]| powers.iter().all(|p| *p >= 0.0 && p.is_finite());
    let mut learner = EmissionLearner::new(emitted);
    let count = 2 * learner.lights.len();
    learner.power = floats("light_power", Some(emitted.len()))?;
    let offsets = file.offsets("square_offset", count)?;
    let flags = file.read("square_split", Dtype::U8, Some(offsets[count]), 1, |[b]| b != 0)?;
    let powers = floats("square_power", Some(offsets[count]))?;
    for (i, square) in learner.lights.iter_mut().flatten().enumerate() {
        let own = offsets[i]..offsets[i + 1];
        let topology = Topology::from_split(&flags[own.clone()]);
        let topology = topology.or_else(|e| file.fail(format!("square_split of square {i}"), e))?;
        *square = Square { topology, power: powers[own].to_vec() };
    }
    let power = floats("emission_power", None)?;
    if !sound(&powers) || !sound(&learner.power) || !sound(&power) {
        return file.fail("square_power", "powers that are negative or not finite");
    }
    let guide = if power.is_empty() { 0 } else { count };
    let mut trees = read_trees(file, "emission", guide)?.into_iter().flatten();
    let squares: Vec<_> = (0..guide / 2).filter_map(|_| Some([trees.next()?, trees.next()?])).collect();
    if !power.is_empty() && (power.len() != emitted.len() || squares.len() != guide / 2) {
        return file.fail("emission_power", format!("{} powers for {} lights", power.len(), emitted.len()));
    }
    let total: f64 = power.iter().sum();
    let learned = total > 0.0 && total.is_finite();
    let guide = if learned { EmissionGuide::learned(emitted, power, squares) } else { EmissionGuide::new(emitted) };
    Ok((guide, learner))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only photons of light 1 that start in a small square of the first square are of use.
    fn useful(start: &Start) -> f64 {
        let inside = start.light == 1 && start.squares[0].iter().all(|x| (0.3..0.4).contains(x));
        if inside { 1.0 / start.probability } else { 0.0 }
    }

    #[test]
    fn photons_go_where_they_are_of_use_and_their_weights_stay_true() {
        let emitted = Discrete::new([3.0, 1.0]);
        let mut learner = EmissionLearner::new(&emitted);
        let mut guide = EmissionGuide::new(&emitted);
        let mut random = Random::new(1, 0, 0);
        let n = 20_000;
        let mut shares = vec![];
        for _ in 0..4 {
            let starts: Vec<Start> = (0..n).map(|_| guide.sample(&mut random).unwrap()).collect();
            let photons: Vec<(Start, f64)> = starts.iter().map(|s| (*s, useful(s))).collect();
            shares.push(photons.iter().filter(|p| p.1 > 0.0).count() as f64 / f64::from(n));
            // A hundredth of the first square of light 1, within five standard errors.
            let mean = photons.iter().map(|p| p.1).sum::<f64>() / f64::from(n);
            let spread = photons.iter().map(|p| (p.1 - mean).powi(2)).sum::<f64>() / f64::from(n);
            let error = (spread / f64::from(n)).sqrt();
            assert!((mean - 0.01).abs() < 5.0 * error, "{mean} ± {error}");
            learner.absorb(&photons);
            guide = learner.publish();
        }
        assert!(shares[0] < 0.005 && shares[3] > 0.3, "{shares:?}");
    }

    #[test]
    fn without_light_there_is_no_photon() {
        let guide = EmissionGuide::new(&Discrete::new([]));
        assert_eq!(guide.sample(&mut Random::new(1, 0, 0)), None);
        let black = Discrete::new([0.0]);
        let mut learner = EmissionLearner::new(&black);
        learner.absorb(&[]);
        assert_eq!(learner.publish().sample(&mut Random::new(1, 0, 0)), None);
    }
}
