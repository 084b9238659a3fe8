//! Counting where the sky is seen, and what it says of how to sample it.
//!
//! With s the probability with which the map's power chooses a tile and m the second moment of what its samples bring, the variance of all
//! samples together is least where the tile is chosen in proportion to s·√m (Rath et al. 2020, *Variance-aware path guiding*, eq. 8, for
//! directions). Radiance over density is about the same in all of the map, so m is here the mean of cos²θ where the sky is seen, and 0
//! elsewhere.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::Vec3;

use super::envmap::Envmap;
use super::seen::{ANYWHERE, FACINGS, LearnedSky};
use crate::sampling::tiles::{COLUMNS, ROWS, TILES, Weights};

/// Part of the samples that tiles get by their power alone, whatever was counted.
const DEFENSIVE: f64 = 0.25;
/// Weights of what was counted around a tile, of two samples of all facings, and of a ten-thousandth of all facings, beside what was counted
/// in the tile: few samples that saw nothing do not show that nothing is seen.
const AROUND: f64 = 0.05;
const FEW: f64 = 2.0;
const OTHERS: f64 = 1e-4;
/// Second moment with what was counted over that without, above which it is not worth knowing. It is measured on other samples than those
/// that were counted: of few, most of what is counted is chance.
const WORTH: f64 = 0.95;
/// Least sum of squared cosines of a facing by which it is judged.
const LEAST: f64 = 32.0;
/// Least cosine that counts: the facing is that of an axis, not of the surface.
const LEAST_COSINE: f32 = 0.1;
/// Parts of 1 in which squared cosines are counted.
const UNIT: f64 = 65536.0;

/// Where samples have seen the sky: sums of squared cosines by half of the samples, facing and tile. Whole numbers, which no order of adding
/// changes.
#[derive(Debug)]
pub struct SkyCounts {
    sums: Vec<AtomicU64>,
}

impl Default for SkyCounts {
    fn default() -> Self {
        Self { sums: (0..2 * FACINGS * TILES).map(|_| AtomicU64::new(0)).collect() }
    }
}

impl SkyCounts {
    /// Counts a direction of light sampling in which the sky is seen, as the part `share` of one: the probability that it was the map by
    /// which it was chosen.
    pub fn add(&self, map: &Envmap, facing: u8, direction: Vec3, share: f32) {
        let along = direction[usize::from(facing / 2).min(2)];
        let cosine = match facing {
            ANYWHERE => 1.0,
            _ if facing % 2 == 1 => -along,
            _ => along,
        };
        // What comes through a surface counts a little.
        let cosine = f64::from(cosine.clamp(LEAST_COSINE, 1.0));
        // Last bits are as good as random.
        let half = ((direction.x.to_bits() ^ direction.y.to_bits() ^ direction.z.to_bits()) & 1) as usize;
        let place = (half * FACINGS + usize::from(facing)) * TILES + map.tile(direction);
        self.sums[place].fetch_add((cosine * cosine * f64::from(share) * UNIT) as u64, Relaxed);
    }

    /// What they tell of the sky; none where it is not worth knowing.
    pub fn learned(&self, map: &Envmap) -> Option<LearnedSky> {
        let shares = map.shares();
        let sums: Vec<f64> = self.sums.iter().map(|sum| sum.load(Relaxed) as f64 / UNIT).collect();
        let (first, second) = sums.split_at(FACINGS * TILES);
        let halves = [first, second].map(Half::new);
        let both: Vec<f64> = first.iter().zip(second).map(|(a, b)| a + b).collect();
        let both = Half::new(&both);
        let (mut before, mut after) = (0.0, 0.0);
        let facing = |facing| {
            let count: f64 = both.of(facing).iter().sum();
            before += count;
            // What either half tells, judged by the other.
            let judged = [0, 1].map(|half| {
                let weights = halves[half].weights(facing, shares);
                weights.as_ref().map(|weights| moment(halves[1 - half].of(facing), weights))
            });
            let gained = if let [Some(a), Some(b)] = judged { a + b } else { f64::INFINITY };
            let learned = both.weights(facing, shares).filter(|_| gained < WORTH * count && count > LEAST);
            after += if learned.is_some() { gained } else { count };
            learned.unwrap_or_else(|| by_power(shares))
        };
        let facings = (0..FACINGS).map(facing).collect();
        let gain = after / before;
        (gain < WORTH).then(|| LearnedSky::new(facings, gain))
    }
}

/// What one half of the samples has counted, or both.
struct Half<'a> {
    sums: &'a [f64],
    /// Sums of all facings.
    all: Vec<f64>,
}

impl<'a> Half<'a> {
    fn new(sums: &'a [f64]) -> Self {
        Self { sums, all: (0..TILES).map(|tile| sums[tile..].iter().step_by(TILES).sum()).collect() }
    }

    /// What a facing has counted.
    fn of(&self, facing: usize) -> &'a [f64] {
        &self.sums[facing * TILES..][..TILES]
    }

    /// Probabilities of tiles for a facing; none where no facing has counted anything.
    fn weights(&self, facing: usize, shares: &[f32]) -> Option<Weights> {
        let total: f64 = self.all.iter().sum();
        let own = self.of(facing);
        let count: f64 = own.iter().sum();
        (total > 0.0).then(|| weights(own, shares, |tile| self.all[tile] / total * (FEW + OTHERS * count)))
    }
}

