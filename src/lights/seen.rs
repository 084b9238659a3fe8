//! The environment map as surfaces see it: a room does so through its windows, a floor above the horizon only. Light sampling chooses parts of the
//! sky by how often they are seen from surfaces that face one way, which is [counted](super::counted) beforehand. Parts are the
//! [`tiles`](crate::sampling::tiles) of the map.

use glam::Vec3;

use super::places::Odds;
use crate::math::lanes::{LANES, Mask, Real, V3};
use crate::sampling::tiles::Weights;

/// Number of facings: the six axis directions that a normal may be nearest to, and [`ANYWHERE`].
pub(super) const FACINGS: usize = 7;
/// Facing of points in media, which have no normal.
pub const ANYWHERE: u8 = 6;

/// Facing of a surface with a unit `normal`: +x, −x, +y, −y, +z, −z are 0 to 5; [`ANYWHERE`] for the normal zero.
#[inline(always)]
pub fn facing(normal: Vec3) -> u8 {
    facings(V3::from(normal)) as u8
}

/// The same as a number in each lane.
#[inline(always)]
pub fn facings<R: Real>(normal: V3<R>) -> R {
    let (size, number) = (normal.abs(), |number: f32| normal.x.all(number));
    let (x, y) = (size.x.ge(size.y) & size.x.ge(size.z), size.y.ge(size.z));
    let axis = x.choose(number(0.0), y.choose(number(2.0), number(4.0)));
    let along = x.choose(normal.x, y.choose(normal.y, normal.z));
    let towards = axis + along.below(0.0).choose(number(1.0), number(0.0));
    normal.is_zero().choose(number(f32::from(ANYWHERE)), towards)
}

/// Probabilities of the sky's tiles by facing.
#[derive(Debug, Clone)]
pub struct LearnedSky {
    facings: Vec<Weights>,
    gain: f64,
}

impl LearnedSky {
    /// Probabilities of tiles for each of [`FACINGS`], and what they gain.
    pub(super) fn new(facings: Vec<Weights>, gain: f64) -> Self {
        Self { facings, gain }
    }

    /// Second moment of the light that samples of the sky bring, over that without what was learned, in (0, 1).
    pub fn gain(&self) -> f64 {
        self.gain
    }
}

/// How points see the lights.
#[derive(Debug, Clone, Copy)]
pub struct LightView<'a> {
    /// What was learned of the sky; none where the map alone decides.
    pub learned: Option<&'a LearnedSky>,
    /// Facings of the points, lane by lane.
    pub facing: [u8; LANES],
    /// The odds of lights with a place, as they were learned where the points are; none where the light tree alone decides.
    pub odds: Option<[&'a Odds; LANES]>,
}

impl LightView<'_> {
    /// Nothing is learned.
    pub const PLAIN: Self = Self { learned: None, facing: [ANYWHERE; LANES], odds: None };

    /// The probabilities of tiles in a lane; none where the map alone decides.
    #[inline(always)]
    pub(super) fn weights(&self, lane: usize) -> Option<&Weights> {
        self.learned.map(|sky| &sky.facings[usize::from(self.facing[lane])])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facings_are_those_of_the_nearest_axis() {
        let found = [
            Vec3::new(0.9, 0.3, 0.0),
            Vec3::NEG_X,
            Vec3::Y,
            Vec3::new(0.1, -0.8, 0.2),
            Vec3::Z,
            Vec3::NEG_Z,
            Vec3::ZERO,
            Vec3::new(-0.6, 0.6, -0.6),
            Vec3::new(0.1, 0.7, -0.7),
        ];
        assert_eq!(found.map(facing), [0, 1, 2, 3, 4, 5, ANYWHERE, 1, 2]);
    }
}
