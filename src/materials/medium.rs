//! Homogeneous participating media: transmittance, and sampling of the distance to a collision.

use glam::Vec3;

use super::phase::HenyeyGreenstein;
use crate::math::lanes::functions::{exp, ln};

/// Parts of a ray, of each of which it is asked how much light is expected there. Eight ask longer for one or two hundredths less noise.
pub(super) const PARTS: usize = 4;
/// Part of the distances that are drawn as if nothing were known of the light.
const PLAIN: f32 = 0.25;

/// Index of a medium in its scene.
pub type MediumId = u32;

/// A medium with the same properties everywhere: fog, milk, tinted glass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Extinction coefficient σ_t per channel, 1 / scene unit.
    pub extinction: Vec3,
    /// Single-scattering albedo: the part of the extinction that is scattered, σ_s / σ_t per channel, in [0, 1].
    pub albedo: Vec3,
    /// Phase function: the directions of scattered light.
    pub phase: HenyeyGreenstein,
}

/// End of a flight through a medium, with the transmittance to there over the density of that end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flight {
    /// A collision with the medium at `distance`; `weight` includes the part that is scattered.
    Collision {
        /// Distance from the ray's origin.
        distance: f32,
        /// σ_s · T / p, p being the density of the distance.
        weight: Vec3,
    },
    /// No collision up to the limit.
    Through {
        /// T / P, P being the probability of no collision.
        weight: Vec3,
    },
}

impl Flight {
    /// The same with `factor` times the weight.
    pub(super) fn times(self, factor: f32) -> Self {
        match self {
            Self::Collision { distance, weight } => Self::Collision { distance, weight: weight * factor },
            Self::Through { weight } => Self::Through { weight: weight * factor },
        }
    }
}

impl Medium {
    /// Transmittance along `distance` per channel (Beer and Lambert).
    pub fn transmittance(&self, distance: f32) -> Vec3 {
        attenuation(self.extinction, distance)
    }

    /// Samples the flight of a ray of length `limit`, which may be infinite. One channel, chosen in proportion to what the path
    /// carries (`carried`) in it, decides the distance, and the weight is by the density of all of them (Wilkie et al. 2014), so
    /// that no channel is ever weighted by more than the path's own mean over what it carries itself.
    pub fn sample(&self, carried: Vec3, limit: f32, choice: f32, u: f32) -> Flight {
        if self.albedo == Vec3::ZERO {
            // A collision would scatter nothing.
            return Flight::Through { weight: self.transmittance(limit) };
        }
        let share = shares(carried);
        let channel = channel(share, choice);
        let distance = -ln(1.0 - u) / self.extinction[channel];
        // Without extinction in the channel the quotient is infinite, or NaN for u = 0.
        if distance < limit { self.collision(share, distance) } else { self.through(share, limit) }
    }

    /// A collision at this distance as [`Medium::sample`] returns it, and its density there, 1 / scene unit.
    pub fn collision_at(&self, carried: Vec3, distance: f32) -> (Flight, f32) {
        if self.albedo == Vec3::ZERO {
            return (Flight::Collision { distance, weight: Vec3::ZERO }, 0.0);
        }
        let share = shares(carried);
        let density = (share * self.extinction * self.transmittance(distance)).element_sum();
        (self.collision(share, distance), density)
    }

    /// No collision up to the limit as [`Medium::sample`] returns it, and its probability there.
    pub fn passed(&self, carried: Vec3, limit: f32) -> (Flight, f32) {
        let through = self.transmittance(limit);
        if self.albedo == Vec3::ZERO {
            return (Flight::Through { weight: through }, 1.0);
        }
        let share = shares(carried);
        (self.through(share, limit), (share * through).element_sum())
    }