/// Second moment of what the samples `own` brought, counted by tile, if tiles are chosen by `weights`; by power alone it is their sum.
fn moment(own: &[f64], weights: &Weights) -> f64 {
    own.iter().enumerate().map(|(tile, sum)| sum / f64::from(weights.ratio(tile)).max(1e-3)).sum()
}

/// Tiles chosen by their power alone.
fn by_power(shares: &[f32]) -> Weights {
    Weights::new(&shares.iter().map(|&share| f64::from(share)).collect::<Vec<_>>(), shares)
}

/// Probabilities of tiles, by what was counted in them and a prior in the same unit.
fn weights(own: &[f64], shares: &[f32], prior: impl Fn(usize) -> f64) -> Weights {
    let seen = |tile: usize| {
        let near = around(tile).iter().map(|&near| own[near]).sum::<f64>() / 8.0;
        own[tile] + AROUND * near + prior(tile)
    };
    // Counts are the second moments times the shares of the samples that tiles had.
    let roots: Vec<f64> = (0..TILES).map(|tile| (seen(tile) * f64::from(shares[tile])).sqrt()).collect();
    let sum: f64 = roots.iter().sum();
    let mixed = |(root, &share): (&f64, &f32)| {
        let share = f64::from(share);
        DEFENSIVE * share + (1.0 - DEFENSIVE) * if sum > 0.0 { root / sum } else { share }
    };
    Weights::new(&roots.iter().zip(shares).map(mixed).collect::<Vec<_>>(), shares)
}

/// The tiles around a tile; those above the first row and below the last are of that row.
fn around(tile: usize) -> [usize; 8] {
    let (row, column) = (tile / COLUMNS, tile % COLUMNS);
    let [up, down] = [row.saturating_sub(1), (row + 1).min(ROWS - 1)];
    let [left, right] = [(column + COLUMNS - 1) % COLUMNS, (column + 1) % COLUMNS];
    [(up, left), (up, column), (up, right), (row, left), (row, right), (down, left), (down, column), (down, right)]
        .map(|(row, column)| row * COLUMNS + column)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Mat3;

    use super::*;
    use crate::base::random::Random;
    use crate::lights::seen::{LightView, facing};
    use crate::math::lanes::LANES;
    use crate::picture::Image;

    /// A sky that shines alike everywhere.
    fn white() -> Envmap {
        let image = Image { width: 64, height: 32, pixels: vec![Vec3::ONE; 64 * 32] };
        Envmap::new(Arc::new(image), 1.0, Mat3::IDENTITY)
    }

    /// Counts of `samples` directions by the map's power, seen where `is_seen` from a surface that faces like `normal`.
    fn counted(map: &Envmap, samples: usize, normal: Vec3, is_seen: impl Fn(Vec3) -> bool) -> SkyCounts {
        let counts = SkyCounts::default();
        let mut random = Random::new(5, 0, 0);
        for _ in 0..samples {
            let wi = map.sample(random.next_2d()).expect("all of it shines").wi;
            if is_seen(wi) {
                counts.add(map, facing(normal), wi, 1.0);
            }
        }
        counts
    }

    /// A floor that sees a quarter of the sky has its samples there; a ceiling that has seen nothing is sampled by power alone. Of as
    /// many counts as the floor has in tile on average, 10, little more than the quarter is known.
    #[test]
    fn samples_go_where_the_sky_is_seen() {
        let map = white();
        let is_seen = |wi: Vec3| wi.x > 0.0 && wi.y > 0.0;
        let sky = counted(&map, 20_000, Vec3::Y, is_seen).learned(&map).expect("it is worth knowing");
        assert!((0.2..0.5).contains(&sky.gain()), "{}", sky.gain());
        let view = |normal| LightView { learned: Some(&sky), facing: [facing(normal); LANES], odds: None };
        let share = |normal: Vec3| {
            let mut random = Random::new(6, 0, 0);
            let seen = |_| is_seen(map.samples::<f32>(random.next_2d(), &view(normal)).wi.into());
            (0..4000).map(seen).filter(|&seen| seen).count() as f64 / 4000.0
        };
        // 0.75 and a quarter of 0.25, of which tiles on the horizon take a little.
        assert!(share(Vec3::Y) > 0.7, "{}", share(Vec3::Y));
        // Five standard deviations of 4000 samples are 0.034.
        assert!((share(Vec3::NEG_Y) - 0.25).abs() < 0.034, "{}", share(Vec3::NEG_Y));
        assert!(map.samples::<f32>([0.5, 0.999], &view(Vec3::Y)).pdf > 0.0);
    }

    /// What is gained by chance is none: of 50 to 3,000 samples of a sky that is seen alike, a few in each of 512 tiles, nothing is
    /// learned, although tiles that had some by chance would have most of the next.
    #[test]
    fn few_samples_learn_nothing_of_chance() {
        let map = white();
        for samples in [50, 100, 300, 1000, 3000, 20_000] {
            assert!(counted(&map, samples, Vec3::ZERO, |_| true).learned(&map).is_none(), "{samples}");
        }
        // And of a quarter of the sky a thousand tell enough.
        let sky = counted(&map, 4000, Vec3::ZERO, |wi| wi.x > 0.0 && wi.y > 0.0).learned(&map);
        let gain = sky.expect("a quarter").gain();
        assert!((0.25..0.9).contains(&gain), "{gain}");
    }

    #[test]
    fn nothing_is_learned_of_nothing() {
        assert!(SkyCounts::default().learned(&white()).is_none());
    }
}
