//! Homogeneous participating media: transmittance, and sampling of the distance to a collision.

use glam::Vec3;

use super::phase::HenyeyGreenstein;
use crate::math::lanes::functions::{exp, ln};

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
        let channel = if choice < share.x { 0 } else { 1 + usize::from(choice >= share.x + share.y) };
        let distance = -ln(1.0 - u) / self.extinction[channel];
        // Without extinction in the channel the quotient is infinite, or NaN for u = 0.
        let collides = distance < limit;
        let length = if collides { distance } else { limit };
        // Relative to the channel that gets farthest among those that can be chosen: a dense medium's own exponentials are 0.
        let chosen = Vec3::select(share.cmpgt(Vec3::ZERO), self.extinction, Vec3::INFINITY);
        let least = chosen.min_element();
        let relative = attenuation(self.extinction - Vec3::splat(least), length);
        if collides {
            let density = (share * self.extinction * relative).element_sum();
            Flight::Collision { distance, weight: quotient(self.albedo * self.extinction * relative, density) }
        } else {
            Flight::Through { weight: quotient(relative, (share * relative).element_sum()) }
        }
    }
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

fn quotient(value: Vec3, density: f32) -> Vec3 {
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

    /// The mean weight of getting through is the transmittance, that of a collision the scattered part; 5σ of 200,000 flights
    /// per channel and case (false alarm 2e-5 in all).
    #[test]
    fn flights_are_unbiased_in_every_channel() {
        let cases = [
            (Vec3::new(0.5, 1.0, 2.0), 1.0),
            (Vec3::new(0.0, 1.0, 20.0), 1.0),
            (Vec3::splat(1e-3), 3.0),
            (Vec3::new(1e4, 2e4, 1e4), 1e-4),
        ];
        for (case, (extinction, limit)) in cases.into_iter().enumerate() {
            let medium = medium(extinction, 0.8);
            for carried in [Vec3::ONE, Vec3::new(1.0, 0.2, 0.05)] {
                let mut random = Random::new(3, case as u64, 0);
                let n = 200_000;
                let mut sums = [[Vec3::ZERO.as_dvec3(); 2]; 2];
                for _ in 0..n {
                    let (index, weight) = match medium.sample(carried, limit, random.next_f32(), random.next_f32()) {
                        Flight::Collision { weight, .. } => (0, weight.as_dvec3()),
                        Flight::Through { weight } => (1, weight.as_dvec3()),
                    };
                    sums[index][0] += weight / f64::from(n);
                    sums[index][1] += weight * weight / f64::from(n);
                }
                let through = medium.transmittance(limit).as_dvec3();
                let scattered = (glam::DVec3::ONE - through) * 0.8;
                for (sum, truth) in sums.into_iter().zip([scattered, through]) {
                    for c in 0..3 {
                        let error = ((sum[1][c] - sum[0][c].powi(2)).max(0.0) / f64::from(n)).sqrt();
                        let off = (sum[0][c] - truth[c]).abs();
                        assert!(off < 5.0 * error + 1e-6, "case {case}, channel {c}: {} {}", sum[0][c], truth[c]);
                    }
                }
            }
        }
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