    /// [`Medium::sample`] where it is known how much light is expected: what collisions at a distance send back, before the albedo, and what
    /// comes from the end of the ray, for which it is asked with none; either may be unknown. Distances are drawn in proportion to
    /// what a path would bring (after Herholz et al. 2019, *Volume Path Guiding Based on Zero-Variance Random Walk Theory*, §5), in
    /// steps: the ray is divided into [`PARTS`], of which one, or the end, is chosen by its probability under [`Medium::sample`] times what is
    /// expected, and the distance within it as there. A part of [`PLAIN`] is drawn as there, so weights are at most 1/[`PLAIN`] of those there.
    pub fn sample_expecting(
        &self,
        carried: Vec3,
        limit: f32,
        [choice, u]: [f32; 2],
        expected: impl Fn(Option<f32>) -> Option<f32>,
    ) -> Flight {
        let share = shares(carried);
        let extinction = (share * self.extinction).element_sum();
        let albedo = (share * self.albedo).element_sum();
        // Without extinction there is nothing to divide, and what is not finite is left to the plain formula.
        if albedo <= 0.0 || !(extinction > 0.0 && extinction < f32::MAX && limit > 0.0) {
            return self.sample(carried, limit, choice, u);
        }
        let ends = self.ends(extinction, limit);
        let mut odds = [0.0; PARTS + 1];
        let mut worth = [None; PARTS + 1];
        for part in 0..=PARTS {
            let [begin, end] = [ends[part], ends[part + 1]];
            let middle = if end.is_finite() { 0.5 * (begin + end) } else { begin + 1.0 / extinction };
            let (at, scattered) = if part < PARTS { (Some(middle), albedo) } else { (None, 1.0) };
            odds[part] = match at {
                Some(_) => self.collides(share, begin, end).element_sum(),
                None => (share * self.transmittance(limit)).element_sum(),
            };
            worth[part] = expected(at).filter(|worth| worth.is_finite()).map(|worth| worth.max(0.0) * scattered);
        }
        let Some(Part { number: part, within, rarer }) = Part::choose(&odds, &worth, u) else {
            return self.sample(carried, limit, choice, u);
        };
        if part == PARTS {
            return self.through(share, limit).times(rarer);
        }
        let [begin, end] = [ends[part], ends[part + 1]];
        let channels = self.collides(share, begin, end);
        let channel = channel(channels / channels.element_sum(), choice);
        let extinction = self.extinction[channel];
        let depth = depth_of(within * lost(extinction * (end - begin)));
        let distance = (begin + depth / extinction).max(begin).min(end).min(limit.next_down());
        self.collision(share, distance).times(rarer)
    }

    /// Where the parts of a ray begin, its end, and infinity: collisions are about as likely in each.
    fn ends(&self, extinction: f32, limit: f32) -> [f32; PARTS + 2] {
        let all = lost(extinction * limit);
        let mut ends = [f32::INFINITY; PARTS + 2];
        for (part, end) in ends.iter_mut().take(PARTS).enumerate() {
            *end = (depth_of(all * part as f32 / PARTS as f32) / extinction).min(limit);
        }
        ends[PARTS] = limit;
        ends
    }

    /// Probability under [`Medium::sample`] of a collision between two distances, by the channel that decides.
    fn collides(&self, share: Vec3, begin: f32, end: f32) -> Vec3 {
        share * self.transmittance(begin) * (self.extinction * (end - begin)).map(lost)
    }

    /// A collision at a distance that was drawn by channels of these shares.
    fn collision(&self, share: Vec3, distance: f32) -> Flight {
        let relative = self.relative(share, distance);
        let density = (share * self.extinction * relative).element_sum();
        Flight::Collision { distance, weight: quotient(self.albedo * self.extinction * relative, density) }
    }

    /// No collision.
    fn through(&self, share: Vec3, limit: f32) -> Flight {
        let relative = self.relative(share, limit);
        Flight::Through { weight: quotient(relative, (share * relative).element_sum()) }
    }

    /// Transmittance relative to the channel that gets farthest among those that can be chosen: a dense medium's own exponentials are 0.
    fn relative(&self, share: Vec3, length: f32) -> Vec3 {
        let chosen = Vec3::select(share.cmpgt(Vec3::ZERO), self.extinction, Vec3::INFINITY);
        attenuation(self.extinction - Vec3::splat(chosen.min_element()), length)
    }
}

/// A part of a ray, or its end, that was chosen by its probability times what is expected there.
pub(super) struct Part {
    /// Which; [`PARTS`] is the end.
    pub number: usize,
    /// A uniform number in [0, 1] that is left.
    pub within: f32,
    /// How much rarer it is drawn by its probability alone.
    pub rarer: f32,
}

