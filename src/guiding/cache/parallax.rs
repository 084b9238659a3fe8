//! Parallax: a near light lies in different directions from different points of a voxel.
//!
//! A voxel's distribution is kept for its centre. Directions are carried to another point of the voxel by way of a sphere around
//! the centre on which most of the light that arrives is taken to start (after Ruppert, Herholz and Lensch 2020, who do so for
//! each lobe of a mixture). A lit spot that is much smaller than the voxel then is a spot in the distribution too, instead of
//! being smeared over all directions in which the points of the voxel see it. With c the centre, R the radius, x the point: ω at
//! the centre becomes ω' = (c + Rω − x)/r at x, and dω = dω'·r²/(R²·(ω·ω')).

use glam::Vec3;

use crate::guiding::cache::Bounds;
use crate::math::lanes::{Mask, Real, V3};

/// Least radius of a sphere over half of the voxel's diagonal: so large that the map is far from singular.
const ROOM: f32 = 1.5;

/// Centre of a voxel, and the least distance from it at which light is taken to start.
pub(in crate::guiding) fn middle(bounds: &Bounds) -> (Vec3, f32) {
    (0.5 * (bounds.low + bounds.high), ROOM * 0.5 * (bounds.high - bounds.low).length())
}

/// Carries directions between a voxel's centre and its other points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parallax {
    /// The centre c.
    pub centre: Vec3,
    /// 1/R; 0 where light comes from far away, or nothing is known.
    pub curvature: f32,
}

/// A direction that was carried: ω at the centre or ω' elsewhere, and the factor dω/dω' by which a density over ω becomes one
/// over ω'.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Unit direction.
    pub direction: Vec3,
    /// dω/dω'.
    pub density: f32,
}

impl Parallax {
    /// No correction: directions are the same at all points.
    pub const NONE: Self = Self { centre: Vec3::ZERO, curvature: 0.0 };

    /// Centre and curvature.
    pub(in crate::guiding) fn to_array(self) -> [f32; 4] {
        self.centre.extend(self.curvature).to_array()
    }

    /// Fits the sphere of a voxel where light of the given weights started at the given places: the curvature is the mean of the
    /// inverse distances, by which the squared errors of directions are least. Places at infinity count as such.
    pub fn fit(bounds: &Bounds, starts: impl Iterator<Item = (Vec3, f32)>) -> Self {
        let (centre, least) = middle(bounds);
        let (mut sum, mut total) = (0.0f64, 0.0f64);
        for (start, weight) in starts.filter(|(_, weight)| *weight > 0.0 && weight.is_finite()) {
            if start.is_finite() {
                sum += f64::from(weight) / f64::from(start.distance(centre).max(least));
            }
            total += f64::from(weight);
        }
        let curvature = if total > 0.0 { (sum / total) as f32 } else { 0.0 };
        if curvature.is_finite() && centre.is_finite() { Self { centre, curvature } } else { Self::NONE }
    }

    /// The direction `away` at `point`, as seen from the centre.
    #[inline(always)]
    pub fn to_centre(&self, point: Vec3, away: Vec3) -> Carried {
        self.sphere().to_centre(point.into(), away.into()).into()
    }

    /// The direction `direction` at the centre, as seen from `point`.
    #[inline(always)]
    pub fn from_centre(&self, point: Vec3, direction: Vec3) -> Carried {
        self.sphere().from_centre(point.into(), direction.into()).into()
    }

    #[inline(always)]
    fn sphere(&self) -> Sphere<f32> {
        Sphere { centre: self.centre.into(), curvature: self.curvature }
    }
}

/// A [`Parallax`] in each lane.
#[derive(Debug, Clone, Copy)]
pub struct Sphere<R: Real> {
    /// The centre c.
    pub centre: V3<R>,
    /// 1/R, or 0.
    pub curvature: R,
}

/// See [`Carried`].
type CarriedLanes<R> = (V3<R>, R);

impl<R: Real> Sphere<R> {
    /// Offset of points from the centres in radii, and its squared length; none where there is nothing to correct, or the point lies outside.
    #[inline(always)]
    fn offset(&self, point: V3<R>) -> (V3<R>, R, R::Mask) {
        let offset = (point - self.centre) * self.curvature;
        let squared = offset.length_squared();
        (offset, squared, self.curvature.above(0.0) & squared.below(0.9))
    }

