//! Bounds of lights that have a place (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with Adaptive Tree Splitting*, §4.1).

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;

/// Bounds of a light's position, directions and intensity.
#[derive(Debug, Clone, Copy)]
pub struct LightBounds {
    /// Lower corner of the box around it.
    pub low: Vec3,
    /// Upper corner of the box.
    pub high: Vec3,
    /// Cone around all its normals, or its axes of symmetry, and how far around these it shines.
    pub cone: Cone,
    /// Radiant intensity in the direction where it is greatest, W·sr⁻¹, channel mean.
    pub intensity: f32,
}

/// A cone of normals around an axis, and the directions around each of them into which light goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Unit vector.
    pub axis: Vec3,
    /// Half angle in [0, π] of the cone of normals, θ_o of the paper.
    pub half: f32,
    /// Angle in [0, π/2] to a normal beyond which there is no light, θ_e.
    pub end: f32,
}

/// Greatest `end` of a spot; one that is wider counts as several. At the edge of a wide spot, which may be as bright as
/// its middle, the estimate, a cosine, would be next to nothing.
const WIDEST: f32 = 1.4;
/// Least measure of a cone: bounds of narrow spots would cost nothing, however they are divided.
const LEAST_MEASURE: f32 = 1e-3;

impl Cone {
    /// Every direction.
    pub const ALL: Self = Self { axis: Vec3::Z, half: PI, end: FRAC_PI_2 };

    /// Surfaces with normals within `half` of the unit vector `axis`.
    pub fn new(axis: Vec3, half: f32) -> Self {
        Self { axis, half, end: FRAC_PI_2 }
    }

    /// Light within `cutoff` of the unit vector `axis`, and nowhere else.
    pub fn beam(axis: Vec3, cutoff: f32) -> Self {
        Self { axis, half: (cutoff - WIDEST).max(0.0), end: cutoff.min(WIDEST) }
    }

    /// A cone around both.
    pub fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.half >= other.half { (self, other) } else { (other, self) };
        let (turn, cosine) = (wide.axis.cross(narrow.axis), wide.axis.dot(narrow.axis));
        // By sine and cosine: next to 1 a cosine alone tells angles of 3e-4 from 0 no more.
        let between = turn.length().atan2(cosine);
        let end = wide.end.max(narrow.end);
        if (between + narrow.half).min(PI) <= wide.half {
            return Self { end, ..wide };
        }
        let half = 0.5 * (wide.half + between + narrow.half);
        // Nearly opposite axes have no plane to turn in.
        if half >= PI || (cosine < 0.0 && turn.length_squared() < 1e-6) {
            return Self::ALL;
        }
        let turned = glam::Quat::from_axis_angle(turn.normalize(), half - wide.half) * wide.axis;
        Self { axis: turned.normalize(), half, end }
    }

    /// About the solid angle into which lights with these normals shine.
    fn measure(self) -> f32 {
        let end = (self.half + self.end).min(PI);
        let (half, cos) = (self.half, self.half.cos());
        let rim = 2.0 * end * half.sin() - (half - 2.0 * end).cos() - 2.0 * half * half.sin() + cos;
        (TAU * (1.0 - cos) + FRAC_PI_2 * rim).max(LEAST_MEASURE)
    }
}

impl LightBounds {
    /// Around both.
    pub fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            cone: self.cone.union(other.cone),
            intensity: self.intensity + other.intensity,
        }
    }

    /// Middle of the box.
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    /// Cost of a node with these bounds (Conty Estevez and Kulla 2018 §4.4).
    pub fn cost(&self) -> f32 {
        // Not the area of the box, which is nothing for lights on a line.
        self.intensity * self.cone.measure() * (self.high - self.low).length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Normals of a flat panel differ by rounding alone, those of one that is bent by 0.2 by little from each to the next: in any
    /// order cones around all of them are hardly wider.
    #[test]
    fn nearly_equal_axes_make_narrow_cones() {
        let mut random = Random::new(62, 0, 0);
        for bend in [0.0f32, 1e-4, 0.2] {
            for _ in 0..200 {
                let axis = (Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()) - 0.5).normalize();
                let side = axis.any_orthonormal_vector();
                let normals: Vec<Vec3> = (0..200)
                    .map(|i| {
                        let (sin, cos) = (bend * i as f32 / 199.0).sin_cos();
                        (cos * axis + sin * side + 6e-8 * random.next_f32()).normalize()
                    })
                    .collect();
                let cones = normals.iter().map(|&normal| Cone::new(normal, 0.0));
                let all = cones.reduce(Cone::union).unwrap();
                assert!(all.half < 0.5 * bend + 2e-3, "{bend}: {}", all.half);
                let outside = |normal: &Vec3| all.axis.angle_between(*normal) > all.half + 1e-3;
                assert!(!normals.iter().any(outside), "{bend}: {all:?}");
            }
        }
        let opposite = Cone::new(Vec3::Y, 0.1).union(Cone::new(-Vec3::Y, 0.1));
        assert_eq!(opposite, Cone::ALL);
    }

    /// Around several cones there is light wherever one of them has some.
    #[test]
    fn unions_end_no_sooner_than_their_parts() {
        let mut random = Random::new(63, 0, 0);
        let unit =
            |random: &mut Random| Vec3::from_array([(); 3].map(|()| random.range(-1.0, 1.0))).normalize_or(Vec3::Z);
        for _ in 0..2000 {
            let cone = |axis: Vec3, random: &mut Random| match random.below(3) {
                0 => Cone::new(axis, random.range(0.0, 1.0)),
                _ => Cone::beam(axis, random.range(0.0, PI)),
            };
            let parts: [Cone; 3] = std::array::from_fn(|_| cone(unit(&mut random), &mut random));
            let all = parts.into_iter().reduce(Cone::union).unwrap();
            let to = unit(&mut random);
            let reached = |cone: &Cone, more: f32| cone.axis.angle_between(to) <= cone.half + cone.end + more;
            assert!(reached(&all, 2e-3) || !parts.iter().any(|part| reached(part, 0.0)), "{parts:?} {to}");
        }
    }
}
