//! Choosing among many lights by an estimate of how much each sends to a point: a binary tree over the lights that have a place.
//!
//! Every node bounds the positions, directions and intensity of its lights. From the root down, the child with the larger estimate
//! is taken more often (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with Adaptive Tree Splitting*, without
//! the splitting; orientation bounds by their §4.1, costs by §4.4).

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;

/// Bounds of a light's position, directions and intensity.
#[derive(Debug, Clone, Copy)]
pub struct LightBounds {
    /// Lower corner of the box around it.
    pub low: Vec3,
    /// Upper corner of the box.
    pub high: Vec3,
    /// Cone around all its normals, or its axes of symmetry.
    pub cone: Cone,
    /// Radiant intensity in the direction where it is greatest, W·sr⁻¹, channel mean.
    pub intensity: f32,
}

/// A cone of directions around an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    axis: Vec3,
    /// Half angle in [0, π].
    half: f32,
}

impl Cone {
    /// Every direction.
    pub const ALL: Self = Self { axis: Vec3::Z, half: PI };

    /// Directions within `half` of the unit vector `axis`.
    pub fn new(axis: Vec3, half: f32) -> Self {
        Self { axis, half }
    }

    /// A cone around both.
    pub fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.half >= other.half { (self, other) } else { (other, self) };
        let between = wide.axis.angle_between(narrow.axis);
        if (between + narrow.half).min(PI) <= wide.half {
            return wide;
        }
        let half = 0.5 * (wide.half + between + narrow.half);
        let turn = wide.axis.cross(narrow.axis);
        // Nearly opposite axes have no plane to turn in.
        if half >= PI || turn.length_squared() < 1e-6 {
            return Self::ALL;
        }
        let turned = glam::Quat::from_axis_angle(turn.normalize(), half - wide.half) * wide.axis;
        Self { axis: turned.normalize(), half }
    }

    /// About the solid angle into which surfaces with these normals shine.
    fn measure(self) -> f32 {
        let end = (self.half + FRAC_PI_2).min(PI);
        let (half, cos) = (self.half, self.half.cos());
        let rim = 2.0 * end * half.sin() - (half - 2.0 * end).cos() - 2.0 * half * half.sin() + cos;
        TAU * (1.0 - cos) + FRAC_PI_2 * rim
    }
}

impl LightBounds {
    fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            cone: self.cone.union(other.cone),
            intensity: self.intensity + other.intensity,
        }
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    fn cost(&self) -> f32 {
        // Not the area of the box, which is nothing for lights on a line.
        self.intensity * self.cone.measure() * (self.high - self.low).length_squared()
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    centre: Vec3,
    /// Half diagonal of the box.
    radius: f32,
    axis: Vec3,
    cos_half: f32,
    sin_half: f32,
    intensity: f32,
    /// Index of the first of two adjacent children, or of the light.
    link: u32,
    leaf: bool,
}

impl Node {
    fn new(bounds: &LightBounds) -> Self {
        let (sin_half, cos_half) = bounds.cone.half.sin_cos();
        Self {
            centre: bounds.centre(),
            radius: 0.5 * (bounds.high - bounds.low).length(),
            axis: bounds.cone.axis,
            cos_half,
            sin_half,
            intensity: bounds.intensity,
            link: 0,
            leaf: true,
        }
    }

    /// Estimate of the greatest irradiance that the node's lights can send to `point`: intensity times the cosine of the least
    /// angle by which they are turned away, over the squared distance, which counts as no less than the node's size.
    fn importance(&self, point: Vec3) -> f32 {
        let to = point - self.centre;
        let squared = to.length_squared();
        let near = self.radius * self.radius;
        let falloff = self.intensity / squared.max(near).max(f32::MIN_POSITIVE);
        if squared <= near {
            return falloff;
        }
        let cos = self.axis.dot(to) / squared.sqrt();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        // Angles are subtracted by their sines and cosines: first the cone of the normals, then the box as seen from the point.
        let (sin, cos) = less((sin, cos), (self.sin_half, self.cos_half));
        let sin_box = (near / squared).sqrt();
        let (_, cos) = less((sin, cos), (sin_box, (1.0 - sin_box * sin_box).max(0.0).sqrt()));
        falloff * cos.max(0.0)
    }
}

/// Sine and cosine of max(a - b, 0), for angles in [0, π] given by their sines and cosines.
fn less((sin_a, cos_a): (f32, f32), (sin_b, cos_b): (f32, f32)) -> (f32, f32) {
    if cos_a >= cos_b { (0.0, 1.0) } else { (sin_a * cos_b - cos_a * sin_b, cos_a * cos_b + sin_a * sin_b) }
}