impl Part {
    /// Chooses by `u`, of odds by transmittance, and what is expected in each part, where that is known; none where nothing is.
    pub fn choose(odds: &[f32; PARTS + 1], worth: &[Option<f32>; PARTS + 1], u: f32) -> Option<Self> {
        let mut known = [0.0; 2];
        for (odds, worth) in odds.iter().zip(worth) {
            if let Some(worth) = worth {
                known = [known[0] + odds * worth, known[1] + odds];
            }
        }
        let (total, mean) = (odds.iter().sum::<f32>(), known[0] / known[1]);
        if !(mean > 0.0 && mean.is_finite() && total > 0.0) {
            return None;
        }
        let hoped = |part: usize| odds[part] * worth[part].unwrap_or(mean);
        let all = (0..=PARTS).map(hoped).sum::<f32>();
        let chance = |part: usize| (1.0 - PLAIN) * hoped(part) / all + PLAIN * odds[part] / total;
        let (mut number, mut below) = (0, 0.0);
        while number < PARTS && u >= below + chance(number) {
            below += chance(number);
            number += 1;
        }
        let (chance, plain) = (chance(number), odds[number] / total);
        let rarer = if chance > 0.0 { plain / chance } else { 0.0 };
        Some(Self { number, within: ((u - below) / chance).clamp(0.0, 1.0), rarer })
    }
}

/// The channel that a number in [0, 1) chooses.
pub(super) fn channel(share: Vec3, choice: f32) -> usize {
    if choice < share.x { 0 } else { 1 + usize::from(choice >= share.x + share.y) }
}

/// 1 − exp(−x) for x ≥ 0, to all digits for small x too.
pub(super) fn lost(x: f32) -> f32 {
    if x < 0.02 { x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x / 24.0))) } else { 1.0 - exp(-x) }
}

/// The inverse of [`lost`], −ln(1 − y).
pub(super) fn depth_of(y: f32) -> f32 {
    if y < 0.02 { y * (1.0 + y * (0.5 + y * (1.0 / 3.0 + y * 0.25))) } else { -ln(1.0 - y) }
}

/// exp(-σ·d) per channel; 1 where σ is 0, even along an infinite distance.
fn attenuation(extinction: Vec3, distance: f32) -> Vec3 {
    let depth = extinction * distance;
    Vec3::select(extinction.cmpeq(Vec3::ZERO), Vec3::ONE, (-depth).map(exp))
}

/// Probability of choosing each channel.
pub(super) fn shares(carried: Vec3) -> Vec3 {
    let total = carried.element_sum();
    if carried.cmpge(Vec3::ZERO).all() && total > 0.0 && total.is_finite() {
        carried / total
    } else {
        Vec3::splat(1.0 / 3.0)
    }
}

