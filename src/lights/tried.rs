//! What light sampling was tried with, and what it tells of which lights pay where.
//!
//! Where lights are chosen with probability p and each brings c, the second moment is least if those whose samples have the mean square m are
//! chosen in proportion to p·√m (Rath et al. 2020, *Variance-aware path guiding*, eq. 8, for directions). So it is for the two nodes of a pair
//! of the light tree: the odds of the first are the root of the means' ratio. What is in the way is in it, and what surfaces send back.

use glam::Vec3;
use rayon::join;

use super::LightSet;
use super::places::{Division, EVEN, LEARNED, LightPlaces, Odds, Part};
use super::tree::{LightTree, Turn, leaning};

/// A light with a place that was chosen at a point, and what came of it.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    /// Index of the path, among those that were traced with it.
    pub path: u32,
    /// The point.
    pub point: Vec3,
    /// Index of the light.
    pub light: u32,
    /// What it brought to the picture: throughput times f·|cos θ|·L·w / p, channel mean; 0 where something was in the way.
    pub brought: f32,
}

/// Trials that count as of what is known of the cells around.
const FEW: f64 = 4.0;
/// Fewest trials of a cell.
const FEWEST: usize = 128;
/// Planes at most between a cell and the whole.
const MOST_LEVELS: u32 = 11;
/// Odds at most, and one over that at least.
const GREATEST: f64 = 256.0;
/// A square counts as so many times the mean at most, so that no single one decides.
const LARGEST: f64 = 200.0;
/// Second moment with what was learned over that without, above which it is not worth knowing: the choice takes longer, and light that is
/// sampled is not all of a picture's noise. It is measured on other trials than those that were learned from.
pub const WORTH: f64 = 0.6;

/// A trial as learning sees it.
struct Example {
    point: Vec3,
    /// Which half it is of.
    half: usize,
    /// Square of what it brought.
    square: f64,
    /// Its turns of learned pairs.
    turns: std::ops::Range<u32>,
}

/// What was tried in a half of the trials of a cell: for each pair and side the number of trials and the sum of their squares.
type Sums = [[[f64; 2]; 2]; LEARNED];

/// What is learned from.
struct Learning {
    examples: Vec<Example>,
    turns: Vec<Turn>,
}

/// Odds of a cell that either half of the trials tells, and both.
#[derive(Clone)]
struct Told {
    halves: [Odds; 2],
    both: Odds,
}

impl LightSet {
    /// What trials, in blocks of which every other one is of one half, tell of which lights pay where; none where the second moment is not
    /// less than `worth` times that without.
    pub fn places(&self, blocks: &[Vec<Trial>], worth: f64) -> Option<LightPlaces> {
        let learning = Learning::new(&self.tree, blocks);
        let all = (0..learning.examples.len() as u32).collect();
        let before = learning.examples.iter().map(|example| example.square).sum::<f64>();
        let (part, after) = learning.divide(all, &Told { halves: [EVEN; 2], both: EVEN }, 0);
        let (division, odds) = Division::new(&part);
        let gain = after / before;
        (gain < worth).then(|| LightPlaces::new(division, odds, gain))
    }
}

impl Learning {
    fn new(tree: &LightTree, blocks: &[Vec<Trial>]) -> Self {
        let (mut examples, mut turns) = (Vec::new(), Vec::new());
        for (number, block) in blocks.iter().enumerate() {
            for trial in block {
                let begin = turns.len() as u32;
                tree.turns(trial.point, trial.light as usize, &mut turns);
                let square = f64::from(trial.brought).powi(2);
                let square = if square.is_finite() { square } else { 0.0 };
                examples.push(Example {
                    point: trial.point,
                    half: number % 2,
                    square,
                    turns: begin..turns.len() as u32,
                });
            }
        }
        let most = LARGEST * examples.iter().map(|example| example.square).sum::<f64>() / examples.len().max(1) as f64;
        examples.iter_mut().for_each(|example| example.square = example.square.min(most));
        Self { examples, turns }
    }

