//! Choosing among many lights by an estimate of how much each sends to a point: a binary tree over the lights that have a place.
//!
//! Every node bounds the positions, directions and intensity of its lights. From the root down, the child with the larger estimate
//! is taken more often (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with Adaptive Tree Splitting*, without
//! the splitting; orientation bounds by their §4.1, costs by §4.4).

use glam::Vec3;

use super::bounds::{Cone, LightBounds};
use super::places::{LEARNED, Odds};
use crate::math::lanes::{Bits, LANES, Mask, Real, V3, Wide, by_lane};

/// What is known of the lights below a node, in lanes.
#[derive(Debug, Clone, Copy)]
struct Node<R> {
    centre: V3<R>,
    /// Half diagonal of the box.
    radius: R,
    axis: V3<R>,
    cos_half: R,
    sin_half: R,
    /// Cosine of a little more than the angle to a normal beyond which there is no light.
    cos_end: R,
    intensity: R,
}

/// Numbers in a [`Node`].
const NUMBERS: usize = 11;
/// What rounding may make of an angle: next to 0 and 180° sines and cosines tell it only to a few 1e-4.
const ROUNDED: f32 = 2e-3;
/// Greatest intensity of a light in its bounds. More, or what has overflowed, would leave nothing to all others.
const BRIGHTEST: f32 = 1e30;
/// Greatest estimate of a node, so that the sum of two is finite at the very place of a light too.
const GREATEST: f32 = 1e38;

impl Node<f32> {
    fn new(bounds: &LightBounds) -> Self {
        let (sin_half, cos_half) = bounds.cone.half.sin_cos();
        Self {
            centre: bounds.centre().into(),
            radius: 0.5 * (bounds.high - bounds.low).length(),
            axis: bounds.cone.axis.into(),
            cos_half,
            sin_half,
            cos_end: (bounds.cone.end + ROUNDED).cos(),
            intensity: bounds.intensity,
        }
    }

    fn numbers(&self) -> [f32; NUMBERS] {
        let Self { centre, radius, axis, cos_half, sin_half, cos_end, intensity } = self;
        [centre.x, centre.y, centre.z, *radius, axis.x, axis.y, axis.z, *cos_half, *sin_half, *cos_end, *intensity]
    }
}

impl<R: Real> Node<R> {
    /// From its numbers in a row.
    #[inline(always)]
    fn of(row: &[R]) -> Self {
        Self {
            centre: V3::new(row[0], row[1], row[2]),
            radius: row[3],
            axis: V3::new(row[4], row[5], row[6]),
            cos_half: row[7],
            sin_half: row[8],
            cos_end: row[9],
            intensity: row[10],
        }
    }

    /// Intensity over the squared distance to a point, which counts as no less than the node's size.
    #[inline(always)]
    fn falloff(&self, point: V3<R>) -> R {
        let squared = (point - self.centre).length_squared();
        (self.intensity / squared.max(self.radius.squared()).at_least(f32::MIN_POSITIVE)).at_most(GREATEST)
    }

    /// Where some of the lights may be turned away from a point: not where they shine everywhere.
    #[inline(always)]
    fn turns(&self) -> R::Mask {
        self.cos_half.above(-1.0)
    }

    /// Estimate of the greatest irradiance that the node's lights can send to a point: the fall-off times the cosine of the least
    /// angle by which they are turned away, and nothing where their light has ended before.
    #[inline(always)]
    fn importance(&self, point: V3<R>) -> R {
        let to = point - self.centre;
        let squared = to.length_squared();
        let near = self.radius.squared();
        let cos = self.axis.dot(to) / squared.sqrt();
        let sin = cos.squared().rest().at_least(0.0).sqrt();
        // Angles are subtracted by their sines and cosines: first the cone of the normals, then the box as seen from the point.
        let (sin, cos) = less((sin, cos), (self.sin_half, self.cos_half));
        let sin_box = (near / squared).sqrt();
        let (_, cos) = less((sin, cos), (sin_box, sin_box.squared().rest().at_least(0.0).sqrt()));
        let falloff = self.falloff(point);
        let turned = (falloff * cos.at_least(0.0)).only(cos.ge(self.cos_end));
        (near.lt(squared) & self.turns()).choose(turned, falloff)
    }
}