pub(super) fn quotient(value: Vec3, density: f32) -> Vec3 {
    // A channel that carries nothing may have more extinction taken off than it has; it stays at nothing.
    let finite = Vec3::select(value.is_finite_mask(), value, Vec3::ZERO);
    if density > 0.0 { finite / density } else { Vec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn medium(extinction: Vec3, albedo: f32) -> Medium {
        Medium { extinction, albedo: Vec3::splat(albedo), phase: HenyeyGreenstein::new(0.0) }
    }

    /// Lights on a ray of unit length in a thin medium, and beyond: everywhere, in its middle, behind it, unknown, and not finite.
    const EXPECTED: [fn(Option<f32>) -> Option<f32>; 6] = [
        |_| None,
        |_| Some(2.0),
        |at| Some(at.map_or(0.0, |at| if (0.4..0.6).contains(&at) { 1.0 } else { 1e-3 })),
        |at| if at.is_none() { Some(1e6) } else { Some(0.0) },
        |at| at.filter(|at| *at > 0.5),
        |at| if at.is_none() { Some(f32::NAN) } else { Some(f32::INFINITY) },
    ];

    /// The mean weight of getting through is the transmittance, that of a collision the scattered part, and that of its distance the
    /// integral of both, whatever light is expected where; 5σ of 100,000 flights per channel, case and quantity (756 of them:
    /// false alarm 4e-4 in all).
    #[test]
    fn flights_are_unbiased_in_every_channel() {
        let cases = [
            (Vec3::new(0.5, 1.0, 2.0), 1.0),
            (Vec3::new(0.0, 1.0, 20.0), 1.0),
            (Vec3::splat(1e-3), 3.0),
            (Vec3::new(1e4, 2e4, 1e4), 1e-4),
            (Vec3::new(2.0, 0.7, 0.1), f32::INFINITY),
            (Vec3::new(2e-3, 1e-2, 5e-3), 2.0),
        ];
        for (case, (extinction, limit)) in cases.into_iter().enumerate() {
            let medium = medium(extinction, 0.8);
            for (carried, known) in [Vec3::ONE, Vec3::new(1.0, 0.2, 0.05)].into_iter().flat_map(|carried| {
                std::iter::once(None).chain(EXPECTED.into_iter().map(Some)).map(move |known| (carried, known))
            }) {
                let mut random = Random::new(3, case as u64, 0);
                let n = 100_000;
                let mut sums = [[glam::DVec3::ZERO; 2]; 3];
                for _ in 0..n {
                    let [choice, u] = random.next_2d();
                    let end = match known {
                        None => medium.sample(carried, limit, choice, u),
                        Some(known) => medium.sample_expecting(carried, limit, [choice, u], known),
                    };
                    let (parts, weight) = match end {
                        Flight::Collision { weight, distance } => {
                            assert!((0.0..=limit).contains(&distance), "{distance} of {limit}");
                            ([1.0, 0.0, f64::from(distance)], weight.as_dvec3())
                        }
                        Flight::Through { weight } => ([0.0, 1.0, 0.0], weight.as_dvec3()),
                    };
                    for (sum, part) in sums.iter_mut().zip(parts) {
                        sum[0] += weight * part / f64::from(n);
                        sum[1] += (weight * part).powf(2.0) / f64::from(n);
                    }
                }
                let (sigma, length) = (extinction.as_dvec3(), f64::from(limit));
                for c in 0..3 {
                    let depth = sigma[c] * length;
                    let (through, lost) =
                        if sigma[c] > 0.0 { ((-depth).exp(), -(-depth).exp_m1()) } else { (1.0, 0.0) };
                    // ∫ σ_s t e^{-σt} dt: of a thin medium by its series, where the closed form cancels.
                    let mean = if depth < 1e-3 {
                        sigma[c] * length * length * (0.5 - depth / 3.0)
                    } else {
                        lost / sigma[c] - if length.is_finite() { length * through } else { 0.0 }
                    };
                    let mean = if sigma[c] > 0.0 { mean } else { 0.0 };
                    for (sum, truth) in sums.iter().zip([0.8 * lost, through, 0.8 * mean]) {
                        let error = ((sum[1][c] - sum[0][c].powi(2)).max(0.0) / f64::from(n)).sqrt();
                        let off = (sum[0][c] - truth).abs();
                        assert!(off < 5.0 * error + 1e-6, "case {case}, channel {c}: {} {truth}", sum[0][c]);
                    }
                }
            }
        }
    }

    /// Ends of flights have the density that they are told to have: the probabilities of a collision in each tenth of a ray and of none, by
    /// the rule of Simpson, against 100,000 flights; 5σ of each of 6 · 11 (false alarm 4e-5 in all). Weights are those of the flights.
    #[test]
    fn ends_have_their_densities() {
        let cases = [(Vec3::new(0.5, 1.0, 2.0), 1.0), (Vec3::new(0.0, 1.0, 20.0), 1.0), (Vec3::splat(3.0), 0.5)];
        for (case, (extinction, limit)) in cases.into_iter().enumerate() {
            for carried in [Vec3::ONE, Vec3::new(1.0, 0.2, 0.05)] {
                let (medium, n) = (medium(extinction, 0.8), 100_000);
                let (mut random, mut counts) = (Random::new(4, case as u64, 0), [0u32; 11]);
                for _ in 0..n {
                    let [choice, u] = random.next_2d();
                    let flight = medium.sample(carried, limit, choice, u);
                    let (part, (same, _)) = match flight {
                        Flight::Collision { distance, .. } => {
                            ((distance / limit * 10.0) as usize, medium.collision_at(carried, distance))
                        }
                        Flight::Through { .. } => (10, medium.passed(carried, limit)),
                    };
                    assert_eq!(flight, same);
                    counts[part] += 1;
                }
                let tenth = |part: usize| {
                    let steps = 20;
                    let at = |i: usize| limit * (part as f32 + i as f32 / steps as f32) / 10.0;
                    let factor = |i: usize| [1.0, 4.0, 2.0][if i == 0 || i == steps { 0 } else { 2 - i % 2 }];
                    let sum: f64 =
                        (0..=steps).map(|i| factor(i) * f64::from(medium.collision_at(carried, at(i)).1)).sum();
                    sum * f64::from(limit) / (30 * steps) as f64
                };
                for (part, count) in counts.into_iter().enumerate() {
                    let p = if part < 10 { tenth(part) } else { f64::from(medium.passed(carried, limit).1) };
                    let error = (p * (1.0 - p) / f64::from(n)).sqrt();
                    let share = f64::from(count) / f64::from(n);
                    assert!((share - p).abs() < 5.0 * error + 1e-6, "case {case}, part {part}: {share} {p}");
                }
            }
        }
        let clear = Medium { albedo: Vec3::ZERO, ..medium(Vec3::ONE, 0.0) };
        assert_eq!(clear.passed(Vec3::ONE, 1.0).1, 1.0);
        assert_eq!(clear.collision_at(Vec3::ONE, 1.0).1, 0.0);
    }

    /// Where light is expected in one place alone, distances are drawn there: the estimate of what it brings has a fifth of the variance at
    /// most (0.05 of it, of which [`PLAIN`] is the cause; the false-alarm rate is nil).
    #[test]
    fn distances_are_drawn_where_light_is() {
        let medium = medium(Vec3::splat(0.1), 1.0);
        let light = |at: Option<f32>| at.map_or(0.0, |at| if (3.8..6.4).contains(&at) { 1.0 } else { 0.0 });
        let variance = |expecting: bool| {
            let (mut random, n) = (Random::new(7, 0, 0), 100_000);
            let brought = (0..n).map(|_| {
                let [choice, u] = random.next_2d();
                let end = if expecting {
                    medium.sample_expecting(Vec3::ONE, 10.0, [choice, u], |at| Some(light(at)))
                } else {
                    medium.sample(Vec3::ONE, 10.0, choice, u)
                };
                match end {
                    Flight::Collision { distance, weight } => f64::from(weight.x * light(Some(distance))),
                    Flight::Through { weight } => f64::from(weight.x * light(None)),
                }
            });
            let (sum, squares) = brought.fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
            let mean = sum / f64::from(n);
            squares / f64::from(n) / (mean * mean) - 1.0
        };
        let [plain, guided] = [false, true].map(variance);
        assert!(guided < 0.2 * plain, "{guided} {plain}");
    }

    /// docs/stability.md, A12: nothing, or everything at once.
    #[test]
    fn a12_limits_are_exact() {
        let clear = medium(Vec3::ZERO, 1.0);
        let opaque = medium(Vec3::splat(1e30), 1.0);
        for u in [0.0, 0.5, 1.0 - f32::EPSILON] {
            assert_eq!(clear.sample(Vec3::ONE, f32::INFINITY, u, u), Flight::Through { weight: Vec3::ONE });
            let hit = opaque.sample(Vec3::ONE, 1.0, 0.1, u);
            assert!(
                matches!(hit, Flight::Collision { distance, weight }
                if distance < 1e-20 && (weight - Vec3::ONE).abs().max_element() < 1e-5),
                "{hit:?}"
            );
        }
        assert_eq!(clear.transmittance(f32::INFINITY), Vec3::ONE);
        assert_eq!(opaque.transmittance(1.0), Vec3::ZERO);
        assert_eq!(opaque.transmittance(0.0), Vec3::ONE);
        // A channel that the path does not carry, and that gets farther than those it does.
        let tinted = medium(Vec3::new(1.0, 1.0, 0.0), 0.5);
        let carried = Vec3::new(1.0, 1.0, 0.0);
        for u in [0.0, 0.3, 1.0 - f32::EPSILON] {
            let (Flight::Collision { weight, .. } | Flight::Through { weight }) = tinted.sample(carried, 1e6, u, u);
            assert!(weight.is_finite() && (carried * weight).is_finite(), "{weight}");
        }
    }
}