    fn turns(&self, example: &Example) -> &[Turn] {
        &self.turns[example.turns.start as usize..example.turns.end as usize]
    }

    /// The odds within a cell of these trials, or of the cells that it is divided into, and the second moment with them; `around` is
    /// what is told of the cell that it is a part of.
    fn divide(&self, trials: Vec<u32>, around: &Told, level: u32) -> (Part, f64) {
        let told = self.told(&trials, around);
        let [plain, own] = self.moments(&trials, &told);
        let whole =
            if own < plain { (Part::Cell(Box::new(told.both)), own) } else { (Part::Cell(Box::new(EVEN)), plain) };
        let split = if level < MOST_LEVELS && trials.len() >= 2 * FEWEST { self.plane(&trials) } else { None };
        let Some((axis, at)) = split else { return whole };
        let side = |trial: &u32| self.examples[*trial as usize].point[axis] < at;
        // Each side keeps their order, in which sums are made.
        let (below, above): (Vec<u32>, Vec<u32>) = trials.iter().partition(|trial| side(trial));
        drop(trials);
        let ((below, first), (above, second)) =
            join(|| self.divide(below, &told, level + 1), || self.divide(above, &told, level + 1));
        if first + second < whole.1 {
            (Part::Divided { axis: axis as u32, at, parts: Box::new([below, above]) }, first + second)
        } else {
            whole
        }
    }

    /// Axis and place of the plane across the longest axis of trials that has half of them on either side; none where they are at one place.
    fn plane(&self, trials: &[u32]) -> Option<(usize, f32)> {
        let points = || trials.iter().map(|trial| self.examples[*trial as usize].point);
        let (low, high) = (points().fold(Vec3::INFINITY, Vec3::min), points().fold(Vec3::NEG_INFINITY, Vec3::max));
        let axis = (high - low).max_position();
        let mut places: Vec<f32> = points().map(|point| point[axis]).collect();
        let middle = places.len() / 2;
        let at = *places.select_nth_unstable_by(middle, f32::total_cmp).1;
        (at.is_finite() && low[axis] < at).then_some((axis, at))
    }

    fn told(&self, trials: &[u32], around: &Told) -> Told {
        let mut sums = [[[[0.0; 2]; 2]; LEARNED]; 2];
        for trial in trials {
            let example = &self.examples[*trial as usize];
            for turn in self.turns(example) {
                let [count, squares] = &mut sums[example.half][turn.pair as usize][usize::from(turn.second)];
                *count += 1.0;
                *squares += example.square;
            }
        }
        let both: Sums = std::array::from_fn(|pair| {
            [0, 1].map(|side| [0, 1].map(|k| sums[0][pair][side][k] + sums[1][pair][side][k]))
        });
        Told { halves: [0, 1].map(|half| odds(&sums[half], &around.halves[half])), both: odds(&both, &around.both) }
    }

    /// Second moments of trials, as they were made, and with what the other half tells.
    fn moments(&self, trials: &[u32], told: &Told) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for trial in trials {
            let example = &self.examples[*trial as usize];
            if example.square > 0.0 {
                sums[0] += example.square;
                sums[1] += example.square / f64::from(leaning(self.turns(example), &told.halves[1 - example.half]));
            }
        }
        sums
    }
}