/// Sine and cosine of max(a - b, 0), for angles in [0, π] given by their sines and cosines.
#[inline(always)]
fn less<R: Real>((sin_a, cos_a): (R, R), (sin_b, cos_b): (R, R)) -> (R, R) {
    let none = cos_a.ge(cos_b);
    let (sin, cos) = (sin_a * cos_b - cos_a * sin_b, cos_a * cos_b + sin_a * sin_b);
    (none.choose(sin.all(0.0), sin), none.choose(cos.all(1.0), cos))
}

/// What is below a node: the index of a pair of nodes, or [`LEAF`] and the index of a light.
type Link = i32;
/// The sign.
const LEAF: Link = Link::MIN;
/// Below it there is nothing.
const NOTHING: Link = -1;
/// No light's index.
pub const NO_LIGHT: u32 = (NOTHING ^ LEAF).cast_unsigned();

/// Two nodes with one parent.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
struct Pair([Row; 2]);

/// The numbers of a node, and its link as the bits of a number.
type Row = [f32; NUMBERS + 1];

impl Pair {
    fn new(halves: [&[(u32, LightBounds)]; 2]) -> Self {
        Self(halves.map(|half| {
            let mut row = [0.0; NUMBERS + 1];
            row[..NUMBERS].copy_from_slice(&Node::new(&around(half)).numbers());
            row
        }))
    }

    #[inline(always)]
    fn nodes(&self) -> [Node<f32>; 2] {
        [Node::of(&self.0[0]), Node::of(&self.0[1])]
    }

    #[inline(always)]
    fn link(&self, second: bool) -> Link {
        self.0[usize::from(second)][NUMBERS].bits()
    }
}

/// Probability of choosing the first of two nodes at a point, and where there is one: not where both estimates are 0.
#[inline(always)]
fn turn<R: Real>([first, second]: &[Node<R>; 2], point: V3<R>) -> (R, R::Mask) {
    // Both with all that it takes or both without: side by side, processors compute them at once.
    let (a, b) = if (first.turns() | second.turns()).any() {
        (first.importance(point), second.importance(point))
    } else {
        (first.falloff(point), second.falloff(point))
    };
    let sum = a + b;
    let share = a / sum;
    let share = (a.above(0.0) & b.above(0.0)).choose(share.between(LEAST, 1.0 - LEAST), share);
    (share, sum.above(0.0))
}

/// A turn that was taken at one of the first pairs on the way to a light.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// Index of the pair.
    pub pair: u32,
    /// Probability of the first node, by the estimates.
    share: f32,
    /// Whether it was not the first that was taken.
    pub second: bool,
}

/// Probability of a light with learned odds over that without, by the turns to it.
pub fn leaning(turns: &[Turn], odds: &Odds) -> f32 {
    let part = |turn: &Turn| {
        let leaned = lean(turn.share, odds[turn.pair as usize]);
        if turn.second { leaned.rest() / turn.share.rest() } else { leaned / turn.share }
    };
    mixed(1.0, turns.iter().map(part).product())
}

/// Part of the samples that take their turns by the estimates alone, whatever was learned.
const DEFENSIVE: f32 = 0.1;

/// Probability of a light, by those without and with learned odds.
#[inline(always)]
fn mixed<R: Real>(plain: R, learned: R) -> R {
    plain * DEFENSIVE + learned * (1.0 - DEFENSIVE)
}

/// Probability of the first of two nodes by its share and learned odds.
#[inline(always)]
fn lean<R: Real>(share: R, odds: R) -> R {
    let first = share * odds;
    first / (first + share.rest())
}

