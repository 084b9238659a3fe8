//! The sphere on which the light of a voxel is taken to start, see [`Parallax`].
//!
//! Where the next hits lie is the first guess. It is right for lamps and lit walls, and wrong where light only passes: the sun behind
//! a pane comes from one direction to all points of a voxel, and a sphere at the pane would smear it over as many directions as it has
//! points. So spheres are judged by what they are for, which is to make the points of a voxel see the same distribution.

use std::f64::consts::TAU;

use glam::Vec3;

use crate::guiding::cache::Bounds;
use crate::guiding::cache::parallax::{Carried, Parallax};
use crate::guiding::record::{PathRecord, PhotonRecord};

/// Light that arrived at a point of a voxel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrival {
    point: Vec3,
    /// Unit direction that it came from.
    direction: Vec3,
    /// Distance to where it came from, the next hit.
    distance: f32,
    /// Part of the light that it brought; not negative.
    pub weight: f32,
}

impl Arrival {
    /// Of a path that found light of this value.
    pub fn of_path(record: &PathRecord, weight: f32) -> Self {
        Self { point: record.point, direction: record.direction, distance: record.distance, weight }
    }

    /// Of a photon.
    pub fn of_photon(record: &PhotonRecord, weight: f32) -> Self {
        Self { point: record.point, direction: record.direction, distance: record.distance, weight }
    }

    /// Whether it says where light starts.
    pub fn brings_light(&self) -> bool {
        self.weight > 0.0
    }
}

/// Curvatures that are compared, over that of the sphere through the next hits, which is kept where nothing tells them apart.
const CURVATURES: [f32; 5] = [1.0, 2.0, 0.5, 0.25, 0.0];

/// Arrivals by which spheres are compared. Their pairs take 10 µs for each sphere.
const WITNESSES: usize = 64;

/// Gain of the logarithm of the likelihood up to which the first guess is kept: so much, and so much for each witness. Luck seldom gives as
/// much, and where all of many gain little each, a sharper guide is not worth what it errs.
const LEAST_GAIN: [f64; 2] = [1.0, 0.25];

/// Sphere of the voxel within `bounds` for the light that arrived there; `density` is that of the last guide, by which an error of
/// direction costs most at narrow peaks.
pub(super) fn fitted(bounds: &Bounds, arrivals: &[Arrival], density: impl Fn(Vec3, Vec3) -> f32) -> Parallax {
    let start = |a: &Arrival| (a.point + a.direction * a.distance, a.weight * density(a.point, a.direction));
    let first = Parallax::fit(bounds, arrivals.iter().map(start));
    if first.curvature > 0.0 { likeliest(first, &witnesses(arrivals)) } else { first }
}

/// Points and directions of up to [`WITNESSES`] arrivals, chosen at equal distances along the sum of their weights; none twice, so
/// that a single bright one has no more to say than others.
fn witnesses(arrivals: &[Arrival]) -> Vec<(Vec3, Vec3)> {
    let usable = arrivals.iter().filter(|a| a.weight > 0.0 && a.weight.is_finite());
    let total: f64 = usable.clone().map(|a| f64::from(a.weight)).sum();
    let step = total / WITNESSES as f64;
    let (mut sum, mut next) = (0.0, 0.5 * step);
    let chosen = usable.filter(|a| {
        sum += f64::from(a.weight);
        let chosen = sum > next;
        while next < sum && step > 0.0 {
            next += step;
        }
        chosen
    });
    chosen.map(|a| (a.point, a.direction)).collect()
}

/// The sphere among those with the [`CURVATURES`] of `first` under which the witnesses are likeliest, each by the others.
fn likeliest(first: Parallax, witnesses: &[(Vec3, Vec3)]) -> Parallax {
    let with = |factor: f32| Parallax { curvature: first.curvature * factor, ..first };
    let [known, others @ ..] = CURVATURES.map(with).map(|sphere| (sphere, log_likelihood(&sphere, witnesses)));
    let least = LEAST_GAIN[0] + LEAST_GAIN[1] * witnesses.len() as f64;
    let start = (known.0, known.1 + least);
    others.into_iter().fold(start, |best, next| if next.1 > best.1 { next } else { best }).0
}