/// Odds of pairs by what was tried, and a little by the odds around.
fn odds(sums: &Sums, around: &Odds) -> Odds {
    let mut odds = *around;
    for (odds, [[first, first_squares], [second, second_squares]]) in odds.iter_mut().zip(sums) {
        let squares = first_squares + second_squares;
        if squares > 0.0 {
            let ratio = f64::from(*odds).powi(2);
            // Means that have the ratio around and together the sum that was found.
            let expected = squares / (first * ratio + second);
            let means = [
                (first_squares + FEW * ratio * expected) / (first + FEW),
                (second_squares + FEW * expected) / (second + FEW),
            ];
            *odds = (means[0] / means[1]).sqrt().clamp(1.0 / GREATEST, GREATEST) as f32;
        }
    }
    odds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::lights::point::Point;
    use crate::lights::{BoundingSphere, Light};

    /// Two rooms side by side, with `count` lamps each, between which nothing is seen.
    fn rooms(count: usize) -> LightSet {
        let lamp = |i: usize| {
            let position = Vec3::new(0.5 + (i % 7) as f32 / 7.0, 1.0, (i % 5) as f32);
            let side = if i < count { 1.0 } else { -1.0 };
            Light::Point(Point { position: position * Vec3::new(side, 1.0, 1.0), intensity: Vec3::ONE })
        };
        let bounds = BoundingSphere { center: Vec3::ZERO, radius: 10.0 };
        LightSet::new((0..2 * count).map(lamp).collect(), &bounds)
    }

    fn place(random: &mut Random) -> Vec3 {
        Vec3::new(random.range(-2.0, 2.0), 0.0, random.range(0.0, 5.0))
    }

    /// Trials of lamps chosen by the tree, at points of both rooms; what is behind the `wall` brings nothing.
    fn trials(lights: &LightSet, number: usize, wall: bool) -> Vec<Vec<Trial>> {
        let mut random = Random::new(5, number as u64, 0);
        let mut trial = |path: usize| {
            let point = place(&mut random);
            let (index, probability) = lights.choose(point, random.next_f64(), None)?;
            let Light::Point(lamp) = &lights.lights[index] else { return None };
            let seen = !wall || lamp.position.x * point.x > 0.0;
            let brought = if seen { lamp.position.distance_squared(point).recip() / probability } else { 0.0 };
            Some(Trial { path: path as u32, point, light: index as u32, brought })
        };
        (0..16).map(|_| (0..number / 16).filter_map(&mut trial).collect()).collect()
    }

    /// Probability of the lamps in the room where points are, on average.
    fn share(lights: &LightSet, places: Option<&LightPlaces>) -> f32 {
        let mut random = Random::new(6, 0, 0);
        let mut own = 0.0;
        for _ in 0..200 {
            let point = place(&mut random);
            for (index, light) in lights.lights.iter().enumerate() {
                let Light::Point(lamp) = light else { continue };
                if lamp.position.x * point.x > 0.0 {
                    own += lights.probability(point, index, places.map(|places| places.at(point)));
                }
            }
        }
        own / 200.0
    }

    /// In either room the other's lamps are left to the tenth that is never learned.
    #[test]
    fn lamps_behind_a_wall_are_left_alone() {
        for count in [1, 15, 100] {
            let lights = rooms(count);
            let places = lights.places(&trials(&lights, 20_000, true), 0.9).expect("half of the lamps are in vain");
            let [before, after] = [None, Some(&places)].map(|places| share(&lights, places));
            assert!(before < 0.85 && after > 0.9 * 0.95 + 0.1 * before, "{count}: {before} {after}");
            assert!(places.cells() >= 2 && places.gain() < 0.8, "{count}: {} {}", places.cells(), places.gain());
        }
    }

    /// What is gained by chance is none: where all lamps are seen from everywhere, nothing is learned, of however few trials.
    #[test]
    fn nothing_is_learned_of_chance() {
        for number in [0, 16, 64, 256, 1024, 4096, 20_000] {
            let lights = rooms(15);
            assert!(lights.places(&trials(&lights, number, false), WORTH).is_none(), "{number}");
        }
    }

    /// Nor of trials that brought nothing, or what is no number, or at points that are none.
    #[test]
    fn nothing_is_learned_of_nonsense() {
        let lights = rooms(15);
        for brought in [0.0, f32::NAN, f32::INFINITY] {
            let mut blocks = trials(&lights, 4096, true);
            blocks.iter_mut().flatten().for_each(|trial| trial.brought = brought);
            assert!(lights.places(&blocks, WORTH).is_none());
        }
        let mut blocks = trials(&lights, 4096, true);
        blocks.iter_mut().flatten().for_each(|trial| trial.point = Vec3::NAN);
        let _ = lights.places(&blocks, WORTH);
    }
}