/// The place of a pair's odds.
#[inline(always)]
fn place(link: Link) -> usize {
    (link as usize).min(LEARNED)
}

/// Where the turns to a light are taken by learned odds, and the number that chooses them, by the number that chooses all.
#[inline(always)]
fn leans(u: f64) -> (bool, f64) {
    split_number(u, DEFENSIVE)
}

/// A tree over the lights that have a place.
#[derive(Debug, Clone)]
pub struct LightTree {
    root: Link,
    /// The other nodes; parents come before their children.
    pairs: Vec<Pair>,
    /// By light: the turns from the root to its leaf, the first in the lowest bit, and their number; none without a place.
    trails: Vec<Option<(u64, u32)>>,
}

impl Default for LightTree {
    fn default() -> Self {
        Self { root: NOTHING, pairs: Vec::new(), trails: Vec::new() }
    }
}

/// Greatest depth of splits by cost; below, lights that the costs do not tell apart are halved by number.
const DEEPEST: u32 = 40;
/// Number of intervals of centres along an axis, between which a node may be split.
const BINS: usize = 12;
/// Least probability of a child whose estimate is not 0: estimates ignore occlusion.
const LEAST: f32 = 0.02;

impl LightTree {
    /// The tree over the lights that have bounds.
    pub fn new(lights: &[Option<LightBounds>]) -> Self {
        // The lesser of it and what is not a number is the number.
        let bounded = |bounds: LightBounds| LightBounds { intensity: bounds.intensity.min(BRIGHTEST), ..bounds };
        let mut placed: Vec<(u32, LightBounds)> =
            (0..).zip(lights).filter_map(|(index, bounds)| Some((index, bounded((*bounds)?)))).collect();
        let pairs = Vec::with_capacity(placed.len().saturating_sub(1));
        let mut tree = Self { pairs, trails: vec![None; lights.len()], ..Self::default() };
        if !placed.is_empty() {
            tree.root = tree.grow(&mut placed, 0, 0);
        }
        tree.by_level();
        tree
    }

    /// Sorts the pairs by their distance from the root, so that the first are those whose odds are learned.
    fn by_level(&mut self) {
        let mut order: Vec<Link> = Vec::with_capacity(self.pairs.len());
        order.extend((self.root & LEAF == 0).then_some(self.root));
        let mut sorted = Vec::with_capacity(self.pairs.len());
        while let Some(&link) = order.get(sorted.len()) {
            let mut pair = self.pairs[link as usize];
            for (second, row) in pair.0.iter_mut().enumerate() {
                let below = self.pairs[link as usize].link(second == 1);
                if below & LEAF == 0 {
                    row[NUMBERS] = (order.len() as Link).real_bits();
                    order.push(below);
                }
            }
            sorted.push(pair);
        }
        self.pairs = sorted;
    }

    /// Whether there are lights to choose among.
    pub fn has_choice(&self) -> bool {
        !self.pairs.is_empty()
    }

    /// Adds to `turns` those to `light` at the pairs whose odds are learned.
    pub fn turns(&self, point: Vec3, light: usize, turns: &mut Vec<Turn>) {
        let Some(Some((mut trail, depth))) = self.trails.get(light).copied() else { return };
        let mut link = self.root;
        for _ in 0..depth {
            if link as usize >= LEARNED {
                return;
            }
            let (pair, second) = (&self.pairs[link as usize], trail & 1 == 1);
            let (share, _) = turn(&pair.nodes(), point.into());
            turns.push(Turn { pair: link.cast_unsigned(), share, second });
            link = pair.link(second);
            trail >>= 1;
        }
    }