/// A tree over the lights that have a place.
#[derive(Debug, Clone, Default)]
pub struct LightTree {
    /// The nodes: two children are adjacent, and parents come before them.
    nodes: Vec<Node>,
    /// By light: the turns from the root to its leaf, the first in the lowest bit, and their number; none without a place.
    trails: Vec<Option<(u64, u32)>>,
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
        let mut placed: Vec<(u32, LightBounds)> =
            (0..).zip(lights).filter_map(|(index, bounds)| Some((index, (*bounds)?))).collect();
        let mut tree = Self { nodes: Vec::with_capacity(2 * placed.len()), trails: vec![None; lights.len()] };
        if !placed.is_empty() {
            tree.nodes.push(Node::new(&around(&placed)));
            tree.grow(0, &mut placed, 0, 0);
        }
        tree
    }

    fn grow(&mut self, node: usize, lights: &mut [(u32, LightBounds)], trail: u64, depth: u32) {
        if let [(light, _)] = lights {
            self.nodes[node].link = *light;
            self.trails[*light as usize] = Some((trail, depth));
            return;
        }
        let middle = if depth < DEEPEST { split(lights) } else { lights.len() / 2 };
        let (left, right) = lights.split_at_mut(middle);
        let first = self.nodes.len();
        self.nodes[node].link = first as u32;
        self.nodes[node].leaf = false;
        self.nodes.extend([&*left, &*right].map(|half| Node::new(&around(half))));
        self.grow(first, left, trail, depth + 1);
        self.grow(first + 1, right, trail | 1 << depth, depth + 1);
    }

    /// Probability of choosing the first child at `point`; none where both estimates are 0.
    fn turn(&self, first: u32, point: Vec3) -> Option<f32> {
        let [a, b] = [first, first + 1].map(|child| self.nodes[child as usize].importance(point));
        let sum = a + b;
        if !(sum > 0.0 && sum.is_finite()) {
            return None;
        }
        let share = a / sum;
        Some(if a > 0.0 && b > 0.0 { share.clamp(LEAST, 1.0 - LEAST) } else { share })
    }

    /// Samples a light for `point`; returns its index and probability, none where no light can light it.
    pub fn sample(&self, point: Vec3, mut u: f64) -> Option<(usize, f32)> {
        let mut node = self.nodes.first()?;
        let mut probability = 1.0;
        while !node.leaf {
            let share = self.turn(node.link, point)?;
            let limit = f64::from(share);
            let second = u >= limit;
            (u, probability) = if second {
                ((u - limit) / (1.0 - limit), probability * (1.0 - share))
            } else {
                (u / limit, probability * share)
            };
            node = &self.nodes[node.link as usize + usize::from(second)];
        }
        Some((node.link as usize, probability))
    }

    /// The probability with which [`LightTree::sample`] chooses `light` for `point`.
    pub fn probability(&self, point: Vec3, light: usize) -> f32 {
        let Some((mut trail, depth)) = self.trails[light] else { return 0.0 };
        let (mut node, mut probability) = (&self.nodes[0], 1.0);
        for _ in 0..depth {
            let Some(share) = self.turn(node.link, point) else { return 0.0 };
            let second = trail & 1 == 1;
            probability *= if second { 1.0 - share } else { share };
            node = &self.nodes[node.link as usize + usize::from(second)];
            trail >>= 1;
        }
        probability
    }
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
    use super::*;
    use crate::base::random::Random;

    fn lights(count: usize) -> Vec<Option<LightBounds>> {
        let mut random = Random::new(5, 0, 0);
        let mut vector = || Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        let light = |i: usize| {
            // Some without a place, some at one place, some facing one way.
            (i % 7 != 3).then(|| {
                let low = if i.is_multiple_of(5) { Vec3::ONE } else { 10.0 * vector() };
                let cone = if i.is_multiple_of(2) { Cone::ALL } else { Cone::new(vector().normalize_or(Vec3::Z), 0.3) };
                LightBounds { low, high: low + 0.1 * vector().abs(), cone, intensity: 1.0 + i as f32 % 4.0 }
            })
        };
        (0..count).map(light).collect()
    }

    /// Probabilities equal those of the samples, and add up to one where every light has an estimate above 0.
    #[test]
    fn probabilities_are_those_of_sampling() {
        let mut random = Random::new(6, 0, 0);
        for count in [1, 2, 40] {
            let lights = lights(count);
            let tree = LightTree::new(&lights);
            for _ in 0..100 {
                let point =
                    12.0 * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - Vec3::splat(6.0);
                let total: f32 = (0..count).map(|light| tree.probability(point, light)).sum();
                let sampled = tree.sample(point, random.next_f64());
                if let Some((light, probability)) = sampled {
                    assert!((total - 1.0).abs() < 1e-4 || total < 1.0, "{total}");
                    let again = tree.probability(point, light);
                    assert!((probability - again).abs() <= 1e-6 * again && again > 0.0, "{probability} {again}");
                }
            }
        }
    }

    /// No light is left out that could light the point: a direction of its cone within 90° of the point.
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
                if angle < FRAC_PI_2 - 0.01 {
                    assert!(tree.probability(point, index) > 0.0, "{index} from {point}");
                    seen += 1;
                }
            }
        }
        assert!(seen > 1000);
    }

    #[test]
    fn nearer_and_stronger_lights_are_preferred() {
        let at = |x: f32, intensity: f32| {
            let place = Vec3::X * x;
            Some(LightBounds { low: place, high: place, cone: Cone::ALL, intensity })
        };
        let tree = LightTree::new(&[at(0.0, 1.0), at(10.0, 1.0), None, at(5.0, 0.0)]);
        let near = tree.probability(Vec3::X, 0);
        assert!(near > 0.9 && near <= 1.0 - LEAST, "{near}");
        assert_eq!(tree.probability(Vec3::X, 2), 0.0);
        assert!(LightTree::new(&[None]).sample(Vec3::ZERO, 0.5).is_none());
        assert!(LightTree::default().sample(Vec3::ZERO, 0.5).is_none());
    }
}
