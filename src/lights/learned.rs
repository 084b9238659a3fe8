//! What is known of the lights before a render, and how light sampling uses it.

use glam::Vec3;

use super::counted::SkyCounts;
use super::places::{LightPlaces, Odds};
use super::seen::{LearnedSky, LightView};
use crate::math::lanes::LANES;

/// What was learned of the lights of a scene.
#[derive(Debug, Clone, Default)]
pub struct LearnedLights {
    /// Where the sky is seen; none where that is not worth knowing.
    pub sky: Option<LearnedSky>,
    /// Which lights with a place pay where; none where that is not worth knowing.
    pub places: Option<LightPlaces>,
}

/// How lights are sampled.
#[derive(Debug, Clone, Copy, Default)]
pub enum LightSampling<'a> {
    /// By their power and place alone.
    #[default]
    Plain,
    /// As plainly, and it is counted where the sky is seen and kept what came of the lights that have a place.
    Counted(&'a SkyCounts),
    /// By what was learned.
    Learned(&'a LearnedLights),
}

impl<'a> From<&'a LearnedLights> for LightSampling<'a> {
    fn from(learned: &'a LearnedLights) -> Self {
        if learned.sky.is_some() || learned.places.is_some() { Self::Learned(learned) } else { Self::Plain }
    }
}

impl<'a> LightSampling<'a> {
    /// What was learned of the sky.
    #[inline(always)]
    pub fn sky(self) -> Option<&'a LearnedSky> {
        if let Self::Learned(learned) = self { learned.sky.as_ref() } else { None }
    }

    /// The odds of lights that were learned at a point.
    #[inline(always)]
    pub fn odds(self, point: Vec3) -> Option<&'a Odds> {
        if let Self::Learned(learned) = self { learned.places.as_ref().map(|places| places.at(point)) } else { None }
    }

    /// The odds of lights that were learned at sixteen points, lane by lane.
    #[inline(always)]
    pub fn odds_lanes(self, point: impl Fn(usize) -> Vec3) -> Option<[&'a Odds; LANES]> {
        let Self::Learned(LearnedLights { places: Some(places), .. }) = self else { return None };
        Some(std::array::from_fn(|lane| places.at(point(lane))))
    }

    /// How a point sees the lights from a surface that faces that way.
    #[inline(always)]
    pub fn view(self, point: Vec3, facing: u8) -> LightView<'a> {
        let odds = self.odds(point).map(|odds| [odds; LANES]);
        LightView { learned: self.sky(), facing: [facing; LANES], odds }
    }

    /// Whether it matters which way surfaces face.
    #[inline(always)]
    pub fn asks_facing(self) -> bool {
        matches!(self, Self::Counted(_)) || self.sky().is_some()
    }
}