    /// Adds the nodes below one with these lights.
    fn grow(&mut self, lights: &mut [(u32, LightBounds)], trail: u64, depth: u32) -> Link {
        if let [(light, _)] = lights {
            self.trails[*light as usize] = Some((trail, depth));
            return LEAF | light.cast_signed();
        }
        let middle = if depth < DEEPEST { split(lights) } else { lights.len() / 2 };
        let (left, right) = lights.split_at_mut(middle);
        let pair = self.pairs.len();
        self.pairs.push(Pair::new([left, right]));
        let links = [self.grow(left, trail, depth + 1), self.grow(right, trail | 1 << depth, depth + 1)];
        for (row, link) in self.pairs[pair].0.iter_mut().zip(links) {
            row[NUMBERS] = link.real_bits();
        }
        pair as Link
    }

    /// Samples a light for `point`, with learned `odds` where there are any; returns its index and probability, none where no light can
    /// light it.
    pub fn sample(&self, point: Vec3, mut u: f64, odds: Option<&Odds>) -> Option<(usize, f32)> {
        let (mut link, mut plain, mut learned, mut by_odds) = (self.root, 1.0, 1.0, false);
        if odds.is_some() {
            (by_odds, u) = leans(u);
        }
        while link & LEAF == 0 {
            let pair = &self.pairs[link as usize];
            let (share, possible) = turn(&pair.nodes(), point.into());
            if !possible {
                return None;
            }
            let leaned = odds.map_or(share, |odds| lean(share, odds[place(link)]));
            let second;
            (second, u) = split_number(u, if by_odds { leaned } else { share });
            plain *= if second { share.rest() } else { share };
            learned *= if second { leaned.rest() } else { leaned };
            link = pair.link(second);
        }
        let probability = if odds.is_some() { mixed(plain, learned) } else { plain };
        (link != NOTHING).then_some(((link ^ LEAF) as usize, probability))
    }

    /// As [`LightTree::sample`] in lanes: the light of each, [`NO_LIGHT`] where there is none or `u` is negative, and its probability.
    #[inline(always)]
    pub fn sample_lanes<W: Wide>(
        &self,
        wide: W,
        points: &V3<W::Real>,
        mut u: [f64; LANES],
        odds: Option<&[&Odds; LANES]>,
    ) -> ([u32; LANES], W::Real) {
        let (mut begin, mut by_odds) = ([NOTHING; LANES], [0; LANES]);
        for lane in 0..LANES {
            begin[lane] = if u[lane] >= 0.0 { self.root } else { NOTHING };
            if odds.is_some() {
                let leans;
                (leans, u[lane]) = self::leans(u[lane]);
                by_odds[lane] = i32::from(leans);
            }
        }
        let (mut links, mut probability) = (wide.load_bits(&begin), points.x.all(1.0));
        let (mut learned, by_odds) = (probability, wide.load_bits(&by_odds).same(links.all(1)));
        let nothing = links.all(NOTHING);
        // A lane that has come to its end stays there, whatever becomes of its number.
        loop {
            let open = links.right::<31>().same(links.all(0));
            if !open.any() {
                break;
            }
            let rows = self.rows(points.x, &wide.store_bits(links), open.answers());
            let (first, second) = rows.split_at(NUMBERS + 1);
            let (share, possible) = turn(&[Node::of(first), Node::of(second)], *points);
            let mut leaned = share;
            if let Some(odds) = odds {
                let (at, mut own) = (wide.store_bits(links), [1.0; LANES]);
                for lane in 0..LANES {
                    own[lane] = odds[lane][place(at[lane].max(0))];
                }
                leaned = lean(share, wide.load(&own));
            }
            let shares = wide.store(by_odds.choose(leaned, share));
            let mut is_second = [0; LANES];
            for lane in 0..LANES {
                let turned;
                (turned, u[lane]) = split_number(u[lane], shares[lane]);
                is_second[lane] = i32::from(turned);
            }
            let is_second = wide.load_bits(&is_second).same(links.all(1));
            let taken = is_second.choose(share.rest(), share);
            probability = open.choose(probability * taken, probability);
            if odds.is_some() {
                learned = open.choose(learned * is_second.choose(leaned.rest(), leaned), learned);
            }
            let next = possible.choose(is_second.choose(second[NUMBERS], first[NUMBERS]), nothing.real_bits());
            links = open.choose(next, links.real_bits()).bits();
        }
        if odds.is_some() {
            probability = mixed(probability, learned);
        }
        let mut lights = [NO_LIGHT; LANES];
        let ends = wide.store_bits(links);
        for lane in 0..LANES {
            lights[lane] = (ends[lane] ^ LEAF).cast_unsigned();
        }
        (lights, probability)
    }