    /// The directions `away` at points as seen from the centres, with their factors.
    #[inline(always)]
    pub fn to_centre(&self, point: V3<R>, away: V3<R>) -> CarriedLanes<R> {
        let (offset, squared, any) = self.offset(point);
        // Along the ray to the unit sphere, from its inside: the only positive solution.
        let along = offset.dot(away);
        let distance = (along * along - squared + along.all(1.0)).sqrt() - along;
        let direction = offset + away * distance;
        carried(any, away, direction, density(direction, away, distance))
    }

    /// The directions `direction` at the centres as seen from points, with their factors.
    #[inline(always)]
    pub fn from_centre(&self, point: V3<R>, direction: V3<R>) -> CarriedLanes<R> {
        let (offset, _, any) = self.offset(point);
        let to = direction - offset;
        let distance = to.length();
        let away = to / distance;
        carried(any, direction, away, density(direction, away, distance))
    }
}

/// What was carried, or what was not.
#[inline(always)]
fn carried<R: Real>(any: R::Mask, as_it_was: V3<R>, direction: V3<R>, density: R) -> CarriedLanes<R> {
    (V3::choose(any, direction, as_it_was), any.choose(density, density.all(1.0)))
}

impl From<CarriedLanes<f32>> for Carried {
    #[inline(always)]
    fn from((direction, density): CarriedLanes<f32>) -> Self {
        Self { direction: direction.into(), density }
    }
}

/// dω/dω' with lengths in radii.
#[inline(always)]
fn density<R: Real>(direction: V3<R>, away: V3<R>, distance: R) -> R {
    distance * distance / direction.dot(away).at_least(1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::math::cylindrical;

    fn bounds() -> Bounds {
        Bounds { low: Vec3::splat(1.0), high: Vec3::new(1.3, 1.2, 1.1), depth: 0 }
    }

    fn some_direction(random: &mut Random) -> Vec3 {
        cylindrical::to_direction([random.next_f64(), random.next_f64()])
    }

    fn some_point(random: &mut Random) -> Vec3 {
        let u = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
        bounds().low + u * (bounds().high - bounds().low)
    }

    #[test]
    fn one_place_is_one_direction_from_everywhere() {
        let mut random = Random::new(1, 0, 0);
        for _ in 0..100 {
            let lamp = bounds().low + 2.0 * some_direction(&mut random);
            let parallax = Parallax::fit(&bounds(), [(lamp, 3.0)].into_iter());
            let expected = (lamp - parallax.centre).normalize();
            for _ in 0..20 {
                let point = some_point(&mut random);
                let away = (lamp - point).normalize();
                let seen = parallax.to_centre(point, away);
                assert!(seen.direction.distance(expected) < 1e-5, "{} {expected}", seen.direction);
                let back = parallax.from_centre(point, seen.direction);
                assert!(back.direction.distance(away) < 1e-5 && (back.density / seen.density - 1.0).abs() < 1e-4);
            }
        }
    }

    /// Catches a wrong Jacobian: the uniform density at the centre must have the mass 1 at every point.
    #[test]
    fn densities_keep_their_mass() {
        let mut random = Random::new(2, 0, 0);
        let parallax = Parallax { centre: Vec3::splat(1.1), curvature: 2.5 };
        for _ in 0..5 {
            let point = some_point(&mut random);
            let side = 200;
            let cell = |i: usize| (i as f64 + 0.5) / f64::from(side);
            let cells = (0..side as usize).flat_map(|x| (0..side as usize).map(move |y| [cell(x), cell(y)]));
            let mass: f64 = cells
                .map(|place| f64::from(parallax.to_centre(point, cylindrical::to_direction(place)).density))
                .sum::<f64>()
                / f64::from(side * side);
            assert!((mass - 1.0).abs() < 1e-3, "{mass}");
        }
    }

    #[test]
    fn nothing_is_corrected_without_a_distance() {
        let far = Parallax::fit(&bounds(), [(Vec3::INFINITY, 1.0)].into_iter());
        let none = Parallax::fit(&bounds(), std::iter::empty());
        for parallax in [far, none, Parallax::NONE] {
            let seen = parallax.to_centre(Vec3::splat(1.05), Vec3::X);
            assert_eq!(seen, Carried { direction: Vec3::X, density: 1.0 });
        }
        let near = Parallax::fit(&bounds(), [(Vec3::splat(1.1), 1.0)].into_iter());
        assert!(near.to_centre(bounds().high, Vec3::X).density.is_finite(), "even where light starts inside");
        assert_eq!(near.to_centre(Vec3::splat(50.0), Vec3::X).density, 1.0, "outside of the sphere");
    }
}