/// Logarithm of the likelihood of all witnesses, where the density at the centre is that of a kernel around each of the others. The
/// kernel, 1/(1 − cos θ + ε), has the same mass in every octave of angles, so that it asks for no bandwidth.
fn log_likelihood(sphere: &Parallax, witnesses: &[(Vec3, Vec3)]) -> f64 {
    const EPSILON: f32 = 1e-4;
    let seen: Vec<_> = witnesses.iter().map(|&(point, direction)| sphere.to_centre(point, direction)).collect();
    let norm = 1.0 / (TAU * f64::from((2.0 + EPSILON) / EPSILON).ln() * (seen.len().max(2) - 1) as f64);
    let density = |i: usize| {
        let kernel = |other: Vec3| 1.0 / ((1.0 - seen[i].direction.dot(other)).max(0.0) + EPSILON);
        let sum = |part: &[Carried]| part.iter().map(|o| kernel(o.direction)).sum::<f32>();
        f64::from(sum(&seen[..i]) + sum(&seen[i + 1..]))
    };
    (0..seen.len()).map(|i| (norm * density(i) * f64::from(seen[i].density)).max(1e-30).ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::math::cylindrical;

    const BOUNDS: Bounds = Bounds { low: Vec3::ZERO, high: Vec3::splat(0.2), depth: 0 };
    const CENTRE: Vec3 = Vec3::splat(0.1);
    /// Distance of what is hit.
    const HIT: f32 = 1.0;

    /// Curvature of the sphere for 400 points whose light comes from the direction that `towards` gives for a point, the hits lying at
    /// the distance [`HIT`] from the centre.
    fn curvature(seed: u64, mut towards: impl FnMut(Vec3, &mut Random) -> Vec3) -> f32 {
        let mut random = Random::new(seed, 0, 0);
        let mut arrivals = Vec::new();
        for _ in 0..400 {
            let point = 0.2 * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
            let direction = towards(point, &mut random).normalize();
            arrivals.push(Arrival { point, direction, distance: HIT, weight: 1.0 });
        }
        fitted(&BOUNDS, &arrivals, |_, _| 1.0).curvature
    }

    fn any_direction(random: &mut Random) -> Vec3 {
        cylindrical::to_direction([random.next_f64(), random.next_f64()])
    }

    /// The sun has half a degree, and what a pane scatters of its light has a few.
    #[test]
    fn the_sun_behind_a_pane_is_far_away() {
        for seed in 0..20 {
            for blur in [0.005, 0.05] {
                let sun = curvature(seed, |_, random| Vec3::Y + blur * any_direction(random));
                assert_eq!(sun, 0.0, "seed {seed}, blur {blur}");
            }
        }
    }

    /// Half of the light comes from a lamp at four times the distance of the pane before it, the rest from all around.
    #[test]
    fn a_lamp_behind_a_pane_is_where_it_is() {
        let lamp = CENTRE + Vec3::new(0.0, 4.0 * HIT, 0.0);
        for seed in 0..20 {
            let found = curvature(
                seed,
                |point, random| {
                    if random.next_f32() < 0.5 { lamp - point } else { any_direction(random) }
                },
            );
            assert!((0.2..0.35).contains(&(found * HIT)), "seed {seed}: {found}");
        }
    }

    /// A lamp that is hit, alone or with as much light from all around.
    #[test]
    fn what_is_hit_is_the_first_guess() {
        let lamp = CENTRE + Vec3::new(0.0, HIT, 0.0);
        for (seed, part) in (0..20).flat_map(|seed| [(seed, 1.0), (seed, 0.5)]) {
            let found = curvature(
                seed,
                |point, random| {
                    if random.next_f32() < part { lamp - point } else { any_direction(random) }
                },
            );
            assert!((0.9..1.1).contains(&(found * HIT)), "seed {seed}: {found}");
        }
    }

    /// What one path brought says nothing of whether others see it in the same place, however much it is.
    #[test]
    fn one_bright_path_has_one_voice() {
        let bright = |weight| Arrival { point: CENTRE, direction: Vec3::X, distance: HIT, weight };
        let few: Vec<Arrival> = std::iter::repeat_n(bright(1.0), 10).chain([bright(1e9)]).collect();
        assert_eq!(witnesses(&few).len(), 1);
        assert!((fitted(&BOUNDS, &few, |_, _| 1.0).curvature - 1.0 / HIT).abs() < 1e-6);
        for weight in [0.0, f32::NAN, f32::INFINITY] {
            assert_eq!(fitted(&BOUNDS, &[bright(weight)], |_, _| 1.0).curvature, 0.0);
        }
        assert_eq!(fitted(&BOUNDS, &[], |_, _| 1.0).curvature, 0.0);
    }
}