    /// The rows of the pairs that lanes have come to; in lanes that have come to an end, those of the first that is `open`.
    #[inline(always)]
    fn rows<R: Real>(&self, like: R, links: &[Link; LANES], open: u32) -> [R; 2 * (NUMBERS + 1)] {
        let row = |link: Link| bytemuck::cast::<_, [f32; 2 * (NUMBERS + 1)]>(self.pairs[link as usize].0);
        let first = links[open.trailing_zeros() as usize];
        // The first turn is the same for all.
        if links.iter().all(|link| *link == first) {
            let (row, mut same) = (row(first), [like; 2 * (NUMBERS + 1)]);
            for i in 0..row.len() {
                same[i] = like.all(row[i]);
            }
            return same;
        }
        by_lane!([like], |lane, _| row(if links[lane] >= 0 { links[lane] } else { first }))
    }

    /// The probability with which [`LightTree::sample`] chooses `light` for `point`.
    pub fn probability(&self, point: Vec3, light: usize, odds: Option<&Odds>) -> f32 {
        let Some((mut trail, depth)) = self.trails[light] else { return 0.0 };
        let (mut link, mut plain, mut learned, mut possible) = (self.root, 1.0, 1.0, true);
        // No branch depends on the estimates, so those of all levels are computed at once.
        for _ in 0..depth {
            let pair = &self.pairs[link as usize];
            let (share, one_is) = turn(&pair.nodes(), point.into());
            let second = trail & 1 == 1;
            plain *= if second { share.rest() } else { share };
            if let Some(odds) = odds {
                let leaned = lean(share, odds[place(link)]);
                learned *= if second { leaned.rest() } else { leaned };
            }
            possible &= one_is;
            link = pair.link(second);
            trail >>= 1;
        }
        let probability = if odds.is_some() { mixed(plain, learned) } else { plain };
        if possible { probability } else { 0.0 }
    }
}

/// Whether `u` in [0, 1) falls beyond `share`, and `u` rescaled to [0, 1) within its part.
#[inline(always)]
fn split_number(u: f64, share: f32) -> (bool, f64) {
    let limit = f64::from(share);
    let second = u >= limit;
    let (above, part) = if second { (u - limit, 1.0 - limit) } else { (u, limit) };
    (second, above / part)
}

fn around(lights: &[(u32, LightBounds)]) -> LightBounds {
    let mut all = lights.iter().map(|(_, bounds)| *bounds);
    let nothing = LightBounds { low: Vec3::ZERO, high: Vec3::ZERO, cone: Cone::ALL, intensity: 0.0 };
    all.next().map_or(nothing, |first| all.fold(first, LightBounds::union))
}

/// Partitions the lights at the split of least cost, and returns where the second part begins.
fn split(lights: &mut [(u32, LightBounds)]) -> usize {
    let centres = lights.iter().map(|(_, bounds)| bounds.centre());
    let (low, high) = centres.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
    let extent = high - low;
    let bin = |bounds: &LightBounds, axis: usize| {
        (((bounds.centre()[axis] - low[axis]) / extent[axis] * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best = (f32::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| extent[axis] > 0.0) {
        let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
        for (_, bounds) in lights.iter() {
            let bin = &mut bins[bin(bounds, axis)];
            *bin = Some(bin.map_or(*bounds, |sum| sum.union(*bounds)));
        }
        let sum = |bins: &[Option<LightBounds>]| bins.iter().flatten().copied().reduce(LightBounds::union);
        for at in 1..BINS {
            if let (Some(left), Some(right)) = (sum(&bins[..at]), sum(&bins[at..])) {
                // Long boxes should not be split across: their parts look alike from afar.
                let cost = (left.cost() + right.cost()) * (extent.max_element() / extent[axis]);
                if cost < best.0 {
                    best = (cost, axis, at);
                }
            }
        }
    }
    let (cost, axis, at) = best;
    if cost.is_infinite() {
        return lights.len() / 2;
    }
    lights.sort_by_key(|(_, bounds)| bin(bounds, axis) >= at);
    lights.partition_point(|(_, bounds)| bin(bounds, axis) < at)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use super::*;
    use crate::base::random::Random;

    fn lights(count: usize) -> Vec<Option<LightBounds>> {
        let mut random = Random::new(5, 0, 0);
        let mut vector = || Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        let light = |i: usize| {
            // Some without a place, some at one place, some facing one way.
            (i % 7 != 3).then(|| {
                let low = if i.is_multiple_of(5) { Vec3::ONE } else { 10.0 * vector() };
                let axis = vector().normalize_or(Vec3::Z);
                let cone = match i % 4 {
                    1 => Cone::new(axis, 0.3),
                    3 => Cone::beam(axis, 0.5 * (1 + i % 5) as f32),
                    _ => Cone::ALL,
                };
                LightBounds { low, high: low + 0.1 * vector().abs(), cone, intensity: 1.0 + i as f32 % 4.0 }
            })
        };
        (0..count).map(light).collect()
    }

    /// Odds from even to very uneven.
    fn odds(random: &mut Random) -> Odds {
        let mut odds: Odds = std::array::from_fn(|_| random.range(-6.0, 6.0f32).exp2());
        odds[LEARNED] = 1.0;
        odds
    }

    /// Probabilities equal those of the samples, and add up to one where every light has an estimate above 0; with learned odds too.
    #[test]
    fn probabilities_are_those_of_sampling() {
        let mut random = Random::new(6, 0, 0);
        for (count, learned) in [1, 2, 40, 200].into_iter().flat_map(|count| [(count, false), (count, true)]) {
            let lights = lights(count);
            let tree = LightTree::new(&lights);
            for _ in 0..100 {
                let odds = learned.then(|| odds(&mut random));
                let odds = odds.as_ref();
                let point =
                    12.0 * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - Vec3::splat(6.0);
                let total: f32 = (0..count).map(|light| tree.probability(point, light, odds)).sum();
                let sampled = tree.sample(point, random.next_f64(), odds);
                if let Some((light, probability)) = sampled {
                    assert!((total - 1.0).abs() < 1e-4 || total < 1.0, "{total}");
                    let again = tree.probability(point, light, odds);
                    assert!((probability - again).abs() <= 1e-6 * again && again > 0.0, "{probability} {again}");
                    let plain = tree.probability(point, light, None);
                    assert!(again >= DEFENSIVE * plain * 0.999, "{again} {plain}");
                    let mut turns = Vec::new();
                    tree.turns(point, light, &mut turns);
                    let ratio = odds.map_or(1.0, |odds| leaning(&turns, odds));
                    assert!((plain * ratio - again).abs() < 1e-4 * again + 1e-12, "{plain} {ratio} {again}");
                }
            }
        }
    }

    /// Lights that shine everywhere are chosen as often as their probabilities say, which add up to one. Pearson's χ² of 20 points is below
    /// its quantile of 1e-6 (Wilson and Hilferty) each.
    #[test]
    fn lights_are_chosen_as_often_as_odds_say() {
        let mut random = Random::new(12, 0, 0);
        let lights: Vec<_> =
            lights(90).into_iter().flatten().map(|of| Some(LightBounds { cone: Cone::ALL, ..of })).collect();
        let tree = LightTree::new(&lights);
        for _ in 0..20 {
            let odds = odds(&mut random);
            let point = 12.0 * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - Vec3::splat(6.0);
            let expected: Vec<f64> =
                (0..lights.len()).map(|light| f64::from(tree.probability(point, light, Some(&odds)))).collect();
            assert!((expected.iter().sum::<f64>() - 1.0).abs() < 1e-4);
            let number = if cfg!(miri) { 10 } else { 100_000 };
            let mut counts = vec![0.0; lights.len()];
            for _ in 0..number {
                counts[tree.sample(point, random.next_f64(), Some(&odds)).expect("all shine").0] += 1.0;
            }
            let often = |p: &f64| p * f64::from(number) >= 5.0;
            let (mut chi2, mut cells) = (0.0, 0.0);
            for (count, p) in counts.iter().zip(&expected).filter(|(_, p)| often(p)) {
                chi2 += (count - p * f64::from(number)).powi(2) / (p * f64::from(number));
                cells += 1.0;
            }
            let h = 2.0 / (9.0 * cells);
            assert!(chi2 < f64::max(cells, 1.0) * (1.0 - h + 4.753 * f64::sqrt(h)).powi(3), "{chi2} of {cells}");
        }
    }

    /// No light is left out that could light the point: one with a normal within 90° of it, or within where it ends.
    #[test]
    fn what_can_shine_is_found() {
        let lights = lights(60);
        let tree = LightTree::new(&lights);
        let mut random = Random::new(8, 0, 0);
        let mut seen = 0;
        for _ in 0..2000 {
            let point = 24.0 * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - Vec3::splat(12.0);
            for (index, bounds) in lights.iter().enumerate() {
                let Some(bounds) = bounds else { continue };
                let angle = bounds.cone.axis.angle_between(point - bounds.centre()) - bounds.cone.half;
                if angle < bounds.cone.end.min(FRAC_PI_2 - 0.01) {
                    assert!(tree.probability(point, index, None) > 0.0, "{index} from {point}");
                    seen += 1;
                }
            }
        }
        assert!(seen > 1000);
    }

    /// A light at a place on an axis.
    fn at(x: f32, intensity: f32) -> Option<LightBounds> {
        let place = Vec3::X * x;
        Some(LightBounds { low: place, high: place, cone: Cone::ALL, intensity })
    }

    /// Lights whose power has overflowed, and points where a light is, leave something to each of the others.
    #[test]
    fn what_is_too_bright_leaves_something_to_others() {
        let lights = [at(0.0, f32::INFINITY), at(10.0, 1.0), None, at(20.0, f32::NAN), at(5.0, 2.0), at(5.5, 3e38)];
        let tree = LightTree::new(&lights);
        for x in [0.0, 5.0, 5.2, 10.0, 20.0, 30.0] {
            let probability = |light: usize| tree.probability(Vec3::X * x, light, None);
            let all: f32 = (0..lights.len()).map(probability).sum();
            assert!((all - 1.0).abs() < 1e-5, "{x}: {all}");
            assert!((0..lights.len()).all(|light| probability(light) > 0.0 || lights[light].is_none()), "{x}");
            assert!(tree.sample(Vec3::X * x, 0.5, None).is_some(), "{x}");
        }
    }

    #[test]
    fn nearer_and_stronger_lights_are_preferred() {
        let tree = LightTree::new(&[at(0.0, 1.0), at(10.0, 1.0), None, at(5.0, 0.0)]);
        let near = tree.probability(Vec3::X, 0, None);
        assert!(near > 0.9 && near <= 1.0 - LEAST, "{near}");
        assert_eq!(tree.probability(Vec3::X, 2, None), 0.0);
        assert!(LightTree::new(&[None]).sample(Vec3::ZERO, 0.5, None).is_none());
        assert!(LightTree::default().sample(Vec3::ZERO, 0.5, None).is_none());
    }
}
